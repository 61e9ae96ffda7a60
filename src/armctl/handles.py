"""What ``Arm`` has beside its motions; and what its calls give to hold: a motion, a stream of setpoints."""

from __future__ import annotations

import asyncio
import logging
import threading
import uuid
from collections import deque
from collections.abc import Generator, Mapping, Sequence
from contextlib import suppress
from types import TracebackType
from typing import Any, Literal, Self

import msgspec
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.boards import ANY_BOARD
from armctl.errors import ArmctlError, BoardError, InputError, StateError
from armctl.facts import State
from armctl.facts.angles import DEGREE
from armctl.hardware import Source
from armctl.kinematics import Target, rotation_of
from armctl.kinematics.target import as_numbers, checked_number
from armctl.program import Condition, Senses, UserFrame
from armctl.program.conditions import Comparison, Otherwise, Trigger
from armctl.protocol import (
    ArmLink,
    Cancel,
    ClearFault,
    Command,
    ConfirmMessage,
    Connect,
    Disconnect,
    LendControl,
    LimitTorque,
    LockControl,
    MonotonicClock,
    MoveGripper,
    MoveJoints,
    MovingCommand,
    Origin,
    Pause,
    PlayInputs,
    Release,
    Resume,
    SetOutput,
    SetSpeed,
    SetTool,
    SimulateInput,
    Snapshot,
    StreamJoints,
    TakeControl,
    Ticket,
)
from armctl.robot import Robot

ORIGIN = Origin("library")
_UNANSWERED = 5
"""so many setpoints of a stream may be on their way to the arm"""
_ANSWER_S = 1.0
_LOOK_S = 0.01
"""so often a wait looks at the newest snapshot"""
STOP_S = 5.0
"""so long an interrupt waits for the arm to stand [s]"""
_TO_DO = {
    State.DISCONNECTED: "reconnect() and enable() the arm",
    State.OFF: "enable() the arm",
    State.FAULT: "see to the cause, then clear_fault() or reconnect(), and enable() the arm",
}
_LOGGER = logging.getLogger("armctl.arm")


class Motion:
    """A motion that was asked for. ``result`` waits for its end; so does ``await`` in asyncio."""

    def __init__(self, link: ArmLink, command: MovingCommand) -> None:
        """Ask for it."""
        self._link, self._name = link, uuid.uuid4().hex
        self._has_progress = not isinstance(command, MoveGripper)  # moves beside what is shown
        self._ticket: Ticket = link.submit(msgspec.structs.replace(command, motion=self._name), ORIGIN)

    @property
    def done(self) -> bool:
        """It is over: it has arrived, or was refused, stopped or broken."""
        return self._ticket.finished.done()

    @property
    def progress(self) -> float | None:
        """How much of it is done, 0 … 1; None where that is not known.

        It counts time at full speed for a motion, steps for a program, and axes for homing. It is not known
        for the gripper, for a program that runs for ever, and for a motion that ended early.
        """
        finished = self._ticket.finished
        if finished.done():
            return 1.0 if finished.exception() is None else None
        if not self._ticket.accepted.done():
            return 0.0
        return self._link.snapshot.progress if self._has_progress else None

    def result(self, timeout: float | None = None) -> None:
        """Wait for its end; raises what refused, stopped or broke it. ``TimeoutError``: it goes on."""
        self._ticket.result(timeout)

    def cancel(self) -> None:
        """STOP for this motion alone: it slows down on its path. Returns once the arm stands."""
        if not self.done:
            self._link.submit(Cancel(self._name), ORIGIN).result()

    def __await__(self) -> Generator[Any, None, None]:
        return asyncio.wrap_future(self._ticket.finished).__await__()


class JointStream:
    """Setpoints for the arm to follow: send one every 10 … 50 ms, in a ``with`` block.

    The arm goes toward the newest one inside its limits of speed and acceleration, so it follows at the
    distance it needs to brake. It slows down when none comes for 150 ms, or when something is in its way
    (``snapshot.warnings``). At the end of the block it goes on to the last one; an exception in the block
    stops it. STOP ends the stream.
    """

    def __init__(self, link: ArmLink) -> None:
        self._link, self._name = link, uuid.uuid4().hex
        self._asked: deque[Ticket] = deque()
        self._q: FloatArray | None = None

    def send(self, q_deg: ArrayLike) -> None:
        """Send the next setpoint (n,) [degrees]; waits while five are not answered.

        Raises the error that refused it or an earlier one. After a STOP or a fault all are refused.
        """
        robot = self._link.robot
        q = robot.check_limits(robot.read(robot.chain.checked_one(q_deg)))
        self._settle(_UNANSWERED - 1)
        self._asked.append(self._link.submit(StreamJoints(q, motion=self._name), ORIGIN))
        self._q = q

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._q is None:
            return
        if error is not None:
            self._cancel()
            return
        try:
            self._settle(0)
            self._link.submit(StreamJoints(self._q, last=True, motion=self._name), ORIGIN).result()
        except BaseException:
            self._cancel()
            raise

    def _settle(self, most: int) -> None:
        """Take the answers that are there, and wait for others until ``most`` are open."""
        while self._asked and (len(self._asked) > most or self._asked[0].finished.done()):
            try:
                self._asked[0].result(_ANSWER_S)
            except TimeoutError as cause:
                raise StateError(f"the arm has not answered a setpoint for {_ANSWER_S:g} s") from cause
            self._asked.popleft()

    def _cancel(self) -> None:
        """What was raised already says more than what this meets."""
        with suppress(ArmctlError, TimeoutError):
            self._link.submit(Cancel(self._name), ORIGIN).result(_ANSWER_S)


Orientation = Literal["kept"]
"""of the tool, where ``Arm.go`` is not told by its numbers: as it is"""


class ArmControls:
    """What ``Arm`` has beside its motions: where the arm is, its line, its power, who has control."""

    def __init__(self, link: ArmLink, board: str = ANY_BOARD, *, park: bool = False) -> None:
        """Drive an arm through a link, which ``close`` ends; ``board``: whose calibration it goes by.

        ``park``: as ``open``.
        """
        self.link, self.board = link, board
        self._park = park
        self._T_base_user: FloatArray | None = None
        """(4, 4) [mm] of the frame that points are given in; None: the base"""

    @property
    def robot(self) -> Robot:
        """The arm as it is calibrated, with the tool that is on."""
        return self.link.robot

    @property
    def tool(self) -> str:
        """Name of the tool that is on; empty: the robot file names none."""
        return self.snapshot.tool

    def set_tool(self, name: str) -> None:
        """Say that a tool of the robot file is on, another one or still the same; only while the arm stands.

        It moves nothing. Its tip, weight, body and gripper count from then on. A real board needs it before
        ``enable`` where the file names several. InputError: no such tool. StateError: something moves, or the
        gripper holds a part.
        """
        self._do(SetTool(name))

    @property
    def snapshot(self) -> Snapshot:
        """The arm at the controller's last tick."""
        return self.link.snapshot

    @property
    def joints_deg(self) -> FloatArray:
        """(n,) joint angles last commanded [degrees]; ``StateError`` where nobody knows where the arm is."""
        return self.robot.shown(self._commanded())

    @property
    def position_mm(self) -> FloatArray:
        """(3,) tool point last commanded [mm]; ``StateError`` where nobody knows where the arm is."""
        return 1000 * self.robot.forward(self._commanded())[:3, 3]

    @property
    def measured_deg(self) -> FloatArray:
        """(n,) joint angles that the board reports [degrees], NaN where it does not know; see ``source``."""
        return self.robot.shown(self.snapshot.q)

    @property
    def source(self) -> Source:
        """What ``measured_deg`` is: measured by encoders, or only what the board sends, or was told."""
        return self.snapshot.source

    @property
    def inputs(self) -> Mapping[str, float]:
        """What the board's inputs are at, by name: 0, 1, or a share 0 … 1."""
        return self.snapshot.inputs

    @property
    def outputs(self) -> Mapping[str, float]:
        """What its outputs beside the joints are at, likewise."""
        return self.snapshot.outputs

    def wait_for(
        self,
        watch: str,
        value: float = 1.0,
        timeout_s: float = 60.0,
        *,
        joint: str = "",
        compare: Comparison = "equals",
        trigger: Trigger = "level",
        otherwise: Otherwise = "stop",
    ) -> bool:
        """Wait until an input has a value, in whatever state the arm is; whether it has come.

        ``watch`` may also be the ``load`` [%], ``temperature`` [°C], ``voltage`` [V] or ``current`` [A] of a
        ``joint``, which is to be compared (``compare``) "above" or "below" a value; so is an analog input.
        ``trigger``: "edge" means that the input must become so from now on. ``otherwise``: after
        ``timeout_s`` it raises StateError; with "go on" it returns False.
        """
        condition = Condition(watch=watch, joint=joint, compare=compare, value=value, trigger=trigger)
        condition.check(self.robot)
        clock, begun = MonotonicClock(), self.snapshot.edges
        until = clock.now() + checked_number(timeout_s, "timeout_s")
        while True:
            now = self.snapshot
            edges = {name: count - begun.get(name, 0) for name, count in now.edges.items()}
            if condition.holds(Senses.of(self.robot, now.quantities, now.inputs, edges)):
                return True
            if self.link.ended or now.unreachable:
                raise BoardError(f"waiting for {condition}: {now.cause}")
            if clock.now() >= until:
                break
            clock.wait_until(clock.now() + _LOOK_S, threading.Event())
        if otherwise == "go on":
            return False
        raise StateError(f"waited {timeout_s:g} s for {condition}, which did not come")

    def confirm(self) -> None:
        """Say OK to the message that a program waits with (``snapshot.message``); ``StateError``: none."""
        message = self.snapshot.message
        if message is None or not message.waits:
            raise StateError("no message waits for OK")
        self._do(ConfirmMessage(message.number))

    def simulate_input(self, name: str, value: float) -> None:
        """Put an input of the simulated board at a value, as if somebody pressed it."""
        self._do(SimulateInput(name, value))

    def play_inputs(self, script: str) -> None:
        """Have simulated inputs follow a script (docs/pins.md) from now on; empty: they stay as they are."""
        self._do(PlayInputs(script))

    def set_frame(self, frame: UserFrame | None = None) -> None:
        """Give the points of what follows in a user frame (``armctl.program.UserFrame``); None: in the base.

        So are the orientations of ``go``, ``line``, ``arc`` and ``follow_target``; a pitch stays above the
        horizontal. A program that is run has frames of its own. ``position_mm`` is in the base frame.
        """
        self._T_base_user = None if frame is None else frame.matrix

    def _rotation(
        self,
        rpy_deg: Sequence[float] | None,
        quaternion_wxyz: Sequence[float] | None,
        orientation: Orientation | None,
    ) -> FloatArray | None:
        """``R_user_tool`` (3, 3) that is asked for, or the present one; None: neither."""
        rpy = None if rpy_deg is None else as_numbers(rpy_deg, "rpy_deg") * DEGREE
        asked = rotation_of(rpy, quaternion_wxyz)
        if orientation is None:
            return asked
        if orientation != "kept":
            raise InputError(f"orientation is 'kept' or left out, not {orientation!r}")
        if asked is not None:
            raise InputError("orientation='kept' is the present one: leave rpy_deg and quaternion_wxyz out")
        present = self.robot.forward(self._commanded())[:3, :3]
        return present if self._T_base_user is None else self._T_base_user[:3, :3].T @ present

    def _in_base(self, target: Target) -> Target:
        """A target that is given in the user frame."""
        if (T := self._T_base_user) is None:
            return target
        R, rotation = T[:3, :3], target.rotation
        turned = None if rotation is None else R @ rotation
        return Target.of(R @ target.point + T[:3, 3] / 1000, target.pitch, target.roll, turned)

    def reconnect(self, port: str | None = None) -> None:
        """Open the line to the board, after ``disconnect`` or a fault; None: the same port as before."""
        self._do(Connect(port))

    def disconnect(self) -> None:
        """Stop, then close the line to the board. The outputs stay as they are."""
        self._do(Disconnect())

    def clear_fault(self) -> None:
        """Leave a fault once its cause is gone; ``StateError``: there is none, or the board is gone."""
        self._do(ClearFault())

    def take_control(self, pin: str = "") -> None:
        """Operate the arm; whoever did only watches from now on. ``pin``: the teacher's, if it is locked."""
        self._do(TakeControl(pin))

    def lend_control(self, to: str = "") -> None:
        """Let another party, by the id in ``snapshot.control``, command beside this one; empty: none."""
        self._do(LendControl(to))

    def lock_control(self, locked: bool = True, pin: str = "") -> None:
        """Lock control, so that nobody can take it, or unlock it."""
        self._do(LockControl(locked, pin))

    def release(self, joints: Sequence[str] | None = None) -> None:
        """Switch the pulses off: the arm drops. Of named joints only, where the board can: others hold."""
        if self._park and joints is None:
            bring_to_rest(self.link, ORIGIN)
        names = (joints,) if isinstance(joints, str) else joints
        self._do(Release(None if names is None else tuple(names)))

    def limit_torque(self, share: float, *joints: str) -> None:
        """How strong the motors of these joints (none: all) may be, 0 … 1, where the board can limit it."""
        self._do(LimitTorque(share, joints))

    def set_output(self, name: str, value: float) -> None:
        """Switch an output of the board that moves no joint: 0, 1, or a share of it."""
        self._do(SetOutput(name, value))

    def stop(self) -> None:
        """Decelerate inside the limits and hold; may be called from any thread."""
        self.link.stop(ORIGIN).result()

    def pause(self) -> None:
        """Slow down along the path and stand."""
        self._do(Pause())

    def resume(self) -> None:
        """Go on along the same path."""
        self._do(Resume())

    def set_speed(self, percent: float) -> None:
        """Speed override for everything that moves, 5 … 100 %."""
        self._do(SetSpeed(checked_number(percent, "percent") / 100))

    def close(self, park: bool | None = None) -> None:
        """Stop, close the line and end. The outputs stay as they are.

        ``park``: go to the rest pose first, where the arm has power; None: as it was opened.
        """
        try:
            if self._park if park is None else park:
                bring_to_rest(self.link, ORIGIN)
        finally:
            self.link.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _commanded(self) -> FloatArray:
        """(n,) the last setpoint [rad]."""
        snapshot = self.snapshot
        if not snapshot.commanded:
            what = _TO_DO.get(snapshot.state, "wait for its end")
            if snapshot.unreachable:
                what = "open or connect the arm again"
            raise StateError(
                f"nobody knows where the arm is: its state is {snapshot.state.value} ({snapshot.cause}); "
                f"{what}. measured_deg tells what its board reports"
            )
        return snapshot.q_command

    def _move(self, command: MovingCommand, wait: bool) -> Motion:
        motion = Motion(self.link, command)
        if wait:
            self._wait_for(motion)
        return motion

    def _do(self, command: Command) -> None:
        self._wait_for(self.link.submit(command, ORIGIN))

    def _wait_for(self, asked: Ticket | Motion) -> None:
        """Wait for the end; an interrupt stops the arm first."""
        try:
            asked.result()
        except KeyboardInterrupt:
            with suppress(TimeoutError):  # closing waits for it once more
                self.link.stop(ORIGIN).result(STOP_S)
            raise


def bring_to_rest(link: ArmLink, origin: Origin) -> None:
    """Park: stop, then go to the rest pose, where the arm has power.

    A way that is refused is told in the log; then the arm holds where it is. After a fault nothing moves.
    """
    link.stop(origin).result(STOP_S)
    if link.snapshot.state is not State.HOLDING:
        return
    ticket = link.submit(MoveJoints(link.robot.pose("rest")), origin)
    try:
        ticket.result()
    except ArmctlError as refusal:
        _LOGGER.warning("not parked, the arm holds where it is: %s", refusal)
    except KeyboardInterrupt:
        link.stop(origin).result(STOP_S)
        raise
