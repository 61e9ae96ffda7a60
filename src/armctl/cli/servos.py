"""``armctl servos``: who is on a servo bus, what differs from what the arm needs, changes of one servo."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping
from contextlib import closing, contextmanager
from dataclasses import asdict
from pathlib import Path

import click

from armctl.boards import SIMULATED, Boards, board_name
from armctl.cli.main import DONE, REFUSED
from armctl.cli.options import ROBOT, json_option, named_port_option, print_json
from armctl.errors import InputError
from armctl.facts.words import fact_record
from armctl.hardware.boards import board_type, channel_settings
from armctl.hardware.bus.differences import differences
from armctl.hardware.bus.lerobot import changed, motor_names, read_kept, require_fits, write_kept
from armctl.hardware.servo_records import KeptSettings, ServoRecords
from armctl.hardware.servos import Difference, FoundServo, Mend, ServoSetup
from armctl.lazy_dataclass import dataclass
from armctl.process.registry import holder
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
        """Of the motors, as LeRobot calls them."""
        return motor_names(self.robot)

    @contextmanager
    def setup(self) -> Generator[ServoSetup]:
        """The bus, to be set up."""
        with (
            closing(Boards(self.robot, MonotonicClock().now, held=holder)) as boards,
            closing(boards.servo_setup(self.port)) as setup,
        ):
            yield setup

    def kept(self) -> Mapping[int, KeptSettings]:
        """What was kept as right of these servos; nothing of simulated ones, which begin anew each time."""
        return {} if self.port == SIMULATED else ServoRecords().load(self.robot.name, self._board)

    def keep(self, found: Iterable[FoundServo]) -> None:
        """From now on these settings are right."""
        if self.port != SIMULATED:
            ServoRecords().keep(self.robot.name, self._board, found)

    @property
    def _board(self) -> str:
        return board_name(self.port, self.robot)


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
    told = differences(found, channel_settings(asked.robot), asked.baud, asked.names, asked.kept())
    if as_json:
        print_json({"servos": [asdict(one) for one in found], "differences": list(map(_record, told))})
    else:
        for one in found:
            click.echo(_line(one, asked.names.get(one.id, "not of this arm")))
        for one in told:
            click.echo(f"{one.what}{f' -> {one.cure}' if one.cure else ''}{_command(one.mend, asked.baud)}")
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
    asked.keep([found])
    click.echo(f"servo {old} has the id {new} now: {_line(found, asked.names.get(new, 'not of this arm'))}")


@servos.command("baud")
@click.argument("servo", type=click.IntRange(0, 252))
@click.argument("old", type=int)
@click.pass_obj
def change_baud(asked: Asked, servo: int, old: int) -> None:
    """Have SERVO, which answers at the rate OLD, answer at the rate of the arm."""
    with asked.setup() as setup:
        found = setup.change_baud(old, servo, asked.baud)
    click.echo(f"servo {servo} answers at {found.baud} baud now")


@servos.command("write")
@click.argument("servo", type=click.IntRange(0, 252))
@click.argument("register")
@click.argument("number", type=int)
@click.pass_obj
def write(asked: Asked, servo: int, register: str, number: int) -> None:
    """Write NUMBER into REGISTER of SERVO, for good.

    REGISTER is offset, lowest, highest, mode, or what the table of its make names.
    """
    with asked.setup() as setup:
        found = Mend(servo, asked.baud, numbers=((register, number),)).carry_out(setup)
    asked.keep([] if found is None else [found])
    click.echo(f"servo {servo}: {register} is {number} now")


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
    """Write what stands in the servos to FILE, as LeRobot's calibration, and keep it as right.

    FILE can be read by LeRobot, and by `armctl servos restore`. What another program changes from now on is
    named.
    """
    with asked.setup() as setup:
        found = {name: _present(setup, asked.baud, servo) for servo, name in asked.names.items()}
    write_kept(file, found)
    asked.keep(found.values())
    click.echo(f"{file}: {len(found)} servos")


@servos.command("restore")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--write", is_flag=True, help="Write what differs into the EEPROM; else it is listed only.")
@click.pass_obj
def restore(asked: Asked, file: Path, write: bool) -> int:
    """Compare the servos with FILE, a calibration of LeRobot, and write what differs.

    An offset moves what a servo calls its position: look at the arm's zeros afterwards.
    """
    kept = read_kept(file)
    require_fits(kept, asked.robot, str(file))
    count, found = 0, list[FoundServo]()
    with asked.setup() as setup:
        for name, one in kept.items():
            for register, wanted, has in (differ := changed(one, _present(setup, asked.baud, one.id))):
                click.echo(f"servo {one.id} ({name}): {register} is {has}, the file has {wanted}")
                if write:
                    setup.write(asked.baud, one.id, register, wanted)
            count += len(differ)
            found.append(_present(setup, asked.baud, one.id))
    if write or not count:
        asked.keep(found)
    did = "written" if write else "differ; --write writes them"
    click.echo(f"{count} registers {did}" if count else "nothing differs")
    return DONE if write or not count else REFUSED


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


def _record(one: Difference) -> Mapping[str, object]:
    """What differs, in words and as data."""
    mend = None if one.mend is None else asdict(one.mend)
    return fact_record(one.fact) | {"servo": one.servo, "what": one.what, "cure": one.cure, "mend": mend}


def _command(mend: Mend | None, baud: int) -> str:
    """What does it, behind ``armctl servos --port … --robot …``."""
    if mend is None:
        return ""
    if mend.new_id is not None:
        at = "" if mend.baud == baud else f" --baud {mend.baud}"
        return f" (id {mend.servo} {mend.new_id}{at})"
    if mend.new_baud is not None:
        return f" (baud {mend.servo} {mend.baud})"
    return f" ({', '.join(f'write {mend.servo} {name} {number}' for name, number in mend.numbers)})"
