"""What some calls of ``Arm`` give to hold: a motion that is under way, a stream of setpoints; parking."""

from __future__ import annotations

import asyncio
import logging
import uuid
from collections import deque
from collections.abc import Generator
from contextlib import suppress
from types import TracebackType
from typing import Any, Self

import msgspec
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, StateError
from armctl.facts import State
from armctl.protocol import (
    ArmLink,
    Cancel,
    MoveGripper,
    MoveJoints,
    MovingCommand,
    Origin,
    StreamJoints,
    Ticket,
)

ORIGIN = Origin("library")
_UNANSWERED = 5
"""so many setpoints of a stream may be on their way to the arm"""
_ANSWER_S = 1.0
STOP_S = 5.0
"""so long an interrupt waits for the arm to stand [s]"""
_LOGGER = logging.getLogger("armctl.arm")


class Motion:
    """A motion that was asked for. ``result`` waits for its end; so does ``await`` in asyncio."""

    def __init__(self, link: ArmLink, command: MovingCommand) -> None:
        """Ask for it."""
        self._link, self._name = link, uuid.uuid4().hex
        self._has_progress = not isinstance(command, MoveGripper)  # moves beside what is shown
        self._ticket: Ticket = link.submit(msgspec.structs.replace(command, motion=self._name), ORIGIN)

    @property
    def done(self) -> bool:
        """It is over: it has arrived, or was refused, stopped or broken."""
        return self._ticket.finished.done()

    @property
    def progress(self) -> float | None:
        """How much of it is done, 0 … 1; None where that is not known.

        It counts time at full speed for a motion, steps for a program, and axes for homing. It is not known
        for the gripper, for a program that runs for ever, and for a motion that ended early.
        """
        finished = self._ticket.finished
        if finished.done():
            return 1.0 if finished.exception() is None else None
        if not self._ticket.accepted.done():
            return 0.0
        return self._link.snapshot.progress if self._has_progress else None

    def result(self, timeout: float | None = None) -> None:
        """Wait for its end; raises what refused, stopped or broke it. ``TimeoutError``: it goes on."""
        self._ticket.result(timeout)

    def cancel(self) -> None:
        """STOP for this motion alone: it slows down on its path. Returns once the arm stands."""
        if not self.done:
            self._link.submit(Cancel(self._name), ORIGIN).result()

    def __await__(self) -> Generator[Any, None, None]:
        return asyncio.wrap_future(self._ticket.finished).__await__()


class JointStream:
    """Setpoints for the arm to follow: send one every 10 … 50 ms, in a ``with`` block.

    The arm goes toward the newest one inside its limits of speed and acceleration, so it follows at the
    distance it needs to brake. It slows down when none comes for 150 ms, or when something is in its way
    (``snapshot.warnings``). At the end of the block it goes on to the last one; an exception in the block
    stops it. STOP ends the stream.
    """

    def __init__(self, link: ArmLink) -> None:
        self._link, self._name = link, uuid.uuid4().hex
        self._asked: deque[Ticket] = deque()
        self._q: FloatArray | None = None

    def send(self, q_deg: ArrayLike) -> None:
        """Send the next setpoint (n,) [degrees]; waits while five are not answered.

        Raises the error that refused it or an earlier one. After a STOP or a fault all are refused.
        """
        robot = self._link.robot
        q = robot.check_limits(robot.read(robot.chain.checked_one(q_deg)))
        self._settle(_UNANSWERED - 1)
        self._asked.append(self._link.submit(StreamJoints(q, motion=self._name), ORIGIN))
        self._q = q

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._q is None:
            return
        if error is not None:
            self._cancel()
            return
        try:
            self._settle(0)
            self._link.submit(StreamJoints(self._q, last=True, motion=self._name), ORIGIN).result()
        except BaseException:
            self._cancel()
            raise

    def _settle(self, most: int) -> None:
        """Take the answers that are there, and wait for others until ``most`` are open."""
        while self._asked and (len(self._asked) > most or self._asked[0].finished.done()):
            try:
                self._asked[0].result(_ANSWER_S)
            except TimeoutError as cause:
                raise StateError(f"the arm has not answered a setpoint for {_ANSWER_S:g} s") from cause
            self._asked.popleft()

    def _cancel(self) -> None:
        """What was raised already says more than what this meets."""
        with suppress(ArmctlError, TimeoutError):
            self._link.submit(Cancel(self._name), ORIGIN).result(_ANSWER_S)


def bring_to_rest(link: ArmLink, origin: Origin) -> None:
    """Park: stop, then go to the rest pose, where the arm has power.

    A way that is refused is told in the log; then the arm holds where it is. After a fault nothing moves.
    """
    link.stop(origin).result(STOP_S)
    if link.snapshot.state is not State.HOLDING:
        return
    ticket = link.submit(MoveJoints(link.robot.pose("rest")), origin)
    try:
        ticket.result()
    except ArmctlError as refusal:
        _LOGGER.warning("not parked, the arm holds where it is: %s", refusal)
    except KeyboardInterrupt:
        link.stop(origin).result(STOP_S)
        raise
