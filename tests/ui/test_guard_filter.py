"""What a page may send: judged frame by frame, without a server."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
import viser
from hypothesis import given
from hypothesis import strategies as st
from tests.ui.guard_kit import CAMERA
from viser._messages import FileTransferPart, FileTransferStartUpload

from armctl.ui.guard.filter import (
    MAX_UPLOAD_BYTES,
    UPLOAD_PART_BYTES,
    FloodGauge,
    FrameFilter,
    Tally,
    UploadLedger,
)

UUID = "3f0e1d9c-0000-4000-8000-000000000000"
IDS = {"source_component_uuid": "upload", "transfer_uuid": "t"}
GOOD: dict[str, dict[str, Any]] = {
    "ViewerCameraMessage": CAMERA,
    "GuiUpdateMessage": {"uuid": UUID, "updates": {"value": 12.5}},
    "GuiButtonHoldMessage": {"uuid": UUID, "frequency": 10},
    "CommandTriggerMessage": {"uuid": UUID},
    "TransformControlsUpdateMessage": {"name": "/target", "wxyz": (1, 0, 0, 0), "position": (0, 0, 1.5)},
    "TransformControlsDragStartMessage": {"name": "/target"},
    "TransformControlsDragEndMessage": {"name": "/target"},
    "SceneNodeClickMessage": {
        "name": "/points",
        "instance_index": 3,
        "ray_origin": (0, 0, 0),
        "ray_direction": (0, 0, 1),
        "screen_pos": (0.5, 0.5),
        "modifier": None,
    },
    "GetRenderResponseMessage": {"payload": b"png", "render_uuid": UUID},
    "LocalStorageGetItemResponseMessage": {"value": None, "error": None, "request_uuid": UUID},
    "FileTransferStartUpload": {
        **IDS,
        "filename": "pick and place.toml",
        "mime_type": "",
        "part_count": 1,
        "size_bytes": 10,
    },
}


class Clock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


class Page:
    """One connection's filter, and what it did."""

    def __init__(self) -> None:
        self.tally = Tally()
        self.tally.open()
        self.notices: list[str] = []
        self.controls: dict[str, object] = {"upload": object.__new__(viser.GuiUploadButtonHandle)}
        gui = SimpleNamespace(
            _gui_input_handle_from_uuid=self.controls,
            _websock_interface=SimpleNamespace(queue_message=lambda message: None),
        )
        client: Any = SimpleNamespace(
            gui=gui, add_notification=lambda title, text, **_: self.notices.append(text)
        )
        self.filter = FrameFilter(self.tally, Clock(), lambda: client)

    def admits(self, kind: str, **fields: object) -> bool:
        return self.filter.admits(frame(kind, **fields))


def frame(kind: str, **fields: object) -> bytes:
    return msgspec.msgpack.encode({"type": kind, **fields})


@pytest.fixture
def page() -> Page:
    return Page()


@pytest.mark.parametrize("kind", GOOD)
def test_what_the_page_of_armctl_sends_is_admitted(page: Page, kind: str) -> None:
    assert page.admits(kind, **GOOD[kind])
    assert page.tally.counts == {}


@pytest.mark.parametrize("kind", GOOD)
def test_a_missing_or_an_unknown_field_is_refused(page: Page, kind: str) -> None:
    for name in GOOD[kind]:
        assert not page.admits(kind, **{k: v for k, v in GOOD[kind].items() if k != name})
    assert not page.admits(kind, **GOOD[kind], surplus=1)


@pytest.mark.parametrize(
    "kind",
    [
        "ShareUrlRequest",
        "ShareUrlDisconnect",
        "SceneNodeDragMessage",
        "GuiFormDirtyMessage",
        "GuiRemoveMessage",
        "FileTransferPartAck",
        "ResetGuiMessage",
        "Message",
        "",
    ],
)
def test_other_messages_are_refused(page: Page, kind: str) -> None:
    assert not page.admits(kind)
    assert not page.admits(kind, uuid=UUID)


@pytest.mark.parametrize(
    "updates",
    [
        {},
        {"update_cb": []},
        {"value": 1, "update_cb": []},
        {"removed": True},
        {"props": None},
        "value",
        {"value": math.nan},
        {"value": [1.0, math.inf]},
        {"value": "x" * 4097},
        {"value": "1" * 100_000},
        {"value": ["x"] * (64 << 10)},
    ],
)
def test_only_a_finite_value_of_some_size_can_be_set(page: Page, updates: object) -> None:
    assert not page.admits("GuiUpdateMessage", uuid=UUID, updates=updates)


@pytest.mark.parametrize("value", [True, 5, -2.5, "text", "", (1, 2.5), (255, 0, 0, 255)])
def test_a_plain_value_is_admitted(page: Page, value: object) -> None:
    assert page.admits("GuiUpdateMessage", uuid=UUID, updates={"value": value})


def test_a_choice_is_one_that_is_offered(page: Page) -> None:
    page.controls["list"] = SimpleNamespace(options=("uzuner", "mico"))
    for value, offered in (("mico", True), ("scorbot", False), (0, False), ([], False)):
        assert page.admits("GuiUpdateMessage", uuid="list", updates={"value": value}) is offered


def test_an_upload_goes_to_an_upload_button_only(page: Page) -> None:
    page.controls["upload"] = SimpleNamespace(options=("uzuner", "mico"))
    assert not page.admits("FileTransferStartUpload", **GOOD["FileTransferStartUpload"])


def test_a_camera_looks_from_a_finite_place(page: Page) -> None:
    assert not page.admits("ViewerCameraMessage", **{**CAMERA, "position": (math.nan, 0, 0)})


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        ("ViewerCameraMessage", "position", "x"),
        ("ViewerCameraMessage", "position", "123"),
        ("ViewerCameraMessage", "wxyz", (1, 0, 0)),
        ("ViewerCameraMessage", "fov", "1.3"),
        ("ViewerCameraMessage", "fov", True),
        ("ViewerCameraMessage", "image_height", "800"),
        ("TransformControlsUpdateMessage", "position", [1, 2]),
        ("TransformControlsUpdateMessage", "position", (1, 2, "3")),
        ("TransformControlsUpdateMessage", "wxyz", None),
        ("TransformControlsUpdateMessage", "name", 7),
        ("SceneNodeClickMessage", "ray_origin", (0, 0)),
        ("SceneNodeClickMessage", "screen_pos", {}),
        ("SceneNodeClickMessage", "instance_index", "3"),
        ("SceneNodeClickMessage", "modifier", 1),
        ("GuiButtonHoldMessage", "frequency", "10"),
        ("FileTransferStartUpload", "part_count", True),
        ("FileTransferStartUpload", "size_bytes", "10"),
        ("FileTransferStartUpload", "filename", b"a.toml"),
    ],
)
def test_a_field_of_another_type_or_shape_is_refused(
    page: Page, kind: str, field: str, value: object
) -> None:
    assert not page.admits(kind, **{**GOOD[kind], field: value})
    assert page.tally.counts == {"no message of a page": 1}
    assert page.admits(kind, **GOOD[kind])


@pytest.mark.parametrize(
    ("field", "value"),
    [("content", "0123456789"), ("content", [0] * 10), ("content", None), ("part_index", False)],
)
def test_a_part_is_bytes_with_a_whole_number(page: Page, field: str, value: object) -> None:
    part = {**IDS, "part_index": 0, "content": b"0123456789"}
    assert page.admits("FileTransferStartUpload", **GOOD["FileTransferStartUpload"])
    assert not page.admits("FileTransferPart", **{**part, field: value})
    assert page.admits("FileTransferPart", **part)


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text() | st.binary(),
    lambda inner: (
        st.lists(inner, max_size=5) | st.dictionaries(st.text() | st.integers(0, 9), inner, max_size=5)
    ),
    max_leaves=20,
)


@given(st.lists(st.binary() | st.text() | ANYTHING.map(msgspec.msgpack.encode), max_size=20))
def test_no_frame_raises(frames: list[str | bytes]) -> None:
    page = Page()
    for raw in frames:
        assert not page.filter.admits(raw)


@given(st.sampled_from(sorted({**GOOD, "FileTransferPart": {}})), st.data())
def test_one_field_replaced_by_anything_never_raises(kind: str, data: st.DataObject) -> None:
    page, good = Page(), {**GOOD, "FileTransferPart": {**IDS, "part_index": 0, "content": b"0123456789"}}
    page.admits("FileTransferStartUpload", **GOOD["FileTransferStartUpload"])
    name = data.draw(st.sampled_from(sorted(good[kind])))
    page.admits(kind, **{**good[kind], name: data.draw(ANYTHING)})


@given(st.sampled_from(sorted(GOOD)), st.data())
def test_a_damaged_frame_never_raises(kind: str, data: st.DataObject) -> None:
    raw = bytearray(frame(kind, **GOOD[kind]))
    for index in data.draw(st.lists(st.integers(0, len(raw) - 1), max_size=4)):
        raw[index] = data.draw(st.integers(0, 255))
    Page().filter.admits(bytes(raw[: data.draw(st.integers(0, len(raw)))]))


def test_a_flood_ends_it_for_good(page: Page) -> None:
    for _ in range(1000):
        page.filter.admits(b"garbage")
    assert page.filter.flooded
    assert not page.admits("ViewerCameraMessage", **CAMERA)
    assert page.tally.counts["too many messages"] == 1
    assert page.tally.counts["no message of a page"] < 200


def test_a_busy_page_is_no_flood() -> None:
    clock = Clock()
    gauge = FloodGauge(clock)
    for _ in range(60 * 200):
        clock.now_s += 1 / 200
        assert gauge.charge(120, refused=False)


def test_an_upload_of_the_largest_file_is_no_flood() -> None:
    gauge = FloodGauge(Clock())
    assert all(gauge.charge(512 << 10, refused=False) for _ in range(16))


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


def test_a_file_that_is_too_large_is_told_once_and_is_no_flood(page: Page) -> None:
    count = 600  # 300 MB, by somebody who took a film for a program
    start = {"filename": "film.mp4", "mime_type": "", "part_count": count, "size_bytes": count << 19}
    assert not page.admits("FileTransferStartUpload", **IDS, **start)
    part = frame("FileTransferPart", **IDS, part_index=0, content=b"." * (512 << 10))
    for _ in range(count):
        assert not page.filter.admits(part)
    assert not page.filter.flooded
    assert [text.split(", the")[0] for text in page.notices] == ["film.mp4 was not taken: it has 300.0 MiB"]
    assert page.tally.counts == {"an upload that is too large": 1}
    for _ in range(100):  # more than was announced
        page.filter.admits(part)
    assert page.filter.flooded


def start(size: int, parts: int, *, transfer: str = "t") -> FileTransferStartUpload:
    return FileTransferStartUpload("button", transfer, "a.toml", "", parts, size)


def part(index: int, size: int, *, transfer: str = "t") -> FileTransferPart:
    return FileTransferPart("button", transfer, index, b"." * size)


def test_parts_may_come_in_any_order_each_once() -> None:
    ledger = UploadLedger()
    assert ledger.starts(start(UPLOAD_PART_BYTES + 5, 2))
    assert ledger.continues(part(1, 5))
    assert ledger.continues(part(0, UPLOAD_PART_BYTES))
    assert not ledger.continues(part(0, UPLOAD_PART_BYTES))


@pytest.mark.parametrize(
    "wrong", [part(0, UPLOAD_PART_BYTES + 1), part(1, 5), part(-1, 5), part(0, 5, transfer="u")]
)
def test_a_part_is_one_that_was_announced(wrong: FileTransferPart) -> None:
    ledger = UploadLedger()
    assert not ledger.continues(wrong)
    assert ledger.starts(start(5, 1))
    assert not ledger.continues(wrong)
    assert ledger.continues(part(0, 5))


@pytest.mark.parametrize(
    ("size", "parts"), [(5, 0), (5, 2), (0, 1), (UPLOAD_PART_BYTES + 1, 1), (-UPLOAD_PART_BYTES, -1)]
)
def test_size_and_count_of_parts_agree(size: int, parts: int) -> None:
    assert not UploadLedger().starts(start(size, parts))


def test_two_transfers_at_once_are_enough() -> None:
    ledger = UploadLedger()
    assert ledger.starts(start(5, 1, transfer="a"))
    assert not ledger.starts(start(5, 1, transfer="a"))
    assert ledger.starts(start(5, 1, transfer="b"))
    assert not ledger.starts(start(5, 1, transfer="c"))
    assert ledger.continues(part(0, 5, transfer="a"))
    assert ledger.starts(start(5, 1, transfer="c"))


def test_an_empty_file_has_no_parts() -> None:
    ledger = UploadLedger()
    assert all(ledger.starts(start(0, 0, transfer=str(n))) for n in range(5))


def test_only_two_files_that_are_too_large_are_remembered() -> None:
    ledger = UploadLedger()
    assert not ledger.is_too_large(start(MAX_UPLOAD_BYTES, 16))
    for transfer in "abc":
        assert ledger.is_too_large(start(MAX_UPLOAD_BYTES + 1, 17, transfer=transfer))
    assert [ledger.is_leftover(part(0, 5, transfer=transfer)) for transfer in "abcd"] == [
        True,
        True,
        False,
        False,
    ]


def test_a_file_of_any_size_announces_a_bounded_number_of_parts() -> None:
    ledger = UploadLedger()
    assert ledger.is_too_large(start(2**63 - 1, 1))
    assert all(ledger.is_leftover(part(0, 5)) for _ in range(ledger.MOST_LEFTOVER_PARTS))
    assert not ledger.is_leftover(part(0, 5))


def test_a_part_that_is_too_long_counts_with_its_size(page: Page) -> None:
    large = {"filename": "film.mp4", "mime_type": "", "part_count": 600, "size_bytes": 600 << 19}
    assert not page.admits("FileTransferStartUpload", **IDS, **large)
    for _ in range(4):
        assert not page.admits("FileTransferPart", **IDS, part_index=0, content=b"." * (15 << 20))
    assert page.filter.flooded


def test_the_log_is_not_flooded(caplog: pytest.LogCaptureFixture, page: Page) -> None:
    for _ in range(250):
        page.tally.refuse("a foreign origin")
    assert [record.getMessage() for record in caplog.records] == [
        "refused: a foreign origin (1 so far)",
        "refused: a foreign origin (10 so far)",
        "refused: a foreign origin (100 so far)",
    ]
