"""armctl's own driver against the real encoder firmware with an arm on its pins."""

from __future__ import annotations

import pytest
from tests.avr.conftest import MakeArm
from tests.avr.encoder_arm import EncoderArm
from tests.avr.serve import stepped_line

from armctl.errors import StateError
from armctl.hardware import ChannelSettings, Readback
from armctl.hardware.encoder.axes import AxisEntry, EncoderAxis, EncoderSettings
from armctl.hardware.encoder.driver import EncoderDriver
from armctl.hardware.transport import Connection

PERIOD_S = 0.02
AXES = tuple(
    EncoderAxis(
        AxisEntry(
            axis,
            order,
            home_by="switch" if axis < 5 else "stall",
            p_percent=100000 / 65280,
            i_percent_s=100000 / 65280,
            d_percent=1300 / 65280,
            breakaway_percent=20000 / 255,
            stall_s=0.3,
        ),
        home_toward=1 if axis < 5 else -1,
        home_speed=800.0,
        following_error=600.0,
    )
    for axis, order in ((0, 6), (1, 2), (2, 3), (3, 4), (4, 5), (5, 1))
)
CHANNELS = tuple(
    ChannelSettings(axis, minimum, maximum, speed=2000.0, acceleration=10_000.0)
    for axis, (minimum, maximum) in enumerate(
        (
            (-2000.0, 2000.0),
            (-2000.0, 2000.0),
            (-2000.0, 2000.0),
            (-1500.0, 1500.0),
            (-1500.0, 1500.0),
            (0.0, 1600.0),
        )
    )
)


class Session:
    """The driver in the time of the simulated CPU."""

    def __init__(self, arm: EncoderArm) -> None:
        self.avr = arm.avr
        self.driver = EncoderDriver(
            Connection(stepped_line(arm.avr), lambda: arm.avr.now), EncoderSettings(AXES, (3, 4))
        )
        self.identity = self.driver.open()
        self.driver.configure(CHANNELS)

    def wait(self, seconds: float) -> Readback:
        readback = self.driver.read()
        for _ in range(round(seconds / PERIOD_S)):
            self.avr.run_for(PERIOD_S)
            readback = self.driver.read()
        return readback

    def home(self) -> Readback:
        self.driver.home()
        for _ in range(3000):
            self.avr.run_for(PERIOD_S)
            readback = self.driver.read()
            assert not readback.errors and not readback.faults, readback
            if readback.homing is not None and readback.homing.done:
                return self.wait(0.5)
        raise AssertionError("homing does not end")

    def move(self, goals: dict[int, float], seconds: float) -> Readback:
        begin = self.driver.read().positions
        readback = self.driver.read()
        steps = round(seconds / PERIOD_S)
        for step in range(1, steps + 1):
            share = (step / steps) ** 2 * (3 - 2 * step / steps)
            self.driver.write(
                {axis: begin[axis] + share * (goal - begin[axis]) for axis, goal in goals.items()}
            )
            readback = self.driver.read()
            self.avr.run_for(PERIOD_S)
            if readback.errors or readback.faults:
                return readback
        return readback


@pytest.fixture
def session(make_arm: MakeArm) -> Session:
    return Session(make_arm())


def test_a_session(session: Session) -> None:
    assert session.identity.kind.startswith("armctl encoder board, firmware ")
    with pytest.raises(StateError, match="home first"):
        session.driver.write({0: 0.0})
    readback = session.home()
    assert all(abs(position) <= 1 for position in readback.positions.values())

    goals = {0: 600.0, 1: -400.0, 2: 500.0, 3: 300.0, 4: -300.0, 5: 400.0}
    readback = session.move(goals, 2.0)
    assert (readback.errors, readback.faults) == ((), {})
    readback = session.wait(0.4)
    assert all(abs(readback.positions[axis] - goal) <= 1 for axis, goal in goals.items())
    assert readback.powered is True

    session.driver.stop()
    assert session.wait(1.0).powered is True, "read alone keeps the watchdog quiet"
    readback = session.move({0: 500.0}, 1.0)
    assert (readback.errors, session.wait(0.4).positions[0]) == ((), pytest.approx(500.0, abs=1.0))

    session.driver.release()
    assert session.wait(0.1).powered is False
    assert session.move({0: 550.0}, 1.0).errors == ()
    assert session.wait(0.4).positions[0] == pytest.approx(550.0, abs=1.0)


def test_a_board_that_has_started_anew_must_be_homed(session: Session) -> None:
    session.home()
    session.avr.reset()
    session.avr.run_for(0.06)
    readback = session.driver.read()
    assert "the board has started anew" in readback.errors[0]
    assert readback.powered is False
    assert set(readback.positions.values()) == {None}
    with pytest.raises(StateError, match="by itself"):
        session.driver.write({0: 0.0})
    session.home()
    assert session.move({0: 100.0}, 0.5).errors == ()


def test_a_blocked_joint_is_told(make_arm: MakeArm) -> None:
    arm = make_arm()
    session = Session(arm)
    session.home()
    session.move({1: 200.0}, 0.5)
    arm.plant.axes[1].blocked = 1
    session.move({1: 900.0}, 2.0)
    readback = session.wait(0.06)  # a setpoint may be refused before the next status says why
    assert readback.faults.keys() == {1}
    assert readback.powered is False
    with pytest.raises(StateError, match="by itself"):
        session.driver.write({1: 200.0})
    arm.plant.axes[1].blocked = 0
    session.driver.release()
    readback = session.move({1: 300.0}, 1.0)
    assert (readback.errors, readback.faults) == ((), {})
