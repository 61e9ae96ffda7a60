"""A simulated arm that shares no code with the fit: plain products of 4×4 matrices, and weights of its own.

Its masses, friction and play are other ones than those by which armctl corrects it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armctl.arrays import FloatArray
from armctl.robot import Robot

G = 9.81


def _matrices(kind: str, value: FloatArray | float, k: int) -> FloatArray:
    """(k, 4, 4) turns about x or z [rad], or ways along them [m]."""
    T = np.tile(np.eye(4), (k, 1, 1))
    if kind in ("Tx", "Tz"):
        T[:, "xyz".index(kind[1]), 3] = value
        return T
    c, s = np.cos(value), np.sin(value)
    i, j = (1, 2) if kind == "Rx" else (0, 1)
    T[:, i, i], T[:, i, j], T[:, j, i], T[:, j, j] = c, -s, s, c
    return T


@dataclass
class Plant:
    """What an arm truly is."""

    rows: list[list[float]]
    """a, alpha, d, theta, 1 where it turns [m, rad]"""
    modified: bool
    bodies: list[tuple[int, float, FloatArray]]
    """index of the joint, mass [kg], centre (3,) in the frame behind its row [m]"""
    zero: FloatArray
    compliance: FloatArray
    play: FloatArray
    friction: FloatArray
    scale: FloatArray
    step: float = 0.0
    """of what is read [rad]; 0: exact"""

    @classmethod
    def of(cls, robot: Robot, rng: np.random.Generator, *, masses: float = 0.1) -> Plant:
        """A good arm, but for its masses, which are off by a share of so many standard deviations."""
        chain, n = robot.chain, robot.n
        rows = [[one.a_m, one.alpha_rad, one.d_m, one.theta_rad, float(one.joint)] for one in chain.rows]
        bodies = [
            (body.joint, body.mass_kg * float(1 + rng.normal(0, masses)),
             np.array(body.com_m) + rng.normal(0, 0.005, 3))
            for body in robot.gravity.bodies
        ]  # fmt: skip
        none = np.zeros(n)
        friction = rng.uniform(0.01, 0.06, n)
        return cls(
            rows,
            chain.convention == "modified",
            bodies,
            none,
            none.copy(),
            none.copy(),
            friction,
            none.copy(),
        )

    @property
    def n(self) -> int:
        return len(self.zero)

    def frames(self, theta: FloatArray) -> tuple[list[FloatArray], list[FloatArray], FloatArray]:
        """(k, 4, 4) of each axis before it turns, behind the row of each, and of the tool."""
        k = len(theta)
        T, axes, behind = np.tile(np.eye(4), (k, 1, 1)), list[FloatArray](), list[FloatArray]()
        for a, alpha, d, zero, turns in self.rows:
            x = _matrices("Rx", alpha, k) @ _matrices("Tx", a, k)
            before = T @ x if self.modified else T
            angle: FloatArray | float = zero + theta[:, len(axes)] if turns else zero
            T = before @ _matrices("Rz", angle, k) @ _matrices("Tz", d, k)
            T = T if self.modified else T @ x
            if turns:
                axes.append(before)
                behind.append(T)
        return axes, behind, T

    def torque(self, theta: FloatArray) -> FloatArray:
        """(k, n) that gravity asks of each joint [N·m], by a sum over all weights."""
        axes, behind, _ = self.frames(theta)
        torque = np.zeros(theta.shape)
        for joint, mass, centre in self.bodies:
            at = (behind[joint] @ np.append(centre, 1.0))[:, :3]
            for i in range(joint + 1):
                lever = at - axes[i][:, :3, 3]
                torque[:, i] += mass * G * np.cross(axes[i][:, :3, 2], lever)[:, 2]
        return torque

    def read(self, q: FloatArray) -> FloatArray:
        """What is read, in steps."""
        return np.round(q / self.step) * self.step if self.step else q

    def link(self, shaft: FloatArray, sense: FloatArray) -> FloatArray:
        """Where the links are (k, n) at what the shafts are at; ``sense``: how each of them turned last."""
        rigid = shaft * (1 + self.scale) + self.zero
        theta = rigid
        for _ in range(4):
            torque = self.torque(theta)
            side = np.where(np.abs(torque) > self.friction, np.sign(torque), sense)
            theta = rigid - self.compliance * torque - self.play / 2 * side
        return theta

    def tip(self, shaft: FloatArray, sense: FloatArray) -> FloatArray:
        """(k, 3) where the tool truly is [m]."""
        return self.frames(self.link(shaft, sense))[2][:, :3, 3]


@dataclass
class Sheet:
    """Marks that lie somewhere before the arm."""

    place: FloatArray
    turn: FloatArray
    """(3, 3)"""

    @classmethod
    def anywhere(
        cls, robot: Robot, rng: np.random.Generator, distance: tuple[float, float], tilt_deg: float = 2.0
    ) -> Sheet:
        """A sheet whose middle is so far before the arm [m], turned any way, and tilted a little."""
        r, side = rng.uniform(*distance), rng.uniform(-0.4, 0.4)
        yaw, (p, q) = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(-tilt_deg, tilt_deg, 2)) / np.sqrt(2)
        Rz = _matrices("Rz", yaw, 1)[0, :3, :3]
        Rx = _matrices("Rx", p, 1)[0, :3, :3]
        Ry = np.array([[np.cos(q), 0, np.sin(q)], [0, 1, 0], [-np.sin(q), 0, np.cos(q)]])
        return cls(np.array([r * np.cos(side), r * np.sin(side), rng.uniform(-0.01, 0.02)]), Ry @ Rx @ Rz)

    def base(self, points: FloatArray) -> FloatArray:
        return points @ self.turn.T + self.place

    def own(self, points: FloatArray) -> FloatArray:
        return (points - self.place) @ self.turn


def touch(
    plant: Plant,
    robot: Robot,
    sheet: Sheet,
    heights: FloatArray,
    rng: np.random.Generator,
    half: float = 0.12,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Bring the tool of a plant to points of a sheet at some heights (m,) [m], in any pose, from any side.

    Gives what is read (m, n), the senses (m, n), and the points (m, 3) in the frame of the sheet. The points
    are at most ``half`` from the middle of the sheet, along its sides [m].
    """
    low, high = robot.limits.T
    lift = int(np.argmax(np.abs(plant.torque(rng.uniform(low, high, (50, robot.n)))).max(axis=0)))
    turn, wanted = 1e-5 * np.eye(robot.n)[lift], list(heights.tolist())
    found: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    while wanted:
        q = rng.uniform(low, high, (4000, robot.n))
        own = sheet.own(plant.frames(q)[2][:, :3, 3])
        near = (
            (np.abs(own[:, :2]) < half).all(axis=1) & (-0.05 < own[:, 2]) & (own[:, 2] < max(heights) + 0.05)
        )
        q = q[near]
        height, sense = rng.choice(heights, len(q)), rng.choice([-1.0, 1.0], q.shape)
        for _ in range(5):
            off = sheet.own(plant.tip(q, sense))[:, 2] - height
            slope = (sheet.own(plant.tip(q + turn, sense))[:, 2] - off - height) / 1e-5
            q = q - np.clip(off / np.where(np.abs(slope) < 0.02, 0.02, slope), -0.2, 0.2)[:, None] * (
                turn > 0
            )
        own = sheet.own(plant.tip(q, sense))
        _, behind, _ = plant.frames(plant.link(q, sense))
        good = (np.abs(own[:, :2]) < half).all(axis=1) & (np.abs(own[:, 2] - height) < 1e-5)
        good &= (np.min([T[:, 2, 3] for T in behind[1:]], axis=0) > 0.02) & ((q > low) & (q < high)).all(
            axis=1
        )
        for i in np.flatnonzero(good).tolist():
            if height[i] in wanted:
                wanted.remove(height[i])
                found.append((q[i], sense[i], own[i]))
    q, sense, points = map(np.array, zip(*found, strict=True))
    return plant.read(q), sense, points
