"""The last pose of each arm, kept on disk: servos cannot say where they stand when their pulses are off."""

from __future__ import annotations

import math
import threading
from pathlib import Path
from typing import Annotated, Self
from urllib.parse import quote

import msgspec
import numpy as np
from platformdirs import user_state_path

from armctl.arrays import FloatArray
from armctl.documents import write_atomically
from armctl.errors import ArmctlError
from armctl.hardware import BoardIdentity
from armctl.robot import Robot
from armctl.runtime.clock import wall_time
from armctl.runtime.snapshot import LastPose, State

_MOVING_INTERVAL_S = 5.0
"""how often the pose of a moving arm is written: a crash in motion leaves it that old"""
_CLOSING_S = 2.0
"""so long the end waits for the disk"""
_LARGEST = 16_384
"""bytes of a file that may be read"""
_ENDS = {State.DISCONNECTED: "disconnected", State.FAULT: "fault", State.OFF: "released"}


class _Record(msgspec.Struct, forbid_unknown_fields=True):
    """One file."""

    robot: str
    board: str
    joints_deg: list[float]
    gripper: float | None
    at: Annotated[float, msgspec.Meta(ge=0, le=1e11)]
    ended: str


class PoseFolder:
    """A folder with one file an arm and board; a thread of its own writes, the newest pose only."""

    def __init__(self, folder: Path, robot: Robot) -> None:
        self.problem: str | None = None
        self._folder, self._robot = folder, robot
        self._waiting: tuple[Path, bytes] | None = None
        self._changed = threading.Condition()
        self._closed = False
        self._thread: threading.Thread | None = None

    @classmethod
    def of_user(cls, robot: Robot) -> Self:
        """Where the user's programs keep their state."""
        return cls(user_state_path("armctl") / "last-pose", robot)

    def load(self, board: BoardIdentity) -> LastPose | None:
        """What is known of the arm on a board; None: nothing, or it cannot be read."""
        path = self._path(board)
        try:
            if not path.is_file() or path.stat().st_size > _LARGEST:
                return None
            record = msgspec.json.decode(path.read_bytes(), type=_Record)
            if (record.robot, record.board) != (self._robot.name, board_key(board)):
                return None
            q = self._robot.check_limits(np.radians(self._robot.chain.checked(record.joints_deg)))
        except (OSError, msgspec.DecodeError, ArmctlError):
            return None  # another version's, damaged, or of the arm before it was calibrated anew
        opening = None if record.gripper is None else min(max(record.gripper, 0.0), 1.0)
        return LastPose(q, opening, record.at, record.ended)

    def save(self, board: BoardIdentity, pose: LastPose) -> None:
        """Keep a pose; never blocks."""
        record = _Record(
            self._robot.name,
            board_key(board),
            np.degrees(pose.q).round(9).tolist(),
            pose.gripper,
            pose.at,
            pose.ended,
        )
        with self._changed:
            if self._closed:
                return
            self._waiting = self._path(board), msgspec.json.encode(record)
            self._changed.notify()
            if self._thread is None:
                self._thread = threading.Thread(target=self._write_all, name="armctl-last-pose", daemon=True)
                self._thread.start()

    def close(self) -> None:
        """Wait until the last one is kept."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(_CLOSING_S)

    def _path(self, board: BoardIdentity) -> Path:
        name = f"{quote(self._robot.name, safe='')[:100]} {quote(board_key(board), safe='')[:100]}.json"
        return self._folder / name

    def _write_all(self) -> None:
        while True:
            with self._changed:
                while self._waiting is None and not self._closed:
                    self._changed.wait()
                if self._waiting is None:
                    return
                (path, content), self._waiting = self._waiting, None
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                write_atomically(path, content)
                self.problem = None
            except OSError as error:
                self.problem = (
                    f"the last pose of the arm cannot be kept ({path}: {error.strerror}): after a restart it "
                    "must be told where it stands"
                )


class PoseWatch:
    """Decides when a pose is worth keeping: at rest, at the end, and every few seconds in motion."""

    def __init__(self, folder: PoseFolder | None) -> None:
        """None: nothing is kept."""
        self._folder = folder
        self.last: LastPose | None = None
        """where the arm was seen last on the board that is connected, or was; None: nobody knows"""
        self._board: BoardIdentity | None = None
        self._q: FloatArray | None = None
        self._opening: float | None = None
        self._comes_on = False
        """servos are being switched on, and nothing streams yet"""
        self._kept: tuple[object, ...] = ()
        self._kept_at = -math.inf

    @property
    def problem(self) -> str | None:
        """Why the last pose cannot be kept, in words."""
        return None if self._folder is None else self._folder.problem

    def note(
        self,
        board: BoardIdentity | None,
        q: FloatArray | None,
        opening: float | None,
        state: State,
        now: float,
    ) -> None:
        """Take note of a tick; ``q`` (n,) [rad] is None where the arm is not held."""
        if self._folder is None:
            return
        if board is not None and board is not self._board:
            self._change_board(board, self._folder)
        if q is not None:
            self._q, self._opening, self._comes_on = q, opening, False
        elif self._comes_on and state not in (State.FAULT, State.DISCONNECTED):
            return
        if self._q is None or self._board is None or self._board.simulated:
            return
        ended = "moving" if state is State.MOVING else _ENDS.get(state, "")
        kept = (self._q.tobytes(), self._opening, ended)
        if kept == self._kept or (ended == "moving" and now < self._kept_at + _MOVING_INTERVAL_S):
            return
        self._kept, self._kept_at = kept, now
        self._keep(self._folder, self._board, self._q, ended)
        if q is None:
            self._q = None  # told; what it does now nobody sees

    def switching_on(self, q: FloatArray, opening: float | None) -> None:
        """Servos come on one after the other at ``q`` (n,) [rad]: the arm is there, or on its way."""
        if self._folder is None or self._board is None or self._board.simulated:
            return
        self._q, self._opening, self._comes_on = q, opening, True
        self._keep(self._folder, self._board, q, "enabling")

    def close(self) -> None:
        """The program ends; an arm that is held until now was closed in order."""
        if self._folder is None:
            return
        if self._q is not None and self._board is not None and not self._board.simulated:
            self._keep(self._folder, self._board, self._q, "closed")
        self._folder.close()

    def _change_board(self, board: BoardIdentity, folder: PoseFolder) -> None:
        same = self._board is not None and board_key(board) == board_key(self._board)
        if not same or board.simulated:  # a simulated board starts anew each time
            self.last = None if board.simulated else folder.load(board)
        self._board, self._q, self._kept, self._comes_on = board, None, (), False

    def _keep(self, folder: PoseFolder, board: BoardIdentity, q: FloatArray, ended: str) -> None:
        self.last = LastPose(q, self._opening, wall_time(), ended)
        folder.save(board, self.last)


def board_key(board: BoardIdentity) -> str:
    """What a board's pose is kept under."""
    return "simulated" if board.simulated else board.serial_number or "unnumbered"
