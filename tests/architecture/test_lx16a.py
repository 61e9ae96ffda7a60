"""A board that armctl does not know, from a package under ``examples``, drives an arm end to end."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import lewanlib
import pytest
from tests.architecture.toy_board import installed
from tests.hardware.lines import LoopTransport

import armctl
from armctl.errors import BoardTimeoutError, EnableError
from armctl.hardware import Setup
from armctl.hardware.boards import board_type, channel_settings
from armctl.hardware.simulation import BoardServer
from armctl.hardware.transport import Connection
from armctl.protocol import ManualClock, MonotonicClock

FOLDER = Path(__file__).parents[2] / "examples" / "boards" / "lx16a"
ARM = FOLDER / "lx16a_arm.toml"


@pytest.fixture
def board(tmp_path: Path) -> Iterator[object]:
    with installed(tmp_path, FOLDER / "armctl_lx16a.py", "lx16a = toyboard:Lx16aBoard"):
        yield board_type("lx16a")


class Chain:
    """The servos of the example's arm, and their driver."""

    def __init__(self, clock: ManualClock) -> None:
        self.robot, kind = armctl.load_robot(ARM), board_type("lx16a")
        self.setup = Setup(channel_settings(self.robot))
        self.model = kind.simulated(self.setup, {})
        self.clock = clock
        line = LoopTransport(self.model, clock.now, clock.advance)
        self.driver = kind.driver(self.setup, Connection(lambda: line, clock.now))
        self.driver.open()
        self.driver.configure(self.setup.channels)

    @property
    def servos(self) -> dict:
        return vars(self.model)["servos"]

    def places(self) -> dict[int, float]:
        self.driver.read()
        found = self.driver.read().positions
        return {servo: float(place) for servo, place in found.items() if place is not None}

    def run(self, goals: dict[int, float], ticks: int) -> None:
        start = self.places()
        for k in range(1, ticks + 1):
            self.driver.write({s: start[s] + (goals[s] - start[s]) * k / ticks for s in goals})
            self.clock.advance(0.02)


@pytest.fixture
def chain(board: object) -> Chain:
    return Chain(ManualClock(50.0))


def test_the_bytes_are_those_that_the_manual_prints(board: object) -> None:
    from toyboard import MOVE, packet, packets  # type: ignore[import-not-found]

    moved = packet(1, MOVE, bytes.fromhex("f401e803"))
    assert moved == bytes.fromhex("55 55 01 07 01 f4 01 e8 03 16")
    assert packets(b"\x55" + moved + moved[:-1]) == [(1, 1, bytes.fromhex("f401e803"))]


def test_torque_comes_on_where_each_servo_stands(chain: Chain) -> None:
    chain.servos[5].position, chain.servos[5].goal = 333.0, 900.0
    chain.driver.write(chain.places())
    chain.clock.advance(1.0)
    assert chain.places()[5] == 333.0
    assert all(one.on for one in chain.servos.values())


def test_a_servo_that_was_turned_meanwhile_or_stands_outside_stays_limp(chain: Chain) -> None:
    places = chain.places()
    chain.servos[4].position += 20
    with pytest.raises(EnableError, match="servo 4 has turned"):
        chain.driver.write(places)
    assert not any(one.on for one in chain.servos.values())
    chain.servos[4].position = -30.0
    places = chain.places() | {4: 40.0}
    with pytest.raises(EnableError, match="outside 0"):
        chain.driver.write(places)


def test_it_follows_a_stream_and_lets_one_joint_go(chain: Chain) -> None:
    chain.driver.write(chain.places())
    chain.run({6: 600.0, 3: 400.0}, 50)
    assert chain.places()[6] == pytest.approx(600, abs=4)
    chain.driver.release_channels([3])
    assert not chain.servos[3].on and chain.servos[6].on


def test_a_servo_that_started_anew_gets_no_goal(chain: Chain) -> None:
    chain.driver.write(chain.places())
    chain.servos[6].on = False
    chain.run({6: 600.0}, 20)
    assert not chain.servos[6].on


def test_a_dead_line_is_told(chain: Chain) -> None:
    chain.servos.clear()
    with pytest.raises(BoardTimeoutError, match="none of the servos"):
        chain.driver.read()


def test_the_library_drives_the_arm(board: object) -> None:
    with armctl.Arm.open(ARM) as arm:
        arm.enable()
        arm.go(x_mm=150, y_mm=40, z_mm=120)
        assert arm.snapshot.board is not None and "LX-16A" in arm.snapshot.board.kind
        assert arm.snapshot.quantities["Base"].voltage_v == pytest.approx(7.4)


def test_somebody_else_s_client_reads_moves_and_lets_go(board: object) -> None:
    robot = armctl.load_robot(ARM)
    model = board_type("lx16a").simulated(Setup(channel_settings(robot)), {})
    with (
        BoardServer(model, MonotonicClock().now) as server,
        lewanlib.ServoBus(server.port, timeout=2.0, discard_echo=False, on_exit_power_off=False) as bus,
    ):
        assert bus.pos_read(6) == pytest.approx(120.0)  # 500 steps of 0.24°
        assert bus.vin_read(5) == pytest.approx(7.4)
        assert not bus.is_powered(6)
        bus.move_time_write(6, 144.0, 0.0)
        assert bus.is_powered(6)
        with server.inspect() as servos:
            assert servos.servos[6].goal == 600.0
        bus.set_powered(6, False)
        assert not bus.is_powered(6)
