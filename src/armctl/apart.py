"""Work in a process of its own: at a lower priority, with bounds, and ended when nobody waits for it.

A thread that computes takes the interpreter from all others. So what takes the page server seconds, and what
reads files of strangers, is done here. Requests and results are bytes. A process costs half a second.
"""

from __future__ import annotations

import importlib
import logging
import os
import queue
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from typing import IO, cast

import msgspec

from armctl import errors
from armctl.errors import ArmctlError, LimitError
from armctl.system import bound_this_process, ended_by_time, priority_below

Tell = Callable[[bytes], None]
Work = Callable[[bytes, Tell], bytes]
"""makes a result of a request, and tells how far it is"""

MOST_BYTES = 3 << 30
"""memory of such a process"""
_LOOK_S = 0.1
"""how often it is looked whether the result is still wanted"""
_SLOWEST = 4.0
"""It may take so many times its processor time, as others go first"""
_SIZE = 8
"""bytes of a number"""
_TOLD, _DONE, _REFUSED, _NO_MEMORY = b"told", b"done", b"no  ", b"full"
_LOG = logging.getLogger("armctl.apart")
_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")

GIVEN_UP: ContextVar[threading.Event | None] = ContextVar("given_up", default=None)
"""set where nobody waits any more for what is worked out in this context"""


def is_given_up() -> bool:
    """Whether nobody waits any more for what is worked out here."""
    given_up = GIVEN_UP.get()
    return given_up is not None and given_up.is_set()


def require_wanted() -> None:
    """Refuse (``LimitError``) to go on with what nobody waits for any more."""
    if is_given_up():
        raise LimitError("it was cancelled")


def apart(
    work: str,
    request: bytes,
    *,
    seconds: float,
    told: Tell | None = None,
    look: Callable[[], None] | None = None,
) -> bytes:
    """What ``work`` ("armctl.module:function", a ``Work``) makes of a request. Blocks; any thread may ask.

    ``told`` gets what it tells. ``look`` is called ten times a second; what it raises ends the process.
    ``ArmctlError`` as the work raises it; ``LimitError``: it took more than ``seconds`` of the processor, or
    more than ``MOST_BYTES`` of memory, or it broke.
    """
    with tempfile.TemporaryFile() as said, _process(work, seconds, said) as process:
        frames: queue.Queue[tuple[bytes, bytes] | None] = queue.Queue()
        stdin, stdout = cast("IO[bytes]", process.stdin), cast("IO[bytes]", process.stdout)
        reader = threading.Thread(target=_read_all, args=(stdout, frames), daemon=True)
        reader.start()
        with suppress(BrokenPipeError):  # it has ended, and says why
            stdin.write(len(request).to_bytes(_SIZE) + request)
            stdin.flush()
        too_slow = threading.Event()

        def end() -> None:
            too_slow.set()
            process.kill()

        late = threading.Timer(_SLOWEST * seconds, end)
        late.daemon = True
        late.start()
        try:
            while True:
                require_wanted()
                try:
                    frame = frames.get(timeout=_LOOK_S)
                except queue.Empty:
                    if look is not None:
                        look()
                    continue
                match frame:
                    case (kind, content) if kind == _TOLD:
                        if told is not None:
                            told(content)
                    case (kind, content) if kind == _DONE:
                        return content
                    case (kind, content) if kind == _REFUSED:
                        raise _error(content)
                    case _:
                        break
        finally:
            late.cancel()
        if frame is not None:
            raise LimitError(f"it needs more than {MOST_BYTES >> 30} GiB of memory")
        if ended_by_time(process.wait()) or too_slow.is_set():
            raise LimitError(f"it takes more than {seconds:g} s of the processor")
        said.seek(0)
        _LOG.error("%s broke: %s", work, said.read()[-4000:].decode(errors="replace"))
        raise LimitError("it cannot be worked out; the program's log has the details")


@contextmanager
def _process(work: str, seconds: float, said: IO[bytes]) -> Generator[subprocess.Popen[bytes]]:
    run = (
        f"import sys; sys.path[:] = {sys.path!r}; from armctl.apart import main; main({work!r}, {seconds!r})"
    )
    process = subprocess.Popen(  # a group of its own: Ctrl-C is for the process that asks
        [sys.executable, "-c", run], env={**os.environ, **_ONE_THREAD}, process_group=0,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said,
    )  # fmt: skip
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()


def _read_all(pipe: IO[bytes], frames: queue.Queue[tuple[bytes, bytes] | None]) -> None:
    """Put what a process says into a queue, and None behind it."""
    with suppress(OSError, ValueError):  # it is closed meanwhile
        while len(kind := pipe.read(len(_DONE))) == len(_DONE):
            content = pipe.read(int.from_bytes(pipe.read(_SIZE)))
            frames.put((kind, content))
    frames.put(None)


def _error(content: bytes) -> ArmctlError:
    kind, text = msgspec.msgpack.decode(content, type=tuple[str, str])
    found = getattr(errors, kind, ArmctlError)
    return found(text) if isinstance(found, type) and issubclass(found, ArmctlError) else ArmctlError(text)


# The other process.


def main(work: str, seconds: float) -> None:
    """Serve one request."""
    priority_below()
    bound_this_process(seconds, MOST_BYTES)
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no result
    size = int.from_bytes(sys.stdin.buffer.read(_SIZE))
    request = sys.stdin.buffer.read(size)
    threading.Thread(target=_end_with_asker, daemon=True).start()

    def say(kind: bytes, content: bytes) -> None:
        out.write(kind + len(content).to_bytes(_SIZE) + content)
        out.flush()

    module, _, name = work.partition(":")
    do: Work = getattr(importlib.import_module(module), name)
    try:
        result = do(request, lambda content: say(_TOLD, content))
    except ArmctlError as refusal:
        say(_REFUSED, msgspec.msgpack.encode((type(refusal).__name__, str(refusal))))
    except MemoryError:
        say(_NO_MEMORY, b"")
    else:
        say(_DONE, result)


def _end_with_asker() -> None:
    """Nobody waits any more once the pipe is closed."""
    os.read(sys.stdin.fileno(), 1)
    os._exit(1)
