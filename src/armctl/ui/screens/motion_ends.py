"""Where a motion on the Trajectory screen begins or ends: a pose, angles, or a point of the tool."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics import Target
from armctl.ui.widgets.numbers_field import NumbersField

if TYPE_CHECKING:
    from armctl.ui.session import Session

FloatArray = NDArray[np.float64]
PRESENT = "present pose"
ANGLES = "angles"
POINT = "X Y Z"
_XYZ = ("X", "Y", "Z")
_XYZ_HINT = "Tool point in the base frame [mm], by inverse kinematics; e.g. 220, −196, 85."


class EndChoice:
    """A dropdown, and the field that the chosen kind of end needs."""

    def __init__(self, session: Session, label: str, initial: str, changed: Callable[[], None]) -> None:
        """Add both to the present container.

        Args:
            session: of the page.
            label: "From" or "To".
            initial: what is chosen first: ``PRESENT`` or a pose's name.
            changed: called when another kind is chosen.
        """
        gui, self._robot = session.gui, session.console.robot
        self._changed = changed
        self._visible = True
        pose = self._robot.pose(next(iter(self._robot.poses)))
        self._kind = gui.add_dropdown(
            label, (PRESENT, *self._robot.poses, ANGLES, POINT), initial_value=initial
        )
        titles = [joint.title for joint in self._robot.joints]
        hint = f"Joint angles [°]: {', '.join(titles)}."
        angles = np.degrees(pose).tolist()
        self._angles = NumbersField(gui, f"{label} θ °", titles, angles, hint=hint, visible=False)
        self._point = point_field(session, f"{label} X Y Z mm")
        session.on(self._kind.on_update, self._on_kind)

    @property
    def fields(self) -> tuple[NumbersField, ...]:
        """Those that are typed into."""
        return self._angles, self._point

    @property
    def kind(self) -> str:
        """What is chosen: ``PRESENT``, a pose's name, ``ANGLES`` or ``POINT``."""
        return self._kind.value

    @property
    def is_point(self) -> bool:
        """Whether inverse kinematics is needed."""
        return self._visible and self.kind == POINT

    @property
    def settings(self) -> tuple[str, ...]:
        """All that decides about the end, but for where the arm stands."""
        typed = {ANGLES: self._angles.text, POINT: self._point.text}
        return self.kind, typed.get(self.kind, "")

    @property
    def title(self) -> str:
        """The end in a few words."""
        if self.kind == ANGLES:
            return f"({self._angles.text})°"
        return f"({self._point.text}) mm" if self.kind == POINT else self.kind

    def show(self, visible: bool) -> None:
        """Show or hide the choice and its field."""
        self._visible = visible
        if self._kind.visible != visible:
            self._kind.visible = visible
        self._angles.visible = visible and self.kind == ANGLES
        self._point.visible = visible and self.kind == POINT

    def asked(self, present: FloatArray) -> FloatArray | Target:
        """Joint angles (n,) [rad], or where the tool shall be.

        Raises:
            InputError: a field holds no numbers that can be used.
        """
        if self.kind == PRESENT:
            return present
        if self.kind == ANGLES:
            return np.radians(self._angles.values)
        if self.kind == POINT:
            return Target.of(metres(self._point))
        return self._robot.pose(self.kind)

    async def _on_kind(self) -> None:
        self.show(self._visible)
        self._changed()


def point_field(
    session: Session, label: str, offset_mm: tuple[float, float, float] = (0, 0, 0)
) -> NumbersField:
    """A hidden field for a tool point, filled with that of the first named pose, moved a little."""
    robot = session.console.robot
    point = 1000 * robot.forward(robot.pose(next(iter(robot.poses))))[:3, 3] + offset_mm
    return NumbersField(session.gui, label, _XYZ, point.round(1).tolist(), hint=_XYZ_HINT, visible=False)


def metres(field: NumbersField) -> FloatArray:
    """The point (3,) in a field [m].

    Raises:
        InputError: the field holds no numbers that can be used.
    """
    return np.array(field.values) / 1000
