"""Who answers, and the check-up, asked of real firmware: the questions upset neither image."""

from __future__ import annotations

import pytest
from tests.avr.avr import Avr
from tests.avr.conftest import MakeAvr
from tests.avr.serve import stepped_line
from tests.avr.test_firmata import FirmataRig

from armctl.hardware.board_type import ARDUINO_MEGA, Verdict
from armctl.hardware.doctor import Patient, examine
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.ports import PortChecks, Probed, approach, probe

FREE = PortChecks(lambda _device: True, lambda _device: None, lambda _device: (), tuple)


def probed(avr: Avr, label: str | None) -> Probed:
    open_line = stepped_line(avr)
    return probe(lambda _baud: open_line(), approach(label), lambda: avr.now)


@pytest.mark.parametrize("label", [None, ARDUINO_MEGA])
def test_standard_firmata_is_told_by_name_and_version(make_avr: MakeAvr, label: str | None) -> None:
    found = probed(make_avr("firmata"), label)
    assert (found.board, found.name, found.version) == ("firmata", "StandardFirmata", "2.3")


def test_standard_firmata_that_has_long_been_running_is_asked_without_a_change_to_its_pulses(
    make_avr: MakeAvr,
) -> None:
    rig = FirmataRig(make_avr("firmata"), (2, 22))
    rig.stream({2: 1000, 22: 2000}, frames=10)
    before = rig.settled_us()
    assert probed(rig.avr, None).board == "firmata"
    assert {round(pulse.width_us, -2) for pulse in rig.meter.take()} == {1000, 2000}
    assert rig.settled_us() == pytest.approx(before, abs=4.0)


@pytest.mark.parametrize("label", [None, ARDUINO_MEGA])
def test_the_encoder_firmware_is_told_by_name_and_version(make_avr: MakeAvr, label: str | None) -> None:
    found = probed(make_avr("encoder"), label)
    assert (found.board, found.name) == ("encoder", "armctl-encoder")
    assert "6 axes" in found.details


def test_another_sketch_is_nobody(make_avr: MakeAvr) -> None:
    assert probed(make_avr("known"), ARDUINO_MEGA).board is None


@pytest.mark.parametrize(
    ("kind", "channels"),
    [
        ("firmata", [ChannelSettings(pin, 544.0, 2400.0) for pin in (2, 22, 49)]),
        ("encoder", [ChannelSettings(axis, -1000.0, 1000.0, 500.0, 5000.0) for axis in range(6)]),
    ],
)
def test_the_check_up_finds_nothing_wrong(
    make_avr: MakeAvr,
    kind: str,
    channels: list[ChannelSettings],
) -> None:
    avr = make_avr(kind)
    open_line = stepped_line(avr)
    patient = Patient("socket://board", expected=kind, channels=channels, checks=FREE)
    findings = examine(patient, lambda _baud: open_line(), lambda: avr.now)
    assert [one for one in findings if one.verdict is Verdict.FAILED] == []
    seen = {one.check: one.seen for one in findings}
    assert seen["round trips"].startswith("50 questions answered")
    assert ("all pulses are off" if kind == "firmata" else "motors off") in seen["outputs"]
