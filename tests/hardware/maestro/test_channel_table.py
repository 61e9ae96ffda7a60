from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.errors import BoardError
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.maestro.driver import ChannelTable
from armctl.hardware.ports import MaestroModel


def test_channels_and_settings_come_in_order():
    table = ChannelTable([ChannelSettings(4, 1000, 2000), ChannelSettings(1, 900, 2100)], None)
    assert table.channels == (1, 4)
    assert [one.minimum for one in table.settings] == [900, 1000]


@pytest.mark.parametrize("pulse", [999.99, 2000.01, math.nan, math.inf, -math.inf, 0.0, -1500.0])
def test_a_setpoint_outside_the_range_is_refused(pulse):
    table = ChannelTable([ChannelSettings(1, 1000, 2000)], None)
    with pytest.raises(BoardError, match=r"channel 1: .* is outside 1000 … 2000 µs; nothing was sent"):
        table.admit(1, pulse)


def test_a_channel_that_is_not_configured_is_refused():
    table = ChannelTable([ChannelSettings(1, 1000, 2000)], None)
    with pytest.raises(BoardError, match=r"channel 2 is not configured \(configured: 1\)"):
        table.admit(2, 1500)


@given(st.floats(0.25, 4000.0), st.floats(0.25, 60.0), st.floats(0.0, 1.0))
def test_rounding_never_leads_out_of_the_range(minimum, width, fraction):
    maximum = minimum + width
    pulse = min(maximum, minimum + fraction * width)
    try:
        table = ChannelTable([ChannelSettings(0, minimum, maximum)], None)
    except BoardError:
        assert math.ceil(minimum * 4) > math.floor(maximum * 4)  # not one whole quarter µs inside
        return
    sent = table.admit(0, pulse) / 4
    assert minimum <= sent <= maximum
    assert abs(sent - pulse) <= 0.25


@pytest.mark.parametrize(
    ("minimum", "maximum"),
    [(2000, 1000), (0, 1000), (-5, 1000), (math.nan, 2000), (1000, math.inf), (1000, 4096), (1000.1, 1000.2)],
)
def test_a_range_that_cannot_be_is_refused(minimum, maximum):
    with pytest.raises(BoardError, match=r"channel 3: .* is no range"):
        ChannelTable([ChannelSettings(3, minimum, maximum)], None)


def test_a_channel_that_the_board_has_not_is_refused():
    settings = [ChannelSettings(6, 1000, 2000)]
    with pytest.raises(BoardError, match="Micro Maestro 6-channel has channels 0 … 5"):
        ChannelTable(settings, MaestroModel.MICRO_6)
    assert ChannelTable(settings, MaestroModel.MINI_12).channels == (6,)
    assert ChannelTable(settings, None).channels == (6,)
    with pytest.raises(BoardError, match="largest Maestro has channels 0 … 23"):
        ChannelTable([ChannelSettings(24, 1000, 2000)], None)


def test_the_same_channel_twice_is_refused():
    with pytest.raises(BoardError, match="channel 1 is configured twice"):
        ChannelTable([ChannelSettings(1, 1000, 2000), ChannelSettings(1, 1000, 2000)], None)
