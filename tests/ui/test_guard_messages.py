from __future__ import annotations

import math
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.ui.guard_kit import CAMERA

from armctl.ui.guard.messages import Admissible, GuiUpdate, MessageDecoder

UUID = "3f0e1d9c-0000-4000-8000-000000000000"
GOOD: dict[str, dict[str, Any]] = {
    "ViewerCameraMessage": CAMERA,
    "GuiUpdateMessage": {"uuid": UUID, "updates": {"value": 12.5}},
    "GuiButtonHoldMessage": {"uuid": UUID, "frequency": 10},
    "GuiFormSubmitMessage": {"uuid": UUID},
    "GuiFormDirtyMessage": {"uuid": UUID},
    "CommandTriggerMessage": {"uuid": UUID},
    "TransformControlsUpdateMessage": {
        "name": "/target",
        "wxyz": (1, 0, 0, 0),
        "position": (0, 0, 1.5),
        "owner": "",
    },
    "TransformControlsDragStartMessage": {"name": "/target", "owner": "7"},
    "TransformControlsDragEndMessage": {"name": "/target"},
    "SceneNodeClickMessage": {
        "name": "/points",
        "instance_index": 3,
        "ray_origin": (0, 0, 0),
        "ray_direction": (0, 0, 1),
        "screen_pos": (0.5, 0.5),
        "modifier": None,
        "owner": "",
    },
    "GetRenderResponseMessage": {"payload": b"png", "render_uuid": UUID},
    "LocalStorageGetItemResponseMessage": {"value": None, "error": None, "request_uuid": UUID},
    "FileTransferStartUpload": {
        "source_component_uuid": UUID,
        "transfer_uuid": UUID,
        "filename": "pick and place.toml",
        "mime_type": "",
        "part_count": 1,
        "size_bytes": 10,
    },
    "FileTransferPart": {
        "source_component_uuid": UUID,
        "transfer_uuid": UUID,
        "part_index": 0,
        "content": b"0123456789",
    },
}


def decode(kind: str, **fields: object) -> Admissible | None:
    return MessageDecoder().decode(msgspec.msgpack.encode({"type": kind, **fields}))


@pytest.mark.parametrize("kind", GOOD)
def test_what_the_page_sends_is_admissible(kind: str) -> None:
    assert decode(kind, **GOOD[kind]) is not None


@pytest.mark.parametrize("kind", GOOD)
def test_a_missing_or_an_unknown_field_is_refused(kind: str) -> None:
    for name in GOOD[kind]:
        if name != "owner":
            assert decode(kind, **{k: v for k, v in GOOD[kind].items() if k != name}) is None
    assert decode(kind, **GOOD[kind], surplus=1) is None
    assert decode(kind, **GOOD[kind], excluded_self_client=0) is None


@pytest.mark.parametrize("kind", GOOD)
@pytest.mark.parametrize("wrong", [{}, [[1]], {"a": 1}, math.nan, math.inf, -math.inf, 1e300])
def test_no_field_takes_a_wrong_type_or_a_number_that_is_none(kind: str, wrong: object) -> None:
    for name in GOOD[kind]:
        assert decode(kind, **{**GOOD[kind], name: wrong}) is None, name


@pytest.mark.parametrize(
    "kind",
    [
        "ShareUrlRequest",
        "ShareUrlDisconnect",
        "RunJavascriptMessage",
        "SceneNodeDragMessage",
        "ScenePointerMessage",
        "GuiRemoveMessage",
        "FileTransferPartAck",
        "ResetGuiMessage",
        "Message",
        "",
    ],
)
def test_other_messages_are_refused(kind: str) -> None:
    assert decode(kind) is None
    assert decode(kind, uuid=UUID) is None


@pytest.mark.parametrize(
    "updates",
    [
        {},
        {"update_cb": []},
        {"value": 1, "update_cb": []},
        {"removed": True},
        {"props": None},
        {"sync_cb": None},
        {"value": None},
        {"value": math.nan},
        {"value": [1.0, math.inf]},
        {"value": []},
        {"value": [0] * 17},
        {"value": [[1]]},
        {"value": {"a": 1}},
        {"value": b"bytes"},
        {"value": "x" * 4097},
        {"value": 10**18},
    ],
)
def test_only_a_plain_value_can_be_set(updates: dict[str, object]) -> None:
    assert decode("GuiUpdateMessage", uuid=UUID, updates=updates) is None


@pytest.mark.parametrize("value", [True, 5, -2.5, "text", "", (1, 2.5), (255, 0, 0, 255)])
def test_plain_values_arrive_as_they_were_sent(value: object) -> None:
    message = decode("GuiUpdateMessage", uuid=UUID, updates={"value": value})
    assert isinstance(message, GuiUpdate)
    assert message.updates.value == value
    assert type(message.updates.value) is type(value)


@pytest.mark.parametrize("name", ["", "../a", "a/b", "a\\b", "a\0b", "a\nb", "a\n", "x" * 256])
def test_a_file_name_is_a_bare_one(name: str) -> None:
    assert decode("FileTransferStartUpload", **{**GOOD["FileTransferStartUpload"], "filename": name}) is None


@pytest.mark.parametrize(
    "raw",
    [
        "text",
        b"",
        b"\x91" * 100_000,
        b"\xdf\xff\xff\xff\xff",
        b"\x81\xa1\xff\x01",
        b"\x82\xa4type\xb0FileTransferPart\xa7content\xc6\xff\xff\xff\xffa",
        msgspec.msgpack.encode({"type": "GuiFormDirtyMessage", "uuid": UUID}) + b"\x00",
        msgspec.json.encode({"type": "GuiFormDirtyMessage", "uuid": UUID}),
    ],
)
def test_garbage_is_refused(raw: str | bytes) -> None:
    assert MessageDecoder().decode(raw) is None


SCALARS = st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text() | st.binary()
ANYTHING = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=5) | st.dictionaries(st.text() | st.integers(0, 9), inner, max_size=5)
    ),
    max_leaves=20,
)


@given(st.binary() | st.text())
def test_no_frame_raises(raw: str | bytes) -> None:
    MessageDecoder().decode(raw)


@given(ANYTHING)
def test_no_structure_raises(anything: object) -> None:
    MessageDecoder().decode(msgspec.msgpack.encode(anything))


@given(st.sampled_from(sorted(GOOD)), st.data())
def test_one_field_replaced_by_anything_never_raises(kind: str, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(sorted(GOOD[kind])))
    fields = {**GOOD[kind], name: data.draw(ANYTHING)}
    MessageDecoder().decode(msgspec.msgpack.encode({"type": kind, **fields}))


@given(st.sampled_from(sorted(GOOD)), st.data())
def test_a_damaged_frame_never_raises(kind: str, data: st.DataObject) -> None:
    raw = bytearray(msgspec.msgpack.encode({"type": kind, **GOOD[kind]}))
    for index in data.draw(st.lists(st.integers(0, len(raw) - 1), max_size=4)):
        raw[index] = data.draw(st.integers(0, 255))
    MessageDecoder().decode(bytes(raw[: data.draw(st.integers(0, len(raw)))]))
