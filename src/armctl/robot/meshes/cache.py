"""What is made of an arm's meshes, kept on disk by their content: reading and fitting them takes seconds.

An entry is named by all that it is made of, also the code that makes it, so that none is ever out of date.
It is only data, checked as it is read. One that is damaged, or that others could have written, is made anew.
"""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeVar, cast

import msgspec
import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_path

from armctl.arrays import content
from armctl.documents import open_at_once, write_atomically
from armctl.errors import RobotFileError
from armctl.robot.meshes.reading import MESHES
from armctl.robot.parts import Shape
from armctl.system import is_own_file, private_folder

T = TypeVar("T")

MOST_BYTES, MOST_OF_ONE = 256 << 20, 32 << 20
"""of all entries together, beyond which the oldest ones go, and of one"""
_MARK = b"armctl meshes\n"
_LIBRARIES = ("numpy", "scipy", "trimesh", "pycollada", "python-fcl")
_DTYPES = ("<f8", "<i8")
_LOG = logging.getLogger("armctl.robot")


def folder() -> Path:
    """Where the entries are."""
    return user_cache_path("armctl") / "meshes"


def kept(kind: type[T], shapes: Sequence[Shape], *says: object) -> T | None:
    """What was made of shapes, and of what else it depends on; None where it has to be made."""
    name = _name(kind, shapes, says)
    return None if name is None else _read(kind, folder() / name)


def keep(kind: type[T], shapes: Sequence[Shape], *says: object, make: Callable[[], T]) -> T:
    """The same, made and kept where it is not there yet.

    It is not kept where a file of the shapes cannot be read, or changes meanwhile.
    """
    name = _name(kind, shapes, says)
    found = None if name is None else _read(kind, folder() / name)
    if found is not None:
        return found
    made = make()
    if name is not None and name == _name(kind, shapes, says):
        _write(folder() / name, made)
    return made


def _name(kind: type, shapes: Sequence[Shape], says: object) -> str | None:
    """Of an entry; None: it would not be known what it is made of."""
    try:
        files = {one: _of_file(one) for one in {shape.file for shape in shapes if shape.kind == "mesh"}}
    except RobotFileError:
        return None
    drawn = [content(replace(shape, file="").made_of()) for shape in shapes]
    meant = _code(), str(kind), drawn, [files.get(shape.file) for shape in shapes], content(says)
    return hashlib.sha256(msgspec.msgpack.encode(meant)).hexdigest()


def _of_file(file: str) -> tuple[str, bytes]:
    path = Path(file)
    if path.suffix.lower() == ".gltf":
        raise RobotFileError("keeps its points in other files")
    return path.name, hashlib.sha256(MESHES.read(path)).digest()


@cache
def _code() -> bytes:
    """What tells this version of the code from another one."""
    sums = hashlib.sha256()
    for module in sorted(Path(__file__).parent.glob("*.py")):
        sums.update(module.read_bytes())
    for library in _LIBRARIES:
        with suppress(PackageNotFoundError):
            sums.update(f"{library} {version(library)};".encode())
    return sums.digest()


def _read(kind: type[T], path: Path) -> T | None:
    try:
        with open(path, "rb", opener=_without_links) as file:
            if not is_own_file(os.fstat(file.fileno())):  # others could have written it
                return None
            mark, digest, data = file.read(len(_MARK)), file.read(32), file.read(MOST_OF_ONE)
    except OSError:
        return None
    if mark != _MARK or hashlib.sha256(data).digest() != digest:
        return None
    try:
        found = msgspec.msgpack.decode(data, type=kind, dec_hook=_array)
    except (msgspec.MsgspecError, ValueError, TypeError):
        return None
    with suppress(OSError):
        os.utime(path)  # the entry that was used longest ago goes first
    return found


def _without_links(path: str, flags: int) -> int:
    return open_at_once(path, flags | getattr(os, "O_NOFOLLOW", 0))


def _write(path: Path, made: object) -> None:
    data = msgspec.msgpack.encode(made, enc_hook=_plain)
    if len(data) > MOST_OF_ONE:
        return
    try:
        private_folder(path.parent)
        path.unlink(missing_ok=True)
        write_atomically(path, _MARK + hashlib.sha256(data).digest() + data, private=True)
        _sweep(path)
    except (OSError, RobotFileError) as cause:
        _LOG.info("what was made of the meshes is not kept: %s", cause)


def _sweep(newest: Path) -> None:
    """Let the entries go that were used longest ago, where all together are too large."""
    found = [(one, one.stat()) for one in newest.parent.iterdir() if one != newest]
    left = MOST_BYTES - newest.stat().st_size
    for path, status in sorted(found, key=lambda one: one[1].st_mtime, reverse=True):
        left -= status.st_size
        if left < 0:
            path.unlink(missing_ok=True)


# Arrays as their bytes.


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray):
        given = cast("NDArray[Any]", value)
        array = np.ascontiguousarray(given).astype(_DTYPES[given.dtype.kind in "iu"])
        return array.dtype.str, array.shape, array.tobytes()
    raise TypeError(f"{value!r} is not kept")


def _array(kind: type, value: Any) -> Any:
    dtype, shape, data = msgspec.convert(value, tuple[str, tuple[int, ...], bytes])
    if dtype not in _DTYPES:
        raise ValueError(f"{kind}: no {dtype} is kept")
    array = np.frombuffer(data, dtype).reshape(shape).copy()
    if not np.isfinite(array).all():
        raise ValueError(f"{kind}: a number is not finite")
    return array
