"""``armctl new``: a robot file of one's own."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Sequence
from typing import get_args

import click
import numpy as np

from armctl.cli.options import NUMBER
from armctl.errors import InputError
from armctl.facts.angles import to_degrees
from armctl.robot import Robot, is_urdf, load_robot, robot_path
from armctl.robot.draft import BUILDS, Build, Draft, build_named
from armctl.robot.load import across_the_link
from armctl.robot.look.rows import MAKES, written
from armctl.robot.parts import Hand, Look


@click.command()
@click.argument("name")
@click.option("--title", help="What pages call it (default: its name).")
@click.option("--build", type=click.Choice([one.name for one in BUILDS]), help="A usual build.")
@click.option("--length", "lengths", multiple=True, metavar="KEY=MM", help="A length of the build.")
@click.option("--from", "source", metavar="ROBOT", help="Begin with a copy of a robot or of a robot file.")
@click.option(
    "--limit", "limits", multiple=True, metavar="JOINT=LOW,HIGH", help="Limits of a joint [degrees]."
)
@click.option(
    "--servo",
    "servos",
    multiple=True,
    metavar="JOINT=CHANNEL[,ZERO_US,US_PER_DEG]",
    help="The servo that turns a joint.",
)
@click.option(
    "--gripper",
    metavar="CHANNEL[,CLOSED_US,OPEN_US]",
    help="The servo of a gripper (its pulses are calibrated later).",
)
@click.option(
    "--pose", "poses", multiple=True, metavar="NAME=Q,Q,…", help="A named pose [degrees]: home, rest, …"
)
@click.option("--floor", "floor_mm", type=NUMBER, help="Height of the floor in the base frame [mm].")
@click.option("--motors", type=click.Choice(list(MAKES)), help="Of its joints: so it is drawn.")
@click.option("--hand", type=click.Choice(get_args(Hand)), help="What is drawn at its tool point.")
@click.option("--replace", is_flag=True, help="Replace a robot of your own that has this name.")
@click.option("--print", "only_print", is_flag=True, help="Print the file instead of saving it.")
@click.option("--look", "only_look", is_flag=True, help="Print its look only, as a table of a robot file.")
def new(
    name: str,
    title: str | None,
    build: str | None,
    lengths: Sequence[str],
    source: str | None,
    limits: Sequence[str],
    servos: Sequence[str],
    gripper: str | None,
    poses: Sequence[str],
    floor_mm: float | None,
    motors: str | None,
    hand: str | None,
    replace: bool,
    only_print: bool,
    only_look: bool,
) -> None:
    """Make a robot file NAME of your own, from a usual build or from another robot.

    In a terminal it asks for what is not given. The file goes into your folder of robots, where every
    command and the page find it by its name.

    An arm without a look is drawn, and kept from touching itself, as a guess from its lengths. --look prints
    this guess as the table [look] of a robot file: correct it there, row by row.
    """
    if only_look and source is not None and is_urdf(source):
        click.echo(look_text(load_robot(source).whole_look), nl=False)
        return
    draft = _begun(name, title, build, dict(_pairs(lengths, "--length")), source)
    for joint, text in _pairs(limits, "--limit"):
        low, high = _numbers(text, f"--limit {joint}", 2)
        draft = draft.with_joint(joint, limit_deg=[low, high])
    for joint, text in _pairs(servos, "--servo"):
        numbers = _numbers(text, f"--servo {joint}", 1, 3)
        settings = dict(zip(("zero_us", "us_per_deg"), numbers[1:], strict=False))
        draft = draft.with_servo(joint, numbers[0], **settings)
    if gripper is not None:
        draft = draft.with_gripper(*_numbers(gripper, "--gripper", 1, 3))
    for pose, text in _pairs(poses, "--pose"):
        draft = draft.with_pose(pose, _numbers(text, f"--pose {pose}", len(draft.joints)))
    if floor_mm is not None:
        draft = draft.changed(floor={"z_mm": floor_mm})
    draft = draft.with_guess(motors, hand)
    if only_look:
        click.echo(look_text(draft.robot().whole_look), nl=False)
        return
    if only_print:
        draft.robot()
        click.echo(draft.text(), nl=False)
        return
    path = draft.save(replace_old=replace)
    for line in summary(draft.robot()):
        click.echo(line)
    click.echo(f"saved as {path}\nnext: armctl serve --robot {name}")


def look_text(look: Look) -> str:
    """A look as the table of a robot file."""
    source, pose = json.dumps(look.source, ensure_ascii=False), map(to_degrees, look.pose)
    angles = ", ".join(f"{angle:.6g}" for angle in pose)
    return f"[look]\nsource = {source}\npose_deg = [{angles}]\n{written(look.rows)}"


def _begun(
    name: str, title: str | None, build: str | None, lengths: dict[str, str], source: str | None
) -> Draft:
    title = title or name.replace("_", " ").capitalize()
    if source is not None:
        if build is not None or lengths:
            raise click.UsageError("give either --from or --build with --length, not both")
        return Draft.of_file(robot_path(source)).changed(name=name, title=title)
    asking = sys.stdin.isatty()
    if build is None:
        if not asking:
            raise click.UsageError("give --build or --from")
        build = _asked_build().name
    chosen = build_named(build)
    mm = {key: _numbers(text, f"--length {key}", 1)[0] for key, text in lengths.items()}
    if asking:
        for length in chosen.lengths:
            if length.key not in mm:
                mm[length.key] = click.prompt(
                    f"{length.title}, {length.meaning} [mm]", length.usual_mm, type=float
                )
    return Draft.of_build(name, title, chosen, mm)


def _asked_build() -> Build:
    for number, one in enumerate(BUILDS, 1):
        click.echo(f"{number}  {one.title}")
    return BUILDS[click.prompt("Which build", 1, type=click.IntRange(1, len(BUILDS))) - 1]


def summary(robot: Robot) -> list[str]:
    """What was recognised, in lines for a person."""
    x, y, z = np.round(1000 * robot.forward(robot.pose("home"))[:3, 3], 1) + 0.0
    solver = robot.inverse_kinematics
    how = "every solution in closed form" if solver.complete else "solutions by search"
    lines = [f"{robot.title}: {robot.n} joints; {solver.family}: {how}"]
    lines += [
        f"  {joint.title:<16}{joint.shown(joint.lower):9.2f}{joint.unit} … {joint.said(joint.upper)}"
        for joint in robot.joints
    ]
    lines.append(f"  in the pose home the tool is at x {x:z.1f}, y {y:z.1f}, z {z:z.1f} mm")
    if (note := across_the_link(robot.chain)) is not None:
        lines.append(f"  warning: the tool axis: {note.what}; {note.mend}")
    if robot.output_map is None:
        lines.append("  no servos yet: it runs on the simulated board (give --servo JOINT=CHANNEL)")
    return lines


def _pairs(texts: Iterable[str], option: str) -> Iterable[tuple[str, str]]:
    for text in texts:
        key, equals, value = text.partition("=")
        if not (key and equals and value):
            raise click.UsageError(f"{option} {text!r}: write NAME=VALUE")
        yield key.strip(), value


def _numbers(text: str, option: str, least: int, most: int | None = None) -> list[float]:
    most = least if most is None else most
    try:
        numbers = [float(one) for one in text.split(",")]
    except ValueError:
        wanted = "a number is needed" if most == 1 else "numbers are needed, with commas between them"
        raise InputError(f"{option} = {text!r}: {wanted}") from None
    if not (least <= len(numbers) <= most and all(map(math.isfinite, numbers))):
        count = f"{least}" if least == most else f"{least} to {most}"
        many = "one finite number is" if most == 1 else f"{count} finite numbers are"
        raise InputError(f"{option} = {text!r}: {many} needed{', with commas between them' * (most > 1)}")
    return numbers
