"""What was asked for and is still being planned: the next motion, and an edit of the program that runs."""

from __future__ import annotations

from concurrent.futures import Future
from typing import cast

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError, StateError
from armctl.motion import Trajectory
from armctl.runtime.activity import Activity
from armctl.runtime.log import EventLog
from armctl.runtime.planner import BegunProgram, Pending, PendingEdit, result_of
from armctl.runtime.program_runner import ProgramRunner

FloatArray = NDArray[np.float64]


class Upcoming:
    """At most one motion and one edit, planned and checked on another thread; taken by the controller's."""

    def __init__(self, log: EventLog) -> None:
        self._log = log
        self._motion: Pending | None = None
        self._edit: PendingEdit | None = None

    @property
    def has_motion(self) -> bool:
        """Whether a motion is being planned."""
        return self._motion is not None

    def await_motion(self, motion: Pending) -> None:
        """Begin it once its plan is there."""
        self._motion = motion

    def await_edit(self, edit: PendingEdit) -> None:
        """Hand it on once it is checked; an earlier one that is still being checked is refused."""
        if self._edit is not None:
            self._edit.ticket.refuse(StateError("another edit came after it"))
        self._edit = edit

    def take_motion(self, q: FloatArray | None) -> tuple[Pending, Trajectory | BegunProgram] | None:
        """The motion whose plan is there; None where none is, or it was refused.

        Args:
            q: (n,) where the arm holds [rad], None where it does not: it must still be where the plan starts.
        """
        motion = self._motion
        if motion is None or not motion.future.done():
            return None
        self._motion = None
        try:
            plan = result_of(cast("Future[Trajectory | BegunProgram]", motion.future))
            if q is None or not np.array_equal(q, motion.start):
                raise StateError(
                    "the arm no longer stands where the motion was planned from; ask for it again"
                )
        except ArmctlError as error:
            self._log.warning(f"{motion.label} ({motion.who}) refused: {error}")
            motion.ticket.refuse(error)
            return None
        return motion, plan

    def take_edit(self, running: Activity | None) -> None:
        """Hand a checked version of the program on to what runs it."""
        edit = self._edit
        if edit is None or not edit.future.done():
            return
        self._edit = None
        try:
            result_of(edit.future)
            if not isinstance(running, ProgramRunner):
                raise StateError("the program has ended; run it again")
        except ArmctlError as error:
            self._log.warning(f"edit of {edit.program.name!r} ({edit.who}) refused: {error}")
            edit.ticket.refuse(error)
            return
        running.update(edit.program)
        self._log.info(
            f"program {edit.program.name!r} was edited; this takes effect at the next pass ({edit.who})"
        )
        edit.ticket.finish()

    def drop_motion(self, error: ArmctlError) -> None:
        """Refuse the motion that is being planned."""
        if self._motion is not None:
            self._motion.future.cancel()
            self._motion.ticket.refuse(error)
            self._motion = None
