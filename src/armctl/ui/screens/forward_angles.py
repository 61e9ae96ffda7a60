"""The angle fields of the Forward screen, and what each of the two buttons would do with them."""

from __future__ import annotations

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.errors import ArmctlError
from armctl.robot import Robot
from armctl.ui.widgets.html_bits import fixed, muted, refused
from armctl.ui.widgets.joint_step import held_at
from armctl.ui.widgets.number_field import NumberField
from armctl.ui.widgets.text import table

FloatArray = NDArray[np.float64]
REFERENCE = "Go with respect to reference"
LAST = "Go with respect to last position"
PRESENT = "present pose (live)"
SHOWN = ("angles as reference", "angles added to last position", PRESENT)


class AngleFields:
    """One field a joint, in degrees."""

    def __init__(self, gui: viser.GuiApi, robot: Robot, q: FloatArray) -> None:
        self.fields = [
            NumberField(
                gui,
                f"{joint.title} °",
                value,
                hint=limits_text(robot, i),
                disabled=held_at(joint) is not None,
            )
            for i, (joint, value) in enumerate(zip(robot.joints, np.degrees(q).tolist(), strict=True))
        ]

    def texts(self) -> tuple[str, ...]:
        """What the fields show."""
        return tuple(field.text for field in self.fields)

    def radians(self) -> FloatArray:
        """The angles (n,) [rad].

        Raises:
            InputError: a field is empty or holds no number; names it.
        """
        return np.radians([field.value for field in self.fields])

    def fill(self, q: FloatArray) -> None:
        """Put a configuration (n,) [rad] into the fields."""
        for field, value in zip(self.fields, np.degrees(q).tolist(), strict=True):
            field.fill(value)


def limits_text(robot: Robot, joint: int) -> str:
    """A joint's limits, in words."""
    if (held := held_at(robot.joints[joint])) is not None:
        return f"{robot.joints[joint].title}: {held}"
    low, high = np.degrees(robot.limits[joint]).tolist()
    return f"{robot.joints[joint].title}: {fixed(low, 2)}° … {fixed(high, 2)}°"


def resulting_pose(how: str, asked: FloatArray, present: FloatArray) -> FloatArray:
    """Where the arm would go: ``asked`` itself, or added to where it is commanded to be (n,) [rad]."""
    return present + asked if how in (LAST, SHOWN[1]) else asked


def results_html(robot: Robot, angles: AngleFields, present: FloatArray) -> str:
    """A row for where the arm is, and one for where each button would send it."""
    rows = [_row("now", robot, present)]
    problems = ""
    try:
        asked = angles.radians()
    except ArmctlError as refusal:
        return _table(robot, rows) + refused(f"Nothing can be sent: {refusal}.")
    for name, how in (("reference", REFERENCE), ("last position", LAST)):
        q = resulting_pose(how, asked, present)
        rows.append(_row(f"→ {name}", robot, q))
        try:
            robot.check_limits(q)
        except ArmctlError as refusal:
            problems += muted(f"✗ With respect to {name}: {refusal}.")
    return _table(robot, rows) + (problems or muted("Both are inside the joint limits."))


def _row(name: str, robot: Robot, q: FloatArray) -> list[str]:
    point = 1000 * robot.forward(q)[:3, 3]
    return [name, *(fixed(v, 1) for v in np.degrees(q).tolist()), *(fixed(v, 1) for v in point.tolist())]


def _table(robot: Robot, rows: list[list[str]]) -> str:
    head = ["will go to", *(f"θ{i + 1}°" for i in range(robot.n)), "x mm", "y mm", "z mm"]
    return f"<div style='font-size:11px'>{table(head, rows)}</div>"
