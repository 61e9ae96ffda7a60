"""The driver on both ways to the chip: golden bytes, take-over, lost power, release."""

from __future__ import annotations

import pytest
from tests.hardware.pca9685.kit import CHANNELS, STEP_US, TICK_S, Session

from armctl.errors import BoardError, BoardProtocolError, BoardTimeoutError
from armctl.hardware import ChannelSettings, Source
from armctl.hardware.faults import Fault, FaultyModel
from armctl.hardware.pca9685 import Pca9685Options
from armctl.hardware.pca9685.driver import OSCILLATOR_NOTE, WATCHDOG_NOTE
from armctl.hardware.pca9685.registers import Mode1
from armctl.hardware.pca9685.simulated import SimulatedPca9685
from armctl.protocol import ManualClock

NEAREST_US = 307 * STEP_US
"""the step nearest to 1500 µs"""


def running(**options) -> SimulatedPca9685:
    """A chip at 50 Hz that another program has left with 1500 µs on channel 1, and a LED on channel 15."""
    chip = SimulatedPca9685(**options)
    for text in ("fe 79", "00 21", "0a 00 00 33 01", "42 00 00 00 08", "00 01"):
        chip.transfer(bytes.fromhex(text), 0)
    chip.transfers.clear()
    return chip


def writes(session: Session) -> list[str]:
    return [f"{register:02x} {data.hex(' ')}" for register, data in session.chip.transfers]


def test_it_is_set_up_asleep_and_woken_with_everything_off(connect):
    session: Session = connect()
    assert writes(session) == ["00 31", "00 30", "fa 00 00 00 10", "fe 79", "01 04", "00 20"]
    assert session.chip.mode == Mode1.AUTO_INCREMENT
    assert session.chip.frequency_hz == pytest.approx(50.03, abs=0.01)
    back = session.settle()
    assert back.positions == dict.fromkeys(range(4))
    assert back.on == dict.fromkeys(range(4), False)
    session.driver.configure(CHANNELS)
    assert len(writes(session)) == 6, "a chip that is set up is left alone"


def test_the_bytes_on_a_bus(clock: ManualClock):
    session = Session("bus", clock)
    session.driver.open()
    assert session.line.written[0] == "01 40 01 01 00"
    session.driver.configure(CHANNELS)
    session.line.written.clear()
    session.tick({0: 1500.0, 1: 1000.0})
    tag = int(session.line.written[0][:2], 16)
    assert session.line.written == [
        f"{tag:02x} 40 09 00 06 00 00 33 01 00 00 cd 00",
        f"{tag + 1:02x} 40 01 01 00",
        f"{tag + 2:02x} 40 01 10 06",
    ]


def test_the_bytes_to_an_arduino(clock: ManualClock):
    session = Session("arduino", clock)
    session.driver.open()
    assert session.line.written[3:5] == ["f0 78 00 00 f7", "f0 76 40 08 00 00 01 00 f7"]
    session.driver.configure(CHANNELS)
    session.settle()
    session.line.written.clear()
    session.tick({0: 1500.0})
    session.tick({0: 1500.0})
    assert session.line.written == [
        "f0 76 40 00 06 00 00 00 00 00 33 00 01 00 f7",
        "f0 76 40 08 00 00 01 00 f7",
        "f0 76 40 08 06 00 10 00 f7",
    ]


def test_what_it_says_of_itself(clock: ManualClock):
    identity = Session("bus", clock).driver.open()
    assert (identity.kind, identity.port) == ("PCA9685 at 0x40", "i2c://1")
    assert identity.notes == (WATCHDOG_NOTE, OSCILLATOR_NOTE)
    assert identity.earlier == ()
    identity = Session("arduino", clock).driver.open()
    assert identity.kind == "PCA9685 at 0x40 behind an Arduino with StandardFirmata"


def test_setpoints_arrive_within_half_a_step_and_are_told_as_they_were_asked_for(connect):
    session: Session = connect()
    for pulse_us in (1000.0, 1234.5, 1500.0, 2000.0):
        back = session.settle({0: pulse_us, 3: 1500.0})
        assert back.source is Source.TRANSMITTED
        assert back.positions == {0: pulse_us, 1: None, 2: None, 3: 1500.0}
        assert back.on == {0: True, 1: False, 2: False, 3: True}
        sent = session.chip.pulse_us(0)
        assert sent == pytest.approx(pulse_us, abs=STEP_US)
        assert 1000.0 <= sent <= 2000.0, "rounding never leads out of the range"
    before = len(session.chip.transfers)
    session.settle({0: 2000.0, 3: 1500.0})
    assert len(session.chip.transfers) == before, "what the chip has is not written again"
    assert session.settle().lost == 0


def test_a_calibrated_clock_makes_true_pulses(connect):
    chip = SimulatedPca9685(oscillator_mhz=26.4)
    session: Session = connect(chip)
    session.settle({0: 1500.0})
    assert chip.pulse_us(0) == pytest.approx(1500.0 * 25.0 / 26.4, abs=STEP_US)
    session.driver.release()
    session.driver.close()
    session: Session = connect(chip, options=Pca9685Options(oscillator_mhz=26.4))
    session.settle({0: 1500.0})
    assert chip.pulse_us(0) == pytest.approx(1500.0, abs=STEP_US)
    assert chip.frequency_hz == pytest.approx(50.0, abs=0.3)


def test_pulses_from_before_are_taken_over_as_they_are(connect):
    chip = running()
    session: Session = connect(chip)
    assert writes(session) == ["00 21"], "nothing but counting registers up"
    back = session.settle()
    assert back.positions == {0: None, 1: pytest.approx(NEAREST_US), 2: None, 3: None}
    assert chip.pulse_us(1) == pytest.approx(NEAREST_US)
    session.settle({1: 1510.0})
    assert chip.pulse_us(1) == pytest.approx(1510.0, abs=STEP_US)


def test_another_frequency_stays_as_long_as_anything_is_on(connect):
    chip = running()
    for text in ("00 31", "fe 65", "00 21", "06 00 00 70 01"):  # 60 Hz; 368 steps are 1501 µs
        chip.transfer(bytes.fromhex(text), 0)
    session: Session = connect(chip)
    assert session.driver.open().earlier[0].startswith("another program had set the PCA9685 to 60 pulses")
    session.driver.configure(CHANNELS)
    assert session.settle().positions[0] == pytest.approx(368 * 102 / 25)
    session.settle({0: 1400.0})
    assert chip.pulse_us(0) == pytest.approx(1400.0, abs=STEP_US)
    session.driver.release()
    assert chip.frequency_hz == pytest.approx(60, abs=0.2), "channel 15 is somebody else's, and on"
    chip.transfer(bytes.fromhex("42 00 00 00 10"), 0)
    session.driver.configure(CHANNELS)
    assert chip.frequency_hz == pytest.approx(50, abs=0.2)


def test_a_channel_lets_go_by_itself_and_the_others_hold(connect):
    session: Session = connect(running())
    session.settle({0: 1500.0, 2: 1600.0})
    session.driver.release_channels([1, 2])
    back = session.settle()
    assert back.on == {0: True, 1: False, 2: False, 3: False}
    assert session.chip.pulse_us(2) is None
    session.settle({2: 1600.0})
    assert session.chip.pulse_us(2) == pytest.approx(1600.0, abs=STEP_US)
    session.driver.release()
    assert [session.chip.pulse_us(channel) for channel in range(4)] == [None] * 4
    assert session.chip.pulse_us(15) is not None


def test_release_says_when_the_chip_does_not_confirm_it(connect):
    session: Session = connect()
    session.settle({0: 1500.0})
    session.bus.works = False
    with pytest.raises(BoardTimeoutError, match=r"confirm the release of channels 0, 1, 2, 3.*Cut the"):
        session.driver.release()


def test_stop_and_a_closed_line_leave_the_pulses_as_they_are(connect):
    session: Session = connect()
    session.settle({0: 1500.0})
    before = len(session.chip.transfers)
    session.driver.stop()
    session.driver.close()
    session.driver.close()
    assert len(session.chip.transfers) == before
    assert session.chip.pulse_us(0) == pytest.approx(NEAREST_US)
    for call in (session.driver.read, session.driver.release, lambda: session.driver.configure(CHANNELS)):
        with pytest.raises(BoardError, match="not connected"):
            call()
    with pytest.raises(BoardError, match="need no homing"):
        session.driver.home()


def test_a_chip_that_lost_its_power_is_told_and_gets_nothing_until_it_is_set_up_again(connect):
    session: Session = connect()
    session.settle({0: 1500.0})
    session.chip.power_up()
    back = session.settle()
    assert back.errors[0].startswith("the PCA9685 has started anew: it lost its power")
    assert back.positions == dict.fromkeys(range(4))
    session.chip.transfers.clear()
    session.settle({0: 1510.0})
    assert session.chip.transfers == []
    session.driver.configure(CHANNELS)
    assert session.settle().errors == ()
    assert session.chip.pulse_us(0) is None
    session.settle({0: 1500.0})
    assert session.chip.pulse_us(0) == pytest.approx(NEAREST_US)


def test_a_chip_without_power_is_a_silent_board(connect):
    session: Session = connect()
    session.settle({0: 1500.0})
    session.chip.powered = False
    with pytest.raises(
        BoardTimeoutError, match=r"chip at 0x40 does not acknowledge; check the chip's supply"
    ):
        session.settle(ticks=20)


def test_another_program_that_sets_it_up_is_told(connect):
    session: Session = connect()
    session.settle({0: 1500.0})
    session.chip.transfer(b"\x00\x01", 0)
    with pytest.raises(BoardError, match="another program has set the PCA9685 up in another way; close it"):
        for _ in range(20):
            try:
                session.tick()
            except BoardTimeoutError:
                continue


@pytest.mark.parametrize("way", ["bus", "arduino"])
def test_the_wrong_address_names_who_is_there(clock: ManualClock, way: str):
    session = Session(way, clock, SimulatedPca9685(0x43))
    how = r"i2c://1/0x43" if way == "bus" else r"address = 0x43 in \[board\]"
    with pytest.raises(BoardTimeoutError, match=rf"nothing answers at 0x40; on this bus 0x43 does.*{how}"):
        session.driver.open()
    session.bus.works = False
    with pytest.raises(BoardTimeoutError, match=r"nor at any other address of a PCA9685: check .*SDA, SCL"):
        session.driver.open()
    session.bus.works = True
    session = Session(way, clock, session.chip, Pca9685Options(address=0x43))
    assert session.driver.open().kind.startswith("PCA9685 at 0x43")


def test_the_address_of_the_port_counts_more_than_that_of_the_file(clock: ManualClock):
    session = Session("bus", clock, SimulatedPca9685(0x41), Pca9685Options(address=0x43), port="i2c://1/0x41")
    assert session.driver.open().kind == "PCA9685 at 0x41"


def test_another_chip_at_the_address_is_left_alone(connect, clock: ManualClock):
    class CurrentSensor(SimulatedPca9685):
        def transfer(self, data: bytes, count: int) -> bytes:
            assert len(data) < 2, "it was written to"
            return b"\x39" * count

    for way in ("bus", "arduino"):
        with pytest.raises(BoardProtocolError, match="what answers is no PCA9685"):
            Session(way, clock, CurrentSensor()).driver.open()


def test_a_sketch_without_i2c_is_refused(clock: ManualClock, monkeypatch: pytest.MonkeyPatch):
    session = Session("arduino", clock)
    monkeypatch.setattr("armctl.hardware.firmata.simulated._I2C_PINS", ())
    with pytest.raises(BoardProtocolError, match=r"has no I²C pins; load the sketch"):
        session.driver.open()


def test_more_channels_than_an_arduinos_line_carries(clock: ManualClock):
    many = [ChannelSettings(channel, 1000.0, 2000.0) for channel in range(16)]
    session = Session("bus", clock)
    session.driver.open()
    session.driver.configure(many)
    session.settle(dict.fromkeys(range(16), 1500.0))
    assert session.chip.pulse_us(15) == pytest.approx(NEAREST_US)
    session = Session("arduino", clock)
    session.driver.open()
    with pytest.raises(BoardError, match=r"16 servos take 3\d ms on the line of an Arduino.*Raspberry Pi"):
        session.driver.configure(many)
    session.driver.configure(many[:9])
    session.settle(dict.fromkeys(range(9), 1500.0))
    assert [session.chip.pulse_us(channel) for channel in range(9)] == [pytest.approx(NEAREST_US)] * 9


def test_setpoints_that_are_refused_send_nothing(connect):
    session: Session = connect()
    before = len(session.chip.transfers)
    for wrong in ({0: 1500.0, 4: 1500.0}, {0: 1500.0, 1: 2001.0}, {0: float("nan")}):
        with pytest.raises(BoardError, match="nothing was sent"):
            session.driver.write(wrong)
        session.tick()
    assert len(session.chip.transfers) == before


# A line that loses things.


def test_a_setpoint_that_got_lost_is_written_again(connect, clock: ManualClock):
    session: Session = connect()
    session.settle({0: 1500.0})
    clock.advance(TICK_S)
    session.bus.works = False
    session.driver.write({0: 1505.0})
    session.bus.works = True
    assert session.chip.pulse_us(0) == pytest.approx(NEAREST_US)
    back = session.settle()
    assert back.positions[0] == 1505.0
    assert session.chip.pulse_us(0) == pytest.approx(1505.0, abs=STEP_US)


def test_setpoints_that_are_lost_for_long_are_dropped_and_what_comes_then_is_no_jump(connect):
    session: Session = connect(wrap=FaultyModel)
    session.settle({0: 1500.0})
    session.chip.transfer, real = lambda data, count: real(data[:1], count), session.chip.transfer
    expired: set[int] = set()
    for k in range(20):
        expired |= set(session.tick({0: 1500.0 + 10 * k}).expired)
    assert expired == {0}
    session.chip.transfer = real
    largest, before = 0.0, session.chip.pulse_us(0)
    for _ in range(40):
        session.tick({0: 1690.0})
        now = session.chip.pulse_us(0)
        largest, before = max(largest, abs(now - before)), now
    assert session.chip.pulse_us(0) == pytest.approx(1690.0, abs=STEP_US)
    assert largest <= 600.0 * 2 * TICK_S + STEP_US


def test_one_lost_answer_is_counted_and_asked_for_again(connect):
    session: Session = connect(wrap=FaultyModel)
    session.settle({0: 1500.0})
    session.model.inject(Fault.DROP_REPLY)
    readings = [session.tick() for _ in range(8)]
    assert sum(one.lost for one in readings) == 1
    assert all(one.positions[0] == 1500.0 for one in readings)


def test_what_another_program_writes_is_told_and_not_undone(connect):
    session: Session = connect()
    session.settle({0: 1500.0})
    session.chip.transfer(bytes.fromhex("06 00 00 90 01"), 0)
    back = session.settle()
    assert back.positions[0] == pytest.approx(400 * STEP_US)
    assert session.chip.pulse_us(0) == pytest.approx(400 * STEP_US)


def test_an_arduino_that_restarts_is_told_and_the_chip_goes_on(clock: ManualClock):
    session = Session("arduino", clock)
    session.driver.open()
    session.driver.configure(CHANNELS)
    session.settle({0: 1500.0})
    session.board.arduino.reset()
    with pytest.raises(BoardError, match=r"the Arduino has restarted.*connect again"):
        session.settle()
    session.driver.open()
    session.driver.configure(CHANNELS)
    assert session.settle().positions[0] == pytest.approx(NEAREST_US)
