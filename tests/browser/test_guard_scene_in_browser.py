"""Everything else that viser's page sends is admitted: scene, hot keys, held buttons, pictures, storage."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import viser
from tests.browser.kit import PATIENCE_MS, Screen, Screens

from armctl.ui.guard import GuardedServer, guarded_server

pytestmark = pytest.mark.browser


class Stage:
    """A box to click, a gizmo to drag, a button to hold and a hot key."""

    def __init__(self) -> None:
        self.events: queue.Queue[str] = queue.Queue()
        self.server: GuardedServer = guarded_server(port=0, label="armctl")
        scene = self.server.scene
        scene.configure_default_lights(cast_shadow=False)
        scene.configure_environment_map(hdri=None)
        scene.world_axes.visible = False
        self.server.initial_camera.position = (0.0, -6.0, 0.0)
        self.server.initial_camera.look_at = (0.0, 0.0, 0.0)
        self.server.on_client_connect(self._build)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server.get_port()}/"

    async def _build(self, client: viser.ClientHandle) -> None:
        gui = client.gui
        control = gui.add_panel()
        with control.add_tab("Control"):
            jog = gui.add_button("Jog")
        control.dock_left()
        gui.main_panel.dock_right()

        @jog.on_hold(callback_hz=20.0)
        async def _(event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            self.events.put("hold")

        command = gui.add_command("Stop", hotkey="escape")

        @command.on_trigger
        async def _(event: viser.CommandEvent) -> None:
            self.events.put("hot key")

        box = client.scene.add_box("/box", dimensions=(1.0, 1.0, 1.0), position=(0.0, 0.0, 1.5))

        @box.on_click
        async def _(event: viser.SceneNodePointerEvent[viser.BoxHandle]) -> None:
            self.events.put("click")

        target = client.scene.add_transform_controls("/target", scale=3.0, disable_rotations=True)

        @target.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            if target.position[0] > 0.2:
                self.events.put("drag")


@pytest.fixture
def stage() -> Iterator[Stage]:
    stage = Stage()
    yield stage
    assert stage.server.refusals == {}
    stage.server.stop()


def wait_for(stage: Stage, screen: Screen, what: str) -> None:
    seen: list[str] = []

    def has_come() -> bool:
        while not stage.events.empty():
            seen.append(stage.events.get_nowait())
        return what in seen

    screen.wait_until(has_come, what)


def test_held_buttons_hot_keys_clicks_and_drags_in_the_scene_arrive(stage: Stage, screen: Screen) -> None:
    screen.open(stage.url, until="Jog")
    screen.hold("Jog", 300)
    wait_for(stage, screen, "hold")
    screen.page.keyboard.press("Escape")
    wait_for(stage, screen, "hot key")

    canvas = screen.page.locator("canvas[data-engine]").bounding_box()
    assert canvas is not None
    x, y = canvas["x"] + canvas["width"] / 2, canvas["y"] + canvas["height"] / 2
    metre = canvas["height"] / (2 * 6.0 * 0.7673)  # 75° of field, seen from 6 m
    screen.page.mouse.click(x, y - 1.6 * metre)
    wait_for(stage, screen, "click")
    screen.page.mouse.move(x + 1.2 * metre, y)
    screen.pause(300)
    screen.page.mouse.down()
    screen.page.mouse.move(x + 2.4 * metre, y, steps=10)
    screen.pause()
    screen.page.mouse.up()
    wait_for(stage, screen, "drag")
    screen.screenshot("guard-scene")


def test_pictures_storage_and_downloads_work(stage: Stage, screens: Screens) -> None:
    screen = screens(drawn=True)
    screen.open(stage.url, until="Jog")
    client = next(iter(stage.server.get_clients().values()))
    answers: dict[str, object] = {}

    def ask() -> None:
        picture = client.get_render(height=120, width=160, timeout=PATIENCE_MS / 1000)
        answers["picture"] = picture.shape
        answers["shows the box"] = bool((picture != picture[0, 0]).any())
        client.local_storage.set_item("key", "value")
        answers["stored"] = client.local_storage.get_item("key", timeout=PATIENCE_MS / 1000)

    asking = threading.Thread(target=ask)
    asking.start()
    screen.wait_until(lambda: not asking.is_alive(), "the page to answer")
    assert answers == {"picture": (120, 160, 3), "shows the box": True, "stored": "value"}
    with screen.page.expect_download() as download:
        client.send_file_download("pick.csv", b"1,2\n", save_immediately=True)
    assert download.value.suggested_filename == "pick.csv"
    assert Path(download.value.path()).read_bytes() == b"1,2\n"
    assert screen.errors == []
