"""The calibration of an arm on its board: shared by all pages, so that reloading a page loses nothing."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Self

from armctl.boards import board_name
from armctl.calibration import Calibration, CalibrationStore, Version, calibrated, narrowed
from armctl.errors import PortError, StateError
from armctl.robot import Robot
from armctl.runtime import wall_time
from armctl.ui.calibration_work import CalibrationWork
from armctl.ui.touched_points import TouchedPoints
from armctl.ui.widgets.when import iso_time

_NO_BOARD = (
    "no board was found for this arm yet, so there is none to keep a calibration for; connect it first"
)


class CalibrationDesk:
    """What is in force, what was measured since, and what was saved. Used on the server's event loop only."""

    def __init__(
        self,
        robot: Robot,
        board: str | None,
        store: CalibrationStore,
        now: Callable[[], float] = wall_time,
    ) -> None:
        """Look up what is in force.

        Args:
            robot: as its file describes it, without a calibration.
            board: what the store knows it by, as ``board_name`` says; None: none is there yet.
            store: where calibrations are kept.
            now: seconds since the epoch.

        Raises:
            CalibrationError: the calibration in force cannot be read, or does not fit the robot.
        """
        self.board = board
        self.in_force = None if board is None else store.load(robot.name, board)
        """the calibration that the arm runs by; None: by its robot file"""
        self.robot = robot if self.in_force is None else calibrated(robot, self.in_force)
        """the robot that the arm is built from"""
        self.work = CalibrationWork(robot, self.in_force)
        self.points = TouchedPoints(self.robot, () if self.in_force is None else tuple(self.in_force.joints))
        self._file_robot, self._store, self._now = robot, store, now

    @classmethod
    def of(cls, robot: Robot, port: str, store: CalibrationStore | None = None) -> Self:
        """The desk of a robot with the board on a port; may block, the ports are listed.

        Raises:
            CalibrationError: as the constructor.
        """
        try:
            board = board_name(port, robot)
        except PortError:  # nothing is plugged in yet; connecting asks again, and tells
            board = None
        return cls(robot, board, CalibrationStore() if store is None else store)

    async def holds_for(self, port: str) -> bool:
        """Whether the arm goes by what is in force now for the board on a port.

        Raises:
            PortError: ``auto`` found no board, or more than one.
            CalibrationError: the calibration in force cannot be read.
        """
        return await asyncio.to_thread(self._holds_for, port)

    def _holds_for(self, port: str) -> bool:
        return board_name(port, self._file_robot) == self.board and not self._overtaken()

    def _overtaken(self) -> bool:
        """Whether another program, or another page, has brought something else in force since."""
        if self.board is None:
            return False
        return self._store.load(self._file_robot.name, self.board) != self.in_force

    def adopt(self, other: CalibrationDesk) -> None:
        """Go on with what was measured at another desk, if that is of the same arm on the same board."""
        key = (self._file_robot.name, self.board)
        if self.board is not None and key == (other._file_robot.name, other.board):
            self.work.take_over(other.work)
            self.points.take_over(other.points)

    def draft(self, note: str = "") -> Calibration:
        """The calibration in force with what was measured in its place.

        Raises:
            StateError: nothing was done that could be saved, or there is no board yet.
            CalibrationError: the marks of a joint have no line, or leave nothing of its limits; says which.
        """
        if self.board is None:
            raise StateError(_NO_BOARD)
        work, before = self.work, self.in_force
        joints = {} if before is None else dict(before.joints)
        joints |= work.measured()
        gripper = None if before is None else before.gripper
        if work.jaws:
            gripper = (work.jaw("closed"), work.jaw("open"))
        if not joints and gripper is None:
            hint = f" ({', '.join(work.unfinished)}: too few marks)" if work.unfinished else ""
            raise StateError(
                f"there is nothing to save yet{hint}: a joint needs three marks, or a safe limit set by hand"
            )
        if before is not None and (joints, gripper) == (dict(before.joints), before.gripper):
            raise StateError("everything is saved: nothing differs from the calibration in force")
        made = iso_time(self._now())
        drawn = Calibration(self._file_robot.name, self.board, work.map.unit, joints, gripper, made, note)
        narrowed(self._file_robot, drawn)
        return drawn

    async def save(self, note: str) -> Version:
        """Save the draft; the arm goes by it once it is opened anew.

        Raises:
            StateError: something else is in force by now, which this would overwrite.
            ArmctlError: as ``draft``, or it cannot be written.
        """
        return await asyncio.to_thread(self._save, self.draft(note))

    def _save(self, drawn: Calibration) -> Version:
        if self._overtaken():
            raise StateError(
                f"another calibration of this arm on board {self.board} was saved since it was opened; press "
                "Disconnect and Connect on the tab Main to go by it (the marks stay), then save"
            )
        return self._store.save(drawn)

    def versions(self) -> tuple[Version, ...]:
        """What was saved of this arm on this board, the newest first.

        Raises:
            CalibrationError: the folder cannot be read.
        """
        return () if self.board is None else self._store.versions(self._file_robot.name, self.board)

    async def revert(self, number: int | None) -> Version:
        """Bring an earlier version in force again; None: the robot file as it is.

        Raises:
            CalibrationError: there is no such version, or it does not fit the robot, or cannot be written.
            StateError: there is no board yet, or nothing to go back from.
        """
        if self.board is None:
            raise StateError(_NO_BOARD)
        name, board = self._file_robot.name, self.board
        if number is None and self.in_force is None:
            raise StateError("the robot file is in force already: nothing to go back from")
        if number is None:
            made = iso_time(self._now())
            return await asyncio.to_thread(self._store.forget, name, board, made, self.work.map.unit)
        for version in self.versions():
            if version.number == number and version.calibration is not None:
                narrowed(self._file_robot, version.calibration)  # else the arm could not be opened any more
        return await asyncio.to_thread(self._store.revert, name, board, number)
