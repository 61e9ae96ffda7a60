"""Simulated arms whose tool touches marks of a sheet, as somebody does who goes by the advice of the fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from tests.calibration.plant import Plant, Sheet, touch

from armctl.arrays import FloatArray
from armctl.calibration import Touches, TouchFit, next_touch
from armctl.calibration.touch_fit import solve
from armctl.calibration.touch_model import TouchModel, Values
from armctl.robot import Robot

NOISE_M = 0.0005


def rms(errors: FloatArray) -> float:
    """Of the lengths of errors (k, 3)."""
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


def heaviest(plant: Plant, robot: Robot, rng: np.random.Generator) -> FloatArray:
    """(n,) largest torque of each joint [N·m]."""
    return np.abs(plant.torque(rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (300, robot.n)))).max(
        axis=0
    )


def worn(
    robot: Robot, seed: int, zero_deg: float, *, encoders: bool
) -> tuple[Plant, Sheet, np.random.Generator]:
    """An arm with hidden zeros, 1.5 … 3° of sag where it carries, and 1° play; and where the sheet lies."""
    rng, n = np.random.default_rng(seed), robot.n
    plant = Plant.of(robot, rng)
    plant.zero = np.radians(rng.normal(0.0, zero_deg, n))
    most = heaviest(plant, robot, rng)
    carries = most > 0.04 * most.max()
    plant.compliance = np.where(carries, np.radians(rng.uniform(1.5, 3.0, n)) / np.maximum(most, 1e-6), 0.0)
    plant.play = np.radians(rng.uniform(0.8, 1.2, n))
    plant.step = 2 * np.pi / 4096 if encoders else 0.0
    return plant, Sheet.anywhere(robot, rng, (0.2, 0.28)), rng


@dataclass
class Held:
    """Points that no fit sees."""

    q: FloatArray
    sense: FloatArray
    points: FloatArray

    @classmethod
    def of(cls, plant: Plant, robot: Robot, sheet: Sheet, rng: np.random.Generator) -> Held:
        """Sixty of them, on the sheet and above it."""
        return cls(*touch(plant, robot, sheet, np.repeat([0.0, 0.03, 0.08], 20), rng))

    def missed(self, model: TouchModel, values: Values) -> float:
        """By how much they are missed by some numbers, seen on the sheet: RMS [m]."""
        return rms(model.on_sheet(values, model.tips(values, self.q, self.sense)) - self.points)


def touched(
    plant: Plant,
    robot: Robot,
    sheet: Sheet,
    rng: np.random.Generator,
    heights: Sequence[float],
    count: int,
    noise: float = NOISE_M,
) -> Touches:
    """Points of a sheet, touched; at some heights (m) in turn."""
    q, sense, points = touch(plant, robot, sheet, np.resize(np.array(heights, dtype=np.float64), count), rng)
    return Touches.checked(robot, q, points + rng.normal(0.0, noise, points.shape), "sheet", sense)


def advised(robot: Robot, possible: Touches, count: int) -> Touches:
    """Three of many touches, and then always the one that tells most."""
    chosen = [0, 1, 2]
    while len(chosen) < count:
        rest = np.array([i for i in range(len(possible)) if i not in chosen])
        best = next_touch(robot, possible.only(np.array(chosen)), possible.only(rest))
        chosen.append(int(rest[best]))
    return possible.only(np.array(chosen))


def before(robot: Robot, touches: Touches) -> tuple[TouchModel, Values]:
    """The arm as its file has it, and the sheet where it then seems to lie."""
    model = TouchModel(robot).placed(touches)
    return model, solve(model, touches, model.of_sheet()).values


def missed(fit: TouchFit, robot: Robot, touches: Touches, held: Held) -> tuple[float, float]:
    """By how much other points are missed before and after a fit [m]."""
    model, values = before(robot, touches)
    return held.missed(model, values), held.missed(model, fit.values if fit.correct else values)
