"""Serial motion: a named list of steps that the arm runs once, N times or for ever."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

Percent = Annotated[float, Meta(ge=0, le=100)]
LONGEST_WAIT_S = 86_400
Seconds = Annotated[float, Meta(ge=0, le=LONGEST_WAIT_S)]


class _Step(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", kw_only=True):
    """What all steps share; in the file, ``do`` names the kind."""

    note: str = ""


class MoveStep(_Step, frozen=True, tag="move"):
    """Go to joint angles [degrees], in the order of the robot's joints."""

    joints_deg: tuple[float, ...]
    duration_s: Seconds | None = None
    """None: as fast as the speed and acceleration limits allow"""


class PointStep(_Step, frozen=True, tag="point"):
    """Put the tool on a point [mm] by inverse kinematics."""

    x_mm: float
    y_mm: float
    z_mm: float
    pitch_deg: float | None = None
    roll_deg: float | None = None
    choose: str = "least-rotation"
    duration_s: Seconds | None = None


class WaitStep(_Step, frozen=True, tag="wait"):
    """Stand still."""

    seconds: Seconds


class GripperStep(_Step, frozen=True, tag="gripper"):
    """Open the gripper to a percentage: 0 closed, 100 open."""

    open_percent: Percent


Step = MoveStep | PointStep | WaitStep | GripperStep


class Program(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A program, as written in its file."""

    format: Literal[1] = 1
    robot: str
    name: str = "untitled"
    steps: tuple[Step, ...] = ()
