"""Sliders that are edited first and sent by a button, and −/+ steps that move one joint at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import InputError, MotionRefusedError, out_of_range
from armctl.facts import Need
from armctl.facts.angles import DEGREE, to_degrees
from armctl.hardware import Source
from armctl.hardware.boards import board_type
from armctl.kinematics import roll_pitch_yaw
from armctl.protocol import MoveJoints, Snapshot
from armctl.robot import Robot
from armctl.ui.events import came_to_end
from armctl.ui.next_pose import PoseWriter
from armctl.ui.session import Session
from armctl.ui.viser_seam import slider_marks
from armctl.ui.widgets.angle_fields import held_at, slider_degrees, slider_limits
from armctl.ui.widgets.html import LiveHtml, fixed, muted, table
from armctl.ui.widgets.number_field import in_row, slider_rows

# The live table: where the tool is, how it moves, and what the joints are told and do.


_PROBE_S = 1e-4
_READ_S = 0.2
"""as often does a moving arm's table change"""


def tool_motion(
    robot: Robot, q: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The tool point's position, velocity and acceleration, each (3,) [m, m/s, m/s²] in the base frame.

    ``v = J q̇`` and ``a = J q̈ + J̇ q̇``, of joints (n,) [rad, rad/s, rad/s²]; ``J̇`` is the central difference
    of the Jacobian along ``q̇``.
    """
    J = robot.jacobian(q)[:3]
    probes = robot.jacobian(np.stack([q + _PROBE_S * velocity, q - _PROBE_S * velocity]))[:, :3]
    J_dot = (probes[0] - probes[1]) / (2 * _PROBE_S)
    return robot.forward(q)[:3, 3], J @ velocity, J @ acceleration + J_dot @ velocity


class LiveReadout:
    """The same table in one or more places; computed anew only when the arm's state is another."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._blocks: list[LiveHtml] = []
        self._shown: tuple[object, ...] = ()
        self._shown_at = -_READ_S

    def add_to(self, gui: viser.GuiApi) -> None:
        """Show the table in the present GUI container, too, once it is unfolded."""
        with gui.add_folder("Numbers", expand_by_default=False):
            self._blocks.append(LiveHtml(gui))

    def refresh(self, snapshot: Snapshot) -> None:
        """Show a snapshot, if it differs from the one before; of a moving arm as many as one can read."""
        if snapshot.busy and 0 <= snapshot.stamp - self._shown_at < _READ_S:
            return
        self._shown_at = snapshot.stamp
        state = (snapshot.q_command, snapshot.velocity_command, snapshot.acceleration_command, snapshot.q)
        key = (*(array.tobytes() for array in state), snapshot.source, snapshot.commanded, snapshot.tool)
        if key != self._shown:
            self._shown = key
            robot = self._robot.with_tool(snapshot.tool)
            content = tool_table(robot, snapshot) + joint_table(robot, snapshot)
            content += rounding_note(robot, snapshot.q_command)
            for block in self._blocks:
                block.show(content)


def tool_table(robot: Robot, snapshot: Snapshot) -> str:
    """Commanded position, velocity and acceleration of the tool point, and how it is turned, as HTML."""
    if not snapshot.commanded:
        return table(["Tool", "x", "y", "z"], [["position mm", *3 * ["–"]]])
    q = snapshot.q_command
    motion = tool_motion(robot, q, snapshot.velocity_command, snapshot.acceleration_command)
    position, velocity, acceleration = (1000 * vector for vector in motion)
    rows = [
        ["position mm", *_numbers(position, 2), ""],
        ["velocity mm/s", *_with_size(velocity)],
        ["acceleration mm/s²", *_with_size(acceleration)],
    ]
    pitch = math.asin(min(1.0, max(-1.0, float(robot.forward(q)[2, 2]))))  # of the approach axis, tool z
    roll = robot.inverse_kinematics.pitch_and_roll(q)[1]
    angles = f"pitch <b>{fixed(to_degrees(pitch), 2)}°</b>"
    if roll is not None:
        angles += f" · roll <b>{fixed(to_degrees(roll), 2)}°</b>"
    html = table(["Tool", "x", "y", "z", "size"], rows) + f"<div style='padding:0 6px'>Tool {angles}</div>"
    if robot.orients_tool:
        turns = map(to_degrees, roll_pitch_yaw(robot.forward(q)[:3, :3]).tolist())
        named = " · ".join(
            f"R{axis} <b>{fixed(turn, 2)}°</b>" for axis, turn in zip("xyz", turns, strict=True)
        )
        html += f"<div style='padding:0 6px'>Orientation {named}</div>"
    return html


def joint_table(robot: Robot, snapshot: Snapshot) -> str:
    """Joint angles in degrees, as commanded and as the board tells them, as HTML."""
    told = snapshot.q_command if snapshot.commanded else np.full(robot.n, np.nan)
    source = "board" if snapshot.source is Source.COMMANDED else snapshot.source.value
    rows = [["commanded", *_numbers(robot.shown(told), 2)], [source, *_numbers(robot.shown(snapshot.q), 2)]]
    return table(["Joints °", *(joint.title for joint in robot.joints)], rows)


def _with_size(vector: FloatArray) -> list[str]:
    return [*_numbers(vector, 1), fixed(float(np.linalg.norm(vector)), 1)]


def _numbers(values: FloatArray, digits: int) -> list[str]:
    return [fixed(value, digits) for value in values.tolist()]


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
    """One line that says why a tool that was sent to 300 mm may show 299.9 mm; ``q`` (n,) [rad].

    Empty for an arm that no board drives: the steps of its simulated one mean nothing.
    """
    if robot.simulated_only is not None:
        return ""
    board, steps = board_type(robot.board), robot.shown(joint_steps(robot))
    turning = steps[steps > 0]
    if not len(turning):
        return ""
    low, high = (fixed(float(step), 3) for step in (turning.min(), turning.max()))
    span = f"{low}°" if low == high else f"{low} … {high}°"
    unit = "step" if (board.scale.step, board.scale.unit) == (1, "steps") else board.scale.unit
    servo = f"Servo steps of {span} ({board.scale.step:g} {unit})"
    what = f"Encoder steps of {span} (1 count)" if board.homing else servo
    off = fixed(1000 * rounding_off_m(robot, q), 2)
    return muted(f"{what}: the tool may stop up to {off} mm beside its target.")


_ROUNDING = 1e-9
_STEPS = ("0.1", "1", "5", "10")
_LEGEND = (
    "<div class='armctl-marks'><span><i class='tick'></i>where the arm is</span> "
    "<span><i class='dot'></i>where it would go</span></div>"
)
_FOLLOWING = "The sliders show the arm. Move one, then press Go."
_WATCHING = "The sliders show the arm. Move one to plan: the operator moves the arm."
_PLANNED = "The sliders show the next pose, as the ghost does. The operator moves the arm."
_EDITED = "The sliders show the next pose, as the ghost does. Go moves the arm there."
_RUNNING = "The sliders show the next pose. Its ghost is away while a program runs."
_AT_ONCE = "− and + turn a joint at once, by so many degrees. Clicks add up."


class JointControl:
    """A slider and step buttons a joint. The sliders show the next pose, whose ever it is, or the arm."""

    def __init__(self, session: Session) -> None:
        self._session, self._robot = session, session.console.robot
        gui = session.gui
        LiveHtml(gui, _LEGEND)
        self._writer = PoseWriter(session, "sliders in Manual")
        self._stepper = JointStepper(session)
        self._ends = slider_limits(self._robot)
        self._shown = slider_degrees(self._robot, session.next.shown_in(session.snapshot), self._ends)
        """degrees"""
        self._sliders: dict[int, viser.GuiSliderHandle[float]] = {}
        """by joint"""
        steps: list[viser.GuiButtonGroupHandle] = []
        with slider_rows(gui):
            for i, joint in enumerate(self._robot.joints):
                steps.extend(self._add_joint(i, held_at(joint)))
        self._at = slider_degrees(self._robot, session.console.last_known.drawn(session.snapshot), self._ends)
        self._ticks = LiveHtml(gui, self._ticks_html())
        with in_row(gui):
            reset = gui.add_button("Sliders to present pose", color="gray")
            self._step = gui.add_dropdown("Step °", _STEPS, initial_value="1")
        self._told = session.needs(
            None,
            reset,
            also=self._following,
            anyone=True,
            hint=_EDITED,
        )
        session.needs(self._stepper.need, *steps, hint=_AT_ONCE)
        session.on(reset.on_click, session.next.clear)

    def _add_joint(self, i: int, held: str | None) -> Iterator[viser.GuiButtonGroupHandle]:
        """A joint's row; gives its buttons, which one that is ``held`` has not."""
        session, joint = self._session, self._robot.joints[i]
        title, (low, high) = f"{joint.title} °", self._ends[i].tolist()
        if held is not None:
            session.gui.add_text(title, held, disabled=True)
            return
        self._sliders[i] = session.gui.add_slider(title, low, high, 0.01, initial_value=self._shown[i])
        session.on(self._sliders[i].on_update, self._on_slider)
        group = session.gui.add_button_group(joint.title, ("−", "+"))
        session.on(group.on_click, partial(self._on_step, i, group))
        yield group

    def _following(self, _: Snapshot) -> str | None:
        if self._session.next.q is not None:
            return None
        return _FOLLOWING if self._session.operates else _WATCHING

    def refresh(self, snapshot: Snapshot) -> None:
        """Show the next pose, or the arm."""
        shown = slider_degrees(self._robot, self._session.next.shown_in(snapshot), self._ends)
        if shown != self._shown:
            self._shown = shown
            for i, slider in self._sliders.items():
                slider.value = shown[i]
        edited = _EDITED if self._session.operates else _PLANNED
        self._told.hint = edited if snapshot.program is None else _RUNNING
        at = slider_degrees(self._robot, self._session.console.last_known.drawn(snapshot), self._ends)
        if at != self._at and self._session.sees("Manual"):
            self._at = at
            self._ticks.show(self._ticks_html())

    def _ticks_html(self) -> str:
        """A mark on each slider where the arm is, which no slider of viser's has by itself."""
        places: dict[str, float] = {}
        for i in self._sliders:
            low, high = self._ends[i].tolist()
            places[f"{self._robot.joints[i].title} °"] = 100 * (self._at[i] - low) / (high - low)
        return slider_marks(places)

    def _on_slider(self) -> None:
        """The joints whose sliders were moved are asked for anew; a slider rounds what the others are at."""
        q = self._session.next.shown_in(self._session.snapshot).copy()
        for i, slider in self._sliders.items():
            value = float(slider.value)
            if value != self._shown[i]:
                q[i], self._shown[i] = self._robot.joints[i].read(value), value
        self._writer.show(np.clip(q, *self._robot.limits.T))

    async def _on_step(self, i: int, group: viser.GuiButtonGroupHandle) -> None:
        sign = 1 if group.value == "+" else -1
        await self._stepper.step(i, sign * float(self._step.value))


class JointStepper:
    """Clicks during a step add up: the arm goes on to where all of them together lead."""

    def __init__(self, session: Session, duration_s: Callable[[FloatArray], float] | None = None) -> None:
        """``duration_s``: how long a way (n,) [rad] takes; None: as short as possible."""
        self._session = session
        self._duration_s = duration_s
        self._goal: FloatArray | None = None

    def need(self) -> Need | None:
        """What the next click needs of the arm: nothing while it moves by an earlier one."""
        return Need.HOLDING if self._goal is None else None

    @property
    def start(self) -> FloatArray:
        """(n,) where the next step begins [rad]."""
        return self._session.snapshot.q_command if self._goal is None else self._goal

    async def step(self, joint: int, step_deg: float) -> None:
        """Turn one joint by ``step_deg``; refused past its limit, and where the arm cannot move now."""
        await self.go_to(stepped(self._session.console.robot, self.start, joint, step_deg))

    async def go_to(self, goal: FloatArray) -> None:
        """Go on to ``goal`` (n,) [rad], a step from ``start``; refused where the arm cannot move now."""
        under_way, self._goal = self._goal is not None, goal
        if not under_way:
            try:
                await self._go()
            finally:
                self._goal = None

    async def _go(self) -> None:
        """Move to the goal, and on for as long as clicks have moved it further."""
        reached: FloatArray | None = None
        while self._goal is not None and self._goal is not reached:
            reached = self._goal
            way = reached - self._session.snapshot.q_command
            duration_s = None if self._duration_s is None else self._duration_s(way)
            if not await came_to_end(await self._session.submit(MoveJoints(reached, duration_s))):
                return  # later clicks start afresh


_SLOW_RAD_S, _SLOW_FRACTION, _SHORTEST_S = 10.0 * DEGREE, 0.15, 0.3


def slow_speeds(robot: Robot) -> FloatArray:
    """(n,) how fast each joint is moved where somebody looks closely [rad/s]."""
    return np.minimum(_SLOW_RAD_S, _SLOW_FRACTION * robot.speed_limits)


def slow_duration(robot: Robot, way: FloatArray) -> float:
    """How long a way (n,) [rad] takes at those speeds [s]."""
    return max(_SHORTEST_S, float((np.abs(way) / slow_speeds(robot)).max()))


def stepped(robot: Robot, q: FloatArray, joint: int, step_deg: float) -> FloatArray:
    """``q`` (n,) [rad] with one joint turned by ``step_deg``; refused past its limit."""
    asked = q.copy()
    one = robot.joints[joint]
    asked[joint] += one.read(step_deg)
    limit = one.upper if step_deg > 0 else one.lower
    beyond = asked[joint] - limit if step_deg > 0 else limit - asked[joint]
    if beyond > _ROUNDING:
        left = abs(limit - float(q[joint]))
        raise MotionRefusedError(
            f"{one.title}: {step_deg:+g}{one.unit} from {one.said(float(q[joint]))} leads to "
            f"{one.said(float(asked[joint]))}, the limit is {one.said(limit)}; "
            f"it can turn {one.said(left)} more that way"
        )
    asked[joint] = min(max(float(asked[joint]), one.lower), one.upper)
    return asked


def checked_percent(value: float, what: str) -> float:
    """A percentage; an InputError where it is outside 0 … 100, or not finite."""
    if not 0 <= value <= 100:
        raise InputError(f"{what}: {out_of_range(value, 0, 100, '%')}")
    return float(value)


class GripperSlider:
    """How far open the gripper is to be [%]; while nobody edits it, where the gripper was sent last."""

    def __init__(self, session: Session) -> None:
        self._followed = 50
        self._slider = session.gui.add_slider("Gripper %", 0, 100, 1, initial_value=self._followed)
        self.follow(session.snapshot)

    def follow(self, snapshot: Snapshot) -> None:
        """Show where the gripper was sent last, unless somebody has moved the slider away from it."""
        if snapshot.gripper is None or (now := round(100 * snapshot.gripper)) == self._followed:
            return
        if self._slider.value == self._followed:
            self._slider.value = now
        self._followed = now

    @property
    def opening(self) -> float:
        """What it shows, 0 … 1; an InputError where that is no percentage."""
        return checked_percent(self._slider.value, "gripper") / 100
