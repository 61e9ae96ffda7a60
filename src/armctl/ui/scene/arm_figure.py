"""An arm drawn from its shapes, or from its DH rows.

Rows give a bar along each a and d, a drum on each joint axis, a gripper or a tip.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.kinematics import quaternion_wxyz
from armctl.robot import Robot
from armctl.robot.meshes import Drawn, coarse_solids
from armctl.robot.parts import Color, Shape
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
from armctl.robot.solids import Solid, beam, block, drum, grown, spike, tube


def send_pose(node: viser.SceneNodeHandle) -> None:
    """Send a new node's pose even where it is the default: a page keeps that of an older node of its name."""
    position, wxyz = node.position.copy(), node.wxyz.copy()
    node.position, node.wxyz = position + 1.0, np.roll(wxyz, 1)
    node.position, node.wxyz = position, wxyz


def add_solid(
    scene: viser.SceneApi,
    name: str,
    solid: Solid,
    color: Color,
    opacity: float | None = None,
    *,
    flat: bool = False,
) -> None:
    """Draw a solid; ``flat``: with edges, as machines have. One that is seen through casts no shadow."""
    scene.add_mesh_simple(
        name,
        solid.vertices,
        solid.faces,
        color=color,
        opacity=opacity,
        flat_shading=flat,
        cast_shadow=opacity is None,
        receive_shadow=opacity is None,
    )


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


class ArmFigure:
    """One drawing of an arm in a scene; ``pose`` moves it, its ``root`` shows, hides and removes it."""

    def __init__(
        self,
        scene: viser.SceneApi,
        robot: Robot,
        name: str,
        *,
        color: Color | None = None,
        opacity: float | None = None,
    ) -> None:
        """Draw the arm as it looks; ``color`` and ``opacity`` replace its own."""
        self._robot, self._scene, self._name = robot, scene, name
        self._color, self._opacity = color, opacity
        self._tool = f"f{len(robot.chain.places) - 1}"
        self._reach = robot.chain.length
        self._width = width(robot.chain, robot.look)
        self.root = scene.add_frame(name, show_axes=False)
        self._frames = [
            scene.add_frame(f"{name}/f{i}", show_axes=False) for i in range(len(robot.chain.places))
        ]
        self._q: FloatArray | None = None
        self._shown: FloatArray | None = None
        for frame in self._frames:
            send_pose(frame)
        meshed = self._draw_shapes()
        self._draw_links(meshed)
        self._label: viser.LabelHandle | None = None
        self._fingers: tuple[viser.FrameHandle, ...] = ()
        if robot.n - 1 in meshed:
            if opacity is None:
                size = self._width
                axes = scene.add_frame(f"{name}/{self._tool}/axes", axes_length=size, axes_radius=0.04 * size)
                send_pose(axes)
        elif robot.gripper is None:  # a cone along the tool's z axis, its point in the tool point
            tip = spike(self._width * TIP_RADIUS, self._width * TIP_LENGTH)
            self._add(f"{self._tool}/tip", tip, _TOOL_COLOR)
        else:
            self._fingers = self._draw_gripper()

    def pose(self, q: FloatArray, opening: float | None = None) -> None:
        """Move the figure to joint angles ``q`` (n,) [rad] and a gripper opening 0..1 (None: as it is)."""
        if self._q is None or not np.array_equal(q, self._q):
            self._q = q.copy()
            self._place(self._robot.frames(q))
        if self._fingers and opening is not None:
            for finger, y in zip(self._fingers, self._fingers_y(opening), strict=True):
                finger.position = (0.0, y, 0.0)

    def _place(self, frames: FloatArray) -> None:
        for i, handle in enumerate(self._frames):
            if self._shown is None or not np.array_equal(self._shown[i], frames[i]):
                handle.position = frames[i, :3, 3]
                handle.wxyz = quaternion_wxyz(frames[i, :3, :3])
        self._shown = frames

    def _fingers_y(self, opening: Any) -> tuple[Any, Any]:
        """How far the fingers are to either side at an opening 0..1, or at many [m]."""
        gap = self._reach * (GAP_CLOSED + (GAP_OPEN - GAP_CLOSED) * opening)
        return gap, -gap

    def tracks(self, q: FloatArray, opening: FloatArray) -> dict[str, FloatArray]:
        """Where ``pose`` would put its parts at angles (k, n) [rad] and openings (k,): by name (k, 7).

        Columns: x, y, z [m] and the quaternion w, x, y, z, whose sign does not jump.
        """
        frames, tracks = self._robot.frames(q), dict[str, FloatArray]()
        for i, handle in enumerate(self._frames):
            turned = np.array([quaternion_wxyz(T[:3, :3]) for T in frames[:, i]])
            flips = np.where((turned[1:] * turned[:-1]).sum(axis=1) < 0, -1.0, 1.0)
            turned[1:] *= np.cumprod(flips)[:, None]
            tracks[handle.name] = np.hstack([frames[:, i, :3, 3], turned])
        for finger, y in zip(self._fingers, self._fingers_y(opening), strict=False):
            tracks[finger.name] = np.zeros((len(q), 7))
            tracks[finger.name][:, 1], tracks[finger.name][:, 3] = y, 1.0
        return tracks

    def say(self, words: str | None) -> None:
        """Write words at the tool point; None: nothing."""
        if words is not None and (self._label is None or self._label.text != words):
            self.say(None)
            self._label = self._scene.add_label(
                f"{self._name}/{self._tool}/words", words, anchor="bottom-center"
            )
            send_pose(self._label)
        elif words is None and self._label is not None:
            self._label.remove()
            self._label = None

    def _draw_shapes(self) -> set[int]:
        """Draw what the arm's file shows of its links; which links that are."""
        look, meshed = self._robot.look, set[int]()
        most = MOST_DRAWN if self._opacity is None else MOST_GHOSTLY
        solids = _DRAWINGS.of(self._robot.shapes, most, anew=False)
        frames = {
            link: i for i, (link, T) in enumerate(self._robot.chain.places) if np.array_equal(T, np.eye(4))
        }
        for i, (link, color, solid) in enumerate(solids):
            if look.thicker > 1.0:
                solid = grown(solid, 0.5 * (look.thicker - 1.0) * self._width)
            color = color or look.links[max(link, 0) % len(look.links)]
            self._add(f"f{frames[link]}/s{i}", solid, color, flat=True)
            meshed.add(link)
        return meshed

    def _draw_links(self, meshed: set[int]) -> None:
        chain, look = self._robot.chain, self._robot.look
        solid = beam if look.shape == "square" else tube
        shorten = tool_length(chain, look, gripper=self._robot.gripper is not None)
        for bar in bars(chain, shorten):
            if bar.length > 0.125 * self._width and bar.link not in meshed:
                color = look.links[max(bar.link, 0) % len(look.links)]
                width = self._width * (1.0 - _TAPER * (bar.link + 1))
                self._add(f"f{bar.frame}/{bar.name}", solid(bar.start, bar.end, width), color)
        axis = 0 if chain.convention == "standard" else 1  # the frame whose z a joint turns about
        for k, i in enumerate(chain.joint_rows):
            if k in meshed or k - 1 in meshed:
                continue
            joint = drum(self._width * _DRUM_RADIUS[look.shape], self._width * _DRUM_HEIGHT)
            self._add(f"f{i + axis}/j{i}", joint, look.joints)

    def _draw_gripper(self) -> tuple[viser.FrameHandle, ...]:
        """A palm and two fingers along the tool's z axis, ending at the tool point."""
        across, thickness, length = (self._reach * size for size in FINGER)
        palm = (self._reach * PALM[0], self._reach * PALM[1], self._reach * PALM[2])
        self._add(f"{self._tool}/palm", block(palm, (0, 0, -length - 0.5 * palm[2])), _TOOL_COLOR)
        fingers: list[viser.FrameHandle] = []
        for side in ("left", "right"):
            fingers.append(self._scene.add_frame(f"{self._name}/{self._tool}/{side}", show_axes=False))
            send_pose(fingers[-1])
            finger = block((across, thickness, length), (0, 0, -0.5 * length))
            self._add(f"{self._tool}/{side}/finger", finger, _TOOL_COLOR)
        return tuple(fingers)

    def _add(self, name: str, solid: Solid, color: Color, *, flat: bool = False) -> None:
        add_solid(self._scene, f"{self._name}/{name}", solid, self._color or color, self._opacity, flat=flat)
