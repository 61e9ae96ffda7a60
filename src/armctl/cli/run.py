"""``armctl run``: run a program without a browser."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from threading import Event, Thread

import click

from armctl import log_files
from armctl.arm import Arm
from armctl.cli.check import check_on_terminal
from armctl.cli.ending import ends_like_ctrl_c
from armctl.cli.opening import load_whole
from armctl.cli.options import ROBOT, SPEED_PERCENT, park_option, port_option, pose_option
from armctl.errors import ProgramError
from armctl.hardware.boards import board_type
from armctl.program import open_program
from armctl.protocol import ProgramProgress

_LOOK_S = 0.01


@click.command()
@click.argument("program", type=click.Path(path_type=Path))
@click.option("--robot", type=ROBOT, help="The robot (default: the one that the program names).")
@port_option
@click.option("--loops", type=click.IntRange(min=1), help="How many times.  [default: 1]")
@click.option("--forever", is_flag=True, help="Until interrupted, instead of --loops.")
@click.option("--speed", type=SPEED_PERCENT, default=100, show_default=True,
              help="Speed override, 5 … 100 percent.")  # fmt: skip
@pose_option
@park_option
@click.option("--quiet", is_flag=True, help="Do not tell the steps as they begin.")
def run(
    program: Path,
    robot: str | None,
    port: str,
    loops: int | None,
    forever: bool,
    speed: float,
    pose: str | list[float] | None,
    park: bool,
    quiet: bool,
) -> None:
    """Run PROGRAM (.toml, or .csv with --robot) on the arm.

    Servos that are off come on one after the other where --pose says that they stand, and motors with
    encoders look for their home switches: keep clear.

    Ctrl-C stops the arm; so do SIGTERM and a terminal that is closed. At the end servos stay on; motors
    with encoders go off, as their board does when nobody speaks to it.
    """
    if forever and loops is not None:
        raise click.UsageError(f"--loops {loops} or --forever, not both")
    arm_robot = None if robot is None else load_whole(robot)
    loaded = open_program(program, arm_robot)
    arm_robot = arm_robot or load_whole(loaded.robot)
    findings = check_on_terminal(loaded, arm_robot)
    errors = [finding for finding in findings if finding.severity == "error"]
    if errors:
        raise ProgramError(f"{program}: {errors[0]}")
    for warning in findings:
        click.echo(f"warning: {warning}", err=True)
    board = board_type(arm_robot.board)
    with log_files.begin("run"), ends_like_ctrl_c(), Arm.open(arm_robot, port, park=park) as arm:
        arm.set_speed(speed)
        if any(not axis.homed for axis in arm.snapshot.homing):
            click.echo("homing: axis by axis, the arm moves to its home switches; keep clear", err=True)
        arm.enable(pose)
        with nullcontext() if quiet else _told_steps(arm):
            arm.run(loaded, None if forever else loops or 1)
        x, y, z = arm.position_mm
        steps = "1 step" if len(loaded.steps) == 1 else f"{len(loaded.steps)} steps"
        click.echo(
            f"done: {loaded.name}, {steps}; the tool is at ({x:z.1f}, {y:z.1f}, {z:z.1f}) mm"
            + (f"; the {board.power} go off now" if board.off_when_left else "")
        )


@contextmanager
def _told_steps(arm: Arm) -> Generator[None]:
    """A line on stderr for each step of a program as it begins; one that is over at once may be left out."""
    ended = Event()

    def tell() -> None:
        told: tuple[int, int] | None = None
        while not ended.wait(_LOOK_S):
            progress = arm.snapshot.program
            if progress is None or progress.loop == progress.loops:  # the last pass is over
                continue
            if told != (told := (progress.loop, progress.step)):
                click.echo(_step_words(progress), err=True)

    teller = Thread(target=tell, name="armctl-steps", daemon=True)
    teller.start()
    try:
        yield
    finally:
        ended.set()
        teller.join()


def _step_words(progress: ProgramProgress) -> str:
    """One line for the step that runs: its place, its kind, its values, its note."""
    step = progress.running.steps[progress.step]
    words = " · ".join(text for text in (step.describe(), step.note) if text)
    where = f"step {progress.step + 1} of {progress.steps}"
    if progress.loops != 1:
        where = f"pass {progress.loop + 1}, {where}"
    return f"{where}: {step.title or step.kind} {words}".rstrip()
