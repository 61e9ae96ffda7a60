"""Runs a program, with pause, resume and stop; its next steps are planned while it runs."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from armctl.errors import ArmctlError, ProgramError
from armctl.program import Program
from armctl.program.base_steps import Effect, Senses, Until
from armctl.program.calls import StepPlace
from armctl.program.conditions import Condition
from armctl.program.feed import PlannedStep
from armctl.protocol import Command, ConfirmMessage, ProgramProgress, UpdateProgram
from armctl.runtime.activity import Activity, Setpoint
from armctl.runtime.core import Core
from armctl.runtime.mover import PathMover, starving_s
from armctl.runtime.program_feed import Begun, ProgramFeed

_EARLIER_S = 0.6
"""What is begun without a stop is taken this long before the arm would slow down for want of it."""
_HELD_S = 2.0
"""so long after it has closed a gripper may take to hold a part, as a vacuum does"""
_NO_TIME_S = 1e-9
"""what is left of a wait by rounding"""


class ProgramRunner(Activity):
    """One program on its way. At most one step is begun a tick, so that an empty loop cannot hang it."""

    pausable = True
    gripping = True  # its motions are checked with the gripper as its steps leave it
    led_by = (UpdateProgram, ConfirmMessage)

    def __init__(self, core: Core, loops: int | None, first: int, begun: Begun) -> None:
        """Begin ``begun`` with step ``first``, ``loops`` times (None: for ever)."""
        self._robot = robot = core.robot
        self._program = begun[0].program
        self.label = f"program {self._program.name!r}"
        self._loops = loops
        self._speed, self._percent = core.speed, 100.0
        self._gripper, self._monitor, self._signals = core.gripper, core.monitor, core.signals
        self._edges = dict(core.signals.edges)
        """of each input, when the program began or waited for it last"""
        self._counters: dict[str, int] = {}
        """of the pass that runs"""
        self._set_output = partial(core.signals.set, core.board)
        self._core, self._now = core, core.monitor.read_at
        self._log, self._tell = core.log, core.messages.tell
        self._early_s = starving_s(robot) + _EARLIER_S
        self._feed = ProgramFeed(robot, begun, core.submit, self._early_s)
        self._running: PlannedStep | None = None
        self._first = first
        self._mover: PathMover | None = None
        self._wait_left = 0.0
        self._until: Until | None = None
        """what is waited for; not longer than ``_wait_left``"""
        self._confirmed = False
        """somebody has said OK to the message of the step that waits"""
        self._gripping = False
        """a gripper step is running"""
        self.begun = False
        self._paused = False
        self._stopped = False
        self._outdated: PlannedStep | None = None
        """the first moving step of a pass that was edited: the arm stops, then the pass begins anew"""
        self._take_steps()

    @property
    def standing(self) -> bool:
        """The joints are at rest now."""
        return self._mover is None or self._mover.standing

    @property
    def done(self) -> bool:
        """All passes are over, or it was stopped or refused, and the joints are at rest."""
        if self._stopped or self.error is not None:
            return self._mover is None or self._mover.done
        busy = self._mover is not None or self._wait_left > 0 or self._gripping
        return not busy and self._feed.ended

    @property
    def notice(self) -> str | None:
        """What is waited for, or that what comes next was not planned in time."""
        if self._until is not None and self.waits:
            return f"waiting for {self._until.what}"
        return None if self._mover is None else self._mover.notice

    @property
    def waits(self) -> bool:
        """For something that comes by itself; a wait for a person is shown as a message."""
        return self._until is not None and not self._until.by_person

    @property
    def progress(self) -> float | None:
        """Share of the steps of all passes that are over; None where it runs for ever."""
        at = self.program
        if at.loops is None or not at.steps:
            return None
        of_step = 0.0 if self._mover is None else self._mover.progress
        if self._running is not None:
            ahead, share = self._running.share
            of_step = ahead + share * of_step
        return min((at.loop + (at.step + of_step) / at.steps) / at.loops, 1.0)

    def lead(self, command: Command, expires: float) -> None:
        """Go on with another version of the program, which was checked, at the next pass; or take an OK."""
        if isinstance(command, UpdateProgram):
            self._update(command.program)
        elif isinstance(command, ConfirmMessage):
            self._confirmed = True

    def _update(self, program: Program) -> None:
        self._program = program
        self.label = f"program {program.name!r}"
        self._feed.update(program)

    def set_speed(self, fraction: float) -> None:
        """Go towards this speed override; waits are not shortened or stretched."""
        self._speed = fraction
        if self._mover is not None:
            self._mover.set_speed(fraction * self._percent / 100)

    def pause(self, paused: bool) -> None:
        """Stand on the path, or stop the time of a wait; or go on."""
        self._paused = paused
        self._gripper.hold(paused and self._gripping)
        if self._mover is not None:
            self._mover.pause(paused)

    def stop(self) -> None:
        """Slow down and drop the rest."""
        self._stopped = True
        self.awaits = None
        self._gripper.hold(False)
        self._feed.drop()
        if self._mover is not None:
            self._mover.stop()

    def halt(self) -> None:
        """No setpoint is sent for now: go on from rest."""
        if self._mover is not None:
            self._mover.halt()

    def advance(self, now: float, dt: float) -> Setpoint | None:
        """Go on by ``dt`` seconds; None where no joint moves."""
        setpoint, self._now = None, now
        if self._mover is not None:
            self._take_steps()
            setpoint = self._mover.advance(now, dt)
            self._show_step(self._mover)
            if self._mover.done:
                q = self._mover.position
                self._mover = None
                if self._outdated is not None and not self._stopped:
                    self._feed.begin_pass_at(q, self._outdated.passes)
                    self._outdated = None
        elif self._wait_left > 0 and not self._paused:
            left = self._wait_left - dt
            self._wait_left = left if left > _NO_TIME_S else 0.0
            if self._until is not None:
                self._look(self._until)
        if self._gripping and self._gripper.goal is None:
            self._gripping = False
        self._take_steps()
        return setpoint

    def _look(self, until: Until) -> None:
        why = ""
        try:
            holds = until.holds(self._senses())
            if not holds and self._wait_left <= 0:
                why = f"waited {until.longest_s:g} s for {until.what}, which did not come"
            if holds or (why and until.goes_on):
                if why:
                    self._log.warn(f"{self._program.name}: {why}; it goes on")
                self._use(until.uses)
                self._end_wait()
                why = ""
        except Exception as defect:  # of a step of somebody's own
            why = f"cannot look for {until.what}: {type(defect).__name__}: {defect}"
        if why:
            self._feed.drop()
            running = self._running
            where = "" if running is None else f": step {running.index + 1}"
            why = why if running is None else f"{running.place.words}{why}"
            self._end_wait()
            self.error = ProgramError(f"{self._program.name}{where}: {why}")

    def _end_wait(self) -> None:
        self._wait_left, self._until, self.awaits = 0.0, None, None

    def _senses(self) -> Senses:
        watch = self._signals
        edges = {name: count - self._edges.get(name, 0) for name, count in watch.edges.items()}
        known = Senses.of(self._robot, self._monitor.reading.quantities, watch.inputs, edges, self._counters)
        return replace(known, confirmed=self._confirmed)

    def _use(self, name: str) -> None:
        """The edges of an input so far count as seen; no name: of none."""
        if name:
            self._edges[name] = self._signals.edges.get(name, 0)

    @property
    def program(self) -> ProgramProgress:
        """The step that runs, and its version of the program."""
        running = self._running
        if running is None:
            program, index, passes = self._program, self._first, 0
        else:
            over = self.done and not self._stopped and self.error is None
            program, index, passes = running.program, running.index, running.passes + over
        steps, place = len(program.steps), StepPlace(index) if running is None else running.place
        return ProgramProgress(
            program.name, index, steps, passes, self._loops, program, self._program, place.calls, place.part
        )

    def _take_steps(self) -> None:
        """Take the steps that are due: the next motion just before it is needed, others one a tick."""
        if self._paused or self._stopped or self._outdated is not None or self.error is not None:
            return
        try:
            while (step := self._feed.peek()) is not None and self._due(step):
                self._feed.take()
                if not self._begin(step):
                    return
        except ArmctlError as cause:
            self._feed.drop()
            if self._mover is not None:
                self._mover.end()
            error = ProgramError(f"{self._program.name}: {cause}")
            error.__cause__ = cause
            self.error = error

    def _due(self, step: PlannedStep) -> bool:
        if self._wait_left > 0 or self._gripping:
            return False
        if step.step.effect.tool and self._gripper.goal is not None:
            return False  # what somebody asked the gripper for before is not for that of another tool
        if self._mover is None:
            return True
        # What is begun at rest waits until the joints stand exactly where it begins. Where the motion
        # goes on, what moves nothing must not wait: the joints come to rest behind it only.
        return self._mover.goes_on and self._mover.remaining_s <= self._early_s

    def _begin(self, step: PlannedStep) -> bool:
        """Begin a step; whether another may be begun in the same tick."""
        if step.error is not None:
            where = f"step {step.index + 1}: {step.place.words}"
            raise ProgramError(f"{where}{step.error}") from step.error
        self.begun = True
        if step.before.program is None:  # the first of its pass
            self._counters.clear()
        if step.trajectory is not None and step.moves:
            if self._mover is not None:
                self._mover.append(step.trajectory, step, goes_on=step.goes_on)
                return True
            self._percent = step.percent
            speed = self._speed * self._percent / 100
            self._mover = PathMover(self._robot, step.trajectory, speed, tag=step, goes_on=step.goes_on)
            self._show(step)
            return True
        if self._mover is None:
            self._show(step)
        else:
            self._say(step)
        effect = step.step.effect
        if effect.counts is not None:
            name = effect.counts.counter
            self._counters[name] = effect.counts.after(self._counters.get(name, 0))
        if effect.asks is not None:
            holds = effect.asks.holds(self._senses())
            self._use(effect.asks.uses if holds else "")
            self._feed.decide(holds)
        if effect.output is not None:
            self._set_output(*effect.output)
        if effect.tool:
            self._core.equip(effect.tool, self.label, self._now)
            self._robot = self._core.robot
        if effect.wait_s is not None:
            self._wait_left = effect.wait_s
        self._until = effect.until
        if effect.until is not None:
            self._wait_left = effect.until.longest_s
        if effect.message:
            number, self._confirmed = self._tell(effect.message), False
            self.awaits = number if self._until is not None and self._until.by_person else None
        if effect.opening is not None:
            self._gripper.move_to(effect.opening, effect.part)
            self._gripping = True
            self._await_part(effect)
        return False

    def _await_part(self, effect: Effect) -> None:
        """A gripper that closes round a part, and has an input for that: see that it holds it."""
        gripper = self._robot.gripper
        if effect.part is None or gripper is None or not gripper.part_input:
            return
        held = Condition(watch=gripper.part_input)
        self._until = Until(f"the gripper to hold a part ({held})", held.holds, 1 / gripper.speed + _HELD_S)
        self._wait_left = self._until.longest_s

    def _show(self, step: PlannedStep) -> None:
        self._running = step
        self._feed.begun(step)
        self._say(step)

    def _say(self, step: PlannedStep) -> None:
        if says := step.step.effect.says:
            self._log.add(says)

    def _show_step(self, mover: PathMover) -> None:
        """The step that runs is the one whose trajectory the mover is on; its speed is asked for."""
        step = mover.tag
        if not isinstance(step, PlannedStep) or step is self._running or self._outdated is not None:
            return
        if self._feed.is_outdated(step):
            self._outdated = step
            mover.stop()
        else:
            self._show(step)
            self._percent = step.percent
            self.set_speed(self._speed)
