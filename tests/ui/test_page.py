"""One page of the whole console, without a browser."""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import math
import threading
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.browser.served_arm import served_arm
from tests.ui.guard_kit import PATIENCE_S, RawPage, uuid_of
from websockets import Origin
from websockets.sync.client import connect

from armctl.protocol import Snapshot
from armctl.ui import app
from armctl.ui import page as pages
from armctl.ui.console import page_name
from armctl.ui.guard.filter import FloodGauge
from armctl.ui.guard.parts import PARTS_PATH
from armctl.ui.tabs import TABS

GARBAGE = ("garbage", "", True, -1e9, 1e9, math.nan, math.inf, 10**18, (1.0, 2.0), ())


def test_garbage_for_every_control_gives_at_most_a_refusal(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only a page that is not armctl's own sends values of a wrong type, or far out of range."""
    monkeypatch.setattr(FloodGauge, "CAPACITY", 1e6)
    enabled, arrived = threading.Event(), threading.Event()

    def look(snapshot: Snapshot) -> None:
        if session.operates:
            enabled.set()
        if any(party.name == "Ada" for party in snapshot.control.parties):
            arrived.set()

    with served_arm(tmp_path) as served, RawPage(served.app.server.get_port()) as page:
        page.operate()
        (client,) = served.app.server.get_clients().values()
        handles = tuple(client.gui._gui_input_handle_from_uuid.values())
        (name,) = (handle for handle in handles if getattr(handle, "label", "") == "Your name")
        session = next(iter(served.app._pages.values())).session
        served.console.frame_listeners.append(look)
        assert enabled.wait(PATIENCE_S)  # the page operates
        for handle in handles:
            if not handle._impl.is_button:
                for value in GARBAGE:
                    page.set(uuid_of(handle), value)
        loop, parts = served.app.server.get_event_loop(), session.parts
        garbage = ("", "garbage", "nan", "-1e999", "12,5")
        said = [*product(set(parts._actions) - {"release"}, garbage, ("",))]
        said += product(parts._values, ("", "garbage"), garbage)
        for do, key, value in (*said, ("speed", "", "7")):
            asyncio.run_coroutine_threadsafe(parts.done(do, key, value), loop).result(PATIENCE_S)
        assert served.now.speed == pytest.approx(0.07)  # the one value that can be used
        page.set(uuid_of(name), "Ada")
        assert arrived.wait(6 * PATIENCE_S)  # behind some thousand messages
        assert served.now.q_command.tolist() == served.robot.pose("home").tolist()
    assert [record.getMessage() for record in caplog.records if record.levelno >= logging.ERROR] == []


def test_what_a_page_still_waits_for_at_the_end_is_no_error(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    waiting: list[asyncio.Task[None]] = []
    begun = threading.Event()

    async def wait() -> None:
        begun.set()
        await asyncio.get_running_loop().create_future()

    with served_arm(tmp_path) as served:
        loop = served.app.server.get_event_loop()
        loop.call_soon_threadsafe(lambda: waiting.append(loop.create_task(wait())))
        assert begun.wait(PATIENCE_S)
    waiting.clear()
    gc.collect()
    assert [record.getMessage() for record in caplog.records if record.levelno >= logging.ERROR] == []


def test_the_bar_of_a_page_comes_ahead_of_its_tabs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(app, "_DRAWN_S", 10 * PATIENCE_S)
    with served_arm(tmp_path) as served:
        port = served.app.server.get_port()
        here = f"127.0.0.1:{port}"
        with (
            RawPage(port, query="?page=0f&load=1") as page,
            connect(f"ws://{here}{PARTS_PATH}", origin=Origin(f"http://{here}")) as line,
        ):
            line.send(json.dumps({"page": "0f", "load": "1"}))
            page.introduce()
            parts: dict[str, str] = {}
            while "Enable" not in parts.get("bar", ""):
                parts |= json.loads(line.recv(timeout=PATIENCE_S))["parts"]
            (only,) = served.app._pages.values()
            assert only.session.operates and len(only._unbuilt) == 1 + len(TABS)
            line.send(json.dumps({"do": "drawn"}))
            page.read_until(b"operates the arm")  # in the log, which is built last


@pytest.mark.logs_a_defect
def test_a_page_that_cannot_be_built_does_not_operate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks, broke = pages.look_at_arm, threading.Event()

    def look(*given: Any, **more: Any) -> None:
        if not broke.is_set():
            broke.set()
            raise ZeroDivisionError("the first page")
        looks(*given, **more)

    with served_arm(tmp_path) as served:
        monkeypatch.setattr(pages, "look_at_arm", look)
        port = served.app.server.get_port()
        with RawPage(port) as broken, RawPage(port) as page:
            broken.introduce()
            assert broke.wait(PATIENCE_S)
            page.operate()
            (built,) = served.app._pages
            operator = served.now.control.operator
            assert operator is not None and operator.id == page_name(built)


def test_a_page_that_left_while_another_was_drawn_is_not_drawn_for_the_next_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = list[str]()
    with served_arm(tmp_path, "abaas") as served, RawPage(served.app.server.get_port()) as stays:
        stays.operate()
        (first,) = served.app._pages.values()
        with RawPage(served.app.server.get_port()) as leaves:
            leaves.operate()
            (_, second) = served.app._pages.values()

            async def refresh() -> None:
                monkeypatch.setattr(first, "see", lambda _: (asked.append("first"), second.session.close()))
                monkeypatch.setattr(second, "see", lambda _: asked.append("second"))
                await served.app._refresh_pages()
                monkeypatch.undo()

            asyncio.run_coroutine_threadsafe(refresh(), served.app.server.get_event_loop()).result(PATIENCE_S)
    assert set(asked) == {"first"}


@pytest.mark.parametrize("where", [1e9, math.nan, math.inf])
@pytest.mark.parametrize("follows", ["the twin follows", "THE ARM follows"])
def test_a_target_out_of_this_world_ends_the_live_target(
    tmp_path: Path, follows: str, where: float, caplog: pytest.LogCaptureFixture
) -> None:
    with served_arm(tmp_path) as served, RawPage(served.app.server.get_port()) as page:
        page.operate()
        (client,) = served.app.server.get_clients().values()
        handles = client.gui._gui_input_handle_from_uuid.values()
        (switch,) = (handle for handle in handles if getattr(handle, "label", "") == "Live target")
        page.set(uuid_of(switch), follows)
        target = {"name": "/live_target", "wxyz": (1, 0, 0, 0), "position": (where, 0, 0)}
        page.say("TransformControlsUpdateMessage", **target, owner=str(client.client_id))
        page.read_until(b"Live target is off")
        assert switch.value == "off"
        np.testing.assert_allclose(served.now.q_command, served.robot.pose("home"), rtol=0, atol=1e-9)
    assert [record.getMessage() for record in caplog.records if record.levelno >= logging.ERROR] == []


@pytest.mark.logs_a_defect
def test_what_a_page_does_beside_its_callbacks_is_logged_when_it_fails(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def fail() -> None:
        raise ValueError("defect")

    async def spawn() -> None:
        for work in (fail(), asyncio.sleep(60)):
            session.spawn(work)
        for _ in range(3):
            await asyncio.sleep(0)
        session.close()

    with served_arm(tmp_path) as served, RawPage(served.app.server.get_port()) as page:
        page.operate()
        (session,) = (page.session for page in served.app._pages.values())
        asyncio.run_coroutine_threadsafe(spawn(), served.app.server.get_event_loop()).result(PATIENCE_S)
    ours = [record for record in caplog.records if record.name.startswith("armctl")]
    errors = [record for record in ours if record.levelno >= logging.ERROR]
    assert [(record.name, record.getMessage()) for record in errors] == [
        ("armctl.ui", "a page's task failed")
    ]


@pytest.mark.parametrize(
    ("text", "window"),
    [("1920 1080", (1920, 1080)), ("1280 0", (1280, 1)), ("", None), ("1280", None), ("1 -2", None)],
)
def test_a_page_says_how_large_its_window_is(text: str, window: tuple[int, int] | None) -> None:
    assert pages.window_of(text) == window
    assert pages.window_of("9" * 5000 + " 9") is None


def test_what_was_unfolded_stays_so_where_the_page_says_its_size_late(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def said() -> list[int]:
        anew: list[int] = []
        monkeypatch.setattr(page, "_lay_out", lambda: anew.append(page._window[0]))
        for window in ("390 844", "390 800", "414 800", "1280 800", "1290 700"):

            async def recall(_: str, window: str = window) -> str:
                return window

            monkeypatch.setattr(page.session, "recall", recall)
            await page._fit()
        return anew

    with served_arm(tmp_path) as served, RawPage(served.app.server.get_port()) as raw:
        raw.operate()
        (page,) = served.app._pages.values()
        loop = served.app.server.get_event_loop()
        assert asyncio.run_coroutine_threadsafe(said(), loop).result(PATIENCE_S) == [390, 1280]
