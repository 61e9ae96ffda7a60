"""A release that lets the arm sink: the torque goes within a second, then the outputs are off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armctl.errors import ArmctlError, InputError, StateError
from armctl.facts import Need, State
from armctl.facts.commands import Released
from armctl.hardware import Source
from armctl.protocol import Ticket
from armctl.runtime.activity import Activity, Setpoint
from armctl.runtime.board import Board
from armctl.runtime.core import Core
from armctl.runtime.power import LEAST_TORQUE, named_joints, release, taken_over

LETTING_DOWN_S = 1.0
"""how long the torque takes to go"""
_STEP_S = 0.04
"""between two limits: each servo has to confirm its own"""
_MOST_HALTS = 10
"""ticks without a good answer after which it is switched off at once"""


def let_down(core: Core, ticket: Ticket, who: str, now: float, names: Sequence[str] | None = None) -> bool:
    """Release an arm that holds, gently where its board can; whether that is over at once.

    ``names``: of these joints only. What moves, is in fault or lets itself down already is switched off at
    once.
    """
    if names is not None:
        if not names:
            raise InputError("which joints are to be released? None was named")
        named_joints(core, names)  # refuses one that does not exist
    running = core.activity
    if isinstance(running, LettingDown) and not running.done:
        running.finish()
        if running.names in (None, names):
            return True
    elif names is not None:
        core.require(Need.HOLDING_SOME, "a release of joints")
    board = core.board
    gently = core.state is State.HOLDING and running is None and core.leaving is None
    if board is None or not board.lets_down or not gently or core.gate.q is None:
        release(core, who, names)
        return True
    released = StateError(Released(who, joints=names is not None))
    core.drop_motion(released)
    if names is None:
        core.gripper.stop(released)
    of = "" if names is None else f" of {', '.join(names)}"
    core.log.warn(f"RELEASE ({who}): the torque{of} goes within {LETTING_DOWN_S:.0f} s")
    core.begin(LettingDown(core, board, ticket, who, now, names), who, now)
    ticket.accept()
    return False


class LettingDown(Activity):
    """Takes the torque away by and by, then switches off; STOP holds the arm where it has sunk to."""

    label = "letting the arm down"
    releasing = True

    def __init__(
        self, core: Core, board: Board, ticket: Ticket, who: str, now: float, names: Sequence[str] | None
    ) -> None:
        """``ticket`` is answered once the outputs are off, or it was stopped; ``names`` None: all joints."""
        self._core, self._board, self._ticket, self._who = core, board, ticket, who
        self.names = names
        self.gripping = names is None  # its motor loses its torque, too
        self._joints = None if names is None else named_joints(core, names)
        self._titles = ", ".join(one.title for one in core.robot.joints if one.name in (names or ()))
        self._began = self._stepped_at = now
        self._share = 1.0
        self._halts = 0
        self._stopped = False

    @property
    def standing(self) -> bool:
        """It is over."""
        return self.done

    @property
    def progress(self) -> float | None:
        """How much of the torque is gone."""
        return 1.0 - self._share

    @property
    def notice(self) -> str | None:
        """What to do meanwhile."""
        if self.done or self._stopped:
            return None
        what = "the arm sinks" if self.names is None else f"{self._titles} lets go"
        return f"{what}: support it. Release again switches it off at once, STOP holds it"

    def advance(self, now: float, dt: float) -> Setpoint | None:
        """A little less torque, or the end of it."""
        self._halts = 0
        if self.done:
            return None
        if self._stopped:
            self._hold(now)
        elif now - self._began >= LETTING_DOWN_S:
            self.finish()
        elif now - self._stepped_at >= _STEP_S:
            self._stepped_at = now
            self._share = max(LEAST_TORQUE, 1.0 - (now - self._began) / LETTING_DOWN_S)
            try:
                self._board.scale_torque(self._share, self._joints)
            except ArmctlError as error:
                self._core.log.warn(f"{error}; the {self._board.power} are switched off at once")
                self.finish()
        return None

    def finish(self) -> None:
        """Switch off now. ``BoardError``: it was not confirmed."""
        if self.done:
            return
        self._done = True
        try:
            release(self._core, self._who, self.names)
        except ArmctlError as error:
            self._ticket.end(error)
            raise
        self._ticket.end()

    def stop(self) -> None:
        """Hold the arm where it is."""
        if not self.done:
            self._stopped = True
            self._ticket.end(StateError("the release was interrupted; the arm is not released"))

    def halt(self) -> None:
        """The board does not answer for now; it is switched off where that lasts."""
        self._halts += 1
        if self._halts >= _MOST_HALTS and not self._stopped:
            self.finish()

    def _hold(self, now: float) -> None:
        """Give the arm its torque back where it has sunk to: the board holds each motor where it is then."""
        core, board = self._core, self._board
        self._done = True
        try:
            board.scale_torque(1.0, self._joints)
        except ArmctlError as error:  # it holds all the same; the next Enable gives it all again
            core.log.warn(f"{error}: some joints are weak. Release the arm, and enable it again")
        reading, q = core.monitor.read(board, now) or core.monitor.reading, core.gate.q
        if reading.source is not Source.MEASURED or q is None:
            return
        stays = np.isnan(reading.q) | board.limp
        if self._joints is not None:
            stays |= ~self._joints
        q = taken_over(core, board, np.where(stays, q, reading.q))  # outside its limits: a fault says so
        core.adopt(q, core.gate.opening, now)
        board.write(q, None)
