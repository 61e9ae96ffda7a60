"""What the tests of the encoder board share."""

from __future__ import annotations

from typing import Literal

from tests.hardware.lines import LoopTransport

from armctl.hardware import ByteModel, ChannelSettings
from armctl.hardware.encoder.axes import AxisEntry, EncoderAxis, EncoderSettings
from armctl.hardware.encoder.driver import EncoderDriver
from armctl.hardware.encoder.simulated import SimulatedEncoderBoard
from armctl.hardware.encoder.simulated_axis import AxisPlant
from armctl.hardware.faults import FaultyModel
from armctl.hardware.transport import Connection
from armctl.protocol import ManualClock

PERIOD_S = 0.02


def encoder_axis(
    axis: int,
    home_toward: Literal[-1, 1] = 1,
    home_speed: float = 400.0,
    following_error: float = 600.0,
    **entry,
) -> EncoderAxis:
    """An axis with round numbers, which finds its switch at home_toward."""
    own = dict(
        home_order=axis + 1,
        p_percent=1.0,
        i_percent_s=1.0,
        d_percent=0.0,
        breakaway_percent=20.0,
        stall_s=0.3,
    )
    return EncoderAxis(AxisEntry(axis, **(own | entry)), home_toward, home_speed, following_error)


AXES = (
    encoder_axis(0, home_order=2),
    encoder_axis(1, home_order=7, home_toward=-1),
    encoder_axis(2, home_order=1),
)
CHANNELS = [
    ChannelSettings(0, -1000.0, 1000.0, speed=2000.0, acceleration=20000.0),
    ChannelSettings(1, -1000.5, 900.5, speed=1000.0, acceleration=10000.0),
    ChannelSettings(2, -500.0, 500.0, speed=1000.0, acceleration=10000.0),
]
PLANTS = {
    0: AxisPlant(start=-200.0),
    1: AxisPlant(switch=(-200.0, 0.0), start=100.0),
    2: AxisPlant(low=-700.0, high=700.0, start=50.0),
}


class DeafTo(SimulatedEncoderBoard):
    """Does not receive the bursts that contain ``lost``."""

    lost: bytes | None = None

    def feed(self, data: bytes) -> bytes:
        return b"" if self.lost is not None and self.lost in data else super().feed(data)


class Bench:
    """A driver over a line that can fail to a simulated board, on a clock of its own."""

    def __init__(self, clock: ManualClock, board: ByteModel | None = None, seed: int = 0, **options) -> None:
        self.clock = clock
        self.board = DeafTo(PLANTS) if board is None else board
        self.faults = FaultyModel(self.board, seed)
        settings = EncoderSettings(options.pop("axes", AXES))
        self.driver = EncoderDriver(Connection(self.open_line, clock.now, **options), settings)

    def open_line(self) -> LoopTransport:
        return LoopTransport(self.faults, self.clock.now, self.clock.advance)

    def connect(self) -> Bench:
        self.driver.open()
        self.driver.configure(CHANNELS)
        return self

    def wait(self, seconds: float):
        """A reading every 20 ms, as the runtime does. The last one, or the first with a fault."""
        return self.stream({}, seconds)

    def stream(self, setpoints: dict[int, float], seconds: float):
        """Write the same setpoints every 20 ms. The last reading, or the first with a fault."""
        readback = self.driver.read()
        for _ in range(round(seconds / PERIOD_S)):
            self.driver.write(setpoints)
            self.clock.advance(PERIOD_S)
            readback = self.driver.read()
            if readback.faults:
                break
        return readback

    def home(self):
        """Home every axis; the last reading."""
        self.driver.home()
        for _ in range(1000):
            self.clock.advance(PERIOD_S)
            readback = self.driver.read()
            assert not readback.errors and not readback.faults
            if readback.homing.done:
                return self.wait(0.1)
        raise AssertionError("homing does not end")

    def executed(self) -> list[str]:
        """The lines that the board took."""
        return list(self.board.log)
