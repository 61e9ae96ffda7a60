"""All configurations of a general arm of six joints for a tool pose, complex ones too, as eigenvectors.

The turn of a joint about its line a (a unit dual quaternion with a² = -1) by the angle θ is c + s a, with
c = cos θ/2 and s = sin θ/2. The closed loop of arm and pose g, with all joints at zero taken off, is

    (c2 + s2 a2) (c3 + s3 a3) (c4 + s4 a4) (c5 + s5 a5) = (c1 - s1 a1) g (c6 - s6 a6)

The right side lies in the space of four dimensions that g, a1 g, g a6 and a1 g a6 span (M. Husty, M. Pfurner
and H.-P. Schröcker, "A new and efficient algorithm for the inverse kinematics of a general serial 6R
manipulator", 2007, use such spaces). The four vectors across it make four equations, linear in each of the
four pairs (c, s) of the left side. One pair is hidden in the coefficients. Times the six monomials of degree
(2, 1, 0) in the other pairs these are 24 equations in the 24 monomials of degree (3, 2, 1) (the resultant of
B. Sturmfels and A. Zelevinsky, "Multigraded resultants of Sylvester type", 1994), linear in the hidden pair:
a generalised eigenvalue problem. Its 24 eigenvalues are the 16 configurations that a general arm has, and
eight others with c² + s² = 0 for some joint, which are no turns.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import quaternion_product, wrapped
from armctl.kinematics.chain import Chain
from armctl.kinematics.newton import newton_steps

ComplexArray = NDArray[np.complex128]
Numbers = NDArray[Any]
"""real or complex"""

SIZE = 24
_ONE = np.eye(8)[0]


class Candidates(NamedTuple):
    """What the eigenvectors of m poses say."""

    q: ComplexArray
    """(m, 24, 6) joint angles [rad]"""
    isotropy: FloatArray
    """(m, 24) least |c² + s²| / (|c|² + |s|²) of the joints: 1 for a real turn, 0 for what is no turn"""
    error: FloatArray
    """(m, 24) how far rounding may have carried each [rad]; to first order"""


class ArmPencil:
    """The constants of one arm. Immutable."""

    def __init__(self, chain: Chain) -> None:
        points, axes = chain.axes()
        tool = chain.forward(np.zeros(chain.n))
        lengths = np.linalg.norm(np.diff(np.vstack([points, tool[:3, 3]]), axis=0), axis=1)
        self.unit = float(lengths.sum()) or 1.0
        """[m] lengths are taken over it; angles, over a radian, count as much"""
        points = points / self.unit
        zeros = np.zeros((6, 1))
        lines = np.concatenate([zeros, axes, zeros, np.cross(points, axes)], axis=1)
        self._first, self._last = lines[0], lines[5]
        self._T_tool_base = np.linalg.inv(tool)
        products = np.stack([_ONE, lines[1]])
        for line in lines[2:5]:
            products = product(products[..., None, :], np.stack([_ONE, line]))
        self._left: FloatArray = products
        """(2, 2, 2, 2, 8) the left side's monomials, c before s, joints 2 to 5"""

    def candidates(self, poses: Numbers, hidden: int, turn: float) -> Candidates:
        """Of tool poses ``T_base_tool`` (m, 4, 4) [m], real or complex.

        ``hidden``: which of the joints 2 to 5 (0 to 3) is in the coefficients; ``turn``: its angle that the
        eigenvalues see as infinite, plus half a turn [rad]. They change nothing but the rounding.
        """
        m = len(poses)
        g = dual_quaternions(poses @ self._T_tool_base, self.unit)
        ahead = product(self._first, g)
        span = np.stack([g, product(g, self._last), ahead, product(ahead, self._last)], axis=1)
        across = np.linalg.svd(span)[2][:, 4:].conj()
        C = np.moveaxis(np.einsum("mhd,ijkld->mhijkl", across, self._left), 2 + hidden, 2)
        c, s = math.cos(0.5 * turn), math.sin(0.5 * turn)
        A, B = np.zeros((2, m, SIZE, SIZE), dtype=C.dtype)
        row, column, equation, i, j, k = _PLACES
        A[:, row, column] = (c * C[:, :, 0] + s * C[:, :, 1])[:, equation, i, j, k]
        B[:, row, column] = (c * C[:, :, 1] - s * C[:, :, 0])[:, equation, i, j, k]
        M = -_solved(B, A)
        values, vectors = np.linalg.eig(M)
        error = _rounding(M, values, vectors)
        pairs = [np.stack([c - s * values, s + c * values], axis=-1), *_factors(vectors)]
        pairs.insert(hidden, pairs.pop(0))
        left = np.einsum("mni,mnj,mnk,mnl,ijkld->mnd", *pairs, self._left, optimize=_PATH)
        ends = np.linalg.pinv(span.swapaxes(1, 2)) @ left.swapaxes(1, 2)
        first, last = _ends(ends.swapaxes(1, 2))
        every = np.stack([first, *pairs, last], axis=2)
        square = every[..., 0] ** 2 + every[..., 1] ** 2
        isotropy = (np.abs(square) / (np.abs(every) ** 2).sum(axis=-1)).min(axis=-1)
        x, y = every[..., 0] + 1j * every[..., 1], every[..., 0] - 1j * every[..., 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            q = -1j * np.log(x / y)
        return Candidates(q, isotropy, error)


def _places() -> tuple[NDArray[np.intp], ...]:
    """Where the coefficients stand: row, column, and the equation and the monomial that they are of."""
    rows = [
        (6 * equation + 2 * p + r, 6 * (p + i) + 2 * (r + j) + k, equation, i, j, k)
        for equation in range(4) for p in range(3) for r in range(2)
        for i in range(2) for j in range(2) for k in range(2)
    ]  # fmt: skip
    return tuple(np.array(rows).T)


_PLACES = _places()
_PATH = ["einsum_path", (0, 4), (0, 3), (0, 2), (0, 1)]


def _solved(B: Numbers, A: Numbers) -> Numbers:
    """``B⁻¹ A`` of matrices (m, 24, 24); of a singular B with what rounding makes of it."""
    try:
        solved = np.linalg.solve(B, A)
    except np.linalg.LinAlgError:
        solved = np.linalg.solve(B + 1e-13 * np.random.default_rng(0).normal(size=B.shape[1:]), A)
    return solved


def _rounding(M: Numbers, values: ComplexArray, vectors: ComplexArray) -> FloatArray:
    """(m, 24) the error of each eigenvalue as an angle, and over its distance from the next of its vector.

    To first order: the eigenvalue's condition times the rounding of the matrix.
    """
    try:
        inverse = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:
        return np.full(values.shape, np.inf)
    condition = np.linalg.norm(vectors, axis=1) * np.linalg.norm(inverse, axis=2)
    size = np.linalg.norm(M, axis=(1, 2))[:, None]
    scale = 1.0 + np.abs(values) ** 2
    error = 2.0 * condition * np.finfo(float).eps * size / scale
    apart = np.abs(values[:, :, None] - values[:, None]) / np.sqrt(scale[:, :, None] * scale[:, None])
    apart += np.eye(SIZE)
    return error / np.minimum(1.0, apart.min(axis=2) + 1e-300)


def _factors(vectors: ComplexArray) -> list[ComplexArray]:
    """The pairs (m, 24, 2) of three joints, of eigenvectors (m, 24, 24) that hold their monomials."""
    m = len(vectors)
    monomials = vectors.swapaxes(1, 2).reshape(m, SIZE, 4, 3, 2)
    pairs: list[ComplexArray] = []
    for axis in (2, 3, 4):
        along = np.moveaxis(monomials, axis, -1)
        low, high = along[..., :-1].reshape(m, SIZE, -1), along[..., 1:].reshape(m, SIZE, -1)
        largest = (np.abs(low) ** 2 + np.abs(high) ** 2).argmax(axis=2)[..., None]
        pair = [np.take_along_axis(part, largest, axis=2)[..., 0] for part in (low, high)]
        pairs.append(np.stack(pair, axis=-1))
    return pairs


def _ends(products: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """The pairs (m, 24, 2) of the first and the last joint, of (m, 24, 4) c1 c6, -c1 s6, -s1 c6, s1 s6."""
    table = products.reshape(*products.shape[:2], 2, 2) * np.array([[1.0, -1.0], [-1.0, 1.0]])
    size = np.abs(table) ** 2
    column = size.sum(axis=2).argmax(axis=2)[..., None, None]
    row = size.sum(axis=3).argmax(axis=2)[..., None, None]
    first = np.take_along_axis(table, column, axis=3)[..., 0]
    last = np.take_along_axis(table, row, axis=2)[:, :, 0]
    return first, last


# Dual quaternions: eight numbers, the real part w, x, y, z before the dual one.


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """The product (..., 8) of dual quaternions."""
    p, q = a[..., :4], b[..., :4]
    dual = quaternion_product(p, b[..., 4:]) + quaternion_product(a[..., 4:], q)
    return np.concatenate([quaternion_product(p, q), dual], axis=-1)


def dual_quaternions(poses: Numbers, unit: float) -> Numbers:
    """Of poses (m, 4, 4) [m], lengths over ``unit``: (m, 8), of either sign."""
    R = poses[:, :3, :3]
    # the largest column of 4 r rᵀ, so that nothing is lost by cancelling
    outer = np.empty((len(R), 4, 4), dtype=R.dtype)
    diagonal = R[:, [0, 1, 2], [0, 1, 2]]
    outer[:, 0, 0] = 1.0 + diagonal.sum(axis=1)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        outer[:, i + 1, i + 1] = 1.0 + diagonal[:, i] - diagonal[:, j] - diagonal[:, k]
        outer[:, 0, i + 1] = outer[:, i + 1, 0] = R[:, k, j] - R[:, j, k]
        outer[:, i + 1, j + 1] = outer[:, j + 1, i + 1] = R[:, i, j] + R[:, j, i]
    largest = np.abs(np.diagonal(outer, axis1=1, axis2=2)).argmax(axis=1)
    r = outer[np.arange(len(R)), largest]
    r /= np.sqrt((r * r).sum(axis=1))[:, None]
    t = np.concatenate([np.zeros((len(R), 1)), poses[:, :3, 3] / unit], axis=1)
    return np.concatenate([r, 0.5 * quaternion_product(t, r)], axis=1)


# All configurations of a pose, followed from those of a complex pose beside it.
#
# Where the last axis is parallel to the first, or two configurations come close to each other, rounding
# hides some of the eigenvalues. A complex pose at some distance has none of these troubles. On the way from
# there to the pose that is asked for, each of its configurations moves on a path of its own: almost no way
# through complex poses has a singular one on it but at its end (A. J. Sommese and C. W. Wampler, "The
# numerical solution of systems of polynomials", 2005, chapter 7). So where all paths have been followed,
# all configurations are known: those at which a path ends. Two paths end in a double one, which is
# singular.

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
