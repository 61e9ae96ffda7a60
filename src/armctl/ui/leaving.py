"""When an arm may be left for another one, or opened anew: not in a motion, nor where it would drop."""

from __future__ import annotations

from armctl.errors import StateError
from armctl.hardware import BoardIdentity, Source
from armctl.runtime import Snapshot, State


def release_to_leave(snapshot: Snapshot) -> str | None:
    """Why the arm must be released before another one is chosen; None: it need not.

    Real servos or motors hold it up, and nobody would speak to them any more.
    """
    board = _holding_it_up(snapshot)
    if board is None:
        return None
    return (
        f"the {_outputs(snapshot)} on {board.port} are on; press Release (the arm drops), then choose "
        "another robot"
    )


def release_to_reopen(snapshot: Snapshot) -> str | None:
    """Why the arm must be released before it is opened anew; None: it need not.

    A Maestro goes on sending its pulses, and Enable takes the arm over where it stands.
    """
    board = _holding_it_up(snapshot)
    if board is None or snapshot.source is Source.TRANSMITTED:
        return None
    return (
        f"the {_outputs(snapshot)} on {board.port} are on, and the arm has to be opened anew: support it, "
        "press Release (it drops), then try again"
    )


def require_leavable(snapshot: Snapshot) -> None:
    """Refuse to leave an arm that moves, or one that real servos or motors hold up.

    Raises:
        StateError: says what to do first.
    """
    if snapshot.state in (State.MOVING, State.PAUSED):
        doing = "moves" if snapshot.state is State.MOVING else "is in the middle of a motion"
        raise StateError(f"the arm {doing}; press STOP, then choose another robot")
    _refuse(release_to_leave(snapshot))


def require_reopenable(snapshot: Snapshot) -> None:
    """Refuse to open an arm anew that moves, or that drops when its line is closed for a moment.

    Raises:
        StateError: says what to do first.
    """
    if snapshot.state in (State.MOVING, State.PAUSED):
        raise StateError("the arm is in the middle of a motion; press STOP, then try again")
    _refuse(release_to_reopen(snapshot))


def _refuse(why: str | None) -> None:
    if why is not None:
        raise StateError(why)


def _holding_it_up(snapshot: Snapshot) -> BoardIdentity | None:
    board = snapshot.board
    return board if board is not None and not board.simulated and snapshot.powered else None


def _outputs(snapshot: Snapshot) -> str:
    return "motors" if snapshot.source is Source.MEASURED else "servos"
