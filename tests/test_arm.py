"""The library's way in, on the simulated board's real serial device."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import armctl
from armctl.errors import (
    InputError,
    MotionRefusedError,
    PortError,
    ProgramError,
    StateError,
    UnreachableError,
)
from armctl.hardware import Source
from armctl.program import GripperStep, MoveStep, PointStep, Program, WaitStep
from armctl.runtime import State


@pytest.fixture(scope="module")
def opened() -> Iterator[armctl.Arm]:
    with armctl.Arm.open("uzuner") as arm:
        yield arm


@pytest.fixture
def arm(opened: armctl.Arm) -> armctl.Arm:
    if opened.snapshot.state is State.OFF:
        opened.enable()
    opened.go_joints([0, 100, -80, -60, 0])
    return opened


def board_pulses(arm: armctl.Arm) -> list[float | None]:
    """What the board sends, once it has answered a readback that began after this call."""
    pause, asked = threading.Event(), arm.snapshot.tick + 3
    while arm.snapshot.tick < asked:
        pause.wait(0.005)
    assert arm.robot.output_map is not None and arm.snapshot.source is Source.TRANSMITTED
    outputs = arm.robot.output_map.outputs(arm.snapshot.q)
    return [outputs.get(channel) for channel in range(6)]


def test_go_puts_exactly_the_best_solutions_pulses_on_the_board(arm: armctl.Arm) -> None:
    arm.go(x_mm=200, y_mm=0, z_mm=100)
    np.testing.assert_allclose(arm.position_mm, [200, 0, 100], atol=1e-6)
    best = arm.robot.inverse([0.2, 0, 0.1]).best("least-rotation")
    assert arm.robot.output_map is not None
    expected = arm.robot.output_map.outputs(best)
    for channel, pulse in expected.items():
        assert board_pulses(arm)[channel] == pytest.approx(pulse, abs=0.126)


def test_go_takes_pitch_roll_and_criterion(arm: armctl.Arm) -> None:
    arm.go(x_mm=200, y_mm=50, z_mm=100, pitch_deg=-80, roll_deg=20, choose="least-torque")
    approach = arm.robot.forward(arm.snapshot.q_command)[:3, 2]
    assert np.degrees(np.arcsin(approach[2])) == pytest.approx(-80, abs=1e-6)
    assert arm.joints_deg[4] == pytest.approx(20)


def test_refusals_are_exceptions_and_move_nothing(arm: armctl.Arm) -> None:
    before = arm.joints_deg.copy()
    with pytest.raises(UnreachableError, match=r"too far by 200\.1 mm.*nearest reachable point"):
        arm.go(x_mm=300, y_mm=0, z_mm=600)
    with pytest.raises(MotionRefusedError, match=r"Elbow: -91\.00° is outside"):
        arm.go_joints([0, 100, -91, 0, 0])
    with pytest.raises(InputError, match="finite"):
        arm.go(x_mm=float("nan"), y_mm=0, z_mm=100)
    with pytest.raises(InputError, match="5 joint angles"):
        arm.go_joints([0, 1, 2])
    with pytest.raises(InputError, match="pose 'bed'"):
        arm.go_pose("bed")
    with pytest.raises(InputError, match="0 … 100 %"):
        arm.gripper(120)
    np.testing.assert_array_equal(arm.joints_deg, before)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda arm: arm.wait(None), "seconds must be numbers, got None"),
        (lambda arm: arm.wait("x"), "seconds must be numbers, got 'x'"),
        (lambda arm: arm.wait(float("nan")), "seconds must be a finite number"),
        (lambda arm: arm.go(10**400, 0, 100), "x_mm, y_mm, z_mm must be numbers"),
        (lambda arm: arm.go(200, 0, 100, pitch_deg="x"), "pitch_deg must be numbers"),
        (lambda arm: arm.go(200, 0, 100, pitch_deg=400), "a pitch lies within one turn.*which is 400°"),
        (lambda arm: arm.go(200, 0, 100, duration_s=[1]), "duration_s must be one number"),
        (lambda arm: arm.go(200, 0, 100, blend_mm=np.ones(2)), "blend_mm must be one number"),
        (lambda arm: arm.go_joints([0] * 5, duration_s="x"), "duration_s must be numbers"),
        (lambda arm: arm.go_pose("home", duration_s="x"), "duration_s must be numbers"),
        (lambda arm: arm.line("x", 0, 100), "x_mm, y_mm, z_mm must be numbers"),
        (lambda arm: arm.line(200, 0, 100, speed_mm_s="x"), "speed_mm_s must be numbers"),
        (lambda arm: arm.arc((1, 2), (3, 4, 5)), r"via_mm needs three numbers, x, y and z, got \(1, 2\)"),
        (lambda arm: arm.arc((1, 2, 3), "def"), "to_mm must be numbers, got 'def'"),
        (lambda arm: arm.gripper(np.array([5, 6])), "open_percent must be one number"),
        (lambda arm: arm.set_speed(None), "percent must be numbers"),
    ],
)
def test_what_is_no_number_is_refused_at_the_door(
    arm: armctl.Arm, call: Callable[[armctl.Arm], None], says: str
) -> None:
    with pytest.raises(InputError, match=says):
        call(arm)
    assert arm.snapshot.state is State.HOLDING


def test_programs_run_from_values_and_files(arm: armctl.Arm, tmp_path: object) -> None:
    steps = (
        MoveStep(joints_deg=(5.0, 95.0, -75.0, -55.0, 5.0)),
        GripperStep(open_percent=50),
        PointStep(x_mm=180, y_mm=60, z_mm=140),
    )
    arm.run(Program(robot="uzuner", name="three", steps=steps), loops=2)
    np.testing.assert_allclose(arm.position_mm, [180, 60, 140], atol=1e-6)
    assert arm.snapshot.gripper == 0.5
    with pytest.raises(ProgramError, match=r"none\.toml"):
        arm.run("none.toml")


@pytest.mark.parametrize("loops", [float("nan"), 1.5, "x", 0, -1])
def test_a_program_runs_a_whole_number_of_times(arm: armctl.Arm, loops: object) -> None:
    wait = Program(robot="uzuner", name="wait", steps=(WaitStep(seconds=0),))
    with pytest.raises(InputError, match=r"how often a program runs must be|runs once or more often"):
        arm.run(wait, loops=loops)  # type: ignore[arg-type]
    assert arm.snapshot.state is State.HOLDING


def test_a_program_that_no_file_could_hold_is_refused_before_it_runs(arm: armctl.Arm) -> None:
    program = Program(robot="uzuner", name="odd", steps=(WaitStep(seconds=None),))  # type: ignore[arg-type]
    with pytest.raises(ProgramError, match=r"^odd: step 1, key seconds: must be a number, not None"):
        arm.run(program)
    assert arm.snapshot.state is State.HOLDING


def test_stop_from_another_thread_ends_an_endless_program(arm: armctl.Arm) -> None:
    steps = tuple(MoveStep(joints_deg=(base, 90.0, -70.0, -40.0, 0.0)) for base in (30.0, -30.0))
    ended: list[BaseException] = []

    def run() -> None:
        try:
            arm.run(Program(robot="uzuner", name="swing", steps=steps), loops=None)
        except StateError as stopped:
            ended.append(stopped)

    thread, pause = threading.Thread(target=run), threading.Event()
    thread.start()
    while arm.snapshot.state is not State.MOVING and thread.is_alive():
        pause.wait(0.002)
    arm.stop()
    thread.join(10)
    assert not thread.is_alive()
    assert "stopped by library" in str(ended[0])
    assert arm.snapshot.state is State.HOLDING
    low, high = arm.robot.limits.T
    assert (arm.snapshot.q_command >= low).all() and (arm.snapshot.q_command <= high).all()


def test_an_interrupt_while_an_arm_homes_stops_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C in ``armctl run``, and in a script."""
    result, interrupted = armctl.runtime.Ticket.result, []

    def once(ticket: armctl.runtime.Ticket, timeout: float | None = None) -> None:
        if not interrupted:
            interrupted.append(ticket)
            ticket.accepted.result(5.0)
            raise KeyboardInterrupt
        result(ticket, timeout)

    with armctl.Arm.open("scorbot") as arm:
        monkeypatch.setattr(armctl.runtime.Ticket, "result", once)
        with pytest.raises(KeyboardInterrupt):
            arm.enable()
        assert arm.snapshot.state.value == "off"
        assert "stopped by library" in arm.snapshot.cause
        assert not any(axis.running for axis in arm.snapshot.homing)


def test_release_switches_the_pulses_off(arm: armctl.Arm) -> None:
    arm.release()
    assert arm.snapshot.state is State.OFF
    assert all(pulse is None or np.isnan(pulse) for pulse in board_pulses(arm))
    with pytest.raises(StateError):
        arm.go_pose("home")


def test_a_port_that_is_not_there_is_refused_in_words() -> None:
    with pytest.raises(PortError, match="/dev/there_is_none"):
        armctl.Arm.open("uzuner", port="/dev/there_is_none")
    for port in ("", "a\0b"):  # the first is what an environment variable without a value leaves
        with pytest.raises(PortError, match="no such port"):
            armctl.Arm.open("uzuner", port=port)


def test_the_package_exports_what_the_readme_uses() -> None:
    assert {"Arm", "load_robot", "ArmctlError", "shipped_robots"} <= set(armctl.__all__)
    with pytest.raises(AttributeError, match="nonsense"):
        armctl.nonsense  # noqa: B018


URDF = """<robot name="bench_arm">
  <link name="base"/><link name="tower"/><link name="upper"/>
  <link name="fore"/><link name="hand"/><link name="tool0"/>
  <joint name="turn" type="continuous"><parent link="base"/><child link="tower"/><axis xyz="0 0 1"/></joint>
  <joint name="lift" type="revolute"><parent link="tower"/><child link="upper"/><origin xyz="0 0 0.1"/>
    <axis xyz="0 -1 0"/><limit lower="-0.5" upper="2" velocity="2" effort="3"/></joint>
  <joint name="bend" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.2 0 0"/>
    <axis xyz="0 -1 0"/><limit lower="-2" upper="2" velocity="2" effort="3"/></joint>
  <joint name="swing" type="revolute"><parent link="fore"/><child link="hand"/><origin xyz="0.15 0.02 0"/>
    <axis xyz="0 0.6 0.8"/><limit lower="-1" upper="1" velocity="2" effort="3"/></joint>
  <joint name="end" type="fixed"><parent link="hand"/><child link="tool0"/><origin xyz="0.05 0 0.01"/></joint>
</robot>
"""


def test_an_arm_from_a_urdf_goes_to_a_point_on_the_simulated_board(tmp_path: Path) -> None:
    """No family, no servos: the numeric solver and a stand-in map."""
    file = tmp_path / "bench.urdf"
    file.write_text(URDF)
    with armctl.Arm.open(file) as arm:
        arm.enable()
        target = 1000 * arm.robot.forward([0.3, 0.8, -0.9, 0.2])[:3, 3]
        arm.go(x_mm=target[0], y_mm=target[1], z_mm=target[2])
        np.testing.assert_allclose(arm.position_mm, target, atol=1e-6)


def test_a_real_board_is_not_driven_for_an_arm_without_servos(tmp_path: Path) -> None:
    file = tmp_path / "bench.urdf"
    file.write_text(URDF)
    with pytest.raises(PortError, match=r"/dev/ttyACM0 is not opened: the robot file of .* gives no servos"):
        armctl.Arm.open(file, port="/dev/ttyACM0")
