"""The profile of a motion over time, and its duration."""

from __future__ import annotations

import viser

from armctl.motion import PROFILES, Profile
from armctl.ui.events import On
from armctl.ui.widgets.number_field import NumberField

Laws = tuple[str, dict[str, Profile], str]
"""label, entries and hint of a dropdown; the first entry is chosen to begin with"""
ALL_PROFILES: Laws = (
    "Profile",
    {**{profile: profile for profile in PROFILES}, "normal (each joint for itself)": "normal"},
    "cubic: the papers' third-order polynomial. trapezoid: the fastest with limited acceleration. s-curve: "
    "with limited jerk as well, the fastest joint by joint and nearly so along a path. quintic: with limited "
    "jerk that does not jump on the way. normal: each joint at its own speed.",
)
MOVEMENTS: Laws = (
    "Movement",
    {"Planned movement": "cubic", "Normal movement": "normal", "From one side": "end-plus"},
    "Planned: a third-order polynomial, all joints start and end together. "
    "Normal: nothing is planned between the two poses, each joint goes at its own speed. "
    "From one side: planned; each joint that has play and carries no weight ends turning up, so that it "
    "stands on the same side of its play each time.",
)
_DURATION_HINT = "Seconds. Empty or 0: as short as this profile and the limits of the joints allow."


class ProfileChoice:
    """A dropdown and a duration; the duration is shown where it means something."""

    def __init__(self, gui: viser.GuiApi, on: On, laws: Laws) -> None:
        label, self._laws, hint = laws
        self.choice = gui.add_dropdown(label, tuple(self._laws), hint=hint)
        self.duration = NumberField(gui, "Duration s", None, hint=_DURATION_HINT)
        self._timed = True
        on(self.choice.on_update, self._show_duration)

    @property
    def profile(self) -> Profile:
        """The profile that is chosen."""
        return self._laws[self.choice.value]

    def show(self, *, profile: bool, duration: bool, normal: bool) -> None:
        """Show or hide the dropdown and the duration; ``normal``: whether "normal" is offered."""
        laws = tuple(name for name, profile in self._laws.items() if normal or profile != "normal")
        if tuple(self.choice.options) != laws:
            self.choice.options = laws
        self.choice.visible = profile
        self._timed = duration
        self._show_duration()

    def choose(self, profile: Profile) -> None:
        """Choose for the operator."""
        self.choice.value = next(name for name, law in self._laws.items() if law == profile)

    def checked(self) -> tuple[Profile, float | None]:
        """Profile and duration [s], None: the shortest; errors as ``NumberField.positive``."""
        if not self.duration.visible:
            return self.profile, None
        return self.profile, self.duration.positive("Duration", "s", "the shortest possible")

    def _show_duration(self) -> None:
        normal = self.choice.visible and self.profile == "normal"
        self.duration.visible = self._timed and not normal
