"""What is said of each kind of reason, in English."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from armctl.facts.angles import in_degrees, to_degrees
from armctl.facts.program_paths import (
    CallCircle,
    CalledStep,
    CallMissing,
    CallTooDeep,
    CallTooLong,
    CallUnread,
    CellOutsideGrid,
    FrameNamedBase,
    InStep,
    NeverComes,
    NeverEnds,
    OnPath,
    PathsLeftOut,
    PathTurn,
    Unbounded,
    UnknownFrame,
)
from armctl.facts.quantities import LOAD_S, LevelPassed
from armctl.facts.reasons import (
    UNITS,
    AngleLimit,
    AngleNeeded,
    AtLimit,
    BeyondReach,
    Blocked,
    BranchEnds,
    MotionEndsMoving,
    Need,
    NoSteps,
    NotHomed,
    NotNow,
    OnCurve,
    OtherRobot,
    Overload,
    PitchDecided,
    RateLimit,
    Reason,
    ShownSoFar,
    Singular,
    SingularStart,
    SpeedJump,
    StandsOutside,
    State,
    ToDo,
    TooFewJoints,
    ToolGripsNot,
    ToolHoldsPart,
    ToolToConfirm,
    ToolWhileMoving,
    Unanswered,
    UnknownTool,
    UnmatchedBlock,
    WrongUnit,
    decimals_apart,
    limits_apart,
)
from armctl.facts.targets import NoRoomToTurn

_BY_HULLS = ", by convex hulls"
"""what is said of parts that are fitted to shapes: the shapes themselves may be hollow there"""
_HOME_FIRST = "press Homing (every axis moves to its switch)"
AT, STEP, MORE = "at {:.{}f} s, ", "step {}: ", " (and {} more)"
STATES = {state: state.value for state in State}
WRONG_UNIT = (
    "a wrong unit? Robot and armctl.motion count in metres and radians; Arm, programs, pages and the command "
    "line in millimetres and degrees"
)
_TO_DO = {
    "other pose": "choose another pose to enable in",
    "support and enable": "support the arm, release it (it drops) and enable again",
    "turn back": "release it and turn it back by hand, or press Homing",
    "mend pose": "mend the pose, take the nearest, or type a joint angle",
}
_WAYS = {
    "then": "step {0}: yes",
    "else": "step {0}: no",
    "pass": "step {0}: pass {1}",
    "cell": "step {0}: cell {1}",
}
_UNMATCHED = {
    "end": "'end' without a 'repeat', 'if' or 'while' before it; delete it, or add what it ends",
    "else": "'else' without an 'if' of its own before it; delete it, or add the 'if'",
}
_ALLOWS_OFF = (Need.OFF, Need.OFF_OR_HOLDING, Need.CONNECTED)


def _path(turns: tuple[PathTurn, ...]) -> str:
    return "; ".join(
        (f"{turn.program}, " if turn.program else "") + _WAYS[turn.way].format(turn.step + 1, turn.number)
        for turn in turns
    )


_MISSING = {
    "beside": "there is no program {0!r} beside the one that calls it; put the file there, or mend its name",
    "saved": "no saved program is called {0!r}; bring it in Files: Upload its file, then Save it as {0!r}",
    "sent": "the program {0!r} that it calls was not sent along",
}


def _inside(one: InStep) -> str:
    """Where inside a step: ``in 'grip', step 2: in 'turn', step 1, approach``."""
    calls = ": ".join(f"in {call.program!r}, step {call.step + 1}" for call in one.calls)
    return ", ".join(filter(None, (calls, one.doing)))


def _called(chain: tuple[str, ...]) -> str:
    return " → ".join(chain)


def _angle(one: AngleLimit) -> str:
    (angle,), low, high = limits_apart([one.angle], one.low, one.high)
    return f"{angle} is outside {low} … {high}"


def _stands(one: StandsOutside) -> str:
    angle, low, high = (to_degrees(value) for value in (one.angle, one.low, one.high))
    return f"{one.joint} stands at {angle:.1f}°, outside {low:.1f}° … {high:.1f}°"


def _keep_away(one: AngleLimit) -> str:
    other = "a way by another point" if one.between_links else "a straighter way"
    return f"keep away from this limit: another target, or {other}"


def _rate(one: RateLimit) -> str:
    unit, limit, value = UNITS[one.rate], to_degrees(one.limit), to_degrees(one.value)
    if not math.isfinite(value):
        return f"its speed jumps at a corner of the path; its limit is {limit:.1f} {unit}"
    shown = decimals_apart(value, limit, least=1)
    return f"{value:.{shown}f} {unit} is over its limit of {limit:.{shown}f} {unit}"


def _slower(one: RateLimit) -> str:
    if not math.isfinite(one.value):
        return "stop there, or round the path"
    return f"take {one.longer:.2f} times as long"


def _jump(one: SpeedJump) -> str:
    return f"its speed jumps by {to_degrees(one.jump):.2f} °/s between two parts of the motion"


def _blocked(one: Blocked) -> str:
    depth_mm, at_rest_mm = 1000 * one.depth_m, 1000 * one.at_rest_m
    if one.kind == "floor":
        return f"{depth_mm:.1f} mm below the floor"
    if one.surfaces:
        return f"{-depth_mm:.1f} mm from {one.other}" if depth_mm < 0.0 else f"touches {one.other}"
    hulls, rest = _BY_HULLS if one.fitted else "", f" ({at_rest_mm:.1f} mm at rest)" if at_rest_mm > 0 else ""
    return f"{depth_mm:.1f} mm inside {one.other}{hulls}{rest}"


def _round_it(one: Blocked) -> str:
    if one.kind == "floor":
        return "raise the target, or go round by a higher point"
    if one.kind == "obstacle":
        return f"choose another target, or go round {one.other} by another point"
    return f"choose another target, or go round by a point farther from {one.other}"


def _singular(one: Singular) -> str:
    percent = 100 * one.isotropy
    if percent < 0.1:
        return "singularity: the tool cannot move in one direction"
    return f"near a singularity: in one direction the tool is only {percent:.1f} % as fast as in the fastest"


def _by_joints(one: Singular) -> str:
    if one.lost:
        return "joint moves are fine; choose a line that does not pass there"
    return "joint moves are fine; a line or a tool jog from there would be slow, or refused"


def _overload(one: Overload) -> str:
    motor = f"its stall torque of {one.stall:.2f} N·m"
    if one.effort:
        motor = f"the effort of {one.stall:.3g} N·m that its URDF file gives"
    share = 100 * one.torque / one.stall
    return f"gravity loads it with {one.torque:.2f} N·m, {share:.0f} % of {motor} (counted: {one.counted})"


def _lighter(one: Overload) -> str:
    if one.effort:
        return f"if the motor is another one, write its stall_torque_nm of {one.joint} into the side file"
    if one.over:
        return "keep the load nearer to the joint, or take a lighter one"
    return "do not stay there for long: the motor gets hot"


_FREER = {
    "pitch kept": "only the tool pitch kept",
    "pitch free": "the tool pitch free",
    "orientation free": "the tool orientation free",
}


def _on_curve(one: OnCurve) -> str:
    x, y, z = (1000.0 * value for value in one.point_m)
    return f"{100.0 * one.fraction:.0f} % of the {one.curve} (x {x:z.1f}, y {y:z.1f}, z {z:z.1f} mm)"


def _too_few(one: TooFewJoints) -> str:
    wish = "turn the tool like this" if one.turns else "keep the tool's orientation"
    turn = f"{in_degrees(one.turn / 1000.0, '.3g')} a mm"
    return f"{one.joints} joints cannot {wish} here, it would also turn by {turn}"


def _in_its_plane(one: TooFewJoints) -> str:
    if one.has_plane:
        return "they can in the arm's own vertical plane, and with the tool straight up or down"
    return f"move the {one.curve}"


def angle_needed(one: AngleNeeded) -> str:
    """What is said of one, also inside of what is said of a target."""
    if not one.angles:
        low, high = map(in_degrees, (one.low, one.high))
        return f"before this branch ends, {one.joint} would have to leave its limits of {low} … {high}"
    angles, low, high = limits_apart(one.angles, one.low, one.high)
    needs = "needs" if one.percent is None else "would need"
    place = "" if one.percent is None else f"at {one.percent:.4g} % "
    return f"{place}{one.joint} {needs} {' or '.join(angles)}, its limits are {low} … {high}"


def _at_limit(one: AtLimit) -> str:
    needs = " and ".join(map(angle_needed, one.needs))
    return f"{_found(one)}{one.joint} is at its limit of {in_degrees(one.limit)}; {needs}"


def _found(one: AtLimit | BranchEnds) -> str:
    return "on the best way that was found, " if one.searched else ""


def _branch_ends(one: BranchEnds) -> str:
    rate = f"{in_degrees(one.turn / 1000.0, '.0f')} a mm"
    farther = "; at 100 %, " if one.at_end else ""
    return (
        f"{_found(one)}{one.joint} would have to turn by {rate}, and more just beyond: a singularity{farther}"
    )


def _other_ways(one: AtLimit | BranchEnds) -> str:
    if not one.branches:
        return f"move the {one.curve}"
    follow = "follows" if len(one.branches) == 1 else "follow"
    names = " or ".join(one.branches)
    return f"start on another branch ({names} {follow} the whole {one.curve}) or move the {one.curve}"


def _beyond_reach(one: BeyondReach) -> str:
    leaves = f"here it leaves what the arm reaches{f' with that {one.held}' if one.held else ''}"
    return leaves if one.why is None else f"{leaves}; at {one.percent} %, "


def _pitch_decided(one: PitchDecided) -> str:
    low, high = map(in_degrees, (one.low, one.high))
    return (
        f"the position alone decides this arm's tool pitch: along the {one.curve} it is {low} … {high}, "
        "so it cannot be kept or interpolated; choose free"
    )


def _level(one: LevelPassed) -> str:
    match one.quantity:
        case "load":
            load = f"load {100 * one.value:.0f} % for more than {LOAD_S:.0f} s"
            return f"{one.output}: {load}, its limit is {100 * one.reference:.0f} %"
        case "temperature":
            return f"{one.output}: {one.value:.0f} °C, it switches itself off at {one.reference:.0f} °C"
        case "voltage":
            return f"{one.output}: supply {one.value:.1f} V, without load it is {one.reference:.1f} V"


_LEVEL_ADVICE = {
    "load": "take load off, or choose a pose that carries less, before it gives way",
    "temperature": "let the arm rest where it hangs or lies, and take load off",
    "voltage": "look at plugs and cables, and take a supply that gives more current",
}


def _not_now(one: NotNow) -> str:
    why = _state(one)
    return f"{one.asked} needs the arm {one.need.value}, it is {why}" if one.asked else f"the arm is {why}"


def _state(one: NotNow) -> str:
    told, moves = f" ({one.cause})" if one.cause else "", one.state in (State.MOVING, State.PAUSED)
    if one.limp:
        return f"holding without {', '.join(one.limp)}; enable first"
    if one.state is State.DISCONNECTED:
        return f"disconnected; connect {'first' if one.need in _ALLOWS_OFF else 'and enable first'}"
    if one.state is State.OFF:
        return f"off; {'enable first' if one.homed else _HOME_FIRST}"
    if moves and one.stopping:
        return "stopping; wait until it stands"
    if moves and one.need is Need.PAUSE and one.doing:
        return f"{one.state.value}{told}; {one.doing} cannot be paused; press STOP"
    if moves and one.need is Need.GRIPPER:
        return f"{one.state.value}{told}; the gripper is not free: wait, or stop first"
    if moves and one.need is not Need.OFF:
        resumes = "resume, or " * (one.state is State.PAUSED)
        return f"{one.state.value}{told}; {resumes}stop first"
    if one.state is State.FAULT:
        return f"in fault{told}; {'clear the fault first' if one.connected else 'connect again'}"
    nothing = "there is nothing to pause" if one.need is Need.PAUSE else "the arm is enabled already"
    return f"{one.state.value}{told}; {nothing}"


WHAT: Mapping[type[Reason], Callable[[Any], str]] = {
    AngleLimit: _angle,
    NoRoomToTurn: lambda one: (
        f"{in_degrees(one.room, '.1f')} from its limit, too near to come from that side; "
        f"{in_degrees(one.needed, '.1f')} are needed"
    ),
    StandsOutside: _stands,
    WrongUnit: lambda _: WRONG_UNIT,
    ToDo: lambda one: _TO_DO[one.what],
    UnknownTool: lambda one: (
        f"the arm has no tool {one.name!r}; it has {', '.join(map(repr, one.known)) or 'none in its file'}"
    ),
    ToolGripsNot: lambda one: f"nothing grips with the tool {one.tool!r} on; put another one on first",
    ToolToConfirm: lambda one: (
        f"nobody has said since the board was connected which tool is on; it was {one.tool!r} last: look at "
        f"the arm, and choose one of {', '.join(map(repr, one.known))} (on the page, with arm.set_tool, with "
        "--tool)"
    ),
    ToolWhileMoving: lambda one: (
        f"a tool is changed only while the arm stands ({one.cause}); stop it, or wait"
    ),
    ToolHoldsPart: lambda one: f"the gripper holds a part of {one.size}; open it before the tool is changed",
    NotHomed: lambda _: f"the arm does not know where it is yet; {_HOME_FIRST}",
    OtherRobot: lambda one: f"it is for the robot {one.made_for!r}, this one is {one.this!r}",
    NoSteps: lambda _: "it has no steps",
    UnmatchedBlock: lambda one: _UNMATCHED.get(
        one.marker, f"this '{one.marker}' has no 'end'; add one behind the last step of its block"
    ),
    PathTurn: lambda one: _path((one,)),
    OnPath: lambda one: f" (path: {_path(one.turns)})",
    CellOutsideGrid: lambda _: "frame = 'cell' needs a 'grid' around it; add one, or leave frame out",
    CalledStep: lambda one: f"in {one.program!r}, step {one.step + 1}",
    InStep: _inside,
    CallMissing: lambda one: _MISSING[one.place].format(one.program),
    CallUnread: lambda one: f"the program {one.program!r} that it calls cannot be read: {one.why}",
    CallCircle: lambda one: f"programs call each other in a circle: {_called(one.chain)}; take one call out",
    CallTooDeep: lambda one: f"more than {one.most} programs call one another: {_called(one.chain)}",
    CallTooLong: lambda one: f"with the programs that it calls it has more than {one.most} steps",
    UnknownFrame: lambda one: (
        f"the program has no frame {one.name!r}; "
        + (f"it has {', '.join(map(repr, one.known))}, and 'base'" if one.known else "it has only 'base'")
    ),
    FrameNamedBase: lambda _: "a frame cannot be called 'base', which is that of the arm; rename it",
    NeverComes: lambda one: f"{one.what} can never come: nothing counts while the program waits",
    NeverEnds: lambda _: "this loop never ends: no pass changes what it asks",
    Unbounded: lambda _: (
        "how often this loop runs cannot be checked, it may be for ever; bound it with 'most'"
    ),
    PathsLeftOut: lambda one: (
        f"the program has too many paths: after {one.most} steps the check ended here; the rest is unchecked"
    ),
    ShownSoFar: lambda _: "the motion shown ends there",
    RateLimit: _rate,
    SpeedJump: _jump,
    MotionEndsMoving: lambda one: f"the motion {one.end} at {to_degrees(one.speed):.2f} °/s",
    Blocked: _blocked,
    Singular: _singular,
    Overload: _overload,
    OnCurve: _on_curve,
    TooFewJoints: _too_few,
    AngleNeeded: angle_needed,
    AtLimit: _at_limit,
    SingularStart: lambda one: f"the arm stands in a singularity and cannot begin this {one.curve}",
    BranchEnds: _branch_ends,
    BeyondReach: _beyond_reach,
    PitchDecided: _pitch_decided,
    NotNow: _not_now,
    Unanswered: lambda one: f"{one.what}; check {one.check}",
    LevelPassed: _level,
}
ADVICE: Mapping[type[Reason], Callable[[Any], str]] = {
    AngleLimit: _keep_away,
    NoRoomToTurn: lambda _: "come from the other side, or choose a pose that is farther from this limit",
    RateLimit: _slower,
    SpeedJump: lambda _: "let a part end as fast as the next one begins, or let both be at rest there",
    MotionEndsMoving: lambda _: "let it start and end at rest",
    Blocked: _round_it,
    Singular: _by_joints,
    Overload: _lighter,
    OnCurve: lambda one: f"with {_FREER[one.freer]} the arm can follow it" if one.freer else "",
    TooFewJoints: _in_its_plane,
    AtLimit: _other_ways,
    SingularStart: lambda _: "bend the arm first (turn a joint, or Main → Home where that pose is bent)",
    BranchEnds: _other_ways,
    BeyondReach: lambda one: f"move the {one.curve}" if one.why is None else "",
    LevelPassed: lambda one: _LEVEL_ADVICE[one.quantity],
}
