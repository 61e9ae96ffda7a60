"""Jog with a gamepad, a 3D mouse, or two thumbs on the glass: the arm moves while somebody holds on.

The page reads them (``guard/sticks.js``) and says what is pushed, twenty times a second, as long as the
button that has to be held is down. Each time one short jog command follows, which expires by itself.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from functools import partial
from html import escape
from itertools import product

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.facts import Need
from armctl.facts.angles import DEGREE
from armctl.protocol import Frame, Jog, JogTool, MonotonicClock, MoveGripper, Snapshot
from armctl.protocol.snapshot import tool_turns
from armctl.robot import Robot
from armctl.ui.session import Session
from armctl.ui.widgets.html import muted, strong, table
from armctl.ui.widgets.number_field import parse_numbers

_PART = "sticks"
_SAID = ("forward", "left", "up", "turn", "lift", "lean", "when")
FORWARD, LEFT, UP, TURN, LIFT, LEAN = range(6)
_DIRECTIONS = np.array(
    [np.array(one) / np.linalg.norm(one) for one in product((-1, 0, 1), repeat=3) if any(one)]
)
"""(26, 3): along the axes, and halfway between two or three of them"""
_KEPT = math.cos(30.0 * DEGREE)
"""a hand that wavers by less than this about the present direction keeps it"""
_OF_JOINTS = (LEFT, FORWARD, UP, LIFT, TURN, LEAN)
"""what turns the first joint that can turn, the second, …"""
_LATE_MS = 150.0
"""what was pushed so much longer ago than what came fastest is not done any more"""
_NAMES = (
    "left stick ↑ ↓", "left stick ← →", "right stick ↑ ↓", "right stick ← →", "cross ↑ ↓", "cross ← →",
)  # fmt: skip
_LET_GO, _STOPPED = "let go", "stopped"
"""said instead of numbers; behind a STOP nothing else is to be sent"""
_OFF, _ON = "Gamepad is off: press to switch on", "Gamepad is ON: press to switch off"
_REST = "The arm moves for as long as a stick is pushed, and no other way."
_UNSEEN = "No gamepad and no 3D mouse is seen. Plug it in, and press a button on it."
RESTS_S = 0.1
"""within which the arm rests once somebody lets go: no joint is led faster than from where it can"""
_TAKEN_S = 0.04
"""after which the arm brakes: it takes what is said at one tick, and obeys at the next"""
_BRAKES_S = RESTS_S - _TAKEN_S
_NOTE = (
    "Hold a shoulder button (L1 or R1; the left button of a 3D mouse), then push a stick. Once you let go, "
    f"the arm rests within {RESTS_S:g} s: no joint is led faster than that allows. A and B close and open "
    "the gripper. The buttons in the middle are STOP."
)
_THUMBS = "Or push with one or two thumbs here; lifting them stops the arm."

Send = Callable[[Callable[[], Jog | JogTool]], Awaitable[None]]
"""one tick of what is held"""


class StickAim:
    """From what is pushed to jog commands. The tool goes along one of 26 directions: a jog keeps a line."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._turns = [i for i, (low, high) in enumerate(robot.limits.tolist()) if low < high]
        self._pitches, self._rolls = (True, True) if robot.orients_tool else tool_turns(robot)
        self._resting = _BRAKES_S * robot.acceleration_limits / robot.speed_limits
        """(n,) the shares of their speed from which joints rest in time"""
        self._direction: FloatArray | None = None

    def let_go(self) -> None:
        """Whatever is pushed next begins anew."""
        self._direction = None

    def joints(self, pushed: FloatArray, share: float) -> Jog | None:
        """Turn joints by ``pushed`` (6,), -1 … 1, at ``share`` of their speed; None: nothing is pushed."""
        rates = np.zeros(self._robot.n)
        for joint, source in zip(self._turns, _OF_JOINTS, strict=False):
            rates[joint] = min(share, self._resting[joint]) * pushed[source]
        return Jog(rates) if rates.any() else None

    def tool(self, pushed: FloatArray, rates: tuple[float, float], frame: Frame) -> JogTool | None:
        """Move the tool, or turn it where that is pushed more; None: nothing is pushed that this arm can do.

        ``pushed`` (6,) -1 … 1; ``rates`` of what is pushed to its end: along [m/s], about [rad/s].
        """
        linear, turns = pushed[:3], pushed[3:]
        speed, rate = rates
        if float(np.abs(turns).max()) > float(np.abs(linear).max()):
            self._direction = None
            turn, lift, _ = turns.tolist()
            lifts = abs(lift) >= abs(turn)
            if not (self._pitches if lifts else self._rolls):
                return None
            of_pitch, of_roll = (rate * lift, 0.0) if lifts else (0.0, rate * turn)
            return JogTool(np.zeros(3), of_pitch, of_roll, frame, rests_s=_BRAKES_S)
        size = float(np.linalg.norm(linear))
        if size == 0.0:
            self._direction = None
            return None
        direction = self._direction
        if direction is None or float(direction @ linear) < _KEPT * size:
            direction = self._direction = _DIRECTIONS[int(np.argmax(_DIRECTIONS @ linear))]
        return JogTool(min(size, 1.0) * speed * direction, frame=frame, rests_s=_BRAKES_S)

    def moved(self, *, joints: bool) -> list[tuple[str, str]]:
        """What each stick moves, and how it is called."""
        if joints:
            titles = [self._robot.joints[i].title for i in self._turns]
            return [(_NAMES[source], title) for source, title in zip(_OF_JOINTS, titles, strict=False)]
        turns = [(TURN, "Roll")] * self._rolls + [(LIFT, "Pitch")] * self._pitches
        axes = [(FORWARD, "X"), (LEFT, "Y"), (UP, "Z"), *turns]
        return [(_NAMES[source], name) for source, name in axes]


class StickJog:
    """A switch, what the sticks move, and pads for two thumbs. Off until the operator switches it on."""

    def __init__(
        self,
        session: Session,
        send: Send,
        joint_share: Callable[[], float],
        tool_rates: Callable[[], tuple[float, float]],
        now: Callable[[], float] = MonotonicClock.now,
    ) -> None:
        """The speeds are those of the buttons: a share 0 … 1 of each joint's; the tool's [m/s], [rad/s]."""
        self._session, self._send, self._now = session, send, now
        self._joint_share, self._tool_rates = joint_share, tool_rates
        self._aim = StickAim(session.console.robot)
        self._moves: dict[str, Frame | None] = {
            "Tool, base axes": "base",
            "Tool, tool axes": "tool",
            "Joints": None,
        }
        self._on = self._pushing = self._held_back = False
        self._seen = ""
        self._fastest = math.inf
        """[ms] of what is said since it is held, how long the fastest was on its way, but for a constant"""
        gui = session.gui
        self._switch = gui.add_button(_OFF, color="gray", icon=viser.Icon.DEVICE_GAMEPAD_2)
        self._choice = gui.add_dropdown("Sticks move", tuple(self._moves))
        session.parts.add(gui, _PART)
        session.needs(None, self._switch)
        session.needs(Need.JOG, hint=_REST)
        session.on(self._switch.on_click, self._on_switch)
        session.on(self._choice.on_update, self._draw)
        session.on_part_value("sticks", self._on_pushed)
        session.on_part_value("sticks-seen", self._on_seen)
        session.on_part_value("sticks-jaw", self._on_jaw)
        self._draw()

    def refresh(self, snapshot: Snapshot) -> None:
        """Let who holds on feel that the arm cannot go on; a page that no longer operates hears no sticks."""
        if self._on and not self._session.operates:
            self._set(on=False)
        held_back = self._pushing and snapshot.doing is not None and snapshot.doing.notice is not None
        if held_back != self._held_back:
            self._held_back = held_back
            self._draw()

    def _on_switch(self) -> None:
        self._session.require_operator()
        self._set(on=not self._on)

    def _set(self, *, on: bool) -> None:
        self._on, self._pushing = on, False
        self._switch.label = _ON if on else _OFF
        self._switch.color = "orange" if on else "gray"
        self._draw()

    def _draw(self) -> None:
        moved = self._aim.moved(joints=self._moves[self._choice.value] is None)
        self._session.parts.show(
            _PART, _html(moved, self._seen, held_back=self._held_back) if self._on else ""
        )

    async def _on_seen(self, _: str, name: str) -> None:
        self._seen = name
        self._draw()

    async def _on_jaw(self, _: str, what: str) -> None:
        if self._on and self._session.console.robot.gripper is not None and what in ("open", "close"):
            await self._session.submit(MoveGripper(float(what == "open")))

    async def _on_pushed(self, _: str, value: str) -> None:
        if not self._on:
            return
        if value in (_LET_GO, _STOPPED):
            self._fastest = math.inf
            self._pushing &= value == _LET_GO
            await self._rest()
            return
        *pushed, when = parse_numbers(value, "sticks", _SAID)
        took = 1000.0 * self._now() - when
        self._fastest = min(self._fastest, took)
        if took > self._fastest + _LATE_MS:
            return  # this console stood still meanwhile; what is pushed now comes behind it
        if max(map(abs, pushed)) > 1.0:
            raise InputError(f"sticks: each is -1 … 1, not {max(pushed, key=abs):g}")
        command = self._command(np.array(pushed))
        if command is None:
            await self._rest()
            return
        self._pushing = True
        await self._send(lambda: command)

    def _command(self, pushed: FloatArray) -> Jog | JogTool | None:
        frame = self._moves[self._choice.value]
        if frame is None:
            return self._aim.joints(pushed, self._joint_share())
        return self._aim.tool(pushed, self._tool_rates(), frame)

    async def _rest(self) -> None:
        """Nothing is pushed any more: slow down now, not when the last command expires."""
        self._aim.let_go()
        pushing, self._pushing = self._pushing, False
        doing = self._session.snapshot.doing
        if pushing and doing is not None and doing.jogged and not doing.stopping:
            await self._send(partial(Jog, np.zeros(self._session.console.robot.n)))


def _html(moved: list[tuple[str, str]], seen: str, *, held_back: bool) -> str:
    state = strong(seen) if seen else muted(_UNSEEN)
    pads = "".join(
        f"<div role='img' data-thumb='{across} {upwards}' aria-label='Thumb pad: {escape(name)}'></div>"
        for across, upwards, name in ((LEFT, FORWARD, "left stick"), (TURN, UP, "right stick"))
    )
    legend = table(("Push", "moves"), [list(one) for one in moved], words=(0, 1))
    return (
        f"<div data-sticks='{'held' if held_back else ''}'>{state}<div class='armctl-thumbs'>{pads}</div>"
        f"{muted(_THUMBS)}{legend}{muted(_NOTE)}</div>"
    )
