"""The 3D view: how the arms are drawn, what they stand on, and where the camera stands."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tests.arms import FIVE
from tests.sticks import of_sticks

from armctl.arrays import FloatArray
from armctl.kinematics import Chain
from armctl.robot import Robot, load_robot
from armctl.robot.look.pieces import Piece
from armctl.robot.parts import Obstacle, Shape
from armctl.robot.solids import Point, Solid, beam, block, drum, tube
from armctl.ui.guard import GuardedServer
from armctl.ui.scene.camera import View, first_view, framed, in_picture, in_view, look_at_arm
from armctl.ui.scene.ghost import Ghost
from armctl.ui.scene.stage import Marks, Stage, floor_size, front, stand_parts
from armctl.ui.widgets.angle_fields import held_at

ROBOTS = {name: load_robot(name) for name in FIVE}


def without_look(robot: Robot) -> Robot:
    """The same arm of a file that does not say how it looks."""
    return replace(robot, look=replace(robot.look, rows=()))


def piece_corners(piece: Piece) -> list[FloatArray]:
    return [corners for part in piece.parts for corners in part.corners]


@pytest.mark.parametrize("name", ROBOTS)
def test_the_stand_and_the_reach_bound_the_arm(name: str) -> None:
    robot = without_look(ROBOTS[name])
    assert stand_parts(ROBOTS[name]) == {}
    q = np.random.default_rng(1).uniform(robot.limits[:, 0], robot.limits[:, 1], (5000, robot.n))
    farthest = np.linalg.norm(robot.forward(q)[:, :3, 3], axis=1).max()
    assert 0.8 * robot.chain.length < farthest <= robot.chain.length + 1e-12
    base = [
        corners for piece in robot.pieces if max(piece.mount.links) < 0 for corners in piece_corners(piece)
    ]
    stand = [solid.vertices for solid in stand_parts(robot).values()]
    vertices = np.concatenate([*base, *stand])
    assert vertices[:, 2].min() == pytest.approx(robot.floor_z, abs=1e-9)
    assert vertices[:, 2].max() >= 0.0


def test_the_column_stands_below_or_behind_the_base() -> None:
    robot, uzuner = without_look(ROBOTS["humanoid"]), without_look(ROBOTS["uzuner"])
    column = stand_parts(robot)["column"].vertices[:, :2]
    hanging = robot.frames(robot.pose("rest"))[:, :2, 3]
    gap = np.linalg.norm(column[:, None] - hanging[None], axis=2).min()
    assert gap > robot.look.width * robot.chain.length
    assert (column @ front(robot)).max() < 0  # behind, as seen from the tool at home
    shapes = (Shape("box", (0.1, 0.1, 0.1), np.eye(4)),)
    meshed = replace(uzuner, shapes=shapes)  # what its file shows says nothing of what it stands on
    below = stand_parts(replace(meshed, floor_z=-0.05))["column"].vertices
    assert below[:, :2].mean(axis=0) == pytest.approx([0, 0], abs=1e-3)
    assert set(stand_parts(meshed)) == {"plate"}
    assert front(ROBOTS["uzuner"]) == pytest.approx([1, 0], abs=0.02)
    assert front(ROBOTS["abaas"]) == pytest.approx([0, -1])
    above = replace(ROBOTS["mico"], poses={"home": np.radians([0.0, -90, 0, 0])})
    assert front(above) == pytest.approx([1, 0])  # straight up is to no side


@pytest.mark.parametrize("bar", [tube, beam])
@pytest.mark.parametrize("end", [(0.0, 0.0, 0.3), (0.3, 0.0, 0.0), (0.0, 0.0, -0.3), (-0.3, 0.0, 0.0)])
def test_a_bar_joins_its_ends_and_is_as_wide_as_asked(
    bar: Callable[[Point, Point, float], Solid], end: Point
) -> None:
    vertices = bar((0.0, 0.0, 0.0), end, 0.04).vertices
    along = vertices @ np.array(end) / 0.3
    assert (along.min(), along.max()) == (pytest.approx(-0.02), pytest.approx(0.32))
    across = np.delete(vertices, np.flatnonzero(end), axis=1)
    assert np.ptp(across, axis=0) == pytest.approx([0.04, 0.04], abs=1e-3)


def test_only_a_joint_that_cannot_turn_is_held() -> None:
    joint = ROBOTS["humanoid"].joints[4]
    assert held_at(joint) == "held at 0°"
    assert held_at(replace(joint, lower=math.radians(-12.5), upper=math.radians(-12.5))) == "held at -12.5°"
    assert held_at(replace(joint, upper=1e-3)) is None
    assert [held_at(one) for one in ROBOTS["mico"].joints] == [None] * 4


@pytest.mark.parametrize(
    ("solid", "volume"),
    [
        (block((0.1, 0.2, 0.3), (1, 2, 3)), 0.006),
        (beam((0, 0.1, 0.2), (0, 0.1, 0.5), 0.05), 0.05**2 * 0.35),
        (drum(0.1, 0.2), np.pi * 0.1**2 * 0.2),
        (tube((0, 0.1, 0.2), (0.3, 0.1, 0.2), 0.05), np.pi * 0.025**2 * (0.3 + 0.1 / 3)),
    ],
)
def test_meshes_are_closed_and_face_outwards(solid: Solid, volume: float) -> None:
    edges = solid.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).tolist()
    there, back = {(a, b) for a, b in edges}, {(b, a) for a, b in edges}
    assert len(there) == len(edges) and there == back
    corners = solid.vertices[solid.faces]
    enclosed = np.linalg.det(corners).sum() / 6
    assert 0.95 * volume < enclosed <= volume * (1 + 1e-9)


FOV = math.radians(75)
AWAY = np.array([0.6, 0.7, 0.3])


def scaled(robot: Robot, factor: float) -> Robot:
    """The same arm, so many times as large."""
    rows = tuple(replace(row, a_m=factor * row.a_m, d_m=factor * row.d_m) for row in robot.chain.rows)
    return replace(
        of_sticks(robot), chain=Chain.from_dh(rows, robot.chain.convention), floor_z=factor * robot.floor_z
    )


def on_picture(points: FloatArray, position: FloatArray, centre: FloatArray, aspect: float) -> FloatArray:
    """(k, 2) where points are on a picture whose edges are at -1 and 1."""
    back = (position - centre) / np.linalg.norm(position - centre)
    right = np.cross([0, 0, 1], back) / np.linalg.norm(np.cross([0, 0, 1], back))
    axes = np.stack([right, np.cross(back, right), back])
    x, y, z = ((points - position) @ axes.T).T
    assert (z < 0).all()  # in front of the camera
    return np.stack([x / aspect, y], axis=1) / (-z * math.tan(FOV / 2))[:, None]


@pytest.mark.parametrize("factor", [0.2, 1.0, 6.0])
@pytest.mark.parametrize("name", FIVE)
def test_an_arm_of_any_size_fills_the_picture_and_does_not_leave_it_or_the_floor(
    name: str, factor: float
) -> None:
    robot = scaled(load_robot(name), factor)
    points = in_view(robot)
    for aspect in (0.5, 0.73, 1.13, 2.4):
        at = on_picture(points, *framed(points, AWAY, FOV, aspect, 0.8), aspect)
        assert np.abs(at).max() == pytest.approx(0.8)
    assert 0.5 * floor_size(robot) >= robot.chain.length
    assert floor_size(robot) <= 1.6 or 0.5 * floor_size(robot) < robot.chain.length + 0.25


def test_each_view_looks_from_its_side_and_the_named_frames_follow_the_arm(server: GuardedServer) -> None:
    robot = ROBOTS["uzuner"]
    ahead = np.append(front(robot), 0.0)
    for view, along in (("Front", ahead), ("Side", np.cross(ahead, [0, 0, 1])), ("Top", np.array([0, 0, 1]))):
        position, centre = first_view(robot, in_view(robot), FOV, 1.2, view)
        away = (position - centre) / np.linalg.norm(position - centre)
        assert away @ along > 0.98
    marks, q = Marks(server.scene, robot), robot.pose("home")
    nodes = server.scene._handle_from_node_name
    marks.show(q, names=False, frames=False)
    assert not [name for name in nodes if name.startswith("/marks")]
    for q in (robot.pose("home"), robot.pose("rest")):
        marks.show(q, names=True, frames=True)
        assert [nodes[f"/marks/joint{i}"].text for i in range(5)] == [joint.title for joint in robot.joints]
        assert nodes["/marks/tool"].position == pytest.approx(robot.forward(q)[:3, 3])
        axes = robot.frames(q)[:, :3, 3]
        places = np.array([nodes[f"/marks/joint{i}"].position for i in range(5)])
        assert np.linalg.norm(places[:, None] - axes[None], axis=2).min(axis=1).max() < 1e-9
    marks.show(q, names=False, frames=True)
    assert "/marks/joint0" not in nodes and "/marks/tool" in nodes


def test_an_arm_beside_one_that_is_much_larger_is_seen_alone() -> None:
    camera = SimpleNamespace(image_width=800, image_height=800, fov=FOV)
    client = cast(Any, SimpleNamespace(camera=camera))
    small = ROBOTS["uzuner"]
    look_at_arm(client, scaled(small, 0.8), beside=(small, 1.0))
    both = np.linalg.norm(camera.position - camera.look_at)
    look_at_arm(client, scaled(small, 3.0), beside=(small, 1.0))
    assert np.linalg.norm(camera.position - camera.look_at) < 0.8 * both
    assert camera.look_at[1] == pytest.approx(1.0, abs=0.2)


def test_a_single_point_is_looked_at_from_where_it_is() -> None:
    for place in framed(np.ones((1, 3)), AWAY, FOV, 1.0, 0.8):
        assert place == pytest.approx(np.ones(3))


def test_a_ghost_is_seen_while_its_tab_is_open(server: GuardedServer) -> None:
    robot = load_robot("uzuner")
    ghost = Ghost(server.scene, robot)
    ghost.see("Forward")
    ghost.show(robot.pose("home"), words="Inverse")  # an answer that came after its tab was left
    assert ghost._figure is not None
    root = ghost._figure.root
    seen = []
    for tab in ("Forward", "Inverse", "Main", None):
        ghost.see(tab)
        seen.append(root.visible)
    assert seen == [False, True, False, True]
    ghost.hide()
    ghost.see("Inverse")
    assert not root.visible
    ghost.see("Main")
    ghost.show(robot.pose("home"), owner=ghost)  # it belongs to no tab
    assert root.visible


def test_on_a_phone_the_arm_is_above_the_sheet(server: GuardedServer) -> None:
    robot, fov = load_robot("uzuner"), np.radians(75)
    camera = SimpleNamespace(image_width=390, image_height=844, fov=fov)
    look_at_arm(cast(Any, SimpleNamespace(camera=camera)), robot, sheet=True)
    away = camera.position - camera.look_at
    distance = np.linalg.norm(away)
    right = np.cross([0, 0, 1], away) / np.linalg.norm(np.cross([0, 0, 1], away))
    axes = np.stack([right, np.cross(away, right) / distance, away / distance])
    x, y, near = axes @ (robot.frames(robot.pose("home"))[:, :3, 3] - camera.look_at).T
    height = y / ((distance - near) * np.tan(fov / 2))  # -1 … 1, from the lower edge to the upper one
    assert (height > 2 * 0.6 - 1).all()
    assert (height < 1).all()
    assert (np.abs(x) / ((distance - near) * np.tan(fov / 2)) < 390 / 844).all()


def test_obstacles_stand_where_the_file_says(server: GuardedServer) -> None:
    wall = Obstacle("the wall", np.array([0.1, -0.2, 0.0]), np.array([0.3, 0.2, 0.5]))
    stage = Stage(server.scene, replace(ROBOTS["uzuner"], obstacles=(wall,)))
    handles = server.scene._handle_from_node_name
    box = cast(Any, handles["/stand/obstacle0"])
    assert tuple(box.dimensions) == pytest.approx((0.2, 0.4, 0.5))
    assert tuple(box.position) == pytest.approx((0.2, 0.0, 0.25))
    assert cast(Any, handles["/stand/obstacle0/title"]).text == "the wall"
    stage.remove()
    assert not [name for name in handles if "obstacle" in name]


def test_what_is_outside_the_picture_is_known_and_seen_once_the_view_is_reset() -> None:
    camera = SimpleNamespace(image_width=552, image_height=692, fov=FOV)
    client, robot = cast(Any, SimpleNamespace(camera=camera)), load_robot("uzuner")
    there = robot.inverse([0.22, -0.196, 0.085]).best("least-travel", robot.pose("home"))
    look_at_arm(client, robot)
    assert in_picture(cast(Any, camera), robot, robot.pose("home"), sheet=False)
    camera.position, camera.look_at = 0.6 * camera.position + 0.4 * camera.look_at, camera.look_at
    assert not in_picture(cast(Any, camera), robot, there, sheet=False)
    for sheet in (False, True):
        look_at_arm(client, robot, shown=[there], sheet=sheet)
        assert in_picture(cast(Any, camera), robot, there, sheet=sheet)


def test_a_view_takes_in_what_rests_outside_of_it_until_a_person_has_turned_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("armctl.ui.scene.camera._FOLLOWS_S", 0.0)
    robot, begun = load_robot("uzuner"), list[Any]()
    camera = SimpleNamespace(image_width=552, image_height=692, fov=FOV)
    client = cast(Any, SimpleNamespace(camera=camera, atomic=nullcontext))
    look_at_arm(client, robot)
    arrows = SimpleNamespace(visible=False)
    home = robot.pose("home")
    other, out = (robot.inverse([0.25, y, 0.1]).best("least-travel", home) for y in (-0.1, 0.1))
    camera.position, camera.look_at = 0.6 * camera.position + 0.4 * camera.look_at, camera.look_at
    page = cast(Any, SimpleNamespace(
        client=client, closed=False, on_phone=False, other_arrows=[arrows], on_stage=[out], spawn=begun.append
    ))  # fmt: skip
    view = View(page, robot)
    placed = camera.position.copy()
    assert not in_picture(cast(Any, camera), robot, out, sheet=False)
    assert not view.misses(other) and not view.misses(out)
    assert begun == []  # it does not rest yet
    for view.held, arrows.visible in ((True, False), (False, True)):  # nothing moves under a hand
        assert view.misses(out)
    view.held = arrows.visible = False
    assert not view.misses(out)
    asyncio.run(begun.pop())
    assert in_picture(cast(Any, camera), robot, out, sheet=False)
    away, before = camera.position - camera.look_at, placed - camera.look_at
    assert np.linalg.norm(away) > np.linalg.norm(before)  # from the same side, from farther away
    assert not view.misses(out) and not begun
    camera.position = 0.7 * camera.position + 0.3 * camera.look_at  # a person has come nearer
    assert [view.misses(out), view.misses(out), begun] == [True, True, []]
    view.look()
    assert not view.misses(out) and not begun
