"""What is said of each reason why a target has no solution, in English."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from armctl.facts import targets
from armctl.facts.angles import in_degrees
from armctl.facts.causes import in_signed_millimetres
from armctl.facts.english import angle_needed
from armctl.facts.reasons import Reason, in_millimetres

_SIDES = {None: "", "facing": "facing it, ", "over the back": "over the back, "}
_LEAST = "at the least, "
_AT_THE_PITCH = " at that pitch"
_ORIENTATIONS = {"": "", "pitch kept": " with that pitch", "any": ", whatever the orientation,"}
_NO_SUCH_ANGLE = {
    "pitch": "this arm's tool does not keep to its vertical plane, so it has no pitch to ask for",
    "roll": "this arm has no joint that rolls the tool",
    "elevation": "the tool's elevation is between -90° and 90°, no pose has another pitch",
}


def _way(one: targets.JointsNeeded) -> str:
    return _SIDES[one.side] + (" and ".join(map(angle_needed, one.needs)) or "the links do not reach it")


def _joints(one: targets.JointsNeeded) -> str:
    return f"{_LEAST if one.least else ''}{_way(one)}"


def _forbid(one: targets.LimitsForbid) -> str:
    said = f"within the links' reach{_AT_THE_PITCH if one.pitched else ''}, but joint limits forbid it"
    least = _LEAST if any(way.least for way in one.ways) else ""
    return f"{said}: {least}{'; '.join(map(_way, one.ways))}" if one.ways else said


def _miss(miss_m: float, *, far: bool) -> str:
    return f"{'too far' if far else 'inside the dead zone, too near'} by {in_millimetres(miss_m)} mm"


def _out_of_reach(one: targets.OutOfReach) -> str:
    shoulder = f"from the {one.shoulder.lower() or 'shoulder'}"
    after = f" with the tool{_AT_THE_PITCH}" if one.pitched else ""
    away = "" if one.distance_m is None else f"the {one.point} would be {1000 * one.distance_m:.1f} mm "
    where = f"{_SIDES[one.side]}{away}{shoulder}{after}"
    several = one.links == "two links"
    reach = "reach" if several else "reaches"
    fold = "fold no closer than" if several else "folds no closer than"
    limit = f"the {one.links} {reach if one.far else fold} {1000 * one.length_m:.1f} mm"
    return f"{_miss(one.miss_m, far=one.far)}: {where}, {limit}"


def _out_of_bound(one: targets.OutOfBound) -> str:
    x, y, z = (1000.0 * value for value in one.centre_m)
    where = f"({x:z.1f}, {y:z.1f}, {z:z.1f}) mm on the axis of {one.joint}"
    limit = "the links together reach" if one.far else "the links fold no closer than"
    away = f"the target is {1000 * one.distance_m:.1f} mm from {where}"
    return f"{_miss(one.miss_m, far=one.far)}: {away}, {limit} {1000 * one.length_m:.1f} mm"


def _cylinder(one: targets.InsideCylinder) -> str:
    radius = f"{1000 * one.radius_m:.2f} mm"
    return (
        f"inside the {radius} cylinder about the base axis that the tip cannot enter: the target is "
        f"{1000 * one.distance_m:.2f} mm from the axis, the tool plane passes it at {radius}"
    )


def _beside_axis(one: targets.BesideAxis) -> str:
    away = f"the target is {1000 * one.distance_m:.1f} mm from the base axis"
    miss = _miss(one.radius_m - one.distance_m, far=False)
    return f"{miss}: {away}, the arm stays {1000 * one.radius_m:.1f} mm"


def _between(one: targets.BetweenReaches) -> str:
    near, far, least, most = (1000.0 * value for value in (one.near_m, one.far_m, one.least_m, one.most_m))
    return (
        f"neither way round: the wrist would be {near:.1f} mm or {far:.1f} mm from the shoulder, the "
        f"two links reach from {least:.1f} mm to {most:.1f} mm"
    )


def _by_position(one: targets.PitchByPosition) -> str:
    pitches = " or ".join(dict.fromkeys(map(in_degrees, one.pitches)))
    return (
        "that pitch is impossible here: with two pitch joints the position alone decides it; "
        f"the links would give {pitches}, within limits or not"
    )


def _pitch_outside(one: targets.PitchOutside) -> str:
    held = f" with {one.joint} at {in_degrees(one.held)}" if one.joint else ""
    return (
        "that pitch is impossible here: at this point the arm holds its tool at "
        f"{in_degrees(one.low)} … {in_degrees(one.high)}{held}, "
        f"the nearest to it is {in_degrees(one.nearest)}"
    )


def _off_rotation(one: targets.OffRotation) -> str:
    return (
        "the arm reaches that point, but not in that orientation: the nearest that was found there is "
        f"{in_degrees(one.angle, '.3g')} off"
    )


def _impossible(one: targets.OrientationImpossible) -> str:
    if one.proven:
        return "the links do not allow the one asked for, whatever the joint limits"
    return "none was found without the joint limits, either"


def _not_found(one: targets.NotFound) -> str:
    turned = ", in any orientation" if one.turned else ""
    nearer = f"none of {one.starts} starts came nearer than {in_millimetres(one.away_m)} mm"
    return f"no solution was found{turned}: {nearer}"


def _pitch_not_found(one: targets.PitchNotFound) -> str:
    return (
        f"the arm reaches that point, but none of {one.starts} starts found a pitch of "
        f"{in_degrees(one.asked)} there: the nearest is {in_degrees(one.nearest)}"
    )


def _not_in_orientation(one: targets.NotInOrientation) -> str:
    pitched = _AT_THE_PITCH if one.pitched else ""
    return f"the arm reaches it{pitched}, but not with the orientation that was asked for"


def _held(one: targets.HeldAtLimit) -> str:
    return f"{one.joint} is at its limit of {in_degrees(one.limit)}"


def _nearest(one: targets.NearestPoint) -> str:
    x, y, z = (1000.0 * value for value in one.point_m)
    inside = "inside the joint limits " if one.held else ""
    held = f", where {' and '.join(map(_held, one.held))}" if one.held else ""
    point = f"({x:z.1f}, {y:z.1f}, {z:z.1f}) mm, {in_millimetres(one.away_m)} mm away"
    return f"{inside}the nearest reachable point{_ORIENTATIONS[one.orientation]} is {point}{held}"


_AT_ANY_ANGLE = {
    "target on base axis": "the target is on the base axis, so that any angle of {} will do",
    "wrist on shoulder axis": "the wrist is on the shoulder's axis, so that any angle of {} will do",
    "centre of wrist": "the wrist's centre is on the axis of {}, which may be at any angle: one is listed",
}


def _in_steps(one: targets.ListedInSteps) -> str:
    return (
        f"listed in steps of {in_degrees(one.step, '.6g')} of {one.joint}; a run of solutions shorter than "
        "that, and further ways of a singular pose, may be missing"
    )


def _may_turn(one: targets.MayTurn) -> str:
    *others, last = one.joints
    joints = f"{', '.join(others)} and {last} may turn together" if others else f"{last} may turn"
    return f"{joints} while the tool stays: of a continuum some are listed"


def _turn_together(one: targets.TurnTogether) -> str:
    joints = f"{' and '.join(one.joints)} can turn against each other" if one.joints else "joints can turn"
    return f"singular: {joints} here without moving the tool; a spread of that continuum is listed"


def _one_line(one: targets.OneLine) -> str:
    return (
        f"the axes of {' and '.join(one.joints)} are one line here, so that only the {one.counts} of their "
        "angles counts: one pair is listed"
    )


def _instead(one: targets.Instead) -> str:
    if one.branch:
        return f"the nearest point needs {one.branch}: the arm keeps its posture and waits"
    return "the arm waits" if one.what == "wait" else "following the nearest point"


def _unmet(one: targets.PoseUnmet) -> str:
    why = "" if one.reason else "its joint angles are still being computed"
    return f"the pose fields and the joint angles are not the same pose: {why}"


def _left_out(one: targets.StrokeLeftOut) -> str:
    begin, end, length = (f"{1000 * value:.1f}" for value in (one.begin, one.end, one.length))
    part = (begin, end) != ("0.0", length)
    said = "stroke {n} (line {l} of the file) is left out"
    if part:
        said = "stroke {n} (line {l} of the file) is left out from {a} to {b} of {c} mm"
    filled = said.format(n=one.stroke, l=one.line, a=begin, b=end, c=length)
    return filled if one.why is None else f"{filled}: "


def _step(one: targets.ToolStepRefused) -> str:
    step = f"{in_signed_millimetres(one.step_m)} mm (x, y, z of the base) from here"
    if one.turns is None:
        return f"{step} is out of reach; step elsewhere"
    turns = in_degrees(one.turns, ".0f")
    return f"{step} would turn a joint by more than {turns}: take a smaller step, or go there with Go"


WHAT: Mapping[type[Reason], Callable[[Any], str]] = {
    targets.JointsNeeded: _joints,
    targets.LimitsForbid: _forbid,
    targets.OutOfReach: _out_of_reach,
    targets.OutOfBound: _out_of_bound,
    targets.InsideCylinder: _cylinder,
    targets.BesideAxis: _beside_axis,
    targets.BetweenReaches: _between,
    targets.NoSuchAngle: lambda one: _NO_SUCH_ANGLE[one.what],
    targets.PitchByPosition: _by_position,
    targets.PitchOutside: _pitch_outside,
    targets.PitchOfRods: lambda one: (
        f"the rods keep the tool at a pitch of {in_degrees(one.kept)}; {in_degrees(one.asked)} cannot be had"
    ),
    targets.NotInOrientation: _not_in_orientation,
    targets.OffRotation: _off_rotation,
    targets.OrientationImpossible: _impossible,
    targets.OrientationNeeds: lambda one: f"for the one asked for, {_joints(one.way)}",
    targets.NoOrientationNear: lambda _: "no orientation near the one asked for was found",
    targets.NotFound: _not_found,
    targets.PitchNotFound: _pitch_not_found,
    targets.NoneWithoutLimits: lambda one: f"even without joint limits, none of {one.starts} led there",
    targets.MayExist: lambda _: "there may be one that was not found",
    targets.Searched: lambda one: (
        f"found by search, there may be others{': they form a continuum' if one.continuum else ''}"
    ),
    targets.MoreByTurns: lambda one: f"{one.count} more differ by whole turns",
    targets.ListedAt: lambda one: (
        f"{one.joint} is free, too: listed is what there is with it at {in_degrees(one.angle)}"
    ),
    targets.ListedInSteps: _in_steps,
    targets.MayTurn: _may_turn,
    targets.AnyAngle: lambda one: _AT_ANY_ANGLE[one.what].format(one.joint),
    targets.TurnTogether: _turn_together,
    targets.OneLine: _one_line,
    targets.MayBeHidden: lambda _: "close to a singular pose: rounding may hide further solutions",
    targets.LostAtLimit: lambda one: (
        f"a solution with {one.joint} at its limit may be missing: rounding decides about it"
    ),
    targets.Instead: _instead,
    targets.PoseUnmet: _unmet,
    targets.StrokeLeftOut: _left_out,
    targets.ToolStepRefused: _step,
    targets.OtherConfiguration: lambda _: "the arm would have to change its configuration there",
    targets.Besides: lambda _: "besides, ",
    targets.ReachedFree: lambda one: (
        f"the arm reaches this point, but not with that {one.without}: leave the {one.without} empty"
    ),
    targets.AtRoll: lambda one: f"with {one.joint} at {in_degrees(one.roll)}, where it comes nearest: ",
    targets.AtPoint: lambda one: f"point {one.number} of {one.count}: ",
    targets.HeldAtLimit: _held,
    targets.NearestPoint: _nearest,
    targets.PointReached: lambda _: "the point itself can be reached",
}
"""Of reasons with a reason inside (``PoseUnmet``, ``StrokeLeftOut``, …) what is said ahead of that."""
