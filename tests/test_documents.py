"""What a user reads of a document that is wrong: line, key, value and what is allowed."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import pytest
from msgspec import Meta

from armctl.documents import DocumentKind, line_of, write_atomically
from armctl.errors import InputError


class Inner(msgspec.Struct, forbid_unknown_fields=True):
    """A table inside the file."""

    way: Literal["up", "down"] = "up"
    maybe: Literal["here"] | None = None
    share: Annotated[float, Meta(gt=0, le=1)] = 0.5


class Red(msgspec.Struct, tag_field="kind", tag="red"):
    """One of two kinds."""

    shade: Annotated[int, Meta(le=3)]


class Blue(msgspec.Struct, tag_field="kind", tag="blue"):
    """The other one."""


class File(msgspec.Struct, forbid_unknown_fields=True):
    """A file with every place that a value may stand in."""

    level: Literal[1, 2] = 1
    one: Inner | None = None
    many: tuple[Inner, ...] = ()
    named: dict[str, Inner] = {}
    words: list[Literal["a", "b"]] = []
    pair: tuple[float, float] = (0, 0)
    name: Annotated[str, Meta(pattern="^[a-z]+$")] = "x"
    title: Annotated[str, Meta(min_length=1)] = "x"
    renamed: Literal["x"] = msgspec.field(default="x", name="re-named")
    colours: tuple[Red | Blue, ...] = ()
    big: float = 0


KIND = DocumentKind(InputError, most_bytes=1024, largest=1e6, entries={"many": "part"})


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("level = 3", "line 1, key level: must be one of 1, 2, not 3"),
        ("\n[one]\nway = 'left'", "line 3, key one.way: must be one of 'down', 'up', not 'left'"),
        ("one = {maybe = 'there'}", "line 1, key one.maybe: must be 'here', not 'there'"),
        ("[one]\nshare = 0", "line 2, key one.share: must be more than 0 and at most 1, not 0"),
        ("[[many]]\n[[many]]\nway = 'x'", "line 3, part 2, key way: must be one of 'down', 'up', not 'x'"),
        ("[[many]]\nwey = 'x'", "line 2, part 1: unknown key 'wey'; mistyped?"),
        ("[named.k]\nway = 'x'", "key named.*.way: must be one of 'down', 'up', not 'x'"),
        ("words = ['a', 'c']", "line 1, key words[1]: must be one of 'a', 'b', not 'c'"),
        ("re-named = 'y'", "line 1, key re-named: must be 'x', not 'y'"),
        ("pair = [1]", "line 1, key pair: must have 2 values, not [1]"),
        ("pair = [1, 2e6]", "line 1, key pair[1]: must be within ±1e+06, not 2000000.0"),
        ("pair = [1, nan]", "line 1, key pair[1]: nan is no number to use"),
        ("big = 3000000", "line 1, key big: must be within ±1e+06, not 3000000"),
        (f"big = {'9' * 400}", "line 1, key big: number out of range"),
        ("a = 1 2", "line 1, column 7: "),
        ("name = 'A'", "line 1, key name: a name must match ^[a-z]+$, not 'A'"),
        ("title = ''", "line 1, key title: must have at least 1 character, not ''"),
        ("title = 3", "line 1, key title: must be text, not 3"),
        ("one = 3", "line 1, key one: must be a table or left out, not 3"),
        ("colours = [{kind = 'pink'}]", "key colours[0].kind: must be one of 'red', 'blue', not 'pink'"),
        ("[[colours]]\nkind = 'red'\nshade = 4", "line 3, key colours[0].shade: must be at most 3, not 4"),
        ("[[colours]]\nkind = 'red'", "line 1, key colours[0]: the key 'shade' is missing"),
        ("[one", "at the end of the file"),
        ("a = '''", "at the end of the file"),
        (b"\xff\xfex", "in UTF-16; save it as UTF-8"),
        (b"a = '\xe9'", "byte 6 cannot be read; save it as UTF-8"),
        ("#" * 1025, "is larger than 1 KiB"),
        ("a = " + "[" * 1000, "nested too deep"),
    ],
)
def test_a_refusal_says_where_what_and_what_is_allowed(text: str | bytes, says: str) -> None:
    with pytest.raises(InputError) as refused:
        KIND.decode(text, File)
    assert says in str(refused.value)


def test_what_an_editor_puts_into_a_file_does_not_matter() -> None:
    assert KIND.decode(b"\xef\xbb\xbflevel = 2\r\n", File) == File(level=2)


def test_lines_are_found_outside_strings_and_comments() -> None:
    text = "a = '''\n[b]\n'''\n# [b]\n[b] # here\n'c d'.e = 1\n[[f]]\n[f.g]\nh = [\n [1],\n]\n"
    places = [("a",), ("b",), ("b", "c d", "e"), ("f", 0), ("f", 0, "g", "h", 0), ("f", 0, "none"), ("none",)]
    assert [line_of(text, place) for place in places] == [1, 5, 6, 7, 9, 7, None]


def test_only_regular_files_that_are_not_too_large_are_read(tmp_path: Path) -> None:
    large, pipe = tmp_path / "large", tmp_path / "pipe"
    large.write_bytes(b"#" * 1025)
    os.mkfifo(pipe)
    for path, says in (
        (large, "large: is larger than 1 KiB"),
        (pipe, "pipe: cannot be read: it is no regular file"),
        (tmp_path, "cannot be read: Is a directory"),
        (tmp_path / "none", "none: cannot be read: No such file"),
        (Path("/dev/zero"), "/dev/zero: cannot be read: it is no regular file"),
    ):
        with pytest.raises(InputError, match=says):
            KIND.load(path, lambda content: KIND.decode(content, File))


def test_a_new_file_is_for_everybody_to_read_and_an_old_one_keeps_its_mode(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    write_atomically(path, b"1")
    assert path.stat().st_mode & 0o777 == 0o644
    path.chmod(0o600)
    write_atomically(path, b"2", keep=True)
    assert (path.read_bytes(), (tmp_path / "x.toml~").read_bytes()) == (b"2", b"1")
    assert path.stat().st_mode & 0o777 == 0o600
    assert len(list(tmp_path.iterdir())) == 2
