"""How a line or an arc of the tool shall be followed: end, via, pitch and speed."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.kinematics import Target
from armctl.motion import PitchMode, usual_pitch
from armctl.ui.session import Session
from armctl.ui.widgets.number_field import NumberField, NumbersField

# Where a motion on the Trajectory screen begins or ends: a pose, angles, or a point of the tool.

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


_PITCH: dict[str, PitchMode] = {"kept": "kept", "evenly to another": "interpolated", "free": "free"}
_PITCH_HINT = (
    "Tool pitch on the way. Kept: as at the start. Evenly to another: it turns to the pitch below. "
    "Free: whatever takes the least motion."
)
_SPEED_HINT = "Largest speed of the tool. 0 or empty: as fast as the joints can."
_VIA_MM, _END_MM = (0.0, 40.0, 20.0), (0.0, 80.0, 0.0)
"""from the tool of the first named pose: an arc and a line that most arms can follow"""


class ToolPathForm:
    """The fields of a tool line or a tool arc; hidden while another motion is chosen."""

    def __init__(self, session: Session, changed: Callable[[], None]) -> None:
        gui = session.gui
        self._changed = changed
        self._via = point_field(session, "Via X Y Z mm", _VIA_MM)
        self._end = point_field(session, "End X Y Z mm", _END_MM)
        usual = usual_pitch(session.console.robot)
        first = next(label for label, mode in _PITCH.items() if mode == usual)
        self._pitch = gui.add_dropdown(
            "Tool pitch", tuple(_PITCH), initial_value=first, hint=_PITCH_HINT, visible=False
        )
        self._end_pitch = NumberField(gui, "End pitch °", 0.0, visible=False)
        self._speed = NumberField(gui, "Tool speed mm/s", 0.0, hint=_SPEED_HINT, visible=False)
        self._shown = (False, False)
        session.on(self._pitch.on_update, self._on_pitch)

    @property
    def fields(self) -> tuple[NumbersField | NumberField, ...]:
        """Those that are typed into."""
        return self._via, self._end, self._end_pitch, self._speed

    @property
    def settings(self) -> tuple[str, ...]:
        """All that decides about the path."""
        return (self._pitch.value, *(field.text for field in self.fields if field.visible))

    def show(self, visible: bool, *, via: bool) -> None:
        """Show or hide the fields; ``via`` only for an arc."""
        self._shown = visible, via
        self._via.visible = visible and via
        self._end.visible = self._speed.visible = visible
        if self._pitch.visible != visible:
            self._pitch.visible = visible
        self._end_pitch.visible = visible and self.pitch == "interpolated"

    @property
    def via(self) -> FloatArray:
        """(3,) a point of the arc [m]; may raise InputError, as all of these."""
        return metres(self._via)

    @property
    def end(self) -> FloatArray:
        """(3,) where the tool shall go [m]."""
        return metres(self._end)

    @property
    def pitch(self) -> PitchMode:
        """What the tool pitch does on the way."""
        return _PITCH[self._pitch.value]

    @property
    def end_pitch(self) -> float | None:
        """Tool pitch at the end [rad]; None: none is asked for."""
        return math.radians(self._end_pitch.value) if self.pitch == "interpolated" else None

    @property
    def speed(self) -> float | None:
        """Largest speed of the tool [m/s]; None: as fast as the joints can.

        Raises:
            InputError: no number, or negative.
        """
        if self._speed.is_empty:
            return None
        speed = self._speed.value
        if speed < 0:
            raise InputError(f"Tool speed: {speed:g} mm/s is negative; 0 is as fast as the joints can")
        return speed / 1000 or None

    async def _on_pitch(self) -> None:
        self.show(self._shown[0], via=self._shown[1])
        self._changed()
