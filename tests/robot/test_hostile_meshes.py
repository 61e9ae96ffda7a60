"""Meshes that are made to take for ever, or all memory: each is refused or read within bounds."""

from __future__ import annotations

import io
import json
import os
import random
import resource
import struct
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from armctl.apart import Tell, apart
from armctl.errors import RobotFileError, StoppedError
from armctl.process import heavy_work
from armctl.robot import load_robot
from armctl.robot.body import meshes as meshes
from armctl.robot.body.mesh_formats import MOST_CORNERS, require_bounded_dae
from armctl.robot.body.meshes import read_mesh
from armctl.robot.urdf.unpacking import zip_files

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
FACET = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
LONG = bool(os.environ.get("ARMCTL_LONG"))
FILES = 250 if LONG else 20
MANY = b"f 1 2 3\n" * 2_000_001 if LONG else (b"f" + 2_500 * b" 1 2 3 4" + b"\n") * 201
"""two million triangles: one a face, or ten thousand"""
MOST_S, MOST_MIB = 20.0, 1500
"""processor time of one file, and memory of the process that reads all of them"""


def ply(head: str, body: str = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", form: str = "ascii") -> bytes:
    return f"ply\nformat {form} 1.0\n{head}end_header\n{body}".encode()


THREE = "0 0 0\n1 0 0\n0 1 0\n"
PLY_HEAD = (
    "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
    "element face {}\nproperty list uchar int vertex_indices\n"
)


def gltf(random: random.Random) -> bytes:
    """A GLB file whose parts stand for many, or for what is not there."""
    n = random.choice([1, 30, 2_000, 100_000])
    scene = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": random.choice([[0], list(range(min(n, 2000)))])}],
        "nodes": random.choice([
            [{"mesh": 0}] * n, [{"children": [min(k + 1, n - 1)], "mesh": 0} for k in range(n)],
        ]),
        "meshes": [{"primitives": [
            {
                "attributes": {"POSITION": 0}, "mode": random.randrange(8),
                "indices": random.choice([0, 1, 10**9]),
            }
        ] * random.choice([1, 50, n])}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": random.choice([3, n, 10**12]), "type": "VEC3"},
            {"bufferView": 0, "componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": random.choice([36, 10**9])}],
        "buffers": [{"byteLength": 36}],
        "images": [{"uri": "data:image/png;base64," + "A" * n}],
    }  # fmt: skip
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", 36, b"BIN\0") + bytes(36)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def hostile(number: int) -> tuple[str, bytes]:
    """A file, from a seed: its suffix and content."""
    random_ = random.Random(number)
    n = random_.choice([3, 1_000, 30_000, 300_000])
    corners = " ".join(str(1 + k % 4) for k in range(random_.choice([3, n])))
    kinds: list[tuple[str, Callable[[], bytes]]] = [
        (".obj", lambda: f"{SQUARE}f {corners}\n".encode()),
        (".obj", lambda: (SQUARE + "".join(f"usemtl {k}\ng {k}\nf 1 2 3\n" for k in range(n))).encode()),
        (".obj", lambda: (SQUARE * n + f"f -1 -2 -{4 * n}\n").encode()),
        (".obj", lambda: (SQUARE + "f 1 2 3 " + "\\\n" * n + f" 4\nv {'9' * n} 1 1\n").encode()),
        (".obj", lambda: (SQUARE + "mtllib /etc/passwd http://a/b\n" * n + f"f 1/{'1/' * n} 2 3\n").encode()),
        (".stl", lambda: f"solid x\n{FACET}endsolid x\n".encode() * min(n, 30_000)),
        (".stl", lambda: ("solid x\n" + FACET * n + "vertex 1 2\n" * random_.randrange(3)).encode()),
        (".stl", lambda: (b"vertex " + b"1" * n + b" 0 0\n") * 3),
        (".stl", lambda: bytes(80) + struct.pack("<I", random_.choice([n, 2**32 - 1])) + bytes(50 * n)),
        (".ply", lambda: ply(PLY_HEAD.format(3, random_.choice([1, n, 10**15])))),
        (".ply", lambda: ply(PLY_HEAD.format(3, 1), f"0 0 0\n1 0 0\n0 1 0\n{n} {'0 1 2 ' * (n // 3)}\n")),
        (".ply", lambda: ply(PLY_HEAD.format(3, n), THREE + "3 0 1 2\n4 0 1 2 0\n" * (n // 2))),
        (".ply", lambda: ply("property list uint int a\n" * n + PLY_HEAD.format(3, 1))),
        (".ply", lambda: ply(PLY_HEAD.format(3, 1), "\0" * n, "binary_little_endian")),
        (".glb", lambda: gltf(random_)),
        (".glb", lambda: gltf(random_)),
    ]  # fmt: skip
    suffix, content = random_.choice(kinds)
    whole = content()
    if random_.random() < 0.2:
        whole = whole[: random_.randrange(len(whole) + 1)]
    return suffix, whole


def read_them(request: bytes, tell: Tell) -> bytes:
    """Read hostile files; how long the longest took, which one, and the memory of this process [MiB]."""
    folder, numbers = msgspec.msgpack.decode(request, type=tuple[str, list[int]])
    longest, which, read = 0.0, 0, 0
    for number in numbers:
        suffix, content = hostile(number)
        path = Path(folder) / f"a{suffix}"
        path.write_bytes(content)
        begun = time.process_time()
        try:
            read += len(read_mesh(path).faces) > 0
        except RobotFileError as refusal:
            assert "\n" not in str(refusal) and len(str(refusal)) < 500, str(refusal)
        took = time.process_time() - begun
        if took > longest:
            longest, which = took, number
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return msgspec.msgpack.encode((longest, which, memory, read))


def test_no_file_takes_long_or_much_memory(tmp_path: Path) -> None:
    request = msgspec.msgpack.encode((str(tmp_path), list(range(FILES))))
    answer = apart(f"{__name__}:read_them", request, seconds=600)
    longest, which, memory, read = msgspec.msgpack.decode(answer, type=tuple[float, int, float, int])
    assert longest < MOST_S, which
    assert memory < MOST_MIB
    assert read > 0.08 * FILES


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.obj", f"{SQUARE}f {'1 2 3 ' * 300_000}\n".encode(), f"a face of .*{MOST_CORNERS}"),
        ("a.obj", SQUARE.encode() + MANY, "holds more than 2000000 triangles"),
        ("a.obj", b"v 1 2\nf 1 1 1\n", "no three coordinates"),
        ("a.obj", b"v 1 2 x\nf 1 1 1\n", "holds a point that is none"),
        ("a.obj", SQUARE.encode() + b"f 1 2 0\n", "triangles of points that are not there"),
        ("a.obj", SQUARE.encode() + b"f 1 b 2\n", "holds a face that is none: '1 b 2'"),
        ("a.stl", b"vertex 0 0 0\n" * 4, "4 corners, which are no triangles"),
        ("a.stl", b"vertex " + b"1" * 100 + b" 0 0\n" + b"vertex 0 0 0\n" * 2, "more than 64 letters"),
        ("a.ply", ply(PLY_HEAD.format(3, 10**12)), "announces '1000000000000' of face"),
        ("a.ply", ply(PLY_HEAD.format(3, 1), f"{THREE}9 {'0 1 2 ' * 99_999}\n"), "a face of more"),
        ("a.ply", ply("property float p\n" * 99), "more than 64 properties"),
        ("a.ply", b"plyable", "it has no head"),
    ],
)  # fmt: skip
def test_what_is_beyond_the_bounds_is_refused_in_one_line(
    tmp_path: Path, name: str, content: bytes, says: str
) -> None:
    (tmp_path / name).write_bytes(content)
    begun = time.process_time()
    with pytest.raises(RobotFileError, match=says) as refused:
        read_mesh(tmp_path / name)
    assert "\n" not in str(refused.value)
    assert time.process_time() - begun < MOST_S


def test_many_small_parts_are_read_as_quickly_as_one(tmp_path: Path) -> None:
    """A library took 83 s over the first, and longer over the second."""
    parts = "v 9 9 9\n" * 200_000 + SQUARE + "".join(f"usemtl m{k}\nf -4 -3 -2\n" for k in range(30_000))
    for name, content in (("a.obj", parts), ("a.stl", f"solid x\n{FACET}endsolid x\n" * 100_000)):
        (tmp_path / name).write_text(content)
        begun = time.process_time()
        assert len(read_mesh(tmp_path / name).faces) in (30_000, 100_000)
        assert time.process_time() - begun < MOST_S


def test_faces_of_many_corners_are_fans_and_indices_may_count_back(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text(f"# a comment\no part\n{SQUARE}vn 0 0 1\nf 1/1/1 2//1 3 \\\n 4 # a square\n")
    solid = read_mesh(path)
    assert solid.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    path.write_text(f"v 7 7 7 1.0\r\n{SQUARE}f -4 -3 -2 -1\nv 8 8 8 0.1 0.2 0.3\n".replace("\n", "\r\n"))
    assert read_mesh(path).faces.tolist() == [[1, 2, 3], [1, 3, 4]]


def dae(scene: str, library: str = "", geometry: str = "<triangles><p>0 1 2</p></triangles>") -> bytes:
    return (
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f'<library_geometries><geometry id="g"><mesh>{geometry}</mesh></geometry></library_geometries>'
        f"<library_nodes>{library}</library_nodes>"
        f'<library_visual_scenes><visual_scene id="s">{scene}</visual_scene></library_visual_scenes>'
        "</COLLADA>"
    ).encode()


DOUBLING = "".join(
    f'<node id="n{k}"><instance_node url="#n{k + 1}"/><instance_node url="#n{k + 1}"/></node>'
    for k in range(30)
)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (dae('<node><instance_node url="#n0"/></node>', DOUBLING), "too many|below each other"),
        (dae('<node id="a"><instance_node url="#a"/></node>'), "below each other"),
        (dae('<node><instance_geometry url="http://a/b#g"/></node>'), "keeps parts in other files"),
        (dae("<node/>", geometry="<polylist><vcount>3 99999</vcount><p>0 1 2</p></polylist>"), "corners"),
        (
            dae(
                '<node><instance_geometry url="#g"/></node>' * 900,
                geometry=f"<triangles><p>{'0 1 2 ' * 9000}</p></triangles>",
            ),
            "is too large once it is read",
        ),
        (b'<!DOCTYPE x [<!ENTITY a "b">]><COLLADA/>', "declares entities"),
        (b"<COLLADA>", "cannot be read"),
    ],
)
def test_a_dae_file_that_grows_is_refused(content: bytes, says: str) -> None:
    begun = time.process_time()
    with pytest.raises(RobotFileError, match=says):
        require_bounded_dae(content, meshes.MOST_TRIANGLES)
    assert time.process_time() - begun < MOST_S


def test_an_honest_dae_file_is_within_bounds() -> None:
    require_bounded_dae(dae('<node><node><instance_geometry url="#g"/></node></node>'), 1000)


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_zip_file_is_packed_as_usual(method: int) -> None:
    """These two pack zeros 10,000 to 1, and take a hundred times as long to unpack."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        archive.writestr("a.stl", b"x")
    with pytest.raises(RobotFileError, match=r"a\.stl is packed in an uncommon way; .*\(deflate\)"):
        zip_files(stream.getvalue())


def arm_with_a_mesh(folder: Path) -> Path:
    """A small arm whose only mesh is a ball of points: hulls of it take minutes."""
    rng = np.random.default_rng(1)
    points = rng.normal(size=(300_000, 3))
    points *= 0.1 / np.linalg.norm(points, axis=1)[:, None]
    corners = points[rng.integers(0, len(points), (600_000, 3))].astype("<f4")
    facets = np.zeros(len(corners), meshes._STL)
    facets["corners"] = corners
    content = bytes(80) + struct.pack("<I", len(facets)) + facets.tobytes()
    (folder / "ball.stl").write_bytes(content)
    path = folder / "arm.urdf"
    path.write_text(
        '<robot name="ball"><link name="base"/><link name="tip"><visual><geometry>'
        '<mesh filename="ball.stl"/></geometry></visual></link><joint name="turn" type="revolute">'
        '<parent link="base"/><child link="tip"/><axis xyz="0 0 1"/><origin xyz="0 0 0.1"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    return path


def test_an_arm_whose_meshes_take_too_long_is_refused_and_its_process_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = load_robot(arm_with_a_mesh(tmp_path))
    monkeypatch.setattr(heavy_work, "_ARM_S", 2.0)
    begun = time.process_time()
    with pytest.raises(RobotFileError, match=r"the meshes of ball: it takes more than 2 s .*coarser"):
        heavy_work.worked_out(robot, (1000,))
    assert time.process_time() - begun < 1.0  # of this process


def test_the_work_on_meshes_ends_when_nobody_wants_it(tmp_path: Path) -> None:
    robot = load_robot(arm_with_a_mesh(tmp_path))

    def leave(*_: int) -> None:
        raise StoppedError("left")

    with pytest.raises(StoppedError, match="left"):
        heavy_work.worked_out(robot, (1000,), leave)


def test_an_arm_worked_out_apart_is_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "ball.stl").unlink(missing_ok=True)
    path = arm_with_a_mesh(tmp_path)
    box = "".join(f"v {x} {y} {z}\n" for x in (0, 0.1) for y in (0, 0.1) for z in (0, 0.1))
    (tmp_path / "box.obj").write_text(f"{box}f 1 2 4 3\nf 5 6 8 7\nf 1 2 6 5\nf 3 4 8 7\n")
    path.write_text(path.read_text().replace("ball.stl", "box.obj"))
    robot = load_robot(path)
    told: list[tuple[int, int]] = []
    apart_, drawn = heavy_work.worked_out(robot, (1000,), lambda *done: told.append(done))
    assert {parts for _, parts in told} == {3}  # the base, a link, a drawing
    assert told[-1][0] == 2
    assert sorted(told) == told

    def no_process(*_: object, **__: object) -> bytes:
        raise AssertionError("what is kept takes no process")

    with monkeypatch.context() as patch:
        patch.setattr(heavy_work, "apart", no_process)
        again, drawn_again = heavy_work.worked_out(robot, (1000,))
    assert again == apart_
    assert np.array_equal(drawn_again[1000][0][2].vertices, drawn[1000][0][2].vertices)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "empty"))  # so that it is worked out once more
    here = robot.with_body()
    assert apart_.assumed == here.assumed
    assert apart_.capsules == here.capsules
    ((link, _, solid),) = drawn[1000]
    ((link_here, _, solid_here),) = meshes.coarse_solids(robot.shapes, 1000)
    assert link == link_here and np.array_equal(solid.vertices, solid_here.vertices)
    assert np.array_equal(solid.faces, solid_here.faces)
