"""Joint rates in, tool velocity out, and the other way round, in the configuration that is shown."""

from __future__ import annotations

from html import escape

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError
from armctl.kinematics.velocity import JointRates, joint_rates, tool_velocity, turning_speeds
from armctl.robot import Robot
from armctl.ui.session import Session
from armctl.ui.widgets.html import LiveHtml, fixed, muted, refused, table
from armctl.ui.widgets.joint_angles import held_at
from armctl.ui.widgets.number_field import NumberField

FloatArray = NDArray[np.float64]
_RATE_DEG_S = 20.0
_SPEED_MM_S = 50.0
_KEEP_HINT = "The tool shall not turn. With fewer than six joints that is not always possible."
_MISSED = 1e-6


class VelocityForm:
    """Nothing here moves the arm."""

    def __init__(self, session: Session) -> None:
        """Add the fields to the present container."""
        self._robot = session.console.robot
        self._q: FloatArray | None = None
        gui = session.gui
        with gui.add_folder("Joint rates (°/s) → tool velocity"):
            self._rates = [
                NumberField(gui, joint.title, min(_RATE_DEG_S, float(np.degrees(joint.speed))))
                for joint in self._robot.joints
                if held_at(joint) is None
            ]
            self._velocity = LiveHtml(gui)
        with gui.add_folder("Tool velocity → joint rates"):
            self._linear = [
                NumberField(gui, f"v{axis} mm/s", value)
                for axis, value in zip("xyz", (_SPEED_MM_S, 0.0, 0.0), strict=True)
            ]
            self._keep = gui.add_checkbox("Do not turn", initial_value=False, hint=_KEEP_HINT)
            self._answer = LiveHtml(gui)
        for field in (*self._rates, *self._linear):
            session.on(field.handle.on_update, self._on_edit)
        session.on(self._keep.on_update, self._on_edit)

    def show(self, q: FloatArray | None) -> None:
        """Compute for a configuration (n,) [rad]; None: there is none to compute for."""
        self._q = q
        if q is None:
            self._velocity.show("")
            self._answer.show("")
            return
        J = self._robot.jacobian(q)
        try:
            self._velocity.show(tool_velocity_html(self._robot, J, self._asked_rates()))
        except ArmctlError as half_typed:
            self._velocity.show(refused(f"{half_typed}."))
        try:
            linear = np.array([field.value for field in self._linear]) / 1000
            self._answer.show(joint_rates_html(self._robot, J, linear, keep=self._keep.value))
        except ArmctlError as half_typed:
            self._answer.show(refused(f"{half_typed}."))

    def _asked_rates(self) -> FloatArray:
        """(n,) [rad/s]; 0 for a joint that is held."""
        rates = np.zeros(self._robot.n)
        turning = [held_at(joint) is None for joint in self._robot.joints]
        rates[turning] = np.radians([field.value for field in self._rates])
        return rates

    async def _on_edit(self) -> None:
        self.show(self._q)


def tool_velocity_html(robot: Robot, jacobian: FloatArray, rates: FloatArray) -> str:
    """What the tool does at joint rates (n,) [rad/s], and which of them no joint can have."""
    velocity = tool_velocity(jacobian, rates)
    rows = [
        ["tool point mm/s", *_with_size(1000 * velocity.linear)],
        ["tool turns °/s", *_with_size(np.degrees(velocity.angular))],
    ]
    over = [
        f"{joint.title} turns at {fixed(float(np.degrees(joint.speed)), 1)} °/s at most"
        for joint, rate in zip(robot.joints, rates.tolist(), strict=True)
        if abs(rate) > joint.speed * (1 + 1e-9)
    ]
    text = table(["", "x", "y", "z", "size"], rows)
    return text + (refused(f"{'; '.join(over)}.") if over else "")


def joint_rates_html(robot: Robot, jacobian: FloatArray, linear: FloatArray, *, keep: bool) -> str:
    """Joint rates for a velocity of the tool point (3,) [m/s]; what limits and singularities leave of it."""
    speeds = turning_speeds(robot.limits, robot.speed_limits)
    found = joint_rates(jacobian, speeds, linear, np.zeros(3) if keep else None)
    rows = [
        [joint.title, f"{fixed(rate, 2)} °/s", held_at(joint) or f"{fixed(limit, 1)} °/s"]
        for joint, rate, limit in zip(
            robot.joints,
            np.degrees(found.rates).tolist(),
            np.degrees(robot.speed_limits).tolist(),
            strict=True,
        )
    ]
    return table(["joint", "rate", "its limit"], rows) + _rates_notes(robot, jacobian, found, linear)


def _rates_notes(robot: Robot, jacobian: FloatArray, found: JointRates, linear: FloatArray) -> str:
    """Speed reached, the joint that limits it, what the arm cannot do, and how the tool turns meanwhile."""
    velocity = tool_velocity(jacobian, found.rates)
    reached, asked = (1000 * float(np.linalg.norm(v)) for v in (velocity.linear, linear))
    text = f"<div>tool point: <b>{fixed(reached, 1)} mm/s</b> of {fixed(asked, 1)} mm/s"
    if found.limiting is not None:
        title = escape(robot.joints[found.limiting].title)
        text += f"; {title} is at its limit, at {fixed(100 * found.scale, 1)} % of what was asked for"
    text += "</div>"
    missed = 1000 * float(np.linalg.norm(found.residual[:3]))
    if missed > _MISSED * max(asked, 1.0):
        text += refused(
            f"Out of the joints' power here: {fixed(missed, 2)} mm/s of the tool point's velocity."
        )
    turned = float(np.degrees(np.linalg.norm(velocity.angular)))
    if len(found.residual) > 3 and turned > _MISSED:
        return text + refused(f"It cannot go without turning: the tool turns at {fixed(turned, 2)} °/s.")
    return text + muted(f"The tool turns at {fixed(turned, 2)} °/s meanwhile.")


def _with_size(vector: FloatArray) -> list[str]:
    return [*(fixed(value, 1) for value in vector.tolist()), fixed(float(np.linalg.norm(vector)), 1)]
