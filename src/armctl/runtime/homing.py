"""Homing: a board that must find the zeros of its axes does so, and the arm is taken over where that ends."""

from __future__ import annotations

from armctl.errors import ArmctlError, BoardError, StateError
from armctl.facts import Need
from armctl.runtime.activity import Activity, Order, Setpoint
from armctl.runtime.board import Board, Reading
from armctl.runtime.core import Core
from armctl.runtime.power import taken_over

_SETTLE_S = 0.3
"""what is read before this may still be from before homing began, or was stopped"""
_LONGEST_S = 180.0


def home(core: Core, order: Order, now: float) -> None:
    """Have the board look for the zero of every axis: the arm moves. It holds where that ends."""
    core.require(Need.OFF_OR_HOLDING, "homing")
    if core.board is None or core.monitor.reading.homing is None:
        raise StateError(
            "the servos of this arm know their angles: there is nothing to home; to go to the "
            "pose that is called home, move there (go_pose)"
        )
    core.rack.require_confirmed()
    who = order.origin.who
    instead = StateError(f"the arm is being homed ({who})")
    core.drop_motion(instead)
    core.gripper.stop(instead)
    core.board.configure()
    homing = Homing(core, core.board, now)
    core.board.take_back()
    core.forget()
    core.monitor.acknowledged()
    core.monitor.enabled()
    core.begin(homing, who, now, order.ticket, order.motion)


class Homing(Activity):
    """Watches a board that homes; sends nothing. When it is done the arm is taken over where it stands."""

    label = "homing"
    gripping = True  # nothing is sent to the board

    def __init__(self, core: Core, board: Board, now: float) -> None:
        """Have the board begin; ``BoardError`` where it does not."""
        self._core, self._board = core, board
        self._logged = ""
        self._began: float | None = now
        self._stopping = False
        board.home()

    @property
    def standing(self) -> bool:
        """The joints are at rest: it is over."""
        return self.done

    @property
    def progress(self) -> float | None:
        """Share of the axes that know where they are."""
        homing = self._core.monitor.reading.homing
        return None if homing is None else sum(homing.homed.values()) / len(homing.homed)

    @property
    def notice(self) -> str | None:
        """Which axis is looked for."""
        homing = self._core.monitor.reading.homing
        if self.done or homing is None or homing.running is None:
            return None
        place = min(sum(homing.homed.values()) + 1, len(homing.homed))
        title = self._board.title(homing.running)
        return f"homing: {title} looks for its zero ({place} of {len(homing.homed)}); keep clear"

    def advance(self, now: float, dt: float) -> Setpoint | None:
        """Look how far the board is."""
        if self.done:
            return None
        if self._began is None:
            self._began = now
        looking = self.notice
        if looking is not None and looking != self._logged:
            self._logged = looking
            self._core.log.warn(looking)  # a hand may be near the axis that begins now
        if now - self._began >= _SETTLE_S:
            self._conclude(self._core.monitor.reading, now, now - self._began)
        return None

    def stop(self) -> None:
        """Have the board brake, at once: it goes on by itself, whether setpoints may be sent or not."""
        if not self._stopping:
            self._stopping = True
            self._began = None
            self._board.hold()

    def halt(self) -> None:
        """Nothing is sent anyway: the board goes on by itself."""

    def _conclude(self, reading: Reading, now: float, since: float) -> None:
        homing = reading.homing
        failed = ""
        if self._stopping:
            self._done = homing is None or homing.running is None
        elif homing is None or reading.powered is False:
            failed = "; ".join(reading.errors) or "the board switched its motors off"
        elif homing.running is not None:
            if since > _LONGEST_S:
                self.error = BoardError(
                    f"homing was given up after {_LONGEST_S:.0f} s: an axis still looks for its zero; "
                    "see to its home switch"
                )
                self.stop()
        elif homing.done:
            self._done = True
            try:
                q = taken_over(self._core, self._board, reading.q)
                self._core.adopt(q, reading.opening, now)
            except ArmctlError as error:
                self.error = error
        else:
            missing = [self._board.title(channel) for channel, homed in homing.homed.items() if not homed]
            failed = "; ".join(reading.errors) or f"{', '.join(missing)} did not find a zero"
        if failed:
            again = "" if reading.home_again else "; see to that and home again"
            self.error = BoardError(f"homing ended before every axis had its zero: {failed}{again}")
            self._done = True
