"""Meshes as published arms keep them: found, read, or named with what to do."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from tests.robot.plain_arm import LINKS, write_plain_arm
from tests.robot.random_gltf import random_scene
from tests.robot.test_meshes import binary_stl

from armctl import load_robot
from armctl.arrays import FloatArray
from armctl.errors import RobotFileError
from armctl.motion.clearance import stands_clear
from armctl.robot.body.meshes import read_mesh
from armctl.robot.solids import Solid, block

PART = block((0.03, 0.03, 0.08))
POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"


def meshed(folder: Path, name: str, *, urdf: str = "arm.urdf", scale: str = "1 1 1") -> Path:
    """The plain arm, drawn by one mesh."""
    mesh = f'<mesh filename="{name}" scale="{scale}"/>'
    return write_plain_arm(folder / urdf, visual=mesh, collision=mesh)


def part(path: Path, solid: Solid = PART) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(binary_stl(solid))


def lacking(file: Path) -> list[str]:
    return [text for text in load_robot(file).assumed if text.startswith("passed over")]


@pytest.mark.parametrize(
    ("written", "there"),
    [
        ("meshes/part.stl", "meshes/PART.STL"),
        ("Meshes/Part.STL", "meshes/part.stl"),
        ("meshes\\part.stl", "meshes/part.stl"),
        ("..\\arm\\MESHES\\part.stl", "meshes/part.stl"),
        ("package://outer_description/repository/arm/meshes/part.stl", "meshes/part.stl"),
        ("package://Other/arm/Meshes/part.stl", "meshes/part.stl"),
        ("model://arm/meshes/visual/part%201.stl", "meshes/visual/part 1.stl"),
        ("C:\\Users\\me\\arm\\meshes\\part.stl", "meshes/part.stl"),
        ("package:\\\\outer\\meshes\\part.stl", "meshes/part.stl"),
    ],
)
def test_meshes_that_are_there_are_found(tmp_path: Path, written: str, there: str) -> None:
    part(tmp_path / "clone/arm" / there)
    file = meshed(tmp_path / "clone/arm", written, urdf="urdf/arm.urdf")
    assert not lacking(file)
    assert {Path(shape.file).name for shape in load_robot(file).shapes} == {Path(there).name}


@pytest.mark.parametrize("seed", range(15))
def test_any_clone_is_read_as_its_package(tmp_path: Path, seed: int) -> None:
    """Folders of any depth and any name above; letters of any case."""
    chance = np.random.default_rng(seed)
    inner = [f"d{k}" for k in range(int(chance.integers(1, 4)))]
    name = "".join(letter.upper() if chance.random() < 0.3 else letter for letter in "link_part.stl")
    (tmp_path / "my clone/.git").mkdir(parents=True)
    part(tmp_path.joinpath("my clone", *inner, "meshes", name))
    part(tmp_path.joinpath("my clone/other", *inner, "parts", name))
    uri = "/".join([*inner[int(chance.integers(len(inner))) :], "Meshes", "link_part.stl"])
    place = tmp_path.joinpath("my clone", *inner[: int(chance.integers(len(inner) + 1))], "urdf")
    assert not lacking(meshed(place, f"package://{chance.choice(['a', 'b_description'])}/{uri}"))


def test_near_misses_are_named(tmp_path: Path) -> None:
    part(tmp_path / "meshes/Part.stl")
    (line,) = lacking(meshed(tmp_path, "meshes/part.dae"))
    assert "meshes/part.dae is not found, but Part.stl is there" in line
    part(tmp_path / "meshes/PART.stl")  # which of the two is meant?
    (line,) = lacking(meshed(tmp_path, "meshes/part.stl"))
    assert "not found, but PART.stl, Part.stl is there" in line
    (line,) = lacking(meshed(tmp_path, "meshes/none.stl"))
    assert line.endswith("meshes/none.stl is not found")


def test_a_git_lfs_pointer_is_told_once_with_the_cure(tmp_path: Path) -> None:
    (tmp_path / "part.stl").write_bytes(POINTER)
    (line,) = lacking(meshed(tmp_path, "part.stl"))
    assert "part.stl is a Git LFS pointer" in line and "git lfs pull" in line
    (tmp_path / "arm.urdf").write_bytes(POINTER)
    with pytest.raises(RobotFileError, match=r"arm\.urdf: is a Git LFS pointer.*git lfs pull"):
        load_robot(tmp_path / "arm.urdf")


# Units.


@pytest.mark.parametrize("factor", [1000.0, 300.0, 5000.0])
def test_a_mesh_in_millimetres_is_named_with_its_size(tmp_path: Path, factor: float) -> None:
    part(tmp_path / "part_mm.stl", Solid(PART.vertices * factor, PART.faces))
    file = meshed(tmp_path, "part_mm.stl")
    robot = load_robot(file).with_body()
    (line,) = (text for text in robot.assumed if text.startswith("passed over"))
    assert f"part_mm.stl is {0.08 * factor:.3g} m large" in line and 'scale="0.001 0.001 0.001"' in line
    assert robot.shapes == () and stands_clear(robot, robot.pose("home"))
    if factor == 1000.0:
        robot = load_robot(meshed(tmp_path, "part_mm.stl", scale="0.001 0.001 0.001")).with_body()
        assert len(robot.shapes) == len(LINKS)
        assert not any(text.startswith("passed over") for text in robot.assumed)


@pytest.mark.parametrize("seed", range(8))
def test_random_meshes_are_in_metres_or_named_with_their_scale(tmp_path: Path, seed: int) -> None:
    rng, unit = Random(seed), (1.0, 0.001, 0.01, 0.0254)[seed % 4]
    size = [rng.uniform(0.015, 0.06), rng.uniform(0.015, 0.06), rng.uniform(0.06, 0.2)]
    part(tmp_path / "part.stl", block((size[0] / unit, size[1] / unit, size[2] / unit)))
    robot = load_robot(meshed(tmp_path, "part.stl")).with_body()
    passed_over = [text for text in robot.assumed if text.startswith("passed over")]
    if unit == 1.0:
        assert not passed_over and len(robot.shapes) == len(LINKS)
        return
    (line,) = passed_over
    assert f'scale="{unit:g} {unit:g} {unit:g}"' in line and robot.shapes == ()
    right = load_robot(meshed(tmp_path, "part.stl", scale=f"{unit} {unit} {unit}")).with_body()
    assert len(right.shapes) == len(LINKS)


def test_meshes_that_are_all_tiny_have_another_unit(tmp_path: Path) -> None:
    part(tmp_path / "part.stl")
    robot = load_robot(meshed(tmp_path, "part.stl", scale="0.001 0.001 0.001")).with_body()
    (line,) = (text for text in robot.assumed if text.startswith("passed over"))
    assert "scale=" in line and robot.shapes == ()


# glTF.


def gltf(folder: Path, uris: tuple[str, str], **changes: Any) -> Path:
    """A block whose corners and faces are in two buffers."""
    corners, faces = PART.vertices.astype("<f4").tobytes(), PART.faces.astype("<u2").tobytes()
    for uri, content in zip(uris, (corners, faces), strict=True):
        if not uri.startswith("data:") and "/" not in uri:
            (folder / uri).write_bytes(content)
    low, high = PART.vertices.min(axis=0).tolist(), PART.vertices.max(axis=0).tolist()
    scene = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3", "min": low, "max": high},
            {"bufferView": 1, "componentType": 5123, "count": PART.faces.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(corners)},
            {"buffer": 1, "byteLength": len(faces)},
        ],
        "buffers": [
            {"uri": uri, "byteLength": len(content)}
            for uri, content in zip(uris, (corners, faces), strict=True)
        ],
    }
    path = folder / "a.gltf"
    path.write_text(json.dumps(scene | changes))
    return path


@pytest.mark.parametrize("seed", range(40))
def test_random_gltf_files_have_their_triangles(tmp_path: Path, seed: int) -> None:
    scene = random_scene(seed)
    found = read_mesh(scene.written(tmp_path))
    assert signatures(found.vertices[found.faces]) == pytest.approx(signatures(scene.triangles), abs=2e-6)


def signatures(triangles: FloatArray) -> FloatArray:
    """(k, 6) the middle and the area vector of triangles (k, 3, 3), in an order of their own."""
    area = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    rows = np.hstack([triangles.mean(axis=1), area])
    return rows[np.lexsort(rows.round(4).T)]


def in_text(content: bytes) -> str:
    return "data:application/octet-stream;base64," + base64.b64encode(content).decode()


def test_gltf_is_read_with_the_files_of_its_folder(tmp_path: Path) -> None:
    faces = in_text(PART.faces.astype("<u2").tobytes())
    for uris in (("corners.bin", "faces.bin"), ("corners.bin", faces)):
        found = read_mesh(gltf(tmp_path, uris, images=[{"uri": "/etc/passwd"}]))
        assert len(found.faces) == len(PART.faces)
        assert np.abs(found.vertices).max(axis=0) == pytest.approx([0.015, 0.015, 0.04], abs=1e-7)
    robot = load_robot(meshed(tmp_path, "a.gltf")).with_body()
    assert len(robot.shapes) == len(LINKS)


@pytest.mark.parametrize(
    ("uri", "says"),
    [
        ("../corners.bin", "outside of its folder"), ("/etc/hostname", "outside of its folder"),
        ("%2e%2e/corners.bin", "outside of its folder"), ("http://a.b/c.bin", "outside of its folder"),
        ("sub/none.bin", "which is not there"), ("data:,@@@", "is no base64"),
        ("link/corners.bin", "outside of its folder"), ("file:///etc/hostname", "outside of its folder"),
    ],
)  # fmt: skip
def test_gltf_reads_nothing_from_elsewhere(tmp_path: Path, uri: str, says: str) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    (tmp_path / "corners.bin").write_bytes(b"x")
    (folder / "link").symlink_to(tmp_path)
    with pytest.raises(RobotFileError, match=says):
        read_mesh(gltf(folder, (uri, "faces.bin")))


@pytest.mark.parametrize(
    "changes",
    [
        {"buffers": 1}, {"buffers": [1]}, {"buffers": []}, {"buffers": [{}]}, {"bufferViews": [[]]},
        {"bufferViews": [{"buffer": 9, "byteLength": 1}]}, {"accessors": []}, {"nodes": [{"mesh": 7}]},
        {"bufferViews": [{"buffer": 0, "byteLength": 1 << 40}] * 2}, {"meshes": [{"primitives": [{}]}]},
        {"nodes": [{"mesh": 0}] * 5000, "scenes": [{"nodes": list(range(5000))}]},
    ],
)  # fmt: skip
def test_hostile_gltf_is_refused(tmp_path: Path, changes: dict[str, Any]) -> None:
    with pytest.raises(RobotFileError):
        read_mesh(gltf(tmp_path, ("corners.bin", "faces.bin"), **changes))
