"""The steps that move the arm: to a pose, to a point, along a line or an arc."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, ClassVar, Literal, cast

import numpy as np
from msgspec import Meta

from armctl.arrays import FloatArray
from armctl.errors import ProgramError, UnreachableError
from armctl.facts import Several
from armctl.facts.angles import from_degrees, to_degrees
from armctl.facts.targets import ReachedFree, Without
from armctl.kinematics import CRITERIA, FROM_START, Target, roll_pitch_yaw, rotation_from_rpy
from armctl.motion.choices import choose_end, solve
from armctl.motion.one_sided import ONE_SIDED, OneSided, commanded_end
from armctl.motion.paths.tool_path import TURN_MODES, PitchMode, TurnMode
from armctl.motion.plan import follow_tool
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.profiles import ProfileName
from armctl.program.base_steps import FASTEST, Field, MotionStep, literal
from armctl.program.frames import moved_step, number_words
from armctl.robot import Robot

_POINT_HINT, _VIA_HINT = "X, Y, Z of the tool at the end.", "X, Y, Z of a point on the arc."
_PITCH_HINT = "Tool pitch at the end; of a line or an arc with 'interpolated' only."
_TURN_HINT = "The tool's whole orientation on the way; instead of its pitch."
_RPY_HINT = (
    "The tool's orientation at the end, Rz(yaw)·Ry(pitch)·Rx(roll); "
    "of a line or an arc with 'interpolated' only."
)
PointKey = Annotated[float, Field("Point mm", _POINT_HINT, 1, touched=True)]
_ViaPoint = Annotated[float, Field("Via mm", _VIA_HINT, 2, touched=True)]
_Mode = Annotated[
    PitchMode | None,
    Field("Tool pitch", "Tool pitch on the way.", 3, "pitch_mode", TURN_MODES, "kept", "pitch", more=True),
]
PitchKey = Annotated[float | None, Field("Pitch °", _PITCH_HINT, 4, turn="pitch", more=True)]
_Turn = Annotated[
    TurnMode | None,
    Field(
        "Tool orientation", _TURN_HINT, 3, choices=TURN_MODES, left_open="kept", turn="orientation", more=True
    ),
]
AngleKey = Annotated[float | None, Field("Rx Ry Rz °", _RPY_HINT, 4, turn="orientation", more=True)]
RollKey = Annotated[
    float | None, Field("Roll °", "Tool roll at the end. Empty: as it comes.", 5, turn="pitch", more=True)
]
CriterionKey = Annotated[
    str, Field("Choose by", "Which of the solutions is taken.", 6, choices=tuple(CRITERIA), more=True)
]
_PROFILE_HINT = (
    "Law of the motion over time. end-plus, end-minus: a cubic that comes to its end from one side, each "
    "joint turning up, or down, so that its play is on the same side each time."
)
_Profile = Annotated[
    Literal[ProfileName, OneSided],
    Field("Profile", _PROFILE_HINT, 7, more=True),
]
ToolSpeedKey = Annotated[Annotated[float, Meta(gt=0)] | None, Field("Tool speed mm/s", FASTEST, 8)]
FrameKey = Annotated[
    Literal["cell"] | None,
    Field(
        "Frame",
        "cell: points begin at the cell of the grid around it.",
        11,
        "frame",
        ("cell",),
        "base",
        more=True,
    ),
]
END, VIA = ("x_mm", "y_mm", "z_mm"), ("via_x_mm", "via_y_mm", "via_z_mm")
RPY = ("rx_deg", "ry_deg", "rz_deg")
_RPY_KEYS = ", ".join(RPY)
_LED = ("pitch", "pitch_deg", "orientation", "rpy_deg", "speed_mm_s", "duration_s", "blend_mm")
"""arguments of ``Arm.line`` and ``Arm.arc`` beside the points"""


class MoveStep(MotionStep, frozen=True, kw_only=True, tag="move"):
    """Go to joint angles [degrees], in the order of the robot's joints."""

    icon: ClassVar = "joints"
    call: ClassVar = ("go_joints", "joints_deg", "duration_s", "profile", "blend_mm")
    button: ClassVar = ("Record", "Record pose", "joints_deg")

    joints_deg: Annotated[
        tuple[float, ...], Field("Angles °", "One angle a joint, separated by commas.", 0, a_joint=True)
    ]
    profile: _Profile = "cubic"

    @property
    def _law(self) -> ProfileName | OneSided:
        return self.profile

    def _goal(self) -> str:
        return f"{_listed(self.joints_deg)} °"

    def check(self, robot: Robot) -> None:
        """Refuse angles outside the limits, or too few or too many."""
        self.end(robot)

    def end(self, robot: Robot, start: FloatArray | None = None) -> FloatArray:
        """The angles [rad]."""
        return _as_commanded(robot, robot.check_limits(robot.read(self.joints_deg)), self.profile)


class _Oriented:
    """What steps with an orientation share. No struct: each writes its keys in an order of its own."""

    __slots__ = ()
    rx_deg: float | None
    ry_deg: float | None
    rz_deg: float | None

    @property
    def rpy_deg(self) -> tuple[float | None, ...] | None:
        """Roll, pitch and yaw of the tool at the end, as far as given; None: none of them."""
        angles = (self.rx_deg, self.ry_deg, self.rz_deg)
        return None if angles == (None, None, None) else angles

    @property
    def _rpy_words(self) -> str:
        angles = self.rpy_deg or ()
        return f"Rx Ry Rz ({', '.join('?' if angle is None else number_words(angle) for angle in angles)})°"

    @property
    def _rotation(self) -> FloatArray | None:
        """(3, 3) at the end; None: not given. ProgramError: not all of its angles are."""
        roll, pitch, yaw = self.rx_deg, self.ry_deg, self.rz_deg
        if self.rpy_deg is None:
            return None
        if roll is None or pitch is None or yaw is None:
            raise ProgramError(f"an orientation needs all of {_RPY_KEYS}")
        return rotation_from_rpy(*map(from_degrees, (roll, pitch, yaw)))


class PointStep(_Oriented, MotionStep, frozen=True, kw_only=True, tag="point"):
    """Put the tool on a point [mm] by inverse kinematics, joint by joint."""

    icon: ClassVar = "point"
    call: ClassVar = (
        "go", *END, "pitch_deg", "roll_deg", "rpy_deg", "choose", "duration_s", "profile", "blend_mm",
    )  # fmt: skip
    button: ClassVar = ("Record tool", "Point", *END, "pitch_deg", "roll_deg", *RPY)

    x_mm: PointKey
    y_mm: PointKey
    z_mm: PointKey
    pitch_deg: PitchKey = None
    roll_deg: RollKey = None
    rx_deg: AngleKey = None
    ry_deg: AngleKey = None
    rz_deg: AngleKey = None
    choose: CriterionKey = "least-rotation"
    profile: _Profile = "cubic"
    frame: FrameKey = None
    """None: the base"""

    @property
    def in_cell(self) -> bool:
        """Its frame says so."""
        return self.frame == "cell"

    def moved(self, T: FloatArray) -> PointStep:
        """As of any step."""
        return moved_step(self, (END,), T)

    @property
    def _law(self) -> ProfileName | OneSided:
        return self.profile

    def _goal(self) -> str:
        pitch = "" if self.pitch_deg is None else f", pitch {number_words(self.pitch_deg)}°"
        roll = "" if self.roll_deg is None else f", roll {number_words(self.roll_deg)}°"
        turned = "" if self.rpy_deg is None else f", {self._rpy_words}"
        return f"{place_words(self, END)}{frame_words(self.frame)}{pitch}{roll}{turned}"

    def check(self, robot: Robot) -> None:
        """Refuse an orientation that is not whole, or one beside a pitch or roll."""
        self._target()

    def _target(self) -> Target:
        pitch, roll = from_degrees(self.pitch_deg), from_degrees(self.roll_deg)
        return Target.of(metres(self, END), pitch, roll, self._rotation)

    def end(self, robot: Robot, start: FloatArray | None = None) -> FloatArray | None:
        """The best solution to which the arm may go by itself; where there is none, the best of all.

        Without a start the best of all, where that does not depend on it.
        """
        target = self._target()
        with telling_freer(robot, target):
            if start is not None:
                q = choose_end(robot, start, target, self.choose, self.duration_s, self._law)
                return _as_commanded(robot, q, self.profile)
            if self.choose in FROM_START:
                solve(robot, None, target, "least-rotation")  # whether there is any
                return None
            return _as_commanded(robot, solve(robot, start, target, self.choose), self.profile)


@contextmanager
def telling_freer(robot: Robot, target: Target) -> Generator[None]:
    """Say of a refused target whether its point can be reached with less asked of the tool."""
    try:
        yield
    except UnreachableError as cause:
        for without, freer in _freer(target):
            if robot.inverse_kinematics.meets(freer):
                raise UnreachableError(Several((ReachedFree(without), cause.reason))) from cause
        raise


def _freer(target: Target) -> Iterator[tuple[Without, Target]]:
    """Targets with less asked of the tool, and what is left out of each, as little as can be first."""
    point, pitch, roll = target.position, target.pitch, target.roll
    if pitch is not None and roll is not None:
        yield "pitch", Target.of(point, roll=roll)
        yield "roll", Target.of(point, pitch=pitch)
        yield "pitch and roll", Target.of(point)
    elif target.rotation is not None:
        yield "orientation", Target.of(point)
    elif pitch is not None or roll is not None:
        yield "roll" if pitch is None else "pitch", Target.of(point)


def _as_commanded(robot: Robot, q: FloatArray, profile: ProfileName | OneSided) -> FloatArray:
    """(n,) what a step commands so that the links come to ``q`` (n,) [rad]."""
    return commanded_end(robot, q, profile) if profile in ONE_SIDED else q


def _require_together(name: str, keys: str, mode: str | None, end: object) -> None:
    """Refuse (``ProgramError``) an end that its mode does not take, and the lack of one that it does."""
    if (end is not None) != (mode == "interpolated"):
        raise ProgramError(
            f'{name} = "{mode or "kept"}" and {keys} = {end} do not go together: "interpolated" '
            f"needs the {name} at the end, the others take none"
        )


class _LeadsTool(_Oriented):
    """What a line and an arc share."""

    __slots__ = ()
    leads_tool: ClassVar[bool] = True
    points: ClassVar[tuple[tuple[str, ...], ...]] = (END,)
    """keys of the points on the way, the last one is the end"""

    pitch: PitchMode | None
    pitch_deg: float | None
    orientation: TurnMode | None
    speed_mm_s: float | None
    frame: Literal["cell"] | None

    @property
    def _tool_speed(self) -> float | None:
        return None if self.speed_mm_s is None else self.speed_mm_s / 1000

    def _goal(self) -> str:
        end = "" if self.pitch_deg is None else f" to {number_words(self.pitch_deg)}°"
        pitch = "" if self.pitch in (None, "kept") else f", pitch {self.pitch}{end}"
        end = "" if self.rpy_deg is None else f" to {self._rpy_words}"
        pitch += "" if self.orientation is None else f", orientation {self.orientation}{end}"
        speed = "" if self.speed_mm_s is None else f", {number_words(self.speed_mm_s)} mm/s"
        points = " via ".join(place_words(self, keys) for keys in reversed(self.points))
        return f"{points}{frame_words(self.frame)}{pitch}{speed}"

    def check(self, robot: Robot) -> None:
        """Refuse a pitch or an orientation at the end that does not go with the mode, and both at once."""
        if self.pitch is not None and self.orientation is not None:
            raise ProgramError(
                f'pitch = "{self.pitch}" and orientation = "{self.orientation}" do not go together: leave '
                "one of them out"
            )
        self._rotation  # noqa: B018  # refused where it is not whole
        _require_together("pitch", "pitch_deg", self.pitch, self.pitch_deg)
        _require_together("orientation", _RPY_KEYS, self.orientation, self.rpy_deg)

    @property
    def in_cell(self) -> bool:
        """Its frame says so."""
        return self.frame == "cell"

    def moved(self, T: FloatArray) -> MotionStep:
        """As of any step."""
        return moved_step(cast("MotionStep", self), self.points, T)

    def path(self, robot: Robot, start: FloatArray) -> PiecewisePolynomial | None:
        """Along the tool's way [m]."""
        *via, end = (metres(self, keys) for keys in self.points)
        turn = (self.pitch, from_degrees(self.pitch_deg), self.orientation, self._rotation)
        return follow_tool(robot, start, via[0] if via else None, end, *turn, speed=self._tool_speed)


class LineStep(_LeadsTool, MotionStep, frozen=True, kw_only=True, tag="line"):
    """Lead the tool to a point [mm] in a straight line, on the branch the arm is on."""

    icon: ClassVar = "line"
    call: ClassVar = ("line", *END, *_LED)
    button: ClassVar = ("Record tool", "Line", *END, "pitch", "orientation", *RPY)

    x_mm: PointKey
    y_mm: PointKey
    z_mm: PointKey
    pitch: _Mode = None
    pitch_deg: PitchKey = None
    """tool pitch at the end; only with pitch = "interpolated", and needed there"""
    orientation: _Turn = None
    """neither this nor a pitch: what the arm can do is kept, its orientation with six joints or more"""
    rx_deg: AngleKey = None
    ry_deg: AngleKey = None
    rz_deg: AngleKey = None
    """tool orientation at the end; only with orientation = "interpolated", and needed there"""
    speed_mm_s: ToolSpeedKey = None
    """largest speed of the tool; None: as fast as the limits allow"""
    frame: FrameKey = None
    """None: the base"""


class ArcStep(_LeadsTool, MotionStep, frozen=True, kw_only=True, tag="arc"):
    """Lead the tool along a circular arc through a point to another [mm]; the rest as in a line."""

    icon: ClassVar = "arc"
    button: ClassVar = ("Record tool", "Arc", *VIA, *END, "pitch", "orientation", *RPY)
    points: ClassVar = (VIA, END)

    via_x_mm: _ViaPoint
    via_y_mm: _ViaPoint
    via_z_mm: _ViaPoint
    x_mm: PointKey
    y_mm: PointKey
    z_mm: PointKey
    pitch: _Mode = None
    pitch_deg: PitchKey = None
    orientation: _Turn = None
    rx_deg: AngleKey = None
    ry_deg: AngleKey = None
    rz_deg: AngleKey = None
    speed_mm_s: ToolSpeedKey = None
    frame: FrameKey = None

    def script(self) -> str:
        """``arc``; its points are tuples there."""
        numbers = map(literal, _values(self, (*VIA, *END)))
        points = "via_mm=({}, {}, {}), to_mm=({}, {}, {})".format(*numbers)
        return f"arc({', '.join(filter(None, (points, self._arguments(_LED))))})"


def tool_turn(robot: Robot, q: FloatArray, digits: int = 6) -> dict[str, float | None]:
    """Keys of steps and their values [degrees]: how the tool is turned at ``q`` (n,) [rad].

    Of an arm that can turn its tool about any axis, its orientation; else its pitch and roll.
    """
    if robot.orients_tool:
        turns = zip(RPY, roll_pitch_yaw(robot.forward(q)[:3, :3]).tolist(), strict=True)
    else:
        turns = zip(("pitch_deg", "roll_deg"), robot.inverse_kinematics.pitch_and_roll(q), strict=True)
    return {key: None if turn is None else round(to_degrees(turn), digits) + 0.0 for key, turn in turns}


# Points and numbers of several kinds.


def _values(step: object, keys: Sequence[str]) -> tuple[float, ...]:
    return tuple(getattr(step, key) for key in keys)


def metres(step: object, keys: Sequence[str]) -> FloatArray:
    """Keys in mm as an array [m]."""
    return np.array(_values(step, keys)) / 1000


def _listed(values: Sequence[float]) -> str:
    return ", ".join(map(number_words, values))


def place_words(step: object, keys: Sequence[str]) -> str:
    """A point in words."""
    return f"{_listed(_values(step, keys))} mm"


def frame_words(frame: str | None) -> str:
    """Whose frame a point is in, behind it; empty: the base's."""
    return "" if frame is None else f" from the {frame}"
