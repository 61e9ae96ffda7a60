"""What is in view on every tab: the bar on top, what must be known now, and where the arm is and goes next.

STOP stands at the left end of the bar, on a line of its own (``guard/overlay.js``). Nothing in the bar comes,
goes or moves: what cannot be done is grey, and says why.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Coroutine
from html import escape
from typing import Any

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import InputError, out_of_range
from armctl.facts import Need, State, say, state_words
from armctl.facts.angles import to_degrees
from armctl.facts.words import capitals
from armctl.kinematics import roll_pitch_yaw
from armctl.protocol import (
    ClearFault,
    ConfirmMessage,
    Message,
    Pause,
    Release,
    Resume,
    SetSpeed,
    Snapshot,
    TakeControl,
)
from armctl.robot import Robot
from armctl.ui.docs import page_of
from armctl.ui.enabling import EnableControl
from armctl.ui.scene.arm_model import ARM, repaint
from armctl.ui.scene.ghost import NEAREST
from armctl.ui.scene.stage import add_floor
from armctl.ui.session import Session
from armctl.ui.widgets.html import button, fixed, sentence, with_minus
from armctl.ui.widgets.number_field import parse_number

_ASKED_S = 5.0
"""how long a button that asks waits to be pressed again"""
_DOUBLE_CLICK_S = 0.6
_SPEED_HINT = "Slows down everything that moves; the path stays the same."
_RELEASE_NOTE = "THE ARM DROPS. Software only: it replaces no emergency stop."
_SINKS_NOTE = "THE ARM SINKS, within a second: support it. Software only: it replaces no emergency stop."
_SUPPORT = "Support the arm: it sinks within a second, then its motors are off."
"""of a board that takes the torque away by and by"""
_SLOWEST, _FASTEST = 5, 100
LIGHT, DARK = "Light", "Dark"
_BLUE = (24, 100, 171)
_FITS = 28
"""letters of a cause that a phone has room for below the state"""
_BAR, _ALERTS, _WHERE = "bar", "alerts", "where"
_PRIMARY = "primary"
"""the one thing to do while the arm is off or paused, or the page watches: no other button is filled then"""
_SHOW_ALL = (
    f"<p>{button('show-all', 'Show all', icon='all', title='A part of the ghost is outside the picture')}</p>"
)


class ControlBar:
    """The bar, the alerts over the scene, and the numbers beside the arm."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._enabling = EnableControl(session)
        self._releasing, self._taking = (AskingButton(session.spawn, self._draw) for _ in range(2))
        self._paused_at = -math.inf
        self._speeds_said = 0
        """how often a speed was typed: the field shows what counts, also where it was refused"""
        self._operated: bool | None = None
        self._message_seen: int | None = None
        """number of the newest message that the page knows"""
        self._where: tuple[FloatArray, FloatArray | None, str, str, str, bool] | None = None
        """what the numbers were written for"""
        self._darkened: list[viser.GridHandle | viser.MeshHandle] = []
        for do, label, action in (
            ("stop", "STOP", self._on_stop),
            ("enable", "Enable", self._enabling.enable),
            ("enable-elsewhere", "Enable", self._enabling.enable_elsewhere),
            ("take", "Take control", self._on_take),
            ("clear", "Clear fault", lambda: session.submit(ClearFault())),
            ("theme", "Theme", self._on_theme),
            ("show-all", "Show all", session.view.look),
        ):
            session.on_press(do, label, lambda _, action=action: action())
        session.on_press("release", "Release", self._on_release)
        session.on_press("pause", "Pause", self._on_pause)
        session.on_press("message-ok", "OK", self._on_message_ok)
        session.on_part_value("speed", self._on_speed)
        hot_key = session.gui.add_command("STOP", hotkey="escape", description="Slow down, and hold")
        session.on_key(hot_key, self._on_stop)
        hold = session.command("Pause or resume", self._on_hold, "Rest on the path, or go on")
        session.needs(Need.PAUSE, hold, told=False)
        session.command("Reset view", session.view.look, "See the whole arm again")
        session.on_theme(self._draw_theme)
        session.spawn(self._recall_looks())

    def refresh(self, snapshot: Snapshot) -> None:
        """Show what the arm does, who operates it, where it is, and what can be done."""
        session = self._session
        self._enabling.refresh(snapshot)
        self._tell_control()
        self._tell_message(snapshot.message)
        source = session.console.last_known.words(snapshot, session.console.robot.board)
        program = snapshot.program if snapshot.state is State.MOVING else None
        cause = snapshot.cause if program is None else f"runs {program.name!r}"
        if snapshot.stopped is not None:
            cause = say(session.with_names(snapshot.stopped))
        session.parts.show(_BAR, self._bar(snapshot, cause, source))
        session.parts.show(_ALERTS, self._alerts(snapshot, cause))
        q, then, kind = session.console.last_known.drawn(snapshot), session.next.in_view, "next"
        if session.ghost.seen:
            then, kind = session.ghost.q, NEAREST if session.ghost.label == NEAREST else "looked"
        now, known, _ = source.partition(";")
        now = now if known else "now"  # "unknown; drawn where Enable would put it"
        unknown = now.startswith("unknown")  # what is drawn then is nobody's pose
        outside = session.view.misses(then)
        before = self._where
        same = before is not None and _same(q, before[0]) and _same(then, before[1])
        if before is None or not same or (now, kind, snapshot.tool, outside) != before[2:]:
            self._where = q, then, now, kind, snapshot.tool, outside
            numbers = where_html(session.arm, q, then, now=None if unknown else now, kind=kind)
            session.parts.show(_WHERE, numbers + _SHOW_ALL * outside)

    def _draw(self) -> None:
        self.refresh(self._session.snapshot)

    # What it shows.

    def _bar(self, snapshot: Snapshot, cause: str, source: str) -> str:
        """``cause`` of the state; ``source`` of the position that is shown."""
        session, robot, shown = self._session, self._session.console.robot, source.partition(";")[0]
        limp = f"<small>{len(snapshot.limp)} limp</small>" if snapshot.limp else ""
        said = way_out(snapshot) or cause
        state = (
            f"<div class='state {snapshot.state.value}{' limp' if limp else ''}' role='status'>"
            f"<b>{escape(capitals(state_words(snapshot.state)))}{limp}</b>"
            f"<span title='{escape(cause)}'>{escape(with_minus(said))}</span></div>"
        )
        fault = snapshot.state is State.FAULT and snapshot.board is not None and not snapshot.unreachable
        on = button("enable", "Enable", why=self._enabling.why_not(snapshot), kind=_PRIMARY)
        asks = self._releasing.asked
        off = button(
            "release",
            ("Sinks! Press again" if _sinks(snapshot) else "Drops! Press again") if asks else "Release",
            key="drop" if asks else "ask",
            why=session.why_not(None, snapshot) or _no_board(snapshot),
            title=_SINKS_NOTE if _sinks(snapshot) else _RELEASE_NOTE,
            kind="asks" if asks else "",
        )
        if fault:  # nothing can be paused then
            hold = button("clear", "Clear fault", why=session.why_not(None, snapshot), kind="warn")
        else:
            resumes = snapshot.state is State.PAUSED
            key, label = ("resume", "Resume") if resumes else ("pause", "Pause")
            why, kind = session.why_not(Need.PAUSE, snapshot), _PRIMARY if resumes else ""
            hold = button("pause", label, key=key, why=why, kind=kind)
        others = len(snapshot.control.parties) - (snapshot.control.operator is not None)
        second = f"<span>{others} watching</span>" if others else "<span></span>"
        if not session.operates:
            second = take_html(session.operator, asks=self._taking.asked)
        marks = f"<i hidden data-armctl-title='{escape(f'armctl – {robot.title}')}'></i>"
        if not session.operates:  # for the banner that is laid over the page
            marks += f"<i hidden data-armctl-watching='{escape(session.operator)}'></i>"
        if snapshot.unreachable:  # for what is laid over the page beside STOP
            marks += f"<i hidden data-armctl-lost='{escape(snapshot.cause)}'></i>"
        other = "dark" if session.theme == "light" else "light"
        theme = button("theme", "", title=f"{other.capitalize()} theme", kind="bare", icon="theme")
        return (
            f"{state}<div class='power'>{on}{off}</div>{hold}{self._speed(snapshot)}"
            f"<div class='who'><span>Operator: <b>{escape(session.operator)}</b></span>{second}</div>"
            f"<div class='what'><b>{escape(robot.title)}</b>"
            f"<span title='Position shown: {escape(source)}'>Position shown: {escape(shown)}</span></div>"
            f"{theme}{self._help()}{marks}"
        )

    def _help(self) -> str:
        """The page of the docs about what is looked at, in a tab of its own of the browser."""
        page = page_of((self._session.ghost.tab or "control").lower())
        return f"<a class='bare' href='{page}' target='_blank' title='Help' aria-label='Help'>?</a>"

    def _speed(self, snapshot: Snapshot) -> str:
        speed, why = round(100 * snapshot.speed), self._session.why_not(None, snapshot)
        off = f" disabled title='{escape(why)}'" if why else f" title='{_SPEED_HINT}'"
        off += f" data-said='{self._speeds_said}'"
        return (
            f"<div class='speed'><label for='armctl-speed'>Speed %</label>"
            f"<input id='armctl-speed' inputmode='decimal' data-set='speed' value='{speed}'{off}>"
            f"<input type='range' min='{_SLOWEST}' max='{_FASTEST}' data-set='speed' value='{speed}' "
            f"aria-label='Speed, percent'{off}></div>"
        )

    def _alerts(self, snapshot: Snapshot, cause: str) -> str:
        """What has to be known now, the gravest first."""
        lines = warning_lines(snapshot)
        if self._releasing.asked and _sinks(snapshot):
            lines.insert(0, f"<p class='warn'>⚠ {_SUPPORT}</p>")
        if snapshot.state is State.FAULT and cause:
            lines.insert(0, f"<p class='bad'>⚠ {escape(sentence(cause))}</p>")
        elif cause:  # where the bar has no room for it
            fits = " short" if len(cause) <= _FITS or snapshot.program is not None else ""
            lines.append(f"<p class='cause{fits}'>{escape(sentence(cause))}</p>")
        why = self._session.why_not(None, snapshot)
        return message_html(snapshot.message, why) + "".join(lines) + self._enabling.html(snapshot)

    # What is done there.

    async def _on_stop(self) -> None:
        self._session.console.stop(self._session.origin)

    async def _on_hold(self) -> None:
        paused = self._session.snapshot.state is State.PAUSED
        await self._session.submit(Resume() if paused else Pause())

    async def _on_pause(self, key: str) -> None:
        """What the button said when it was pressed; the second half of a double click is no Resume."""
        now = asyncio.get_running_loop().time()
        if key == "pause":
            self._paused_at = now
            await self._session.submit(Pause())
        elif now - self._paused_at > _DOUBLE_CLICK_S:
            await self._session.submit(Resume())

    async def _on_message_ok(self, key: str) -> None:
        """OK to the message that the button stood below."""
        if key.isdecimal():
            await self._session.submit(ConfirmMessage(int(key)))

    def _tell_message(self, message: Message | None) -> None:
        """What a program only tells; one that waits stands over the scene."""
        number = 0 if message is None else message.number
        new = self._message_seen not in (None, number)
        self._message_seen = number
        if new and message is not None and not message.waits:
            self._session.notify("Message of the program", message.text)

    async def _on_speed(self, _: str, text: str) -> None:
        self._speeds_said += 1
        percent = parse_number(text, "Speed %")
        if not _SLOWEST <= percent <= _FASTEST:
            raise InputError(f"speed: {out_of_range(percent, _SLOWEST, _FASTEST, '%')}")
        await self._session.submit(SetSpeed(percent / 100))

    async def _on_release(self, key: str) -> None:
        """Asks first, since the arm drops; the second half of a double click is no answer."""
        self._session.require_operator()
        if self._releasing.answered(said=key == "drop", after_s=_DOUBLE_CLICK_S):
            await self._session.submit(Release())

    async def _on_take(self) -> None:
        """Asks first where somebody else operates."""
        if self._session.snapshot.control.operator is None or self._taking.answered():
            await self._session.say(TakeControl())

    def _tell_control(self) -> None:
        """Tell the page that it has control now, or has lost it."""
        session, operated = self._session, self._operated
        if session.snapshot.control.party(session.me) is None:
            return  # it has just come
        self._operated = session.operates
        if session.operates:
            self._taking.end()
        if operated is None or operated is session.operates:
            return
        if session.operates:
            session.notify("Control", "This page now operates the arm.")
        else:
            session.notify(
                "Control", f"This page watches now: {session.operator} operates the arm.", "yellow"
            )

    # Light and dark.

    def _on_theme(self) -> None:
        theme = DARK if self._session.theme == "light" else LIGHT
        self._session.remember("theme", theme)
        self._session.use_theme("dark" if theme == DARK else "light")

    async def _recall_looks(self) -> None:
        if await self._session.recall("drawn-by") == "card":
            self._session.client.scene.configure_default_lights(cast_shadow=True)
        if await self._session.recall("theme") == DARK:
            self._session.use_theme("dark")

    def _draw_theme(self) -> None:
        """What is drawn for all pages is light; a page that is dark draws some of it in other colours."""
        session, dark = self._session, self._session.theme == "dark"
        set_theme(session.gui, dark=dark)
        for node in self._darkened:
            node.remove()
        self._darkened = []
        if dark:
            scene, robot = session.client.scene, session.console.robot
            self._darkened = [add_floor(scene, robot, dark=True), *repaint(scene, robot, ARM, "dark")]
        self._draw()


class AskingButton:
    """Of a button that asks before it does what it says; pressed again within a few seconds, it does it."""

    def __init__(
        self, spawn: Callable[[Coroutine[Any, Any, None]], object], draw: Callable[[], None]
    ) -> None:
        self._spawn, self._draw = spawn, draw
        self.asked = False
        self._pressed_at = -math.inf

    def answered(self, *, said: bool = True, after_s: float = 0.0) -> bool:
        """Whether this press is the answer; else it asks.

        ``said``: that the button showed the question when it was pressed. A press sooner than ``after_s``
        after the last one is neither: a double click, or a key that is held.
        """
        now = asyncio.get_running_loop().time()
        last, self._pressed_at = self._pressed_at, now
        answers = False
        if now - last >= after_s:
            answers = self.asked and said
            self.asked = not answers
        if self.asked:
            self._draw()
            self._spawn(self._forget(now))
        return answers

    def end(self) -> None:
        """Ask no more."""
        self.asked = False

    async def _forget(self, pressed_at: float) -> None:
        """The question ends by itself, unless the button was pressed since."""
        await asyncio.sleep(_ASKED_S)
        if self.asked and pressed_at == self._pressed_at:
            self.asked = False
            self._draw()


def take_html(operator: str, *, asks: bool) -> str:
    """The button by which a page that watches takes control; once pressed it asks, and is pressed again."""
    question = f"Take it from {operator}? Press again" if asks else ""
    return button("take", "Take control", kind="asks" if asks else _PRIMARY, asks=question)


def way_out(snapshot: Snapshot) -> str:
    """What to do about a fault, whose cause stands over the scene; empty: there is none."""
    if snapshot.state is not State.FAULT:
        return ""
    if snapshot.unreachable:
        return "the arm does not answer"
    return "connect again in Main" if snapshot.board is None else "clear the fault, then enable"


def warning_lines(snapshot: Snapshot) -> list[str]:
    """The warnings that the cause does not tell; then what a program waits for: a state, no fault."""
    awaited = {snapshot.warnings[k] for k in snapshot.awaited}
    shown = snapshot.more_warnings
    waits = [f"<p class='waits'>{escape(sentence(text))}</p>" for text in shown if text in awaited]
    warned = [text for text in shown if text not in awaited]
    return [*(f"<p class='warn'>⚠ {escape(with_minus(text))}</p>" for text in warned), *waits]


def message_html(message: Message | None, why: str | None) -> str:
    """The card of a message that waits for OK; ``why``: why this page cannot say it. Else nothing."""
    if message is None or not message.waits:
        return ""
    ok = button("message-ok", "OK", key=str(message.number), why=why)
    return (
        f"<section class='message' role='alertdialog' aria-label='Message of the program'>"
        f"<b>The program asks</b><p>{escape(message.text)}</p>{ok}</section>"
    )


def _sinks(snapshot: Snapshot) -> bool:
    """Whether Release takes the torque away by and by: where the arm stands, and its board can."""
    able = snapshot.board is not None and "scale_torque" in snapshot.board.abilities
    return able and snapshot.state is State.HOLDING


def _no_board(snapshot: Snapshot) -> str | None:
    there = snapshot.board is not None and not snapshot.unreachable
    return None if there else "no board is connected"


def _same(q: FloatArray | None, before: FloatArray | None) -> bool:
    return q is before if q is None or before is None else np.array_equal(q, before)


def set_theme(gui: viser.GuiApi, *, dark: bool) -> None:
    """Light or dark, in armctl's blue."""
    gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False, brand_color=_BLUE)


_THEN = {"next": "next", "looked": "looked at", NEAREST: NEAREST}


def where_html(
    robot: Robot,
    q: FloatArray,
    then: FloatArray | None = None,
    *,
    now: str | None = "now",
    kind: str = "next",
) -> str:
    """Joint angles and tool at ``q`` (n,) [rad], under ``now``, and at the next pose; None: there is none.

    ``now`` None: nobody knows where the arm is, and ``q`` is only drawn. ``kind``: "next", or "looked" for a
    pose that is only looked at, or ``NEAREST``.
    """
    columns: list[tuple[str, str, list[str]]] = []
    rows = _figures(robot, q)
    if now is not None:
        columns.append((now, "", [figure for _, _, figure in rows]))
    elif then is None:
        columns.append(("not known", "", ["–"] * len(rows)))
    if then is not None:
        style = "next" if kind == "next" else "looked"
        columns.append((_THEN[kind], f" class='{style}'", [figure for _, _, figure in _figures(robot, then)]))
    heads = "".join(f"<th{style}>{escape(head)}</th>" for head, style, _ in columns)
    html = f"<table aria-label='Joints and tool'><tr><td></td>{heads}</tr>"
    for i, (name, unit, _) in enumerate(rows):
        cells = "".join(f"<td{style}>{figures[i]}</td>" for _, style, figures in columns)
        begins = " class='tool'" if i == robot.n else ""
        html += f"<tr{begins}><th>{escape(name)} <small>{escape(unit)}</small></th>{cells}</tr>"
    return f"{html}</table>"


def _figures(robot: Robot, q: FloatArray) -> list[tuple[str, str, str]]:
    """Name, unit and figure of each joint, then of the tool."""
    rows = [
        (joint.title, joint.unit.strip(), fixed(angle, 1))
        for joint, angle in zip(robot.joints, robot.shown(q).tolist(), strict=True)
    ]
    T = robot.forward(q)
    point = (1000 * T[:3, 3]).tolist()
    rows += [(axis, "mm", fixed(value, 1)) for axis, value in zip("XYZ", point, strict=True)]
    pitch, roll = robot.inverse_kinematics.pitch_and_roll(q)
    if robot.orients_tool:  # its roll counts from the plane of the arm, and changes as the base turns
        turns = map(to_degrees, roll_pitch_yaw(T[:3, :3]).tolist())
        rows += [(f"R{axis}", "°", fixed(turn, 1)) for axis, turn in zip("xyz", turns, strict=True)]
        roll = None
    for name, angle in (("Pitch", pitch), ("Roll", roll)):
        if angle is not None:
            rows.append((name, "°", fixed(to_degrees(angle), 1)))
    return rows
