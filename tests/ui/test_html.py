from __future__ import annotations

import re
from collections.abc import Callable
from html import unescape

import pytest

from armctl.ui.widgets.html import fixed, limited, muted, refused, warned


def test_a_long_text_keeps_its_height_and_can_be_read_to_its_end() -> None:
    text = "homing ended: <Shoulder> found no 'zero'; " * 20
    html = limited(text, 4, "color:red")
    assert "max-height:6.0em;overflow-y:auto;color:red" in html
    told = re.fullmatch(r"<div style='[^']*' title='([^']*)'>(.*)</div>", html)
    assert told is not None
    assert [unescape(part) for part in told.groups()] == [text, text]
    assert "<Shoulder>" not in html


@pytest.mark.parametrize("block", [muted, refused, warned])
def test_what_is_told_is_text_and_has_the_minus_of_the_figures_beside_it(block: Callable[[str], str]) -> None:
    html = block("<b>Elbow</b>: -91.2° is outside -84.36° … 95.07°; see ik-1, 2026-11-21")
    assert "&lt;b&gt;Elbow&lt;/b&gt;: −91.2° is outside −84.36° … 95.07°; see ik-1, 2026-11-21<" in html


@pytest.mark.parametrize(
    ("value", "text"), [(-1.25, "−1.2"), (-0.01, "0.0"), (float("nan"), "–"), (float("inf"), "–")]
)
def test_numbers_have_no_negative_zero(value: float, text: str) -> None:
    assert fixed(value, 1) == text
