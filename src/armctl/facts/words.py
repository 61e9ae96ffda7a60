"""Words for reasons, in the language of whoever reads them: made as late as possible, never read back."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from armctl.facts import english, turkish
from armctl.facts.reasons import About, Advised, OnCurve, Reason, Said, Several
from armctl.facts.states import State


class Language(NamedTuple):
    """What is said of each kind of reason."""

    what: Mapping[type[Reason], Callable[[Any], str]]
    """what is wrong, with numbers"""
    advice: Mapping[type[Reason], Callable[[Any], str]]
    """what to do about it, where there is more to say than what is wrong"""
    at: str
    """before what is said of a time: a form for it [s] and its decimals"""
    states: Mapping[State, str]


LANGUAGES = {
    "en": Language(english.WHAT, english.ADVICE, english.AT, english.STATES),
    "tr": Language(turkish.WHAT, turkish.ADVICE, turkish.AT, turkish.STATES),
}


def preferred(environment: Mapping[str, str] = os.environ) -> str:
    """The language that a user's settings name (``LC_ALL``, ``LC_MESSAGES``, ``LANG``), or English."""
    named = next(filter(None, map(environment.get, ("LC_ALL", "LC_MESSAGES", "LANG"))), "")
    code = re.split(r"[_.@-]", named)[0].lower()
    return code if code in LANGUAGES else "en"


def _table(language: str | None) -> Language:
    return LANGUAGES[language or preferred()]


def what(reason: Reason, language: str | None = None) -> str:
    """What is wrong, with numbers; of which part is left out. ``language``: None is the user's."""
    match reason:
        case Said():
            return reason.text
        case About():
            return f"{reason.thing}: {say(reason.reason, language)}"
        case Advised():
            return say(reason.reason, language)
        case Several():
            return "; ".join(say(one, language) for one in reason.reasons)
        case OnCurve():
            told = f"{_table(language).what[OnCurve](reason)}: {say(reason.reason, language)}"
            more = advice(reason.reason, language) if reason.freer else ""
            return f"{told}; {more}" if more else told
        case _:
            return _table(language).what[type(reason)](reason)


def advice(reason: Reason, language: str | None = None) -> str:
    """What to do about it; empty: ``what`` says it."""
    match reason:
        case Said() | Advised():
            return reason.mend
        case OnCurve() if not reason.freer:
            return advice(reason.reason, language)
        case _:
            make = _table(language).advice.get(type(reason))
            return "" if make is None else make(reason)


def say(reason: Reason, language: str | None = None) -> str:
    """One sentence: which part, and what is wrong with it; of a curve also when, and what to do."""
    text, part = what(reason, language), getattr(reason, "part", "")
    if part:
        return f"{part}: {text}"
    if not isinstance(reason, OnCurve):
        return text
    mend = advice(reason, language)
    return f"{at(reason.at_s, language=language)}{text}{'; ' if mend else ''}{mend}"


def at(time_s: float | None, digits: int = 2, language: str | None = None) -> str:
    """What is said before something that happens at a time [s]; empty where that is None."""
    return "" if time_s is None else _table(language).at.format(time_s, digits)


def state_words(state: State, language: str | None = None) -> str:
    """What a state is called."""
    return _table(language).states[state]
