"""What *Main* says of the boards: which are there, which is connected, what Enable and Homing will do."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from armctl.robot import BoardKind
from armctl.runtime import Snapshot, State
from armctl.ui.console import PortChoice
from armctl.ui.widgets.html_bits import refused, sentence

_ENABLE_NOTE = (
    "**Enable** switches the servos on. A servo that was off jumps to the rest pose at full speed: "
    "hold the arm near that pose or keep clear."
)
_TAKE_OVER_NOTE = "The servos are on: **Enable** takes the arm over where it stands. Nothing jumps."
_MOTORS_NOTE = "**Enable** switches the motors on; they hold the arm where it stands."
_LOST_NOTE = (
    "The board is lost. See to its cable and its power, then press **Connect**; nothing moves by itself."
)
_UNHOMED_NOTE = (
    "The arm does not know where it is yet. **Homing** moves every axis slowly to its home switch, one after "
    "the other: keep clear. STOP ends it."
)


def enable_note(snapshot: Snapshot, board: BoardKind) -> str:
    """What Enable will do, or what must be done before."""
    if snapshot.state is State.FAULT and snapshot.board is None:
        return _LOST_NOTE
    if board != "encoder":
        return _TAKE_OVER_NOTE if snapshot.powered else _ENABLE_NOTE
    homed = bool(snapshot.homing) and all(axis.homed for axis in snapshot.homing)
    return _MOTORS_NOTE if homed else _UNHOMED_NOTE


def homing_html(snapshot: Snapshot) -> str:
    """Each axis with a sign: homed, being looked for, or not."""
    signs = [
        f"<span style='white-space:nowrap'>{'✓' if axis.homed else '…' if axis.running else '○'} "
        f"{'<b>' if axis.running else ''}{escape(axis.title)}{'</b>' if axis.running else ''}</span>"
        for axis in snapshot.homing
    ]
    if not signs:
        return ""
    done = sum(axis.homed for axis in snapshot.homing)
    return f"<div>Homed {done} of {len(signs)}: {' &nbsp; '.join(signs)}</div>"


def ports_html(choices: Iterable[PortChoice]) -> str:
    """The boards that are plugged in, and why one cannot be used."""
    lines: list[str] = []
    for choice in choices:
        if not choice.listed:
            continue
        serial = f" · serial number {escape(choice.serial_number)}" if choice.serial_number else ""
        lines.append(f"<div>{escape(choice.label)}{serial}</div>")
        if choice.why_not is not None:
            lines.append(refused(sentence(f"cannot be used: {choice.why_not}")))
        lines += [f"<div style='opacity:.75'>{escape(sentence(note))}</div>" for note in choice.notes]
    return "".join(lines)


def board_html(snapshot: Snapshot) -> str:
    """The board that is connected, and what the user must know of it."""
    board = snapshot.board
    if board is None:
        return "<div>Not connected.</div>"
    serial = f" · serial number {escape(board.serial_number)}" if board.serial_number else ""
    lines = [f"<div><b>{escape(board.kind)}</b> on {escape(board.port)}{serial}</div>"]
    notes = (*board.notes, *board.earlier)
    lines += [f"<div style='opacity:.75'>{escape(sentence(note))}</div>" for note in notes]
    return "".join(lines)
