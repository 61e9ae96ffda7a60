"""Energy: what "least" means when a solution is chosen, gravity torque, and the least of a continuum."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import field
from functools import cached_property
from importlib import import_module
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import ArrayRecord, FloatArray
from armctl.errors import InputError
from armctl.kinematics.angles import skew_part
from armctl.kinematics.chain import Chain
from armctl.kinematics.frames import LinkFrames
from armctl.kinematics.newton import Rows, newton, target_rows
from armctl.kinematics.samples import joint_samples
from armctl.kinematics.target import Target
from armctl.lazy_dataclass import dataclass

STANDARD_GRAVITY = 9.80665
"""m/s² (CGPM 1901)"""
_PROBES = 500


@dataclass(frozen=True, slots=True)
class Body:
    """A point mass that moves with a joint."""

    joint: int
    """index of the link that carries it"""
    mass_kg: float
    com_m: tuple[float, float, float]
    """in the frame of the joint's DH row; in the link's own where there are no rows"""


@dataclass(frozen=True, slots=True)
class GravityModel:
    """Masses of an arm; gravity points along -z of the base frame."""

    chain: Chain
    bodies: tuple[Body, ...]
    payload_kg: float = 0.0
    """held at the tool point"""
    _carried: tuple[tuple[tuple[float, FloatArray], ...], ...] = field(init=False, repr=False, compare=False)
    """for each joint: mass and point (3,) in the link's frame of what it carries until the next joint"""
    _points: tuple[tuple[tuple[float, tuple[float, ...]], ...], ...] = field(
        init=False, repr=False, compare=False
    )
    """the same in plain numbers"""

    def __post_init__(self) -> None:
        places, n = self.chain.places, len(self.chain.segments)
        carried: list[list[tuple[float, FloatArray]]] = [[] for _ in range(n)]
        for body in self.bodies:
            T = places[self.chain.joint_rows[body.joint] + 1].T_link_frame
            carried[body.joint].append((body.mass_kg, T[:3, :3] @ np.array(body.com_m) + T[:3, 3]))
        carried[n - 1].append((self.payload_kg, places[-1].T_link_frame[:3, 3]))
        object.__setattr__(self, "_carried", tuple(map(tuple, carried)))
        plain = [tuple((mass, tuple(point.tolist())) for mass, point in one) for one in carried]
        object.__setattr__(self, "_points", tuple(plain))

    @property
    def weighs(self) -> bool:
        """Whether masses of links are known; else torques are those of the payload alone, and say little."""
        return any(body.mass_kg for body in self.bodies)

    @property
    def counted(self) -> str:
        """What torques count, in words."""
        links = f"links of {sum(body.mass_kg for body in self.bodies):.3g} kg" if self.weighs else ""
        payload = f"a payload of {self.payload_kg:g} kg" if self.payload_kg else ""
        return " and ".join(filter(None, (links, payload))) or "nothing"

    def torque(self, q: FloatArray) -> FloatArray:
        """Torque (..., n) [N·m] that each joint must hold against gravity at ``q`` (..., n) [rad].

        The sum over all masses beyond the joint of ``m g (z_axis x lever)_z``, the gradient of the
        potential energy: positive where gravity would turn the joint to smaller angles.
        """
        if q.ndim == 1:
            return self._torque_of_one(q)
        q = self.chain.checked(q)
        flat = q.reshape(-1, self.chain.n)
        return self.torque_of(LinkFrames.at(self.chain, flat)).T.reshape(q.shape)

    def heaviest(self, limits: FloatArray) -> FloatArray:
        """(n,) the largest torque of each joint inside its limits (n, 2) [N·m], by some hundred poses."""
        return np.abs(self.torque(joint_samples(limits, _PROBES))).max(axis=0)

    def _torque_of_one(self, q: FloatArray) -> FloatArray:
        """As ``torque``, of one configuration: a twentieth of the time, as setpoints need it every tick."""
        links = self.chain.link_frames(q)
        torque = [0.0] * len(links)
        mass, moment_x, moment_y = 0.0, 0.0, 0.0
        for j in reversed(range(len(links))):
            xx, xy, _, yx, yy, _, zx, zy, _, px, py, _ = links[j]
            for weight, (x, y, z) in self._points[j]:
                mass += weight
                moment_x += weight * (px + x * xx + y * yx + z * zx)
                moment_y += weight * (py + x * xy + y * yy + z * zy)
            torque[j] = STANDARD_GRAVITY * (zx * (moment_y - mass * py) - zy * (moment_x - mass * px))
        out = np.array(torque)
        return out if self.chain.coupling is None else self.chain.coupling.T @ out

    def torque_of(self, links: LinkFrames) -> FloatArray:
        """As ``torque``, for links that are placed already: (n, m) [N·m], a column a configuration."""
        n, m = len(self.chain.segments), links.origin[0].shape[-1]
        torque = np.empty((n, m))
        mass, moment = 0.0, np.zeros((2, m))  # of everything beyond the joint: Σ m and Σ m (x, y)
        for j in reversed(range(n)):
            for weight, point in self._carried[j]:
                mass += weight
                moment += weight * links.place(j, point[None])[:2, 0]
            z, origin = links.rotation[j][:, 2], links.origin[j]
            torque[j] = z[0] * (moment[1] - mass * origin[1]) - z[1] * (moment[0] - mass * origin[0])
        torque *= STANDARD_GRAVITY
        return torque if self.chain.coupling is None else self.chain.coupling.T @ torque


Criterion = Literal["least-rotation", "published", "least-travel", "shortest-time", "least-torque"]
CRITERIA: tuple[Criterion, ...] = get_args(Criterion)
CRITERION_TEXT: dict[Criterion, str] = {
    "least-rotation": "least sum of |joint angles|",
    "published": "least |sum of joint angles| with the last pitch joint ≤ 0 (tables of the Uzuner paper)",
    "least-travel": "least sum of |change| / joint speed from the present pose",
    "shortest-time": "shortest motion from the present pose, all joints together by a cubic",
    "least-torque": "least gravity torque, in shares of the stall torques (in N·m where one is unknown)",
}
FROM_START: tuple[Criterion, ...] = ("least-travel", "shortest-time")
"""the criteria that need to know where the arm stands, and leave a roll that is free as it stands there"""
CUBIC_PEAKS = (1.5, 6.0)
"""largest speed and acceleration of the cubic ``3 u² - 2 u³``, for a way and a time of 1"""


def rest_to_rest_times(way: FloatArray, peaks: Sequence[float], *limits: FloatArray) -> FloatArray:
    """Shortest times (..., n) [s] of ways (..., n) [rad, not negative] by a law from rest to rest.

    ``peaks`` are the largest speed, acceleration and so on of the law for a way and a time of 1, ``limits``
    (n,) of the same of each joint.
    """
    times = np.zeros(way.shape)
    for order, (peak, most) in enumerate(zip(peaks, limits, strict=False), 1):
        times = np.maximum(times, (peak * way / most) ** (1 / order))
    return times


@dataclass(frozen=True, slots=True, eq=False)
class EnergyModel(ArrayRecord):
    """What the criteria need to know of an arm."""

    speed_limits: FloatArray
    """(n,) [rad/s]"""
    acceleration_limits: FloatArray
    """(n,) [rad/s²]"""
    gravity: GravityModel
    stall_torque: FloatArray | None = None
    """(n,) [N·m]; None: not known, then torques count alike"""

    @property
    def criteria(self) -> tuple[Criterion, ...]:
        """Those that can choose for this arm."""
        return tuple(one for one in CRITERIA if one != "least-torque" or self.gravity.weighs)


def checked_criterion(name: object) -> Criterion:
    """``name`` as a criterion. Raises ``InputError`` where there is none of that name."""
    for criterion in CRITERIA:
        if isinstance(name, str) and name == criterion:  # an array compares entry by entry
            return criterion
    raise InputError(f"there is no criterion {name!r}; choose one of {', '.join(CRITERIA)}")


def energies(
    criterion: Criterion,
    q: FloatArray,
    model: EnergyModel,
    pitch_joints: tuple[int, ...],
    start: FloatArray | None = None,
) -> FloatArray:
    """Energy (k,) of each configuration ``q`` (k, n) [rad]; infinite where the criterion excludes it.

    ``published`` sums the base and the parallel ``pitch_joints``, and excludes solutions whose last pitch
    joint is positive: so the printed tables of the uzuner paper were chosen, not as its text says.
    ``least-torque`` is the sum of squared load factors, as a motor's heat grows with the square.
    ``shortest-time`` is the duration [s] of the cubic motion in which the slowest joint sets the time.
    ``start`` (n,) [rad] is where the arm stands; those ``FROM_START`` raise ``InputError`` without it, and
    ``least-torque`` where the masses of the links are not known.
    """
    match criterion:
        case "least-rotation":
            return np.abs(q).sum(axis=1)
        case "published":
            summed = [0, *pitch_joints] if pitch_joints else list(range(q.shape[1]))
            return np.where(q[:, summed[-1]] > 0.0, np.inf, np.abs(q[:, summed].sum(axis=1)))
        case "least-travel" | "shortest-time":
            if start is None:
                raise InputError(f"{criterion} needs the pose that the arm starts from")
            way = np.abs(q - start)
            if criterion == "least-travel":
                return (way / model.speed_limits).sum(axis=1)
            limits = model.speed_limits, model.acceleration_limits
            return rest_to_rest_times(way, CUBIC_PEAKS, *limits).max(axis=1)
        case "least-torque":
            if not model.gravity.weighs:
                raise InputError(
                    "least-torque cannot choose: the robot file gives no masses of links; add a table "
                    "[[bodies]] for each link to it (a URDF file: <inertial>), or choose by another criterion"
                )
            load = model.gravity.torque(q)
            if model.stall_torque is not None:
                load = load / model.stall_torque
            return np.einsum("kn,kn->k", load, load)


# The best of a continuum of solutions: the best of some of them, continued downhill.
#
# By sequential quadratic programming (SLSQP of scipy; D. Kraft, 1988). Least travel and shortest time become
# smooth with more unknowns. Travel: each joint turns by ``p - m``, neither negative, and Σ (p + m) / speed is
# least. Time: a time T is least in which every joint can make its way, |q - start| ≤ way(T).
# Nothing else in this package asks scipy.

_BEGUN = (4, 0.2), (12, 1.0)
"""how many of the best are continued, and how far they are from each other [rad]: a few of the very best, and
then some of other kinds"""
_ROUNDS, _PRECISION = 60, 1e-11
"""of a search, and what its last round still gained"""
_POLISH = 6
"""Newton steps at most"""
_MOVED = 1e-6
"""a joint that turned by less stands where it was [rad]"""
_MET = 1e-10
"""what Newton steps leave of a target that is met, in [m] and [rad]"""
_SINGULAR = 1e-9
_ROUNDING = 1e-14


class _Problem(NamedTuple):
    """Unknowns x, of which ``zero + turns x`` is the configuration."""

    begin: Callable[[FloatArray], FloatArray]
    """x of a configuration (n,)"""
    cost: Callable[[FloatArray], tuple[float, FloatArray]]
    """and its slope"""
    bounds: FloatArray
    """(k, 2) of x"""
    zero: FloatArray
    """(n,)"""
    turns: FloatArray
    """(n, k)"""
    others: tuple[dict[str, Any], ...] = ()
    """what must not be negative"""


@dataclass(frozen=True, eq=False)
class OnTarget:
    """The configurations of an arm inside its limits that meet a target. Immutable."""

    chain: Chain
    limits: FloatArray
    """(n, 2) [rad]; of joints that are held, what they are held at"""
    target: Target
    up: FloatArray
    """(3,) what a pitch is measured against"""

    @cached_property
    def rows(self) -> Rows:
        """By how much a configuration (n,) misses the target (m,), and the derivatives (m, n)."""
        return target_rows(self.chain, self.target, self.up)

    @property
    def spare(self) -> int:
        """How many more joints turn than the target takes."""
        asked = 3 if self.target.pitch is None else 4 if self.target.up is None else 5
        asked = asked if self.target.rotation is None else 6
        return int(np.count_nonzero(self.limits[:, 0] < self.limits[:, 1])) - asked

    def least_travel(self, q: FloatArray, start: FloatArray, weights: FloatArray) -> FloatArray:
        """Configurations (m, n) [rad] of less Σ weight |q - start|, continued from the best of (k, n)."""
        low, high = self.limits.T - start
        least, most = np.append(low, -high), np.append(high, -low)
        bounds = np.maximum(np.stack([least, most], axis=1), 0.0)
        both = np.hstack([np.eye(len(start)), -np.eye(len(start))])

        def begin(q: FloatArray) -> FloatArray:
            return np.append(np.maximum(q - start, 0.0), np.maximum(start - q, 0.0))

        problem = _Problem(begin, _linear(np.append(weights, weights)), bounds, start, both)
        return self._continued(self._seeds(q, np.abs(q - start) @ weights, start), start, problem)

    def shortest_time(self, q: FloatArray, start: FloatArray, model: EnergyModel) -> FloatArray:
        """Configurations (m, n) [rad] of a shorter motion from a start, continued from the best of (k, n)."""
        n = len(start)
        speed, acceleration = model.speed_limits / CUBIC_PEAKS[0], model.acceleration_limits / CUBIC_PEAKS[1]

        def times(q: FloatArray) -> FloatArray:
            limits = model.speed_limits, model.acceleration_limits
            return rest_to_rest_times(np.abs(q - start), CUBIC_PEAKS, *limits).max(axis=-1)

        least = times(q).min()

        def begin(q: FloatArray) -> FloatArray:
            return np.append(q, max(times(q), least))  # no time would leave a joint no way, however it turned

        def room(x: FloatArray) -> FloatArray:
            way, time = x[:n] - start, x[n]
            ways = speed * time, acceleration * time * time
            return np.concatenate([most + sense * way for most in ways for sense in (-1.0, 1.0)])

        def slopes(x: FloatArray) -> FloatArray:
            one = np.eye(n)
            ways = speed, 2.0 * acceleration * x[n]
            return np.vstack([np.column_stack([sense * one, most]) for most in ways for sense in (-1.0, 1.0)])

        problem = _Problem(
            begin,
            _linear(np.append(np.zeros(n), 1.0)),
            np.vstack([self.limits, [0.0, math.inf]]),
            np.zeros(n),
            np.eye(n, n + 1),
            ({"type": "ineq", "fun": room, "jac": slopes},),
        )
        return self._continued(self._seeds(q, times(q), start), start, problem)

    def nearest_rotation(self, q: FloatArray, rotation: FloatArray) -> FloatArray:
        """Configurations (m, n) [rad] that turn the tool as nearly as can be to a rotation (3, 3).

        Each continued from one of (k, n).
        """

        def cost(x: FloatArray) -> tuple[float, FloatArray]:
            """One less the cosine of the angle."""
            off = self.chain.forward(x)[:3, :3] @ rotation.T
            return (3.0 - float(np.trace(off))) / 2.0, skew_part(off) @ self.chain.jacobian(x)[3:]

        n = self.chain.n
        problem = _Problem(np.copy, cost, self.limits, np.zeros(n), np.eye(n))
        return self._continued(list(q), None, problem)

    def _continued(
        self, seeds: Sequence[FloatArray], start: FloatArray | None, problem: _Problem
    ) -> FloatArray:
        """(m, n) where the least cost of a problem is found on the target, from some configurations (n,)."""
        minimize = import_module("scipy.optimize").minimize  # takes long to import, and few need it
        warnings.filterwarnings("ignore", "Values in x were outside bounds")  # by rounding, and clipped
        zero, turns = problem.zero, problem.turns

        def missed(x: FloatArray) -> FloatArray:
            return self.rows(zero + turns @ x)[0]

        def slopes(x: FloatArray) -> FloatArray:
            return self.rows(zero + turns @ x)[1] @ turns

        met = {"type": "eq", "fun": missed, "jac": slopes}
        found: list[FloatArray] = []
        for one in seeds:
            answer = minimize(
                problem.cost, np.clip(problem.begin(one), *problem.bounds.T), jac=True, method="SLSQP",
                bounds=problem.bounds.tolist(), constraints=(met, *problem.others),
                options={"maxiter": _ROUNDS, "ftol": _PRECISION},
            )  # fmt: skip
            x = np.asarray(answer.x, dtype=np.float64)
            there = self._polished(zero + turns @ x, start) if np.isfinite(x).all() else None
            if there is not None:
                found.append(there)
        return np.reshape(found, (-1, self.chain.n))

    def _seeds(self, q: FloatArray, cost: FloatArray, start: FloatArray) -> list[FloatArray]:
        """The best of some configurations (k, n), not near to each other; and the start itself."""
        seeds: list[FloatArray] = []
        order = np.argsort(cost, kind="stable")
        for count, apart in _BEGUN:
            rest = order
            for one in seeds:
                rest = rest[np.abs(q[rest] - one).max(axis=1) > apart]
            while len(rest) and len(seeds) < count:
                seeds.append(q[rest[0]])
                rest = rest[np.abs(q[rest] - seeds[-1]).max(axis=1) > apart]
        return [*seeds, np.clip(start, *self.limits.T)]

    def _polished(self, q: FloatArray, start: FloatArray | None) -> FloatArray | None:
        """Brought onto the target, if it is near: joints at a limit or at the start stay if they can."""
        low, high = self.limits.T
        q = np.clip(q, low, high)
        inside = (q > low + _MOVED) & (q < high - _MOVED)
        begin = np.full(len(q), math.inf) if start is None else np.clip(start, low, high)
        away = np.abs(q - begin) > _MOVED
        for free in (inside & away, inside | (low < high)):

            def rows(q: FloatArray, free: NDArray[np.bool_] = free) -> tuple[FloatArray, FloatArray]:
                off, slopes = self.rows(q)
                return off, slopes * free

            there, missed = newton(
                rows, np.where(away, q, begin), _POLISH, rank=_SINGULAR, gain=math.inf, still=_ROUNDING,
                limits=self.limits,
            )  # fmt: skip
            if missed < _MET:
                return there
        return None


def _linear(slope: FloatArray) -> Callable[[FloatArray], tuple[float, FloatArray]]:
    """The cost ``slope`` x."""

    def cost(x: FloatArray) -> tuple[float, FloatArray]:
        return float(slope @ x), slope

    return cost
