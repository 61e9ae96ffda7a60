"""What every solver family answers. A family fills in what it can; the rest has an answer here."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.facts import Reason, Several
from armctl.facts.targets import Besides, NoSuchAngle
from armctl.kinematics.angles import (
    LIMIT_TOLERANCE,
    TWO_PI,
    images,
    into_limits,
    nearest_angle,
    rest_angle,
    wrap,
)
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.explanations import angle_needed
from armctl.kinematics.samples import DEFAULT_STEP
from armctl.kinematics.solutions import BatchSolutions, Solutions
from armctl.kinematics.subproblems import ToolPlane
from armctl.kinematics.target import Target, checked_positions, checked_rotations
from armctl.kinematics.workspace import SampledSection, Section


class InverseKinematics(ABC):
    """A solver for one arm inside its limits. Immutable; safe in several threads."""

    family: ClassVar[str]
    """name of the family, in words"""
    complete: ClassVar[bool] = True
    """False where solutions are searched for: that takes long, and some may be missing"""
    searches_parts: ClassVar[bool] = False
    """True where less than a whole pose, such as a position, is searched for: that takes long"""
    takes_linkages: ClassVar[bool] = False
    """True where links may turn by sums of joint angles (``Chain.coupling``)"""
    roll_moves_tip: ClassVar[bool] = False
    """True where the tool point lies beside the axis of the roll joint, so that a free roll is swept"""
    direct: ClassVar[bool] = False
    """True where ``solve_batch`` and ``least_rotation`` answer, without a list of all solutions"""

    def __init__(
        self,
        chain: Chain,
        limits: FloatArray,
        energy: EnergyModel,
        titles: Sequence[str],
        *,
        plane: ToolPlane | None = None,
        free_joint: int | None = None,
        roll_joint: int | None = None,
    ) -> None:
        self.chain, self.limits, self.energy, self.titles = chain, limits, energy, tuple(titles)
        self.plane = plane
        """the vertical plane in which parallel pitch joints move the tool; None where there is none"""
        self.pitch_joints: tuple[int, ...] = () if plane is None else plane.pitch_joints
        self.free_joint = free_joint
        """index of the joint that is free (and swept) when only a position is asked for"""
        self.roll_joint = roll_joint
        """index of the joint that rolls the tool about its approach axis"""
        k = roll_joint
        self._roll = None if k is None else RollJoint(k, titles[k], limits[k].tolist())

    def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
        """Prepared anew where a pickle is read."""
        return type(self).of, (self.chain, self.limits, self.energy, self.titles)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.chain.n} joints)"

    @classmethod
    @abstractmethod
    def of(cls, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> Self | None:
        """The solver of an arm of the family, or None: limits (n, 2) [rad], titles (n,) for messages."""

    @classmethod
    def recognises(cls, chain: Chain) -> bool:
        """Whether a serial arm is of this family, and a whole pose needs no search in it."""
        return False

    @abstractmethod
    def solve(self, target: Target, step: float, start: FloatArray | None = None) -> Solutions:
        """All solutions inside the limits; where there is none, why, and the nearest configuration.

        ``start`` (n,) [rad] is where the arm stands: a search begins there, a closed form does not need it.
        Raises ``InputError`` where the ``step`` of a swept joint [rad] is not a positive number.
        """

    def pitch_and_roll(self, q: FloatArray) -> tuple[float | None, float | None]:
        """Tool pitch in [-pi/2, pi/2] and roll [rad] at one configuration (n,); None where there is none."""
        x, y, z = self.chain.forward(q)[:3, 2].tolist()
        roll = None if self.roll_joint is None else float(q[self.roll_joint])
        return math.atan2(z, math.hypot(x, y)), roll  # an arc sine is blind near ±90°

    def solve_batch(
        self,
        position_m: ArrayLike,
        pitch: ArrayLike | None,
        roll: ArrayLike | None,
        rotation: ArrayLike | None = None,
    ) -> BatchSolutions:
        """Every branch of many poses; ``Robot.inverse_batch`` says more.

        Raises ``InputError``: a wrong shape, an entry that is not finite, or a family that has no batch.
        """
        self.solve_poses(np.empty((0, 4, 4)))  # a family that has none says so first
        if rotation is None or pitch is not None or roll is not None:
            raise self._has_no("batch of targets other than positions with rotations")
        position = checked_positions(position_m)
        poses = np.tile(np.eye(4), (len(position), 1, 1))
        poses[:, :3, 3] = position
        poses[:, :3, :3] = checked_rotations(rotation, (len(position), 3, 3), "the target rotations")
        solutions = self.solve_poses(poses)
        q, found = solutions.q.copy(order="K"), solutions.found.copy()
        for joint, (low, high) in enumerate(self.limits.tolist()):
            angle = q[..., joint]
            found &= into_limits(angle, low, high)
            np.clip(angle, low, high, out=angle)
        q[~found] = math.nan
        return BatchSolutions(q, found, solutions.branch_names)

    def solve_poses(self, poses: FloatArray) -> BatchSolutions:
        """Every branch of many tool poses ``T_base_tool`` (k, 4, 4) [m], whatever the joint limits.

        The angles are at any of their images. Raises ``InputError``: the family has no batch.
        """
        raise self._has_no("batch of poses")

    def reaches(self, pose: FloatArray) -> bool | None:
        """Whether any configuration has a tool pose ``T_base_tool`` (4, 4) [m], limits not looked at.

        None: only a search would tell.
        """
        known = self.complete and self.searches_parts  # such a family lists whole poses
        return bool(self.solve_poses(pose[None]).found.any()) if known else None

    def meets(self, target: Target) -> bool:
        """Whether ``solve`` lists a configuration that has all of a target: sooner, where there is none."""
        if self.complete and self.searches_parts and target.rotation is not None:
            return bool(self.solve_batch([target.point], None, None, [target.rotation]).found.any())
        return self.solve(target, DEFAULT_STEP).met

    def is_swept(self, target: Target) -> bool:
        """Whether a target asks for less than the joints can do: a continuum, and no list of branches.

        A joint that rolls the tool about its own point does not count: without a roll asked for, any will do.
        """
        turns = self.limits[:, 0] < self.limits[:, 1]
        asked = 6
        if target.rotation is None:
            asked = 3 if target.pitch is None else 4 if target.up is None else 5
            if self.roll_moves_tip:
                asked += target.roll is not None
            elif self.roll_joint is not None:
                turns[self.roll_joint] = False
        return bool(np.count_nonzero(turns) > asked)

    def least_rotation(self, position_m: ArrayLike) -> FloatArray:
        """The exact least rotation of one point (3,) or many (k, 3) [m]; ``Robot.least_rotation`` says more.

        Raises ``InputError``: a wrong shape, an entry that is not finite, or a family that has none.
        """
        raise self._has_no("least rotation without a list")

    def section(self) -> Section:
        """The workspace cut open in the plane of the base axis and the tip."""
        return SampledSection(self.chain, self.limits)

    def _besides(self, refusal: Reason, rest: Target, step: float, start: FloatArray | None = None) -> Reason:
        """Why a roll or a pitch cannot be, and what forbids the ``rest`` of the target."""
        other = self.solve(rest, step, start).bare_reason
        return refusal if other is None else Several((refusal, Besides(other)))

    def _has_no(self, what: str) -> InputError:
        return InputError(f"arms of the family {self.family!r} have no {what}: call inverse for each target")


# The joint that rolls the tool about its approach axis.

NO_ROLL = NoSuchAngle("roll")
_NOTHING = (0.0,)


class RollJoint:
    """One roll joint inside its limits. Immutable; safe in several threads."""

    def __init__(self, index: int, title: str, limits: Sequence[float]) -> None:
        self.index, self.title = index, title
        self.low, self.high = map(float, limits)
        self.resting = rest_angle(self.low, self.high)
        """where it stands when any roll will do [rad]"""
        self._any = (self.resting,)
        # between these a roll has no image inside the limits but itself
        slack = LIMIT_TOLERANCE if self.high - self.low <= TWO_PI else math.inf
        self._alone_from, self._alone_to = self.low + slack, self.high - slack

    def angles(self, roll: float | None) -> Sequence[float]:
        """What the joint may be at for a roll asked for, or any [rad]; empty where its limits forbid it."""
        if roll is None:
            return self._any
        if self._alone_from < roll < self._alone_to:
            return (roll,)
        return images(roll, self.low, self.high)


def roll_angles(joint: RollJoint | None, roll: float | None) -> Sequence[float]:
    """``RollJoint.angles``; for an arm without the joint one number that says nothing."""
    return _NOTHING if joint is None else joint.angles(roll)


def held_roll(joint: RollJoint | None, roll: float | None) -> tuple[Reason | None, float]:
    """Why a roll asked for (None: any) cannot be, or None; and what the joint is held at for it [rad].

    Of several angles the one nearest to zero; the nearest that can be; 0 where there is no such joint.
    """
    if joint is None:
        return (None if roll is None else NO_ROLL), 0.0
    angles = joint.angles(roll)
    if roll is None or angles:
        return None, min(angles, key=abs)
    needed = angle_needed(joint.title, (joint.low, joint.high), wrap(roll))
    return needed, nearest_angle(roll, joint.low, joint.high)
