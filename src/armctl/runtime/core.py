"""What the controller thread owns: the arm's state and every transition between the states."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import (
    ArmctlError,
    BoardError,
    InputError,
    MotionRefusedError,
    StateError,
    StoppedError,
    out_of_range,
)
from armctl.facts import Need, State
from armctl.hardware import Driver
from armctl.motion.clearance import kept_out
from armctl.motion.preflight import require_gaps
from armctl.protocol import Command, Doing, Origin, Ticket, unmet
from armctl.protocol.clock import AFTER_GAP_S
from armctl.protocol.needs import POWERED
from armctl.protocol.snapshot import BOARD_REPORTS
from armctl.robot import CarriedPart, Robot
from armctl.runtime.activity import Activity, Setpoint
from armctl.runtime.board import Board, close_opened
from armctl.runtime.control import ControlHandover
from armctl.runtime.gate import Gate
from armctl.runtime.last_pose import PoseFolder, PoseWatch
from armctl.runtime.led.joint_servo import KeepClear
from armctl.runtime.monitor import Monitor
from armctl.runtime.mover import GripperMover, PathMover
from armctl.runtime.notices import EventLog, Notices
from armctl.runtime.order import Order
from armctl.runtime.planner import LONGEST_PLAN_S, Grip, Pending, Submit, result_of
from armctl.runtime.tick_time import LATE_SHOWN_S, LONGEST_TICKS, TickTime

SLOWEST = 0.05
"""the smallest speed override"""
JOG_GAP_S = 0.2
"""A jog that was held during a STOP must be let go for this long before it moves the arm again."""
_SAME_PRESS_S, _SAME_REFUSAL_S = 0.5, 2.0
_UNSENT_S = 1.0
"""so long the end of a motion waits for the line"""
_READ_INTERVAL_S = 0.02
_LOGGER = logging.getLogger("armctl.runtime")


class Core:
    """The arm's state. Only one thread at a time may use it, and nothing else writes its attributes."""

    def __init__(
        self,
        robot: Robot,
        open_driver: Callable[[str], Driver],
        submit: Submit,
        period: float,
        pin: str = "",
        poses: PoseFolder | None = None,
        open_line: Submit | None = None,
    ) -> None:
        """``submit`` has motions planned elsewhere, and ``open_line`` (None: the same) has lines opened."""
        self.robot = robot
        self.submit = submit
        self._open_line = submit if open_line is None else open_line
        self.log = EventLog()
        self.notices = Notices(self.log)
        self.desk = ControlHandover(self.log, pin)
        self.around = kept_out(robot)
        self.clear = KeepClear(robot)
        self.gate = Gate(robot, LONGEST_TICKS * period)
        self.gripper = GripperMover(robot.gripper)
        self.monitor = Monitor(robot, self.notices, max(period, _READ_INTERVAL_S))
        self.poses = PoseWatch(poses)
        self.board: Board | None = None
        self.state = State.DISCONNECTED
        self.cause = "not connected yet"
        self.activity: Activity | None = None
        self.stopped_by = ""
        """who stopped the activity that comes to rest now"""
        self.motion = self.stopped_motion = ""
        """name of the motion that began last, and of the one that may not go on"""
        self.leaving: Ticket | None = None
        """of a disconnect that waits for the arm to stand"""
        self.speed = 1.0
        self.setpoint: Setpoint | None = None
        self.presumed = robot.first_pose
        """(n,) [rad] where the arm is enabled, or would be, while nobody knows where it stands"""
        self._open_driver = open_driver
        self._port: str | None = None
        self._opening: Pending | None = None
        self._motion: Pending | None = None
        self._edit: Pending | None = None
        self._grip: Grip | None = None
        self._gripped: tuple[object, ...] = ()
        """the jaws and the part that ``clear`` was told of last"""
        self._looking: Future[None] | None = None
        self._ticket: Ticket | None = None
        self._stopping: list[Ticket] = []
        self._pausing = False
        self._held_at = -math.inf
        self._held_locked = False
        self._dropped = False
        """a setpoint was dropped, as the line was busy for too long: it must be written again"""
        self._wrote_at = -math.inf
        self._unsent_since: float | None = None
        self._ticks = TickTime(period)
        self._gap_ended = -math.inf
        self._gap_s = 0.0

    @property
    def standing(self) -> bool:
        """No joint moves."""
        return self.activity is None or self.activity.standing

    @property
    def doing(self) -> Doing | None:
        """What moves the arm."""
        return None if self.activity is None else self.activity.doing(bool(self.stopped_by))

    def led_by(self, command: Command) -> Activity | None:
        """What moves the arm, if it goes on by commands of this kind."""
        it = self.activity
        return it if it is not None and isinstance(command, it.led_by) else None

    @property
    def busy(self) -> bool:
        """Something moves, or a motion is being planned."""
        planned = self._motion is not None or self._grip is not None
        return self.activity is not None or planned or self.gripper.goal is not None

    @property
    def resting(self) -> bool:
        """Nothing is powered, moves, or is about to: the board is only looked at."""
        if self.state not in (State.OFF, State.DISCONNECTED) or self.powered or self.busy:
            return False
        waits = self._opening is not None or self._edit is not None or self.leaving is not None
        return not (waits or self._stopping or self.monitor.doubts or self.monitor.homes)

    @property
    def powered(self) -> bool:
        """The board has said that pulses are on."""
        return bool(self.monitor.reading.on.any())

    def require(self, need: Need, what: str) -> None:
        """Refuse (``StateError``) ``what`` ("a motion") needs the arm in another state."""
        homing = self.monitor.reading.homing
        homed, connected = homing is None or homing.done, self.board is not None
        why = unmet(
            need, self.state, asked=what, connected=connected, homed=homed, cause=self.cause,
            doing=self.doing, limp=self.limp,
        )  # fmt: skip
        if why is not None:
            raise StateError(why)

    @property
    def limp(self) -> tuple[str, ...]:
        """Titles of joints that were released by themselves, while the others hold."""
        return () if self.board is None else self.board.limp_titles

    @property
    def held(self) -> Robot:
        """The arm with its jaws between where they are and where they go, and with what they carry."""
        grips = () if self.gripper.goal is None else (self.gripper.goal,)
        return self.robot.gripping(self.gate.opening, *grips).carrying(self.gripper.part)

    # Connecting, and switching the outputs on and off.

    def connect(self, order: Order, port: str | None, now: float) -> None:
        """Open the line, off this thread: it takes seconds. Moves nothing; leaves the outputs as they are."""
        if self.state not in (State.DISCONNECTED, State.FAULT):
            raise StateError(f"connected already, and {self.state.value}; disconnect first")
        if self._opening is not None:
            raise StateError(f"{self._port} is being opened already")
        port = self._port if port is None else port
        if port is None:
            raise StateError("no board was connected yet: on which port is it?")
        if self.board is not None:
            self.disconnect("to connect again")
        self._port = port
        future = self._open_line(Board, self.robot, self._open_driver, port)
        self._opening = Pending(order, order.label, future)
        self._enter(State.DISCONNECTED, f"opening {port} ({order.origin.who})")
        self._take_board(now)

    def _take_board(self, now: float) -> None:
        opening = self._opening
        if opening is None or not opening.future.done():
            return
        self._opening = None
        try:
            board: Board = result_of(opening.future, "opening the line")
            self.board = board
            self._connected(board, opening.order.origin.who, now)
        except ArmctlError as error:
            if self.board is not None:
                self.disconnect(str(error))
            self._enter(State.DISCONNECTED, str(error))
            self.refuse(opening.order, opening.label, error)
        else:
            opening.order.ticket.end()

    def _connected(self, board: Board, who: str, now: float) -> None:
        answered = self.monitor.read(board, now) is not None
        identity, power = board.identity, board.power
        for note in identity.notes:
            self.log.add(note)
        for words in identity.earlier:
            self.log.warn(words)
        if self.powered:
            cause = f"its {power} are on already: Enable takes the arm over where it is"
        else:
            cause = f"{power} are off" if answered else f"it has not said yet whether its {power} are on"
        self._enter(State.OFF, f"connected to {identity.title} at {identity.port} ({who}); {cause}")

    def leave(self, ticket: Ticket, who: str) -> bool:
        """Disconnect, after the arm was brought to rest; whether that is done at once."""
        if self.activity is not None:
            self.stop(Origin(f"disconnect, {who}"))
            self.leaving = ticket
        elif self.state is not State.DISCONNECTED or self._opening is not None:
            self.disconnect(f"disconnected ({who})")
        return self.leaving is None

    def disconnect(self, cause: str) -> None:
        """Close the line; the outputs stay as they are."""
        self._drop_all(StateError("disconnected"))
        if self._opening is not None:
            self._opening.order.ticket.end(StateError(f"disconnected while {self._port} was being opened"))
            self._opening.future.add_done_callback(close_opened)
            self._opening = None
        self._close_board()
        self._enter(State.DISCONNECTED, cause)
        if self.leaving is not None:
            ticket, self.leaving = self.leaving, None
            ticket.end()

    def adopt(self, q: FloatArray, opening: float | None, now: float) -> None:
        """The arm stands at ``q`` (n,) [rad] with its outputs on: the next setpoint goes on from there."""
        self.gate.jump(q, now)
        if opening is not None:
            self.gate.adopt_opening(opening, now)

    def forget(self) -> None:
        """Nobody knows any more where the arm is, or what its gripper carries."""
        self.gate.forget()
        self.gripper.forget()

    def hold(self, cause: str) -> None:
        """The outputs are on, and the arm stands where the last setpoint is."""
        self.monitor.enabled()
        self._enter(State.HOLDING, cause)

    def power_off(self, cause: str) -> None:
        """The outputs are off: forget where the arm is."""
        self._drop_all(StateError(cause))
        self.forget()
        self._dropped = False
        self.monitor.released()
        self._enter(State.OFF, cause)

    # Motions.

    def begin(
        self, activity: Activity, who: str, now: float, ticket: Ticket | None = None, motion: str = ""
    ) -> None:
        """Begin a motion from standstill; ``motion`` is its name."""
        self.activity, self._ticket, self.motion = activity, ticket, motion
        self._pausing, self._unsent_since = False, None
        self._ticks.restart(now)
        self._enter(State.MOVING, f"{activity.label} ({who})")

    def plan(
        self,
        order: Order,
        label: str,
        start: FloatArray,
        take: Callable[[Any], Activity] | None,
        plan: Callable[..., object],
        *args: object,
    ) -> None:
        """Plan from ``start`` (n,) [rad] off this thread; ``take`` makes an activity of it, None follows."""
        if self._motion is not None:
            raise StateError("another motion is being planned; stop it first")
        future = self.submit(plan, self.held, start, *args)
        self._motion = Pending(order, label, future, start, take)

    def move_gripper(self, order: Order, opening: float, part: CarriedPart | None) -> None:
        """Move the gripper to ``opening`` 0..1, where ``part`` is between its jaws.

        The rest of a motion that is under way is checked first, off this thread, with the jaws anywhere from
        where they are to ``opening``. While a motion is being planned, the gripper waits for it to begin.
        """
        self._drop_grip(StateError("a newer gripper command took its place"))
        self._grip = Grip(order, opening, part)
        self._take_grip()

    def _take_grip(self) -> None:
        """Move the gripper, if the motion under way is clear with it, too."""
        grip, activity = self._grip, self.activity
        if grip is None or self._motion is not None:
            return
        rest = None if activity is None else activity.rest
        try:
            self.require(Need.GRIPPER, "the gripper")  # a program may have begun
            if rest is not None:
                if grip.checked is not activity:
                    held = self.robot.gripping(self.gate.opening, grip.opening).carrying(grip.part)
                    check = self.submit(require_gaps, held, rest)
                    self._grip = grip = replace(grip, checked=activity, check=check)
                if grip.check is None or not grip.check.done():
                    return
                result_of(grip.check, "checking the motion under way")
        except ArmctlError as error:
            self._grip = None
            if isinstance(error, MotionRefusedError):
                error = error.about("the motion under way, with the gripper as it would be")
            self.refuse(grip.order, grip.order.label, error)
        else:
            self._grip = None
            self.gripper.move_to(grip.opening, grip.part, grip.order.ticket, grip.order.motion)
            grip.order.ticket.accept()

    def _drop_grip(self, error: ArmctlError) -> None:
        """Refuse the gripper command that waits for the motion under way to be checked."""
        if self._grip is not None:
            if self._grip.check is not None:
                self._grip.check.cancel()
            self._grip.order.ticket.end(error)
            self._grip = None

    def await_edit(self, order: Order, label: str, future: Future[None], take: Callable[[Any], None]) -> None:
        """Take an edit over once it is checked; an earlier one that is still being checked is refused."""
        self._drop_edit(StateError("another edit came after it"))
        self._edit = Pending(order, label, future, take=take)

    def take_planned(self, now: float) -> None:
        """Take over what is done elsewhere: an open board, a planned motion, a checked edit or gripper."""
        self._take_board(now)
        self._drop_what_takes_too_long(now)
        motion, edit = self._motion, self._edit
        if motion is not None and motion.future.done():
            self._motion = None
            ticket = motion.order.ticket
            try:
                plan = result_of(motion.future)
                q = self.gate.q
                stands = q is not None and motion.start is not None and np.array_equal(q, motion.start)
                if self.state is not State.HOLDING or self.limp or not stands:
                    raise StateError(
                        "the arm no longer stands where the motion was planned from; ask for it again"
                    )
                self._ticket = ticket  # a defect in what follows is a fault, which answers it
                if motion.take is None:
                    activity: Activity = PathMover(self.robot, plan, self.speed, motion.label)
                else:
                    activity = motion.take(plan)
                self.begin(activity, motion.order.origin.who, now, ticket, motion.order.motion)
            except ArmctlError as error:
                self._ticket = None
                self.refuse(motion.order, motion.label, error)
        self._take_grip()
        if edit is not None and edit.take is not None and edit.future.done():
            self._edit = None
            try:
                edit.take(result_of(edit.future))
                edit.order.ticket.end()
            except ArmctlError as error:
                self.refuse(edit.order, edit.label, error)

    def _drop_what_takes_too_long(self, now: float) -> None:
        """Whatever hangs the planner, the arm can be asked for something else."""
        for pending, drop in ((self._motion, self.drop_motion), (self._edit, self._drop_edit)):
            if pending is None or pending.future.done():
                continue
            if now - pending.order.given_at > LONGEST_PLAN_S:
                error = StateError(f"planning took longer than {LONGEST_PLAN_S:.0f} s; make it smaller")
                drop(error)
                self.refuse(pending.order, pending.label, error)

    def refuse(self, order: Order, label: str, error: ArmctlError) -> None:
        """Answer an order that cannot be carried out; the log tells the same once in a while."""
        words = f"{label} ({order.origin.who}) refused: {error}"
        if not self.log.said(words, _SAME_REFUSAL_S):
            self.log.warn(words)
        order.ticket.end(error)

    def pause(self, who: str) -> None:
        """Bring the motion to rest on its path."""
        self.require(Need.PAUSE, "a pause")
        if self.activity is None:  # refused above
            return
        self.activity.pause(True)
        self._pausing = True
        self.log.add(f"pause ({who})")
        if self.state is State.MOVING:
            self.cause = f"{self.activity.label} pausing ({who})"

    def resume(self, who: str) -> None:
        """Go on with a motion that was paused."""
        if self.activity is None or not self._pausing:
            raise StateError(f"there is nothing to resume: {self.state.value}")
        self.activity.pause(False)
        self._pausing = False
        self._enter(State.MOVING, f"{self.activity.label} resumed ({who})")

    def set_speed(self, fraction: float, who: str) -> None:
        """Speed override for everything that moves."""
        if not SLOWEST <= fraction <= 1:
            raise InputError(f"a speed of {out_of_range(100 * fraction, 100 * SLOWEST, 100, '%')}")
        self.speed = fraction
        if self.activity is not None:
            self.activity.set_speed(self.speed)
        self.log.add(f"speed {100 * fraction:.0f} % ({who})")

    def still_held(self, given_at: float) -> bool:
        """A jog came: whether it has been held since before a STOP, and must be let go of first."""
        gap, self._held_at = given_at - self._held_at, given_at
        if self._held_locked and gap < JOG_GAP_S:
            return True
        self._held_locked = False
        return False

    # Stop and fault.

    def stop(self, origin: Origin, ticket: Ticket | None = None) -> None:
        """Slow down along the path as hard as the limits allow, then hold; drop the rest.

        A board that moves the arm by itself is told to brake; if it does not confirm, that is a fault.
        """
        ticket = Ticket.ended() if ticket is None else ticket
        ticket.accept()
        self._stopping.append(ticket)  # from here on settle answers it, or a fault
        moving = self.busy
        if moving or self.monitor.homes or not origin.note:
            fresh = moving and self.stopped_by != str(origin)
            if fresh or not self.log.said(f"STOP ({origin})", _SAME_PRESS_S):  # a page sends each press twice
                self.log.warn(f"STOP ({origin})")
        else:
            self.log.add(f"{origin}; nothing moved, {self.state.value} as before")
        self._held_locked, self.stopped_motion = True, self.motion
        self.drop_motion(StateError(f"stopped by {origin}"))
        self._drop_grip(StateError(f"stopped by {origin}"))
        self.gripper.stop(StateError(f"stopped by {origin}"))
        try:
            if self.activity is not None:
                self.stopped_by = str(origin)
                self._pausing = False
                self.activity.stop()
                return
            if self.board is not None and self.monitor.homes:
                self.board.hold()
        except ArmctlError as error:
            self.fault(error)
            return
        self._stopping.remove(ticket)  # nothing moves; what is asked for next is not waited for
        ticket.end()

    def cancel(self, motion: str, origin: Origin, ticket: Ticket) -> None:
        """STOP for the motion of that name; one that is over changes nothing."""
        if not motion:
            raise InputError("which motion is to be cancelled? STOP stops them all")
        error = StateError(f"cancelled by {origin}")
        if self._motion is not None and self._motion.order.motion == motion:
            self.drop_motion(error)
        if self._grip is not None and self._grip.order.motion == motion:
            self._drop_grip(error)
        if self.gripper.motion == motion:
            self.gripper.stop(error)
        if self.activity is None or self.motion != motion:
            ticket.end()
            return
        self._stopping.append(ticket)
        if not self.stopped_by:
            self.log.add(f"{self.activity.label} cancelled ({origin})")
            self.stopped_motion, self.stopped_by, self._pausing = motion, str(origin), False
            self.activity.stop()

    def await_last(self, ticket: Ticket) -> None:
        """Answer ``ticket`` when what runs has ended."""
        self._ticket = ticket

    def drop_motion(self, error: ArmctlError) -> None:
        """Refuse the motion that is being planned."""
        if self._motion is not None:
            self._motion.future.cancel()
            self._motion.order.ticket.end(error)
            self._motion = None

    def _drop_edit(self, error: ArmctlError) -> None:
        """Refuse the edit that is being checked."""
        if self._edit is not None:
            self._edit.future.cancel()
            self._edit.order.ticket.end(error)
            self._edit = None

    def fault(self, error: ArmctlError) -> None:
        """Something broke: send nothing more, and say why."""
        cause = str(error)
        goes_on = self._drop_all(error)
        if goes_on is not None and str(goes_on) != cause:
            cause = f"{cause}; and {goes_on}"
        if isinstance(error, BoardError) or goes_on is not None:
            self._close_board()  # a board that moves its motors by itself ends that when no host talks to it
        self._enter(State.FAULT, cause)

    def clear_fault(self, who: str) -> None:
        """Leave fault for ``holding`` (outputs on) or ``off``."""
        if self.state is not State.FAULT:
            raise StateError(f"there is no fault to clear: {self.state.value}")
        if self.board is None:
            raise StateError(f"the board is gone ({self.cause}); connect again")
        self.monitor.acknowledged()
        if self.gate.q is None:
            if self.monitor.reading.powered is False:
                self.board.release()  # a board that switched its motors off by itself waits for this
            self._enter(State.OFF, f"fault cleared ({who})")
        else:
            self._enter(State.HOLDING, f"fault cleared ({who}); the arm holds the last setpoint")

    # One tick.

    def advance(self, now: float, *, urgent: bool) -> None:
        """Move on to ``now`` and send one setpoint where something changed."""
        ticks = self._ticks
        dt = ticks.take(now, urgent=urgent)
        if dt is None:
            return
        if ticks.late_before is not None:
            self.log.warn(ticks.late_before)
        if ticks.gap_s is not None:
            self._gap_ended, self._gap_s = now, ticks.gap_s
        if self.board is None or self.state not in POWERED:
            return
        activity = self.activity
        if ticks.gap_s is not None:
            self._after_gap(ticks.gap_s, now)
        elif ticks.late_s is not None:
            self.monitor.doubt()
            if activity is not None and self.gate.q is not None:
                self.notices.set("late", ticks.count_late(now), until=now + LATE_SHOWN_S)
        self.setpoint = None
        if not self.poses.may_move(now):
            return
        if self.monitor.doubts:
            # What is written to a board that has lost its power switches the pulses on again with a jump.
            if activity is not None:
                activity.halt()
            return
        if self._dropped and self.gate.q is not None:
            self.board.write(self.gate.q, self.gate.opening)
            self._dropped, self._wrote_at = False, now
        self._keep_clear_with_gripper()
        if activity is not None:
            self.setpoint = activity.advance(now, dt)
        gripping = self.gripper.goal is not None
        opening = self.gripper.advance(self.gate.opening, dt, self.speed) if gripping else None
        q, opening = self.gate.admit(None if self.setpoint is None else self.setpoint.q, opening, now)
        if q is not None or opening is not None:
            self.board.write(q, opening)
            self._wrote_at = now

    def _keep_clear_with_gripper(self) -> None:
        """Let jogs and live targets stay clear with the jaws as they are, and with what they carry."""
        gripper = self.gripper
        gripped = gripper.part, gripper.goal, self.gate.opening if gripper.goal is None else None
        if gripped != self._gripped:
            self._gripped = gripped
            self.clear.hold(self.held)
        if self._looking is not None and self._looking.done():
            looking, self._looking = self._looking, None
            result_of(looking, "looking at what the arm carries")
        if self.clear.outdated and self._looking is None:
            with suppress(StateError):  # too many motions wait to be planned: at the next tick
                self._looking = self.submit(self.clear.work_out)

    def _after_gap(self, gap_s: float, now: float) -> None:
        """Nothing ran for ``gap_s``: what moved, stands and does not go on; the board is read first."""
        self.monitor.doubt()
        words = (
            f"nothing ran for {gap_s:.1f} s (computer suspended, program frozen or too busy, or the board "
            "kept it waiting)"
        )
        activity = self.activity
        if not self.busy:
            self.log.warn(f"{words}; the arm stood still, the board is looked at first")
            self._held_locked = True
        else:
            if activity is not None:
                activity.halt()  # no setpoint went out meanwhile: it stands, and needs no way to brake
            self.stop(Origin("armctl", f"{words}; it does not go on by itself, ask for it again"))
        self._held_at = now  # a jog or a live target that is asked for all the time must be let go of first

    def require_no_gap(self, now: float) -> None:
        """Refuse (``StateError``) what may have been asked for before a gap, and would move the arm now."""
        if now - self._gap_ended < AFTER_GAP_S:
            words = f"nothing ran for {self._gap_s:.1f} s before it could begin; ask for it again"
            raise StateError(words)

    def observe(self, now: float) -> None:
        """Read back where it is due, and compare."""
        board, monitor = self.board, self.monitor
        if board is None or now < monitor.due_at:
            return
        reading = monitor.read(board, now)
        if monitor.unreliable is not None and self.activity is not None and not self._stopping:
            self.stop(Origin("armctl", monitor.unreliable))
        if reading is None:
            return
        q = self.gate.q
        if q is None:
            monitor.check_released()
            monitor.check_unasked(enabling=self.activity is not None)
            return
        self._dropped |= bool(monitor.take_dropped())
        if reading.errors and self.activity is not None and not self._stopping:
            self.stop(Origin("armctl", f"{BOARD_REPORTS}{'; '.join(reading.errors)}"))
        standing = self.standing and self.gripper.goal is None
        grips = self.gate.opening is not None and board.map.gripper_channel is not None
        lost = monitor.went_by_itself(board, q, standing, now, grips=grips)
        if lost is not None:
            self.forget()
            if self.state is not State.FAULT:  # a fault that is there already keeps its cause
                self.fault(MotionRefusedError(lost))
            return
        monitor.compare(board, q, standing, now)

    def _on_the_wire(self, now: float) -> bool:
        """Whether the last setpoint has gone out; a fault where the line does not take it for a second."""
        monitor = self.monitor
        waits = (
            not monitor.reading.sent or self._dropped or monitor.doubts or monitor.read_at < self._wrote_at
        )
        if self.board is None or self.gate.q is None or not waits:
            return True
        if self._unsent_since is None:
            self._unsent_since = now
        if now - self._unsent_since > _UNSENT_S:
            raise BoardError(
                f"the line to the board has not taken the last setpoints for {_UNSENT_S:.0f} s: the arm "
                "stands somewhere before the end of its motion; check cable and USB hub, then connect again"
            )
        return False

    def settle(self, now: float) -> None:
        """Draw the conclusions of a tick: what has ended, what stands, what is refused."""
        activity = self.activity
        if self.gripper.arrived and self._on_the_wire(now):
            self.gripper.settle()
            self._unsent_since = None
        if activity is not None:
            if activity.begun and self._ticket is not None:
                self._ticket.accept()
            if activity.notice is None:
                self.notices.clear("activity")
            else:
                self.notices.set("activity", activity.notice)
            if activity.done and (self.stopped_by or self._on_the_wire(now)):
                self._end(activity)
            elif self._pausing and activity.standing and self.state is State.MOVING:
                self._enter(State.PAUSED, f"{activity.label} paused")
        if self.activity is None:
            if self._stopping:
                self._answer_stops()
            if self.leaving is not None:
                self.disconnect("asked for")

    def presume(self, q: FloatArray) -> None:
        """Nobody knows where the arm is; it is drawn at ``q`` (n,) [rad], where it is said to be."""
        self.presumed = q

    def keep_pose(self, now: float) -> None:
        """Have the pose kept for the next start; a disk that takes nothing is only a warning."""
        identity = None if self.board is None else self.board.identity
        moving = self.state is State.MOVING or self.gripper.goal is not None or bool(self.limp)
        self.poses.note(identity, self.gate.q, self.gate.opening, self.state, moving, now)
        if self.activity is None:
            self.presumed = self.robot.first_pose if self.poses.last is None else self.poses.last.q
        if self.poses.problem is None:
            self.notices.clear("last pose")
        else:
            self.notices.set("last pose", self.poses.problem)

    def _enter(self, state: State, cause: str) -> None:
        """Change the state; every change is logged with its cause."""
        if state is not self.state:
            line = f"{self.state.value} → {state.value}: {cause}"
            self.log.add(line, "error" if state is State.FAULT else "info")
        self.state, self.cause = state, cause

    def _end(self, activity: Activity) -> None:
        ticket, self._ticket, self.activity = self._ticket, None, None
        self._pausing, self._unsent_since = False, None
        self.notices.clear("activity")
        stopped, self.stopped_by = self.stopped_by, ""
        error = activity.error
        if stopped:
            error = StoppedError(f"{activity.label} was stopped by {stopped}")
            cause = f"stopped by {stopped}"
        elif error is not None:
            cause = str(error)
            self.log.add(cause, "error")
        else:
            cause = f"{activity.label} finished"
        if ticket is not None:
            ticket.end(error)
        # Homing that was stopped or failed leaves an arm whose position is unknown.
        self._enter(State.OFF if self.gate.q is None else State.HOLDING, cause)

    def _drop_all(self, error: ArmctlError) -> ArmctlError | None:
        """Drop all that runs or waits; why a board that moves by itself may go on, None: it does not."""
        self.stopped_motion = self.motion
        self.drop_motion(error)
        self._drop_edit(error)
        self._drop_grip(error)
        goes_on: ArmctlError | None = None
        activity, self.activity = self.activity, None
        try:
            if activity is not None:
                activity.stop()
        except ArmctlError as unconfirmed:
            goes_on = unconfirmed
        except Exception as defect:  # must not keep a fault from being one
            _LOGGER.exception("a motion could not be stopped")
            if self.monitor.homes:  # else the arm stands still without setpoints
                goes_on = ArmctlError(f"internal error: {type(defect).__name__}: {defect}")
        if self._ticket is not None:
            self._ticket.end(error)
            self._ticket = None
        self.gripper.stop(error)
        self._answer_stops()  # nothing moves any more: what STOP asked for
        self.stopped_by = ""
        self._pausing = False
        self.setpoint = None
        self.notices.clear("activity")
        return goes_on

    def _answer_stops(self) -> None:
        for ticket in self._stopping:
            ticket.end()
        self._stopping.clear()

    def _close_board(self) -> None:
        if self.board is not None:
            self.board.close()
            self.board = None
        self._dropped = False
        self.forget()
        self.monitor.reset()
        self.notices.clear_all()
