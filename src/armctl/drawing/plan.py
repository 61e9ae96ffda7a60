"""A drawing planned for an arm: which strokes it can draw, its whole motion, and what is left out and why."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import field, replace
from functools import cached_property

import numpy as np

from armctl.apart import require_wanted
from armctl.arrays import FloatArray
from armctl.drawing.pen import Part, PenHold, pen_holds
from armctl.drawing.pen_path import pen_paths, stroke_line
from armctl.drawing.plane import DrawingPlane
from armctl.drawing.strokes import PenDrawing, Stroke, ordered
from armctl.errors import ArmctlError, InputError, MotionRefusedError
from armctl.facts import OtherConfiguration, Reason, StrokeLeftOut
from armctl.lazy_dataclass import dataclass
from armctl.motion.paths.tool_curve import ToolLine, ToolSpline
from armctl.motion.plan import plan_joints
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.preflight import preflight
from armctl.motion.timing import timed
from armctl.motion.trajectory import JoinedTrajectory, Trajectory
from armctl.robot import Robot

_PROBES = 60
"""places of a drawing that are looked at to choose how the pen is held"""
_MOST_HOLDS = 3
"""that are planned with, the others are only looked at"""
_SHORTEST_M = 2e-3
"""a piece of a stroke that is shorter is not worth to lift the pen for [m]"""
_GAP_M = 0.02e-3
"""so far before and behind a place where the arm changes over a stroke is cut: less than a pen is wide [m]"""
_LOOK_M = 2e-3
"""how far apart places are where a stroke may be begun again [m]"""
_MOST_LOOKED_AT = 50
"""of such places in a smooth piece of a stroke"""
_MOST_TRIES = 12
"""to put the pen down on one stroke"""
_NEAR_SPEED = 0.05
_SAMPLE_M = 0.25e-3
_AT_ONCE = 256


@dataclass(frozen=True, eq=False)
class DrawnPart:
    """One motion of a drawing."""

    kind: Part
    trajectory: Trajectory
    path: PiecewisePolynomial
    """q(s) of the joints over the metres of the tool"""
    line: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """(k, 3) what is drawn in it, base frame [m]"""
    stroke: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """(m, 3) the whole stroke of which that is a piece, as its file has it, base frame [m]"""


@dataclass(frozen=True, eq=False)
class LeftOut:
    """A stroke that is not drawn, or a piece of one."""

    fact: StrokeLeftOut
    line: FloatArray
    """(k, 3) base frame [m]"""


@dataclass(frozen=True, eq=False)
class DrawingPlan:
    """The motion of a whole drawing, from where the arm stands."""

    hold: PenHold
    speed: float
    """of the pen [m/s]"""
    parts: tuple[DrawnPart, ...]
    """at least one"""
    left_out: tuple[LeftOut, ...]

    @cached_property
    def trajectory(self) -> JoinedTrajectory:
        """All of it; the pen stops where a stroke begins and ends."""
        return JoinedTrajectory([part.trajectory for part in self.parts])

    @cached_property
    def path(self) -> PiecewisePolynomial:
        """The joints' path q(s) over the tool's way [m]."""
        first, *others = (part.path for part in self.parts)
        return first.followed_by(*others)

    @property
    def drawn_m(self) -> float:
        """The way of the pen on the plane [m]."""
        return sum(_length(part.line) for part in self.parts)

    @property
    def left_out_m(self) -> float:
        """Of what is not drawn [m]."""
        return sum(_length(one.line) for one in self.left_out)

    @cached_property
    def _samples(self) -> tuple[float, float]:
        robot, worst, near, way = self.hold.robot, 0.0, 0.0, 0.0
        for part in self.parts:
            if part.kind != "draw":
                continue
            count = max(int(np.ceil(part.path.high / _SAMPLE_M)), 8)
            times = np.linspace(0.0, part.trajectory.duration, count + 1)
            points = robot.forward(part.trajectory.sample(times).q)[:, :3, 3]
            steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
            worst = max(worst, float(distances(points, part.stroke).max()))
            fast = np.abs(steps / np.diff(times) / self.speed - 1.0) <= _NEAR_SPEED
            near, way = near + float(steps[fast].sum()), way + float(steps.sum())
        return worst, near / way if way else 0.0

    @property
    def line_error_m(self) -> float:
        """How far the planned pen strays from the strokes at most, by samples of the joints [m]."""
        return self._samples[0]

    @property
    def at_speed(self) -> float:
        """Share of the drawn way on which the pen has its speed, but for 5 %."""
        return self._samples[1]


def distances(points: FloatArray, line: FloatArray) -> FloatArray:
    """(k,) of points (k, d) from the line through points (m, d)."""
    begin, way = line[:-1], np.diff(line, axis=0)
    squares = np.maximum((way * way).sum(axis=1), 1e-30)
    found: list[FloatArray] = []
    for some in np.array_split(points, len(points) // _AT_ONCE + 1):
        share = np.clip(((some[:, None] - begin) * way).sum(axis=2) / squares, 0.0, 1.0)
        gaps = some[:, None] - (begin + share[..., None] * way)
        found.append(np.sqrt((gaps * gaps).sum(axis=2).min(axis=1)))
    return np.concatenate(found)


def plan_drawing(
    robot: Robot,
    start: FloatArray,
    drawing: PenDrawing,
    plane: DrawingPlane,
    *,
    speed: float,
    lift: float,
    pitch: float | None = None,
) -> DrawingPlan:
    """Plan a placed drawing from ``start`` (n,) [rad], strokes in the order that spares the lifted pen ways.

    ``speed`` of the pen [m/s], ``lift`` above the highest place of the surface that was touched, or that
    lies between places of the drawing [m], ``pitch`` of the pen [rad] (None: straight onto the plane where
    the arm can, else tilted as little as serves). Every part has passed the pre-flight. What cannot be drawn
    is left out; MotionRefusedError: that is all of it.
    """
    strokes = ordered(drawing.strokes)
    height = lift + plane.highest(np.concatenate([stroke.points for stroke in strokes]) / 1000)
    best: DrawingPlan | LeftOut | None = None
    for hold in _likely(robot, plane, strokes, height, pitch):
        planner = _Planner(hold, plane, speed, height, start)
        for stroke in strokes:
            require_wanted()
            planner.draw(stroke)
        if planner.drawn:
            plan = DrawingPlan(hold, speed, tuple(planner.parts), tuple(planner.left_out))
            if not isinstance(best, DrawingPlan) or plan.left_out_m < best.left_out_m:
                best = plan
            if not plan.left_out:
                break
        elif best is None:
            best = planner.left_out[0]
    if isinstance(best, LeftOut):
        raise MotionRefusedError(best.fact).about(f"none of {len(strokes)} strokes can be drawn")
    if best is None:  # pragma: no cover  # there is at least one hold, and one stroke
        raise InputError("a drawing has at least one stroke")
    return best


def _likely(
    robot: Robot, plane: DrawingPlane, strokes: Sequence[Stroke], height: float, pitch: float | None
) -> list[PenHold]:
    """The holds that reach most places of the drawing, and above them; the best first."""
    holds = pen_holds(robot, plane, pitch)
    if len(holds) == 1:
        return holds
    points = np.concatenate([stroke.points for stroke in strokes]) / 1000
    some = points[:: max(len(points) // _PROBES, 1)]
    places = np.concatenate([plane.points(some), plane.points(some[::4], height)])
    counts: list[int] = []
    for hold in holds:
        require_wanted()
        reached = hold.reaches(places)
        can = reached.any() and hold.keeps(places[reached.argmax()], plane)
        counts.append(int(np.count_nonzero(reached)) if can else 0)
        if counts[-1] == len(places):
            break
    order = sorted(range(len(counts)), key=lambda k: -counts[k])
    return [holds[k] for k in order[:_MOST_HOLDS]]


def _length(line: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


@dataclass(frozen=True, eq=False)
class _Piece:
    """A smooth piece of a stroke that is still to be drawn."""

    curve: PiecewisePolynomial
    begin: float
    """from the beginning of its stroke [m]"""

    def cut(self, begin: float, end: float) -> _Piece:
        inner = self.curve.breaks[(self.curve.breaks > begin + 1e-9) & (self.curve.breaks < end - 1e-9)]
        curve = self.curve.cut(np.concatenate([[begin], inner, [end]]))
        return _Piece(PiecewisePolynomial(curve.breaks - begin, curve.coefficients), self.begin + begin)

    @property
    def length(self) -> float:
        return self.curve.high


@dataclass(frozen=True, eq=False)
class _Try:
    """What came of a stroke from one configuration."""

    parts: Sequence[DrawnPart] = ()
    """empty: nothing of it can be drawn"""
    q: FloatArray | None = None
    """where the arm stands afterwards, with the pen lifted"""
    rest: Sequence[_Piece] = ()
    why: Reason | None = None
    """it ends there; None: nothing is left"""

    @property
    def reach(self) -> float:
        return sum(_length(part.line) for part in self.parts)


class _RefusedError(ArmctlError):
    """A motion that the pre-flight refuses."""


class _Planner:
    """Draws stroke after stroke, from where the one before has ended."""

    def __init__(
        self, hold: PenHold, plane: DrawingPlane, speed: float, height: float, start: FloatArray
    ) -> None:
        self._hold, self._robot, self._plane = hold, hold.robot, plane
        self._speed, self._height = speed, height
        self._keeps_jerk = any(joint.jerk_told for joint in self._robot.joints)
        self._q, self._lifted = start, False
        self.parts: list[DrawnPart] = []
        self.left_out: list[LeftOut] = []

    @property
    def drawn(self) -> bool:
        """Whether there is anything to draw."""
        return any(part.kind == "draw" for part in self.parts)

    def draw(self, stroke: Stroke) -> None:
        """Draw as much of a stroke as can be, and keep what is left out."""
        pieces, begin, line = list[_Piece](), 0.0, stroke_line(stroke.points, self._plane)
        for curve in pen_paths(stroke.points, self._plane):
            pieces.append(_Piece(curve, begin))
            begin += curve.high
        whole, ended, skip, left = begin, None, _LOOK_M, _MOST_TRIES
        while pieces:
            left -= 1
            done = self._best(pieces)
            if done.q is not None:
                self.parts += [
                    replace(part, stroke=line) if part.kind == "draw" else part for part in done.parts
                ]
                self._q, self._lifted = done.q, True
                pieces, ended, skip = list(done.rest), done.why, _LOOK_M
            else:
                why = ended or done.why  # where a piece has ended is why the next cannot begin there
                pieces = self._pass_over(stroke, pieces, whole, why, skip if left > 0 else np.inf)
                ended, skip = None, 2.0 * skip  # what looked as if it could be drawn, and could not, goes on

    def _best(self, pieces: Sequence[_Piece]) -> _Try:
        """As far as any configuration leads."""
        best = _Try(rest=pieces)
        for tried in self._tries(pieces):
            if best.why is None or tried.reach > best.reach:
                best = tried
            if tried.why is None:
                return tried
        return best

    def _tries(self, pieces: Sequence[_Piece]) -> Iterator[_Try]:
        above = self._above(pieces[0].curve(0.0))
        refused: Reason | None = None
        if self._lifted:
            try:
                yield self._drawn([self._line("go", self._q, above)], pieces)
            except ArmctlError as cause:
                refused = cause.reason
        found, why = self._hold.solve(above, self._q)
        for q in found:
            try:
                yield self._drawn([self._turn(q)], pieces)
            except ArmctlError as cause:
                refused = refused or cause.reason
        yield _Try(rest=pieces, why=why or refused or OtherConfiguration())

    def _drawn(self, before: list[DrawnPart], pieces: Sequence[_Piece]) -> _Try:
        """Onto the plane, along the pieces as far as they can be followed, and off it."""
        q = before[-1].trajectory.end
        parts = [*before, self._line("down", q, pieces[0].curve(0.0))]
        why, rest = None, list(pieces)
        while rest and why is None:
            piece = rest.pop(0)
            q = parts[-1].trajectory.end
            path, reach = self._hold.lead(q, ToolSpline(piece.curve))
            end = piece.length
            if reach < piece.length:
                beyond = min(reach + _GAP_M, piece.length)
                why, end = self._why(piece.curve(beyond), q), max(reach - _GAP_M, 0.0)
                if end < _SHORTEST_M:
                    rest.insert(0, piece)
                elif beyond < piece.length - _GAP_M:
                    rest.insert(0, piece.cut(beyond, piece.length))
            if path is not None and (why is None or end >= _SHORTEST_M):
                parts.append(self._along(piece, path, end))
        if parts[-1].kind != "draw":
            return _Try(rest=pieces, why=why)
        tip = self._robot.forward(parts[-1].trajectory.end)[:3, 3]
        parts.append(self._line("up", parts[-1].trajectory.end, self._above(tip)))
        self._check([part.trajectory for part in parts[len(before) :]])
        return _Try(parts, parts[-1].trajectory.end, rest, why)

    def _why(self, point: FloatArray, q: FloatArray) -> Reason:
        """Why the pen is not led to a point (3,) from where the arm is."""
        found, why = self._hold.solve(point, q)
        return why if why is not None and not found else OtherConfiguration()

    def _pass_over(
        self, stroke: Stroke, pieces: Sequence[_Piece], whole: float, why: Reason | None, skip: float
    ) -> list[_Piece]:
        """Leave out what cannot be drawn: at least ``skip`` [m], to where the pen could be put down again."""
        begin, line, rest = pieces[0].begin, list[FloatArray](), list(pieces)
        while rest:
            piece = rest.pop(0)
            step = max(_LOOK_M, piece.length / _MOST_LOOKED_AT)
            s = np.append(np.arange(0.0, piece.length, step), piece.length)
            places = piece.curve(s)
            ahead = s[(piece.begin + s >= begin + skip) & (s >= step) & (s <= piece.length - _SHORTEST_M)]
            again = next((at for at in ahead.tolist() if self._can_begin(piece.curve(at))), None)
            if again is not None:
                line.append(places[s <= again])
                rest.insert(0, piece.cut(again, piece.length))
                break
            line.append(places)
        points = np.concatenate(line)
        last = self.left_out[-1] if self.left_out else None
        if last is not None and last.fact.stroke == stroke.number and last.fact.end == begin:
            self.left_out.pop()
            begin, why, points = last.fact.begin, last.fact.why, np.concatenate([last.line, points])
        end = rest[0].begin if rest else whole
        fact = StrokeLeftOut(stroke.number, stroke.line, begin, end, whole, why)
        self.left_out.append(LeftOut(fact, points))
        return rest

    def _can_begin(self, point: FloatArray) -> bool:
        return bool(self._hold.solve(point, self._q)[0] and self._hold.solve(self._above(point), self._q)[0])

    def _above(self, point: FloatArray) -> FloatArray:
        """(3,) where the lifted pen is, over a place on the surface."""
        plane = self._plane
        over = float((point - plane.origin) @ plane.normal)
        return point + (self._height - over) * plane.normal

    def _line(self, kind: Part, q: FloatArray, end: FloatArray) -> DrawnPart:
        """Straight to a point (3,), the pen held as it is."""
        way = ToolLine(self._robot.forward(q)[:3, 3], end)
        path, reach = self._hold.lead(q, way)
        if path is None or reach < way.length:
            raise _RefusedError(self._why(way.positions(reach) if reach else end, q))
        cap = self._speed if kind == "down" else np.inf
        made = DrawnPart(kind, self._timed(path, cap), path)
        if kind == "go":
            self._check([made.trajectory])
        return made

    def _turn(self, q: FloatArray) -> DrawnPart:
        """To a configuration, joint by joint."""
        trajectory = plan_joints(self._robot, self._q, q, profile="s-curve" if self._keeps_jerk else "cubic")
        way = float(np.linalg.norm(self._robot.forward(q)[:3, 3] - self._robot.forward(self._q)[:3, 3]))
        coefficients = np.stack([self._q, (q - self._q) / max(way, 1e-3)])[None]
        return DrawnPart("go", trajectory, PiecewisePolynomial([0.0, max(way, 1e-3)], coefficients))

    def _along(self, piece: _Piece, path: PiecewisePolynomial, end: float) -> DrawnPart:
        """Along a piece as far as ``end`` [m]."""
        if end < path.high:
            path = path.cut(np.append(path.breaks[path.breaks < end], end))
        count = max(int(np.ceil(end / _SAMPLE_M)), 4)
        line = piece.curve(np.linspace(0.0, end, count + 1))
        return DrawnPart("draw", self._timed(path, self._speed), path, line)

    def _timed(self, path: PiecewisePolynomial, cap: float) -> Trajectory:
        """As fast as ``cap`` [m/s] and the limits allow; that of jerk where the arm's file gives one."""
        limited = self._keeps_jerk and not path.slope_jumps().any()
        return timed(self._robot, path, profile="s-curve" if limited else "trapezoid", rate_cap=cap)

    def _check(self, trajectories: Sequence[Trajectory]) -> None:
        """Refuse what the pre-flight refuses."""
        for finding in preflight(self._robot, JoinedTrajectory(trajectories), tool_path=True):
            if finding.severity == "error":
                raise _RefusedError(replace(finding, step=None).fact)
