"""The snapshot of one tick."""

from __future__ import annotations

import numpy as np

from armctl.runtime.activity import ActivityView
from armctl.runtime.core import Core
from armctl.runtime.snapshot import AxisHoming, Snapshot

_IDLE = ActivityView(None, 0.0, 0.0)


def report(core: Core, tick: int, now: float) -> Snapshot:
    """Everything that the outside may know, as it is now."""
    q = core.gate.q
    still = np.zeros(core.robot.n)
    sample = core.setpoint
    reading = core.monitor.reading
    activity = core.activity
    view = _IDLE if activity is None else activity.view()
    return Snapshot(
        stamp=now,
        tick=tick,
        state=core.state,
        cause=core.cause,
        q_command=core.robot.first_pose if q is None else q,
        commanded=q is not None,
        velocity_command=still if sample is None else sample.velocity,
        acceleration_command=still if sample is None else sample.acceleration,
        q=reading.q,
        source=reading.source,
        powered=core.powered(),
        gripper=core.gate.opening,
        speed=core.speed,
        goal=view.goal,
        progress=view.progress,
        remaining_s=view.remaining_s,
        program=view.program,
        board=None if core.board is None else core.board.identity,
        homing=_homing(core),
        warnings=core.notices.current(now),
        events=core.log.events,
    )


def _homing(core: Core) -> tuple[AxisHoming, ...]:
    state = core.monitor.reading.homing
    if state is None or core.board is None:
        return ()
    title = core.board.title
    return tuple(
        AxisHoming(title(channel), homed, channel == state.running) for channel, homed in state.homed.items()
    )
