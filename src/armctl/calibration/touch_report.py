"""What touched points say of an arm, as facts: figures on points that were not used, causes, a correction."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.calibration.touch_fit import NOISE_WEIGHT, OF_SHEET, Solved, blame, solve
from armctl.calibration.touch_model import LEAST_POINTS, Parameter, Touches, TouchModel, Values
from armctl.facts import Reason, say_with_advice
from armctl.facts.causes import (
    FitFigures,
    GoodAlready,
    HasPlay,
    LengthOff,
    MistakenPoint,
    NotBetter,
    NotTold,
    PlaceOff,
    Sags,
    ScaleOff,
    ZeroOff,
)
from armctl.kinematics.samples import joint_samples
from armctl.lazy_dataclass import dataclass
from armctl.robot import Robot

_MISTAKEN = 5.0
"""a point is mistaken where it is off by more than so many standard deviations of what is expected there"""
_MISTAKEN_M = 0.003
"""… and by more than that [m]"""
_SUSPECTS = 3
"""points that are looked at in each round"""
_MOST_MISTAKEN = 0.2
"""share of the points that may be mistaken; with more of them the fit is wrong, not the points"""
_TOLD = 0.1
"""a number is told by the points where they narrow what is known of it by more than this share"""
_SURE = 2.0
"""a number is a cause where it is away from 0 by more than so many standard deviations"""
_SEEN_M = 0.0003
"""… and moves the tool by more than that [m]"""
_BETTER = 0.8
"""a correction is offered where it leaves less than this share of the error at points that were left out"""
_SIMPLE = 1.05
"""few numbers are taken for many where they leave no larger share of what those leave"""
_EVEN = 1.25
"""… and where all of them leave no less than this share more at the points themselves"""
_LAW = 0.05
"""share of sag and play that no fit of them foretells: weights and friction are known to that"""
_GOOD_M = 0.001
_SAMPLES, _NEAR_M, _LEAST_NEAR = 4000, 0.01, 20
_DRAWN, _TAILS = 4000, (0.05, 0.95)
"""arms that are drawn by what the points leave open, and the shares of them below and above what is told"""


@dataclass(frozen=True, slots=True)
class Size:
    """How far a tool is off [m]."""

    rms: float
    largest: float

    @classmethod
    def of(cls, errors: FloatArray) -> Size:
        """Of errors (k, 3) [m]."""
        lengths: FloatArray = np.linalg.norm(errors, axis=1)
        return cls(math.sqrt(np.mean(lengths**2)), float(lengths.max()))


@dataclass(frozen=True, slots=True)
class Expected:
    """How far the tool is off with a correction, at points that nobody has touched: RMS [m]."""

    rms: float
    """near the touched points, as it is most likely"""
    low: float
    """in 5 of 100 such fits it is less near them"""
    high: float
    """… and in 5 of 100 more"""
    anywhere: float
    """wherever the arm can go"""


@dataclass(frozen=True, slots=True, eq=False)
class TouchFit:
    """What touched points say about an arm."""

    robot: Robot
    count: int
    """of the points that were given"""
    before: Size
    """at points that were left out, by the robot's numbers"""
    after: Size
    """at points that were left out, with the correction"""
    expected: Expected
    """with the correction"""
    correct: bool
    """whether the correction is better than the robot's numbers by more than chance: then it may be used"""
    causes: tuple[Reason, ...]
    """what is to blame, what moves the tool most first"""
    or_else: tuple[Reason, ...]
    """what would explain the points as well as the first cause"""
    mistaken: tuple[MistakenPoint, ...]
    """points that fit to nothing; they were left out"""
    held: tuple[NotTold, ...]
    """numbers that these points cannot tell: they stay as they are"""
    verdict: Reason | None
    """why there is no correction; None: there is one"""
    values: Values
    """the corrected numbers; the robot's where there is no correction"""
    known: Values
    """the robot's numbers"""
    missed_m: FloatArray
    """(count given, 3) from each point to where the tool was, along the axes of the points' frame [m]

    By what all the other points say.
    """
    load_kg: float
    drive: FloatArray | None
    """(n,) compliance between setpoint and reading [rad/(N·m)]; None: not noted"""

    @property
    def figures(self) -> FitFigures:
        """Before and after, as a fact."""
        return FitFigures(
            self.count, self.before.rms, self.before.largest, self.after.rms, self.after.largest,
            self.expected.low, self.expected.high, self.correct,
        )  # fmt: skip

    @property
    def facts(self) -> tuple[Reason, ...]:
        """All of it, in the order in which it is read."""
        rest = () if self.verdict is None else (self.verdict,)
        return (self.figures, *self.mistaken, *self.causes, *rest, *self.held)

    def words(self, language: str | None = None) -> tuple[str, ...]:
        """All of it for the user, a line a fact."""
        return tuple(say_with_advice(one, language) for one in self.facts)


def fit_touches(robot: Robot, touches: Touches, *, load_kg: float = 0.0, lengths: bool = False) -> TouchFit:
    """Zeros, sag and play of an arm from points that its tool touched (``Touches.checked``).

    ``robot`` is as the arm runs, with its calibration. ``load_kg``: what it carried meanwhile. ``lengths``:
    all lengths of its links may be off, too; without, only one that explains more than all else. Ends with a
    ``LimitError`` where nobody waits for it any more (``apart.is_given_up``).
    """
    model = TouchModel(robot, load_kg).placed(touches)
    every, given = model.parameters(touches, lengths=lengths), touches
    kept = _without_mistaken(solve(model, touches, every, robust=True))
    sheet, sparse, likes, full = _explained(model, touches.only(kept), every, lengths=lengths)
    back = kept | _fits(sparse if _as_good(sparse, full) else full, touches)
    if (back != kept).any():  # with a number that nobody had thought of they are no mistakes
        kept = back
        sheet, sparse, likes, full = _explained(model, touches.only(kept), every, lengths=lengths)
    touches = touches.only(kept)
    few = len(sparse.parameters) > len(sheet.parameters) and _as_good(sparse, full)
    before = Size.of(sheet.left_out)
    best, untold = sparse if few else full, _untold(full)
    if not few and untold:
        best = solve(model, touches, best.without(untold))
    after = Size.of(best.left_out)
    gain = np.sum(sheet.left_out**2, axis=1) - np.sum(best.left_out**2, axis=1)
    chance = float(np.std(gain)) / math.sqrt(len(gain))
    correct = after.rms < _BETTER * before.rms and float(gain.mean()) > chance
    verdict = None
    if not correct:
        good = before.rms < 2 * max(best.noise_m, _GOOD_M)
        verdict = GoodAlready(before.rms) if good else NotBetter(before.rms, after.rms)
    causes = _causes(best, in_order=few) if correct else ()
    missed = _missed(best, given, kept)
    mistaken = tuple(MistakenPoint(i + 1, _xyz(missed[i])) for i in np.flatnonzero(~kept).tolist())
    return TouchFit(
        robot, len(kept), before, after if correct else before,
        _expected(sparse if few else full, touches),
        correct, causes,
        tuple(_cause(one, len(one.parameters) - 1) for one in likes) if few and causes else (),
        mistaken, tuple(NotTold(_part(model, one), one.kind) for one in untold), verdict,
        best.values if correct else model.known, model.known, missed, load_kg,
        drive(model, best.values, touches),
    )  # fmt: skip


def touch_errors(robot: Robot, touches: Touches, *, load_kg: float = 0.0) -> FloatArray:
    """(k, 3) by how much the tool misses points by the robot's own numbers, base frame [m].

    On a sheet, each from where all the others put it: three touches at least. Nothing of the arm is fitted.
    """
    model = TouchModel(robot, load_kg).placed(touches)
    return solve(model, touches, model.of_sheet()).left_out


def _explained(
    model: TouchModel, touches: Touches, every: Sequence[Parameter], *, lengths: bool
) -> tuple[Solved, Solved, list[Solved], Solved]:
    """By where the sheet lies alone; by the fewest numbers, and what is as good; by all, and those few."""
    sheet = solve(model, touches, model.of_sheet())
    own = [one for one in every if one.kind not in OF_SHEET]
    sparse, likes = blame(sheet, [*own, *model.others(), *([] if lengths else model.lengths())])
    blamed = [one for one in sparse.parameters if one not in every]
    return sheet, sparse, likes, solve(model, touches, [*every, *blamed])


def _as_good(sparse: Solved, full: Solved) -> bool:
    """Whether few numbers explain the points as well as all of them do."""
    simple, other = Size.of(sparse.left_out).rms, Size.of(full.left_out).rms
    return simple <= _SIMPLE * other and sparse.noise_m < _EVEN * full.noise_m


def _unforeseen(fit: Solved, touches: Touches) -> FloatArray:
    """(k, 3, 3) covariance of the errors [m²] that a fit allows at touches that it has not seen.

    Where gravity pulls a joint off the side of its play from which it came, it may lean to either.
    """
    model, values = fit.model, fit.values
    links = theta, torque = model.links(values, touches.q, touches.senses)
    A = model.slopes(values, touches, fit.parameters, links)
    J = model.robot.jacobian(theta)[:, :3]
    pulled = np.clip(-touches.senses * np.sign(torque), 0.0, 1.0)
    either = (pulled * values.play / np.cosh(torque / model.deflection.friction / 2)) ** 2
    spread = np.einsum("kip,pq,kjq->kij", A, fit.covariance, A) + np.einsum("kin,kn,kjn->kij", J, either, J)
    return spread + fit.noise_m**2 * np.eye(3)


def _strange(fit: Solved, touches: Touches) -> FloatArray:
    """(k,) by how many standard deviations touches that were not fitted are off; 0 where that is little."""
    off = fit.model.errors(fit.values, touches)
    away = np.einsum("ki,kij,kj->k", off, np.linalg.inv(_unforeseen(fit, touches)), off)
    return np.where(np.linalg.norm(off, axis=1) > _MISTAKEN_M, np.sqrt(away), 0.0)


def _fits(fit: Solved, touches: Touches) -> NDArray[np.bool_]:
    """(k,) touches that are no mistakes by a fit."""
    return _strange(fit, touches) < _MISTAKEN


def _without_mistaken(fit: Solved) -> NDArray[np.bool_]:
    """(k,) touches without those that are far from where all the others put them, one after the other."""
    touches = fit.touches
    kept = np.ones(len(touches), dtype=np.bool_)
    while kept.sum() - 1 >= (1 - _MOST_MISTAKEN) * len(kept) and kept.sum() > LEAST_POINTS:
        fit = solve(fit.model, touches.only(kept), fit.parameters, fit.x)
        worst, found = -1, _MISTAKEN
        for i in np.argsort(-np.sum(fit.left_out**2, axis=1))[:_SUSPECTS].tolist():
            less = np.arange(int(kept.sum())) != i
            other = solve(fit.model, fit.touches.only(less), fit.parameters, fit.x)
            away = float(_strange(other, fit.touches.only(~less))[0])
            if away > found:
                worst, found = i, away
        if worst < 0:
            break
        kept[np.flatnonzero(kept)[worst]] = False
    return kept


def _missed(fit: Solved, touches: Touches, kept: NDArray[np.bool_]) -> FloatArray:
    """(k, 3) as ``TouchFit.missed_m``, of all points that were given, by a fit of those that were kept."""
    missed = fit.model.errors(fit.values, touches)
    missed[kept] = fit.left_out
    return fit.model.along(fit.values, missed)


def _xyz(vector: FloatArray) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def _untold(fit: Solved) -> list[Parameter]:
    """The numbers of which the points tell nothing."""
    pairs = zip(fit.parameters, fit.told.tolist(), strict=True)
    return [one for one, told in pairs if told < _TOLD and one.kind not in OF_SHEET]


def _expected(fit: Solved, touches: Touches) -> Expected:
    """RMS of the tool's error that is left, and the interval in which it is in 90 of 100 such fits.

    The mean square near the points is Σ λ z² with z ~ N(0, 1) for each way in which the numbers may still be
    off (λ: eigenvalues), and what no fit foretells of each joint's sag and play. The noise by which all of it
    is measured is itself known by a few touches only: χ² with as many degrees of freedom as it was fitted by.
    """
    model, values = fit.model, fit.values
    q = joint_samples(model.robot.limits, _SAMPLES)
    tips = model.tips(values, q, np.zeros(q.shape))
    # what stands below the arm's own links is nowhere near the floor
    clear = model.robot.frames(q)[:, 2:, 2, 3].min(axis=1) > model.robot.floor_z
    q, tips = q[clear], tips[clear]
    own, points = model.on_sheet(values, tips), touches.points_m
    low, high = points.min(axis=0) - _NEAR_M, points.max(axis=0) + _NEAR_M
    near = ((own > low) & (own < high)).all(axis=1)
    if near.sum() < _LEAST_NEAR:
        q, own = np.vstack([q, touches.q]), np.vstack([own, points])
        near = np.append(near, np.ones(len(points), dtype=np.bool_))
    probes = Touches(q, own, model.frame)
    links = theta, torque = model.links(values, q, probes.senses)
    A = model.slopes(values, probes, fit.parameters, links)
    root = np.linalg.cholesky(fit.covariance)
    bent = (_LAW * values.compliance * torque) ** 2 + (_LAW * values.play) ** 2
    by_joint = np.einsum("kij,kj->kj", model.robot.jacobian(theta)[:, :3] ** 2, bent)

    def squares(some: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
        """By numbers that are fitted, and by the law of each joint, over some of the probes [m²]."""
        near_to = np.einsum("kip,kiq->pq", A[some], A[some]) / len(A[some])
        own = np.asarray(np.linalg.eigvalsh(root.T @ near_to @ root), dtype=np.float64)
        return own, np.asarray(by_joint[some].mean(axis=0), dtype=np.float64)

    told, law = squares(near)
    rng = np.random.default_rng(0)
    used = float(np.sum(1.0 - (1.0 - fit.told) ** 2))
    free = max(3 * len(touches) - used, 1.0) + NOISE_WEIGHT
    z = rng.chisquare(1.0, (_DRAWN, len(told) + len(law)))
    sizes = z[:, : len(told)] @ told * (free / rng.chisquare(free, _DRAWN)) + z[:, len(told) :] @ law
    five, most = np.quantile(np.sqrt(sizes), _TAILS).tolist()
    most = max(
        most, Size.of(fit.left_out).rms
    )  # where the model does not fit, points that were left out say it
    over_all = float(sum(map(np.sum, squares(np.ones(len(q), dtype=np.bool_)))))
    return Expected(math.sqrt(float(told.sum() + law.sum())), five, most, math.sqrt(over_all))


# What is to blame.


def _causes(fit: Solved, *, in_order: bool) -> tuple[Reason, ...]:
    """The numbers that are off for certain and move the tool; what moves it most first."""
    slopes = fit.model.slopes(fit.values, fit.touches, fit.parameters)
    away = fit.x - fit.model.start(fit.parameters)
    moves = np.sqrt(np.mean(np.sum((slopes * away) ** 2, axis=1), axis=0))
    sure = np.abs(away) > _SURE * np.sqrt(np.diag(fit.covariance))
    own = [one.kind not in OF_SHEET or fit.model.frame == "base" for one in fit.parameters]
    chosen = np.flatnonzero(np.array(own) & (in_order | sure) & (moves > _SEEN_M)).tolist()
    return tuple(_cause(fit, i) for i in sorted(chosen, key=lambda i: -moves[i]))


def _part(model: TouchModel, one: Parameter) -> str:
    robot = model.robot
    if one.kind in ("a", "d"):
        rows = robot.chain.joint_rows
        return robot.link_titles[max(0, sum(row <= one.index for row in rows) - 1)]
    return "xyz"[one.index] if one.kind == "place" else robot.joints[one.index].title


def _cause(fit: Solved, i: int) -> Reason:
    """A parameter as a fact."""
    one, value, sd = fit.parameters[i], float(fit.x[i]), math.sqrt(float(fit.covariance[i, i]))
    model, j = fit.model, one.index
    part = _part(model, one)
    match one.kind:
        case "zero":
            return ZeroOff(part, value, sd)
        case "sag":
            most = float(model.heaviest[j])
            return Sags(part, value * most, sd * most)
        case "play":
            return HasPlay(part, value, sd)
        case "scale":
            return ScaleOff(part, value, sd)
        case "a" | "d":
            row = model.robot.chain.rows[j]
            old = row.a_m if one.kind == "a" else row.d_m
            return LengthOff(part, j + 1, one.kind, old, value, sd)
        case _:
            return PlaceOff(part, value, sd)


def drive(model: TouchModel, values: Values, touches: Touches) -> FloatArray | None:
    """(n,) compliance between setpoint and reading, by the points at which both were noted."""
    if touches.commanded is None:
        return None
    torque = model.links(values, touches.q, touches.senses)[1]
    behind = touches.commanded - touches.q
    size = np.sum(torque**2, axis=0)
    weak = (0.05 * model.heaviest) ** 2 * len(touches)
    slope = np.sum(torque * behind, axis=0) / np.maximum(size, 1e-12)
    return np.where(model.carries & (size > weak), np.maximum(slope, 0.0), 0.0)
