"""Does the tool lose a direction on the way?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.link_frames import LinkFrames
from armctl.kinematics.samples import joint_samples
from armctl.kinematics.velocity import NEAR
from armctl.motion.preflight.batch import Batch, Chunk, Finding, Worst

FloatArray = NDArray[np.float64]
_LOST = 0.005
"""isotropy below which a tool path that needs the hardest direction is refused"""
_STRAINED = 0.25 / _LOST
"""Joint travel per tool travel, in units of the best direction's, that shows that a path needs it."""
_PROBES = 64


class Singularity:
    """Smallest over largest singular value of the tool point's Jacobian.

    A joint motion passes any singularity; a warning tells where it ends at one (below ``NEAR``), since lines
    and jogs of the tool cannot well begin there. A path of the tool is watched all the way. There it is
    an error where the direction that is lost is the one that the path takes: then the joints turn many
    times as far as the tool's way asks for elsewhere.
    """

    def __init__(self, batch: Batch, tool_paths: Sequence[bool]) -> None:
        """Prepare.

        Args:
            batch: the motions.
            tool_paths: for each motion, whether it leads the tool along a path.
        """
        robot = batch.robot
        self._chain = robot.chain
        self._limits = robot.limits
        self._tool = robot.chain.tail[:3, 3]
        self._turning = np.flatnonzero(robot.limits[:, 0] < robot.limits[:, 1])
        self._tool_paths = np.array(tool_paths, dtype=np.bool_)
        self._near, self._lost = Worst(batch.motions), Worst(batch.motions)
        ends = self._squares(self._jacobian(LinkFrames.at(robot.chain, batch.ends)))[0]
        self._note(self._near, np.arange(batch.motions), batch.end_times, ends)

    def look(self, chunk: Chunk, links: LinkFrames) -> None:
        """Take in some samples."""
        on_path = self._tool_paths[chunk.motion]
        if not on_path.any():
            return
        ratio, largest = self._squares(self._jacobian(links))
        self._note(self._near, chunk.motion[on_path], chunk.time[on_path], ratio[on_path])
        lost = np.flatnonzero((ratio < _LOST**2) & on_path)
        lost = lost[lost > 0]
        lost = lost[chunk.leaf[lost] == chunk.leaf[lost - 1]]
        tool = links.place(self._chain.n - 1, self._tool[None])[:, 0]
        way = np.linalg.norm(tool[:, lost] - tool[:, lost - 1], axis=0)
        turn = np.linalg.norm(chunk.q[lost] - chunk.q[lost - 1], axis=1)
        at = lost[turn * np.sqrt(largest[lost]) > _STRAINED * way]
        self._note(self._lost, chunk.motion[at], chunk.time[at], ratio[at])

    @staticmethod
    def _note(worst: Worst, motion: NDArray[np.intp], time: FloatArray, ratio: FloatArray) -> None:
        isotropy = np.sqrt(ratio)
        worst.look(motion, time, NEAR - isotropy, np.zeros_like(motion), isotropy)

    def findings(self) -> Iterator[tuple[int, Finding]]:
        """What was found, with the index of the motion."""
        found = self._near.found.tolist()
        if found and self._never_free():
            return
        for i in found:
            refused = self._lost.badness[i] > 0.0
            worst = self._lost if refused else self._near
            percent = 100 * float(worst.figure[i])
            yield (
                i,
                Finding(
                    float(worst.time[i]),
                    "the tool",
                    f"{'at' if percent < 0.1 else 'near'} a singularity: in one direction it moves only "
                    f"{percent:.1f} % as freely as in the best",
                    "lead the path past there, or go joint by joint"
                    if refused
                    else "begin no lines and no jogs of the tool there: they would be slow, or refused",
                    "singularity",
                    "error" if refused else "warning",
                ),
            )

    def _never_free(self) -> bool:
        """Whether the tool is held to a line or a plane wherever the arm stands: no pose of it is special."""
        probes = LinkFrames.at(self._chain, joint_samples(self._limits, _PROBES))
        return bool((self._squares(self._jacobian(probes))[0] <= NEAR**2).all())

    def _jacobian(self, links: LinkFrames) -> FloatArray:
        """Position rows, for the joints that can turn: (3, turning, m) [m/rad]."""
        tool = links.place(self._chain.n - 1, self._tool[None])[:, 0]
        J = np.empty((3, len(self._turning), tool.shape[-1]))
        for column, j in enumerate(self._turning.tolist()):
            z = links.rotation[j][:, 2]
            x, y, h = tool - links.origin[j]
            J[0, column] = z[1] * h - z[2] * y
            J[1, column] = z[2] * x - z[0] * h
            J[2, column] = z[0] * y - z[1] * x
        return J

    @staticmethod
    def _squares(J: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Squares of the isotropy, and of the largest singular value [m²/rad²]: (m,) each.

        The isotropy is exact where it is small; elsewhere it is a lower bound: with the eigenvalues
        a ≥ b ≥ c of J Jᵀ, c / a is at least 4 abc / (a + b + c)³.
        """
        xx, yy, zz = (_dot(J[i], J[i]) for i in range(3))
        xy, xz, yz = _dot(J[0], J[1]), _dot(J[0], J[2]), _dot(J[1], J[2])
        trace = xx + yy + zz
        volume = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
        ratio = 4.0 * np.maximum(volume, 0.0) / np.maximum(trace, 1e-300) ** 3
        largest = trace.copy()
        small = np.flatnonzero(ratio < NEAR**2)
        if len(small):
            sizes = np.linalg.svd(np.moveaxis(J[:, :, small], 2, 0), compute_uv=False)
            if sizes.shape[1] < 3:  # with fewer than three joints some direction is always lost
                sizes = np.pad(sizes, ((0, 0), (0, 3 - sizes.shape[1])))
            largest[small] = sizes[:, 0] ** 2
            ratio[small] = (sizes[:, 2] / np.maximum(sizes[:, 0], 1e-300)) ** 2
        return ratio, largest


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.einsum("jm,jm->m", a, b)
