"""What all pages share of an arm's servos while it is not connected: who was found, what differs, one job."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from typing import Self, TypeVar

from armctl.boards import SIMULATED, Boards, board_name
from armctl.errors import BoardError, InputError, StateError, StoppedError
from armctl.hardware.boards import board_type, channel_settings
from armctl.hardware.bus.differences import differences
from armctl.hardware.bus.lerobot import KeptServo, changed, motor_names
from armctl.hardware.servo_records import KeptSettings, ServoRecords
from armctl.hardware.servos import Difference, FoundServo, Mend, ServoSetup
from armctl.lazy_dataclass import dataclass
from armctl.process.registry import holder
from armctl.protocol import MonotonicClock, Snapshot
from armctl.ui.console import Console

T = TypeVar("T")
_NEW_IDS = range(32)
"""those that a servo from its box, or from another arm, is looked for at"""


@dataclass(frozen=True, slots=True)
class ScannedBus:
    """What was seen on a port, as it is now."""

    port: str
    found: tuple[FoundServo, ...]
    kept: Mapping[int, KeptSettings] | None
    """what was kept of them as right, by servo; None: nothing is kept of simulated servos"""
    differ: tuple[Difference, ...]
    """what is not as the arm needs it"""


class SharedServos:
    """The servos of an arm. Used on the web server's event loop only; the bus is, on a thread, by one job."""

    def __init__(self, console: Console) -> None:
        self._console, robot = console, console.robot
        self.robot = robot
        self.baud = board_type(robot.board).baud
        self.channels = channel_settings(robot)
        self.ids = tuple(one.channel for one in self.channels)
        """in the order of the chain, base first"""
        outputs = robot.outputs
        titles = {channel: joint.title for channel, joint in zip(outputs.channels, robot.joints, strict=True)}
        titles |= {one.channel: f"{robot.joints[one.joint].title} (second motor)" for one in outputs.mirrors}
        if outputs.gripper_channel is not None and robot.gripper is not None:
            titles[outputs.gripper_channel] = robot.gripper.title
        self.titles = titles
        """of joints and gripper, by servo"""
        self.seen: ScannedBus | None = None
        """None: nobody has looked yet"""
        self.doing = ""
        """the job that is under way; empty: none is"""
        self.share = 0.0
        """how much of it is done"""
        self.cancellable = False
        """and whether it can be cancelled"""
        self._ended = threading.Event()

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """An arm that is opened anew has its servos looked at anew."""
        return cls(console)

    @property
    def first_silent(self) -> int | None:
        """The first servo of the chain that was looked for in vain; None: there is none."""
        found = {one.id for one in self.seen.found} if self.seen else set(self.ids)
        return next((servo for servo in self.ids if servo not in found), None)

    def found(self, key: str) -> FoundServo:
        """The servo with a key (``servo_key``); ``InputError``: it was not found."""
        seen = () if self.seen is None else self.seen.found
        one = next((one for one in seen if servo_key(one) == key), None)
        if one is None:
            raise InputError("that servo is no longer there; look for the servos again")
        return one

    def why_not(self, snapshot: Snapshot) -> str | None:
        """Why nothing can be done with them now; None: it can."""
        if self.doing:
            return self._busy
        if snapshot.board is not None:
            return "the arm is connected, and only one program can use the bus; disconnect first"
        return None

    def require_free(self) -> None:
        """Refuse (``StateError``) what would need the port that a job has."""
        if self.doing:
            raise StateError(self._busy)

    @property
    def _busy(self) -> str:
        return f"{self.doing} is under way; wait for it, or cancel it in Main → Servos"

    def cancel(self) -> None:
        """End the search that is under way."""
        self._ended.set()

    # Jobs.

    async def scan(self, port: str, *, all_rates: bool) -> bool:
        """Look for all servos; whether that was not cancelled."""

        def look(setup: ServoSetup) -> list[FoundServo]:
            return setup.scan(
                None if all_rates else [self.baud], likely=self.ids, progress=self._note_progress
            )

        try:
            found = await self._job(port, "the search for servos", look)
        except StoppedError:
            return False
        self._see(port, found, await asyncio.to_thread(self._keep, port))
        return True

    async def find_new(self, port: str) -> FoundServo:
        """The one servo that is plugged in; ``BoardError``: there is none, or more than one."""
        mine = set(self.ids)

        def look(setup: ServoSetup) -> list[FoundServo]:
            found = setup.scan(None, sorted({*_NEW_IDS, *self.ids}), progress=self._note_progress)
            strangers = [one for one in found if one.id not in mine]
            return strangers if len(strangers) == 1 else found

        found = await self._job(port, "the search for a new servo", look)
        if not found:
            raise BoardError(
                "no servo answers: is it plugged into the adapter, and has the supply been switched on?"
            )
        if len(found) > 1:
            ids = ", ".join(str(one.id) for one in found)
            raise BoardError(f"{len(found)} servos answer ({ids}): plug in the new one alone")
        return found[0]

    async def mend(self, port: str, mend: Mend) -> FoundServo:
        """Carry out one change, and keep what it made as right."""
        found = await self._job(port, "a change of a servo", mend.carry_out)
        if found is None:
            raise BoardError(f"servo {mend.servo} does not answer after the change; look for it again")
        await self._take(port, [found], gone=(mend.servo, mend.baud))
        return found

    async def nudge(self, port: str, servo: int, baud: int) -> None:
        """Turn one a little and back."""
        await self._job(port, "a nudge", lambda setup: setup.nudge(baud, servo))

    async def look_at_all(self, port: str, *, right: bool = False) -> dict[str, FoundServo]:
        """All servos of the arm, by what LeRobot calls their motors; ``right``: kept as right."""

        def look(setup: ServoSetup) -> dict[str, FoundServo]:
            return {
                name: _present(setup, self.baud, servo) for servo, name in motor_names(self.robot).items()
            }

        found = await self._job(port, "a look at the servos", look)
        await self._take(port, list(found.values()), keep=right)
        return found

    async def restore(self, port: str, kept: Mapping[str, KeptServo]) -> int:
        """Write what differs from a calibration of LeRobot; how many registers did."""

        def write(setup: ServoSetup) -> tuple[int, list[FoundServo]]:
            count, found = 0, list[FoundServo]()
            for k, one in enumerate(kept.values()):
                self.share = k / len(kept)
                differ = changed(one, _present(setup, self.baud, one.id))
                for register, wanted, _ in differ:
                    setup.write(self.baud, one.id, register, wanted)
                count += len(differ)
                found.append(_present(setup, self.baud, one.id))
            return count, found

        count, found = await self._job(port, "the writing of the calibration", write)
        await self._take(port, found)
        return count

    async def _job(self, port: str, doing: str, work: Callable[[ServoSetup], T]) -> T:
        """Do something on the bus, on a thread, as the only one (``StateError``)."""
        if (why := self.why_not(self._console.controller.snapshot)) is not None:
            raise StateError(why)
        self.doing, self.share = doing, 0.0
        self._ended.clear()
        try:
            return await asyncio.to_thread(self._on_bus, port, work)
        finally:
            self.doing, self.cancellable = "", False

    def _on_bus(self, port: str, work: Callable[[ServoSetup], T]) -> T:
        served = self._console.controller.simulated_port() if port == SIMULATED else None
        with (
            closing(Boards(self.robot, MonotonicClock().now, held=holder)) as boards,
            closing(boards.servo_setup(port, served)) as setup,
        ):
            return work(setup)

    def _note_progress(self, share: float) -> None:
        """On the thread of the job."""
        self.share, self.cancellable = share, True
        if self._ended.is_set():
            raise StoppedError("the search was cancelled")

    async def _take(
        self,
        port: str,
        changed: Sequence[FoundServo],
        gone: tuple[int, int] | None = None,
        *,
        keep: bool = True,
    ) -> None:
        """These are as they are now; ``keep``: and right so. ``gone``: id and baud rate of one before."""
        kept = await asyncio.to_thread(self._keep, port, changed if keep else ())
        places = {*((one.id, one.baud) for one in changed), gone}
        before = () if self.seen is None or self.seen.port != port else self.seen.found
        found = [*(one for one in before if (one.id, one.baud) not in places), *changed]
        self._see(port, sorted(found, key=lambda one: one.id), kept)

    def _see(self, port: str, found: Sequence[FoundServo], kept: Mapping[int, KeptSettings] | None) -> None:
        differ = differences(found, self.channels, self.baud, self.titles, kept)
        self.seen = ScannedBus(port, tuple(found), kept, tuple(differ))

    def _keep(self, port: str, right: Sequence[FoundServo] = ()) -> Mapping[int, KeptSettings] | None:
        """These are right as they are; what was kept of all servos on that port."""
        if port == SIMULATED:
            return None
        records, board = ServoRecords(), board_name(port, self.robot)
        if not right:
            return records.load(self.robot.name, board)
        return records.keep(self.robot.name, board, right)


def servo_key(one: FoundServo) -> str:
    """What tells a servo on a bus from all others: of one id there may be one at each baud rate."""
    return f"{one.id}@{one.baud}"


def _present(setup: ServoSetup, baud: int, servo: int) -> FoundServo:
    found = setup.look(baud, servo)
    if found is None:
        raise BoardError(f"servo {servo} does not answer; look for the servos first")
    return found
