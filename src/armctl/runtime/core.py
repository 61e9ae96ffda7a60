"""What the controller thread does with the arm: one tick, and what was done elsewhere meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, BoardError, MotionRefusedError, StateError
from armctl.facts import Need, State, ToolHoldsPart, ToolWhileMoving, commands
from armctl.motion.preflight import require_gaps
from armctl.protocol import TIMING, Origin, Ticket
from armctl.protocol.clock import AFTER_GAP_S
from armctl.protocol.snapshot import POWERED
from armctl.robot import CarriedPart
from armctl.robot.signals import ON
from armctl.runtime.activity import Activity, Order
from armctl.runtime.board import Board
from armctl.runtime.monitor import BOARD_REPORTS, LATE_SHOWN_S, UNANSWERED, reported
from armctl.runtime.mover import PathMover
from armctl.runtime.planner import LONGEST_PLAN_S, Grip, Pending, result_of
from armctl.runtime.state import ArmState

_UNSENT_S = 1.0
"""so long the end of a motion waits for the line"""


class Core(ArmState):
    """The arm as the controller runs it. Only one thread at a time may use it; nothing else writes to it."""

    # Connecting.

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
            board.equip(self.robot)  # another tool may be on than when the line was asked for
            self._connected(board, opening.order.origin.who, now)
        except ArmctlError as error:
            if self.board is not None:
                self.disconnect(str(error))
            self._enter(State.DISCONNECTED, str(error))
            self.refuse(opening.order, opening.label, error)
        else:
            opening.order.ticket.end()

    def _connected(self, board: Board, who: str, now: float) -> None:
        reading = self.monitor.read(board, now)
        answered = reading is not None
        if reading is not None:
            self.signals.take(reading, now)
        identity, power = board.identity, board.power
        self.rack.connected(simulated=identity.simulated)
        for note in identity.notes:
            self.log.add(note)
        for words in identity.earlier:
            self.log.warn(words)
        if self.powered:
            cause = f"its {power} are on already: Enable takes the arm over where it is"
        else:
            cause = f"{power} are off" if answered else f"it has not said yet whether its {power} are on"
        self.log.add(f"connected to {identity.title} at {identity.port} ({who})")
        self._enter(State.OFF, f"connected; {cause}")

    def leave(self, ticket: Ticket, who: str) -> bool:
        """Disconnect, after the arm was brought to rest; whether that is done at once."""
        if self.activity is not None:
            self.stop(Origin(f"disconnect, {who}"))
            self.leaving = ticket
        elif self.state is not State.DISCONNECTED or self._opening is not None:
            self.disconnect(f"disconnected ({who})")
        return self.leaving is None

    def await_last(self, ticket: Ticket) -> None:
        """Answer ``ticket`` when what runs has ended."""
        self._ticket = ticket

    def set_tool(self, name: str, who: str, now: float) -> None:
        """Somebody says which tool is on; refused while something moves. Nothing moves by it.

        An arm that gives way stands lower with a heavier tool: as its outputs stay, it is somewhere else.
        """
        if self.busy:
            raise StateError(ToolWhileMoving(self.cause))
        board, q = self.board, self.gate.q
        told = None if board is None or q is None else board.map.outputs(q)
        changed = self._put_on(name, who, now)
        if changed and board is not None and told is not None and board.map.deflection is not None:
            self.gate.jump(np.clip(board.map.angles(told), *self.robot.limits.T), now)

    def equip(self, name: str, who: str, now: float) -> None:
        """A program has another tool on from now on; the joints stand.

        An arm that gives way is told anew where it stands, for the weight of that tool: so it was planned.
        That is done bit by bit (``Board.equip``), as somebody may have a hand there.
        """
        self._put_on(name, who, now, self.gate.q)

    def _put_on(self, name: str, who: str, now: float, q: FloatArray | None = None) -> bool:
        """A tool counts in all that moves from now on; whether it is another one."""
        part = self.gripper.part
        if part is not None and name != self.robot.tool:
            raise StateError(ToolHoldsPart(str(part)))
        changed = name != self.robot.tool
        self.rack.change(name)
        self._take_tool(now, q)
        self.log.add(f"tool: {name} ({who})")
        return changed

    def _take_tool(self, now: float, q: FloatArray | None = None) -> None:
        on, self._gripped = self.rack.on, ()
        self.robot, self.around, self.clear = on.robot, on.around, on.clear
        self.gate.equip(on.robot)
        self.gripper.equip(on.robot.gripper)
        if self.board is None or not self.board.equip(on.robot, q):
            return
        opening, reading = None, self.monitor.read(self.board, now)
        if self.gate.q is not None and self.board.grips and reading is not None:
            opening = reading.opening
        self.gate.forget_opening()
        if opening is not None:
            self.gate.adopt_opening(opening, now)

    # What is done on other threads.

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
            raise StateError(commands.PlanningAlready())
        future = self.submit(plan, self.held, start, *args)
        self._motion = Pending(order, label, future, start, take)

    def move_gripper(self, order: Order, opening: float, part: CarriedPart | None) -> None:
        """Move the gripper to ``opening`` 0..1, where ``part`` is between its jaws.

        The rest of a motion that is under way is checked first, off this thread, with the jaws anywhere from
        where they are to ``opening``. While a motion is being planned, the gripper waits for it to begin.
        """
        self._drop_grip(StateError(commands.Superseded("gripper")))
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

    def await_edit(self, order: Order, label: str, future: Future[None], take: Callable[[Any], None]) -> None:
        """Take an edit over once it is checked; an earlier one that is still being checked is refused."""
        self._drop_edit(StateError(commands.Superseded("edit")))
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
                    raise StateError(commands.StartLeft())
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
                error = StateError(commands.PlannedTooLong(LONGEST_PLAN_S))
                drop(error)
                self.refuse(pending.order, pending.label, error)

    # One tick.

    def advance(self, now: float, *, urgent: bool, pace: float) -> None:
        """Move on to ``now`` and send one setpoint where something changed; ``pace``: see ``TickTime``."""
        ticks = self._ticks
        dt = ticks.take(now, pace, urgent=urgent)
        if dt is None:
            return
        if ticks.late_before is not None:
            self.log.warn(ticks.late_before, TIMING)
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
                until = now + LATE_SHOWN_S
                self.notices.set("late", ticks.count_late(now), until, about=TIMING)
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
        if q is None and self.board.catching_up and activity is not None and not self._pausing:
            q = self.gate.q
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
            self.log.warn(f"{words}; the arm stood still, the board is looked at first", TIMING)
            self._held_locked = True
        else:
            if activity is not None:
                activity.halt()  # no setpoint went out meanwhile: it stands, and needs no way to brake
            self.stop(Origin("armctl", f"{words}; it does not go on by itself, ask for it again"))
        self._held_at = now  # a jog or a live target that is asked for all the time must be let go of first

    def require_no_gap(self, now: float) -> None:
        """Refuse (``StateError``) what may have been asked for before a gap, and would move the arm now."""
        if now - self._gap_ended < AFTER_GAP_S:
            raise StateError(commands.AfterGap(self._gap_s))

    def observe(self, now: float) -> None:
        """Read back where it is due, and compare."""
        board, monitor = self.board, self.monitor
        if board is None or now < monitor.due_at:
            return
        reading = monitor.read(board, now)
        stoppable = self.activity is not None and not (self._stopping or self.activity.releasing)
        if monitor.unreliable is not None and stoppable:
            self.stop(Origin("armctl", monitor.unreliable), tells=(UNANSWERED,))
        if reading is None:
            return
        self.signals.take(reading, now)
        if board.switches_gripper and self.gripper.goal is None and self.gate.opening != reading.opening:
            self._adopt_switched(reading.opening, now)
        q = self.gate.q
        if q is None:
            monitor.check_released()
            monitor.check_unasked(enabling=self.activity is not None)
            return
        self._dropped |= bool(monitor.take_dropped())
        if reading.errors and stoppable and not self._stopping:
            told = Origin("armctl", f"{BOARD_REPORTS}{'; '.join(reading.errors)}")
            self.stop(told, tells=list(map(reported, reading.errors)))
        standing = self.standing and self.gripper.goal is None
        grips = self.gate.opening is not None and board.grips
        lost = monitor.went_by_itself(board, q, standing, now, grips=grips)
        if lost is not None:
            self.forget()
            if self.state is not State.FAULT:  # a fault that is there already keeps its cause
                self.fault(MotionRefusedError(lost.words), tells=list(map(reported, lost.errors)))
            return
        monitor.compare(board, q, standing, now)

    def _adopt_switched(self, opening: float | None, now: float) -> None:
        """A gripper that is an output is as that is: STOP may have opened it, and what it held is gone."""
        if opening is None or self.gate.opening is None:
            return
        self.gate.adopt_opening(opening, now)
        if opening > ON:
            self.gripper.forget()

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
                self.notices.set("activity", activity.notice, awaited=activity.waits)
            if activity.done and (self.stopped_by is not None or self._on_the_wire(now)):
                self._end(activity)
            elif self._pausing and activity.standing and self.state is State.MOVING:
                self._enter(State.PAUSED, f"{activity.label} paused")
        if self.activity is None:
            if self._stopping:
                self._answer_stops()
            if self.leaving is not None:
                self.disconnect("asked for")

    def keep_pose(self, now: float) -> None:
        """Have the pose kept for the next start; a disk that takes nothing is only a warning."""
        identity = None if self.board is None else self.board.identity
        moving = self.state is State.MOVING or self.gripper.goal is not None or bool(self.limp)
        self.poses.note(identity, self.gate.q, self.gate.opening, self.state, moving, now, self.robot.tool)
        if self.poses.last is not None and self.rack.presume(self.poses.last.tool):
            self._take_tool(now)
        if self.activity is None:
            self.presumed = self.robot.first_pose if self.poses.last is None else self.poses.last.q
        if self.poses.problem is None:
            self.notices.clear("last pose")
        else:
            self.notices.set("last pose", self.poses.problem)
