"""Simulated arms that touch marks: what is found of them, what it is worth, and how sure that was.

The arms are plants of their own (``plant.py``). ``ARMCTL_LONG=1`` tries as many of them as the figures in
docs/calibration.md come from.
"""

from __future__ import annotations

import os
import sys
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.calibration.plant import Plant, Sheet, touch
from tests.calibration.touch_kit import NOISE_M, Held, advised, missed, rms, touched, worn

from armctl.arrays import FloatArray
from armctl.calibration import (
    Calibration,
    Touches,
    calibrated,
    corrected,
    fit_touches,
    next_touch,
    own_map,
    reachable,
)
from armctl.calibration.touch_fit import solve
from armctl.calibration.touch_model import TouchModel
from armctl.errors import CalibrationError
from armctl.facts.causes import HasPlay, LengthOff, MistakenPoint, Sags, ZeroOff
from armctl.motion import plan_line
from armctl.robot import Robot, load_robot

LONG = bool(os.environ.get("ARMCTL_LONG"))
SO101, UZUNER = load_robot("so101"), load_robot("uzuner")


def tell(text: str) -> None:
    """Figures for docs/calibration.md: pytest shows them with ``-s``."""
    sys.stdout.write(f"{text}\n")


def figures(robot: Robot, zero_deg: float, count: int, *, encoders: bool) -> FloatArray:
    """(count, 5) how far other points are missed before and after ten touches, and what was told of that.

    What is told: the RMS as it is most likely, and the ends of the interval in which it is in 90 of 100 fits.
    """
    rows: list[tuple[float, float, float, float, float]] = []
    for seed in range(count):
        plant, sheet, rng = worn(robot, seed, zero_deg, encoders=encoders)
        touches = advised(robot, touched(plant, robot, sheet, rng, (0.0, 0.08), 60), 10)
        fit = fit_touches(robot, touches)
        held = Held.of(plant, robot, sheet, rng)
        told = fit.expected
        rows.append((*missed(fit, robot, touches, held), told.rms, told.low, told.high))
    found = np.array(rows)
    inside = within(found)
    tell(
        f"{robot.name}: {count} arms, median {1000 * np.median(found[:, :3], axis=0)} mm, ratio "
        f"{np.median(found[:, 1] / found[:, 0]):.3f}, <= 5 mm {np.mean(found[:, 1] <= 0.005):.2f}, "
        f"{1000 * np.median(found[:, 3]):.1f} … {1000 * np.median(found[:, 4]):.1f} mm was told, right in "
        f"{inside.mean():.2f}"
    )
    return found


def within(found: FloatArray) -> NDArray[np.bool_]:
    """(count,) of which arms the error that is left lies in the interval that was told."""
    _, after, _, low, high = found.T
    return (low <= after) & (after <= high)


def test_ten_touches_take_an_so101_to_a_sixth_of_its_error() -> None:
    found = figures(SO101, 3.0, 100 if LONG else 4, encoders=True)
    before, after, told, low, high = found.T
    assert np.mean(after <= 0.005) >= 0.9
    assert np.median(after / before) <= (1 / 6 if LONG else 1 / 4)
    assert np.median(told / after) == pytest.approx(1.0, abs=0.25)
    assert within(found).mean() >= (0.9 if LONG else 0.75)
    assert np.median(high / low) < 3.0  # whatever is wide enough holds, and says nothing


def test_ten_touches_take_an_arm_that_measures_nothing_to_a_quarter() -> None:
    found = figures(UZUNER, 1.5, 100 if LONG else 3, encoders=False)
    before, after, told, low, high = found.T
    assert np.median(after / before) <= 0.25
    assert np.median(told / after) == pytest.approx(1.0, abs=0.3)
    assert within(found).mean() >= (0.9 if LONG else 0.6) and np.median(high / low) < 3.0


def test_a_length_that_is_a_millimetre_off_is_found_by_twenty_points() -> None:
    robot, wrong = load_robot("parol6"), list[float]()
    for seed in range(40 if LONG else 2):
        rng = np.random.default_rng(seed)
        plant = Plant.of(robot, rng)
        plant.zero = np.radians(rng.normal(0.0, 0.1, robot.n))
        plant.rows[1][0] += (off := 0.001 * float(rng.choice([-1, 1])))
        q = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (20, robot.n))
        sense = rng.choice([-1.0, 1.0], q.shape)
        points = plant.tip(q, sense)
        points += rng.normal(0.0, 0.0002, points.shape)
        fit = fit_touches(robot, Touches.checked(robot, q, points, "base", sense), lengths=True)
        wrong.append(float(fit.values.lengths[1, 0]) - off)
    tell(f"parol6: {len(wrong)} arms, a_mm of row 2 off by {1000 * np.abs(wrong).max():.2f} mm at most")
    assert np.mean(np.abs(wrong) < 0.0003) >= 0.9


# One defect.

KINDS = ("zero", "sag", "play", "length", "mark")


def defect(plant: Plant, kind: str, rng: np.random.Generator) -> tuple[type, str | int, float]:
    """Hide a defect in an SO-101, or choose a mark to mistake: its kind, its part, its size [rad, m]."""
    sign = float(rng.choice([-1.0, 1.0]))
    titles = [joint.title for joint in SO101.joints]
    match kind:
        case "zero":
            i = int(rng.integers(1, 4))
            plant.zero[i] = sign * np.radians(rng.uniform(2.0, 5.0))
            return ZeroOff, titles[i], float(plant.zero[i])
        case "sag":
            i = int(rng.integers(1, 3))
            most = float(replace(SO101.gravity, payload_kg=0.0).heaviest(SO101.limits)[i])
            angle = float(np.radians(rng.uniform(2.0, 4.0)))
            plant.compliance[i] = angle / most
            return Sags, titles[i], angle
        case "play":  # gravity always leans shoulder and elbow to one side: there play is a zero
            i = int(rng.choice([0, 3]))
            plant.play[i] = np.radians(rng.uniform(1.5, 3.0))
            return HasPlay, titles[i], float(plant.play[i])
        case "mark":
            return MistakenPoint, int(rng.integers(24)) + 1, float(rng.uniform(0.008, 0.03))
        case _:
            row, column = [(2, 0), (3, 0), (6, 2)][int(rng.integers(3))]
            off = sign * float(rng.uniform(0.003, 0.008))
            plant.rows[row][column] += off
            return LengthOff, row + 1, off


def test_one_defect_is_named_with_its_size() -> None:
    first, sized, count = Counter[str](), Counter[str](), 1000 if LONG else 5
    for seed in range(count):
        kind, rng = KINDS[seed % 5], np.random.default_rng(seed)
        plant = Plant.of(SO101, rng)
        plant.step = 2 * np.pi / 4096
        sheet = Sheet.anywhere(SO101, rng, (0.2, 0.28))
        expected, part, size = defect(plant, kind, rng)
        q, sense, points = touch(plant, SO101, sheet, np.resize([0.0, 0.06, 0.12], 24), rng)
        points = points + rng.normal(0.0, NOISE_M, points.shape)
        if kind == "mark":
            away = rng.normal(size=3)
            points[int(part) - 1] += size * away / np.linalg.norm(away)
        fit = fit_touches(SO101, Touches.checked(SO101, q, points, "sheet", sense))
        named = [*fit.mistaken, *fit.causes]
        if not named or type(named[0]) is not expected:
            continue
        match named[0]:
            case LengthOff(row=row, off=found):
                right = row == part
            case MistakenPoint(number=number, away=found):
                right = number == part
            case (
                ZeroOff(part=title, off=found)
                | Sags(part=title, angle=found)
                | HasPlay(part=title, angle=found)
            ):
                right = title == part
            case _:
                raise AssertionError(named[0])
        first[kind] += right
        sized[kind] += right and abs(found / size - 1) < 0.2
    tell(f"{count} arms: first {dict(first)}, with its size {dict(sized)}")
    assert first.total() >= 0.95 * count and sized.total() >= 0.9 * count


# What the correction is worth on the arm.


def test_a_line_of_a_corrected_arm_deviates_a_third_at_most() -> None:
    """Setpoints by the robot's map, through the plant: joints drive there and stop where they give way."""
    shares: list[float] = []
    for seed in range(20 if LONG else 1):
        plant, sheet, rng = worn(SO101, seed, 0.0, encoders=True)
        plant.zero[:] = 0.0
        touches = advised(SO101, touched(plant, SO101, sheet, rng, (0.0, 0.08), 60), 10)
        fit = fit_touches(SO101, touches)
        empty = Calibration("so101", "1", own_map(SO101).unit, {})
        better = calibrated(SO101, corrected(fit, empty))
        start = SO101.inverse([0.22, -0.075, 0.08], pitch=np.radians(-60.0)).q[0]
        line = plan_line(SO101, start, [0.22, 0.075, 0.08])
        wanted = np.array([line.sample(t).q for t in np.linspace(0.0, line.duration, 60)])
        sense = np.sign(np.gradient(wanted, axis=0))
        ends = SO101.forward(wanted[[0, -1]])[:, :3, 3]
        missed_by: list[float] = []
        for robot in (SO101, better):
            outputs = own_map(robot)
            told = np.array([list(outputs.outputs(q).values()) for q in wanted])
            rigid = (told - own_map(SO101).zero) / own_map(SO101).per_rad
            way = plant.tip(rigid, sense) - ends[0]
            along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
            missed_by.append(rms(way - np.outer(way @ along, along)))
        shares.append(missed_by[1] / missed_by[0])
    tell(f"line of 150 mm: {len(shares)} arms, after/before median {np.median(shares):.2f}")
    assert np.median(shares) <= 1 / 3


# What must not happen.


def spoiled(rng: np.random.Generator) -> Touches:
    """Touches of a worn arm that tell too little, or one of which is wrong."""
    plant, sheet, rng = worn(SO101, int(rng.integers(1 << 30)), 3.0, encoders=True)
    touches = touched(plant, SO101, sheet, rng, (0.0, 0.08), 40)
    points, which = touches.points_m, str(rng.choice(["few", "line", "flat", "mistaken"]))
    match which:
        case "few":
            return touches.only(np.arange(6))
        case "line":
            return touches.only(np.argsort(np.abs(points[:, 0] - points[:, 1]))[:8])
        case "flat":
            return touches.only(np.flatnonzero(points[:, 2] < 0.01)[:8])
        case _:
            moved = points.copy()
            moved[:2] += rng.normal(0.0, 0.015, (2, 3))
            return replace(touches, points_m=moved).only(np.arange(10))


def test_no_arm_gets_worse_by_points_that_tell_little() -> None:
    worse, offered, count = 0, 0, 200 if LONG else 4
    for seed in range(count):
        rng = np.random.default_rng(seed)
        kept = rng.bit_generator.state
        touches = spoiled(rng)
        rng.bit_generator.state = kept
        plant, sheet, rng = worn(SO101, int(rng.integers(1 << 30)), 3.0, encoders=True)
        fit = fit_touches(SO101, touches)
        offered += fit.correct
        before, after = missed(fit, SO101, touches, Held.of(plant, SO101, sheet, rng))
        worse += after > 1.05 * before
        assert fit.correct or fit.verdict is not None
    tell(f"{count} arms with points that tell little: {offered} corrected, {worse} worse")
    assert worse <= 0.01 * count


def test_the_touch_that_is_advised_tells_more_than_most_others() -> None:
    plant, sheet, rng = worn(SO101, 3, 3.0, encoders=True)
    possible = touched(plant, SO101, sheet, rng, (0.0, 0.08), 24)
    first, rest = possible.only(np.arange(6)), possible.only(np.arange(6, 24))
    best = next_touch(SO101, first, rest)

    def left(i: int) -> float:
        """How uncertain the tool stays after one more touch (RMS over all of them, by their design)."""
        more = possible.only(np.append(np.arange(6), 6 + i))
        model = TouchModel(SO101).placed(more)
        fit = solve(model, more, model.parameters(possible))
        A = model.slopes(fit.values, possible, fit.parameters)
        return float(np.einsum("kip,pq,kiq->", A, fit.covariance / fit.noise_m**2, A))

    others = [left(i) for i in range(18)]
    assert others[best] <= np.quantile(others, 0.35)


def test_the_next_point_is_one_that_the_arm_reaches() -> None:
    plant, sheet, rng = worn(SO101, 4, 3.0, encoders=True)
    touches = touched(plant, SO101, sheet, rng, (0.0,), 6)
    marks = np.array([[x, y, 0.0] for x in (-0.1, 0.0, 0.1, 2.0) for y in (-0.1, 0.0, 0.1)])
    candidates = reachable(SO101, touches, marks)
    chosen = candidates.points_m[next_touch(SO101, touches, candidates)]
    assert chosen[0] < 1.0 and (candidates.points_m[:, 0] < 1.0).all()
    with pytest.raises(CalibrationError, match="2 touches"):
        next_touch(SO101, touches.only(np.arange(2)), candidates)
