"""armctl's Firmata driver and boards that are not what it hopes for, all of them real firmware."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.avr.avr import Avr, AvrError
from tests.avr.conftest import MakeAvr
from tests.avr.firmata_rig import HIGHEST_US, LOWEST_US, FirmataRig
from tests.avr.serve import stepped_line

from armctl.errors import BoardError, BoardTimeoutError
from armctl.hardware.driver import ChannelSettings, Source
from armctl.hardware.firmata.driver import FirmataDriver
from armctl.hardware.transport import Connection


def driver_of(avr: Avr) -> FirmataDriver:
    return FirmataDriver(Connection(stepped_line(avr), lambda: avr.now))


def test_the_sketch_is_recognised_right_after_power_on(make_avr: MakeAvr) -> None:
    identity = driver_of(make_avr("firmata")).open()
    assert identity.kind == "Arduino with StandardFirmata 2.3"


def test_the_sketch_is_recognised_when_it_has_long_been_running(make_avr: MakeAvr) -> None:
    avr = make_avr("firmata")
    avr.run_for(5.0)
    avr.read()
    assert driver_of(avr).open().kind == "Arduino with StandardFirmata 2.3"


def test_positions_read_back_are_the_commanded_ones(make_avr: MakeAvr) -> None:
    rig = FirmataRig(make_avr("firmata"), (2, 44))
    assert rig.driver.read().positions == {2: None, 44: None}
    rig.stream({2: 1234, 44: 2345}, frames=20)
    readback = rig.driver.read()
    assert readback.positions == {2: 1234, 44: 2345}
    assert readback.source is Source.COMMANDED
    assert readback.powered


def test_release_between_questions_leaves_none_unanswered(make_avr: MakeAvr) -> None:
    rig = FirmataRig(make_avr("firmata"), (2, 5, 13, 14))
    for _ in range(10):
        rig.stream(dict.fromkeys(rig.pins, 1000), frames=5)
        rig.driver.release()
    rig.avr.run_for(1.0)
    assert rig.driver.read().positions == dict.fromkeys(rig.pins)


def test_configuring_anew_takes_no_earlier_answer_for_its_own(make_avr: MakeAvr) -> None:
    """The runtime configures again after a reading that failed, while the arm moves."""
    pins = (2, 3, 4, 5, 6, 7)
    rig = FirmataRig(make_avr("firmata"), pins)
    rig.stream(dict.fromkeys(pins, 1000), frames=10)
    for turn in range(20):
        rig.stream(dict.fromkeys(pins, 1000 + turn), frames=2)
        assert rig.driver.read().errors == ()  # which asks, and what it asks is not answered yet
        rig.driver.configure([ChannelSettings(pin, LOWEST_US, HIGHEST_US) for pin in pins])
        rig.avr.run_for(0.001 * turn)
        rig.stream(dict.fromkeys(pins, 1500 + turn), frames=2)
    assert rig.settled_us() == pytest.approx(dict.fromkeys(pins, 1519), abs=4)


def test_a_pin_that_cannot_drive_a_servo_is_named(make_avr: MakeAvr) -> None:
    driver = driver_of(make_avr("firmata"))
    driver.open()
    with pytest.raises(BoardError, match="pin 53 cannot drive a servo"):
        driver.configure([ChannelSettings(pin, LOWEST_US, HIGHEST_US) for pin in (2, 53)])


def test_the_reset_button_is_noticed(make_avr: MakeAvr) -> None:
    rig = FirmataRig(make_avr("firmata"), (2, 44))
    rig.stream({2: 1000, 44: 2000}, frames=5)
    rig.avr.reset()
    rig.avr.run_for(2.0)
    with pytest.raises(BoardError, match="restarted"):
        rig.driver.read()
    with pytest.raises(BoardError, match="connect again"):
        rig.driver.write({2: 1001})
    assert rig.pulses_of(0.2) == []


def test_a_mega_without_the_sketch_is_told_how_to_get_it(make_avr: MakeAvr) -> None:
    """A sketch that answers something else (here: every byte, plus one) is no Firmata."""
    with pytest.raises(BoardError, match="StandardFirmata"):
        driver_of(make_avr("known")).open()


def test_the_encoder_firmware_is_not_mistaken_for_firmata(make_avr: MakeAvr) -> None:
    with pytest.raises(BoardError, match="Firmata"):
        driver_of(make_avr("encoder")).open()


def test_a_silent_mega_is_told_from_a_foreign_one(make_avr: MakeAvr, tmp_path: Path) -> None:
    image = tmp_path / "idle.hex"
    image.write_text(":02000000FFCF30\n:00000001FF\n")  # rjmp .-2
    with pytest.raises(BoardTimeoutError, match="StandardFirmata"):
        driver_of(make_avr(image)).open()


def test_a_blank_mega_crashes_the_simulator_and_so_the_test(make_avr: MakeAvr, tmp_path: Path) -> None:
    image = tmp_path / "blank.hex"
    image.write_text(":02000000FFFF00\n:00000001FF\n")  # the CPU runs off the end of its flash
    with pytest.raises(AvrError, match=r"blank\.hex: the simulated CPU crashed"):
        driver_of(make_avr(image)).open()
