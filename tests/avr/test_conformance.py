"""Real firmware is held to the bytes that its Python fake is held to in ``tests/hardware``."""

from __future__ import annotations

import pytest
from tests.avr import encoder_conformance, firmata_conformance
from tests.avr.conformance import AvrLine, Check
from tests.avr.conftest import MakeAvr


@pytest.mark.parametrize("check", encoder_conformance.CONFORMANCE, ids=lambda check: check.__name__)
def test_the_encoder_firmware(check: Check, make_avr: MakeAvr) -> None:
    check(AvrLine(make_avr("encoder")))


@pytest.mark.parametrize("check", firmata_conformance.CONFORMANCE, ids=lambda check: check.__name__)
def test_standard_firmata(check: Check, make_avr: MakeAvr) -> None:
    line = AvrLine(make_avr("firmata"))
    assert line.exchange(b"", 2.0) == firmata_conformance.REPORT
    check(line)
