"""``armctl serve``: the operator's console in the browser."""

from __future__ import annotations

import errno
import logging
import os
import secrets
import ssl
import webbrowser
from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import click
from platformdirs import user_data_path, user_state_path

from armctl import log_files
from armctl.boards import AUTOMATIC, NO_BOARD, SIMULATED, only_simulated
from armctl.calibration import CalibrationStore
from armctl.cli.options import (
    ROBOT,
    EndEvent,
    MeshProgress,
    end_event,
    has_display,
    inputs_option,
    park_option,
    port_option,
)
from armctl.cli.reference import commands
from armctl.documents import sweep_litter, write_atomically
from armctl.errors import ArmctlError, ServerError, StoppedError, with_help
from armctl.handles import bring_to_rest
from armctl.hardware.boards import board_type
from armctl.hardware.input_script import load_script
from armctl.hardware.ports import list_ports
from armctl.process import start_arm
from armctl.process.heavy_work import Progress, worked_out
from armctl.protocol import ArmLink, Connect, Event, Origin, PlayInputs, wall_time
from armctl.robot import (
    Robot,
    hidden_robots,
    load_robot,
    robot_title,
    says_no_board,
    shipped_robots,
    user_robots,
)
from armctl.system import is_private, open_private, private_folder
from armctl.ui import (
    App,
    CalibrationInForce,
    Console,
    PortChoice,
    RobotChoice,
    RobotSwitch,
    settle_interpreter,
)
from armctl.ui.api import PATH as API_PATH
from armctl.ui.api import api_door
from armctl.ui.docs import ServedDocs
from armctl.ui.guard import TOKEN, GuardedServer, encryption, guarded_server
from armctl.ui.scene.arm_model import MOST_DRAWN, MOST_GHOSTLY, keep_drawn

LOG = logging.getLogger("armctl.cli.serve")
_TAKEN_OVER = (
    "the program before this one was gone without a word; its arm process has held the arm on {} since"
)


@click.command()
@click.option("--robot", type=ROBOT, default="uzuner", show_default=True,
              help="The robot to begin with: a shipped name or a robot file.")  # fmt: skip
@port_option
@click.option("--host", default="127.0.0.1", show_default=True,
              help="Address to listen on; 0.0.0.0 (or ::) lets other computers open the page.",
              )  # fmt: skip
@click.option("--http-port", type=click.IntRange(0, 65535), default=8080, show_default=True,
              help="0: any free one.")  # fmt: skip
@click.option("--allow-host", "names", multiple=True, metavar="NAME",
              help="A name of this computer in links (raspberrypi.local). Can be given several times.",
              )  # fmt: skip
@click.option("--tls-cert", type=click.Path(path_type=Path), metavar="FILE",
              help="Encrypt the line (https): the certificate, PEM.")  # fmt: skip
@click.option("--tls-key", type=click.Path(path_type=Path), metavar="FILE",
              help="The key of --tls-cert, PEM, without password.")  # fmt: skip
@click.option("--no-token", is_flag=True,
              help="Let every user and program of this computer open the page, without the link's token. "
                   "Refused where other computers can reach it.")  # fmt: skip
@click.option("--new-link", is_flag=True,
              help="Make a new link: whoever has the one before it is shut out. Without this option the link "
                   "to a port stays the same from start to start.")  # fmt: skip
@click.option("--pin", default="", envvar="ARMCTL_PIN", metavar="PIN",
              help="A teacher's PIN: who gives it in the page can always take and lock control. Set it as "
                   "ARMCTL_PIN, as others can see a command line.")  # fmt: skip
@click.option("--no-browser", is_flag=True, help="Do not open a browser.")
@inputs_option
@park_option
def serve(
    robot: str,
    port: str,
    host: str,
    http_port: int,
    names: tuple[str, ...],
    tls_cert: Path | None,
    tls_key: Path | None,
    no_token: bool,
    new_link: bool,
    pin: str,
    no_browser: bool,
    inputs: Path | None,
    park: bool,
) -> None:
    """Serve the console until interrupted (Ctrl-C)."""
    _begin_logs()
    tls = _encryption(tls_cert, tls_key)
    token = _token(http_port, no_token, new_link)
    ended = end_event()  # also while it starts: what has been started by then is ended in order
    ended.patient = False
    _sweep()
    open_console = partial(_open_console, asked=port, pin=pin)
    open_server = partial(guarded_server, host, http_port, extra_hosts=names, token=token, tls=tls)
    switches: list[RobotSwitch] = []
    sockets = {API_PATH: api_door(partial(_present_arm, switches), lambda who: switches[0].revive(who))}
    with ThreadPoolExecutor(1) as opener:  # the arm process starts while the page server does
        progress = MeshProgress(robot, lambda: ended.came)
        opening = opener.submit(open_console, robot, port, progress)
        try:
            server = open_server(sockets=sockets, docs=_docs(), label="armctl")
        except ServerError as refusal:
            progress.given_up = True
            with suppress(StoppedError):
                opening.result().close()
            raise ServerError(f"{refusal}{_link_of_another(refusal, http_port)}") from refusal
        try:
            console = opening.result()
        except BaseException:
            progress.given_up = True
            server.stop()
            raise
        finally:
            progress.end()
    present = RobotChoice(robot, console.robot.title, bool(console.robot.no_board))
    switches.append(robots := RobotSwitch(console, present, _robot_choices(present), open_console))
    try:
        app = App(robots, server)
        try:
            where = _connect(console, port, inputs)
            with _kept_link(server, token if http_port else None):
                click.echo(f"armctl: {present.title} {where}: {server.links[0]}  (Ctrl-C ends)")
                _say_more(server)
                _wait_for_end(server, ended, browser=not no_browser)
            if park:  # while the pages are there, so that STOP is
                _park(robots.console.controller)
        finally:
            app.close()
    finally:
        robots.close()


def _docs() -> ServedDocs | None:
    """The documentation, with what this command line says of itself; None: it was installed without."""
    whole = click.get_current_context().find_root().command
    try:
        return ServedDocs({"commands": partial(commands, whole)})
    except OSError as cause:
        LOG.warning("no documentation is served: %s", cause)
        return None


def _encryption(certificate: Path | None, key: Path | None) -> ssl.SSLContext | None:
    if (certificate is None) is not (key is None):
        raise click.UsageError("--tls-cert and --tls-key belong together: give both, or neither")
    return None if certificate is None or key is None else encryption(certificate, key)


def _token(http_port: int, no_token: bool, new_link: bool) -> str | None:
    if no_token and new_link:
        raise click.UsageError("--new-link makes a new token, and --no-token uses none: give one of them")
    return None if no_token else stored_token(http_port, new=new_link)


def _begin_logs() -> None:
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(levelname)s %(message)s")
    click.get_current_context().with_resource(log_files.begin("serve"))


def _sweep() -> None:
    for folder in (user_data_path("armctl"), CalibrationStore().folder, user_state_path("armctl")):
        for path in sweep_litter(folder, wall_time()):
            LOG.info("removed %s, which a killed save had left", path)


def _wait_for_end(server: GuardedServer, ended: EndEvent, *, browser: bool) -> None:
    ended.patient = True
    if browser and has_display() and not ended.came:
        webbrowser.open(server.link_for_one_browser())
    settle_interpreter()
    ended.wait()


def _park(link: ArmLink) -> None:
    operator = link.snapshot.control.operator
    bring_to_rest(link, Origin("serve --park" if operator is None else operator.id, "parking"))


def _present_arm(switches: list[RobotSwitch]) -> ArmLink | None:
    """The arm that is served now; None before it has been opened."""
    return switches[0].console.controller if switches else None


def _say_more(server: GuardedServer) -> None:
    """The other addresses of the page, and what the user should know of the line to it."""
    for link in server.links[1:]:
        click.echo(f"armctl: also at {link}")
    if not server.beyond_loopback and len(server.links) > 1:
        click.echo(
            "armctl: only this computer can open these links; --host 0.0.0.0 lets others open them", err=True
        )
    if server.beyond_loopback and not server.encrypted:
        click.echo(
            "armctl: the connection is not encrypted: who can listen in this network can read the token and "
            "drive the arm. Use it in a network that you trust, or give --tls-cert and --tls-key.",
            err=True,
        )


def _link_file(port: int) -> Path:
    return user_state_path("armctl") / f"link-{port}"


def _token_file(port: int) -> Path:
    """The secret of the links to a port: they and the pages that are open outlive a restart."""
    return user_state_path("armctl") / f"token-{port}"


def stored_token(port: int, *, new: bool) -> str:
    """The token of the last start on a port; another one where there is none that others cannot have read."""
    path = _token_file(port)
    try:
        if not new and is_private(path) and TOKEN.fullmatch(token := path.read_text("ascii")):
            return token
    except (OSError, UnicodeDecodeError):  # none yet, or none that can be used
        pass
    return secrets.token_urlsafe(24)


@contextmanager
def _kept_link(server: GuardedServer, token: str | None) -> Generator[None]:
    """Keep the token, and while the server runs its link, in files that only this user can read."""
    path, kept = _link_file(server.get_port()), False
    try:
        private_folder(path.parent)
        if token is not None:
            write_atomically(_token_file(server.get_port()), token.encode(), private=True)
        path.unlink(missing_ok=True)
        with open(path, "x", opener=open_private) as file:
            file.write(server.links[0])
        kept = True
    except OSError as cause:
        LOG.warning("the link is not kept for another start: %s: %s", path, cause.strerror)
    try:
        yield
    finally:
        if kept:
            path.unlink(missing_ok=True)


def _link_of_another(refusal: ServerError, port: int) -> str:
    """For a port that is busy, perhaps by an armctl of this user: the link that leads to it."""
    path = _link_file(port)
    is_busy = isinstance(refusal.__cause__, OSError) and refusal.__cause__.errno == errno.EADDRINUSE
    return (
        f". The armctl that runs there is at {path.read_text()}"
        if is_busy and os.access(path, os.R_OK)
        else ""
    )


def _open_console(name: str, port: str, progress: Progress, *, asked: str, pin: str) -> Console:
    """An arm, not connected yet, as calibrated with the board on a port; ``asked`` stays on offer."""
    robot, drawn = worked_out(load_robot(name), (MOST_DRAWN, MOST_GHOSTLY), progress)
    keep_drawn(robot.shapes, drawn)  # or the pages' event loop would wait for the files
    calibration = CalibrationInForce.of(robot, port)
    robot = calibration.robot
    _ = robot.inverse_kinematics  # takes a while, and may be refused: here, before a page waits for it
    link = start_arm(
        robot, calibration.board or NO_BOARD, name="console", beats=False, logs=True, pin=pin, port=port
    )
    held = link.snapshot.board
    return Console(
        calibration=calibration,
        controller=link,
        list_ports=lambda: _port_choices(asked, robot),
        files=user_data_path("armctl"),
        state=user_state_path("armctl"),
        close=link.close,
        default_port=port,
        pin=pin,
        earlier=() if held is None else (Event(wall_time(), "warning", _TAKEN_OVER.format(held.port)),),
    )


def _robot_choices(present: RobotChoice) -> list[RobotChoice]:
    names = (*shipped_robots(), *user_robots())
    choices = [RobotChoice(name, robot_title(name), says_no_board(name)) for name in names]
    for path in map(str, hidden_robots()):
        choices.append(RobotChoice(path, f"{robot_title(path)} (your own file)", says_no_board(path)))
    return choices if present in choices else [*choices, present]


def _connect(console: Console, port: str, inputs: Path | None) -> str:
    """Connect, and say on what; where that fails the page says why and offers the other ports.

    InputError: the inputs of the simulated board cannot follow what is in the file ``inputs``.
    """
    script = None if inputs is None else load_script(inputs, console.robot.signals)
    try:
        if console.controller.snapshot.board is None:  # else it was taken over
            console.controller.submit(Connect(port), Origin("start")).result()
        if script is not None:
            console.controller.submit(PlayInputs(script), Origin("start")).result()
    except ArmctlError as refusal:
        click.echo(f"armctl: not connected: {with_help(refusal)}", err=True)
        return "(not connected)"
    return "on the simulated board" if port == SIMULATED else f"on {port}"


def _port_choices(asked: str, robot: Robot) -> list[PortChoice]:
    """What may be chosen; boards that are there say why they cannot drive an arm that is simulated only."""
    choices, only = [PortChoice(SIMULATED, "Simulated board")], only_simulated(robot)
    if only is None:
        choices.append(PortChoice(AUTOMATIC, f"First {board_type(robot.board).plugged_in} found"))
    for port in list_ports():
        label = f"{port.kind} on {port.device}"
        why_not, notes = (port.why_not, port.notes) if only is None else (only, ())
        choices.append(PortChoice(port.device, label, why_not, port.serial_number, notes, listed=True))
    if asked not in [choice.port for choice in choices]:
        choices.append(PortChoice(asked, asked))
    return choices
