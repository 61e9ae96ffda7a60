"""Random scenes of boxes, and glTF files of them: packed or in text, interleaved, scaled, mirrored."""

from __future__ import annotations

import base64
import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from armctl.arrays import FloatArray
from armctl.robot.solids import block

_INDICES = {5121: "<u1", 5123: "<u2", 5125: "<u4"}
"""kinds of components (glTF 2.0, section 3.6.2.2)"""


@dataclass
class RandomScene:
    """A scene, and its triangles."""

    seed: int
    triangles: FloatArray = field(default_factory=lambda: np.empty((0, 3, 3)))
    """(k, 3, 3) [m]"""
    scene: dict[str, Any] = field(default_factory=dict[str, Any])
    buffers: list[bytes] = field(default_factory=list[bytes])

    def written(self, folder: Path) -> Path:
        """A file of it: GLB, or glTF with buffers in the text or beside it."""
        rng = np.random.default_rng(self.seed + 1000)
        if len(self.buffers) == 1 and rng.random() < 0.5:
            return self._packed(folder / "scene.glb")
        entries: list[dict[str, Any]] = []
        for k, content in enumerate(self.buffers):
            uri = f"data:application/octet-stream;base64,{base64.b64encode(content).decode()}"
            if rng.random() < 0.5:
                uri = f"part {k}.bin"
                (folder / uri).write_bytes(content)
                uri = uri.replace(" ", "%20")
            entries.append({"uri": uri, "byteLength": len(content)})
        path = folder / "scene.gltf"
        path.write_text(json.dumps(self.scene | {"buffers": entries}))
        return path

    def _packed(self, path: Path) -> Path:
        (content,) = self.buffers
        content += bytes(-len(content) % 4)
        text = json.dumps(self.scene | {"buffers": [{"byteLength": len(content)}]}).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(content), b"BIN\0") + content
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
        return path


def random_scene(seed: int) -> RandomScene:
    """The scene of a seed: one to three boxes, each drawn once or twice."""
    rng, made = np.random.default_rng(seed), RandomScene(seed)
    count = 1 + seed % 3
    buffers = [bytearray() for _ in range(int(rng.integers(1, count + 1)))]
    meshes, nodes, roots = list[Any](), list[Any](), list[int]()
    views, accessors, drawn = list[Any](), list[Any](), list[FloatArray]()

    def view(content: bytes, buffer: int, **more: int) -> int:
        into = buffers[buffer]
        into += bytes(rng.integers(0, 256, 4 * rng.integers(0, 3), dtype=np.uint8))  # belongs to nobody
        into += bytes(-len(into) % 4)
        views.append({"buffer": buffer, "byteOffset": len(into), "byteLength": len(content), **more})
        into += content
        return len(views) - 1

    for mesh in range(count):
        x, y, z = rng.uniform(0.02, 0.3, 3).tolist()
        box = block((x, y, z))
        kind = int(rng.choice([0, *_INDICES]))
        points = box.vertices if kind else box.vertices[box.faces].reshape(-1, 3)
        points = (points + rng.uniform(-0.2, 0.2, 3)).astype("<f4")
        apart = 4 * int(rng.integers(3, 8))
        rows = rng.integers(0, 256, (len(points), apart), dtype=np.uint8)
        ahead = 4 * int(rng.integers(0, (apart - 12) // 4 + 1))
        rows[:, ahead : ahead + 12] = points.view(np.uint8).reshape(-1, 12)
        low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        stride = {} if apart == 12 and rng.random() < 0.5 else {"byteStride": apart}
        place = view(rows.tobytes(), mesh % len(buffers), **stride)
        accessors.append(
            {"bufferView": place, "byteOffset": ahead, "componentType": 5126, "count": len(points)}
            | {"type": "VEC3", "min": low, "max": high}
        )
        primitive: dict[str, Any] = {"attributes": {"POSITION": len(accessors) - 1}}
        faces = box.faces
        if kind:
            place = view(faces.astype(_INDICES[kind]).tobytes(), mesh % len(buffers))
            accessors.append(
                {"bufferView": place, "componentType": kind, "count": faces.size, "type": "SCALAR"}
            )
            primitive["indices"] = len(accessors) - 1
        meshes.append({"primitives": [primitive]})
        corners = points.astype(np.float64)[faces if kind else np.arange(len(points)).reshape(-1, 3)]
        for _ in range(int(rng.integers(1, 3))):
            pose = np.eye(4)
            chain = [_node(rng) for _ in range(int(rng.integers(1, 4)))]
            for k, (node, own) in enumerate(chain):
                pose = pose @ own
                last = k == len(chain) - 1
                nodes.append(node | ({"mesh": mesh} if last else {"children": [len(nodes) + 1]}))
            roots.append(len(nodes) - len(chain))
            moved = corners @ pose[:3, :3].T + pose[:3, 3]
            drawn.append(moved if np.linalg.det(pose[:3, :3]) > 0 else moved[:, ::-1])  # else inside out
    made.triangles = np.concatenate(drawn)
    made.buffers = [bytes(one) for one in buffers]
    made.scene = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": roots}],
        "nodes": nodes, "meshes": meshes, "accessors": accessors, "bufferViews": views,
    }  # fmt: skip
    return made


def _node(rng: np.random.Generator) -> tuple[dict[str, Any], FloatArray]:
    """A node that moves, turns and scales what hangs on it, perhaps mirrored; and its matrix (4, 4)."""
    T, written = np.eye(4), dict[str, Any]()
    quaternion = rng.normal(size=4)
    x, y, z, w = quaternion = quaternion / np.linalg.norm(quaternion)
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    if rng.random() < 0.7:
        written["rotation"] = quaternion.tolist()
        T[:3, :3] = turn
    if rng.random() < 0.7:
        scale = rng.uniform(0.5, 2.0, 3) * rng.choice([1, 1, -1])
        written["scale"] = scale.tolist()
        T[:3, :3] *= scale
    if rng.random() < 0.7:
        T[:3, 3] = rng.uniform(-0.5, 0.5, 3)
        written["translation"] = T[:3, 3].tolist()
    return ({"matrix": T.T.ravel().tolist()} if rng.random() < 0.3 else written), T
