"""What befalls an arm in each phase on each board, and what comes of it: one row a cell."""

from __future__ import annotations

import errno
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from itertools import cycle, groupby, islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.faults.kit import OTHER_PORT, PORT, ROBOTS, Bench
from tests.runtime.kit import TEST, TICK

from armctl.arrays import FloatArray
from armctl.facts import State
from armctl.hardware.boards import board_type
from armctl.protocol import ClearFault, Connect, Enable, HomeAxes, Jog, MoveJoints, Release

_SETTLES_S = 12.0
_IDLE_S, _IDLE_TICK_S = 3.0, 0.05
_RESTS = {"maestro": 1.0, "firmata": 1.0, "encoder": 12.0, "feetech": 12.0, "dynamixel": 12.0}
"""board units (µs, counts, steps) by which an output at rest may differ: a motor has yet to settle"""
_NOT_FOR_PEOPLE = re.compile(r"Traceback|\w+(Error|Exception)\b|internal error|\bNone\b|\bnan\b|\[Errno|<")
_ADVICE = re.compile(
    r"\b(check|connect|clear|enable|press|ask|see to|release|plug|close|say|home again|cut)", re.I
)
_OFF = ("unplug", "replug", "brown-out", "reset")
_LINE = ("drop", "delay", "garble", "half", "double")


def ready(bench: Bench) -> None:
    """Connected, homed or enabled, holding."""
    bench.does(Connect(PORT), State.OFF)
    if bench.kind == "encoder":
        bench.does(HomeAxes(), State.HOLDING, seconds=180.0)
    else:
        bench.does(Enable(None if bench.measures else bench.robot.pose("home")), State.HOLDING)


def goal(bench: Bench, degrees: float = 15.0) -> FloatArray:
    """Each joint a little nearer to the middle of its range."""
    home, middle = bench.robot.pose("home"), bench.robot.limits.mean(axis=1)
    return home + np.clip(middle - home, -np.radians(degrees), np.radians(degrees)) + 0.02


# Phases: each leaves the arm in the middle of something.


def connecting(bench: Bench) -> None:
    pass


def enabling(bench: Bench) -> None:
    if bench.measures:
        ready(bench)
        bench.does(Release(), State.OFF)
        bench.run(0.3)
    else:
        bench.does(Connect(PORT), State.OFF)
        bench.ask(Enable(bench.robot.pose("home")))
        bench.run(0.7)
        assert bench.now.state is State.MOVING


def homing(bench: Bench) -> None:
    bench.does(Connect(PORT), State.OFF)
    bench.ask(HomeAxes())
    bench.run(1.0)
    assert bench.homes


def holding(bench: Bench) -> None:
    ready(bench)


def moving(bench: Bench) -> None:
    ready(bench)
    bench.ask(MoveJoints(goal(bench), duration_s=2.0))
    bench.run(0.9)
    assert bench.now.velocity_command.any()


def stopping(bench: Bench) -> None:
    ready(bench)
    bench.ask(MoveJoints(goal(bench, 40.0)))
    bench.run(0.4)
    bench.controller.stop(TEST)
    bench.tick()
    assert bench.now.velocity_command.any()


def jogging(bench: Bench) -> None:
    """As for the marks of a calibration: a button is held, the fault comes, the button is held on."""
    ready(bench)
    bench.hold = Jog(np.where(np.arange(bench.robot.n) == 0, 0.3, 0.0))
    bench.run(0.5)
    assert bench.now.velocity_command.any()


PHASES: dict[str, Callable[[Bench], None]] = {
    one.__name__: one for one in (connecting, enabling, homing, holding, moving, stopping, jogging)
}


# Faults: each strikes, and gives what makes it good again.


def bad_line(kind: str, bench: Bench) -> Callable[[], None]:
    bench.trouble({"drop": "drop@0+2", "delay": "delay=0.4@0+2"}.get(kind, f"{kind}:0.5@0+2"))
    return bench.trouble


def unplug(bench: Bench) -> Callable[[], None]:
    bench.line.unplug()
    return bench.line.plug_in


def replug(bench: Bench) -> Callable[[], None]:
    """Pulled, and back at once; the computer gives it another name."""
    bench.line.unplug()
    bench.tick()
    bench.line.plug_in()
    bench.port = OTHER_PORT
    return lambda: None


def brown_out(bench: Bench) -> Callable[[], None]:
    bench.line.advance(bench.clock.now())
    bench.line.brown_out(0.5)
    return lambda: None


def reset(bench: Bench) -> Callable[[], None]:
    bench.line.reset()
    return lambda: None


def busy(bench: Bench) -> Callable[[], None]:
    bench.busy = True
    return partial(setattr, bench, "busy", False)


def frozen(seconds: float, bench: Bench) -> Callable[[], None]:
    bench.clock.advance(seconds)
    return lambda: None


def wall_clock(shift_s: float, bench: Bench) -> Callable[[], None]:
    for module in ("notices", "last_pose", "black_box"):
        bench.patch.setattr(f"armctl.runtime.{module}.wall_time", lambda: 1.7e9 + shift_s)
    return lambda: None


def disk(number: int, bench: Bench) -> Callable[[], None]:
    def refused(*_: Any, **__: Any) -> None:
        raise OSError(number, os.strerror(number))

    bench.patch.setattr(tempfile, "mkstemp", refused)
    return lambda: None


FAULTS: dict[str, Callable[[Bench], Callable[[], None]]] = {
    **{kind: partial(bad_line, kind) for kind in _LINE},
    "unplug": unplug,
    "replug": replug,
    "brown-out": brown_out,
    "reset": reset,
    "busy": busy,
    "frozen": partial(frozen, 0.8),
    "suspended": partial(frozen, 600.0),
    "clock+1d": partial(wall_clock, 86400.0),
    "clock-1d": partial(wall_clock, -86400.0),
    "disk-full": partial(disk, errno.ENOSPC),
    "disk-read-only": partial(disk, errno.EROFS),
    "client-lost": lambda bench: bench.lose_client(),
    "arm-dead": lambda bench: bench.die(),
}


# The table. States are those that the arm may have settled in: D disconnected, O off, H holding, F fault.
# The words are told to whoever looks at the arm: in its cause, a warning, its log or the answer to a
# command. A Maestro that is reset between two setpoints comes on again with the next one, where the arm is:
# its answers do not show it, and nothing jumps.

_GONE = "unplugged; plug it in and connect again"
_LOST = "lost the board: .*check the cable and the power, then connect again"
_SILENT = (
    "check (the cable and the board's|cable, USB hub)|set the serial mode|load the sketch|Are they powered"
    "|does not answer; look at its plug"
)
_RESTARTED = (
    "(switched the (pulses|motors) off by itself|no longer drives pin|has restarted|has started anew).*"
    "(check its power|check the supply|home again)"
)
_GAP = "nothing ran for (0.[5-9]|600.0) s .*(ask for it again|looked at first)|watchdog"
_FOUND = "are on already: Enable takes the arm over where it is|motors are off"
_DISK = "the last pose of the arm cannot be kept .*(No space left|Read-only).*must be told where it stands"

TABLE = rf"""
# a fault, in a phase: on maestro, firmata, encoder, feetech, dynamixel; words
drop           connecting DO   DO   DO   DO   DO   {_SILENT}|connected to
drop           enabling   F    F    F    F    F    {_LOST}|did not answer 'EN 1'
drop           homing     -    -    F    -    -    {_LOST}; and .* does not confirm that it holds; cut
drop           holding    F    F    F    F    F    {_LOST}
drop           moving     F    F    F    F    F    {_LOST}
drop           stopping   F    F    F    F    F    {_LOST}
drop           jogging    F    F    F    F    F    {_LOST}
delay          connecting DO   DO   DO   DO   DO   {_SILENT}|connected to
delay          enabling   FO   F    F    OFH  OFH  {_LOST}|did not answer 'EN 1'|nothing ran|{_SILENT}|enabled
delay          homing     -    -    OF   -    -    watchdog: the board heard nothing from this computer
delay          holding    FH   F    F    FH   FH   {_LOST}|watchdog|{_SILENT}|{_GAP}
delay          moving     FH   F    F    FH   FH   {_LOST}|watchdog|{_SILENT}|{_GAP}
delay          stopping   FH   F    F    FH   FH   {_LOST}|watchdog|{_SILENT}|{_GAP}|stopped by test
garble         connecting DO   DO   DO   DO   DO   {_SILENT}|connected to
garble         enabling   OF   FO   FH   OFH  OFH  serial protocol error|by itself|{_LOST}|enabled|{_SILENT}
garble         homing     -    -    OFH  -    -    watchdog|finished
garble         holding    FH   FH   FH   FH   FH   by itself|{_LOST}|{_SILENT}|of the questions
garble         moving     FH   FH   FH   FH   FH   by itself|{_LOST}|check the supply|{_SILENT}
garble         stopping   FH   FH   FH   FH   FH   by itself|{_LOST}|check the (supply|USB cable)|{_SILENT}
half           connecting DO   DO   DO   DO   DO   {_SILENT}|connected to
half           enabling   F    F    F    OFH  OFH  by itself .*check its power|{_LOST}|{_SILENT}
half           homing     -    -    OF   -    -    watchdog
half           holding    FH   F    FH   FH   FH   by itself|{_LOST}|{_SILENT}
half           moving     FH   F    FH   FH   FH   by itself|{_LOST}|{_SILENT}
half           stopping   FH   F    FH   FH   FH   by itself|{_LOST}|{_SILENT}
double         connecting O    O    O    O    O    connected to
double         enabling   H    H    H    H    H    enabling finished|enabled
double         homing     -    -    H    -    -    homing finished
double         moving     H    H    H    H    H    move finished
double         stopping   H    H    H    H    H    stopped by test
unplug         connecting D    D    D    D    D    {_GONE}
unplug         enabling   F    F    F    F    F    {_GONE}
unplug         homing     -    -    F    -    -    {_GONE}
unplug         holding    F    F    F    F    F    {_GONE}
unplug         moving     F    F    F    F    F    {_GONE}
unplug         stopping   F    F    F    F    F    {_GONE}
unplug         jogging    F    F    F    F    F    {_GONE}
replug         connecting D    D    D    D    D    {PORT}: no such port; is the board plugged in\?
replug         enabling   F    F    F    F    F    {_GONE}
replug         homing     -    -    F    -    -    {_GONE}
replug         holding    F    F    F    F    F    {_GONE}
replug         moving     F    F    F    F    F    {_GONE}
replug         stopping   F    F    F    F    F    {_GONE}
brown-out      connecting DO   DO   DO   DO   DO   {_SILENT}|connected to
brown-out      enabling   F    F    FO   FO   FO   {_RESTARTED}|did not answer ('EN 1'|where it is)
brown-out      homing     -    -    OF   -    -    {_RESTARTED}
brown-out      holding    F    F    F    F    F    {_RESTARTED}
brown-out      moving     F    F    F    F    F    {_RESTARTED}
brown-out      stopping   F    F    F    F    F    {_RESTARTED}
reset          connecting O    O    O    O    O    connected to
reset          enabling   F    F    O    H    H    {_RESTARTED}|enabled
reset          homing     -    -    O    -    -    {_RESTARTED}
reset          holding    F    F    F    F    F    {_RESTARTED}
reset          moving     HF   F    F    F    F    {_RESTARTED}|move finished
reset          stopping   HF   F    F    F    F    {_RESTARTED}|stopped by test
busy           connecting D    D    D    D    D    in use by another program .*close that and try again
frozen         connecting O    O    O    O    O    connected to
frozen         enabling   O    O    O    O    O    {_GAP}
frozen         homing     -    -    O    -    -    {_GAP}
frozen         holding    H    H    F    H    F    {_GAP}
frozen         moving     H    H    F    H    F    {_GAP}
frozen         stopping   H    H    F    H    F    {_GAP}
frozen         jogging    H    H    F    H    F    {_GAP}
suspended      enabling   O    O    O    O    O    {_GAP}
suspended      homing     -    -    O    -    -    {_GAP}
suspended      holding    H    H    F    H    F    {_GAP}
suspended      moving     H    H    F    H    F    {_GAP}
suspended      stopping   H    H    F    H    F    {_GAP}
clock+1d       moving     H    H    H    H    H    move finished
clock-1d       moving     H    H    H    H    H    move finished
clock-1d       enabling   H    H    H    H    H    enabling finished|enabled
disk-full      enabling   H    H    H    H    H    {_DISK}
disk-full      moving     H    H    H    H    H    {_DISK}
disk-read-only moving     H    H    H    H    H    {_DISK}
client-lost    enabling   O    O    -    -    -    stopped by laptop: its connection is gone
client-lost    homing     -    -    O    -    -    stopped by laptop: its connection is gone
client-lost    moving     H    H    H    H    H    stopped by laptop: its connection is gone
client-lost    stopping   H    H    H    H    H    stopped by laptop: its connection is gone
client-lost    jogging    H    H    H    H    H    stopped by laptop: its connection is gone
arm-dead       enabling   D    D    D    D    D    {_FOUND}
arm-dead       homing     -    -    D    -    -    motors are off
arm-dead       holding    D    D    D    D    D    {_FOUND}
arm-dead       moving     D    D    D    D    D    {_FOUND}
arm-dead       stopping   D    D    D    D    D    {_FOUND}
"""


def cells() -> Iterator[Any]:
    for row in TABLE.strip().splitlines()[1:]:
        fault, phase, *states, words = row.split(maxsplit=7)
        for board, allowed in zip(ROBOTS, states, strict=True):
            if allowed != "-":
                yield pytest.param(fault, phase, board, allowed, words, id=f"{fault}-{phase}-{board}")


CELLS = tuple(cells())


def pairs() -> Iterator[Any]:
    """Cells with each fault in each of its phases and on each of its boards: two boards a row, in turn."""
    for number, (_, one_fault) in enumerate(groupby(CELLS, lambda cell: cell.values[0])):
        rows = [list(row) for _, row in groupby(one_fault, lambda cell: cell.values[1])]
        turn = islice(cycle(ROBOTS), number // 3, None)  # not the same ones for each phase
        for row in rows:
            boards = ROBOTS if min(len(row), len(rows)) < 3 else (next(turn), next(turn))
            yield from (cell for cell in row if cell.values[2] in boards)


TRIED = CELLS if os.environ.get("ARMCTL_LONG") else tuple(pairs())


def test_the_table_is_large_enough() -> None:
    assert len(CELLS) >= 360
    assert {cell.values[0] for cell in CELLS} == set(FAULTS)
    assert {cell.values[1] for cell in CELLS} == set(PHASES)
    for two in ((0, 1), (0, 2), (1, 2)):
        wanted, tried = ({tuple(cell.values[k] for k in two) for cell in some} for some in (CELLS, TRIED))
        assert tried == wanted


@pytest.mark.parametrize(("fault", "phase", "board", "allowed", "told"), TRIED)
def test_a_fault_in_a_phase(
    fault: str,
    phase: str,
    board: str,
    allowed: str,
    told: str,
    tmp_path: Path,
    bench_of: Callable[..., Bench],
) -> None:
    bench = bench_of(board, tmp_path if fault.startswith(("clock", "disk", "arm")) else None)
    state, words = outcome(bench, fault, phase)
    assert state.name[0] in allowed, (state, words)
    assert re.search(told, words), words


def outcome(bench: Bench, fault: str, phase: str) -> tuple[State, str]:
    """Carry a cell out; gives the state that it settled in, and all that was told."""
    bench.by_client = fault == "client-lost"
    PHASES[phase](bench)
    since, first = bench.clock.now(), len(bench.history)
    mend = FAULTS[fault](bench)
    if phase == "connecting":
        bench.ask(Connect(PORT))
    elif phase == "enabling" and bench.measures and fault != "arm-dead":
        bench.ask(Enable())
    bench.run(2.5)
    bench.hold = None
    for _ in range(round(_SETTLES_S / TICK)):
        if bench.now.state is not State.MOVING:
            break
        bench.tick()
    if fault.startswith("disk"):
        bench.until_told("cannot be kept")
    state, cause, words = bench.now.state, bench.now.cause, bench.words(since, first)
    assert_stands(bench)
    if not (phase == "enabling" and bench.measures):  # whose Enable is asked for in the middle of the fault
        assert_silent_after_a_fault(bench, since, first)
    mend()
    go_on(bench)
    if fault == "arm-dead":  # who looks at the new one
        words = bench.words(since, first)
    assert not (found := _NOT_FOR_PEOPLE.search(words)), (found, words)
    if state is State.FAULT:
        assert _ADVICE.search(cause), cause
        assert fault not in _OFF or "on and held" not in words
    return state, words


def assert_stands(bench: Bench) -> None:
    """Nothing moves and nothing is asked to, for as long as a person would wait."""
    bench.run(0.4)  # what was on its way arrives
    before, sent = bench.outputs(), len(bench.log)
    for _ in range(round(_IDLE_S / _IDLE_TICK_S)):
        bench.tick(_IDLE_TICK_S)
    after = bench.outputs()
    assert not (np.isnan(before) & ~np.isnan(after)).any(), "an output came on"
    assert np.nanmax(np.abs(after - before), initial=0.0) <= _RESTS.get(bench.kind, 1.0)
    assert not [what for _, what, _ in bench.log[sent:] if what in ("write", "home")]


def assert_silent_after_a_fault(bench: Bench, since: float, first: int) -> None:
    """Whoever has lost the arm asks nothing of it but to stop or to let go."""
    last_held = max(
        (one.stamp for one in bench.history[first:] if one.state in (State.HOLDING, State.MOVING)),
        default=since,
    )
    if bench.now.state in (State.FAULT, State.OFF, State.DISCONNECTED):
        assert not [one for one in bench.log if one[0] > last_held + TICK and one[1] in ("write", "home")]


def go_on(bench: Bench) -> None:
    """What a person does then, one step after the other; at the end a motion works."""
    for _ in range(6):
        now = bench.now
        if now.state is State.DISCONNECTED or (now.state is State.FAULT and now.board is None):
            bench.does(Connect(bench.port), State.OFF)
        elif now.state is State.FAULT:
            bench.does(ClearFault(), State.OFF, State.HOLDING)
        elif now.state is State.OFF and not all(axis.homed for axis in now.homing):
            bench.does(HomeAxes(), State.HOLDING, seconds=180.0)
        elif now.state is State.OFF:
            bench.does(Enable(None if bench.measures else bench.robot.pose("home")), State.HOLDING)
        else:
            break
        bench.run(0.1)
    bench.does(MoveJoints(goal(bench, 10.0)), State.HOLDING)
    bench.run(0.3)
    sag = board_type(bench.robot.board).sag_deg
    assert np.abs(bench.now.q - goal(bench, 10.0)).max() <= np.radians(sag)
