"""Calibrations in words and as records: what the commands of ``armctl calibrate`` share."""

from __future__ import annotations

import click
import numpy as np

from armctl.calibration import (
    Calibration,
    CalibrationStore,
    JointFit,
    check_pose,
    differences,
    narrowed,
    own_map,
    safe_outputs,
)
from armctl.cli.options import rounded
from armctl.errors import CalibrationError
from armctl.robot import Robot


def show_fit(arm: Robot, joint: str, found: JointFit) -> None:
    """A fit in words: the line, each mark's residual, what it changes, what is wrong with it."""
    unit, title = own_map(arm).unit, arm.joints[arm.joint_names.index(joint)].title
    click.echo(f"{title}: {found.zero:.2f} {unit} at 0°, {np.radians(found.per_rad):+.4f} {unit} a degree")
    for i, residual in enumerate(np.degrees(found.residuals_rad)):
        click.echo(f"  mark {i + 1}: {residual:+.2f}°{'   left out' if i == found.suspect else ''}")
    for line in (f"RMS {np.degrees(found.rms_rad):.2f}°", *differences(arm, joint, found)):
        click.echo(f"  {line}")
    if found.advice is not None:
        click.echo(f"armctl: warning: {found.advice}", err=True)
    low, high = safe_outputs(arm, joint, found)
    click.echo(f"  safe outputs: {low:.1f} … {high:.1f} {unit}")


def fit_record(arm: Robot, joint: str, found: JointFit) -> dict[str, object]:
    """A fit for programs; marks are counted from 1, as in the text."""
    return {
        "joint": joint,
        "unit": own_map(arm).unit,
        "zero": found.zero,
        "per_deg": float(np.radians(found.per_rad)),
        "residuals_deg": rounded(np.degrees(found.residuals_rad)),
        "rms_deg": float(np.degrees(found.rms_rad)),
        "wrong_marks": [] if found.suspect is None else [found.suspect + 1],
        "advice": found.advice,
        "safe_outputs": safe_outputs(arm, joint, found),
        "differences": differences(arm, joint, found),
    }


def in_words(calibration: Calibration | None) -> str:
    """Which parts were measured, and when."""
    if calibration is None:
        return "as in the robot file"
    joints = ", ".join(calibration.joints) or "no joint"
    gripper = "" if calibration.gripper is None else " and the gripper"
    return f"{joints}{gripper}, measured {calibration.made or 'some time'}"


def joint_lines(arm: Robot, calibration: Calibration) -> list[str]:
    """A line a joint, and one for the gripper."""
    lines = [
        f"{name}: {joint.zero:.2f} {calibration.unit} at 0°, {np.radians(joint.per_rad):+.4f} a degree, "
        f"safe {joint.low:.1f} … {joint.high:.1f}"
        for name, joint in calibration.joints.items()
    ]
    lines += [f"{name}: as in the robot file" for name in arm.joint_names if name not in calibration.joints]
    if calibration.gripper is not None:
        closed, opened = calibration.gripper
        lines.append(f"gripper: closed at {closed:.1f}, open at {opened:.1f} {calibration.unit}")
    return lines


def record(calibration: Calibration | None) -> dict[str, object] | None:
    """A calibration for programs, in degrees."""
    if calibration is None:
        return None
    joints = {
        name: {"zero": one.zero, "per_deg": float(np.radians(one.per_rad)), "low": one.low, "high": one.high}
        for name, one in calibration.joints.items()
    }
    gripper = calibration.gripper
    return {
        "unit": calibration.unit,
        "made": calibration.made,
        "note": calibration.note,
        "joints": joints,
        "gripper": None if gripper is None else {"closed": gripper[0], "open": gripper[1]},
    }


def show_narrowed(arm: Robot, calibration: Calibration) -> None:
    """What a calibration takes from the limits; refuses one that does not fit the robot."""
    for line in narrowed(arm, calibration):
        click.echo(f"  {line}")


def show_check_pose(arm: Robot) -> None:
    """Where a calibrated arm is to be sent to judge it by eye."""
    pose = check_pose(arm)
    click.echo(f"to check by eye, send it to {pose.title}: {'; '.join(pose.words)}")


board_option = click.option(
    "--board", help="Serial number of the board (default: the only one that the robot was calibrated with)."
)


def chosen_board(
    store: CalibrationStore, robot: str, board: str | None, begin: str = "begin with `armctl calibrate joint`"
) -> str:
    """The board that was named, or the only one that the robot was calibrated with.

    ``begin`` says what to do where there is no calibration yet.

    Raises:
        CalibrationError: the robot was never calibrated, not with this board, or with several.
    """
    known = [one.board for one in store.boards() if one.robot == robot]
    if not known:
        raise CalibrationError(f"{robot} was never calibrated on this computer; {begin}")
    if board is None and len(known) == 1:
        return known[0]
    listed = ", ".join(known)
    if board is None:
        raise CalibrationError(f"{robot} was calibrated with several boards: {listed}; name one with --board")
    if board not in known:
        raise CalibrationError(f"{robot} was never calibrated with board {board!r}; known are {listed}")
    return board
