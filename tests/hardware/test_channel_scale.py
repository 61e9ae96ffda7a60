from __future__ import annotations

import math
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.errors import BoardError
from armctl.hardware import ChannelSettings
from armctl.hardware.board_titles import BOARD_SCALES
from armctl.hardware.driver import ChannelScale
from armctl.robot import BoardKind

QUARTERS = ChannelScale("channel", "µs", 4)
CONFIGURED = {3: ChannelSettings(3, 999.9, 2000.1), 1: ChannelSettings(1, -5.5, 5.5)}


@pytest.mark.parametrize("value", [999.8, 2000.2, math.nan, math.inf, -math.inf])
def test_what_is_outside_is_refused_in_the_boards_own_words(value: float):
    with pytest.raises(
        BoardError, match=rf"channel 3: {value:g} µs is outside 999.9 … 2000.1 µs; nothing was"
    ):
        QUARTERS.admit(CONFIGURED, 3, value)


def test_what_is_not_configured_is_refused():
    with pytest.raises(BoardError, match=r"axis 2 is not configured \(configured: 1, 3\); nothing was sent"):
        ChannelScale("axis", "counts").admit(CONFIGURED, 2, 0.0)
    with pytest.raises(BoardError, match=r"pin 2 is not configured \(configured: none\)"):
        ChannelScale("pin", "µs").admit({}, 2, 0.0)


@given(st.floats(-5.5, 5.5), st.sampled_from([1, 2, 4, 10]))
def test_rounding_leads_nowhere_that_the_range_forbids(value: float, steps: int):
    sent = ChannelScale("axis", "counts", steps).admit(CONFIGURED, 1, value) / steps
    assert -5.5 <= sent <= 5.5
    assert abs(sent - value) <= 1 / steps


@pytest.mark.parametrize(
    ("board", "unit", "step"), [("maestro", "µs", 0.25), ("firmata", "µs", 1.0), ("encoder", "counts", 1.0)]
)
def test_the_steps_of_every_kind_of_board(board: BoardKind, unit: str, step: float):
    assert set(BOARD_SCALES) == set(get_args(BoardKind))
    assert (BOARD_SCALES[board].unit, BOARD_SCALES[board].step) == (unit, step)
