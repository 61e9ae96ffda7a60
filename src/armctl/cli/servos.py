"""``armctl servos``: who is on a servo bus, what differs from what the arm needs, changes of one servo."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import click

from armctl.boards import AUTOMATIC, SIMULATED, Boards, require_kind, split_kind
from armctl.cli.main import DONE, REFUSED
from armctl.cli.options import ROBOT, json_option, named_port_option, print_json
from armctl.errors import InputError
from armctl.hardware.boards import board_type, channel_settings
from armctl.hardware.bus.lerobot import KeptServo, changed, read_kept, write_kept
from armctl.hardware.bus.setup import differences
from armctl.hardware.ports import find_board, list_ports
from armctl.hardware.servos import FoundServo, ServoSetup
from armctl.hardware.transport import SerialTransport
from armctl.protocol import MonotonicClock
from armctl.robot import Robot, load_robot


@dataclass(frozen=True, slots=True)
class Asked:
    """The arm and the port of all subcommands."""

    robot: Robot
    port: str

    @property
    def baud(self) -> int:
        """At which the arm's servos are spoken to."""
        return board_type(self.robot.board).baud

    @property
    def names(self) -> dict[int, str]:
        """Of the motors, as LeRobot calls them: joints by their names, and ``gripper``."""
        outputs = self.robot.outputs
        names = dict(zip(outputs.channels, self.robot.joint_names, strict=True))
        names |= {
            one.channel: f"{self.robot.joint_names[one.joint]}_{one.channel}" for one in outputs.mirrors
        }
        return names if outputs.gripper_channel is None else names | {outputs.gripper_channel: "gripper"}

    @contextmanager
    def setup(self) -> Generator[ServoSetup]:
        """The bus, to be set up."""
        now, board = MonotonicClock().now, board_type(self.robot.board)
        with closing(Boards(self.robot, now)) as boards:
            named, device = split_kind(self.port)
            if self.port == SIMULATED:
                device = boards.simulated().port
            elif self.port == AUTOMATIC:
                device = find_board(list_ports(), self.robot.board).device
            elif named is not None:
                require_kind(self.robot, named, device)
            setup = board.servo_setup(
                lambda baud: SerialTransport(device, baud=baud), now, simulated=self.port == SIMULATED
            )
            if setup is None:
                raise InputError(
                    f"{self.robot.title} has a {board.title}: it has no servos that could be set up"
                )
            with closing(setup):
                yield setup


@click.group(invoke_without_command=True)
@named_port_option("looks at")
@click.option("--robot", type=ROBOT, required=True, help="The arm whose servos they are.")
@click.option("--all-rates", is_flag=True, help="Look at every baud rate, not only at the arm's.")
@json_option
@click.pass_context
def servos(context: click.Context, port: str, robot: str, all_rates: bool, as_json: bool) -> int | None:
    """List the servos on a bus, and what differs from what the arm needs.

    Without a further command nothing is changed and nothing moves. The arm must not be connected: end the
    console first. The exit status is 1 where something differs.
    """
    context.obj = asked = Asked(load_robot(robot), port)
    if context.invoked_subcommand is not None:
        return None
    with asked.setup() as setup:
        found = setup.scan(None if all_rates else [asked.baud], likely=asked.names)
    told = differences(found, channel_settings(asked.robot), asked.baud, asked.names)
    if as_json:
        print_json({"servos": [asdict(one) for one in found], "differences": [asdict(one) for one in told]})
    else:
        for one in found:
            click.echo(_line(one, asked.names.get(one.id, "not of this arm")))
        for one in told:
            click.echo(f"{one.what}{f' -> {one.cure}' if one.cure else ''}")
        click.echo(f"{len(found)} servos, {len(told)} differences from {asked.robot.title}")
    return REFUSED if told else DONE


@servos.command("id")
@click.argument("old", type=click.IntRange(0, 252))
@click.argument("new", type=click.IntRange(0, 252))
@click.option("--baud", type=int, default=None, help="At which it answers (default: the arm's rate).")
@click.pass_obj
def change_id(asked: Asked, old: int, new: int, baud: int | None) -> None:
    """Give the servo OLD the id NEW.

    Plug in one new servo at a time: two with the same id answer at once, and nobody understands them.
    """
    with asked.setup() as setup:
        found = setup.change_id(asked.baud if baud is None else baud, old, new)
    click.echo(f"servo {old} has the id {new} now: {_line(found, asked.names.get(new, 'not of this arm'))}")


@servos.command("nudge")
@click.argument("servo", type=click.IntRange(0, 252))
@click.pass_obj
def nudge(asked: Asked, servo: int) -> None:
    """Turn SERVO by 2 degrees and back, weakly, to see which one it is.

    Keep clear, and support the arm: its torque is off again afterwards.
    """
    with asked.setup() as setup:
        setup.nudge(asked.baud, servo)
    click.echo(f"servo {servo} ({asked.names.get(servo, 'not of this arm')}) moved")


@servos.command("save")
@click.argument("file", type=click.Path(path_type=Path))
@click.pass_obj
def save(asked: Asked, file: Path) -> None:
    """Write what stands in the servos to FILE, as LeRobot's calibration.

    FILE can be read by LeRobot, and by `armctl servos restore`.
    """
    with asked.setup() as setup:
        found = {name: _present(setup, asked.baud, servo) for servo, name in asked.names.items()}
    write_kept(file, found)
    click.echo(f"{file}: {len(found)} servos")


@servos.command("restore")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--write", is_flag=True, help="Write what differs into the EEPROM; else it is listed only.")
@click.pass_obj
def restore(asked: Asked, file: Path, write: bool) -> int:
    """Compare the servos with FILE, a calibration of LeRobot, and write what differs.

    An offset moves what a servo calls its position: look at the arm's zeros afterwards.
    """
    kept, names = read_kept(file), {name: servo for servo, name in asked.names.items()}
    strangers = [name for name in kept if name not in names]
    if strangers:
        raise InputError(
            f"{file}: {asked.robot.title} has no motor {strangers[0]!r}; it has {', '.join(names)}"
        )
    for name, one in kept.items():
        if one.id != names[name]:
            raise InputError(
                f"{file}: {name} has the id {one.id}, in {asked.robot.title} it is {names[name]}"
            )
        if one.drive_mode:
            raise InputError(
                f"{file}: {name} has drive_mode 1; turn its direction round in the robot file (steps_per_deg)"
            )
    count = 0
    with asked.setup() as setup:
        for name, one in kept.items():
            count += _restored(setup, asked.baud, name, one, write=write)
    did = "written" if write else "differ; --write writes them"
    click.echo(f"{count} registers {did}" if count else "nothing differs")
    return DONE if write or not count else REFUSED


def _restored(setup: ServoSetup, baud: int, name: str, kept: KeptServo, *, write: bool) -> int:
    """List, or write, the registers of a servo that differ; how many do."""
    differ = changed(kept, _present(setup, baud, kept.id))
    for register, wanted, has in differ:
        click.echo(f"servo {kept.id} ({name}): {register} is {has}, the file has {wanted}")
        if write:
            setup.write(baud, kept.id, register, wanted)
    return len(differ)


def _present(setup: ServoSetup, baud: int, servo: int) -> FoundServo:
    found = setup.look(baud, servo)
    if found is None:
        raise InputError(f"servo {servo} does not answer; `armctl servos` looks for it")
    return found


def _line(one: FoundServo, name: str) -> str:
    volts = "" if one.voltage is None else f", {one.voltage:.1f} V"
    heat = "" if one.temperature is None else f", {one.temperature:.0f} °C"
    torque = ", torque on" if one.on else ""
    return (
        f"{one.id:>3}  {name:<16} {one.model}, firmware {one.settings.firmware}, {one.baud} baud, "
        f"at {one.position} steps{volts}{heat}{torque}"
    )
