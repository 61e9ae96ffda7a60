"""The controller: one thread that owns time, motion and driver. Commands in, snapshots out."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import ParamSpec

import numpy as np

from armctl.errors import ArmctlError, InputError, StateError
from armctl.facts.commands import Stopped
from armctl.hardware import Driver
from armctl.protocol import (
    AxisHoming,
    Clock,
    Command,
    ControlCommand,
    HeldCommand,
    MovingCommand,
    Origin,
    Recording,
    Snapshot,
    Ticket,
)
from armctl.protocol.commands import Answer, give
from armctl.robot import Robot
from armctl.runtime.activity import Order
from armctl.runtime.black_box import BlackBox
from armctl.runtime.core import Core
from armctl.runtime.dispatch import dispatch
from armctl.runtime.last_pose import PoseFolder
from armctl.runtime.planner import Openers, Planner, planner
from armctl.runtime.signals import InputSimulator

P = ParamSpec("P")
_LOGGER = logging.getLogger("armctl.runtime")
_RATES_HZ = (10.0, 200.0)
_UNPOWERED_S, _HOLDING_S, _CALM_TICKS = 0.1, 0.05, 50
"""From tick to tick where nothing moves and nothing is powered, or the arm holds, after so many ticks of
that. STOP and what moves the arm wake the thread at all times. An arm that holds is looked at twice as often:
some boards switch off what hears nothing for 0.4 s, and a computer may be late."""
_STOPPING_S = 5.0
"""How long ``close`` waits for a moving arm to come to rest."""


class Controller:
    """Runs one arm. Any thread may use it; ``tick`` is for offline runs, without ``start``."""

    def __init__(
        self,
        robot: Robot,
        open_driver: Callable[[str], Driver],
        clock: Clock,
        rate_hz: float = 50.0,
        executor: Executor | None = None,
        published: Callable[[Snapshot], None] | None = None,
        pin: str = "",
        black_boxes: Path | None = None,
        poses: PoseFolder | None = None,
        simulate: InputSimulator | None = None,
    ) -> None:
        """Wire it up; it runs once it is started.

        ``open_driver`` gives a driver, not opened yet, for a port as the user names it. ``rate_hz``: ticks a
        second, 10 … 200, else ``InputError``. ``executor`` plans and opens lines; None: threads of its own.
        ``published`` is called behind each tick with its snapshot, once that and its answers are given.
        ``pin``: the teacher's, see ``ControlDesk``.
        ``black_boxes``: the folder where the last minute is saved at every fault; None: it is not.
        ``poses`` keeps where the arm was seen last; None: nothing is kept.
        ``simulate``: what is connected to the inputs of the simulated board; None: there is no such one.
        """
        low, high = _RATES_HZ
        if not low <= rate_hz <= high:
            raise InputError(f"a rate of {rate_hz} Hz is outside {low:.0f} … {high:.0f} Hz")
        self._clock = clock
        self._period = 1.0 / rate_hz
        self._own_executor = executor is None
        self._executor = executor or Planner()
        self._published = published
        self._wake = threading.Event()
        plan = planner(self._executor, self._wake.set)
        open_line = planner(executor or Openers(), self._wake.set)
        self._core = Core(robot, open_driver, plan, self._period, pin, poses, open_line)
        self._core.signals.let_simulate(simulate)
        self._black_box = BlackBox(robot, self._period, clock.now, black_boxes)
        self._recording = True
        self._lock = threading.Lock()
        self._orders: list[Order] = []
        self._stops: list[Order] = []
        self._answers: list[Answer] = []
        self._number = 0
        self._tick = 0
        self._pace = self._period
        """the time from tick to tick now [s]"""
        self._closing = threading.Event()
        self._closed = False
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._publish(clock.now())

    @property
    def robot(self) -> Robot:
        """The arm, with the tool that is on."""
        return self._core.robot

    @property
    def snapshot(self) -> Snapshot:
        """The arm as it was at the last tick."""
        return self._snapshot

    @property
    def ended(self) -> bool:
        """It was closed."""
        return self._closed

    def start(self) -> None:
        """Begin to tick on a thread of its own, once."""
        if self._thread is not None or self._closed:
            raise StateError("the controller was started already")
        self._thread = threading.Thread(target=self._run, name="armctl-controller", daemon=True)
        self._thread.start()

    def submit(self, command: Command, origin: Origin | None = None) -> Ticket:
        """Ask for something at the next tick; ``origin`` is for the log.

        What moves the arm brings the tick forward. What everybody may say does not: else a watcher's flood
        would be a flood of ticks.
        """
        with self._lock:
            if self._closed:
                return Ticket.ended(StateError("the controller is closed"))
            order = self._order(command, origin)
            self._orders.append(order)
        if not isinstance(command, ControlCommand):
            self._wake.set()
        return order.ticket

    def stop(self, origin: Origin | None = None) -> Ticket:
        """STOP: drops what was asked for before it; the ticket is ``finished`` when the arm is at rest."""
        with self._lock:
            if self._closed:
                return Ticket.ended()
            order = self._order(None, origin)
            self._stops.append(order)
        self._wake.set()
        return order.ticket

    def black_box(self) -> Recording:
        """The last minute: commands, setpoints, readings, log, lateness of the ticks."""
        return self._black_box.recording("asked for")

    def beat(self) -> None:
        """Nothing: who calls is part of the same process."""

    def tick(self) -> None:
        """One tick: stops, motion, commands, plans, readback, snapshot. What goes wrong is a fault."""
        now = self._clock.now()
        self._tick += 1
        core = self._core
        with self._lock:
            stops, self._stops = self._stops, []
            orders, self._orders = self._orders, []
        for stop in stops:  # each on its own: whatever one of them meets, the others are carried out
            self._note_order(stop, now)
            self._guarded(core.stop, stop.origin, stop.ticket)
        self._guarded(core.advance, now, urgent=bool(stops), pace=self._pace)
        for order in orders:
            self._note_order(order, now)
            if stops and isinstance(order.command, MovingCommand) and order.number < stops[-1].number:
                self._drop(order, stops)
            elif (broken := self._guarded(dispatch, core, order, now)) is not None:
                order.ticket.end(broken)
        self._guarded(core.take_planned, now)
        self._guarded(core.observe, now)
        self._guarded(core.settle, now)
        self._guarded(core.desk.tick, now)
        for text, level in self._black_box.results():
            core.log.add(text, level)
        self._guarded(core.keep_pose, now)
        self._guarded(self._publish, now)  # first: who waits for an answer finds its snapshot
        give(self._answers)
        self._note(self._black_box.tick, self._snapshot, self._pace)
        if self._published is not None:
            self._guarded(self._published, self._snapshot)

    def close(self) -> None:
        """Bring the arm to rest, close the line, end; the outputs stay. May be called more than once.

        Ctrl-C meanwhile is raised once the arm stands: a closed line would leave a motion unfinished.
        """
        interrupt: KeyboardInterrupt | None = None
        while True:
            try:
                self._closing.set()
                self._wake.set()
                if self._thread is not None and self._thread is not threading.current_thread():
                    self._ended.wait()  # not join(): interrupted, it takes the thread for ended
                self._shut()
                break
            except KeyboardInterrupt as another:
                interrupt = another
        if interrupt is not None:
            raise interrupt

    def _run(self) -> None:
        deadline = self._clock.now()
        ends: float | None = None
        calm = 0
        try:
            while True:
                woken = self._clock.wait_until(deadline, self._wake)
                self._wake.clear()
                if self._closing.is_set():
                    if ends is None:
                        ends = self._clock.now() + _STOPPING_S
                        self.stop(Origin("close"))
                        self.tick()  # what stands in a wait is stopped, too: its outputs are to be switched
                    if self._core.standing or self._clock.now() > ends:
                        break
                self.tick()
                now = self._clock.now()
                calm = calm + 1 if self._core.resting else 0
                self._pace = self._period
                if calm > _CALM_TICKS:
                    self._pace = max(self._period, _HOLDING_S if self._core.powered else _UNPOWERED_S)
                if not woken or now >= deadline:
                    # Missed ticks are skipped, not made up for.
                    deadline = max(deadline + self._pace, now)
                deadline = min(deadline, now + self._pace)  # what has begun does not wait as at rest
            self._shut()
        finally:
            self._ended.set()

    def _order(self, command: Command | None, origin: Origin | None) -> Order:
        """The next order; the lock is held."""
        self._number += 1
        origin = Origin() if origin is None else origin
        return Order(command, origin, Ticket(self._answers), self._clock.now(), self._number)

    def _drop(self, order: Order, stops: list[Order]) -> None:
        """Refuse an order that was given before a stop of the same tick."""
        who = next(stop.origin.who for stop in stops if order.number < stop.number)
        order.ticket.end(StateError(Stopped(who, how="unbegun")))
        if isinstance(order.command, HeldCommand):
            self._core.still_held(order.given_at)  # its key is held: it must be let go first

    def _publish(self, now: float) -> None:
        """Make the snapshot: everything that the outside may know, as it is now."""
        core = self._core
        q, board, sample = core.gate.q, core.board, core.setpoint
        reading = core.monitor.reading
        still = np.zeros_like(reading.q)
        homing: tuple[AxisHoming, ...] = ()
        if board is not None and reading.homing is not None:
            running = reading.homing.running
            homing = tuple(
                AxisHoming(board.title(channel), homed, channel == running)
                for channel, homed in reading.homing.homed.items()
            )
        warnings, told, awaited = core.notices.current(now)
        self._snapshot = Snapshot(
            stamp=now,
            tick=self._tick,
            state=core.state,
            cause=core.cause,
            q_command=core.presumed.copy() if q is None else core.standing_at(q),
            commanded=q is not None,
            velocity_command=still if sample is None else sample.velocity,
            acceleration_command=still if sample is None else sample.acceleration,
            q=reading.q,
            source=reading.source,
            powered=core.powered,
            gripper=core.gate.opening,
            part_mm=None if core.gripper.part is None else core.gripper.part.edges_mm,
            speed=core.speed,
            program=None if core.activity is None else core.activity.program,
            progress=None if core.activity is None else core.activity.progress,
            doing=core.doing,
            busy=core.busy,
            board=None if board is None else board.identity,
            homing=homing,
            warnings=warnings,
            told_by_cause=told,
            awaited=awaited,
            stopped=core.stopped,
            stops=core.stops,
            last_stop=core.last_stop,
            events=core.log.events,
            last_pose=core.poses.last,
            quantities=reading.quantities,
            limits=reading.limits,
            levels=core.monitor.levels.passed,
            inputs=core.signals.inputs,
            edges=core.signals.edges,
            outputs=core.signals.outputs,
            limp=core.limp,
            scripted=core.signals.scripted if board is not None and board.identity.simulated else (),
            message=core.messages.shown(None if core.activity is None else core.activity.awaits),
            tool=core.robot.tool,
            tool_unconfirmed=core.rack.unconfirmed,
            control=core.desk.control,
        )

    def _guarded(self, step: Callable[P, None], *args: P.args, **kwargs: P.kwargs) -> ArmctlError | None:
        """Take a step of a tick; whatever it raises is a fault and is given back, and the thread lives on."""
        try:
            step(*args, **kwargs)
        except ArmctlError as error:
            self._core.fault(error)
            return error
        except BaseException as error:  # also SystemExit: a trajectory may be a caller's own code
            if isinstance(error, KeyboardInterrupt) and self._thread is None:
                raise  # Ctrl-C while it is ticked by hand
            _LOGGER.exception("the controller broke")
            broken = ArmctlError(f"internal error: {type(error).__name__}: {error}")
            self._core.fault(broken)
            return broken
        return None

    def _note_order(self, order: Order, now: float) -> None:
        origin, finished = order.origin, order.ticket.finished
        self._note(self._black_box.order, order.command, origin.who, origin.note, finished, now)

    def _note(self, note: Callable[P, None], *args: P.args, **kwargs: P.kwargs) -> None:
        """Let the black box take note; a defect of its own must not touch the arm, and ends it."""
        try:
            if self._recording:
                note(*args, **kwargs)
        except Exception:
            self._recording = False
            _LOGGER.exception("the black box broke and records no more")

    def _shut(self) -> None:
        with self._lock:
            if self._closed:
                return
            self._closed = True
            stops, self._stops = self._stops, []
            orders, self._orders = self._orders, []
        for stop in stops:
            stop.ticket.end()
        for order in orders:
            order.ticket.end(StateError("the controller is closed"))
        self._core.poses.close()
        self._core.desk.close()
        self._core.disconnect("closed")
        self._publish(self._clock.now())
        give(self._answers)
        self._black_box.close()
        if self._own_executor:
            self._executor.shutdown(wait=False, cancel_futures=True)
