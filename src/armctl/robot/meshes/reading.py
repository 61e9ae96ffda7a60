"""Meshes of other people's files, read within bounds: STL, OBJ, PLY, GLB and glTF, DAE with pycollada.

Whatever is wrong with one is a ``RobotFileError`` in one line; the arm can do without it.
"""

from __future__ import annotations

import io
import logging
import math
import re
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from armctl.arrays import FloatArray
from armctl.documents import LFS_POINTER, DocumentKind, is_lfs_pointer
from armctl.errors import RobotFileError
from armctl.robot.meshes.gltf import packed, require_bounded_glb
from armctl.robot.meshes.text import read_obj, read_stl_text, require_bounded_dae, require_bounded_ply
from armctl.robot.parts import Color, Shape
from armctl.robot.solids import Solid, block, decimated, drum, welded

_LOG = logging.getLogger("armctl.robot")
MESHES = DocumentKind(RobotFileError, most_bytes=64 << 20)
SUFFIXES = (".stl", ".obj", ".ply", ".dae", ".glb", ".gltf")
MOST_TRIANGLES = 2_000_000
"""of one file"""
MOST_OF_ARM = 4_000_000
"""triangles of all meshes of an arm"""
_SMALLEST_M = 1e-9
FARTHEST_M = 100.0
"""No point of a mesh is farther from its link; files in millimetres without a scale are refused by that."""
_OTHER_UNITS = {"millimetre": 0.001, "centimetre": 0.01, "inch": 0.0254}
"""of meshes without a scale [m]"""
_SMALLEST_PART, _LARGEST_PART = 0.02, 1.2
"""shares of an arm's length that the mesh of a link has, as arms mostly are"""
_BINARY_STL = 84
_ROUND = 36
"""sides of a cylinder"""
_UNIT = re.compile(r"(?P<factor>[\d.eE+-]+) \* meters")


def solid_of(shape: Shape) -> Solid:
    """A shape as triangles in its link's frame [m]; reads the file of a mesh."""
    match shape.kind:
        case "box":
            x, y, z = shape.size
            solid = block((x, y, z))
        case "cylinder":
            # round the circle, so that what contains the corners contains the cylinder
            solid = drum(shape.size[0] / math.cos(math.pi / _ROUND), shape.size[1])
        case "sphere":
            solid = _ball(shape.size[0])
        case "mesh":
            solid = _scaled(read_mesh(Path(shape.file)), shape)
    T = shape.pose
    return Solid(solid.vertices @ T[:3, :3].T + T[:3, 3], solid.faces)


class ArmSolids:
    """The solids of one arm, one after the other, as long as they have ``MOST_OF_ARM`` triangles together."""

    def __init__(self) -> None:
        self._left = MOST_OF_ARM

    def solid_of(self, shape: Shape) -> Solid:
        """As ``solid_of``; refuses what is beyond, without reading more than one file too many."""
        solid = solid_of(shape) if self._left > 0 else None
        if solid is None or len(solid.faces) > self._left:
            self._left = 0
            name = Path(shape.file).name or shape.kind
            raise RobotFileError(f"{name}: beyond the {MOST_OF_ARM} triangles that an arm may have")
        self._left -= len(solid.faces)
        return solid


Drawn = tuple[tuple[int, Color | None, Solid], ...]
"""link, colour and mesh of each shape"""
_FEWEST_DRAWN = 300
"""triangles of a mesh below which it is not made coarser"""


def coarse_solids(shapes: Sequence[Shape], most: int) -> Drawn:
    """Shapes as they are drawn, made coarser where an arm has more than ``most`` triangles.

    One that cannot be read is left out.
    """
    arm = ArmSolids()
    solids: list[tuple[Shape, Solid]] = []
    for shape in shapes:
        try:
            solids.append((shape, welded(arm.solid_of(shape))))
        except RobotFileError as problem:
            _LOG.warning("a shape is not drawn: %s", problem)
    share = min(1.0, most / max(1, sum(len(solid.faces) for _, solid in solids)))
    return tuple(
        (shape.link, shape.color, decimated(solid, max(_FEWEST_DRAWN, int(share * len(solid.faces)))))
        for shape, solid in solids
    )


def _ball(radius: float) -> Solid:
    """A sphere of patches between circles of latitude, all of it inside them."""
    latitudes, sections = 12, 24
    outer = radius / (math.cos(math.pi / sections) * math.cos(math.pi / (2 * latitudes)))
    latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, latitudes + 1)
    angle = np.arange(sections) * (2 * np.pi / sections)
    ring = np.cos(latitude)[:, None]
    height = np.sin(latitude)[:, None] + 0.0 * angle
    vertices = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=-1).astype(np.float64)
    here = np.arange(latitudes * sections).reshape(latitudes, sections)
    after, above = np.roll(here, -1, axis=1), here + sections
    faces = np.concatenate([
        np.stack([here, after, np.roll(above, -1, axis=1)], axis=-1).reshape(-1, 3),
        np.stack([here, np.roll(above, -1, axis=1), above], axis=-1).reshape(-1, 3),
    ])  # fmt: skip
    return Solid(outer * vertices.reshape(-1, 3), faces)


def _scaled(solid: Solid, shape: Shape) -> Solid:
    faces = solid.faces if math.prod(shape.size) > 0 else solid.faces[:, ::-1]  # a mirrored one is inside out
    scaled = Solid(solid.vertices * np.array(shape.size), faces)
    if extent(scaled) > FARTHEST_M:
        raise RobotFileError(too_large(shape, across(scaled)))
    return _with_surface(scaled)


def extent(solid: Solid) -> float:
    """How far its farthest point is from the origin, along an axis [m]."""
    return float(np.abs(solid.vertices).max())


def across(solid: Solid) -> float:
    """Its largest size along an axis [m]."""
    return float(np.ptp(solid.vertices, axis=0).max())


def too_large(shape: Shape, size: float, arm_m: float | None = None) -> str:
    """Text for a mesh of this size [m] whose unit is likely not the metre; names the units that fit."""
    scales = units_for(size, arm_m, shape.size)
    return f"{Path(shape.file).name} is {size:.3g} m large; {scales} into its <mesh>"


def units_for(size: float, arm_m: float | None, scale: Sequence[float] = (1.0, 1.0, 1.0)) -> str:
    """Which units bring a size [m] to that of a link of an arm, and the scale= to write for each."""
    fits = {
        unit: metres
        for unit, metres in _OTHER_UNITS.items()
        if arm_m is not None and _SMALLEST_PART * arm_m <= metres * size <= _LARGEST_PART * arm_m
    } or {"millimetre": _OTHER_UNITS["millimetre"]}
    written = [f'scale="{" ".join(f"{metres * factor:g}" for factor in scale)}"' for metres in fits.values()]
    names = " or the ".join(fits)
    return f"if its unit is the {names}, write {' or '.join(written)}"


def _with_surface(solid: Solid) -> Solid:
    used = np.zeros(len(solid.vertices), dtype=np.bool_)
    used[solid.faces] = True
    if not float(np.ptp(solid.vertices[used], axis=0).max()) >= _SMALLEST_M:
        raise RobotFileError("holds no surface: all its points are in one place")
    return solid


def unreadable(path: Path) -> str | None:
    """Why a mesh of this kind or size is not read, by its name and first bytes; None: it may be."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        return f"is not one of {', '.join(SUFFIXES)}"
    if is_lfs_pointer(path):
        return LFS_POINTER
    if suffix == ".dae" and find_spec("collada") is None:
        return "is a DAE file, which takes pycollada: pip install pycollada"
    if path.stat().st_size > MESHES.most_bytes:
        return f"is larger than {MESHES.most_bytes >> 20} MiB"
    return None


def read_mesh(path: Path) -> Solid:
    """The triangles of a file, in the file's unit; of a DAE file in metres."""
    try:
        solid = _read(path, path.suffix.lower())
    except RobotFileError as refusal:
        raise RobotFileError(f"{path.name}: {refusal}") from refusal
    return solid


def _read(path: Path, suffix: str) -> Solid:
    content = MESHES.read(path)
    if (why := unreadable(path)) is not None:
        raise RobotFileError(why)
    if suffix == ".stl" and len(content) >= _BINARY_STL:
        count = int.from_bytes(content[80:84], "little")
        if len(content) == _BINARY_STL + 50 * count:
            return _binary_stl(content, count)
    if suffix == ".dae" and not content.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<"):
        raise RobotFileError("is not XML")  # pycollada would unpack a zip file
    match suffix:
        case ".stl":
            return _checked(*read_stl_text(content, MOST_TRIANGLES))
        case ".obj":
            return _checked(*read_obj(content, MOST_TRIANGLES))
        case ".ply":
            require_bounded_ply(content, MOST_TRIANGLES)
        case ".dae":
            require_bounded_dae(content, MOST_TRIANGLES)
        case ".gltf":
            content, suffix = packed(content, path.parent, MESHES), ".glb"
            require_bounded_glb(content, MOST_TRIANGLES, MESHES.most_bytes)
        case _:
            require_bounded_glb(content, MOST_TRIANGLES, MESHES.most_bytes)
    return _by_trimesh(content, suffix)


_STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def _binary_stl(content: bytes, count: int) -> Solid:
    """Most meshes of arms: a fifth of a second sooner than by trimesh, which takes as long to import."""
    _require_count(count)
    corners = np.frombuffer(content, _STL, count, _BINARY_STL)["corners"].astype(np.float64)
    return _checked(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def _by_trimesh(content: bytes, suffix: str) -> Solid:
    import trimesh  # as long as reading a mesh takes

    library: Any = trimesh
    try:
        loaded = library.load_scene(
            io.BytesIO(content), file_type=suffix.removeprefix("."), process=False, skip_materials=True
        )
        units = next((one.metadata.get("units") for one in loaded.geometry.values()), None)
        for one in loaded.geometry.values():
            one.metadata.clear()  # of a PLY file it holds all faces once more, and is copied twice
        mesh = loaded.to_mesh()
        vertices = np.array(mesh.vertices, dtype=np.float64).reshape(-1, 3)
        faces = np.array(mesh.faces, dtype=np.int64).reshape(-1, 3)
    except Exception as cause:  # parsers of other people raise what they meet
        raise RobotFileError(
            f"cannot be read: {' '.join(str(cause).split()) or type(cause).__name__}"
        ) from cause
    if suffix == ".dae" and (unit := _UNIT.fullmatch(str(units))):
        vertices *= float(unit["factor"])
    return _checked(vertices, faces)


def _require_count(count: int) -> None:
    if count == 0:
        raise RobotFileError("holds no triangles")
    if count > MOST_TRIANGLES:
        raise RobotFileError(f"holds {count} triangles; {MOST_TRIANGLES} at most")


def _checked(vertices: FloatArray, faces: Any) -> Solid:
    _require_count(len(faces))
    if not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
        raise RobotFileError(
            "holds points that are no finite numbers, or triangles of points that are not there"
        )
    return _with_surface(Solid(vertices, faces))
