"""Does every joint stay inside its limits?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armctl.motion.preflight.batch import Batch
from armctl.motion.preflight.finding import Finding

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
