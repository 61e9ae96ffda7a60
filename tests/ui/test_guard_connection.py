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
    number = server.gui.add_number("x", initial_value=2.0)
    for uuid, value in ((uuid_of(number), "abc"), (uuid_of(number), (1, 2)), ("nobody", 1), (["a"], 1)):
        page.set(uuid, value)
    page.set(uuid_of(number), math.nan)
    stop.ring_from(page)
    gc.collect()  # the exception of a task that nobody asks is reported when the task goes
    assert number.value == 2.0
    assert server.refusals == {
        "a number that is not finite": 1,
        "a value that viser cannot take": 2,
        "no message of a page": 1,
    }


def test_a_control_takes_a_value_of_its_type_and_a_slider_one_within_its_range(
    server: GuardedServer, page: RawPage, stop: Bell
) -> None:
    gui = stop.gui_of(page)
    number = gui.add_number("number", initial_value=2.0, min=0.0, max=10.0)
    slider = gui.add_slider("slider", min=-90.0, max=90.0, step=0.1, initial_value=0.0)
    several = gui.add_multi_slider("several", min=0, max=10, step=1, initial_value=(2, 8))
    text = gui.add_text("text", initial_value="pick")
    tick = gui.add_checkbox("tick", initial_value=False)
    vector = gui.add_vector3("vector", initial_value=(1.0, 2.0, 3.0))
    button = gui.add_upload_button("load")
    refused = (
        (number, ("nan", True, (1, 2), None)),
        (slider, ("45", 90.2, -91, True)),
        (several, (5, (5, 11), (-1, 5), (1, 2, 3), "15")),
        (text, (1, True, ("a",), "x" * 4097)),
        (tick, (1, "True", None)),
        (vector, ((1, 2), "abc", (1, 2, "3"), (True, 1, 2), 1)),
        (button, ("file", True, 1)),
    )
    for handle, values in refused:
        for value in values:
            page.set(uuid_of(handle), value)
    stop.ring_from(page)
    assert server.refusals == {"a value that the control cannot take": sum(len(v) for _, v in refused)}
    assert (number.value, slider.value, several.value, tick.value) == (2.0, 0.0, (2, 8), False)
    assert (text.value, vector.value) == ("pick", (1.0, 2.0, 3.0))
    taken = (
        (number, 900),  # the screen says that it is outside
        (slider, 90),
        (several, (0, 10)),
        (text, "x" * 4096),
        (tick, True),
        (vector, (4, 5.5, 6)),
    )
    for handle, value in taken:
        page.set(uuid_of(handle), value)
    stop.ring_from(page)
    assert [handle.value for handle, _ in taken] == [value for _, value in taken]


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
