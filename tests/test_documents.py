"""What a user reads of a document that is wrong: line, key, value and what is allowed."""

from __future__ import annotations

import multiprocessing
import os
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import pytest
from msgspec import Meta

from armctl.decoding import line_of, refusal_of
from armctl.documents import DocumentKind, claim, sweep_litter, write_atomically
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
        ("[named.k]\nway = 'x'", "line 2, key named.k.way: must be one of 'down', 'up', not 'x'"),
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


@pytest.mark.parametrize(
    ("record", "says"),
    [
        ({"one": {"share": 2}}, "must be more than 0 and at most 1, not 2"),
        ({"named": {"k": {"way": 3}}}, "must be text, not 3"),
        ({"colours": [{}]}, "the key 'kind' is missing"),
        ({"pair": [1, "x"]}, "must be a number, not 'x'"),
        ({"maybe": 1}, "unknown key 'maybe'; mistyped?"),
    ],
)
def test_what_is_wrong_is_found_in_the_record_and_not_in_the_words_of_a_library(
    record: dict[str, object], says: str
) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(record, File)
    assert refusal_of(msgspec.ValidationError("other words"), record, File).what == says


def test_what_an_editor_puts_into_a_file_does_not_matter() -> None:
    assert KIND.decode(b"\xef\xbb\xbflevel = 2\r\n", File) == File(level=2)


def test_lines_are_found_outside_strings_and_comments() -> None:
    text = "a = '''\n[b]\n'''\n# [b]\n[b] # here\n'c d'.e = 1\n[[f]]\n[f.g]\nh = [\n [1],\n]\n"
    places = [("a",), ("b",), ("b", "c d", "e"), ("f", 0), ("f", 0, "g", "h", 0), ("f", 0, "none"), ("none",)]
    assert [line_of(text, place) for place in places] == [1, 5, 6, 7, 10, 7, None]


def test_only_regular_files_that_are_not_too_large_are_read(tmp_path: Path) -> None:
    large, pipe = tmp_path / "large", tmp_path / "pipe"
    large.write_bytes(b"#" * 1025)
    os.mkfifo(pipe)
    for path, says in (
        (large, "large: is larger than 1 KiB"),
        (pipe, "pipe: cannot be read: it is a named pipe, no regular file"),
        (tmp_path, "cannot be read: it is a folder, no regular file"),
        (tmp_path / "none", "none: cannot be read: No such file"),
        (Path("/dev/zero"), "/dev/zero: cannot be read: it is a device, no regular file"),
        (Path("a\0b"), "cannot be read: embedded null byte"),
    ):
        with pytest.raises(InputError, match=says):
            KIND.load(path, lambda content: KIND.decode(content, File))


def test_what_a_file_seemed_to_be_is_not_trusted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It may become another between the question and the opening, and /proc says that its files are empty."""
    regular, pipe, large = tmp_path / "regular", tmp_path / "pipe", tmp_path / "large"
    regular.write_bytes(b"")
    large.write_bytes(b"#" * 2000)
    os.mkfifo(pipe)
    seemed = regular.stat()
    monkeypatch.setattr(os, "stat", lambda _: seemed)
    with pytest.raises(InputError, match="it is a named pipe"):
        KIND.read(pipe)
    monkeypatch.setattr(os, "fstat", lambda _: seemed)
    with pytest.raises(InputError, match="larger than 1 KiB"):
        KIND.read(large)


MANY = DocumentKind(InputError, most_bytes=1024 * 1024, largest=1e6)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("\nx = " + "9" * 5000, "^line 2: a whole number of more than 400 digits$"),
        ("x = 0x" + "f" * 500_000, "^line 1: a whole number of more than 400 digits$"),
        ("big = " + "9" * 300, r"^line 1, key big: must be within ±1e\+06, not 99999\d+\.\.\.9+$"),
        ("x = " + "[" * 400_000, "nested too deep"),
        ("x = " + "{a = " * 200_000, "nested too deep"),
        ("a." * 200_000 + "a = 1", "^line 1: a key of more than 16 parts$"),
        ("[" + "a . " * 200_000 + "a]", "a key of more than 16 parts"),
        ("\n\n" + "'a'.\"b\"." * 100_000 + "a = 1", "^line 3: a key of more than 16 parts$"),
        ("x = {" + "a." * 20 + "a = 1}", "a key of more than 16 parts"),
        ("title = 'a\0b'", "^line 1, column 11: (illegal|found invalid) character"),
        ("title = 'é'".encode("latin-1"), "not a text file in UTF-8: byte 10 cannot be read"),
        ("title = 'x'".encode("utf-16"), "UTF-16; save it as UTF-8"),
        ("title = 'x'".encode("utf-32"), "UTF-16; save it as UTF-8"),
    ],
)
def test_what_was_made_to_hurt_is_one_line_soon(text: str | bytes, says: str) -> None:
    """Without the bounds the long keys take hours, and the long numbers are an error inside the program."""
    with pytest.raises(InputError, match=says) as refusal:
        MANY.decode(text, File)
    assert len(str(refusal.value)) < 120


def test_dots_and_digits_of_people_are_read() -> None:
    dotted = "title = '0.1.2 ............................ 3' # ... . . . . . . . . . . . . . . . . . ."
    numbers = "[" + ", ".join(["0.5"] * 200) + "]"
    assert MANY.parse(f"{dotted}\nbig = 1.{'0' * 500}\nx = {numbers}").record["big"] == 1.0


def test_nothing_but_a_regular_file_is_written_over(tmp_path: Path) -> None:
    pipe = tmp_path / "x.toml"
    os.mkfifo(pipe)
    with pytest.raises(OSError, match="it is a named pipe"):
        write_atomically(pipe, b"1", keep=True)
    assert list(tmp_path.iterdir()) == [pipe]


def _begin_a_save(folder: str) -> None:
    assert claim(Path(folder) / ".000007.claim")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda _: os._exit(9))
        write_atomically(Path(folder) / "deep" / "x.toml", b"half")


def test_litter_of_killed_saves_is_swept(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    killed = multiprocessing.get_context("spawn").Process(target=_begin_a_save, args=(str(tmp_path),))
    killed.start()
    killed.join()
    assert killed.exitcode == 9
    (tmp_path / ".uzuner.toml.ab3_xy12.new").touch()
    assert claim(tmp_path / ".000009.claim")  # by this process, so it is of an earlier one with its number
    (tmp_path / ".000010.claim").write_text("1")  # another user's, or that of the first of all processes
    kept = [tmp_path / name for name in ("x.new", ".x.new", ".mine.claim", "x.toml", "x.toml~")]
    for path in kept:
        path.touch()
    names = {path.name for path in tmp_path.rglob("*.new") if path.parent.name == "deep"}
    assert len(names) == 1
    now = tmp_path.stat().st_mtime
    assert sweep_litter(tmp_path, now + 30) == []
    swept = {path.name for path in sweep_litter(tmp_path, now + 90)}
    assert swept == {*names, ".uzuner.toml.ab3_xy12.new", ".000007.claim", ".000009.claim"}
    assert sorted(tmp_path.iterdir()) == sorted([*kept, tmp_path / ".000010.claim", tmp_path / "deep"])
    assert not claim(tmp_path / ".000010.claim")


def test_a_new_file_is_for_everybody_to_read_and_an_old_one_keeps_its_mode(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    write_atomically(path, b"1")
    assert path.stat().st_mode & 0o777 == 0o644
    path.chmod(0o600)
    write_atomically(path, b"2", keep=True)
    assert (path.read_bytes(), (tmp_path / "x.toml~").read_bytes()) == (b"2", b"1")
    assert path.stat().st_mode & 0o777 == 0o600
    assert len(list(tmp_path.iterdir())) == 2
