"""What a configuration means in numbers: matrix, orientation, Jacobian, manipulability, as HTML."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics import quaternion_wxyz, roll_pitch_yaw
from armctl.robot import Robot
from armctl.ui.widgets.html_bits import fixed, heading, muted, numbers
from armctl.ui.widgets.text import table

FloatArray = NDArray[np.float64]
_SINGULAR = 1e-6
_NEAR = 0.05
_ROWS = ("vx mm/s", "vy mm/s", "vz mm/s", "ωx rad/s", "ωy rad/s", "ωz rad/s")


@dataclass(frozen=True, slots=True)
class Manipulability:
    """How freely the tool can move in a configuration."""

    measure: float
    """sqrt(det(J Jᵀ)) of the rows that count"""
    rows: int
    """3: position only (arms with fewer than six joints); 6: position and orientation"""
    isotropy: float
    """smallest over largest singular value: 1 alike in all directions, 0 singular"""
    blocked: FloatArray
    """(rows,) the direction in which the tool moves least"""

    @property
    def verdict(self) -> str:
        """How near to singular, in words."""
        if self.isotropy < _SINGULAR:
            return "singular"
        return "near a singularity" if self.isotropy < _NEAR else "well away from singularities"


def manipulability(jacobian: FloatArray) -> Manipulability:
    """Yoshikawa's measure of a geometric Jacobian (6, n): of its position rows when n < 6."""
    rows = 3 if jacobian.shape[1] < 6 else 6
    u, sizes, _ = np.linalg.svd(jacobian[:rows], full_matrices=True)
    values = np.zeros(rows)
    values[: len(sizes)] = sizes
    largest = float(values[0])
    isotropy = float(values[-1]) / largest if largest > 0 else 0.0
    return Manipulability(float(np.prod(values)), rows, isotropy, u[:, -1])


def pose_html(robot: Robot, q: FloatArray) -> str:
    """Tool pose at ``q`` (n,) [rad]: 4 x 4 matrix in mm, roll-pitch-yaw, quaternion."""
    T = robot.forward(q)
    shown = T.copy()
    shown[:3, 3] *= 1000
    rows = [[fixed(value, 4 if j < 3 else 2) for j, value in enumerate(row)] for row in shown.tolist()]
    rows[3] = ["0", "0", "0", "1"]
    angles = zip(("roll", "pitch", "yaw"), np.degrees(roll_pitch_yaw(T[:3, :3])).tolist(), strict=True)
    turned = " · ".join(f"{name} <b>{fixed(angle, 3)}°</b>" for name, angle in angles)
    quaternion = numbers(quaternion_wxyz(T[:3, :3]).tolist(), 5)
    return (
        heading("Matrix: tool in base, lengths in mm")
        + table(["x axis", "y axis", "z axis", "position"], rows, names=False)
        + heading("Orientation")
        + f"<div>{turned}</div>"
        + muted("R = Rz(yaw) · Ry(pitch) · Rx(roll)")
        + f"<div>quaternion w, x, y, z: {quaternion}</div>"
    )


def jacobian_html(robot: Robot, q: FloatArray) -> str:
    """Geometric Jacobian and manipulability at ``q`` (n,) [rad]."""
    J = robot.jacobian(q)
    shown = J.copy()
    shown[:3] *= 1000
    rows = [
        [name, *(fixed(value, 2 if i < 3 else 4) for value in row)]
        for i, (name, row) in enumerate(zip(_ROWS, shown.tolist(), strict=True))
    ]
    return (
        heading(f"Geometric Jacobian (6×{robot.n}), base frame")
        + table(["per rad/s of", *(joint.title for joint in robot.joints)], rows)
        + heading("Manipulability")
        + manipulability_html(manipulability(J))
    )


def manipulability_html(figure: Manipulability) -> str:
    """The measure, its meaning, and the direction that is hardest."""
    unit, scale = ("10⁶ mm³", 1e3) if figure.rows == 3 else ("m³", 1.0)
    color = "#2b8a3e" if figure.isotropy >= _NEAR else "#c92a2a"
    rows = "position rows" if figure.rows == 3 else "all rows"
    text = (
        f"<div>√det(J Jᵀ), {rows}: <b>{scale * figure.measure:.4f}</b> {unit}/rad³ · "
        f"<b style='color:{color}'>{escape(figure.verdict)}</b></div>"
        f"<div>smallest / largest singular value: {figure.isotropy:.4f} "
        "<span style='opacity:.75'>(0 = singular)</span></div>"
    )
    if figure.isotropy < _NEAR:
        text += f"<div>the tool can hardly move along ({numbers(figure.blocked[:3].tolist(), 2)})</div>"
    return text
