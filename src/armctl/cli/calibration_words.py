"""Calibrations in words and as records: what the commands of ``armctl calibrate`` share."""

from __future__ import annotations

from datetime import UTC, datetime

import click
import numpy as np

from armctl.calibration import (
    Calibration,
    CalibrationStore,
    JointFit,
    differences,
    own_calibration,
    safe_outputs,
)
from armctl.cli.options import rounded
from armctl.errors import CalibrationError
from armctl.robot import Robot
from armctl.runtime.clock import wall_time


def unit_of(arm: Robot, joint: str) -> str:
    """The unit of the robot's outputs; refuses a joint that it has not."""
    own_calibration(arm, joint)
    return "µs" if arm.output_map is None else arm.output_map.unit


def timestamp() -> str:
    """Now, to the second, with the computer's offset from UTC (ISO 8601)."""
    return datetime.fromtimestamp(wall_time(), UTC).astimezone().isoformat(timespec="seconds")


def show_fit(arm: Robot, joint: str, found: JointFit) -> None:
    """A fit in words: the line, each mark's residual, what it changes, what is wrong with it."""
    unit, title = unit_of(arm, joint), arm.joints[arm.joint_names.index(joint)].title
    click.echo(f"{title}: {found.zero:.2f} {unit} at 0°, {np.radians(found.per_rad):+.4f} {unit} a degree")
    for number, residual in enumerate(np.degrees(found.residuals_rad), 1):
        left_out = "" if number - 1 in found.used else "   left out"
        click.echo(f"  mark {number}: {residual:+.2f}°{left_out}")
    click.echo(f"  RMS {np.degrees(found.rms_rad):.2f}°")
    for line in differences(arm, joint, found):
        click.echo(f"  {line}")
    if found.advice is not None:
        click.echo(f"armctl: warning: {found.advice}", err=True)
    low, high = safe_outputs(arm, joint, found)
    click.echo(f"  safe outputs: {low:.1f} … {high:.1f} {unit}")


def fit_record(arm: Robot, joint: str, found: JointFit, unit: str) -> dict[str, object]:
    """A fit for programs; marks are counted from 1, as in the text."""
    return {
        "joint": joint,
        "unit": unit,
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


def record(calibration: Calibration) -> dict[str, object]:
    """A calibration for programs, in degrees."""
    gripper = calibration.gripper
    return {
        "unit": calibration.unit,
        "made": calibration.made,
        "note": calibration.note,
        "joints": {
            name: {"zero": one.zero, "per_deg": float(np.radians(one.per_rad)), "low": one.low,
                   "high": one.high}
            for name, one in calibration.joints.items()
        },
        "gripper": None if gripper is None else {"closed": gripper[0], "open": gripper[1]},
    }  # fmt: skip


# Which board a command of ``armctl calibrate`` is about.

board_option = click.option(
    "--board", help="Serial number of the board (default: the only one that the robot was calibrated with)."
)


_BEGIN = "begin with `armctl calibrate joint`"


def chosen_board(store: CalibrationStore, robot: str, board: str | None, begin: str = _BEGIN) -> str:
    """The board that was named, or the only one.

    Args:
        store: the calibrations of this computer.
        robot: name of the robot.
        board: serial number; None: the only one.
        begin: what to do where there is no calibration yet.

    Raises:
        CalibrationError: the robot was never calibrated, or with several boards.
    """
    known = [one.board for one in store.boards() if one.robot == robot]
    if board is None and len(known) == 1:
        return known[0]
    if board is not None and board in known:
        return board
    if not known:
        raise CalibrationError(f"{robot} was never calibrated on this computer; {begin}")
    listed = ", ".join(known)
    if board is None:
        raise CalibrationError(f"{robot} was calibrated with several boards: {listed}; name one with --board")
    raise CalibrationError(f"{robot} was never calibrated with board {board!r}; known are {listed}")
