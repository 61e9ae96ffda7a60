"""How arms are drawn: from their looks, and from their rows where they have none."""

from __future__ import annotations

import asyncio
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import viser
from tests.robot.test_tools import arm_with_tools, urdf_with_tools
from tests.ui.page_kit import snapshot_of
from tests.ui.test_scene import without_look

from armctl.kinematics.frames import LinkFrames
from armctl.robot import CarriedPart, Robot, load_robot, shipped_robots
from armctl.robot.look.rows import paint
from armctl.robot.solids import block, creased, drum, grown, joined
from armctl.ui.guard import GuardedServer
from armctl.ui.scene.arm_model import TOOL, ArmFigure, arm_model, repaint
from armctl.ui.scene.ghost import BodyView, Ghost, body_solids

ARMS = {name: load_robot(name) for name in shipped_robots()}


def nodes(server: GuardedServer) -> dict[str, viser.SceneNodeHandle]:
    return dict(server.scene._handle_from_node_name)


def in_base(server: GuardedServer, name: str) -> np.ndarray:
    """The pose (4, 4) of a node in the scene."""
    T = np.eye(4)
    while name:
        node = nodes(server)[name]
        w, x, y, z = node.wxyz
        R = np.array([
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ])  # fmt: skip
        T = np.block([[R, node.position[:, None]], [np.zeros(3), 1.0]]) @ T
        name = name.rpartition("/")[0]
    return T


def test_a_figure_puts_another_tool_on_where_it_stands(server: GuardedServer, tmp_path: Path) -> None:
    robot = arm_with_tools(tmp_path)
    figure = ArmFigure(server.scene, robot, "/arm", color=(1, 2, 3), opacity=0.5)
    q = robot.pose("rest")
    figure.pose(q, 0.9)
    assert figure.wearing(robot.with_tool("jaws")) is figure
    figure.root.visible = False
    pen = figure.wearing(robot.with_tool("pen"))
    assert pen is not figure and not pen.root.visible
    pen.pose(q)  # its jaws are open as far
    tip = robot.with_tool("pen").forward(q)[:3, 3]
    assert in_base(server, "/arm/tool")[:3, 3] == pytest.approx(tip, abs=1e-6)
    other = ArmFigure(server.scene, robot.with_tool("pen"), "/other")
    other.pose(q, 0.9)
    jaws = [
        name for name in nodes(server) if "/jaw" in name and name.startswith("/arm/") and name[-1].isdigit()
    ]
    assert jaws and all(
        np.allclose(nodes(server)[name].position, nodes(server)[name.replace("/arm/", "/other/")].position)
        for name in jaws
    )


def test_a_tool_is_drawn_on_a_link_that_has_shapes_of_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    robot = load_robot(urdf_with_tools(tmp_path))
    bare, pen = (arm_model(robot.with_tool(name)).meshes for name in ("bare", "pen"))
    assert {mesh.name for mesh in pen} - {mesh.name for mesh in bare} == {"link4/blue"}


@pytest.mark.parametrize("name", ARMS)
def test_every_shipped_arm_is_drawn_by_its_look_and_keeps_its_nodes_while_it_moves(
    server: GuardedServer, name: str
) -> None:
    robot = ARMS[name]
    figure = ArmFigure(server.scene, robot, "/arm")
    before = nodes(server)
    q, opening = robot.limits @ [0.3, 0.7], 0.8
    figure.pose(q, opening)
    assert nodes(server) == before
    links = LinkFrames.at(robot.chain, q[None])
    for piece in robot.pieces:  # every solid of the look is where its mount has it
        R, origin = (part[..., 0] for part in piece.mount.at(links))
        turned, moved = (np.eye(3), np.zeros(3)) if piece.jaw is None else piece.jaw.at(opening)
        wanted = piece.parts[0].solid.vertices @ turned.T @ R.T + R @ moved + origin
        meshes = [mesh for mesh in arm_model(robot).meshes if mesh.color == piece.color]
        off = [np.inf]
        for mesh in meshes:
            T = in_base(server, f"/arm/{mesh.name.rpartition('/')[0]}")
            drawn = mesh.solid.vertices @ T[:3, :3].T + T[:3, 3]
            off.append(np.linalg.norm(drawn[None] - wanted[:4, None], axis=2).min(axis=1).max())
        assert min(off) < 1e-6, piece.part
    tool = robot.forward(q)
    assert np.abs(in_base(server, "/arm/tool") - tool).max() < 1e-9


@pytest.mark.parametrize("name", ["uzuner", "braccio", "mearm"])
def test_tracks_are_the_poses_and_jaws_follow_the_gripper(server: GuardedServer, name: str) -> None:
    robot = ARMS[name]
    figure = ArmFigure(server.scene, robot, "/arm")
    share, opening = np.linspace(0.0, 1.0, 5), np.linspace(1.0, 0.0, 5)
    q = robot.limits[:, 0] + share[:, None] * np.ptp(robot.limits, axis=1)
    tracks = figure.tracks(q, opening)
    assert set(tracks) == {f"/arm/{frame}" for frame in arm_model(robot).frames}
    for i in range(5):
        figure.pose(q[i], opening[i])
        for node, track in tracks.items():
            shown = nodes(server)[node]
            assert np.abs(track[i, :3] - shown.position).max() < 1e-12
            assert abs(abs(track[i, 3:] @ shown.wxyz) - 1) < 1e-12
    jaws = {name: track for name, track in tracks.items() if "/jaw" in name}
    assert len(jaws) >= 2 and all(np.ptp(track, axis=0).max() > 1e-3 for track in jaws.values())


def test_a_ghost_is_one_mesh_a_frame_and_a_little_larger() -> None:
    robot = ARMS["so101"]
    arm, ghost = arm_model(robot), arm_model(robot, 1.08, ghostly=True)
    assert ghost.frames == arm.frames
    names = {mesh.name for mesh in ghost.meshes}
    frames = {mesh.name.rpartition("/")[0] for mesh in arm.meshes} - {"base"}  # that is the arm's own
    assert names == {f"{frame}/solid" for frame in frames}
    q = robot.pose("home")[None]
    moving = replace(arm, meshes=tuple(mesh for mesh in arm.meshes if not mesh.name.startswith("base/")))
    thicker = np.ptp(ghost.bounds(q), axis=0) - np.ptp(moving.bounds(q), axis=0)
    assert (thicker > 1e-4).all() and (thicker < 0.01).all()


def test_a_dark_page_draws_what_is_black_in_its_own_colours_and_in_the_same_frames(
    server: GuardedServer,
) -> None:
    robot: Robot = ARMS["mearm"]
    black = [mesh for mesh in arm_model(robot).meshes if mesh.color == "black"]
    drawn = repaint(server.scene, robot, "/arm", "dark")
    colors = {node.name: tuple(node.color) for node in drawn}
    assert black and all(colors[f"/arm/{mesh.name}"] == paint("black", "dark") for mesh in black)


def test_edges_stay_sharp_and_the_rest_is_smooth() -> None:
    angle = math.radians(38)
    assert len(creased(block((1, 1, 1)), angle).vertices) == 24  # each corner once for each side
    round_one = drum(1.0, 1.0)
    sharp = creased(round_one, angle)
    assert len(sharp.vertices) == len(round_one.vertices) + 72  # both rims are doubled, nothing else
    both = creased(joined([block((1, 1, 1)), drum(1.0, 1.0)]), angle)
    assert len(both.vertices) == 24 + len(sharp.vertices)
    assert np.array_equal(
        sharp.vertices[sharp.faces], round_one.vertices[round_one.faces]
    )  # no face has changed
    assert np.ptp(grown(round_one, 0.1).vertices[:, 2]) > 1.05


@pytest.mark.parametrize(
    "robot",
    [ARMS["so101"].gripping(0.4), ARMS["mearm"].gripping(1.0), without_look(ARMS["uzuner"])],
    ids=["hulls", "rods", "capsules"],
)
def test_the_body_that_is_shown_is_the_one_that_is_checked(server: GuardedServer, robot: Robot) -> None:
    figure, q = ArmFigure(server.scene, robot, "/arm"), robot.limits @ [0.4, 0.6]
    figure.pose(q, 0.4)
    drawn = [
        solid.vertices @ T[:3, :3].T + T[:3, 3]
        for frame, pose, solid in body_solids(robot)
        for T in (in_base(server, f"/arm/{frame}") @ pose,)
    ]
    links, checked = robot.body_frames(q[None]), list[np.ndarray]()
    for capsule in robot.collision.capsules:
        hull = capsule.as_hull
        corners = links.place(capsule.link, hull.corners)[:, :, 0].T
        checked += [corners - hull.margin, corners + hull.margin]
    for end in (np.min, np.max):
        off = end(np.concatenate(drawn), axis=0) - end(np.concatenate(checked), axis=0)
        assert np.abs(off).max() < 0.003 * robot.chain.length


def test_the_carried_part_that_is_drawn_is_the_one_that_is_checked(server: GuardedServer) -> None:
    robot = ARMS["mearm"]
    figure, q, node = ArmFigure(server.scene, robot, "/carrier"), robot.limits @ [0.4, 0.6], f"{TOOL}/part"
    figure.pose(q)
    for edges in ((20.0, 30.0, 40.0), (5.0, 5.0, 5.0)):
        part = CarriedPart(edges)
        figure.carry(part)
        T = in_base(server, f"/carrier/{node}")
        drawn = nodes(server)[f"/carrier/{node}"].vertices @ T[:3, :3].T + T[:3, 3]
        checked = part.hung(robot.chain)
        corners = LinkFrames.at(robot.chain, q[None]).place(checked.link, checked.as_hull.corners)
        assert np.abs(drawn - corners[:, :, 0].T).max() < 1e-7
    figure.carry(None)
    assert f"/carrier/{node}" not in nodes(server)
    figure.root.remove()


def test_a_ghost_carries_what_the_arm_carries_when_it_is_shown(server: GuardedServer) -> None:
    robot = ARMS["mearm"]
    snapshot = snapshot_of(robot)
    states = [replace(snapshot, part_mm=(20.0, 30.0, 40.0)), replace(snapshot, part_mm=None)]
    ghost = Ghost(server.scene, robot, lambda: states[0])
    ghost.show(robot.pose("home"))
    box = nodes(server)[f"/looked_at/{TOOL}/part"]
    solid = next(node for name, node in nodes(server).items() if re.fullmatch("/looked_at/.+/solid", name))
    assert (box.color, box.opacity) == (solid.color, solid.opacity) and box.opacity < 1
    wider = np.ptp(box.vertices, axis=0) - np.array([20, 30, 40]) / 1000
    assert (wider > 1e-4).all() and (wider < 0.01).all()  # beside the arm's own its surfaces would flicker
    states.pop(0)
    ghost.show(robot.pose("rest"))
    assert f"/looked_at/{TOOL}/part" not in nodes(server)


def test_the_body_goes_with_the_gripper_and_out_of_view_again(server: GuardedServer) -> None:
    async def watched() -> None:
        tasks: list[asyncio.Task[None]] = []
        robot = ARMS["mearm"]
        body = BodyView(server.scene, lambda work: tasks.append(asyncio.create_task(work)))
        shapes: list[dict[str, np.ndarray]] = []
        for opening in (0.0, 1.0):
            body.show(robot.gripping(opening))
            await asyncio.gather(*tasks)
            shown = {name: node for name, node in nodes(server).items() if re.search(r"/body\d", name)}
            shapes.append({name: np.ptp(node.vertices, axis=0) for name, node in shown.items()})
        assert len(shapes[0]) > 3 and shapes[0].keys() == shapes[1].keys()
        assert any(np.abs(shapes[1][name] - size).max() > 0.005 for name, size in shapes[0].items())
        body.show(None)
        assert not [name for name in nodes(server) if re.search(r"/body\d", name)]

    asyncio.run(watched())
