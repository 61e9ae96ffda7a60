"""Speeds and accelerations inside their limits, and rest at both ends."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from armctl.motion.preflight.batch import Batch, Finding, Kind, Leaf

FloatArray = NDArray[np.float64]
_RELATIVE_TOLERANCE = 1e-6
_REST_SPEED = 1e-6


def rate_findings(batch: Batch) -> Iterator[tuple[int, Finding]]:
    """Joints that are too fast or pushed too hard, by the peaks of each motion, with the motion's index."""
    robot = batch.robot
    pushes = np.array([leaf.peaks.acceleration for leaf in batch.leaves]).reshape(-1, robot.n)
    yield from _over(batch, batch.speeds, robot.speed_limits, "speed")
    yield from _over(batch, pushes, robot.acceleration_limits, "acceleration")


def rest_findings(batch: Batch) -> Iterator[tuple[int, Finding]]:
    """Motions that do not start or end at rest, with their indices."""
    for ends, k, where in ((batch.first, 0, "starts"), (batch.last, 1, "ends")):
        speeds = batch.end_speeds[k][ends]
        for i in np.flatnonzero(speeds.max(axis=1) > _REST_SPEED).tolist():
            j = int(speeds[i].argmax())
            yield (
                i,
                Finding(
                    float(batch.end_times[i]) if k else 0.0,
                    batch.robot.joints[j].title,
                    f"the motion {where} at {np.degrees(speeds[i, j]):.2f} °/s",
                    "let it start and end at rest",
                    "rest",
                ),
            )


def _over(batch: Batch, peaks: FloatArray, limits: FloatArray, kind: Kind) -> Iterator[tuple[int, Finding]]:
    worst = np.zeros((batch.motions, batch.robot.n))
    np.maximum.at(worst, batch.owner, peaks)
    unit, power = ("°/s", 1.0) if kind == "speed" else ("°/s²", 0.5)
    for i, j in np.argwhere(worst > limits * (1 + _RELATIVE_TOLERANCE)).tolist():
        k = next(k for k in range(batch.first[i], batch.last[i] + 1) if peaks[k, j] == worst[i, j])
        slower = float(worst[i, j] / limits[j]) ** power
        value, limit = np.degrees(worst[i, j]), np.degrees(limits[j])
        yield (
            i,
            Finding(
                _when(batch.leaves[k], j, kind),
                batch.robot.joints[j].title,
                f"{value:.1f} {unit} is over its limit of {limit:.1f} {unit}",
                f"take {slower:.2f} times as long",
                kind,
            ),
        )


def _when(leaf: Leaf, joint: int, kind: Kind) -> float:
    """When the sampled rate of a joint is largest: near the peak, from the start of the motion [s]."""
    sample = leaf.trajectory.sample(leaf.time)
    rates = sample.velocity if kind == "speed" else sample.acceleration
    return leaf.begins + float(leaf.time[int(np.abs(rates[:, joint]).argmax())])


# Does every joint stay inside its limits?

_TOLERANCE = 1e-9


def limit_findings(batch: Batch) -> Iterator[tuple[int, Finding]]:
    """Joints outside their limits, by the exact extremes of each motion, with the index of the motion."""
    robot = batch.robot
    low = np.array([leaf.peaks.low for leaf in batch.leaves]).reshape(-1, robot.n)
    high = np.array([leaf.peaks.high for leaf in batch.leaves]).reshape(-1, robot.n)
    lower, upper = robot.limits.T
    excess = np.maximum(lower - low, high - upper)
    worst = np.full((batch.motions, robot.n), -np.inf)
    np.maximum.at(worst, batch.owner, excess)
    for i, j in np.argwhere(worst > _TOLERANCE).tolist():
        k = next(k for k in range(batch.first[i], batch.last[i] + 1) if excess[k, j] == worst[i, j])
        leaf, joint = batch.leaves[k], robot.joints[j]
        below = lower[j] - low[k, j] >= high[k, j] - upper[j]
        q = batch.angles(k)[:, j]
        at = int(q.argmin() if below else q.argmax())
        angle, least, most = np.degrees([low[k, j] if below else high[k, j], joint.lower, joint.upper])
        yield (
            i,
            Finding(
                leaf.begins + float(leaf.time[at]),
                joint.title,
                f"{angle:.2f}° is outside {least:.2f}° … {most:.2f}°",
                "keep away from this limit: another target, another branch or a straighter way",
                "limits",
            ),
        )
