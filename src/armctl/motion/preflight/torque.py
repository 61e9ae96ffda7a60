"""Can the joints hold the arm and what it carries?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.kinematics import GravityModel
from armctl.kinematics.link_frames import LinkFrames
from armctl.motion.preflight.batch import Batch, Chunk, Finding, Worst
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
_WARM = 0.5
"""Above this share of its stall torque a motor is told of: held for long, it gets hot."""
_TOLERANCE = 1e-3


class Torque:
    """Static gravity torque of each joint against its stall torque.

    More than the stall torque is an error, unless the motion starts there and it gets no worse.
    """

    def __init__(self, batch: Batch, at_start: LinkFrames, payload_kg: float | None = None) -> None:
        """Prepare.

        Args:
            batch: the motions.
            at_start: the links where each motion starts.
            payload_kg: at the tool point; None: that of the robot file.

        Raises:
            InputError: a payload that is not finite, or negative.
        """
        robot = batch.robot
        self._robot = robot
        self._gravity = _loaded(robot.gravity, payload_kg)
        self._stall = np.array([joint.stall_torque or np.inf for joint in robot.joints])[:, None]
        self._known = bool(np.isfinite(self._stall).any() and robot.gravity.bodies)
        if not self._known:
            return
        self._allowed = np.maximum(self._shares(at_start), 1.0)
        """(n, motions) largest shares of the stall torque"""
        self._worst = [Worst(batch.motions) for _ in robot.joints]

    def look(self, chunk: Chunk, links: LinkFrames) -> None:
        """Take in some samples."""
        if not self._known:
            return
        shares = self._shares(links)
        for j, (share, worst) in enumerate(zip(shares, self._worst, strict=True)):
            if share.max() > _WARM:
                worst.look(chunk.motion, chunk.time, share - _WARM, np.full(len(share), j), share)

    def findings(self) -> Iterator[tuple[int, Finding]]:
        """What was found, with the index of the motion."""
        if not self._known:
            return
        for j, worst in enumerate(self._worst):
            joint = self._robot.joints[j]
            for i in worst.found.tolist():
                share, stall = float(worst.figure[i]), float(self._stall[j, 0])
                over = share > self._allowed[j, i] * (1 + _TOLERANCE)
                yield (
                    i,
                    Finding(
                        float(worst.time[i]),
                        joint.title,
                        f"gravity asks for {share * stall:.2f} N·m, "
                        f"{100 * share:.0f} % of its stall torque of {stall:.2f} N·m",
                        "keep the load nearer to the joint, or take a lighter one"
                        if over
                        else "do not stay there for long: the motor gets hot",
                        "torque",
                        "error" if over else "warning",
                    ),
                )

    def _shares(self, links: LinkFrames) -> FloatArray:
        """(n, m) gravity torque over stall torque, without sign."""
        return np.abs(self._gravity.torque_of(links)) / self._stall


def not_checked(robot: Robot) -> tuple[str, ...]:
    """What the pre-flight cannot judge, because the robot file gives no figures for it."""
    if not robot.gravity.bodies:
        return (f"gravity torque: the file of {robot.name} gives no masses",)
    unknown = [joint.title for joint in robot.joints if joint.stall_torque is None]
    if not unknown:
        return ()
    which = "any joint" if len(unknown) == robot.n else ", ".join(unknown)
    return (f"gravity torque: the file of {robot.name} gives no stall torque of {which}",)


def _loaded(gravity: GravityModel, payload_kg: float | None) -> GravityModel:
    if payload_kg is None:
        return gravity
    if not 0.0 <= payload_kg < np.inf:
        raise InputError(f"a payload must be a number of at least 0 kg, got {payload_kg}")
    return replace(gravity, payload_kg=payload_kg)
