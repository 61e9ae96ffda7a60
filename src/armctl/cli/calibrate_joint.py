"""Measuring one joint at the terminal: the arm goes to places, a person reads the angles."""

from __future__ import annotations

import shlex

import click
import msgspec
import numpy as np

from armctl.arm import Arm
from armctl.boards import UNNUMBERED
from armctl.calibration import (
    LEAST_MARKS,
    Calibration,
    CalibrationStore,
    JointCalibration,
    JointFit,
    Mark,
    calibrated,
    check_pose,
    differences,
    fit_joint,
    iso_time,
    narrowed,
    own_calibration,
    own_map,
    safe_outputs,
)
from armctl.cli.options import ends_like_ctrl_c
from armctl.errors import CalibrationError, MotionRefusedError, ProgramError
from armctl.facts.angles import DEGREE, in_degrees, to_degrees
from armctl.hardware import Source
from armctl.protocol import wall_time
from armctl.robot import Robot

_MARGIN = 0.05
"""of the joint's range that is left free at either end"""


def measure_joint(
    robot: Robot, joint: str, port: str, places: int, speed: float, pose: str | list[float] | None, note: str
) -> None:
    """Take ``places`` marks of a joint on ``port``, fit them, and save them if the user wants that.

    ``robot`` is as its file describes it; ``speed`` is the override [percent]; ``pose`` is where the arm
    stands, as for ``Arm.enable``.
    """
    own_calibration(robot, joint)
    with ends_like_ctrl_c(), Arm.open(robot, port) as arm:
        if arm.board == UNNUMBERED:
            click.echo(f"the board on {port} has no serial number: what is saved holds for every such board")
        arm.set_speed(speed)
        first = "look for its home switches, then move" if arm.snapshot.homing else "move"
        click.confirm(
            f"{robot.title} on {port} will {first} to its home pose, then {joint} alone. Clear?", abort=True
        )
        arm.enable(pose)
        arm.go_pose("home")
        marks = _take_marks(arm, joint, places)
        outputs = own_map(robot)
        found = fit_joint(marks, outputs.unit, outputs.turn)
        show_fit(robot, joint, found)
        _keep(robot, arm.board, joint, found, note)


def _take_marks(arm: Arm, joint: str, places: int) -> list[Mark]:
    """Send the joint to places over its range, and ask what it shows there."""
    unit, index = own_map(arm.robot).unit, arm.robot.joint_names.index(joint)
    low, high = arm.robot.shown(arm.robot.limits.T)[:, index].tolist()
    margin = _MARGIN * (high - low)
    click.echo(
        "Read the angle of the joint at each place, in the robot's own sense (see `armctl robots` for its "
        "limits). An empty answer leaves the place out; Ctrl-C ends it."
    )
    marks: list[Mark] = []
    for place in range(places):
        angle = low + margin + (high - low - 2 * margin) * place / (places - 1)
        target = arm.joints_deg
        target[index] = angle
        try:
            arm.go_joints(target.tolist())
        except (MotionRefusedError, ProgramError) as refusal:
            click.echo(f"the place at {angle:.1f}° is left out: {refusal}", err=True)
            continue
        read = _ask(f"mark {len(marks) + 1}: {joint} should show {angle:.1f}°; it shows [°]")
        if read is not None:
            marks.append(Mark(_output(arm, index), arm.robot.joints[index].read(read)))
            click.echo(f"  {marks[-1].output:.1f} {unit}: {read:g}°")
    if len(marks) < LEAST_MARKS:
        raise CalibrationError(f"{len(marks)} marks were taken, {LEAST_MARKS} are needed; nothing is saved")
    return marks


def _ask(question: str) -> float | None:
    """An angle in degrees; None for an empty answer. Asks again after what is no angle."""
    while True:
        answer = str(click.prompt(question, default="", show_default=False)).strip().rstrip("°").strip()
        if not answer:
            return None
        try:
            read = float(answer.replace("−", "-").replace(",", "."))
        except ValueError:
            click.echo(f"{answer[:40]!r} is not a number", err=True)
            continue
        if abs(read) <= 720:
            return read
        click.echo(f"{read:g}° is no angle of a joint", err=True)


def _output(arm: Arm, index: int) -> float:
    snapshot, outputs = arm.snapshot, own_map(arm.robot)
    q = snapshot.q if snapshot.source is Source.MEASURED else snapshot.q_command
    if not np.isfinite(q[index]):
        raise CalibrationError("the board does not tell where the joint is; nothing is saved")
    return outputs.outputs(q)[outputs.channels[index]]


def _keep(robot: Robot, board: str, joint: str, found: JointFit, note: str) -> None:
    """Save the joint with the other joints that are in force, if the user wants it."""
    store = CalibrationStore()
    now = store.load(robot.name, board) or Calibration(robot.name, board, own_map(robot).unit, {})
    outputs = safe_outputs(robot, joint, found, now.joints.get(joint))
    joints = {**now.joints, joint: JointCalibration(found.zero, found.per_rad, *outputs)}
    calibration = msgspec.structs.replace(now, joints=joints, made=iso_time(wall_time()), note=note)
    show_narrowed(robot, calibration)
    if not click.confirm(f"Save it for board {board}?"):
        click.echo("nothing is saved")
        return
    version = store.save(calibration)
    back = f"armctl calibrate revert {robot.name} --board {shlex.quote(board)}"
    click.echo(f"saved as version {version.number}; `{back}` goes back")
    show_check_pose(calibrated(robot, calibration))


def show_fit(arm: Robot, joint: str, found: JointFit) -> None:
    """A fit in words: the line, each mark's residual, what it changes, what is wrong with it."""
    unit, title = own_map(arm).unit, arm.joints[arm.joint_names.index(joint)].title
    click.echo(f"{title}: {found.zero:.2f} {unit} at 0°, {found.per_rad * DEGREE:+.4f} {unit} a degree")
    for i, residual in enumerate(map(to_degrees, found.residuals_rad)):
        click.echo(f"  mark {i + 1}: {residual:+.2f}°{'   left out' if i == found.suspect else ''}")
    for line in (f"RMS {in_degrees(found.rms_rad)}", *differences(arm, joint, found)):
        click.echo(f"  {line}")
    if found.advice is not None:
        click.echo(f"armctl: warning: {found.advice}", err=True)
    low, high = safe_outputs(arm, joint, found)
    click.echo(f"  safe outputs: {low:.1f} … {high:.1f} {unit}")


def show_narrowed(arm: Robot, calibration: Calibration) -> None:
    """What a calibration takes from the limits; refuses one that does not fit the robot."""
    for line in narrowed(arm, calibration):
        click.echo(f"  {line}")


def show_check_pose(arm: Robot) -> None:
    """Where a calibrated arm is to be sent to judge it by eye."""
    pose = check_pose(arm)
    click.echo(f"to check by eye, send it to {pose.title}: {'; '.join(pose.words)}")
