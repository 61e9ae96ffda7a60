"""Serial motion: a named list of steps that the arm runs once, N times or for ever."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

Percent = Annotated[float, Meta(ge=0, le=100)]
LONGEST_WAIT_S = 86_400
Seconds = Annotated[float, Meta(ge=0, le=LONGEST_WAIT_S)]
MOST_REPEATS = 1_000_000
SLOWEST_PERCENT = 5

ProfileName = Literal["cubic", "quintic", "trapezoid", "s-curve"]
"""the law of a motion over time; see ``armctl.motion.profiles``"""
PitchMode = Literal["kept", "interpolated", "free"]
"""tool pitch along a line or an arc: as at its start; evenly to that at its end; as it comes"""


class _Step(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", kw_only=True):
    """What all steps share; in the file, ``do`` names the kind."""

    note: str = ""


class _Motion(_Step, frozen=True, kw_only=True):
    """What all moving steps share."""

    duration_s: Seconds | None = None
    """None: as fast as the limits allow"""
    blend_mm: Annotated[float, Meta(ge=0, le=1000)] = 0.0
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


class Program(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A program, as written in its file."""

    format: Literal[1] = 1
    robot: str
    name: str = "untitled"
    steps: tuple[Step, ...] = ()
