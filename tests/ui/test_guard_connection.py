"""A hostile page against a running server: what it says has no effect, and STOP still works."""

from __future__ import annotations

import contextlib
import gc
import logging
import math
from collections.abc import Iterator

import msgspec
import pytest
import viser
from tests.ui.guard_kit import Bell, RawPage, uuid_of
from websockets.exceptions import ConnectionClosed

from armctl.ui.guard import GuardedServer, guarded_server


@pytest.fixture
def server(capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture) -> Iterator[GuardedServer]:
    caplog.set_level(logging.WARNING)
    server = guarded_server(port=0)
    yield server
    server.stop()
    assert capfd.readouterr() == ("", "")  # neither a banner nor a traceback
    assert {record.name for record in caplog.records} <= {"armctl.ui.guard"}
    assert [record for record in caplog.records if record.exc_info] == []


@pytest.fixture
def stop(server: GuardedServer) -> Bell:
    return Bell(server)


@pytest.fixture
def page(server: GuardedServer) -> Iterator[RawPage]:
    with RawPage(server.get_port()) as page:
        page.introduce()
        yield page


def test_garbage_is_dropped_and_the_connection_stays(
    server: GuardedServer, page: RawPage, stop: Bell
) -> None:
    for raw in (b"", b"\x00", b"\xff" * 100, b"\x91" * 5000, "text", "", msgspec.json.encode({"type": "x"})):
        page.socket.send(raw)
    page.say("GuiUpdateMessage", uuid=stop.uuid, updates={"update_cb": []})
    page.say("ShareUrlRequest")
    page.say("NoSuchMessage")
    stop.ring_from(page)
    assert stop.silent
    assert server.refusals == {
        "no message of a page": 7,
        "setting something else than a value": 1,
        "a message of another type": 2,
    }


def test_a_value_that_a_control_cannot_take_is_refused(
    server: GuardedServer, page: RawPage, stop: Bell
) -> None:
    number = server.gui.add_number("x", initial_value=2)
    for uuid, value in ((uuid_of(number), "abc"), (uuid_of(number), (1, 2)), ("nobody", 1), (["a"], 1)):
        page.set(uuid, value)
    page.set(uuid_of(number), math.nan)
    stop.ring_from(page)
    gc.collect()  # the exception of a task that nobody asks is reported when the task goes
    assert number.value == 2
    assert server.refusals == {
        "a value that viser cannot take": 3,
        "no message of a page": 1,
    }


def test_a_list_takes_what_it_offers_and_a_slider_what_it_has_and_a_field_holds_its_type(
    server: GuardedServer, page: RawPage, stop: Bell
) -> None:
    gui = stop.gui_of(page)
    number = gui.add_number("number", initial_value=2.0, min=0.0, max=10.0)
    slider = gui.add_slider("slider", min=-90.0, max=90.0, step=0.1, initial_value=0.0)
    choice = gui.add_dropdown("choice", ("uzuner", "mico"))
    text = gui.add_text("text", initial_value="pick")
    tick = gui.add_checkbox("tick", initial_value=False)
    button = gui.add_upload_button("load")
    refused = ((slider, ("45", 90.2, -91, None)), (choice, ("scorbot", 1, None)))
    failing = ((number, ("abc", (1, 2), None)), (button, ("file", True, 1)))
    for handle, values in (*refused, *failing):
        for value in values:
            page.set(uuid_of(handle), value)
    stop.ring_from(page)
    gc.collect()  # the exception of a task that nobody asks is reported when the task goes
    assert server.refusals == {"a value that the control cannot take": 7, "a value that viser cannot take": 6}
    assert (number.value, slider.value, choice.value) == (2.0, 0.0, "uzuner")
    taken = (
        (number, 900, 900.0),
        (slider, 90, 90.0),
        (choice, "mico", "mico"),
        (text, 5, "5"),
        (tick, "x", True),
    )
    for handle, value, _ in taken:
        page.set(uuid_of(handle), value)
    stop.ring_from(page)
    assert [handle.value for handle, _, _ in taken] == [value for _, _, value in taken]


def test_a_page_cannot_reach_the_controls_of_another(
    server: GuardedServer, page: RawPage, stop: Bell
) -> None:
    number = stop.gui_of(page).add_number("x", initial_value=1.0)
    with RawPage(server.get_port()) as other:
        other.introduce()
        other.set(uuid_of(number), 5.0)
        stop.ring_from(other)
        assert number.value == 1.0
    page.set(uuid_of(number), 6.0)
    stop.ring_from(page)
    assert number.value == 6.0


def test_an_upload_arrives_whole_or_not_at_all(server: GuardedServer, page: RawPage, stop: Bell) -> None:
    button = stop.gui_of(page).add_upload_button("load")
    uploaded = Bell(server, "uploaded")

    @button.on_upload
    async def _(event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
        uploaded.ring(event.client_id)

    def send(transfer: str, size: int, content: bytes) -> None:
        ids = {"source_component_uuid": uuid_of(button), "transfer_uuid": transfer}
        page.say(
            "FileTransferStartUpload", **ids, filename="a.toml", mime_type="", part_count=1, size_bytes=size
        )
        page.say("FileTransferPart", **ids, part_index=0, content=content)

    send("1", 9 << 20, b"abc")
    page.read_until(b"a.toml was not taken: it has 9.0 MiB")
    stop.ring_from(page)
    assert uploaded.silent
    send("2", 3, b"abc")
    uploaded.wait()
    assert (button.value.name, button.value.content) == ("a.toml", b"abc")


def test_a_page_that_floods_or_sends_too_large_or_broken_frames_is_disconnected_alone(
    server: GuardedServer, page: RawPage, stop: Bell
) -> None:
    def how_it_ends(raw: bytes, count: int = 1, *, text: bool | None = None) -> tuple[int, str]:
        with RawPage(server.get_port()) as other:
            other.introduce()
            with contextlib.suppress(ConnectionClosed):  # the server need not wait for the end of a frame
                for _ in range(count):
                    other.socket.send(raw, text=text)
            end = other.read_to_the_end().rcvd
            assert end is not None
            return end.code, end.reason

    assert how_it_ends(b"garbage", 100_000) == (1008, "too many messages")
    assert how_it_ends(b"\x00" * (17 << 20))[0] == 1009
    assert how_it_ends(b"\xff\xfe", text=True)[0] == 1007
    stop.ring_from(page)


def test_another_version_of_the_page_is_turned_away(server: GuardedServer) -> None:
    with RawPage(server.get_port(), version="0.9") as old:
        assert "Version mismatch" in str(old.read_to_the_end())
