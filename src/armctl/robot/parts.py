"""What an arm consists of: joints, gripper, look and shapes; and what stands around it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import ArrayRecord, FloatArray
from armctl.facts import AngleLimit
from armctl.kinematics.angles import LIMIT_TOLERANCE
from armctl.lazy_dataclass import dataclass
from armctl.robot.look.rows import AnyRow, MakeName, Material

# A joint: its limits, and the owner of what its value means and how it is shown and read.

MOST_JOINTS = 64
"""no arm has more: solvers and checks take time and memory for each"""
JERK_UP_S = 0.05
"""Where nothing else is written, a joint reaches its largest acceleration in this time."""


@dataclass(frozen=True, slots=True)
class Joint:
    """One joint, which turns: its values are radians inside, and degrees wherever people read or write them.

    A joint that slides would differ here, and in the chain: whoever shows or reads a value asks the joint.
    """

    unit: ClassVar[str] = "°"
    """of its values, as people read them"""

    name: str
    title: str
    lower: float
    upper: float
    speed: float
    """largest speed [rad/s]"""
    acceleration: float
    """largest acceleration [rad/s²]"""
    jerk: float
    """largest jerk [rad/s³]; kept by the profiles that know one (s-curve, quintic)"""
    stall_torque: float | None
    """[N·m]; None where the source gives none"""
    jerk_told: bool = False
    """its file gives the jerk: a pen keeps to it, too; else it is taken from the acceleration"""
    torque_is_effort: bool = False
    """True: that is the ``effort`` of a URDF file, which often is a placeholder and forbids nothing"""

    def shown(self, value: float) -> float:
        """A value as people count it."""
        return math.degrees(value)

    def read(self, shown: float) -> float:
        """The value of a number as people count it."""
        return math.radians(shown)

    def said(self, value: float, digits: int = 2) -> str:
        """A value with its unit, such as ``−12.50°``."""
        return f"{self.shown(value):.{digits}f}{self.unit}"


def beyond_limits(joints: Sequence[Joint], q: FloatArray) -> tuple[AngleLimit, ...]:
    """Which of the values (n,) are outside their limits."""
    return tuple(
        AngleLimit(joint.title, value, joint.lower, joint.upper)
        for joint, value in zip(joints, q.tolist(), strict=True)
        if not joint.lower - LIMIT_TOLERANCE <= value <= joint.upper + LIMIT_TOLERANCE
    )


def spoken(name: str) -> str:
    """A name as people write it: ``wrist_roll`` is "Wrist roll"."""
    return name.replace("_", " ").capitalize()


def shown_values(joints: Sequence[Joint], q: ArrayLike) -> FloatArray:
    """Values (..., n) of all joints, or how much they change, as people count them."""
    return np.degrees(q)


def read_values(joints: Sequence[Joint], shown: ArrayLike) -> FloatArray:
    """The values (..., n) of numbers as people count them."""
    return np.radians(shown)


@dataclass(frozen=True, slots=True)
class Gripper:
    """The gripper as an opening from 0 (closed) to 1 (open)."""

    title: str
    speed: float
    """largest speed [opening/s]"""
    output: str = ""
    """name of the output that closes it while it is on; empty: the board moves it like a joint"""
    part_input: str = ""
    """name of the input that is on while it holds a part; empty: nothing tells"""


# How an arm is drawn, and what is kept apart.

Color = tuple[int, int, int]
Hand = Literal["jaws", "cup", "pen", "tip"]
"""what an arm without a look is drawn with at its tool point"""


@dataclass(frozen=True, slots=True)
class Look:
    """Colours (red, green, blue 0..255) and proportions; the links themselves come from the DH rows."""

    links: tuple[Color, ...] = (
        (52, 73, 94),
        (41, 128, 185),
        (230, 126, 34),
        (39, 174, 96),
        (142, 68, 173),
    )
    """one a joint, used over and over where there are more joints"""
    joints: Color = (60, 60, 65)
    shape: Literal["round", "square"] = "round"
    """cross-section of the links"""
    width: float = 0.052
    """width of the links as a fraction of the arm's reach"""
    rows: tuple[AnyRow, ...] = ()
    """its solids; empty: they are guessed, as wide and coloured as above"""
    pose: tuple[float, ...] = ()
    """how it stands where the rows describe it: its joints [rad]; empty: all at 0"""
    source: str = ""
    """where the sizes of the rows come from"""
    material: Material = "printed"
    """of solids whose row says none"""
    servo: MakeName | None = None
    """without rows: the make of its servos, after which the look that is guessed has its sizes"""
    hand: Hand | None = None
    """without rows: what is at the tool point; None: jaws where the arm has a gripper, else a tip"""


@dataclass(frozen=True, slots=True, eq=False)
class Shape(ArrayRecord):
    """A solid or a mesh that is part of a link."""

    kind: Literal["box", "cylinder", "sphere", "mesh"]
    size: tuple[float, ...]
    """of a box (3), radius and length of a cylinder, radius of a sphere [m]; factors (3) of a mesh"""
    pose: FloatArray
    """(4, 4) in the link's frame (``LinkFrames``) [m]"""
    file: str = ""
    """of a mesh"""
    color: Color | None = None
    link: int = -1
    """index of the joint that moves it; -1: the base"""


# Things around the arm that it must stay out of.


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle(ArrayRecord):
    """A box along the axes of the base frame: a table, a wall, a conveyor."""

    title: str
    low: FloatArray
    """(3,) its lower corner, base frame [m]"""
    high: FloatArray
    """(3,) its upper corner [m]"""
