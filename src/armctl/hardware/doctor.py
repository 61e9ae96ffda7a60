"""The check-up of a port and the board behind it: in the order in which a fault can hide the next one."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from armctl.errors import ArmctlError
from armctl.hardware.access import is_pseudo_terminal, permission_hint
from armctl.hardware.boards import board_type, board_types
from armctl.hardware.driver import ChannelSettings, translated
from armctl.hardware.findings import (
    OF_ANOTHER_BOARD,
    CheckUp,
    Finding,
    Needs,
    Verdict,
    failed,
    not_checked,
    ok,
    warning,
)
from armctl.hardware.ports import PortChecks, boards_listed_as
from armctl.hardware.probe import Probed, approach, reach
from armctl.hardware.transport import PortInfo, Transport

_CHECKS_OF_A_BOARD = ("who answers", "channels", "error register", "watchdog", "round trips")
_NO_USB = "not listed as a USB device (a pty, a socket or a plain serial port)"


@dataclass(frozen=True, slots=True)
class Patient:
    """What is to be looked at.

    Args:
        port: what to open: a device, a pty or ``socket://host:port``.
        info: what the listing says of it; None where it does not list it.
        expected: the kind of board that should be there; None: any.
        channels: what the robot file needs, in the board's unit.
        checks: what the system says about the port.
        simulated: whether a simulated board is behind it.
    """

    port: str
    info: PortInfo | None = None
    expected: str | None = None
    channels: Sequence[ChannelSettings] = ()
    checks: PortChecks = field(default_factory=PortChecks)
    simulated: bool = False


def examine(
    patient: Patient, open_line: Callable[[int], Transport], now: Callable[[], float]
) -> tuple[Finding, ...]:
    """Check a port and the board behind it. Moves nothing; opening the port of an Arduino resets it.

    Args:
        patient: the port and what is expected there.
        open_line: opens the port at a baud rate.
        now: the clock [s].
    """
    findings = _port(patient)
    if any(one.verdict is Verdict.FAILED for one in findings):
        return (*findings, not_checked("opens", "the port cannot be used"), *_unseen())
    label = None if patient.info is None else patient.info.kind
    try:
        line, probed = reach(open_line, approach(label, patient.expected), now)
    except ArmctlError as error:
        return (*findings, failed("opens", str(error)), *_unseen())
    try:
        findings.append(ok("opens", "yes, for this program alone"))
        findings.append(_who(patient, probed))
        if probed.board is None:
            return (*findings, *_unseen()[1:])
        try:
            findings += _board(patient, probed, line, now)
        except ArmctlError as error:
            findings.append(failed("conversation", f"broke off: {error}"))
        return tuple(findings)
    finally:
        line.close()


def _port(patient: Patient) -> list[Finding]:
    """What can be told without opening the port."""
    if "://" in patient.port:
        return [ok("port", "a network address: neither permission nor other programs can be checked")]
    if not os.path.exists(patient.port):  # a Path raises where it may not look
        return [
            failed(
                "port",
                f"{patient.port} does not exist",
                "plug the board in; `armctl ports` lists what is there",
            )
        ]
    findings = [ok("port", _NO_USB if patient.info is None else _listed(patient.info))]
    if patient.checks.may_open(patient.port):
        findings.append(ok("permission", "this user may read and write it"))
    else:
        findings.append(failed("permission", "this user may not open it", permission_hint(patient.port)))
    findings.append(_other_programs(patient))
    if patient.info is not None:
        if patient.info.why_not is not None and all(one.verdict is Verdict.OK for one in findings):
            findings.append(failed("right port", patient.info.why_not))
        findings += [warning("other programs", note) for note in patient.info.notes]
    return findings


def _other_programs(patient: Patient) -> Finding:
    """Only what can be known before the port is opened: whether it is free, its opening tells."""
    program = patient.checks.used_by(patient.port)
    if program is not None:
        return failed("other programs", f"{program} has it open", "close that and try again")
    if is_pseudo_terminal(patient.port):
        return not_checked("other programs", "which program uses a pseudo-terminal cannot be told")
    return ok("other programs", "none of this user's; another user's cannot be seen")


def _listed(info: PortInfo) -> str:
    serial_number = f", USB serial number {info.serial_number}" if info.serial_number else ""
    stable = f", also {info.stable_name}" if info.stable_name else ""
    return f"{info.kind}{serial_number}{stable}"


def _who(patient: Patient, probed: Probed) -> Finding:
    if probed.board is None:
        return failed("who answers", str(probed), _advice(patient))
    if patient.expected is not None and probed.board != patient.expected:
        found, wanted = board_type(probed.board).title, board_type(patient.expected).title
        return failed(
            "who answers",
            "; ".join((f"{_a(found)} answers, where {_a(wanted)} is expected", *probed.details)),
            "choose the robot that belongs to this board, or the port that belongs to this robot",
        )
    return ok("who answers", str(probed))


def _a(title: str) -> str:
    return f"{'an' if title[0] in 'AEIOUaeiou' else 'a'} {title}"


def _advice(patient: Patient) -> str:
    """What to do where nobody answers."""
    listing = None if patient.info is None else patient.info.kind
    listed = boards_listed_as(listing)
    certain = [board for board in listed if listing in board.own_listings]
    if certain:
        return certain[0].advice
    if patient.expected is not None:
        return board_type(patient.expected).advice
    return "; ".join(
        f"if it should be {_a(board.title)}: {board.advice}" for board in listed or board_types()
    )


def _board(patient: Patient, probed: Probed, line: Transport, now: Callable[[], float]) -> list[Finding]:
    """What is asked of the board depends on who it is; another than expected is not asked for channels."""
    fits = patient.expected in (None, probed.board)
    needs = Needs(patient.channels) if fits or not patient.channels else OF_ANOTHER_BOARD
    listing = None if patient.info is None else patient.info.kind
    check_up = CheckUp(line, now, needs, listing, probed.reported, patient.simulated)
    if probed.board is None:
        return []
    return translated("the check-up", board_type(probed.board).examine, check_up)


def _unseen() -> list[Finding]:
    return [not_checked(check, "an earlier check failed") for check in _CHECKS_OF_A_BOARD]


# A report goes into public bug trackers: what names a person or a computer stays out of it.

_SHORTEST = 3
"""a shorter name is part of too many words; it also tells little"""
_TELLS_NOTHING = frozenset({"localhost", "root", "user", "armctl"})


def without_personal_data(text: str, home: str, host: str, user: str) -> str:
    """``text`` with the home folder as ``~`` and without the names of computer and user.

    Args:
        text: the report.
        home: the user's home folder.
        host: the computer's name, with or without its domain.
        user: the user's login name.
    """
    if len(home) > 1:
        text = re.sub(rf"{re.escape(home.rstrip('/'))}(?![\w-])", "~", text)
    for name, stands_for in ((host, "<host>"), (host.partition(".")[0], "<host>"), (user, "<user>")):
        if len(name) >= _SHORTEST and name not in _TELLS_NOTHING:
            text = re.sub(rf"(?<![\w-]){re.escape(name)}(?![\w-])", stands_for, text)
    return text
