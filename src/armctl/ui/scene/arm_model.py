"""What an arm is drawn of: frames that move, and meshes in them, of its shapes or its look."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.chain import Chain, LinkFrames
from armctl.robot import Robot
from armctl.robot.look.pieces import Jaw, Mount, Piece
from armctl.robot.shape import width
from armctl.robot.solids import Solid, creased, grown, joined
from armctl.ui.scene.arm_mesh import TOOL, Mesh, link_frame
from armctl.ui.scene.shape_drawings import MOST_DRAWN, MOST_GHOSTLY, shape_meshes

_CREASE = math.radians(38)
"""Faces that meet at a flatter angle are shaded as one surface."""
_KEPT = 16
"""models: the present arm, its ghost, and one for each branch of a target"""


@dataclass(frozen=True, slots=True, eq=False)
class ArmModel:
    """An arm to draw."""

    frames: tuple[str, ...]
    """their names below the arm's own; a frame in another one is named behind it"""
    meshes: tuple[Mesh, ...]
    place: Callable[[FloatArray, FloatArray], FloatArray]
    """Angles (k, n) [rad] and openings (k,) -> the pose of each frame in the one that it is in, or in the
    base's: (k, frames, 4, 4), metres"""
    frame_of: Callable[[Mount], tuple[str, FloatArray]]
    """The name of the frame that a mount moves with, and its pose (4, 4) in there [m]"""
    tool_axes: bool = False
    """whether nothing else shows where the tool point is"""

    def bounds(self, q: FloatArray) -> FloatArray:
        """Corners (k, 3) of boxes round all meshes at ``q`` (m, n), the gripper open, base frame [m]."""
        placed = self.place(q, np.ones(len(q)))
        poses = dict(zip(self.frames, placed.swapaxes(0, 1), strict=True))
        found = [np.empty((0, 3))]
        for mesh in self.meshes:
            frame, vertices = mesh.name.rpartition("/")[0], mesh.solid.vertices
            inside = frame.rpartition("/")[0]
            T = poses[inside] @ poses[frame] if inside else poses[frame]
            ends = np.stack([vertices.min(axis=0), vertices.max(axis=0)])
            box = np.stack(np.meshgrid(*ends.T), axis=-1).reshape(-1, 3)
            found.append((box @ T[:, :3, :3].swapaxes(1, 2) + T[:, None, :3, 3]).reshape(-1, 3))
        return np.concatenate(found)


def arm_model(robot: Robot, thicker: float = 1.0, *, ghostly: bool = False) -> ArmModel:
    """The model of an arm: the shapes of its file, and what its look says of links without these.

    ``thicker``: times as wide as its links are, by which all surfaces are moved outwards. ``ghostly``: beside
    the arm itself. All of a frame is one mesh, as the colours are not shown; the base is left out.
    """
    out = 0.5 * (thicker - 1.0) * width(robot.chain, robot.look)
    shapes = shape_meshes(robot, out, MOST_GHOSTLY if ghostly else MOST_DRAWN) if robot.shapes else []
    shown = frozenset(link for link, _ in shapes)
    model = _look_model(robot, out, ghostly, shown)
    meshes = tuple(mesh for link, mesh in shapes if link >= 0 or not ghostly)
    return replace(model, meshes=model.meshes + meshes, tool_axes=robot.n - 1 in shown)


@lru_cache(_KEPT)
def _look_model(robot: Robot, out: float, ghostly: bool, shown: frozenset[int]) -> ArmModel:
    """A frame for all that moves as one, and there a mesh a colour, but of links that are ``shown``."""
    frames = _Frames(robot.chain)
    groups: dict[tuple[str, str], list[Piece]] = {}
    for piece in robot.pieces:
        link = max(piece.mount.links)
        if link not in shown and not (link < 0 and (ghostly or shown)):
            groups.setdefault((frames.of(piece), "solid" if ghostly else piece.color), []).append(piece)
    meshes = [
        Mesh(f"{frame}/{color}", _surface(pieces, out), pieces[0].color)
        for (frame, color), pieces in groups.items()
    ]
    return ArmModel(frames.names, tuple(meshes), frames.place, frames.of_mount)


def _surface(pieces: Sequence[Piece], out: float) -> Solid:
    """The solids of some pieces as one mesh, ``out`` [m] larger all round."""
    solid = joined([part.solid for piece in pieces for part in piece.parts])
    return creased(grown(solid, out) if out > 0 else solid, _CREASE)


class _Frames:
    """Those of an arm with a look: of links, of what moves with two of them, of jaws there, of the tool."""

    def __init__(self, chain: Chain) -> None:
        self._chain = chain
        self._mounts = {Mount(link, link): link_frame(link) for link in range(-1, len(chain.segments))}
        self._jaws: dict[str, Jaw] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """In the order of ``place``."""
        return (*self._mounts.values(), *self._jaws, TOOL)

    def of(self, piece: Piece) -> str:
        """The name of the frame that a piece moves with."""
        count = len(self._mounts)
        name = self._mounts.setdefault(piece.mount, f"between{count}")
        if piece.jaw is None:
            return name
        for other, jaw in self._jaws.items():
            if other.startswith(f"{name}/") and jaw == piece.jaw:
                return other
        name = f"{name}/jaw{len(self._jaws)}"
        self._jaws[name] = piece.jaw
        return name

    def of_mount(self, mount: Mount) -> tuple[str, FloatArray]:
        """As ``ArmModel.frame_of``."""
        return self._mounts[mount], np.eye(4)

    def place(self, q: FloatArray, opening: FloatArray) -> FloatArray:
        """As ``ArmModel.place``."""
        links = LinkFrames.at(self._chain, q)
        T = np.zeros((len(q), len(self._mounts) + len(self._jaws) + 1, 4, 4))
        T[:, :, 3, 3] = 1.0
        for i, mount in enumerate(self._mounts):
            R, origin = mount.at(links)
            T[:, i, :3, :3], T[:, i, :3, 3] = R.transpose(2, 0, 1), origin.T
        openings, which = np.unique(opening, return_inverse=True)
        for i, jaw in enumerate(self._jaws.values(), len(self._mounts)):
            turned, moved = zip(*(jaw.at(one) for one in openings.tolist()), strict=True)
            T[:, i, :3, :3], T[:, i, :3, 3] = np.array(turned)[which], np.array(moved)[which]
        last = links.pose(len(self._chain.segments) - 1)[0].transpose(2, 0, 1)
        T[:, -1, :3, :3], T[:, -1, :3, 3] = last @ self._chain.tail[:3, :3], links.tool.T
        return T
