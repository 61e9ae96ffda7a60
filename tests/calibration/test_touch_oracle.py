"""The fit of touched points beside another one: SciPy's least squares on plain products of 4×4 matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.special import chdtri
from tests.calibration.plant import Plant, Sheet
from tests.calibration.touch_kit import NOISE_M, Held, rms, touched, worn

from armctl.arrays import FloatArray
from armctl.calibration import Touches
from armctl.calibration.touch_fit import solve
from armctl.calibration.touch_model import TouchModel
from armctl.robot import Robot, load_robot

SO101, UZUNER = load_robot("so101"), load_robot("uzuner")
ZERO, SAG, PLAY, TILT, HEADING = np.radians(3.0), np.radians(2.0), np.radians(1.0), np.radians(2.0), 3.0
"""how far a number may well be off [rad]: what is believed before a point is touched"""


FRICTION = 0.035
"""of each joint, as the search guesses it; truly each has its own [N·m]"""


class Oracle:
    """Zeros, sag, play and the pose of the sheet, found by a search that shares no code with the fit."""

    def __init__(self, robot: Robot, true: Plant, touches: Touches, sheet: Sheet) -> None:
        """``true``: whose masses are known; nothing else of it is used."""
        self.touches, self.n = touches, robot.n
        none = np.zeros(self.n)
        self.arm = replace(true, zero=none, compliance=none, play=none, friction=np.full(self.n, FRICTION))
        low, high = robot.limits.T
        q = low + (high - low) * np.random.default_rng(5).uniform(0.0, 1.0, (2000, self.n))
        self.most = np.abs(self.arm.torque(q)).max(axis=0)
        self.carries = self.most > 0.04 * self.most.max()
        start = np.zeros(3 * self.n + 6)
        start[-6:-3] = sheet.place  # somewhere near: the search is a local one
        start[-3:] = Rotation.from_matrix(sheet.turn).as_rotvec()
        self.begin = Rotation.from_matrix(sheet.turn)
        self.x = np.asarray(least_squares(self.cost, start, x_scale="jac").x)

    def parts(self, x: FloatArray) -> tuple[Plant, Sheet]:
        n = self.n
        compliance = np.where(self.carries, x[n : 2 * n] * SAG / np.maximum(self.most, 1e-9), 0.0)
        arm = replace(self.arm, zero=x[:n] * ZERO, compliance=compliance, play=x[2 * n : 3 * n] * PLAY)
        return arm, Sheet(x[-6:-3], Rotation.from_rotvec(x[-3:]).as_matrix())

    def errors(self, x: FloatArray, touches: Touches) -> FloatArray:
        arm, sheet = self.parts(x)
        return arm.tip(touches.q, touches.senses) - sheet.base(touches.points_m)

    def cost(self, x: FloatArray) -> FloatArray:
        tilt = Rotation.from_rotvec(x[-3:]).as_matrix()[:2, 2] / TILT
        return np.concatenate([(self.errors(x, self.touches) / NOISE_M).ravel(), x[: 3 * self.n], tilt])

    def missed(self, held: Held) -> float:
        arm, sheet = self.parts(self.x)
        return rms(sheet.own(arm.tip(held.q, held.sense)) - held.points)


def an_arm(
    robot: Robot, seed: int, count: int, *, zero_deg: float, play: float = 1.0
) -> tuple[Plant, Sheet, Touches, Held]:
    """An arm whose masses are those of its file; its touches, and others that no fit sees."""
    plant, sheet, rng = worn(robot, seed, zero_deg, encoders=False)
    plant.bodies = [(one.joint, one.mass_kg, np.array(one.com_m)) for one in robot.gravity.bodies]
    plant.play *= play
    touches = touched(plant, robot, sheet, rng, (0.0, 0.04, 0.08), count)
    return plant, sheet, touches, Held.of(plant, robot, sheet, rng)


@pytest.mark.parametrize(("robot", "zero_deg"), [(SO101, 3.0), (UZUNER, 1.5)], ids=["so101", "uzuner"])
def test_it_is_as_good_as_a_search_that_knows_the_masses(robot: Robot, zero_deg: float) -> None:
    ours, theirs, apart = list[float](), list[float](), list[float]()
    for seed in range(3):
        plant, sheet, touches, held = an_arm(robot, 100 + seed, 24, zero_deg=zero_deg)
        model = TouchModel(robot).placed(touches)
        solved = solve(model, touches, model.parameters(touches))
        oracle = Oracle(robot, plant, touches, sheet)
        ours.append(held.missed(model, solved.values))
        theirs.append(oracle.missed(held))
        arm, laid = oracle.parts(oracle.x)
        of_ours = model.on_sheet(solved.values, model.tips(solved.values, held.q, held.sense))
        apart.append(rms(of_ours - laid.own(arm.tip(held.q, held.sense))))
    assert np.mean(ours) < 1.2 * np.mean(theirs)
    assert np.mean(apart) < 0.8 * np.mean(theirs)  # they differ by less than either is off


def test_what_it_leaves_is_the_noise_of_the_touches() -> None:
    squares, free = 0.0, 0.0
    for seed in range(3):
        _, _, touches, _ = an_arm(SO101, 200 + seed, 40, zero_deg=3.0, play=0.0)
        model = TouchModel(SO101).placed(touches)
        solved = solve(model, touches, model.parameters(touches))
        squares += float(np.sum(solved.errors**2)) / NOISE_M**2
        free += 3 * len(touches) - float(np.sum(solved.told))
    low, high = chdtri(free, [0.999, 0.001])  # chi-square; scipy.stats takes seconds to import
    assert low < squares < high
