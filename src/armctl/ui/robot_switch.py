"""Which arm the pages show; changing it for another one, and opening it anew."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from armctl.boards import SIMULATED
from armctl.errors import ArmctlError, InputError, StateError, StoppedError
from armctl.facts import State
from armctl.hardware import Source
from armctl.lazy_dataclass import dataclass
from armctl.process.heavy_work import Progress
from armctl.protocol import (
    Arrive,
    Command,
    Connect,
    Event,
    Leave,
    LockControl,
    Origin,
    RememberWrongPins,
    SetSpeed,
    SetTool,
    Snapshot,
    wall_time,
)
from armctl.robot.tools import tool_of
from armctl.ui.console import Console

LOG = logging.getLogger("armctl.ui")
RESTARTED, EQUIPPED = "started a new arm process for", "put on"
_LOG_LINES = 200
_REVIVED_AGAIN_S = 5.0


@dataclass(frozen=True, slots=True)
class RobotChoice:
    """One entry of the robot list."""

    name: str
    """what opens it: a shipped robot's name, or the path of a robot file"""
    title: str
    simulated_only: bool = False
    """its file says that no board drives it"""


@dataclass(frozen=True, slots=True)
class RobotChange:
    """What the pages are told after the arm was changed."""

    who: str
    title: str
    not_connected: str | None
    """why the new arm is not connected, and what to do; None: it is"""
    did: str = "chose"
    """what was done with it"""


class RobotSwitch:
    """Holds the present console, on the event loop; what fails while another is opened leaves it as it is."""

    def __init__(
        self,
        console: Console,
        present: RobotChoice,
        choices: Sequence[RobotChoice],
        open_console: Callable[[str, str, Progress], Console],
    ) -> None:
        """``present`` is open already; ``open_console(name, port, progress)`` opens another, unconnected.

        It may block; it tells its progress where it takes long, and ends with what that raises.
        """
        self.console, self.present, self.choices = console, present, tuple(choices)
        self.opening: RobotChoice | None = None
        """what the present arm is being changed for"""
        self.progress: tuple[int, int] | None = None
        """how many of how many parts of the work on its meshes are done; None: there is none to wait for"""
        self._given_up = False
        self.pages: list[str] = []
        """the pages that are open, in the order in which they came"""
        self.sources: dict[str, str] = {}
        """by page, where it comes from: for the count of wrong PINs"""
        self._open = open_console
        self._reviving: asyncio.Task[None] | None = None
        self._not_revived: tuple[float, ArmctlError] | None = None
        """when the arm process could not be started again, and why"""
        self._tell: Callable[[RobotChange], None] | None = None

    def on_change(self, tell: Callable[[RobotChange], None]) -> None:
        """Have ``tell`` called at once whenever the present console has become another."""
        self._tell = tell

    def offer(self, choice: RobotChoice) -> None:
        """Put a robot into the list, in place of one of the same name; pages see it once they are rebuilt."""
        others = [one for one in self.choices if one.name != choice.name]
        self.choices = (*others, choice)

    def give_up(self) -> None:
        """Leave the arm that is being opened; the present one stays."""
        self._given_up = True

    def _note_progress(self, done: int, parts: int) -> None:
        """On the thread that opens the arm."""
        self._require_wanted()
        self.progress = done, parts

    def _require_wanted(self) -> None:
        if self._given_up and self.opening is not None:
            raise StoppedError(f"{self.opening.title} was not opened: you left it")

    def close(self) -> None:
        """End the present arm."""
        self.console.close()

    def require_settled(self) -> None:
        """Refuse (``StateError``) what must wait while the arm is being changed."""
        if self.opening is not None:
            title = self.opening.title
            raise StateError(f"the robot is being changed for {title}; wait a moment and try again")

    def require_reopenable(self) -> None:
        """Refuse (``StateError``) what would open the arm anew, where that could let it drop."""
        self.require_settled()
        require_replaceable(self.console.controller.snapshot, reopen=True)

    async def needs_reopening(self, port: str) -> bool:
        """Whether the arm process is gone, or a port's board needs another calibration.

        Errors as ``CalibrationInForce.holds_for``.
        """
        if self.console.controller.ended:
            return True
        if self.console.controller.snapshot.state not in (State.DISCONNECTED, State.FAULT):
            return False  # connected already: the controller refuses in words
        return port != self.console.default_port or not await self.console.calibration.holds_for(port)

    async def change(self, name: str, origin: Origin, permit: Callable[[], None]) -> None:
        """Change the present arm for another one, at the same speed, connected if the old one is simulated.

        ``permit`` raises when the page may not, and is asked again once the new arm is ready. ``InputError``:
        no such choice; ``StateError``: as ``require_replaceable``, or being changed; others: not opened.
        """
        choice = next((choice for choice in self.choices if choice.name == name), None)
        if choice is None:
            raise InputError(f"there is no robot {name!r} to choose")
        if choice == self.present:
            return
        permit()
        self.require_settled()
        snapshot = self.console.controller.snapshot
        require_replaceable(snapshot, reopen=False)
        simulated = snapshot.board is not None and snapshot.board.simulated
        await self._replace(choice, SIMULATED if simulated else self.console.default_port, origin, permit)

    async def reopen(self, origin: Origin, permit: Callable[[], None], port: str | None = None) -> None:
        """Open the present arm anew, as calibrated now, on ``port`` or where it was; errors as ``change``."""
        permit()
        self.require_reopenable()
        connect = port is not None or self.console.controller.snapshot.board is not None
        port = self.console.default_port if port is None else port
        await self._replace(self.present, port, origin, permit)
        if connect:
            await _finished(self.console, Connect(port), origin)

    def follow_tool(self) -> None:
        """Have the pages show the arm with the tool that is on, where it is another one and nothing moves."""
        console, now = self.console, self.console.controller.snapshot
        if now.tool == console.robot.tool or now.busy or now.unreachable or self.opening is not None:
            return
        self.console = console.equipped(now.tool)
        if self._tell is not None:
            title = tool_of(self.console.robot.tools, now.tool).title
            self._tell(RobotChange("", title, None, EQUIPPED))

    async def revive(self, who: str) -> None:
        """Start the process of the present arm again where it is gone, for ``who``: nothing is connected.

        Errors as ``change``; after one, nobody tries again for some seconds.
        """
        now = asyncio.get_running_loop().time
        if self._not_revived is not None and now() - self._not_revived[0] < _REVIVED_AGAIN_S:
            raise self._not_revived[1]
        if self._reviving is None:
            self._reviving = asyncio.create_task(self._revive(who))
        reviving = self._reviving
        try:
            await asyncio.shield(reviving)
        except ArmctlError as refusal:
            self._not_revived = now(), refusal
            raise
        finally:
            if reviving.done() and self._reviving is reviving:
                self._reviving = None

    async def _revive(self, who: str) -> None:
        if self.console.controller.ended:
            self.require_reopenable()
            await self._replace(
                self.present, self.console.default_port, Origin(who), lambda: None, again=True
            )

    async def _replace(
        self,
        choice: RobotChoice,
        port: str,
        origin: Origin,
        permit: Callable[[], None],
        *,
        again: bool = False,
    ) -> None:
        """Put a new console in place of the present one; what fails before that changes nothing.

        ``again``: its process is gone, and somebody wants to use the arm who is no page.
        """
        began, left, reopen = wall_time(), self.console, choice == self.present
        self.opening, self.progress, self._given_up = choice, None, False
        try:
            opened = await asyncio.to_thread(self._open, choice.name, port, self._note_progress)
            self.progress = None
            try:
                self._require_wanted()
                await self._carry_control(opened, left)
                for command in _as_before(opened, left, reopen=reopen):
                    operator = opened.controller.snapshot.control.operator
                    by = origin if operator is None or operator.id == origin.who else Origin(operator.id)
                    await _finished(opened, command, by)
                if again:
                    title = opened.robot.title
                    not_connected = f"{title} is not connected, as its process was gone; press Connect"
                else:
                    not_connected = None if reopen else await _connect(opened, left, origin)
                # ask again: the present arm may have begun to move meanwhile
                permit()
                require_replaceable(left.controller.snapshot, reopen=reopen)
            except BaseException:
                await asyncio.to_thread(opened.close)
                raise
            if left.controller.ended:
                did = RESTARTED
            else:
                did = "chose" if not reopen else "calibrated" if port == left.default_port else "opened"
            log = _log_lines(left, opened, origin, began, not_connected, did)
            kept = left.last_known if reopen and _same_machine(left, opened) else opened.last_known
            self.console = replace(opened, earlier=log, last_known=kept)
            self.console.carry_over(left)
            self.present = choice
            self._settle_pages(left)
            try:
                if self._tell is not None:
                    self._tell(RobotChange(origin.who, choice.title, not_connected, did))
            finally:
                await asyncio.to_thread(left.close)  # frees its line, so that the new arm may use it
        finally:
            self.opening = self.progress = None

    def _settle_pages(self, left: Console) -> None:
        """Tell the new arm of pages that came or went after their names were carried over."""
        control, before = self.console.controller.snapshot.control, left.controller.snapshot.control
        for party in control.parties:
            if party.id not in self.pages:
                self.console.controller.submit(Leave("its page is gone"), Origin(party.id))
        for page in self.pages:
            if control.party(page) is None:
                known = before.party(page)
                name = page if known is None else known.name
                arriving = Arrive(name, watch=control.operator is not None)
                self.console.controller.submit(arriving, self.origin(page))

    def origin(self, page: str) -> Origin:
        """A page, as it is introduced to an arm."""
        return Origin(page, source=self.sources.get(page, ""))

    async def _carry_control(self, opened: Console, left: Console) -> None:
        """The pages keep their names, their operator and a lock; who guesses the PIN does not begin anew."""
        control = left.controller.snapshot.control
        pages = [party for party in control.parties if party.id in self.pages]
        for party in sorted(pages, key=lambda party: not party.operates):
            await _finished(opened, Arrive(party.name, watch=not party.operates), self.origin(party.id))
        if control.locked and pages:
            who = next((party.id for party in pages if party.operates), pages[0].id)
            pin = opened.pin if control.by_teacher else ""
            await _finished(opened, LockControl(True, pin), Origin(who))
        if control.wrong_pins:  # last: who is there already does not wait for others who guess
            await _finished(opened, RememberWrongPins(control.wrong_pins), Origin("console"))


def _as_before(opened: Console, left: Console, *, reopen: bool) -> Iterator[Command]:
    """What gives an arm the speed override of the one that is left and, where it is the same, its tool."""
    now, before = opened.controller.snapshot, left.controller.snapshot
    if now.speed != before.speed:
        yield SetSpeed(before.speed)
    if reopen and now.tool != before.tool and before.tool in [tool.name for tool in opened.robot.tools]:
        yield SetTool(before.tool)


async def _connect(opened: Console, left: Console, origin: Origin) -> str | None:
    """Connect the new arm where the old one is simulated; else says why it is not connected."""
    title, board = opened.robot.title, left.controller.snapshot.board
    if board is None:
        return f"{title} is not connected, as the arm before it was not; press Connect"
    if not board.simulated:
        return (
            f"{title} is not connected: the servos on {board.port} are another arm's; "
            "choose its port and press Connect"
        )
    await _finished(opened, Connect(SIMULATED), origin)
    return None


async def _finished(console: Console, command: Command, origin: Origin) -> None:
    await asyncio.wrap_future(console.controller.submit(command, origin).finished)


def _same_machine(left: Console, opened: Console) -> bool:
    boards = {left.calibration.board, opened.calibration.board} - {None}
    same_line = left.default_port == opened.default_port and len(boards) < 2
    return same_line and left.robot.n == opened.robot.n  # its file may be another one by now


def _log_lines(
    left: Console, opened: Console, origin: Origin, began: float, not_connected: str | None, did: str
) -> tuple[Event, ...]:
    what = {"chose": f"{left.robot.title} → {opened.robot.title}", RESTARTED: "a new arm process was started"}
    change = what.get(did, f"{opened.robot.title} {did}")
    text = f"robot: {change} ({origin.who})"
    lines = [*left.earlier, *left.controller.snapshot.events, Event(began, "info", text)]
    LOG.info("%s", text)
    if not_connected is not None:
        lines.append(Event(wall_time(), "warning", not_connected))
        LOG.warning("%s", not_connected)
    return tuple(lines[-_LOG_LINES:])


# When an arm may be left for another one, or opened anew: not in a motion, nor where it would drop.


def release_first(snapshot: Snapshot, *, reopen: bool) -> str | None:
    """Why real servos or motors must be released first, as nothing would speak to them any more; or None."""
    board = snapshot.board
    if board is None or board.simulated or not snapshot.powered:
        return None
    on = f"the {'motors' if snapshot.source is Source.MEASURED else 'servos'} on {board.port} are on"
    if not reopen:
        return f"{on}; press Release (the arm drops), then choose another robot"
    if snapshot.source is Source.TRANSMITTED:
        return None  # a Maestro goes on sending its pulses, and Enable takes the arm over where it stands
    return f"{on}, and the arm has to be opened anew: support it, press Release (it drops), then try again"


def not_replaceable(snapshot: Snapshot, *, reopen: bool) -> str | None:
    """Why an arm cannot be left for another one, or opened anew: it moves, or must be released first."""
    if snapshot.state in (State.MOVING, State.PAUSED):
        doing = "moves" if snapshot.state is State.MOVING and not reopen else "is in the middle of a motion"
        then = "try again" if reopen else "choose another robot"
        return f"the arm {doing}; wait until it stands, or press STOP, then {then}"
    return release_first(snapshot, reopen=reopen)


def require_replaceable(snapshot: Snapshot, *, reopen: bool) -> None:
    """Refuse (``StateError``) where an arm is ``not_replaceable``."""
    if (why := not_replaceable(snapshot, reopen=reopen)) is not None:
        raise StateError(why)
