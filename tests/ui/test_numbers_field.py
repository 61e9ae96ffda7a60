"""What a field for several numbers takes."""

from __future__ import annotations

import pytest

from armctl.errors import InputError
from armctl.ui.widgets.number_field import parse_numbers

XYZ = ("X", "Y", "Z")


@pytest.mark.parametrize(
    "text", ["220, -196, 85", "220 −196 85", " (220; -196; 85.0) ", "[220,-196,85]", "220\t-196,  85,"]
)
def test_commas_spaces_semicolons_and_brackets(text: str) -> None:
    assert parse_numbers(text, "End", XYZ) == [220.0, -196.0, 85.0]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", r"End: 3 numbers are needed \(X, Y, Z\), got 0; put commas or spaces"),
        ("1, 2", "got 2"),
        ("1 2 3 4", "got 4"),
        ("1, two, 3", "End: Y: 'two' is not a number"),
        ("1, 2, inf", "End: Z: 'inf' is not a number that can be used"),
        ("1, 2, 1e9", "End: Z"),
    ],
)
def test_what_is_no_number_is_named(text: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        parse_numbers(text, "End", XYZ)
