"""glTF files, packed (GLB) or in text with files beside: how large they become once they are read.

A library reads them; a ``.gltf`` file is packed before, from files of its own folder only.
"""

from __future__ import annotations

import base64
import binascii
from pathlib import Path, PurePosixPath
from typing import Annotated, Any
from urllib.parse import unquote

import msgspec

from armctl.documents import DocumentKind
from armctl.errors import RobotFileError

_MOST_PIECES, _DEEPEST = 1000, 32
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
        for _ in range(_DEEPEST):
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
        raise RobotFileError(f"has more than {_DEEPEST} pieces below each other; export it as one mesh")
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
