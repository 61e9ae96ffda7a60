"""The configured channels of a board: which are taken, and what each may be sent."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.boards import setup_of
from armctl.errors import BoardError
from armctl.hardware import ChannelScale, ChannelSettings, ChannelTable, Setup
from armctl.hardware.boards import board_type
from armctl.hardware.firmata import pin_table
from armctl.hardware.maestro import MaestroModel
from armctl.hardware.maestro.driver import channel_table
from armctl.robot import load_robot

QUARTERS = ChannelScale("channel", "µs", 4)
CONFIGURED = (ChannelSettings(3, 999.9, 2000.1), ChannelSettings(1, -5.5, 5.5))


def test_channels_and_settings_come_in_order():
    table = ChannelTable(QUARTERS, CONFIGURED)
    assert table.channels == (1, 3)
    assert [one.minimum for one in table.settings] == [-5.5, 999.9]
    assert table.whole_range(3) == (4000, 8000)


@pytest.mark.parametrize("value", [999.8, 2000.2, math.nan, math.inf, -math.inf])
def test_what_is_outside_is_refused_in_the_boards_own_words(value: float):
    with pytest.raises(BoardError, match=rf"channel 3: {value:g} µs is outside 999.9 … 2000.1 µs; nothing"):
        ChannelTable(QUARTERS, CONFIGURED).admit(3, value)


def test_what_is_not_configured_is_refused():
    with pytest.raises(BoardError, match=r"axis 2 is not configured \(configured: 1, 3\); nothing was sent"):
        ChannelTable(ChannelScale("axis", "counts"), CONFIGURED).admit(2, 0.0)
    with pytest.raises(BoardError, match=r"pin 2 is not configured \(configured: none\)"):
        ChannelTable(ChannelScale("pin", "µs")).admit(2, 0.0)


@given(st.floats(0.25, 4000.0), st.floats(0.25, 60.0), st.floats(0.0, 1.0), st.sampled_from([1, 2, 4, 10]))
def test_rounding_leads_nowhere_that_the_range_forbids(low: float, width: float, share: float, steps: int):
    scale, settings = ChannelScale("axis", "counts", steps), ChannelSettings(0, low, low + width)
    if not scale.holds_range(settings, -99999, 99999):
        assert math.ceil(low * steps) > math.floor((low + width) * steps)  # no whole step inside
        return
    value = min(settings.maximum, low + share * width)
    sent = ChannelTable(scale, [settings]).admit(0, value) / steps
    assert low <= sent <= settings.maximum
    assert abs(sent - value) <= 1 / steps


def test_the_same_channel_twice_is_refused():
    with pytest.raises(BoardError, match="channel 1 is configured twice"):
        channel_table([ChannelSettings(1, 1000, 2000), ChannelSettings(1, 1000, 2000)], None)
    with pytest.raises(BoardError, match="pin 9 is configured twice"):
        pin_table([ChannelSettings(9, 1000, 2000), ChannelSettings(9, 1000, 2000)], [9])


NO_RANGES = [(2000, 1000), (-5, 1000), (math.nan, 2000), (1000, math.inf), (600.1, 600.2)]
NO_MAESTRO = r"channel 3: .* is no range .* within 0.25 … 4095.75 µs"
NO_FIRMATA = r"is no range for a servo .* within 544 … 2912 µs.*degrees"


@pytest.mark.parametrize(
    ("check", "says", "ranges"),
    [
        (lambda one: channel_table([one], None), NO_MAESTRO, [*NO_RANGES, (0, 1000), (1000, 4096)]),
        (
            lambda one: pin_table([one], [3]),
            NO_FIRMATA,
            [*NO_RANGES, (500, 2400), (543.9, 2000), (1000, 2913)],
        ),
    ],
)
def test_a_range_that_a_board_has_not(check, says: str, ranges):
    for low, high in ranges:
        with pytest.raises(BoardError, match=says):
            check(ChannelSettings(3, low, high))


def test_a_channel_that_the_maestro_has_not():
    settings = [ChannelSettings(6, 1000, 2000)]
    with pytest.raises(BoardError, match="Micro Maestro 6-channel has channels 0 … 5"):
        channel_table(settings, MaestroModel.MICRO_6)
    assert channel_table(settings, MaestroModel.MINI_12).channels == (6,)
    assert channel_table(settings, None).channels == (6,)


def test_a_pin_that_drives_no_servo_is_named_with_those_that_do():
    two = [ChannelSettings(2, 1000, 2000)]
    for pins, said in (
        (range(3, 50), "3 … 49; change"),
        ((9, 5, 6, 3), "3, 5 … 6, 9;"),
        ((), "none at all;"),
    ):
        with pytest.raises(BoardError, match=f"pin 2 cannot drive a servo on this .* that can: {said}"):
            pin_table(two, pins)


def test_more_servos_than_the_line_carries_are_refused():
    servos = [ChannelSettings(pin, 1000, 2000) for pin in range(2, 19)]
    pin_table(servos[:16], range(2, 50))
    with pytest.raises(BoardError, match="17 servos: at 57600 baud a Firmata board can be sent 16 setpoints"):
        pin_table(servos, range(2, 50))


@pytest.mark.parametrize("name", ["abaas", "humanoid", "mico", "scorbot", "uzuner"])
def test_what_is_shipped_is_taken(name: str) -> None:
    robot = load_robot(name)
    board_type(robot.board).check(setup_of(robot))


@pytest.mark.parametrize(("kind", "channel", "low"), [("maestro", 23, 600.0), ("firmata", 2, 544.0)])
def test_what_the_largest_board_has_is_taken(kind: str, channel: int, low: float) -> None:
    board_type(kind).check(Setup([ChannelSettings(channel, low, 2400.0, 100.0, 100.0)]))


@pytest.mark.parametrize(
    ("kind", "channel", "says"),
    [
        ("maestro", 24, "channel 24: the largest Maestro has channels 0 … 23"),
        ("firmata", 1, "pin 1 cannot drive a servo"),
        ("encoder", 0, "axis 0"),  # nothing says how it is homed
    ],
)
def test_what_a_board_has_not_is_refused(kind: str, channel: int, says: str) -> None:
    with pytest.raises(BoardError, match=says):
        board_type(kind).check(Setup([ChannelSettings(channel, 600.0, 2400.0, 100.0, 100.0)]))
