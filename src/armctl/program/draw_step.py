"""The step that draws a file onto a touched plane."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, ClassVar, Self

import msgspec
import numpy as np
from msgspec import Meta

from armctl.arrays import FloatArray
from armctl.drawing import DrawingPlane, PenDrawing, read_drawing
from armctl.drawing.files import require_drawing_name
from armctl.drawing.fit import Fit, fit_drawing
from armctl.drawing.plan import DrawingPlan, plan_drawing
from armctl.errors import MotionRefusedError
from armctl.facts import Reason
from armctl.facts.angles import from_degrees
from armctl.lazy_dataclass import dataclass
from armctl.motion.blend import Leg
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.profiles import lasting_s
from armctl.motion.trajectory import SlowedTrajectory, Trajectory
from armctl.program.base_steps import Field, MotionStep, keys_of, literal
from armctl.robot import Robot

WIDEST_MM, FASTEST_MM_S, HIGHEST_LIFT_MM = 5000.0, 500.0, 200.0
_FILE_HINT = "An SVG or G-code file, as seen from the folder of the program."
_PLANE_HINT = (
    "X, Y, Z of three touched points: the origin, one to the right of it, one above it on the drawing; then "
    "of further ones where the surface is not flat."
)
_WIDTH_HINT = "How wide the drawing is. Empty: as wide as its file says."
_SHIFT_HINT = (
    "Where the lower left corner of the drawing is on the plane: to the right of the origin, and up."
)
_PITCH_HINT = "Of the pen. Empty: straight onto the plane where the arm can, else tilted as little as serves."
_Shift = Annotated[
    Annotated[float, Meta(ge=-WIDEST_MM, le=WIDEST_MM)], Field("Shift mm", _SHIFT_HINT, 43, more=True)
]


@dataclass(frozen=True, slots=True, eq=False)
class _PlannedLeg(Leg):
    """A leg whose motion is known."""

    trajectory: Trajectory | None = None


class DrawStep(MotionStep, frozen=True, kw_only=True, tag="draw"):
    """Draw an SVG or G-code file on a plane; what is out of reach is named before, and left out."""

    leads_tool: ClassVar[bool] = True
    icon: ClassVar = "draw"
    button: ClassVar = ("Record tool", "Drawing", "file", "plane_mm")

    file: Annotated[
        str, Meta(min_length=1, max_length=1000), Field("File", _FILE_HINT, 40, offers="drawings")
    ]
    plane_mm: Annotated[tuple[float, ...], Field("Plane mm", _PLANE_HINT, 41)]
    width_mm: Annotated[
        Annotated[float, Meta(gt=0, le=WIDEST_MM)] | None, Field("Width mm", _WIDTH_HINT, 42)
    ] = None
    right_mm: _Shift = 0.0
    up_mm: _Shift = 0.0
    pen_speed_mm_s: Annotated[
        float, Meta(gt=0, le=FASTEST_MM_S), Field("Pen speed mm/s", "Outside sharp corners.", 44)
    ] = 30.0
    lift_mm: Annotated[
        float, Meta(gt=0, le=HIGHEST_LIFT_MM), Field("Lift mm", "How high the pen is between strokes.", 45)
    ] = 10.0
    pen_pitch_deg: Annotated[
        Annotated[float, Meta(ge=-90, le=90)] | None, Field("Pen pitch °", _PITCH_HINT, 46, more=True)
    ] = None

    def _goal(self) -> str:
        width = "" if self.width_mm is None else f", {self.width_mm:g} mm wide"
        return f"{Path(self.file).name}{width}, {self.pen_speed_mm_s:g} mm/s"

    def found_from(self, folder: Path) -> Self:
        """Its file is looked for in the folder of the program."""
        return msgspec.structs.replace(self, file=str(folder / self.file))

    def seen_from(self, folder: Path) -> Self:
        """Its file by its name in the folder of the program, if it is there."""
        try:
            inside = Path(self.file).relative_to(os.path.abspath(folder))
        except ValueError:
            return self
        return msgspec.structs.replace(self, file=inside.as_posix())

    def moved(self, T: FloatArray) -> Self:
        """Its plane in another frame, as of any step."""
        points = np.reshape(self.plane_mm, (-1, 3)) @ T[:3, :3].T + T[:3, 3]
        return msgspec.structs.replace(self, plane_mm=tuple(points.ravel().tolist()))

    def check(self, robot: Robot) -> None:
        """Refuse a file that cannot be read as a drawing, and points that are no plane."""
        require_drawing_name(self.file)
        self._placed()
        DrawingPlane.touched(self.plane_mm)

    def drawn(self, robot: Robot, start: FloatArray) -> DrawingPlan:
        """Its plan from ``start`` (n,) [rad]; raises as ``path``, and DrawingError."""
        return _planned(robot, self, read_drawing(self.file), (start + 0.0).tobytes())

    def left_out(self, robot: Robot, start: FloatArray) -> Sequence[Reason]:
        """Strokes out of reach."""
        return [one.fact for one in self.drawn(robot, start).left_out]

    def path(self, robot: Robot, start: FloatArray) -> PiecewisePolynomial:
        """All its ways, the pen lifted between strokes."""
        return self.drawn(robot, start).path

    def leg(self, robot: Robot, start: FloatArray) -> Leg:
        """With its motion, which is planned already."""
        plan = self.drawn(robot, start)
        cap = plan.speed
        if self.duration_s:
            cap = min(cap, (plan.path.high - plan.path.low) / self.duration_s)
        return _PlannedLeg(plan.path, self.blend_mm / 1000, cap, self._lasting(plan.trajectory))

    def plan_leg(self, robot: Robot, leg: Leg, *, checked: bool = True) -> Trajectory:
        """The motion that its leg brings; every part of it has passed the pre-flight."""
        if isinstance(leg, _PlannedLeg) and leg.trajectory is not None:
            return leg.trajectory
        return super().plan_leg(robot, leg, checked=checked)

    def fitted(self, robot: Robot, start: FloatArray) -> Self:
        """Smaller and shifted, until all is in reach from ``start`` (n,) [rad]; DrawingError: no size is."""

        def sized(fit: Fit) -> Self:
            return msgspec.structs.replace(
                self, width_mm=fit.width, right_mm=fit.corner[0], up_mm=fit.corner[1]
            )

        def leaves_out(fit: Fit) -> bool:
            try:
                return bool(sized(fit).left_out(robot, start))
            except MotionRefusedError:
                return True

        plane, pitch = DrawingPlane.touched(self.plane_mm), from_degrees(self.pen_pitch_deg)
        return sized(fit_drawing(robot, self._placed(), plane, self.lift_mm / 1000, pitch, leaves_out))

    def script(self) -> str:
        """A program of this step alone."""
        given = ((key.name, getattr(self, key.name), key.default) for key in keys_of(type(self)))
        named = (f"{name}={literal(value)}" for name, value, default in given if value != default)
        step = f"armctl.program.DrawStep({', '.join(named)})"
        return f"run(armctl.program.Program(robot=arm.robot.name, steps=({step},)))"

    def _placed(self) -> PenDrawing:
        return read_drawing(self.file).placed(self.width_mm, (self.right_mm, self.up_mm))

    def _lasting(self, trajectory: Trajectory) -> Trajectory:
        """As long as was asked for, at least what it needs."""
        if self.duration_s is None:
            return trajectory
        lasts = lasting_s(
            self.duration_s,
            trajectory.duration,
            lambda _, told: f"the drawing cannot take {told}",
            "trapezoid",
            exact=True,
        )
        return SlowedTrajectory(trajectory, max(lasts / trajectory.duration, 1.0))


@lru_cache(maxsize=8)
def _planned(robot: Robot, step: DrawStep, drawing: PenDrawing, start: bytes) -> DrawingPlan:
    """What the list, the check and the arm ask for in turn is planned once."""
    return plan_drawing(
        robot,
        np.frombuffer(start),
        drawing.placed(step.width_mm, (step.right_mm, step.up_mm)),
        DrawingPlane.touched(step.plane_mm),
        speed=step.pen_speed_mm_s / 1000,
        lift=step.lift_mm / 1000,
        pitch=from_degrees(step.pen_pitch_deg),
    )
