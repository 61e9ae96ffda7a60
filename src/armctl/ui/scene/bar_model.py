"""What an arm without a look is drawn of: the shapes of its file, or its DH rows.

Rows give a bar along each a and d, a drum on each joint axis, a gripper or a tip.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from armctl.arrays import FloatArray
from armctl.robot import Robot
from armctl.robot.look.pieces import Mount
from armctl.robot.meshes import Drawn, coarse_solids
from armctl.robot.parts import Color, Look, Shape
from armctl.robot.shape import (
    FINGER,
    GAP_CLOSED,
    GAP_OPEN,
    PALM,
    TIP_LENGTH,
    TIP_RADIUS,
    bars,
    tool_length,
    width,
)
from armctl.robot.solids import beam, block, drum, grown, spike, tube
from armctl.ui.scene.arm_model import TOOL, ArmModel, Mesh

MOST_DRAWN, MOST_GHOSTLY = 30_000, 8_000
"""triangles of an arm (0.8 MB for each page), and of a ghost, of which a page may have many"""
_KEPT = 8
"""drawings: those of four arms"""


class _Drawings:
    """The drawings of some arms, as every page and every ghost asks for them, and reading takes seconds."""

    def __init__(self) -> None:
        self._kept: dict[tuple[tuple[Shape, ...], int], tuple[object, Drawn]] = {}

    def of(self, shapes: tuple[Shape, ...], most: int, *, anew: bool) -> Drawn:
        known = self._kept.get((shapes, most))
        if known is None or (anew and known[0] != _stamps(shapes)):
            return self.keep(shapes, most, coarse_solids(shapes, most))
        self._kept[shapes, most] = self._kept.pop((shapes, most))  # the newest: what is shown stays
        return known[1]

    def keep(self, shapes: tuple[Shape, ...], most: int, drawn: Drawn) -> Drawn:
        self._kept.pop((shapes, most), None)
        while len(self._kept) >= _KEPT:
            del self._kept[next(iter(self._kept))]
        self._kept[shapes, most] = _stamps(shapes), drawn
        return drawn


_DRAWINGS = _Drawings()


def drawn_solids(shapes: tuple[Shape, ...], most: int = MOST_DRAWN) -> Drawn:
    """As ``coarse_solids``, kept; read anew where a file has changed. May take seconds."""
    return _DRAWINGS.of(shapes, most, anew=True)


def keep_drawn(shapes: tuple[Shape, ...], drawn: Mapping[int, Drawn]) -> None:
    """Keep drawings by their number of triangles: the pages draw an arm as it was when it was opened."""
    for most, one in drawn.items():
        _DRAWINGS.keep(shapes, most, one)


def _stamps(shapes: tuple[Shape, ...]) -> tuple[tuple[int, int] | None, ...]:
    """What changes with the files: their times and sizes; None: there is none."""
    return tuple(_stamp(shape.file) for shape in shapes)


def _stamp(file: str) -> tuple[int, int] | None:
    try:
        status = os.stat(file)
    except (OSError, ValueError):
        return None
    return status.st_mtime_ns, status.st_size


_TOOL_COLOR: Color = (90, 90, 95)
# Proportions of the joints, as multiples of the links' width.
_DRUM_RADIUS, _DRUM_HEIGHT = {"round": 0.65, "square": 0.74}, 1.27
_TAPER = 0.02
"""each link is a little thinner than the one before: surfaces that two share would flicker"""
_FINGERS = f"{TOOL}/left", f"{TOOL}/right"


def bar_model(robot: Robot, thicker: float = 1.0, most: int = MOST_DRAWN) -> ArmModel:
    """The model of an arm without a look, ``thicker`` times as wide, of at most so many triangles of shapes.

    Its frames are those of ``Chain.places``, the last of which is the tool's, and one for each finger.
    """
    chain, look = robot.chain, replace(robot.look, width=thicker * robot.look.width)
    wide, names = width(chain, look), [*(f"f{i}" for i in range(len(chain.places) - 1)), TOOL]
    meshes = list(_shapes(robot, names, most, 0.5 * (thicker - 1.0) * wide))
    shown = {link for link, _ in meshes}
    parts = [mesh for _, mesh in meshes]
    parts += [*_links(robot, look, names, shown), *_joints(robot, look, names, shown)]
    fingers: tuple[str, ...] = ()
    if robot.n - 1 not in shown:
        if robot.gripper is None:  # a cone along the tool's z axis, its point in the tool point
            parts.append(Mesh(f"{TOOL}/tip", spike(wide * TIP_RADIUS, wide * TIP_LENGTH), _TOOL_COLOR))
        else:
            fingers = _FINGERS
            parts += _gripper(chain.length)

    def place(q: FloatArray, opening: FloatArray) -> FloatArray:
        frames = robot.frames(q)
        gap = chain.length * (GAP_CLOSED + (GAP_OPEN - GAP_CLOSED) * opening)
        sides = np.tile(np.eye(4), (len(q), len(fingers), 1, 1))
        sides[:, :, 1, 3] = np.stack([gap, -gap], axis=1)[:, : len(fingers)]
        return np.concatenate([frames, sides], axis=1)

    def frame_of(mount: Mount) -> tuple[str, FloatArray]:
        i, T = next((i, T) for i, (link, T) in enumerate(chain.places) if link == mount.hangs)
        return names[i], np.asarray(np.linalg.inv(T), dtype=np.float64)

    return ArmModel((*names, *fingers), tuple(parts), place, frame_of, tool_axes=robot.n - 1 in shown)


def _shapes(robot: Robot, names: list[str], most: int, out: float) -> Iterator[tuple[int, Mesh]]:
    """What the arm's file shows of its links, ``out`` [m] larger all round, and of which."""
    look, frames = robot.look, dict[int, str]()
    for name, (link, T) in zip(names, robot.chain.places, strict=True):
        if np.array_equal(T, np.eye(4)):
            frames[link] = name
    for i, (link, color, solid) in enumerate(_DRAWINGS.of(robot.shapes, most, anew=False)):
        color = color or look.links[max(link, 0) % len(look.links)]
        solid = grown(solid, out) if out > 0 else solid
        yield link, Mesh(f"{frames[link]}/s{i}", solid, color, flat=True)


def _links(robot: Robot, look: Look, names: list[str], shown: set[int]) -> Iterator[Mesh]:
    """A bar for each length in the rows, or from joint to joint."""
    chain, wide = robot.chain, width(robot.chain, look)
    solid = beam if look.shape == "square" else tube
    for bar in bars(chain, tool_length(chain, look, gripper=robot.gripper is not None)):
        if bar.length > 0.125 * wide and bar.link not in shown:
            color = look.links[max(bar.link, 0) % len(look.links)]
            tapered = wide * (1.0 - _TAPER * (bar.link + 1))
            yield Mesh(f"{names[bar.frame]}/{bar.name}", solid(bar.start, bar.end, tapered), color)


def _joints(robot: Robot, look: Look, names: list[str], shown: set[int]) -> Iterator[Mesh]:
    """A drum about each joint between two links that are drawn as bars."""
    chain, wide = robot.chain, width(robot.chain, look)
    axis = 0 if chain.convention == "standard" else 1  # the frame whose z a joint turns about
    for k, i in enumerate(chain.joint_rows):
        if not {k - 1, k} & shown:
            joint = drum(wide * _DRUM_RADIUS[look.shape], wide * _DRUM_HEIGHT)
            yield Mesh(f"{names[i + axis]}/j{i}", joint, look.joints)


def _gripper(reach: float) -> Iterator[Mesh]:
    """A palm and two fingers along the tool's z axis, ending at the tool point."""
    across, thickness, length = (reach * size for size in FINGER)
    palm = (reach * PALM[0], reach * PALM[1], reach * PALM[2])
    yield Mesh(f"{TOOL}/palm", block(palm, (0, 0, -length - 0.5 * palm[2])), _TOOL_COLOR)
    for side in _FINGERS:
        yield Mesh(f"{side}/finger", block((across, thickness, length), (0, 0, -0.5 * length)), _TOOL_COLOR)
