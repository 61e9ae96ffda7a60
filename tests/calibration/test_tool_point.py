"""The tool point, taught by touching one point from several sides."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from armctl.arrays import FloatArray
from armctl.calibration import LEAST_SIDES, ToolPoint, teach_tool
from armctl.errors import CalibrationError
from armctl.facts import say
from armctl.facts.causes import TaughtTip, TipAsBefore, TipUntold
from armctl.kinematics.samples import joint_samples
from armctl.robot import Robot, load_robot

TIP = np.array([0.012, -0.007, 0.035])
"""of the tool that is fixed: along the axes of the tool, from the point that the file has [m]"""
ROBOTS = Path(__file__).parents[2] / "robots"


@cache
def robot(name: str) -> Robot:
    return load_robot(name)


@cache
def sides(name: str, tip: tuple[float, ...] = tuple(TIP)) -> tuple[FloatArray, FloatArray]:
    """Configurations (k, n) [rad] with the tip on one point (3,) [m], the tool turned this way and that."""
    arm = robot(name)
    q = joint_samples(arm.limits, 400)
    T = arm.forward(q)
    tips = T[:, :3, 3] + T[:, :3, :3] @ tip
    inside = np.flatnonzero((tips[:, 2] > 0.03) & (np.linalg.norm(tips, axis=1) < 0.7 * arm.chain.length))
    best: tuple[float, FloatArray, FloatArray] | None = None
    for i in inside[:12].tolist():
        found = _led(arm, q[::2], tips[i], np.array(tip))
        if len(found) < LEAST_SIDES:
            continue
        spread = _spread(arm, found[apart(arm, found, LEAST_SIDES)])
        if best is None or spread > best[0]:
            best = spread, found, tips[i]
    assert best is not None, name
    return best[1], best[2]


def _led(arm: Robot, q: FloatArray, point: FloatArray, tip: FloatArray) -> FloatArray:
    """Newton steps of the true tip onto a point, inside the limits, from each of (k, n): where that ends."""
    for _ in range(30):
        away, J = _away(arm, q, point, tip)
        q = np.clip(q + (np.linalg.pinv(J, rcond=1e-3) @ away[..., None])[..., 0], *arm.limits.T)
    return q[np.linalg.norm(_away(arm, q, point, tip)[0], axis=1) < 1e-9]


def _away(arm: Robot, q: FloatArray, point: FloatArray, tip: FloatArray) -> tuple[FloatArray, FloatArray]:
    """From the tip to the point (k, 3) [m], and the tip's Jacobian (k, 3, n)."""
    T = arm.forward(q)
    lever = T[:, :3, :3] @ tip
    return point - T[:, :3, 3] - lever, _of_tip(arm.jacobian(q), lever)


def _of_tip(J: FloatArray, lever: FloatArray) -> FloatArray:
    """(..., 3, n) of a point that is fixed to the tool."""
    return J[..., :3, :] + np.cross(J[..., 3:, :], lever[..., None], axis=-2)


def _spread(arm: Robot, q: FloatArray) -> float:
    """The smallest singular value: how well the worst direction is told."""
    R = arm.forward(q)[:, :3, :3]
    return float(np.linalg.svd((R - R.mean(axis=0)).reshape(-1, 3), compute_uv=False)[-1])


def apart(arm: Robot, q: FloatArray, count: int) -> list[int]:
    """Indices of some with the tool turned most from one to the other, as a person would choose them."""
    R = arm.forward(q)[:, :3, :3].reshape(len(q), 9)
    chosen = [int(np.argmax(np.linalg.norm(R - R.mean(axis=0), axis=1)))]
    while len(chosen) < count:
        chosen.append(int(np.argmax(np.linalg.norm(R[:, None] - R[chosen], axis=2).min(axis=1))))
    return chosen


def touched(arm: Robot, q: FloatArray, tip: FloatArray, sigma: float, rng: np.random.Generator) -> FloatArray:
    """Joint angles that are noted where the tip is off the point by so much in each coordinate."""
    noted = q.copy()
    for i, one in enumerate(q):
        T, J = arm.forward(one), arm.jacobian(one)
        lever = T[:3, :3] @ tip
        noted[i] += np.linalg.pinv(_of_tip(J, lever), rcond=1e-3) @ rng.normal(scale=sigma, size=3)
    return noted


@pytest.mark.parametrize("name", ["uzuner", "so101", "ur5"])
def test_without_noise_it_is_found_exactly(name: str) -> None:
    q, point = sides(name)
    found = teach_tool(robot(name), q[apart(robot(name), q, LEAST_SIDES)])
    np.testing.assert_allclose(found.offset_m, TIP, atol=1e-7)
    np.testing.assert_allclose(found.point_m, point, atol=1e-7)
    assert found.rank == 3 and found.residual_m < 1e-8 and found.differs


@pytest.mark.parametrize("name", ["uzuner", "so101", "ur5"])
@pytest.mark.parametrize(("count", "sigma"), [(LEAST_SIDES, 0.0005 / math.sqrt(3)), (8, 0.0005)])
def test_touches_by_eye_tell_it_to_a_millimetre(name: str, count: int, sigma: float) -> None:
    """Four touches that are 0.5 mm off, or eight with that in each coordinate: 1 mm in 95 of 100."""
    arm, (q, _) = robot(name), sides(name)
    q, rng = q[apart(arm, q, count)], np.random.default_rng(43)
    found = [teach_tool(arm, touched(arm, q, TIP, sigma, rng)) for _ in range(100)]
    off = np.array([np.linalg.norm(one.offset_m - TIP) for one in found])
    assert (off <= 0.001).sum() >= 95
    sure = np.array([np.linalg.norm(one.sd_m) for one in found])
    assert 0.4 < np.sqrt(np.mean(off**2)) / sure.mean() < 1.2  # what it says of itself
    assert np.mean([one.residual_m for one in found]) < 2 * sigma


def test_an_axis_about_which_alone_the_tool_was_turned_is_not_told() -> None:
    """Four joints with one that only rolls the tool: what lies along its axis stays as it is, and is said."""
    arm = robot("uzuner")
    q = np.tile(arm.pose("home"), (5, 1))
    q[:, 4] = np.linspace(-1.2, 1.2, 5)  # the wrist roll alone: the tip turns round the roll axis
    found = teach_tool(arm, q)
    assert found.rank == 2 and not found.differs and found.suggestion == ""
    (figures, before, untold) = found.facts
    assert (
        isinstance(figures, TaughtTip) and isinstance(before, TipAsBefore) and isinstance(untold, TipUntold)
    )
    np.testing.assert_allclose(np.abs(untold.axis), (0, 0, 1), atol=1e-9)
    assert untold.sd is None and "the tool's z axis is not told" in say(untold)
    assert np.isinf(found.sd_m).sum() == 1


def test_a_tool_that_was_tilted_little_is_told_with_what_that_leaves_open() -> None:
    """The offset is large, so what is told weakly is better than nothing; how weakly is said."""
    arm, (q, _) = robot("uzuner"), sides("uzuner")
    rng = np.random.default_rng(3)
    some = (q[rng.choice(len(q), 5, replace=False)] for _ in range(2000))
    q = next(one for one in some if 0.15 < _spread(arm, one) < 0.4)
    found = teach_tool(arm, touched(arm, q, TIP, 0.0002, np.random.default_rng(5)))
    assert found.rank == 3
    loose = [one for one in found.facts if isinstance(one, TipUntold) and one.sd is not None]
    assert loose and "mm only" in say(loose[-1])
    off = found.directions @ (found.offset_m - TIP)
    assert (np.abs(off) < 3 * found.sd_m).all() and found.residual_m < 0.0005


def test_mico_tells_what_its_four_joints_can() -> None:
    arm = robot("mico")
    q, _ = sides("mico", (0.0, 0.0, 0.0))
    found = teach_tool(arm, q[apart(arm, q, 6)])
    assert (
        found.rank == 3 or len([one for one in found.facts if isinstance(one, TipUntold)]) == 3 - found.rank
    )
    np.testing.assert_allclose(found.offset_m, 0, atol=1e-6)


def test_too_few_touches_and_a_tool_that_was_not_turned_are_refused_with_figures() -> None:
    arm, (q, _) = robot("uzuner"), sides("uzuner")
    with pytest.raises(CalibrationError, match="3 touches are too few: touch the point from 4 sides"):
        teach_tool(arm, q[:3])
    alike = np.tile(arm.pose("home"), (4, 1)) + np.linspace(0, 0.01, 4)[:, None]
    with pytest.raises(CalibrationError, match=r"turned by \d+° only from touch to touch"):
        teach_tool(arm, alike)
    with pytest.raises(CalibrationError, match="each touch needs 5 joint angles"):
        teach_tool(arm, q[:, :4])
    with pytest.raises(Exception, match="finite"):
        teach_tool(arm, np.full((4, 5), np.nan))


def test_a_touch_that_missed_is_named() -> None:
    arm, (q, _) = robot("ur5"), sides("ur5")
    q = q[apart(arm, q, 6)]
    q[2] += touched(arm, q[2:3], TIP, 0.0, np.random.default_rng(0))[0] - q[2]
    q[2, 0] += 0.01
    (figures, *_) = teach_tool(arm, q).facts
    assert isinstance(figures, TaughtTip) and figures.worst == 3 and figures.away > 0.001


@pytest.mark.parametrize("name", ["uzuner", "scorbot", "ur5", "so101"])
def test_what_it_suggests_makes_the_robot_file_right(name: str, tmp_path: Path) -> None:
    """Its rows behind those of the file put the tool point where the tip is."""
    arm = robot(name)
    found = ToolPoint(arm, TIP, np.eye(3), np.full(3, 1e-4), np.zeros(3), np.zeros(4))
    rows = "".join(line for line in found.suggestion.splitlines(keepends=True) if line[0] != "#")
    text = (ROBOTS / f"{name}.toml").read_text(encoding="utf-8")
    begin = text.index("rows = [")
    end = text.index("\n]", begin) + 1
    (tmp_path / f"{name}.toml").write_text(text[:end] + rows + text[end:], encoding="utf-8")
    changed = load_robot(tmp_path / f"{name}.toml")
    q = joint_samples(arm.limits, 20)
    T, right = changed.forward(q), arm.forward(q)
    np.testing.assert_allclose(T[:, :3, :3], right[:, :3, :3], atol=1e-9)
    np.testing.assert_allclose(T[:, :3, 3], right[:, :3, 3] + right[:, :3, :3] @ TIP, atol=2e-5)
    assert changed.inverse(T[0]).success if arm.orients_tool else changed.inverse(T[0, :3, 3]).success
