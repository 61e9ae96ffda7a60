"""The arm's state, and every transition between the states.

What the controller thread does from tick to tick stands in ``core.py``.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import replace

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, BoardError, InputError, StateError, StoppedError
from armctl.facts import Need, State, say
from armctl.facts.commands import Disconnected, NothingTo, ShareOutside, Stopped
from armctl.hardware import Driver, Source
from armctl.protocol import Command, Doing, Origin, Ticket, unmet
from armctl.robot import Robot
from armctl.runtime.activity import Activity, Order, Setpoint
from armctl.runtime.board import Board, close_opened
from armctl.runtime.control import ControlHandover
from armctl.runtime.gate import Gate
from armctl.runtime.last_pose import PoseFolder, PoseWatch
from armctl.runtime.monitor import LONGEST_TICKS, Monitor, TickTime
from armctl.runtime.mover import GripperMover
from armctl.runtime.notices import EventLog, MessageBoard, Notices
from armctl.runtime.planner import Grip, Pending, Submit
from armctl.runtime.signals import SignalWatch
from armctl.runtime.tool_rack import ToolRack

SLOWEST, JOG_GAP_S = 0.05, 0.2
"""The smallest speed override. How long a jog held at a STOP must be let go before it moves again."""
_SAME_PRESS_S, _SAME_REFUSAL_S = 0.5, 2.0
_READ_INTERVAL_S = 0.02
_LOGGER = logging.getLogger("armctl.runtime")


class ArmState:
    """Which state the arm is in, what moves it, and what is asked of it. Only ``Core`` is made of it."""

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
        self.rack = ToolRack(robot)
        self.robot, self.around, self.clear = robot, self.rack.on.around, self.rack.on.clear
        self.submit = submit
        self._open_line = submit if open_line is None else open_line
        self.log = EventLog()
        self.notices, self.messages = Notices(self.log), MessageBoard(self.log)
        self.desk = ControlHandover(self.log, pin)
        self.gate = Gate(robot, LONGEST_TICKS * period)
        self.gripper = GripperMover(robot.gripper)
        self.monitor = Monitor(robot, self.notices, max(period, _READ_INTERVAL_S))
        self.signals = SignalWatch(robot, self.log)
        self.poses = PoseWatch(poses)
        self.board: Board | None = None
        self.state = State.DISCONNECTED
        self.cause, self.stops, self.last_stop = "not connected yet", 0, None
        self.activity: Activity | None = None
        self.stopped_by: Stopped | None = None  # whose STOP brings the activity to rest now
        self.stopped: Stopped | None = None  # what ``cause`` tells, where it is somebody's STOP
        self._stop_tells: Sequence[str] = ()  # names of the warnings that it tells
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
        return None if self.activity is None else self.activity.doing(self.stopped_by is not None)

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
        """Nothing moves, or is about to: the board is only looked at."""
        off = self.state in (State.OFF, State.DISCONNECTED) and not self.powered
        if self.busy or not (off or self.state is State.HOLDING):
            return False
        if (it := self.board) is not None and (self.robot.signals.inputs or self.limp or it.catching_up):
            return False  # an input is waited for, a hand leads it, or setpoints are still to be sent
        waits = self._opening is not None or self._edit is not None or self.leaving is not None
        return not (waits or self._stopping or self._dropped or self.monitor.doubts or self.monitor.homes)

    @property
    def powered(self) -> bool:
        """The board has said that pulses are on."""
        return bool(self.monitor.reading.on.any())

    def standing_at(self, q: FloatArray) -> FloatArray:
        """``q`` (n,) [rad], the last setpoint, with limp joints where a hand has led them."""
        board, measured = self.board, self.monitor.reading
        if board is None or not board.limp_titles or measured.source is not Source.MEASURED:
            return q.copy()
        return np.where(board.limp & ~np.isnan(measured.q), measured.q, q)

    @property
    def limp(self) -> tuple[str, ...]:
        """Titles of joints that were released by themselves, while the others hold."""
        return () if self.board is None else self.board.limp_titles

    @property
    def held(self) -> Robot:
        """The arm with its jaws between where they are and where they go, and with what they carry."""
        grips = () if self.gripper.goal is None else (self.gripper.goal,)
        return self.robot.gripping(self.gate.opening, *grips).carrying(self.gripper.part)

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

    # What begins, and what becomes of the outputs.

    def begin(
        self, activity: Activity, who: str, now: float, ticket: Ticket | None = None, motion: str = ""
    ) -> None:
        """Begin a motion from standstill; ``motion`` is its name."""
        self.activity, self._ticket, self.motion = activity, ticket, motion
        self._pausing, self._unsent_since, self._stop_tells = False, None, ()
        self._ticks.restart(now)
        self._enter(State.MOVING, f"{activity.label} ({who})")

    def hold(self, cause: str) -> None:
        """The outputs are on, and the arm stands where the last setpoint is."""
        self.monitor.enabled()
        self._enter(State.HOLDING, cause)

    def adopt(self, q: FloatArray, opening: float | None, now: float) -> None:
        """The arm stands at ``q`` (n,) [rad] with its outputs on: the next setpoint goes on from there."""
        self.gate.jump(q, now)
        if opening is not None:
            self.gate.adopt_opening(opening, now)

    def forget(self) -> None:
        """Nobody knows any more where the arm is, or what its gripper carries."""
        self.gate.forget()
        self.gripper.forget()

    def presume(self, q: FloatArray) -> None:
        """Nobody knows where the arm is; it is drawn at ``q`` (n,) [rad], where it is said to be."""
        self.presumed = q

    def power_off(self, cause: str) -> None:
        """The outputs are off: forget where the arm is."""
        self._drop_all(StateError(cause))
        self.forget()
        self._dropped = False
        self.monitor.released()
        self._enter(State.OFF, cause)

    def disconnect(self, cause: str) -> None:
        """Close the line; the outputs stay as they are."""
        self._drop_all(StateError(Disconnected()))
        if self._opening is not None:
            self._opening.order.ticket.end(StateError(Disconnected(self._port or "")))
            self._opening.future.add_done_callback(close_opened)
            self._opening = None
        self._close_board()
        self._enter(State.DISCONNECTED, cause)
        if self.leaving is not None:
            ticket, self.leaving = self.leaving, None
            ticket.end()

    # While something moves.

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
            raise StateError(NothingTo("resume", self.state))
        self.activity.pause(False)
        self._pausing = False
        self._enter(State.MOVING, f"{self.activity.label} resumed ({who})")

    def set_speed(self, fraction: float, who: str) -> None:
        """Speed override for everything that moves."""
        if not SLOWEST <= fraction <= 1:
            raise InputError(ShareOutside("speed", fraction, SLOWEST, 1.0))
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

    def stop(self, origin: Origin, ticket: Ticket | None = None, tells: Sequence[str] = ()) -> None:
        """Slow down along the path as hard as the limits allow, then hold; drop the rest.

        A board that moves the arm by itself is told to brake; if it does not confirm, that is a fault.
        ``tells``: names of the warnings that ``origin`` tells.
        """
        ticket = Ticket.ended() if ticket is None else ticket
        ticket.accept()
        self._stopping.append(ticket)  # from here on settle answers it, or a fault
        moving, by = self.busy, Stopped(origin.who, origin.note)
        self.stops, self.last_stop = self.stops + 1, by
        if moving or self.monitor.homes or not origin.note:
            fresh = moving and self.stopped_by != by
            if fresh or not self.log.said(f"STOP ({origin})", _SAME_PRESS_S):  # a page sends each press twice
                self.log.warn(f"STOP ({origin})")
        else:
            self.log.add(f"{origin}; nothing moved, {self.state.value} as before")
        self._held_locked, self.stopped_motion = True, self.motion
        self.drop_motion(StateError(by))
        self._drop_grip(StateError(by))
        self.gripper.stop(StateError(by))
        try:
            if (activity := self.activity) is not None:
                self.stopped_by, self._stop_tells, self._pausing = by, tells, False
                activity.stop()
            elif self.board is not None and self.monitor.homes:
                self.board.hold()
            self.signals.switch(self.board, "stop")
            if activity is not None:
                return
        except ArmctlError as error:
            self.fault(error)
            return
        self._stopping.remove(ticket)  # nothing moves; what is asked for next is not waited for
        ticket.end()

    def cancel(self, motion: str, origin: Origin, ticket: Ticket) -> None:
        """STOP for the motion of that name; one that is over changes nothing."""
        if not motion:
            raise InputError("which motion is to be cancelled? STOP stops them all")
        by = Stopped(origin.who, origin.note)
        error = StateError(replace(by, how="cancelled"))
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
        if self.stopped_by is None:
            self.log.add(f"{self.activity.label} cancelled ({origin})")
            self.stopped_motion, self.stopped_by, self._pausing = motion, by, False
            try:
                self.activity.stop()
                self.signals.switch(self.board if self.activity.program is not None else None, "stop")
            except ArmctlError as failure:
                self.fault(failure)

    def fault(self, error: ArmctlError, tells: Sequence[str] = ()) -> None:
        """Something broke: send nothing more, and say why. ``tells``: names of the warnings that it tells."""
        cause = str(error)
        goes_on = self._drop_all(error)
        self.signals.switch_if_possible(self.board, "fault")
        if goes_on is not None and goes_on.reason != error.reason:
            cause = f"{cause}; and {goes_on}"
        if isinstance(error, BoardError) or goes_on is not None:
            self._close_board()  # a board that moves its motors by itself ends that when no host talks to it
        self._enter(State.FAULT, cause, tells)

    def clear_fault(self, who: str) -> None:
        """Leave fault for ``holding`` (outputs on) or ``off``."""
        if self.state is not State.FAULT:
            raise StateError(NothingTo("clear", self.state))
        if self.board is None:
            raise StateError(f"the board is gone ({self.cause}); connect again")
        self.monitor.acknowledged()
        if self.gate.q is None:
            if self.monitor.reading.powered is False:
                self.board.release()  # a board that switched its motors off by itself waits for this
            self.board.clear_faults()  # and one that switches each by itself for this
            self._enter(State.OFF, f"fault cleared ({who})")
        else:
            self._enter(State.HOLDING, f"fault cleared ({who}); the arm holds the last setpoint")

    # What waits.

    def drop_motion(self, error: ArmctlError) -> None:
        """Refuse the motion that is being planned."""
        if self._motion is not None:
            self._motion.future.cancel()
            self._motion.order.ticket.end(error)
            self._motion = None

    def _drop_edit(self, error: ArmctlError) -> None:
        if self._edit is not None:
            self._edit.future.cancel()
            self._edit.order.ticket.end(error)
            self._edit = None

    def _drop_grip(self, error: ArmctlError) -> None:
        if self._grip is not None:
            if self._grip.check is not None:
                self._grip.check.cancel()
            self._grip.order.ticket.end(error)
            self._grip = None

    def refuse(self, order: Order, label: str, error: ArmctlError) -> None:
        """Answer an order that cannot be carried out; the log tells the same once in a while."""
        words = f"{label} ({order.origin.who}) refused: {error}"
        if not self.log.said(words, _SAME_REFUSAL_S):
            self.log.warn(words)
        order.ticket.end(error)

    # The transitions.

    def _enter(self, state: State, cause: str, tells: Sequence[str] = ()) -> None:
        """Change the state; every change is logged with its cause, which ``tells`` some warnings, by name."""
        if state is not self.state:
            line = f"{self.state.value} → {state.value}: {cause}"
            self.log.add(line, "error" if state is State.FAULT else "info")
        self.state, self.cause, self.stopped = state, cause, None
        self.notices.told_by_cause(tells)

    def _end(self, activity: Activity) -> None:
        ticket, self._ticket, self.activity = self._ticket, None, None
        self._pausing, self._unsent_since = False, None
        self.notices.clear("activity")
        stopped, self.stopped_by = self.stopped_by, None
        error = activity.error
        if stopped is not None:
            error, cause = StoppedError(replace(stopped, what=activity.label)), say(stopped)
        elif error is not None:
            cause = str(error)
            self.log.add(cause, "error")
        else:
            cause = f"{activity.label} finished"
        if activity.program is not None and stopped is None:
            self.signals.switch_if_possible(self.board, "end")
        if ticket is not None:
            ticket.end(error)
        # Homing that was stopped or failed leaves an arm whose position is unknown.
        self._enter(State.OFF if self.gate.q is None else State.HOLDING, cause, self._stop_tells)
        self.stopped = stopped

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
        self.stopped_by, self._pausing = None, False
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
        self.signals.reset()
        self.notices.clear_all()
