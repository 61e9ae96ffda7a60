"""What the inputs of a simulated board see over time."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.errors import InputError
from armctl.hardware.board_type import SimulatedPins
from armctl.hardware.input_script import InputChange, InputPlayer, InputScript, load_script, read_script
from armctl.robot.signals import Input, Signals

SIGNALS = Signals((Input("part", "Part", 6, active_low=True), Input("knob", "Knob", 8, kind="analog")))


def read(text: str) -> InputScript:
    return read_script(text, SIGNALS)


@pytest.mark.parametrize(
    ("text", "change"),
    [
        ("at 2 s part = on", InputChange("part", 1.0, 2.0)),
        ("at 250ms part off", InputChange("part", 0.0, 0.25)),
        ("at .5 min knob=40 %", InputChange("knob", 0.4, 30.0)),
        ("at 1s part on for 20 ms", InputChange("part", 1.0, 1.0, for_s=0.02)),
        ("every 5 s part on for 200 ms", InputChange("part", 1.0, 5.0, 5.0, 0.2)),
        ("every 5 s from 1.5 s knob = 0.25 for 2 s", InputChange("knob", 0.25, 1.5, 5.0, 2.0)),
    ],
)
def test_statements_are_read(text: str, change: InputChange) -> None:
    assert read(text) == read(f"# first\n\n  {text}  # last\n") == InputScript((change,))
    assert read(f"{text}; {text}").changes == (change, change)


def test_a_table_is_read() -> None:
    table = read("time_s, part, knob\n0,off,\n\n1.5, on ,0.25\n2,,100%\n")
    assert table.changes == (
        InputChange("part", 0.0, 0.0),
        InputChange("part", 1.0, 1.5),
        InputChange("knob", 0.25, 1.5),
        InputChange("knob", 1.0, 2.0),
    )


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "the script is empty; for example: at 2 s part = on"),
        ("# nothing", "the script is empty"),
        ("at 2 s part = on\nsometimes part on", "line 2: 'sometimes part on' cannot be read"),
        ("at 2 part on", "line 1: .* cannot be read"),
        ("at 2 s horn on", "line 1: there is no input 'horn'; the robot file has part, knob"),
        ("at 2 s part = 40 %", "line 1: input part is digital: on or off, not 40 %"),
        ("at 2 s knob = 1.5", "line 1: input knob: 1.5 is outside 0 … 1"),
        ("every 5 s part on", "line 1: say for how long"),
        ("every 1 s part on for 1 s", "line 1: 1 s is not shorter than the 1 s between"),
        ("every 0 s part on for 0 s", "line 1: .*not shorter"),
        ("at 1 s part on for 0 s", "line 1: times are 1 ms"),
        ("at 2000000 s part on", "line 1: times are"),
        ("at 2 s from 1 s part on", "line 1: from goes with every"),
        ("time_s", "line 1: a table has time_s and at least one input"),
        ("time_s,part\nsoon,on", "line 2: time_s: 'soon' is not a number"),
        ("time_s,part\n-1,on", "line 2: time_s: -1 is outside"),
        ("time_s,part\nnan,on", "line 2: time_s: nan is outside"),
        ("time_s,part\n1,on,off", "line 2: 3 cells, but the first line names 2"),
        ("time_s,part\n1,maybe", "line 2: input part: 'maybe' is not on, off or a number"),
        ("time_s,horn\n1,on", "line 2: there is no input 'horn'"),
        ("at 1 s part on\n" * 301, "at most 300 changes, not 301"),
        ("#" * 20_001, "at most 20000 characters"),
    ],
)
def test_what_cannot_be_played_is_refused_with_its_line(text: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        read(text)


def test_a_file_is_named_by_its_refusal(tmp_path: Path) -> None:
    path = tmp_path / "day.txt"
    path.write_text("at 1 s part on\n")
    assert load_script(path, SIGNALS) == "at 1 s part on\n"
    path.write_bytes(b"at 1 s part in\n")
    with pytest.raises(InputError, match=r"day\.txt: line 1: "):
        load_script(path, SIGNALS)
    with pytest.raises(InputError, match="cannot be read: No such file"):
        load_script(tmp_path / "none", SIGNALS)


def test_a_pulse_ends_where_it_was_before_and_the_last_begun_counts() -> None:
    script = read(
        "at 1 s knob 0.5; every 2 s from 2 s knob 1 for 0.5 s; at 2.2 s knob 0.2; at 9 s knob 0.7 for 1 s"
    )
    seen = [script.value("knob", time) for time in (0.9, 1, 2, 2.3, 2.5, 3.9, 4, 4.5, 9.4, 10.2, 10.5)]
    assert seen == [None, 0.5, 1, 1, 0.2, 0.2, 1, 0.2, 0.7, 1, 0.2]
    assert script.value("part", 3.0) is None and script.names == ("knob",)


@st.composite
def changes(draw: st.DrawFn) -> InputChange:
    """Times that a float does not hold exactly, too."""
    value, at_s = draw(st.sampled_from([0.0, 0.5, 1.0])), draw(st.integers(0, 40)) / 10
    every_s = draw(st.sampled_from([math.inf, 0.3, 0.7, 1.1]))
    for_s = (
        draw(st.sampled_from([0.1, 0.2])) if every_s < math.inf else draw(st.sampled_from([math.inf, 0.1]))
    )
    return InputChange("knob", value, at_s, every_s, for_s)


@given(st.lists(changes(), min_size=1, max_size=4))
def test_between_two_changes_nothing_changes_and_none_is_missed(several: list[InputChange]) -> None:
    script, time = InputScript(tuple(several)), 0.0
    for _ in range(40):
        following = script.next(time)
        assert following > time
        if math.isinf(following):
            break
        if following - time > 1e-9:  # else two times that are one, but for the last bit
            middle = script.value("knob", (time + following) / 2)
            assert middle == script.value("knob", time) == script.value("knob", following - 1e-12)
        time = following


class Board(SimulatedPins):
    """Writes down what its pins were at whenever its time goes on."""

    def __init__(self) -> None:
        super().__init__()
        self.levels |= SIGNALS.at_rest
        self.seen: list[tuple[float, float, float]] = []

    def feed(self, data: bytes) -> bytes:
        return data

    def advance(self, now: float) -> bytes:
        self.seen.append((round(now, 3), self.levels[6], self.levels[8]))
        return f"{len(self.seen)} ".encode()

    def reset(self) -> None:
        """It has nothing to forget."""


def test_the_board_sees_each_change_at_its_time_however_seldom_its_time_goes_on() -> None:
    board = Board()
    player = InputPlayer(read("every 1 s part on for 5 ms; at 0 s knob 0.5"), SIGNALS, board.levels)
    assert player.advance(board, 100.0) == b"1 "
    assert player.advance(board, 102.5) == b"2 3 4 5 6 "
    # ahead of each change the level is as it was: the pin is low while the part is there
    assert board.seen == [
        (100, 1, 0.5), (101, 1, 0.5), (101.005, 0, 0.5), (102, 1, 0.5), (102.005, 0, 0.5), (102.5, 1, 0.5),
    ]  # fmt: skip


def test_what_is_pressed_by_hand_stays_until_the_script_says_otherwise_and_much_time_ends() -> None:
    board = Board()
    player = InputPlayer(read("every 1 s part on for 0.5 s"), SIGNALS, board.levels)
    player.advance(board, 0.0)
    board.levels[6] = 0.0  # pressed
    player.advance(board, 0.9)
    assert board.seen[-1] == (0.9, 0, 0)
    player.advance(board, 1.6)
    assert board.seen[-1] == (1.6, 1, 0)
    player.advance(board, 1e5 + 0.2)  # the computer slept
    assert board.seen[-1] == (1e5 + 0.2, 0, 0) and len(board.seen) < 2000
