"""What the board stands at while the arm holds still: what a calibration takes its marks from."""

from __future__ import annotations

import numpy as np

from armctl.errors import StateError
from armctl.hardware import Source
from armctl.robot import OutputMap, Robot
from armctl.runtime import Snapshot, State


def present_outputs(robot: Robot, snapshot: Snapshot) -> dict[int, float]:
    """Output of every joint by channel, in the board's unit.

    As the board tells it; where the board tells nothing, as it was last told. An arm that is off and whose
    board measures may have been led there by hand.

    Raises:
        StateError: nobody knows where the arm is.
    """
    outputs = calibrated_map(robot)
    unknown = np.isnan(snapshot.q)
    if unknown.any() and not snapshot.commanded:
        if snapshot.source is Source.MEASURED:
            raise StateError("the board does not know where every joint stands; home the arm first")
        raise StateError(
            f"the arm is {snapshot.state.value}, so nobody knows where it stands; connect and enable it first"
        )
    return outputs.outputs(np.where(unknown, snapshot.q_command, snapshot.q))


def standing_outputs(robot: Robot, snapshot: Snapshot) -> dict[int, float]:
    """The same, of an arm that stands.

    Raises:
        StateError: the arm moves, or nobody knows where it is.
    """
    if snapshot.state in (State.MOVING, State.PAUSED):
        raise StateError("the arm is in the middle of a motion; wait until it stands, then press again")
    return present_outputs(robot, snapshot)


def standing_gripper(robot: Robot, snapshot: Snapshot) -> float:
    """Output of the gripper.

    Raises:
        StateError: it was not told to go anywhere yet.
    """
    if snapshot.gripper is None:
        raise StateError("the gripper has not been told to move yet; press 'Move gripper' first")
    (output,) = calibrated_map(robot).gripper_output(snapshot.gripper).values()
    return output


def calibrated_map(robot: Robot) -> OutputMap:
    """The map that the arm runs by.

    Raises:
        StateError: its file gives none, so that there is nothing to calibrate.
    """
    if robot.output_map is None:
        raise StateError(f"the robot file of {robot.title} gives no outputs: nothing to calibrate")
    return robot.output_map
