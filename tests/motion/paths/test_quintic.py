from __future__ import annotations

import numpy as np

from armctl.motion.paths.spline import quintic
from armctl.motion.polynomial import PiecewisePolynomial


def test_it_has_what_is_given_at_both_ends() -> None:
    start, end = np.random.default_rng(2).normal(size=(2, 3, 4))
    curve = PiecewisePolynomial([0.0, 1.0], quintic(start, end)[None])
    np.testing.assert_allclose(curve.derivatives(0.0, 2), start, atol=1e-13)
    np.testing.assert_allclose(curve.derivatives(1.0, 2), end, atol=1e-12)


def test_many_at_once_are_those_alone() -> None:
    start, end = np.random.default_rng(3).normal(size=(2, 3, 7, 4))
    together = quintic(start, end)
    for k in range(7):
        np.testing.assert_array_equal(together[:, k], quintic(start[:, k], end[:, k]))
