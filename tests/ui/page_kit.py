"""A page without a browser: what a person presses and types, by label, and the commands that come of it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import nullcontext
from functools import cache
from types import SimpleNamespace
from typing import Any, Protocol, cast

import viser

from armctl.arrays import FloatArray
from armctl.facts import Need, State
from armctl.hardware import Driver, Source
from armctl.protocol import Command, Control, ManualClock, Snapshot
from armctl.robot import Robot
from armctl.runtime import Controller
from armctl.ui.console import Precedence
from armctl.ui.events import Action
from armctl.ui.guard import GuardedServer
from armctl.ui.guard.parts import Parts
from armctl.ui.next_pose import NextPose
from armctl.ui.offers import Offer
from armctl.ui.robot_switch import RobotChoice
from armctl.ui.scene.ghost import Ghost
from armctl.ui.session import Session


def snapshot_of(robot: Robot) -> Snapshot:
    """Of an arm that nothing was asked of yet."""

    def no_driver(port: str) -> Driver:
        raise AssertionError(port)

    return Controller(robot, no_driver, ManualClock()).snapshot


class Refreshed(Protocol):
    """A screen."""

    def refresh(self, snapshot: Snapshot) -> None: ...


class FakePage:
    """Stands for a session: an arm that holds at ``q`` (n,) [rad], and takes every command."""

    def __init__(self, server: GuardedServer, robot: Robot, q: FloatArray) -> None:
        self.gui = server.gui
        self.client = SimpleNamespace(scene=server.scene, atomic=nullcontext)
        self.snapshot = SimpleNamespace(
            q_command=q, q=q, state=State.HOLDING, gripper=None, part_mm=None, speed=1.0, busy=False,
            progress=None, control=Control(), commanded=True, source=Source.COMMANDED, limp=(), stops=0,
            program=None, stamp=0.0,
        )  # fmt: skip
        last_known = SimpleNamespace(
            standing=lambda snapshot: snapshot.q_command, drawn=lambda snapshot: snapshot.q_command
        )
        self.console = SimpleNamespace(
            robot=robot,
            last_known=last_known,
            shared=cache(lambda kind: kind()),
            precedence=Precedence(),
        )
        self.robots = SimpleNamespace(present=RobotChoice(robot.name, robot.title))
        self.me, self.operates = "browser page 1", True
        self.ghost = Ghost(server.scene, robot)
        self.parts = Parts()
        self.closed = False
        self.sent: list[Command] = []
        self.shown_at_sending: list[FloatArray | None] = []
        self._handles: dict[str, Any] = {}
        self._actions: dict[str, Action] = {}
        self._beside: list[Coroutine[Any, Any, None]] = []
        self.obeyed: set[str] = set()
        self.offers: list[Offer] = []
        self.other_arrows: list[viser.TransformControlsHandle] = []
        self.next = NextPose(self.session)
        self.view = SimpleNamespace(held=False)

    @property
    def session(self) -> Session:
        return cast(Session, self)

    @property
    def arm(self) -> Robot:
        return self.console.robot.with_tool(getattr(self.snapshot, "tool", self.console.robot.tool))

    @property
    def held(self) -> Robot:
        return cast(Robot, self.console.robot)

    def sees(self, tab: str) -> bool:
        return self.ghost.in_view(tab)

    def on(self, attach: Callable[..., object], action: Action) -> None:
        handle: Any = getattr(attach, "__self__", None)
        label = getattr(handle, "label", None)
        if label is not None:
            self._handles[label], self._actions[label] = handle, action

    def on_part(self, do: str, action: Callable[[str], None]) -> None:
        self.parts.on(do, action)

    def on_press(self, do: str, label: str, action: Callable[[str], Awaitable[object] | None]) -> None:
        del label
        self.parts.on(do, action)

    def on_part_value(self, do: str, action: Callable[[str, str], Any]) -> None:
        self.parts.on_value(do, action)

    def needs(self, arm: Need | None, *controls: Any, also: Any = None, **_: object) -> Offer:
        """What would be refused is not looked at here."""
        self.offers.append(Offer(controls, arm, also, reason=None, anyone=False))
        return self.offers[-1]

    def why_not(self, arm: Need | None, snapshot: Snapshot) -> str | None:
        return None if snapshot.state is State.HOLDING else "the arm is moving; stop first"

    def go(self) -> None:
        """Press the line's *Go*."""
        self.act(lambda: self.parts.done("go", str(self.next.number)))

    async def submit(self, command: Command) -> None:
        self.shown_at_sending.append(self.next.q)
        self.sent.append(command)

    async def work_out(self, work: Callable[..., Any], *given: object, undo: object = None) -> Any:
        del undo  # nothing is cancelled here
        return await asyncio.to_thread(work, *given)

    def spawn(self, work: Coroutine[Any, Any, None]) -> None:
        """It ends before the next press."""
        self._beside.append(work)

    def press(self, label: str, value: object = None, *, times: int = 1) -> None:
        """Press a button, or one of a group of buttons, so many ``times`` without waiting in between."""
        if value is not None:
            self._handles[label].value = value
        self.act(self._actions[label], times=times)

    async def act_on(self, label: str, value: object = None) -> None:
        """Press a button while something else goes on."""
        if value is not None:
            self._handles[label].value = value
        result = self._actions[label]()
        if result is not None:
            await result

    def act(self, action: Action, *, times: int = 1) -> None:
        """Do something, and what it has spawned."""

        async def act() -> None:
            result = action()
            if result is not None:
                await result

        async def act_often() -> None:
            try:
                await asyncio.gather(*(act() for _ in range(times)))
            finally:
                while self._beside:
                    await self._beside.pop(0)

        asyncio.run(act_often())

    def refresh(self, screen: Refreshed) -> None:
        """Draw what the arm does now, as a page does."""

        def draw() -> None:
            self.next.refresh(self.session.snapshot)
            screen.refresh(self.session.snapshot)

        self.act(draw)

    @property
    def html(self) -> str:
        """All blocks of HTML."""
        containers = self.gui._container_handle_from_uuid.values()
        blocks = (one for container in containers for one in container._children.values())
        return "".join(one.content for one in blocks if isinstance(one, viser.GuiHtmlHandle))

    @property
    def shown_html(self) -> str:
        """All blocks of HTML that are in view."""
        containers = self.gui._container_handle_from_uuid.values()
        blocks = (one for container in containers for one in container._children.values())
        return "".join(one.content for one in blocks if isinstance(one, viser.GuiHtmlHandle) and one.visible)

    def field(self, label: str) -> Any:
        """The newest field of a label, such as one that nothing is called for."""
        containers = self.gui._container_handle_from_uuid.values()
        fields = (one for container in containers for one in container._children.values())
        return [one for one in fields if getattr(one, "label", None) == label][-1]

    def options(self, label: str) -> tuple[str, ...]:
        """What a list offers."""
        return tuple(self._handles[label].options)

    def reads(self, label: str) -> object:
        """What a field or a list shows."""
        return self._handles[label].value

    def is_visible(self, label: str) -> bool:
        """Whether it is shown."""
        return bool(self._handles[label].visible)

    def put(self, label: str, value: object) -> None:
        """Type into a field, or choose from a list."""
        self.press(label, value)

    def ask(self, x: float, y: float, z: float) -> None:
        """Type a point [mm]."""
        for label, value in (("X mm", x), ("Y mm", y), ("Z mm", z)):
            self.put(label, str(value))
