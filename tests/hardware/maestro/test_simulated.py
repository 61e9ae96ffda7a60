from __future__ import annotations

import random
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.errors import InputError
from armctl.hardware.maestro import MaestroModel, codec
from armctl.hardware.maestro.codec import MaestroErrors
from armctl.hardware.maestro.simulated import (
    ChannelConfig,
    HomeMode,
    MaestroSettings,
    SimulatedMaestro,
)

WIDE = ChannelConfig(minimum_us=500.0, maximum_us=2500.0)


def board(model: MaestroModel = MaestroModel.MICRO_6, **settings) -> SimulatedMaestro:
    """A board switched on at t = 0."""
    simulated = SimulatedMaestro(model, MaestroSettings(**settings))
    simulated.advance(0.0)
    return simulated


def feed(simulated: SimulatedMaestro, text: str) -> str:
    return simulated.feed(bytes.fromhex(text)).hex(" ")


def target(simulated: SimulatedMaestro, channel: int, pulse_us: float) -> None:
    assert simulated.feed(codec.command(codec.Opcode.SET_TARGET, channel, round(pulse_us * 4))) == b""


def test_targets_outside_the_channels_range_are_clamped():
    simulated = board(channels={1: WIDE})
    for channel, pulse_us, sent in ((0, 500.0, 992.0), (0, 2500.0, 2000.0), (1, 2500.0, 2500.0)):
        target(simulated, channel, pulse_us)
        assert simulated.position_us(channel) == sent


def test_the_pololu_form_reaches_only_its_own_device_number():
    simulated = board(device=3)
    feed(simulated, "aa 0c 04 00 20 1f aa 03 04 00 70 2e")
    assert simulated.target_us(0) == 1500.0
    assert simulated.errors == MaestroErrors(0)


@pytest.mark.parametrize(
    ("limit", "end_us", "before", "arrives_s"),
    [
        ("87 00 0c 01", 1350.0, 1280.0, 0.1),  # speed 140: exactly 100 ms for 350 µs
        ("87 00 01 00", 2000.0, 1999.5, 40.0),  # the smallest speed
        ("89 00 01 00", 2000.0, None, 3.56),  # the smallest acceleration: about 2 * sqrt(1000 / 312.5) s
    ],
)
def test_the_guides_speeds_and_accelerations(limit: str, end_us: float, before, arrives_s: float):
    simulated = board()
    target(simulated, 0, 1000.0)
    feed(simulated, limit)
    target(simulated, 0, end_us)
    simulated.advance(0.0199)  # nothing moves between two servo periods
    assert simulated.position_us(0) == 1000.0
    simulated.advance(arrives_s - 0.02)
    assert before is None or simulated.position_us(0) == before
    assert simulated.position_us(0) < end_us
    simulated.advance(arrives_s)
    assert simulated.position_us(0) == end_us


def test_speed_and_acceleration_together_make_a_trapezoid():
    simulated = board()
    target(simulated, 0, 1000.0)
    simulated.feed(
        codec.command(codec.Opcode.SET_SPEED, 0, 40) + codec.command(codec.Opcode.SET_ACCELERATION, 0, 20)
    )
    target(simulated, 0, 2000.0)
    positions = [1000.0]
    for tick in range(1, 80):
        simulated.advance(tick * 0.02)
        positions.append(simulated.position_us(0) or 0.0)
    steps = [after - before for before, after in pairwise(positions)]
    assert positions[-1] == 2000.0
    assert max(steps) == 20.0  # 40 units = 1000 µs/s = 20 µs a period
    changes = [abs(after - before) for before, after in pairwise(steps)]
    assert max(changes) <= 2.5  # 20 units = 6250 µs/s² = 2.5 µs a period²
    assert steps[0] == 2.5


def test_a_target_moved_behind_a_running_channel_is_reached_after_a_turn():
    simulated = board()
    target(simulated, 0, 1000.0)
    simulated.feed(codec.command(codec.Opcode.SET_ACCELERATION, 0, 10))
    target(simulated, 0, 2000.0)
    simulated.advance(0.5)
    passed = simulated.position_us(0)
    target(simulated, 0, 1010.0)
    simulated.advance(0.52)
    assert simulated.position_us(0) > passed  # it cannot turn at once
    simulated.advance(10.0)
    assert simulated.position_us(0) == 1010.0


@given(
    speed=st.integers(0, 400),
    acceleration=st.integers(0, 255),
    targets=st.lists(st.tuples(st.integers(3968, 8000), st.integers(1, 40)), min_size=1, max_size=6),
)
def test_ramps_keep_their_limits_and_arrive(speed, acceleration, targets):
    simulated = board()
    target(simulated, 0, 1500.0)
    simulated.feed(
        codec.command(codec.Opcode.SET_SPEED, 0, speed)
        + codec.command(codec.Opcode.SET_ACCELERATION, 0, acceleration)
    )
    tick = 0
    last = 1500.0
    for quarters, ticks in targets:
        simulated.feed(codec.command(codec.Opcode.SET_TARGET, 0, quarters))
        for _ in range(ticks):
            tick += 1
            simulated.advance(tick * 0.02)
            position = simulated.position_us(0)
            assert 992.0 <= position <= 2000.0
            if speed:
                assert abs(position - last) <= speed * 0.5 + 0.25
            last = position
    simulated.advance(tick * 0.02 + 120.0 if speed != 0 else tick * 0.02 + 20.0)
    assert simulated.position_us(0) == targets[-1][0] / 4


def test_the_first_target_of_an_off_channel_jumps_as_every_one_does_without_limits():
    simulated = board()
    for pulse_us in (1000.0, 2000.0):
        target(simulated, 1, pulse_us)
        assert simulated.position_us(1) == pulse_us
    simulated.feed(
        codec.command(codec.Opcode.SET_SPEED, 0, 1) + codec.command(codec.Opcode.SET_ACCELERATION, 0, 1)
    )
    for pulse_us, sent in ((1900.0, 1900.0), (1000.0, 1900.0), (0.0, None), (1000.0, 1000.0)):
        target(simulated, 0, pulse_us)
        assert simulated.position_us(0) == sent


def test_mini_ssc():
    simulated = board(channels={2: WIDE})
    feed(simulated, "ff 00 7f ff 02 00 ff 03 fe ff 06 7f")
    assert simulated.target_us(0) == 1500.0
    assert simulated.target_us(2) == 1500.0 - 476.25
    assert simulated.target_us(3) == 1500.0 + 476.25
    assert simulated.errors == MaestroErrors(0)  # servo 6 is another board's


@pytest.mark.parametrize(
    ("model", "bytes_in"),
    [
        (MaestroModel.MICRO_6, "9f 02 03 00 00 70 2e"),
        (MaestroModel.MINI_12, "9f 02 0b 70 2e 70 2e"),  # beyond the last channel
        (MaestroModel.MINI_12, "9f 00 03"),
        *((MaestroModel.MICRO_6, text) for text in ("84 06 70 2e", "90 06", "87 06 01 00", "89 00 00 02")),
    ],
)
def test_commands_without_sense_get_no_answer_and_switch_off(model: MaestroModel, bytes_in: str):
    simulated = board(model)
    target(simulated, 0, 1500.0)
    assert feed(simulated, bytes_in) == ""
    assert simulated.target_us(0) is None
    feed(simulated, "84 00 70 2e")
    assert simulated.target_us(0) == 1500.0
    assert feed(simulated, "a1") == "10 00"  # the error stays until it is read
    assert feed(simulated, "a1") == "00 00"


@pytest.mark.parametrize(("bytes_in", "error"), [("c0", MaestroErrors.SERIAL_PROTOCOL), ("a2", 0)])
def test_an_error_and_go_home_send_every_channel_to_its_home(bytes_in: str, error: int):
    home = ChannelConfig(home=HomeMode.GO_TO, home_us=1200.0)
    simulated = board(channels={1: ChannelConfig(home=HomeMode.IGNORE), 2: home, 3: home})
    assert simulated.position_us(2) == 1200.0  # at start-up too
    for channel in range(4):
        target(simulated, channel, 1800.0)
    simulated.feed(codec.command(codec.Opcode.SET_SPEED, 3, 40))
    feed(simulated, bytes_in)
    assert [simulated.target_us(channel) for channel in range(4)] == [None, 1800.0, 1200.0, 1200.0]
    assert simulated.errors == error
    simulated.advance(0.02)
    assert simulated.position_us(3) == 1780.0


def test_the_serial_timeout_fires_on_time_and_switches_off():
    simulated = board(timeout_units=50)
    simulated.advance(0.3)
    target(simulated, 0, 1500.0)
    simulated.advance(0.7999)
    assert simulated.position_us(0) == 1500.0
    assert simulated.errors == MaestroErrors(0)
    simulated.advance(0.8)
    assert simulated.position_us(0) is None
    assert feed(simulated, "a1 a1") == "20 00 00 00"
    simulated.advance(1.3)  # the next command has armed it again
    assert feed(simulated, "a1") == "20 00"
    by_default = board()
    target(by_default, 0, 1500.0)
    by_default.advance(1e6)
    assert by_default.position_us(0) == 1500.0


def test_any_valid_command_feeds_the_watchdog_and_an_invalid_one_does_not():
    simulated = board(timeout_units=50)
    for step in range(1, 10):
        simulated.advance(step * 0.4)
        assert feed(simulated, "90 00") == "00 00"
    assert simulated.errors == MaestroErrors(0)
    simulated.advance(3.8)
    feed(simulated, "c0")
    simulated.advance(4.1)
    assert MaestroErrors.SERIAL_TIMEOUT in simulated.errors


def test_in_the_uart_modes_usb_commands_are_silently_ignored():
    assert feed(board(), "84 02 70 2e 90 02 a1") == "70 17 00 00"
    simulated = board(takes_usb=False)
    assert feed(simulated, "84 02 70 2e 90 02 a1") == ""
    assert simulated.target_us(2) is None
    assert simulated.errors == MaestroErrors(0)
    assert simulated.log == ()


@pytest.mark.parametrize("model", MaestroModel)
def test_every_model_has_its_number_of_channels_and_tells_whether_it_moves(model: MaestroModel):
    simulated = board(model)
    last = model.channels - 1
    target(simulated, last, 1500.0)
    assert simulated.target_us(last) == 1500.0
    with pytest.raises(InputError, match=f"channels 0 … {last}"):
        simulated.target_us(model.channels)
    with pytest.raises(InputError, match=f"channel {model.channels}"):
        board(model, channels={model.channels: WIDE})
    assert feed(simulated, "93") == "00"
    simulated.feed(codec.command(codec.Opcode.SET_SPEED, last, 1))
    target(simulated, last, 2000.0)
    assert feed(simulated, "93") == ("00" if model is MaestroModel.MICRO_6 else "01")  # a Micro's is no use


def test_the_log_keeps_commands_with_their_times_and_stays_bounded():
    simulated = SimulatedMaestro(log_length=2)
    for step in range(3):
        simulated.advance(10.0 + step)
        target(simulated, step, 1500.0)
    assert [(entry.time, entry.raw.hex(" ")) for entry in simulated.log] == [
        (11.0, "84 01 70 2e"),
        (12.0, "84 02 70 2e"),
    ]


def test_a_power_cut_loses_all_but_the_settings():
    simulated = board(channels={0: WIDE}, timeout_units=100)
    target(simulated, 0, 2400.0)
    simulated.feed(
        codec.command(codec.Opcode.SET_SPEED, 0, 5)
        + codec.command(codec.Opcode.SET_ACCELERATION, 0, 6)
        + b"\xc0\x84\x00"
    )
    simulated.advance(0.9)
    simulated.reset()
    assert simulated.errors == MaestroErrors(0)
    assert simulated.position_us(0) is None
    assert (simulated.channel(0).speed, simulated.channel(0).acceleration) == (0, 0)
    target(simulated, 0, 2400.0)  # not the rest of the command that was cut off
    assert simulated.position_us(0) == 2400.0
    simulated.advance(1.5)  # the watchdog counts from the restart
    assert simulated.position_us(0) == 2400.0


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"minimum_us": 2000.0, "maximum_us": 1000.0}, "no range"),
        ({"home": HomeMode.GO_TO}, "home None"),
        ({"home": HomeMode.GO_TO, "home_us": 900.0}, "home 900"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings, says: str):
    with pytest.raises(InputError, match=says):
        ChannelConfig(**settings)


def assert_in_range(simulated: SimulatedMaestro) -> None:
    for channel in range(simulated.model.channels):
        for pulse in (simulated.position_us(channel), simulated.target_us(channel)):
            assert pulse is None or 992.0 <= pulse <= 2000.0


@pytest.mark.parametrize("model", [MaestroModel.MICRO_6, MaestroModel.MINI_24])
@pytest.mark.parametrize("crc", [False, True])
def test_a_hundred_thousand_random_bytes_do_no_harm(model, crc):
    # Home "ignore": else each of the many errors would switch all channels off and nothing would move.
    channels = {number: ChannelConfig(home=HomeMode.IGNORE) for number in range(model.channels)}
    simulated = board(model, crc=crc, timeout_units=7, channels=channels)
    rng = random.Random(20)
    now = 0.0
    seen: set[float | None] = set()
    for _ in range(2_000):
        now += rng.random() * 0.1
        simulated.advance(now)
        # Half of them shaped like commands, or hardly a target would ever be complete.
        noise = rng.randbytes(25)
        simulated.feed(noise + bytes(b & 0x7F for b in rng.randbytes(10)))
        shaped = bytes(
            [rng.choice([0x84, 0x87, 0x89]), rng.randrange(8), rng.randrange(128), rng.randrange(128)]
        )
        simulated.feed(shaped + (bytes([codec.crc7(shaped)]) if crc else b"") + noise[:11])
        seen.update(simulated.position_us(channel) for channel in range(6))
        assert_in_range(simulated)
    assert len(seen) > 100


@given(st.lists(st.binary(max_size=30), max_size=20))
def test_how_the_bytes_are_split_makes_no_difference(chunks):
    whole, parts = board(), board()
    reply = whole.feed(b"".join(chunks))
    assert b"".join(parts.feed(chunk) for chunk in chunks) == reply
    assert whole.log == parts.log
    assert whole.errors == parts.errors
    assert_in_range(whole)


def test_one_long_step_in_time_ends_where_many_short_ones_do():
    home = ChannelConfig(home=HomeMode.GO_TO, home_us=1200.0)
    boards = [board(timeout_units=10, channels={0: home}) for _ in range(2)]
    for simulated in boards:
        target(simulated, 0, 1900.0)
        simulated.feed(codec.command(codec.Opcode.SET_SPEED, 0, 40))
        target(simulated, 0, 2000.0)
    for step in range(1, 301):
        boards[0].advance(step * 0.001)
    boards[1].advance(0.3)
    assert boards[0].position_us(0) == boards[1].position_us(0) == 1800.0
