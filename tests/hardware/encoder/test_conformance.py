"""The simulated board is held to the same bytes as the firmware in the simulated ATmega2560."""

from __future__ import annotations

import pytest
from tests.avr.encoder_conformance import CONFORMANCE, Check

from armctl.hardware.encoder.simulated import SimulatedEncoderBoard

STEP_S = 0.005


class LineToTheSimulation:
    """Its time passes in small steps, as on a pty."""

    def __init__(self) -> None:
        self.board = SimulatedEncoderBoard()
        self.now = 50.0

    def exchange(self, data: bytes, seconds: float) -> bytes:
        said = self.board.advance(self.now) + self.board.feed(data)
        for _ in range(round(seconds / STEP_S)):
            self.now += STEP_S
            said += self.board.advance(self.now)
        return said


@pytest.mark.parametrize("check", CONFORMANCE, ids=lambda check: check.__name__)
def test_conformance(check: Check) -> None:
    check(LineToTheSimulation())
