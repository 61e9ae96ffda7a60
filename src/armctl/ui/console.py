"""One arm and what all browser pages share: its controller, its calibration, who operates."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncGenerator, Awaitable, Callable, Generator, Sequence
from contextlib import asynccontextmanager, contextmanager
from copy import copy
from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import Protocol, Self, TypeVar, cast

import numpy as np

from armctl.arrays import FloatArray
from armctl.boards import board_name
from armctl.calibration import Calibration, CalibrationStore, calibrated
from armctl.errors import PortError, StateError
from armctl.facts import State
from armctl.hardware import BoardIdentity, Source
from armctl.hardware.boards import board_type
from armctl.lazy_dataclass import dataclass
from armctl.protocol import ArmLink, Command, Event, MovingCommand, Origin, Snapshot, Ticket
from armctl.robot import Robot
from armctl.ui.events import LastStop


def page_name(client_id: int) -> str:
    """What people call a page; the server counts from 0."""
    return f"browser page {client_id + 1}"


class LastKnown:
    """The newest known angle of each joint, to draw an arm whose board is lost where it was."""

    def __init__(self) -> None:
        self._q: FloatArray | None = None

    def note(self, snapshot: Snapshot) -> None:
        """Remember what is known now."""
        now = known(snapshot)
        self._q = now if self._q is None else np.where(np.isnan(now), self._q, now)

    def drawn(self, snapshot: Snapshot) -> FloatArray:
        """Joint angles (n,) [rad] to draw: as known now, else as last known, else where Enable leads to."""
        q = known(snapshot)
        if self._q is not None:
            q = np.where(np.isnan(q), self._q, q)
        return np.where(np.isnan(q), snapshot.q_command, q)

    def standing(self, snapshot: Snapshot) -> FloatArray:
        """Joint angles (n,) [rad] as last commanded; before the first command: as drawn."""
        return snapshot.q_command if snapshot.commanded else self.drawn(snapshot)

    def remembers(self, snapshot: Snapshot) -> bool:
        """Whether what is drawn is not known now, but every joint was known once."""
        if not np.isnan(known(snapshot)).any():
            return False
        return self._q is not None and not np.isnan(self._q).any()

    def words(self, snapshot: Snapshot, board: str) -> str:
        """Where the position that is drawn comes from."""
        if not np.isnan(snapshot.q).any() and snapshot.board is not None:
            return snapshot.source.value
        if snapshot.commanded:
            return Source.COMMANDED.value
        homed = board_type(board).homing
        if self.remembers(snapshot):
            return f"last known; unknown until the arm is {'homed' if homed else 'enabled'} again"
        if homed:
            return "unknown until the arm is homed; drawn where homing ends"
        return "unknown; drawn where Enable would put it"


def known(snapshot: Snapshot) -> FloatArray:
    """Joint angles (n,) [rad] as the board reports them, or as commanded; NaN where neither is known."""
    if not snapshot.commanded:
        return snapshot.q
    return np.where(np.isnan(snapshot.q), snapshot.q_command, snapshot.q)


def pose_unknown(snapshot: Snapshot) -> StateError:
    """The refusal where nothing says where the arm stands."""
    state = "in fault" if snapshot.state is State.FAULT else snapshot.state.value
    first = "enable it" if snapshot.state is State.OFF else "connect and enable it"
    return StateError(f"the arm is {state}, so its pose is not known; {first} first")


def present_pose(snapshot: Snapshot) -> FloatArray:
    """The pose to record (n,) [rad]: as commanded, else as the board reports it; refused where unknown."""
    q = snapshot.q_command if snapshot.commanded else snapshot.q
    if np.isfinite(q).all():
        return q
    raise pose_unknown(snapshot)


@dataclass(frozen=True, slots=True)
class PortChoice:
    """One entry of the port list."""

    port: str
    """what ``Connect`` takes: sim, auto or a device"""
    label: str
    why_not: str | None = None
    """why it cannot be used, and what to do"""
    serial_number: str | None = None
    notes: tuple[str, ...] = ()
    """what the user should know before connecting"""
    listed: bool = False
    """there is a device; not just a way to ask for one"""


class CalibrationInForce:
    """The calibration that an arm runs by, as it was read when the arm was opened."""

    def __init__(self, robot: Robot, board: str | None, store: CalibrationStore) -> None:
        """Look up what is in force; a ``CalibrationError`` where it cannot be read or does not fit.

        ``robot`` is without a calibration; ``board`` is its ``board_name``, or None where there is none yet.
        """
        self.file_robot, self.board, self.store = robot, board, store
        self.calibration: Calibration | None = None if board is None else store.load(robot.name, board)
        """None: the arm runs by its robot file"""
        self.robot = robot if self.calibration is None else calibrated(robot, self.calibration)
        """the robot that the arm is built from"""

    @classmethod
    def of(cls, robot: Robot, port: str, store: CalibrationStore | None = None) -> Self:
        """What is in force with the board on a port; errors as the constructor. May block: it lists ports."""
        try:
            board = board_name(port, robot)
        except PortError:  # nothing is plugged in yet; connecting asks again, and reports it
            board = None
        return cls(robot, board, CalibrationStore() if store is None else store)

    def equipped(self, tool: str) -> Self:
        """The same with another tool on the arm."""
        other = copy(self)
        other.file_robot, other.robot = self.file_robot.with_tool(tool), self.robot.with_tool(tool)
        return other

    def is_overtaken(self) -> bool:
        """Whether another program, or another page, has saved another calibration since. May block."""
        if self.board is None:
            return False
        return self.store.load(self.file_robot.name, self.board) != self.calibration

    async def holds_for(self, port: str) -> bool:
        """Whether this is in force for the board on a port; ``PortError``: ``auto`` found none or several."""
        board = await asyncio.to_thread(board_name, port, self.file_robot)
        return board == self.board and not await asyncio.to_thread(self.is_overtaken)


_FIRST_S = 0.5
"""for so long others wait for a Go"""


class Precedence:
    """Who presses Go goes before what pages work out for themselves. Used on the web server's loop only.

    All threads of the pages share one interpreter: the check of a short program for Go takes 14 ms of it by
    itself, 35 beside one thread that solves, 60 beside two.
    """

    def __init__(self) -> None:
        self._computing = asyncio.Lock()
        self._going = 0
        self._free = asyncio.Event()
        self._free.set()

    @contextmanager
    def going(self) -> Generator[None]:
        """As long as what was pressed is on its way to the arm; a longer one goes on beside others."""
        self._going += 1
        self._free.clear()
        late = asyncio.get_running_loop().call_later(_FIRST_S, self._free.set)
        try:
            yield
        finally:
            late.cancel()
            self._going -= 1
            if not self._going:
                self._free.set()

    async def give_way(self) -> None:
        """Wait while somebody's Go is on its way."""
        await self._free.wait()

    @asynccontextmanager
    async def turn(self) -> AsyncGenerator[None]:
        """To work something out on a thread: behind who presses Go, and one of all pages after the other.

        All at once would last as long.
        """
        async with self._computing:
            await self.give_way()
            yield


class Shared(Protocol):
    """What all pages share for one tab: one object an arm, made when a page first asks for it."""

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """Make it for an arm; ``before`` is that of the arm which was left for this one, if it had any."""
        ...


SharedT = TypeVar("SharedT", bound=Shared)


@dataclass(frozen=True)
class Console:
    """One arm and everything that the pages share. Used on the web server's event loop only."""

    calibration: CalibrationInForce
    controller: ArmLink
    list_ports: Callable[[], Sequence[PortChoice]]
    files: Path
    """the folder of the user's files"""
    close: Callable[[], None]
    """ends the arm: controller and boards; may block for as long as a moving arm needs to come to rest"""
    state: Path | None = None
    """the folder of the console's own state; None: it keeps none"""
    default_port: str = "sim"
    """the port that the arm was opened for, as it is calibrated with the board on it"""
    pin: str = ""
    """the teacher's; empty: there is none"""
    last_known: LastKnown = field(default_factory=LastKnown)
    """where the arm was last known to stand"""
    earlier: tuple[Event, ...] = ()
    """the log from before this arm was chosen, oldest first"""
    frame_listeners: list[Callable[[Snapshot], None]] = field(
        default_factory=list[Callable[[Snapshot], None]], init=False
    )
    """called at each frame that is drawn, 30 times a second"""
    unsaved: list[Callable[[], str | None]] = field(
        default_factory=list[Callable[[], str | None]], init=False
    )
    """each says what would be lost with this arm, in a sentence, or None"""
    savers: list[Callable[[], Awaitable[Path | None]]] = field(
        default_factory=list[Callable[[], Awaitable[Path | None]]], init=False
    )
    """each saves what would be lost; gives the file, or None where nothing would be"""
    precedence: Precedence = field(default_factory=Precedence, init=False)
    _stops: deque[Origin] = field(default_factory=partial(deque[Origin], maxlen=1))
    """the pages' last one, of the arm with any of its tools on"""
    _shared: dict[type[Shared], Shared] = field(default_factory=dict[type[Shared], Shared], init=False)

    @property
    def robot(self) -> Robot:
        """The arm, as it is calibrated."""
        return self.calibration.robot

    def stop(self, origin: Origin) -> None:
        """STOP, from any thread. What was pressed before it, and is still worked out, begins no motion."""
        self._stops.append(origin)
        self.controller.stop(origin)

    @property
    def last_stop(self) -> LastStop:
        """The newest STOP, as far as it is known."""
        snapshot = self.controller.snapshot
        return LastStop(self._stops[-1] if self._stops else None, snapshot.stops, snapshot.last_stop)

    def submit(self, command: Command, origin: Origin, pressed: LastStop | None = None) -> Ticket:
        """Ask the arm for something; a motion is refused where STOP came after the last one ``pressed``."""
        if pressed is None or not isinstance(command, MovingCommand):
            return self.controller.submit(command, origin)
        if (newer := self.last_stop.since(pressed)) is not None:
            return Ticket.ended(StateError(replace(newer, note="", how="unbegun")))
        ticket = self.controller.submit(command, origin)
        if self._stops and (stop := self._stops[-1]) is not pressed.page:  # pressed between these two
            self.controller.stop(stop)
        return ticket

    def equipped(self, tool: str) -> Console:
        """The same arm with another tool on, and what its pages share of it."""
        other = replace(self, calibration=self.calibration.equipped(tool))
        other.carry_over(self)
        return other

    def shared(self, kind: type[SharedT]) -> SharedT:
        """What all pages share of a kind."""
        if kind not in self._shared:
            self._shared[kind] = kind.of(self, None)
        return cast(SharedT, self._shared[kind])

    def carry_over(self, left: Console) -> None:
        """Take over what was shared for the arm that is left, as far as it fits this one."""
        for kind, state in left._shared.items():
            self._shared[kind] = kind.of(self, state)


# Whether a board that was lost is plugged in again, so that the pages say so. No port is opened for that.


_FRAMES = 25
"""from one look to the next: a second"""


class PortWatch:
    """What all pages share of the ports. Used on the web server's event loop only."""

    def __init__(self, console: Console) -> None:
        self._list_ports = console.list_ports
        self._board: BoardIdentity | None = None
        """the one that was connected last"""
        self._frames = 0
        self._looking: asyncio.Task[None] | None = None
        self._was_away = False
        self.choices: Sequence[PortChoice] = ()
        """as they were listed last while the board was lost; empty: not yet"""
        self.back_on: str | None = None
        """the port where the board that was lost is plugged in again; None: it is not, or none is lost"""

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """Look for this console."""
        watch = cls(console)
        console.frame_listeners.append(watch.note)
        return watch

    def note(self, snapshot: Snapshot) -> None:
        """Called with every frame."""
        if snapshot.board is not None or snapshot.unreachable or snapshot.state is not State.FAULT:
            self._board = snapshot.board if snapshot.board is not None else self._board
            self._was_away, self.back_on = False, None
            return
        self._frames += 1
        if self._frames % _FRAMES == 0 and (self._looking is None or self._looking.done()):
            self._looking = asyncio.create_task(self._look())

    async def _look(self) -> None:
        board = self._board
        if board is None or board.simulated:
            return
        self.choices = await asyncio.to_thread(self._list_ports)
        port = await asyncio.to_thread(_port_of, board, self.choices)
        self._was_away |= port is None
        self.back_on = port if self._was_away else None


def _port_of(board: BoardIdentity, choices: Sequence[PortChoice]) -> str | None:
    """Where a board is plugged in now: by its serial number, else by its port; None: nowhere."""
    listed = [choice for choice in choices if choice.listed]
    if board.serial_number:
        return next((one.port for one in listed if one.serial_number == board.serial_number), None)
    there = board.port in [choice.port for choice in listed] or Path(board.port).exists()
    return board.port if there else None
