"""Every hook into viser holds: what a later viser has to have, or armctl has to hold otherwise.

Where something is gone, the message says which hook it was for. ``ui/viser_seam`` says what each one is for.
"""

from __future__ import annotations

import asyncio
import base64
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_type_hints

import msgspec
import numpy as np
import pytest
import viser
import zstandard
from tests.ui.guard_kit import Bell, RawPage, uuid_of
from viser import _assignable_props_api, _gui_api, _icons, _messages

from armctl.errors import ServerError
from armctl.ui import viser_seam
from armctl.ui.guard import GuardedServer
from armctl.ui.guard.filter import ALLOWED
from armctl.ui.viser_seam import KeptScene

CLIENT = Path(viser.__file__).parent / "client"
INDEX = (CLIENT / "build" / "index.html").read_text("utf-8")
SEAM = Path(viser_seam.__file__).parent


@cache
def client_code() -> str:
    """viser's client, unpacked from its page as the page does it: 4 bytes in 5 letters, zstd."""
    packed = re.search(r'data-p="([^"]*)"', INDEX)
    assert packed is not None, "viser's page packs its client otherwise: unpack it here as it does"
    digits = np.zeros(127, np.int64)
    digits[[letter for letter in range(0x21, 0x7F) if chr(letter) not in "\"&<>'`"]] = range(88)
    letters = digits[np.frombuffer(packed[1].encode(), np.uint8)]
    whole = len(letters) // 5 * 5
    words = letters[:whole].reshape(-1, 5) @ 88 ** np.arange(4, -1, -1)
    last = 0
    for letter in letters[whole:].tolist():
        last = 88 * last + letter
    raw = words.astype(">u4").tobytes() + last.to_bytes(max(len(letters) - whole - 1, 0), "big")
    return zstandard.ZstdDecompressor().decompress(raw).decode()


# serving


def test_require_version_and_subprotocol() -> None:
    viser_seam.require_version()
    assert "`viser-v${" in client_code(), "SUBPROTOCOL: viser's page asks for another one"


def served(arrange: Callable[..., Any]) -> list[Exception | None]:
    with viser_seam.opening_through(arrange) as opened:
        viser.ViserServer(host="127.0.0.1", port=0, verbose=False).stop()
    return opened


def test_opening_through() -> None:
    asked: list[tuple[Any, Any]] = []

    def arrange(handler: Any, serve_page: Any) -> tuple[Any, dict[str, Any]]:
        asked.append((handler, serve_page))
        return handler, {"host": "127.0.0.1", "port": 0}

    assert served(arrange) == [None], "opening_through: viser does not open its server through serve()"
    ((handler, serve_page),) = asked
    assert asyncio.iscoroutinefunction(handler), "opening_through: what serves a connection is no coroutine"
    assert callable(serve_page), "opening_through: viser gives no process_request"
    assert handler.__module__ == viser_seam._OPENER, "opening_through: another module opens its server"


def test_opening_through_where_it_cannot_be_opened() -> None:
    why = ServerError("it cannot")

    def arrange(*_: object) -> Any:
        raise why

    assert served(arrange) == [why]  # and viser's constructor does not wait for ever


def test_connections_of(server: GuardedServer) -> None:
    with RawPage(server.get_port()) as one:
        one.introduce()
        client_id = Bell(server).ring_from(one)
        live = viser_seam.connections_of(server)
        assert client_id in live, "connections_of: viser's server keeps its connections otherwise"
        assert live[client_id].remote_address[0] == "127.0.0.1"
        assert server.client_of(live[client_id]) is server.get_clients()[client_id]


def test_keep_quiet(capfd: pytest.CaptureFixture[str]) -> None:
    viser_seam.keep_quiet()
    viser.ViserServer(host="127.0.0.1", port=0, verbose=True).stop()
    assert capfd.readouterr() == ("", ""), "keep_quiet: viser prints by another way"


def test_share_type_hints(server: GuardedServer) -> None:
    assert hasattr(_assignable_props_api, "get_type_hints"), "share_type_hints: nothing to be replaced"
    viser_seam.share_type_hints()
    asked = _gui_api.get_type_hints_cached.cache_info().hits
    server.gui.add_number("hints", 1.0).hint = "again"
    server.gui.add_number("hints", 1.0).hint = "again"
    after = _gui_api.get_type_hints_cached.cache_info().hits
    assert after > asked, "share_type_hints: viser looks types up by another way"


@pytest.mark.parametrize(
    ("name", "same", "other"),
    [("disabled", False, True), ("label", "A button", "Another"), ("options", ("a", "b"), ("a",))],
)
def test_leave_what_is_shown(
    server: GuardedServer, monkeypatch: pytest.MonkeyPatch, name: str, same: object, other: object
) -> None:
    viser_seam.leave_what_is_shown()
    viser_seam.leave_what_is_shown()
    gui = server.gui
    it: Any = gui.add_button_group("group", ("a", "b")) if name == "options" else gui.add_button("A button")
    sent: list[object] = []
    monkeypatch.setattr(gui._websock_interface, "queue_message", sent.append)
    looked_up: list[str] = []
    monkeypatch.setattr(
        _assignable_props_api.AssignablePropsBase,
        "_cast_value_recursive",
        lambda _self, _hint, value, name: looked_up.append(name) or value,
    )
    setattr(it, name, same)
    assert not sent and not looked_up, "leave_what_is_shown: viser keeps properties otherwise"
    setattr(it, name, other)
    assert getattr(it, name) == other and len(sent) == 1 and looked_up == [name]
    it.remove()
    with pytest.raises(RuntimeError, match="removed"):
        setattr(it, name, other)


def test_keep_icons_open(server: GuardedServer) -> None:
    assert hasattr(_icons, "zipfile"), "keep_icons_open: nothing to be replaced"
    viser_seam.keep_icons_open()
    archive = _icons.zipfile.ZipFile(_icons.ICONS_DIR / "tabler-icons.zip")
    _icons.svg_from_icon.cache_clear()
    assert "<svg" in _icons.svg_from_icon(viser.Icon.PLUG) and "<svg" in _icons.svg_from_icon(viser.Icon.TAG)
    again = _icons.zipfile.ZipFile(_icons.ICONS_DIR / "tabler-icons.zip")
    assert again is archive and archive.fp is not None, "keep_icons_open: viser opens them otherwise"


def test_let_groups_be_disabled(server: GuardedServer) -> None:
    viser_seam.let_groups_be_disabled()
    viser_seam.let_groups_be_disabled()
    group = server.gui.add_button_group("group", ("a", "b"))
    group.disabled = True
    assert group.disabled, "let_groups_be_disabled: a group of buttons has no property of that name"
    assert "disabled" in get_type_hints(_messages.GuiBaseProps), (
        "let_groups_be_disabled: the page is not told"
    )


def test_failed_in_viser(server: GuardedServer) -> None:
    number = server.gui.add_number("failing", 1.0)
    update = _messages.GuiUpdateMessage(uuid_of(number), {"value": "no number"})
    with pytest.raises(ValueError) as failure:
        asyncio.run(server.gui._handle_gui_updates(0, update))
    assert viser_seam.failed_in_viser(failure.value), "failed_in_viser: viser casts values by another way"
    assert not viser_seam.failed_in_viser(None)
    assert not viser_seam.failed_in_viser(ValueError("it was never raised"))


# messages


@pytest.mark.parametrize("kind", ALLOWED)
def test_message_reader_knows_each_kind_of_message(kind: type[_messages.Message]) -> None:
    known = _messages.Message._subclass_from_type_string()
    assert known.get(kind.__name__) is kind, (
        f"MessageReader: viser calls {kind.__name__} otherwise on the line"
    )
    assert kind.__name__ in client_code(), f"MessageReader: viser's page sends no {kind.__name__}"


def test_message_reader() -> None:
    reader = viser_seam.MessageReader([_messages.CommandTriggerMessage])
    trigger = msgspec.msgpack.encode({"type": "CommandTriggerMessage", "uuid": "k"})
    assert reader.read(trigger) == _messages.CommandTriggerMessage("k")
    assert reader.read(msgspec.msgpack.encode({"type": "GuiFormSubmitMessage", "uuid": "k"})) is None
    for wrong in (
        trigger.decode("latin-1"),
        msgspec.msgpack.encode({"type": "CommandTriggerMessage", "uuid": 1}),
    ):
        with pytest.raises((TypeError, msgspec.ValidationError)):
            reader.read(wrong)


def test_control_of(server: GuardedServer) -> None:
    client: Any = SimpleNamespace(gui=server.gui)
    number, upload = server.gui.add_number("x", 1.0), server.gui.add_upload_button("up")
    start = _messages.FileTransferStartUpload(uuid_of(upload), "t", "a.toml", "", 1, 5)
    for handle, message in (
        (number, _messages.GuiUpdateMessage(uuid_of(number), {"value": 2.0})),
        (upload, start),
        (None, _messages.GuiUpdateMessage("nobody", {"value": 2.0})),
        (None, _messages.TransformControlsDragStartMessage("/target")),
    ):
        found = viser_seam.control_of(client, message)
        assert found is handle, "control_of: viser keeps its controls, or names them in messages, otherwise"


def test_acknowledge_all(server: GuardedServer, monkeypatch: pytest.MonkeyPatch) -> None:
    queued: list[Any] = []
    monkeypatch.setattr(server.gui._websock_interface, "queue_message", queued.append)
    start = _messages.FileTransferStartUpload("button", "t", "a.toml", "", 1, 5)
    viser_seam.acknowledge_all(SimpleNamespace(gui=server.gui), start)  # type: ignore[arg-type]
    (said,) = queued
    assert (said.transfer_uuid, said.transferred_bytes, said.total_bytes) == ("t", 5, 5), "acknowledge_all"
    assert "FileTransferPartAck" in client_code(), "acknowledge_all: viser's page hears it no more"


def test_id_of_notification(server: GuardedServer) -> None:
    with RawPage(server.get_port()) as one:
        one.introduce()
        client_id = Bell(server).ring_from(one)
        shown = server.get_clients()[client_id].add_notification("a title", "a body")
        name = viser_seam.id_of_notification(shown)
        said = "id_of_notification: viser's page is told of another id"
        assert name, said
        one.read_until(name.encode())


def test_upload_part_bytes() -> None:
    source = (CLIENT / "src" / "components" / "UploadButton.tsx").read_text("utf-8")
    said = "UPLOAD_PART_BYTES: viser's page cuts files in parts of another size"
    assert f"chunkSize = {viser_seam.UPLOAD_PART_BYTES >> 10} * 1024;" in source, said


# kept_scene.py


def test_a_node_is_moved_as_by_assigning_its_pose() -> None:
    told: list[list[object]] = []
    for assigned in (True, False):
        scene = KeptScene()
        node = scene.api.add_frame("/arm/link")
        sent: list[object] = []
        scene.queue_message = sent.append
        position, wxyz = np.array([0.1, -0.2, 0.3]), np.array([0.5, 0.5, -0.5, 0.5])
        if assigned:
            node.position, node.wxyz = position, wxyz
        else:
            viser_seam.move_node(node, position, wxyz)
        assert node.position.tolist() == position.tolist() and node.wxyz.tolist() == wxyz.tolist()
        told.append(sent)
    assert told[0] == told[1] and len(told[0]) == 2, "move_node: viser tells the pose of a node otherwise"
    node.remove()
    with pytest.raises(RuntimeError, match="removed"):
        viser_seam.move_node(node, position, wxyz)


def test_kept_scene() -> None:
    scene = KeptScene()
    scene.api.add_frame("/there", position=(1.0, 2.0, 3.0))
    scene.api.add_frame("/gone").remove()
    scene.camera.position = (4.0, 5.0, 6.0)
    data = re.search(r'window\.__VISER_EMBED_DATA__="([^"]+)"', scene.html())
    assert data is not None, "KeptScene: viser embeds a scene otherwise"
    assert "__VISER_EMBED_DATA__" in client_code()
    raw = base64.b64decode(data[1])
    packed = raw[raw.index(b"\x28\xb5\x2f\xfd") :]  # from where the zstd frame begins
    kept = zstandard.ZstdDecompressor().decompressobj().decompress(packed)
    assert b"/there" in kept, "KeptScene: what is drawn is not kept"
    assert b"SetCameraPosition" in kept, "KeptScene: the first view is not kept"


# the page, viser_seam.js and the styles


def test_dressed() -> None:
    dressed = viser_seam.dressed(
        INDEX, ahead="<i>ahead</i>", title="mine", icon="<link rel=icon>", behind="<i>behind</i>"
    )
    said = "dressed: viser's page has another"
    assert "<head><i>ahead</i>" in dressed
    assert "<title>mine</title>" in dressed and viser_seam._TITLE not in dressed, f"{said} title"
    assert "<link rel=icon>" in dressed and 'rel="icon"' not in dressed, f"{said} icon"
    assert dressed.index("<i>behind</i>") > dressed.index('<div id="root">'), f"{said} root"
    assert re.search(r"<i>behind</i></body>\s*</html>\s*$", dressed)
    with pytest.raises(ServerError, match="has no <head>"):
        viser_seam.dressed("<html></html>", ahead="", title="mine")


CONTRACT = {
    "answer": ("viser-user:", "localStorage"),
    "nameLine": ("type:`set_server`,server:", ".type===`set_server`"),
    "openTabs": ("aria-selected", "role:`tab`"),
    "tabsInView": ("aria-selected", "role:`tab`"),
    "tabsAround": ("data-dock-group",),
    "keepTabs": ("role:`tablist`", "role:`tab`"),
    "nameSections": ("chevron-up", "chevron-down", "`Paper`"),
    "nameIcons": ("closeButton", "`Notification`", "list-search", "adjustments", "tabler-icon"),
    "furnishNotifications": ("`Notification`", "id:n.uuid,title:n.props.title"),
    "letGoOfLists": ("role:`option`",),
    "drawNothing": ("getContextAttributes", "getShaderPrecisionFormat", "`webgl2`"),
    "darkenLabels": ("vec4(0.0, 0.0, 0.0, a)", "vec4(1.0, 1.0, 1.0, 0.85 * vAlpha)"),
    "onSceneEdges": ("data-dock-root",),
    "onScenePress": ("data-dock-root",),
    "rayAt": ("__viserMutable", "nodeRefFromName"),
    "scene": (
        "__viserMutable",
        "nodeRefFromName",
        "messageQueue",
        "requestRender",
        "`SetPositionMessage`",
        "`SetOrientationMessage`",
        "`SetSceneNodeVisibilityMessage`",
    ),
    "viser_console.css": (
        "--mantine-primary-color-filled",
        "data-mantine-color-scheme",
        "`Button`",
        "`ActionIcon`",
        "`Spotlight`",
        "actionDescription",
        "--scrollarea-scrollbar-size",
        "data-dock-tab",
        "data-dock-root",
        "data-dock-unmergeable-header",
        "data-dock-griphandle",
        "data-dock-minimize",
        "data-dock-region-handle",
        "data-dock-side",
        "data-dock-area",
        "data-dock-leaf",
        "`Paper`",
        "`Tabs`",
        "`Checkbox`",
        "`Input`",
        "`Modal`",
        "`NumberInput`",
        "`Slider`",
        "markLabel",
        "`TextInput`",
        "`ScrollArea`",
        "`Select`",
        "style:{width:`3rem`}",
        "data-dock-strip",
        "width:`20em`",
        "height:`3.5em`",
        "`Notifications`",
        "`Notification`",
        "`upload-`",
    ),
    "viser_file.css": ("scene tree",),
}
"""what of viser's client each function of ``viser_seam.js``, and each style, holds"""


@pytest.mark.parametrize(
    ("hook", "name"), [(hook, name) for hook, names in CONTRACT.items() for name in names]
)
def test_the_page_of_viser_has_what_scripts_and_styles_hold(hook: str, name: str) -> None:
    assert name in client_code(), f"{hook}: viser's client has no {name!r} any more"


def test_the_contract_names_all_globals_and_classes_of_the_page() -> None:
    texts = {path.name: path.read_text("utf-8") for path in SEAM.glob("viser_*.*s")}
    held = {name.strip("`") for names in CONTRACT.values() for name in names}
    used = re.compile(
        r"__viser\w+|(?<=mantine-)[A-Z]\w+(?=-)|(?<=tabler-icon-)[\w-]+|data-dock[\w-]+|Set\w+Message"
    )
    for name, text in texts.items():
        assert set(used.findall(text)) <= held, name
    assert all(f"function {hook}(" in texts["viser_seam.js"] for hook in CONTRACT if "." not in hook)


def test_a_mark_on_a_slider_names_it_and_nothing_in_its_name_ends_the_style() -> None:
    style = viser_seam.slider_marks({"Base °": 12.5, '"]</style><b>': 0.0})
    assert style.startswith("<style>") and style.count("<") == 2 and style.endswith("</style>")
    assert '[aria-label="Base\\20 \\b0 "]' in style and "--armctl-at:12.50%" in style
