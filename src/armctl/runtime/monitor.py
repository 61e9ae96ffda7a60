"""Decides whether the readings of a board can be trusted, and reports what does not fit."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import BoardError, BoardProtocolError, BoardTimeoutError
from armctl.facts import Unanswered, say
from armctl.facts.angles import DEGREE
from armctl.hardware import Source
from armctl.hardware.boards import board_type
from armctl.robot import Robot
from armctl.robot.tools import own_gripper
from armctl.runtime.board import Board, BoolArray, Reading
from armctl.runtime.notices import Levels, Notices

_READ_FAILURES = 5
_SILENCE_S = 1.0
"""how long a board may give no good answer before it counts as lost: a busy computer may be that late"""
_DOUBTFUL_FAILURES = 3
_OFF_READINGS = 3
_SURE_READINGS = 2
"""answers carry no checksum: one alone is no proof that an output came on, or that the board moved it"""
_LAG_S = 0.08
"""how far the transmitted position may be behind a moving setpoint: a few servo frames"""
_DEVIATION_UNITS = 1.0
_DEVIATION_S = 0.5
_DEVIATION_WORDS = {
    Source.TRANSMITTED: "the board does not send what it was told ({by}): its channel range is narrower than "
    "the servo map; widen it on the board, or change the robot file",
    Source.MEASURED: "the arm does not stand where it was told ({by}): look for something in its way, a "
    "worn gear or too much load",
}
_ERROR_SHOWN_S = 10.0
_RATE_S = 5.0
"""over which unanswered questions are counted"""
_FEWEST_ASKED = 250
"""as many readings as there are in that time: after a start, a few lost ones are not yet a rate"""
_RATE_SHOWN, _RATE_TOO_HIGH = 0.02, 0.1
"""shares of them from which on it is said, and the arm is brought to rest: it would only crawl"""
_REST_READINGS = 5
"""that are alike before the pulses count as at rest"""
_GO_ON = "then clear the fault and enable"
_GO_HOMING = "then clear the fault and home the arm"
_DELAYS_S = 1.0
"""over which the time that answers take is looked at"""
_FEWEST_SLOW = 2
"""one late answer may be the computer's"""
_OUTAGE_OVER_S = 1.0
"""after an outage and so long without a lost answer, the outage counts no more"""
_SEE_TO = "check its power and its errors, "
_REPORTED = "board "
"""begins the names of what the board reports itself"""
UNANSWERED = "unanswered"
"""names the warning of a board that leaves too many questions unanswered"""
BOARD_REPORTS = "the board reports: "
"""before what the board says of itself"""


class WentByItself(NamedTuple):
    """A board that does not do what it was told."""

    words: str
    """what it did, and what to do"""
    errors: tuple[str, ...] = ()
    """of the board, that the words tell"""


def reported(words: str) -> str:
    """Names the warning of what the board reports itself."""
    return f"{_REPORTED}{words}"


class Monitor:
    """Reads back, tolerates a few failures, and reports what does not fit."""

    def __init__(self, robot: Robot, notices: Notices, interval_s: float) -> None:
        self._robot = robot
        gripper = own_gripper(robot) or robot.gripper
        self._gripper = "gripper" if gripper is None else gripper.title
        self._notices = notices
        self._interval_s = interval_s
        self._sag = board_type(robot.board).sag_deg * DEGREE
        self.reset()

    def reset(self) -> None:
        """Another board, or none: nothing is known."""
        n = self._robot.n
        self.reading = Reading(np.full(n, np.nan), np.zeros(n, dtype=np.bool_))
        """the last one"""
        self.due_at = -np.inf
        """when to read again (controller clock) [s]"""
        self._answered_at: float | None = None
        self._failures = 0
        self.doubts = 0
        """good readings that are missing before a setpoint may be sent: the last one failed, or said that a
        joint has no pulses, or is too long ago. A board that has started anew would switch them on again
        with a jump; after several failures in a row it takes several good readings to trust it."""
        self._off = 0
        self._errors: tuple[str, ...] = ()
        self._erred_at = -np.inf
        self._released = False
        self._still_on = 0
        self._deviates_since: float | None = None
        self.read_at = -np.inf
        """when the last reading was taken (controller clock) [s]"""
        self._answers: deque[tuple[float, int, int]] = deque()
        self._asked = self._lost = 0
        """sums of ``_answers``"""
        self._dropped: tuple[str, ...] = ()
        self._delays: deque[tuple[float, float]] = deque()
        self._outage_ended: float | None = None
        self._seen_on: BoolArray | None = None
        self._unasked = self._moved = 0
        self.unreliable: str | None = None
        """how many questions the board leaves unanswered, where these are too many to move the arm"""
        self._rest: tuple[FloatArray, FloatArray, int] | None = None
        self._strayed = 0
        self.levels = Levels(self._notices)
        """loads, heat and voltages that are warned of"""

    def read(self, board: Board, now: float) -> Reading | None:
        """Read back; None where this once no answer came. ``BoardError``: none for a second, or gone."""
        self.due_at = now + 0.9 * self._interval_s
        if self._answered_at is None:
            self._answered_at = now
        try:
            reading = board.read()
            if self._failures:
                board.configure()  # a board that was silent may have started anew and forgotten its limits
        except (BoardTimeoutError, BoardProtocolError) as cause:
            self._failures += 1
            self._count_answers(now, 1, 1)
            self._note_delay(now, np.inf)
            self.doubt()
            silent = now - self._answered_at
            if self._failures >= _READ_FAILURES and silent >= _SILENCE_S:
                why = cause.reason
                what = why.what if isinstance(why, Unanswered) else say(why)  # what to check is said once
                raise BoardError(
                    f"lost the board: {self._failures} readings in a row failed in {silent:.1f} s ({what}); "
                    "check the cable and the power, then connect again"
                ) from cause
            if self._failures >= _DOUBTFUL_FAILURES:
                self.doubts = _OFF_READINGS
                self._notices.set("read", f"the board does not answer properly: {cause}")
            return None
        self.reading, self.read_at = reading, now
        self._count_answers(now, reading.asked, reading.lost)
        if reading.delay_s is not None:
            self._note_delay(now, reading.delay_s)
        if self._failures >= _DOUBTFUL_FAILURES:
            self._outage_ended = now
        self._answered_at = now
        self.doubts = max(0, self.doubts - 1)
        if reading.expired:
            self.doubt()
            self._dropped += reading.expired
            words = f"the line was busy for too long: setpoints of {', '.join(reading.expired)} were dropped"
            self._notices.set("expired", words, until=now + _RATE_S)
        if self._failures:
            self._failures = 0
            self._notices.clear("read")
        for error in reading.errors:
            self._notices.set(reported(error), f"{BOARD_REPORTS}{error}", until=now + _ERROR_SHOWN_S)
        self.levels.take(reading.levels, now)
        for warning in reading.warnings:
            self._notices.set(reported(warning), warning, until=now + _ERROR_SHOWN_S)
        return reading

    def _count_answers(self, now: float, asked: int, lost: int) -> None:
        """Say how many of the last seconds' questions got no answer, where these are many."""
        self._answers.append((now, asked, lost))
        self._asked, self._lost = self._asked + asked, self._lost + lost
        while now - self._answers[0][0] > _RATE_S:
            _, asked_then, lost_then = self._answers.popleft()
            self._asked, self._lost = self._asked - asked_then, self._lost - lost_then
        if lost:
            self._outage_ended = None
        elif self._outage_ended is not None and now - self._outage_ended > _OUTAGE_OVER_S:
            self._outage_ended = None
            self._answers.clear()
            self._answers.append((now, asked, 0))
            self._asked, self._lost = asked, 0
        rate = self._lost / max(_FEWEST_ASKED, self._asked)
        words = (
            f"the board does not answer {100 * rate:.0f} % of the questions in time: check cable, USB hub, "
            "baud rate"
        )
        if rate >= _RATE_SHOWN:
            self._notices.set(UNANSWERED, words, until=now + _RATE_S)
        # What was lost in an outage that is over stops no motion.
        self.unreliable = words if rate >= _RATE_TOO_HIGH and lost else None

    def take_dropped(self) -> tuple[str, ...]:
        """Titles of what was dropped since this was asked last, as it could not be sent in its time."""
        dropped, self._dropped = self._dropped, ()
        return dropped

    def _note_delay(self, now: float, delay_s: float) -> None:
        self._delays.append((now, delay_s))
        while now - self._delays[0][0] > _DELAYS_S:
            self._delays.popleft()

    def slow_line(self, slowest_s: float) -> float | None:
        """The longest [s] that an answer took lately, where a good part of them took over ``slowest_s``.

        Infinite where some did not come in time.
        """
        slow = [delay for _, delay in self._delays if delay > slowest_s]
        many = len(slow) >= max(_FEWEST_SLOW, _RATE_TOO_HIGH * len(self._delays))
        return max(slow) if many else None

    @property
    def homes(self) -> bool:
        """Whether the board moved the arm by itself at the last reading, to look for its zeros."""
        homing = self.reading.homing
        return homing is not None and homing.running is not None

    def enabled(self) -> None:
        """The pulses were switched on: what was seen before that counts no more."""
        self.doubts = self._off = 0
        self._erred_at = -np.inf
        self._released = False
        self._notices.clear("released")

    def acknowledged(self) -> None:
        """The user has read what the board reported; what still holds is reported again."""
        self._notices.clear_from(_REPORTED)

    def released(self) -> None:
        """The pulses were switched off: the readings must show it."""
        self.doubts = self._off = self._still_on = 0
        self._released = True

    def check_released(self) -> None:
        """Warn where the board goes on sending pulses that were switched off."""
        on = self.reading.on
        self._still_on = self._still_on + 1 if self._released and on.any() else 0
        if self._still_on < _OFF_READINGS:
            self._notices.clear("released")
            return
        self._notices.set(
            "released",
            f"the board's outputs are still on ({self._joints(on)}) though it was told to switch them off; "
            "release again, or cut the power of the motors",
        )

    def check_unasked(self, *, enabling: bool) -> None:
        """Tell of outputs that come on while the arm is off and nobody switches them on."""
        on = self.reading.on
        if self._seen_on is None or enabling:
            self._seen_on = on.copy()
        came_on = on & ~self._seen_on
        self._unasked = self._unasked + 1 if came_on.any() else 0
        if self._unasked < _SURE_READINGS:
            self._seen_on &= on
            return
        self._seen_on = on.copy()
        self._notices.set(
            "unasked",
            f"{self._joints(came_on)} came on though nobody asked for that just now: keep clear; Enable "
            "takes the arm over where it stands, Release switches it off",
            until=self.read_at + _ERROR_SHOWN_S,
        )

    def doubt(self) -> None:
        """Look before the next setpoint: no answer came, or the board's own watchdog may have struck."""
        self.doubts = max(self.doubts, 1)

    def went_by_itself(
        self, board: Board, q_command: FloatArray, standing: bool, now: float, *, grips: bool = False
    ) -> WentByItself | None:
        """How the last reading does not fit (n,) [rad] the last setpoint; None while it does.

        ``grips``: the gripper was switched on, too.

        Outputs that are off count once several readings say so where answers carry no checksum, and one is
        no proof. Until the next one nothing is sent. A Maestro that reports an error has sent its channels
        wherever its settings say; if that is off, or far from the setpoint, nothing checked the path there.
        Pulses that change while nothing is sent are another program's.
        """
        reading, self._seen_on = self.reading, None  # what is on after this was switched on by somebody
        off = ~reading.on & ~board.limp
        if reading.source is Source.MEASURED:
            why = "; ".join(reading.errors) or "it does not say why"
            lost = np.isnan(reading.q) & ~board.limp
            homes = reading.homing is not None
            if off.any() or (grips and reading.gripper_on is False):
                what = f"the board switched the motors off by itself ({why})"
            elif lost.any() and homes:
                what = f"the board lost its zeros ({self._joints(lost)}; {why})"
            elif lost.any():
                what = f"the board no longer says where the arm stands ({self._joints(lost)}; {why})"
            else:
                return None
            go_on = _GO_HOMING if homes and lost.any() else _GO_ON
            return WentByItself(f"{what}; {_SEE_TO}{go_on}", reading.errors)
        if (gone := self.switched_off(off, gripper=grips and reading.opening is None)) is not None:
            return WentByItself(gone)
        if reading.source is not Source.TRANSMITTED:
            return None
        if reading.errors:
            self._errors, self._erred_at = reading.errors, now
        moved = np.abs(reading.q - q_command) > _LAG_S * self._robot.speed_limits
        erred = moved.any() and now - self._erred_at <= _ERROR_SHOWN_S  # it goes home at its own, slow speed
        self._moved = self._moved + 1 if erred else 0
        if self._moved:
            self.doubt()
        if self._moved >= _SURE_READINGS:
            why = ", ".join(self._errors)
            words = f"the board moved the arm by itself ({self._joints(moved)}; {why}); {_SEE_TO}{_GO_ON}"
            return WentByItself(words, self._errors)
        another = self._moved_by_another(board, q_command) if standing else None
        return None if another is None else WentByItself(another)

    def switched_off(self, off: BoolArray, *, gripper: bool = False) -> str | None:
        """In words, that joints (n,) whose outputs the last reading shows off are off for certain.

        ``gripper``: it is shown off, too. A board that starts anew between a reading and a setpoint has its
        joints on again; the gripper, which stands, shows it.
        """
        self._off = self._off + 1 if off.any() or gripper else 0
        if self._off:
            self.doubt()
        if self._off < _OFF_READINGS:
            return None
        names = [*([self._joints(off)] if off.any() else []), *([self._gripper] if gripper else [])]
        return f"the board switched the pulses off by itself ({', '.join(names)}); {_SEE_TO}{_GO_ON}"

    def _moved_by_another(self, board: Board, q_command: FloatArray) -> str | None:
        """In words, that pulses which had come to rest have changed though no setpoint was sent since."""
        q = self.reading.q
        command, rest, alike = self._rest or (q_command, q, 0)
        away = np.where(board.limp, 0.0, np.abs(q - rest) * board.unit_per_rad)
        strays = away > _DEVIATION_UNITS
        if not np.array_equal(command, q_command) or (alike < _REST_READINGS and strays.any()):
            command, rest, alike = q_command.copy(), q, 0
        if alike < _REST_READINGS or not strays.any():
            self._rest, self._strayed = (command, rest, alike + 1), 0
            return None
        self._strayed += 1
        self.doubt()
        if self._strayed < _OFF_READINGS:
            return None
        by = ", ".join(
            f"{self._robot.joints[i].title} by {away[i]:.0f} {board.map.unit}" for i in np.flatnonzero(strays)
        )
        self._rest = None
        return (
            f"something else moved the arm ({by} so far): another program writes to the board; close it, "
            f"{_GO_ON}"
        )

    def compare(self, board: Board, q_command: FloatArray, standing: bool, now: float) -> None:
        """Warn where the arm stands away from its setpoint for half a second while nothing moves."""
        source = self.reading.source
        away = np.abs(self.reading.q - q_command)
        if source is Source.MEASURED:
            deviates, values, unit = away > self._sag, self._robot.shown(away), "°"
        else:
            values, unit = away * board.unit_per_rad, f" {board.map.unit}"
            deviates = values > _DEVIATION_UNITS
        deviates &= ~board.limp
        if source is Source.COMMANDED or not standing or not deviates.any():
            self._deviates_since = None
            self._notices.clear("deviation")
            return
        if self._deviates_since is None:
            self._deviates_since = now
        if now - self._deviates_since > _DEVIATION_S:
            joints = self._robot.joints
            by = ", ".join(f"{joints[i].title} by {values[i]:.1f}{unit}" for i in np.flatnonzero(deviates))
            self._notices.set("deviation", _DEVIATION_WORDS[source].format(by=by))

    def _joints(self, which: BoolArray) -> str:
        return ", ".join(self._robot.joints[i].title for i in np.flatnonzero(which))


# How much of the time a tick counts for.


LONGEST_TICKS = 2
"""A tick counts for no more periods: time that was missed is not made up for, or the arm would jump."""
_LATE_S = 0.06
"""a tick that comes so long after the one before it is late"""
GAP_S = 0.5
"""after so long without a tick nothing goes on by itself: suspended, frozen or too busy"""
LATE_SHOWN_S = 5.0
"""how long a late tick is shown, and how long no tick may be late before the next one is logged"""
_ROUNDING_S = 1e-6


class TickTime:
    """Measures the time from tick to tick, and counts the late ones that follow each other."""

    def __init__(self, period: float) -> None:
        """``period``: from tick to tick [s]."""
        self.late_s: float | None = None
        """how much later the last tick came than it should; None: in time"""
        self.gap_s: float | None = None
        """time from the tick before to the last one, where it was longer than ``GAP_S``"""
        self.late_before: str | None = None
        """text for the log at the last tick: several before it came late, and that is over"""
        self._period = period
        self._at = -math.inf
        self._count = 0
        self._longest_s = 0.0
        self._late_at = -math.inf

    def restart(self, now: float) -> None:
        """Something begins now: what went before counts no more."""
        self._at = now

    def take(self, now: float, pace: float, *, urgent: bool) -> float | None:
        """What the tick that ends now, due ``pace`` [s] after the last, counts for [s]; None: too early."""
        elapsed = now - self._at
        if elapsed <= 0 or (elapsed < 0.25 * self._period and not urgent):
            return None
        self._at = now
        late = elapsed > max(pace + LONGEST_TICKS * self._period, _LATE_S)
        self.late_s = elapsed - pace if late else None
        self.gap_s = elapsed if GAP_S + _ROUNDING_S < elapsed < math.inf else None
        self.late_before = None
        if self._count and now > self._late_at + LATE_SHOWN_S:
            self.late_before = self._text() if self._count > 1 else None
            self._count, self._longest_s = 0, 0.0
        return min(elapsed, LONGEST_TICKS * self._period)

    def count_late(self, now: float) -> str:
        """Count the last tick, which came late and halted a motion; gives the text of the notice."""
        self._count += 1
        self._longest_s = max(self._longest_s, self.late_s or 0.0)
        self._late_at = now
        return self._text()

    def _text(self) -> str:
        longest_ms = 1000 * self._longest_s
        if self._count == 1:
            return f"the controller was {longest_ms:.0f} ms late; the motion halted and goes on from rest"
        return (
            f"the controller was late {self._count} times, by up to {longest_ms:.0f} ms; each time the "
            "motion halted and went on from rest: this computer is too busy, or the board answers late"
        )
