"""Steps that take a part, and put it down. They are made of lines, the gripper or an output, and waits."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from armctl.arrays import FloatArray
from armctl.decoding import must_be
from armctl.errors import ArmctlError, ProgramError
from armctl.facts import Part
from armctl.kinematics import Target
from armctl.motion.choices import choose_end, different_ends, may_go_to, solve
from armctl.motion.paths.refusals import ToolPathRefusedError, ToolPathUnreachableError
from armctl.motion.paths.tool_walk import StepBudget
from armctl.motion.plan import follow_tool, plan_path, straight_way
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.preflight import passes
from armctl.program.base_steps import Field, MotionStep, Seconds, Step
from armctl.program.frames import moved_step
from armctl.program.motion_steps import (
    END,
    RPY,
    AngleKey,
    CriterionKey,
    FrameKey,
    LineStep,
    PitchKey,
    PointKey,
    PointStep,
    RollKey,
    ToolSpeedKey,
    frame_words,
    metres,
    place_words,
    telling_freer,
)
from armctl.program.signal_steps import AtTimeout, LongestWait, SetStep, SignalNameOrNone, WaitForStep
from armctl.program.standing_steps import EDGES, EdgeKey, GripperStep, HoldsPart, WaitStep
from armctl.robot import Robot
from armctl.robot.tools import grippers

FARTHEST_MM = 500.0
_TRIED_STEPS = 2000
"""of walks along the way, for all configurations at a point that are tried for one with a way"""
Along = Literal["base", "tool"]
_Way = Annotated[float, Meta(gt=0, le=FARTHEST_MM)]
_ALONG_HINT = "base: from above, along Z; tool: along the axis of the tool."
_RETREAT_HINT = "How far straight away from it. Empty: as the approach."
_OUTPUT_HINT = "It grips while it is on, such as a vacuum. Empty: the gripper."
_INPUT_HINT = "It is 1 while a part is held. Empty: nothing is asked."
_Percent = Annotated[float, Meta(ge=0, le=100)]
_HIGH = ("high_x_mm", "high_y_mm", "high_z_mm")
_Parts = list[tuple[Part, Step]]
_TARGET = (*END, "pitch_deg", "roll_deg", *RPY)
_CALL = ("approach_mm", "retreat_mm", "along", "pitch_deg", "roll_deg", "rpy_deg", "choose", "speed_mm_s")
_CALL_END = ("output", "seconds", "part_input", "timeout_s", "otherwise")


class ApproachStep(PointStep, frozen=True, kw_only=True, tag="approach"):
    """Go joint by joint to where the straight way to a point begins; no file holds it.

    The configuration is chosen at the point: the best one to which that way leads. So the way down is that
    way back, on its branch.
    """

    high_x_mm: float
    high_y_mm: float
    high_z_mm: float
    back_mm: float
    """so far from the point, back along the tool; 0: the way begins at the other point"""

    def moved(self, T: FloatArray) -> PointStep:
        """Both points."""
        return moved_step(self, (END, _HIGH), T)

    def end(self, robot: Robot, start: FloatArray | None = None) -> FloatArray | None:
        """The begin of the way, (n,) [rad]; None without a start. Raises as a point, and as a line."""
        target = self._target()
        with telling_freer(robot, target):
            if start is None:  # it depends on where the arm comes from; whether there is any does not
                solve(robot, None, target, "least-rotation")
                return None
            q = self._chosen(robot, start, target)
        try:
            way = self._way(robot, q)
        except (ToolPathRefusedError, ToolPathUnreachableError) as cause:  # no key frees the tool there
            raise type(cause)(replace(cause.on_curve, freer=None), cause.place, cause.before) from cause
        return q if way is None else way(way.high)

    def _chosen(self, robot: Robot, start: FloatArray, target: Target) -> FloatArray:
        """At the point: the best that may be gone to; else one with a way, so that what blocks it is told."""
        effort, answers = StepBudget(_TRIED_STEPS), list[bool]()

        def may_take(q: FloatArray) -> bool:
            answers.append(self._may_take(robot, start, q, effort))
            return answers[-1]

        q = choose_end(robot, start, target, self.choose, may_go=may_take)
        if any(answers):
            return q
        ends, effort = different_ends(robot, start, target, self.choose), StepBudget(_TRIED_STEPS // 4)
        led = (end for end in ends if straight_way(robot, end, self._high(robot, end), effort) is not None)
        return next(led, q)

    def _high(self, robot: Robot, q: FloatArray) -> FloatArray:
        """Where the way begins (3,) [m], of one that leads to the point at ``q`` (n,) [rad]."""
        if not self.back_mm:
            return metres(self, _HIGH)
        T = robot.forward(q)
        return T[:3, 3] - self.back_mm / 1000 * T[:3, 2]

    def _way(self, robot: Robot, q: FloatArray) -> PiecewisePolynomial | None:
        """From the point, at ``q`` (n,) [rad], to the begin."""
        return follow_tool(robot, q, None, self._high(robot, q))

    def _may_take(self, robot: Robot, start: FloatArray, q: FloatArray, effort: StepBudget) -> bool:
        way = straight_way(robot, q, self._high(robot, q), effort)
        if way is None:
            return False
        try:
            line = plan_path(robot, q, way, checked=False)
        except ArmctlError:
            return False
        return may_go_to(robot, start, line.end) and passes(robot, line, tool_path=True)


class RetreatStep(MotionStep, frozen=True, kw_only=True, tag="retreat"):
    """Lead the tool back along its axis; no file holds it."""

    leads_tool: ClassVar[bool] = True

    back_mm: float
    speed_mm_s: float | None = None

    @property
    def _tool_speed(self) -> float | None:
        return None if self.speed_mm_s is None else self.speed_mm_s / 1000

    def path(self, robot: Robot, start: FloatArray) -> PiecewisePolynomial | None:
        """From where the tool is."""
        T = robot.forward(start)
        return follow_tool(
            robot, start, None, T[:3, 3] - self.back_mm / 1000 * T[:3, 2], speed=self._tool_speed
        )


class _HandlingStep(Step, frozen=True, kw_only=True):
    """What a pick and a place share: their keys, and the way to the part and away from it."""

    handles: ClassVar[bool] = True

    x_mm: PointKey
    y_mm: PointKey
    z_mm: PointKey
    approach_mm: Annotated[_Way, Field("Approach mm", "How far straight to the point.", 2, more=True)] = 50.0
    retreat_mm: Annotated[_Way | None, Field("Retreat mm", _RETREAT_HINT, 2, more=True)] = None
    along: Annotated[Along, Field("Along", _ALONG_HINT, 3, more=True)] = "base"
    pitch_deg: PitchKey = None
    roll_deg: RollKey = None
    rx_deg: AngleKey = None
    ry_deg: AngleKey = None
    rz_deg: AngleKey = None
    choose: CriterionKey = "least-rotation"
    speed_mm_s: ToolSpeedKey = None
    """of the straight ways; None: as fast as the limits allow"""
    frame: FrameKey = None
    output: Annotated[SignalNameOrNone, Field("Output", _OUTPUT_HINT, 60, offers="outputs", more=True)] = ""
    """on: it grips; empty: the gripper does"""
    seconds: Annotated[Seconds, Field("Wait time s", "At the part.", 61, head="wait_s", more=True)] = 0.0
    part_input: Annotated[
        SignalNameOrNone, Field("Part input", _INPUT_HINT, 62, offers="inputs", more=True)
    ] = ""
    """name of an input that is 1 while a part is held, and is waited for; empty: none"""
    timeout_s: Annotated[LongestWait, Field("Time-out s", "Of the part input.", 64, more=True)] = 2.0
    otherwise: AtTimeout = "stop"

    @property
    def rpy_deg(self) -> tuple[float | None, ...] | None:
        """Roll, pitch and yaw of the tool at the point, as far as given; None: none of them."""
        return self._point.rpy_deg

    @property
    def in_cell(self) -> bool:
        """Its frame says so."""
        return self.frame == "cell"

    def moved(self, T: FloatArray) -> Step:
        """As of any step."""
        return moved_step(self, (END,), T)

    def check(self, robot: Robot) -> None:
        """Refuse what is wrong with one of its parts, and an arm that has nothing to grip with."""
        self._point.check(robot)
        if not self.output and not grippers(robot):
            raise ProgramError(f"{robot.name} has no gripper: say by which output it grips")
        if self.part_input and robot.signals.input(self.part_input) is None:
            names = [one.name for one in robot.signals.inputs]
            has = (
                f"part_input {must_be(names)}" if names else "inputs are told in the robot file ([[inputs]])"
            )
            raise ProgramError(f"{robot.name} has no input {self.part_input!r}: {has}")
        for _, part in self.parts:
            if not isinstance(part, MotionStep):
                part.check(robot)

    @property
    def parts(self) -> _Parts:
        """To the point, what is done there, and away."""
        away = self.approach_mm if self.retreat_mm is None else self.retreat_mm
        if self.along == "tool":
            retreat: Step = RetreatStep(back_mm=away, speed_mm_s=self.speed_mm_s)
        else:
            retreat = self._line(away)
        waits: _Parts = [("settle", WaitStep(seconds=self.seconds))] if self.seconds else []
        return [*self._before, *self._to_point(), self._hand, *waits, *self._asks, ("retreat", retreat)]

    @property
    def _before(self) -> _Parts:
        return []

    @property
    def _hand(self) -> tuple[Part, Step]:
        """What grips, or lets go."""
        raise NotImplementedError

    @property
    def _asks(self) -> _Parts:
        """The wait for the part, if an input tells of it."""
        raise NotImplementedError

    def _wait_for_part(self, part: Part, value: float) -> _Parts:
        if not self.part_input:
            return []
        wait = WaitForStep(
            watch=self.part_input, value=value, timeout_s=self.timeout_s, otherwise=self.otherwise
        )
        return [(part, wait)]

    @property
    def _point(self) -> PointStep:
        keys = (*_TARGET, "choose", "frame")
        return PointStep(**{key: getattr(self, key) for key in keys})

    def _line(self, above_mm: float) -> LineStep:
        return LineStep(
            x_mm=self.x_mm,
            y_mm=self.y_mm,
            z_mm=self.z_mm + above_mm,
            speed_mm_s=self.speed_mm_s,
            frame=self.frame,
        )

    def _to_point(self) -> _Parts:
        keys = {key: getattr(self, key) for key in (*_TARGET, "choose", "frame")}
        high = dict(zip(_HIGH, (self.x_mm, self.y_mm, self.z_mm + self.approach_mm), strict=True))
        back = self.approach_mm if self.along == "tool" else 0.0
        return [("approach", ApproachStep(**keys, **high, back_mm=back)), ("down", self._line(0.0))]

    def _words(self, hand: str) -> str:
        turned = "" if self.pitch_deg is None else f", pitch {self.pitch_deg:g}°".replace("-", "−")
        asks = f", {self.part_input} within {self.timeout_s:g} s" if self.part_input else ""
        tool = " along the tool" if self.along == "tool" else ""
        where = f"{place_words(self, END)}{frame_words(self.frame)}{turned}"
        return f"{where}, approach {self.approach_mm:g} mm{tool}, {hand}{asks}"


class PickStep(HoldsPart, _HandlingStep, frozen=True, kw_only=True, tag="pick"):
    """Take a part: approach it, go straight to it, grip, see that it is held, go straight away."""

    icon: ClassVar = "pick"
    call: ClassVar = ("pick", *END, *_CALL, "ready_percent", "close_percent", "part_mm", *_CALL_END)
    button: ClassVar = ("Pick and place", "Pick", *_TARGET, "close_percent", *EDGES)

    ready_percent: Annotated[
        _Percent | None, Field("Open first %", "Ahead of the approach. Empty: as it is.", 52, more=True)
    ] = None
    close_percent: Annotated[_Percent, Field("Close to %", "0 closed; of the gripper.", 53)] = 0.0
    part_x_mm: EdgeKey = None
    part_y_mm: EdgeKey = None
    part_z_mm: EdgeKey = None

    def check(self, robot: Robot) -> None:
        """As of a place; and refuse the size of a part that no gripper holds."""
        if self.output and self.part_mm is not None:
            raise ProgramError("the size of a part counts between the jaws only: leave it out, or the output")
        super().check(robot)

    def describe(self) -> str:
        """Where, how, and by what."""
        return self._words(f"{self.output} on" if self.output else f"close to {self.close_percent:g} %")

    @property
    def _before(self) -> _Parts:
        if self.ready_percent is None or self.output:
            return []
        return [("open", GripperStep(open_percent=self.ready_percent))]

    @property
    def _hand(self) -> tuple[Part, Step]:
        if self.output:
            return "grip", SetStep(output=self.output, value=1.0)
        edges = dict(zip(EDGES, (self.part_x_mm, self.part_y_mm, self.part_z_mm), strict=True))
        return "grip", GripperStep(open_percent=self.close_percent, **edges)

    @property
    def _asks(self) -> _Parts:
        return self._wait_for_part("held", 1.0)


class PlaceStep(_HandlingStep, frozen=True, kw_only=True, tag="place"):
    """Put a part down: approach the place, go straight to it, let go, see that it is gone, go away."""

    icon: ClassVar = "place"
    call: ClassVar = ("place", *END, *_CALL, "open_percent", *_CALL_END)
    button: ClassVar = ("Pick and place", "Place", *_TARGET)

    open_percent: Annotated[_Percent, Field("Open %", "0 closed, 100 open.", 53, head="gripper_percent")] = (
        100.0
    )

    def describe(self) -> str:
        """Where, how, and by what."""
        return self._words(f"{self.output} off" if self.output else f"open to {self.open_percent:g} %")

    @property
    def _hand(self) -> tuple[Part, Step]:
        if self.output:
            return "let go", SetStep(output=self.output, value=0.0)
        return "let go", GripperStep(open_percent=self.open_percent)

    @property
    def _asks(self) -> _Parts:
        return self._wait_for_part("gone", 0.0)
