"""The array type of the whole package, and values that are equal by the arrays they hold."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any, ClassVar, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
"""float64; every docstring gives its shape, and the unit and frame of its numbers"""


def read_only(values: ArrayLike) -> FloatArray:
    """A copy that cannot be written to: threads share it."""
    return lock(np.array(values, dtype=np.float64))


A = TypeVar("A", bound=NDArray[Any])


def lock(array: A) -> A:
    """The same array; nobody may write to it any more."""
    array.flags.writeable = False
    return array


def _locked(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return lock(cast("NDArray[Any]", value).copy())
    if isinstance(value, Mapping):
        items = cast("Mapping[str, Any]", value)
        return MappingProxyType({key: _locked(one) for key, one in items.items()})
    return value


def content(value: Any) -> Any:
    """Something that compares, and hashes, as ``value`` does by its content: arrays entry by entry."""
    if isinstance(value, np.ndarray):
        array = cast("NDArray[Any]", value) + 0.0  # -0.0 is 0.0; NaN is NaN
        return array.shape, array.tobytes()
    if isinstance(value, Mapping):
        items = cast("Mapping[str, Any]", value)
        return tuple(sorted((key, content(one)) for key, one in items.items()))
    if isinstance(value, tuple):
        return tuple(map(content, cast("tuple[Any, ...]", value)))
    return value


class ByContent:
    """Base of immutable values that are equal, and hashed, by what they are made of.

    Copies and what comes out of a pickle are made of it anew, so that their arrays are read-only, too.
    """

    __slots__ = ()

    def made_of(self) -> tuple[Any, ...]:
        """The arguments that make an equal value."""
        raise NotImplementedError

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if type(other) is not type(self):
            return NotImplemented
        ours, theirs = self.made_of(), other.made_of()
        return all(content(one) == content(another) for one, another in zip(ours, theirs, strict=True))

    def __hash__(self) -> int:
        return hash(content(self.made_of()))

    def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
        return type(self), tuple(map(_plain, self.made_of()))


class ArrayRecord(ByContent):
    """Base of frozen dataclasses (``eq=False``) that hold arrays, of which they keep read-only copies."""

    __slots__ = ()
    __dataclass_fields__: ClassVar[dict[str, Any]]

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.init:
                object.__setattr__(self, field.name, _locked(getattr(self, field.name)))

    def made_of(self) -> tuple[Any, ...]:
        """See ``ByContent``."""
        return tuple(getattr(self, field.name) for field in fields(self) if field.init)


def _plain(value: Any) -> Any:
    """A read-only mapping cannot be pickled."""
    return dict(cast("Mapping[str, Any]", value)) if isinstance(value, MappingProxyType) else value
