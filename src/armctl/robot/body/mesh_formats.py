"""Meshes format by format: what is text is read here, and how large any of them becomes is judged."""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Annotated, Any
from urllib.parse import unquote
from xml.etree import ElementTree

import msgspec
import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.documents import DocumentKind
from armctl.errors import RobotFileError

# STL and OBJ are read here, line by line: libraries take minutes over small files with many parts. Of PLY and
# DAE files only the size is judged; libraries read them.

MOST_CORNERS = 10_000
"""of a face"""
_LONGEST = 64
"""letters of a number"""
_VERTEX = re.compile(rb"^[ \t]*vertex[ \t]+([^\r\n]*)", re.IGNORECASE | re.MULTILINE)

_OBJ_LINE = re.compile(rb"^[ \t]*([vf])[ \t]+([^\r\n]*)", re.MULTILINE)

Triangles = tuple[FloatArray, NDArray[np.int64]]
"""vertices (k, 3) and faces (m, 3)"""


def read_stl_text(content: bytes, most: int) -> Triangles:
    """The triangles of an STL file in text, of all solids in it; refuses more than ``most``."""
    if content.lower().count(b"vertex") > 3 * most:
        raise RobotFileError(f"holds more than {most} triangles")
    lines = _VERTEX.findall(content)
    if len(lines) % 3:
        raise RobotFileError(f"holds {len(lines)} corners, which are no triangles")
    vertices = _points([line.split(None, 3)[:3] for line in lines])
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


def read_obj(content: bytes, most: int) -> Triangles:
    """The triangles of an OBJ file: its vertices and faces, whatever parts and materials they belong to."""
    points: list[list[bytes]] = []
    faces: list[int] = []
    for line in _OBJ_LINE.finditer(content.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")):
        kind, values = line.groups()
        if kind == b"v":
            points.append(values.split(None, 3)[:3])
        else:
            faces += _fan(values, len(points))
        if len(faces) > 3 * most or len(points) > 3 * most:
            raise RobotFileError(f"holds more than {most} triangles, or points of so many")
    return _points(points), np.array(faces, dtype=np.int64).reshape(-1, 3)


def _fan(values: bytes, count: int) -> list[int]:
    """A face of an OBJ file, behind so many vertices, as triangles: three indices each."""
    if values.count(b" ") + values.count(b"\t") > 4 * MOST_CORNERS:
        raise RobotFileError(f"holds a face of more than {MOST_CORNERS} corners")
    corners = values.split(b"#", 1)[0].split()
    if len(corners) > MOST_CORNERS:
        raise RobotFileError(f"holds a face of {len(corners)} corners; {MOST_CORNERS} at most")
    try:
        index = [int(corner.split(b"/", 1)[0]) for corner in corners]
        np.array(index, dtype=np.int64)
    except (ValueError, OverflowError) as cause:
        raise RobotFileError(f"holds a face that is none: {_shown(values)}") from cause
    first, *others = [one - 1 if one > 0 else count + one if one < 0 else -1 for one in index] or [-1]
    if len(others) == 1:
        raise RobotFileError(f"holds a face of two corners: {_shown(values)}")
    return [one for a, b in pairwise(others) for one in (first, a, b)]


def _points(rows: Sequence[Sequence[bytes]]) -> FloatArray:
    """Numbers, three a row."""
    numbers = [number for row in rows for number in row]
    if len(numbers) != 3 * len(rows):
        raise RobotFileError("holds a point that has no three coordinates")
    longest = max(map(len, numbers), default=1)
    if longest > _LONGEST:
        raise RobotFileError(f"holds a number of more than {_LONGEST} letters")
    try:
        return np.array(numbers, dtype=f"S{longest}").astype(np.float64).reshape(-1, 3)
    except ValueError as cause:
        raise RobotFileError(f"holds a point that is none: {cause}") from cause


def _shown(text: bytes) -> str:
    return repr(text[:30].decode(errors="replace"))


# PLY: what its head announces.

_HEAD_BYTES, _MOST_LINES = 16 * 1024, 200
_MOST_PROPERTIES = 64


def require_bounded_ply(content: bytes, most: int) -> None:
    """Refuse a PLY file whose head announces more than ``most`` triangles, or what is no surface."""
    end = content.find(b"end_header", 0, _HEAD_BYTES)
    if not content.startswith(b"ply") or end < 0:
        raise RobotFileError("is no PLY file: it has no head, or a very long one")
    lines = content[:end].decode(errors="replace").splitlines()
    words = [line.split() for line in lines if line.strip()]
    if len(words) > _MOST_LINES or sum(word[0] == "property" for word in words) > _MOST_PROPERTIES:
        raise RobotFileError(f"has a head of more than {_MOST_PROPERTIES} properties")
    for word in words:
        match word:
            case ["element", name, count]:
                if not count.isdecimal() or len(count) > _LONGEST or int(count) > 3 * most:
                    raise RobotFileError(f"announces {_shown(count.encode())} of {name}; {3 * most} at most")
            case _:
                pass
    if b"format ascii" in content[:end] and _longest_line(content) > 10 * MOST_CORNERS:
        raise RobotFileError(f"holds a face of more than {MOST_CORNERS} corners")


def _longest_line(content: bytes) -> int:
    """Its bytes; without a list of all lines, which may be sixty million."""
    at = longest = 0
    while at < len(content):
        end = content.find(b"\n", at)
        end = len(content) if end < 0 else end
        longest, at = max(longest, end - at), end + 1
    return longest


# DAE: parts that stand for others multiply.

_MOST_PARTS, _DEEPEST = 1000, 32
_FACES = ("triangles", "polylist", "polygons", "tristrips", "trifans")


def require_bounded_dae(content: bytes, most: int) -> None:
    """Refuse a DAE file (Collada 1.4, 1.5) that is larger once it is read, or that names other files."""
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise RobotFileError("declares entities, which no DAE file of an arm needs")
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as cause:
        raise RobotFileError(f"cannot be read: {cause}") from cause
    if any(
        _kind(one).startswith("instance_") and not one.get("url", "#").startswith("#") for one in root.iter()
    ):
        raise RobotFileError("keeps parts in other files; export it as one DAE file")
    shapes = {one.get("id", ""): _size_of(one) for one in root.iter() if _kind(one) == "geometry"}
    nodes = {one.get("id", ""): one for one in root.iter() if _kind(one) == "node"}
    drawn, parts = 0, 0
    for scene in (one for one in root.iter() if _kind(one) == "visual_scene"):
        waiting = [(child, 1) for child in scene]
        while waiting:
            one, depth = waiting.pop()
            parts += 1
            if depth > _DEEPEST or parts > 10 * _MOST_PARTS:
                raise RobotFileError(f"has more than {_DEEPEST} pieces below each other, or too many")
            target = one.get("url", "").removeprefix("#")
            match _kind(one):
                case "node":
                    waiting += [(child, depth + 1) for child in one]
                case "instance_node" if target in nodes:
                    waiting.append((nodes[target], depth + 1))
                case "instance_geometry" | "instance_controller":
                    drawn += shapes.get(target, 0)
                case _:
                    pass
    if max(drawn, sum(shapes.values())) > most:
        raise RobotFileError(f"is too large once it is read; {most} triangles at most")


def _kind(one: ElementTree.Element) -> str:
    return one.tag.rpartition("}")[2] if isinstance(one.tag, str) else ""  # pyright: ignore[reportUnnecessaryIsInstance]


def _size_of(geometry: ElementTree.Element) -> int:
    """Triangles of a geometry, at most."""
    size = 0
    for one in geometry.iter():
        if _kind(one) in _FACES:
            size += sum(len((part.text or "").split()) for part in one if _kind(part) == "p") // 3 + 1
            counts = [part for part in one if _kind(part) == "vcount"]
            if any(
                len(number) > 5 or int(number) > MOST_CORNERS
                for part in counts
                for number in (part.text or "").split()
                if number.isdecimal()
            ):
                raise RobotFileError(f"holds a face of more than {MOST_CORNERS} corners")
    return size


# glTF files, packed (GLB) or in text with files beside: how large they become once they are read.
#
# A library reads them; a ``.gltf`` file is packed before, from files of its own folder only.

_MOST_PIECES, _DEEPEST_NODE = 1000, 32
"""of one file; how many may hang below each other, as trimesh's time grows with the cube of that"""
_LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_")
"""extensions that change no shape"""
_JSON, _BIN = 0x4E4F534A, 0x004E4942
"""kinds of chunks (glTF 2.0, section 4.4.3)"""
_Number = Annotated[int, msgspec.Meta(ge=0)]


class _Accessor(msgspec.Struct, rename="camel"):
    count: _Number
    buffer_view: _Number | None = None


class _View(msgspec.Struct, rename="camel"):
    byte_length: _Number


class _Buffer(msgspec.Struct):
    uri: str = "data:"


class _Primitive(msgspec.Struct):
    attributes: dict[str, _Number]
    indices: _Number | None = None

    @property
    def used(self) -> list[int]:
        points = self.attributes["POSITION"]
        return [points] if self.indices is None else [points, self.indices]


class _Mesh(msgspec.Struct):
    primitives: list[_Primitive]


class _Node(msgspec.Struct):
    mesh: _Number | None = None
    children: list[_Number] = []


class _GlbFile(msgspec.Struct, rename="camel"):
    """What bounds the size of a GLB file once it is read (glTF 2.0, section 5)."""

    buffers: list[_Buffer] = []
    buffer_views: list[_View] = []
    accessors: list[_Accessor] = []
    meshes: list[_Mesh] = []
    nodes: list[_Node] = []
    extensions_required: list[str] = []

    def count(self, accessor: int) -> int:
        return self.accessors[accessor].count

    @property
    def is_deep(self) -> bool:
        """Whether pieces hang too far below each other, or in a circle."""
        above = {child: k for k, node in enumerate(self.nodes) for child in node.children}
        below = set(above)
        for _ in range(_DEEPEST_NODE):
            below = {child for child in below if above[child] in below}
        return bool(below)


def require_bounded_glb(glb: bytes, most: int, most_bytes: int) -> None:
    """Refuse a GLB file of more than ``most`` triangles once it is read: a part may be drawn often."""
    end = 20 + int.from_bytes(glb[12:16], "little")
    try:
        scene = msgspec.json.decode(glb[20:end], type=_GlbFile)
        points = [sum(max(map(scene.count, one.used)) for one in mesh.primitives) for mesh in scene.meshes]
        drawn = sum(points[node.mesh] for node in scene.nodes if node.mesh is not None)
    except LookupError as cause:
        raise RobotFileError("refers to parts that are not there") from cause
    except (msgspec.MsgspecError, RecursionError) as cause:
        raise RobotFileError(f"cannot be read: {cause}") from cause
    if needed := [name for name in scene.extensions_required if not name.startswith(_LOOKS)]:
        raise RobotFileError(f"needs {', '.join(needed)}; export it without")
    if not all(buffer.uri.startswith("data:") for buffer in scene.buffers):
        raise RobotFileError("keeps its points in other files; export it as one GLB file")
    if any(one.buffer_view is None for one in scene.accessors):
        raise RobotFileError("is compressed; export it without compression")
    pieces = len(scene.nodes) + sum(len(mesh.primitives) for mesh in scene.meshes)
    # corners, their normals and textures, and the corners again
    read = sum(one.count for one in scene.accessors) + sum(points)
    copied = sum(view.byte_length for view in scene.buffer_views)
    if scene.is_deep:
        raise RobotFileError(f"has more than {_DEEPEST_NODE} pieces below each other; export it as one mesh")
    if pieces > _MOST_PIECES or max(drawn, read / 4) > 3 * most or copied > most_bytes:
        raise RobotFileError(
            f"is too large once it is read; {most} triangles and {_MOST_PIECES} pieces at most"
        )


def packed(content: bytes, folder: Path, kind: DocumentKind) -> bytes:
    """A ``.gltf`` file as GLB: its buffers, in the text or in files of ``folder``, behind each other.

    ``kind``: reads the files, and says how large all of it may be.
    """
    joined, begins = bytearray(), list[int]()
    try:
        scene = msgspec.json.decode(content, type=dict[str, Any])
        for buffer in scene.get("buffers", []):
            begins.append(len(joined))
            joined += _buffer(str(buffer["uri"]), folder, kind)
            joined += bytes(-len(joined) % 4)
            if len(joined) > kind.most_bytes:
                raise RobotFileError(f"is larger than {kind.most_bytes >> 20} MiB with its files")
        for view in scene.get("bufferViews", []):
            view["byteOffset"] = int(view.get("byteOffset", 0)) + begins[view["buffer"]]
            view["buffer"] = 0
    except (msgspec.MsgspecError, RecursionError) as cause:
        raise RobotFileError(f"cannot be read: {cause}") from cause
    except (AttributeError, LookupError, TypeError, ValueError) as cause:
        raise RobotFileError("refers to parts that are not there") from cause
    scene["buffers"] = [{"byteLength": len(joined)}]
    scene.pop("images", None)
    text = msgspec.json.encode(scene)
    text += b" " * (-len(text) % 4)
    chunks = b"".join(
        len(chunk).to_bytes(4, "little") + what.to_bytes(4, "little") + chunk
        for what, chunk in ((_JSON, text), (_BIN, bytes(joined)))
    )
    return b"glTF" + (2).to_bytes(4, "little") + (12 + len(chunks)).to_bytes(4, "little") + chunks


def _buffer(uri: str, folder: Path, kind: DocumentKind) -> bytes:
    """What a buffer holds; refuses a file that is not in the folder of the ``.gltf`` file."""
    if uri.startswith("data:"):
        try:
            return base64.b64decode(uri.partition(",")[2], validate=True)
        except binascii.Error as cause:
            raise RobotFileError(f"holds a buffer that is no base64: {cause}") from cause
    name = unquote(uri)
    path = folder / name
    outside = PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts
    if outside or any(sign in name for sign in "\\:\0") or not _is_below(path, folder):
        raise RobotFileError(f"keeps its points outside of its folder ({name[:60]!r}); export it as GLB")
    if not path.is_file():
        raise RobotFileError(f"keeps its points in {name[:60]}, which is not there; export it as GLB")
    return kind.read(path)


def _is_below(path: Path, folder: Path) -> bool:
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # links in a circle, names that no file has
        return False
