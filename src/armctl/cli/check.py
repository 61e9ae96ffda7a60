"""``armctl check``: is a robot file or a program sound?"""

from __future__ import annotations

from pathlib import Path

import click
import msgspec

from armctl.cli.main import DONE, REFUSED
from armctl.cli.options import json_option, print_json
from armctl.errors import ArmctlError, InputError
from armctl.motion import check_program, load_program
from armctl.robot import load_robot


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--robot", help="The robot to check a program against (default: the one it names).")
@json_option
def check(file: Path, robot: str | None, as_json: bool) -> int:
    """Check FILE, a robot file or a program, and say everything that is wrong with it."""
    kind = _kind(file)
    try:
        findings = _check_robot(file) if kind == "robot" else _check_program(file, robot)
    except ArmctlError as refusal:
        findings = [str(refusal)]
    if as_json:
        print_json({"file": str(file), "kind": kind, "sound": not findings, "findings": findings})
    elif not findings:
        click.echo(f"{file}: a sound {kind}")
    for finding in findings:
        click.echo(f"armctl: {finding if str(file) in finding else f'{file}: {finding}'}", err=True)
    return REFUSED if findings else DONE


def _kind(file: Path) -> str:
    """``robot`` or ``program``: what the file's name or its top level says it is."""
    if file.suffix == ".urdf":
        return "robot"
    try:
        top = msgspec.toml.decode(file.read_bytes())
    except OSError as cause:
        raise InputError(f"{file}: cannot be read: {cause.strerror}") from cause
    except ValueError as cause:
        raise InputError(f"{file}: is not TOML: {cause}") from cause
    return "robot" if isinstance(top, dict) and ("dh" in top or "joints" in top) else "program"


def _check_robot(file: Path) -> list[str]:
    load_robot(file).inverse_kinematics  # noqa: B018  choosing the solver is part of the check
    return []


def _check_program(file: Path, robot: str | None) -> list[str]:
    program = load_program(file)
    return [str(finding) for finding in check_program(program, load_robot(robot or program.robot))]
