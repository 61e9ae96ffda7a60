"""What is said of a command that is refused, or ended before it was over, in English."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from armctl.facts import commands
from armctl.facts.commands import range_texts
from armctl.facts.reasons import Reason

_NOTHING = {
    "resume": "there is nothing to resume",
    "clear": "there is no fault to clear",
    "release": "nothing to release",
}
_NEWER = {
    "gripper": "a newer gripper command took its place",
    "edit": "another edit came after it",
}
_SHARES = {
    "speed": "a speed of",
    "opening": "an opening of",
    "torque limit": "a torque limit of",
    "input": "input {}:",
    "output": "output {}:",
    "gripper": "{}:",
}

_SAY_WHERE = (
    "Say where it stands: on the page, with armctl run --pose last (or a named pose, or joint angles "
    'in degrees), or with arm.enable(pose="last")'
)


def numbered(noun: str, numbers: Sequence[int]) -> str:
    """Channels, pins or servos as in an English sentence: "pin 3", "pins 3, 4"."""
    listed = ", ".join(map(str, numbers))
    return f"{noun} {listed}" if len(numbers) == 1 else f"{noun}s {listed}"


def out_of_range(value: float, low: float, high: float, unit: str = "") -> str:
    """English text for a number outside a range, with as many digits as tell it from both ends."""
    text, least, most = range_texts(value, low, high)
    space = " " if unit else ""
    return f"{text}{space}{unit} is outside {least} … {most}{space}{unit}"


def _took(one: commands.LineSlow) -> str:
    return f"took up to {1000 * one.took:.0f} ms" if math.isfinite(one.took) else "did not all come in time"


def _stopped(one: commands.Stopped) -> str:
    who = one.by or "you"
    if one.how == "unbegun":
        return f"stopped by {who} before it began"
    was = f"{one.what} was " if one.what else ""
    return f"{was}{one.how} by {who}{f': {one.note}' if one.note else ''}"


def _not_operator(one: commands.NotOperator) -> str:
    if one.operator:
        return f"{one.operator} operates the arm; take control first"
    if one.locked:
        return "the teacher has locked control; give the teacher's PIN"
    return "nobody operates the arm; take control first"


def _locked(one: commands.ControlLocked) -> str:
    pin = ", or give the teacher's PIN" if one.pin else ""
    return f"{one.by or 'the teacher'} has locked control; ask for it to be unlocked{pin}"


def _share(one: commands.ShareOutside) -> str:
    scale, unit = (1, "") if one.of in ("input", "output") else (100, "%")
    outside = out_of_range(scale * one.share, scale * one.low, scale * one.high, unit)
    return f"{_SHARES[one.of].format(one.name)} {outside}"


def _unknown(one: commands.UnknownName) -> str:
    known = ", ".join(one.known) or "none"
    if one.kind == "input":
        return f"there is no input {one.name!r}; the robot file has {known}"
    if one.robot:
        where = "; the robot file tells them" if one.kind == "output" and not one.known else ""
        return f"{one.robot} has no {one.kind} {one.name!r}; it has {known}{where}"
    return f"there is no {one.kind} {one.name!r}; there are {known}"


def _on(one: commands.ReleaseUnconfirmed) -> str:
    outputs = numbered(one.noun, one.outputs)
    if one.board:
        did = f"the {one.board} did not confirm the release of {outputs}; the arm may still be held"
        return f"{one.line}: {did}. Cut the servos' supply before you reach in"
    did = f"{outputs} did not confirm that the torque is off"
    return f"{one.line}: {did}; cut the power of the servos before you reach in"


WHAT: Mapping[type[Reason], Callable[[Any], str]] = {
    commands.Stopped: _stopped,
    commands.Released: lambda one: f"{'joints were' if one.joints else 'the arm was'} released ({one.by})",
    commands.NotOperator: _not_operator,
    commands.ControlLocked: _locked,
    commands.NothingTo: lambda one: f"{_NOTHING[one.do]}: {one.state.value}",
    commands.NoBoard: lambda _: "there is no board; connect first",
    commands.Disconnected: lambda one: (
        f"disconnected while {one.opening} was being opened" if one.opening else "disconnected"
    ),
    commands.Superseded: lambda one: _NEWER[one.by],
    commands.PlanningAlready: lambda _: "another motion is being planned; stop it first",
    commands.PlannedTooLong: lambda one: f"planning took longer than {one.limit_s:.0f} s; make it smaller",
    commands.StartLeft: lambda _: (
        "the arm no longer stands where the motion was planned from; ask for it again"
    ),
    commands.AfterGap: lambda one: (
        f"nothing ran for {one.gap_s:.1f} s before it could begin; ask for it again"
    ),
    commands.ShareOutside: _share,
    commands.NotDigital: lambda one: f"output {one.name} is digital: 0 or 1, not {one.value:g}",
    commands.UnknownName: _unknown,
    commands.NoSuchStep: lambda one: f"{one.program} has no step {one.step}; it has {one.steps}",
    commands.PoseUnknown: lambda one: (
        f"nobody knows where the arm is{f' ({one.last})' if one.last else ''}: {one.power} are off. "
        f"{_SAY_WHERE}"
    ),
    commands.NothingOn: lambda one: f"{'; '.join(one.errors)}; nothing was switched on",
    commands.LineSlow: lambda one: (
        f"the line is too slow: the board's answers {_took(one)}, at most {1000 * one.most:.0f} ms are safe; "
        "nothing was switched on. Check USB hub, network and baud rate"
    ),
    commands.MotorsApart: lambda one: (
        f"the two motors of {', '.join(one.joints)} stand apart, one of them would be driven to the other; "
        "release the arm, put them right and enable again"
    ),
    commands.ReadingsDiffer: lambda one: (
        f"two readings of the board differ ({', '.join(one.joints)}); let it stand and try again"
    ),
    commands.OnUnconfirmed: lambda one: (
        f"the board has not confirmed that its {one.power} are on, and some may be: keep clear, see that it "
        "has power, press Release, and try again"
    ),
    commands.ReleaseUnconfirmed: _on,
}
