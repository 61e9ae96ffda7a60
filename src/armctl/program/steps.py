"""The steps of a program: one struct a kind, which says how it is written, shown, checked, planned and run.

Files, the form and the list of the page, CSV columns and scripts are made from what a struct says of itself:
a new kind of step is a struct here and its entry in ``KINDS``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Union, cast

import msgspec
import numpy as np
from msgspec import Meta

from armctl.arrays import FloatArray
from armctl.errors import ProgramError
from armctl.kinematics import CRITERIA, Target
from armctl.motion.blend import Leg
from armctl.motion.paths.tool_path import PitchMode
from armctl.motion.plan import follow_tool, plan_joints, plan_path, solve
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.profiles import NOWHERE, PointToPoint, ProfileName
from armctl.motion.trajectory import Trajectory
from armctl.program.keys import Field, Key, defaults_of, keys_of, literal
from armctl.robot import Robot

LONGEST_WAIT_S = 86_400
MOST_REPEATS = 1_000_000
SLOWEST_PERCENT = 5
WIDEST_BLEND_MM = 1000


@dataclass(frozen=True, slots=True)
class Effect:
    """What a step does besides moving joints."""

    wait_s: float | None = None
    """the joints stand so long"""
    opening: float | None = None
    """where the gripper goes, 0..1; the joints stand meanwhile"""
    percent: float | None = None
    """speed of the steps after it, on top of the operator's override"""

    @property
    def stands(self) -> bool:
        """The joints stand while it lasts."""
        return self.wait_s is not None or self.opening is not None


_POINT_HINT, _VIA_HINT = "X, Y, Z of the tool at the end.", "X, Y, Z of a point on the arc."
_PITCH_HINT = "Tool pitch at the end; of a line or an arc with 'interpolated' only."
_BLEND_HINT = "How far from its end the tool may turn off to the next step."
_FASTEST = "Empty: as fast as the limits allow."
_Seconds = Annotated[float, Meta(ge=0, le=LONGEST_WAIT_S)]
_Point = Annotated[float, Field("Point mm", _POINT_HINT, 1)]
_Via = Annotated[float, Field("Via mm", _VIA_HINT, 2)]
_Mode = Annotated[PitchMode, Field("Tool pitch", "Tool pitch on the way.", 3, head="pitch_mode")]
_Pitch = Annotated[float | None, Field("Pitch °", _PITCH_HINT, 4)]
_Roll = Annotated[float | None, Field("Roll °", "Tool roll at the end. Empty: as it comes.", 5)]
_Criterion = Annotated[
    str, Field("Choose by", "Which of the solutions is taken.", 6, choices=tuple(CRITERIA))
]
_Profile = Annotated[ProfileName, Field("Profile", "Law of the motion over time.", 7)]
_ToolSpeed = Annotated[Annotated[float, Meta(gt=0)] | None, Field("Tool speed mm/s", _FASTEST, 8)]


class Step(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", kw_only=True):
    """What all steps share; in the file, ``do`` names the kind."""

    title: ClassVar[str] = ""
    """of its kind, in the list"""
    acts: ClassVar[bool] = True
    """it is executed; comments and the markers of blocks are not"""

    note: Annotated[str, Field("Note", place=99)] = ""

    @property
    def kind(self) -> str:
        """What ``do`` says in the file."""
        return str(self.__struct_config__.tag)

    @property
    def effect(self) -> Effect:
        """What it does besides moving joints."""
        return Effect()

    def describe(self) -> str:
        """Its values in words, for the list."""
        return ""

    def check(self, robot: Robot) -> None:
        """Refuse what can be refused without planning; the ranges of its values are checked already.

        Raises:
            ArmctlError: what is wrong for this arm.
        """

    def script(self) -> str:
        """The call of ``Arm`` that does the same, as Python.

        Raises:
            ProgramError: there is none.
        """
        raise ProgramError(f"no call of Arm does what a {self.kind!r} step does")

    def _call(self, name: str, *arguments: str) -> str:
        """A call with keys as arguments; one that is as by default is left out."""
        defaults = defaults_of(type(self))
        needed = [key for key in arguments if defaults[key] is msgspec.NODEFAULT]
        parts: list[str] = []
        for key in arguments:
            value: object = getattr(self, key)
            value = list(cast("tuple[float, ...]", value)) if isinstance(value, tuple) else value
            if needed == [key]:
                parts.append(literal(value))
            elif value != defaults[key]:
                parts.append(f"{key}={literal(value)}")
        return f"{name}({', '.join(parts)})"


class MotionStep(Step, frozen=True, kw_only=True):
    """What all moving steps share: each has a path of the joints, planned alone or as a leg of a blend."""

    leads_tool: ClassVar[bool] = False
    """the tool is led along a path; else each joint goes to its goal"""

    duration_s: Annotated[_Seconds | None, Field("Duration s", _FASTEST, 9)] = None
    """None: as fast as the limits allow"""
    blend_mm: Annotated[float, Meta(ge=0, le=WIDEST_BLEND_MM), Field("Blend mm", _BLEND_HINT, 10)] = 0.0
    """how far from its end the tool may begin to turn off towards the next step; 0: it stops there"""

    @property
    def tool_speed(self) -> float | None:
        """Largest speed of the tool [m/s]; None: as fast as the joints can."""
        return None

    def path(self, robot: Robot, start: FloatArray) -> PiecewisePolynomial | None:
        """The joints' path q(s) from ``start`` (n,) [rad]; None where it goes nowhere.

        Raises:
            InputError: a value that is not finite, or the wrong number of joints.
            UnreachableError: no solution, or a line or arc that the arm cannot follow; says where and why.
            MotionRefusedError: outside the joint limits.
        """
        raise NotImplementedError

    def plan_leg(self, robot: Robot, leg: Leg, *, checked: bool = True) -> Trajectory:
        """Its motion from rest to rest along the path of ``leg`` (``checked``: as in ``plan_joints``).

        Raises:
            MotionRefusedError: as in ``plan_joints``.
        """
        raise NotImplementedError

    def end(self, robot: Robot) -> FloatArray | None:
        """Where it ends, (n,) [rad], if that does not depend on where it starts; else None.

        Raises:
            ArmctlError: as ``path``.
        """
        return None

    def leg(self, robot: Robot, start: FloatArray) -> Leg | None:
        """It as a leg of a blended motion; None where it goes nowhere.

        In a blended motion the step's profile gives way to the speed plan over all legs, and its duration is
        a shortest one.

        Raises:
            ArmctlError: as ``path``.
        """
        path = self.path(robot, start)
        if path is None:
            return None
        cap = math.inf if self.tool_speed is None else self.tool_speed
        if self.duration_s:
            cap = min(cap, (path.high - path.low) / self.duration_s)
        return Leg(path, self.blend_mm / 1000, cap)

    def plan(self, robot: Robot, start: FloatArray, *, checked: bool = True) -> Trajectory:
        """Its motion by itself, from rest at ``start`` (n,) [rad] to rest.

        Raises:
            ArmctlError: as ``path`` and ``plan_leg``.
        """
        leg = self.leg(robot, start)
        if leg is None:
            return PointToPoint.lasting(start, start, self.duration_s or 0.0)
        return self.plan_leg(robot, leg, checked=checked)

    def _way(self, profile: str = "cubic") -> str:
        """Duration, law and blend radius in words."""
        seconds = "" if self.duration_s is None else f" in {self.duration_s:g} s"
        law = "" if profile == "cubic" else f", {profile}"
        return f"{seconds}{law}{f', blend {self.blend_mm:g} mm' if self.blend_mm else ''}"


class MoveStep(MotionStep, frozen=True, kw_only=True, tag="move"):
    """Go to joint angles [degrees], in the order of the robot's joints."""

    title: ClassVar[str] = "pose"

    joints_deg: Annotated[tuple[float, ...], Field("Angles °", "One angle a joint, separated by commas.", 0)]
    profile: _Profile = "cubic"

    def describe(self) -> str:
        """Angles and how."""
        return f"{_listed(self.joints_deg)} °{self._way(self.profile)}"

    def check(self, robot: Robot) -> None:
        """Refuse angles outside the limits, or too few or too many."""
        self.end(robot)

    def script(self) -> str:
        """``go_joints``."""
        return self._call("go_joints", "joints_deg", "duration_s", "profile", "blend_mm")

    def end(self, robot: Robot) -> FloatArray:
        """The angles [rad]."""
        return robot.check_limits(np.radians(self.joints_deg))

    def path(self, robot: Robot, start: FloatArray) -> PiecewisePolynomial | None:
        """Straight in joint space."""
        return _straight(start, self.end(robot))

    def plan_leg(self, robot: Robot, leg: Leg, *, checked: bool = True) -> Trajectory:
        """By the profile."""
        return _by_profile(robot, leg, self.duration_s, self.profile, checked)


class PointStep(MotionStep, frozen=True, kw_only=True, tag="point"):
    """Put the tool on a point [mm] by inverse kinematics, joint by joint."""

    title: ClassVar[str] = "point"

    x_mm: _Point
    y_mm: _Point
    z_mm: _Point
    pitch_deg: _Pitch = None
    roll_deg: _Roll = None
    choose: _Criterion = "least-rotation"
    profile: _Profile = "cubic"

    @property
    def target(self) -> Target:
        """In metres and radians.

        Raises:
            InputError: a value that is not finite.
        """
        point = _metres(self.x_mm, self.y_mm, self.z_mm)
        return Target.of(point, _radians(self.pitch_deg), _radians(self.roll_deg))

    def describe(self) -> str:
        """Point, pitch, roll and how."""
        pitch = "" if self.pitch_deg is None else f", pitch {_short(self.pitch_deg)}°"
        roll = "" if self.roll_deg is None else f", roll {_short(self.roll_deg)}°"
        return f"{_point(self.x_mm, self.y_mm, self.z_mm)}{pitch}{roll}{self._way(self.profile)}"

    def script(self) -> str:
        """``go``."""
        angles = ("pitch_deg", "roll_deg", "choose", "duration_s", "profile", "blend_mm")
        return self._call("go", "x_mm", "y_mm", "z_mm", *angles)

    def end(self, robot: Robot) -> FloatArray | None:
        """The solution that is chosen; by least travel, it depends on the start."""
        if self.choose == "least-travel":
            solve(robot, None, self.target, "least-rotation")  # whether there is any
            return None
        return solve(robot, None, self.target, self.choose)

    def path(self, robot: Robot, start: FloatArray) -> PiecewisePolynomial | None:
        """Straight in joint space to the solution that is chosen."""
        return _straight(start, solve(robot, start, self.target, self.choose))

    def plan_leg(self, robot: Robot, leg: Leg, *, checked: bool = True) -> Trajectory:
        """By the profile."""
        return _by_profile(robot, leg, self.duration_s, self.profile, checked)


class LineStep(MotionStep, frozen=True, kw_only=True, tag="line"):
    """Lead the tool to a point [mm] in a straight line, on the branch the arm is on."""

    title: ClassVar[str] = "line"
    leads_tool: ClassVar[bool] = True

    x_mm: _Point
    y_mm: _Point
    z_mm: _Point
    pitch: _Mode = "kept"
    pitch_deg: _Pitch = None
    """tool pitch at the end; only with pitch = "interpolated", and needed there"""
    speed_mm_s: _ToolSpeed = None
    """largest speed of the tool; None: as fast as the limits allow"""

    @property
    def tool_speed(self) -> float | None:
        """[m/s]."""
        return None if self.speed_mm_s is None else self.speed_mm_s / 1000

    def describe(self) -> str:
        """End, pitch and how."""
        return f"{_point(self.x_mm, self.y_mm, self.z_mm)}{_led(self)}{self._way()}"

    def check(self, robot: Robot) -> None:
        """Refuse a pitch at the end that does not go with the mode."""
        _check_pitch(self)

    def script(self) -> str:
        """``line``."""
        return self._call("line", "x_mm", "y_mm", "z_mm", *_LED)

    def path(self, robot: Robot, start: FloatArray) -> PiecewisePolynomial | None:
        """Along the tool's way [m]."""
        end = _metres(self.x_mm, self.y_mm, self.z_mm)
        return follow_tool(robot, start, None, end, self.pitch, _radians(self.pitch_deg), self.tool_speed)

    def plan_leg(self, robot: Robot, leg: Leg, *, checked: bool = True) -> Trajectory:
        """Along the path."""
        return _along(robot, leg, self.duration_s, self.tool_speed, checked)


class ArcStep(MotionStep, frozen=True, kw_only=True, tag="arc"):
    """Lead the tool along a circular arc through a point to another [mm], on the branch the arm is on."""

    title: ClassVar[str] = "arc"
    leads_tool: ClassVar[bool] = True

    via_x_mm: _Via
    via_y_mm: _Via
    via_z_mm: _Via
    x_mm: _Point
    y_mm: _Point
    z_mm: _Point
    pitch: _Mode = "kept"
    pitch_deg: _Pitch = None
    """as in a line"""
    speed_mm_s: _ToolSpeed = None

    @property
    def tool_speed(self) -> float | None:
        """[m/s]."""
        return None if self.speed_mm_s is None else self.speed_mm_s / 1000

    def describe(self) -> str:
        """End, point on the way, pitch and how."""
        via = f"via {_point(self.via_x_mm, self.via_y_mm, self.via_z_mm)}"
        return f"{_point(self.x_mm, self.y_mm, self.z_mm)} {via}{_led(self)}{self._way()}"

    def check(self, robot: Robot) -> None:
        """Refuse a pitch at the end that does not go with the mode."""
        _check_pitch(self)

    def script(self) -> str:
        """``arc``; its points are tuples there."""
        via = literal((self.via_x_mm, self.via_y_mm, self.via_z_mm))
        end = literal((self.x_mm, self.y_mm, self.z_mm))
        others = self._call("", *_LED).strip("()")
        return f"arc(via_mm={via}, to_mm={end}{f', {others}' if others else ''})"

    def path(self, robot: Robot, start: FloatArray) -> PiecewisePolynomial | None:
        """Along the tool's way [m]."""
        via = _metres(self.via_x_mm, self.via_y_mm, self.via_z_mm)
        end = _metres(self.x_mm, self.y_mm, self.z_mm)
        return follow_tool(robot, start, via, end, self.pitch, _radians(self.pitch_deg), self.tool_speed)

    def plan_leg(self, robot: Robot, leg: Leg, *, checked: bool = True) -> Trajectory:
        """Along the path."""
        return _along(robot, leg, self.duration_s, self.tool_speed, checked)


class WaitStep(Step, frozen=True, kw_only=True, tag="wait"):
    """Stand still."""

    title: ClassVar[str] = "wait"

    seconds: Annotated[_Seconds, Field("Wait time s", head="wait_s")]

    @property
    def effect(self) -> Effect:
        """The time."""
        return Effect(wait_s=self.seconds)

    def describe(self) -> str:
        """How long."""
        return f"{self.seconds:g} s"

    def script(self) -> str:
        """``wait``."""
        return self._call("wait", "seconds")


class GripperStep(Step, frozen=True, kw_only=True, tag="gripper"):
    """Open the gripper to a percentage: 0 closed, 100 open."""

    title: ClassVar[str] = "gripper"

    open_percent: Annotated[
        float, Meta(ge=0, le=100), Field("Open %", "0 closed, 100 open.", head="gripper_percent")
    ]

    @property
    def effect(self) -> Effect:
        """The opening."""
        return Effect(opening=self.open_percent / 100)

    def describe(self) -> str:
        """How far."""
        return f"{self.open_percent:g} % open"

    def check(self, robot: Robot) -> None:
        """Refuse an arm without a gripper."""
        if robot.gripper is None:
            raise ProgramError(f"{robot.name} has no gripper; delete the step")

    def script(self) -> str:
        """``gripper``."""
        return self._call("gripper", "open_percent")


class SpeedStep(Step, frozen=True, kw_only=True, tag="speed"):
    """Run the steps after it at a percentage of their speed, on top of the operator's override."""

    title: ClassVar[str] = "speed"

    percent: Annotated[
        float,
        Meta(ge=SLOWEST_PERCENT, le=100),
        Field("Percent", "Speed of the steps after this one.", head="speed_percent"),
    ]

    @property
    def effect(self) -> Effect:
        """The percentage."""
        return Effect(percent=self.percent)

    def describe(self) -> str:
        """How fast."""
        return f"{self.percent:g} % from here on"

    def script(self) -> str:
        """``set_speed``."""
        return self._call("set_speed", "percent")


class RepeatStep(Step, frozen=True, kw_only=True, tag="repeat"):
    """Run the steps as far as the matching ``end`` several times."""

    title: ClassVar[str] = "repeat"
    acts: ClassVar[bool] = False

    times: Annotated[int, Meta(ge=1, le=MOST_REPEATS), Field("Times")]

    def describe(self) -> str:
        """How often."""
        return f"{self.times} times"


class EndStep(Step, frozen=True, kw_only=True, tag="end"):
    """End of the block that the last open ``repeat`` began."""

    title: ClassVar[str] = "end"
    acts: ClassVar[bool] = False

    def describe(self) -> str:
        """Of what."""
        return "of the repeat"


class CommentStep(Step, frozen=True, kw_only=True, tag="comment"):
    """Nothing: its note is for people."""

    title: ClassVar[str] = "#"
    acts: ClassVar[bool] = False


KINDS: tuple[type[Step], ...] = (
    MoveStep,
    PointStep,
    LineStep,
    ArcStep,
    WaitStep,
    GripperStep,
    SpeedStep,
    RepeatStep,
    EndStep,
    CommentStep,
)
"""the registry: every kind of step that a program may hold"""


def any_step() -> Any:
    """The union of all kinds of steps, to decode one."""
    return Union[KINDS]  # noqa: UP007


def all_keys() -> tuple[Key, ...]:
    """The keys of all kinds of steps, each name once, in the order of their fields and columns."""
    found = {key.name: key for kind in KINDS for key in keys_of(kind)}
    return tuple(sorted(found.values(), key=lambda key: key.field.place))


# What several kinds share.

_LED = ("pitch", "pitch_deg", "speed_mm_s", "duration_s", "blend_mm")


def _straight(start: FloatArray, end: FloatArray) -> PiecewisePolynomial | None:
    moves = float(np.abs(end - start).max()) > NOWHERE
    return PiecewisePolynomial([0.0, 1.0], np.stack([start, end - start])[None]) if moves else None


def _by_profile(
    robot: Robot, leg: Leg, duration_s: float | None, profile: ProfileName, checked: bool
) -> Trajectory:
    start, end = leg.path(leg.path.low), leg.path(leg.path.high)
    return plan_joints(robot, start, end, duration_s, profile, checked=checked)


def _along(
    robot: Robot, leg: Leg, duration_s: float | None, speed: float | None, checked: bool
) -> Trajectory:
    start = leg.path(leg.path.low)
    return plan_path(robot, start, leg.path, speed=speed, duration_s=duration_s, checked=checked)


def _check_pitch(step: LineStep | ArcStep) -> None:
    if (step.pitch_deg is not None) != (step.pitch == "interpolated"):
        raise ProgramError(
            f'pitch = "{step.pitch}" and pitch_deg = {step.pitch_deg} do not go together: "interpolated" '
            "needs the pitch at the end, the others take none"
        )


def _metres(x_mm: float, y_mm: float, z_mm: float) -> FloatArray:
    return np.array([x_mm, y_mm, z_mm]) / 1000


def _radians(angle_deg: float | None) -> float | None:
    return None if angle_deg is None else math.radians(angle_deg)


def _short(value: float) -> str:
    return f"{round(value, 2) + 0.0:g}".replace("-", "−")


def _listed(values: Sequence[float]) -> str:
    return ", ".join(map(_short, values))


def _point(x_mm: float, y_mm: float, z_mm: float) -> str:
    return f"({_listed((x_mm, y_mm, z_mm))}) mm"


def _led(step: LineStep | ArcStep) -> str:
    pitch = "" if step.pitch_deg is None else f" to {_short(step.pitch_deg)}°"
    mode = "" if step.pitch == "kept" else f", pitch {step.pitch}{pitch}"
    return mode if step.speed_mm_s is None else f"{mode}, {_short(step.speed_mm_s)} mm/s"
