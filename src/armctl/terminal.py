"""The person at the terminal: reads there what a program says, and presses Enter for OK."""

from __future__ import annotations

import sys
from contextlib import suppress
from threading import Event, Thread
from types import TracebackType
from typing import Self

from armctl.errors import ArmctlError
from armctl.protocol import ArmLink, ConfirmMessage, Message, Origin
from armctl.system import forget_typed, typed_enter

_LOOK_S = 0.01
_NOBODY = "nobody can press Enter here: OK comes from a page, or another program"


class PersonAtTerminal:
    """Tells on stderr what programs say, in a ``with`` block; Enter is OK where stdin is a terminal."""

    def __init__(self, link: ArmLink, origin: Origin, keys: int | None = None) -> None:
        """``keys``: descriptor of the terminal that Enter comes from; None: that of stdin, if it is one."""
        self._link, self._origin = link, origin
        self._keys = _stdin() if keys is None else keys
        before = link.snapshot.message
        self._told = 0 if before is None else before.number
        self._ended = Event()
        self._teller = Thread(target=self._watch, name="armctl-person", daemon=True)

    def __enter__(self) -> Self:
        self._teller.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._teller.join()
        self.tell(self._link.snapshot.message)  # the program may have ended at once

    def look(self) -> bool:
        """Tell what is new, and pass on an Enter; whether there was one."""
        message = self._link.snapshot.message
        self.tell(message)
        if message is None or not message.waits or self._keys is None or not typed_enter(self._keys):
            return False
        with suppress(ArmctlError):  # somebody was faster, or the program has gone on
            self._link.submit(ConfirmMessage(message.number), self._origin).result()
        return True

    def tell(self, message: Message | None) -> None:
        """Tell a message, once."""
        if message is None or message.number == self._told:
            return
        self._told = message.number
        ask = ""
        if message.waits:
            ask = f" [{_NOBODY}]" if self._keys is None else " [press Enter]"
            if self._keys is not None:
                forget_typed(self._keys)  # what was pressed before is no answer
        sys.stderr.write(f"message: {message.text}{ask}\n")
        sys.stderr.flush()

    def _watch(self) -> None:
        while not self._ended.wait(_LOOK_S):
            self.look()


def _stdin() -> int | None:
    try:
        return sys.stdin.fileno() if sys.stdin.isatty() else None
    except (AttributeError, OSError, ValueError):  # there is none, or it is closed
        return None
