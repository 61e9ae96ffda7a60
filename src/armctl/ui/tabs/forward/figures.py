"""A configuration in numbers: pose matrix, orientation, Jacobian, manipulability and velocities, as HTML."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape
from typing import NamedTuple

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, UnreachableError
from armctl.facts import Reason, Several
from armctl.facts.angles import DEGREE, to_degrees
from armctl.facts.reasons import AngleLimit, WrongUnit
from armctl.kinematics import quaternion_wxyz, roll_pitch_yaw
from armctl.kinematics.velocity import (
    Freedom,
    joint_rates,
    manipulability,
    pose_freedom,
    position_freedom,
    speeds_alone,
    tool_velocity,
    turning_speeds,
)
from armctl.robot import Robot
from armctl.ui.offers import NO_REASON, why_html
from armctl.ui.session import Session
from armctl.ui.widgets.angle_fields import held_at
from armctl.ui.widgets.html import (
    ERROR,
    GOOD,
    LiveHtml,
    fixed,
    heading,
    muted,
    numbers,
    refused,
    sentence,
    table,
)
from armctl.ui.widgets.number_field import DEGREES, MILLIMETRES, FieldArray, NumberField, field_grid

_LEAST_PART = 0.35
"""a part of a direction smaller than this is left out of its description (20°)"""
_ON_AXIS_M = 1e-3
_EQUAL_RATE = 20 * DEGREE
"""one rate for all joints, so that they can be compared [rad/s]"""
_ROWS = ("vx mm/s", "vy mm/s", "vz mm/s", "ωx rad/s", "ωy rad/s", "ωz rad/s")
_WAYS = (("out", "in"), ("left", "right"), ("up", "down"))
_WAYS_ON_AXIS = (("along +x", "along −x"), ("along +y", "along −y"), ("up", "down"))
_MISSED = 1e-6
_INSIDE_RAD = 1e-9


def pose_html(robot: Robot, q: FloatArray) -> str:
    """Tool pose at ``q`` (n,) [rad]: 4 x 4 matrix in mm, roll-pitch-yaw, quaternion."""
    T = robot.forward(q)
    shown = T.copy()
    shown[:3, 3] *= 1000
    rows = [[fixed(value, 4 if j < 3 else 2) for j, value in enumerate(row)] for row in shown.tolist()]
    rows[3] = ["0", "0", "0", "1"]
    turned = " · ".join(
        f"{name} ({usual}) <b>{angle}</b>"
        for (name, angle), usual in zip(base_turns(T, 3), ("roll", "pitch", "yaw"), strict=True)
    )
    quaternion = numbers(quaternion_wxyz(T[:3, :3]).tolist(), 5)
    pitch, _ = robot.inverse_kinematics.pitch_and_roll(q)
    html = heading("Matrix: tool in base, position in mm")
    html += table(["x axis", "y axis", "z axis", "position"], rows, words=())
    html += heading("Orientation") + f"<div>{turned}</div>"
    html += muted("R = Rz(yaw) · Ry(pitch) · Rx(roll): turns about the base's x, then y, then z axis.")
    if pitch is not None:
        pitch_deg = fixed(to_degrees(pitch), 3)
        html += muted(
            f"Ry is not the tool pitch: that is {pitch_deg}°, the tool's axis above the horizontal."
        )
    return html + f"<div>quaternion w, x, y, z: {quaternion}</div>"


def base_turns(T: FloatArray, digits: int) -> list[tuple[str, str]]:
    """Roll-pitch-yaw of a pose (4, 4), named Rx, Ry, Rz: "pitch" and "roll" are the tool's."""
    angles = [f"{fixed(angle, digits)}°" for angle in map(to_degrees, roll_pitch_yaw(T[:3, :3]).tolist())]
    return list(zip(("Rx", "Ry", "Rz"), angles, strict=True))


def jacobian_html(robot: Robot, q: FloatArray) -> str:
    """Geometric Jacobian, manipulability and the joints' own tool speeds at ``q`` (n,) [rad]."""
    J = robot.jacobian(q)
    shown = J.copy()
    shown[:3] *= 1000
    rows = [
        [name, *(fixed(value, 2 if i < 3 else 4) for value in row)]
        for i, (name, row) in enumerate(zip(_ROWS, shown.tolist(), strict=True))
    ]
    formula = "√det(J Jᵀ)" if robot.n >= 6 else "√det(Jᵀ J)"
    # six joints may lose a turn where the tool point is free: a singular wrist
    wrist = "" if robot.n < 6 else f"; position and orientation: {pose_freedom(J).verdict}"
    head = ["per rad/s of", *(joint.title for joint in robot.joints)]
    return (
        heading(f"Geometric Jacobian (6×{robot.n}), base frame")
        + table(head, rows, small=True)
        + heading("Manipulability")
        + manipulability_html(position_freedom(J), robot.forward(q)[:3, 3])
        + muted(f"{formula} of all six rows, in m and rad: {fixed(float(manipulability(J)), 4)}{wrist}")
        + heading("Tool point's speed when one joint alone turns")
        + tool_speeds_html(robot, J)
    )


def manipulability_html(freedom: Freedom, tip: FloatArray) -> str:
    """The measure, the distance from singularities, and the hardest direction of the tool point (3,) [m]."""
    free, lost = freedom.verdict == "well away from singularities", freedom.verdict == "singular"
    color = GOOD if free else ERROR
    ratio = "∞" if lost else fixed(freedom.condition, 1)
    way = f"{direction_words(freedom.hardest, tip)}, along ({numbers(freedom.hardest.tolist(), 2)})"
    how = "cannot move" if lost else "moves least" if free else "can hardly move"
    return (
        f"<div><b style='color:{color}'>{escape(freedom.verdict.capitalize())}</b>: "
        f"the tool {how} {escape(way)}.</div>"
        f"<div>√det(J Jᵀ) of the position rows: <b>{1e3 * freedom.measure:.4f}</b> × 10⁶ mm³/rad³</div>"
        f"<div>smallest singular value: <b>{fixed(1000 * freedom.smallest, 2)}</b> mm/rad; "
        f"largest / smallest: {ratio}</div>"
    )


def direction_words(direction: FloatArray, tip: FloatArray) -> str:
    """A line along a unit vector (3,) through the tool point (3,) [m]; out: away from the base's z axis."""
    x, y, _ = tip.tolist()
    distance = math.hypot(x, y)
    ways = _WAYS_ON_AXIS if distance < _ON_AXIS_M else _WAYS
    out = np.array([1.0, 0.0, 0.0]) if distance < _ON_AXIS_M else np.array([x, y, 0.0]) / distance
    axes = np.stack([out, [-out[1], out[0], 0.0], [0.0, 0.0, 1.0]])
    parts = [(float(part), way) for part, way in zip(axes @ direction, ways, strict=True)]
    large = [(part, way) for part, way in parts if abs(part) >= _LEAST_PART]
    ahead = large[0][0] > 0
    there = " and ".join(way[(part > 0) != ahead] for part, way in large)
    back = " and ".join(way[(part > 0) == ahead] for part, way in large)
    return f"{there} or {back}"


def tool_speeds_html(robot: Robot, jacobian: FloatArray) -> str:
    """How fast each joint alone moves the tool point; the joint that moves it fastest is marked."""
    equal = 1000 * speeds_alone(jacobian, np.full(robot.n, _EQUAL_RATE))
    speeds = 1000 * speeds_alone(jacobian, turning_speeds(robot.limits, robot.speed_limits))
    rows: list[list[str]] = []
    for joint, same, speed in zip(robot.joints, equal.tolist(), speeds.tolist(), strict=True):
        if (held := held_at(joint)) is not None:
            rows.append([joint.title, held, "", ""])
        else:
            limit = f"{fixed(joint.shown(joint.speed), 1)} °/s"
            rows.append([joint.title, f"{fixed(same, 1)} mm/s", limit, f"{fixed(speed, 1)} mm/s"])
    most = int(np.where(speeds > 0, equal, 0.0).argmax())
    head = ["joint", f"at {fixed(to_degrees(_EQUAL_RATE), 0)} °/s", "its limit", "at its limit"]
    return table(head, rows, marked=most if speeds[most] > 0 else None)


def tool_velocity_html(robot: Robot, jacobian: FloatArray, rates: FloatArray) -> str:
    """Velocity of the tool at joint rates (n,) [rad/s], and which rates are over their limits."""
    velocity = tool_velocity(jacobian, rates)
    rows = [
        ["tool point mm/s", *_with_size(1000 * velocity.linear)],
        ["tool turns °/s", *_with_size(to_degrees(velocity.angular))],
    ]
    over = [
        f"{joint.title} turns at {fixed(joint.shown(joint.speed), 1)} °/s at most"
        for joint, rate in zip(robot.joints, rates.tolist(), strict=True)
        if abs(rate) > joint.speed * (1 + 1e-9)
    ]
    text = table(["", "x", "y", "z", "size"], rows)
    return text + (refused(f"{'; '.join(over)}.") if over else "")


def joint_rates_html(robot: Robot, jacobian: FloatArray, linear: FloatArray, *, keep: bool) -> str:
    """Joint rates for a velocity of the tool point (3,) [m/s]; ``keep``: without turning the tool."""
    speeds = turning_speeds(robot.limits, robot.speed_limits)
    found = joint_rates(jacobian, speeds, linear, np.zeros(3) if keep else None)
    rows: list[list[str]] = []
    for joint, rate in zip(robot.joints, robot.shown(found.rates).tolist(), strict=True):
        limit = held_at(joint) or f"{fixed(joint.shown(joint.speed), 1)} °/s"
        rows.append([joint.title, f"{fixed(rate, 2)} °/s", limit])
    velocity = tool_velocity(jacobian, found.rates)
    reached, asked = (1000 * float(np.linalg.norm(v)) for v in (velocity.linear, linear))
    text = table(["joint", "rate", "its limit"], rows)
    text += f"<div>tool point: <b>{fixed(reached, 1)} mm/s</b> of {fixed(asked, 1)} mm/s"
    if found.limiting is not None:
        title = escape(robot.joints[found.limiting].title)
        text += f"; {title} is at its limit, at {fixed(100 * found.scale, 1)} % of what was asked for"
    text += "</div>"
    missed = 1000 * float(np.linalg.norm(found.residual[:3]))
    if missed > _MISSED * max(asked, 1.0):
        text += refused(f"The joints cannot give {fixed(missed, 2)} mm/s of the tool point's velocity here.")
    turned = to_degrees(float(np.linalg.norm(velocity.angular)))
    if keep and turned > _MISSED:
        return text + refused(
            f"The tool cannot move like this without turning: it turns at {fixed(turned, 2)} °/s."
        )
    return text + muted(f"The tool turns at {fixed(turned, 2)} °/s meanwhile.")


def _with_size(vector: FloatArray) -> list[str]:
    return [*(fixed(value, 1) for value in vector.tolist()), fixed(float(np.linalg.norm(vector)), 1)]


# Joint rates in, tool velocity out, and the other way round, in the configuration that is shown.

_KEEP_HINT = "The tool keeps its orientation. With fewer than six joints that is not always possible."


class VelocityForm:
    """Fields for rates and velocities; nothing here moves the arm."""

    def __init__(self, session: Session) -> None:
        self._robot = session.console.robot
        self._q: FloatArray | None = None
        self._turning = np.array([held_at(joint) is None for joint in self._robot.joints])
        gui = session.gui
        with gui.add_folder("Joint rates (°/s) → tool velocity"):
            turning = [joint for joint in self._robot.joints if held_at(joint) is None]
            with field_grid(gui):
                rates = [NumberField(gui, one.title, min(20.0, one.shown(one.speed))) for one in turning]
            self._rates = FieldArray(rates, DEGREES)
            self._velocity = LiveHtml(gui)
        with gui.add_folder("Tool velocity → joint rates"):
            speeds = zip("xyz", (50.0, 0.0, 0.0), strict=True)
            with field_grid(gui):
                linear = [NumberField(gui, f"v{axis} mm/s", value) for axis, value in speeds]
            self._linear = FieldArray(linear, MILLIMETRES)
            self._keep = gui.add_checkbox("Do not turn", initial_value=False, hint=_KEEP_HINT)
            self._answer = LiveHtml(gui)
        for handle in (*(field.handle for field in (*rates, *linear)), self._keep):
            session.on(handle.on_update, self._show_again)

    def _show_again(self) -> None:
        if self._q is not None:
            self.show(self._q)

    def show(self, q: FloatArray | None, why_not: str = "") -> None:
        """Compute for a configuration (n,) [rad]; None: there is none, for the reason ``why_not`` (HTML)."""
        self._q = q
        if q is None:
            self._velocity.show(why_not)
            self._answer.show("")
            return
        J, rates = self._robot.jacobian(q), np.zeros(self._robot.n)
        try:
            rates[self._turning] = self._rates.array
            self._velocity.show(tool_velocity_html(self._robot, J, rates))
        except ArmctlError as half_typed:
            self._velocity.show(refused(f"{half_typed}."))
        try:
            self._answer.show(joint_rates_html(self._robot, J, self._linear.array, keep=self._keep.value))
        except ArmctlError as half_typed:
            self._answer.show(refused(f"{half_typed}."))


# Where each button would send the arm.


REFERENCE = "Go with respect to reference"
LAST = "Go with respect to last position"
PRESENT = "present pose (live)"
SHOWN = ("angles as reference", "angles added to last position", PRESENT)
ABOUT = {REFERENCE: "to these angles", LAST: "by these angles, from where it stands"}
"""what each button does, in other words"""
_ROW_OF = {REFERENCE: "reference", LAST: "last"}
_NAMED = 5
"""so many joints have their names above their columns"""
_UNEDITED = "The fields follow the arm until you edit them."
_TAKEN = "The fields show the next pose until you edit them."


def resulting_pose(how: str, asked: FloatArray, present: FloatArray) -> FloatArray:
    """Where the arm would go: ``asked`` itself, or added to where it is commanded to be (n,) [rad]."""
    return present + asked if how in (LAST, SHOWN[1]) else asked


class Results(NamedTuple):
    """Where each button would send the arm."""

    goals: Mapping[str, FloatArray]
    """(n,) by button [rad]; empty: nothing can be sent"""
    notes: str
    """what the fields and the ghost show, and why nothing can be sent"""


def results(
    angles: FieldArray,
    present: FloatArray,
    *,
    edited: bool = True,
    unmet: Reason | None = None,
    ghost: str = "",
    taken: bool = False,
) -> Results:
    """Where each button would send the arm from ``present`` (n,) [rad].

    Before the fields are edited they hold the pose of the arm, which is the one with respect to reference.
    ``unmet``: why nothing can be sent although the angles are complete. ``ghost``: which of ``SHOWN`` is
    drawn; empty: none. ``taken``: the fields show a next pose that was written elsewhere.
    """
    goals = dict[str, FloatArray]()
    notes = muted(_TAKEN) if taken else "" if edited else muted(_UNEDITED)
    try:
        asked = angles.array
        if unmet:
            raise UnreachableError(unmet)
    except ArmctlError as refusal:
        notes = refused(f"Nothing can be sent: {refusal}.")
    else:
        goals = {how: resulting_pose(how, asked, present) for how in ABOUT}
    drawn = muted(f"The ghost shows the {ghost}.") if ghost else ""
    return Results(goals, notes + drawn)


def abouts_html() -> str:
    """Right below the two buttons: what each does."""
    return f"<div class=armctl-abouts>{''.join(f'<span>{text}</span>' for text in ABOUT.values())}</div>"


def goals_html(robot: Robot, now: FloatArray, goals: Mapping[str, FloatArray]) -> str:
    """Where the arm is drawn (n,) [rad], and where each button would send it."""
    head = "".join(_heads(robot)) + "".join(f"<th>{axis}&nbsp;mm</th>" for axis in "XYZ")
    rows = _goal_html(robot, "now", now)
    for how, name in _ROW_OF.items():
        rows += _goal_html(robot, name, goals.get(how))
    return f"<table class=armctl-goal><tr><td></td>{head}</tr>{rows}</table>"


def _heads(robot: Robot) -> list[str]:
    """The joints' names; their numbers where a word of them may not fit into its column."""
    if robot.n <= _NAMED:
        return [f"<th>{escape(joint.title)}</th>" for joint in robot.joints]
    return [f"<th title='{escape(joint.title)}'>J{i}</th>" for i, joint in enumerate(robot.joints, 1)]


def _goal_html(robot: Robot, name: str, q: FloatArray | None) -> str:
    """A row of numbers at ``q`` (n,) [rad]: one that is outside the limits of its joint stands out."""
    if q is None:
        return f"<tr><td>{name}</td>{'<td>–</td>' * (robot.n + 3)}</tr>"
    inside = (robot.limits[:, 0] - _INSIDE_RAD <= q) & (q <= robot.limits[:, 1] + _INSIDE_RAD)
    marks = (*("" if ok else " class=bad" for ok in inside.tolist()), "", "", "")
    values = (*robot.shown(q).tolist(), *(1000 * robot.forward(q)[:3, 3]).tolist())
    cells = "".join(f"<td{mark}>{fixed(v, 1)}</td>" for mark, v in zip(marks, values, strict=True))
    return f"<tr><td>{name}</td>{cells}</tr>"


def offers_html(why: Mapping[str, str | Reason | None]) -> str:
    """Why buttons cannot be pressed: once where it is the same, else by button; limits a line each."""
    told = dict[str, list[str]]()
    for how, reason in why.items():
        for line in [] if reason is None else _lines(reason):
            told.setdefault(line, []).append(how)
    if not told:
        return NO_REASON
    if list(told.values()) == [list(why)] and not any(map(_of_limits, why.values())):
        return why_html(escape(next(iter(told))))
    rows = "".join(
        f"<tr><td>{'both' if len(hows) == len(why) else _ROW_OF[hows[0]]}</td><td>{escape(line)}</td></tr>"
        for line, hows in told.items()
    )
    return why_html(f"<table class=armctl-outside>{rows}</table>")


def _of_limits(why: str | Reason | None) -> bool:
    return isinstance(why, Several) and any(isinstance(one, AngleLimit) for one in why.reasons)


def _lines(why: str | Reason) -> list[str]:
    """A line for each limit; that pages count in degrees needs no word here."""
    if isinstance(why, Several) and _of_limits(why):
        return [sentence(one) for one in why.reasons if not isinstance(one, WrongUnit)]
    return [sentence(why)]
