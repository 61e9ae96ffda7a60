"""The Python fake of a Firmata board is held to what the real image does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.avr.avr import Avr
from tests.avr.conftest import MakeAvr
from tests.avr.firmata_conformance import CONFORMANCE, REPORT, Line

from armctl.hardware.board_type import ByteModel
from armctl.hardware.firmata.simulated import SimulatedFirmata
from armctl.runtime.clock import ManualClock

_STEP_S = 0.001


class AvrLine:
    """The line of a simulated CPU."""

    def __init__(self, avr: Avr) -> None:
        self._avr = avr

    def exchange(self, data: bytes, seconds: float) -> bytes:
        self._avr.write(data)
        self._avr.run_for(seconds)
        return self._avr.read()


class ModelLine:
    """The line of a Python model."""

    def __init__(self, model: ByteModel) -> None:
        self._model = model
        self._clock = ManualClock()

    def exchange(self, data: bytes, seconds: float) -> bytes:
        received = self._model.advance(self._clock.now()) + self._model.feed(data)
        for _ in range(round(seconds / _STEP_S)):
            self._clock.advance(_STEP_S)
            received += self._model.advance(self._clock.now())
        return received


@pytest.fixture(params=["image", "fake"])
def line(request: pytest.FixtureRequest, make_avr: MakeAvr) -> Line:
    if request.param == "fake":
        return ModelLine(SimulatedFirmata())
    image: Path = request.getfixturevalue("firmata_firmware")
    return AvrLine(make_avr(image))


def test_the_board_reports_itself_when_it_has_started(line: Line) -> None:
    assert line.exchange(b"", 2.0) == REPORT


@pytest.mark.parametrize("conforms", CONFORMANCE, ids=lambda conforms: conforms.__name__)
def test_conformance(line: Line, conforms: Callable[[Line], None]) -> None:
    assert line.exchange(b"", 2.0) == REPORT
    conforms(line)
