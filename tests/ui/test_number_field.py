"""Number fields: what they show is what is used, or nothing is."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
import viser

from armctl.errors import InputError
from armctl.ui.guard import GuardedServer
from armctl.ui.widgets import number_field
from armctl.ui.widgets.number_field import (
    EditWatch,
    NumberField,
    format_number,
    parse_number,
    parse_numbers,
)


@pytest.mark.parametrize(
    ("text", "value"),
    [("45", 45.0), (" -3.5 ", -3.5), ("−12", -12.0), ("1e2", 100.0), ("1.", 1.0), ("0" * 39 + "1", 1.0)],
)
def test_numbers_are_read(text: str, value: float) -> None:
    assert parse_number(text, "X") == value


@pytest.mark.parametrize("text", ["", "   ", "-", "1.5.2", "abc", "nan", "-inf", "1e999", "1e7", "0x10"])
def test_what_is_no_usable_number_is_refused_by_name(text: str) -> None:
    with pytest.raises(InputError, match=r"^Elbow °"):
        parse_number(text, "Elbow °")


def test_a_decimal_comma_is_explained_and_many_digits_are_refused_by_their_length(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with pytest.raises(InputError, match=r"write 1\.5, with a point"):
        parse_number("45,5", "X mm")
    assert parse_number("45,5", "Duration s", comma=True) == 45.5
    assert parse_number("−,5", "Pitch °", comma=True) == -0.5
    for text in ("1,2,3", "1,234.5", ","):
        with pytest.raises(InputError, match="Duration s"):
            parse_number(text, "Duration s", comma=True)
    monkeypatch.setattr(number_field, "_NUMBER", None)  # with it, the time would grow with the square
    for text in ("0" * 41, "1" * 100_000 + "x"):
        with pytest.raises(InputError, match="is not a number"):
            parse_number(text, "X")


@pytest.mark.parametrize(
    ("value", "text"), [(-1e-9, "0"), (1.25, "1.25"), (-80.12345, "-80.123"), (100.0, "100")]
)
def test_a_field_shows_no_needless_zeros(value: float, text: str) -> None:
    assert format_number(value) == text


def test_a_filled_field_keeps_all_digits_until_it_is_edited(server: GuardedServer) -> None:
    field = NumberField(server.gui, "X mm", 1.0)
    field.fill(math.pi)
    assert (field.text, field.value) == ("3.142", math.pi)
    field.handle.value = "3.1"
    assert field.value == 3.1
    field.handle.value = ""
    with pytest.raises(InputError, match="X mm is empty"):
        _ = field.value


def test_a_click_that_comes_with_an_edit_is_refused_and_the_page_shown_what_the_server_has(
    server: GuardedServer,
) -> None:
    now, sent, callbacks = [10.0], list[str](), list[Callable[[Any], Any]]()
    field = NumberField(server.gui, "Z mm", 4.0)
    watch = EditWatch([field], lambda: now[0])
    watch.watch(callbacks.append)

    @field.handle.on_update
    def _(event: viser.GuiEvent[viser.GuiTextHandle]) -> None:
        sent.append(event.target.value)

    def edit(*, by_page: bool) -> None:
        with pytest.raises(StopIteration):
            callbacks[0](SimpleNamespace(client=object() if by_page else None)).send(None)

    watch.require_settled()
    edit(by_page=False)
    watch.require_settled()  # what the program fills in is no edit
    edit(by_page=True)
    now[0] += 0.06
    with pytest.raises(InputError, match="still being edited"):
        watch.require_settled()
    assert (field.value, sent[-1]) == (4.0, "4")
    now[0] += 0.9
    sent.clear()
    watch.require_settled()
    assert sent[-1] == "4"
    now[0] += 0.1
    sent.clear()
    watch.require_settled()
    assert sent == []


XYZ = ("X", "Y", "Z")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", r"End: 3 numbers are needed \(X, Y, Z\), got 0; put commas or spaces"),
        ("1 2 3 4", "got 4"),
        ("1, two, 3", "End: Y: 'two' is not a number"),
        ("1, 2, inf", "End: Z: 'inf' is not a number that can be used"),
    ],
)
def test_numbers_are_read_however_they_are_parted_and_what_is_none_is_named(text: str, why: str) -> None:
    for good in ("220, -196, 85", "220 −196 85", " (220; -196; 85.0) ", "[220,-196,\t85,]"):
        assert parse_numbers(good, "End", XYZ) == [220.0, -196.0, 85.0]
    with pytest.raises(InputError, match=why):
        parse_numbers(text, "End", XYZ)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("12,5", r"Times N: '12,5' is not a number"),
        ("2.5", r"Times N: 2\.5 is no whole number"),
        ("0", r"Times N: 0 is outside 1 … 1000"),
        ("−3", r"Times N: -3 is outside 1 … 1000"),
        ("1001", r"Times N: 1001 is outside 1 … 1000"),
        ("", r"Times N is empty"),
    ],
)
def test_a_count_outside_its_range_is_refused_by_its_name(server: GuardedServer, text: str, why: str) -> None:
    field = NumberField(server.gui, "Times N", 3)
    assert field.whole(1, 1000) == 3
    field.handle.value = text
    with pytest.raises(InputError, match=why):
        field.whole(1, 1000)


def test_a_number_outside_its_range_is_refused_with_as_many_digits_as_tell_it(server: GuardedServer) -> None:
    field = NumberField(server.gui, "Wait s", 1.0)
    assert field.within(0, 86_400) == 1.0
    field.handle.value = "86400.5"
    with pytest.raises(InputError, match=r"Wait s: 86400\.5 is outside 0 … 86400"):
        field.within(0, 86_400)
