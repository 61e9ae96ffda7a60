"""The check-up of a port and the board behind it: in the order in which a fault can hide the next one."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import field, replace

from armctl.errors import ArmctlError
from armctl.hardware.access import permission_hint
from armctl.hardware.board_type import (
    OF_ANOTHER_BOARD,
    ChannelsToCheck,
    CheckUp,
    Finding,
    Verdict,
    failed,
    not_checked,
    ok,
    warning,
)
from armctl.hardware.boards import board_of_address, board_type, board_types
from armctl.hardware.driver import ChannelSettings, translated
from armctl.hardware.ports import PortChecks, Probed, approach, boards_listed_as, reach
from armctl.hardware.transport import PortInfo, Transport
from armctl.lazy_dataclass import dataclass
from armctl.system import is_pseudo_terminal

_CHECKS_OF_A_BOARD = ("who answers", "channels", "error register", "watchdog", "round trips")
_NO_USB = "not listed as a USB device (a pty, a socket or a plain serial port)"


@dataclass(frozen=True, slots=True)
class Patient:
    """What is to be looked at."""

    port: str  # what to open: a device, a pty or ``socket://host:port``
    info: PortInfo | None = None  # what the listing says of it; None where it does not list it
    expected: str | None = None  # the kind of board that should be there; None: any
    channels: Sequence[ChannelSettings] = ()  # what the robot file needs, in the board's unit
    checks: PortChecks = field(default_factory=PortChecks)
    simulated: bool = False  # whether a simulated board is behind it
    missing: Sequence[PortInfo] = ()  # boards that are plugged in without a port
    settings: object = None  # what the robot file says of the board besides the map of the outputs

    @property
    def listing(self) -> str | None:
        """How the port is listed."""
        return None if self.info is None else self.info.kind


def examine(
    patient: Patient, open_line: Callable[[int], Transport], now: Callable[[], float]
) -> tuple[Finding, ...]:
    """Check a port and the board behind it. Moves nothing; opening the port of an Arduino resets it."""
    findings = _port(patient)
    if any(one.verdict is Verdict.FAILED for one in findings):
        return (*findings, not_checked("opens", "the port cannot be used"), *_unseen())
    try:
        line, probed = reach(open_line, approach(patient.listing, patient.expected, patient.port), now)
    except ArmctlError as error:
        return (*findings, failed("opens", str(error)), *_unseen())
    try:
        findings.append(ok("opens", "yes; locked for other programs but root's"))
        probed = _behind(patient, probed)
        findings.append(_who(patient, probed))
        if probed.board is None:
            return (*findings, *_unseen()[1:])
        # Another board than expected is not asked for the robot's channels.
        fits = patient.expected in (None, probed.board) or not patient.channels
        needs = ChannelsToCheck(patient.channels) if fits else OF_ANOTHER_BOARD
        check_up = CheckUp(
            line, now, needs, patient.listing, probed.reported, patient.simulated, patient.settings
        )
        try:
            findings += translated("the check-up", board_type(probed.board).examine, check_up)
        except ArmctlError as error:
            findings.append(failed("conversation", f"broke off: {error}"))
        return tuple(findings)
    finally:
        line.close()


def _port(patient: Patient) -> list[Finding]:
    """What can be told without opening the port."""
    port, info, checks = patient.port, patient.info, patient.checks
    if "://" in port:
        if (board := board_of_address(port)) is not None:
            return [ok("port", f"an address of a {board.title}: its opening tells whether it can be used")]
        return [ok("port", "a network address: neither permission nor other programs can be checked")]
    if not os.path.exists(port):  # a Path raises where it may not look
        advice = "plug the board in; `armctl ports` lists what is there"
        taken = [failed("other programs", f"{one.device}: {one.why_not}") for one in patient.missing]
        return [failed("port", f"{port} does not exist", advice), *taken]
    findings = [ok("port", _NO_USB if info is None else _listed(info))]
    if checks.may_open(port):
        findings.append(ok("permission", "this user may read and write it"))
    else:
        findings.append(failed("permission", "this user may not open it", permission_hint(port)))
    # Only what can be known before the port is opened: whether it is free, its opening tells.
    if (program := checks.used_by(port)) is not None:
        findings.append(failed("other programs", f"{program} has it open", "close that and try again"))
    elif is_pseudo_terminal(port):
        seen = "which program uses a pseudo-terminal cannot be told"
        findings.append(not_checked("other programs", seen))
    else:
        findings.append(ok("other programs", "none of this user's; another user's cannot be seen"))
    if info is not None:
        if info.why_not is not None and all(one.verdict is Verdict.OK for one in findings):
            findings.append(failed("right port", info.why_not))
        findings += [warning("other programs", note) for note in info.notes]
    return findings


def _listed(info: PortInfo) -> str:
    serial_number = f", USB serial number {info.serial_number}" if info.serial_number else ""
    stable = f", also {info.stable_name}" if info.stable_name else ""
    return f"{info.kind}{serial_number}{stable}"


def _behind(patient: Patient, probed: Probed) -> Probed:
    """The expected board in place of the one that answers for it: its check-up looks for it."""
    if patient.expected is None or probed.board is None:
        return probed
    stands_behind = board_type(patient.expected).stands_behind == probed.board
    return replace(probed, board=patient.expected) if stands_behind else probed


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
    """What to do where no board answers."""
    listed = boards_listed_as(patient.listing)
    for board in listed:
        if patient.listing in board.own_listings:
            return board.advice
    if patient.expected is not None:
        return board_type(patient.expected).advice
    boards = listed or board_types()
    return "; ".join(f"if it should be {_a(board.title)}: {board.advice}" for board in boards)


def _unseen() -> list[Finding]:
    return [not_checked(check, "an earlier check failed") for check in _CHECKS_OF_A_BOARD]


# A report goes into public bug trackers: what names a person or a computer stays out of it.

_SHORTEST = 3
"""a shorter name is part of too many words; it also tells little"""
_TELLS_NOTHING = frozenset({"localhost", "root", "user", "armctl"})


def without_personal_data(text: str, home: str, host: str, user: str) -> str:
    """``text`` with the home folder as ``~`` and without the names of computer and user."""
    if len(home) > 1:
        text = re.sub(rf"{re.escape(home.rstrip('/'))}(?![\w-])", "~", text)
    for name, stands_for in ((host, "<host>"), (host.partition(".")[0], "<host>"), (user, "<user>")):
        if len(name) >= _SHORTEST and name not in _TELLS_NOTHING:
            text = re.sub(rf"(?<![\w-]){re.escape(name)}(?![\w-])", stands_for, text)
    return text
