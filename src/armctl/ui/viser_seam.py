"""All that armctl holds of viser 1.1.1 beyond its documented calls. Nothing else touches its insides.

How it serves, what its pages say, a scene without a server, and its page. What scripts and styles hold of
that page stands in ``viser_seam.js``, ``viser_console.css`` and ``viser_file.css``. Each hook has a test that
names it, ``tests/ui/test_viser_seam.py``.
"""

from __future__ import annotations

import asyncio
import re
import threading
import traceback
import types
import zipfile
from collections.abc import AsyncGenerator, Awaitable, Callable, Generator, Iterable, Mapping
from contextlib import asynccontextmanager, contextmanager
from functools import lru_cache
from importlib import resources
from typing import Any, cast

import msgspec
import rich
import viser
import websockets.asyncio.server
from viser import _assignable_props_api as props_api
from viser import _gui_api as gui_api  # pyright: ignore[reportPrivateUsage]
from viser import _icons as icons  # pyright: ignore[reportPrivateUsage]
from viser import _messages as messages  # pyright: ignore[reportPrivateUsage]
from viser.infra import StateSerializer, WebsockMessageHandler
from viser.infra._async_message_buffer import AsyncMessageBuffer
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from armctl.arrays import FloatArray
from armctl.errors import ServerError

# How viser opens its web server, whom that has connected, and what viser does to its process.

VERSION = "1.1.1"
"""the one whose insides are held here"""
SUBPROTOCOL = f"viser-v{viser.__version__}"
"""what viser's page asks for when it opens its websocket (``infra/_infra.py``)"""
_OPENER = "viser.infra._infra"
"""the module that calls ``serve``, by which its call is told from those of others"""
_REPLACING = threading.Lock()  # what is replaced belongs to the process, so the lock does too

Handler = Callable[[ServerConnection], Awaitable[None]]
PageServer = Callable[[ServerConnection, Request], Response | None]


def require_version() -> None:
    """Refuse (``ServerError``) another viser than the one whose insides are held here."""
    if viser.__version__ != VERSION:
        raise ServerError(
            f"the guard is made for viser {VERSION}, but {viser.__version__} is installed; "
            f"install viser=={VERSION}"
        )


@contextmanager
def opening_through(
    arrange: Callable[[Handler, PageServer], tuple[Handler, dict[str, Any]]],
) -> Generator[list[Exception | None]]:
    """Have a server that viser opens meanwhile handle connections, and be opened, as ``arrange`` says.

    ``arrange`` gets what viser handles connections and serves its page with, and gives what handles them
    instead, with more options of ``websockets.asyncio.server.serve``. The list that is given has one entry
    for each server that viser opened this way: None, or why it could not be opened.

    Holds: ``viser.infra._infra`` looks ``serve`` up when a server starts, calls it as ``serve(handler, host,
    port, process_request=…)``, and waits for ever in its constructor where that raises.
    """
    module = websockets.asyncio.server
    opened: list[Exception | None] = []

    def arranged(handler: Handler, host: Any = None, port: Any = None, **options: Any) -> Any:
        if getattr(handler, "__module__", "") != _OPENER:
            return serve(handler, host, port, **options)
        opened.append(None)
        try:
            route, more = arrange(handler, options["process_request"])
            return serve(route, **options | more)
        except Exception as cause:
            opened[-1] = cause
            return _serving_nothing()

    with _REPLACING:
        serve: Callable[..., Any] = module.serve
        module.serve = arranged  # pyright: ignore[reportAttributeAccessIssue]
        try:
            yield opened
        finally:
            module.serve = serve


@asynccontextmanager
async def _serving_nothing() -> AsyncGenerator[types.SimpleNamespace]:
    """What viser gets for a server that could not be opened: it serves nothing until it is stopped.

    Holds: of what ``serve`` gives, viser asks for ``server.sockets`` alone.
    """
    yield types.SimpleNamespace(server=types.SimpleNamespace(sockets=()))


def connections_of(server: viser.ViserServer) -> dict[int, ServerConnection]:
    """The open connections by client id; one is there before its page has introduced itself.

    Holds: ``ViserServer._websock_server._live_connections``.
    """
    return dict(server._websock_server._live_connections)  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]


def hold_viser() -> None:
    """Change what is changed for the whole process; refuses (``ServerError``) another viser than ours."""
    require_version()
    keep_quiet()
    share_type_hints()
    leave_what_is_shown()
    keep_icons_open()
    let_groups_be_disabled()


def keep_quiet() -> None:
    """Have viser print neither its banner nor its notices.

    Holds: it prints through the console of ``rich`` that the whole process shares.
    """
    rich.get_console().quiet = True


def share_type_hints() -> None:
    """Have the types of a control's properties looked up once a kind, instead of once a control.

    That is half of the time in which a page is built, and nothing else runs on the event loop.

    Holds: ``_assignable_props_api.get_type_hints`` and ``_gui_api.get_type_hints_cached``.
    """
    props_api.get_type_hints = gui_api.get_type_hints_cached  # pyright: ignore[reportPrivateImportUsage]


def leave_what_is_shown() -> None:
    """Have it cost next to nothing to assign what a property is already: pages do it all the time.

    Holds: ``_assignable_props_api.props_setattr``, which looks the property's type up and casts to it before
    it compares, and that a handle keeps its properties in ``_impl.props``.
    """
    base: Any = props_api.AssignablePropsBase
    assign = cast("Callable[[object, str, object], None]", cast(Any, props_api).props_setattr)

    def leave(handle: object, name: str, value: object) -> None:
        it: Any = getattr(handle, "__dict__", {}).get("_impl")
        if it is not None and not it.removed and not hasattr(type(handle), name):  # else by its own setter
            shown: object = getattr(it.props, name, None)
            if type(shown) is type(value) and _is_plain(value) and shown == value:
                return
        assign(handle, name, value)

    base.__setattr__ = leave


def _is_plain(value: object) -> bool:
    """Whether a value is compared by what it is: no array, and nothing that somebody may change."""
    if isinstance(value, tuple):
        return all(map(_is_plain, cast("tuple[object, ...]", value)))
    return isinstance(value, bool | int | str)


class _KeptArchive(zipfile.ZipFile):
    def __exit__(self, *raised: object) -> None:
        """It stays open."""


_archive = lru_cache(maxsize=1)(_KeptArchive)


def keep_icons_open() -> None:
    """Have the archive of 5,000 icons opened once, not once an icon: 0.03 s each while a page is built.

    Holds: ``_icons.zipfile.ZipFile``, by which ``svg_from_icon`` opens it.
    """
    icons.zipfile = types.SimpleNamespace(ZipFile=_archive)  # pyright: ignore


def let_groups_be_disabled() -> None:
    """Let groups of buttons be disabled: viser refuses, though its page shows them so.

    Holds: ``GuiButtonGroupHandle.disabled``, a property that refuses and hides one like any other.
    """
    if "disabled" in vars(viser.GuiButtonGroupHandle):
        delattr(viser.GuiButtonGroupHandle, "disabled")


def failed_in_viser(error: BaseException | None) -> bool:
    """Tell whether it was viser that failed at what a page sent, not a callback that it has called.

    Holds: viser casts a value to the type of the present one in a task of its own, which fails there
    (``_gui_api._handle_gui_updates``).
    """
    frames = [] if error is None else [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    modules: list[str] = [frame.f_globals["__name__"] for frame in frames]
    below = ("armctl.ui.guard", "armctl.ui.viser_seam")
    is_ours = any(name.startswith("armctl.") and not name.startswith(below) for name in modules)
    return bool(modules) and modules[-1].startswith("viser.") and not is_ours


# What viser's pages say: the messages of its protocol, and the controls that they are for.


UPLOAD_PART_BYTES = 512 << 10
"""The page cuts a file in parts of this size (``chunkSize`` in viser's UploadButton.tsx)."""


class _Envelope(msgspec.Struct):
    type: str


class MessageReader:
    """Decodes frames as viser does, each field checked against its type: viser lets most of them pass.

    Holds: the dataclasses of ``viser._messages``, which msgpack maps with their name as ``type``, and
    ``Message.deserialize``.
    """

    def __init__(self, kinds: Iterable[type[messages.Message]]) -> None:
        """``kinds``: of messages that may come."""
        self._decoders = {kind.__name__: msgspec.msgpack.Decoder(kind) for kind in kinds}

    def read(self, raw: str | bytes) -> messages.Message | None:
        """The message of a frame.

        None for one of another kind; an exception of any kind where a field is of a wrong type or viser could
        not read the frame.
        """
        if isinstance(raw, str):
            raise TypeError("viser's pages send binary frames only")
        decoder = self._decoders.get(msgspec.msgpack.decode(raw, type=_Envelope).type)
        if decoder is None:
            return None
        decoder.decode(raw)
        return cast(messages.Message, messages.Message.deserialize(raw))


def control_of(client: viser.ClientHandle, message: messages.Message) -> Any:
    """The control of this page that a message is for, by its handle; None: there is none.

    Holds: ``GuiApi._gui_input_handle_from_uuid``, and the fields ``uuid`` and ``source_component_uuid``.
    """
    fields = vars(message)
    table = client.gui._gui_input_handle_from_uuid  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
    return table.get(fields.get("uuid", fields.get("source_component_uuid", "")))


def id_of_notification(shown: viser.NotificationHandle) -> str:
    """The id of a notification's element in the page (``furnishNotifications`` in ``viser_seam.js``)."""
    return shown._impl.uuid  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]


def acknowledge_all(client: viser.ClientHandle, start: messages.FileTransferStartUpload) -> None:
    """Have the page take a file for sent, so that it can send another one.

    Holds: ``GuiApi._websock_interface.queue_message`` and ``FileTransferPartAck``, the answer to a last part.
    """
    size = start.size_bytes
    done = messages.FileTransferPartAck(start.source_component_uuid, start.transfer_uuid, size, size)
    client.gui._websock_interface.queue_message(done)  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]


def move_node(node: viser.SceneNodeHandle, position: FloatArray, wxyz: FloatArray) -> None:
    """Move a node to ``position`` (3,) [m] and a unit quaternion (4,), which the caller knows to be new.

    As assigning both, which compares them with where the node is: half of what an arm that moves costs.

    Holds: ``_set_pose_vector``, by which a node's pose is assigned, and what it asks of the node.
    """
    it: Any = node._impl  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
    if it.removed:
        raise RuntimeError(f"{it.name} is removed and cannot be moved")
    it.position[:], it.wxyz[:] = position, wxyz
    x, y, z = position.tolist()
    it.api._queue_scene_message(messages.SetPositionMessage(it.name, (x, y, z)))  # noqa: SLF001
    w, x, y, z = wxyz.tolist()
    it.api._queue_scene_message(messages.SetOrientationMessage(it.name, (w, x, y, z)))  # noqa: SLF001


# A scene that is kept, not served.


class KeptScene(WebsockMessageHandler):
    """The ``SceneApi`` of viser writes to it as to a server; it gives viser's client with the scene in it.

    Holds: what ``SceneApi`` asks of its server (``client_id``, ``_websock_connection``, ``_viser_server``,
    ``_scene_lifecycle_lock``), ``AsyncMessageBuffer``, which keeps the newest message of each kind for each
    part, and ``StateSerializer._insert_message``.
    """

    client_id = ""
    """as viser's server calls itself"""

    def __init__(self) -> None:
        super().__init__()
        nobody = asyncio.new_event_loop()
        nobody.close()  # viser wakes it with each message, and takes a closed one for a server that has ended
        self._buffer = AsyncMessageBuffer(nobody, persistent_messages=True)
        self._websock_connection = self._viser_server = self
        self._scene_lifecycle_lock = threading.RLock()
        self.api = viser.SceneApi(cast(Any, self), cast(Any, None), nobody)
        self.camera = viser.InitialCameraConfig(self.queue_message)

    def get_message_buffer(self) -> AsyncMessageBuffer:
        """What ``queue_message`` writes to."""
        return self._buffer

    def html(self) -> str:
        """Client of viser with this scene in it."""
        serializer: StateSerializer = self.get_message_serializer(
            lambda message: message.include_in_scene_serialization
        )
        for message in self._buffer.message_from_id.values():
            serializer._insert_message(message)  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
        return serializer.as_html()


# viser's page as a text: where something can be put into it, and what our scripts and styles hold of it.

_HERE = resources.files("armctl.ui")
SCRIPT = _HERE.joinpath("viser_seam.js").read_text("utf-8")
"""``armctlViser``: all that a script may ask of viser's page; it goes ahead of those that ask"""
CONSOLE_STYLE = _HERE.joinpath("viser_console.css").read_text("utf-8")
"""what armctl changes of viser's looks in the console"""
FILE_STYLE = _HERE.joinpath("viser_file.css").read_text("utf-8")
"""… and in a file that shows a motion"""


def slider_marks(places: Mapping[str, float]) -> str:
    """A style that marks a place on sliders with these labels [% of their way]: where the arm is.

    Such a slider has another thumb, too (``viser_console.css``).
    """
    looks = "--armctl-tick:'';--armctl-thumb:var(--armctl-next);--armctl-fill:transparent"
    rules = (
        f'.mantine-Slider-root:has([aria-label="{_css_text(label)}"]){{--armctl-at:{share:.2f}%;{looks}}}'
        for label, share in places.items()
    )
    return f"<style>{''.join(rules)}</style>"


def _css_text(text: str) -> str:
    """A text between quotes in a style, where it can end neither them nor the style."""
    return "".join(c if c.isascii() and c.isalnum() else f"\\{ord(c):x} " for c in text)


_ICON = re.compile(r'<link\s+rel="icon"[^>]*>')
_TITLE = "<title>Viser</title>"


def dressed(page: str, *, ahead: str, title: str, icon: str | None = None, behind: str = "") -> str:
    """The page of viser, with HTML ``ahead`` of its scripts and ``behind`` it all, a title and an icon.

    Holds: ``client/build/index.html`` has ``<head>``, ``</body>``, a link to its icon, and its title.
    """
    start, head, rest = page.partition("<head>")
    rest, end, tail = rest.rpartition("</body>")
    if not (head and end):
        raise ServerError("viser's page has no <head> and <body> to put anything into")
    if icon is not None:
        rest = _ICON.sub(lambda _: icon, rest, count=1)
    rest = rest.replace(_TITLE, f"<title>{title}</title>", 1)
    return "".join((start, head, ahead, rest, behind, end, tail))
