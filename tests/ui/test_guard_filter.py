"""What a page may send: judged frame by frame, without a server."""

from __future__ import annotations

import math
import os
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
import viser
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.ui.guard_kit import CAMERA
from viser._messages import FileTransferPart, FileTransferStartUpload

from armctl.ui.guard import GuardedServer
from armctl.ui.guard.filter import (
    MAX_ARM_BYTES,
    MAX_UPLOAD_BYTES,
    FloodGauge,
    FrameFilter,
    Tally,
    UploadLedger,
)
from armctl.ui.viser_seam import UPLOAD_PART_BYTES

UUID = "3f0e1d9c-0000-4000-8000-000000000000"
IDS = {"source_component_uuid": "upload", "transfer_uuid": "t"}
START: dict[str, Any] = {
    **IDS,
    "filename": "pick and place.toml",
    "mime_type": "",
    "part_count": 1,
    "size_bytes": 10,
}
GOOD: dict[str, dict[str, Any]] = {
    "ViewerCameraMessage": CAMERA,
    "GuiUpdateMessage": {"uuid": UUID, "updates": {"value": 12.5}},
    "GuiButtonHoldMessage": {"uuid": UUID, "frequency": 10},
    "CommandTriggerMessage": {"uuid": UUID},
    "GuiFormSubmitMessage": {"uuid": UUID},
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
    "FileTransferStartUpload": START,
}
PART: dict[str, Any] = {**IDS, "part_index": 0, "content": b"0123456789"}


class Clock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


class UploadButton(viser.GuiUploadButtonHandle):
    visible, disabled, mime_type = True, False, ".toml"

    def __init__(self) -> None:
        """Of no page."""


class Page:
    """One connection's filter, and what it did."""

    def __init__(self) -> None:
        self.tally = Tally()
        self.tally.open()
        self.notices: list[str] = []
        self.controls: dict[str, object] = {"upload": UploadButton()}
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
def test_what_the_page_of_armctl_sends_is_admitted_with_all_its_fields_and_no_more(
    page: Page, kind: str
) -> None:
    assert page.admits(kind, **GOOD[kind])
    assert page.tally.counts == {}
    for name in GOOD[kind]:
        assert not page.admits(kind, **{k: v for k, v in GOOD[kind].items() if k != name})
    assert not page.admits(kind, **GOOD[kind], surplus=1)


def test_viser_keeps_no_marks_of_forms_for_all_pages(page: Page) -> None:
    assert not page.admits("GuiFormDirtyMessage", uuid="x" * 10_000)
    assert page.tally.counts == {}


@pytest.mark.parametrize(
    "kind", ["ShareUrlRequest", "SceneNodeDragMessage", "GuiRemoveMessage", "Message", ""]
)
def test_other_messages_are_refused(page: Page, kind: str) -> None:
    assert not page.admits(kind)
    assert not page.admits(kind, uuid=UUID)
    assert page.tally.counts == {"a message of another type": 2}


@pytest.mark.parametrize(
    ("reason", "wrong"),
    {
        "setting something else than a value": (
            {},
            {"update_cb": []},
            {"value": 1, "update_cb": []},
            {"removed": True},
            {"props": None},
        ),
        "no message of a page": ("value",),
        "a message that is too large": ({"value": "x" * (20 << 10)}, {"value": ["x"] * (64 << 10)}),
    }.items(),
)
def test_only_a_value_of_some_size_can_be_set(page: Page, reason: str, wrong: tuple[object, ...]) -> None:
    assert not any(page.admits("GuiUpdateMessage", uuid=UUID, updates=updates) for updates in wrong)
    assert page.tally.counts == {reason: len(wrong)}


@pytest.mark.parametrize("value", [True, 5, -2.5, "text", "", "🦾" * 4096, (1, 2.5)])
def test_a_plain_value_is_admitted(page: Page, value: object) -> None:
    assert page.admits("GuiUpdateMessage", uuid=UUID, updates={"value": value})


def test_a_choice_is_one_that_is_offered(page: Page) -> None:
    page.controls["list"] = SimpleNamespace(options=("uzuner", "mico"), visible=True, disabled=False)
    for value, offered in (("mico", True), ("scorbot", False), (0, False), ([], False)):
        assert page.admits("GuiUpdateMessage", uuid="list", updates={"value": value}) is offered
    assert not page.admits("FileTransferStartUpload", **{**START, "source_component_uuid": "list"})
    assert page.tally.counts["an upload to what is no upload button"] == 1


@pytest.mark.parametrize(("visible", "disabled"), [(False, False), (True, True)])
def test_a_control_that_is_disabled_or_hidden_takes_nothing(
    page: Page, visible: bool, disabled: bool
) -> None:
    shown = {"visible": visible, "disabled": disabled}
    page.controls["upload"] = page.controls[UUID] = type("Off", (UploadButton,), shown)()
    said = ("GuiUpdateMessage", "GuiButtonHoldMessage", "FileTransferStartUpload")
    assert not any(page.admits(kind, **GOOD[kind]) for kind in said)
    assert page.tally.counts == {"a control that is disabled or hidden": 3}


WRONG: dict[str, dict[str, tuple[object, ...]]] = {
    "ViewerCameraMessage": {
        "position": ("x", "123"),
        "wxyz": ((1, 0, 0),),
        "fov": ("1.3", True),
        "image_height": ("800",),
    },
    "TransformControlsUpdateMessage": {"position": ([1, 2], (1, 2, "3")), "wxyz": (None,), "name": (7,)},
    "SceneNodeClickMessage": {
        "ray_origin": ((0, 0),),
        "screen_pos": ({},),
        "instance_index": ("3",),
        "modifier": (1,),
    },
    "GuiButtonHoldMessage": {"frequency": ("10",)},
    "FileTransferStartUpload": {"part_count": (True,), "size_bytes": ("10",), "filename": (b"a.toml",)},
    "FileTransferPart": {"content": ("0123456789", [0] * 10, None), "part_index": (False,)},
}


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [(kind, field, value) for kind in WRONG for field, values in WRONG[kind].items() for value in values],
)
def test_a_field_of_another_type_or_shape_is_refused(
    page: Page, kind: str, field: str, value: object
) -> None:
    good = GOOD.get(kind, PART)
    if good is PART:
        assert page.admits("FileTransferStartUpload", **START)
    assert not page.admits(kind, **{**good, field: value})
    assert page.tally.counts == {"no message of a page": 1}
    assert page.admits(kind, **good)


def test_a_camera_looks_from_a_finite_place(page: Page) -> None:
    for wrong in ({"position": (math.nan, 0, 0)}, {"fov": math.inf}):
        assert not page.admits("ViewerCameraMessage", **{**CAMERA, **wrong})
    assert page.tally.counts == {"a camera that is nowhere": 2}


EXAMPLES = 100 if os.environ.get("ARMCTL_LONG") else 30
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text() | st.binary(),
    lambda inner: (
        st.lists(inner, max_size=5) | st.dictionaries(st.text() | st.integers(0, 9), inner, max_size=5)
    ),
    max_leaves=20,
)


@settings(max_examples=EXAMPLES)
@given(st.lists(st.binary() | st.text() | ANYTHING.map(msgspec.msgpack.encode), max_size=20))
def test_no_frame_raises(frames: list[str | bytes]) -> None:
    page = Page()
    for raw in frames:
        assert not page.filter.admits(raw)


@settings(max_examples=EXAMPLES)
@given(st.sampled_from([*GOOD, "FileTransferPart"]), st.data())
def test_one_field_replaced_by_anything_or_a_damaged_frame_never_raises(
    kind: str, data: st.DataObject
) -> None:
    page, good = Page(), GOOD.get(kind, PART)
    page.admits("FileTransferStartUpload", **START)
    page.admits(kind, **{**good, data.draw(st.sampled_from(sorted(good))): data.draw(ANYTHING)})
    raw = bytearray(frame(kind, **good))
    for index in data.draw(st.lists(st.integers(0, len(raw) - 1), max_size=4)):
        raw[index] = data.draw(st.integers(0, 255))
    page.filter.admits(bytes(raw[: data.draw(st.integers(0, len(raw)))]))


def test_a_flood_ends_it_for_good(page: Page) -> None:
    for _ in range(1000):
        page.filter.admits(b"garbage")
    assert page.filter.flooded
    assert not page.admits("ViewerCameraMessage", **CAMERA)
    assert page.tally.counts["too many messages"] == 1
    assert page.tally.counts["no message of a page"] < 200


def test_a_busy_page_is_no_flood_and_the_allowance_comes_back_but_does_not_pile_up() -> None:
    clock = Clock()
    gauge = FloodGauge(clock)
    assert all(gauge.charge(512 << 10, refused=False) for _ in range(16))
    for _ in range(60 * 200):
        clock.now_s += 1 / 200
        assert gauge.charge(120, refused=False)
    clock = Clock()
    gauge = FloodGauge(clock)
    while gauge.charge(0, refused=True):
        pass
    clock.now_s += 3600.0
    count = 0
    while gauge.charge(0, refused=True):
        count += 1
    assert 150 < count < 200


def test_an_arm_with_its_meshes_may_be_larger_than_a_program(page: Page) -> None:
    def starts(size: int, button: object, transfer: str) -> bool:
        page.controls["upload"] = button
        start = {
            "filename": "arm.zip",
            "mime_type": "",
            "part_count": -(-size // UPLOAD_PART_BYTES),
            "size_bytes": size,
        }
        return page.admits("FileTransferStartUpload", **{**IDS, "transfer_uuid": transfer}, **start)

    for_arms = type("ForArms", (UploadButton,), {"mime_type": ".zip,.urdf"})()
    assert not starts(MAX_UPLOAD_BYTES + 1, UploadButton(), "one")
    assert not starts(MAX_ARM_BYTES + 1, for_arms, "two")
    assert "the largest that is taken has 24 MiB" in page.notices[-1]
    assert starts(MAX_ARM_BYTES, for_arms, IDS["transfer_uuid"])
    parts = (
        frame("FileTransferPart", **IDS, part_index=k, content=bytes(UPLOAD_PART_BYTES)) for k in range(48)
    )
    assert all(page.filter.admits(part) for part in parts)
    assert not page.filter.flooded


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


def test_a_part_that_is_too_long_counts_with_its_size(page: Page) -> None:
    assert not page.admits("FileTransferStartUpload", **{**START, "size_bytes": 600 << 19})
    for _ in range(4):
        assert not page.admits("FileTransferPart", **{**PART, "content": b"." * (15 << 20)})
    assert page.filter.flooded


def starts(ledger: UploadLedger, size: int, parts: int = 1, *, transfer: str = "t") -> bool:
    start = FileTransferStartUpload("button", transfer, "a.toml", "", parts, size)
    return ledger.reason_against(start) is None


def part(index: int, size: int, *, transfer: str = "t") -> FileTransferPart:
    return FileTransferPart("button", transfer, index, b"." * size)


def test_parts_may_come_in_any_order_each_once() -> None:
    ledger = UploadLedger()
    assert starts(ledger, UPLOAD_PART_BYTES + 5, 2)
    assert ledger.continues(part(1, 5))
    assert ledger.continues(part(0, UPLOAD_PART_BYTES))
    assert not ledger.continues(part(0, UPLOAD_PART_BYTES))


@pytest.mark.parametrize(
    "wrong", [part(0, UPLOAD_PART_BYTES + 1), part(1, 5), part(-1, 5), part(0, 5, transfer="u")]
)
def test_a_part_is_one_that_was_announced(wrong: FileTransferPart) -> None:
    ledger = UploadLedger()
    assert not ledger.continues(wrong)
    assert starts(ledger, 5)
    assert not ledger.continues(wrong)
    assert ledger.continues(part(0, 5))


@pytest.mark.parametrize(
    ("size", "parts"), [(5, 0), (5, 2), (0, 1), (UPLOAD_PART_BYTES + 1, 1), (-UPLOAD_PART_BYTES, -1)]
)
def test_size_and_count_of_parts_agree(size: int, parts: int) -> None:
    assert not starts(UploadLedger(), size, parts)


def test_the_ledger_is_bounded_in_transfers_files_and_parts() -> None:
    ledger = UploadLedger()
    assert starts(ledger, 5, transfer="a")
    assert not starts(ledger, 5, transfer="a")
    assert starts(ledger, 5, transfer="b")
    assert not starts(ledger, 5, transfer="c")
    assert all(starts(ledger, 0, 0, transfer=str(n)) for n in range(5))
    assert ledger.continues(part(0, 5, transfer="a"))
    assert starts(ledger, 5, transfer="c")
    ledger = UploadLedger()
    assert starts(ledger, MAX_UPLOAD_BYTES, 2)
    assert not any(starts(ledger, MAX_UPLOAD_BYTES + 1, 3, transfer=transfer) for transfer in "abc")
    known = [ledger.is_leftover(part(0, 5, transfer=transfer)) for transfer in "abcd"]
    assert known == [True, True, False, False]
    ledger = UploadLedger()
    assert not starts(ledger, 2**63 - 1)
    assert all(ledger.is_leftover(part(0, 5)) for _ in range(ledger.MOST_LEFTOVER_PARTS))
    assert not ledger.is_leftover(part(0, 5))


def test_the_log_is_not_flooded(caplog: pytest.LogCaptureFixture, page: Page) -> None:
    for _ in range(250):
        page.tally.refuse("a foreign origin")
    assert [record.getMessage() for record in caplog.records] == [
        f"refused: a foreign origin ({count} so far)" for count in (1, 10, 100)
    ]


def test_a_number_beside_a_slider_that_is_outside_is_refused_in_words_and_the_one_before_stays(
    server: GuardedServer,
) -> None:
    slider = server.gui.add_slider("Shoulder °", -3.2, 146.8, 0.1, initial_value=40.0)
    told: list[str] = []

    def notify(_title: str, text: str, **_: object) -> SimpleNamespace:
        told.append(text)
        return SimpleNamespace(remove=lambda: None)

    client: Any = SimpleNamespace(gui=server.gui, add_notification=notify)
    judge = FrameFilter(Tally(), Clock(), lambda: client)

    def typed(value: float) -> bool:
        message = {"type": "GuiUpdateMessage", "uuid": slider._impl.uuid, "updates": {"value": value}}
        return judge.admits(msgspec.msgpack.encode(message))

    assert typed(146.8) and told == []
    assert not typed(400)
    assert told == ["Shoulder °: 400 is outside -3.2 … 146.8; it stays 40."]
    assert slider.value == 40.0


def test_a_number_that_is_half_typed_is_left_alone(server: GuardedServer) -> None:
    """What is typed as "20" beside a slider from 5 to 100 comes as "2" first; that must not be taken away."""
    speed = server.gui.add_slider("Speed %", 5, 100, 1, initial_value=100)
    cold = server.gui.add_slider("Cold", -100, -5, 1, initial_value=-50)
    tally = Tally()
    tally.open()
    client: Any = SimpleNamespace(gui=server.gui)  # it could be told nothing
    judge = FrameFilter(tally, Clock(), lambda: client)
    for slider, typed in ((speed, 2), (speed, 0), (cold, -2)):
        before = slider.value
        message = {"type": "GuiUpdateMessage", "uuid": slider._impl.uuid, "updates": {"value": typed}}
        assert not judge.admits(msgspec.msgpack.encode(message))
        assert slider.value == before
    assert tally.counts == {"a value that the control cannot take": 3}
