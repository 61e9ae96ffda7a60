"""A robot as a record: as it crosses from one process to another, and over the network."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, cast, get_type_hints

import msgspec
import numpy as np

from armctl.errors import InputError
from armctl.kinematics import Chain
from armctl.kinematics.chain import TurnLimit
from armctl.kinematics.frames import DHRow, FixedFrame
from armctl.robot.robot import Robot


def robot_record(robot: Robot) -> dict[str, Any]:
    """A robot as plain values, without what only its board reads."""

    def described(value: object) -> object:
        match value:
            case Chain():
                names = ("segments", "tail", "places", "rows", "convention", "coupling", "turn_limits")
                return {name: getattr(value, name) for name in names}
            case Mapping():
                return dict(cast("Mapping[str, object]", value))
            case _:
                return plain(value)

    without = ("board_settings", "flange")
    names = [one.name for one in fields(robot) if one.init and one.name not in without]
    held = {"tool": robot.tool, "openings": robot.openings, "part": robot.part}
    arm = robot.flange or robot
    return {
        name: msgspec.to_builtins(held.get(name, getattr(arm, name)), enc_hook=described) for name in names
    }


def robot_of(record: dict[str, Any]) -> Robot:
    """The robot of ``robot_record``; ``InputError`` where it is of another version of this program."""

    def built(kind: type, value: Any) -> Any:
        if kind is not Chain:
            return np.array(value, dtype=np.float64)
        places = msgspec.convert(value["places"], tuple[FixedFrame, ...], dec_hook=built)
        rows = msgspec.convert(value["rows"], tuple[DHRow, ...])
        segments, tail = [np.array(one) for one in value["segments"]], np.array(value["tail"])
        return Chain(
            segments,
            tail,
            places=places,
            rows=rows,
            convention=value["convention"],
            coupling=value["coupling"],
            turn_limits=msgspec.convert(value["turn_limits"], tuple[TurnLimit, ...]),
        )

    hints = get_type_hints(Robot)
    try:
        says = {name: msgspec.convert(one, hints[name], dec_hook=built) for name, one in record.items()}
        on, openings, part = says.pop("tool"), says.pop("openings"), says.pop("part")
        return replace(Robot(**says).with_tool(on), openings=openings, part=part)
    except (msgspec.MsgspecError, KeyError, TypeError, ValueError) as cause:
        raise InputError(
            f"the arm is described in the words of another version of armctl: {cause}"
        ) from cause


def plain(value: object) -> object:
    """Arrays as lists, a number that is not known as null."""
    if isinstance(value, np.ndarray):
        return (
            [None if math.isnan(one) else one for one in value.tolist()]
            if value.ndim == 1
            else value.tolist()
        )
    if isinstance(value, np.generic):
        return cast("object", value.item())
    raise NotImplementedError(f"a {type(value).__name__} does not travel")
