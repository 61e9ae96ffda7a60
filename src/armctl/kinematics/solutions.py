"""What inverse kinematics answers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.arrays import ArrayRecord, ByContent, FloatArray, content, lock
from armctl.errors import InputError, UnreachableError
from armctl.facts import Reason, Said, say
from armctl.facts.targets import OffRotation
from armctl.kinematics.angles import SAME_ROTATION, rotation_angle
from armctl.kinematics.energy import FROM_START, Criterion, OnTarget, checked_criterion, energies
from armctl.kinematics.explanations import SolvedArm, lost_at_a_limit, nearest_point, refusal, which_move
from armctl.kinematics.target import Target, as_numbers
from armctl.lazy_dataclass import dataclass

THERE_M = 1e-7
"""a nearest point that is so near is the target itself [m]"""
_SAME_TIME, _SAME_TORQUE = 9, 12
"""decimals that count of a time [s], and of a sum of squared torques by the least one"""
_GAIN, _ALIGNED = 1e-6, 1e-9
"""by what share a solution must be better than all of the list to be taken beside it; sine of the angle up to
which a roll axis is along the approach axis"""
Choice = str | Callable[[FloatArray, FloatArray | None], ArrayLike]
"""A named criterion, or one of your own: of the solutions (k, n) [rad] and the start (n,) [rad], or None
where none is given, it makes k energies. The least is chosen; infinity excludes one."""
Further = Callable[[Criterion, FloatArray], FloatArray]
"""By a criterion and from a start (n,) [rad], solutions (m, n): the one of least travel is among them."""


class Listed(Protocol):
    """An array whose length is known before it is made."""

    def __len__(self) -> int: ...

    def __array__(self) -> NDArray[Any]: ...


class Solutions(ByContent):
    """Every configuration inside the limits that answers a target, or why there is none. Immutable.

    ``len(solutions)``, ``solutions[0]`` and ``for q in solutions`` are about the rows (n,) [rad] of ``q``.
    Two are equal that hold the same solutions of the same target for the same arm, and in the same order.
    """

    def __init__(
        self,
        arm: SolvedArm,
        target: Target,
        q: FloatArray | Sequence[Sequence[float]] | Listed,
        branch_index: NDArray[np.int8] | Sequence[int] | Listed,
        free_joint: int | None = None,
        least_rotation: Callable[[], FloatArray | None] | None = None,
        reason: Reason | str | Callable[[], Reason | str] | None = None,
        nearest_q: FloatArray | Callable[[], FloatArray] | None = None,
        incomplete: Reason | None = None,
        further: Further | None = None,
    ) -> None:
        """What a solver found.

        Args:
            arm: whose configurations they are.
            target: what was asked for.
            q: (k, n) configurations [rad].
            branch_index: (k,) index of each into the arm's ``branch_names``.
            free_joint: index of the joint that was swept; None where the solutions are isolated.
            least_rotation: the exact optimum over the continuum, where a joint is free.
            reason: why there is none, or what finds that out (a search may take long); None when solved.
            nearest_q: (n,) configuration that comes nearest where there is none [rad], or what finds it.
            incomplete: why solutions may be missing; None where a look at the list decides.
            further: solutions of a continuum by a criterion ``FROM_START``.
        """
        self.arm, self.target, self._q, self._index = arm, target, q, branch_index
        self.free_joint, self.least_rotation, self.further = free_joint, least_rotation, further
        self._reason, self._nearest, self._missing = reason, nearest_q, incomplete

    @cached_property
    def q(self) -> FloatArray:
        """(k, n) configurations [rad], all inside the limits."""
        return lock(np.asarray(self._q, dtype=np.float64).reshape(-1, self.arm.chain.n))

    @cached_property
    def nearest_q(self) -> FloatArray | None:
        """(n,) configuration that comes nearest where there is no solution [rad]; None: not known."""
        found = self._nearest() if callable(self._nearest) else self._nearest
        return None if found is None else lock(found)

    @property
    def reason(self) -> str | None:
        """Why there is none, in words; None when solved."""
        return self.said()

    def said(self, language: str | None = None) -> str | None:
        """The same in a language ("en", "tr"); None is the user's."""
        return None if (why := self.why()) is None else say(why, language)

    @cached_property
    def bare_reason(self) -> Reason | None:
        """Why there is none, without the nearest point and without a word on units; None when solved."""
        found = self._reason() if callable(self._reason) else self._reason
        return Said(found) if isinstance(found, str) else found

    @cached_property
    def refusal(self) -> Reason | None:
        """The reason and the nearest reachable point, as data; None when solved."""
        q, point = self.nearest_q, self.nearest_m
        if q is None or point is None:
            return self.why()
        return self.why(nearest_point(self.arm, self.target, q, point, self.nearest_away_m))

    def why(self, instead: Reason | None = None) -> Reason | None:
        """Why there is none, as data, and what is done ``instead``; None when solved."""
        bare = self.bare_reason
        return None if bare is None else refusal(bare, self.arm, self.target, instead)

    @cached_property
    def branch_index(self) -> NDArray[np.int8]:
        """(k,) index of each into ``branch_names``."""
        return lock(np.asarray(self._index, dtype=np.int8))

    @property
    def branch_names(self) -> tuple[str, ...]:
        """Names of the arm's branches."""
        return self.arm.branch_names

    def __repr__(self) -> str:
        found = self.explanation
        if self.success:
            swept = "" if self.free_joint is None else f", {self.arm.title(self.free_joint)} swept"
            found = f"{len(self)} configuration{'' if len(self) == 1 else 's'}{swept}"
        return f"Solutions({found})"

    def made_of(self) -> tuple[Any, ...]:
        """See ``ByContent``: what was put off is worked out."""
        says = self.arm, self.target, self.q, self.branch_index, self.free_joint, self.least_rotation
        return (*says, self.bare_reason, self.nearest_q, self._missing, self.further)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Solutions):
            return NotImplemented
        return self is other or self._listed == other._listed

    def __hash__(self) -> int:
        return hash(self._listed)

    @property
    def _listed(self) -> Any:
        """What makes two equal; the rest follows from it."""
        return content((self.arm, self.target, self.q, self.branch_index, self.free_joint, self.nearest_q))

    @property
    def incomplete_reason(self) -> str | None:
        """Why solutions may be missing from the list, in words; None where none is."""
        return None if self.incomplete is None else say(self.incomplete)

    @cached_property
    def incomplete(self) -> Reason | None:
        """The same as data.

        A swept joint, and a roll that is free by itself, do not count.
        """
        if self._missing is not None or self.arm.limits is None:
            return self._missing
        given = self.arm.roll_joint if self.target.roll is not None else None
        # any angle of these counts as the same solution, or they are given one
        held = [k for k in (self.free_joint, self.free_roll, given) if k is not None]
        if (moving := which_move(self.arm, self.target, self.q, held)) is not None:
            return moving
        return lost_at_a_limit(self.arm, self.target, self.q, held) if self.free_joint is None else None

    @property
    def complete(self) -> bool:
        """False where solutions may be missing from the list; ``incomplete_reason`` says why."""
        return self.incomplete is None

    @property
    def success(self) -> bool:
        """True when there is at least one."""
        return len(self._q) > 0

    def __len__(self) -> int:
        return len(self._q)

    def __getitem__(self, index: int | slice) -> FloatArray:
        return self.q[index]

    def __iter__(self) -> Iterator[FloatArray]:
        return iter(self.q)

    @cached_property
    def branch(self) -> NDArray[np.str_]:
        """(k,) branch name of each, for example ``front elbow-up``."""
        return lock(np.array(self.branch_names or ("",), dtype=np.str_)[self.branch_index])

    @cached_property
    def residual_m(self) -> FloatArray:
        """(k,) distance between the target point and the tool point of each [m]."""
        points = self.arm.chain.forward(self.q)[:, :3, 3]
        return lock(np.linalg.norm(points - self.target.position, axis=1))

    @cached_property
    def residual_rad(self) -> FloatArray:
        """(k,) angle between the rotation asked for and that of each [rad]; 0 where none was asked for."""
        if self.target.rotation is None:
            return lock(np.zeros(len(self.q)))
        turned = np.swapaxes(self.arm.chain.forward(self.q)[:, :3, :3], 1, 2) @ self.target.rotation
        return lock(rotation_angle(turned))

    @property
    def met(self) -> bool:
        """Whether one has all that was asked for: else the nearest to a rotation may be listed."""
        return self.success and bool((self.residual_rad < SAME_ROTATION).any())

    @cached_property
    def nearest_m(self) -> FloatArray | None:
        """(3,) the reachable point that comes nearest to the target [m]; None when it is reached."""
        return None if self.nearest_q is None else lock(self.arm.chain.forward(self.nearest_q)[:3, 3])

    @property
    def explanation(self) -> str:
        """The ``refusal`` in one sentence [mm]; empty when solved."""
        return "" if self.refusal is None else say(self.refusal)

    @property
    def nearest_away_m(self) -> float:
        """How far that point is from the target [m]; 0 where the target point itself can be reached."""
        away = 0.0 if self.nearest_m is None else float(np.linalg.norm(self.nearest_m - self.target.position))
        return away if away >= THERE_M else 0.0

    @cached_property
    def free_roll(self) -> int | None:
        """Index of the joint that may have any angle inside its limits, because no roll was asked for."""
        joint, (_, pitch, roll, rotation) = self.arm.roll_joint, self.target
        if joint is None or self.arm.roll_moves_tip or roll is not None or rotation is not None:
            return None
        chain = self.arm.chain
        approach = chain.forward(np.zeros(chain.n))[:3, 2]
        swings = np.linalg.norm(np.cross(chain.axes()[1][chain.first_links[joint]], approach)) > _ALIGNED
        return None if swings and pitch is not None else joint

    def taken(self, q: FloatArray, criterion: Criterion, start: FloatArray | None) -> FloatArray:
        """Configurations ``q`` (..., n) [rad] as a criterion takes them; a copy.

        Those ``FROM_START`` leave a free roll as near as its limits allow to where ``start`` (n,) has it.
        """
        q = q.copy()
        if criterion in FROM_START and start is not None and self.free_roll is not None:
            limits = self.arm.limits
            roll = start[self.free_roll]
            q[..., self.free_roll] = roll if limits is None else np.clip(roll, *limits[self.free_roll])
        return q

    def energies(self, criterion: Choice = "least-rotation", start: ArrayLike | None = None) -> FloatArray:
        """(k,) energy of each by a criterion (``energy.CRITERIA``, or your own); infinite where excluded."""
        checked = None if start is None else self.arm.chain.checked_one(start)
        if not isinstance(criterion, str) and callable(criterion):
            return self._own_energies(as_numbers(criterion(self.q, checked), "energies"))
        name = checked_criterion(criterion)
        return self._energies(name, self.taken(self.q, name, checked), checked)

    def _energies(self, name: Criterion, q: FloatArray, start: FloatArray | None) -> FloatArray:
        return energies(name, q, self.arm.energy, self.arm.pitch_joints, start)

    def _own_energies(self, energy: FloatArray) -> FloatArray:
        if energy.shape != (len(self),) or np.isnan(energy).any():
            raise InputError(
                f"a criterion of your own gives one energy for each of {len(self)} solutions, none of them "
                f"NaN; it gave {energy.shape} with {np.count_nonzero(np.isnan(energy))} NaN"
            )
        return energy

    def order(self, criterion: Criterion, start: ArrayLike | None = None) -> NDArray[np.intp]:
        """(k,) indices of the solutions, that of least energy first.

        Of equal times the least travel comes first, of equal torques the least rotation.
        """
        begin = None if start is None else self.arm.chain.checked_one(start)
        q = self.taken(self.q, criterion, begin)
        return self._ranked(criterion, self._energies(criterion, q, begin), q, begin)

    def _ranked(
        self, name: Criterion | None, energy: FloatArray, q: FloatArray, start: FloatArray | None
    ) -> NDArray[np.intp]:
        if name == "least-torque":  # whole turns weigh nothing
            least = float(np.min(energy[energy > 0.0], initial=math.inf))
            scale = least if math.isfinite(least) else 1.0
            return np.lexsort((np.abs(q).sum(axis=1), np.round(energy / scale, _SAME_TORQUE)))
        if name != "shortest-time":
            return np.argsort(energy, kind="stable")
        # one joint sets the time, and the others need not move for nothing
        return np.lexsort((self._energies("least-travel", q, start), np.round(energy, _SAME_TIME)))

    def best(self, criterion: Choice = "least-rotation", start: ArrayLike | None = None) -> FloatArray:
        """The configuration (n,) [rad] of least energy by one of ``energy.CRITERIA``, or your own ``Choice``.

        Over a continuum ``least-rotation``, ``least-travel`` and ``shortest-time`` are not only the best of
        the list: they are exact where the arm's family can do it, and else continued from the best. The
        criteria ``FROM_START`` need ``start`` (n,) [rad], where the arm stands; the others only check it.
        Raises ``UnreachableError``: there is no solution, or none that the criterion admits; ``InputError``:
        no such criterion, a start that is missing, or one that is no configuration.
        """
        own = not isinstance(criterion, str) and callable(criterion)
        name = None if own else checked_criterion(criterion)
        begin = None if start is None else self.arm.chain.checked_one(start)
        if not self.success:
            raise UnreachableError(self.refusal or "there is no solution")
        if name == "least-rotation" and self.least_rotation is not None:
            exact = self.least_rotation()
            if exact is not None:
                return exact
        if name in FROM_START and begin is not None:
            q = self._from_start(name, begin)
        else:
            q = self.q if name is None else self.taken(self.q, name, begin)
        energy = self.energies(criterion, begin) if name is None else self._energies(name, q, begin)
        i = int(self._ranked(name, energy, q, begin)[0])
        if energy[i] == math.inf:
            said = "the criterion given" if name is None else repr(name)
            which = "the only solution" if len(self) == 1 else f"all {len(self)} solutions"
            raise UnreachableError(f"{said} excludes {which}")
        return q[i].copy()

    def _from_start(self, name: Criterion, start: FloatArray) -> FloatArray:
        """Solutions (m, n) with the best by a criterion ``FROM_START`` among them."""
        exact = name == "least-travel" or self.target.rotation is not None
        further = None if self.further is None else self.taken(self.further(name, start), name, start)
        q = self.taken(self.q, name, start)  # where the arm stands may be on the list alone
        q = q if further is None else np.concatenate([further, q])
        if further is not None and len(further) and exact:
            return q
        return np.concatenate([q, self._continued(name, q, start)])

    def _continued(self, name: Criterion, q: FloatArray, start: FloatArray) -> FloatArray:
        """Solutions (m, n) of a continuum that are better by a criterion than the best of ``q`` (k, n)."""
        arm = self.arm
        if arm.limits is None:
            return np.empty((0, arm.chain.n))
        energy = self._energies(name, q, start)
        limits = arm.limits.copy()
        for joint in (self.free_roll, None if self.target.roll is None else arm.roll_joint):
            if joint is not None:
                limits[joint] = q[int(energy.argmin()), joint]
        on_target = OnTarget(arm.chain, limits, self.target, self.arm.upward)
        if on_target.spare < 1:
            return q[:0]
        if name == "least-travel":
            found = on_target.least_travel(q, start, 1.0 / arm.energy.speed_limits)
        else:
            found = on_target.shortest_time(q, start, arm.energy)
        return found[self._energies(name, found, start) < energy.min() * (1.0 - _GAIN)]

    def turned_off(self, q: FloatArray) -> str | None:
        """How a configuration (n,) [rad] misses the rotation that was asked for; None where it does not."""
        return None if (off := self.off_rotation(q)) is None else say(off)

    def off_rotation(self, q: FloatArray) -> OffRotation | None:
        """The same as data."""
        if self.target.rotation is None:
            return None
        off = float(rotation_angle(self.arm.chain.forward(q)[:3, :3].T @ self.target.rotation))
        return None if off <= SAME_ROTATION else OffRotation(off)

    def index_of(self, q: ArrayLike) -> int:
        """Index of the solution nearest to ``q`` (n,) [rad] by its largest difference of a joint.

        A roll that is free does not count.
        """
        if not self.success:
            raise UnreachableError(self.why() or "there is no solution")
        apart = np.abs(self.q - self.arm.chain.checked_one(q))
        if self.free_roll is not None:
            apart[:, self.free_roll] = 0.0
        return int(apart.max(axis=1).argmin())

    def branch_of(self, q: ArrayLike) -> str:
        """Branch name of the listed solution that lies nearest to ``q``."""
        return str(self.branch[self.index_of(q)])


@dataclass(frozen=True, eq=False, repr=False)
class BatchSolutions(ArrayRecord):
    """The branches of k poses, a column a branch; the arrays are read-only."""

    q: FloatArray
    """(k, b, n) joint angles [rad]; NaN where a branch has no solution inside the limits"""
    found: NDArray[np.bool_]
    """(k, b) where it has one"""
    branch_names: tuple[str, ...]
    """(b,)"""

    def __post_init__(self) -> None:
        """Without copies, as the arrays are large."""
        lock(self.q)
        lock(self.found)

    def __repr__(self) -> str:
        poses, branches = self.found.shape
        return f"BatchSolutions({int(self.found.sum())} configurations of {poses} poses, {branches} branches)"

    @property
    def count(self) -> NDArray[np.intp]:
        """(k,) how many branches of each pose have a solution."""
        return self.found.sum(axis=1)

    def __len__(self) -> int:
        return len(self.q)
