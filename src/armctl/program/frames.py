"""User frames: named frames of a program, taught by three touches, and the step that chooses one."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Self, TypeVar, cast

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.facts import CellOutsideGrid, Reason, UnknownFrame
from armctl.facts.angles import from_degrees, to_degrees
from armctl.kinematics import roll_pitch_yaw, rotation_from_rpy
from armctl.kinematics.target import as_numbers
from armctl.program.base_steps import BlockStep, Field, Step

BASE = "base"
MOST_FRAMES, FARTHEST_MM = 100, 100_000.0
NEAREST_MM, LEAST_SINE = 5.0, 0.1
"""Nearer touches, or a third one that lies flatter beside the first two, leave the axes to chance."""
_DIGITS = 3
"""of what is taught: micrometres, and thousandths of a degree"""
_RPY = ("rx_deg", "ry_deg", "rz_deg")
NAME_OF_FRAME = re.compile(r"\w[\w .+-]{0,39}")
FrameName = Annotated[str, Meta(pattern=f"^{NAME_OF_FRAME.pattern}$")]
_Place = Annotated[float, Meta(ge=-FARTHEST_MM, le=FARTHEST_MM)]
_Angle = Annotated[float, Meta(ge=-360, le=360)]


class UserFrame(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where a frame is, in the base frame: its origin, and its turn Rz(rz)·Ry(ry)·Rx(rx)."""

    x_mm: _Place
    y_mm: _Place
    z_mm: _Place
    rx_deg: _Angle = 0.0
    ry_deg: _Angle = 0.0
    rz_deg: _Angle = 0.0

    @property
    def matrix(self) -> FloatArray:
        """``T_base_frame`` (4, 4), lengths in mm."""
        T = np.eye(4)
        T[:3, :3] = rotation_from_rpy(*map(from_degrees, (self.rx_deg, self.ry_deg, self.rz_deg)))
        T[:3, 3] = self.x_mm, self.y_mm, self.z_mm
        return T

    @classmethod
    def taught(cls, origin_mm: ArrayLike, on_x_mm: ArrayLike, beside_mm: ArrayLike) -> Self:
        """From three points (3,) in the base frame [mm]: the origin, one on +x, one on the side of +y.

        With a = on_x − origin and b = beside − origin: x = a/‖a‖, z = x × b/‖x × b‖, y = z × x. So the second
        point gives a direction only, and the third only the half plane of x and y. InputError: points too
        near to each other, or in one line.
        """
        points = _points(origin_mm, on_x_mm, beside_mm)
        x, y = _sides(points)
        z: FloatArray = np.asarray(np.cross(x, y), dtype=np.float64)
        angles = to_degrees(roll_pitch_yaw(np.stack([x, y, z], axis=1))).tolist()
        rx, ry, rz = (round(angle, _DIGITS) + 0.0 for angle in angles)
        x_mm, y_mm, z_mm = (round(value, _DIGITS) + 0.0 for value in points[0].tolist())
        return cls(x_mm=x_mm, y_mm=y_mm, z_mm=z_mm, rx_deg=rx, ry_deg=ry, rz_deg=rz)

    def describe(self) -> str:
        """Its numbers in words."""
        place = ", ".join(map(number_words, (self.x_mm, self.y_mm, self.z_mm)))
        turn = ", ".join(map(number_words, (self.rx_deg, self.ry_deg, self.rz_deg)))
        return f"({place}) mm, Rx Ry Rz ({turn})°"


def turn_errors(
    origin_mm: ArrayLike, on_x_mm: ArrayLike, beside_mm: ArrayLike, touch_mm: float
) -> FloatArray:
    """How far a frame that was taught by three touches may be turned about its x, y and z, (3,) [rad].

    ``touch_mm``: standard deviation of each coordinate of each touch; to first order, and they are
    independent. In the frame the second touch is (a, 0, 0), the third (b, h, 0). A touch that is off by e
    turns it about z by (e₂y − e₁y)/a, about y by −(e₂z − e₁z)/a, about x by (e₃z − e₁z − (b/a)(e₂z − e₁z))/h.
    """
    points = _points(origin_mm, on_x_mm, beside_mm)
    x, y = _sides(points)
    a = float(np.linalg.norm(points[1] - points[0]))
    b, h = float((points[2] - points[0]) @ x), float((points[2] - points[0]) @ y)
    about_x = np.sqrt(1 + (1 - b / a) ** 2 + (b / a) ** 2) / h
    return touch_mm * np.array([about_x, np.sqrt(2) / a, np.sqrt(2) / a])


def _points(*points_mm: ArrayLike) -> FloatArray:
    """(3, 3) of three touches, which must be apart."""
    points = np.stack([as_numbers(point, "a touched point").ravel() for point in points_mm])
    if points.shape != (3, 3) or not np.isfinite(points).all():
        raise InputError("a frame is taught by three points, X, Y, Z each")
    for one, other in ((0, 1), (0, 2), (1, 2)):
        if (near := float(np.linalg.norm(points[one] - points[other]))) < NEAREST_MM:
            raise InputError(
                f"the {_TOUCHES[one]} and the {_TOUCHES[other]} are {near:.1f} mm apart; at least "
                f"{NEAREST_MM:g} mm, and the farther the truer"
            )
    return points


_TOUCHES = ("origin", "point on +x", "point on the +y side")


def _sides(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors along x and y."""
    along, beside = points[1] - points[0], points[2] - points[0]
    x = along / np.linalg.norm(along)
    across = beside - (beside @ x) * x
    off = float(np.linalg.norm(across))
    if off < LEAST_SINE * np.linalg.norm(beside):
        angle = float(np.rad2deg(np.arcsin(off / np.linalg.norm(beside))))
        raise InputError(
            f"the point on the +y side lies {off:.1f} mm beside the x axis, {angle:.1f}° seen from the "
            f"origin; at least {np.rad2deg(np.arcsin(LEAST_SINE)):.1f}°: touch it farther aside"
        )
    return x, across / off


# Which frame a step is in.


class FrameStep(Step, frozen=True, kw_only=True, tag="frame"):
    """Give the points of the steps below it in a user frame of the program; ``base`` goes back.

    It counts down the list as far as the next ``frame`` step, and no farther than the end of its block:
    which way a program takes changes nothing. Points, lines, arcs, grids and drawings are in the frame, with
    an orientation that is given in angles. A pitch or a roll stays that of the arm: above the horizontal.
    """

    icon: ClassVar = "frame"
    acts: ClassVar[bool] = False
    button: ClassVar = ("Program", "Frame", "frame")

    frame: Annotated[str, Field("Frame", "A frame of the program, or base.", 11, choices=(BASE,))] = BASE

    def describe(self) -> str:
        """Its name."""
        return self.frame


def markers_of(steps: Sequence[Step]) -> set[type[Step]]:
    """The kinds among some steps that begin, divide or close a block: few of 10,000 steps are of one."""
    kinds = {type(step) for step in steps}
    return {kind for kind in kinds if issubclass(kind, BlockStep) or kind.divides or kind.closes}


class Placing:
    """In which frame each step of a program has its points: the same for every pass, on every path."""

    def __init__(self, steps: Sequence[Step], frames: Mapping[str, UserFrame]) -> None:
        self.names: list[str] = []
        """one a step: the frame of its points; in a cell, that of its grid"""
        self.unknown: dict[int, Reason] = {}
        """steps that name a frame which the program has not"""
        self.no_cell: dict[int, Reason] = {}
        """steps in a cell without a grid around them"""
        self._frames = {name: frame.matrix for name, frame in frames.items()}
        around: list[tuple[str, str | None]] = [(BASE, None)]
        markers = {*markers_of(steps), FrameStep}
        for index, step in enumerate(steps):
            name, grid = around[-1]
            if type(step) not in markers and not step.in_cell:
                self.names.append(name)
                continue
            if isinstance(step, FrameStep):
                name, around[-1] = step.frame, (step.frame, grid)
                if name != BASE and name not in frames:
                    self.unknown[index] = UnknownFrame(name, tuple(frames))
            elif (step.divides or step.closes) and len(around) > 1:
                name = around[-2][0]
                if step.closes:
                    around.pop()
                else:
                    around[-1] = name, grid
            if step.in_cell and grid is None:
                self.no_cell[index] = CellOutsideGrid()
            self.names.append(grid if step.in_cell and grid is not None else name)
            if isinstance(step, BlockStep):
                inside = BASE if step.scoped else name  # a called program has frames of its own
                around.append((inside, grid if step.cell(0) is None else name))

    @property
    def lost(self) -> set[int]:
        """Steps in a frame that the program has not."""
        known = {BASE, *self._frames}
        return {index for index, name in enumerate(self.names) if name not in known}

    def matrix(self, index: int) -> FloatArray | None:
        """``T_base_frame`` (4, 4) [mm] of the frame that a step is in; None: the base."""
        return self._frames.get(self.names[index])

    def placed(self, index: int, step: Step, cell: Sequence[float] | None) -> Step:
        """The step at ``index`` with its points in the base frame; ``cell``: X, Y, Z in that of the grid."""
        T_base_user = self.matrix(index)
        if not step.in_cell:
            return step if T_base_user is None else step.moved(T_base_user)
        if cell is None:
            return step
        T_user_cell = np.eye(4)
        T_user_cell[:3, 3] = cell
        return step.moved(T_user_cell if T_base_user is None else T_base_user @ T_user_cell)

    def given(self, index: int, step: Step) -> Step:
        """A step in the base frame as it has to be given at ``index``, to a micrometre."""
        T_base_user = self.matrix(index)
        if T_base_user is None or step.in_cell:
            return step
        return _rounded(step.moved(np.asarray(np.linalg.inv(T_base_user), dtype=np.float64)), step)


def _rounded(step: Step, before: Step) -> Step:
    """The numbers that are no longer as before with fewer digits."""
    shorter: dict[str, float | tuple[float, ...]] = {}
    for key in step.__struct_fields__:
        value = getattr(step, key)
        if value != getattr(before, key) and isinstance(value, float):
            shorter[key] = round(value, _DIGITS) + 0.0
        elif value != getattr(before, key) and isinstance(value, tuple):
            shorter[key] = tuple(round(one, _DIGITS) + 0.0 for one in cast("tuple[float, ...]", value))
    return msgspec.structs.replace(step, **shorter)


_MovedStep = TypeVar("_MovedStep")


def moved_step(step: _MovedStep, points: Sequence[Sequence[str]], T: FloatArray) -> _MovedStep:
    """A step in another frame, ``T`` (4, 4) [mm]: ``points`` are the keys of each of its points.

    Its angles are turned with it, where it has them all.
    """
    R = T[:3, :3]
    moved: dict[str, float] = {}
    for keys in points:
        place = R @ [getattr(step, key) for key in keys] + T[:3, 3]
        moved |= zip(keys, place.tolist(), strict=True)
    rx, ry, rz = (from_degrees(getattr(step, key, None)) for key in _RPY)
    if rx is not None and ry is not None and rz is not None and not np.array_equal(R, np.eye(3)):
        turned = to_degrees(roll_pitch_yaw(R @ rotation_from_rpy(rx, ry, rz)))
        moved |= zip(_RPY, turned.tolist(), strict=True)
    return cast("_MovedStep", msgspec.structs.replace(cast("Any", step), frame=None, **moved))


def number_words(value: float) -> str:
    """A number of a step as it is listed: to hundredths, with a true minus."""
    return f"{round(value, 2) + 0.0:g}".replace("-", "−")
