"""What a step of a program does when it runs, beside moving joints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from armctl.errors import ProgramError
from armctl.facts import Quantities
from armctl.robot import CarriedPart


@dataclass(frozen=True, slots=True)
class Senses:
    """What the board measures and sees at one moment."""

    quantities: Mapping[str, Quantities]
    """by title of a joint"""
    inputs: Mapping[str, float]
    """by name: 0, 1, or a share"""


@dataclass(frozen=True, slots=True)
class Until:
    """What a step waits for."""

    what: str
    """in words: "the load of Elbow above 40 %\""""
    holds: Callable[[Senses], bool]
    """whether it has come; asked once a tick, so it must be quick"""
    longest_s: float
    """the program ends with an error where it has not come by then"""

    def __post_init__(self) -> None:
        if not self.longest_s > 0.0:
            raise ProgramError(
                f"waiting for {self.what}: at most {self.longest_s:g} s is no time; more than 0"
            )


@dataclass(frozen=True, slots=True)
class Effect:
    """What a step does; of one that moves joints only ``says`` counts."""

    wait_s: float | None = None
    """the joints stand so long"""
    opening: float | None = None
    """where the gripper goes, 0..1; the joints stand meanwhile"""
    part: CarriedPart | None = None
    """what is between its jaws from then on; None: nothing"""
    until: Until | None = None
    """the joints stand until this holds"""
    percent: float | None = None
    """speed of the steps after it, on top of the operator's override"""
    says: str = ""
    """what the log says when it begins; empty: nothing"""

    @property
    def stands(self) -> bool:
        """The joints stand while it lasts."""
        return self.wait_s is not None or self.opening is not None or self.until is not None
