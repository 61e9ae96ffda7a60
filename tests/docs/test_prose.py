"""README and docs are written for students: short sentences, the terms of the field."""

from __future__ import annotations

import re
from pathlib import Path
from statistics import fmean

import pytest
from tests.docs.pages import ROOT, reading_pages, sentences

LONGEST_AVERAGE = 18
STRICTER = {"docs/safety.md": 15}
"""words a sentence, on average"""
TERMS = {
    r"end[- ]effectors?": "tool",
    r"tool cent(?:re|er) point": "tool point (TCP)",
    r"way[- ]points": "waypoints",
    r"set[- ]points?": "setpoint",
    r"joint (?:values?|coordinates?)": "joint angle",
    r"(?:kinematic|arm) configurations? branch": "branch",
    r"e-?stop": "emergency stop, and only to say that STOP is none",
    r"singular (?:point|position)s?": "singularity",
    r"zero(?:ing)? run": "homing",
    r"calibrat(?:e|ing) the zero": "homing, or calibration of a servo",
    r"pulse (?:length|duration)s?": "pulse width",
    r"speed (?:curve|law)s?": "profile",
    r"rounding radius": "blend radius",
    r"simulator board": "simulated board",
    r"(?:lag|tracking) error": "following error",
    r"see to": "check, or do",
    r"goes by": "uses",
    r"(?:is|are) said of": "describe",
    r"tells? of": "describes",
    r"says? of": "describes",
    r"can(?:not)? be had": "is possible",
    r"where need be|if need be": "if necessary",
    r"for ever": "without end",
    r"(?:un)?beknown\w*|thereof|hereby|whilst|whence|thence|lest|nought|shall": "a plain word",
    r"simply|obviously|of course|trivially|just works": "nothing",
}
"""what to avoid, and what to write instead"""


@pytest.mark.parametrize("page", reading_pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_its_sentences_are_short(page: Path) -> None:
    found = list(sentences(page))
    lengths = [len(sentence.split()) for sentence in found]
    most = STRICTER.get(page.relative_to(ROOT).as_posix(), LONGEST_AVERAGE)
    longest = sorted(found, key=lambda sentence: len(sentence.split()))[-5:]
    assert not lengths or fmean(lengths) <= most, f"{fmean(lengths):.1f} words a sentence: {longest}"


@pytest.mark.parametrize("page", reading_pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_it_uses_the_terms_of_the_field(page: Path) -> None:
    for sentence in sentences(page):
        for term, better in TERMS.items():
            assert not re.search(rf"\b(?:{term})\b", sentence, re.IGNORECASE), f"write {better!r}: {sentence}"
