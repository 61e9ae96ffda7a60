"""What is said of each cause of a tool that is off, in English."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from armctl.facts import causes
from armctl.facts.angles import in_degrees, to_degrees
from armctl.facts.reasons import Reason, decimals_apart, in_millimetres

_ALONG = 0.98
"""share of a direction that makes it that of an axis"""
_NUMBERS = {
    "zero": "its zero", "sag": "its sag", "play": "its play", "scale": "its scale", "a": "the length a_mm",
    "d": "the length d_mm", "place": "the place of the points", "tilt": "the tilt of the points",
    "heading": "the heading of the points",
}  # fmt: skip

_TOO_FEW = {
    "marks": "{} marks are too few: {} are needed, far apart; with 4 or more a wrong one is named",
    "touches": "{} touches are too few: touch the point from {} sides at least, the tool turned as far as it "
    "can be in between",
    "points": "{} points are too few: touch {} at least, better 10, in different poses of the arm",
}


def _narrow(one: causes.MarksNarrow) -> str:
    spread, least = to_degrees(one.spread), to_degrees(one.least)
    angle = f"{spread:.{decimals_apart(spread, least, least=1)}f}°"
    return (
        f"the angles of the marks spread over {angle} only: take them "
        f"further apart, over {least:.0f}° at least, better over the whole range of the joint"
    )


def _give(sd: float) -> str:
    return f"± {in_degrees(sd, '.1f')}"


def _figures(one: causes.FitFigures) -> str:
    def size(rms: float, largest: float) -> str:
        return f"RMS {1000 * rms:.2f} mm, largest {1000 * largest:.2f} mm"

    text = f"tool error of {one.count} points, each left out in turn: {size(one.before, one.before_largest)}"
    if not one.corrected:
        return text
    after = f"with the correction {size(one.after, one.after_largest)}"
    return f"{text}; {after}; nearby {1000 * one.low:.1f} … {1000 * one.high:.1f} mm RMS (9 of 10)"


def _length(one: causes.LengthOff) -> str:
    old, new = 1000 * one.old, 1000 * (one.old + one.off)
    sure = f"{1000 * one.off:+.1f} mm ± {1000 * one.sd:.1f}"
    return f"{one.key}_mm of DH row {one.row} is {new:.1f} mm, not {old:.1f} ({sure})"


def _tip(one: causes.TaughtTip) -> str:
    x, y, z = (f"{1000 * value:.2f}" for value in one.offset)
    return (
        f"the tip is ({x}, {y}, {z}) mm from the tool point of the robot, along the axes of the tool, "
        f"± {1000 * one.sd:.2f} mm; {one.count} touches meet within {1000 * one.residual:.2f} mm (RMS), "
        f"touch {one.worst} is off most: {1000 * one.away:.2f} mm"
    )


def _axis(axis: tuple[float, float, float]) -> str:
    largest = max(range(3), key=lambda i: abs(axis[i]))
    if abs(axis[largest]) > _ALONG:
        return f"the tool's {'xyz'[largest]} axis"
    return "the direction ({}) of the tool".format(", ".join(f"{value:.2f}" for value in axis))


WHAT: Mapping[type[Reason], Callable[[Any], str]] = {
    causes.ZeroOff: lambda one: f"zero off by {to_degrees(one.off):+.1f}° ({_give(one.sd)})",
    causes.Sags: lambda one: f"sags by {in_degrees(one.angle, '.1f')} stretched out ({_give(one.sd)})",
    causes.HasPlay: lambda one: f"{in_degrees(one.angle, '.1f')} play ({_give(one.sd)})",
    causes.ScaleOff: lambda one: f"turns {100 * one.share:+.1f} % too far (± {100 * one.sd:.1f} %)",
    causes.LengthOff: _length,
    causes.PlaceOff: lambda one: f"all points lie {in_millimetres(one.off)} mm further along this axis",
    causes.MistakenPoint: lambda one: (
        f"point {one.number} is {in_millimetres(one.away)} mm from where the others put it and was left out; "
        f"the tip was {causes.in_signed_millimetres(one.off)} mm (x, y, z) from there"
    ),
    causes.WorstPoint: lambda one: (
        f"point {one.number} fits worst: the tip was {causes.in_signed_millimetres(one.off)} mm (x, y, z) "
        "from where the others put it"
    ),
    causes.NotTold: lambda one: f"these points do not tell {_NUMBERS[one.what]}; it stays as it is",
    causes.FitFigures: _figures,
    causes.GoodAlready: lambda one: (
        f"no number explains the error better than chance: {in_millimetres(one.rms)} mm is what touching "
        "points can tell"
    ),
    causes.NotBetter: lambda one: (
        f"no correction is better at points that were left out: {in_millimetres(one.before)} mm without, "
        f"{in_millimetres(one.after)} mm with the best"
    ),
    causes.TaughtTip: _tip,
    causes.TipAsBefore: lambda _: "the tip is where the robot has it, as far as touches can tell",
    causes.TipUntold: lambda one: (
        f"where the tip is along {_axis(one.axis)} is told to ± {1000 * one.sd:.1f} mm only: the tool was "
        "turned little about other axes"
        if one.sd is not None
        else f"where the tip is along {_axis(one.axis)} is not told: the tool was turned about that axis "
        "only; it stays as it is"
    ),
    causes.TooFew: lambda one: _TOO_FEW[one.of].format(one.count, one.least),
    causes.MarksTogether: lambda one: (
        f"the marks are at {one.places} places only: take them at {one.least} or more, spread over the "
        "joint's range"
        if one.output is None
        else f"all marks are at one place, {one.output:.1f} {one.unit}: move the joint between the marks"
    ),
    causes.MarksNarrow: _narrow,
    causes.PointsTogether: lambda one: (
        f"the points are all within {1000 * one.within:.0f} mm of each other: spread them over the arm's "
        "workspace"
    ),
    causes.ToolTurnedLittle: lambda one: (
        f"the tool was turned by {in_degrees(one.turn, '.0f')} only from touch to touch: turn it by 60° or "
        "more, else its tip cannot be told"
    ),
    causes.PlanePointsNear: lambda one: (
        f"touched points {one.first} and {one.second} are {1000 * one.apart:.1f} mm apart; at least "
        f"{1000 * one.least:g}"
    ),
    causes.PlanePointsInLine: lambda _: (
        "the three touched points stand nearly in one line; touch the third aside of it"
    ),
    causes.PlaneFromBelow: lambda _: (
        "seen from above the third point lies to the right of the way from the first to the second, so the "
        "pen would come from below; touch it on the other side"
    ),
    causes.PlanePointOff: lambda one: (
        f"touched point {one.number} lies {1000 * one.off:.1f} mm off the plane of the first three; at most "
        f"{1000 * one.most:g}"
    ),
    causes.PlaneOutOfReach: lambda _: (
        "no size of it is wholly in reach on this plane; touch the plane where the arm reaches well"
    ),
}
ADVICE: Mapping[type[Reason], Callable[[Any], str]] = {
    causes.ZeroOff: lambda one: (
        "save the correction, or put the horn on anew" if abs(one.off) < 0.17 else "put the horn on anew"
    ),
    causes.Sags: lambda _: "save the correction; carry less, or stiffen the bracket",
    causes.HasPlay: lambda _: "tighten the horn and the screws of this joint",
    causes.ScaleOff: lambda _: "measure this joint with a protractor (Calibration → Joints)",
    causes.LengthOff: lambda _: "measure it, and enter it in the robot file",
    causes.PlaceOff: lambda _: "measure anew where the points are",
    causes.MistakenPoint: lambda _: "touch it again",
    causes.NotBetter: lambda _: "touch more points, in poses that differ more, from both sides",
    causes.TipUntold: lambda _: "turn the tool farther about another axis, too",
}
