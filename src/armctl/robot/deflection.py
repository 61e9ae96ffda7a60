"""How an arm gives way under its own weight: what lies between an output and the link that it moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armctl.arrays import ArrayRecord, FloatArray
from armctl.kinematics import GravityModel
from armctl.kinematics.samples import joint_samples
from armctl.lazy_dataclass import dataclass

_FRICTION = 0.05
"""by which share of the arm's largest torque gravity must exceed what holds a joint in its play"""
_STEEPEST = 0.8
"""share of a turn of the links by which what gives way may change at most (``invertible``)"""
_WIDER = 1.1
"""the friction grows by this factor until that holds"""
_PROBES, _APART = 300, 1e-4
"""configurations in which that is looked at, and the step of differences there [rad]"""
_STILL = 2e-6
"""what the last step changes of an angle that is found [rad]"""
_QUICK_STEPS, _MOST_STEPS = 12, 60
"""the first ones, which guess where they lead; and the others, each of which leaves a fixed share"""


@dataclass(frozen=True, slots=True, eq=False)
class Deflection(ArrayRecord):
    """What gravity bends of each joint, and how it leans inside its play.

    On the way from a setpoint to the tool two things give way. A servo stands below its setpoint by
    ``drive · torque``: an encoder at its output sees that. Behind the encoder horn, bracket and link bend by
    ``link · torque`` and lean to one side of the play; no encoder sees it.
    """

    gravity: GravityModel
    """with the load for which it holds"""
    link: FloatArray
    """(n,) compliance between what is read and the link [rad/(N·m)]"""
    drive: FloatArray
    """(n,) compliance between the setpoint and what is read [rad/(N·m)]; 0 where nothing is measured"""
    play: FloatArray
    """(n,) from one side to the other [rad]"""
    friction: float
    """torque from which on gravity decides the side on which a joint leans [N·m]"""

    @classmethod
    def of(cls, gravity: GravityModel, heaviest: FloatArray) -> Deflection:
        """Of an arm that does not give way; ``heaviest`` (n,) the largest torque of each joint [N·m]."""
        none = np.zeros(len(heaviest))
        return cls(gravity, none, none, none, _FRICTION * max(float(heaviest.max()), 1e-3))

    def invertible(self, limits: FloatArray) -> Deflection:
        """The same, with a friction that lets angles inside limits (n, 2) [rad] be told by ``setpoint``.

        Where gravity changes its sense, much play would lean over faster than the links turn: what is told
        would run backwards, and be the same for several angles. It is q + g(q), and the slope of g is D H. H,
        that of the torque, is symmetric, as gravity has an energy. D is diagonal, none of it larger than
        B = link + drive + play / (2 friction). So with angles in units of √B the slope of g is no larger than
        √B H √B, whose largest eigenvalue is kept below 1 by a larger friction. Then g contracts: no two
        angles are told alike, and the steps of ``angles`` lead to the right one.
        """
        if not self.play.any():
            return self
        q = joint_samples(limits, _PROBES)
        steps = _APART * np.eye(len(self.play))[:, None]
        by_joint = (self.gravity.torque(q + steps) - self.gravity.torque(q - steps)) / (2 * _APART)
        H = 0.5 * (by_joint.transpose(1, 0, 2) + by_joint.transpose(1, 2, 0))  # but for rounding symmetric
        friction, most = self.friction, _WIDER * float(np.abs(self.gravity.torque(q)).max())
        while friction < most:
            root = np.sqrt(self.link + self.drive + 0.5 * self.play / friction)
            if np.abs(np.linalg.eigvalsh(root[:, None] * H * root)).max() < _STEEPEST:
                break
            friction *= _WIDER
        return replace(self, friction=friction)

    def side(self, torque: FloatArray, sense: FloatArray | float = 0.0) -> FloatArray:
        """On which side of its play each joint leans, -1 … 1: 1 is the side of smaller angles.

        ``torque`` (..., n) [N·m]; ``sense`` (..., n) in which it turned last, 1, -1 or 0 for unknown: it
        decides where gravity does not.
        """
        lean = np.tanh(torque / self.friction)
        return lean + sense * (1.0 - np.abs(lean))

    def bend(self, q: FloatArray, sense: FloatArray | float = 0.0) -> FloatArray:
        """By how much what is read is ahead of the links (..., n) [rad], where they are at ``q`` (..., n)."""
        return self.bent(self.gravity.torque(q), sense)

    def bent(self, torque: FloatArray, sense: FloatArray | float = 0.0) -> FloatArray:
        """The same by the torques (..., n) [N·m] there."""
        return self.link * torque + 0.5 * self.play * self.side(torque, sense)

    def shaft(self, q: FloatArray) -> FloatArray:
        """What is read (..., n) [rad] where the links are at ``q`` (..., n), however they came there."""
        return self._ahead(q, self.link)

    def setpoint(self, q: FloatArray) -> FloatArray:
        """What to command (..., n) [rad] so that the links come to stand at ``q`` (..., n)."""
        return self._ahead(q, self.link + self.drive)

    def _ahead(self, q: FloatArray, compliance: FloatArray) -> FloatArray:
        torque = self.gravity.torque(q)
        return q + compliance * torque + 0.5 * self.play * np.tanh(torque / self.friction)

    def angles(self, told: FloatArray, *, measured: bool) -> FloatArray:
        """Where the links are (n,) [rad] at an angle that was ``told``: measured, or else commanded.

        As it was told where one of the angles is NaN: then no torque is known.
        """
        if np.isnan(told).any():
            return told
        compliance = self.link if measured else self.link + self.drive
        q, off = told, self._ahead(told, compliance) - told
        for k in range(_MOST_STEPS):
            step = -off
            if np.abs(off).max() < _STILL:
                break
            q = q + step
            left = self._ahead(q, compliance) - told
            # the share of the last step that it missed is what the next one must be longer by (Aitken)
            missed = float(left @ off) / float(off @ off) if k < _QUICK_STEPS else 0.0
            off = left / (1.0 - min(max(missed, -0.5), 0.5))
        return q
