"""Energy criteria: what "least" means when one of several solutions is chosen, and the gravity torque."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from armctl.arrays import ArrayRecord, FloatArray
from armctl.errors import InputError
from armctl.kinematics.chain import Chain, LinkFrames

STANDARD_GRAVITY = 9.80665
"""m/s² (CGPM 1901)"""


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

    def __post_init__(self) -> None:
        places, n = self.chain.places, len(self.chain.segments)
        carried: list[list[tuple[float, FloatArray]]] = [[] for _ in range(n)]
        for body in self.bodies:
            T = places[self.chain.joint_rows[body.joint] + 1].T_link_frame
            carried[body.joint].append((body.mass_kg, T[:3, :3] @ np.array(body.com_m) + T[:3, 3]))
        carried[n - 1].append((self.payload_kg, places[-1].T_link_frame[:3, 3]))
        object.__setattr__(self, "_carried", tuple(map(tuple, carried)))

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
        q = self.chain.checked(q)
        flat = q.reshape(-1, self.chain.n)
        return self.torque_of(LinkFrames.at(self.chain, flat)).T.reshape(q.shape)

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
