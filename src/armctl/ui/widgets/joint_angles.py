"""Joint angles as sliders and fields show them."""

from __future__ import annotations

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.robot import Joint, Robot
from armctl.ui.widgets.html import fixed
from armctl.ui.widgets.number_field import DEGREES, FieldArray, NumberField


def held_at(joint: Joint) -> str | None:
    """What the controls of a joint say whose limits are one and the same angle; None: it can turn."""
    return (
        f"held at {round(joint.shown(joint.lower), 2):g}{joint.unit}" if joint.lower == joint.upper else None
    )


def slider_limits(robot: Robot) -> FloatArray:
    """(n, 2) ends of the sliders [degrees]: the limits, or the hundredth next to them inside."""
    exact = robot.shown(robot.limits.T).T
    low, high = np.ceil(100 * exact[:, 0] - 1e-9) / 100, np.floor(100 * exact[:, 1] + 1e-9) / 100
    return np.where((low < high)[:, None], np.stack([low, high], axis=1), exact)


def slider_degrees(robot: Robot, q: FloatArray) -> list[float]:
    """``q`` (n,) [rad] as slider positions: degrees rounded to 0.01, inside the limits."""
    low, high = slider_limits(robot).T
    return np.clip(np.round(robot.shown(q), 2), low, high).tolist()


def angle_fields(gui: viser.GuiApi, robot: Robot, q: FloatArray) -> FieldArray:
    """A field a joint, in degrees, filled with ``q`` (n,) [rad]; one that is held cannot be typed into."""
    fields: list[NumberField] = []
    for joint, (low, high) in zip(robot.joints, robot.shown(robot.limits.T).T.tolist(), strict=True):
        held = held_at(joint)
        hint = f"{joint.title}: {held or f'{fixed(low, 2)}° … {fixed(high, 2)}°'}"
        fields.append(NumberField(gui, f"{joint.title} °", None, hint=hint, disabled=held is not None))
    angles = FieldArray(fields, DEGREES)
    angles.fill(q)
    return angles
