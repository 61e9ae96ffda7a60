"""A hostile page against a running server: what it says has no effect, and STOP still works."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator

import msgspec
import pytest
import viser
from tests.ui.guard_kit import CAMERA, Bell, RawPage, uuid_of
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


def test_a_good_click_arrives(page: RawPage, stop: Bell) -> None:
    stop.press(page)
    assert stop.wait() >= 0


def test_callbacks_cannot_be_removed(server: GuardedServer, page: RawPage, stop: Bell) -> None:
    for updates in (
        {"update_cb": []},
        {"value": True, "update_cb": []},
        {"removed": True},
        {"is_button": False},
    ):
        page.say("GuiUpdateMessage", uuid=stop.uuid, updates=updates)
    stop.press(page)
    assert stop.wait() >= 0
    assert server.refusals == {"not an admissible message": 4}


def test_garbage_is_dropped_and_the_connection_stays(
    server: GuardedServer, page: RawPage, stop: Bell
) -> None:
    for raw in (b"", b"\x00", b"\xff" * 100, b"\x91" * 5000, "text", "", msgspec.json.encode({"type": "x"})):
        page.socket.send(raw)
    page.say("ShareUrlRequest")
    page.say("NoSuchMessage")
    page.say("GuiUpdateMessage", uuid=["a"], updates={"value": 1})
    stop.press(page)
    assert stop.wait() >= 0
    assert stop.silent
    assert server.refusals == {"not an admissible message": 10}


def test_broken_utf8_closes_that_connection_alone(server: GuardedServer, page: RawPage, stop: Bell) -> None:
    with RawPage(server.get_port()) as other:
        other.introduce()
        other.socket.send(b"\xff\xfe", text=True)
        other.read_to_the_end()
    stop.press(page)
    assert stop.wait() >= 0


def test_values_that_a_control_cannot_take_have_no_effect(
    server: GuardedServer, page: RawPage, stop: Bell
) -> None:
    slider = server.gui.add_slider("joint", min=-90.0, max=84.36, step=0.01, initial_value=1.0)
    number = server.gui.add_number("x", initial_value=2.0)
    robots = server.gui.add_dropdown("robot", ("uzuner", "mico"))
    box = server.gui.add_checkbox("loop", initial_value=False)
    bar = server.gui.add_progress_bar(10.0)
    upload = server.gui.add_upload_button("load")
    for handle, value in (
        (slider, 85.0),
        (slider, float("nan")),
        (slider, "1"),
        (number, float("inf")),
        (number, "abc"),
        (number, (1, 2)),
        (number, True),
        (robots, "scorbot"),
        (box, "yes"),
        (bar, 50.0),
        (upload, "x"),
    ):
        page.set(uuid_of(handle), value)
    page.set("no-such-control", 1)
    stop.press(page)
    stop.wait()
    assert (slider.value, number.value, robots.value, box.value, bar.value) == (
        1.0,
        2.0,
        "uzuner",
        False,
        10.0,
    )
    assert sum(server.refusals.values()) == 12
    page.set(uuid_of(slider), 84.36)
    page.set(uuid_of(number), 7)
    page.set(uuid_of(robots), "mico")
    page.set(uuid_of(box), True)
    stop.press(page)
    stop.wait()
    assert (slider.value, number.value, robots.value, box.value) == (84.36, 7.0, "mico", True)


def test_disabled_and_hidden_controls_do_not_work(server: GuardedServer, page: RawPage, stop: Bell) -> None:
    held: list[int | None] = []
    go = Bell(server, "GO")

    @go.handle.on_hold(callback_hz=10.0)
    async def _(event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
        held.append(event.client_id)

    for go.handle.disabled, go.handle.visible in ((True, True), (False, False), (False, True)):
        go.press(page)
        page.say("GuiButtonHoldMessage", uuid=go.uuid, frequency=10.0)
        page.say("GuiButtonHoldMessage", uuid=stop.uuid, frequency=9.0)
        stop.press(page)
        stop.wait()
    assert go.wait() >= 0
    assert go.silent
    assert len(held) == 1
    assert server.refusals == {
        "a control that is disabled or hidden": 2,
        "holding what is no usable button": 2,
    }


def test_a_page_cannot_reach_the_controls_of_another(
    server: GuardedServer, page: RawPage, stop: Bell
) -> None:
    stop.press(page)
    page_id = stop.wait()
    mine = server.get_clients()[page_id]
    number = mine.gui.add_number("x", initial_value=1.0)
    with RawPage(server.get_port()) as other:
        other.introduce()
        other.set(uuid_of(number), 5.0)
        stop.press(other)
        stop.wait()
        assert number.value == 1.0
        assert server.refusals == {"a control that does not exist": 1}
    page.set(uuid_of(number), 6.0)
    stop.press(page)
    stop.wait()
    assert number.value == 6.0


def test_nothing_counts_before_the_page_introduced_itself(server: GuardedServer, stop: Bell) -> None:
    box = server.gui.add_checkbox("loop", initial_value=False)
    with RawPage(server.get_port()) as page:
        page.set(uuid_of(box), True)
        page.introduce()
        stop.press(page)
        stop.wait()
        assert box.value is False


def test_a_hostile_camera_is_dropped(server: GuardedServer, page: RawPage, stop: Bell) -> None:
    for wrong in (
        {"position": (float("nan"), 0, 0)},
        {"wxyz": (1, 0, 0)},
        {"wxyz": (1e9, 0, 0, 0)},
        {"image_height": 10**9},
        {"fov": -1},
        {"look_at": "abc"},
        {"extra": 1},
    ):
        page.say("ViewerCameraMessage", **{**CAMERA, **wrong})
    stop.press(page)
    page_id = stop.wait()
    client = server.get_clients()[page_id]
    assert client.camera.position.tolist() == [1.0, 2.5, 3.0]
    assert server.refusals == {"not an admissible message": 7}


def test_an_upload_goes_to_an_upload_button_only(server: GuardedServer, page: RawPage, stop: Bell) -> None:
    number = server.gui.add_number("x", initial_value=2.0)
    button = server.gui.add_upload_button("load")
    uploaded = Bell(server, "uploaded")

    @button.on_upload
    async def _(event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
        uploaded.ring(event.client_id)

    def send(handle: object, transfer: str, size: int, content: bytes) -> None:
        ids = {"source_component_uuid": uuid_of(handle), "transfer_uuid": transfer}
        page.say(
            "FileTransferStartUpload", **ids, filename="a.toml", mime_type="", part_count=1, size_bytes=size
        )
        page.say("FileTransferPart", **ids, part_index=0, content=content)

    send(number, "1", 3, b"abc")
    send(button, "2", 9 << 20, b"abc")
    send(button, "3", 3, b"abcd")
    stop.press(page)
    stop.wait()
    assert number.value == 2.0
    assert uploaded.silent
    send(button, "4", 3, b"abc")
    uploaded.wait()
    assert (button.value.name, button.value.content) == ("a.toml", b"abc")


def test_a_form_that_does_not_exist_is_not_announced_to_others(
    server: GuardedServer, page: RawPage, stop: Bell
) -> None:
    form = server.gui.add_form("f")
    page.say("GuiFormDirtyMessage", uuid="made-up")
    page.say("GuiFormSubmitMessage", uuid="made-up")
    page.say("GuiFormSubmitMessage", uuid=uuid_of(form))
    stop.press(page)
    stop.wait()
    assert server.refusals == {"a form that does not exist": 2}


def test_a_flooding_page_is_disconnected_and_others_are_not(
    server: GuardedServer, page: RawPage, stop: Bell
) -> None:
    with RawPage(server.get_port()) as other:
        with pytest.raises(ConnectionClosed):
            for _ in range(100_000):
                other.socket.send(b"garbage")
        end = other.read_to_the_end()
        assert end.rcvd is not None
        assert (end.rcvd.code, end.rcvd.reason) == (1008, "too many messages")
    stop.press(page)
    assert stop.wait() >= 0


def test_a_frame_that_is_too_large_closes_that_connection(
    server: GuardedServer, page: RawPage, stop: Bell
) -> None:
    with RawPage(server.get_port()) as other:
        with contextlib.suppress(ConnectionClosed):  # the server need not wait for the end of the frame
            other.socket.send(b"\x00" * (17 << 20))
        end = other.read_to_the_end()
        assert end.rcvd is not None
        assert end.rcvd.code == 1009
    stop.press(page)
    assert stop.wait() >= 0


def test_another_version_of_the_page_is_turned_away(server: GuardedServer) -> None:
    with RawPage(server.get_port(), version="0.9") as old:
        assert "Version mismatch" in str(old.read_to_the_end())
