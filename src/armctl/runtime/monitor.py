"""Watches what the board reads back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.errors import BoardError, BoardProtocolError, BoardTimeoutError
from armctl.hardware import Source
from armctl.robot import Robot
from armctl.runtime.board import Board, Reading, no_reading
from armctl.runtime.log import Notices

_READ_FAILURES = 5
_SILENCE_S = 1.0
"""how long a board may give no good answer before it counts as lost: a busy computer may be that late"""
_DOUBTFUL_FAILURES = 3
_OFF_READINGS = 3
_LAG_S = 0.08
"""how far the transmitted position may be behind a moving setpoint: a few servo frames"""
_DEVIATION_UNITS = 1.0
_DEVIATION_RAD = np.radians(1.0)
_DEVIATION_S = 0.5
_DEVIATION_WORDS = {
    Source.TRANSMITTED: "the board does not send what it was told ({by}): its channel range is narrower than "
    "the servo map; widen it on the board, or change the robot file",
    Source.MEASURED: "the arm does not stand where it was told ({by}): look for something in its way, a "
    "worn gear or too much load",
}
_ERROR_SHOWN_S = 10.0


class Monitor:
    """Reads back, bears a few failures, and tells what does not fit."""

    def __init__(self, robot: Robot, notices: Notices, interval_s: float) -> None:
        self._robot = robot
        self._notices = notices
        self._interval_s = interval_s
        self.reading = no_reading(robot.n)
        """the last one"""
        self.reset()

    def reset(self) -> None:
        """Another board, or none: nothing is known."""
        self.reading = no_reading(self._robot.n)
        self._read_at = -np.inf
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

    def due(self, now: float) -> bool:
        """Whether it is time to read again."""
        return now - self._read_at >= 0.9 * self._interval_s

    def read(self, board: Board, now: float) -> Reading | None:
        """Read back; None where this once no answer came.

        Raises:
            BoardError: the board is gone, or has not answered several times in a row for a second.
        """
        self._read_at = now
        if self._answered_at is None:
            self._answered_at = now
        try:
            reading = board.read()
            if self._failures:
                board.configure()  # a board that was silent may have started anew and forgotten its limits
        except (BoardTimeoutError, BoardProtocolError) as cause:
            self._failures += 1
            self.doubts = max(self.doubts, 1)
            silent = now - self._answered_at
            if self._failures >= _READ_FAILURES and silent >= _SILENCE_S:
                raise BoardError(
                    f"lost the board: {self._failures} readings in a row failed in {silent:.1f} s ({cause}); "
                    "check the cable and the power, then connect again"
                ) from cause
            if self._failures >= _DOUBTFUL_FAILURES:
                self.doubts = _OFF_READINGS
                self._notices.set("read", f"the board does not answer properly: {cause}")
            return None
        self.reading = reading
        self._answered_at = now
        self.doubts = max(0, self.doubts - 1)
        if self._failures:
            self._failures = 0
            self._notices.clear("read")
        for error in self.reading.errors:
            self._notices.set(f"board {error}", f"the board reports: {error}", until=now + _ERROR_SHOWN_S)
        return self.reading

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

    def released(self) -> None:
        """The pulses were switched off: the readings must show it."""
        self.doubts = self._off = self._still_on = 0
        self._released = True

    def check_released(self) -> None:
        """Warn where the board goes on sending pulses that it was told to switch off."""
        on = self.reading.on
        self._still_on = self._still_on + 1 if self._released and on.any() else 0
        if self._still_on < _OFF_READINGS:
            self._notices.clear("released")
            return
        self._notices.set(
            "released",
            f"the board's outputs are still on ({self._titles(on)}) though it was told to switch them off; "
            "release again, or cut the power of the motors",
        )

    def doubt(self) -> None:
        """Nothing was sent for so long that the board's own watchdog may have struck: look first."""
        self.doubts = max(self.doubts, 1)

    def went_by_itself(self, q_command: FloatArray, now: float) -> str | None:
        """In words, that the last reading does not fit (n,) [rad] the last setpoint; None while it does.

        Outputs that are off count once several readings say so where answers carry no checksum, and one is
        no proof. Until the next one nothing is sent. A Maestro that reports an error has sent its channels
        wherever its settings say; if that is off, or far from the setpoint, the path from there is nobody's.
        """
        reading = self.reading
        off = ~reading.on
        if reading.source is Source.MEASURED:
            why = "; ".join(reading.errors) or "it does not say why"
            if off.any():
                return f"the board switched the motors off by itself ({why})"
            lost = np.isnan(reading.q)
            return f"the board lost its zeros ({self._titles(lost)}; {why})" if lost.any() else None
        self._off = self._off + 1 if off.any() else 0
        if self._off:
            self.doubt()
        if self._off >= _OFF_READINGS:
            return f"the board switched the pulses off by itself ({self._titles(off)})"
        if reading.source is not Source.TRANSMITTED:
            return None
        if reading.errors:
            self._errors, self._erred_at = reading.errors, now
        moved = np.abs(reading.q - q_command) > _LAG_S * self._robot.speed_limits
        if moved.any() and now - self._erred_at <= _ERROR_SHOWN_S:  # it goes home at its own, slow speed
            return f"the board moved the arm by itself ({self._titles(moved)}; {', '.join(self._errors)})"
        return None

    def _titles(self, which: NDArray[np.bool_]) -> str:
        return ", ".join(self._robot.joints[i].title for i in np.flatnonzero(which))

    def compare(self, board: Board, q_command: FloatArray, standing: bool, now: float) -> None:
        """Warn where the arm stands elsewhere than told for half a second while nothing moves."""
        source = self.reading.source
        away = np.abs(self.reading.q - q_command)
        if source is Source.MEASURED:
            deviates = away > _DEVIATION_RAD
        else:
            away = away * board.outputs.unit_per_rad
            deviates = away > _DEVIATION_UNITS
        if source is Source.COMMANDED or not standing or not deviates.any():
            self._deviates_since = None
            self._notices.clear("deviation")
            return
        if self._deviates_since is None:
            self._deviates_since = now
        if now - self._deviates_since > _DEVIATION_S:
            values, unit = (
                (np.degrees(away), "°") if source is Source.MEASURED else (away, f" {board.outputs.unit}")
            )
            by = ", ".join(
                f"{joint.title} by {value:.1f}{unit}"
                for joint, value, far in zip(self._robot.joints, values, deviates, strict=True)
                if far
            )
            self._notices.set("deviation", _DEVIATION_WORDS[source].format(by=by))
