"""An arm as it is drawn: frames that move, and meshes in them, of its shapes or its look."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.facts.angles import DEGREE
from armctl.kinematics import quaternion_wxyz
from armctl.kinematics.chain import Chain
from armctl.kinematics.frames import LinkFrames
from armctl.lazy_dataclass import dataclass
from armctl.robot import CarriedPart, Robot
from armctl.robot.body.arm_body import width
from armctl.robot.body.meshes import Drawn, coarse_solids
from armctl.robot.look.pieces import Jaw, Mount, Piece
from armctl.robot.look.rows import Paint, Theme, paint
from armctl.robot.parts import Color, Shape
from armctl.robot.solids import Solid, creased, grown, joined
from armctl.robot.tools import tool_of, tool_rows
from armctl.ui.viser_seam import move_node

# The shapes of an arm's files as they are drawn, kept for all pages.


MOST_DRAWN, MOST_GHOSTLY = 30_000, 8_000
"""triangles of an arm (0.8 MB for each page), and of a ghost, of which a page may have many"""
_KEPT = 8
"""drawings: those of four arms"""


class _Drawings:
    """The drawings of some arms, as every page and every ghost asks for them, and reading takes seconds."""

    def __init__(self) -> None:
        self._kept: dict[tuple[tuple[Shape, ...], int], Drawn] = {}

    def of(self, shapes: tuple[Shape, ...], most: int) -> Drawn:
        known = self._kept.get((shapes, most))
        return self.keep(shapes, most, coarse_solids(shapes, most) if known is None else known)

    def keep(self, shapes: tuple[Shape, ...], most: int, drawn: Drawn) -> Drawn:
        self._kept.pop((shapes, most), None)
        while len(self._kept) >= _KEPT:
            del self._kept[next(iter(self._kept))]
        self._kept[shapes, most] = drawn  # the newest: what is shown stays
        return drawn


_DRAWINGS = _Drawings()


def keep_drawn(shapes: tuple[Shape, ...], drawn: Mapping[int, Drawn]) -> None:
    """Keep drawings by their number of triangles: the pages draw an arm as it was when it was opened."""
    for most, one in drawn.items():
        _DRAWINGS.keep(shapes, most, one)


def shape_meshes(robot: Robot, out: float, most: int) -> list[tuple[int, Mesh]]:
    """What the arm's file shows of its links, and of which link: ``out`` [m] larger all round."""
    look, found = robot.look, list[tuple[int, Mesh]]()
    for i, (link, color, solid) in enumerate(_DRAWINGS.of(robot.shapes, most)):
        color = color or look.links[max(link, 0) % len(look.links)]
        solid = grown(solid, out) if out > 0 else solid
        found.append((link, Mesh(f"{link_frame(link)}/s{i}", solid, color, flat=True)))
    return found


# One mesh of an arm as it is drawn, and the names of the frames that meshes are in.


TOOL = "tool"
"""the frame at the tool point"""


def link_frame(link: int) -> str:
    """The name of a link's frame below the arm's own; -1: the base."""
    return f"link{link}" if link >= 0 else "base"


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """One surface of one colour."""

    name: str
    """below the arm's own: that of its frame, and what tells it from others there"""
    solid: Solid
    """in that frame [m]"""
    color: Color | Paint
    flat: bool = False
    """each triangle is seen, as machines have edges; else its normals leave only doubled vertices sharp"""

    def color_in(self, theme: Theme) -> Color:
        """Red, green and blue (0..255)."""
        return paint(self.color, theme) if isinstance(self.color, str) else self.color


_CREASE = 38 * DEGREE
"""Faces that meet at a flatter angle are shaded as one surface."""
_FIGURES = 16
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


@lru_cache(_FIGURES)
def _look_model(robot: Robot, out: float, ghostly: bool, shown: frozenset[int]) -> ArmModel:
    """A frame for all that moves as one, and there a mesh a colour, but of links that are ``shown``.

    The tool that is on is none of its link's shapes.
    """
    frames = _Frames(robot.chain)
    groups: dict[tuple[str, str], list[Piece]] = {}
    own = len(robot.whole_look.rows)
    if robot.tool:
        own -= tool_rows(tool_of(robot.tools, robot.tool))
    for piece in robot.pieces:
        link = max(piece.mount.links)
        if piece.row >= own or (link not in shown and not (link < 0 and (ghostly or shown))):
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
        openings, which = (opening, [0]) if len(opening) == 1 else np.unique(opening, return_inverse=True)
        for i, jaw in enumerate(self._jaws.values(), len(self._mounts)):
            turned, moved = zip(*(jaw.at(one) for one in openings.tolist()), strict=True)
            T[:, i, :3, :3], T[:, i, :3, 3] = np.array(turned)[which], np.array(moved)[which]
        last = links.pose(len(self._chain.segments) - 1)[0].transpose(2, 0, 1)
        T[:, -1, :3, :3], T[:, -1, :3, 3] = last @ self._chain.tail[:3, :3], links.tool.T
        return T


# An arm in a scene: a node for each frame that moves, and for each mesh in it.


ARM = "/arm"
"""the name of the present arm's figure, which all pages share"""
_PART: Color = (176, 137, 96)
HALF_OPEN = 0.5
"""the gripper, where nobody has seen it"""


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
    two_sided: bool = False,
) -> viser.MeshHandle:
    """Draw a solid; ``flat``: with edges, as machines have. One that is seen through casts no shadow.

    ``two_sided``: its inside is drawn, too.
    """
    return scene.add_mesh_simple(
        name,
        solid.vertices,
        solid.faces,
        color=color,
        opacity=opacity,
        flat_shading=flat,
        side="double" if two_sided else "front",
        cast_shadow=opacity is None,
        receive_shadow=opacity is None,
    )


def repaint(scene: viser.SceneApi, robot: Robot, name: str, theme: Theme) -> list[viser.MeshHandle]:
    """Draw the meshes of a figure of all pages in one page's own scene, in the colours of its theme.

    They hide those of all pages, and move with them, as they are in the same frames.
    """
    meshes = (mesh for mesh in arm_model(robot).meshes if mesh.color_in(theme) != mesh.color_in("light"))
    return [
        add_solid(scene, f"{name}/{mesh.name}", mesh.solid, mesh.color_in(theme), flat=mesh.flat)
        for mesh in meshes
    ]


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
        thicker: float = 1.0,
        theme: Theme = "light",
        opening: float = HALF_OPEN,
    ) -> None:
        """Draw the arm as it looks; ``color`` and ``opacity`` replace its own.

        ``thicker``: so many times as wide as the arm. Equal surfaces of two in one place would flicker.
        ``opening``: of the jaws 0..1, until a pose says it.
        """
        self._scene, self._name, self._robot = scene, name, robot
        self._part_color, self._opacity = color or _PART, opacity
        self._again = partial(ArmFigure, scene, name=name, color=color, opacity=opacity, thicker=thicker,
                              theme=theme)  # fmt: skip
        self._grown = 0.5 * (thicker - 1.0) * width(robot.chain, robot.look)
        self._model = arm_model(robot, thicker, ghostly=color is not None)
        self.root = scene.add_frame(name, show_axes=False)
        self._frames = [scene.add_frame(f"{name}/{frame}", show_axes=False) for frame in self._model.frames]
        self._q: FloatArray | None = None
        self._opening = opening
        self._shown: FloatArray | None = None
        for frame in self._frames:
            send_pose(frame)
        for mesh in self._model.meshes:
            shown = color or mesh.color_in(theme)
            add_solid(scene, f"{name}/{mesh.name}", mesh.solid, shown, opacity, flat=mesh.flat)
        self._label: viser.LabelHandle | None = None
        self._part: CarriedPart | None = None
        self._drawn_part: viser.MeshHandle | None = None
        if self._model.tool_axes and opacity is None:
            size = width(robot.chain, robot.look)
            axes = scene.add_frame(f"{name}/{TOOL}/axes", axes_length=size, axes_radius=0.04 * size)
            send_pose(axes)

    def wearing(self, robot: Robot) -> ArmFigure:
        """The figure of the same arm with a tool on: itself, or one in its place with that of ``robot``.

        Its jaws are open as far, and it is shown if this one is; what it carries and says is to be told anew.
        """
        if robot.tool == self._robot.tool:
            return self
        visible = self.root.visible
        self.root.remove()
        figure = self._again(robot, opening=self._opening)
        figure.root.visible = visible
        return figure

    def pose(self, q: FloatArray, opening: float | None = None) -> None:
        """Move the figure to joint angles ``q`` (n,) [rad] and a gripper opening 0..1 (None: as it is)."""
        opening = self._opening if opening is None else opening
        if self._q is not None and opening == self._opening and np.array_equal(q, self._q):
            return
        self._q, self._opening = q.copy(), opening
        placed = self._model.place(q[None], np.array([opening]))[0]
        before = np.full_like(placed, np.nan) if self._shown is None else self._shown
        moved = (before != placed).any(axis=(1, 2)).tolist()
        for handle, frame, has_moved in zip(self._frames, placed, moved, strict=True):
            if has_moved:
                move_node(handle, frame[:3, 3], quaternion_wxyz(frame[:3, :3]))
        self._shown = placed

    def carry(self, part: CarriedPart | None) -> None:
        """Draw what is between the jaws as a box; None: nothing."""
        if part == self._part:
            return
        self._part = part
        if self._drawn_part is not None:
            self._drawn_part.remove()
        self._drawn_part = None if part is None else self.add_part(part, "part")

    def add_part(self, part: CarriedPart, name: str) -> viser.MeshHandle:
        """Draw a part between the jaws, as a node of this name in the tool frame, which stays."""
        solid = grown(part.solid, self._grown)
        node = f"{self._name}/{TOOL}/{name}"
        drawn = add_solid(self._scene, node, solid, self._part_color, self._opacity, flat=True)
        send_pose(drawn)
        return drawn

    def tracks(self, q: FloatArray, opening: FloatArray) -> dict[str, FloatArray]:
        """Where ``pose`` would put its parts at angles (k, n) [rad] and openings (k,): by name (k, 7).

        Columns: x, y, z [m] and the quaternion w, x, y, z, whose sign does not jump.
        """
        placed, tracks = self._model.place(q, opening), dict[str, FloatArray]()
        for i, handle in enumerate(self._frames):
            turned = np.array([quaternion_wxyz(T[:3, :3]) for T in placed[:, i]])
            flips = np.where((turned[1:] * turned[:-1]).sum(axis=1) < 0, -1.0, 1.0)
            turned[1:] *= np.cumprod(flips)[:, None]
            tracks[handle.name] = np.hstack([placed[:, i, :3, 3], turned])
        return tracks

    def say(self, words: str | None) -> None:
        """Write words at the tool point; None: nothing."""
        if words is not None and (self._label is None or self._label.text != words):
            self.say(None)
            self._label = self._scene.add_label(f"{self._name}/{TOOL}/words", words, anchor="bottom-center")
            send_pose(self._label)
        elif words is None and self._label is not None:
            self._label.remove()
            self._label = None
