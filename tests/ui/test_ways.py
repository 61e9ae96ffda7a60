"""The ways to a target, which a person chooses among: none is missing, and what is said of each is true."""

from __future__ import annotations

import re

import numpy as np
import pytest
from tests.ui.page_kit import FakePage

from armctl.kinematics import Target
from armctl.motion.choices import way_refused
from armctl.protocol import MoveJoints
from armctl.robot import Robot, load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.inverse.answer import RankedSolutions, solve
from armctl.ui.tabs.inverse.answer_html import ways_html
from armctl.ui.tabs.inverse.screen import InverseScreen

UR5, UZUNER = load_robot("ur5"), load_robot("uzuner")


def of_pose(
    robot: Robot, shift_m: tuple[float, float, float], criterion: str = "least-rotation"
) -> RankedSolutions:
    home = robot.pose("home")
    pose = robot.forward(home)
    target = Target.of(pose[:3, 3] + shift_m, rotation=pose[:3, :3])
    return solve(robot, target, criterion, home)


def apart(a: np.ndarray, b: np.ndarray) -> float:
    """How far two configurations are from each other, whole turns aside."""
    return float(np.abs(np.exp(1j * a) - np.exp(1j * b)).max())


@pytest.mark.parametrize("name", ["ur5", "ar4", "parol6"])
def test_every_row_is_one_of_the_ways_but_for_whole_turns(name: str) -> None:
    robot, dice = load_robot(name), np.random.default_rng(3)
    seen = 0
    for _ in range(8):
        found = of_pose(robot, tuple(dice.uniform(-0.06, 0.06, 3).tolist()))
        if not found.solutions.success:
            continue
        seen += 1
        listed = [way for way in found.choices if way.row is not None]
        assert sum(1 + way.turns for way in listed) == len(found.solutions)
        for q in found.solutions.q:
            assert sum(apart(q, way.q) < 1e-5 for way in listed) == 1
        for way in listed:
            assert np.array_equal(way.q, found.q(way.row or 0))
    assert seen >= 3


@pytest.mark.parametrize(
    ("name", "criterion"), [("ur5", "least-travel"), ("uzuner", "least-rotation"), ("so101", "shortest-time")]
)
def test_verdicts_order_and_what_is_the_least_are_true(name: str, criterion: str) -> None:
    robot, dice = load_robot(name), np.random.default_rng(7)
    home = robot.pose("home")
    point = robot.forward(home)[:3, 3]
    for whole in (False, robot.n == 6):
        shift = dice.uniform(-0.05, 0.05, 3)
        found = (
            of_pose(robot, tuple(shift.tolist()), criterion)
            if whole
            else solve(robot, Target.of(point + shift), criterion, home)
        )
        assert found.choices
        kinds = [bool(way.refused) for way in found.choices]
        assert kinds == sorted(kinds)
        possible = [way for way in found.choices if not way.refused]
        assert [way.row for way in possible] == sorted(way.row or 0 for way in possible)
        for way in found.choices:
            if way.row is not None:
                assert way.refused == way_refused(robot, home, "cubic", way.q)
            seconds = np.abs(way.q - home) / robot.speed_limits
            assert way.costs.travel_s == pytest.approx(float(seconds.sum()), abs=1e-6)
            assert way.costs.rotation_deg == pytest.approx(np.degrees(np.abs(way.q).sum()))
            others = [one.costs.travel_s for one in possible]
            least = not way.refused and len(possible) > 1 and way.costs.travel_s <= min(others) * (1 + 1e-6)
            assert ("least-travel" in way.least) is least


def test_pieces_of_a_free_joint_are_ways_of_their_own() -> None:
    found = solve(UZUNER, Target.of([0.16, 0.0, 0.22]), "least-rotation", UZUNER.pose("home"))
    free = found.solutions.free_joint
    assert free is not None
    for way in found.choices:
        assert way.row is not None
        name = way.name.partition(",")[0]
        rows = found.solutions.q[found.solutions.branch == name]
        assert np.abs(rows - way.q).max(axis=1).min() == 0.0
    names = {way.name.partition(",")[0] for way in found.choices}
    assert names == set(np.unique(found.solutions.branch).tolist())


def test_cards_say_the_reason_and_no_card_can_break_the_page() -> None:
    found = of_pose(UR5, (-0.05, 0.0, -0.1))
    html = ways_html(found, found.instead or 1)
    assert html.count("role=option") == len(found.choices) == 8
    assert html.count("aria-selected=true") == 1
    assert html.count("tabindex=0") == 1
    refused = [way for way in found.choices if way.refused]
    assert html.count("<em>") == len(refused) > 0
    assert f"; {8 - len(refused)} may be gone to" in html
    assert not re.search(r"<(?!/?(div|b|p|em|span|svg|path|circle)\b)", html)


def test_a_card_that_is_clicked_is_what_is_sent(server: GuardedServer) -> None:
    page = FakePage(server, UR5, UR5.pose("home"))
    InverseScreen(page.session)
    point = UR5.forward(UR5.pose("home"))[:3, 3] * 1000
    point += np.array([-50.0, 0.0, -100.0])
    page.ask(*point.tolist())
    page.press("Solve")
    found = solve(UR5, Target.of(point / 1000), "least-rotation", UR5.pose("home"))
    chosen = re.findall(r"aria-selected=true[^>]* data-key=(\d+)", page.parts["ways"])
    assert chosen == ["0"] and not found.choices[0].refused  # the best that may be gone to
    page.parts.done("way", "1")
    assert re.findall(r"aria-selected=true[^>]* data-key=(\d+)", page.parts["ways"]) == ["1"]
    page.press("Go by the selected one")
    sent = page.sent[-1]
    assert isinstance(sent, MoveJoints)
    assert np.allclose(sent.q, found.choices[1].q, atol=1e-9)
    for nonsense in ("99", "-1", "x", ""):
        page.parts.done("way", nonsense)
    assert re.findall(r"aria-selected=true[^>]* data-key=(\d+)", page.parts["ways"]) == ["1"]
    page.put("Z mm", "9000")
    page.press("Solve")
    assert page.parts["ways"] == ""
