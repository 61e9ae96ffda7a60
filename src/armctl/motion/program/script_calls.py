"""Which call of ``Arm`` stands for which kind of step."""

from __future__ import annotations

from typing import NamedTuple


class Argument(NamedTuple):
    """One argument of a call."""

    name: str
    keys: tuple[str, ...]
    """of the step; more than one: a tuple of them"""
    positional: bool = False
    optional: bool = False


class Call(NamedTuple):
    """A method of ``Arm``."""

    name: str
    do: str
    arguments: tuple[Argument, ...]


def _required(*names: str, positional: bool = False) -> tuple[Argument, ...]:
    return tuple(Argument(name, (name,), positional) for name in names)


def _optional(*names: str) -> tuple[Argument, ...]:
    return tuple(Argument(name, (name,), optional=True) for name in names)


_POINT = ("x_mm", "y_mm", "z_mm")
_VIA = ("via_x_mm", "via_y_mm", "via_z_mm")
_LED = _optional("pitch", "pitch_deg", "speed_mm_s", "duration_s", "blend_mm")
_ALL = (
    Call(
        "go_joints",
        "move",
        (*_required("joints_deg", positional=True), *_optional("duration_s", "profile", "blend_mm")),
    ),
    Call(
        "go",
        "point",
        (
            *_required(*_POINT),
            *_optional("pitch_deg", "roll_deg", "choose", "duration_s", "profile", "blend_mm"),
        ),
    ),
    Call("line", "line", (*_required(*_POINT), *_LED)),
    Call("arc", "arc", (Argument("via_mm", _VIA), Argument("to_mm", _POINT), *_LED)),
    Call("wait", "wait", (Argument("seconds", ("seconds",), positional=True),)),
    Call("gripper", "gripper", (Argument("open_percent", ("open_percent",), positional=True),)),
    Call("set_speed", "speed", (Argument("percent", ("percent",), positional=True),)),
)
CALLS = {call.do: call for call in _ALL}
"""by the kind of step"""
BY_NAME = {call.name: call for call in _ALL}
"""by the name of the method"""
