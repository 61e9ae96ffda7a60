"""By which law a motion is spread over time, and how long it shall take."""

from __future__ import annotations

from typing import TYPE_CHECKING

from armctl.errors import InputError
from armctl.motion import PROFILES, Profile
from armctl.ui.widgets.number_field import NumberField

if TYPE_CHECKING:
    from armctl.ui.session import Session

_NORMAL = "normal (each joint for itself)"
_HINT = (
    "cubic: the papers' third-order polynomial. quintic: least jerk. trapezoid: the shortest with limited "
    "acceleration. s-curve: the shortest with limited jerk as well. normal: each joint at its own speed."
)
_DURATION_HINT = "Seconds. 0 or empty: the shortest that the limits allow."


class ProfileChoice:
    """A dropdown and a duration; the duration is shown where it means something."""

    def __init__(self, session: Session) -> None:
        gui = session.gui
        self._profile = gui.add_dropdown("Profile", (*PROFILES, _NORMAL), initial_value="cubic", hint=_HINT)
        self.duration = NumberField(gui, "Duration s", 0.0, hint=_DURATION_HINT)
        self._duration_shown = True
        session.on(self._profile.on_update, self._on_profile)

    @property
    def profile(self) -> Profile:
        """The profile that is chosen."""
        return "normal" if self._profile.value == _NORMAL else self._profile.value

    @property
    def settings(self) -> tuple[str, ...]:
        """All that decides, as far as it is shown."""
        law = self._profile.value if self._profile.visible else ""
        return law, self.duration.text if self.duration.visible else ""

    def show(self, *, profile: bool, duration: bool, normal: bool) -> None:
        """Show or hide.

        Args:
            profile: the choice of a law.
            duration: the field for the duration.
            normal: whether "normal" is among the laws.
        """
        laws = (*PROFILES, _NORMAL) if normal else PROFILES
        if tuple(self._profile.options) != laws:
            self._profile.options = laws
        if self._profile.visible != profile:
            self._profile.visible = profile
        self._duration_shown = duration
        self.duration.visible = duration and not (profile and self.profile == "normal")

    def choose(self, profile: Profile) -> None:
        """Choose for the operator."""
        self._profile.value = _NORMAL if profile == "normal" else profile

    def checked(self) -> tuple[Profile, float | None]:
        """Profile and duration [s]; None: the shortest.

        Raises:
            InputError: the duration is no number, or negative.
        """
        if not self.duration.visible or self.duration.is_empty:
            return self.profile, None
        seconds = self.duration.value
        if seconds < 0:
            raise InputError(f"Duration: {seconds:g} s is negative; 0 is the shortest possible")
        return self.profile, seconds or None

    async def _on_profile(self) -> None:
        self.duration.visible = self._duration_shown and self.profile != "normal"
