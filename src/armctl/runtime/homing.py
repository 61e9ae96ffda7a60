"""Homing: the board looks for the zero of every axis by itself, and tells when it has them."""

from __future__ import annotations

from collections.abc import Callable

from armctl.errors import ArmctlError, BoardError
from armctl.runtime.activity import ActivityView, Setpoint
from armctl.runtime.board import Board, Reading
from armctl.runtime.log import EventLog

_SETTLE_S = 0.3
"""what is read before this may still be from before homing began, or was stopped"""
_LONGEST_S = 180.0


class Homing:
    """Watches a board that homes; gives no setpoints. When it is done the arm is taken over where it stands.

    Args:
        board: which homes.
        reading: gives the newest reading.
        adopt: called once, with the reading that says that every axis is homed, and the time; an
            ``ArmctlError`` of it ends homing as a failure.
        log: gets a line for each axis.
        now: controller clock [s].

    Raises:
        BoardError: the board does not begin.
    """

    label = "homing"
    begun = True
    pausable = False

    def __init__(
        self,
        board: Board,
        reading: Callable[[], Reading],
        adopt: Callable[[Reading, float], None],
        log: EventLog,
        now: float,
    ) -> None:
        self._board = board
        self._reading = reading
        self._adopt = adopt
        self._log, self._logged = log, ""
        self._began: float | None = now
        self._ended = False
        self._stopping = False
        self._error: ArmctlError | None = None
        board.home()

    @property
    def standing(self) -> bool:
        """The joints are at rest now."""
        return self._ended

    @property
    def done(self) -> bool:
        """Homed, stopped or failed."""
        return self._ended

    @property
    def error(self) -> ArmctlError | None:
        """Why not every axis is homed."""
        return self._error

    @property
    def notice(self) -> str | None:
        """Which axis is looked for."""
        homing = self._reading().homing
        if self._ended or homing is None or homing.running is None:
            return None
        place = min(sum(homing.homed.values()) + 1, len(homing.homed))
        title = self._board.title(homing.running)
        return f"homing: {title} looks for its zero ({place} of {len(homing.homed)}); keep clear"

    def advance(self, now: float, dt: float) -> Setpoint | None:
        """Look how far the board is."""
        del dt
        if self._ended:
            return None
        if self._began is None:
            self._began = now
        looking = self.notice
        if looking is not None and looking != self._logged:
            self._logged = looking
            self._log.warning(looking)  # somebody's hand may be near the axis that begins now
        if now - self._began >= _SETTLE_S:
            self._conclude(self._reading(), now, now - self._began)
        return None

    def set_speed(self, fraction: float) -> None:
        """Axes look for their zeros at their own, slow speed."""

    def pause(self) -> None:
        """It cannot be paused; ``pausable`` says so."""

    def resume(self) -> None:
        """It cannot be paused."""

    def stop(self) -> None:
        """Have the board brake, at once: it goes on by itself, whether setpoints may be sent or not.

        Raises:
            BoardError: it does not confirm.
        """
        if not self._stopping:
            self._stopping = True
            self._began = None
            self._board.hold()

    def halt(self) -> None:
        """Nothing is sent anyway: the board goes on by itself."""

    def view(self) -> ActivityView:
        """How many axes are homed."""
        homing = self._reading().homing
        share = 0.0 if homing is None else sum(homing.homed.values()) / max(len(homing.homed), 1)
        return ActivityView(None, share, 0.0)

    def _conclude(self, reading: Reading, now: float, since: float) -> None:
        homing = reading.homing
        if self._stopping:
            self._ended = homing is None or homing.running is None
        elif homing is None or reading.powered is False:
            self._fail("; ".join(reading.errors) or "the board switched its motors off")
        elif homing.running is not None:
            if since > _LONGEST_S:
                self._error = BoardError(
                    f"homing was given up after {_LONGEST_S:.0f} s: an axis still looks for its zero; "
                    "see to its home switch"
                )
                self.stop()
        elif homing.done:
            self._take_over(reading, now)
        else:
            missing = [self._board.title(channel) for channel, homed in homing.homed.items() if not homed]
            self._fail("; ".join(reading.errors) or f"{', '.join(missing)} did not find a zero")

    def _take_over(self, reading: Reading, now: float) -> None:
        try:
            self._adopt(reading, now)
        except ArmctlError as error:
            self._error = error
        self._ended = True

    def _fail(self, why: str) -> None:
        self._error = BoardError(f"homing ended before every axis had its zero: {why}")
        self._ended = True
