"""Every path of a program, walked before it runs: all branches, passes and places, each motion once."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Generator, Iterable, Mapping, Sequence
from dataclasses import field, replace
from typing import cast

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.facts import (
    NeverComes,
    NeverEnds,
    OnPath,
    PathsLeftOut,
    PathTurn,
    PathWay,
    Reason,
    ToolGripsNot,
    ToolHoldsPart,
    Unbounded,
)
from armctl.kinematics.velocity import NEAR
from armctl.lazy_dataclass import dataclass
from armctl.motion.clearance import sources
from armctl.motion.preflight import Finding, Severity, isotropy_of, passes, preflight
from armctl.motion.trajectory import JoinedTrajectory, Trajectory
from armctl.program.base_steps import BlockStep, MotionStep, Step
from armctl.program.calls import WholeProgram
from armctl.program.conditions import COUNTER
from armctl.program.signal_steps import ConditionStep
from armctl.robot import CarriedPart, Robot
from armctl.robot.body.arm_body import Openings

_TOGETHER, _ALONE = 32, 2
"""So many motions are checked at once, and so few one by one: 10,000 steps take a quarter of the time."""
MOST_VISITS = 200_000
"""steps that are walked, each pass and each branch anew; then the rest is left out, and that is said"""

Cell = tuple[float, float, float] | None
Key = tuple[bytes, str, Openings, CarriedPart | None, Cell, tuple[tuple[str, int], ...]]
Path = tuple[PathTurn, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _PathPlace:
    """Where the arm may be ahead of a step."""

    q: FloatArray | None
    """(n,) [rad]; None: not known"""
    robot: Robot
    """with its tool and its gripper as they are there"""
    counters: Mapping[str, int]
    cell: Cell = None
    """of the grid around it"""
    path: Path = ()
    """one of the ways there"""
    key: Key = field(init=False)
    """what makes it another place than others; rounding makes none"""

    def __post_init__(self) -> None:
        place = b"" if self.q is None else (np.round(self.q, 7) + 0.0).tobytes()
        counters = tuple(sorted(self.counters.items()))
        robot = self.robot
        key = (place, robot.tool, robot.openings, robot.part, self.cell, counters)
        object.__setattr__(self, "key", key)


_Places = dict[Key, _PathPlace]
_Walking = Generator["_Walking", _Places, _Places]
"""a walk that asks for the walk of a block in it: blocks may be nested deeper than Python's calls"""


@dataclass(frozen=True, slots=True, eq=False)
class _PlannedMotion:
    index: int
    step: MotionStep
    trajectory: Trajectory
    robot: Robot
    path: Path


class _SpentError(Exception):
    """There is more than can be walked."""


class PathWalk:
    """Plans from step to step, on every path; what was walked from the same place, once."""

    def __init__(
        self, whole: WholeProgram, robot: Robot, skipped: Container[int], payload_kg: float | None
    ) -> None:
        """``skipped``: indices of the steps that are wrong in themselves, among those that run."""
        self.found: list[Finding] = []
        """motions that cannot be planned, what the pre-flight found in the others, waits that cannot end"""
        steps = whole.flat.steps
        self._whole = whole
        self._steps, self._robot, self._skipped, self._payload_kg = steps, robot, skipped, payload_kg
        self._blocks, self._placing = whole.blocks.required(), whole.placing
        self._ranges = _counter_ranges([step for k, step in enumerate(steps) if k not in skipped])
        self._planned: list[_PlannedMotion] = []
        """motions that the pre-flight has not seen yet, each from where the one before ends"""
        self._ends: dict[tuple[int, Key], FloatArray | None] = {}
        """where a step ends that began somewhere"""
        self._left: dict[tuple[int, frozenset[Key]], _Places] = {}
        """where a block ends that was entered at some places"""
        self._robots: dict[tuple[str, float | None, CarriedPart | None], Robot] = {}
        self._reported: set[tuple[int, str, str]] = set()
        self._visits = 0
        self._at = 0
        """the step that is walked now"""

    def run(self, q: FloatArray | None, progress: Callable[[int, int], None] | None) -> None:
        """PathWalk through the program from ``q`` (n,) [rad]; None: not known."""
        self._progress, self._done = progress, 0
        begin = _PathPlace(q, self._robot, {})
        open_: list[_Walking] = [self._through(0, len(self._steps), {begin.key: begin})]
        result: _Places | None = None
        try:
            while open_:
                try:
                    inner = next(open_[-1]) if result is None else open_[-1].send(result)
                    open_.append(inner)
                    result = None
                except StopIteration as over:
                    result = over.value
                    open_.pop()
        except _SpentError:
            self._report(self._at, PathsLeftOut(MOST_VISITS), (), "warning")
        self._look_at(self._planned)

    def _through(self, first: int, last: int, places: _Places) -> _Walking:
        index = first
        while index < last and places:  # behind what is never passed nothing runs
            step, self._at = self._steps[index], index
            self._visits += len(places)
            if self._visits > MOST_VISITS:
                raise _SpentError
            if isinstance(step, BlockStep) and index not in self._skipped:
                key = (index, frozenset(places))
                if key not in self._left:
                    self._left[key] = yield (
                        self._alternatives(index, places)
                        if not step.again
                        else self._loop(index, step, places)
                    )
                # As it was walked: of how it came there only the way to the block is new.
                places = self._left[key]
                index = self._blocks.partners[index]
            elif isinstance(step, BlockStep):
                index = self._blocks.partners[index]
            elif step.acts:
                places = _merged(self._after(index, step, place) for place in places.values())
                if self._progress is not None and isinstance(step, MotionStep):
                    self._done = max(self._done, index + 1)
                    self._progress(self._done, len(self._steps))
            index += 1
        return places

    def _alternatives(self, begin: int, places: _Places) -> _Walking:
        end = self._blocks.partners[begin]
        otherwise = self._blocks.elses.get(begin, end)
        yes, no = self._split(begin, places)
        yes = _merged(_turned(place, self._turn(begin, "then")) for place in yes.values())
        no = _merged(_turned(place, self._turn(begin, "else")) for place in no.values())
        if yes:
            yes = yield self._through(begin + 1, otherwise, yes)
        if no and otherwise < end:
            no = yield self._through(otherwise + 1, end, no)
        return _merged([*yes.values(), *no.values()])

    def _loop(self, begin: int, step: BlockStep, places: _Places) -> _Walking:
        """All passes; where a pass begins as an earlier one did, those that follow are known."""
        end, most, asks = self._blocks.partners[begin], step.passes, step.effect.asks is not None
        around = next(iter(places.values())).cell if places else None
        base, done, endless = _common(places.values()), 0, asks and step.passes is None
        left: _Places = {}
        seen: dict[frozenset[Key], int] = {}
        while places and (most is None or done < most):
            signature = frozenset(places)
            if signature in seen:
                if most is None:
                    break
                period = done - seen[signature]
                done += (most - done) // period * period
                seen.clear()
                continue
            seen[signature] = done
            cell = step.cell(done)
            if cell is not None:
                turn = self._turn(begin, "cell", done + 1)
                places = _merged(replace(it, path=(*base, turn), cell=cell) for it in places.values())
            elif done > 0:
                path = (*base, self._turn(begin, "pass", done + 1))
                places = {key: replace(place, path=path) for key, place in places.items()}
            if asks:
                places, leaving = self._split(begin, places)
                left = _merged([*left.values(), *leaving.values()])
            if not places:
                break
            places = yield self._through(begin + 1, end, places)
            done += 1
        if step.cell(0) is not None:
            places = _merged(replace(it, cell=around) for it in places.values())
        if most is None and places and not left:
            self._report(begin, NeverEnds(), _common(places.values()), "error")
        elif endless and self._foreseen(begin, next(iter(left.values()), None)) is None and places:
            self._report(begin, Unbounded(), (), "warning")
        return _merged([*left.values(), *(places.values() if most is not None else ())])

    def _turn(self, index: int, way: PathWay, number: int = 0) -> PathTurn:
        return self._whole.turn(PathTurn(index, way, number))

    def _split(self, index: int, places: _Places) -> tuple[_Places, _Places]:
        """The places where a condition may hold, and those where it may not."""
        answers = {key: self._foreseen(index, place) for key, place in places.items()}
        return (
            {key: place for key, place in places.items() if answers[key] is not False},
            {key: place for key, place in places.items() if answers[key] is not True},
        )

    def _foreseen(self, index: int, place: _PathPlace | None) -> bool | None:
        """Whether the condition of a step holds; None: only the board knows."""
        step = self._steps[index]
        if place is None or not isinstance(step, ConditionStep):
            return None
        return step.condition.foreseen(place.counters)

    def _after(self, index: int, step: Step, place: _PathPlace) -> _PathPlace | None:
        """Where the arm is after a step; None: it does not come there."""
        if isinstance(step, MotionStep):
            return replace(place, q=self._end(index, step, place))
        if index in self._skipped:
            return place
        effect = step.effect
        if effect.until is not None and self._foreseen(index, place) is False:
            goes_on = effect.until.goes_on
            self._report(index, NeverComes(effect.until.what), place.path, "warning" if goes_on else "error")
            return place if goes_on else None
        if effect.counts is not None and effect.counts.counter in self._ranges:
            name = effect.counts.counter
            low, high = self._ranges[name]
            count = effect.counts.after(place.counters.get(name, 0))
            return replace(place, counters={**place.counters, name: int(min(max(count, low), high))})
        if effect.opening is not None:
            if place.robot.gripper is None:
                self._report(index, ToolGripsNot(place.robot.tool), place.path, "error")
                return place
            return self._held(place, place.robot.tool, effect.opening, effect.part)
        if effect.tool and effect.tool != place.robot.tool:
            if place.robot.part is not None:
                self._report(index, ToolHoldsPart(str(place.robot.part)), place.path, "error")
            return self._held(place, effect.tool, None, None)
        return place

    def _held(
        self, place: _PathPlace, tool: str, opening: float | None, part: CarriedPart | None
    ) -> _PathPlace:
        """The place with another tool, opening or part."""
        kept = (tool, opening, part)
        if kept not in self._robots:
            self._robots[kept] = self._robot.with_tool(tool).gripping(opening).carrying(part)
        return replace(place, robot=self._robots[kept])

    def _end(self, index: int, step: MotionStep, place: _PathPlace) -> FloatArray | None:
        """Where a moving step ends; None where that is not known."""
        if index in self._skipped:
            return None
        key = (index, (*place.key[:4], place.cell if step.in_cell else None, ()))
        if key not in self._ends:
            self._ends[key] = None
            step = cast("MotionStep", self._placing.placed(index, step, place.cell))
            try:
                if place.q is None:
                    self._ends[key] = step.end(place.robot)
                else:
                    trajectory = step.plan(place.robot, place.q, checked=False)
                    self._ends[key] = trajectory.end
                    self._add(_PlannedMotion(index, step, trajectory, place.robot, place.path))
                    for reason in step.left_out(place.robot, place.q):
                        self._report(index, reason, place.path, "warning")
            except ArmctlError as cause:
                self._report(index, cause.reason, place.path, "error")
        return self._ends[key]

    def _report(self, index: int, why: Reason, path: Path, severity: Severity) -> None:
        refusal = Finding(_on(path, why), step=index, severity=severity)
        fact = (index, str(why), "")
        if fact not in self._reported:
            self._reported.add(fact)
            self.found.append(refusal)

    def _add(self, planned: _PlannedMotion) -> None:
        if self._planned:
            last = self._planned[-1]
            follows = (
                last.robot is planned.robot
                and last.step.leads_tool == planned.step.leads_tool
                and np.array_equal(last.trajectory.end, planned.trajectory.start)
            )
            if len(self._planned) == _TOGETHER or not follows:
                self._look_at(self._planned)
                self._planned = []
        self._planned.append(planned)

    def _look_at(self, planned: list[_PlannedMotion]) -> None:
        """Run the pre-flight: over all at once, and where that finds something, over ever fewer."""
        if len(planned) > _ALONE:
            if not self._clear_together(planned):
                half = len(planned) // 2
                self._look_at(planned[:half])
                self._look_at(planned[half:])
            return
        for it in planned:
            for one in preflight(it.robot, it.trajectory, self._payload_kg, tool_path=it.step.leads_tool):
                fact = (it.index, one.kind, one.part)
                if fact not in self._reported:  # the same from another place
                    self._reported.add(fact)
                    self.found.append(replace(one, step=it.index, reason=_on(it.path, one.reason)))

    def _clear_together(self, planned: Sequence[_PlannedMotion]) -> bool:
        """Whether nothing is found in motions that follow each other, nor touched at their start."""
        robot, trajectories = planned[0].robot, [it.trajectory for it in planned]
        motion = JoinedTrajectory(trajectories)
        start = robot.body_frames(motion.start[None])
        if any((source.gaps(start) < source.closed[:, None]).any() for source in sources(robot)):
            return False
        ends = np.array([trajectory.end for trajectory in trajectories])
        if isotropy_of(robot, robot.jacobian(ends))[0].min() < NEAR:
            return False
        return passes(robot, motion, self._payload_kg, tool_path=planned[0].step.leads_tool, warned=False)


def _merged(places: Iterable[_PathPlace | None]) -> _Places:
    """Places, each once; the path of one that several lead to is what they share."""
    found: _Places = {}
    for place in places:
        if place is None:
            continue
        other = found.get(place.key)
        found[place.key] = place if other is None else replace(other, path=_common((other, place)))
    return found


def _turned(place: _PathPlace, turn: PathTurn) -> _PathPlace:
    return replace(place, path=(*place.path, turn))


def _common(places: Iterable[_PathPlace]) -> Path:
    first, *others = [place.path for place in places]
    count = len(first)
    for path in others:
        count = min(count, len(path))
        while path[:count] != first[:count]:
            count -= 1
    return first[:count]


def _on(path: Path, why: Reason) -> Reason:
    return OnPath(path, why) if path else why


def _counter_ranges(steps: Sequence[Step]) -> dict[str, tuple[float, float]]:
    """The counters that conditions ask for, each with the range out of which all values are alike.

    One that only grows is as good as one above all that it is compared with; so a loop that counts ends.
    """
    compared: dict[str, list[float]] = {}
    for step in steps:
        if isinstance(step, ConditionStep) and step.condition.watch == COUNTER:
            compared.setdefault(step.condition.counter, []).append(step.condition.value)
    counts = [step.effect.counts for step in steps]
    ranges: dict[str, tuple[float, float]] = {}
    for name, values in compared.items():
        added = [one.after(0) for one in counts if one is not None and one.counter == name and one.adds]
        low, high = -math.inf, math.inf
        if all(add >= 0 for add in added):
            high = math.floor(max(values)) + 1
        if all(add <= 0 for add in added):
            low = math.ceil(min(values)) - 1
        ranges[name] = low, high
    return ranges
