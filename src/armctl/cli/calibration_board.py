"""Which board a command of ``armctl calibrate`` is about."""

from __future__ import annotations

import click

from armctl.calibration import CalibrationStore
from armctl.errors import CalibrationError

board_option = click.option(
    "--board", help="Serial number of the board (default: the only one that the robot was calibrated with)."
)


_BEGIN = "begin with `armctl calibrate joint`"


def chosen_board(store: CalibrationStore, robot: str, board: str | None, begin: str = _BEGIN) -> str:
    """The board that was named, or the only one.

    Args:
        store: the calibrations of this computer.
        robot: name of the robot.
        board: serial number; None: the only one.
        begin: what to do where there is no calibration yet.

    Raises:
        CalibrationError: the robot was never calibrated, or with several boards.
    """
    known = [one.board for one in store.boards() if one.robot == robot]
    if board is None and len(known) == 1:
        return known[0]
    if board is not None and board in known:
        return board
    if not known:
        raise CalibrationError(f"{robot} was never calibrated on this computer; {begin}")
    listed = ", ".join(known)
    if board is None:
        raise CalibrationError(f"{robot} was calibrated with several boards: {listed}; name one with --board")
    raise CalibrationError(f"{robot} was never calibrated with board {board!r}; known are {listed}")
