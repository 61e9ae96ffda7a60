"""Serial motion: a named list of steps that the arm runs once, N times or for ever."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, get_args

import msgspec
from msgspec import Meta

from armctl.motion.paths.tool_path import PitchMode
from armctl.motion.profiles.law import ProfileName

Percent = Annotated[float, Meta(ge=0, le=100)]
LONGEST_WAIT_S = 86_400
Seconds = Annotated[float, Meta(ge=0, le=LONGEST_WAIT_S)]
MOST_REPEATS = 1_000_000
SLOWEST_PERCENT = 5
WIDEST_BLEND_MM = 1000


class _Step(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", kw_only=True):
    """What all steps share; in the file, ``do`` names the kind."""

    note: str = ""


class _Motion(_Step, frozen=True, kw_only=True):
    """What all moving steps share."""

    duration_s: Seconds | None = None
    """None: as fast as the limits allow"""
    blend_mm: Annotated[float, Meta(ge=0, le=WIDEST_BLEND_MM)] = 0.0
    """how far from its end the tool may begin to turn off towards the next step; 0: it stops there"""


class MoveStep(_Motion, frozen=True, kw_only=True, tag="move"):
    """Go to joint angles [degrees], in the order of the robot's joints."""

    joints_deg: tuple[float, ...]
    profile: ProfileName = "cubic"


class PointStep(_Motion, frozen=True, kw_only=True, tag="point"):
    """Put the tool on a point [mm] by inverse kinematics, joint by joint."""

    x_mm: float
    y_mm: float
    z_mm: float
    pitch_deg: float | None = None
    roll_deg: float | None = None
    choose: str = "least-rotation"
    profile: ProfileName = "cubic"


class LineStep(_Motion, frozen=True, kw_only=True, tag="line"):
    """Lead the tool to a point [mm] in a straight line, on the branch the arm is on."""

    x_mm: float
    y_mm: float
    z_mm: float
    pitch: PitchMode = "kept"
    pitch_deg: float | None = None
    """tool pitch at the end; only with pitch = "interpolated", and needed there"""
    speed_mm_s: Annotated[float, Meta(gt=0)] | None = None
    """largest speed of the tool; None: as fast as the limits allow"""


class ArcStep(_Motion, frozen=True, kw_only=True, tag="arc"):
    """Lead the tool along a circular arc through a point to another [mm], on the branch the arm is on."""

    via_x_mm: float
    via_y_mm: float
    via_z_mm: float
    x_mm: float
    y_mm: float
    z_mm: float
    pitch: PitchMode = "kept"
    pitch_deg: float | None = None
    """as in a line"""
    speed_mm_s: Annotated[float, Meta(gt=0)] | None = None


class WaitStep(_Step, frozen=True, kw_only=True, tag="wait"):
    """Stand still."""

    seconds: Seconds


class GripperStep(_Step, frozen=True, kw_only=True, tag="gripper"):
    """Open the gripper to a percentage: 0 closed, 100 open."""

    open_percent: Percent


class SpeedStep(_Step, frozen=True, kw_only=True, tag="speed"):
    """Run the steps after it at a percentage of their speed, on top of the operator's override."""

    percent: Annotated[float, Meta(ge=SLOWEST_PERCENT, le=100)]


class RepeatStep(_Step, frozen=True, kw_only=True, tag="repeat"):
    """Run the steps as far as the matching ``end`` several times."""

    times: Annotated[int, Meta(ge=1, le=MOST_REPEATS)]


class EndStep(_Step, frozen=True, kw_only=True, tag="end"):
    """End of the block that the last open ``repeat`` began."""


class CommentStep(_Step, frozen=True, kw_only=True, tag="comment"):
    """Nothing: its note is for people."""


MotionStep = MoveStep | PointStep | LineStep | ArcStep
Step = MotionStep | WaitStep | GripperStep | SpeedStep | RepeatStep | EndStep | CommentStep


_DEFAULTS: dict[type, dict[str, object]] = {
    kind: {field.name: field.default for field in msgspec.structs.fields(kind)} for kind in get_args(Step)
}


def defaults_of(step: Step) -> Mapping[str, object]:
    """Every key of a step's kind and its default, or ``msgspec.NODEFAULT``."""
    return _DEFAULTS[type(step)]


def kind_of(step: Step) -> str:
    """What a step's ``do`` says in the file."""
    return str(step.__struct_config__.tag)


class Program(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A program, as written in its file."""

    format: Literal[1] = 1
    robot: str
    name: str = "untitled"
    steps: tuple[Step, ...] = ()
