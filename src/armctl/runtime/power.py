"""Switching the outputs on and off, and homing: how the arm is taken over where it stands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, BoardError, MotionRefusedError, StateError
from armctl.hardware import Source
from armctl.motion import FLOOR_TOLERANCE_M, Floor
from armctl.runtime.activity import Setpoint
from armctl.runtime.board import Board, Reading
from armctl.runtime.commands import Order
from armctl.runtime.core import POWERED, Core
from armctl.runtime.snapshot import State

ADOPT_TOLERANCE_RAD = np.radians(0.25)
"""how far outside a limit a joint may stand when it is taken over, and two readings may differ"""
_ADOPT_TOLERANCE_STEPS = 1.5
"""the same in steps of the board, where these are coarser: an encoder at rest wavers by a count"""
_DROP_AND_ENABLE = "support the arm, release it (it drops) and enable again"
_BACK_INSIDE = {
    Source.COMMANDED: _DROP_AND_ENABLE,
    Source.TRANSMITTED: _DROP_AND_ENABLE,
    Source.MEASURED: "release it and turn it back by hand, or press Homing",
}
_HOME_FIRST = "press Homing (every axis moves to its switch)"
_SETTLE_S = 0.3
"""what is read before this may still be from before homing began, or was stopped"""
_LONGEST_S = 180.0


def enable(core: Core, wanted: FloatArray | None, who: str, now: float) -> None:
    """Pulses on: servos that were off jump to ``wanted`` (n,) [rad] (None: the rest pose), others stay."""
    if core.state in POWERED and core.gate.q is not None and wanted is None:
        return
    if core.state is not State.OFF or core.board is None:
        raise StateError(f"enable needs the state off, it is {core.state.value}{hint(core, to_enable=True)}")
    goal = core.robot.check_limits(core.robot.pose("rest") if wanted is None else wanted)
    core.board.configure()
    reading = _where_it_is(core, core.board, now)
    if reading.homing is not None and not reading.homing.done:
        raise StateError(f"the arm does not know where it is yet; {_HOME_FIRST}")
    live = ~np.isnan(reading.q)
    start = _taken_over(core, core.board, np.where(live, reading.q, goal))
    if not live.all() and (below := below_floor(core.floor, start)) is not None:
        raise MotionRefusedError(f"{below}; choose another pose to enable in")
    core.adopt(start, reading.opening, now)
    core.board.write(start, None)
    core.hold(f"enabled ({who}); {_how_it_began(core, live, reading.source)}")
    if wanted is not None and live.any() and (np.abs(start - goal) > _tolerance(core.board)).any():
        core.log.warn("enabled where the arm stands, not in the pose asked for: move there now")


def home(core: Core, order: Order, now: float) -> None:
    """Have the board look for the zero of every axis: the arm moves. It holds where that ends."""
    if core.board is None or core.state not in (State.OFF, State.HOLDING):
        raise StateError(
            f"homing needs the arm off or holding, it is {core.state.value}{hint(core, to_enable=True)}"
        )
    if core.monitor.reading.homing is None:
        raise StateError("the servos of this arm know their angles: there is nothing to home")
    who = order.origin.who
    instead = StateError(f"the arm is being homed ({who})")
    core.drop_motion(instead)
    core.gripper.stop(instead)
    core.board.configure()
    homing = Homing(core, core.board, now)
    core.gate.forget()
    core.monitor.enabled()
    core.begin(homing, who, now, order.ticket, order.motion)


def release(core: Core, who: str) -> None:
    """Outputs off: the arm drops."""
    if core.board is None:
        raise StateError(f"nothing to release: {core.state.value}")
    core.board.release()
    core.log.warn(f"RELEASE ({who}): {core.board.power} off")
    core.power_off(f"released ({who})")


def hint(core: Core, *, to_enable: bool = False) -> str:
    """What to do about a state in which a command is refused."""
    match core.state:
        case State.DISCONNECTED:
            return "; connect first" if to_enable else "; connect and enable first"
        case State.OFF:
            homing = core.monitor.reading.homing
            return "; enable first" if homing is None or homing.done else f"; {_HOME_FIRST}"
        case State.MOVING | State.PAUSED:
            return f" ({core.cause}); stop first"
        case State.FAULT:
            return f" ({core.cause}); clear the fault first"
        case State.HOLDING:
            return "; the arm is enabled already"


class Homing:
    """Watches a board that homes; sends nothing. When it is done the arm is taken over where it stands."""

    label = "homing"
    begun = True
    pausable = False
    program = None

    def __init__(self, core: Core, board: Board, now: float) -> None:
        """Have the board begin; ``BoardError`` where it does not."""
        self.error: ArmctlError | None = None
        """why not every axis is homed"""
        self._core, self._board = core, board
        self._logged = ""
        self._began: float | None = now
        self.done = False
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

    def set_speed(self, fraction: float) -> None:
        """Axes look for their zeros at their own, slow speed."""

    def pause(self, paused: bool) -> None:
        """Never called: it is not ``pausable``."""

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
            self.done = homing is None or homing.running is None
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
            self.done = True
            try:
                q = _taken_over(self._core, self._board, reading.q)
                self._core.adopt(q, reading.opening, now)
            except ArmctlError as error:
                self.error = error
        else:
            missing = [self._board.title(channel) for channel, homed in homing.homed.items() if not homed]
            failed = "; ".join(reading.errors) or f"{', '.join(missing)} did not find a zero"
        if failed:
            self.error = BoardError(f"homing ended before every axis had its zero: {failed}")
            self.done = True


def _where_it_is(core: Core, board: Board, now: float) -> Reading:
    """What two readings agree on: answers carry no checksum, and the arm is held where they say it is."""
    first, second = (core.monitor.read(board, now) for _ in range(2))
    if first is None or second is None:
        raise StateError("the board did not answer where it is; try again")
    differs = np.isnan(first.q) != np.isnan(second.q)
    differs |= np.nan_to_num(np.abs(first.q - second.q)) > _tolerance(board)
    if differs.any():
        names = ", ".join(core.robot.joints[i].title for i in np.flatnonzero(differs))
        raise StateError(f"the board says two things of where it is ({names}); let it stand and try again")
    return second


def below_floor(floor: Floor, q: FloatArray) -> str | None:
    """What of the arm a jump to ``q`` (n,) [rad] would put below the floor, in words; None: nothing."""
    gaps = floor.clearance(q)
    lowest = float(gaps.min(initial=0.0))
    if lowest >= -FLOOR_TOLERANCE_M:
        return None
    return f"{floor.parts[int(gaps.argmin())]}: {-1000 * lowest:.1f} mm below the floor"


def _tolerance(board: Board) -> FloatArray:
    """(n,) difference that says nothing [rad]."""
    return np.maximum(ADOPT_TOLERANCE_RAD, _ADOPT_TOLERANCE_STEPS / board.unit_per_rad)


def _taken_over(core: Core, board: Board, q: FloatArray) -> FloatArray:
    """``q`` (n,) [rad] inside the limits; refused where a joint stands clearly outside."""
    low, high = core.robot.limits.T
    outside = np.maximum(low - q, q - high) - _tolerance(board)
    i = int(outside.argmax())
    if outside[i] > 0:
        joint = core.robot.joints[i]
        raise StateError(
            f"{joint.title} stands at {np.degrees(q[i]):.1f}°, outside {np.degrees(joint.lower):.1f}° … "
            f"{np.degrees(joint.upper):.1f}°; {_BACK_INSIDE[core.monitor.reading.source]}"
        )
    return np.clip(q, low, high)


def _how_it_began(core: Core, live: NDArray[np.bool_], source: Source) -> str:
    if live.all():
        what = "encoders say" if source is Source.MEASURED else "board already sent pulses"
        return f"the {what} where the arm is, it stays there"
    if live.any():
        on = ", ".join(joint.title for joint, is_on in zip(core.robot.joints, live, strict=True) if is_on)
        return f"{on} stayed, the others jumped to the pose"
    return "the servos jumped to the pose"
