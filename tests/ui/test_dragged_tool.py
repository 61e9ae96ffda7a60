"""Dragging the tool writes the next pose."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.ui.page_kit import FakePage

from armctl.errors import InputError
from armctl.facts import State
from armctl.robot import Robot, load_robot
from armctl.ui.dragged_tool import DraggedTool, dragged_near, dragged_to
from armctl.ui.guard import GuardedServer
from armctl.ui.next_pose import PoseWriter

UZUNER = load_robot("uzuner")
HOME = UZUNER.pose("home")


@pytest.mark.parametrize("name", ["uzuner", "scorbot", "ur5", "so101", "ar4"])
def test_the_arm_follows_a_dragged_tool_without_jumping(name: str) -> None:
    """A line of 4 mm steps about home: the tool is where it is dragged, and no joint jumps."""
    robot = load_robot(name)
    q = robot.pose("home")
    start = robot.forward(q)
    for k in range(1, 9):
        point = start[:3, 3] + 0.004 * k * np.array([-0.5, 0.8, -0.3])
        found = dragged_to(robot, point, q)
        assert found is not None
        assert robot.forward(found)[:3, 3] == pytest.approx(point, abs=1e-6)
        assert np.abs(found - q).max() < 0.2
        if robot.orients_tool:
            assert robot.forward(found)[:3, :3] == pytest.approx(start[:3, :3], abs=1e-6)
        q = found


def test_what_is_out_of_reach_is_none_and_an_orientation_that_cannot_be_kept_is_given_up() -> None:
    assert dragged_to(UZUNER, np.array([2.0, 0.0, 0.1]), HOME) is None
    ur5 = load_robot("ur5")
    q = ur5.pose("home")
    far = np.array([-0.90, -0.1, 0.3])  # the wrist would be beyond the reach as the tool is turned
    kept = ur5.inverse(far, rotation=ur5.forward(q)[:3, :3])
    assert ur5.off_rotation(kept, kept.best("least-travel", q)) is not None
    found = dragged_to(ur5, far, q)
    assert found is not None and ur5.forward(found)[:3, 3] == pytest.approx(far, abs=1e-5)


@pytest.mark.parametrize(
    ("name", "degrees"),
    [
        ("uzuner", (0, 60, 0, 0, 0)),
        ("scorbot", (20, -60, 0, 0, 0)),
        ("so101", (-25, 15, -70, -6, -133)),
        ("ar4", (-119, 19, -87, -160, 8, -70)),
    ],
)
def test_a_stretched_arm_follows_a_tool_that_is_dragged_up_as_near_as_it_comes(
    name: str, degrees: tuple[float, ...]
) -> None:
    """Every way but back is out of its reach."""
    robot = load_robot(name)
    q = robot.read(np.array(degrees))
    point, began = robot.forward(q)[:3, 3], q
    out = robot.forward(began)[:3, 3] / np.linalg.norm(robot.forward(began)[:3, 3])
    for k in range(1, 9):
        beyond = point + k * (0.008 * out + np.array([0.0, 0.0, 0.008]))
        found, missed = dragged_near(robot, beyond, q)
        assert found is not None
        robot.check_limits(found)
        away = float(np.linalg.norm(robot.forward(found)[:3, 3] - beyond))
        assert away < (1e-5 if missed is None else missed.nearest_away_m + 2e-3)
        assert np.abs(found - q).max() < 0.5  # no joint jumps
        q = found
    assert np.abs(q - began).max() > 0.02


class Dragging:
    def __init__(self, server: GuardedServer) -> None:
        self.page = FakePage(server, UZUNER, HOME)
        self.page.attempt = self._attempt  # type: ignore[attr-defined]
        self.notices: list[str] = []
        self.page.notify = lambda title, *_: self.notices.append(title)  # type: ignore[attr-defined]
        self.tool = DraggedTool(self.page.session)

    async def _attempt(self, action: Any) -> None:
        await action()

    def drag(self, point: np.ndarray, phase: str = "update", client: object = object()) -> None:
        arrows = self.tool._arrows
        arrows.position = point
        (callback,) = arrows._impl_aux.update_cb
        event = SimpleNamespace(client=client, phase=phase)

        async def done() -> None:
            await callback(event)
            while self.page._beside:
                await self.page._beside.pop(0)

        asyncio.run(done())


def test_it_writes_the_next_pose_and_the_arrows_stand_at_its_tool(server: GuardedServer) -> None:
    bench = Dragging(server)
    page, tip = bench.page, UZUNER.forward(HOME)[:3, 3]
    page.refresh(bench.tool)
    assert bench.tool._arrows.position == pytest.approx(tip, abs=1e-6) and bench.tool._arrows.visible
    to = tip + np.array([0.0, 0.03, -0.02])
    bench.drag(to)
    assert page.next.q is not None and UZUNER.forward(page.next.q)[:3, 3] == pytest.approx(to, abs=1e-6)
    assert page.next.writer is not None and page.next.writer.words == "dragged tool"
    beyond = np.array([2.0, 0.1, 0.2])
    nearest = UZUNER.inverse(beyond).nearest_m
    assert nearest is not None
    bench.drag(beyond)  # held beyond the reach: that is said at once, and once
    bench.drag(beyond, "end")
    assert bench.notices == ["Out of reach"] and page.next.q is not None
    shown = UZUNER.forward(page.next.q)[:3, 3]
    assert np.linalg.norm(shown - beyond) < np.linalg.norm(nearest - beyond) + 2e-3
    away = 1000 * np.linalg.norm(shown - beyond)
    assert f"dragged tool, {away:.1f} mm out of reach" in page.parts["next"]
    assert bench.tool._arrows.position == pytest.approx(shown, abs=1e-5)  # and they come back to it
    bench.drag(beyond, "end")
    assert bench.notices == ["Out of reach"] * 2  # another drag
    bench.drag(to)
    assert "dragged tool ·" in page.parts["next"]
    kept = page.next.q
    bench.drag(np.array([np.nan, 0.0, 0.0]))  # no page of armctl's
    assert np.array_equal(page.next.q, kept)
    bench.tool._point, bench.tool._held, bench.tool._dragged = (
        to + 0.01,
        False,
        True,
    )  # let go, not solved yet
    page.refresh(bench.tool)
    assert np.isnan(bench.tool._arrows.position[0])  # they wait for it, and are not put back
    bench.drag(to + np.array([0.0, 0.0, 0.01]), "end")
    assert page.next.q is not None
    assert UZUNER.forward(page.next.q)[:3, 3] == pytest.approx(to + [0, 0, 0.01], abs=1e-6)  # noqa: RUF005
    page.go()
    page.snapshot.state, page.snapshot.busy = State.MOVING, True
    page.refresh(bench.tool)
    assert not bench.tool._arrows.visible


def test_a_click_that_drags_nothing_writes_nothing(server: GuardedServer) -> None:
    bench = Dragging(server)
    page, other = bench.page, PoseWriter(bench.page.session, "somebody")
    there = HOME + np.radians([20.0, 0, 0, 0, 0])
    page.act(lambda: other.show(there))
    page.refresh(bench.tool)
    tip = UZUNER.forward(there)[:3, 3]
    for phase in ("start", "update", "end"):
        bench.drag(tip, phase)
    assert page.next.writer is other
    for point, phase in ((tip, "start"), (tip + np.array([0.0, 0.0, 0.02]), "update"), (tip, "end")):
        bench.drag(point, phase)  # away and back
    assert page.next.writer is not None and page.next.writer.words == "dragged tool"
    for phase in ("start", "end"):
        bench.drag(tip + np.array([0.0, 0.0, 0.01]), phase)  # this does
    assert page.next.q is not None
    assert UZUNER.forward(page.next.q)[:3, 3] == pytest.approx(tip + np.array([0.0, 0.0, 0.01]), abs=1e-6)


def test_the_arrows_come_back_from_where_no_tool_can_be(server: GuardedServer) -> None:
    bench = Dragging(server)
    with pytest.raises(InputError, match="farther than 1000 m"):
        bench.drag(np.array([2000.0, 0.0, 0.0]), "end")
    assert bench.page.next.q is None
    assert bench.tool._arrows.position == pytest.approx(UZUNER.forward(HOME)[:3, 3], abs=1e-5)


@pytest.mark.parametrize("name", ["uzuner", "ur5"])
def test_a_point_out_of_reach_is_solved_once_in_each_orientation(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, solved = load_robot(name), list[object]()
    inverse = Robot.inverse

    def counted(self: Robot, point: Any, *given: Any, **named: Any) -> Any:
        solved.append((tuple(point), named.get("rotation") is None))
        return inverse(self, point, *given, **named)

    monkeypatch.setattr(Robot, "inverse", counted)
    _, missed = dragged_near(robot, np.array([2.0, 0.1, 0.2]), robot.pose("home"), done=False)
    assert missed is not None and len(solved) == len(set(solved))


def test_it_overwrites_no_pose_that_was_written_after_it_was_let_go(server: GuardedServer) -> None:
    bench = Dragging(server)
    page, other = bench.page, PoseWriter(bench.page.session, "somebody")
    tip, there = UZUNER.forward(HOME)[:3, 3], HOME + np.radians([20.0, 0, 0, 0, 0])

    async def attempt(action: Any) -> None:
        other.show(there)
        await action()

    page.attempt = attempt  # type: ignore[attr-defined]
    bench.drag(tip + np.array([0.0, 0.03, -0.02]), "end")
    assert page.next.q is not None and np.array_equal(page.next.q, there)
    assert bench.tool._arrows.position == pytest.approx(UZUNER.forward(there)[:3, 3], abs=1e-5)
