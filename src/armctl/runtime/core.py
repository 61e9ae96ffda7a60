"""What the controller thread owns: board, gate, activity and state, and how they change."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError, BoardError, MotionRefusedError, StateError
from armctl.hardware import Driver
from armctl.motion import Floor
from armctl.robot import Robot
from armctl.runtime.activity import Activity, Setpoint
from armctl.runtime.board import Board
from armctl.runtime.commands import Origin
from armctl.runtime.gate import Gate
from armctl.runtime.gripper import GripperMover
from armctl.runtime.joint_servo import KeepClear
from armctl.runtime.log import EventLog, Notices
from armctl.runtime.monitor import Monitor
from armctl.runtime.mover import PathMover
from armctl.runtime.planner import BegunProgram, Planner
from armctl.runtime.program_runner import ProgramRunner
from armctl.runtime.snapshot import State
from armctl.runtime.tick_time import LONGEST_TICKS, TickTime
from armctl.runtime.ticket import Ticket
from armctl.runtime.upcoming import Upcoming

FloatArray = NDArray[np.float64]
POWERED = (State.HOLDING, State.MOVING, State.PAUSED)
_READ_INTERVAL_S = 0.02
_LOGGER = logging.getLogger("armctl.runtime")


class Core:
    """The arm's state. Only one thread at a time may use it."""

    def __init__(
        self, robot: Robot, open_driver: Callable[[str], Driver], planner: Planner, period: float
    ) -> None:
        self.robot = robot
        self.open_driver = open_driver
        self.planner = planner
        self.period = period
        self.log = EventLog()
        self.notices = Notices(self.log)
        self.floor = Floor(robot)
        self.clear = KeepClear(robot)
        self.gate = Gate(robot, LONGEST_TICKS * period)
        self.gripper = GripperMover(robot.gripper)
        self.monitor = Monitor(robot, self.notices, self.log, max(period, _READ_INTERVAL_S))
        self.board: Board | None = None
        self.state = State.DISCONNECTED
        self.cause = "not connected yet"
        self.activity: Activity | None = None
        self.ticket: Ticket | None = None
        self.upcoming = Upcoming(self.log)
        self.stopping: list[Ticket] = []
        self.stopped_by = ""
        self.leaving: Ticket | None = None
        self.pausing = False
        self.speed = 1.0
        self.jogged_at = -math.inf
        self.jog_locked = False
        self.setpoint: Setpoint | None = None
        self._ticks = TickTime(period, self.notices, self.log)

    @property
    def standing(self) -> bool:
        """No joint moves."""
        return self.activity is None or self.activity.standing

    def enter(self, state: State, cause: str) -> None:
        """Change the state; every change is logged with its cause."""
        if state is not self.state:
            line = f"{self.state.value} → {state.value}: {cause}"
            (self.log.error if state is State.FAULT else self.log.info)(line)
        self.state, self.cause = state, cause

    def begin(self, activity: Activity, ticket: Ticket | None, who: str, now: float) -> None:
        """Start doing something from standstill."""
        activity.set_speed(self.speed)
        self.activity, self.ticket = activity, ticket
        self.pausing = False
        self._ticks.restart(now)
        self.enter(State.MOVING, f"{activity.label} ({who})")

    def take_planned(self, now: float) -> None:
        """Begin the motion that was asked for, once its plan is there."""
        taken = self.upcoming.take_motion(self.gate.q if self.state is State.HOLDING else None)
        if taken is None:
            return
        asked, plan = taken
        activity: Activity
        if isinstance(plan, BegunProgram):
            activity = ProgramRunner(
                self.robot, asked.loops, asked.first, plan, self.planner, self.gripper, self.speed
            )
        else:
            activity = PathMover(self.robot, plan, self.speed, asked.label)
        self.begin(activity, asked.ticket, asked.who, now)

    def advance(self, now: float, *, urgent: bool) -> None:
        """Move on to ``now`` and send one setpoint where something changed."""
        tick = self._ticks.take(now, urgent=urgent)
        if tick is None or self.state not in POWERED:
            return
        if tick.late_s is not None:
            self.monitor.doubt()
            if self.activity is not None and self.gate.q is not None:
                self._ticks.tell_late(tick.late_s, now)
        if self.monitor.doubtful:
            # What is written to a board that has lost its power switches the pulses on again with a jump.
            self.setpoint = None
            if self.activity is not None:
                self.activity.halt()
            return
        self.setpoint = None if self.activity is None else self.activity.advance(now, tick.dt)
        opening = self.gripper.advance(tick.dt, self.speed)
        self._send(None if self.setpoint is None else self.setpoint.q, opening, now)

    def settle(self, now: float) -> None:
        """Draw the conclusions of a tick: what has ended, what stands, what is refused."""
        self.gripper.settle()
        activity = self.activity
        if activity is not None:
            self._settle_activity(activity)
        if self.activity is None:
            for ticket in self.stopping:
                ticket.finish()
            self.stopping.clear()
            self._leave_now()

    def stop(self, origin: Origin, ticket: Ticket) -> None:
        """Slow down along the path as hard as the limits allow, then hold; drop the rest.

        A board that moves the arm by itself is told to brake; if it does not confirm, that is a fault.
        """
        who = str(origin)
        ticket.accept()
        self.stopping.append(ticket)  # from here on settle answers it, or a fault
        self._tell_stop(origin)
        self.jog_locked = True
        self.upcoming.drop_motion(StateError(f"stopped by {who}"))
        self.gripper.stop(StateError(f"stopped by {who}"))
        try:
            if self.activity is not None:
                self.stopped_by = who
                self.pausing = False
                self.activity.stop()
                return
            if self.board is not None and self.monitor.homes:
                self.board.hold()
        except ArmctlError as error:
            self.fault(error)
            return
        self.stopping.remove(ticket)  # nothing is under way; what is asked for next is not waited for
        ticket.finish()

    def _tell_stop(self, origin: Origin) -> None:
        """A STOP is a warning; only one that nobody pressed, and that found nothing to stop, is none."""
        busy = self.activity is not None or self.upcoming.has_motion or self.gripper.moving
        if busy or self.monitor.homes or not origin.note:
            self.log.warning(f"STOP ({origin})")
        else:
            self.log.info(f"{origin}; nothing moved, {self.state.value} as before")

    def drop_all(self, error: ArmctlError) -> ArmctlError | None:
        """Forget everything that runs or waits; the arm gets no further setpoint.

        Returns:
            why a board that moves the arm by itself may go on; None: it does not.
        """
        self.upcoming.drop_motion(error)
        goes_on = self._drop_activity()
        if self.ticket is not None:
            self.ticket.refuse(error)
            self.ticket = None
        self.gripper.stop(error)
        for ticket in self.stopping:
            ticket.finish()  # nothing moves any more: what STOP asked for
        self.stopping.clear()
        self.stopped_by = ""
        self.pausing = False
        self.setpoint = None
        self.notices.clear("activity")
        return goes_on

    def fault(self, error: ArmctlError) -> None:
        """Something broke: send nothing more, and say why."""
        cause = str(error)
        goes_on = self.drop_all(error)
        if goes_on is not None:
            cause = f"{cause}; and {goes_on}"
        if isinstance(error, BoardError) or goes_on is not None:
            self._close_board()  # a board that moves its motors by itself ends that when nobody talks to it
        self.enter(State.FAULT, cause)
        self._leave_now()

    def disconnect(self, cause: str) -> None:
        """Close the line; the outputs stay as they are."""
        self.drop_all(StateError("disconnected"))
        self._close_board()
        self.enter(State.DISCONNECTED, cause)
        if self.leaving is not None:
            ticket, self.leaving = self.leaving, None
            ticket.finish()

    def power_off(self, cause: str) -> None:
        """The pulses are off: forget where the arm is."""
        self.drop_all(StateError(cause))
        self.gate.forget()
        self.gripper.set(None)
        self.monitor.released()
        self.enter(State.OFF, cause)
        self._leave_now()

    def observe(self, now: float) -> None:
        """Read back where it is due, and compare."""
        board = self.board
        if board is None or not self.monitor.due(now):
            return
        reading = self.monitor.read(board, now)
        q = self.gate.q
        if reading is None:
            return
        if q is None:
            self.monitor.check_released()
            return
        if reading.errors and self.activity is not None and not self.stopping:
            self.stop(Origin(f"the board reports {', '.join(reading.errors)}"), Ticket())
        lost = self.monitor.went_by_itself(q, now)
        if lost is not None:
            self.gate.forget()
            self.gripper.set(None)
            if self.state is not State.FAULT:  # a fault that is there already keeps its cause
                text = f"{lost}; see to its power and its errors, then clear the fault and enable"
                self.fault(MotionRefusedError(text))
            return
        self.monitor.compare(board, q, self.standing and not self.gripper.moving, now)

    def powered(self) -> bool:
        """The pulses are on, as far as is known."""
        if self.gate.q is not None:
            return self.board is not None
        return bool(self.monitor.reading.on.any())

    def _drop_activity(self) -> ArmctlError | None:
        """Have what runs end; an error where the board does not confirm that it does."""
        activity, self.activity = self.activity, None
        if activity is None:
            return None
        try:
            activity.stop()
        except ArmctlError as error:
            return error
        except Exception as error:  # a defect here must not keep a fault from being one
            _LOGGER.exception("%s could not be stopped", activity.label)
            if self.monitor.homes:
                return ArmctlError(f"internal error: {type(error).__name__}: {error}")
        return None  # without setpoints an arm that the board does not move by itself stands still

    def _settle_activity(self, activity: Activity) -> None:
        if activity.begun and self.ticket is not None:
            self.ticket.accept()
        if activity.notice is not None:
            self.notices.set("activity", activity.notice)
        else:
            self.notices.clear("activity")
        if activity.done:
            self._end(activity)
        elif self.pausing and activity.standing and self.state is State.MOVING:
            self.enter(State.PAUSED, f"{activity.label} paused")

    def _end(self, activity: Activity) -> None:
        ticket, self.ticket, self.activity = self.ticket, None, None
        self.pausing = False
        self.notices.clear("activity")
        stopped, self.stopped_by = self.stopped_by, ""
        error = activity.error
        if stopped:
            error = StateError(f"{activity.label} was stopped by {stopped}")
            cause = f"stopped by {stopped}"
        elif error is not None:
            cause = str(error)
            self.log.error(cause)
        else:
            cause = f"{activity.label} finished"
        if ticket is not None:
            if error is None:
                ticket.finish()
            else:
                ticket.refuse(error)
        # Homing that was stopped or failed leaves an arm of which nobody knows where it is.
        self.enter(State.OFF if self.gate.q is None else State.HOLDING, cause)

    def _send(self, q: FloatArray | None, opening: float | None, now: float) -> None:
        if self.board is None:
            return
        q, opening = self.gate.admit(q, opening, now)
        if q is not None or opening is not None:
            self.board.write(q, opening)

    def _close_board(self) -> None:
        if self.board is not None:
            self.board.close()
            self.board = None
        self.gate.forget()
        self.gripper.set(None)
        self.monitor.reset()
        self.notices.clear_all()

    def _leave_now(self) -> None:
        """The arm stands: carry out a disconnect that waited for it."""
        if self.leaving is not None:
            self.disconnect("asked for")
