"""What armctl is measured against does the same work as armctl; how fast is for ``make bench`` to say."""

from __future__ import annotations

import math
import shutil

import numpy as np
import pytest
from benchmarks.__main__ import PAGE, WORKS
from benchmarks.measure import Effort, compare, must_agree
from benchmarks.naive_forward import naive_forward
from benchmarks.naive_sweep import naive_sweep
from benchmarks.paper_loop import PaperLoop, library
from benchmarks.peers.joint_frames import joint_frames
from benchmarks.planar_arm import ABAAS, SCORBOT, UZUNER
from benchmarks.row import Goal, NotMeasuredError, Row
from benchmarks.table import table, with_table
from tests.kinematics.kit import plain_forward, random_q

from armctl import load_robot

ARMS = {"uzuner": UZUNER, "abaas": ABAAS, "scorbot": SCORBOT}
STEP = math.radians(0.1)
TINY = Effort(seconds=0.0, scale=0.001)


@pytest.mark.parametrize("name", ARMS)
def test_the_planar_arms_are_the_robots(name: str) -> None:
    robot, arm = load_robot(name), ARMS[name]
    q = arm.random(np.random.default_rng(80), 200)
    assert np.abs(arm.tip(q) - robot.forward(q)[:, :3, 3]).max() < 1e-12
    assert np.degrees(np.abs(np.vstack([arm.limits, arm.roll_limits]) - robot.limits)).max() < 1e-9
    for one, pitch in zip(q, arm.pitch(q), strict=True):
        assert robot.inverse_kinematics.pitch_and_roll(one) == pytest.approx((pitch, one[4]), abs=1e-7)


def test_the_naive_products_are_right() -> None:
    robot = load_robot("uzuner")
    q = random_q(np.random.default_rng(81), robot.limits, 5)
    for one, T in zip(q, naive_forward(robot.chain, q), strict=True):
        assert np.abs(T - plain_forward(robot.chain, one)).max() < 1e-12


@pytest.mark.parametrize("name", ARMS)
def test_peers_are_built_from_the_same_rows(name: str) -> None:
    robot = load_robot(name)
    frames = joint_frames(robot)
    assert np.abs(frames.zero[-1] - plain_forward(robot.chain, np.zeros(robot.n))).max() < 1e-12
    q = random_q(np.random.default_rng(82), robot.limits)
    T = np.eye(4)
    for step, angle in zip(frames.steps, q, strict=True):
        turn = np.eye(4)
        turn[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
        T = T @ step @ turn
    assert np.abs(T @ frames.tool - plain_forward(robot.chain, q)).max() < 1e-12


def test_the_papers_loop_lists_what_the_naive_sweep_does() -> None:
    loop = PaperLoop(UZUNER, STEP)
    for position in UZUNER.tip(UZUNER.random(np.random.default_rng(84), 20)):
        naive, found = naive_sweep(UZUNER, position, STEP), loop.solutions(position)
        assert len(found) == len(naive)
        assert np.abs(UZUNER.tip(found) - position).max() < 1e-9
        assert loop.least_sum(np.ascontiguousarray(naive)) == pytest.approx(np.abs(naive).sum(axis=1).min())


def test_no_compiler_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    library.cache_clear()
    with pytest.raises(NotMeasuredError, match="no C compiler: cc is not on the path"):
        PaperLoop(UZUNER, STEP)


def test_disagreement_stops_the_benchmark() -> None:
    with pytest.raises(ValueError, match=r"two poses: results differ by 0\.5, allowed is 1e-09"):
        must_agree("two poses", np.zeros(3), np.array([0.0, 0.5, 0.0]), 1e-9)
    with pytest.raises(ValueError, match="do not answer the same targets"):
        must_agree("two poses", np.zeros(2), np.array([0.0, np.nan]), 1e-9)


@pytest.mark.parametrize(
    ("goal", "figure", "met"),
    [
        (Goal("time", 0.8), 0.79, True),
        (Goal("time", 0.8), 0.81, False),
        (Goal("speed", 20), 20.0, True),
        (Goal("speed", 20), 19.9, False),
        (Goal("share", 1.0), 1.0, True),
        (Goal("share", 1.0), 0.9999, False),
    ],
)
def test_a_goal_is_met_or_missed(goal: Goal, figure: float, met: bool) -> None:
    row = Row("work", "peer", ratio=figure, goal=goal)
    assert row.met is met
    assert f"| {goal} | {'yes' if met else '**no**'} |" in table([row])


def test_a_missing_peer_is_a_row_that_says_why() -> None:
    def missing() -> tuple[object, object]:
        raise NotMeasuredError("not installed: No module named 'eaik'")

    row = compare("pose", "EAIK", missing, TINY, goal=Goal("time", 0.8))  # type: ignore[arg-type]
    assert row.met is None
    assert "not installed: No module named 'eaik'" in table([row])


def test_the_page_takes_the_table_whole() -> None:
    marked = with_table(PAGE.read_text(), "| old |")
    again = with_table(marked, "| new |")
    assert "| old |" not in again
    assert again == marked.replace("| old |", "| new |")
    with pytest.raises(ValueError, match="needs a line <!-- make bench: begin -->"):
        with_table("no marks", "| new |")


def test_the_ratio_is_in_the_goals_terms() -> None:
    def sides() -> tuple[object, object]:
        return lambda: sum(range(100_000)), lambda: None

    slow = compare("sum", "loop", sides, TINY, goal=Goal("time", 0.5))  # type: ignore[arg-type]
    fast = compare("sum", "loop", sides, TINY, goal=Goal("speed", 2.0))  # type: ignore[arg-type]
    assert slow.met and fast.met
    assert slow.ratio is not None and fast.ratio is not None
    assert slow.ratio < 1.0 < fast.ratio


@pytest.mark.parametrize("name", WORKS)
def test_every_work_gives_its_rows(name: str) -> None:
    rows = list(WORKS[name].rows(TINY))
    assert rows
    for row in rows:
        assert row.ratio is not None or row.missing.startswith("not ")
        assert row.work in table(rows)
