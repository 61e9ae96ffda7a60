"""Fields and sliders for joint angles, and fields for the whole orientation of a tool."""

from __future__ import annotations

from collections.abc import Awaitable
from contextlib import AbstractContextManager, nullcontext
from functools import partial

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.kinematics import quaternion_wxyz, roll_pitch_yaw, rotation_from_rpy
from armctl.kinematics.target import rotation_from_quaternion
from armctl.robot import Joint, Robot
from armctl.ui.events import Action, On
from armctl.ui.widgets.html import fixed
from armctl.ui.widgets.number_field import DEGREES, FieldArray, NumberField, NumbersField, TextEntry


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


def slider_degrees(robot: Robot, q: FloatArray, ends: FloatArray | None = None) -> list[float]:
    """``q`` (n,) [rad] as slider positions: degrees rounded to 0.01, inside the limits.

    ``ends``: ``slider_limits``, where the caller keeps them.
    """
    low, high = (slider_limits(robot) if ends is None else ends).T
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


Container = AbstractContextManager[object]
"""of viser: what is added within it stands in it"""
CONVENTION = "R = Rz(yaw) · Ry(pitch) · Rx(roll): turns about the base's x, then y, then z axis."
_TURNS = (
    ("Rx °", "Roll: the turn about the base's x axis, which comes first."),
    ("Ry °", "Pitch: the turn about the base's y axis, after that; not the tool's own pitch."),
    ("Rz °", "Yaw: the turn about the base's z axis, which comes last."),
)
_QUATERNION_HINT = "The same orientation as w, x, y, z, of any length. Type either; the other one follows."


class OrientationFields:
    """Rx, Ry and Rz, and the quaternion: each shows what was typed into the other."""

    def __init__(
        self, gui: viser.GuiApi, rotation: FloatArray, *, visible: bool = True, apart: Container | None = None
    ) -> None:
        """Add them to the present container, filled with ``R_base_tool`` (3, 3); the quaternion ``apart``."""
        turns = [
            NumberField(gui, label, None, hint=f"{hint} {CONVENTION}", visible=visible)
            for label, hint in _TURNS
        ]
        self._rpy = FieldArray(turns, DEGREES)
        with apart or nullcontext():
            self._quaternion = NumbersField(
                gui, "Quaternion", "wxyz", quaternion_wxyz(rotation), 1.0, _QUATERNION_HINT,
                digits=6, visible=visible,
            )  # fmt: skip
        self._by_quaternion = False
        self.fields: tuple[TextEntry, ...] = (*turns, self._quaternion)
        self.fill(rotation)

    def attach(self, on: On, changed: Action) -> None:
        """Let both follow each other; ``changed`` runs after each edit."""

        def typed(*, by_quaternion: bool) -> Awaitable[object] | None:
            self._by_quaternion = by_quaternion
            self._follow()
            return changed()

        *turns, quaternion = self.fields
        for field in turns:
            on(field.handle.on_update, partial(typed, by_quaternion=False))
        on(quaternion.handle.on_update, partial(typed, by_quaternion=True))

    @property
    def texts(self) -> tuple[str, ...]:
        """What the fields show."""
        return tuple(field.text for field in self.fields)

    @property
    def rotation(self) -> FloatArray:
        """``R_base_tool`` (3, 3) as it was typed last; errors name the field."""
        if self._by_quaternion:
            return rotation_from_quaternion(self._quaternion.array)
        return rotation_from_rpy(*self._rpy.array.tolist())

    def fill(self, rotation: FloatArray) -> None:
        """Show ``R_base_tool`` (3, 3)."""
        self._by_quaternion = False
        self._rpy.fill(roll_pitch_yaw(rotation))
        self._quaternion.fill(quaternion_wxyz(rotation))

    def show(self, *, visible: bool) -> None:
        """Show or hide all of it."""
        for field in self.fields:
            field.visible = visible

    def _follow(self) -> None:
        try:
            rotation = self.rotation
        except ArmctlError:  # half-typed: said when it is used
            return
        if self._by_quaternion:
            self._rpy.fill(roll_pitch_yaw(rotation))
        else:
            self._quaternion.fill(quaternion_wxyz(rotation))
