"""``armctl calibrate``: what was measured of an arm on a board, and the tool's error."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import click
import msgspec

from armctl.boards import board_name
from armctl.calibration import (
    Calibration,
    CalibrationStore,
    Change,
    Frame,
    JointCalibration,
    JointFit,
    TouchFit,
    calibrated,
    changes,
    corrected,
    differences,
    encode_calibration,
    fit_joint,
    fit_touches,
    iso_time,
    narrowed,
    own_calibration,
    own_map,
    read_calibration,
    read_marks,
    read_touches,
    renamed,
    safe_outputs,
    suggestion,
)
from armctl.cli.calibrate_joint import measure_joint, show_check_pose, show_fit, show_narrowed
from armctl.cli.options import (
    NUMBER,
    QUERY_SETTINGS,
    ROBOT,
    SPEED_PERCENT,
    json_option,
    named_port_option,
    pose_option,
    print_json,
    rounded,
)
from armctl.documents import not_written
from armctl.errors import CalibrationError
from armctl.facts.angles import DEGREE, to_degrees
from armctl.facts.words import fact_record
from armctl.protocol import wall_time
from armctl.robot import Robot, is_urdf, load_robot


@click.group()
def calibrate() -> None:
    """Measure an arm and keep what was measured, by robot and by the board's serial number.

    Outputs are in the board's unit: µs for servos, counts for encoders. The robot file stays as it is.
    """


# Numbers that are set, not fitted.

_NAME_IT = "say for which board: --port, or --board and its serial number (`armctl ports` prints it)"
board_option = click.option(
    "--board", help="Serial number of the board (default: the only one that the robot was calibrated with)."
)
port_option = click.option("--port", help="The port that the board is on, instead of --board.")


@calibrate.command(context_settings=QUERY_SETTINGS)
@click.argument("robot", type=ROBOT)
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
    own, outputs = own_calibration(arm, joint), own_map(arm)
    now = _in_force(arm, board, port)
    crosses = low < own.high and own.low < high
    if crosses and not outputs.homed and (low < own.low or high > own.high):
        raise CalibrationError(
            f"{joint}: {low:.1f} … {high:.1f} {outputs.unit} reach beyond {outputs.range_key} of the robot "
            f"file, {own.low:.1f} … {own.high:.1f} {outputs.unit}; stay inside, or change it there if the "
            "servo can go there"
        )
    one = now.joints.get(joint) or own
    changed = JointCalibration(one.zero, one.per_rad, low, high)
    _save(arm, msgspec.structs.replace(now, joints={**now.joints, joint: changed}))
    click.echo(f"{joint}: safe outputs {low:.1f} … {high:.1f} {now.unit}, kept for board {now.board}")


@calibrate.command(context_settings=QUERY_SETTINGS)
@click.argument("robot", type=ROBOT)
@click.argument("closed", type=NUMBER)
@click.argument("opened", type=NUMBER, metavar="OPEN")
@board_option
@port_option
def gripper(robot: str, closed: float, opened: float, board: str | None, port: str | None) -> None:
    """Set the outputs at which the gripper of ROBOT is CLOSED and OPEN, in the board's unit."""
    arm = load_robot(robot)
    now = _in_force(arm, board, port)
    _save(arm, msgspec.structs.replace(now, gripper=(closed, opened)))
    click.echo(
        f"gripper: closed at {closed:.1f}, open at {opened:.1f} {now.unit}, kept for board {now.board}"
    )


def _in_force(arm: Robot, board: str | None, port: str | None) -> Calibration:
    if board is not None and port is not None:
        raise click.UsageError("give --board or --port, not both")
    unit, store = own_map(arm).unit, CalibrationStore()
    if port is not None:
        board = board_name(port, arm)
    elif board is None:
        board = _chosen_board(store, arm.name, None, _NAME_IT)
    return store.load(arm.name, board) or Calibration(arm.name, board, unit, {})


def _save(arm: Robot, changed: Calibration) -> None:
    show_narrowed(arm, changed)
    CalibrationStore().save(msgspec.structs.replace(changed, made=iso_time(wall_time())))


# Measuring.


@calibrate.command()
@click.argument("robot", type=ROBOT)
@click.argument("joint")
@click.argument("marks", type=click.Path(path_type=Path))
@json_option
def fit(robot: str, joint: str, marks: Path, as_json: bool) -> None:
    """Fit JOINT of ROBOT to MARKS, a CSV file with the columns output and angle_deg; saves nothing."""
    arm = load_robot(robot)
    own_calibration(arm, joint)  # refuses a joint that is not there
    outputs = own_map(arm)
    found = fit_joint(read_marks(marks), outputs.unit, outputs.turn)
    if as_json:
        print_json(_fit_record(arm, joint, found))
    else:
        show_fit(arm, joint, found)


@calibrate.command("joint")
@click.argument("robot", type=ROBOT)
@click.argument("joint")
@named_port_option("measures")
@click.option("--places", type=click.IntRange(3, 20), default=5, show_default=True, help="How many marks.")
@click.option(
    "--speed", type=SPEED_PERCENT, default=20, show_default=True, help="Speed override, 5 … 100 percent."
)
@pose_option
@click.option("--note", default="", help="Kept with the calibration.")
def joint_command(
    robot: str, joint: str, port: str, places: int, speed: float, pose: str | list[float] | None, note: str
) -> None:
    """Measure JOINT of ROBOT: the arm moves it to some places, you read the angle off a protractor.

    Servos that are off come on one after the other where --pose says that they stand: keep clear.

    Ctrl-C stops the arm; so do SIGTERM and a terminal that is closed. Servos stay on at the end; motors
    with encoders are switched off: support the arm.
    """
    measure_joint(load_robot(robot), joint, port, places, speed, pose, note)


@calibrate.command()
@click.argument("robot", type=ROBOT)
@board_option
@json_option
def show(robot: str, board: str | None, as_json: bool) -> None:
    """Show the calibration in force for ROBOT, its earlier versions, and what it takes from the limits."""
    arm, store = load_robot(robot), CalibrationStore()
    board = _chosen_board(store, arm.name, board)
    versions, now = store.versions(arm.name, board), store.load(arm.name, board)
    words = () if now is None else narrowed(arm, now)
    if as_json:
        keys = ("number", "made", "note", "problem", "again")
        print_json({
            "robot": arm.name,
            "board": board,
            "calibration": _record(now),
            "narrowed": words,
            "versions": [{key: getattr(one, key) for key in keys} for one in versions],
        })  # fmt: skip
        return
    click.echo(f"{arm.title} on board {board}: {_in_words(now)}")
    if now is not None:
        for line in (*_lines(arm, now), *words):
            click.echo(f"  {line}")
        show_check_pose(calibrated(arm, now))
    for one in versions:
        what = one.problem or one.note or ("as in the robot file" if one.calibration is None else "")
        again = "" if one.again is None else f" (version {one.again} again)"
        click.echo(f"version {one.number}{again}   {one.made}   {what}")


@calibrate.command("list")
@json_option
def list_command(as_json: bool) -> None:
    """List the robots and boards that were calibrated on this computer."""
    store = CalibrationStore()
    found = store.boards()
    if as_json:
        print_json([
            {"robot": one.robot, "board": one.board, "problem": one.problem,
             "calibration": _record(one.calibration)}
            for one in found
        ])  # fmt: skip
        return
    if not found:
        click.echo("nothing was calibrated on this computer yet; see `armctl calibrate joint --help`")
    for one in found:
        click.echo(f"{one.robot:<12}{one.board:<16}{one.problem or _in_words(one.calibration)}")


@calibrate.command()
@click.argument("robot", type=ROBOT)
@board_option
@click.option("--to", "number", type=int, help="Number of the version (default: the one before).")
def revert(robot: str, board: str | None, number: int | None) -> None:
    """Go back to an earlier calibration of ROBOT; again and again goes further back. Nothing is lost."""
    store, name, board = _kept(robot, board)
    version = store.revert(name, board, number)
    words = _in_words(version.calibration)
    click.echo(f"{name} on board {board}: version {version.again} is in force again: {words}")


@calibrate.command()
@click.argument("robot", type=ROBOT)
@board_option
def forget(robot: str, board: str | None) -> None:
    """Let the file of ROBOT hold as it is. The calibrations so far are kept; `revert` brings them back."""
    store, name, board = _kept(robot, board)
    store.forget(name, board, iso_time(wall_time()))
    click.echo(f"{name} on board {board} goes by its robot file now")


@calibrate.command()
@click.argument("robot", type=ROBOT)
@click.argument("points", type=click.Path(path_type=Path))
@click.option("--board", help="Serial number of the board whose calibration the angles were read with.")
@click.option(
    "--frame",
    type=click.Choice(["base", "sheet"]),
    default="base",
    show_default=True,
    help="Of the points: the base frame, or that of a sheet that lies flat, nobody knows where.",
)
@click.option("--lengths", is_flag=True, help="All lengths of the links may be off, too.")
@click.option("--load-kg", type=NUMBER, default=0.0, show_default=True, help="What the tool carried.")
@click.option("--save", is_flag=True, help="Bring the correction in force for --board, where it is better.")
@json_option
def points(
    robot: str,
    points: Path,
    board: str | None,
    frame: Frame,
    lengths: bool,
    load_kg: float,
    save: bool,
    as_json: bool,
) -> None:
    """Compare where the tool of ROBOT went with the POINTS that it touched, and say what is to blame.

    POINTS is a CSV file: a column NAME_deg for each joint, and x_mm, y_mm, z_mm. About ten points, in
    poses as different as can be. Columns NAME_sense say in which sense each joint turned last (1, -1), and
    NAME_commanded_deg what was commanded where NAME_deg is measured.
    """  # fmt: skip
    arm, store = load_robot(robot), CalibrationStore()
    now = None if board is None or save else store.load(arm.name, _chosen_board(store, arm.name, board))
    if save:
        now = _in_force(arm, board, None)
    in_force = arm if now is None else calibrated(arm, now)
    fit = fit_touches(in_force, read_touches(points, arm, frame), load_kg=load_kg, lengths=lengths)
    found = changes(fit, () if now is None else now.joints)
    if as_json:
        print_json(_touch_record(fit, found))
    else:
        for line in fit.words():
            click.echo(line)
        if found:
            click.echo(f"to write into the robot file of {arm.name}, or into its calibration (--save):")
            click.echo(suggestion(found), nl=False)
    if save and now is not None:
        _save(arm, corrected(fit, now))
        if not as_json:
            click.echo(f"kept for board {now.board}")


def _touch_record(fit: TouchFit, found: tuple[Change, ...]) -> dict[str, object]:
    """A fit for programs; lengths in mm, facts in SI units."""
    return {
        "points": fit.count,
        "rms_mm": 1000 * fit.before.rms,
        "largest_mm": 1000 * fit.before.largest,
        "rms_after_mm": 1000 * fit.after.rms,
        "largest_after_mm": 1000 * fit.after.largest,
        "expected_mm": 1000 * fit.expected.rms,
        "expected_low_mm": 1000 * fit.expected.low,
        "expected_high_mm": 1000 * fit.expected.high,
        "better": fit.correct,
        "blamed": [fact_record(one) for one in fit.causes],
        "or_else": [fact_record(one) for one in fit.or_else],
        "mistaken": [fact_record(one) for one in fit.mistaken],
        "not_told": [fact_record(one) for one in fit.held],
        "changes": [asdict(change) for change in found],
    }


@calibrate.command("export")
@click.argument("robot", type=ROBOT)
@click.argument("file", type=click.Path(path_type=Path))
@board_option
def export(robot: str, file: Path, board: str | None) -> None:
    """Write the calibration in force for ROBOT to FILE (TOML), which must not be there yet."""
    store, name, board = _kept(robot, board)
    now = store.load(name, board)
    if now is None:
        raise CalibrationError(f"{name} on board {board} goes by its robot file: there is nothing to export")
    try:
        with file.open("x", encoding="utf-8") as stream:
            stream.write(encode_calibration(now))
    except OSError as cause:
        raise CalibrationError(not_written(file, cause)) from cause
    click.echo(f"{file}: {_in_words(now)}")


@calibrate.command("import")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--board", help="Serial number of the board to keep it for (default: the one in the file).")
@click.option("--robot", type=ROBOT, help="The robot, where it is not a shipped one: its file.")
def import_command(file: Path, board: str | None, robot: str | None) -> None:
    """Bring the calibration in FILE in force."""
    read = read_calibration(file)
    calibration = read if board is None else renamed(read, board)
    arm = load_robot(robot or calibration.robot)
    words = narrowed(arm, calibration)
    CalibrationStore().save(calibration)
    click.echo(f"{arm.name} on board {calibration.board}: {_in_words(calibration)}")
    for line in words:
        click.echo(f"  {line}")


def _kept(robot: str, board: str | None) -> tuple[CalibrationStore, str, str]:
    """The store, the robot's name (of a file the one inside, else what was typed), and its board."""
    store = CalibrationStore()
    name = load_robot(robot).name if is_urdf(robot) or Path(robot).suffix else robot
    return store, name, _chosen_board(store, name, board)


def _chosen_board(
    store: CalibrationStore, robot: str, board: str | None, begin: str = "begin with `armctl calibrate joint`"
) -> str:
    """The board that was named, or the only one of the robot; ``begin``: what to do where there is none."""
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


def _fit_record(arm: Robot, joint: str, found: JointFit) -> dict[str, object]:
    """A fit for programs; marks are counted from 1, as in the text."""
    return {
        "joint": joint,
        "unit": own_map(arm).unit,
        "zero": found.zero,
        "per_deg": found.per_rad * DEGREE,
        "residuals_deg": rounded([to_degrees(one) for one in found.residuals_rad]),
        "rms_deg": to_degrees(found.rms_rad),
        "wrong_marks": [] if found.suspect is None else [found.suspect + 1],
        "advice": found.advice,
        "safe_outputs": safe_outputs(arm, joint, found),
        "differences": differences(arm, joint, found),
    }


def _in_words(calibration: Calibration | None) -> str:
    if calibration is None:
        return "as in the robot file"
    joints = ", ".join(calibration.joints) or "no joint"
    gripper = "" if calibration.gripper is None else " and the gripper"
    return f"{joints}{gripper}, measured {calibration.made or 'some time'}"


def _lines(arm: Robot, calibration: Calibration) -> Iterator[str]:
    for name, joint in calibration.joints.items():
        line = f"{joint.zero:.2f} {calibration.unit} at 0°, {joint.per_rad * DEGREE:+.4f} a degree"
        yield f"{name}: {line}, safe {joint.low:.1f} … {joint.high:.1f}"
    yield from (f"{name}: as in the robot file" for name in arm.joint_names if name not in calibration.joints)
    for name, one in calibration.deflection.items():
        soft = f"bends by {(one.compliance + one.drive) / DEGREE:.2f}°/(N·m)"
        yield f"{name}: {soft}, {to_degrees(one.play):.2f}° play"
    if calibration.deflection:
        yield f"load: {calibration.load_kg:g} kg at the tool point, which joints give way to"
    for one in calibration.lengths:
        yield f"{one.key}_mm of DH row {one.row + 1}: {1000 * one.off_m:+.2f} mm"
    if calibration.gripper is not None:
        closed, opened = calibration.gripper
        yield f"gripper: closed at {closed:.1f}, open at {opened:.1f} {calibration.unit}"


def _record(calibration: Calibration | None) -> dict[str, object] | None:
    if calibration is None:
        return None
    joints = {
        name: {"zero": one.zero, "per_deg": one.per_rad * DEGREE, "low": one.low, "high": one.high}
        for name, one in calibration.joints.items()
    }
    gripper = calibration.gripper
    return {
        "unit": calibration.unit,
        "made": calibration.made,
        "note": calibration.note,
        "joints": joints,
        "gripper": None if gripper is None else {"closed": gripper[0], "open": gripper[1]},
        "deflection": {
            name: {
                "compliance_deg_per_nm": one.compliance / DEGREE,
                "drive_deg_per_nm": one.drive / DEGREE,
                "play_deg": one.play / DEGREE,
            }
            for name, one in calibration.deflection.items()
        },
        "load_kg": calibration.load_kg,
        "lengths": [
            {"row": one.row + 1, "key": one.key, "longer_mm": 1000 * one.off_m} for one in calibration.lengths
        ],
    }
