"""The encoder firmware is held to the bytes that its simulation is held to as well."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.avr.avr import Avr
from tests.avr.conftest import MakeAvr
from tests.avr.encoder_conformance import CONFORMANCE, Check


class LineToTheFirmware:
    """The serial line of a simulated Mega that has just got its power."""

    def __init__(self, avr: Avr) -> None:
        self._avr = avr

    def exchange(self, data: bytes, seconds: float) -> bytes:
        self._avr.write(data)
        self._avr.run_for(seconds)
        return self._avr.read()


@pytest.mark.parametrize("check", CONFORMANCE, ids=lambda check: check.__name__)
def test_conformance(check: Check, make_avr: MakeAvr, encoder_firmware: Path) -> None:
    check(LineToTheFirmware(make_avr(encoder_firmware)))
