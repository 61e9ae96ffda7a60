"""How a simulated encoder board finds the zero of an axis."""

from __future__ import annotations

from collections.abc import Generator

from armctl.hardware.encoder.simulated_axis import SimulatedAxis

NOT_FOUND = "notfound"
STUCK = "stuck"

Homing = Generator[None, float, str]
"""Takes the seconds of each tick; returns why it failed, an empty string where it did not."""


def home(axis: SimulatedAxis) -> Homing:
    """Look for the switch, or for the stop, as the axis is set up."""
    axis.homed = False
    axis.switch_on()
    if axis.settings["hmode"]:
        yield from _until_stopped(axis)
    else:
        failure = yield from _find_edge(axis)
        if failure:
            return failure
    axis.set_zero()
    return ""


def _until_stopped(axis: SimulatedAxis) -> Generator[None, float, None]:
    while not _stopped(axis):
        yield from _creep(axis, axis.settings["hdir"])


def _find_edge(axis: SimulatedAxis) -> Homing:
    """Meet the switch coming from the far side, so that it is always the same edge."""
    toward = axis.settings["hdir"]
    if not (yield from _go(axis, -toward, closed=False)):
        return STUCK
    if not (yield from _go(axis, toward, closed=True)):
        # It stood beyond the switch: back over it, and once more from the right side.
        if not (yield from _go(axis, -toward, closed=True)):
            return NOT_FOUND
        if not (yield from _go(axis, -toward, closed=False)):
            return STUCK
        yield from _go(axis, toward, closed=True)
    return ""


def _go(axis: SimulatedAxis, direction: int, *, closed: bool) -> Generator[None, float, bool]:
    """Creep until the switch says ``closed``; False where the axis stops before."""
    axis.switch_on()
    while axis.switch_closed is not closed:
        if _stopped(axis):
            return False
        yield from _creep(axis, direction)
    return True


def _creep(axis: SimulatedAxis, direction: int) -> Generator[None, float, None]:
    dt = yield
    axis.creep(direction * float(axis.settings["hv"]), dt)


def _stopped(axis: SimulatedAxis) -> bool:
    return axis.standing_s >= axis.settings["stall"] / 1000.0
