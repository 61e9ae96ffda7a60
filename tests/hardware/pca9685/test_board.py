"""What armctl asks of the kind of board: robot file, ports, addresses, who answers, check-up."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.hardware.lines import LoopTransport
from tests.hardware.pca9685.kit import CHANNELS, model_of, robot_on, robot_text
from tests.hardware.pca9685.test_i2c import FakeBus, FakeMessage

from armctl.boards import AUTOMATIC, SIMULATED, Boards
from armctl.errors import BoardError, OtherBoardError, PortError, RobotFileError
from armctl.hardware import ChannelSettings, Setup
from armctl.hardware.board_type import ARDUINO_MEGA, Finding, Verdict
from armctl.hardware.boards import board_of_address, board_type
from armctl.hardware.doctor import Patient, examine
from armctl.hardware.firmata.simulated import SimulatedFirmata
from armctl.hardware.maestro.simulated import SimulatedMaestro
from armctl.hardware.pca9685 import PI_BUS, Pca9685Options, i2c
from armctl.hardware.pca9685.driver import Pca9685Driver
from armctl.hardware.pca9685.simulated import SimulatedI2cBus, SimulatedPca9685
from armctl.hardware.ports import Probed, approach, list_ports, open_line, probe
from armctl.hardware.transport import PortInfo
from armctl.protocol import ManualClock, MonotonicClock
from armctl.robot import load_robot

BUS = PortInfo("i2c://1", PI_BUS, "Raspberry Pi 5", None, True, None)
WIDE = [ChannelSettings(0, 500.0, 2450.0)]
MEGA = PortInfo("/dev/ttyACM1", ARDUINO_MEGA, "", "8573", True, None)


def test_the_robot_file_says_address_frequency_and_clock(tmp_path: Path):
    assert robot_on().board_settings == Pca9685Options(0x40, 50.0, 25.0)
    robot = robot_on('kind = "pca9685"\naddress = 0x41\nfrequency_hz = 200\noscillator_mhz = 26.2')
    assert robot.board_settings == Pca9685Options(0x41, 200.0, 26.2)
    assert robot.outputs.unit == "µs"
    for key, says in (
        ("address = 0x3f", "board.address"),
        ("frequency_hz = 1000", "board.frequency_hz"),
        ("oscillator_mhz = 2.5", "board.oscillator_mhz"),
        ("clock = 25", "board: unknown key .clock.*oscillator_mhz"),
    ):
        file = tmp_path / "arm.toml"
        file.write_text(robot_text(f'kind = "pca9685"\n{key}'), encoding="utf-8")
        with pytest.raises(RobotFileError, match=rf"line 19, key {says}"):
            load_robot(file)


def test_pulses_that_do_not_fit_into_a_period_are_refused():
    with pytest.raises(BoardError, match="no range for pulses that come 407 times a second"):
        board_type("pca9685").check(Setup(WIDE, Pca9685Options(frequency_hz=400)))


def boards(*ports: PortInfo) -> Boards:
    return Boards(robot_on(), MonotonicClock().now, lambda: ports)


def test_the_port_says_which_way_leads_to_the_chip(monkeypatch: pytest.MonkeyPatch):
    fake = type("Bus", (FakeBus,), {})
    monkeypatch.setitem(sys.modules, "smbus2", SimpleNamespace(SMBus=fake, i2c_msg=FakeMessage))
    for port, given in (("i2c://1/0x40", ()), ("pca9685:i2c://1/0x40", ()), (AUTOMATIC, (BUS,))):
        driver = boards(*given).driver(port)
        identity = driver.open()
        assert identity.kind == "PCA9685 at 0x40"
        assert identity.port == ("i2c://1" if given else "i2c://1/0x40")
        driver.configure(CHANNELS)
        driver.write({0: 1500.0})
        assert driver.read().positions[0] == 1500.0
        driver.close()
    assert isinstance(boards(MEGA).driver(AUTOMATIC), Pca9685Driver)
    assert isinstance(boards(MEGA).driver("/dev/ttyACM1"), Pca9685Driver)


def test_the_simulated_board_stands_behind_an_arduino():
    one = boards()
    driver = one.driver(SIMULATED)
    try:
        identity = driver.open()
        assert identity.simulated
        assert identity.kind == "PCA9685 at 0x40 behind an Arduino with StandardFirmata"
    finally:
        driver.close()
        one.close()


def test_other_boards_take_no_i2c_address():
    maestro = Boards(load_robot("uzuner"), MonotonicClock().now, tuple)
    with pytest.raises(PortError, match="not a port that can be opened"):
        maestro.driver("i2c://1/0x40").open()
    with pytest.raises(OtherBoardError, match="is set up for Pololu Maestro, this is PCA9685"):
        maestro.driver("pca9685:i2c://1/0x40")
    assert board_of_address("i2c://1/0x40") is board_type("pca9685")
    assert board_of_address("socket://a:1") is board_of_address("/dev/ttyACM0") is None
    with pytest.raises(PortError, match="has no addresses of its own"):
        board_type("maestro").open_line("maestro://1")
    with pytest.raises(PortError, match="not an I²C bus"):
        open_line("i2c://one", 115_200)


def test_the_bus_of_a_raspberry_pi_is_listed(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(i2c, "pi_buses", lambda: (BUS,))
    assert BUS in list_ports(tuple, Path("/nowhere"))


# Who answers.


def found(model, clock: ManualClock, port: str, expected: str | None = None) -> Probed:
    how = approach(None, expected, port)
    return probe(lambda _: LoopTransport(model, clock.now, clock.advance, port), how, clock.now)


def test_a_bus_is_asked_for_its_chips_only(clock: ManualClock):
    bus = SimulatedI2cBus([SimulatedPca9685(0x41), SimulatedPca9685(0x40)])
    assert str(found(bus, clock, "i2c://1")) == "PCA9685 at 0x40; on this bus answer 0x40, 0x41"
    assert found(bus, clock, "i2c://1/0x41").name == "PCA9685 at 0x41"
    assert found(bus, clock, "i2c://1/0x42").board is None
    assert all(chip.transfers == [] for chip in bus.chips), "nothing was written"


def test_an_arduino_and_a_maestro_are_found_as_before(clock: ManualClock):
    assert found(SimulatedFirmata(), clock, "pty").board == "firmata"
    assert found(SimulatedMaestro(), clock, "pty").board == "maestro"


def report(way: str, chip: SimulatedPca9685, clock: ManualClock, **changes) -> dict[str, Finding]:
    port = "i2c://1" if way == "bus" else "socket://loop:1"
    model = model_of(way, chip)
    values = {"expected": "pca9685", "channels": CHANNELS} | changes
    findings = examine(
        Patient(port, **values), lambda _: LoopTransport(model, clock.now, clock.advance, port), clock.now
    )
    worst = (Verdict.OK, Verdict.NOT_CHECKED, Verdict.WARNING, Verdict.FAILED).index
    return {one.check: one for one in sorted(findings, key=lambda one: worst(one.verdict))}


@pytest.mark.parametrize("way", ["bus", "arduino"])
def test_the_check_up_of_a_chip_writes_nothing_to_it(clock: ManualClock, way: str):
    chip = SimulatedPca9685()
    findings = report(way, chip, clock)
    assert [one.check for one in findings.values() if one.verdict is Verdict.FAILED] == []
    assert chip.transfers == []
    assert findings["chip"].seen == "a PCA9685 answers at 0x40; asleep, as after power-up: all pulses are off"
    assert findings["channels"].seen == "channels 0, 1, 2, 3: the chip has them"
    assert findings["outputs"].seen == "all pulses are off"
    assert findings["clock"].verdict is Verdict.NOT_CHECKED
    assert "oscillator_mhz" in findings["clock"].advice
    assert findings["watchdog"].verdict is Verdict.WARNING
    assert findings["round trips"].seen.startswith("50 questions answered")
    assert ("firmware" in findings) == (way == "arduino")


@pytest.mark.parametrize("way", ["bus", "arduino"])
def test_the_check_up_tells_what_another_program_has_done(clock: ManualClock, way: str):
    chip = SimulatedPca9685()
    for text in ("00 31", "fe 65", "00 61", "0a 00 00 70 01", "06 00 10 00 00", "01 14", "00 41"):
        chip.transfer(bytes.fromhex(text), 0)
    chip.transfers.clear()
    findings = report(way, chip, clock, settings=Pca9685Options(oscillator_mhz=25.0))
    assert chip.transfers == []
    assert findings["frequency"].seen.startswith("another program has set 60 pulses a second")
    assert findings["clock"].seen == "the chip runs on an external clock, until its power is cut"
    assert findings["outputs"].seen == "channel 0 high all the time, which is no pulse for a servo"


def test_the_check_up_of_another_address_and_of_channels_that_do_not_fit(clock: ManualClock):
    chip = SimulatedPca9685(0x41)
    assert "on this bus 0x41 does" in report("arduino", chip, clock)["conversation"].seen
    findings = report("arduino", chip, clock, settings=Pca9685Options(0x41, 400.0, 26.0), channels=WIDE)
    assert findings["channels"].verdict is Verdict.FAILED
    assert findings["clock"].seen == "26 MHz, as the robot file says"
    assert report("bus", chip, clock, settings=Pca9685Options(0x41), channels=())["channels"].seen == (
        "no robot was named"
    )
