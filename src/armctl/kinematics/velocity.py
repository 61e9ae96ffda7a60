"""Velocity kinematics of one configuration: tool velocity and joint rates, manipulability, singularities.

All of it follows from ``jacobian`` J (6, n), linear over angular, in the base frame (``Chain.jacobian``).
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import ArrayRecord, FloatArray
from armctl.kinematics.chain import Chain
from armctl.kinematics.samples import joint_samples
from armctl.kinematics.target import checked_array
from armctl.lazy_dataclass import dataclass

Verdict = Literal["singular", "near a singularity", "well away from singularities"]
NEAR = 0.05
"""smallest over largest singular value below which a direction counts as nearly lost, and is damped"""
_SINGULAR = 1e-6
_SAMPLES, _HELD_SAMPLES = 16, 64


@dataclass(frozen=True, slots=True, eq=False)
class ToolVelocity(ArrayRecord):
    """How the tool moves, in the base frame: its point (3,) [m/s], and (3,) [rad/s]."""

    linear: FloatArray
    angular: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class JointRates(ArrayRecord):
    """Joint rates for a tool velocity, as far as the arm can give it."""

    rates: FloatArray
    """(n,) inside the speed limits [rad/s]"""
    scale: float
    """what the wanted velocity had to be multiplied with to stay inside them; 1 where nothing had to"""
    limiting: int | None
    """index of the joint that decides the scale; None where nothing is scaled"""
    residual: FloatArray
    """(3,) [m/s] or (6,) [m/s, rad/s]: what damping and lost directions leave unmet of the wanted
    velocity, before scaling"""


@dataclass(frozen=True, slots=True, eq=False)
class Freedom(ArrayRecord):
    """How freely the tool moves in a configuration."""

    measure: float
    """``manipulability`` of the rows; of the position rows 0 with fewer than three joints, too"""
    singular_values: FloatArray
    """(rows,) largest first; zeros where there are fewer joints than rows [m/rad]"""
    hardest: FloatArray
    """(rows,) unit vector of the least free direction, base frame; its sign means nothing"""

    @property
    def smallest(self) -> float:
        """How far from singular: the tool's speed per joint rate in the hardest direction [m/rad]."""
        return float(self.singular_values[-1])

    @property
    def isotropy(self) -> float:
        """Smallest over largest singular value: 1 alike in all directions, 0 singular."""
        largest = float(self.singular_values[0])
        return self.smallest / largest if largest > 0.0 else 0.0

    @property
    def condition(self) -> float:
        """Largest over smallest singular value; infinite at a singularity."""
        return 1.0 / self.isotropy if self.isotropy > 0.0 else np.inf

    @property
    def verdict(self) -> Verdict:
        """How near to singular, in words."""
        if self.isotropy < _SINGULAR:
            return "singular"
        return "near a singularity" if self.isotropy < NEAR else "well away from singularities"


def tool_velocity(jacobian: FloatArray, rates: ArrayLike) -> ToolVelocity:
    """Velocity ``J q̇`` of the tool at joint rates (n,) [rad/s], from ``jacobian`` (6, n).

    Raises ``InputError``: a wrong shape, or not finite.
    """
    moved = jacobian @ checked_array(rates, (jacobian.shape[1],), "joint rates")
    return ToolVelocity(moved[:3], moved[3:])


def joint_rates(
    jacobian: FloatArray, speed_limits: FloatArray, linear: ArrayLike, angular: ArrayLike | None = None
) -> JointRates:
    """The least joint rates that give a tool velocity (3,) [m/s] and, unless None, (3,) [rad/s].

    From ``jacobian`` (6, n) and ``speed_limits`` (n,) [rad/s]; a joint with 0 stands still. Directions near
    to being lost are damped (``damped_inverse``); an unmet rad/s counts as its speed at the end of the
    longest lever. Where a rate would pass its limit, all are scaled by one factor.
    Raises ``InputError``: a wrong shape, or not finite.
    """
    wanted = checked_array(linear, (3,), "the linear velocity")
    rows = jacobian[:3]
    weights = np.ones(3)
    if angular is not None:
        wanted = np.concatenate([wanted, checked_array(angular, (3,), "the angular velocity")])
        rows, weights = jacobian, _weights(jacobian)
    turning = speed_limits > 0.0
    rates = np.zeros(jacobian.shape[1])
    rates[turning] = damped_inverse(weights[:, None] * rows[:, turning]) @ (weights * wanted)
    residual = wanted - rows @ rates
    share = np.zeros(len(rates))
    share[turning] = np.abs(rates[turning]) / speed_limits[turning]
    fullest = int(share.argmax())
    if share[fullest] <= 1.0:
        return JointRates(rates, 1.0, None, residual)
    scale = 1.0 / float(share[fullest])
    return JointRates(scale * rates, scale, fullest, residual)


def manipulability(jacobian: FloatArray) -> FloatArray:
    """Yoshikawa's measure (...) of Jacobians (..., rows, n): the product of the singular values.

    With at least as many joints as rows it is √det(J Jᵀ), else √det(Jᵀ J). Of the position rows it is in m³;
    of all six it mixes metres and radians, so it compares poses of one arm.
    """
    return np.linalg.svd(jacobian, compute_uv=False).prod(axis=-1)


def position_freedom(jacobian: FloatArray) -> Freedom:
    """How freely the tool point moves: of the position rows of ``jacobian`` (6, n) [m/rad]."""
    return _freedom(jacobian[:3])


def pose_freedom(jacobian: FloatArray) -> Freedom:
    """How freely the tool moves and turns: of all rows of ``jacobian`` (6, n).

    A rad/s counts as the speed that it has at the end of the longest lever; the measure is of J itself. With
    fewer than six joints some direction is always lost: then only the measure tells anything.
    """
    return _freedom(_weights(jacobian)[:, None] * jacobian, float(manipulability(jacobian)))


def speeds_alone(jacobian: FloatArray, speed_limits: FloatArray) -> FloatArray:
    """Speed of the tool point when each joint turns alone at its limit: (n,) [m/s]."""
    return np.linalg.norm(jacobian[:3], axis=0) * speed_limits


def turning_speeds(limits: FloatArray, speed_limits: FloatArray) -> FloatArray:
    """Largest rates of the joints that can turn: (n,) [rad/s], 0 for those that ``limits`` (n, 2) hold."""
    return np.where(limits[:, 0] < limits[:, 1], speed_limits, 0.0)


def position_leaves_pitch(chain: Chain, limits: FloatArray) -> bool:
    """Whether the tool can pitch while its point stays: False where the position alone decides the pitch.

    It can when position and height of the approach axis's tip have four independent directions of motion,
    somewhere inside the limits (n, 2).
    """
    q = joint_samples(limits, _SAMPLES)
    J, approach = chain.jacobian(q), chain.forward(q)[:, :3, 2]
    lever = np.linalg.norm(J[:, :3], axis=1).max()
    rise = np.cross(J[:, 3:], approach[:, :, None], axis=1)[:, 2:]  # of the approach axis's tip
    rows = np.concatenate([J[:, :3] / max(lever, _SINGULAR), rise], axis=1)[:, :, limits[:, 0] < limits[:, 1]]
    sizes = np.linalg.svd(rows, compute_uv=False)
    return bool(sizes.shape[-1] == 4 and sizes[:, -1].max() > _SINGULAR)


def position_is_held(chain: Chain, limits: FloatArray) -> bool:
    """Whether the tool point is held to a line or a plane inside the limits (n, 2): no pose is special."""
    J = chain.jacobian(joint_samples(limits, _HELD_SAMPLES))[:, :3, limits[:, 0] < limits[:, 1]]
    squares = np.linalg.eigvalsh(J @ J.swapaxes(1, 2))
    return bool((squares[:, 0] <= NEAR**2 * squares[:, 2]).all())


def position_leaves_orientation(chain: Chain, limits: FloatArray) -> bool:
    """Whether the tool can turn about any axis while its point stays, somewhere inside the limits (n, 2)."""
    moving = limits[:, 0] < limits[:, 1]
    if np.count_nonzero(moving) < 6:
        return False
    J = chain.jacobian(joint_samples(limits, _SAMPLES))[:, :, moving]
    J[:, :3] /= max(np.linalg.norm(J[:, :3], axis=1).max(), _SINGULAR)
    return bool(np.linalg.svd(J, compute_uv=False)[:, -1].max() > _SINGULAR)


def _weights(jacobian: FloatArray) -> FloatArray:
    """What turns the rows into m/s: 1 for the linear ones, the longest lever [m] for the angular ones."""
    lever = float(np.linalg.norm(jacobian[:3], axis=0).max())
    return np.repeat([1.0, lever], 3)


def damped_inverse(rows: FloatArray, near: float = NEAR, largest: float | None = None) -> FloatArray:
    """Least-squares inverse (n, m) of rows (m, n) with every direction damped by its own singular value.

    With ε = ``near`` times ``largest`` (None: the largest singular value), directions of σ >= ε are met
    exactly; below, the gain is 2σ / (σ² + ε²): least squares with λ² = (ε² - σ²) / 2.
    """
    u, sizes, vt = np.linalg.svd(rows, full_matrices=False)
    edge = near * (float(sizes.max(initial=0.0)) if largest is None else largest)
    if edge == 0.0:
        return np.zeros((vt.shape[-1], len(rows)))
    gain = np.where(sizes < edge, 2.0 * sizes / (sizes**2 + edge**2), 1.0 / np.maximum(sizes, edge))
    return vt.T @ (gain[:, None] * u.T)


def _freedom(rows: FloatArray, measure: float | None = None) -> Freedom:
    """``measure`` None: the product of all singular values, those of missing joints too, which are 0."""
    u, sizes, _ = np.linalg.svd(rows, full_matrices=True)
    values = np.zeros(len(rows))
    values[: len(sizes)] = sizes
    return Freedom(float(values.prod()) if measure is None else measure, values, u[:, len(rows) - 1])
