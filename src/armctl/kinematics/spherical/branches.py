"""Names of the branches of *spherical shoulder + elbow (+ roll)*.

Both depend on the configuration alone. Between two singular values of θ2, at which the three shoulder axes
lie in one plane, the shoulder is *direct* while θ2 lies in the half turn that begins where the third axis is
nearest to the first, and *flipped* in the other half: the two ways to take up one rotation. The elbow is
*plus* while it is bent from straight in the positive sense of its joint, and *minus* when against it.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.spherical.shoulder import SphericalShoulder

FloatArray = NDArray[np.float64]
SPHERICAL_BRANCHES = tuple(
    f"shoulder-{shoulder} elbow-{elbow}"
    for shoulder, elbow in itertools.product(("direct", "flipped"), ("plus", "minus"))
)
"""Index: 2 · flipped + minus."""


def spherical_branch_index(geometry: SphericalShoulder, q: FloatArray) -> NDArray[np.int8]:
    """(k,) index into ``SPHERICAL_BRANCHES`` of configurations ``q`` (k, n) [rad]."""
    flipped, minus = (
        np.floor(angle / math.pi).astype(np.int64) & 1  # odd in the half turn in which the sine is negative
        for angle in (q[:, 1] - geometry.singular, q[:, 3] + geometry.offset)
    )
    return (2 * flipped + minus).astype(np.int8)
