"""One arm, wired up and ready: the library's way in, and what the command line builds on."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Literal, Self

from armctl.arm_values import (
    enable_command,
    handling_keys,
    led_keys,
    optional_number,
    point_of,
    require_blend,
    target_of,
    turned_keys,
)
from armctl.boards import SIMULATED, board_name, calibrated_for
from armctl.errors import InputError, MotionRefusedError, StateError
from armctl.facts.angles import DEGREE
from armctl.facts.commands import AfterGap, LineSlow
from armctl.handles import ORIGIN, ArmControls, JointStream, Motion, Orientation
from armctl.kinematics import Choice
from armctl.kinematics.target import as_numbers, checked_number
from armctl.motion import PathTrajectory, PitchMode, Profile, Trajectory, TurnMode, plan_choice
from armctl.motion.choices import not_the_best
from armctl.motion.clearance import clear_rest
from armctl.motion.trajectory import KnowsPeaks
from armctl.process import Link, RemoteLine, start_arm
from armctl.program import (
    ArcStep,
    LineStep,
    MessageStep,
    PickStep,
    PlaceStep,
    Program,
    Step,
    WaitStep,
    checked_program,
    open_program,
)
from armctl.program.conditions import Otherwise
from armctl.program.feed import whole_number
from armctl.program.message_step import GoesOn
from armctl.protocol import (
    Connect,
    Enable,
    Follow,
    FollowTarget,
    Frame,
    HomeAxes,
    Jog,
    JogTool,
    MonotonicClock,
    MoveGripper,
    MoveJoints,
    MoveTo,
    RunProgram,
    UpdateProgram,
)
from armctl.robot import CarriedPart, Robot, load_robot
from armctl.robot.body.arm_body import BODY_GUESSED
from armctl.terminal import PersonAtTerminal

_LOGGER = logging.getLogger("armctl.arm")
_BUSY_S = 1.2
"""so long after a refusal that a busy computer may explain, Enable is asked for once more"""


class Arm(ArmControls):
    """A robot on its board, run by a process of its own.

    Lengths are millimetres and angles degrees here, as in files and on the command line. Every motion
    blocks until it has ended; what refuses or breaks it is raised. With ``wait=False`` it gives a ``Motion``
    at once, whose ``result()`` raises this.

        with Arm.open("uzuner") as arm:
            arm.enable()
            arm.go(x_mm=200, y_mm=0, z_mm=100)
            arm.run("pick.toml", loops=3)
            swing = arm.go_pose("home", wait=False)
            print(swing.progress)
            swing.cancel()
    """

    @classmethod
    def open(
        cls, robot: str | Path | Robot, port: str | None = None, rate_hz: float = 50.0, *, park: bool = False
    ) -> Self:
        """Load a robot, with the calibration that is kept for its board, and connect to the board.

        The arm runs in a process of its own, so nothing that this program does can make it late. One that
        has held the arm since a program on the same port crashed is taken over.
        ``robot``: a shipped robot's name, a robot file, or a robot. ``port``: a device, ``auto``, or None for
        the simulated board. ``rate_hz``: ticks a second, 10 … 200. ``park``: before ``release`` and ``close``
        it goes to its rest pose, where it has power.
        """
        loaded = robot if isinstance(robot, Robot) else load_robot(robot)
        if loaded.body_is_guessed:
            _LOGGER.warning("%s: %s", loaded.title, BODY_GUESSED)
        port = SIMULATED if port is None else port
        board = board_name(port, loaded)
        link = start_arm(calibrated_for(loaded, board), board, rate_hz, port=port)
        arm = cls(link, board, park=park)
        try:
            if link.snapshot.board is None:  # else it was taken over
                arm._do(Connect(port))
        except BaseException:
            arm.close()
            raise
        return arm

    @classmethod
    def connect(
        cls, url: str, token: str | None = None, name: str = "library", *, watch: bool = False
    ) -> Self:
        """Drive the arm of a console that runs elsewhere, e.g. ``http://192.168.1.20:8080``.

        ``token``: as ``armctl serve`` prints it; or ``url`` is the whole printed link. ``name``: what its
        pages show. It takes control where nobody has it; else call ``take_control``. ``watch``: it only
        watches.
        BoardError: nobody answers there, or the token is wrong.
        """
        return cls(Link(RemoteLine(url, token), name, watch=watch))

    def enable(self, pose: str | Sequence[float] | None = None) -> None:
        """Make the arm ready to move: keep clear of it.

        ``pose`` says where the arm stands now, for servos that are off and cannot tell: "last" (where armctl
        saw it last; "last-moving" if it was moving then), a named pose ("rest"), or joint angles [degrees].
        They come on there one by one, which takes some seconds; in a wrong pose they jump. The simulated
        board, and pulses that are on, need none.
        StateError: nobody knows where the arm is, and no pose was given. Motors with encoders that do not
        know where they are look for their zeros first (``home``).
        """
        if any(not axis.homed for axis in self.snapshot.homing):
            self.home()
        try:
            self._enable(enable_command(self.robot, self.snapshot, pose))
        except MotionRefusedError as refusal:
            found = clear_rest(self.robot) if pose in (None, "rest") else None
            if found is None:
                raise
            raise MotionRefusedError(
                f"{refusal}: {found[1]} is clear. Give it here, enable({found[1]}), or keep it as the rest "
                f"pose: [poses] rest = {found[1]} in the robot file or the side file of the arm"
            ) from refusal

    def home(self, wait: bool = True) -> Motion:
        """Move every axis slowly to its zero. ``go_pose("home")`` instead goes to the pose called home.

        BoardError: an axis did not find its zero. StateError: the board has no encoders.
        """
        return self._move(HomeAxes(), wait)

    def go(
        self,
        x_mm: float,
        y_mm: float,
        z_mm: float,
        pitch_deg: float | None = None,
        roll_deg: float | None = None,
        choose: Choice = "least-rotation",
        duration_s: float | None = None,
        profile: Profile = "cubic",
        blend_mm: float = 0.0,
        wait: bool = True,
        *,
        rpy_deg: Sequence[float] | None = None,
        quaternion_wxyz: Sequence[float] | None = None,
        orientation: Orientation | None = None,
    ) -> Motion:
        """Put the tool on a point, joint by joint.

        The point is in the base frame, or as ``set_frame`` says. ``pitch_deg`` and ``roll_deg`` are the
        tool's; None: any. Instead of these you can give its whole orientation in that frame: ``rpy_deg`` is
        roll, pitch and yaw as Rz(yaw)·Ry(pitch)·Rx(roll), ``quaternion_wxyz`` has any length,
        ``orientation="kept"`` is the present one.
        ``choose`` is the criterion among the solutions: its name, or a function of your own that takes the
        solutions (k, n) [rad] and where the arm stands (n,) [rad], and returns k energies. The solution of
        least energy is sent, or where the arm may not go there, the best of those to which it may; the
        events say so, or the log where the criterion is your own. Infinity excludes a solution.
        ``profile`` is the law over time; "end-plus" comes to the end from one side, each joint turning up, so
        that play is on the same side each time, "end-minus" from the other. Without ``duration_s`` the motion
        is as fast as the limits allow.
        ``blend_mm`` matters only in a program: a call stops at its end.
        UnreachableError: no solution, or none with that orientation. MotionRefusedError: the way there would
        leave the limits.
        """
        require_blend(blend_mm)
        point = point_of((x_mm, y_mm, z_mm), "x_mm, y_mm, z_mm")
        rotation = self._rotation(rpy_deg, quaternion_wxyz, orientation)
        target, duration = (
            self._in_base(target_of(point, pitch_deg, roll_deg, rotation)),
            optional_number(duration_s, "duration_s"),
        )
        if isinstance(choose, str):
            return self._move(MoveTo(target, choose, duration, profile), wait)
        planned, refusal = plan_choice(self.robot, self._commanded(), target, choose, duration, profile)
        if refusal is not None:
            _LOGGER.warning("%s", not_the_best(refusal))
        return self._move(MoveJoints(planned.end, duration, profile), wait)

    def go_joints(
        self,
        joints_deg: Sequence[float],
        duration_s: float | None = None,
        profile: Profile = "cubic",
        blend_mm: float = 0.0,
        wait: bool = True,
    ) -> Motion:
        """Go to joint angles [degrees]; the rest as ``go``."""
        require_blend(blend_mm)
        q = self.robot.read(self.robot.chain.checked(joints_deg))
        return self._move(MoveJoints(q, optional_number(duration_s, "duration_s"), profile), wait)

    def line(
        self,
        x_mm: float,
        y_mm: float,
        z_mm: float,
        pitch: PitchMode | None = None,
        pitch_deg: float | None = None,
        speed_mm_s: float | None = None,
        duration_s: float | None = None,
        blend_mm: float = 0.0,
        wait: bool = True,
        *,
        orientation: TurnMode | None = None,
        rpy_deg: Sequence[float] | None = None,
        quaternion_wxyz: Sequence[float] | None = None,
    ) -> Motion:
        """Lead the tool to a point [mm] in a straight line; in the base frame, or as ``set_frame`` says.

        ``pitch``: tool pitch on the way, "kept", "interpolated" to ``pitch_deg``, or "free".
        ``orientation``, instead: the same of the whole rotation, "interpolated" to ``rpy_deg`` or
        ``quaternion_wxyz`` as in ``go``. Without either the arm keeps what it can: its orientation with six
        joints or more. ``speed_mm_s``: largest speed of the tool; None: as fast as the joints can. The rest
        as ``go``.
        ProgramError: the tool cannot be led there; says when, where and why.
        """
        x, y, z = point_of((x_mm, y_mm, z_mm), "x_mm, y_mm, z_mm").tolist()
        shared = led_keys(pitch, pitch_deg, speed_mm_s, duration_s, blend_mm)
        shared |= turned_keys(orientation, rpy_deg, quaternion_wxyz)
        return self._step(LineStep(x_mm=x, y_mm=y, z_mm=z, **shared), wait)

    def arc(
        self,
        via_mm: tuple[float, float, float],
        to_mm: tuple[float, float, float],
        pitch: PitchMode | None = None,
        pitch_deg: float | None = None,
        speed_mm_s: float | None = None,
        duration_s: float | None = None,
        blend_mm: float = 0.0,
        wait: bool = True,
        *,
        orientation: TurnMode | None = None,
        rpy_deg: Sequence[float] | None = None,
        quaternion_wxyz: Sequence[float] | None = None,
    ) -> Motion:
        """Lead the tool along the circle through where it is, ``via_mm`` and ``to_mm`` [mm]; as ``line``."""
        (via_x, via_y, via_z), (x, y, z) = (
            point_of(via_mm, "via_mm").tolist(),
            point_of(to_mm, "to_mm").tolist(),
        )
        shared = led_keys(pitch, pitch_deg, speed_mm_s, duration_s, blend_mm)
        shared |= turned_keys(orientation, rpy_deg, quaternion_wxyz)
        step = ArcStep(via_x_mm=via_x, via_y_mm=via_y, via_z_mm=via_z, x_mm=x, y_mm=y, z_mm=z, **shared)
        return self._step(step, wait)

    def pick(self, x_mm: float, y_mm: float, z_mm: float, wait: bool = True, **how: Any) -> Motion:
        """Take a part at a point: approach, straight to it, grip, straight away.

        ``how``: keys of a ``pick`` step (``armctl.program.PickStep``), such as ``approach_mm=40``,
        ``close_percent=20``, ``output="vacuum"``, ``part_input="held"``; also ``rpy_deg`` and ``part_mm``.
        InputError: another key. ProgramError: a part of it is refused, or no part was held in time.
        """
        return self._step(PickStep(**handling_keys(PickStep, (x_mm, y_mm, z_mm), how)), wait)

    def place(self, x_mm: float, y_mm: float, z_mm: float, wait: bool = True, **how: Any) -> Motion:
        """Put a part down at a point; as ``pick``, with the keys of ``armctl.program.PlaceStep``."""
        return self._step(PlaceStep(**handling_keys(PlaceStep, (x_mm, y_mm, z_mm), how)), wait)

    def wait(self, seconds: float, wait: bool = True) -> Motion:
        """Stand still for some seconds."""
        return self._step(WaitStep(seconds=checked_number(seconds, "seconds")), wait)

    def message(
        self,
        text: str,
        goes_on: GoesOn = "at OK",
        timeout_s: float | None = None,
        otherwise: Otherwise = "stop",
        wait: bool = True,
    ) -> Motion:
        """Tell the person something on all pages and at this terminal; stand until OK, or go on "at once".

        Enter is OK, the button on the operator's page, and ``confirm``. After ``timeout_s`` (None: a day) it
        raises ProgramError, or with ``otherwise="go on"`` goes on.
        """
        keys = {"goes_on": goes_on, "timeout_s": timeout_s, "otherwise": otherwise}
        return self._step(MessageStep(text=text, **keys), wait)  # type: ignore[arg-type]

    def go_pose(self, name: str, duration_s: float | None = None, wait: bool = True) -> Motion:
        """Go to one of the robot's named poses, e.g. home."""
        return self._move(MoveJoints(self.robot.pose(name), optional_number(duration_s, "duration_s")), wait)

    def gripper(
        self, open_percent: float, wait: bool = True, *, part_mm: Sequence[float] | None = None
    ) -> Motion:
        """Open the gripper: 0 closed, 100 open.

        ``part_mm``: (3,) edges of what is between the jaws then, along x, y and z of the tool, its middle at
        the tool point [mm]; None: nothing. It counts in all that moves, until the gripper is told to move
        again. InputError: not three edges, or one that is no part's (``CarriedPart``). MotionRefusedError:
        the motion under way would not be clear with it.
        """
        if not 0 <= checked_number(open_percent, "open_percent") <= 100:
            raise InputError(f"the gripper opens 0 … 100 %, not {open_percent}")
        part = CarriedPart.of(part_mm)
        return self._move(MoveGripper(open_percent / 100, None if part is None else part.edges_mm), wait)

    def run(self, program: str | Path | Program, loops: int | None = 1, wait: bool = True) -> Motion:
        """Run a program, or its file (.toml, .csv), ``loops`` times (None: until stopped)."""
        program = self._program(program)
        loops = None if loops is None else whole_number(loops, "how often a program runs")
        return self._run(RunProgram(program, loops), wait)

    def update_program(self, program: str | Path | Program) -> None:
        """Let the program that runs go on in another version, from its next pass on."""
        self._do(UpdateProgram(self._program(program)))

    def follow(self, trajectory: Trajectory, wait: bool = True) -> Motion:
        """Run a trajectory that begins where the arm stands, after its pre-flight.

        One of your own class (``armctl.motion.Trajectory``) is sampled every 10 ms.
        InputError: it raises an error, or gives no numbers.
        """
        own = not isinstance(trajectory, KnowsPeaks)
        return self._move(Follow(PathTrajectory.sampled(trajectory) if own else trajectory), wait)

    # What counts only for a moment, and is given again and again.

    def stream(self) -> JointStream:
        """Let the arm follow setpoints as they come: ``with arm.stream() as s: s.send(joints_deg)``."""
        return JointStream(self.link)

    def jog(self, percent: Sequence[float]) -> None:
        """Turn the joints at -100 … 100 % of their speed limits (n,) for 100 ms; then they slow down."""
        self._do(Jog(as_numbers(percent, "percent") / 100))

    def jog_tool(
        self,
        x_mm_s: float = 0.0,
        y_mm_s: float = 0.0,
        z_mm_s: float = 0.0,
        pitch_deg_s: float = 0.0,
        roll_deg_s: float = 0.0,
        frame: Frame | Literal["user"] = "base",
        *,
        rx_deg_s: float = 0.0,
        ry_deg_s: float = 0.0,
        rz_deg_s: float = 0.0,
    ) -> None:
        """Move the tool along a line, or turn it in its place, for 100 ms; then it slows down.

        ``frame``: whose axes x, y and z are along, "base", "tool" or "user" (``set_frame``). A positive
        pitch lifts the tool. About these axes, ``rx_deg_s`` and so on, an arm turns its tool that can orient
        it (``robot.orients_tool``); along a line such an arm keeps the orientation, another one its pitch
        and roll.
        """
        linear = point_of((x_mm_s, y_mm_s, z_mm_s), "x_mm_s, y_mm_s, z_mm_s") / 1000
        turn = point_of((rx_deg_s, ry_deg_s, rz_deg_s), "rx_deg_s, ry_deg_s, rz_deg_s") * DEGREE
        pitch, roll = checked_number(pitch_deg_s, "pitch_deg_s"), checked_number(roll_deg_s, "roll_deg_s")
        of_robot: Frame = "base" if frame == "user" else frame
        jog = JogTool(linear, pitch * DEGREE, roll * DEGREE, of_robot, turn)
        if frame == "user" and self._T_base_user is not None:
            jog = jog.from_user_frame(self._T_base_user[:3, :3])
        self._do(jog)

    def follow_target(
        self,
        x_mm: float,
        y_mm: float,
        z_mm: float,
        pitch_deg: float | None = None,
        roll_deg: float | None = None,
        *,
        rpy_deg: Sequence[float] | None = None,
        quaternion_wxyz: Sequence[float] | None = None,
    ) -> None:
        """Let the tool follow a point that moves: give it again within 500 ms, or the arm slows down.

        Pitch, roll and orientation as ``go``; what is not given stays as it was where the arm can.
        """
        point = point_of((x_mm, y_mm, z_mm), "x_mm, y_mm, z_mm")
        rotation = self._rotation(rpy_deg, quaternion_wxyz, None)
        self._do(FollowTarget(self._in_base(target_of(point, pitch_deg, roll_deg, rotation))))

    def _program(self, program: str | Path | Program) -> Program:
        if isinstance(program, Program):
            return checked_program(program)
        return open_program(program, self.robot)

    def _step(self, step: Step, wait: bool) -> Motion:
        if self._T_base_user is not None:
            step = step.moved(self._T_base_user)
        program = checked_program(Program(robot=self.robot.name, name=step.kind, steps=(step,)))
        return self._run(RunProgram(program), wait)

    def _run(self, command: RunProgram, wait: bool) -> Motion:
        with PersonAtTerminal(self.link, ORIGIN) if wait else nullcontext():
            return self._move(command, wait)

    def _enable(self, command: Enable) -> None:
        """Enable; once more where this computer was too busy, as when a program begins. Not after STOP."""
        stops = self.snapshot.stops
        try:
            self._do(command)
        except StateError as refusal:
            if not isinstance(refusal.reason, (LineSlow, AfterGap)):
                raise
            clock = MonotonicClock()
            clock.wait_until(clock.now() + _BUSY_S, threading.Event())
            if self.snapshot.stops != stops:
                raise
            self._do(command)
