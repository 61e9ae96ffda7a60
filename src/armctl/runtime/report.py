"""The snapshot of one tick."""

from __future__ import annotations

import numpy as np

from armctl.runtime.activity import ActivityView
from armctl.runtime.core import Core
from armctl.runtime.snapshot import Snapshot

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
        q_command=core.robot.pose("rest") if q is None else q,
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
        warnings=core.notices.current(now),
        events=core.log.events,
    )
