"""The last pose of each arm, kept on disk: servos cannot say where they stand when their pulses are off."""

from __future__ import annotations

import math
import threading
from pathlib import Path
from typing import Annotated, Self
from urllib.parse import quote

import msgspec
from platformdirs import user_state_path

from armctl.arrays import FloatArray
from armctl.documents import write_atomically
from armctl.errors import ArmctlError
from armctl.facts import State
from armctl.hardware import BoardIdentity
from armctl.protocol import LastPose, wall_time
from armctl.robot import Robot
from armctl.system import private_folder

_MOVING_INTERVAL_S = 0.5
"""how often the pose of a moving arm is written: a crash in motion leaves it that old"""
_SLOW_DISK_S = 1.0
"""so long a motion waits until the disk says that the arm moves; then it begins without that"""
_CLOSING_S = 2.0
"""so long the end waits for the disk"""
_LARGEST = 16_384
"""bytes of a file that may be read"""
_ENDS = {State.DISCONNECTED: "disconnected", State.FAULT: "fault", State.OFF: "released"}


class _Record(msgspec.Struct, forbid_unknown_fields=True):
    robot: str
    board: str
    joints_deg: list[float]
    gripper: float | None
    at: Annotated[float, msgspec.Meta(ge=0, le=1e11)]
    ended: str
    moving: bool = False
    tool: str = ""


class PoseFolder:
    """A folder with one file an arm and board; a thread of its own writes, the newest pose only."""

    def __init__(self, folder: Path, robot: Robot) -> None:
        self.problem: str | None = None
        self.written = 0
        """number of the newest pose that is on the disk, as ``save`` gives it"""
        self._folder, self._robot = folder, robot
        self._saved = 0
        self._waiting: tuple[int, Path, bytes] | None = None
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
            q = self._robot.check_limits(self._robot.read(self._robot.chain.checked(record.joints_deg)))
        except (OSError, msgspec.DecodeError, ArmctlError):
            return None  # another version's, damaged, or of the arm before it was calibrated anew
        opening = None if record.gripper is None else min(max(record.gripper, 0.0), 1.0)
        return LastPose(q, opening, record.at, record.ended, record.moving, record.tool)

    def save(self, board: BoardIdentity, pose: LastPose) -> int:
        """Keep a pose; never blocks. Its number: it is kept once ``written`` has come so far."""
        record = _Record(
            self._robot.name,
            board_key(board),
            self._robot.shown(pose.q).round(9).tolist(),
            pose.gripper,
            pose.at,
            pose.ended,
            pose.moving,
            pose.tool,
        )
        with self._changed:
            if self._closed:
                return self._saved
            self._saved += 1
            self._waiting = self._saved, self._path(board), msgspec.json.encode(record)
            self._changed.notify_all()
            if self._thread is None:
                self._thread = threading.Thread(target=self._write_all, name="armctl-last-pose", daemon=True)
                self._thread.start()
            return self._saved

    def wait(self, timeout_s: float) -> bool:
        """Wait until what was saved is on the disk, or the disk does not take it; whether that is so."""
        with self._changed:
            return self._changed.wait_for(
                lambda: self.written == self._saved or self.problem is not None, timeout_s
            )

    def close(self) -> None:
        """Wait until the last one is kept."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
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
                (number, path, content), self._waiting = self._waiting, None
            problem = self._write(path, content)
            with self._changed:
                self.problem = problem
                if problem is None:
                    self.written = number
                self._changed.notify_all()

    def _write(self, path: Path, content: bytes) -> str | None:
        """Why it could not be written, in words. What is there then is old, and goes."""
        try:
            private_folder(path.parent)
            write_atomically(path, content, private=True)
            return None
        except OSError as error:
            problem = f"the last pose of the arm cannot be kept ({path}: {error.strerror})"
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            return (
                f"{problem}, and an older one stays there ({error.strerror}): after a restart do not enable "
                "the arm at its last pose"
            )
        return f"{problem}: after a restart it must be told where it stands"


class PoseWatch:
    """Decides when a pose is kept: when a motion begins or ends, and twice a second in between.

    That the arm moves is on the disk before it does (``may_move``): whoever finds the pose after a crash
    must know that the arm may stand elsewhere.
    """

    def __init__(self, folder: PoseFolder | None) -> None:
        """None: nothing is kept."""
        self._folder = folder
        self.last: LastPose | None = None
        """where the arm was seen last on the board that is connected, or was; None: nobody knows"""
        self._board: BoardIdentity | None = None
        self._q: FloatArray | None = None
        self._opening: float | None = None
        self._tool = ""
        self._comes_on = False
        """servos are being switched on, and nothing streams yet"""
        self._moving = False
        """at the last tick"""
        self._kept: tuple[object, ...] = ()
        self._kept_at = -math.inf
        self._moves: tuple[int, float] | None = None
        """number and time of the first pose of this motion; None: what was kept last says that it stands"""

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
        moving: bool,
        now: float,
        tool: str = "",
    ) -> None:
        """Take note of a tick; ``q`` (n,) [rad] is None where the arm is not held.

        ``moving``: setpoints go out from the next tick on. ``tool``: name of the one that is on.
        """
        if self._folder is None:
            return
        self._tool = tool
        if board is not None and board is not self._board:
            self._change_board(board, self._folder)
        if q is not None:
            self._q, self._opening, self._comes_on, self._moving = q, opening, False, moving
        elif self._comes_on and state not in (State.FAULT, State.DISCONNECTED):
            return
        if self._q is None or self._board is None or self._board.simulated:
            return
        # What ends a motion without bringing it to rest leaves an arm that was seen moving.
        moving = self._moving = self._moving or moving
        ended = "moving" if state is State.MOVING else _ENDS.get(state, "")
        kept = (self._q.tobytes(), self._opening, ended, moving, tool)
        if kept == self._kept or (
            moving and q is not None and self._moves is not None and now < self._kept_at + _MOVING_INTERVAL_S
        ):
            return
        self._kept, self._kept_at = kept, now
        self._keep(self._folder, self._board, self._q, ended, now)
        if q is None:
            self._q, self._moving = None, False  # told; what it does now nobody sees

    def switching_on(self, q: FloatArray, opening: float | None, now: float) -> None:
        """Servos come on one after the other at ``q`` (n,) [rad]: the arm is there, or on its way."""
        if self._folder is None or self._board is None or self._board.simulated:
            return
        self._q, self._opening, self._comes_on, self._moving = q, opening, True, True
        self._keep(self._folder, self._board, q, "enabling", now)

    def may_move(self, now: float) -> bool:
        """Whether what is on the disk says that the arm moves; on a disk that is too slow, after a while."""
        if self._moves is None or self._folder is None:
            return True
        number, since = self._moves
        written = self._folder.written >= number or self._folder.problem is not None
        return written or now - since > _SLOW_DISK_S

    def close(self) -> None:
        """The program ends; an arm that is held until now was closed in order."""
        if self._folder is None:
            return
        if self._q is not None and self._board is not None and not self._board.simulated:
            self._keep(self._folder, self._board, self._q, "closed", self._kept_at)
        self._folder.close()

    def _change_board(self, board: BoardIdentity, folder: PoseFolder) -> None:
        same = self._board is not None and board_key(board) == board_key(self._board)
        if not same or board.simulated:  # a simulated board starts anew each time
            self.last = None if board.simulated else folder.load(board)
        self._board, self._q, self._kept, self._comes_on = board, None, (), False
        self._moving, self._moves = False, None

    def _keep(self, folder: PoseFolder, board: BoardIdentity, q: FloatArray, ended: str, now: float) -> None:
        self.last = LastPose(q, self._opening, wall_time(), ended, self._moving, self._tool)
        number = folder.save(board, self.last)
        self._moves = (self._moves or (number, now)) if self._moving else None


def board_key(board: BoardIdentity) -> str:
    """What a board's pose is kept under."""
    return "simulated" if board.simulated else board.serial_number or "unnumbered"
