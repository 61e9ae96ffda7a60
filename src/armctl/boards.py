"""From a port as the user names it to a driver: the simulated board, the one that is found, or a device."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from armctl.calibration import CalibrationStore, calibrated
from armctl.errors import InputError, OtherBoardError, PortError, StateError
from armctl.hardware import BoardType, ByteModel, Driver, Setup
from armctl.hardware.board_type import SimulatedPins
from armctl.hardware.boards import board_of_address, board_type, channel_settings, find_board_type
from armctl.hardware.input_script import InputPlayer, InputScript
from armctl.hardware.ports import boards_listed_as, find_board, list_ports
from armctl.hardware.servo_records import KeptSettings, ServoRecords
from armctl.hardware.servos import ServoSetup
from armctl.hardware.simulation import TICK_S, BoardServer
from armctl.hardware.transport import NO_SUCH_PORT, Connection, PortInfo, SerialTransport, describe_port
from armctl.robot import Robot

_LOGGER = logging.getLogger("armctl.boards")
SIMULATED, AUTOMATIC = "sim", "auto"
SIMULATED_SERIAL = "simulated"
"""what stands for the serial number of a simulated board"""
_SILENT_TICK_S = 1.0
"""of a simulated board that never speaks unasked: its time goes on when it is asked"""
UNNUMBERED = "unnumbered"
"""what stands for the serial number of a board without one: one calibration for all of them"""
ANY_BOARD, NO_BOARD = "*", ""
"""for an arm that may be connected to any board; for one whose board was not there when it was opened"""


class Boards:
    """Opens drivers of one robot, and owns the simulated board behind ``sim``.

    A real board other than ``board``, a ``board_name``, is refused: its calibration is another.
    """

    def __init__(
        self,
        robot: Robot,
        now: Callable[[], float],
        ports: Callable[[], Sequence[PortInfo]] = list_ports,
        board: str = ANY_BOARD,
        held: Callable[[str], str | None] = lambda _: None,
    ) -> None:
        """``held``: which other process of ours holds a device, in words; None: none does."""
        self._held = held
        self._robot, self._now, self._ports, self._board = robot, now, ports, board
        self._lock = threading.Lock()
        self._simulated: BoardServer[ByteModel] | None = None

    def driver(self, port: str) -> Driver:
        """A driver, not opened yet, for ``sim``, ``auto``, ``socket://host:port`` or a device.

        A device may have its board's kind in front (``firmata:/dev/ttyUSB0``). PortError: ``auto`` found none
        or several; another kind than the robot file's; or the arm may only be simulated.
        """
        if port == SIMULATED:
            return self._driver(self.simulated().port, simulated=True)
        return self._driver(self._device(port))

    def servo_setup(self, port: str, served: str | None = None) -> ServoSetup:
        """The servos on a port, named as for ``driver``, to be set up; nothing is opened yet.

        ``served``: where the simulated board is served already, by another process. Errors as ``driver``, and
        ``InputError``: the arm's board has no servos that could be set up.
        """
        simulated = port == SIMULATED
        if simulated:
            device = self.simulated().port if served is None else served
        else:
            device = self._device(port)
        setup = _servo_setup(self._robot, device, self._now, simulated=simulated)
        if setup is None:
            board = board_type(self._robot.board)
            raise InputError(
                f"{self._robot.title} has a {board.title}: it has no servos that could be set up"
            )
        return setup

    def _device(self, port: str) -> str:
        """The device that a port's name means, checked as for ``driver``."""
        _require_real(port, self._robot)
        if port == AUTOMATIC:
            device = find_board(self._ports(), self._robot.board).device
        else:
            named, device = split_kind(port)
            for board in (named, _listed_as(device, self._ports())):
                if board is not None:
                    require_kind(self._robot, board, device)
        if (why := self._held(device)) is not None:
            raise PortError(f"{device}: {why}")
        return device

    def simulated(self) -> BoardServer[ByteModel]:
        """The simulated board's server, started when it is first asked for."""
        with self._lock:
            if self._simulated is None:
                board = board_type(self._robot.board)
                model = board.simulated(setup_of(self._robot), {})
                if isinstance(model, SimulatedPins):
                    model.levels |= self._robot.signals.at_rest
                tick_s = TICK_S if board.listener() is not None else _SILENT_TICK_S
                server = BoardServer(model, self._now, tick_s=tick_s)
                server.__enter__()
                self._simulated = server
            return self._simulated

    def simulate(self, channel: int, level: float) -> None:
        """Put a pin of the simulated board at a level 0 ... 1; ``StateError``: it has no pins."""
        with self.simulated().inspect() as model:
            if not isinstance(model, SimulatedPins):
                raise StateError("this simulated board has no inputs")
            model.levels[channel] = level

    def play(self, script: InputScript | None) -> None:
        """Have the inputs of the simulated board follow a script from now on; None: they stay as they are.

        ``StateError``: it has no pins.
        """
        server, player = self.simulated(), None
        if script is not None:
            with server.inspect() as model:
                if not isinstance(model, SimulatedPins):
                    raise StateError("this simulated board has no inputs")
                player = InputPlayer(script, self._robot.signals, model.levels)
        server.play(player)

    def close(self) -> None:
        """Take the simulated board off its line. May be called more than once."""
        with self._lock:
            server, self._simulated = self._simulated, None
        if server is not None:
            server.close()

    def _driver(self, line: str, *, simulated: bool = False) -> Driver:
        board = board_type(self._robot.board)
        accept = partial(self._accept, line)
        own = board_of_address(line) is board
        opened = partial(board.open_line, line) if own else line
        connection = Connection(opened, self._now, self._ports, accept, simulated, board.baud)
        return board.driver(setup_of(self._robot), connection)

    def _accept(self, line: str, serial_number: str | None) -> None:
        """Refuse the board of another calibration: a name of a port may mean another board by now."""
        found = serial_number or UNNUMBERED
        if self._board in (ANY_BOARD, found):
            return
        was = "no board was there" if self._board == NO_BOARD else f"board {self._board} was there"
        raise OtherBoardError(
            f"{line}: {was} when the calibration of {self._robot.title} was looked up, now board {found} is; "
            "it was told nothing. Connect again, to use its own calibration"
        )


def setup_of(robot: Robot) -> Setup:
    """What a robot needs of its board."""
    return Setup(channel_settings(robot), robot.board_settings, robot, partial(_kept_settings, robot.name))


def _kept_settings(robot: str, serial_number: str | None) -> Mapping[int, KeptSettings]:
    try:
        return ServoRecords().load(robot, serial_number or UNNUMBERED)
    except InputError as cause:
        _LOGGER.warning("what was kept of the servos is not compared with them: %s", cause)
        return {}


def has_servos(robot: Robot) -> bool:
    """Whether the arm's servos have settings that could be looked at and changed."""
    return _servo_setup(robot, "", lambda: 0.0, simulated=True) is not None


def _servo_setup(
    robot: Robot, device: str, now: Callable[[], float], *, simulated: bool
) -> ServoSetup | None:
    return board_type(robot.board).servo_setup(
        lambda baud: SerialTransport(device, baud=baud), now, simulated=simulated
    )


def split_kind(port: str) -> tuple[BoardType | None, str]:
    """The board whose kind stands in front of a port's name, if one does, and the rest."""
    kind, colon, device = port.partition(":")
    board = find_board_type(kind) if colon and not device.startswith("//") else None
    return (None, port) if board is None else (board, device)


def require_kind(robot: Robot, board: BoardType, port: str) -> None:
    """Refuse another kind of board than the robot file's (``PortError``)."""
    if board.kind != robot.board:
        raise OtherBoardError(
            f"{port}: {robot.title} is set up for {board_type(robot.board).title}, this is {board.title}, "
            "and a channel of one is not that of the other; choose another port, or give the arm a "
            "robot file for this board ([board] kind, channels)"
        )


def _listed_as(device: str, ports: Sequence[PortInfo]) -> BoardType | None:
    """The board that the listing is certain of; it is not of an Arduino, a pty or a socket."""
    info = describe_port(device, ports)
    listed = [] if info is None else boards_listed_as(info.kind)
    return next((board for board in listed if info is not None and info.kind in board.own_listings), None)


def only_simulated(robot: Robot) -> str | None:
    """Why no real board may drive an arm; None where one may."""
    if robot.simulated_only is None:
        return None
    mend = "" if robot.no_board else "add a servo entry to each joint, or "
    return f"{robot.title} is simulated only: {robot.simulated_only}; {mend}use the simulated board"


def _require_real(port: str, robot: Robot) -> None:
    """Refuse a name that is empty, as an unset variable leaves it, or has a NUL; an arm without outputs."""
    if not port or "\0" in port:
        raise PortError(f"{port!r}: {NO_SUCH_PORT}")
    why_not = only_simulated(robot)
    if why_not is not None:
        raise OtherBoardError(f"{port} is not opened: {why_not}")


def board_name(port: str, robot: Robot, ports: Callable[[], Sequence[PortInfo]] = list_ports) -> str:
    """What a calibration is kept under: the serial number of the board on a port.

    ``UNNUMBERED`` where none is known (many clones of the Arduino, ptys, sockets). PortError as
    ``Boards.driver``, and where there is no such device.
    """
    if port == SIMULATED:
        return SIMULATED_SERIAL
    _require_real(port, robot)
    if port == AUTOMATIC:
        return find_board(ports(), robot.board).serial_number or UNNUMBERED
    device = split_kind(port)[1]
    info = describe_port(device, ports())
    if info is None and "://" not in device and not Path(device).exists():
        raise PortError(f"{device}: {NO_SUCH_PORT}")
    return (info.serial_number if info is not None else None) or UNNUMBERED


def calibrated_for(robot: Robot, board: str) -> Robot:
    """The robot as calibrated with a ``board_name``. CalibrationError: unreadable, or it no longer fits."""
    calibration = CalibrationStore().load(robot.name, board)
    return robot if calibration is None else calibrated(robot, calibration)
