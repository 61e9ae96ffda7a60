"""All configurations of a pose, followed from those of a complex pose beside it.

Where the last axis is parallel to the first, or two configurations come close to each other, rounding hides
some of the eigenvalues (``pencil``). A complex pose at some distance has none of these troubles. On the way
from there to the pose that is asked for, each of its configurations moves on a path of its own: almost no way
through complex poses has a singular one on it but at its end (A. J. Sommese and C. W. Wampler, "The numerical
solution of systems of polynomials", 2005, chapter 7). So where all paths have been followed, all
configurations are known: those at which a path ends. Two paths end in a double one, which is singular.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import wrapped
from armctl.kinematics.chain import Chain
from armctl.kinematics.families.general_six.pencil import ComplexArray
from armctl.kinematics.newton import newton_steps

_FIRST, _LEAST, _NEAR = 0.1, 1e-7, 1e-7
"""shares of the way that is left: the first step, one so short that a path is given up; where a path ends"""
_ROUNDS = 300
_LEAP, _BASIN, _FASTER = 1.0, 0.1, 0.3
"""[rad] the farthest to go in a step and in the first Newton step, each of which is shorter by a factor"""
_NEWTON, _MET = 4, 1e-6
"""how many Newton steps are made, and what is left then [rad]"""
_FAR, _MET_FAR, _AWAY = 5.0, 1e-3, 25.0
"""[rad] imaginary parts beyond which rounding, which grows with their exponential, leaves so much; and those
at which a path leaves for what is no turn"""
_TOGETHER = 0.1
"""[rad] how near to each other the paths to one singular configuration are at their ends"""
_SINGULAR, _SAME = 1e-6, 1e-6
"""[1] of a singular pose the Jacobian has a smaller singular value; [rad] nearer ends are one"""


class Beside(NamedTuple):
    """A complex pose and the way back: shifted by ``shift``, and turned by ``angle`` about ``axis``."""

    shift: ComplexArray
    """(3,) [m], base frame"""
    axis: FloatArray
    """(3,) unit vector, tool frame"""
    angle: complex
    """[rad]"""

    @classmethod
    def of(cls, rng: np.random.Generator, size: float, unit: float) -> Beside:
        """A random one, by about ``size``: an angle, and a shift over the ``unit`` [m]."""
        shift = rng.normal(size=3) + 1j * rng.normal(size=3)
        axis = rng.normal(size=3)
        angle = size * complex(np.exp(1j * rng.uniform(0.6, 2.5)))
        return cls(size * unit * shift, axis / np.linalg.norm(axis), angle)

    def poses(self, pose: FloatArray, share: FloatArray) -> ComplexArray:
        """(m, 4, 4) at shares (m,) of the way from ``pose`` (4, 4) to the complex one."""
        angle = share * self.angle
        x, y, z = self.axis.tolist()
        K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        c, s = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
        T = np.zeros((len(share), 4, 4), dtype=np.complex128)
        T[:, :3, :3] = pose[:3, :3] @ (np.eye(3) + s * K + (1.0 - c) * (K @ K))
        T[:, :3, 3] = pose[:3, 3] + share[:, None] * self.shift
        T[:, 3, 3] = 1.0
        return T


class Ends(NamedTuple):
    """Where paths end; those to what is no turn end nowhere, and are left out."""

    q: ComplexArray
    """(k, 6) [rad]"""
    singular: NDArray[np.bool_]
    """(k,) where the last bit of the way was not gone: the arm is singular there, or nearly"""
    all: bool
    """whether no path was lost"""


def followed(chain: Chain, pose: FloatArray, beside: Beside, starts: ComplexArray, unit: float) -> Ends:
    """Where the paths from configurations ``starts`` (m, 6) of the complex pose end."""
    way = _PosePath(chain, pose, beside, unit)
    q, share, step = starts, np.ones(len(starts)), np.full(len(starts), _FIRST)
    jacobian = way.off(q, share)[1]
    ended, left = [q[:0]], [share[:0]]
    lost = 0
    for _ in range(_ROUNDS):
        there = np.where(step < 1.0, np.maximum(share * (1.0 - step), _NEAR), 0.0)
        ahead, changed, good = way.corrected(*way.predicted(q, jacobian, there - share), there)
        q, share = np.where(good[:, None], ahead, q), np.where(good, there, share)
        jacobian = np.where(good[:, None, None], changed, jacobian)
        step = np.where(good, np.minimum(1.5 * step, 1.0), 0.5 * step)
        gone, arrived, stuck = unreal(q) > _AWAY, share <= _NEAR, step < _LEAST
        ended.append(q[arrived & ~gone])
        left.append(share[arrived & ~gone])
        lost += int((stuck & ~arrived & ~gone).sum())
        on = ~(gone | arrived | stuck)
        q, share, step, jacobian = q[on], share[on], step[on], jacobian[on]
        if len(q) == 0:
            break
    ends = np.concatenate(ended)
    least = np.linalg.svd(way.off(ends, np.zeros(len(ends)))[1], compute_uv=False)[:, -1]
    singular = (np.concatenate(left) > 0.0) | (least < _SINGULAR)
    place = np.exp(1j * ends[~singular])  # of two paths that end in one place, one has jumped on to the other
    apart = np.abs(place[:, None] - place).max(axis=2) + np.eye(len(place))
    return Ends(ends, singular, lost + len(q) == 0 and bool((apart > _SAME).all()))


def meeting(ends: Ends) -> FloatArray:
    """(k, 6) singular configurations where paths come together [rad], each once, real parts.

    Near its end such a path moves by a root of what is left of the way, but the mean of all that come
    together moves by a power series (A. P. Morgan, A. J. Sommese and C. W. Wampler, "A power series method
    for computing singular solutions", 1992).
    """
    q = ends.q[ends.singular]
    means: list[FloatArray] = []
    while len(q):
        off = q - q[0]
        off.real = wrapped(off.real)
        near = np.abs(off).max(axis=1) < _TOGETHER
        means.append((q[0] + off[near].mean(axis=0)).real)
        q = q[~near]
    return np.array(means).reshape(-1, 6)


def unreal(q: ComplexArray) -> FloatArray:
    """(k,) the largest imaginary part of each configuration (k, 6) [rad]."""
    return np.abs(q.imag).max(axis=1, initial=0.0)


class _PosePath:
    """The way from the complex pose to the one that is asked for."""

    def __init__(self, chain: Chain, pose: FloatArray, beside: Beside, unit: float) -> None:
        self._chain, self._pose, self._beside, self._unit = chain, pose, beside, unit
        self._speed = np.concatenate([beside.shift / unit, beside.angle * (pose[:3, :3] @ beside.axis)])
        """(6,) of the pose, by the share of the way"""

    def predicted(
        self, q: ComplexArray, jacobian: ComplexArray, step: FloatArray
    ) -> tuple[ComplexArray, NDArray[np.bool_]]:
        """Configurations (m, 6) after steps (m,) along the tangents, and which steps are not too long."""
        ahead = (
            newton_steps(jacobian, np.broadcast_to(self._speed, q.shape).astype(np.complex128))
            * step[:, None]
        )
        good = np.abs(ahead).max(axis=1, initial=0.0) < _LEAP
        return np.where(good[:, None], q + ahead, q), good

    def corrected(
        self, q: ComplexArray, good: NDArray[np.bool_], share: FloatArray
    ) -> tuple[ComplexArray, ComplexArray, NDArray[np.bool_]]:
        """Configurations (m, 6) after Newton steps, their Jacobians, and where the steps become short."""
        most, met = np.full(len(q), _BASIN), np.where(unreal(q) > _FAR, _MET_FAR, _MET)
        off, jacobian = self.off(q, share)
        length = np.full(len(q), np.inf)
        for _ in range(_NEWTON):
            move = newton_steps(jacobian, off)
            length = np.abs(move).max(axis=1, initial=0.0)
            good = good & ((length <= most) | (length < met))
            q = np.where(good[:, None], q - move, q)
            if (length[good] < met[good]).all():
                break
            most = np.minimum(_FASTER * length, most)
            off, jacobian = self.off(q, share)
        return q, jacobian, good & (length < met)

    def off(self, q: ComplexArray, share: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """What (m, 6) miss their poses by (m, 6), and the Jacobian (m, 6, 6), lengths over the unit."""
        frame: ComplexArray = np.broadcast_to(np.eye(4, dtype=np.complex128), (len(q), 4, 4))
        c, s = np.cos(q)[:, :, None], np.sin(q)[:, :, None]
        axes, points = np.empty((2, len(q), 6, 3), dtype=np.complex128)
        for j, segment in enumerate(self._chain.segments):
            frame = frame @ segment
            axes[:, j], points[:, j] = frame[:, :3, 2], frame[:, :3, 3]
            x, y = frame[:, :, 0].copy(), frame[:, :, 1].copy()
            frame[:, :, 0], frame[:, :, 1] = c[:, j] * x + s[:, j] * y, c[:, j] * y - s[:, j] * x
        frame = frame @ self._chain.tail
        goal = self._beside.poses(self._pose, share)
        turned = frame[:, :3, :3] @ goal[:, :3, :3].swapaxes(1, 2)
        off = np.empty((len(q), 6), dtype=np.complex128)
        off[:, :3] = (frame[:, :3, 3] - goal[:, :3, 3]) / self._unit
        for k, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
            off[:, 3 + k] = 0.5 * (turned[:, i, j] - turned[:, j, i])
        columns = np.concatenate([np.cross(axes, frame[:, None, :3, 3] - points) / self._unit, axes], axis=2)
        return off, columns.swapaxes(1, 2)
