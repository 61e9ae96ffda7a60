"""Trajectories as they travel: curves as numbers, counted before they are decoded."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated

import msgspec
import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.motion import Trajectory
from armctl.motion.polynomial import MOST_COEFFICIENTS, PiecewisePolynomial
from armctl.motion.profiles import PointToPoint
from armctl.motion.timing import PathTrajectory
from armctl.motion.trajectory import JoinedTrajectory, SlowedTrajectory

MOST_PIECES, _MOST_NUMBERS = 20_000, 1_000_000
"""of one curve"""
_MOST_PARTS, _DEEPEST = 1_000, 8
"""of one trajectory, and how many of them may be inside each other"""
_MOST_JOINTS = 64
_LONGEST_PIECE = 16 * 1024
"""bytes of a piece of a curve"""


class Curve(msgspec.Struct, frozen=True):
    """A ``PiecewisePolynomial``.

    A piece waits in its bytes: what arrives is counted before it is decoded, and a list of Python is thirty
    times as large as its bytes.
    """

    breaks: Annotated[list[float], msgspec.Meta(max_length=MOST_PIECES + 1)]
    coefficients: list[msgspec.Raw]
    """(k, degree + 1, n)"""

    @classmethod
    def of(cls, curve: PiecewisePolynomial) -> Curve:
        """As numbers."""
        return cls(curve.breaks.tolist(), curve.coefficients.tolist())

    def built(self) -> PiecewisePolynomial:
        """The curve; ``InputError`` where the numbers are none."""
        if len(self.coefficients) > MOST_PIECES:
            raise InputError(f"a curve of {len(self.coefficients)} pieces; {MOST_PIECES} at most")
        coefficients: FloatArray | None = None
        for k, raw in enumerate(self.coefficients):
            piece = _piece(raw)
            if coefficients is None:
                if piece.size * len(self.coefficients) > _MOST_NUMBERS:
                    raise InputError(
                        f"a curve of {piece.size * len(self.coefficients)} numbers; {_MOST_NUMBERS} at most"
                    )
                coefficients = np.empty((len(self.coefficients), *piece.shape))
            if piece.shape != coefficients.shape[1:]:
                raise InputError(f"piece {k + 1} of a curve has another number of coefficients, or joints")
            coefficients[k] = piece
        return PiecewisePolynomial(self.breaks, np.zeros((0, 1, 1)) if coefficients is None else coefficients)


def _piece(raw: msgspec.Raw) -> FloatArray:
    """(degree + 1, n) the coefficients of a piece, as it arrived, in JSON or msgpack."""
    data = bytes(raw)
    if len(data) > _LONGEST_PIECE:
        raise InputError(
            f"a piece of a curve in {len(data)} bytes: it has {MOST_COEFFICIENTS} coefficients at most, "
            f"of {_MOST_JOINTS} joints"
        )
    wire = msgspec.json if data.lstrip()[:1] == b"[" else msgspec.msgpack
    rows = wire.decode(data, type=list[list[float]])
    if not rows or any(len(row) != len(rows[0]) for row in rows):
        raise InputError("a piece of a curve needs a row of coefficients for each power, of one length")
    if len(rows) > MOST_COEFFICIENTS or len(rows[0]) > _MOST_JOINTS:
        raise InputError(
            f"a piece of a curve has {len(rows)} coefficients of {len(rows[0])} joints; "
            f"{MOST_COEFFICIENTS} of {_MOST_JOINTS} at most"
        )
    return np.array(rows, dtype=np.float64)


class Straight(msgspec.Struct, frozen=True, tag="straight"):
    """A ``PointToPoint``."""

    start: Annotated[list[float], msgspec.Meta(max_length=_MOST_JOINTS)]
    end: Annotated[list[float], msgspec.Meta(max_length=_MOST_JOINTS)]
    duration: float
    way: Curve | None


class Path(msgspec.Struct, frozen=True, tag="path"):
    """A ``PathTrajectory``: ``curve`` (n,) [rad] over s, ``law`` s over time [s]."""

    curve: Curve
    law: Curve


class Slowed(msgspec.Struct, frozen=True, tag="slowed"):
    """A ``SlowedTrajectory``."""

    motion: Straight | Path | Slowed | Joined
    factor: float


class Joined(msgspec.Struct, frozen=True, tag="joined"):
    """A ``JoinedTrajectory``."""

    parts: Annotated[list[Straight | Path | Slowed | Joined], msgspec.Meta(max_length=_MOST_PARTS)]


Motion = Straight | Path | Slowed | Joined


def carried(trajectory: Trajectory) -> Motion:
    """A trajectory as numbers; one of the caller's own class by its samples."""
    match trajectory:
        case PointToPoint():
            way = None if trajectory.way is None else Curve.of(trajectory.way)
            return Straight(trajectory.start.tolist(), trajectory.end.tolist(), trajectory.duration, way)
        case PathTrajectory():
            return Path(Curve.of(trajectory.path), Curve.of(trajectory.law))
        case SlowedTrajectory():
            return Slowed(carried(trajectory.inner), trajectory.factor)
        case JoinedTrajectory():
            return Joined([carried(part) for part in trajectory.parts])
        case _:
            return carried(PathTrajectory.sampled(trajectory))


def built(motion: Motion) -> Trajectory:
    """The trajectory; ``InputError`` where the numbers are none, or it has more parts than any needs."""
    left = _MOST_PARTS

    def inside(motion: Motion, depth: int) -> Trajectory:
        nonlocal left
        left -= 1
        if left < 0:
            raise InputError(f"a trajectory has more than {_MOST_PARTS} parts")
        if depth > _DEEPEST:
            raise InputError(f"a trajectory has more than {_DEEPEST} others inside each other")
        return _built(motion, lambda part: inside(part, depth + 1))

    return inside(motion, 1)


def _built(motion: Motion, inside: Callable[[Motion], Trajectory]) -> Trajectory:
    match motion:
        case Straight(start, end, duration, way):
            if not (math.isfinite(duration) and duration >= 0):
                raise InputError(f"a motion lasts 0 s or longer, not {duration}")
            q = [np.array(ends, dtype=np.float64) for ends in (start, end)]
            if q[0].shape != q[1].shape or not np.isfinite(q).all():
                raise InputError("a motion needs finite joint angles at both ends")
            for ends in q:
                ends.flags.writeable = False
            curve = None if way is None else way.built()
            if curve is not None and curve.n != len(q[0]):
                raise InputError(f"a motion of {len(q[0])} joints has a curve of {curve.n}")
            return PointToPoint(q[0], q[1], duration, curve)
        case Path(curve, law):
            return PathTrajectory(curve.built(), law.built())
        case Slowed(inner, factor):
            return SlowedTrajectory(inside(inner), factor)
        case Joined(parts):
            return JoinedTrajectory([inside(part) for part in parts])
