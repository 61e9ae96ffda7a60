"""The links and joints of a URDF file as a tree; and right angles that exporters have rounded."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import RobotFileError
from armctl.kinematics import roll_pitch_yaw, rotation_from_rpy
from armctl.kinematics.frames import frame_along
from armctl.lazy_dataclass import dataclass
from armctl.robot.parts import Shape
from armctl.robot.urdf.xacro_properties import Argument

# Right angles that exporters have rounded, taken as exact.
#
# Exporters write a quarter turn as 1.5708 and a zero as -9.4e-08. Read to the letter, axes that are parallel
# in the machine are not in the file, and no closed form fits the arm. So each joint tells how far what is
# taken is from what is written.

_QUARTER = math.pi / 2
_UNSEEN_M = 1e-9
_NOISE = 1e-6
"""angles [rad] and components of unit vectors below this are a rounded zero"""
_FEWEST_DECIMALS = 4
"""that a rounded quarter turn has: 1.57 may be meant"""
_MOST_QUARTERS = 4
NOISY = math.radians(0.1)
"""angles this near to right ones are noise of CAD programs, or 1.57, where the user says so [rad]"""
NOISY_M = 5e-5
"""the same of offsets near to zero [m]"""


@dataclass(frozen=True, slots=True)
class Rounding:
    """What was taken as exact, and how far that is from what is written."""

    quarters: tuple[str, ...] = ()
    """rounded quarter turns as written, signs left out"""
    zeros: int = 0
    """numbers that are a rounded zero"""
    shift: float = 0.0
    """how far a point one metre off is moved by it, at most [m]"""
    moved: float = 0.0
    """how far every point is moved by it, besides [m]"""
    noise: tuple[str, ...] = ()
    """joints that were noisy, with the angle or the length"""

    def __add__(self, other: Rounding) -> Rounding:
        return Rounding(
            self.quarters + other.quarters,
            self.zeros + other.zeros,
            self.shift + other.shift,
            self.moved + other.moved,
            self.noise + other.noise,
        )


def exact_angle(text: str) -> float:
    """An angle as written [rad], or the whole number of quarter turns that it is when rounded or cut off.

    That needs four decimals, or to be within 1e-6 of it. Twice 1.57079 is 3.14158: a multiple may be off
    by so many units of the last decimal.
    """
    value = float(text)
    quarters = round(value / _QUARTER)
    exponent = Decimal(text).as_tuple().exponent
    allowed = _NOISE
    if isinstance(exponent, int) and exponent <= -_FEWEST_DECIMALS and abs(quarters) <= _MOST_QUARTERS:
        allowed = max(_NOISE, abs(quarters) * 10.0**exponent)
    return quarters * _QUARTER if abs(value - quarters * _QUARTER) < allowed else value


def exact_rotation(texts: Sequence[str]) -> tuple[FloatArray, Rounding]:
    """A rotation (3, 3) from roll, pitch and yaw as written [rad]."""
    written, exact = [float(text) for text in texts], [exact_angle(text) for text in texts]
    rotation = rotation_from_rpy(*exact)
    changed = [k for k in range(3) if written[k] != exact[k]]
    if not changed:
        return rotation, Rounding()
    chord = float(np.linalg.norm(rotation - rotation_from_rpy(*written))) / math.sqrt(2)
    quarters = tuple(texts[k].lstrip("+-") for k in changed if exact[k] != 0.0)
    return rotation, Rounding(quarters, len(changed) - len(quarters), chord)


def exact_axis(axis: FloatArray) -> tuple[FloatArray, Rounding]:
    """A unit vector (3,), without components that are a rounded zero."""
    noise = (axis != 0.0) & (np.abs(axis) < _NOISE)
    if not noise.any():
        return axis, Rounding()
    exact = np.where(noise, 0.0, axis)
    exact /= np.linalg.norm(exact)
    # turning about the other axis: the way there, the turn, the way back
    return exact, Rounding((), int(noise.sum()), 2 * float(np.linalg.norm(exact - axis)))


def without_noise(name: str, origin: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray, Rounding]:
    """Origin (4, 4) and axis (3,) of a joint with what is within ``NOISY`` of right angles taken as right."""
    exact, direction = origin.copy(), axis.copy()
    exact[:3, :3] = _square(origin[:3, :3])
    exact[:3, 3][np.abs(origin[:3, 3]) < NOISY_M] = 0.0
    direction[np.abs(axis) < NOISY] = 0.0
    if np.any(axis):
        direction /= np.linalg.norm(direction)
    turn = float(np.linalg.norm(exact[:3, :3] - origin[:3, :3])) / math.sqrt(2)
    leans = float(np.linalg.norm(direction - axis))
    moved = float(np.linalg.norm(exact[:3, 3] - origin[:3, 3]))
    if turn < _NOISE and leans < _NOISE and moved < _UNSEEN_M:
        return origin, axis, Rounding()
    angle = max(turn, float(np.linalg.norm(exact[:3, :3] @ direction - origin[:3, :3] @ axis)))
    size = f"{math.degrees(angle):.2g}°" if angle >= _NOISE else f"{1000 * moved:.2g} mm"
    return exact, direction, Rounding((), 0, turn + 2 * leans, moved, (f"{name} {size}",))


def _square(rotation: FloatArray) -> FloatArray:
    """A rotation near to quarter turns as these; of another one, each of roll, pitch and yaw that is near."""
    nearest = np.rint(rotation)
    if np.linalg.norm(nearest - rotation) < math.sqrt(2) * NOISY and np.linalg.det(nearest) == 1.0:
        return nearest
    angles = roll_pitch_yaw(rotation)
    quarters = _QUARTER * np.rint(angles / _QUARTER)
    return rotation_from_rpy(*np.where(np.abs(angles - quarters) < NOISY, quarters, angles).tolist())


WIDEST = 4 * math.pi
"""a limit farther from zero is none [rad]"""
_ROUNDED = 0.05
"""by which whole turns are rounded [rad]"""
_DEGREES = 720.0
"""a limit between ``WIDEST`` and this is likely one in degrees, unless it is of whole half turns"""


@dataclass(frozen=True)
class UrdfJoint:
    """One joint, in metres and radians."""

    name: str
    kind: str
    """one of ``KINDS``"""
    parent: str
    child: str
    origin: FloatArray
    """(4, 4) ``T_parent_joint``"""
    axis: FloatArray
    """(3,) unit vector in the joint's frame"""
    limits: tuple[float, float] | None
    """lower and upper; 0 where one is not written"""
    speed: float
    """0 where none is written, as ``effort``"""
    effort: float
    mimics: str | None
    """the joint that this one follows"""
    multiplier: float
    """how far it turns by a turn of that joint"""
    offset: float
    """its angle where that joint is at zero"""
    rounding: Rounding
    """how origin and axis differ from what is written"""
    held: str | None = None
    """where a joint that moves was taken as fixed, and why, to be shown; ``origin`` has it in"""
    limits_told: str | None = None
    """how its limits differ from what is written, or from what is usual, to be shown"""

    def without_noise(self) -> UrdfJoint:
        """The joint with right angles where the file's are nearly right."""
        origin, axis, rounding = without_noise(self.name, self.origin, self.axis)
        return replace(self, origin=origin, axis=axis, rounding=self.rounding + rounding)

    def settled(self) -> UrdfJoint:
        """The joint with the limits that it has in an arm, or fixed at the one angle that they leave it."""
        if self.kind == "fixed" or self.mimics is not None:  # what it follows has limits
            return self
        turn = (-math.pi, math.pi)
        if self.kind == "continuous":
            lower, upper = self.limits or turn
            if not -WIDEST <= lower < upper <= WIDEST or upper - lower > 2 * math.pi - _ROUNDED:
                return replace(self, limits=turn)
            told = f"{self.name}, a continuous joint, keeps to the limits that its file gives"
            return replace(self, limits_told=f"{told}, {_degrees(lower)} … {_degrees(upper)}")
        where = f'<joint name="{self.name}">'
        if self.limits is None:
            raise RobotFileError(f"{where}: <limit> is missing; a revolute joint needs lower and upper")
        lower, upper = (math.copysign(WIDEST, one) if _is_widest(one) else one for one in self.limits)
        where = f"{where}: <limit lower={lower} upper={upper}>"
        if _is_in_degrees(lower) or _is_in_degrees(upper):
            raise RobotFileError(
                f"{where}: both are in radians; these look like degrees. More than two turns are "
                'type="continuous"'
            )
        if lower > upper:
            raise RobotFileError(f"{where}: the lower limit comes first")
        if lower < -WIDEST or upper > WIDEST:
            told = f"{self.name}, with limits of {lower:g} … {upper:g} rad in the file"
            if lower < -WIDEST and upper > WIDEST:
                told += ", is taken as continuous"
                return replace(self, kind="continuous", limits=turn, limits_told=told)
            kept = (
                (lower, lower + turn[1] - turn[0]) if upper > WIDEST else (upper + turn[0] - turn[1], upper)
            )
            told += f", keeps to one turn, {_degrees(kept[0])} … {_degrees(kept[1])}"
            return replace(self, limits=kept, limits_told=told).settled()
        if lower == upper == 0.0:  # exporters write that where the limits were never filled in
            raise RobotFileError(
                f"{where}: both are 0, which is also what is read where they are not written; write the "
                'angles that the joint may take, or make it type="fixed" if it does not turn'
            )
        if lower < upper:
            return replace(self, limits=(lower, upper))
        held = f"{self.name} at {math.degrees(lower):.1f}°, as both limits are the same"
        return replace(self.turned(lower), kind="fixed", held=held)

    def turned(self, angle: float) -> UrdfJoint:
        """The joint with its zero where it stands at an angle [rad]."""
        turn, rounding = exact_rotation(["0", "0", repr(angle)])
        along, place = frame_along(self.axis), np.eye(4)
        place[:3, :3] = along[:3, :3] @ turn @ along[:3, :3].T
        return replace(self, origin=self.origin @ place, rounding=self.rounding + rounding)

    def at_rest(self) -> UrdfJoint:
        """A joint below the arm that slides or floats (a rail, a lift, a mobile base), fixed near zero."""
        place, along = np.eye(4), 0.0
        if self.kind == "prismatic" and self.limits is not None:
            along = min(max(0.0, self.limits[0]), self.limits[1])
            place[:3, 3] = along * self.axis
        held = f"{self.name} at {1000 * along:.4g} mm, which moves the base and is no joint of the arm"
        return replace(self, kind="fixed", origin=self.origin @ place, held=held)


def is_free(joint: UrdfJoint) -> bool:
    """True where a joint turns, and follows no other."""
    return joint.kind in ("revolute", "continuous") and joint.mimics is None


@dataclass(frozen=True, slots=True)
class UrdfLink:
    """The mass of a link, 0 where none is written, and its shapes."""

    mass_kg: float
    com: FloatArray
    """(3,) centre of mass in the link's frame [m]"""
    visual: tuple[Shape, ...] = ()
    """with their poses in the frame of the file's link, and the names of meshes as written"""
    collision: tuple[Shape, ...] = ()
    problems: tuple[str, ...] = ()
    """why shapes of it were passed over"""

    @property
    def is_solid(self) -> bool:
        """False for a bare frame."""
        return bool(self.visual or self.collision or self.mass_kg)


class UrdfTree:
    """The links of a file, hung up by its root; refuses what is no tree."""

    def __init__(
        self,
        path: Path,
        name: str,
        links: dict[str, UrdfLink],
        joints: Sequence[UrdfJoint],
        arguments: tuple[Argument, ...] = (),
        left_out: tuple[str, ...] = (),
    ):
        self.path, self.name, self.links = path, name, links
        self.arguments, self.left_out = arguments, left_out
        self._children: dict[str, list[UrdfJoint]] = {link: [] for link in links}
        self._into: dict[str, UrdfJoint] = {}
        self._poses: dict[str, FloatArray] = {}
        if not links:
            raise RobotFileError("there is no <link>")
        for joint in joints:
            self._hang(joint)
        roots = [link for link in links if link not in self._into]
        if not roots:
            raise RobotFileError("the joints form a loop; a robot has one root link")
        if len(roots) > 1:
            raise RobotFileError(
                f"there are several root links ({', '.join(roots)}); join them by a fixed joint"
            )
        self.root = roots[0]
        self._poses[self.root] = np.eye(4)
        lost = set(links) - {self.root, *(joint.child for joint in self.below(self.root))}
        if lost:
            raise RobotFileError(f"the joints form a loop: {', '.join(sorted(lost))}")

    def _hang(self, joint: UrdfJoint) -> None:
        where = f'<joint name="{joint.name}">'
        for tag, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in self.links:
                raise RobotFileError(f'{where}: <{tag} link="{link}">: there is no such link')
        if joint.child in self._into:
            other = self._into[joint.child].name
            raise RobotFileError(f'{where}: the link "{joint.child}" already hangs on the joint "{other}"')
        self._into[joint.child] = joint
        self._children[joint.parent].append(joint)

    def children(self, link: str) -> list[UrdfJoint]:
        """The joints that a link carries."""
        return self._children[link]

    def into(self, link: str) -> UrdfJoint | None:
        """The joint that carries a link; None for the root."""
        return self._into.get(link)

    def below(self, link: str) -> Iterator[UrdfJoint]:
        """Every joint further from the root than a link, parents first."""
        waiting = list(self._children[link])
        for joint in waiting:
            yield joint
            waiting += self._children[joint.child]

    def body(self, link: str) -> list[str]:
        """A link, and those that hang on it by fixed joints, the nearest first."""
        body = [link]
        for one in body:
            body += [joint.child for joint in self._children[one] if joint.kind == "fixed"]
        return body

    def carriers(self) -> dict[str, str]:
        """Of each link, the first one of the ``body`` that it is part of."""
        carriers = {self.root: self.root}
        for joint in self.below(self.root):
            carriers[joint.child] = carriers[joint.parent] if joint.kind == "fixed" else joint.child
        return carriers

    def exits(self, link: str) -> list[UrdfJoint]:
        """The joints that a link and its ``body`` carry and that move."""
        return [one for part in self.body(link) for one in self._children[part] if one.kind != "fixed"]

    def pose(self, link: str) -> FloatArray:
        """(4, 4) of a link in the root frame, all joints at zero."""
        route: list[UrdfJoint] = []
        while link not in self._poses:
            route.append(self._into[link])
            link = route[-1].parent
        for joint in reversed(route):
            self._poses[joint.child] = self._poses[joint.parent] @ joint.origin
        return self._poses[route[0].child if route else link]

    def route(self, link: str) -> list[UrdfJoint]:
        """The joints from the root link to a link, fixed ones too, as they are written."""
        route: list[UrdfJoint] = []
        while link != self.root:
            route.append(self._into[link])
            link = route[-1].parent
        return route[::-1]


def _is_widest(limit: float) -> bool:
    return abs(abs(limit) - WIDEST) < _ROUNDED


def _is_in_degrees(limit: float) -> bool:
    half_turns = abs(limit) / math.pi
    whole = abs(half_turns - round(half_turns)) * math.pi < _ROUNDED if math.isfinite(half_turns) else True
    return WIDEST < abs(limit) <= _DEGREES and (limit.is_integer() or not whole)


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.4g}°"
