"""A record of ours and one of the standard library are told apart by nothing but their class."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
import re
import threading
from collections.abc import Callable
from dataclasses import FrozenInstanceError, field
from pathlib import Path
from typing import Any, ClassVar

import msgspec
import pytest

import armctl
from armctl.lazy_dataclass import dataclass

Decorator = Callable[..., Any]
OPTIONS = [
    {},
    {"frozen": True},
    {"frozen": True, "slots": True},
    {"frozen": True, "slots": True, "eq": False},
    {"frozen": True, "eq": False, "repr": False},
    {"slots": True},
    {"eq": False},
]


def point(decorator: Decorator, **options: bool) -> Any:
    """A class with every kind of field, that counts what is made of it."""

    @decorator(**options)
    class Point:
        made: ClassVar[list[object]] = []
        x: float
        y: float = 2.0
        name: str = field(default="p", compare=False, repr=False)
        more: list[int] = field(default_factory=list[int])
        norm: float = field(init=False, default=0.5)
        z: float = field(default=3.0, kw_only=True)

        def __post_init__(self) -> None:
            self.made.append(self.x)
            object.__setattr__(self, "norm", self.x + self.y)

    return Point


def told(make: Callable[[], object]) -> object:
    """What comes of it, or the error that it ends in."""
    try:
        return make()
    except (TypeError, AttributeError) as error:
        return type(error), str(error)


def described(Point: Any) -> list[object]:
    """What a program can find out of a class and of its records."""
    a, b = Point(1.0), Point(1.0, name="other")
    c = Point(x=4.0, y=5.0, more=[1], z=6.0)
    return [
        [told(lambda one=one: (one.x, one.y, one.name, one.more, one.norm, one.z)) for one in (a, b, c)],
        a.more is not b.more,
        Point.made,
        [a == a, a == b, a == c, a != b, a == 1],
        [told(lambda one=one: hash(one) == hash(b)) for one in (a, c)],
        repr(c).partition(" object at ")[0],
        [(one.name, one.type, one.init, one.kw_only) for one in dataclasses.fields(Point)],
        dataclasses.asdict(c),
        told(lambda: repr(dataclasses.replace(c, x=7.0).x)),
        str(inspect.signature(Point)),
        Point.__match_args__,
        [getattr(Point.__dataclass_params__, key) for key in ("init", "repr", "eq", "frozen")],
        hasattr(a, "__dict__"),
        copy.copy(c).more is c.more,
        copy.deepcopy(c).more,
        told(lambda: setattr(a, "x", 1.0)),
        told(lambda: delattr(a, "y")),
        hasattr(a, "__dict__") and [told(lambda: setattr(a, "no", 1.0)), told(lambda: delattr(a, "no"))],
        [told(lambda: Point()), told(lambda: Point(1.0, 2.0, "n", [], 1.0)), told(lambda: Point(1.0, no=1))],
        msgspec.to_builtins(c),
        msgspec.to_builtins(msgspec.convert({"x": 1.0, "z": 9.0}, Point)),
        inspect.signature(Point.__init__).return_annotation,
    ]


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_it_does_what_the_library_does(options: dict[str, bool]) -> None:
    assert described(point(dataclass, **options)) == described(point(dataclasses.dataclass, **options))


def family(decorator: Decorator) -> list[Any]:
    """Four classes, each derived from the one before."""

    @decorator(frozen=True, slots=True)
    class Base:
        a: int

    @decorator(frozen=True, slots=True)
    class Derived(Base):
        b: int = 2

        def __repr__(self) -> str:
            return f"<{self.a} {self.b}>"

    @decorator(frozen=True)
    class Compared(Derived):
        c: int = 3

        def __eq__(self, other: object) -> bool:
            return isinstance(other, Compared) and self.c == other.c

    class Plain(Compared):
        def __init__(self, a: int) -> None:
            super().__init__(a, 5)

    return [Base, Derived, Compared, Plain]


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0)], ids=["bases first", "derived first"])
def test_classes_that_are_derived(order: tuple[int, ...]) -> None:
    def described(kinds: list[Any]) -> list[object]:
        made = {k: kinds[k](1) for k in order}
        return [
            [repr(made[k]).rpartition(".")[2] for k in order],
            [[one == another for one in made.values()] for another in made.values()],
            [told(lambda k=k: hash(made[k]) == hash(kinds[k](1))) for k in order],
            [str(inspect.signature(kinds[k])) for k in order],
            [told(lambda k=k: setattr(made[k], "a", 2)) for k in order],
        ]

    assert described(family(dataclass)) == described(family(dataclasses.dataclass))


def test_the_librarys_dataclasses_derive_from_it_and_it_from_them() -> None:
    theirs, ours = dataclasses.dataclass(frozen=True), dataclass(frozen=True)

    @ours
    class A:
        a: int

    @theirs
    class B(A):
        b: int

    @ours
    class C(B):
        c: int

    one = C(1, 2, 3)
    assert (one, hash(one), repr(one).rpartition(".")[2]) == (C(1, 2, 3), hash((1, 2, 3)), "C(a=1, b=2, c=3)")
    for name in ("a", "unknown"):
        with pytest.raises(FrozenInstanceError, match=repr(name)):
            setattr(one, name, 2)
    with pytest.raises(TypeError, match="frozen"):
        dataclasses.dataclass(type("D", (A,), {}))


def test_a_method_may_be_wrapped_before_it_is_made() -> None:
    Point = point(dataclass)
    made, seen = Point.__init__, list[float]()

    def init(self: Any, *values: Any, **named: Any) -> None:
        made(self, *values, **named)
        seen.append(self.x)

    Point.__init__ = init
    assert [Point(1.0).x, Point(x=2.0).x] == seen == [1.0, 2.0]


def refusals(decorator: Decorator) -> list[object]:
    """What comes of a record that is frozen as its base is not, and of one that says itself what is set."""

    def derived(*, frozen: bool) -> object:
        base = decorator(frozen=not frozen)(type("Base", (), {"__annotations__": {"a": int}}))
        return decorator(frozen=frozen)(type("Derived", (base,), {}))

    def own(name: str) -> object:
        return decorator(frozen=True)(type("Own", (), {name: lambda *given: None}))

    return [
        *(told(lambda frozen=frozen: derived(frozen=frozen)) for frozen in (True, False)),
        *(told(lambda name=name: own(name)) for name in ("__setattr__", "__delattr__")),
    ]


def test_it_refuses_what_the_library_refuses() -> None:
    found = refusals(dataclass)
    assert found == refusals(dataclasses.dataclass)
    assert all(isinstance(one, tuple) for one in found)


@dataclass(frozen=True, slots=True)
class Kept:
    """One that a pickle finds."""

    value: tuple[int, ...]
    name: str = field(default="kept", init=False)


def test_a_pickle_is_read_before_one_is_made() -> None:
    kept = object.__new__(Kept)
    kept.__setstate__([(1, 2), "read"])  # pyright: ignore
    assert "first" in Kept.__init__.__qualname__, "nothing is made yet"
    again = pickle.loads(pickle.dumps(kept))
    assert (again, again.name, Kept.__doc__) == (kept, "read", "One that a pickle finds.")


def test_threads_may_make_the_first_one_at_the_same_time() -> None:
    for _ in range(20):
        kind, begin, made = point(dataclass, frozen=True), threading.Barrier(4), list[Any]()

        def make(kind: Any = kind, begin: threading.Barrier = begin, made: list[Any] = made) -> None:
            begin.wait()
            made.append(kind(1.0, more=[2]))

        threads = [threading.Thread(target=make) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert made == 4 * [kind(1.0, more=[2])]


def test_the_package_uses_no_other() -> None:
    package = Path(armctl.__file__).parent
    theirs = re.compile(r"^ *(from dataclasses import .*\bdataclass\b|@dataclasses\.dataclass)", re.MULTILINE)
    files = [file for file in package.rglob("*.py") if theirs.search(file.read_text(encoding="utf-8"))]
    assert files == [package / "lazy_dataclass.py"], "write: from armctl.lazy_dataclass import dataclass"
