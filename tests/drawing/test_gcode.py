"""G-code read to strokes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.drawing.gcode import read_gcode
from armctl.errors import DrawingError


def ends(text: str) -> list[list[list[float]]]:
    return [stroke.points[[0, -1]].round(6).tolist() for stroke in read_gcode(text).strokes]


def test_the_pen_is_down_below_zero_in_a_file_with_z() -> None:
    text = "G21 G90\nG0 X0 Y0 Z5\nG1 Z-1 F300\nG1 X10\nY10 (up)\nG0 Z5\nG0 X30\nG1 Z0\nX40 ; last\nM2\nX99"
    assert ends(text) == [[[0.0, 0.0], [10.0, 10.0]], [[30.0, 10.0], [40.0, 10.0]]]
    assert [stroke.line for stroke in read_gcode(text).strokes] == [4, 9]


def test_m3_and_m5_put_the_pen_down_and_up() -> None:
    assert ends("G1 X5\nM3 S90\nG1 X9\nM5\nG1 X20\nM03\nX30 Y1\nS0\nX40") == [
        [[5.0, 0.0], [9.0, 0.0]],
        [[20.0, 0.0], [30.0, 1.0]],
    ]


def test_without_either_the_fast_moves_are_those_of_the_lifted_pen() -> None:
    assert ends("G0 X1 Y1\nG1 X2\nG0 X5\nG1 Y2") == [[[1.0, 1.0], [2.0, 1.0]], [[5.0, 1.0], [5.0, 2.0]]]


def test_inches_and_steps_from_where_it_is() -> None:
    assert ends("G20 G91\nG1 X1\nY1\nG21 G1 X1") == [[[0.0, 0.0], [26.4, 25.4]]]


def test_a_place_gets_another_name_and_home_is_gone_to_with_the_pen_up() -> None:
    named = "G0 X10 Y20\nG92 X0 Y0\nG1 X5\nG91\nG1 Y1\nG90\nG1 X0 Y0\nG28\nG1 X1"
    assert ends(named) == [[[10.0, 20.0], [10.0, 20.0]], [[0.0, 0.0], [11.0, 0.0]]]
    assert next(stroke.length for stroke in read_gcode(named).strokes) == pytest.approx(6 + 26**0.5)
    assert ends("G92 X0 Y0 Z0\nG0 Z5\nG1 X1\nG1 Z0\nX3\nG28\nG1 X4") == [[[1.0, 0.0], [3.0, 0.0]]]


def test_home_is_gone_to_by_the_axes_that_are_named_alone() -> None:
    assert ends("G0 X10 Y20\nG91\nG28 X0\nG1 X5") == [[[0.0, 20.0], [5.0, 20.0]]]
    lifts = "G0 X10 Y20 Z5\nG1 Z0\nX11\nG91 G28 Z0\nG1 X5\nG90 G1 Z0\nX20"
    assert ends(lifts) == [[[10.0, 20.0], [11.0, 20.0]], [[16.0, 20.0], [20.0, 20.0]]]
    for bare in ("G28 X Y", "g28xy", "G28 Y X ; both"):
        assert ends(f"G0 X9 Y9\n{bare}\nG1 X5") == [[[0.0, 0.0], [5.0, 0.0]]]
    assert ends("G0 X9 Y9\nG28 X\nG1 X5") == [[[0.0, 9.0], [5.0, 9.0]]]


def test_numbers_of_programs_and_lines_and_their_sums_are_passed_over() -> None:
    assert ends("N3 G0 X1*57 ; a word (or two)\nN4 G1 X2*61 (on)") == [[[1.0, 0.0], [2.0, 0.0]]]
    assert ends("%\nO1000\nN10 G0 X1 *57\nN20 G1 X2*61 \n%") == [[[1.0, 0.0], [2.0, 0.0]]]


@given(st.floats(-50, 50), st.floats(-50, 50), st.booleans(), st.booleans())
def test_a_circle_is_whole_wherever_it_begins(i: float, j: float, clockwise: bool, inches: bool) -> None:
    radius = float(np.hypot(i, j)) * (25.4 if inches else 1.0)
    if radius < 0.5:
        return
    word, unit = ("G2" if clockwise else "G3"), ("G20" if inches else "G21")
    around = f"{word} X{3 + 2 * i:.9f} Y{7 + 2 * j:.9f} I{i:.9f} J{j:.9f}"
    back = f"{word} X3 Y7 I{-i:.9f} J{-j:.9f}"
    (stroke,) = read_gcode(f"{unit}\nG0 X3 Y7\n{around}\n{back}\n{word} X3 Y7 I{i:.9f} J{j:.9f}").strokes
    assert stroke.length == pytest.approx(4 * np.pi * radius, rel=2e-3)


@pytest.mark.parametrize(
    ("words", "middle", "length"),
    [
        ("G2 X10 Y0 I5 J0", (5.0, 0.0), 5 * np.pi),
        ("G3 X10 Y0 R5", (5.0, 0.0), 5 * np.pi),
        ("G3 X5 Y5 R5", (0.0, 5.0), 2.5 * np.pi),
        ("G2 X5 Y5 R-5", (0.0, 5.0), 7.5 * np.pi),
        ("G3 I5", (5.0, 0.0), 10 * np.pi),
    ],
)
def test_arcs_keep_to_their_circle(words: str, middle: tuple[float, float], length: float) -> None:
    (stroke,) = read_gcode(words).strokes
    halves = 0.5 * (stroke.points[1:] + stroke.points[:-1])
    assert np.abs(np.linalg.norm(stroke.points - middle, axis=1) - 5.0).max() < 1e-9
    assert np.abs(np.linalg.norm(halves - middle, axis=1) - 5.0).max() < 0.05
    assert stroke.length == pytest.approx(length, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("G1 X1\nG5 X3", "line 2: G5 is not known here"),
        ("X3", "line 1: a place without G0, G1, G2 or G3"),
        ("G1 X1 X2", "X stands twice"),
        ("G1 X", "'X' is no word of G-code"),
        ("G1 X1 #3", "'#3' is no word"),
        ("G1 A3", "the word 'A3' is not known here"),
        ("M98", "M98 is not known"),
        ("G2 X10 I3", "must be the same"),
        ("G2 X10 R2", "an arc of R = 2 mm cannot span 10.000 mm"),
        ("G2 X10", "an arc needs its middle"),
        ("G1 X1e9", "the word 'e9' is not known here"),
        ("G1 X999999999", "m away"),
        ("G0 X3", "it draws nothing"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(text: str, says: str) -> None:
    with pytest.raises(DrawingError) as refusal:
        read_gcode(text)
    assert says in str(refusal.value)


WORDS = st.sampled_from(
    [
        "G0",
        "G1",
        "G2",
        "G3",
        "G20",
        "G91",
        "X3",
        "Y-2.5",
        "Z1",
        "Z-1",
        "I2",
        "J1",
        "R4",
        "M3",
        "M5",
        "S0",
        "\n",
        "(",
    ]
)


@given(st.lists(WORDS, max_size=25).map(" ".join))
def test_no_words_crash_the_reader(text: str) -> None:
    try:
        drawing = read_gcode(text)
    except DrawingError:
        return
    assert all(np.isfinite(stroke.points).all() for stroke in drawing.strokes)
