"""Steps of the tool: a click moves it by so many millimetres, also where friction swallows part of it.

A servo that only controls its position does not turn until its error outweighs its friction: on a small servo
bus that is half a degree, 2 mm at the tool. What is sent runs ahead of what is measured by that much, and by
what the arm sags. So a step is counted from where the tool was measured, or was to be by the clicks before;
once the arm stands, what is missing is sent after it, in small slow motions like any other.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from functools import partial

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, MotionRefusedError, StateError
from armctl.facts import Need, State
from armctl.facts.angles import DEGREE
from armctl.facts.targets import ToolStepRefused
from armctl.hardware import Source
from armctl.protocol import MoveJoints, Snapshot
from armctl.robot import Robot
from armctl.ui.dragged_tool import dragged_to
from armctl.ui.events import came_to_end
from armctl.ui.session import Session
from armctl.ui.tabs.manual.joints import slow_duration
from armctl.ui.widgets.html import LiveHtml, muted, numbers

_STEPS_MM = {"−10": -10.0, "−3": -3.0, "−1": -1.0, "+1": 1.0, "+3": 3.0, "+10": 10.0}
_BASE_ROWS = ("X ahead mm", "Y left mm", "Z up mm")
_SHEET_ROWS = ("X sheet mm", "Y sheet mm", "Z up mm")
_MOST_STEP_RAD = 30.0 * DEGREE
"""a step that turns a joint by more is no small one: the arm stands near a singularity, or would turn over"""
_BASE_NOTE = "X, Y and Z are the base's: red, green and blue arrow at the tool."
_SHEET_NOTE = "X and Y are along the sheet: X away from the base, Y to the left."
_SENT = 1e-6
"""a command that differs by less is the one that was sent [rad]"""
_NEAR_M = 0.0004
"""a tool that is measured so near is there: a count of an encoder is about as much"""
_TRIES = 6
_COUNT = 0.06 * DEGREE
"""a joint that is off by less is not sent further"""
_MOVED = 0.12 * DEGREE
"""a joint that was measured to turn by more than a count has turned"""
_SIDES = (1.0, -1.0)
_PUSHES = (0.1 * DEGREE, 0.8 * DEGREE)
"""how much further a joint is sent that did not turn: where its friction is known, and where it is not"""
_MOST_AHEAD = 3.0 * DEGREE
"""so much further than a click asks for a joint is sent at most: where that is too little it is held"""
_LOOK_S, _LOOKS = 0.08, 12
"""how often it is looked whether the arm stands, and how many times at most"""
Pause = Callable[[float], Awaitable[None]]
Sense = Callable[[], Sequence[float]]
Heading = Callable[[], float | None]


class StepAhead:
    """How far ahead of what is measured joints are sent, so that they come to where they are to be.

    A joint that turns to larger angles stands at one edge of its friction when it comes to rest, one that
    turns to smaller angles at the other edge. Both are learned by what the motions do.
    """

    def __init__(self, n: int) -> None:
        self.width = np.zeros(n)
        """(n,) by how much more a joint is sent ahead when it turns the other way [rad]; 0: not known yet"""
        self._edges = np.full((2, n), np.nan)
        """(2, n) how far ahead joints are sent to turn to larger angles, and to smaller ones; NaN: unknown"""
        self._left = np.full((3, n), np.nan)
        """(3, n) when a step ended early: what was sent, where the arm stood, and the lead before it [rad]"""

    def leave(self, now: Snapshot, lead: FloatArray) -> None:
        """A step has ended early; before it joints were sent so far ahead: ``lead`` (n,) [rad]."""
        self._left = np.array([now.q_command, now.q, lead])

    def begin(self, now: Snapshot, sense: FloatArray) -> FloatArray:
        """The arm was moved by something else; how far ahead its joints are sent now (n,) [rad].

        ``sense`` (n,): in which sense its joints turned last, 1 or -1; 0: not known.
        """
        sent, stood, lead = self._left
        # it may still press on what it was sent into
        stays = _is_same(now.q_command, sent) and np.abs(now.q - stood).max() <= _MOVED
        ahead = lead if stays else now.q_command - now.q
        self._edges = np.where(np.array(_SIDES)[:, None] == sense, ahead, np.nan)
        return ahead

    def wanted(self, way: FloatArray, ahead: FloatArray) -> FloatArray:
        """(n,) how far ahead to send joints that are to turn by ``way`` (n,), and are sent ``ahead`` now."""
        this, other = np.where(way > 0.0, self._edges, self._edges[::-1])
        guess = np.where((self.width > 0.0) & ~np.isnan(other), other + np.sign(way) * self.width, ahead)
        return np.where(np.isnan(this), guess, this)

    def learn(self, turned: FloatArray, missing: FloatArray, ahead: FloatArray) -> None:
        """Joints sent so far ``ahead`` have ``turned``, and have so much ``missing``: (n,) [rad]."""
        for k, side in enumerate(_SIDES):
            here = side * turned > _MOVED
            stuck = (np.abs(turned) <= _MOVED) & (side * missing > _COUNT)
            known = (self.width > 0.0) & ~np.isnan(self._edges[1 - k])
            further = ahead + side * np.where(known, *_PUSHES)
            self._edges[k] = np.where(here, ahead, np.where(stuck, further, self._edges[k]))
        seen = (np.abs(turned) > _MOVED) & ~np.isnan(self._edges).any(axis=0)
        width = self._edges[0] - self._edges[1]
        self.width = np.where(seen & (width > 0.0), width, self.width)


class _Motion:
    """What goes on by clicks, how it ended, and who waits for that."""

    def __init__(self) -> None:
        self._over = asyncio.Event()
        self._over.set()
        self._came = True
        """whether the last one led where it was to"""
        self._awaited = False

    @property
    def goes_on(self) -> bool:
        """Whether it is not over yet."""
        return not self._over.is_set()

    async def run(self, lead: Callable[[], Awaitable[bool]]) -> None:
        """Let ``lead`` move the arm; it says whether that led where it was to."""
        self._over.clear()
        self._came = False
        try:
            self._came = await lead()
        finally:
            self._over.set()

    async def ended(self) -> None:
        """Wait until none goes on; ``StateError``: it led elsewhere, or somebody waits already."""
        if not self.goes_on:
            return
        if self._awaited:
            raise StateError("it waits already until the step is done")
        self._awaited = True
        try:
            while self.goes_on:
                await self._over.wait()
        finally:
            self._awaited = False
        if not self._came:
            raise StateError("the arm did not come there; look where the tip is, then press again")


class ToolSteps:
    """A row of steps for each axis: a click moves the tool by so much, and stops."""

    def __init__(
        self,
        session: Session,
        sense: Sense | None = None,
        heading: Heading | None = None,
        pause: Pause = asyncio.sleep,
    ) -> None:
        """``sense`` gives (n,) in which sense each joint turned last; ``pause`` waits for so many seconds.

        ``heading`` gives that of a sheet whose axes the steps are along [rad]; None: the base's.
        """
        gui, self._session, self._pause = session.gui, session, pause
        n = session.console.robot.n
        self._sense: Sense = (lambda: (0.0,) * n) if sense is None else sense
        self._heading: Heading = (lambda: None) if heading is None else heading
        self._on_sheet = False
        self._clicks: list[FloatArray] = []
        """(3,) each, by how far the tool is to go by those that are not solved yet [m]"""
        self._motion = _Motion()
        self._at, self._sent = np.zeros(n), np.full(n, np.nan)
        """(n,) where the clicks so far lead, and what was sent for that [rad]"""
        self._ahead = StepAhead(n)
        self._rows = [gui.add_button_group(label, tuple(_STEPS_MM)) for label in _BASE_ROWS]
        for axis, row in enumerate(self._rows):
            session.needs(self.need, row, told=False)
            session.on(row.on_click, partial(self._on_step, axis, row))
        session.needs(self.need, hint="A click moves the tip at once.")
        self._note, self._moved = LiveHtml(gui), ""
        self._draw_note()

    def need(self) -> Need | None:
        """What the next click needs of the arm: nothing while it moves by an earlier one."""
        return None if self.stepping else Need.HOLDING

    @property
    def stepping(self) -> bool:
        """Whether the arm still moves by clicks, or is looked at whether it came there."""
        return self._motion.goes_on

    async def settled(self) -> None:
        """Wait until it does not; ``StateError``: it did not come there, or somebody waits already."""
        await self._motion.ended()

    async def _on_step(self, axis: int, row: viser.GuiButtonGroupHandle) -> None:
        await self.step(_STEPS_MM[row.value] / 1000 * _axes(self._heading())[axis])

    def refresh(self) -> None:
        """Say along which axes the steps are."""
        on_sheet = self._heading() is not None
        if on_sheet != self._on_sheet:
            self._on_sheet = on_sheet
            for row, label in zip(self._rows, _SHEET_ROWS if on_sheet else _BASE_ROWS, strict=True):
                row.label = label
            self._draw_note()

    async def step(self, step_m: FloatArray) -> None:
        """Move the tool by (3,) [m] along the base's axes; refused out of reach, or where it cannot move."""
        self._session.require_operator()
        self._clicks.append(step_m)
        if self.stepping:  # whoever moves the arm takes it along
            return
        try:
            await self._motion.run(self._step)
        finally:
            self._clicks = []

    async def _step(self) -> bool:
        """Go where the clicks lead, those that come meanwhile too; whether the tool has come there."""
        now = self._session.snapshot
        stops, measures = now.stops, is_measured(now)
        first = now.q_command - now.q
        if not self._is_where_sent(now):
            self._at, self._sent = now.q if measures else now.q_command, now.q_command
            first = self._ahead.begin(now, np.array(self._sense()))
        begin = now.q
        while self._clicks:
            before = self._at
            goal = self._at = await self._solved()
            came = False
            try:
                if measures:
                    came = await self._go_measured(goal, first, stops)
                else:
                    came = await self._send(self._sent + goal - before)
            finally:
                if not came:  # what is missing is not made good by the next click
                    self._ahead.leave(self._session.snapshot, first)
                    self._sent = np.full(len(goal), np.nan)
            if not came:
                return False
            first = self._sent - self._session.snapshot.q
        if measures:
            self._show_moved(begin)
        return True

    async def _solved(self) -> FloatArray:
        """(n,) where the clicks lead [rad], or as many of them as one motion may do at once; the rest wait.

        ``MotionRefusedError``: the first of them leads nowhere.
        """
        count, fewer = len(self._clicks), False
        while True:
            step_m = np.sum(self._clicks[:count], axis=0)
            try:
                goal = await asyncio.to_thread(tool_stepped, self._session.held, self._at, step_m)
            except MotionRefusedError:
                if count == 1:
                    raise
                count, fewer = count // 2, True
            else:
                if not fewer and count < len(self._clicks):  # clicked meanwhile
                    count = len(self._clicks)
                    continue
                del self._clicks[:count]
                return goal

    async def _go_measured(self, goal: FloatArray, first: FloatArray, stops: int) -> bool:
        """Send joints until the tool is measured at ``goal`` (n,), or back where something holds it.

        ``first``: (n,) how far ahead of what is measured they are sent where nothing is in the way.
        ``stops``: of the snapshot when it began. Whether it may go on: it was not stopped, and holds.
        """
        robot, q, ahead, asked_m = self._session.held, self._session.snapshot.q, first, 0.0
        for tries in range(_TRIES + 1):
            way = goal - q
            off_m = float(np.linalg.norm(robot.forward(goal)[:3, 3] - robot.forward(q)[:3, 3]))
            asked_m = max(asked_m, off_m)
            if off_m < _NEAR_M or (tries == _TRIES and off_m < asked_m / 2):
                return True
            if tries == _TRIES:
                break
            wanted = np.clip(self._ahead.wanted(way, ahead), first - _MOST_AHEAD, first + _MOST_AHEAD)
            if not await self._send(np.where(np.abs(way) > _COUNT, goal + wanted, q + ahead)):
                return False
            now = await self._stand(stops)
            if now is None:
                return False
            ahead = self._sent - now
            self._ahead.learn(now - q, goal - now, ahead)
            q = now
            if self._clicks:  # clicked meanwhile, or more than one motion may do: on from here
                return True
        await self._send(q + first)  # it does not go on to press against what holds it
        return False

    def _is_where_sent(self, snapshot: Snapshot) -> bool:
        """Whether nothing else has moved the arm, and nothing has kept it from what was sent."""
        return _is_same(snapshot.q_command, self._sent)

    async def _stand(self, stops: int) -> FloatArray | None:
        """(n,) where the arm is measured once it stands [rad].

        None: STOP, it holds no more, or something else moves it.
        """
        before: FloatArray | None = None
        for _ in range(_LOOKS):
            now = self._session.snapshot
            holds = now.state is State.HOLDING and is_measured(now) and self._is_where_sent(now)
            if not holds or now.stops != stops:
                return None
            if before is not None and now.q is not before and np.abs(now.q - before).max() < _COUNT:
                return now.q
            before = now.q
            await self._pause(_LOOK_S)
        return before

    async def _send(self, q: FloatArray) -> bool:
        """Go to ``q`` (n,) [rad]; whether the arm came there, or was stopped."""
        self._sent = np.clip(q, *self._session.held.limits.T)
        way = self._sent - self._session.snapshot.q_command
        move = MoveJoints(self._sent, slow_duration(self._session.held, way))
        return await came_to_end(await self._session.submit(move))

    def _show_moved(self, begin: FloatArray) -> None:
        tips = [self._session.held.forward(q)[:3, 3] for q in (begin, self._session.snapshot.q)]
        moved = numbers(1000 * _axes(self._heading()) @ (tips[1] - tips[0]), 1)
        self._moved = f" Moved by {moved} mm, as measured."
        self._draw_note()

    def _draw_note(self) -> None:
        """Two lines, before a click and after it: what lies below stays under the pointer."""
        axes = _SHEET_NOTE if self._on_sheet else _BASE_NOTE
        self._note.show(muted(axes) + muted(f"Clicks add up.{self._moved}"))


def _is_same(command: FloatArray, sent: FloatArray) -> bool:
    return np.allclose(command, sent, rtol=0.0, atol=_SENT)


def _axes(heading: float | None) -> FloatArray:
    """(3, 3) the axes X, Y and Z of the steps in its rows, base frame; ``heading`` None: the base's own."""
    c, s = math.cos(heading or 0.0), math.sin(heading or 0.0)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def is_measured(snapshot: Snapshot) -> bool:
    """Whether the board measures where all joints stand."""
    return snapshot.source is Source.MEASURED and not snapshot.limp and not np.isnan(snapshot.q).any()


def tool_stepped(robot: Robot, q: FloatArray, step_m: FloatArray) -> FloatArray:
    """The configuration (n,) [rad] with the tool (3,) [m] further than at ``q``, base axes, the nearest one.

    With the tool turned as it is, where the arm can. ``MotionRefusedError``: out of reach, or too far a turn.
    """
    point = robot.forward(q)[:3, 3] + step_m
    goal: FloatArray | None = None
    if not robot.orients_tool:
        with suppress(ArmctlError):  # no such pitch there, or the arm has none
            pitch, roll = robot.inverse_kinematics.pitch_and_roll(q)
            goal = robot.inverse(point, pitch=pitch, roll=roll, start=q).best("least-travel", q)
    if goal is None or np.abs(goal - q).max() > _MOST_STEP_RAD:
        goal = dragged_to(robot, point, q)
    x, y, z = step_m.tolist()
    if goal is None:
        raise MotionRefusedError(ToolStepRefused((x, y, z)))
    if np.abs(goal - q).max() > _MOST_STEP_RAD:
        raise MotionRefusedError(ToolStepRefused((x, y, z), turns=_MOST_STEP_RAD))
    return goal
