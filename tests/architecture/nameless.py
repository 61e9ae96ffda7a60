"""A board that somebody has not finished."""

from __future__ import annotations

from armctl.hardware import BoardType, ByteModel, Driver, Setup, SimulatorOptions
from armctl.hardware.transport import Connection


class Board(BoardType):
    """Says nothing of itself."""

    def driver(self, setup: Setup, connection: Connection) -> Driver:
        raise NotImplementedError

    def simulated(self, setup: Setup, options: SimulatorOptions) -> ByteModel:
        raise NotImplementedError
