"""A small console of every kind of control, for the tests of the guard and of the kit."""

from __future__ import annotations

import queue
import threading
from typing import Any

import viser
from tests.browser.kit import PATIENCE_MS, Screen
from tests.browser.serving import page_port

from armctl.ui.guard import GuardedServer, guarded_server


class Console:
    """A small console, one copy a page: what happens to its controls ends up in ``events``."""

    def __init__(self, **options: Any) -> None:
        self.events: queue.Queue[tuple[str, object]] = queue.Queue()
        self.loop_threads: set[str] = set()
        self.server: GuardedServer = guarded_server(port=page_port(), label="armctl", **options)
        self.server.on_client_connect(self._build)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server.get_port()}/"

    def next_event(self) -> tuple[str, object]:
        return self.events.get(timeout=PATIENCE_MS / 1000)

    def last_event(self, screen: Screen) -> tuple[str, object]:
        """What the last of a series of keystrokes did; the page has sent everything when a helper returns."""
        screen.wait_until(lambda: not self.events.empty(), "an event of the console")
        event = self.next_event()
        while not self.events.empty():
            event = self.next_event()
        return event

    async def _build(self, client: viser.ClientHandle) -> None:
        gui = client.gui
        control = gui.add_panel()
        with control.add_tab("Control"):
            stop = gui.add_button("STOP", color="red")
            off = gui.add_button("Release")
            off.disabled = True
        tabs = gui.add_tab_group()
        with tabs.add_tab("Main"):
            x = gui.add_number("X [mm]", initial_value=1.5, min=-400.0, max=400.0, step=0.1)
            joint = gui.add_slider("joint 1", min=-90.0, max=90.0, step=0.1, initial_value=0.0)
            robot = gui.add_dropdown("robot", ("uzuner", "mico"))
            name = gui.add_text("name", initial_value="pick")
            loop = gui.add_checkbox("loop", initial_value=False)
            step = gui.add_button_group("step", ("−", "+"))
            target = gui.add_vector3("target", initial_value=(1.0, 2.0, 3.0), step=0.1)
            load = gui.add_upload_button("Load")
            gui.add_html('<p id="state">state: <b>holding</b></p>')
            gui.add_markdown("Reached *exactly*.")
        with tabs.add_tab("Manual"):
            gui.add_number("X [mm]", initial_value=2.5)
        gui.main_panel.dock_right()
        control.dock_above(gui.main_panel)  # notifications appear at the top left: they would cover it

        @stop.on_click
        async def _(event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            self.loop_threads.add(threading.current_thread().name)
            self.events.put(("STOP", event.client_id))
            client.add_notification("Stopped", "The arm holds its position.", color="red")

        @load.on_upload
        async def _(event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
            self.events.put(("Load", (event.target.value.name, event.target.value.content)))

        def note(label: str, handle: Any) -> None:
            async def changed(event: viser.GuiEvent[Any]) -> None:
                if event.client is not None:
                    self.events.put((label, event.target.value))

            (handle.on_click if isinstance(handle, viser.GuiButtonGroupHandle) else handle.on_update)(changed)

        for label, handle in (
            ("X [mm]", x),
            ("joint 1", joint),
            ("robot", robot),
            ("name", name),
            ("loop", loop),
            ("step", step),
            ("target", target),
        ):
            note(label, handle)
