"""What an arm has beside its joints: gripper, look, shapes, and what stands around it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from armctl.arrays import ArrayRecord, FloatArray
from armctl.robot.look.rows import AnyRow, MakeName, Material


@dataclass(frozen=True, slots=True)
class Gripper:
    """The gripper as an opening from 0 (closed) to 1 (open)."""

    title: str
    speed: float
    """largest speed [opening/s]"""


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
