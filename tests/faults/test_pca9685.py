"""What befalls an arm on a PCA9685, over an I²C bus and behind an Arduino: its cells of the table."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.faults.kit import PORT, Bench, Spied
from tests.faults.test_table import FAULTS, PHASES, outcome
from tests.hardware.lines import LoopTransport
from tests.hardware.pca9685.kit import model_of, robot_on
from tests.runtime.kit import TICK

from armctl.arrays import FloatArray
from armctl.hardware import Driver
from armctl.hardware.pca9685.driver import Pca9685Driver
from armctl.hardware.pca9685.registers import Mode1
from armctl.hardware.pca9685.simulated import SimulatedPca9685
from armctl.hardware.transport import Connection
from armctl.protocol import Snapshot
from armctl.robot import Robot

LONG = bool(os.environ.get("ARMCTL_LONG"))
WAYS = ("bus", "arduino")
HAT = robot_on()


class HatBench(Bench):
    """An arm on a PCA9685; ``kind`` is the way to it."""

    def __post_init__(self) -> None:
        self.largest_step = 0.0
        """[µs] of any pulse from one tick to the next"""
        super().__post_init__()

    def _robot(self) -> Robot:
        return HAT

    def _model(self) -> Any:
        self.chip = SimulatedPca9685()
        return model_of(self.kind, self.chip)

    def _driver(self, port: str) -> Driver:
        driver = Pca9685Driver(Connection(lambda: self._open(port), self.clock.now))
        return Spied(driver, self.clock, self.log)

    def _open(self, port: str) -> LoopTransport:
        line = super()._open(port)
        line.name = "i2c://1" if self.kind == "bus" else port
        return line

    def trouble(self, *texts: str) -> None:
        super().trouble(*texts)
        if not texts and self.chip.mode & Mode1.EXTCLK:
            self.chip.power_up()  # the message says so: nothing else brings its own clock back

    def outputs(self) -> FloatArray:
        found = [self.chip.pulse_us(channel) for channel in self.robot.outputs.channels]
        return np.array([math.nan if one is None else one for one in found], dtype=float)

    def tick(self, elapsed: float = TICK) -> Snapshot:
        before = self.outputs()
        snapshot = super().tick(elapsed)
        step = np.nanmax(np.abs(self.outputs() - before), initial=0.0)
        self.largest_step = max(self.largest_step, float(step))
        return snapshot


# As in the table of the other boards: D disconnected, O off, H holding, F fault. ``µs``: no pulse may change
# by more from one tick to the next. A tick is 11 µs at the base's speed, and may count for two; a bus that
# is late by 0.4 s for half of its messages loses several. What a garbled or cut message says, nobody sees.

_GONE = "unplugged; plug it in and connect again"
_LOST = "lost the board: .*check the cable and the power, then connect again"
_SILENT = "check the chip's supply|long wires want"
_NEW = "PCA9685 has started anew: it lost its power"
_ARDUINO = "the Arduino has restarted .*connect again"
_GAP = "nothing ran for (0.[5-9]|600.0) s .*(ask for it again|looked at first)"
_FOUND = "are on already: Enable takes the arm over where it is"

TABLE = rf"""
# fault     phase       bus  arduino  µs    words
drop        connecting  D    DO       20    {_SILENT}|connected to
drop        enabling    F    F        20    {_LOST}
drop        holding     F    F        20    {_LOST}
drop        moving      F    F        20    {_LOST}
drop        stopping    F    F        25    {_LOST}
drop        jogging     F    F        20    {_LOST}
delay       connecting  D    DO       20    {_SILENT}|connected to
delay       enabling    FO   FO       20    {_LOST}
delay       moving      FH   FH       60    {_LOST}
delay       stopping    FH   FH       60    {_LOST}
garble      connecting  DO   DO       -     {_SILENT}|connected to
garble      enabling    FHO  FHO      -     of the questions|by itself|external clock|in another way|{_LOST}
garble      moving      FH   FH       -     of the questions|by itself|in another way|does not send|{_LOST}
half        connecting  D    DO       -     {_SILENT}|connected to
half        moving      FH   FH       -     {_LOST}|by itself
double      enabling    H    H        20    enabling finished|enabled
double      moving      H    H        20    move finished
double      stopping    H    H        25    stopped by test
unplug      connecting  D    D        20    {_GONE}
unplug      enabling    F    F        20    {_GONE}
unplug      moving      F    F        20    {_GONE}
replug      connecting  D    D        20    {PORT}: no such port; is the board plugged in\?
brown-out   connecting  DO   DO       20    {_SILENT}|connected to
brown-out   enabling    FO   F        20    {_NEW}|{_LOST}
brown-out   holding     F    F        20    {_NEW}|{_LOST}
brown-out   moving      F    F        20    {_NEW}|{_LOST}
brown-out   stopping    F    F        25    {_NEW}|{_LOST}
reset       connecting  O    O        20    connected to
reset       enabling    O    F        20    {_NEW}|{_ARDUINO}
reset       holding     F    F        20    {_NEW}|{_ARDUINO}
reset       moving      F    F        20    {_NEW}|{_ARDUINO}
reset       stopping    F    F        25    {_NEW}|{_ARDUINO}
frozen      enabling    O    O        20    {_GAP}
frozen      moving      H    H        20    {_GAP}
frozen      jogging     H    H        20    {_GAP}
suspended   holding     H    H        20    {_GAP}
client-lost enabling    O    O        20    stopped by laptop: its connection is gone
client-lost jogging     H    H        20    stopped by laptop: its connection is gone
arm-dead    enabling    D    D        20    {_FOUND}
arm-dead    moving      D    D        20    {_FOUND}
"""


def cells() -> Iterator[Any]:
    """All in a long run; else each fault in each of its phases on one of both ways, in turn, and on both."""
    rows = [row.split(maxsplit=5) for row in TABLE.strip().splitlines()[1:]]
    for _, one_fault in groupby(rows, lambda row: row[0]):
        found = list(one_fault)
        for number, (fault, phase, *states, step, words) in enumerate(found):
            most_us = math.inf if step == "-" else float(step)
            for place, (way, allowed) in enumerate(zip(WAYS, states, strict=True)):
                if LONG or len(found) == 1 or place == number % 2:
                    name = f"{fault}-{phase}-{way}"
                    yield pytest.param(fault, phase, way, allowed, most_us, words, id=name)


@pytest.mark.parametrize(("fault", "phase", "way", "allowed", "most_us", "told"), tuple(cells()))
def test_a_fault_in_a_phase(
    fault: str, phase: str, way: str, allowed: str, most_us: float, told: str, tmp_path: Path
) -> None:
    assert fault in FAULTS and phase in PHASES
    bench = HatBench(way, folder=tmp_path if fault == "arm-dead" else None)
    try:
        state, words = outcome(bench, fault, phase)
        assert state.name[0] in allowed, (state, words)
        assert re.search(told, words), words
        assert bench.largest_step <= most_us
    finally:
        bench.close()
