"""Real firmware and the Python fakes of ``armctl simulate`` are held to the same bytes."""

from __future__ import annotations

import pytest
from tests.avr import encoder_conformance, firmata_conformance
from tests.avr.conformance import AvrLine, Check, ModelLine
from tests.avr.conftest import MakeAvr

from armctl.hardware.firmata.simulated import SimulatedFirmata


@pytest.mark.parametrize("check", encoder_conformance.CONFORMANCE, ids=lambda check: check.__name__)
def test_the_encoder_firmware(check: Check, make_avr: MakeAvr) -> None:
    check(AvrLine(make_avr("encoder")))


@pytest.mark.parametrize("board", ["image", "fake"])
@pytest.mark.parametrize("check", firmata_conformance.CONFORMANCE, ids=lambda check: check.__name__)
def test_standard_firmata(check: Check, make_avr: MakeAvr, board: str) -> None:
    line = AvrLine(make_avr("firmata")) if board == "image" else ModelLine(SimulatedFirmata(), 0.001)
    assert line.exchange(b"", 2.0) == firmata_conformance.REPORT
    check(line)
