"""Snapshots as they are written for clients, tick after tick."""

from __future__ import annotations

from dataclasses import fields, replace
from operator import attrgetter
from typing import Any

import msgspec

from armctl.process.records import Codec
from armctl.program import Program
from armctl.protocol import Snapshot

_NO_PROGRAM = Program(robot="")


class SnapshotWriter:
    """Encodes ``Seen`` records one after the other, each without log and programs.

    What is the same object as in the record before is not encoded anew: a third of the time, where a board
    measures much.
    """

    def __init__(self) -> None:
        self._known: dict[str, tuple[object, msgspec.Raw]] = {}

    def __call__(self, codec: Codec, snapshot: Snapshot) -> bytes:
        """The record of a snapshot; always with the same codec."""
        values: dict[str, Any] = dict(zip(_FIELDS, _VALUES(snapshot), strict=True))
        values["events"] = ()
        if not codec.house:  # programs of others read them; a page has the numbers
            values["measured"] = snapshot.measured
        if (progress := snapshot.program) is not None:
            values["program"] = replace(progress, running=_NO_PROGRAM, coming=_NO_PROGRAM)
        for name in _SELDOM_NEW:
            value, known = values[name], self._known.get(name)
            if known is None or known[0] is not value:
                known = self._known[name] = value, msgspec.Raw(codec.encode(value))
            values[name] = known[1]
        return codec.encode({"type": "seen", "snapshot": values})


_FIELDS = tuple(one.name for one in fields(Snapshot))
_VALUES = attrgetter(*_FIELDS)
_SELDOM_NEW = (
    "board", "control", "homing", "last_pose", "levels", "limits", "quantities", "warnings",
)  # fmt: skip
