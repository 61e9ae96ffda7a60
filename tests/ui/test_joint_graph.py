"""What the joint graph keeps, draws, says and writes."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from tests.ui.page_kit import snapshot_of

from armctl.facts import Quantities
from armctl.hardware import BoardIdentity, Source
from armctl.protocol import Snapshot
from armctl.robot import load_robot
from armctl.ui.tabs.simulation.joint_graph import (
    LONGEST_S,
    JointHistory,
    JointRows,
    angle_curves,
    error_html,
    legend_html,
    load_curves,
    missing_html,
    rows_csv,
)

ROBOT = load_robot("so101")
TITLES = [joint.title for joint in ROBOT.joints]
EMPTY = snapshot_of(ROBOT)
PAN, LIFT = 0, 1


def moment(at: float, degrees: float = 0.0, load: float | None = 0.1) -> Snapshot:
    """All joints are measured at an angle."""
    quantities = {title: Quantities(load=load) for title in TITLES}
    board = BoardIdentity("servo bus", "sim")
    return replace(
        EMPTY, stamp=at, q=np.full(ROBOT.n, np.radians(degrees)), quantities=quantities,
        source=Source.MEASURED, board=board,
    )  # fmt: skip


def history(seconds: float, every: float = 0.1) -> JointHistory:
    """A ramp of 1 °/s that is measured 0.5° behind."""
    kept = JointHistory(TITLES)
    for k in range(round(seconds / every) + 1):
        at = k * every
        kept.add(moment(100.0 + at, at - 0.5), np.full(ROBOT.n, np.radians(at)))
    return kept


def test_five_minutes_are_kept_and_a_span_of_them_is_given_oldest_first() -> None:
    kept = history(400.0)
    assert np.ptp(kept.since(LONGEST_S).time) == pytest.approx(LONGEST_S, abs=0.2)
    rows = kept.since(20.0)
    assert np.ptp(rows.time) == pytest.approx(20.0, abs=0.2) and (np.diff(rows.time) > 0).all()
    assert rows.time[-1] == pytest.approx(400.0)
    assert rows.commanded[-1] == pytest.approx([400.0] * ROBOT.n)
    assert rows.board[-1] == pytest.approx([399.5] * ROBOT.n)
    assert rows.load[-1] == pytest.approx([10.0] * ROBOT.n)


def test_nothing_is_known_before_the_first_moment() -> None:
    rows = JointHistory(TITLES).since(20.0)
    drawn = rows.drawn()
    assert drawn.time == [0.0] and np.isnan(drawn.commanded).all()
    assert "not known now" in error_html(TITLES, rows, [PAN], Source.MEASURED)


def test_a_page_gets_a_few_hundred_points_of_five_minutes_with_both_ends() -> None:
    rows = history(300.0).since(LONGEST_S)
    drawn = rows.drawn()
    assert len(drawn.time) <= 250 < len(rows.time)
    assert drawn.time[[0, -1]] == pytest.approx([-LONGEST_S, 0.0], abs=0.2)
    assert (drawn.commanded[[0, -1]] == rows.commanded[[0, -1]]).all()


def test_what_the_board_did_not_tell_is_left_open_in_graph_and_file() -> None:
    kept = JointHistory(TITLES)
    kept.add(
        replace(moment(1.0), q=np.full(ROBOT.n, np.nan), quantities={}), np.full(ROBOT.n, np.radians(7.0))
    )
    rows = kept.since(20.0)
    assert np.isnan([rows.drawn().board[0, PAN], rows.drawn().load[0, PAN]]).all()
    (line,) = rows_csv(TITLES, rows, [PAN]).splitlines()[1:]
    assert line == "0,7,,"


def test_the_following_error_is_the_measured_against_the_commanded_angle() -> None:
    rows = history(20.0).since(20.0)
    told = error_html(TITLES, rows, [LIFT], Source.MEASURED)
    assert "error now: <b>−0.50°</b>" in told and "Largest of these 20 s: <b>0.50°</b>" in told
    rows.board[-1, LIFT] -= 2.0
    told = error_html(TITLES, rows, [PAN, LIFT], Source.MEASURED)
    assert "now: <b>−2.50°</b> (Shoulder lift)" in told and "s: <b>2.50°</b> (Shoulder lift)" in told
    assert "nothing is measured" in error_html(TITLES, rows, [PAN], Source.TRANSMITTED)


def test_one_joint_is_drawn_commanded_and_measured_and_its_load_between_its_limits() -> None:
    rows = history(5.0).since(20.0)
    names = [line.name for line in angle_curves(ROBOT, rows, [LIFT], Source.MEASURED).lines]
    assert names == ["Shoulder lift commanded", "Shoulder lift measured"]
    loads = load_curves(ROBOT, rows, [LIFT], [None, 0.8, None, None, None])
    assert loads.lines[0].y == pytest.approx(10.0)
    assert [(one.value, one.is_upper) for one in loads.bounds] == [(80.0, True), (-80.0, False)]
    both = load_curves(ROBOT, rows, [PAN, LIFT], [0.8] * ROBOT.n)
    assert len(both.lines) == 2 and both.bounds == ()


def test_of_a_board_that_tells_no_positions_only_what_was_commanded_is_drawn() -> None:
    rows = history(5.0).since(20.0)
    assert len(angle_curves(ROBOT, rows, [LIFT], Source.COMMANDED).lines) == 1
    assert "Dotted" not in legend_html(ROBOT, [LIFT], Source.COMMANDED)
    assert "Dotted: transmitted" in legend_html(ROBOT, range(ROBOT.n), Source.TRANSMITTED)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"board": None}, "No board is connected"),
        ({"source": Source.COMMANDED}, "tells no positions"),
        ({"source": Source.TRANSMITTED}, "what it sends to the servos, not where they are"),
        ({"quantities": {}}, "measures no loads"),
    ],
)
def test_it_says_what_is_missing(change: dict[str, object], words: str) -> None:
    assert words in missing_html(replace(moment(1.0), **change))  # type: ignore[arg-type]
    assert missing_html(moment(1.0)) == ""


def test_the_file_has_each_joint_that_is_drawn_commanded_and_measured_with_its_load() -> None:
    rows: JointRows = history(1.0).since(20.0)
    head, *lines = csv.reader(io.StringIO(rows_csv(TITLES, rows, [PAN, LIFT])))
    assert head == [
        "time s", "Shoulder pan commanded °", "Shoulder pan board °", "Shoulder pan load %",
        "Shoulder lift commanded °", "Shoulder lift board °", "Shoulder lift load %",
    ]  # fmt: skip
    assert len(lines) == len(rows.time)
    assert [float(cell) for cell in lines[-1]] == pytest.approx([1.0, 1.0, 0.5, 10.0, 1.0, 0.5, 10.0])
