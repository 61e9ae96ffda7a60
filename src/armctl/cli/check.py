"""``armctl check``: is a robot file or a program sound?"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

from armctl.boards import setup_of
from armctl.cli.main import DONE, REFUSED
from armctl.cli.opening import load_whole
from armctl.cli.options import ROBOT, json_option, print_json
from armctl.documents import DocumentKind
from armctl.errors import ArmctlError, BoardError, InputError
from armctl.facts import Advised, Said
from armctl.hardware.boards import board_type
from armctl.motion.clearance import clear_rest, kept_out, touching
from armctl.motion.preflight import Finding, not_checked, preflight
from armctl.motion.profiles import PointToPoint
from armctl.program import Program, check_program, open_program
from armctl.robot import Robot, is_urdf
from armctl.robot.look.rows import called
from armctl.robot.look_sound import faults
from armctl.robot.shape import across_the_link

_ANY = DocumentKind(InputError, most_bytes=1024 * 1024)
"""a TOML file of a robot or a program"""
_LONG = 500
"""steps of a program whose check takes more than a moment"""


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--robot", type=ROBOT, help="The robot to check a program against (default: the one it names).")
@json_option
def check(file: Path, robot: str | None, as_json: bool) -> int:
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
    try:
        if kind == "robot":
            arm = load_whole(file)
            assumed, left_out = arm.assumed, arm.left_out
            if left_out:
                sound = f"sound as an arm of {arm.n} joint{'s' * (arm.n > 1)}, without {', '.join(left_out)}"
            counted = [f"torques count {arm.gravity.counted}"] if arm.gravity.weighs else []
            findings = list(_check_robot(arm))
        else:
            given = None if robot is None else load_whole(robot)
            program = open_program(file, given)
            arm = given or load_whole(program.robot)
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
        named = str(file).partition("#")[0] in str(finding)
        text = str(finding) if named else f"{file}: {finding}"
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
    """``robot`` or ``program``: what the file's name or its top level says it is."""
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


def _check_robot(robot: Robot) -> Iterator[Finding]:
    """What is wrong with its solver, channels, rest pose, the ways to its named poses, and its look."""
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
    for fault in faults(robot):
        part = "the look" if fault.row is None else called(fault.row, robot.look.rows[fault.row])
        yield Finding(Said(fault.what, fault.mend), part=part, severity="warning")
