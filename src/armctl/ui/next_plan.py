"""The motion to a next pose, planned beside the event loop."""

from __future__ import annotations

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.lazy_dataclass import dataclass
from armctl.motion import Profile, Trajectory, plan_joints
from armctl.robot import Robot
from armctl.ui.scene.ghost import SAME_RAD

PATH_POINTS = 48
Movement = tuple[Profile, float | None]
"""profile, and duration [s]; None: the shortest"""


def usual() -> Movement:
    """As the arm moves where nobody asks for another movement."""
    return "cubic", None


@dataclass(frozen=True, eq=False)
class ToPlan:
    """What is planned."""

    robot: Robot
    start: FloatArray
    q: FloatArray
    movement: Movement

    def is_as(self, other: ToPlan | None) -> bool:
        """Whether the plan of the other one holds."""
        return (
            other is not None
            and self.robot is other.robot
            and self.movement == other.movement
            and np.array_equal(self.q, other.q)
            and float(np.abs(self.start - other.start).max()) < SAME_RAD
        )

    def plan(self) -> Planned:
        """Plan the motion; it may take tenths of a second."""
        profile, duration = self.movement
        try:
            trajectory = plan_joints(self.robot, self.start, self.q, duration, profile)
        except ArmctlError as refusal:
            return Planned(refused=str(refusal))
        q = trajectory.sample(np.linspace(0.0, trajectory.duration, PATH_POINTS)).q
        return Planned(trajectory, tool_m=self.robot.forward(q)[:, :3, 3])


@dataclass(frozen=True, eq=False)
class Planned:
    """How the arm goes to the next pose, or why it does not."""

    trajectory: Trajectory | None = None
    refused: str = ""
    tool_m: FloatArray | None = None
    """(k, 3) where the tool passes [m]"""
