"""A step of your own: file, form, list, CSV column and range check come from this struct."""

from __future__ import annotations

from typing import Annotated, ClassVar

from msgspec import Meta

from armctl.errors import ProgramError
from armctl.program import Effect, Step
from armctl.program.base_steps import Field
from armctl.robot import Robot


class BlinkStep(Step, frozen=True, kw_only=True, tag="blink"):
    """Stand still while a lamp blinks."""

    button: ClassVar = ("Lamp", "Blink here", "roll_deg")

    flashes: Annotated[int, Meta(ge=1, le=20), Field("Flashes")] = 1
    each_s: Annotated[float, Meta(gt=0, le=5), Field("Flash s", "How long one flash takes.")] = 0.5
    roll_deg: float = 0.0

    @property
    def effect(self) -> Effect:
        """The lamp takes its time."""
        return Effect(wait_s=self.flashes * self.each_s, says=f"the lamp flashes {self.flashes} times")

    def describe(self) -> str:
        """How often."""
        return f"{self.flashes} flashes"

    def check(self, robot: Robot) -> None:
        """Refuse more than three flashes of a whole second."""
        if self.flashes > 3 and self.each_s >= 1:
            raise ProgramError("the lamp gets too hot")
