"""The kinds of board that armctl knows: those that it ships, and those of other packages."""

from __future__ import annotations

import logging
from functools import cache

from armctl.errors import InputError
from armctl.hardware.board_type import NEEDED, BoardType
from armctl.hardware.encoder.board import EncoderBoard
from armctl.hardware.firmata.board import FirmataBoard
from armctl.hardware.maestro.board import MaestroBoard
from armctl.robot.board_entries import BoardEntries

SHIPPED: tuple[BoardType, ...] = (MaestroBoard(), FirmataBoard(), EncoderBoard())
"""in the order in which they are asked who is there: a question of the second upsets the first"""
GROUP = "armctl.boards"
_LOGGER = logging.getLogger("armctl.hardware")


@cache
def board_types() -> tuple[BoardType, ...]:
    """The shipped boards, then each ``BoardType`` (class or instance) that an entry point brings."""
    from importlib.metadata import entry_points

    found = list(SHIPPED)
    for entry in entry_points(group=GROUP):
        try:
            loaded: object = entry.load()
            board = loaded() if isinstance(loaded, type) else loaded
            missing = [name for name in NEEDED if not hasattr(board, name)]
            if missing and isinstance(board, BoardType):
                raise TypeError(f"it does not say its {', '.join(missing)}")
        except Exception as error:
            _LOGGER.warning("the board %s of %s cannot be loaded: %s", entry.name, entry.value, error)
            continue
        if not isinstance(board, BoardType):
            _LOGGER.warning("the board %s: %s is no BoardType", entry.name, entry.value)
        elif board.kind in (one.kind for one in found):
            _LOGGER.warning("the board %s: there is a board of the kind %r already", entry.name, board.kind)
        else:
            found.append(board)
    return tuple(found)


def find_board_type(kind: str) -> BoardType | None:
    """The board of a kind; None where there is none. Installed packages are asked only if need be."""
    shipped = next((one for one in SHIPPED if one.kind == kind), None)
    return shipped or next((one for one in board_types() if one.kind == kind), None)


def board_type(kind: str) -> BoardType:
    """The board of a kind; ``InputError`` names those that there are."""
    found = find_board_type(kind)
    if found is None:
        raise InputError(f"there is no board of the kind {kind!r}; there are {', '.join(kinds())}")
    return found


def kinds() -> tuple[str, ...]:
    """The kinds of all boards, sorted."""
    return tuple(sorted(one.kind for one in board_types()))


def find_entries(kind: str) -> BoardEntries | tuple[str, ...]:
    """What reads the robot-file entries of a kind of board; where there is none, the kinds that there are."""
    found = find_board_type(kind)
    return kinds() if found is None else found.entries
