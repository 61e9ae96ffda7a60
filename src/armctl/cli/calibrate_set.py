"""``armctl calibrate safe`` and ``gripper``: numbers that are set, not fitted."""

from __future__ import annotations

import click

from armctl.boards import board_name
from armctl.calibration import (
    Calibration,
    CalibrationStore,
    JointCalibration,
    narrowed,
    own_calibration,
)
from armctl.cli.calibration_board import board_option, chosen_board
from armctl.cli.calibration_words import timestamp, unit_of
from armctl.cli.options import NUMBER, QUERY_SETTINGS
from armctl.errors import CalibrationError
from armctl.robot import Robot, load_robot

_NAME_IT = "say for which board: --port, or --board and its serial number (`armctl ports` prints it)"
port_option = click.option("--port", help="The port that the board is on, instead of --board.")


@click.command(context_settings=QUERY_SETTINGS)
@click.argument("robot")
@click.argument("joint")
@click.argument("low", type=NUMBER)
@click.argument("high", type=NUMBER)
@board_option
@port_option
def safe(robot: str, joint: str, low: float, high: float, board: str | None, port: str | None) -> None:
    """Set the outputs LOW … HIGH that JOINT of ROBOT may be sent; its limits move in with them.

    In the board's unit: µs for servos, counts for encoders.
    """
    arm = load_robot(robot)
    unit = unit_of(arm, joint)
    now = _now(arm, board, port)
    one = now.joints.get(joint) or own_calibration(arm, joint)
    changed = JointCalibration(one.zero, one.per_rad, low, high)
    _require_servo_range(arm, joint, changed)
    _save(arm, now, {**now.joints, joint: changed}, now.gripper)
    click.echo(f"{joint}: safe outputs {low:.1f} … {high:.1f} {unit}, kept for board {now.board}")


@click.command(context_settings=QUERY_SETTINGS)
@click.argument("robot")
@click.argument("closed", type=NUMBER)
@click.argument("opened", type=NUMBER, metavar="OPEN")
@board_option
@port_option
def gripper(robot: str, closed: float, opened: float, board: str | None, port: str | None) -> None:
    """Set the outputs at which the gripper of ROBOT is CLOSED and OPEN, in the board's unit."""
    arm = load_robot(robot)
    unit = unit_of(arm, arm.joint_names[0])
    now = _now(arm, board, port)
    _save(arm, now, dict(now.joints), (closed, opened))
    click.echo(f"gripper: closed at {closed:.1f}, open at {opened:.1f} {unit}, kept for board {now.board}")


def _require_servo_range(arm: Robot, joint: str, one: JointCalibration) -> None:
    """Refuse what the robot file would cut off again: whoever types it should know."""
    own = own_calibration(arm, joint)
    crosses = one.low < own.high and own.low < one.high
    if arm.board != "encoder" and crosses and (one.low < own.low or one.high > own.high):
        raise CalibrationError(
            f"{joint}: {one.low:.1f} … {one.high:.1f} µs reach beyond pulse_us of the robot file, "
            f"{own.low:.1f} … {own.high:.1f} µs; stay inside, or change it there if the servo can go there"
        )


def _now(arm: Robot, board: str | None, port: str | None) -> Calibration:
    """What is in force for the board; an empty calibration where nothing is."""
    if board is not None and port is not None:
        raise click.UsageError("give --board or --port, not both")
    if arm.output_map is None:
        raise CalibrationError(f"the robot file of {arm.title} gives no outputs to calibrate")
    store = CalibrationStore()
    key = (
        board_name(port, arm) if port is not None else board or chosen_board(store, arm.name, None, _NAME_IT)
    )
    found = store.load(arm.name, key)
    return found or Calibration(arm.name, key, arm.output_map.unit, {})


def _save(
    arm: Robot, now: Calibration, joints: dict[str, JointCalibration], jaws: tuple[float, float] | None
) -> None:
    changed = Calibration(now.robot, now.board, now.unit, joints, jaws, timestamp(), now.note)
    words = narrowed(arm, changed)
    CalibrationStore().save(changed)
    for line in words:
        click.echo(f"  {line}")
