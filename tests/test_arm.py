"""The library's way in, on the simulated board's real serial device."""

from __future__ import annotations

import asyncio
import pickle
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.arms import BENCH_URDF, quick_robot
from tests.browser.serving import serving
from tests.robot.panda_kit import panda_file
from tests.runtime.kit import ROBOT, RecordingDriver

import armctl
from armctl.boards import Boards
from armctl.errors import (
    BoardError,
    EnableError,
    InputError,
    MotionRefusedError,
    PortError,
    ProgramError,
    StateError,
    UnreachableError,
)
from armctl.facts import State
from armctl.handles import Motion
from armctl.hardware import BoardIdentity, Source
from armctl.kinematics import quaternion_wxyz, roll_pitch_yaw, rotation_from_rpy
from armctl.kinematics.angles import rotation_angle
from armctl.motion import PointToPoint, Sample, plan_joints
from armctl.process.records import commands as known_commands
from armctl.program import (
    FrameStep,
    GripperStep,
    MessageStep,
    MoveStep,
    PickStep,
    PlaceStep,
    PointStep,
    Program,
    UserFrame,
    WaitStep,
)
from armctl.protocol import (
    Command,
    Connect,
    LastPose,
    ManualClock,
    Message,
    MonotonicClock,
    Origin,
    Snapshot,
    Ticket,
    commands,
)
from armctl.runtime import Controller, PoseFolder

MY_ARM = Path(__file__).parents[1] / "examples" / "my_arm.toml"


@contextmanager
def arm_by(way: str, folder: Path) -> Iterator[armctl.Arm]:
    """An arm of this program's own, or that of ``armctl serve`` over its WebSocket."""
    robot = quick_robot(folder)
    if way == "open":
        with armctl.Arm.open(robot) as arm:
            yield arm
    else:
        words = ("--port", "sim", "--robot", str(robot))
        with serving(folder, *words) as link, armctl.Arm.connect(link) as arm:
            yield arm


@pytest.fixture(scope="module", params=["open", "connect"])
def way(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def opened(way: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[armctl.Arm]:
    with arm_by(way, tmp_path_factory.mktemp(way)) as arm:
        yield arm


@pytest.fixture
def arm(opened: armctl.Arm) -> armctl.Arm:
    if opened.snapshot.state is State.OFF:
        opened.enable()
    opened.go_joints([0, 100, -80, -60, 0])
    return opened


@pytest.fixture
def own_board(way: str, tmp_path: Path) -> Iterator[armctl.Arm]:
    """An arm of its own, for what breaks it."""
    with arm_by(way, tmp_path) as arm:
        yield arm


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
    with pytest.raises(UnreachableError, match=r"too far by 200\.0 mm.*nearest reachable point"):
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
        (lambda arm: arm.gripper(5, part_mm=(20, 30)), "part_mm must be three edges in mm"),
        (lambda arm: arm.gripper(5, part_mm=(20, 0, 5)), "the edge along y of the tool, 0 mm is outside"),
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
    result, interrupted = armctl.protocol.Ticket.result, []

    def once(ticket: armctl.protocol.Ticket, timeout: float | None = None) -> None:
        if not interrupted:
            interrupted.append(ticket)
            ticket.accepted.result(5.0)
            raise KeyboardInterrupt
        result(ticket, timeout)

    with armctl.Arm.open("scorbot") as arm:
        monkeypatch.setattr(armctl.protocol.Ticket, "result", once)
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


def test_an_arm_from_a_urdf_goes_to_a_point_on_the_simulated_board(tmp_path: Path) -> None:
    """No family, no servos: the numeric solver and a stand-in map."""
    file = tmp_path / "bench.urdf"
    file.write_text(BENCH_URDF)
    with armctl.Arm.open(file) as arm:
        arm.enable()
        target = 1000 * arm.robot.forward([0.3, 0.8, -0.9, 0.2])[:3, 3]
        arm.go(x_mm=target[0], y_mm=target[1], z_mm=target[2])
        np.testing.assert_allclose(arm.position_mm, target, atol=1e-6)


@pytest.mark.parametrize("kind", ["maestro", "firmata", "encoder"])
def test_a_gripper_without_an_output_moves_on_the_simulated_board(tmp_path: Path, kind: str) -> None:
    arm_only = "\n".join(line for line in MY_ARM.read_text().splitlines() if not line.startswith("servo ="))
    file = tmp_path / "my_arm.toml"
    gripper = '[gripper]\ntitle = "Hand"\nspeed_percent_s = 200\n'
    file.write_text(f'{arm_only}\n{gripper}\n[board]\nkind = "{kind}"\n')
    with armctl.Arm.open(file) as arm:
        arm.enable()
        arm.gripper(80)
        assert arm.snapshot.gripper == pytest.approx(0.8, abs=0.01)


def test_an_arm_of_seven_joints_goes_with_a_whole_orientation(tmp_path: Path) -> None:
    with armctl.Arm.open(panda_file(tmp_path)) as arm:
        arm.enable("rest")
        turned = arm.robot.forward(arm.robot.pose("home"))
        x, y, z = 1000 * turned[:3, 3]
        arm.go(x, y, z, rpy_deg=np.degrees(roll_pitch_yaw(turned[:3, :3])).tolist())
        assert arm.position_mm == pytest.approx([x, y, z], abs=1e-6)
        assert tool_turn(arm, turned) < 1e-6
        arm.go(x, y, z - 30, orientation="kept", choose="least-travel")
        assert arm.position_mm == pytest.approx([x, y, z - 30], abs=1e-6)
        assert tool_turn(arm, turned) < 1e-6
        other = turned[:3, :3] @ rotation_from_rpy(0.2, 0.0, 0.3)
        arm.go(x, y, z, quaternion_wxyz=(3 * quaternion_wxyz(other)).tolist(), choose="least-travel")
        assert tool_turn(arm, other) < 1e-6
        for words, says in (
            ({"rpy_deg": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}, "not as both"),
            ({"rpy_deg": [0, 0, 0], "orientation": "kept"}, "leave rpy_deg"),
            ({"rpy_deg": [0, 0]}, "roll, pitch and yaw"),
            ({"quaternion_wxyz": [0, 0, 0, 0]}, "length 0"),
            ({"quaternion_wxyz": [1, 0, 0, float("nan")]}, "finite"),
            ({"orientation": "free"}, "'kept' or left out, not 'free'"),
            ({"orientation": "kept", "pitch_deg": 3}, "not both"),
        ):
            with pytest.raises(InputError, match=says):
                arm.go(x, y, z, **words)  # type: ignore[arg-type]
        arm.jog_tool(rz_deg_s=10, frame="tool")


def tool_turn(arm: armctl.Arm, pose: np.ndarray) -> float:
    """By how much the tool is turned away from a pose [rad]."""
    now = arm.robot.forward(np.radians(arm.joints_deg))
    return float(rotation_angle(now[:3, :3].T @ pose[:3, :3]))


def test_an_orientation_that_the_arm_cannot_take_is_refused_with_the_angle(arm: armctl.Arm) -> None:
    with pytest.raises(UnreachableError, match=r"not in that orientation: .* \d+(\.\d+)?° off"):
        arm.go(200, 0, 100, rpy_deg=[90, 0, 0])
    with pytest.raises(InputError, match="cannot turn about any axis"):
        arm.jog_tool(rx_deg_s=5)


def test_a_real_board_is_not_driven_for_an_arm_without_servos(tmp_path: Path) -> None:
    file = tmp_path / "bench.urdf"
    file.write_text(BENCH_URDF)
    with pytest.raises(PortError, match=r"/dev/ttyACM0 is not opened: .* its file gives no servos"):
        armctl.Arm.open(file, port="/dev/ttyACM0")
    with pytest.raises(
        PortError, match="UR5 is simulated only: armctl does not speak to its controller; use"
    ):
        armctl.Arm.open("ur5", port="/dev/ttyACM0")


# Motions that do not block.

AWAY = [40, 100, -80, -60, 0]


def until(condition: Callable[[], bool]) -> None:
    pause = threading.Event()
    for _ in range(4000):
        if condition():
            return
        pause.wait(0.005)
    raise AssertionError("not in time")


def test_a_motion_that_is_not_waited_for_gives_a_handle(arm: armctl.Arm) -> None:
    nothing = Program(robot="uzuner", steps=(WaitStep(seconds=0.3),))
    begins: list[Callable[[], Motion]] = [
        lambda: arm.go_joints([3, 100, -80, -60, 0], wait=False),
        lambda: arm.go(210, 5, 110, wait=False),
        lambda: arm.line(205, 10, 115, pitch="free", wait=False),
        lambda: arm.arc((205, 15, 115), (205, 20, 110), pitch="free", wait=False),
        lambda: arm.follow(Sway(np.radians(arm.joints_deg), 0.01), wait=False),
        lambda: arm.wait(0.3, wait=False),
        lambda: arm.run(nothing, wait=False),
        lambda: arm.gripper(40, wait=False),
        lambda: arm.go_pose("home", wait=False),
    ]
    for begin in begins:
        motion = begin()
        assert not motion.done
        assert motion.progress is None or 0.0 <= motion.progress < 1.0
        motion.result(20.0)
        assert motion.done
        assert motion.progress == 1.0
        motion.cancel()  # over already
        motion.result(0)


def test_a_part_between_the_jaws_counts_until_the_gripper_is_told_to_move_again(arm: armctl.Arm) -> None:
    arm.go(200, 0, 60, pitch_deg=-90)
    arm.gripper(30, part_mm=[30, 30, 30])
    assert arm.snapshot.part_mm == (30.0, 30.0, 30.0)
    with pytest.raises(MotionRefusedError, match=r"the carried part: at .* below the floor"):
        arm.go(200, 0, 12, pitch_deg=-90)
    with pytest.raises(ProgramError, match=r"the carried part: at .* below the floor"):
        arm.line(200, 0, 12)
    arm.gripper(80)
    assert arm.snapshot.part_mm is None
    arm.go(200, 0, 12, pitch_deg=-90)


def test_progress_grows_and_cancel_stops_this_motion_alone(arm: armctl.Arm) -> None:
    motion, shown = arm.go_joints(AWAY, duration_s=1.0, wait=False), list[float]()
    gripper = arm.gripper(90, wait=False)
    assert gripper.progress in (0.0, None)
    until(lambda: shown.append(motion.progress) or shown[-1] > 0.3)  # type: ignore[func-returns-value]
    assert shown == sorted(shown)
    motion.cancel()
    assert arm.snapshot.state is State.HOLDING
    assert 5.0 < arm.joints_deg[0] < 35.0
    with pytest.raises(StateError, match="stopped by library"):
        motion.result()
    assert motion.progress is None
    gripper.result(10.0)
    with pytest.raises(TimeoutError):
        arm.go_joints(AWAY, duration_s=2.0, wait=False).result(0.05)
    arm.stop()


def test_a_motion_that_is_refused_says_so_when_it_is_asked(arm: armctl.Arm) -> None:
    motion = arm.go(x_mm=300, y_mm=0, z_mm=600, wait=False)
    with pytest.raises(UnreachableError, match="too far"):
        motion.result(10.0)
    with pytest.raises(InputError, match="finite"):
        arm.go(x_mm=float("nan"), y_mm=0, z_mm=600, wait=False)


def test_a_motion_can_be_awaited(arm: armctl.Arm) -> None:
    async def there_and_stopped() -> None:
        await arm.go_joints([4, 100, -80, -60, 0], wait=False)
        back = arm.go_joints([0, 100, -80, -60, 0], duration_s=2.0, wait=False)
        waiting = asyncio.ensure_future(asyncio.wait_for(back, 0.05))
        with pytest.raises(TimeoutError):
            await waiting
        assert not back.done  # who no longer waits does not stop it
        back.cancel()

    asyncio.run(there_and_stopped())


def test_pause_and_resume(arm: armctl.Arm) -> None:
    motion = arm.go_joints(AWAY, duration_s=1.0, wait=False)
    until(lambda: (motion.progress or 0.0) > 0.1)
    arm.pause()
    until(lambda: arm.snapshot.state is State.PAUSED)
    arm.resume()
    motion.result(10.0)
    assert arm.joints_deg.tolist() == pytest.approx(AWAY)


# A criterion, and a trajectory, of the caller's own.


def test_a_criterion_of_ones_own_decides_what_is_sent(arm: armctl.Arm) -> None:
    start, asked = np.radians(arm.joints_deg), list[tuple[int, ...]]()

    def straightest(q: np.ndarray, begin: np.ndarray | None) -> np.ndarray:
        np.testing.assert_allclose(begin, start)
        asked.append(q.shape)
        return np.where(q[:, 1] < 1.0, np.abs(q[:, 2]), np.inf)

    arm.go(200, 30, 100, roll_deg=0, choose=straightest)
    found = arm.robot.inverse([0.2, 0.03, 0.1], roll=0.0)
    admitted = found.q[found.q[:, 1] < 1.0]
    best = admitted[np.abs(admitted[:, 2]).argmin()]
    np.testing.assert_allclose(arm.joints_deg, np.degrees(best), atol=1e-9)
    assert asked == [found.q.shape]
    with pytest.raises(UnreachableError, match="too far"):
        arm.go(300, 0, 600, choose=straightest)
    with pytest.raises(ZeroDivisionError):
        arm.go(200, 0, 100, choose=lambda q, _: q[:, 0] / 0 if False else 1 / 0)
    for wrong in (None, 5):
        with pytest.raises(InputError, match=f"no criterion {wrong}"):
            arm.go(200, 0, 100, choose=wrong)  # type: ignore[arg-type]


class Sway:
    """There and back, by a law of its own; ``breaks`` in the middle."""

    def __init__(self, q: np.ndarray, size: float, breaks: BaseException | None = None) -> None:
        self.duration, self.start, self.end = 1.0, q, q
        self._size, self._breaks = size, breaks

    def sample(self, t: float | np.ndarray) -> Sample:
        if self._breaks is not None:
            raise self._breaks
        w, one = 2 * np.pi, self._size * np.eye(5)[0]
        x = w * np.clip(np.asarray(t), 0.0, 1.0)[..., None]
        rise, fall = w * np.sin(x), w**2 * np.cos(x)
        return Sample(self.start + (1 - np.cos(x)) * one, rise * one, fall * one, -(w**2) * rise * one)


def test_a_trajectory_is_followed_and_a_broken_one_only_refused(arm: armctl.Arm) -> None:
    trajectory = plan_joints(arm.robot, np.radians(arm.joints_deg), np.radians([3, 100, -80, -60, 0]))
    arm.follow(trajectory)
    assert arm.joints_deg[0] == pytest.approx(3)
    with pytest.raises(StateError, match="go to its start first"):
        arm.follow(trajectory)
    for broken in (SystemExit(3), ZeroDivisionError("division")):
        with pytest.raises(InputError, match=f"cannot be sampled: {type(broken).__name__}"):
            arm.follow(Sway(np.radians(arm.joints_deg), 0.01, broken))
    with pytest.raises(MotionRefusedError, match="Base: at"):
        arm.follow(Sway(np.radians(arm.joints_deg), 2.0))
    assert arm.snapshot.state is State.HOLDING


# What counts for a moment.


def test_a_stream_is_followed_to_its_last_setpoint(arm: armctl.Arm) -> None:
    pace, goal = threading.Event(), np.array([15, 105, -80, -60, 0])
    with arm.stream() as stream:
        for share in np.linspace(0.0, 1.0, 20):
            stream.send((1 - share) * np.array([0, 100, -80, -60, 0]) + share * goal)
            pace.wait(0.01)
    np.testing.assert_allclose(arm.joints_deg, goal)
    assert arm.snapshot.state is State.HOLDING
    with arm.stream():
        pass  # nothing was sent, nothing happens


def test_stop_and_what_is_refused_end_a_stream(arm: armctl.Arm) -> None:
    pace = threading.Event()
    with pytest.raises(StateError, match="the setpoint stream is over"), arm.stream() as stream:
        stream.send(AWAY)
        until(lambda: arm.snapshot.state is State.MOVING)
        arm.stop()
        for _ in range(100):
            stream.send(AWAY)
            pace.wait(0.005)
    assert arm.snapshot.state is State.HOLDING
    with pytest.raises(MotionRefusedError, match="Base: 200"), arm.stream() as stream:
        stream.send(AWAY)
        stream.send([200, 100, -80, -60, 0])
    assert arm.snapshot.state is State.HOLDING
    assert arm.joints_deg[0] < 39.0  # stopped, not gone on to the last good one
    with pytest.raises(InputError, match="5 joint angles"), arm.stream() as stream:
        stream.send([1, 2])
    arm.release()
    with pytest.raises(StateError, match="needs the arm holding"), arm.stream() as stream:
        stream.send(AWAY)


def test_jogs_and_a_live_target_move_the_arm_for_a_moment(arm: armctl.Arm) -> None:
    for jog in (
        lambda: arm.jog([50, 0, 0, 0, 0]),
        lambda: arm.jog_tool(y_mm_s=50),
        lambda: arm.follow_target(190, 60, 120),
    ):
        before = arm.joints_deg
        jog()
        until(lambda before=before: bool((arm.joints_deg != before).any()))
        until(lambda: arm.snapshot.state is State.HOLDING)
    with pytest.raises(InputError, match="between -1 and 1"):
        arm.jog([500, 0, 0, 0, 0])
    with pytest.raises(InputError, match="mm/s"):
        arm.jog_tool(x_mm_s=5000)


# In a user frame.

TABLE = UserFrame(x_mm=180, y_mm=-20, z_mm=80, rz_deg=50)


def test_points_are_given_in_the_frame_that_is_set(arm: armctl.Arm) -> None:
    def stands_at(*point: float) -> None:
        T = TABLE.matrix
        assert arm.position_mm == pytest.approx(T[:3, :3] @ point + T[:3, 3], abs=1e-3)

    arm.set_frame(TABLE)
    try:
        arm.go(10, 20, 30)
        stands_at(10, 20, 30)
        arm.line(40, 20, 30, pitch="free")
        stands_at(40, 20, 30)
        arm.arc(via_mm=(30, 30, 30), to_mm=(20, 20, 30), pitch="free")
        stands_at(20, 20, 30)
        before = arm.position_mm
        arm.jog_tool(x_mm_s=30, frame="user")
        until(lambda: bool((arm.position_mm != before).any()))
        until(lambda: arm.snapshot.state is State.HOLDING)
        along = TABLE.matrix[:3, :3].T @ (arm.position_mm - before)
        assert along[0] > 0.0 and along[1:] == pytest.approx((0, 0), abs=0.02 * along[0] + 1e-3)
        arm.go_joints([0, 100, -80, -60, 0])
        before = arm.position_mm
        arm.follow_target(*(np.linalg.inv(TABLE.matrix)[:3] @ [190, 60, 120, 1]))
        until(lambda: float(arm.position_mm[1] - before[1]) > 1.0)
        until(lambda: arm.snapshot.state is State.HOLDING)
        program = Program(
            robot=arm.robot.name,
            frames={"table": UserFrame(x_mm=0, y_mm=0, z_mm=20)},
            steps=(FrameStep(frame="table"), PointStep(x_mm=200, y_mm=0, z_mm=100)),
        )
        arm.run(program)  # it has frames of its own
        assert arm.position_mm == pytest.approx((200, 0, 120), abs=1e-3)
    finally:
        arm.set_frame()
    arm.go(200, 0, 100)
    assert arm.position_mm == pytest.approx((200, 0, 100), abs=1e-3)


def test_an_orientation_is_given_in_the_frame_too(tmp_path: Path) -> None:
    with armctl.Arm.open(panda_file(tmp_path)) as arm:
        arm.enable("rest")
        home = arm.robot.forward(arm.robot.pose("home"))
        frame = UserFrame(x_mm=100, y_mm=-50, z_mm=20, rx_deg=12, ry_deg=-8, rz_deg=70)
        T = frame.matrix
        x, y, z = T[:3, :3].T @ (1000 * home[:3, 3] - T[:3, 3])
        rpy = np.degrees(roll_pitch_yaw(T[:3, :3].T @ home[:3, :3])).tolist()
        arm.set_frame(frame)
        arm.go(x, y, z, rpy_deg=rpy)
        assert arm.position_mm == pytest.approx(1000 * home[:3, 3], abs=1e-3) and tool_turn(arm, home) < 1e-6
        arm.go(x, y, z + 20, orientation="kept", choose="least-travel")
        assert tool_turn(arm, home) < 1e-6
        arm.line(x, y, z, orientation="interpolated", rpy_deg=rpy)
        assert tool_turn(arm, home) < 1e-5


# What is known of the arm, and what ends a fault.


def test_where_the_arm_is_is_not_invented(own_board: armctl.Arm) -> None:
    arm = own_board
    for what in (lambda: arm.joints_deg, lambda: arm.position_mm):
        with pytest.raises(StateError, match=r"nobody knows .*: its state is off .*; enable\(\) the arm"):
            what()
    with pytest.raises(StateError, match="nobody knows"):
        arm.go(200, 0, 100, choose=lambda q, _: q[:, 0])
    assert np.isnan(arm.measured_deg).all()
    arm.enable()
    until(lambda: not np.isnan(arm.measured_deg).any())
    np.testing.assert_allclose(arm.measured_deg, arm.joints_deg, atol=0.05)
    assert arm.source is Source.TRANSMITTED
    kept = pickle.loads(pickle.dumps(arm.snapshot))
    assert (kept.state, kept.board, kept.source) == (State.HOLDING, arm.snapshot.board, arm.source)
    np.testing.assert_array_equal(kept.q_command, np.radians(arm.joints_deg))
    arm.disconnect()
    with pytest.raises(StateError, match=r"state is disconnected .*reconnect\(\)"):
        arm.joints_deg.tolist()
    assert np.isnan(arm.measured_deg).all()
    with pytest.raises(StateError, match="no fault to clear"):
        arm.clear_fault()
    before = arm.snapshot.board
    arm.reconnect()
    assert before is None
    assert arm.snapshot.board is not None
    arm.enable()
    arm.go_joints(AWAY)
    with pytest.raises(StateError, match="connected already"):
        arm.reconnect()


def test_a_running_program_goes_on_in_another_version(arm: armctl.Arm) -> None:
    def swing(*bases: float) -> Program:
        return Program(
            robot="uzuner",
            name="swing",
            steps=tuple(MoveStep(joints_deg=(base, 100.0, -80.0, -60.0, 0.0)) for base in bases),
        )

    with pytest.raises(StateError, match="no program runs"):
        arm.update_program(swing(1))
    run = arm.run(swing(4, 0), loops=None, wait=False)
    until(lambda: arm.snapshot.program is not None)
    until(lambda: run.progress is None)  # of an endless one nobody knows it
    arm.update_program(swing(-9, 0))
    until(lambda: arm.joints_deg[0] < -5)
    run.cancel()
    with pytest.raises(StateError, match="'swing' was stopped by library"):
        run.result()
    for program in (None, 5):
        with pytest.raises(InputError, match=f"a Program or the path of its file, not {program}"):
            arm.run(program)  # type: ignore[arg-type]


# Everything that a page can ask for is one call.

CALLS: dict[type[Command], Callable[[armctl.Arm], object]] = {
    commands.Connect: lambda arm: arm.reconnect("sim"),
    commands.Disconnect: lambda arm: arm.disconnect(),
    commands.Enable: lambda arm: arm.enable(),
    commands.HomeAxes: lambda arm: arm.home(),
    commands.Release: lambda arm: arm.release(),
    commands.Pause: lambda arm: arm.pause(),
    commands.Resume: lambda arm: arm.resume(),
    commands.ClearFault: lambda arm: arm.clear_fault(),
    commands.TakeControl: lambda arm: arm.take_control("1234"),
    commands.LockControl: lambda arm: arm.lock_control(True),
    commands.MoveJoints: lambda arm: arm.go_pose("home"),
    commands.MoveTo: lambda arm: arm.go(200, 0, 100),
    commands.Follow: lambda arm: arm.follow(PointToPoint.lasting([0.0] * 5, [0.0] * 5, 0.0)),
    commands.Cancel: lambda arm: arm.go_pose("home", wait=False).cancel(),
    commands.Jog: lambda arm: arm.jog([1, 0, 0, 0, 0]),
    commands.JogTool: lambda arm: arm.jog_tool(x_mm_s=1),
    commands.FollowTarget: lambda arm: arm.follow_target(200, 0, 100),
    commands.StreamJoints: lambda arm: arm.stream().send(AWAY),
    commands.MoveGripper: lambda arm: arm.gripper(50),
    commands.SetSpeed: lambda arm: arm.set_speed(50),
    commands.LimitTorque: lambda arm: arm.limit_torque(0.5),
    commands.SetOutput: lambda arm: arm.set_output("lamp", 1.0),
    commands.SimulateInput: lambda arm: arm.simulate_input("door", 1.0),
    commands.PlayInputs: lambda arm: arm.play_inputs("at 1 s door on"),
    commands.SetTool: lambda arm: arm.set_tool("cup"),
    commands.LendControl: lambda arm: arm.lend_control("pad"),
    commands.RunProgram: lambda arm: arm.wait(0.1),
    commands.ConfirmMessage: lambda arm: arm.confirm(),
    commands.UpdateProgram: lambda arm: arm.update_program(Program(robot="uzuner")),
}
BY_CONNECTING = {commands.Arrive, commands.Leave, commands.RememberWrongPins}
"""what the house says when somebody connects, or has gone, and when another console takes its place"""


class Listener:
    """A link that only keeps what is asked for."""

    def __init__(self) -> None:
        self.robot, self.asked = armctl.load_robot("uzuner"), list[Command]()
        self.stopped, self.ended = 0, False
        controller = Controller(self.robot, Boards(self.robot, ManualClock().now).driver, ManualClock())
        self.snapshot: Snapshot = replace(controller.snapshot, message=Message("ready?", 1, True))
        controller.close()

    def submit(self, command: Command, origin: Origin | None = None) -> Ticket:
        self.asked.append(command)
        waits = isinstance(command, commands.MoveJoints) and command.motion
        return Ticket([]) if waits else Ticket.ended()

    def stop(self, origin: Origin | None = None) -> Ticket:
        self.stopped += 1
        return Ticket.ended()

    def close(self) -> None:
        self.ended = True


def test_there_is_a_call_for_every_command_and_for_stop() -> None:
    every = {kind for kind in known_commands() if kind not in BY_CONNECTING}
    assert set(CALLS) == every, "a command without a call of Arm, or the reverse"
    for kind, call in CALLS.items():
        link = Listener()
        if kind is commands.MoveJoints:
            call = lambda arm: arm.go_pose("home", wait=False)  # noqa: E731
        call(armctl.Arm(link))
        assert kind in map(type, link.asked)
    link = Listener()
    armctl.Arm(link).follow_target(200, 0, 100, quaternion_wxyz=[0, 2, 0, 0])
    (asked,) = link.asked
    assert isinstance(asked, commands.FollowTarget) and asked.target is not None
    np.testing.assert_allclose(asked.target.rotation, np.diag([1, -1, -1]), atol=1e-12)
    link = Listener()
    with armctl.Arm(link) as arm:
        arm.stop()
    assert (link.stopped, link.ended) == (1, True)


def test_steps_of_programs_are_calls_with_their_keys() -> None:
    link = Listener()
    arm = armctl.Arm(link)
    arm.pick(190, -80, 90, approach_mm=40, close_percent=20, part_mm=[10, 20, 30], rpy_deg=[180, 0, 0])
    arm.place(180, 80, 90, along="tool", output="lamp")
    arm.message("Ready?", timeout_s=5)
    asked = [one.program.steps for one in link.asked if isinstance(one, commands.RunProgram)]
    assert asked == [
        (
            PickStep(
                x_mm=190, y_mm=-80, z_mm=90, approach_mm=40, close_percent=20, part_x_mm=10, part_y_mm=20,
                part_z_mm=30, rx_deg=180, ry_deg=0, rz_deg=0,
            ),
        ),
        (PlaceStep(x_mm=180, y_mm=80, z_mm=90, along="tool", output="lamp"),),
        (MessageStep(text="Ready?", timeout_s=5),),
    ]  # fmt: skip
    with pytest.raises(InputError, match="PlaceStep has no 'close_percent'; it has along, approach_mm"):
        arm.place(180, 80, 90, close_percent=20)
    with pytest.raises(InputError, match="part_mm needs three numbers"):
        arm.pick(190, -80, 90, part_mm=[10, 20])
    with pytest.raises(ProgramError, match="approach_mm"):
        arm.pick(190, -80, 90, approach_mm=-1)


def ticked(driver: RecordingDriver, **kept: object) -> Controller:
    """A controller that runs as fast as it can, connected."""
    controller = Controller(ROBOT, lambda _: driver, driver._clock, **kept)  # type: ignore[arg-type]
    controller.start()
    controller.submit(Connect("/dev/ttyACM0")).result(20)
    return controller


@pytest.mark.parametrize(
    ("pose", "stands"),
    [
        ("last", [10, 80, -60, -30, 0]),
        ("home", [0, 90, -80, -40, 0]),
        ([5, 90, -80, -40, 1], [5, 90, -80, -40, 1]),
    ],
)
def test_servos_that_are_off_come_on_where_the_arm_is_said_to_stand(
    tmp_path: Path, pose: str | list[float], stands: list[float]
) -> None:
    driver = RecordingDriver(ManualClock())
    driver.simulated = False
    before = PoseFolder(tmp_path, ROBOT)
    board = BoardIdentity("board", "/dev/ttyACM0")
    before.save(board, LastPose(np.radians([10, 80, -60, -30, 0]), 0.25, 0.0, "closed"))
    before.close()  # waits until it is written
    with armctl.Arm(ticked(driver, poses=PoseFolder(tmp_path, ROBOT))) as arm:
        with pytest.raises(StateError, match=r"nobody knows where the arm is \(last seen at 10\.0, 80\.0"):
            arm.enable()
        with pytest.raises(InputError, match="no pose 'nowhere'"):
            arm.enable("nowhere")
        assert driver.writes == []
        arm.enable(pose)
        assert arm.joints_deg == pytest.approx(stands)
        assert arm.snapshot.gripper == (0.25 if pose == "last" else 0.5)


def test_a_last_pose_of_a_moving_arm_needs_a_second_word(tmp_path: Path) -> None:
    driver = RecordingDriver(ManualClock())
    driver.simulated = False
    before = PoseFolder(tmp_path, ROBOT)
    stood = np.radians([10, 80, -60, -30, 0])
    before.save(BoardIdentity("board", "/dev/ttyACM0"), LastPose(stood, 0.25, 0.0, "moving", moving=True))
    before.close()  # waits until it is written
    with armctl.Arm(ticked(driver, poses=PoseFolder(tmp_path, ROBOT))) as arm:
        with pytest.raises(StateError, match=r"10\.0, 80\.0.* moving.*--pose last-moving"):
            arm.enable("last")
        assert driver.writes == []
        arm.enable("last-moving")
        assert arm.joints_deg == pytest.approx(np.degrees(stood))


@pytest.mark.parametrize("stopped", [False, True])
def test_a_line_that_is_slow_as_a_program_begins_is_tried_once_more_unless_somebody_stops(
    stopped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A busy computer looks like a slow line for a second."""
    driver = RecordingDriver(ManualClock())
    driver.simulated = False
    with armctl.Arm(ticked(driver)) as arm:
        controller, asked = arm.link, list[str]()

        def wait_until(clock: MonotonicClock, deadline: float, wake: threading.Event) -> bool:
            """What happens within a second."""
            assert deadline - clock.now() > 1.0 and not driver.writes
            driver.delay_s = 0.01
            slow = controller.snapshot.stamp
            while controller.snapshot.stamp < slow + 1.2:
                pass
            if stopped:
                controller.stop(Origin("page 1")).result(20)
            asked.append("again")
            return False

        monkeypatch.setattr(MonotonicClock, "wait_until", wait_until)
        driver.delay_s = 0.085
        tick = controller.snapshot.tick
        while controller.snapshot.tick < tick + 5:
            pass
        if stopped:
            with pytest.raises(EnableError, match="too slow: the board's answers took up to 85 ms"):
                arm.enable("home")
        else:
            arm.enable("home")
        assert (bool(driver.writes), asked) == (not stopped, ["again"])


def test_a_last_pose_that_nobody_kept_is_refused() -> None:
    driver = RecordingDriver(ManualClock())
    driver.simulated = False
    with (
        armctl.Arm(ticked(driver)) as arm,
        pytest.raises(StateError, match="no last pose of uzuner on this board is kept"),
    ):
        arm.enable("last")


@pytest.mark.parametrize(
    ("opened", "closed", "parks"), [(True, None, True), (False, True, True), (True, False, False)]
)
def test_it_parks_at_the_end_where_that_is_asked_for(opened: bool, closed: bool | None, parks: bool) -> None:
    driver = RecordingDriver(ManualClock())
    arm = armctl.Arm(ticked(driver), park=opened)
    arm.enable("home")
    arm.close(park=closed)
    at = ROBOT.output_map.angles(driver.positions)
    assert at == pytest.approx(ROBOT.pose("rest" if parks else "home"))


def test_a_way_to_the_rest_pose_that_is_refused_is_told_and_the_arm_holds(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    driver = RecordingDriver(ManualClock())
    arm = armctl.Arm(ticked(driver), park=True)
    arm.enable("home")
    refused = Ticket.ended(MotionRefusedError("the tool: 3.0 mm below the floor"))
    monkeypatch.setattr(arm.link, "submit", lambda *_: refused)
    arm.close()
    assert "not parked, the arm holds where it is: the tool: 3.0 mm below the floor" in caplog.text
    assert ROBOT.output_map.angles(driver.positions) == pytest.approx(ROBOT.pose("home"))


def test_a_fault_does_not_park() -> None:
    driver = RecordingDriver(ManualClock())
    arm = armctl.Arm(ticked(driver), park=True)
    arm.enable("home")
    driver.fail["read"] = BoardError("unplugged")
    while arm.snapshot.state is not State.FAULT:
        pass
    count = len(driver.writes)
    arm.close()
    assert len(driver.writes) == count
