"""Normal or planned movement, and how long it shall take."""

from __future__ import annotations

from typing import TYPE_CHECKING

from armctl.errors import InputError
from armctl.motion import Profile
from armctl.ui.widgets.number_field import NumberField

if TYPE_CHECKING:
    from armctl.ui.session import Session

_PLANNED = "Planned movement"
_NORMAL = "Normal movement"
_HINT = (
    "Planned: a third-order polynomial, all joints start and end together. "
    "Normal: nothing is planned between the two poses, each joint goes at its own speed."
)
_DURATION_HINT = "Seconds. 0 or empty: the shortest that the speed and acceleration limits allow."


class MovementChoice:
    """A dropdown and a duration; the duration is shown where it means something."""

    def __init__(self, session: Session) -> None:
        gui = session.gui
        self._profile = gui.add_dropdown("Movement", (_PLANNED, _NORMAL), initial_value=_PLANNED, hint=_HINT)
        self.duration = NumberField(gui, "Duration s", 0.0, hint=_DURATION_HINT)
        session.on(self._profile.on_update, self._on_profile)

    @property
    def profile(self) -> Profile:
        """The profile that is chosen."""
        return "normal" if self._profile.value == _NORMAL else "cubic"

    @property
    def visible(self) -> bool:
        """Whether the choice is shown."""
        return self._profile.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        if self._profile.visible != visible:
            self._profile.visible = visible
        self.duration.visible = visible and self.profile == "cubic"

    def checked(self) -> tuple[Profile, float | None]:
        """Profile and duration [s]; None: the shortest.

        Raises:
            InputError: the duration is no number, or negative.
        """
        if self.profile == "normal" or self.duration.is_empty:
            return self.profile, None
        seconds = self.duration.value
        if seconds < 0:
            raise InputError(f"Duration: {seconds:g} s is negative; 0 is the shortest possible")
        return self.profile, seconds or None

    async def _on_profile(self) -> None:
        self.duration.visible = self.visible and self.profile == "cubic"
