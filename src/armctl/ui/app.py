"""The web application: guarded server, one session a page, one loop that draws."""

from __future__ import annotations

import asyncio
import gc
import logging
import sys
from concurrent.futures import Future
from contextlib import suppress

import viser

from armctl.errors import ArmctlError
from armctl.process.limits import near
from armctl.protocol import Arrive, Leave, Origin, Snapshot, Ticket
from armctl.robot import CarriedPart, Robot
from armctl.ui.bar import set_theme
from armctl.ui.console import Console, page_name
from armctl.ui.control_return import ControlReturn
from armctl.ui.guard import GuardedServer
from armctl.ui.page import Page
from armctl.ui.robot_switch import EQUIPPED, RESTARTED, RobotChange, RobotSwitch
from armctl.ui.scene.arm_model import ARM, ArmFigure
from armctl.ui.scene.stage import Stage, set_lights
from armctl.ui.session import Session
from armctl.ui.tabs.inverse.answer import prepare

LOG = logging.getLogger("armctl.ui")
FRAME_S = 1 / 25
"""every other tick of the arm"""
SILENCE_S = 0.9
"""Five beats a second come from a page. STOP reaches the arm within 1 s of the moment when they end."""
_CLOSE_S = 5.0
_FRAMES_A_REFRESH = 3
_ARRIVING_S = 1.0
_DRAWN_S = 0.3
"""for so long a page's tabs wait for its bar"""


_SWITCH_INTERVAL_S = 2e-4


def settle_interpreter() -> None:
    """Prepare the interpreter of a process that only serves pages, once what stays for ever is built.

    Threads that work for a page hand the interpreter over after 0.2 ms instead of 5, and the garbage
    collector, which stops them all, never looks again at what is there now (``benchmarks/page_gaps.py``).
    """
    sys.setswitchinterval(_SWITCH_INTERVAL_S)
    gc.collect()
    gc.freeze()


class App:
    """Serves the present arm's console to browser pages, all of it on viser's event loop, without a lock."""

    def __init__(self, robots: RobotSwitch, server: GuardedServer, silence_s: float = SILENCE_S) -> None:
        """``server`` is closed with the console.

        ``silence_s``: how long [s] the operator's page may give no sign of life while the arm moves.
        """
        self.robots = robots
        self.server = server
        self._lines = server.stop_lines
        self._lines.attend(self._stop, self._silent, silence_s)
        state = robots.console.state
        self._return = ControlReturn(
            self._lines, None if state is None else state / f"operator-{server.get_port()}"
        )
        self._pages: dict[int, Page] = {}
        self._prepared: Robot | None = None
        """the arm for which a target was solved once"""
        set_theme(server.gui, dark=False)
        set_lights(self.server.scene)
        self._draw_arm()
        robots.on_change(self._changed)
        self.server.on_client_connect(self._connect)
        self.server.on_client_disconnect(self._disconnect)
        self._loop: Future[None] = asyncio.run_coroutine_threadsafe(self._run(), self.server.get_event_loop())

    def close(self) -> None:
        """Stop serving; pages that hang are not waited for, so that the arm is brought to rest after it."""
        ending = asyncio.run_coroutine_threadsafe(self._end(), self.server.get_event_loop())
        try:
            ending.result(_CLOSE_S)
        except TimeoutError:
            LOG.error("the pages have not ended within %g s; they are left", _CLOSE_S)
        self.server.stop()

    async def _end(self) -> None:
        # A page may wait for a file or a check. That ends with it, and is no error in the terminal.
        asyncio.get_running_loop().set_exception_handler(
            lambda _, context: LOG.debug("left at the end: %s", context["message"])
        )
        self._loop.cancel()
        for page in self._pages.values():
            page.session.close()
        await asyncio.sleep(FRAME_S)  # what was cancelled ends before the server does

    @property
    def _console(self) -> Console:
        return self.robots.console

    async def _connect(self, client: viser.ClientHandle) -> None:
        who = page_name(client.client_id)
        try:
            page = await self._begin(client)
            await page.build()
        except Exception:
            LOG.exception("%s could not be built", who)
            if (built := self._pages.pop(client.client_id, None)) is not None:
                built.session.close()
            self._leave(who, "its page could not be built")
            raise
        self._prepare(page)
        former = self._return.former
        if former is not None and self._lines.page_of(who) != former.page:
            text = (
                f"Control is kept for {former.words} for a few seconds, as armctl was started anew. "
                "To have it now, press Take control."
            )
            page.session.notify("Control", text)

    async def _begin(self, client: viser.ClientHandle) -> Page:
        """A page with its bar, whose tabs are still empty.

        The bar goes ahead of them, on the page's other line: what follows keeps the browser at work for long.
        """
        number, who = client.client_id, page_name(client.client_id)
        address = self.server.address_of(number)
        arrived = self._arrive(who, f"pages at {near(address)}" if address else "")
        with client.atomic():
            page = self._pages[number] = Page(client, self.robots, self._link, self._operator_lost)
            with suppress(ArmctlError, TimeoutError):  # a page of an arm that does not answer is shown, too
                await asyncio.wait_for(asyncio.wrap_future(arrived.finished), _ARRIVING_S)
            page.show_bar()
            said = self.server.introduced(number)
            if said is not None and not page.session.closed:
                self.server.part_lines.link(*said, page.session.parts)
                with suppress(TimeoutError):
                    await asyncio.wait_for(page.session.parts.drawn(), _DRAWN_S)
        return page

    def _link(self, page: str, load: str, session: Session) -> None:
        """The lines of ``page``, which calls itself so, are those of a session."""
        self._lines.link(page, session.me)
        self.server.part_lines.link(page, load, session.parts)

    def _prepare(self, page: Page) -> None:
        """Have one page do what takes a while the first time with an arm."""
        if self._prepared is not self._console.robot:
            self._prepared = self._console.robot
            page.session.spawn(asyncio.to_thread(prepare, page.session.held))

    def _arrive(self, who: str, source: str) -> Ticket:
        """Tell the arm that a page is there."""
        self.robots.pages.append(who)
        self.robots.sources[who] = source
        watch = self._return.former is not None  # control is kept for who had it
        return self._console.controller.submit(Arrive(who, watch), self.robots.origin(who))

    def _leave(self, who: str, why: str) -> None:
        """A page is gone: what moves at its command is stopped, and control is free."""
        if who in self.robots.pages:
            self.robots.pages.remove(who)
            self.robots.sources.pop(who, None)
        self._console.controller.submit(Leave(why), Origin(who))

    def _draw_arm(self) -> None:
        self._stage = Stage(self.server.scene, self._console.robot)
        self._figure = ArmFigure(self.server.scene, self._console.robot, ARM)
        self._drawn: Snapshot | None = None

    def _changed(self, change: RobotChange) -> None:
        with self.server.atomic():
            self._stage.remove()
            self._figure.root.remove()
            self._draw_arm()
        for client_id, page in tuple(self._pages.items()):
            self.server.part_lines.unlink(page.session.parts)
            try:
                page.rebuild()
                self._prepare(page)
                if change.did == RESTARTED:
                    then = "Enable again" if change.not_connected is None else "Connect, then Enable"
                    text = f"A new arm process was started. Press {then}."
                    page.session.notify("Robot", text, "yellow")
                elif change.did == EQUIPPED:
                    page.session.notify("Tool", f"{change.title} is on: the page shows the arm with it now.")
                elif not page.session.operates:
                    text = f"{change.who} {change.did} {change.title}: this page shows it now."
                    page.session.notify("Robot", text)
                elif change.not_connected is not None:
                    page.session.notify("Robot", f"{change.not_connected}.", "yellow")
            except Exception:  # the other pages go on
                LOG.exception("%s could not be built anew", page_name(client_id))
                self._pages.pop(client_id)
                page.session.refuse("this page could not be built for the new robot; reload it", "Error")
                page.session.close()

    async def _disconnect(self, client: viser.ClientHandle) -> None:
        self._lines.unlink(page_name(client.client_id))
        page = self._pages.pop(client.client_id, None)
        if page is not None:
            page.session.close()
            self.server.part_lines.unlink(page.session.parts)
        self._leave(page_name(client.client_id), "the operator's page is gone")

    def _operator_lost(self, client_id: int) -> None:
        self._silent(page_name(client_id))

    def _stop(self, who: str) -> None:
        self._console.stop(Origin(who))

    def _silent(self, who: str) -> None:
        controller = self._console.controller
        if controller.snapshot.busy:
            LOG.warning("%s does not answer", who)
            controller.submit(Leave("the operator's page does not answer"), Origin(who))
            controller.submit(Arrive(who, watch=True), self.robots.origin(who))
            self._return.fell_silent(who)

    async def _run(self) -> None:
        """Draw, and beat beside it; where one of them breaks, both end, and the arm comes to rest."""
        try:
            async with asyncio.TaskGroup() as both:
                both.create_task(self._beat())
                both.create_task(self._draw())
        except Exception:
            LOG.exception("the pages cannot be drawn any more")
            raise

    async def _beat(self) -> None:
        """Say that pages can command: from this loop, as where it hangs they cannot."""
        while True:
            self._console.controller.beat()
            await asyncio.sleep(FRAME_S)

    async def _draw(self) -> None:
        frame = 0
        while True:
            await asyncio.sleep(FRAME_S)
            frame += 1
            control = self._console.controller.snapshot.control
            self._lines.watch(None if control.operator is None else control.operator.id)
            former = self._return.former
            if (back := self._return.due(control, self.robots.pages)) is not None:
                party = control.party(back)
                name = "" if party is None else party.name
                if former is not None and former.name and self._lines.who_is(former.page) == back:
                    name = former.name
                self._console.controller.submit(Arrive(name), self.robots.origin(back))
            try:
                self.robots.follow_tool()
                self._draw_frame()
            except Exception:
                LOG.exception("a frame could not be drawn")
            if frame % _FRAMES_A_REFRESH == 0:
                await self._refresh_pages()

    async def _refresh_pages(self) -> None:
        for client_id, page in tuple(self._pages.items()):
            if page.session.closed:  # it left while the others were drawn; the arm may be another since then
                continue
            try:
                page.see(self._lines.tabs(page_name(client_id)))
                page.refresh(self._console.controller.snapshot)
            except RuntimeError:  # the page has just gone
                LOG.debug("a page could not be refreshed", exc_info=True)
            except Exception:  # the other pages go on
                LOG.exception("%s could not be refreshed", page_name(client_id))
            await asyncio.sleep(0)  # a click is not to wait for all pages

    def _draw_frame(self) -> None:
        console = self._console
        snapshot = console.controller.snapshot
        if snapshot is self._drawn:
            return
        self._drawn = snapshot
        console.last_known.note(snapshot)
        q = console.last_known.drawn(snapshot)
        with self.server.atomic():  # another tool is drawn at once; the pages follow when nothing moves
            self._figure = self._figure.wearing(console.robot.with_tool(snapshot.tool))
            self._figure.pose(q, snapshot.gripper)
            self._figure.carry(CarriedPart.of(snapshot.part_mm))
            self._figure.say("last known" if console.last_known.remembers(snapshot) else None)
        for listener in console.frame_listeners:
            listener(snapshot)
