"""Serial chains of revolute joints: forward kinematics, Jacobian and frames, for one pose and for many.

A chain is a fixed transform ahead of each joint, which turns about z, and a tail behind the last one. It is
built from Denavit-Hartenberg rows or from the joints of a URDF file. In a parallel linkage a link turns by a
sum of joint angles (``coupling``), as the hand of a palletiser, which rods keep level.

Everything is built on two loops over the segments: ``Chain._walk`` in plain floats for one pose, for which
numpy would take three times as long, and ``Chain.walk`` in numpy for many.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, partial
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.arrays import ByContent, FloatArray
from armctl.errors import InputError
from armctl.kinematics.angles import LIMIT_TOLERANCE, half_angle_cos_sin
from armctl.kinematics.frames import Convention, DHRow, FixedFrame, LinkFrames, dh_frames, frame_along
from armctl.kinematics.subproblems import cross
from armctl.kinematics.target import as_numbers, require_finite

_FLOAT = np.dtype(np.float64)
_EYE = np.eye(4)
_CHUNK = 8192
"""configurations worked on at a time, so that what they need stays in the processor's cache"""
_put_pose = struct.Struct("16d").pack_into  # half of the time that an array takes to be made of numbers


class TurnLimit(NamedTuple):
    """How far a link of a parallel linkage may turn against the one ahead: as ``Chain.turns`` [rad]."""

    link: int
    lower: float
    upper: float
    name: str
    """of that angle, for messages"""


class Chain(ByContent):
    """A chain of n revolute joints. Immutable; safe in several threads.

    Frames are named ``T_base_x``: x seen from the base. Link j turns with joint j about its own z axis, or,
    with a ``coupling``, by row j of it times the joint angles.
    """

    def __init__(
        self,
        segments: Sequence[FloatArray],
        tail: FloatArray,
        *,
        places: Sequence[FixedFrame] = (),
        rows: Sequence[DHRow] = (),
        convention: Convention | None = None,
        coupling: ArrayLike | None = None,
        turn_limits: Sequence[TurnLimit] = (),
    ) -> None:
        """Of m poses (4, 4) of a turning link's frame in the link ahead, and of the tool in the last link.

        ``rows`` are the DH rows that say the same, if there are any, and ``places`` the base and the frames
        behind them; without rows: the base, the links, the tool. ``coupling`` (m, n): the turn of each link
        by a turn of each joint; None: each link has its own joint. ``turn_limits``: of links, besides those
        of the joints.
        """
        if not segments:
            raise InputError("a chain needs at least one row with a joint")
        self.segments, self.tail = tuple(segments), tail
        self.coupling = None if coupling is None else _checked_coupling(coupling, len(segments))
        """(m, n) read-only, or None"""
        self.turn_limits = tuple(turn_limits)
        """what configurations must keep besides the limits of each joint (``turn_excess``)"""
        self.n = len(segments) if self.coupling is None else self.coupling.shape[1]
        """number of joints"""
        self.rows, self.convention = tuple(rows), convention
        self.places = tuple(places) or (
            FixedFrame(-1, np.eye(4)),
            *(FixedFrame(j, np.eye(4)) for j in range(len(segments))),
            FixedFrame(len(segments) - 1, tail),
        )
        """frames along the chain, as ``frames`` lists them"""
        if self.rows:
            self.joint_rows = tuple(i for i, row in enumerate(self.rows) if row.joint)
        else:
            self.joint_rows = tuple(range(len(self.segments)))
        """of each link, the index of the DH row that turns; the frame behind it is the next of ``places``"""
        for shared in (*self.segments, self.tail, *(place.T_link_frame for place in self.places)):
            shared.flags.writeable = False
        self._steps = [_step(T) for T in (*self.segments, tail)]
        self._columns = [np.ascontiguousarray(T.T) for T in (*self.segments, tail)]
        self._one_shape = (self.n,)
        self._place_links = [place.link for place in self.places]
        self._T_link_places = np.stack([place.T_link_frame for place in self.places])

    def __repr__(self) -> str:
        links = "" if self.coupling is None else f", {len(self.segments)} links"
        return f"Chain({self.n} joints{links})"

    @cached_property
    def length(self) -> float:
        """From the base frame to the tool point, all links stretched [m]."""
        tool = self.forward(np.zeros(self.n))[:3, 3]
        # no joint changes how far two corners in a row are apart
        corners = np.vstack([np.zeros(3), self.axes()[0], tool])
        return float(np.linalg.norm(np.diff(corners, axis=0), axis=1).sum())

    def made_of(self) -> tuple[Any, ...]:
        """See ``ByContent``; what follows the first two is given by keywords."""
        says = self.segments, self.tail, self.places, self.rows, self.convention, self.coupling
        return (*says, self.turn_limits)

    def __reduce__(self) -> tuple[Callable[..., Chain], tuple[object, ...]]:
        segments, tail, *says = self.made_of()
        names = ("places", "rows", "convention", "coupling", "turn_limits")
        return partial(type(self), **dict(zip(names, says, strict=True))), (segments, tail)

    @classmethod
    def from_dh(
        cls,
        rows: Sequence[DHRow],
        convention: Convention = "standard",
        coupling: ArrayLike | None = None,
        turn_limits: Sequence[TurnLimit] = (),
    ) -> Self:
        """A chain of DH rows; ``coupling`` (m, n) of the m rows that turn, ``turn_limits`` as of ``Chain``.

        Standard (distal) rows are ``Rz(theta) Tz(d) Tx(a) Rx(alpha)``, modified (Craig, proximal) rows
        ``Rx(alpha) Tx(a) Rz(theta) Tz(d)``.
        Raises ``InputError``: no such convention, a number that is not finite, or no joint.
        """
        segments, places = dh_frames(rows, convention)
        return cls(
            segments, places[-1].T_link_frame, places=places, rows=rows, convention=convention,
            coupling=coupling, turn_limits=turn_limits,
        )  # fmt: skip

    @classmethod
    def from_joints(cls, origins: Sequence[FloatArray], axes: Sequence[FloatArray], tool: FloatArray) -> Self:
        """A chain of joints as URDF has them.

        ``origins`` are n poses (4, 4) [m] of each joint's frame, at zero, in the frame that the joint ahead
        turns (the first one: in the base frame), ``axes`` unit vectors (3,) in the joints' own frames, and
        ``tool`` (4, 4) is the tool frame in the frame that the last joint turns.
        """
        upright = [frame_along(axis) for axis in axes]
        back = [np.eye(4), *(T.T for T in upright)]
        segments = [T @ origin @ turn for T, origin, turn in zip(back[:-1], origins, upright, strict=True)]
        return cls(segments, back[-1] @ tool)

    @property
    def first_links(self) -> tuple[int, ...]:
        """Index of the first link that each joint turns."""
        if self.coupling is None:
            return tuple(range(self.n))
        return tuple(int(np.flatnonzero(column)[0]) for column in self.coupling.T)

    def turns(self, q: FloatArray) -> FloatArray:
        """How far each link turns (..., m) [rad] at joint angles ``q`` (..., n)."""
        return q if self.coupling is None else q @ self.coupling.T

    def turn_rows(self) -> FloatArray:
        """(k, n) what each of k ``turn_limits`` makes of the joint angles: its link turns by ``row @ q``."""
        return self.turns(np.eye(self.n)).T[[limit.link for limit in self.turn_limits]]

    def turn_excess(self, q: FloatArray) -> FloatArray:
        """By how much ``q`` (..., n) passes each of k ``turn_limits``: (..., k) [rad], negative inside."""
        if not self.turn_limits:
            return np.empty((*q.shape[:-1], 0))
        turns = self.turns(q)[..., [limit.link for limit in self.turn_limits]]
        low = np.array([limit.lower for limit in self.turn_limits])
        high = np.array([limit.upper for limit in self.turn_limits])
        return np.maximum(low - turns, turns - high)

    def keeps_turns(self, q: FloatArray) -> NDArray[np.bool_]:
        """Where ``q`` (..., n) keeps all ``turn_limits``: (...)."""
        return np.asarray((self.turn_excess(q) <= LIMIT_TOLERANCE).all(axis=-1))

    def turns_beyond(self, q: FloatArray) -> list[tuple[TurnLimit, float]]:
        """The ``turn_limits`` that ``q`` (n,) does not keep, and what each link turns by there [rad]."""
        if not self.turn_limits:
            return []
        turns, excess = self.turns(q), self.turn_excess(q)
        limits = zip(self.turn_limits, excess.tolist(), strict=True)
        return [(limit, float(turns[limit.link])) for limit, over in limits if over > LIMIT_TOLERANCE]

    def without_turn_limits(self) -> Chain:
        """The same, whatever its links turn by."""
        if not self.turn_limits:
            return self
        segments, tail, places, rows, convention, coupling, _ = self.made_of()
        return Chain(segments, tail, places=places, rows=rows, convention=convention, coupling=coupling)

    @cached_property
    def links_alone(self) -> Chain:
        """The chain of the links, each turned by a joint of its own: no coupling, no limits."""
        return Chain(self.segments, self.tail)

    def with_last_held(self, angle: float) -> Chain:
        """The chain of the joints before the last one, which is held at an angle [rad].

        ``InputError``: a parallel linkage, whose links follow several joints.
        """
        if self.coupling is not None:
            raise InputError("of a parallel linkage no joint can be held by itself: its links follow several")
        T = np.eye(4)
        c, s = math.cos(angle), math.sin(angle)
        T[:2, :2] = [[c, -s], [s, c]]
        return Chain(self.segments[:-1], self.segments[-1] @ T @ self.tail)

    def checked(self, q: ArrayLike) -> FloatArray:
        """``q`` as an array ``(..., n)`` of finite numbers; a copy. Raises ``InputError`` for any other."""
        numbers = self._shaped(q)
        require_finite(numbers, "joint angles")
        return numbers.copy()

    def _shaped(self, q: ArrayLike) -> FloatArray:
        numbers = q if type(q) is np.ndarray and q.dtype is _FLOAT else as_numbers(q, "joint angles")
        if numbers.ndim == 0 or numbers.shape[-1] != self.n:
            raise InputError(f"{self.n} joint angles are needed, got an array of shape {numbers.shape}")
        return numbers

    def checked_one(self, q: ArrayLike) -> FloatArray:
        """As ``checked``, of one configuration (n,)."""
        numbers = self.checked(q)
        if numbers.ndim != 1:
            raise InputError(f"{self.n} joint angles are needed, got an array of shape {numbers.shape}")
        return numbers

    def forward(self, q: ArrayLike) -> FloatArray:
        """Pose of the tool frame ``T_base_tool`` (..., 4, 4) [m] at joint angles ``q`` (..., n) [rad].

        Raises ``InputError``: ``q`` has the wrong shape or is not finite.
        """
        angles = self._one(q)
        if angles is not None:
            return _pose(self._walk(self._link_turns(angles)))
        return self._many(q, (4, 4), self._forward_into)

    def jacobian(self, q: ArrayLike) -> FloatArray:
        """Geometric Jacobian (..., 6, n) of the tool point in the base frame at ``q`` (..., n) [rad].

        Column i is ``(z_i x (p_tool - p_i), z_i)``: linear [m] over angular velocity for one rad/s.
        """
        angles = self._one(q)
        if angles is not None:
            links: list[tuple[float, ...]] = []
            return self._columns_of(self._walk(self._link_turns(angles), links), links)
        return self._many(q, (6, self.n), self._jacobian_into)

    def pose_and_jacobian(self, q: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """``forward`` and ``jacobian`` of the same joint angles; of one configuration in half of the time."""
        angles = self._one(q)
        if angles is None:
            return self.forward(q), self.jacobian(q)
        links: list[tuple[float, ...]] = []
        tool = self._walk(self._link_turns(angles), links)
        return _pose(tool), self._columns_of(tool, links)

    def _columns_of(self, tool: tuple[float, ...], links: list[tuple[float, ...]]) -> FloatArray:
        """The Jacobian (6, n) where the tool frame and the links are as ``_walk`` gives them."""
        tx, ty, tz = tool[9:]
        columns: list[float] = []
        for *_, x, y, z, px, py, pz in links:
            px, py, pz = tx - px, ty - py, tz - pz
            columns += y * pz - z * py, z * px - x * pz, x * py - y * px, x, y, z
        J = np.array(columns).reshape(-1, 6).T
        return J.copy() if self.coupling is None else J @ self.coupling

    def frames(self, q: ArrayLike) -> FloatArray:
        """Poses ``T_base_frame`` (..., len(places), 4, 4) [m] of ``places`` at ``q`` (..., n) [rad].

        The base first, the tool frame last. A chain of DH rows has a frame behind each row, another one a
        frame for each link and the tool.
        """
        angles = self._one(q)
        if angles is not None:
            walked: list[tuple[float, ...]] = []
            self._walk(self._link_turns(angles), walked)
            T_base_link = np.tile(_EYE, (len(walked) + 1, 1, 1))  # the last one is the base, link -1
            T_base_link[:-1, :3] = np.array(walked).reshape(-1, 4, 3).swapaxes(1, 2)
            return np.matmul(T_base_link[self._place_links], self._T_link_places)
        q = self.checked(q)
        links = LinkFrames.at(self, q.reshape(-1, self.n))
        out = np.zeros((q.size // self.n, len(self.places), 4, 4))
        out[..., 3, 3] = 1.0
        for i, (link, T) in enumerate(self.places):
            if link < 0:
                out[:, i] = T
                continue
            R = np.moveaxis(links.rotation[link], -1, 0)
            out[:, i, :3, :3] = R @ T[:3, :3]
            out[:, i, :3, 3] = R @ T[:3, 3] + links.origin[link].T
        return out.reshape(*q.shape[:-1], len(self.places), 4, 4)

    def axes(self, q: ArrayLike | None = None) -> tuple[FloatArray, FloatArray]:
        """Links' axes at ``q`` (default: all zero): points (m, 3) [m], unit directions (m, 3), base frame."""
        stacked = np.array(self.link_frames(np.zeros(self.n) if q is None else self.checked_one(q)))
        return stacked[:, 9:].copy(), stacked[:, 6:9].copy()

    def link_frames(self, q: FloatArray) -> list[tuple[float, ...]]:
        """Each link at ``q`` (n,) [rad] in plain floats: x, y, z axis and origin [m], base frame, 3 each.

        Raises ``InputError``: ``q`` has the wrong shape or is not finite.
        """
        links: list[tuple[float, ...]] = []
        self._walk(self._link_turns(self._one(q) or self.checked_one(q).tolist()), links)
        return links

    def _one(self, q: ArrayLike) -> list[float] | None:
        """``q`` as the angles of one configuration; None where it holds many."""
        if not (type(q) is np.ndarray and q.dtype is _FLOAT and q.shape == self._one_shape):
            q = self.checked(q)
            return q.tolist() if q.ndim == 1 else None
        angles: list[float] = q.tolist()
        if not math.isfinite(sum(angles)):
            require_finite(q, "joint angles")
        return angles

    def _link_turns(self, angles: list[float]) -> list[float]:
        return angles if self.coupling is None else (self.coupling @ angles).tolist()

    def _walk(
        self, angles: Sequence[float], links: list[tuple[float, ...]] | None = None
    ) -> tuple[float, ...]:
        """The tool frame where the links turn by ``angles`` (m,) [rad]: x, y, z axis, origin, 3 numbers each.

        ``links`` receives the same of each link.

        Lengths of zero and axes that are parallel or at a right angle, as DH rows mostly have them, are not
        multiplied out: that halves the time of one pose.
        """
        xx, xy, xz, yx, yy, yz, zx, zy, zz = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
        px = py = pz = 0.0
        cos, sin = math.cos, math.sin
        for (u, v, w, quarter, rotation), angle in zip(self._steps, (*angles, 0.0), strict=True):
            if u:
                px, py, pz = px + u * xx, py + u * xy, pz + u * xz
            if v:
                px, py, pz = px + v * yx, py + v * yy, pz + v * yz
            if w:
                px, py, pz = px + w * zx, py + w * zy, pz + w * zz
            if quarter == 1:
                yx, yy, yz, zx, zy, zz = zx, zy, zz, -yx, -yy, -yz
            elif quarter == -1:
                yx, yy, yz, zx, zy, zz = -zx, -zy, -zz, yx, yy, yz
            elif quarter is None:
                a, b, c, d, e, f, g, h, i = rotation
                xx, yx, zx = a * xx + b * yx + c * zx, d * xx + e * yx + f * zx, g * xx + h * yx + i * zx
                xy, yy, zy = a * xy + b * yy + c * zy, d * xy + e * yy + f * zy, g * xy + h * yy + i * zy
                xz, yz, zz = a * xz + b * yz + c * zz, d * xz + e * yz + f * zz, g * xz + h * yz + i * zz
            if angle:
                c, s = cos(angle), sin(angle)
                xx, yx = c * xx + s * yx, c * yx - s * xx
                xy, yy = c * xy + s * yy, c * yy - s * xy
                xz, yz = c * xz + s * yz, c * yz - s * xz
            if links is not None:
                links.append((xx, xy, xz, yx, yy, yz, zx, zy, zz, px, py, pz))
        if links is not None:
            links.pop()  # the tail is no link
        return xx, xy, xz, yx, yy, yz, zx, zy, zz, px, py, pz

    def _many(
        self, q: ArrayLike, shape: tuple[int, int], fill: Callable[[FloatArray, FloatArray], None]
    ) -> FloatArray:
        """A matrix of each configuration (..., n): (..., *shape)."""
        q = self._shaped(q)
        flat = q.reshape(-1, self.n)
        out = np.zeros((*shape, len(flat)))  # entry by entry in memory: contiguous to write
        for i in range(0, len(flat), _CHUNK):
            part = flat[i : i + _CHUNK]
            if not math.isfinite(float(part.sum())):
                require_finite(q, "joint angles")
            fill(part, out[..., i : i + _CHUNK])
        return np.moveaxis(out.reshape(*shape, *q.shape[:-1]), (0, 1), (-2, -1))

    def _forward_into(self, q: FloatArray, out: FloatArray) -> None:
        *_, frame = self.walk(q)
        out[:3] = frame.swapaxes(0, 1)
        out[3, 3] = 1.0

    def _jacobian_into(self, q: FloatArray, out: FloatArray) -> None:
        *links, (_, _, _, tool) = self.walk(q)
        for i, (_, _, axis, origin) in enumerate(links):
            linear = np.stack(cross(axis, tool - origin))
            if self.coupling is None:
                out[:3, i], out[3:, i] = linear, axis
                continue
            for j in np.flatnonzero(self.coupling[i]).tolist():
                out[:3, j] += self.coupling[i, j] * linear
                out[3:, j] += self.coupling[i, j] * axis

    def walk(self, q: FloatArray) -> Iterator[FloatArray]:
        """The frame of each link, then the tool frame, at finite ``q`` (m, n) [rad].

        Yields (4, 3, m): x, y, z axis and origin [m], base frame.
        """
        cos, sin = half_angle_cos_sin(np.ascontiguousarray((q if self.coupling is None else self.turns(q)).T))
        m = len(q)
        frame = np.zeros((4, 3, m))
        frame[0, 0] = frame[1, 1] = frame[2, 2] = 1.0
        for k, columns in enumerate(self._columns):
            frame = (columns @ frame.reshape(4, 3 * m)).reshape(4, 3, m)
            if k < len(self.segments):
                c, s = cos[k], sin[k]
                x, y = frame[:2]
                frame[0], frame[1] = c * x + s * y, c * y - s * x
            yield frame


def _pose(frame: tuple[float, ...]) -> FloatArray:
    """(4, 4) of a frame as ``Chain._walk`` gives it."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz, px, py, pz = frame
    out = np.empty((4, 4))
    _put_pose(out.data, 0, xx, yx, zx, px, xy, yy, zy, py, xz, yz, zz, pz, 0.0, 0.0, 0.0, 1.0)
    return out


def _checked_coupling(coupling: ArrayLike, links: int) -> FloatArray:
    C = as_numbers(coupling, "a coupling").copy()
    require_finite(C, "a coupling")
    if C.ndim != 2 or len(C) != links or np.linalg.matrix_rank(C) != C.shape[1]:
        raise InputError(
            f"a coupling has one row for each of {links} links and a column for each joint, and each joint "
            f"turns a link of its own; this one has the shape {C.shape}"
        )
    C.flags.writeable = False
    return C


def _step(T: FloatArray) -> tuple[float, float, float, int | None, tuple[float, ...]]:
    """A fixed transform (4, 4) for ``Chain._walk``: shift, quarter turns about x (None: other), rotation."""
    rotations = {0: np.eye(3), 1: np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])}
    rotations[-1] = rotations[1].T
    quarter = next((k for k, R in rotations.items() if np.array_equal(R, T[:3, :3])), None)
    x, y, z = T[:3, 3].tolist()
    return x, y, z, quarter, tuple(T[:3, :3].T.ravel().tolist())
