"""Which touch tells most about what is still uncertain, and where the arm is sent to come near to it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from armctl.arrays import FloatArray
from armctl.calibration.touch_fit import Solved, solve
from armctl.calibration.touch_model import Frame, Touches, TouchModel
from armctl.calibration.touch_report import drive
from armctl.errors import CalibrationError
from armctl.facts.angles import DEGREE
from armctl.lazy_dataclass import dataclass
from armctl.robot import Robot

_LEAST = 3
"""touches by which it is known where a sheet lies"""
_NOISE_M = 0.0007
"""standard deviation of a coordinate of a touch, with what no number of the arm explains [m]"""
_PITCHES = tuple(DEGREE * pitch for pitch in (-90.0, -70.0, -50.0, -30.0, -10.0))
_PITCHED = 3
"""so many parallel pitch joints leave the pitch free"""
_NEAR = 5.0 * DEGREE
_STEP = 5.0 * DEGREE
_SENSES = (1.0, -1.0)
_SPARE_M = 0.01
"""how far parts of the arm stay from each other, or half as far as at home: a tool that comes out so far
beside a point is brought there without that the arm touches itself"""


def next_touch(robot: Robot, touches: Touches, candidates: Touches, *, load_kg: float = 0.0) -> int:
    """Index of the candidate after which the tool's error over all candidates is least (A-optimal).

    Both are of one ``frame``. ``CalibrationError``: fewer than three touches, or no candidates.
    """
    if len(touches) < _LEAST or not len(candidates):
        raise CalibrationError(
            f"{len(touches)} touches and {len(candidates)} points that can be reached: touch {_LEAST} points "
            "by hand first, then armctl says which one tells most"
        )
    model = TouchModel(robot, load_kg).placed(touches)
    now = solve(model, touches, model.parameters(candidates))
    # by the design alone: three or four touches say next to nothing of their own noise
    done = model.slopes(now.values, touches, now.parameters).reshape(3 * len(touches), -1) / _NOISE_M
    covariance = np.linalg.inv(done.T @ done + np.diag(now.sd**-2))
    A = model.slopes(now.values, candidates, now.parameters)
    weights = np.einsum("kip,kiq->pq", A, A)
    CA = np.einsum("pq,kiq->kpi", covariance, A)
    S = np.einsum("kip,kpj->kij", A, CA) + _NOISE_M**2 * np.eye(3)
    seen = np.asarray(np.linalg.solve(S, CA.swapaxes(1, 2)), dtype=np.float64)
    won = np.einsum("kpi,kiq,pq->k", CA, seen, weights)
    return int(np.argmax(won))


@dataclass(frozen=True, slots=True, eq=False)
class Aim:
    """How an arm comes near to points before it is corrected: by what its touches say of it so far."""

    solved: Solved
    drive: FloatArray
    """(n,) compliance between setpoint and reading [rad/(N·m)]; 0 where that is not noted"""
    drive_sd_m: float
    """by how much that leaves the tool too high or too low [m]"""

    @classmethod
    def of(cls, robot: Robot, touches: Touches, *, load_kg: float = 0.0) -> Aim:
        """By the most likely zeros, sag and place of the sheet; touches that are far off count less."""
        model = TouchModel(robot, load_kg).placed(touches)
        solved = solve(model, touches, model.parameters(touches), robust=True)
        gives = drive(model, solved.values, touches)
        aim = cls(solved, np.zeros(robot.n) if gives is None else gives, 0.0)
        if touches.commanded is None:
            return aim
        sent, read = aim._tips(touches.commanded), model.tips(solved.values, touches.q, touches.senses)
        return replace(aim, drive_sd_m=float(np.sqrt(np.mean((sent - read)[:, 2] ** 2))))

    def _tips(self, q: FloatArray) -> FloatArray:
        """(k, 3) where the tool truly is at setpoints ``q`` (k, n) [rad], base frame [m]."""
        model, values, none = self.solved.model, self.solved.values, np.zeros(q.shape)
        return model.tips(values, q - self.drive * model.links(values, q, none)[1], none)

    def in_base(self, point_m: FloatArray) -> FloatArray:
        """(3,) where a point (3,) of the touches' frame truly is, base frame [m]."""
        return self.solved.model.in_base(self.solved.values, point_m)

    def ahead(self, q: FloatArray) -> FloatArray:
        """(3,) from where the tool truly is to where the robot shows it, sent to ``q`` (n,) [rad], base [m].

        So much beyond a point the robot is sent there.
        """
        return self.solved.model.robot.forward(q)[:3, 3] - self._tips(q[None])[0]

    def height_sd(self, q: FloatArray, point_m: FloatArray) -> float:
        """Standard deviation of how high the tool truly is over a point (3,) [m] at ``q`` (n,) [rad]."""
        one = self.solved
        probe = Touches(q[None], point_m[None], one.model.frame)
        down = one.model.slopes(one.values, probe, one.parameters)[0, 2]
        return math.hypot(math.sqrt(float(down @ one.covariance @ down)), self.drive_sd_m)


def reachable(robot: Robot, touches: Touches, points_m: FloatArray, *, load_kg: float = 0.0) -> Touches:
    """Poses in which the tool can touch points (m, 3) of the touches' frame, from either side.

    By what the touches so far say of where a sheet lies; empty where no point can be reached.
    """
    model = TouchModel(robot, load_kg).placed(touches)
    values = solve(model, touches, model.of_sheet()).values
    return reachable_at(robot, points_m, model.in_base(values, points_m), touches.frame)


def reachable_at(robot: Robot, points_m: FloatArray, base_m: FloatArray, frame: Frame = "base") -> Touches:
    """The same for points (m, 3) of a frame that lie at ``base_m`` (m, 3) in the base frame."""
    home = robot.collision.gaps(robot.body_frames(robot.pose("home")[None]), 2.0 * _SPARE_M)
    room = np.minimum(_SPARE_M, np.minimum(home, 0.5 * home))
    rows = [
        (pose, point)
        for point, target in zip(points_m, base_m, strict=True)
        for pose in _poses(robot, target, room)
    ]
    q = np.reshape([pose for pose, _ in rows for _ in _SENSES], (-1, robot.n))
    points = np.reshape([point for _, point in rows for _ in _SENSES], (-1, 3))
    senses = np.tile(np.array(_SENSES)[:, None], (len(rows), robot.n))
    return Touches(q, points, frame, senses)


def _poses(robot: Robot, target: FloatArray, room: FloatArray) -> list[FloatArray]:
    """Configurations (n,) [rad] with the tool at a point (3,) [m]: a free pitch downwards, in some steps.

    Only where two parts of the arm come no nearer to each other than ``room`` (pairs, 1) [m].
    """
    rotation = robot.forward(robot.pose("home"))[:3, :3] if robot.orients_tool else None
    found = robot.inverse(target, rotation=rotation, step=_STEP).q
    found = found[np.all(robot.collision.gaps(robot.body_frames(found), _SPARE_M) >= room, axis=0)]
    if len(robot.inverse_kinematics.pitch_joints) != _PITCHED or not len(found):
        return list(found[:1])
    # one search for all pitches: a pitch that is out of reach takes a second to be refused
    pitch = np.arcsin(np.clip(robot.forward(found)[:, 2, 2], -1.0, 1.0))
    away = np.abs(found - robot.pose("home")).max(axis=1)
    chosen: list[FloatArray] = []
    for wanted in _PITCHES:
        near = np.flatnonzero(np.abs(pitch - wanted) < _NEAR)
        if len(near):
            chosen.append(found[near[np.argmin(away[near])]])
    return chosen
