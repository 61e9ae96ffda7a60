"""From a port as the user names it to a driver: the simulated board, the one that is found, or a device."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, get_args

from armctl.calibration import CalibrationStore, calibrated
from armctl.errors import PortError
from armctl.hardware import Driver
from armctl.hardware.board_titles import BOARD_TITLES
from armctl.hardware.encoder import EncoderDriver, serve_simulated_encoder
from armctl.hardware.firmata import FirmataDriver, serve_simulated_firmata
from armctl.hardware.maestro import MaestroDriver, serve_simulated_maestro
from armctl.hardware.ports import MaestroModel, PortInfo, describe_port, find_board, list_ports
from armctl.hardware.simulation.pty_server import PtyServer
from armctl.hardware.transport import NO_SUCH_PORT
from armctl.robot import BoardKind, Robot
from armctl.runtime import channel_settings

SIMULATED, AUTOMATIC = "sim", "auto"
SIMULATED_SERIAL = "simulated"
"""what stands for the serial number of a simulated board"""
UNNUMBERED = "unnumbered"
"""what stands for the serial number of a board without one: one calibration for all of them"""
ANY_BOARD, NO_BOARD = "*", ""
"""for an arm that may be connected to any board; for one whose board was not there when it was opened"""
_SIMULATED_TIMEOUT_S = 0.5
"""The simulated board lives in this process: on a busy computer it is late, never gone."""
_REPEATED_WITHIN_S, _FIRMATA_TIMEOUT_S = 0.1, 0.25


class Boards:
    """Opens drivers of one robot, and owns the simulated board behind ``sim`` while the program runs.

    Args:
        robot: whose board it is; its file says of which kind.
        now: the clock [s].
        ports: the listing of serial ports.
        board: what ``board_name`` called the board that the robot is calibrated with, or ``NO_BOARD``. A
            driver of another real board refuses to open: its calibration, or its lack of one, is another.
    """

    def __init__(
        self,
        robot: Robot,
        now: Callable[[], float],
        ports: Callable[[], Sequence[PortInfo]] = list_ports,
        board: str = ANY_BOARD,
    ) -> None:
        self._robot, self._now, self._ports, self._board = robot, now, ports, board
        self._lock = threading.Lock()
        self._simulated: PtyServer[Any] | None = None

    def driver(self, port: str) -> Driver:
        """A driver for a port, not opened yet.

        Args:
            port: ``sim``, ``auto``, a device or ``socket://host:port``; a device may have the kind of its
                board in front (``firmata:/dev/ttyUSB0``), which must be that of the robot file.

        Raises:
            PortError: ``auto`` found no board, or more than one; another kind of board than the robot
                file's; or the arm may only be simulated.
        """
        if port == SIMULATED:
            return self._driver(self._robot.board, self.simulated().port, simulated=True)
        _require_name(port)
        _require_outputs(self._robot, port)
        if port == AUTOMATIC:
            return self._driver(self._robot.board, find_board(self._ports(), self._robot.board).device)
        kind, device = split_kind(port)
        return self._driver(kind or self._listed_kind(device), device)

    def simulated(self) -> PtyServer[Any]:
        """The simulated board's server, started when it is first asked for."""
        with self._lock:
            if self._simulated is None:
                server = self._serve()
                server.__enter__()
                self._simulated = server
            return self._simulated

    def close(self) -> None:
        """Take the simulated board off its line. May be called more than once."""
        with self._lock:
            server, self._simulated = self._simulated, None
        if server is not None:
            server.__exit__(None, None, None)

    def _driver(self, kind: BoardKind, line: str, *, simulated: bool = False) -> Driver:
        robot = self._robot
        require_kind(robot, kind, line)
        accept = partial(self._accept, line)
        match kind:
            case "maestro":
                if not simulated:
                    return MaestroDriver(line, ports=self._ports, accept=accept)
                return MaestroDriver(
                    line, model=_model(robot), simulated=True, timeout_s=_SIMULATED_TIMEOUT_S
                )
            case "firmata":
                patience = _SIMULATED_TIMEOUT_S if simulated else _FIRMATA_TIMEOUT_S
                return FirmataDriver(
                    line,
                    now=self._now,
                    simulated=simulated,
                    ports=self._ports,
                    accept=accept,
                    timeout_s=patience,
                )
            case "encoder":
                return EncoderDriver(
                    line,
                    axes=robot.axes,
                    differential=robot.differential,
                    now=self._now,
                    simulated=simulated,
                    ports=self._ports,
                    accept=accept,
                    timeout_s=_SIMULATED_TIMEOUT_S if simulated else _REPEATED_WITHIN_S,
                )

    def _accept(self, line: str, serial_number: str | None) -> None:
        """Refuse the board of another calibration: a name of a port may mean another board by now."""
        found = serial_number or UNNUMBERED
        if self._board in (ANY_BOARD, found):
            return
        was = "no board was there" if self._board == NO_BOARD else f"board {self._board} was there"
        raise PortError(
            f"{line}: {was} when the calibration of {self._robot.title} was looked up, now board {found} is; "
            "it was told nothing. Connect again, to go by its own calibration"
        )

    def _serve(self) -> PtyServer[Any]:
        robot = self._robot
        match robot.board:
            case "maestro":
                return serve_simulated_maestro(
                    self._now, channels=channel_settings(robot), model=_model(robot)
                )
            case "firmata":
                return serve_simulated_firmata(self._now)
            case "encoder":
                return serve_simulated_encoder(self._now, channels=channel_settings(robot), axes=robot.axes)

    def _listed_kind(self, device: str) -> BoardKind:
        """What the listing says; an Arduino, a pty or a socket has what the robot file says."""
        info = describe_port(device, self._ports())
        if info is not None and MaestroModel.from_label(info.kind) is not None:
            return "maestro"
        return self._robot.board


def split_kind(port: str) -> tuple[BoardKind | None, str]:
    """The kind of board in front of a port's name, if there is one, and the rest."""
    kind, colon, device = port.partition(":")
    for known in get_args(BoardKind):
        if colon and kind == known:
            return known, device
    return None, port


def require_kind(robot: Robot, kind: BoardKind, port: str) -> None:
    """Refuse another kind of board than the robot file's.

    Raises:
        PortError: says which is which, and what to do.
    """
    if kind != robot.board:
        raise PortError(
            f"{port}: {robot.title} is set up for {BOARD_TITLES[robot.board]}, this is "
            f"{BOARD_TITLES[kind]}, and a channel of one is not that of the other; choose another port, "
            "or give the arm a robot file for this board ([board] kind, channels)"
        )


def only_simulated(robot: Robot) -> str | None:
    """Why no real board may drive an arm; None where one may."""
    if robot.output_map is not None:
        return None
    return (
        f"the robot file of {robot.title} gives no servos, so nobody knows which pulse means which angle; "
        "add a servo entry to each joint, or use the simulated board"
    )


def _require_name(port: str) -> None:
    """Refuse what no port can be called: nothing, as an unset variable leaves it, or a name with a NUL."""
    if not port or "\0" in port:
        raise PortError(f"{port!r}: {NO_SUCH_PORT}")


def _require_outputs(robot: Robot, port: str) -> None:
    why_not = only_simulated(robot)
    if why_not is not None:
        raise PortError(f"{port} is not opened: {why_not}")


def _model(robot: Robot) -> MaestroModel:
    """The smallest Maestro with enough channels."""
    return MaestroModel.with_channels(max(one.channel for one in channel_settings(robot)) + 1)


def board_name(port: str, robot: Robot, ports: Callable[[], Sequence[PortInfo]] = list_ports) -> str:
    """What a calibration is kept under: the serial number of the board on a port.

    Returns:
        ``SIMULATED_SERIAL`` for the simulated board, and ``UNNUMBERED`` where no serial number is known (many
        clones of the Arduino have none, a pty and a socket neither).

    Raises:
        PortError: ``auto`` found no board, or more than one; there is no such device; or the arm may only
            be simulated.
    """
    if port == SIMULATED:
        return SIMULATED_SERIAL
    _require_name(port)
    _require_outputs(robot, port)
    if port == AUTOMATIC:
        return find_board(ports(), robot.board).serial_number or UNNUMBERED
    device = split_kind(port)[1]
    info = describe_port(device, ports())
    if info is None and "://" not in device and not Path(device).exists():
        raise PortError(f"{device}: {NO_SUCH_PORT}")
    return (info.serial_number if info is not None else None) or UNNUMBERED


def calibrated_for(robot: Robot, board: str, store: CalibrationStore | None = None) -> Robot:
    """The robot as it was calibrated with a board, named as by ``board_name``; unchanged where it never was.

    Raises:
        CalibrationError: the calibration that is kept cannot be read, or no longer fits the robot file.
    """
    calibration = (store or CalibrationStore()).load(robot.name, board)
    return robot if calibration is None else calibrated(robot, calibration)
