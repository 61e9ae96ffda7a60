"""The ways to a target, which a person chooses among: none is missing, and what is said of each is true."""

from __future__ import annotations

import asyncio
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from tests.long import LONG
from tests.ui.page_kit import FakePage

from armctl.errors import InputError
from armctl.kinematics import CRITERIA, Target
from armctl.kinematics.angles import rotation_from_rpy
from armctl.motion.choices import way_refused
from armctl.protocol import MoveJoints
from armctl.robot import Robot, load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.inverse.answer import RankedSolutions, solve
from armctl.ui.tabs.inverse.answer_html import _badges, count_html, ways_html
from armctl.ui.tabs.inverse.screen import InverseScreen
from armctl.ui.tabs.inverse.target_form import ANY

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
    for _ in range(4):
        found = of_pose(robot, tuple(dice.uniform(-0.06, 0.06, 3).tolist()))
        if not found.solutions.success:
            continue
        seen += 1
        listed = [way for way in found.choices if way.row is not None]
        assert sum(len(way.rows) for way in listed) == len(found.solutions)
        for q in found.solutions.q:
            assert sum(apart(q, way.q) < 1e-5 for way in listed) == 1
        for way in listed:
            assert np.array_equal(way.q, found.q(way.row or 0))
    assert seen >= 2


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
        speeds = robot.speed_limits
        kinds = [bool(way.refused) for way in found.choices]
        assert kinds == sorted(kinds)
        possible = [way for way in found.choices if not way.refused]
        assert [way.row for way in possible] == sorted(way.row or 0 for way in possible)
        for way in found.choices:
            if way.row is not None:
                assert way.refused == way_refused(robot, home, "cubic", way.q)
            travel = np.degrees((np.abs(way.q - home) * speeds.max() / speeds).sum())
            assert way.costs.travel_deg == pytest.approx(travel, abs=1e-6)
            assert way.costs.rotation_deg == pytest.approx(np.degrees(np.abs(way.q).sum()))
            travels = [one.costs.travel_deg for one in possible]
            least = not way.refused and way.costs.travel_deg <= min(travels) * (1 + 1e-6) < max(travels)
            assert ("least travel" in way.least) is least


@pytest.mark.parametrize("name", ["uzuner", "ur5"])
def test_ways_to_where_the_base_is_turned_look_different(name: str) -> None:
    """Each is drawn in the arm's own plane, not end-on where it points at who looks."""
    robot = load_robot(name)
    home = robot.pose("home")
    looked = [np.array([math.cos(turn), math.sin(turn)]) for turn in np.radians(range(0, 360, 15))]
    for to in looked:
        point = np.array([*(0.22 * to if name == "uzuner" else 0.45 * to), 0.1])
        found = solve(robot, Target.of(point), "least-rotation", home)
        html = ways_html(found, 1, 1)
        for path in re.findall(r"</?svg[^>]*><path class=foot[^>]*/><path d='M([^']*)'", html):
            places = np.array([one.split() for one in path.split("L")], dtype=float)
            assert np.ptp(places[:, 0]) > 10  # [px]


def test_pieces_of_a_free_joint_are_ways_of_their_own() -> None:
    robot = load_robot("scorbot")
    found = solve(robot, Target.of([0.3, 0.1, 0.3]), "least-rotation", robot.pose("home"))
    free = found.solutions.free_joint
    assert free is not None
    below = [way for way in found.choices if way.name.startswith("front elbow-down")]
    assert len(below) == 2
    spans = [np.sort(found.solutions.q[found.order[way.rows - 1], free]) for way in below]
    spans.sort(key=lambda span: float(span[0]))
    assert spans[1][0] - spans[0][-1] > np.radians(1.0)
    assert all(np.diff(span).max() < np.radians(0.03) for span in spans)
    assert sum(len(way.rows) for way in found.choices) == len(found.solutions)


@pytest.mark.parametrize("criterion", CRITERIA if LONG else ("least-rotation", "shortest-time"))
def test_a_posture_to_which_go_goes_is_a_way_that_is_possible(criterion: str) -> None:
    """Whole turns of one posture count as one way: where one of them is possible, it is."""
    home = UR5.pose("home")
    found = of_pose(UR5, (0.010, 0.005, -0.010), criterion)
    assert found.next is not None
    for way in found.choices:
        some = [row for row in way.rows.tolist() if found.ways.possible(found.q(row))][:1]
        assert bool(way.refused) is not bool(some), way.name
    chosen = [way for way in found.choices if apart(way.q, found.next) < 1e-5]
    assert len(chosen) == 1 and not chosen[0].refused
    assert way_refused(UR5, home, "cubic", chosen[0].q) == ""


def test_where_the_orientation_cannot_be_had_there_is_no_way() -> None:
    home = UZUNER.pose("home")
    rotation = rotation_from_rpy(0.5, 0.3, 0.6) @ UZUNER.forward(home)[:3, :3]
    found = solve(UZUNER, Target.of(UZUNER.forward(home)[:3, 3], rotation=rotation), "least-rotation", home)
    assert found.why_not and found.choices == () and ways_html(found, 1, 1) == ""


def test_a_free_roll_makes_no_way_that_cannot_be_chosen() -> None:
    robot = load_robot("scorbot")
    start = robot.pose("home").copy()
    low, high = robot.limits[-1]
    start[-1] = low + 0.8 * (high - low)
    pose = robot.forward(robot.pose("home"))
    pitch = float(np.arcsin(pose[2, 2]))
    for criterion in ("least-rotation", "shortest-time"):
        found = solve(robot, Target.of(pose[:3, 3], pitch), criterion, start)
        for way in found.choices:
            assert way.refused or way.row is not None


def test_the_way_of_any_selected_row_is_the_card_that_is_chosen() -> None:
    found = of_pose(UR5, (-0.05, 0.0, -0.1))
    for row in (1, 17, len(found.solutions)):
        (key,) = re.findall(r"aria-selected=true[^>]* data-key=4\.(\d+)", ways_html(found, row, 4))
        assert apart(found.choices[int(key)].q, found.q(row)) < 1e-5


def test_cards_say_the_reason_and_no_card_can_break_the_page() -> None:
    joints = (replace(UR5.joints[0], title="<b onx='\"'>"), *UR5.joints[1:])
    robot = replace(UR5, joints=joints)
    found = replace(of_pose(UR5, (-0.05, 0.0, -0.1)), robot=robot)
    named = replace(
        found,
        choices=tuple(replace(way, name="<i>", refused=way.refused and "<i>'") for way in found.choices),
    )
    html = ways_html(named, named.instead or 1, 1)
    assert html.count("role=option") == len(found.choices) == 8
    assert html.count("aria-selected=true") == 1
    assert html.count("tabindex=0") == 1
    refused = [way for way in found.choices if way.refused]
    assert html.count("<em>") == len(refused) > 0
    assert f", {8 - len(refused)} possible" in count_html(named)
    assert "<i>" not in html and "title='<" not in html and "&lt;i&gt;" in html
    upright = replace(
        found, robot=replace(UR5, poses={**UR5.poses, "home": np.array([0, -np.pi / 2, 0, -np.pi / 2, 0, 0])})
    )
    assert "nan" not in ways_html(upright, 1, 1)


def test_a_card_that_is_clicked_is_what_is_sent(server: GuardedServer) -> None:
    page = FakePage(server, UR5, UR5.pose("home"))
    InverseScreen(page.session)
    point = UR5.forward(UR5.pose("home"))[:3, 3] * 1000
    point += np.array([-50.0, 0.0, -100.0])
    page.put("Orientation", ANY)
    page.ask(*point.tolist())
    page.press("Solve")
    found = solve(UR5, Target.of(point / 1000), "least-travel", UR5.pose("home"))

    def chosen() -> list[str]:
        return re.findall(r"aria-selected=true[^>]* data-key=([\d.]+)", page.parts["ways"])

    def click(key: str) -> None:
        asyncio.run(page.parts.done("way", key))

    assert chosen() == ["1.0"] and not found.choices[0].refused  # the best that may be gone to
    click("1.1")
    assert chosen() == ["1.1"]
    page.press("Go by the selected one")
    sent = page.sent[-1]
    assert isinstance(sent, MoveJoints)
    assert np.allclose(sent.q, found.choices[1].q, atol=1e-9)
    for nonsense in ("1.99", "0.0", "-1", "x", ""):
        click(nonsense)
    assert chosen() == ["1.1"]
    page.put("Z mm", "nothing")
    with pytest.raises(InputError):
        page.press("Solve")
    assert page.parts["ways"] == ""
    click("1.0")  # it comes too late
    assert page.parts["ways"] == ""
    page.put("Z mm", "9000")
    page.press("Solve")
    assert page.parts["ways"] == ""


def test_a_way_under_the_mouse_is_looked_at_and_never_sent(server: GuardedServer) -> None:
    page = FakePage(server, UZUNER, UZUNER.pose("home"))
    screen = InverseScreen(page.session)
    page.ask(220, -60, 100)
    page.press("Solve")
    found, chosen = screen._answer, page.next.q
    assert found is not None and chosen is not None
    other = next(i for i, way in enumerate(found.choices) if not np.array_equal(way.q, chosen) and way.row)
    key = re.findall(r"data-key=(\S+)", page.parts["ways"])[other]
    page.act(lambda: page.parts.done("look-way", key))
    assert page.ghost.seen and page.ghost.q is not None
    assert np.array_equal(page.ghost.q, found.choices[other].q)
    assert page.next.q is not None and np.array_equal(page.next.q, chosen)
    page.act(lambda: page.parts.done("look-way", ""))
    assert not page.ghost.seen
    page.act(lambda: page.parts.done("look-way", key))
    page.act(lambda: page.parts.done("way", key))
    assert not page.ghost.seen and np.array_equal(page.next.q, found.choices[other].q)


@pytest.mark.parametrize(("arm", "first"), [(UR5, "least-travel"), (UZUNER, "least-rotation")])
def test_an_arm_begins_with_the_criterion_of_its_paper_else_with_the_least_travel(
    server: GuardedServer, arm: Robot, first: str
) -> None:
    page = FakePage(server, arm, arm.pose("home"))
    InverseScreen(page.session)
    assert page.reads("Least energy is") == first


def test_a_way_has_two_badges_at_most_and_says_the_rest_under_the_mouse() -> None:
    least = ("fastest", "least travel", "least load")
    assert _badges(least, frozenset(least)).count("armctl-badge") == 1
    assert ">best in all<" in _badges(least, frozenset(least))
    some = _badges(least, frozenset((*least, "least rotation")))
    assert some.count("armctl-badge") == 2 and ">least load<" not in some
    assert some.count("title='fastest, least travel, least load'") == 2
    assert _badges((), frozenset(least)) == ""
