"""What a robot needs of its board, for the check-up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from armctl.hardware.doctor.finding import Finding, not_checked
from armctl.hardware.driver import ChannelSettings


@dataclass(frozen=True, slots=True)
class Needs:
    """The channels of a robot file, or why none can be checked."""

    channels: Sequence[ChannelSettings] = ()
    why_none: str = "no robot was named"
    advice: str = "name one with --robot"

    def not_known(self, check: str) -> Finding:
        """The finding of a check that takes a robot file for this board."""
        return not_checked(check, self.why_none, self.advice)


OF_ANOTHER_BOARD = Needs(
    why_none="the robot file is for another kind of board", advice="choose the robot that belongs to this one"
)
