"""What every bus servo shares: the half-duplex line, the torque-on rite, the driver, and the simulated bus.

A make (``ServoMake``) has its folder beside this one: its packets, its control table, what its servos mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from armctl.hardware.driver import ChannelScale
from armctl.lazy_dataclass import dataclass
from armctl.robot.board_entries import BoardPart, ServoEntries
from armctl.robot.file import Strict
from armctl.robot.outputs import OutputMap

SCALE = ChannelScale("servo", "steps")
_JOINT_PERCENT, _GRIPPER_PERCENT = 100.0, 50.0
_Percent = Annotated[float, Meta(ge=5, le=100)]


class BusOptions(Strict, frozen=True):
    """``[board]`` of a servo bus, beside its kind."""

    supply_v: Annotated[float, Meta(ge=4, le=30)] | None = None
    """voltage of the supply; left out, the highest that each servo has measured since it was connected"""


@dataclass(frozen=True, slots=True)
class BusSettings:
    """What a robot file says of the servos of a bus, besides the map of the outputs."""

    torque: tuple[tuple[int, float], ...] = ()
    """by id, how strong each may be: a share of its full torque; one that is not named has all of it"""
    supply_v: float | None = None
    """without load [V]; None: as measured"""

    @property
    def torque_of(self) -> Mapping[int, float]:
        """The same, to look up."""
        return dict(self.torque)


@dataclass(frozen=True)
class BusEntries(ServoEntries):
    """Entries of servos that are told how strong they may be: ``torque_percent`` in each servo's table."""

    limited: bool = True
    """whether they can be told so"""

    @cached_property
    def models(self) -> tuple[type[msgspec.Struct], type[msgspec.Struct]]:
        """Of a joint's table and of the gripper's."""
        if not self.limited:
            return self._models((), ())
        return self._models(
            [("torque_percent", _Percent, _JOINT_PERCENT)], [("torque_percent", _Percent, _GRIPPER_PERCENT)]
        )

    def read(self, part: BoardPart) -> tuple[OutputMap | None, BusSettings | None]:
        """The map of the outputs, None where the file has none; and what the servos are told besides."""
        options = part.board(BusOptions)
        bare = replace(part.document, record={**part.document.record, "board": {"kind": part.kind}})
        part = replace(part, document=bare)
        outputs, _ = super().read(part)
        if outputs is None:
            return None, None
        joint, gripper = self.models
        servos: list[dict[str, Any]] = [msgspec.to_builtins(one) for one in part.outputs("servo", joint)]
        every = [one for servo in servos for one in (servo, *servo["also"])]
        if (hand := part.gripper("servo", gripper, "closed_steps", "open_steps")) is not None:
            every.append(msgspec.to_builtins(hand))
        torque = tuple((one["channel"], one["torque_percent"] / 100) for one in every if self.limited)
        return outputs, BusSettings(torque, options.supply_v)


SERVO_ENTRIES = BusEntries("steps", "steps", "range_steps", 0.0, 4095.0, 4096.0)
"""what a robot file says of a servo; its channel is its id"""
EEPROM_ADVICE = "armctl writes nothing into a servo's EEPROM unasked: see Main → Servos, or `armctl servos`"
