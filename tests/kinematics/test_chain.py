"""Forward kinematics and Jacobian against plain 4 x 4 products and differences."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.kinematics.kit import plain_forward, plain_frames, plain_jacobian
from tests.long import examples

from armctl import load_robot
from armctl.errors import InputError
from armctl.kinematics import Chain, DHRow
from armctl.kinematics.angles import half_angle_cos_sin
from armctl.kinematics.frames import LinkFrames

QUARTERS = st.sampled_from([0.0, math.pi / 2, -math.pi / 2, math.pi, -math.pi])
ANGLES = st.floats(-7.0, 7.0) | QUARTERS
LENGTHS = st.floats(-0.5, 0.5) | st.just(0.0)
ROWS = st.builds(DHRow, a_m=LENGTHS, alpha_rad=ANGLES, d_m=LENGTHS, theta_rad=ANGLES, joint=st.booleans())


@st.composite
def chains(draw: st.DrawFn) -> Chain:
    rows = draw(st.lists(ROWS, min_size=1, max_size=8))
    if not any(row.joint for row in rows):
        rows.append(DHRow(0.1, 0.3, 0.0))
    return Chain.from_dh(rows, draw(st.sampled_from(["standard", "modified"])))


def uzuner() -> Chain:
    return load_robot("uzuner").chain


@settings(max_examples=examples(150))
@given(chain=chains(), seed=st.integers(0, 10**6))
def test_forward_is_the_plain_product(chain: Chain, seed: int) -> None:
    q = np.random.default_rng(seed).uniform(-7, 7, (3, chain.n))
    for one, T, frames in zip(q, chain.forward(q), chain.frames(q), strict=True):
        expected = np.array(plain_frames(chain.rows, chain.convention, one))
        assert np.abs(chain.forward(one) - expected[-1]).max() < 1e-12
        assert np.abs(T - expected[-1]).max() < 1e-12
        assert np.abs(chain.frames(one) - expected).max() < 1e-12
        assert np.abs(frames - expected).max() < 1e-12


@settings(max_examples=examples(80))
@given(chain=chains(), seed=st.integers(0, 10**6))
def test_jacobian_is_the_difference_quotient(chain: Chain, seed: int) -> None:
    q = np.random.default_rng(seed).uniform(-4, 4, (2, chain.n))
    batched = chain.jacobian(q)
    for one, J in zip(q, batched, strict=True):
        assert np.abs(J - plain_jacobian(chain, one)).max() < 1e-6
        assert np.abs(J - chain.jacobian(one)).max() < 1e-13


def test_a_batch_keeps_its_leading_dimensions() -> None:
    chain = uzuner()
    assert 1000 * chain.forward(np.zeros(5))[:3, 3] == pytest.approx([330, 3.62, 163])  # as the paper says
    q = np.random.default_rng(0).uniform(-2, 2, (2, 3, 5))
    assert chain.forward(q).shape == (2, 3, 4, 4)
    assert chain.frames(q).shape == (2, 3, 10, 4, 4)
    assert chain.jacobian(q).shape == (2, 3, 6, 5)
    assert np.abs(chain.forward(q)[1, 2] - plain_forward(chain, q[1, 2])).max() < 1e-12
    assert chain.forward(np.empty((0, 5))).shape == (0, 4, 4)


@settings(max_examples=examples(60))
@given(chain=chains(), seed=st.integers(0, 10**6))
def test_links_and_places_are_those_of_the_plain_products(chain: Chain, seed: int) -> None:
    q = np.random.default_rng(seed).uniform(-3, 3, (3, chain.n))
    links = LinkFrames.at(chain, q)
    assert [link for link, _ in chain.places] == [-1, *np.cumsum([row.joint for row in chain.rows]) - 1]
    for m, one in enumerate(q):
        expected = plain_frames(chain.rows, chain.convention, one)
        for (link, T), frame in zip(chain.places, expected, strict=True):
            assert np.abs(links.place(link, T[:3, 3][None])[:, 0, m] - frame[:3, 3]).max() < 1e-12
            tips = links.place(link, T[:3, 3] + T[:3, :3].T)[:, :, m]
            assert np.abs(tips - frame[:3, 3:] - frame[:3, :3]).max() < 1e-12
        points, directions = chain.axes(one)
        for j in range(chain.n):
            assert np.abs(links.rotation[j][:, 2, m] - directions[j]).max() < 1e-12
            assert np.abs(links.origin[j][:, m] - points[j]).max() < 1e-12
        assert np.abs(links.tool[:, m] - expected[-1][:3, 3]).max() < 1e-12


def test_many_chunks_are_one_batch() -> None:
    chain = uzuner()
    q = np.random.default_rng(1).uniform(-7, 7, (10_000, 5))
    q[:50] = np.round(q[:50] / (math.pi / 2)) * (math.pi / 2)  # half turns, where a half tangent is huge
    T, J = chain.forward(q), chain.jacobian(q)
    for i in range(0, 10_000, 53):
        assert np.abs(T[i] - plain_forward(chain, q[i])).max() < 1e-12
        assert np.abs(J[i] - chain.jacobian(q[i])).max() < 1e-12


def test_cosines_and_sines_by_the_half_angle() -> None:
    angle = np.random.default_rng(91).uniform(-7, 7, 40_000)
    angle[:2001] = math.pi + np.arange(-1000, 1001) * 1e-12  # half turns, and next to them
    for found, exact in zip(half_angle_cos_sin(angle), (np.cos(angle), np.sin(angle)), strict=True):
        assert np.abs(found - exact).max() < 2e-15


def test_a_batch_names_the_row_that_is_not_finite() -> None:
    q = np.zeros((20_000, 5))
    q[17_003, 2] = math.nan
    for method in (uzuner().forward, uzuner().jacobian):
        with pytest.raises(InputError, match=r"finite numbers, got \[0.0, 0.0, nan, 0.0, 0.0\] in row 17003"):
            method(q)


def test_an_array_given_is_never_written_to_and_the_result_is_the_callers_own() -> None:
    chain, q = uzuner(), np.full((3, 5), 0.3)
    for value in (q, q[0]):
        before, T = value.copy(), chain.forward(value)
        T[...] = 7.0
        chain.checked(value)[...] = 7.0
        assert np.array_equal(value, before)
        assert np.abs(chain.forward(value)).max() < 7.0


def test_huge_angles_still_turn() -> None:
    chain, q = uzuner(), np.array([1e6, -1e9, 12345.6, 3e7, 1e12])
    assert np.abs(chain.forward(np.stack([q, q])) - plain_forward(chain, q)).max() < 1e-12


@pytest.mark.parametrize(
    ("q", "says"),
    [
        ([0, 0, 0, 0], "5 joint angles are needed"),
        (0.0, "5 joint angles are needed"),
        ([[0, 0, 0, 0, 0, 0]], "5 joint angles are needed"),
        ([0, 0, math.nan, 0, 0], "finite"),
        ([0, 0, 0, 0, math.inf], "finite"),
        ([0, 0, 0, 0, None], "must be numbers"),
        (["0", "0", "0", "0", "0"], "must be numbers"),
        ("zero", "must be numbers"),
        ([0, 0, 0, 0, 1j], "must be numbers"),
        ([[0, 0, 0, 0, 0], [0]], "must be numbers"),
        ([True, False, True, False, True], "must be numbers"),
    ],
)
@pytest.mark.parametrize("method", ["forward", "frames", "jacobian"])
def test_what_is_no_configuration_is_refused(q: object, says: str, method: str) -> None:
    with pytest.raises(InputError, match=says):
        getattr(uzuner(), method)(q)


def test_a_chain_that_cannot_be_is_refused() -> None:
    for wrong in (np.zeros((2, 5)), np.zeros((1, 5)), np.zeros(4), 0.0, []):
        with pytest.raises(InputError, match="5 joint angles are needed"):
            uzuner().checked_one(wrong)
    with pytest.raises(InputError, match="allowed are 'standard' and 'modified'"):
        Chain.from_dh([DHRow(0, 0, 0)], "craig")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="DH row 2 holds a value that is not a finite number"):
        Chain.from_dh([DHRow(0, 0, 0), DHRow(0, math.nan, 0)])
    with pytest.raises(InputError, match="at least one row with a joint"):
        Chain.from_dh([DHRow(0.1, 0, 0, joint=False)])
