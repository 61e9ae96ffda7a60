"""``armctl replay``: what a black box or a report tells of the last minute of an arm."""

from __future__ import annotations

import secrets
import tempfile
import webbrowser
import zipfile
from pathlib import Path

import click
import numpy as np

from armctl.arrays import FloatArray
from armctl.cli.options import ROBOT, end_event, has_display
from armctl.documents import write_atomically
from armctl.errors import InputError, RobotFileError
from armctl.facts.angles import to_degrees
from armctl.protocol import Recording, read_recording
from armctl.protocol.recording import ticks_csv
from armctl.robot import Robot, load_robot

_LAST_TICKS = 12
_MOST_ROBOT_BYTES = 4 << 20
_MOST_LATE_S = 0.005


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--text", is_flag=True, help="Print commands, log, warnings and the last ticks instead.")
@click.option(
    "--csv",
    "table",
    type=click.Path(path_type=Path),
    help="Write every tick to this CSV file instead: setpoints and readings [rad], loads, heat, voltages.",
)
@click.option("--robot", type=ROBOT, help="The robot to draw (default: the one that FILE has or names).")
@click.option("--http-port", type=click.IntRange(0, 65535), default=0, help="Of the page (default: any).")
@click.option("--no-browser", is_flag=True, help="Do not open a browser.")
def replay(
    file: Path, text: bool, table: Path | None, robot: str | None, http_port: int, no_browser: bool
) -> None:
    """Show what FILE holds, a saved black box or a report: the last minute of an arm. No arm is driven."""
    recording = read_recording(file)
    if table is not None:
        try:
            write_atomically(table, ticks_csv(recording).encode())
        except OSError as cause:
            raise InputError(f"{table} cannot be written: {cause.strerror}") from cause
        click.echo(f"{table}: {len(recording.ticks)} ticks")
    if text:
        for line in told(recording):
            click.echo(line)
    if text or table is not None:
        return
    from armctl.ui.guard import guarded_server
    from armctl.ui.replay import ReplayApp

    arm = _robot(file, recording) if robot is None else load_robot(robot)
    if arm.joint_names != recording.joints:
        raise InputError(
            f"{file}: its joints are {', '.join(recording.joints)}, those of {arm.name} are "
            f"{', '.join(arm.joint_names)}; name the robot that was recorded: --robot"
        )
    if arm.tools:
        for tool in recording.tools_on:
            arm = arm.with_tool(tool)  # one that it does not have is refused here
    server = guarded_server(
        port=http_port, token=secrets.token_urlsafe(24), label="armctl replay", overlay=False
    )
    app = ReplayApp(recording, arm, server)
    try:
        ended = end_event()
        click.echo(f"armctl: {file}: {server.links[0]}  (Ctrl-C ends)")
        if not no_browser and has_display():
            webbrowser.open(server.link_for_one_browser())
        ended.wait()
    finally:
        app.close()


def _robot(file: Path, recording: Recording) -> Robot:
    with zipfile.ZipFile(file) as archive, tempfile.TemporaryDirectory() as folder:
        for info in archive.infolist():
            if info.filename.startswith("robot/") and info.file_size <= _MOST_ROBOT_BYTES:
                path = Path(folder) / Path(info.filename).name
                path.write_bytes(archive.read(info))
                return load_robot(path)
    try:
        return load_robot(recording.robot)
    except RobotFileError as cause:
        raise InputError(f"{file}: {cause}; name the file of the robot: --robot") from cause


def told(recording: Recording) -> list[str]:
    """The story in lines: who asked for what, what came of it, and the ticks at the end."""
    time, end = recording.time_s, recording.clock_s
    late = recording.column("late_s")
    most = int(late.argmax())
    lines = [
        f"{recording.robot} on {recording.board}",
        f"{recording.why}",
        f"{time[-1] - time[0]:.1f} s up to {recording.wall(end).isoformat(sep=' ', timespec='milliseconds')}",
        f"{len(time)} ticks of {1000 * recording.period_s:g} ms; the latest came "
        f"{1000 * late[most]:.1f} ms late, at {time[most] - end:+.2f} s; "
        f"{int((late > _MOST_LATE_S).sum())} were more than "
        f"{1000 * _MOST_LATE_S:g} ms late",
        "",
        "time [s] before the end",
    ]
    happened = [(one.time_s, 0, f"> {one.who}: {one.what}") for one in recording.commands]
    happened += [
        (one.answered_s, 2, f"< {one.command or one.what}: {one.answer}")
        for one in recording.commands
        if one.answered_s is not None
    ]
    happened += [(one.time_s, 1, f"  {one.level}: {one.text}") for one in recording.lines]
    happened += [
        (one.time_s, 3, f"! {'; '.join(one.texts) or 'no warning any more'}") for one in recording.warnings
    ]
    lines += [f"{at - end:+9.3f}  {text}" for at, _, text in sorted(happened)]
    lines += ["", f"the last ticks: setpoint | reading [°] of {', '.join(recording.titles)}"]
    setpoint, readback = to_degrees(recording.setpoint), to_degrees(recording.readback)
    state = recording.column("state").astype(int)
    for k in range(max(0, len(time) - _LAST_TICKS), len(time)):
        lines.append(
            f"{time[k] - end:+9.3f}  {recording.states[state[k]]:<12} {_angles(setpoint[k])} | "
            f"{_angles(readback[k])}  late {1000 * late[k]:.1f} ms"
        )
    return lines


def _angles(degrees: FloatArray) -> str:
    return " ".join("      –" if np.isnan(one) else f"{one + 0.0:7.2f}" for one in degrees)
