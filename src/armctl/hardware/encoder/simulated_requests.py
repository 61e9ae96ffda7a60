"""Requests to a simulated encoder board: taken apart and checked, before anything is done."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from armctl.hardware.encoder.axes import WIRE_RANGES
from armctl.hardware.encoder.simulated_axis import SimulatedAxis

_REACH_MS = 20
_REACH_RANGE_MS = (1, 1000)
_MOST_COUNTS = 1 << 31


class Refused(Exception):  # noqa: N818  not an error: what the board answers
    """The request is answered by ``err`` and has no effect."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(f"{code} {text}")


def number(word: str, low: int, high: int) -> int:
    """A decimal number within its range."""
    try:
        value = int(word)
    except ValueError:
        raise Refused("ARGS", f"{word} is no number") from None
    if not low <= value <= high:
        raise Refused("RANGE", f"{word} is outside {low} {high}")
    return value


def axis_number(word: str, axes: int) -> int:
    """The number of an axis that there is."""
    return number(word, 0, axes - 1)


def settings(words: Sequence[str]) -> dict[str, int]:
    """The ``key=value`` pairs of a CFG line."""
    found: dict[str, int] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or key not in WIRE_RANGES:
            raise Refused("ARGS", f"unknown key {key}")
        found[key] = number(value, *WIRE_RANGES[key])
    if not found:
        raise Refused("ARGS", "nothing to set")
    return found


def setpoints(words: Sequence[str], axes: int) -> tuple[dict[int, int], float]:
    """The counts by axis of a P line, and the seconds in which to be there."""
    if len(words) not in (axes, axes + 1):
        raise Refused("ARGS", f"P takes {axes} setpoints and a time")
    counts = {
        axis: number(word, -_MOST_COUNTS, _MOST_COUNTS - 1)
        for axis, word in enumerate(words[:axes])
        if word != "-"
    }
    reach_ms = number(words[axes], *_REACH_RANGE_MS) if len(words) > axes else _REACH_MS
    return counts, reach_ms / 1000.0


def check_setpoints(counts: dict[int, int], axes: Sequence[SimulatedAxis]) -> None:
    """Refuse all of them where one may not be."""
    for axis in counts:
        if not axes[axis].homed:
            raise Refused("NOTHOMED", str(axis))
    for axis, count in counts.items():
        low, high = axes[axis].settings["min"], axes[axis].settings["max"]
        if not low <= count <= high:
            raise Refused("LIMIT", f"{axis} {count} {low} {high}")


def homing_order(words: Sequence[str], axes: Sequence[SimulatedAxis]) -> list[int]:
    """The axes that a HOME line is about, in the order in which they are homed; unused ones are left out."""
    named = {axis_number(word, len(axes)) for word in words} or set(range(len(axes)))
    used = [axis for axis in named if axes[axis].settings["hord"]]
    for axis in used:
        own = axes[axis].settings
        if not own["min"] <= own["hpos"] <= own["max"]:
            raise Refused("RANGE", f"hpos outside min max, axis {axis}")
    return sorted(used, key=lambda axis: (axes[axis].settings["hord"], axis))


def check_pair(words: Sequence[str], axes: int) -> None:
    """Refuse what is neither two axes nor NONE."""
    if list(words) == ["NONE"]:
        return
    if len(words) != 2:
        raise Refused("ARGS", "PAIR takes two axes or NONE")
    first, second = (axis_number(word, axes) for word in words)
    if first == second:
        raise Refused("RANGE", "two axes")


def shown(values: Mapping[str, int], part: str) -> str:
    """The first or the second half of an axis's settings, as SHOW tells them."""
    keys = list(values)
    half = len(keys) // 2
    return " ".join(f"{key}={values[key]}" for key in (keys[:half] if part == "1" else keys[half:]))
