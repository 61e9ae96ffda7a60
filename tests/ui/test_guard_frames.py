from __future__ import annotations

from typing import Any

import msgspec
import pytest
import viser
from hypothesis import given
from hypothesis import strategies as st
from tests.ui.guard_kit import CAMERA

from armctl.ui.guard import GuardedServer
from armctl.ui.guard.filter import FloodGauge, FrameFilter, Operable, Tally
from armctl.ui.guard.messages import UploadStart


class Clock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


class NoControls:
    def control(self, uuid: str) -> Operable | None:
        return None

    def has_form(self, uuid: str) -> bool:
        return uuid == "form"

    def has_command(self, uuid: str) -> bool:
        return uuid == "key"

    def refuse_upload(self, upload: UploadStart) -> None:
        raise AssertionError("there is no upload button")


def frame(kind: str, **fields: Any) -> bytes:
    return msgspec.msgpack.encode({"type": kind, **fields})


@pytest.fixture
def tally() -> Tally:
    tally = Tally()
    tally.open()
    return tally


@pytest.fixture
def page(tally: Tally) -> FrameFilter:
    page = FrameFilter(NoControls(), tally, Clock())
    assert page.admits(frame("ViewerCameraMessage", **CAMERA))
    return page


def test_a_page_introduces_itself_first(tally: Tally) -> None:
    page = FrameFilter(NoControls(), tally, Clock())
    assert not page.admits(frame("CommandTriggerMessage", uuid="key"))
    assert page.admits(frame("ViewerCameraMessage", **CAMERA))
    assert page.admits(frame("CommandTriggerMessage", uuid="key"))
    assert tally.counts == {"a message before the page introduced itself": 1}


def test_messages_to_nothing_are_refused(page: FrameFilter, tally: Tally) -> None:
    assert not page.admits(frame("GuiUpdateMessage", uuid="u", updates={"value": True}))
    assert not page.admits(frame("GuiButtonHoldMessage", uuid="u", frequency=10))
    assert not page.admits(frame("GuiFormDirtyMessage", uuid="u"))
    assert page.admits(frame("GuiFormDirtyMessage", uuid="form"))
    assert not page.admits(frame("CommandTriggerMessage", uuid="u"))
    start = {"source_component_uuid": "u", "transfer_uuid": "t", "filename": "a", "mime_type": ""}
    assert not page.admits(frame("FileTransferStartUpload", **start, part_count=1, size_bytes=1))
    part = {"source_component_uuid": "u", "transfer_uuid": "t", "part_index": 0, "content": b"1"}
    assert not page.admits(frame("FileTransferPart", **part))
    assert tally.counts == {
        "a control that does not exist": 1,
        "holding what is no usable button": 1,
        "a form that does not exist": 1,
        "a command that does not exist": 1,
        "an upload to what is no usable upload button": 1,
        "a part of no upload under way": 1,
    }


@given(st.lists(st.binary() | st.text(), max_size=20))
def test_the_filter_never_raises(frames: list[str | bytes]) -> None:
    page = FrameFilter(NoControls(), Tally(), Clock())
    for raw in frames:
        page.admits(raw)


def test_a_flood_ends_it_for_good(page: FrameFilter, tally: Tally) -> None:
    for _ in range(1000):
        page.admits(b"garbage")
    assert page.flooded
    assert not page.admits(frame("ViewerCameraMessage", **CAMERA))
    assert tally.counts["too many messages"] == 1
    assert tally.counts["not an admissible message"] < 200


def test_a_busy_page_is_no_flood() -> None:
    clock = Clock()
    gauge = FloodGauge(clock)
    for _ in range(60 * 200):
        clock.now_s += 1 / 200
        assert gauge.charge(120, refused=False)


def test_an_upload_of_the_largest_file_is_no_flood() -> None:
    gauge = FloodGauge(Clock())
    assert all(gauge.charge(512 << 10, refused=False) for _ in range(16))


class UploadButton(NoControls):
    """Addressees with an upload button, which notes what is refused."""

    def __init__(self, server: viser.ViserServer) -> None:
        self.button = server.gui.add_upload_button("load")
        self.refused: list[str] = []

    def control(self, uuid: str) -> Operable | None:
        return self.button

    def refuse_upload(self, upload: UploadStart) -> None:
        self.refused.append(upload.filename)


def test_a_file_that_is_too_large_is_told_once_and_is_no_flood(server: GuardedServer, tally: Tally) -> None:
    addressees = UploadButton(server)
    page = FrameFilter(addressees, tally, Clock())
    assert page.admits(frame("ViewerCameraMessage", **CAMERA))
    ids = {"source_component_uuid": "u", "transfer_uuid": "t"}
    count = 600  # 300 MB, by somebody who took a film for a program
    named = {"filename": "film.mp4", "mime_type": ""}
    start = frame("FileTransferStartUpload", **ids, **named, part_count=count, size_bytes=count << 19)
    assert not page.admits(start)
    part = frame("FileTransferPart", **ids, part_index=0, content=b"." * (512 << 10))
    for _ in range(count):
        assert not page.admits(part)
    assert not page.flooded
    assert addressees.refused == ["film.mp4"]
    assert tally.counts == {"an upload that is too large": 1}
    for _ in range(100):  # more than was announced
        page.admits(part)
    assert page.flooded


def test_the_allowance_comes_back_with_time_but_does_not_pile_up() -> None:
    clock = Clock()
    gauge = FloodGauge(clock)
    while gauge.charge(0, refused=True):
        pass
    clock.now_s += 3600.0
    count = 0
    while gauge.charge(0, refused=True):
        count += 1
    assert 150 < count < 200


def test_the_log_is_not_flooded(caplog: pytest.LogCaptureFixture, tally: Tally) -> None:
    for _ in range(250):
        tally.refuse("a foreign origin")
    assert [record.getMessage() for record in caplog.records] == [
        "refused: a foreign origin (1 so far)",
        "refused: a foreign origin (10 so far)",
        "refused: a foreign origin (100 so far)",
    ]
