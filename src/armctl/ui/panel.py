"""The panel that is always in view: STOP, Release, what the arm does, who operates, speed."""

from __future__ import annotations

import asyncio
import math
from html import escape

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.facts import Need, State, state_words
from armctl.facts.angles import to_degrees
from armctl.facts.words import capitals
from armctl.hardware.boards import board_type
from armctl.kinematics import roll_pitch_yaw
from armctl.protocol import ClearFault, Pause, Release, Resume, SetSpeed, Snapshot, TakeControl
from armctl.robot import Robot
from armctl.ui.enabling import EnableButton
from armctl.ui.scene.arm_model import ARM, repaint
from armctl.ui.scene.stage import add_floor
from armctl.ui.session import Session
from armctl.ui.widgets.angle_fields import held_at
from armctl.ui.widgets.html import ERROR, LiveHtml, fixed, limited, muted, table

PANEL_WIDTH = 250
"""[px]"""
_MOST_LINES, _MOST_FAULT_LINES = 4, 12
"""of a cause or a warning: what the arm does must stay in view; the log has all of it"""
_RELEASE_SECONDS = _ASKED_S = 5.0
_DOUBLE_CLICK_S = 0.6
_EXPAND_S = 1.0
_STOP_NOTE = (
    "STOP (Escape): the arm stops and holds, with power. Release: THE ARM DROPS. Both are software only. "
    "They do not replace an emergency stop."
)
_SPEED_HINT = "Slows down everything that moves; the path stays the same."
_COLORS = {
    State.DISCONNECTED: "#5c636a",
    State.OFF: "#5c636a",
    State.HOLDING: "#237032",
    State.MOVING: "#1864ab",
    State.PAUSED: "#9c5500",
    State.FAULT: "#c92a2a",
}
"""behind white letters, in both themes"""
_BADGE = (
    "padding:3px 10px;border-radius:4px;color:#fff;font-size:1.15em;font-weight:700;"
    "letter-spacing:.05em;text-align:center;background:"
)
LIGHT, DARK = "Light", "Dark"
_BLUE = (24, 100, 171)
_PAUSE, _RESUME = ("Pause", viser.Icon.PLAYER_PAUSE), ("Resume", viser.Icon.PLAYER_PLAY)


def where_html(robot: Robot, q: FloatArray) -> str:
    """Joint angles and tool at ``q`` (n,) [rad]."""
    joints = [
        [joint.title, f"{angle + 0.0:.2f}°"]
        for joint, angle in zip(robot.joints, np.round(robot.shown(q), 2), strict=True)
    ]
    T = robot.forward(q)
    x, y, z = np.round(1000 * T[:3, 3], 1) + 0.0
    tool = [["X", f"{x:z.1f} mm"], ["Y", f"{y:z.1f} mm"], ["Z", f"{z:z.1f} mm"]]
    pitch, roll = robot.inverse_kinematics.pitch_and_roll(q)
    if robot.orients_tool:  # its roll counts from the plane of the arm, and changes as the base turns
        turns = np.round(to_degrees(roll_pitch_yaw(T[:3, :3])), 1) + 0.0
        tool.append(["Rx, Ry, Rz", ", ".join(f"{turn:.1f}" for turn in turns) + "°"])
        roll = None
    for name, angle in (("Pitch", pitch), ("Roll", roll)):
        if angle is not None:
            tool.append([name, f"{round(to_degrees(angle), 1) + 0.0:.1f}°"])
    heading = "<b style='display:block;margin-top:6px'>"
    angles, pose = table((), joints), table((), tool)
    return f"{heading}Joints</b>{angles}{heading}Tool</b>{pose}{rounding_note(robot, q)}"


class ControlPanel:
    """A panel of its own: viser throttles clicks a panel, and STOP must never wait for a number field."""

    def __init__(self, session: Session, window: viser.PanelHandle) -> None:
        """Fill the tab that is entered, of ``window``."""
        self._session, self._window = session, window
        gui = session.gui
        speed = round(100 * session.snapshot.speed)
        self._stop = gui.add_button("STOP", color="red", icon=viser.Icon.HAND_STOP)
        self._state = LiveHtml(gui)
        self._take = gui.add_button("Take control", icon=viser.Icon.HAND_GRAB, visible=False)
        self._clear = gui.add_button("Clear fault", color="orange", visible=False)
        session.needs(None, self._clear, told=False)
        self._enable = EnableButton(session)
        self._hold = gui.add_button(_PAUSE[0], icon=_PAUSE[1])
        self._release = gui.add_button("Release", color="gray", icon=viser.Icon.POWER)
        title = escape(f"armctl – {session.console.robot.title}")
        LiveHtml(gui, f"{muted(_STOP_NOTE)}<i hidden data-armctl-title='{title}'></i>")
        self._speed = gui.add_slider("Speed %", 5, 100, 1, initial_value=speed, hint=_SPEED_HINT)
        self._where = LiveHtml(gui)
        self._theme = gui.add_dropdown("Theme", (LIGHT, DARK), initial_value=LIGHT)
        self._asked_release = False
        self._released_at = 0.0
        self._expanded_at = self._asked_take = -math.inf
        self._operated: bool | None = None
        self._shown_at: FloatArray | None = None
        """(n,) the joint angles that are written [rad]"""
        session.on(self._stop.on_click, self._on_stop)
        hot_key = session.gui.add_command("STOP", hotkey="escape", description="Decelerate and hold")
        session.on_key(hot_key, self._on_stop)
        session.on(self._hold.on_click, self._on_hold)
        session.on(self._release.on_click, self._on_release)
        session.on(self._speed.on_update, lambda: session.submit(SetSpeed(self._speed.value / 100)))
        session.on(self._take.on_click, self._on_take)
        session.on(self._clear.on_click, lambda: session.submit(ClearFault()))
        session.on(self._theme.on_update, self._on_theme)
        hold = session.command("Pause or resume", self._on_hold, "Come to rest on the path, or go on")
        session.command("Reset view", session.look, "See the whole arm again")
        session.needs(Need.PAUSE, self._hold, hold, told=False)
        session.needs(None, self._release, also=_no_board, told=False)
        session.needs(None, self._speed, told=False)
        self._darkened: list[viser.GridHandle | viser.MeshHandle] = []
        session.on_theme(self._draw_theme)
        session.spawn(self._recall_looks())

    def refresh(self, snapshot: Snapshot) -> None:
        """Show state, operator and speed."""
        session = self._session
        self._enable.refresh(snapshot)
        fault = snapshot.state is State.FAULT and not snapshot.unreachable
        self._clear.visible = fault and snapshot.board is not None
        label, icon = _RESUME if snapshot.state is State.PAUSED else _PAUSE
        if self._hold.label != label:
            self._hold.label, self._hold.icon = label, icon
        if snapshot.state is State.MOVING and snapshot.stamp - self._expanded_at > _EXPAND_S:
            self._window.expand()  # a panel that was minimised must not hide STOP
            self._expanded_at = snapshot.stamp
        self._tell_control()
        self._take.visible = not session.operates
        if not session.operates:
            self._speed.value = round(100 * snapshot.speed)
        most = _MOST_FAULT_LINES if snapshot.state is State.FAULT else _MOST_LINES
        count = len(snapshot.control.parties) - (snapshot.control.operator is not None)
        watching = f" · {count} watching" if count else ""
        source = session.console.last_known.words(snapshot, session.console.robot.board)
        lines = [
            f"<div style='{_BADGE}{_COLORS[snapshot.state]}'>{capitals(state_words(snapshot.state))}</div>",
            limited(session.with_names(snapshot.cause), most, "opacity:.75") if snapshot.cause else "",
            f"<div>Operator: <b>{escape(session.operator)}</b>{watching}</div>",
            f"<div>Position shown: <b>{source}</b></div>",
            *(limited(f"⚠ {text}", _MOST_LINES, f"color:{ERROR}") for text in snapshot.more_warnings),
        ]
        if not session.operates:  # for the banner that is laid over the page
            lines.append(f"<i hidden data-armctl-watching='{escape(session.operator)}'></i>")
        if snapshot.unreachable:  # for what is laid over the page beside STOP
            lines.append(f"<i hidden data-armctl-lost='{escape(snapshot.cause)}'></i>")
        self._state.show("".join(lines))
        q = session.console.last_known.drawn(snapshot)
        if self._shown_at is None or not np.array_equal(q, self._shown_at):
            self._shown_at = q
            self._where.show(where_html(session.console.robot, q))

    async def _on_stop(self) -> None:
        self._session.console.controller.stop(self._session.origin)

    async def _on_hold(self) -> None:
        paused = self._session.snapshot.state is State.PAUSED
        await self._session.submit(Resume() if paused else Pause())

    def _on_theme(self) -> None:
        self._session.remember("theme", self._theme.value)
        self._use_theme()

    async def _recall_looks(self) -> None:
        if await self._session.recall("drawn-by") == "card":
            self._session.client.scene.configure_default_lights(cast_shadow=True)
        theme = await self._session.recall("theme")
        if theme in (LIGHT, DARK) and theme != self._theme.value:
            self._theme.value = theme
            self._use_theme()

    def _use_theme(self) -> None:
        self._session.use_theme("dark" if self._theme.value == DARK else "light")

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

    async def _on_release(self) -> None:
        """The first click asks, a second one within a few seconds releases."""
        self._session.require_operator()
        now = asyncio.get_running_loop().time()
        if self._asked_release:
            if now - self._released_at < _DOUBLE_CLICK_S:
                return  # the second half of a double click is no answer
            self._ask_release(False)
            await self._session.submit(Release())
            return
        self._released_at = now
        self._ask_release(True)
        self._session.spawn(self._forget_release())

    async def _forget_release(self) -> None:
        await asyncio.sleep(_RELEASE_SECONDS)
        self._ask_release(False)

    def _ask_release(self, asking: bool) -> None:
        self._asked_release = asking
        self._release.label = "DROPS! Click again" if asking else "Release"
        self._release.color = "orange" if asking else "gray"

    async def _on_take(self) -> None:
        """Where somebody else operates, the first click asks, a second one within a few seconds takes."""
        session = self._session
        now = asyncio.get_running_loop().time()
        if session.snapshot.control.operator is not None and now - self._asked_take > _ASKED_S:
            self._asked_take = now
            what = f"{session.operator} operates the arm. Click Take control again to take it."
            session.notify("Take control?", what, "yellow")
            return
        self._asked_take = -math.inf
        await session.say(TakeControl())

    def _tell_control(self) -> None:
        """Tell the page that it has control now, or has lost it."""
        session, operated = self._session, self._operated
        if session.snapshot.control.party(session.me) is None:
            return  # it has just come
        self._operated = session.operates
        if operated is None or operated is session.operates:
            return
        if session.operates:
            session.notify("Control", "This page now operates the arm.")
        else:
            session.notify(
                "Control", f"This page watches now: {session.operator} operates the arm.", "yellow"
            )


def _no_board(snapshot: Snapshot) -> str | None:
    there = snapshot.board is not None and not snapshot.unreachable
    return None if there else "no board is connected"


def set_theme(gui: viser.GuiApi, *, dark: bool) -> None:
    """Light or dark, in armctl's blue."""
    gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False, brand_color=_BLUE)


# The rounding of setpoints to the board's steps.


def joint_steps(robot: Robot) -> FloatArray:
    """(n,) by how much each joint turns with one step of its setpoint [rad]; 0 for one that is held."""
    outputs = robot.outputs
    held = np.array([held_at(joint) is not None for joint in robot.joints])
    return np.where(held, 0.0, board_type(robot.board).scale.step / np.abs(outputs.per_rad))


def rounding_off_m(robot: Robot, q: FloatArray) -> float:
    """How far off its target the tool point may be at ``q`` (n,) [rad], each joint half a step off [m]."""
    return float(np.linalg.norm(robot.jacobian(q)[:3], axis=0) @ (0.5 * joint_steps(robot)))


def rounding_note(robot: Robot, q: FloatArray) -> str:
    """One line that says why a tool that was sent to 300 mm may show 299.9 mm; ``q`` (n,) [rad]."""
    board, steps = board_type(robot.board), robot.shown(joint_steps(robot))
    turning = steps[steps > 0]
    if not len(turning):
        return ""
    low, high = (fixed(float(step), 3) for step in (turning.min(), turning.max()))
    span = f"{low}°" if low == high else f"{low} … {high}°"
    servo = f"Servo steps of {span} ({board.scale.step:g} {board.scale.unit})"
    what = f"Encoder steps of {span} (1 count)" if board.homing else servo
    off = fixed(1000 * rounding_off_m(robot, q), 2)
    return muted(f"{what}: the tool may stop up to {off} mm beside its target.")
