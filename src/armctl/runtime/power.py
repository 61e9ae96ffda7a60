"""Connecting, and switching the pulses on and off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError, MotionRefusedError, StateError
from armctl.hardware import Source
from armctl.motion import FLOOR_TOLERANCE_M, Floor
from armctl.runtime.board import Board, Reading
from armctl.runtime.core import POWERED, Core
from armctl.runtime.homing import Homing
from armctl.runtime.snapshot import State
from armctl.runtime.ticket import Ticket

FloatArray = NDArray[np.float64]
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
HOME_FIRST = "press Homing (every axis moves to its switch)"


def connect(core: Core, port: str, who: str, now: float) -> None:
    """Open the line. Moves nothing; leaves the outputs as they are.

    Raises:
        StateError: connected already.
        BoardError: nobody there.
    """
    if core.state not in (State.DISCONNECTED, State.FAULT):
        raise StateError(f"connected already, and {core.state.value}; disconnect first")
    if core.board is not None:
        core.disconnect("to connect again")
    try:
        core.board = Board.open(core.robot, core.open_driver, port)
        answered = core.monitor.read(core.board, now) is not None
    except ArmctlError as error:
        if core.board is not None:
            core.disconnect(str(error))
        core.enter(State.DISCONNECTED, str(error))
        raise
    identity = core.board.identity
    for note in identity.notes:
        core.log.info(note)
    for words in identity.earlier:
        core.log.warning(words)
    cause = f"connected to {identity.kind} at {identity.port} ({who}); "
    power = core.board.outputs.power
    if core.powered():
        cause += f"its {power} are on already: Enable takes the arm over where it is"
    else:
        cause += f"{power} are off" if answered else f"it has not said yet whether its {power} are on"
    core.enter(State.OFF, cause)


def enable(core: Core, wanted: FloatArray | None, who: str, now: float) -> None:
    """Switch the pulses on: servos that were off jump to ``wanted`` (n,) [rad], those that are on stay.

    Raises:
        StateError: not connected, in fault, a joint is on and outside its limits, or the board does not
            say twice the same of where it is.
        InputError: not finite, or a wrong shape.
        MotionRefusedError: ``wanted`` is outside the limits, or joints would jump to below the floor.
        BoardError: the board is gone.
    """
    if core.state in POWERED and core.gate.q is not None and wanted is None:
        return
    if core.state is not State.OFF or core.board is None:
        raise StateError(f"enable needs the state off, it is {core.state.value}{_way_out(core)}")
    goal = core.robot.check_limits(core.robot.pose("rest") if wanted is None else wanted)
    core.board.configure()
    reading = _where_it_is(core, core.board, now)
    if reading.homing is not None and not reading.homing.done:
        raise StateError(f"the arm does not know where it is yet; {HOME_FIRST}")
    live = ~np.isnan(reading.q)
    start = _taken_over(core, core.board, np.where(live, reading.q, goal))
    if not live.all() and (below := below_floor(core.floor, start)) is not None:
        raise MotionRefusedError(f"{below}; choose another pose to enable in")
    core.gate.jump(start, now)
    if reading.opening is not None:
        core.gate.adopt_opening(reading.opening, now)
    core.gripper.set(core.gate.opening)
    core.board.write(start, None)
    core.monitor.enabled()
    core.enter(State.HOLDING, f"enabled ({who}); {_how_it_began(core, live, reading.source)}")
    if wanted is not None and live.any() and (np.abs(start - goal) > _tolerance(core.board)).any():
        core.log.warning("enabled where the arm stands, not in the pose asked for: move there now")


def home(core: Core, ticket: Ticket, who: str, now: float) -> None:
    """Have the board look for the zero of every axis: the arm moves. It holds where that ends.

    Raises:
        StateError: not connected, in fault, moving, or a board whose servos have nothing to look for.
        BoardError: the board does not begin, or is gone.
    """
    if core.board is None or core.state not in (State.OFF, State.HOLDING):
        raise StateError(f"homing needs the arm off or holding, it is {core.state.value}{_way_out(core)}")
    if core.monitor.reading.homing is None:
        raise StateError("the servos of this arm know their angles: there is nothing to home")
    instead = StateError(f"the arm is being homed ({who})")
    core.upcoming.drop_motion(instead)
    core.gripper.stop(instead)
    board = core.board
    board.configure()

    def adopt(reading: Reading, when: float) -> None:
        core.gate.jump(_taken_over(core, board, reading.q), when)
        if reading.opening is not None:
            core.gate.adopt_opening(reading.opening, when)
        core.gripper.set(core.gate.opening)

    homing = Homing(board, lambda: core.monitor.reading, adopt, core.log, now)
    core.gate.forget()
    core.gripper.set(None)
    core.monitor.enabled()
    core.begin(homing, ticket, who, now)


def release(core: Core, who: str) -> None:
    """Pulses off: the arm drops.

    Raises:
        StateError: not connected.
        BoardError: the board is gone.
    """
    if core.board is None:
        raise StateError(f"nothing to release: {core.state.value}")
    core.board.release()
    core.log.warning(f"RELEASE ({who}): {core.board.outputs.power} off")
    core.power_off(f"released ({who})")


def clear_fault(core: Core, who: str) -> None:
    """Leave fault for ``holding`` (pulses on) or ``off``.

    Raises:
        StateError: no fault, or the board is gone.
    """
    if core.state is not State.FAULT:
        raise StateError(f"there is no fault to clear: {core.state.value}")
    if core.board is None:
        raise StateError(f"the board is gone ({core.cause}); connect again")
    core.gripper.set(core.gate.opening)
    if core.gate.q is None:
        if core.monitor.reading.powered is False:
            core.board.release()  # what the board has switched off by itself stays off until it is told so
        core.enter(State.OFF, f"fault cleared ({who})")
    else:
        core.enter(State.HOLDING, f"fault cleared ({who}); the arm holds the last setpoint")


def _way_out(core: Core) -> str:
    match core.state:
        case State.DISCONNECTED:
            return "; connect first"
        case State.FAULT:
            return f" ({core.cause}); clear the fault first"
        case State.HOLDING:
            return "; the arm is enabled already"
        case _:
            return f" ({core.cause}); stop first"


def _where_it_is(core: Core, board: Board, now: float) -> Reading:
    """What two readings agree on: answers carry no checksum, and the arm is held where they say it is."""
    readings = [core.monitor.read(board, now) for _ in range(2)]
    first, second = readings
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
    lowest = floor.clearance(q)
    if not lowest.size or float(lowest.min()) >= -FLOOR_TOLERANCE_M:
        return None
    return f"{floor.parts[int(lowest.argmin())]}: {-1000 * float(lowest.min()):.1f} mm below the floor"


def _tolerance(board: Board) -> FloatArray:
    """(n,) difference that says nothing [rad]."""
    return np.maximum(ADOPT_TOLERANCE_RAD, _ADOPT_TOLERANCE_STEPS / board.outputs.unit_per_rad)


def _taken_over(core: Core, board: Board, q: FloatArray) -> FloatArray:
    low, high = core.robot.limits[:, 0], core.robot.limits[:, 1]
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
