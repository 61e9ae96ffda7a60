"""Meshes read within bounds, made coarser, and contained in capsules."""

from __future__ import annotations

import json
import math
import struct
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.robot.urdf_kit import Step, written

from armctl import load_robot
from armctl.arrays import FloatArray
from armctl.errors import RobotFileError
from armctl.kinematics import rotation_from_rpy
from armctl.kinematics.frames import LinkFrames
from armctl.motion import SelfCollision, not_checked
from armctl.motion.clearance import clear_pose, stands_clear
from armctl.motion.preflight import preflight
from armctl.motion.profiles import PointToPoint
from armctl.robot.body import meshes as meshes
from armctl.robot.body.fitting import Fitted, _points_on, fit
from armctl.robot.body.meshes import read_mesh, solid_of
from armctl.robot.parts import Shape
from armctl.robot.robot import Robot
from armctl.robot.solids import Solid, block, decimated, grown, tube, welded


def posed(
    solid: Solid, xyz: tuple[float, float, float], rpy: tuple[float, float, float] = (0, 0, 0)
) -> Solid:
    return Solid(solid.vertices @ rotation_from_rpy(*rpy).T + xyz, solid.faces)


def binary_stl(solid: Solid) -> bytes:
    facets = b"".join(struct.pack("<12fH", 0, 0, 1, *solid.vertices[face].ravel(), 0) for face in solid.faces)
    return bytes(80) + struct.pack("<I", len(solid.faces)) + facets


def text_of(solid: Solid, kind: str) -> str:
    if kind == "obj":
        lines = [f"v {x} {y} {z}" for x, y, z in solid.vertices.tolist()]
        return "\n".join([*lines, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in solid.faces.tolist())])
    if kind == "ply":
        head = f"ply\nformat ascii 1.0\nelement vertex {len(solid.vertices)}\nproperty float x\n"
        head += f"property float y\nproperty float z\nelement face {len(solid.faces)}\n"
        head += "property list uchar int vertex_indices\n"
        lines = [f"{x} {y} {z}" for x, y, z in solid.vertices.tolist()]
        faces = [f"3 {a} {b} {c}" for a, b, c in solid.faces.tolist()]
        return head + "end_header\n" + "\n".join([*lines, *faces]) + "\n"
    facets = [
        "facet normal 0 0 1\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in solid.vertices[face].tolist())
        + "endloop\nendfacet\n"
        for face in solid.faces
    ]
    return f"solid x\n{''.join(facets)}endsolid x\n"


BOX = posed(block((0.1, 0.04, 0.02)), (0.02, 0.0, 0.3), (0.3, -0.2, 0.5))


def sorted_corners(solid: Solid) -> FloatArray:
    corners = solid.vertices[solid.faces].reshape(-1, 9)
    return corners[np.lexsort(corners.round(6).T)]


def glb(solid: Solid, **changed: Any) -> bytes:
    """A binary glTF 2.0 file: one mesh, drawn here and 1 m along x; ``changed`` replaces parts of it."""
    points, corners = solid.vertices.astype("<f4").tobytes(), solid.faces.astype("<u4").tobytes()
    views = [
        {"buffer": 0, "byteOffset": 0, "byteLength": len(points)},
        {"buffer": 0, "byteOffset": len(points), "byteLength": len(corners)},
    ]
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": len(solid.vertices), "type": "VEC3"},
        {"bufferView": 1, "componentType": 5125, "count": solid.faces.size, "type": "SCALAR"},
    ]
    scene = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"mesh": 0, "translation": [1, 0, 0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(points + corners)}],
    }
    text = json.dumps(scene | changed).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(points + corners), b"BIN\0") + points + corners
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def test_a_glb_file_is_drawn_as_often_as_it_says(tmp_path: Path) -> None:
    (tmp_path / "two.glb").write_bytes(glb(BOX))
    both = np.concatenate([BOX.vertices, BOX.vertices + np.array([1.0, 0.0, 0.0])])
    expected = Solid(both, np.concatenate([BOX.faces, BOX.faces + len(BOX.vertices)]))
    read = read_mesh(tmp_path / "two.glb")
    assert np.abs(sorted_corners(read) - sorted_corners(expected)).max() < 1e-6


def test_what_changes_no_shape_may_be_needed(tmp_path: Path) -> None:
    chain = [{"children": [k + 1]} for k in range(32)] + [{"mesh": 0}]
    scene = {"nodes": chain, "scenes": [{"nodes": [0]}], "extensionsRequired": ["KHR_materials_unlit"]}
    (tmp_path / "one.glb").write_bytes(glb(BOX, **scene))
    assert len(read_mesh(tmp_path / "one.glb").faces) == len(BOX.faces)


ACCESSOR = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"nodes": [{"mesh": 0}] * 900, "accessors": [ACCESSOR | {"count": 7_000}] * 2}, "is too large once"),
        ({"nodes": [{"mesh": 0}] * 1_000}, "1000 pieces at most"),
        ({"nodes": [{"children": [k + 1]} for k in range(33)] + [{"mesh": 0}]}, "more than 32 pieces below"),
        ({"nodes": [{"children": [1]}, {"children": [0]}]}, "more than 32 pieces below each other"),
        ({"extensionsRequired": ["KHR_mesh_quantization"]}, "needs KHR_mesh_quantization; export it without"),
        ({"accessors": [ACCESSOR | {"count": 10**12}] * 2}, "is too large once"),
        ({"bufferViews": [{"buffer": 0, "byteLength": 300}] * 300_000}, "is too large once"),
        ({"accessors": [{"componentType": 5126, "count": 3, "type": "VEC3"}] * 2}, "without compression"),
        ({"accessors": [ACCESSOR | {"count": -1}] * 2}, "cannot be read: Expected `int` >= 0"),
        ({"buffers": [{"uri": "points.bin", "byteLength": 9}]}, "export it as one GLB file"),
        ({"nodes": [{"mesh": 7}]}, "refers to parts that are not there"),
        ({"meshes": [{"primitives": [{"attributes": {}}]}]}, "refers to parts that are not there"),
        ({"scenes": []}, "cannot be read: "),
    ],
)
def test_a_glb_file_that_grows_is_refused(tmp_path: Path, changed: dict[str, Any], says: str) -> None:
    path = tmp_path / "a.glb"
    path.write_bytes(glb(BOX, **changed))
    with pytest.raises(RobotFileError, match=says) as refused:
        read_mesh(path)
    assert "\n" not in str(refused.value)
    for cut in (0, 11, 19, 25, 400):
        path.write_bytes(glb(BOX)[:cut])
        with pytest.raises(RobotFileError, match=r"a\.glb: "):
            read_mesh(path)


@pytest.mark.parametrize("kind", ["binary", "stl", "obj", "ply"])
def test_every_format_holds_the_same_triangles(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"box.{'STL' if kind == 'binary' else kind}"
    path.write_bytes(binary_stl(BOX) if kind == "binary" else text_of(BOX, kind).encode())
    solid = read_mesh(path)
    assert np.abs(sorted_corners(solid) - sorted_corners(BOX)).max() < 1e-7
    mirrored = solid_of(Shape("mesh", (1.0, -2.0, 1.0), np.eye(4), str(path)))
    assert np.abs(mirrored.vertices - solid.vertices * [1, -2, 1]).max() < 1e-12
    assert volume(mirrored) == pytest.approx(2 * volume(solid), rel=1e-5)  # not inside out


def volume(solid: Solid) -> float:
    a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))
    return float((np.cross(a, b) * c).sum() / 6)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.stl", b"", r"a\.stl: "),
        ("a.stl", binary_stl(BOX)[:-7], r"a\.stl: "),
        ("a.stl", bytes(80) + struct.pack("<I", 0), "holds no triangles"),
        ("a.stl", binary_stl(Solid(BOX.vertices * math.nan, BOX.faces)), "no finite numbers"),
        ("a.obj", b"v 0 0 0\nf 1 2 9\n", r"a\.obj: "),
        ("a.obj", b"nothing", r"a\.obj: "),
        ("a.step", b"x", r"is not one of \.stl, \.obj, \.ply, \.dae, \.glb, \.gltf"),
        ("a.dae", b"PK\x03\x04", "is not XML|takes pycollada"),
    ],
)
def test_what_is_no_mesh_is_refused_in_one_line(tmp_path: Path, name: str, content: bytes, says: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RobotFileError, match=says) as refused:
        read_mesh(tmp_path / name)
    assert "\n" not in str(refused.value)


def test_sizes_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.stl"
    path.write_bytes(binary_stl(BOX))
    with pytest.raises(RobotFileError, match=r'a\.stl is 107 m large.*scale="1 1 1"'):
        solid_of(Shape("mesh", (1e3, 1e3, 1e3), np.eye(4), str(path)))
    monkeypatch.setattr(meshes, "MOST_TRIANGLES", 11)
    with pytest.raises(RobotFileError, match="holds 12 triangles; 11 at most"):
        read_mesh(path)
    monkeypatch.setattr(meshes, "MESHES", replace(meshes.MESHES, most_bytes=100))
    with pytest.raises(RobotFileError, match="is larger than 0 KiB"):
        read_mesh(path)


def test_a_dae_file_needs_its_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshes, "find_spec", lambda name: None)
    (tmp_path / "a.dae").write_text("<COLLADA/>")
    with pytest.raises(RobotFileError, match=r"takes pycollada: pip install pycollada"):
        read_mesh(tmp_path / "a.dae")


@pytest.mark.parametrize("size", [0.0, 1e-10])
def test_a_mesh_of_one_point_is_refused(tmp_path: Path, size: float) -> None:
    path = tmp_path / "dot.obj"
    path.write_text(f"v 0 0 0\nv {size:f} 0 0\nv 0 {size:.12f} 0\nv 9 9 9\nf 1 2 3\n")
    with pytest.raises(RobotFileError, match="holds no surface"):
        read_mesh(path)
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(RobotFileError, match="holds no surface"):
        solid_of(Shape("mesh", (size, size, size), np.eye(4), str(path)))


def test_an_arm_has_so_many_triangles_and_points(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshes, "MOST_OF_ARM", 30)
    solids, box = meshes.ArmSolids(), Shape("box", (0.1, 0.1, 0.1), np.eye(4))
    assert [len(solids.solid_of(box).faces) for _ in range(2)] == [12, 12]
    for _ in range(2):
        with pytest.raises(RobotFileError, match="box: beyond the 30 triangles"):
            solids.solid_of(box)
    triangles = np.random.default_rng(1).uniform(-1, 1, (1000, 3, 3))
    assert len(_points_on(triangles, 0.03)) <= 200_000 + 3000


def test_a_coarser_mesh_keeps_its_shape() -> None:
    fine = tube((0, 0, 0), (0, 0, 0.2), 0.08)
    coarse = decimated(fine, 150)
    assert 40 < len(coarse.faces) <= 150
    assert np.abs(np.ptp(coarse.vertices, axis=0) - np.ptp(fine.vertices, axis=0)).max() < 0.03
    assert decimated(fine, len(fine.faces)) is fine
    loose = Solid(fine.vertices[fine.faces].reshape(-1, 3), np.arange(3 * len(fine.faces)).reshape(-1, 3))
    assert len(welded(loose).vertices) == len(fine.vertices)
    ball = grown(tube((0, 0, 0), (0, 0, 1e-6), 0.1), 0.002)
    assert np.linalg.norm(ball.vertices, axis=1) == pytest.approx(0.052, abs=3e-4)


# Capsules.


def outside(points: FloatArray, capsules: list[Fitted]) -> float:
    """How far the farthest of points (k, 3) is outside of all capsules [m]; by plain vectors, one by one."""
    worst = -math.inf
    for point in points:
        nearest = math.inf
        for one in capsules:
            span = one.end - one.start
            square = float(span @ span)
            t = 0.0 if square == 0 else min(max(float((point - one.start) @ span) / square, 0.0), 1.0)
            nearest = min(nearest, float(np.linalg.norm(point - one.start - t * span)) - one.radius)
        worst = max(worst, nearest)
    return worst


def points_on(solids: list[Solid], rng: np.random.Generator, each: int) -> FloatArray:
    """Corners and random points of all triangles (k, 3)."""
    corners = np.concatenate([one.vertices[one.faces] for one in solids])
    weights = rng.dirichlet([1, 1, 1], (len(corners), each))
    return np.concatenate(
        [corners.reshape(-1, 3), np.einsum("tec,tcx->tex", weights, corners).reshape(-1, 3)]
    )


L_SHAPE = [block((0.3, 0.04, 0.04)), posed(block((0.04, 0.04, 0.3)), (0.13, 0, 0.13))]
_ROUND = np.linspace(0, 2 * np.pi, 40)
RING = Solid(  # flat, round a hole of 100 mm
    np.concatenate([[(r * math.cos(a), r * math.sin(a), 0.0) for a in _ROUND] for r in (0.1, 0.12)]),
    np.array([(k, k + 1, k + 40) for k in range(39)] + [(k + 1, k + 41, k + 40) for k in range(39)]),
)
SOLIDS = {
    "rod": ([tube((0, 0, 0), (0.1, 0.2, 0.3), 0.06)], 1, 0.008),
    "ball": ([tube((0, 0, 0), (0, 0, 1e-4), 0.1)], 1, 0.008),
    "box": ([BOX], 1, 0.001),
    "plate": ([block((0.2, 0.2, 0.004))], 1, 0.003),
    "bent": (L_SHAPE, 2, 0.005),
    "ring": ([RING], 1, 0.11),
    "one triangle": ([Solid(np.eye(3), np.array([[0, 1, 2]]))], 1, 0.01),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_hulls_and_their_capsules_contain_the_whole_mesh(name: str) -> None:
    solids, most, largest = SOLIDS[name]
    found, gap = fit(solids)
    assert 1 <= len(found) <= most
    points = points_on(solids, np.random.default_rng(1), 8)
    assert outside(points, found) <= 1e-9
    assert outside_hulls(points, found) <= 1e-9
    assert 0 <= gap <= largest


def outside_hulls(points: FloatArray, found: list[Fitted]) -> float:
    """How far the farthest of points (k, 3) is outside of all hulls with their margins [m]: a lower bound.

    Outside of a hull with an inside is what lies beyond one of its faces, outside of a flat one what is off
    its plane; scipy finds the faces anew.
    """
    beyond = np.full(len(points), np.inf)
    for one in found:
        corners = one.hull.corners
        off = corners - corners.mean(axis=0)
        across = np.linalg.svd(off)[2][2]
        if np.abs(off @ across).max() < 1e-7:
            away = np.abs((points - corners.mean(axis=0)) @ across)
        else:
            faces = import_module("scipy.spatial").ConvexHull(corners).equations
            away = (points @ faces[:, :3].T + faces[:, 3]).max(axis=1)
        beyond = np.minimum(beyond, away - one.hull.margin)
    return float(beyond.max())


def test_random_clouds_of_triangles_are_contained() -> None:
    rng = np.random.default_rng(2)
    for k in range(6):
        corners = rng.normal(size=(int(rng.integers(1, 300)), 3, 3)) * rng.uniform(0.01, 0.3, 3)
        solid = Solid(corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3))
        found, gap = fit([solid])
        points = points_on([solid], rng, 2)
        assert outside(points, found) <= 1e-9 and outside_hulls(points, found) <= 1e-9
        assert gap >= 0, k


def test_the_gap_is_that_of_points_of_the_surface() -> None:
    """The hull of a box without a lid stands off by half its width in the middle of the open side."""
    walls = [
        posed(block(size), at)
        for size, at in (
            ((0.2, 0.2, 0.002), (0.0, 0.0, 0.0)),
            ((0.002, 0.2, 0.1), (0.1, 0.0, 0.05)),
            ((0.002, 0.2, 0.1), (-0.1, 0.0, 0.05)),
            ((0.2, 0.002, 0.1), (0.0, 0.1, 0.05)),
            ((0.2, 0.002, 0.1), (0.0, -0.1, 0.05)),
        )
    ]
    found, gap = fit(walls)
    assert len(found) == 1 and gap == pytest.approx(0.1, abs=0.01)
    assert fit([RING])[1] == pytest.approx(0.1, abs=0.01)  # a flat one, too


# A whole arm.

STEPS = (
    Step("pan", "revolute", "base", "body", "0 0 0.1"),
    Step("lift", "revolute", "body", "upper", "0 0 0.05", axis="0 1 0", limits=(-2.6, 2.6)),
    Step("elbow", "revolute", "upper", "lower", "0 0 0.18", axis="0 1 0", limits=(-2.9, 2.9)),
    Step("end", "fixed", "lower", "tool0", "0 0 0.2"),
    Step("camera", "fixed", "upper", "cam", "0.05 0 0.1"),
)
SHAPES = {
    "base": '<visual><origin xyz="0 0 0.04"/><geometry><cylinder radius="0.06" length="0.08"/></geometry>'
    "</visual>",
    "body": '<collision><geometry><sphere radius="0.07"/></geometry></collision>',
    "upper": '<visual><origin xyz="0 0 0.12" rpy="0 0 0.3"/><geometry><mesh filename="upper.stl" '
    'scale="0.001 0.001 0.001"/></geometry><material name="red"/></visual>',
    "lower": '<visual><geometry><mesh filename="none.stl"/></geometry></visual>'
    '<collision><origin xyz="0 0 0.1"/><geometry><box size="0.03 0.03 0.2"/></geometry></collision>',
    "cam": '<visual><geometry><box size="0.02 0.02 0.02"/></geometry></visual>'
    "<visual><geometry/></visual><visual><geometry><cone/></geometry></visual>",
}


def arm(tmp_path: Path) -> Robot:
    path = written(tmp_path / "arm.urdf", STEPS)
    text = path.read_text()
    for name, shapes in SHAPES.items():
        text = text.replace(f'<link name="{name}"/>', f'<link name="{name}">{shapes}</link>')
    red = '<material name="red"><color rgba="1 0.5 0 1"/></material></robot>'
    path.write_text(text.replace("</robot>", red))
    upper = block((40.0, 30.0, 220.0))
    (tmp_path / "upper.stl").write_bytes(binary_stl(upper))
    return load_robot(path)


def test_meshes_that_are_missing_for_one_reason_are_told_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    mesh = '<link name="{0}"><visual><geometry><mesh filename="{0}.step"/></geometry></visual></link>'
    text = written(path, STEPS).read_text()
    for link in ("base", "upper", "lower"):
        (tmp_path / f"{link}.step").write_bytes(b"x")
        text = text.replace(f'<link name="{link}"/>', mesh.format(link))
    path.write_text(text)
    told = [one for one in load_robot(path).assumed if one.startswith("passed over")]
    kinds = "is not one of .stl, .obj, .ply, .dae, .glb, .gltf"
    assert told == [f"passed over: base.step {kinds}; the same with 2 more: upper.step, lower.step"]


def test_the_shapes_of_an_arm_move_with_its_links(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    assert [(one.kind, one.link) for one in robot.shapes] == [
        ("cylinder", -1), ("sphere", 0), ("mesh", 1), ("box", 2), ("box", 1),
    ]  # fmt: skip
    assert robot.shapes[2].color == (255, 128, 0)
    told = "; ".join(robot.assumed)
    assert "passed over: none.stl is not found (drawn: what is meant for collisions)" in told
    assert "the same with" not in told
    assert "cam: <visual>: <geometry> is missing or empty" in told and "<cone>: allowed are box" in told
    whole = robot.with_body()
    assert any(text.startswith("the body: ") and "largest gap is" in text for text in whole.assumed)
    assert "armctl check says" not in "; ".join(whole.assumed)
    assert whole.with_body() is whole and whole.collision.capsules == robot.collision.capsules
    rng = np.random.default_rng(4)
    for q in rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (3, 3)):
        links = LinkFrames.at(robot.chain, q[None])
        for shape in robot.shapes:
            placed = links.place(shape.link, solid_of(shape).vertices)[:, :, 0].T
            capsules = [
                Fitted(
                    *links.place(one.link, np.array([one.start, one.end]))[:, :, 0].T, one.radius, one.as_hull
                )
                for one in robot.collision.capsules
                if one.link == shape.link
            ]
            assert outside(placed, capsules) <= 1e-9


def test_a_mesh_that_went_away_leaves_a_bar(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    (tmp_path / "upper.stl").write_bytes(b"broken")
    whole = robot.with_body()
    assert any("passed over: upper.stl" in text for text in whole.assumed)
    assert {one.link for one in whole.collision.capsules} == {-1, 0, 1, 2}
    bare = replace(robot, shapes=tuple(one for one in robot.shapes if one.link == -1))
    assert {one.link for one in bare.collision.capsules} >= {-1, 1, 2}  # bars of the links without a shape


def test_an_arm_folded_onto_itself_is_refused_also_where_it_touches_at_rest(tmp_path: Path) -> None:
    robot = arm(tmp_path).with_body()
    bends = np.linspace(0.0, 2.9, 100)
    folding = np.stack([0 * bends, 0 * bends, bends], axis=1)
    depths = -robot.collision.gaps(LinkFrames.at(robot.chain, folding)).min(axis=0)
    touching, deeper = (folding[int(np.flatnonzero(depths > depth)[0])] for depth in (0.004, 0.015))

    def refusals(one: Robot, goal: FloatArray) -> list[str]:
        found = preflight(one, PointToPoint.plan(one, np.zeros(3), goal))
        return [finding.what for finding in found if finding.kind == "self-collision"]

    assert refusals(robot, touching) and refusals(robot, deeper)
    # with a rest pose where the forearm lies against the shoulder it may lie there, but no deeper
    lying = replace(robot, poses={"home": np.zeros(3), "rest": touching})
    depth = 1000 * -SelfCollision(lying).closed.min()
    assert depth >= 4
    assert any(f"no deeper than at rest ({depth:.0f} mm)" in one.text for one in not_checked(lying))
    assert refusals(lying, touching) == []
    (what,) = refusals(lying, deeper)
    assert what.endswith(" mm at rest)") and ", by convex hulls (" in what


def test_a_clear_pose_is_found_or_none(tmp_path: Path) -> None:
    robot = replace(arm(tmp_path).with_body(), poses={})
    q = clear_pose(robot)
    assert q is not None and stands_clear(robot, q)
    raised = replace(robot, floor_z=0.2)  # of the upper arm, the lower end is below it in every pose
    assert clear_pose(raised) is None


def test_an_arm_is_loaded_without_reading_its_meshes(tmp_path: Path) -> None:
    arm(tmp_path)
    code = (
        "import sys, armctl; r = armctl.load_robot(sys.argv[1]); r.forward([0, 0, 0]); "
        "assert len(r.shapes) == 5; assert not {'trimesh', 'scipy', 'viser'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "arm.urdf")], check=True)
