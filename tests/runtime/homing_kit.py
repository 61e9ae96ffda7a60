"""A board with encoders for the runtime's tests: it finds zeros when a test says so."""

from __future__ import annotations

from tests.runtime.kit import RecordingDriver, Rig, make_rig

from armctl.errors import StateError
from armctl.hardware import HomingState, Readback, Source
from armctl.robot import Robot, load_robot
from armctl.runtime import Connect, HomeAxes

SCORBOT = load_robot("scorbot")
AXES = range(6)


class HomingDriver(RecordingDriver):
    """A board with encoders: nobody knows where an axis is before it was homed."""

    def __init__(self, clock) -> None:
        super().__init__(clock)
        self.source = Source.MEASURED
        self.homed = dict.fromkeys(AXES, False)
        self.running: int | None = None
        self.on = False
        self.faults: dict[int, str] = {}
        self.counts = dict.fromkeys(AXES, 0.0)

    def write(self, setpoints) -> None:
        if self.running is not None:
            raise StateError("the board is homing; wait until it is done, or stop it")
        if self.faults:
            return  # lost on the way: the board takes no setpoint while a fault is latched
        super().write(setpoints)
        self.on = True
        self.counts.update(setpoints)

    def read(self) -> Readback:
        self._call("read")
        positions = {axis: self.counts[axis] if homed else None for axis, homed in self.homed.items()}
        homing = HomingState(dict(self.homed), self.running)
        return Readback(positions, self.source, self.errors, self.on, dict(self.faults), homing)

    def home(self) -> None:
        self._call("home")
        self.homed = dict.fromkeys(AXES, False)
        self.running = 5
        self.on = True

    def stop(self) -> None:
        super().stop()
        self.running = None

    def release(self) -> None:
        super().release()
        self.on = False
        self.faults.clear()

    def find(self, *axes: int, then: int | None) -> None:
        self.homed.update(dict.fromkeys(axes, True))
        self.running = then

    def trip(self, axis: int, words: str) -> None:
        self.faults[axis] = words
        self.on = False
        self.running = None


def make_homing_rig(robot: Robot = SCORBOT) -> Rig:
    """Connected, and not homed."""
    rig = make_rig(robot=robot)
    driver = HomingDriver(rig.clock)
    rig.driver = driver
    rig.controller._core._open_driver = lambda _: driver
    rig.do(Connect("sim")).finished.result(0)
    return rig


def home(rig: Rig) -> None:
    """Let homing run through."""
    ticket = rig.do(HomeAxes())
    rig.run(0.4)
    rig.driver.find(*AXES, then=None)
    rig.run(0.1)
    ticket.finished.result(0)
