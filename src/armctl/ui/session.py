"""What the parts of one browser page need: clicks become commands, refusals become notices."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine, Generator, Iterable
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from functools import cache, partial
from itertools import count
from typing import Any, TypeVar

import viser

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.facts import Need, Reason, say
from armctl.facts.commands import Stopped
from armctl.protocol import Command, ControlCommand, HomeAxes, Origin, Snapshot, Ticket
from armctl.robot import CarriedPart, Robot
from armctl.robot.look.rows import Theme
from armctl.ui.console import page_name
from armctl.ui.docs import page_of_error
from armctl.ui.events import Action, AtWork, Color, GivenUpError, Notifications
from armctl.ui.guard.parts import Parts
from armctl.ui.next_pose import NextPose
from armctl.ui.offers import NO_REASON, Disableable, Offer
from armctl.ui.robot_switch import RobotSwitch
from armctl.ui.scene.camera import View
from armctl.ui.scene.ghost import Ghost
from armctl.ui.widgets.html import LiveHtml, with_minus
from armctl.ui.widgets.number_field import in_row

LOG = logging.getLogger("armctl.ui")
_LINK_AGAIN_S, _LINK_TIMEOUT_S = 0.5, 3.0
_AT_WORK: ContextVar[tuple[str, AtWork | None]] = ContextVar("at_work", default=("", None))
"""what was pressed on a page, in whose context this runs"""
T = TypeVar("T")


class Session:
    """One page and the present arm; another arm takes a new session. Nothing may block the event loop."""

    def __init__(self, client: viser.ClientHandle, robots: RobotSwitch) -> None:
        self.client = client
        self.robots = robots
        self.console = robots.console
        self._tasks: set[asyncio.Task[None]] = set()
        self._keys: list[viser.CommandHandle] = []
        self._offers: list[Offer] = []
        self.obeyed: set[str] = set()
        """labels of the buttons of this page whose commands the arm has accepted"""
        self._end_question: Callable[[], None] = lambda: None
        self.closed = False
        """page or arm is gone; whoever has waited for something must not write to the page any more"""
        self.ghost = Ghost(client.scene, self.console.robot, lambda: self.snapshot)
        """what is only looked at"""
        self.on_phone = False
        """the panels are a sheet over the lower part of the scene"""
        self.parts = Parts()
        self._notices = Notifications(client, self.parts)
        self._numbers, self._at_work = count(1), dict[str, AtWork]()
        self.on_part("cancel-work", self._on_cancel_work)
        self.theme: Theme = "light"
        self._themed: list[Callable[[], None]] = []
        self.other_arrows: list[viser.TransformControlsHandle] = []
        """what else can be dragged; it may stand where the tool is"""
        self.next = NextPose(self)
        self.view = View(self, self.console.robot)

    @property
    def gui(self) -> viser.GuiApi:
        """The page's own GUI: no other page can touch it."""
        return self.client.gui

    @property
    def snapshot(self) -> Snapshot:
        """The newest state of the arm."""
        return self.console.controller.snapshot

    @property
    def arm(self) -> Robot:
        """The arm with the tool that is on, also while a program runs that has changed it."""
        return self.console.robot.with_tool(self.snapshot.tool)

    @property
    def held(self) -> Robot:
        """The arm with its jaws as far open as they are, and with what they carry: motions are checked so."""
        now = self.snapshot
        return self.arm.gripping(now.gripper).carrying(CarriedPart.of(now.part_mm))

    @property
    def origin(self) -> Origin:
        """How the log names this page."""
        return Origin(self.me)

    @property
    def me(self) -> str:
        """What this page is called among those who may operate the arm."""
        return page_name(self.client.client_id)

    @property
    def name(self) -> str:
        """What people call it."""
        party = self.snapshot.control.party(self.me)
        return self.me if party is None else party.name

    @property
    def operates(self) -> bool:
        """Whether this page has the controls."""
        return self.snapshot.control.operates(self.me)

    @property
    def operator(self) -> str:
        """Who operates, as seen from this page."""
        party = self.snapshot.control.operator
        return "nobody" if party is None else "you" if party.id == self.me else party.name

    def with_names(self, reason: Reason) -> Reason:
        """A reason with who stopped the arm as this page knows them: itself as "you", others by name."""
        if not isinstance(reason, Stopped) or reason.note:
            return reason
        party = self.snapshot.control.party(reason.by)
        return replace(reason, by="" if reason.by == self.me else party.name if party else reason.by)

    def sees(self, tab: str) -> bool:
        """Whether the tab with this label is open, or nobody knows: what only tells need not be told else."""
        return self.ghost.in_view(tab)

    @property
    def on_stage(self) -> list[FloatArray]:
        """(n,) the arm as it is drawn, its next pose, and what is looked at [rad]."""
        ghosts = (self.next.q, self.ghost.q if self.ghost.seen else None)
        return [self.console.last_known.drawn(self.snapshot), *(q for q in ghosts if q is not None)]

    def use_theme(self, theme: Theme) -> None:
        """The page is light or dark from now on."""
        self.theme = theme
        for draw in self._themed:
            draw()

    def on_theme(self, draw: Callable[[], None]) -> None:
        """Call ``draw`` whenever the page's ``theme`` has changed."""
        self._themed.append(draw)

    def on(self, attach: Callable[..., object], action: Action) -> None:
        """Run ``action`` on a page's event (``attach``: ``on_click``, …); what goes wrong is notified."""

        async def callback(event: viser.GuiEvent[Any]) -> None:
            if event.client is None:
                return
            with self._shown_at_work(_label_of(event.target)):
                await self.attempt(action)

        attach(callback)

    def on_part(self, do: str, action: Callable[[str], Awaitable[object] | None]) -> None:
        """Run ``action(key)`` where this is done to a part of the page; what goes wrong is notified."""
        self.parts.on(do, lambda key: None if self.closed else self.attempt(partial(action, key)))

    def on_press(self, do: str, label: str, action: Callable[[str], Awaitable[object] | None]) -> None:
        """As ``on_part``, for a button with this label: what it does may take a while, and others go on."""

        async def press(key: str) -> None:
            with self._shown_at_work(label):
                await self.attempt(partial(action, key))

        self.parts.on(do, lambda key: None if self.closed else self.spawn(press(key)))

    def on_part_value(self, do: str, action: Callable[[str, str], Awaitable[object] | None]) -> None:
        """Run ``action(key, value)`` where a part of the page gives a value; what goes wrong is notified."""
        self.parts.on_value(
            do, lambda key, value: None if self.closed else self.attempt(partial(action, key, value))
        )

    def needs(
        self,
        arm: Need | Callable[[], Need | None] | None,
        *controls: Disableable,
        also: Callable[[Snapshot], str | Reason | None] | None = None,
        told: bool = True,
        anyone: bool = False,
        hint: str = "",
    ) -> Offer:
        """Disable controls while they would be refused, and say why below them, in the present container.

        ``arm``: what they need of the arm, or need now; None: only that this page operates. ``also``: why
        they would be refused all the same, in words ("the list is empty; record a pose first"), or None.
        ``told``: whether the reason is shown; not where the same one stands beside it already. ``anyone``: a
        page that watches may use them, too, whatever the arm does. ``hint``: a line in place of no reason.
        """
        offer = Offer(controls, arm, also, LiveHtml(self.gui, NO_REASON) if told else None, anyone, hint)
        self._offers.append(offer)
        self._draw_offers((offer,), self.snapshot)
        return offer

    def why_not(self, arm: Need | None, snapshot: Snapshot) -> str | None:
        """Why what needs this of the arm is refused on this page now, and what to do; None: it is not."""
        if self.robots.opening is not None:
            return f"the robot is being changed for {self.robots.opening.title}; wait a moment"
        if not (snapshot.control.operates(self.me) or self.console.controller.ended):
            if snapshot.control.party(self.me) is None and not snapshot.unreachable:
                return "this page has just come; wait a moment"
            return "this page is watching; press 'Take control' first"
        if arm is None:
            return None
        if snapshot.unreachable:
            return "the arm does not answer; see the message over the picture"
        why = snapshot.unmet(arm)
        return None if why is None else say(why)

    def refresh(self, snapshot: Snapshot) -> None:
        """Enable and disable the controls for a snapshot."""
        self._draw_offers(self._offers, snapshot)

    def _draw_offers(self, offers: Iterable[Offer], snapshot: Snapshot) -> None:
        why_not = cache(partial(self.why_not, snapshot=snapshot))  # many controls share a need
        known = snapshot.control.party(self.me) is not None  # one that has just come is about to be told
        for offer in offers:
            offer.draw(snapshot, why_not, told=known)

    def command(self, label: str, action: Action, description: str) -> viser.CommandHandle:
        """Add a command to the palette (Ctrl+K)."""
        handle = self.gui.add_command(label, description=description)
        self.on_key(handle, action)
        return handle

    def on_key(self, command: viser.CommandHandle, action: Action) -> None:
        """Run ``action`` when the command's key is pressed outside a field."""
        self.on(command.on_trigger, action)
        self._keys.append(command)

    def take_key(self, command: viser.CommandHandle) -> None:
        """The key does nothing from now on."""
        self._keys.remove(command)
        command.remove()

    def take_keys(self) -> None:
        """No key does anything from now on."""
        for command in tuple(self._keys):
            self.take_key(command)

    async def attempt(self, action: Action) -> None:
        """Run ``action``; a refusal is shown, a defect is logged and shown."""
        try:
            result = action()
            if result is not None:
                await result
        except GivenUpError:
            raise
        except ArmctlError as refusal:
            if not self.closed:
                self.refuse(say(self.with_names(refusal.reason)), more=page_of_error(refusal))
        except Exception:
            if self.closed:  # it has met widgets that went with the page or the arm
                LOG.debug("an action outlived its page", exc_info=True)
                return
            LOG.exception("a page's action failed")
            self.refuse("an internal error; the program's log has the details", title="Error")

    @contextmanager
    def _shown_at_work(self, label: str) -> Generator[None]:
        """Show that what was pressed is being worked on, as long as it is and the arm does not act on it."""
        if not label:
            _AT_WORK.set(("", None))
            yield
            return
        key = str(next(self._numbers))
        at_work = self._at_work[key] = AtWork(self.client, self.parts, label, key, self.console.last_stop)
        _AT_WORK.set((label, at_work))
        try:
            yield
        except GivenUpError as given_up:
            self.notify(label, f"Cancelled: {given_up}." if given_up.args else "Cancelled.")
        finally:
            at_work.end()
            del self._at_work[key]

    async def work_out(
        self, work: Callable[..., T], *given: object, undo: Callable[[T], object] | None = None
    ) -> T:
        """As ``asyncio.to_thread``, for what can be left: the page offers to cancel what takes a while.

        ``undo`` is given, on a thread, what ``work`` has made after it was cancelled.
        """
        if (at_work := _AT_WORK.get()[1]) is None:
            return await asyncio.to_thread(work, *given)
        return await at_work.work_out(work, *given, undo=undo)

    def _on_cancel_work(self, key: str) -> None:
        if key in self._at_work:
            self._at_work[key].give_up()

    def require_operator(self) -> None:
        """Refuse (``ArmctlError``) what only the operator may do."""
        if self.console.controller.ended:
            return  # who connects starts a new arm process; nobody operates one that is gone
        if not self.operates:
            raise ArmctlError(f"this page is watching, {self.operator} operates; press 'Take control' first")

    async def submit(self, command: Command) -> Ticket:
        """Submit, wait until accepted; refused where another page operates or the robot is being changed."""
        self.require_operator()
        self.robots.require_settled()
        label, at_work = _AT_WORK.get()
        with self.console.precedence.going():
            pressed = None if at_work is None else at_work.last_stop
            ticket = self.console.submit(command, self.origin, pressed)
            await asyncio.wrap_future(ticket.accepted)
        if at_work is not None:  # from here on the arm itself shows it
            at_work.end()
            self.obeyed.add(label)
        self.spawn(self._report_end(ticket, command))
        return ticket

    async def say(self, command: ControlCommand) -> None:
        """Say something about who operates, which any page may; waits for the answer."""
        await asyncio.wrap_future(self.console.controller.submit(command, self.origin).finished)

    def download(self, name: str, content: str | bytes) -> None:
        """Send the page a file; the arm's name goes before its name."""
        content = content.encode() if isinstance(content, str) else content
        name = f"{self.console.robot.name}-{name}"
        self.client.send_file_download(name, content, save_immediately=True)

    async def change_robot(self, name: str) -> None:
        """Change the present arm for another one; where something is not saved, the page is asked first."""
        words = [text for unsaved in self.console.unsaved if (text := unsaved()) is not None]
        if words and name != self.robots.present.name:
            self.require_operator()
            self._ask_first(" ".join(words), name)
        else:
            await self.robots.change(name, self.origin, self.require_operator)

    def _ask_first(self, text: str, name: str) -> None:
        self._end_question()
        question = self.gui.add_modal("Change the robot?")
        title = next((one.title for one in self.robots.choices if one.name == name), name)
        with question:
            self.gui.add_markdown(f"The robot becomes {title}. {text}")
            with in_row(self.gui):
                stay = self.gui.add_button("Stay with this robot", color="gray")
                change = self.gui.add_button("Change without saving", color="orange")
                save = self.gui.add_button("Save and change")

        def end() -> None:
            if not question.closed:
                question.close()

        async def go_on() -> None:
            end()
            await self.robots.change(name, self.origin, self.require_operator)

        async def save_first() -> None:
            self.require_operator()
            for save_all in self.console.savers:
                if (path := await save_all()) is not None:
                    self.notify("Saved", str(path))
            await go_on()

        self._end_question = end
        self.on(save.on_click, save_first)
        self.on(stay.on_click, end)
        self.on(change.on_click, go_on)

    async def reopen_arm(self, port: str | None = None) -> None:
        """Open the arm anew, as calibrated now, on ``port`` or where it was; this page shows what fails."""
        try:
            await self.robots.reopen(self.origin, self.require_operator, port)
        except ArmctlError as refusal:
            self.refuse(str(refusal), more=page_of_error(refusal))

    def spawn(self, work: Coroutine[Any, Any, None]) -> None:
        """Run something beside the callbacks; it ends with the page, and what it raises is logged."""
        self._tasks.add(task := asyncio.create_task(work))
        task.add_done_callback(self._ended)

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if (error := None if task.cancelled() else task.exception()) is not None:
            level = logging.DEBUG if self.closed else logging.ERROR  # it may have outlived its page
            LOG.log(level, "a page's task failed", exc_info=error)

    async def _report_end(self, ticket: Ticket, command: Command) -> None:
        try:
            await asyncio.wrap_future(ticket.finished)
        except ArmctlError as broken:
            reason = self.with_names(broken.reason)
            # One's own STOP is in the bar; that the arm is not homed is not.
            if not isinstance(reason, Stopped) or reason.by or isinstance(command, HomeAxes):
                self.notify("Not finished", say(reason), "yellow")

    async def find_line(self, link: Callable[[str, str, Session], None], lost: Callable[[int], None]) -> None:
        """Ask the page which lines are its own, ``link(page, load, session)``: then its beats are watched.

        ``page`` is its name, ``load`` tells this time that it was loaded from others.
        ``lost(client id)`` while this page operates without a line that beats.
        """
        who = page_name(self.client.client_id)
        while (line := await self._ask("armctl-page", _LINK_TIMEOUT_S)) is None:
            if self.operates:
                LOG.warning("%s does not answer", who)
                lost(self.client.client_id)
            await asyncio.sleep(_LINK_AGAIN_S)
        page, _, load = line.partition(" ")
        link(page, load, self)

    async def recall(self, key: str) -> str | None:
        """What this browser remembers under a key; None: nothing, or it keeps no storage."""
        return await self._ask(f"armctl-{key}", _LINK_TIMEOUT_S)

    def remember(self, key: str, value: str) -> None:
        """Have this browser remember something."""
        self.client.local_storage.set_item(f"armctl-{key}", value)

    async def answers(self, timeout_s: float) -> bool:
        """Ask the page for a sign of life; its script has to answer."""
        return await self._ask("armctl-page", timeout_s) is not None

    async def _ask(self, key: str, timeout_s: float) -> str | None:
        try:
            return await asyncio.to_thread(self.client.local_storage.get_item, key, timeout=timeout_s)
        except (TimeoutError, RuntimeError):  # it hangs, is gone, or its browser keeps no storage
            return None

    def close(self) -> None:
        """The page or its arm is gone: end what waits for it."""
        self.closed = True
        self.next.close()
        self._end_question()
        for at_work in self._at_work.values():
            at_work.end()
        for task in tuple(self._tasks):
            task.cancel()

    def refuse(self, text: str, title: str = "Refused", more: str = "") -> None:
        """Say why something is not done, with a link to ``more`` in the documentation if it is there."""
        self.notify(title, text, "red", more)

    def notify(self, title: str, text: str, color: Color = "blue", more: str = "") -> None:
        """Show a notification for as long as it takes to read it."""
        self._notices.show(title, with_minus(text), color, more)


def _label_of(pressed: object) -> str:
    """Of a control; of a group the button that was pressed."""
    button = pressed.value if isinstance(pressed, viser.GuiButtonGroupHandle) else ""
    return button or getattr(pressed, "label", "")
