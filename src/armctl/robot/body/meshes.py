"""Meshes of other people's files, read within bounds: STL, OBJ, PLY, GLB and glTF, DAE with pycollada.

Whatever is wrong with one is a ``RobotFileError`` in one line; the arm can do without it.
"""

from __future__ import annotations

import hashlib
import io
import logging
import math
import os
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar, cast

import msgspec
import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_path

from armctl.arrays import FloatArray, content
from armctl.documents import LFS_POINTER, DocumentKind, is_lfs_pointer, open_at_once, write_atomically
from armctl.errors import RobotFileError
from armctl.robot.body.mesh_formats import (
    packed,
    read_obj,
    read_stl_text,
    require_bounded_dae,
    require_bounded_glb,
    require_bounded_ply,
)
from armctl.robot.parts import Color, Shape
from armctl.robot.solids import Solid, block, decimated, drum, welded
from armctl.system import is_own_file, private_folder

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


# What is made of an arm's meshes, kept on disk by their content: reading and fitting them takes seconds.
#
# An entry is named by all that it is made of, also the code that makes it, so that none is ever out of date.
# It is only data, checked as it is read. One that is damaged, or that others could write, is made anew.

T = TypeVar("T")

MOST_BYTES, MOST_OF_ONE = 256 << 20, 32 << 20
"""of all entries together, beyond which the oldest ones go, and of one"""
_MARK = b"armctl meshes\n"
_LIBRARIES = ("numpy", "scipy", "trimesh", "pycollada", "python-fcl")
_DTYPES = ("<f8", "<i8")


def folder() -> Path:
    """Where the entries are."""
    return user_cache_path("armctl") / "meshes"


def kept(kind: type[T], shapes: Sequence[Shape], *says: object) -> T | None:
    """What was made of shapes, and of what else it depends on; None where it has to be made."""
    name = _name(kind, shapes, says)
    return None if name is None else _read_entry(kind, folder() / name)


def keep(kind: type[T], shapes: Sequence[Shape], *says: object, make: Callable[[], T]) -> T:
    """The same, made and kept where it is not there yet.

    It is not kept where a file of the shapes cannot be read, or changes meanwhile.
    """
    name = _name(kind, shapes, says)
    found = None if name is None else _read_entry(kind, folder() / name)
    if found is not None:
        return found
    made = make()
    if name is not None and name == _name(kind, shapes, says):
        _write(folder() / name, made)
    return made


def _name(kind: type, shapes: Sequence[Shape], says: object) -> str | None:
    """Of an entry; None: it would not be known what it is made of."""
    try:
        files = {one: _of_file(one) for one in {shape.file for shape in shapes if shape.kind == "mesh"}}
    except RobotFileError:
        return None
    drawn = [content(replace(shape, file="").made_of()) for shape in shapes]
    meant = _code(), str(kind), drawn, [files.get(shape.file) for shape in shapes], content(says)
    return hashlib.sha256(msgspec.msgpack.encode(meant)).hexdigest()


def _of_file(file: str) -> tuple[str, bytes]:
    path = Path(file)
    if path.suffix.lower() == ".gltf":
        raise RobotFileError("keeps its points in other files")
    return path.name, hashlib.sha256(MESHES.read(path)).digest()


@cache
def _code() -> bytes:
    """What tells this version of the code from another one."""
    sums = hashlib.sha256()
    for module in sorted(Path(__file__).parent.glob("*.py")):
        sums.update(module.read_bytes())
    for library in _LIBRARIES:
        with suppress(PackageNotFoundError):
            sums.update(f"{library} {version(library)};".encode())
    return sums.digest()


def _read_entry(kind: type[T], path: Path) -> T | None:
    try:
        with open(path, "rb", opener=_without_links) as file:
            if not is_own_file(os.fstat(file.fileno())):  # others could have written it
                return None
            mark, digest, data = file.read(len(_MARK)), file.read(32), file.read(MOST_OF_ONE)
    except OSError:
        return None
    if mark != _MARK or hashlib.sha256(data).digest() != digest:
        return None
    try:
        found = msgspec.msgpack.decode(data, type=kind, dec_hook=_array)
    except (msgspec.MsgspecError, ValueError, TypeError):
        return None
    with suppress(OSError):
        os.utime(path)  # the entry that was used longest ago goes first
    return found


def _without_links(path: str, flags: int) -> int:
    return open_at_once(path, flags | getattr(os, "O_NOFOLLOW", 0))


def _write(path: Path, made: object) -> None:
    data = msgspec.msgpack.encode(made, enc_hook=_plain)
    if len(data) > MOST_OF_ONE:
        return
    try:
        private_folder(path.parent)
        path.unlink(missing_ok=True)
        write_atomically(path, _MARK + hashlib.sha256(data).digest() + data, private=True)
        _sweep(path)
    except (OSError, RobotFileError) as cause:
        _LOG.info("what was made of the meshes is not kept: %s", cause)


def _sweep(newest: Path) -> None:
    """Let the entries go that were used longest ago, where all together are too large."""
    found = [(one, one.stat()) for one in newest.parent.iterdir() if one != newest]
    left = MOST_BYTES - newest.stat().st_size
    for path, status in sorted(found, key=lambda one: one[1].st_mtime, reverse=True):
        left -= status.st_size
        if left < 0:
            path.unlink(missing_ok=True)


# Arrays as their bytes.


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray):
        given = cast("NDArray[Any]", value)
        array = np.ascontiguousarray(given).astype(_DTYPES[given.dtype.kind in "iu"])
        return array.dtype.str, array.shape, array.tobytes()
    raise TypeError(f"{value!r} is not kept")


def _array(kind: type, value: Any) -> Any:
    dtype, shape, data = msgspec.convert(value, tuple[str, tuple[int, ...], bytes])
    if dtype not in _DTYPES:
        raise ValueError(f"{kind}: no {dtype} is kept")
    array = np.frombuffer(data, dtype).reshape(shape).copy()
    if not np.isfinite(array).all():
        raise ValueError(f"{kind}: a number is not finite")
    return array
