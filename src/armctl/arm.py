"""One arm, wired up and ready: the library's way in, and what the command line builds on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.boards import ANY_BOARD, SIMULATED, board_name, calibrated_for
from armctl.errors import InputError
from armctl.kinematics import Target
from armctl.kinematics.target import as_numbers, checked_number, require_finite
from armctl.motion import PitchMode, Profile
from armctl.process import start_arm
from armctl.program import ArcStep, LineStep, Program, Step, WaitStep, checked_program, open_program
from armctl.program.feed import whole_number
from armctl.program.steps import WIDEST_BLEND_MM
from armctl.robot import Robot, load_robot
from armctl.runtime import (
    ArmLink,
    Command,
    Connect,
    Enable,
    HomeAxes,
    MoveGripper,
    MoveJoints,
    MoveTo,
    Origin,
    Release,
    RunProgram,
    SetSpeed,
    Snapshot,
)

_STOP_S = 5.0
"""so long an interrupt waits for the arm to stand [s]"""
_ORIGIN = Origin("library")


class Arm:
    """A robot on its board, run by a process of its own.

    Lengths are millimetres and angles degrees here, as in files and on the command line. Every motion
    blocks until it has ended; what refuses or breaks it is raised.

        with Arm.open("uzuner") as arm:
            arm.enable()
            arm.go(x_mm=200, y_mm=0, z_mm=100)
            arm.run("pick.toml", loops=3)
    """

    def __init__(self, link: ArmLink, board: str = ANY_BOARD) -> None:
        """Drive an arm through a link, which ``close`` ends; ``board``: whose calibration it goes by."""
        self.link, self.board = link, board
        self.robot = link.robot

    @classmethod
    def open(cls, robot: str | Path | Robot, port: str | None = None, rate_hz: float = 50.0) -> Self:
        """Load a robot, with the calibration that is kept for its board, and connect to the board.

        The arm runs in a process of its own, so nothing that this program does can make it late.
        ``robot``: a shipped robot's name, a robot file, or a robot. ``port``: a device, ``auto``, or None for
        the simulated board. ``rate_hz``: ticks a second, 10 … 200.
        """
        loaded = robot if isinstance(robot, Robot) else load_robot(robot)
        port = SIMULATED if port is None else port
        board = board_name(port, loaded)
        arm = cls(start_arm(calibrated_for(loaded, board), board, rate_hz), board)
        try:
            arm._do(Connect(port))
        except BaseException:
            arm.close()
            raise
        return arm

    @property
    def snapshot(self) -> Snapshot:
        """The arm at the controller's last tick."""
        return self.link.snapshot

    @property
    def joints_deg(self) -> FloatArray:
        """(n,) joint angles last commanded [degrees]."""
        return np.degrees(self.snapshot.q_command)

    @property
    def position_mm(self) -> FloatArray:
        """(3,) tool point last commanded [mm]."""
        return 1000 * self.robot.forward(self.snapshot.q_command)[:3, 3]

    def enable(self) -> None:
        """Make the arm ready to move: keep clear of it.

        Servos that were off jump to the rest pose. Motors with encoders that do not know where they are
        look for their zeros first (``home``); those that do stay where they are.
        """
        if any(not axis.homed for axis in self.snapshot.homing):
            self.home()
        self._do(Enable())

    def home(self) -> None:
        """Every axis moves, slowly, to its zero. BoardError: one did not find it. StateError: no encoders."""
        self._do(HomeAxes())

    def release(self) -> None:
        """Pulses off: the arm drops."""
        self._do(Release())

    def stop(self) -> None:
        """Decelerate inside the limits and hold; may be called from any thread."""
        self.link.stop(_ORIGIN).result()

    def go(
        self,
        x_mm: float,
        y_mm: float,
        z_mm: float,
        pitch_deg: float | None = None,
        roll_deg: float | None = None,
        choose: str = "least-rotation",
        duration_s: float | None = None,
        profile: Profile = "cubic",
        blend_mm: float = 0.0,
    ) -> None:
        """Put the tool on a point, joint by joint.

        The point is in the base frame; ``pitch_deg`` and ``roll_deg`` are the tool's, None: any. ``choose``
        is the criterion among the solutions, ``profile`` the law over time. Without a duration the motion
        takes the shortest. ``blend_mm`` means something in a program only: a call stops at its end.
        UnreachableError: no solution. MotionRefusedError: the way there would leave the limits.
        """
        _require_blend(blend_mm)
        point = _point((x_mm, y_mm, z_mm), "x_mm, y_mm, z_mm")
        pitch, roll = _optional(pitch_deg, "pitch_deg"), _optional(roll_deg, "roll_deg")
        target = Target.of(
            point / 1000,
            None if pitch is None else math.radians(pitch),
            None if roll is None else math.radians(roll),
        )
        self._do(MoveTo(target, choose, _optional(duration_s, "duration_s"), profile))

    def go_joints(
        self,
        joints_deg: Sequence[float],
        duration_s: float | None = None,
        profile: Profile = "cubic",
        blend_mm: float = 0.0,
    ) -> None:
        """Go to joint angles [degrees]; the rest as ``go``."""
        _require_blend(blend_mm)
        q = np.radians(self.robot.chain.checked(joints_deg))
        self._do(MoveJoints(q, _optional(duration_s, "duration_s"), profile))

    def line(
        self,
        x_mm: float,
        y_mm: float,
        z_mm: float,
        pitch: PitchMode = "kept",
        pitch_deg: float | None = None,
        speed_mm_s: float | None = None,
        duration_s: float | None = None,
        blend_mm: float = 0.0,
    ) -> None:
        """Lead the tool to a point in the base frame [mm] in a straight line.

        ``pitch``: tool pitch on the way, "kept", "interpolated" to ``pitch_deg``, or "free". ``speed_mm_s``:
        largest speed of the tool; None: as fast as the joints can. The rest as ``go``. ProgramError: the
        tool cannot be led there; says when, where and why.
        """
        x, y, z = _point((x_mm, y_mm, z_mm), "x_mm, y_mm, z_mm").tolist()
        shared = _led(pitch, pitch_deg, speed_mm_s, duration_s, blend_mm)
        self._step(LineStep(x_mm=x, y_mm=y, z_mm=z, **shared))

    def arc(
        self,
        via_mm: tuple[float, float, float],
        to_mm: tuple[float, float, float],
        pitch: PitchMode = "kept",
        pitch_deg: float | None = None,
        speed_mm_s: float | None = None,
        duration_s: float | None = None,
        blend_mm: float = 0.0,
    ) -> None:
        """Lead the tool along the circle through where it is, ``via_mm`` and ``to_mm`` [mm]; as ``line``."""
        (via_x, via_y, via_z), (x, y, z) = _point(via_mm, "via_mm").tolist(), _point(to_mm, "to_mm").tolist()
        shared = _led(pitch, pitch_deg, speed_mm_s, duration_s, blend_mm)
        self._step(ArcStep(via_x_mm=via_x, via_y_mm=via_y, via_z_mm=via_z, x_mm=x, y_mm=y, z_mm=z, **shared))

    def wait(self, seconds: float) -> None:
        """Stand still for some seconds."""
        self._step(WaitStep(seconds=checked_number(seconds, "seconds")))

    def go_pose(self, name: str, duration_s: float | None = None) -> None:
        """Go to one of the robot's named poses, e.g. home."""
        self._do(MoveJoints(self.robot.pose(name), _optional(duration_s, "duration_s")))

    def gripper(self, open_percent: float) -> None:
        """Open the gripper: 0 closed, 100 open."""
        if not 0 <= checked_number(open_percent, "open_percent") <= 100:
            raise InputError(f"the gripper opens 0 … 100 %, not {open_percent}")
        self._do(MoveGripper(open_percent / 100))

    def set_speed(self, percent: float) -> None:
        """Speed override for everything that moves, 5 … 100 %."""
        self._do(SetSpeed(checked_number(percent, "percent") / 100))

    def run(self, program: str | Path | Program, loops: int | None = 1) -> None:
        """Run a program, or its file (.toml, .csv), ``loops`` times (None: until stopped)."""
        if isinstance(program, Program):
            program = checked_program(program)
        else:
            program = open_program(program, self.robot)
        loops = None if loops is None else whole_number(loops, "how often a program runs")
        self._do(RunProgram(program, loops))

    def close(self) -> None:
        """Stop, close the line and end. The outputs stay as they are."""
        self.link.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _step(self, step: Step) -> None:
        self._do(RunProgram(Program(robot=self.robot.name, name=step.kind, steps=(step,))))

    def _do(self, command: Command) -> None:
        """Submit and wait for the end; an interrupt stops the arm first."""
        ticket = self.link.submit(command, _ORIGIN)
        try:
            ticket.result()
        except KeyboardInterrupt:
            with suppress(TimeoutError):  # closing waits for it once more
                self.link.stop(_ORIGIN).result(_STOP_S)
            raise


def _point(value: ArrayLike, what: str) -> FloatArray:
    """(3,) finite numbers."""
    array = as_numbers(value, what)
    if array.shape != (3,):
        raise InputError(f"{what} needs three numbers, x, y and z, got {value!r}")
    require_finite(array, what)
    return array


def _led(
    pitch: PitchMode,
    pitch_deg: float | None,
    speed_mm_s: float | None,
    duration_s: float | None,
    blend_mm: float,
) -> dict[str, Any]:
    """What a line and an arc of the tool share, checked."""
    return {
        "pitch": pitch,
        "pitch_deg": _optional(pitch_deg, "pitch_deg"),
        "speed_mm_s": _optional(speed_mm_s, "speed_mm_s"),
        "duration_s": _optional(duration_s, "duration_s"),
        "blend_mm": checked_number(blend_mm, "blend_mm"),
    }


def _optional(value: float | None, what: str) -> float | None:
    return None if value is None else checked_number(value, what)


def _require_blend(blend_mm: float) -> None:
    if not 0 <= checked_number(blend_mm, "blend_mm") <= WIDEST_BLEND_MM:
        raise InputError(f"a blend radius is 0 … {WIDEST_BLEND_MM} mm, not {blend_mm}")
