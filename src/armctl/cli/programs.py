"""``armctl check``: is a robot file or a program sound?"""

from __future__ import annotations

import sys
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from threading import Event, Thread

import click
import numpy as np

from armctl import log_files
from armctl.arm import Arm
from armctl.boards import setup_of
from armctl.cli.main import DONE, REFUSED
from armctl.cli.options import (
    ROBOT,
    SPEED_PERCENT,
    ends_like_ctrl_c,
    json_option,
    load_whole,
    park_option,
    port_option,
    pose_option,
    print_json,
    tool_option,
)
from armctl.documents import DocumentKind, not_written, write_atomically
from armctl.errors import ArmctlError, BoardError, InputError, ProgramError
from armctl.facts import Advised, Said
from armctl.hardware.boards import board_type
from armctl.motion.clearance import clear_rest, kept_out, touching
from armctl.motion.preflight import Finding, not_checked, preflight
from armctl.motion.profiles import PointToPoint
from armctl.program import Program, check_program, open_program
from armctl.protocol import ProgramProgress
from armctl.robot import Robot, is_urdf
from armctl.robot.load import across_the_link
from armctl.robot.look.rows import called
from armctl.robot.look_sound import faults

_ANY = DocumentKind(InputError, most_bytes=1024 * 1024)
"""a TOML file of a robot or a program"""
_LONG = 500
"""steps of a program whose check takes more than a moment"""


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--robot", type=ROBOT, help="The robot to check a program against (default: the one it names).")
@tool_option
@json_option
def check(file: Path, robot: str | None, tool: str | None, as_json: bool) -> int:
    """Check FILE, and say everything that is wrong with it.

    It is a robot file, a program, or the name of a robot.

    A program is checked as 'armctl run' begins it: from where the servos start.
    """
    kind = _kind(file)
    unknown: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    counted = list[str]()
    sound = f"a sound {kind}"
    opens = kind == "robot"  # what refuses to open the file names it
    try:
        if kind == "robot":
            arm, opens = load_whole(file, tool), False
            assumed, left_out = arm.assumed, arm.left_out
            if left_out:
                sound = f"sound as an arm of {arm.n} joint{'s' * (arm.n > 1)}, without {', '.join(left_out)}"
            counted = [f"torques count {arm.gravity.counted}"] if arm.gravity.weighs else []
            findings = [*_check_robot(arm), *_check_look(arm.flange or arm)]
            for other in () if tool is not None else arm.tools[1:]:
                findings += list(_check_tool(arm.with_tool(other.name), findings))
        else:
            given = None if robot is None else load_whole(robot, tool)
            opens = True
            program, opens = open_program(file, given), False
            arm = given or load_whole(program.robot, tool)
            findings = check_on_terminal(program, arm)
        unknown = tuple(one.text for one in not_checked(arm))
    except ArmctlError as refusal:
        findings = [Finding(one.reason) for one in refusal.each or (refusal,)]
    errors = [finding for finding in findings if finding.severity == "error"]
    if as_json:
        print_json({
            "file": str(file),
            "kind": kind,
            "sound": not errors,
            "findings": [_record(finding) for finding in findings],
            "not_checked": unknown,
            "assumed": assumed,
            "left_out": left_out,
        })  # fmt: skip
    else:
        warnings = f", with {len(findings)} warning{'s' if len(findings) > 1 else ''}" if findings else ""
        lines = [] if errors else [f"{sound}{warnings}"]
        lines += counted
        lines += [f"assumed: {text}" for text in assumed]
        for line in (*lines, *(f"not checked: {text}" for text in unknown)):
            click.echo(f"{file}: {line}")
    for finding in findings:
        text = str(finding) if opens else f"{file}: {finding}"
        click.echo(f"armctl: {'' if finding.severity == 'error' else 'warning: '}{text}", err=True)
    return REFUSED if errors else DONE


def check_on_terminal(program: Program, robot: Robot) -> list[Finding]:
    """Check a program from where the servos start; on a terminal a long one shows its progress."""
    steps, start = len(program.steps), robot.first_pose
    if steps < _LONG or not sys.stderr.isatty():
        return check_program(program, robot, start=start)
    with click.progressbar(length=steps, label=f"checking {steps} steps", file=sys.stderr) as bar:
        return check_program(program, robot, start=start, progress=lambda done, _: bar.update(done - bar.pos))


def _record(finding: Finding) -> dict[str, object]:
    """A finding as JSON; steps are counted from 1, as in the text."""
    return {
        "step": None if finding.step is None else finding.step + 1,
        "time_s": finding.time,
        "part": finding.part,
        "what": finding.what,
        "mend": finding.mend,
        "kind": finding.kind,
        "severity": finding.severity,
        "text": str(finding),
    }


def _kind(file: Path) -> str:
    if is_urdf(file) or (not file.suffix and len(file.parts) == 1 and not file.exists()):
        return "robot"
    if file.suffix.lower() in (".csv", ".py", ".xlsx", ".xls", ".ods"):
        return "program"
    top = _ANY.load(file, lambda content: _ANY.parse(content).record)
    return "robot" if "dh" in top or "joints" in top else "program"


def _other(pose: str, robot: Robot) -> str:
    """What to write for a named pose that is clear of everything, if one is easily found."""
    found = clear_rest(robot)
    if found is None:
        return f"choose another {pose} pose, or another height of the floor"
    return f"in the side file or the robot file, [poses] {pose} = {found[1]} would do"


def _check_tool(robot: Robot, known: Sequence[Finding]) -> Iterator[Finding]:
    """What is wrong with an arm with another tool on, and not with the first one."""
    told = {(one.part, str(one.reason)) for one in known}
    for finding in _check_robot(robot):
        if (finding.part, str(finding.reason)) not in told:
            yield replace(finding, part=f"with the tool {robot.tool}: {finding.part}")


def _check_robot(robot: Robot) -> Iterator[Finding]:
    """What is wrong with its solver, channels, rest pose, and the ways to its named poses."""
    robot.inverse_kinematics  # noqa: B018
    board = board_type(robot.board)
    if robot.output_map is not None:
        try:
            board.check(setup_of(robot))
        except BoardError as refusal:
            yield Finding(Advised(refusal.reason, "connecting is refused"), part="the board")
    # servos that are off may jump to where Enable sends them; motors stay where homing ended
    around = kept_out(robot)
    blocked = None if board.homing else touching(around, robot, robot.first_pose)
    if blocked is not None:
        mend = f"Enable is refused there; {_other('rest', robot)}"
        yield Finding(Advised(blocked, mend), part="the rest pose", kind=blocked.kind)
    note = across_the_link(robot.chain)
    if note is not None:
        yield Finding(Said(note.what, note.mend), part="the tool axis", kind="reach", severity="warning")
    home = robot.pose("home")
    away = touching(around, robot, home)
    if away is not None and (blocked is None or not np.array_equal(home, robot.first_pose)):
        mend = f"what leads there is refused; {_other('home', robot)}"
        yield Finding(Advised(away, mend), part="the home pose", kind=away.kind, severity="warning")
    for name in robot.poses:
        if name != "home" and away is None:
            for finding in preflight(robot, PointToPoint.plan(robot, home, robot.pose(name))):
                part = f"the way from home to {name}: {finding.part}"
                yield replace(finding, part=part, severity="warning")


def _check_look(robot: Robot) -> Iterator[Finding]:
    """What is wrong with the look of its file."""
    for fault in faults(robot):
        part = "the look" if fault.row is None else called(fault.row, robot.look.rows[fault.row])
        yield Finding(Said(fault.what, fault.mend), part=part, severity="warning")


# ``armctl run``: run a program without a browser.


_LOOK_S = 0.01


@click.command()
@click.argument("program", type=click.Path(path_type=Path))
@click.option("--robot", type=ROBOT, help="The robot (default: the one that the program names).")
@port_option
@click.option("--loops", type=click.IntRange(min=1), help="How many times.  [default: 1]")
@click.option("--forever", is_flag=True, help="Until interrupted, instead of --loops.")
@click.option("--speed", type=SPEED_PERCENT, default=100, show_default=True,
              help="Speed override, 5 … 100 percent.")  # fmt: skip
@tool_option
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
    tool: str | None,
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
    arm_robot = None if robot is None else load_whole(robot, tool)
    loaded = open_program(program, arm_robot)
    arm_robot = arm_robot or load_whole(loaded.robot, tool)
    findings = check_on_terminal(loaded, arm_robot)
    errors = [finding for finding in findings if finding.severity == "error"]
    if errors:
        raise ProgramError(f"{program}: {errors[0]}")
    for warning in findings:
        click.echo(f"warning: {warning}", err=True)
    board = board_type(arm_robot.board)
    with log_files.begin("run"), ends_like_ctrl_c(), Arm.open(arm_robot, port, park=park) as arm:
        if tool is not None:
            arm.set_tool(tool)
        elif arm.tool != arm_robot.tool:  # of an arm that ran already
            raise ProgramError(
                f"the tool {arm.tool!r} is on, and the program was checked with {arm_robot.tool!r}; say "
                "with --tool which one is on"
            )
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
        told: tuple[object, ...] | None = None
        while not ended.wait(_LOOK_S):
            progress = arm.snapshot.program
            if progress is None or progress.loop == progress.loops:  # the last pass is over
                continue
            if told != (told := (progress.loop, progress.step, progress.calls, progress.part)):
                click.echo(_step_words(progress), err=True)

    teller = Thread(target=tell, name="armctl-steps", daemon=True)
    teller.start()
    try:
        yield
    finally:
        ended.set()
        teller.join()


def _step_words(progress: ProgramProgress) -> str:
    step = progress.running.steps[progress.step]
    words = " · ".join(text for text in (step.describe(), step.note) if text)
    where = f"step {progress.step + 1} of {progress.steps}"
    if progress.loops != 1:
        where = f"pass {progress.loop + 1}, {where}"
    inside = f" · {progress.inside}" if progress.inside else ""
    return f"{where}: {step.title} {words}".rstrip() + inside


# ``armctl twin``: a program as a page that plays it, for a mail or a bug report.


@click.command()
@click.argument("program", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    help="The file to write, e.g. pick.html.",
)
@click.option("--robot", type=ROBOT, help="The robot (default: the one that the program names).")
@tool_option
def twin(program: Path, output: Path, robot: str | None, tool: str | None) -> int:
    """Write PROGRAM as one HTML file that plays it: arm, graphs, and what the pre-flight found.

    The file opens in any browser, without armctl and without a network. No arm is driven. The program
    begins where 'armctl run' begins it: where the servos start.
    """
    from armctl.ui.twin_file import planned_for_file, program_file

    if not output.is_dir() and output.suffix.lower() not in (".html", ".htm"):
        raise click.UsageError(f"--output {output}: the file is a web page; let its name end in .html")

    given = None if robot is None else load_whole(robot, tool)
    loaded = open_program(program, given)
    arm = given or load_whole(loaded.robot, tool)
    plan = planned_for_file(arm, loaded, arm.first_pose, None)
    findings = check_on_terminal(loaded, arm)
    page = program_file(arm, loaded, plan, findings).encode()
    try:
        write_atomically(output, page)
    except OSError as cause:
        raise InputError(not_written(output, cause)) from cause
    errors = [finding for finding in findings if finding.severity == "error"]
    for finding in findings:
        click.echo(f"armctl: {'' if finding in errors else 'warning: '}{program}: {finding}", err=True)
    end = "" if plan.broken is None else f", as far as step {plan.broken.index}"
    click.echo(f"{output}: {loaded.name}{end}, {plan.duration:.1f} s, {len(page) / 1e6:.2f} MB")
    return REFUSED if errors or plan.broken else DONE
