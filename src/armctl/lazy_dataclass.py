"""``dataclass`` of the standard library; a class's methods are made when they are first called.

The library writes source for each method and compiles it: a millisecond a class, and half of what an arm
process computed to start. A process uses few of the classes, and compares or prints few records: its 360
classes take 80 ms instead of 500 (``python -X importtime -c "import armctl.process.__main__"``).
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable
from functools import cache, partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dataclasses import dataclass

__all__ = ["dataclass"]


def _dataclass(
    cls: Any = None, /, *, frozen: bool = False, slots: bool = False, eq: bool = True, repr: bool = True
) -> Any:
    decorate = partial(_decorated, frozen=frozen, slots=slots, eq=eq, repr=repr)
    return decorate if cls is None else decorate(cls)


if not TYPE_CHECKING:
    dataclass = _dataclass  # a type checker sees the library's


def _decorated(cls: Any, *, frozen: bool, slots: bool, eq: bool, repr: bool) -> Any:
    own = dict(cls.__dict__)
    if own.get("__hash__", ...) is None and "__eq__" in own:
        del own["__hash__"]  # not the class's own: Python put it there
    if cls.__doc__ is None:
        cls.__doc__ = cls.__name__  # the library would put a signature there
    derived = any(map(dataclasses.is_dataclass, cls.__mro__[1:]))  # then the library looks at its bases, too
    cls = dataclasses.dataclass(init=False, repr=False, eq=False, frozen=frozen and derived, slots=slots)(cls)
    params = cls.__dataclass_params__  # what the library asks of the bases of a class
    params.init, params.repr, params.eq, params.frozen = True, repr, eq, frozen
    if frozen and not derived:
        _freeze(cls, own, slots=slots)
    for name, wanted in {"__init__": True, "__repr__": repr, "__eq__": eq, "__hash__": eq and frozen}.items():
        if wanted and name not in own:
            setattr(cls, name, _made_when_called(cls, name, partial(_made, cls, name, frozen, slots)))
    if eq and not frozen and "__hash__" not in own:
        cls.__hash__ = None
    if "__init__" not in own:
        cls.__signature__ = _Signature(cls, partial(_made, cls, "__init__", frozen, slots))
    return cls


def _freeze(cls: Any, own: dict[str, Any], *, slots: bool) -> None:
    names = frozenset(field.name for field in dataclasses.fields(cls))
    above: Any = partial(super, cls)
    for name in ("__setattr__", "__delattr__"):
        if name in own:
            raise TypeError(f"Cannot overwrite attribute {name} in class {cls.__name__}")

    def set_value(self: Any, name: str, value: Any) -> None:
        if type(self) is cls or name in names:
            raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")
        above(self).__setattr__(name, value)

    def delete_value(self: Any, name: str) -> None:
        if type(self) is cls or name in names:
            raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")
        above(self).__delattr__(name)

    cls.__setattr__, cls.__delattr__ = set_value, delete_value
    if slots:  # for copies and pickles
        cls.__getstate__ = own.get("__getstate__", _values)
        cls.__setstate__ = own.get("__setstate__", _set_values)


def _values(self: Any) -> list[Any]:
    return [getattr(self, field.name) for field in dataclasses.fields(self)]


def _set_values(self: Any, values: list[Any]) -> None:
    for field, value in zip(dataclasses.fields(self), values, strict=True):
        object.__setattr__(self, field.name, value)


def _made_when_called(cls: Any, name: str, make: Callable[[], Any]) -> Callable[..., Any]:
    make = cache(make)

    def first(self: Any, /, *args: Any, **named: Any) -> Any:
        made = make()
        if cls.__dict__.get(name) is first:  # else another thread was faster, or somebody has wrapped it
            setattr(cls, name, made)
        return made(self, *args, **named)

    return first


def _made(cls: Any, name: str, frozen: bool, slots: bool) -> Any:
    """The method that the library makes of a class with the same fields."""
    names = ("__module__", "__qualname__", "__doc__", "__post_init__")
    twin = dataclasses.make_dataclass(
        cls.__name__,
        [(field.name, field.type, field) for field in dataclasses.fields(cls)],
        namespace={name: getattr(cls, name) for name in names if hasattr(cls, name)},
        init=name == "__init__",
        repr=name == "__repr__",
        eq=name in ("__eq__", "__hash__"),
        frozen=frozen and name in ("__init__", "__hash__"),
        slots=slots and name == "__init__",
    )
    return twin.__dict__[name]


class _Signature:
    """What ``help`` and ``inspect.signature`` say of a class whose ``__init__`` may not be made yet."""

    def __init__(self, cls: Any, make_init: Callable[[], Any]) -> None:
        self._cls, self._make_init = cls, make_init

    def __get__(self, instance: object, owner: Any) -> inspect.Signature:
        if instance is not None:
            raise AttributeError("__signature__")  # of what it does when it is called
        inherits = owner.__init__ is self._cls.__init__
        whole = inspect.signature(self._make_init() if inherits else owner.__init__)
        return whole.replace(parameters=list(whole.parameters.values())[1:])
