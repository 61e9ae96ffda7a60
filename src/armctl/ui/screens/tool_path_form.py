"""How a line or an arc of the tool shall be followed: end, via, pitch and speed."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.motion import PitchMode, usual_pitch
from armctl.ui.screens.motion_ends import metres, point_field
from armctl.ui.widgets.number_field import NumberField
from armctl.ui.widgets.numbers_field import NumbersField

if TYPE_CHECKING:
    from armctl.ui.session import Session

FloatArray = NDArray[np.float64]
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
