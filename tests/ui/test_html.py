"""Pieces of HTML, and the list of what the pre-flight found."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest

import armctl.ui.tabs
from armctl.facts import Said
from armctl.motion import Finding
from armctl.motion.preflight import Unchecked
from armctl.ui.widgets.html import (
    first_error,
    fixed,
    limited,
    muted,
    refused,
    verdict_html,
    warned,
    with_minus,
)


def test_a_long_text_keeps_its_height_and_can_be_read_to_its_end() -> None:
    text = "homing ended: <Shoulder> found no 'zero'; " * 20
    html = limited(text, 4, "color:red")
    assert "max-height:6.0em;overflow-y:auto;color:red" in html
    told = re.fullmatch(r"<div style='[^']*' title='([^']*)'>(.*)</div>", html)
    assert told is not None
    assert [unescape(part) for part in told.groups()] == [text, text]
    assert "<Shoulder>" not in html


def test_no_text_of_a_tab_has_a_colour_that_is_made_for_one_theme() -> None:
    folder = Path(armctl.ui.tabs.__file__).parent
    told = {
        path.name: re.findall(r"[ ';]color:#\w+", path.read_text("utf-8")) for path in folder.rglob("*.py")
    }
    assert len(told) > 20 and {name for name, colours in told.items() if colours} == set()


@pytest.mark.parametrize("block", [muted, refused, warned])
def test_what_is_told_is_text_and_has_the_minus_of_the_figures_beside_it(block: Callable[[str], str]) -> None:
    html = block("<b>Elbow</b>: -91.2° is outside -84.36° … 95.07°; see ik-1, 2026-11-21")
    assert "&lt;b&gt;Elbow&lt;/b&gt;: −91.2° is outside −84.36° … 95.07°; see ik-1, 2026-11-21<" in html


@pytest.mark.parametrize(
    ("value", "text"), [(-1.25, "−1.2"), (-0.01, "0.0"), (float("nan"), "–"), (float("inf"), "–")]
)
def test_numbers_have_no_negative_zero(value: float, text: str) -> None:
    assert fixed(value, 1) == text


FLOOR = Finding(Said("12.3 mm below the floor", "raise the target"), 1.84, "the tool", "floor")
HOT = Finding(Said("60 % of its stall torque", "do not stay there"), 0.5, "Shoulder", "torque", "warning")


def test_what_was_not_checked_is_not_said_to_be_checked() -> None:
    html = verdict_html([])
    assert "Pre-flight: clear" in html and "self-collision, singularity, torque." in html
    html = verdict_html([], [Unchecked("torque", "gravity torque: no stall torque of any joint")])
    assert "self-collision, singularity." in html
    assert "Not checked: gravity torque" in html


def test_errors_come_first_long_lists_are_cut_steps_count_from_one_and_texts_are_escaped() -> None:
    html = verdict_html([HOT, FLOOR])
    assert "refused, 1 error and 1 warning" in html
    assert html.index("12.3 mm below the floor") < html.index("60 % of its stall torque")
    assert "✕ refused" in html and "! warning" in html
    for text in ("1.84 s", "the tool", "raise the target"):
        assert text in html
    assert "may be run, 2 warnings" in verdict_html([HOT, HOT])
    html = verdict_html([FLOOR] * 35)
    assert html.count("below the floor") == 12
    assert "and 23 more" in html
    found = [replace(FLOOR, step=6), Finding(Said("a wait takes 0 … 86400 s, not -1"), step=1)]
    html = verdict_html(found)
    assert "step 7 · 1.84 s · the tool" in html and "step 2</div>" in html
    nasty = Finding(Said("<b>", "&"), 0.0, "<img src=x onerror=alert(1)>", "obstacle")
    html = verdict_html([nasty], [Unchecked("torque", "<i>masses</i>")])
    assert not any(tag in html for tag in ("<img", "<i>", "<b>"))
    assert "&lt;img" in html and "Not checked: &lt;i&gt;masses" in html


def test_what_keeps_a_program_from_running_is_told_in_one_line() -> None:
    warning = Finding(Said("near a singularity"), severity="warning", step=0)
    far, low = Finding(Said("too far by 671.0 mm"), step=1), Finding(Said("below the floor"), step=2)
    assert first_error([]) is None
    assert first_error([warning]) is None
    assert first_error([warning, far]) == "step 2: too far by 671.0 mm"
    assert first_error([warning, far, low]) == "step 2: too far by 671.0 mm (and 1 more, see the list)"


def test_a_list_that_is_quoted_of_a_file_keeps_its_hyphens() -> None:
    assert with_minus("limit_deg = [-102.8, 107.3]: -102.8 is too far") == (
        "limit_deg = [-102.8, 107.3]: −102.8 is too far"
    )
