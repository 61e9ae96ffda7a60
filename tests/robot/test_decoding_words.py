"""What a user reads of a value that is no choice of its key; everything else stays as msgspec says it."""

from __future__ import annotations

from typing import Literal

import msgspec
import pytest

from armctl.robot.file import decoding_words


class Inner(msgspec.Struct, forbid_unknown_fields=True):
    """A table inside the file."""

    way: Literal["up", "down"] = "up"
    maybe: Literal["here"] | None = None


class File(msgspec.Struct, forbid_unknown_fields=True):
    """A file with every place that a choice may stand in."""

    level: Literal[1, 2] = 1
    one: Inner | None = None
    many: tuple[Inner, ...] = ()
    named: dict[str, Inner] = {}
    words: list[Literal["a", "b"]] = []
    renamed: Literal["x"] = msgspec.field(default="x", name="re-named")


def words(text: str) -> str:
    with pytest.raises(msgspec.DecodeError) as refused:
        msgspec.json.decode(text, type=File)
    return decoding_words(refused.value, File)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('{"level": 3}', "level = 3: must be one of 1, 2"),
        ('{"one": {"way": "left"}}', "one.way = 'left': must be one of 'down', 'up'"),
        ('{"one": {"maybe": "there"}}', "one.maybe = 'there': must be 'here'"),
        ('{"many": [{}, {"way": "left"}]}', "many[1].way = 'left': must be one of 'down', 'up'"),
        ('{"named": {"k": {"way": "x"}}}', "named[...].way = 'x': must be one of 'down', 'up'"),
        ('{"words": ["a", "c"]}', "words[1] = 'c': must be one of 'a', 'b'"),
        ('{"re-named": "y"}', "re-named = 'y': must be 'x'"),
        ('{"one": {"way": "a - at `$.level`"}}', "one.way = 'a - at `$.level`': must be one of 'down', 'up'"),
    ],
)
def test_a_value_that_is_no_choice(text: str, says: str) -> None:
    assert words(text) == says


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('{"level": "one"}', "Expected `int`, got `str` - at `$.level`"),
        ('{"lvl": 1}', "Object contains unknown field `lvl`"),
        ('{"one": 4}', "Expected `object | null`, got `int` - at `$.one`"),
        ("{", "Input data was truncated"),
    ],
)
def test_other_errors_keep_their_words(text: str, says: str) -> None:
    assert words(text) == says
