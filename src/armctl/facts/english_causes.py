"""What is said of each cause of a tool that is off, in English."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from armctl.facts import causes
from armctl.facts.angles import in_degrees, to_degrees
from armctl.facts.reasons import Reason, in_millimetres

_ALONG = 0.98
"""share of a direction that makes it that of an axis"""
_NUMBERS = {
    "zero": "its zero", "sag": "its sag", "play": "its play", "scale": "its scale", "a": "the length a_mm",
    "d": "the length d_mm", "place": "the place of the points", "tilt": "the tilt of the points",
    "heading": "the heading of the points",
}  # fmt: skip


def _give(sd: float) -> str:
    return f"± {in_degrees(sd, '.1f')}"


def _figures(one: causes.FitFigures) -> str:
    def size(rms: float, largest: float) -> str:
        return f"RMS {1000 * rms:.2f} mm, largest {1000 * largest:.2f} mm"

    text = f"tool error of {one.count} points, each left out in turn: {size(one.before, one.before_largest)}"
    if not one.corrected:
        return text
    after = f"with the correction {size(one.after, one.after_largest)}"
    return f"{text}; {after}; to be expected nearby: {1000 * one.expected:.1f} mm"


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
        f"point {one.number} is {in_millimetres(one.away)} mm from where the others put it and was left out"
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
