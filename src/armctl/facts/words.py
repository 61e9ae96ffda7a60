"""Words for reasons, in the language of whoever reads them: made as late as possible, never read back."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import fields
from enum import Enum
from functools import cache
from types import ModuleType
from typing import Any, NamedTuple, cast

from armctl.facts import (
    causes,
    commands,
    english,
    english_causes,
    english_commands,
    english_servos,
    english_targets,
    program_paths,
    quantities,
    reasons,
    servos,
    targets,
    turkish,
    turkish_causes,
    turkish_commands,
    turkish_servos,
    turkish_targets,
)
from armctl.facts.program_paths import InStep, OnPath
from armctl.facts.reasons import (
    About,
    Advised,
    BeyondReach,
    BranchEnds,
    Found,
    Need,
    OnCurve,
    Reason,
    Said,
    Several,
    State,
)
from armctl.facts.targets import AtPoint, AtRoll, Besides, PoseUnmet, StrokeLeftOut


class Language(NamedTuple):
    """What is said of each kind of reason."""

    what: Mapping[type[Reason], Callable[[Any], str]]
    """what is wrong, with numbers"""
    advice: Mapping[type[Reason], Callable[[Any], str]]
    """what to do about it, where there is more to say than what is wrong"""
    at: str
    """before what is said of a time: a form for it [s] and its decimals"""
    step: str
    """before what is said of a step of a program"""
    more: str
    """behind one of several things that a check found"""
    states: Mapping[State, str]


def _language(words: Any, *others: Any) -> Language:
    """Of the words of reasons, and those of other kinds of facts."""
    told, advised = dict(words.WHAT), dict(words.ADVICE)
    for one in others:
        told |= one.WHAT
        advised |= getattr(one, "ADVICE", {})
    return Language(told, advised, words.AT, words.STEP, words.MORE, words.STATES)


LANGUAGES = {
    "en": _language(english, english_targets, english_servos, english_causes, english_commands),
    "tr": _language(turkish, turkish_targets, turkish_servos, turkish_causes, turkish_commands),
}


def preferred(environment: Mapping[str, str] = os.environ) -> str:
    """The language that a user's settings name (``LC_ALL``, ``LC_MESSAGES``, ``LANG``), or English."""
    return _code(next(filter(None, map(environment.get, ("LC_ALL", "LC_MESSAGES", "LANG"))), ""))


@cache
def _code(named: str) -> str:
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
        case Found():
            return _found(reason, language)
        case OnPath():
            return f"{what(reason.reason, language)}{_table(language).what[OnPath](reason)}"
        case InStep():
            return f"{inside(reason, language)}{say(reason.reason, language)}"
        case Besides() | AtRoll() | AtPoint():
            return f"{_table(language).what[type(reason)](reason)}{say(reason.reason, language)}"
        case (
            BeyondReach(why=Reason() as inner)
            | BranchEnds(at_end=Reason() as inner)
            | PoseUnmet(reason=Reason() as inner)
            | StrokeLeftOut(why=Reason() as inner)
        ):
            return f"{_table(language).what[type(reason)](reason)}{say(inner, language)}"
        case OnCurve():
            told = f"{_table(language).what[OnCurve](reason)}: {say(reason.reason, language)}"
            more = advice(reason.reason, language) if reason.freer else ""
            return f"{told}; {more}" if more else told
        case _:
            return _table(language).what[type(reason)](reason)


def _found(found: Found, language: str | None) -> str:
    """Step, part, time, what and what to do about it: ``step 2: Elbow: at 0.51 s, …; …``."""
    forms, mend, reason, where = _table(language), advice(found.reason, language), found.reason, ""
    if isinstance(reason, InStep):  # ahead of all else: it says of what the rest is told
        where, reason = inside(reason, language), reason.reason
    text = f"{at(found.at_s, found.digits, language)}{what(reason, language)}"
    text = where + (f"{found.part}: {text}" if found.part else text)
    text = f"{text}; {mend}" if mend else text
    step = "" if found.step is None else forms.step.format(found.step + 1)
    return f"{step}{text}{forms.more.format(found.more) if found.more else ''}"


def inside(where: InStep, language: str | None = None) -> str:
    """Where inside a step something is, said before what it is; empty where it is all of the step."""
    told = place(where, language)
    return f"{told}: " if told else ""


def place(where: InStep, language: str | None = None) -> str:
    """Where inside a step something is: ``in 'grip', step 2, approach``; empty: it is all of the step."""
    return _table(language).what[InStep](where)


def advice(reason: Reason, language: str | None = None) -> str:
    """What to do about it; empty: ``what`` says it."""
    match reason:
        case Said() | Advised():
            return reason.mend
        case OnPath() | InStep():
            return advice(reason.reason, language)
        case OnCurve() if not reason.freer:
            return advice(reason.reason, language)
        case _:
            make = _table(language).advice.get(type(reason))
            return "" if make is None else make(reason)


def say(reason: Reason, language: str | None = None) -> str:
    """One sentence: which part, and what is wrong with it; of a curve also when, and what to do."""
    text, part = what(reason, language), getattr(reason, "part", "")
    if part and not isinstance(reason, Found):
        return f"{part}: {text}"
    if not isinstance(reason, OnCurve):
        return text
    mend = advice(reason, language)
    return f"{at(reason.at_s, language=language)}{text}{'; ' if mend else ''}{mend}"


def say_with_advice(reason: Reason, language: str | None = None) -> str:
    """What is wrong with which part, and behind it what to do about it, where there is more to say."""
    mend = advice(reason, language)
    return f"{say(reason, language)}{'; ' if mend else ''}{mend}"


def at(time_s: float | None, digits: int = 2, language: str | None = None) -> str:
    """What is said before something that happens at a time [s]; empty where that is None."""
    return "" if time_s is None else _table(language).at.format(time_s, digits)


def state_words(state: State, language: str | None = None) -> str:
    """What a state is called."""
    return _table(language).states[state]


def opening(reason: Reason, language: str | None = None) -> str:
    """``say`` with a capital in front: that of the user's language, unless the word is English or a name."""
    text = say(reason, language)
    return capitals(text[:1], "en" if _is_said(reason) else language) + text[1:]


def _is_said(reason: Reason) -> bool:
    """Whether the first word is a name, or of a text that there is in English alone."""
    match reason:
        case Several(reasons=(first, *_)) | Advised(reason=first) | Found(reason=first):
            return _is_said(first)
        case _:
            return isinstance(reason, Said | About)


def capitals(text: str, language: str | None = None) -> str:
    """A text in capitals: in Turkish that of i has its dot."""
    return (text.replace("i", "İ") if (language or preferred()) == "tr" else text).upper()


# Reasons as plain records, for JSON and for other processes.


def _kinds(*modules: ModuleType) -> dict[str, type[Reason]]:
    found = (one for module in modules for one in vars(module).values())
    return {one.__name__: one for one in found if isinstance(one, type) and issubclass(one, Reason)}


KINDS = _kinds(reasons, quantities, targets, servos, causes, commands, program_paths)
_ENUMS = {"need": Need, "state": State}


def fact_record(reason: Reason) -> dict[str, Any]:
    """``fact``, the name of its class, and its fields; reasons inside likewise."""
    return {"fact": type(reason).__name__} | {
        one.name: _plain(getattr(reason, one.name)) for one in fields(reason)
    }


def _plain(value: Any) -> Any:
    if isinstance(value, Reason):
        return fact_record(value)
    if isinstance(value, tuple):
        return [_plain(one) for one in cast(tuple[Any, ...], value)]
    if isinstance(value, float):
        return float(value)  # numpy's is none that every format knows
    return value.value if isinstance(value, Enum) else value


def fact_of(record: dict[str, Any]) -> Reason | None:
    """The reason of a record; None where it is none that this version knows, or can say."""
    try:
        kind = KINDS[record["fact"]]
        reason = kind(**{one.name: _valued(one.name, record[one.name]) for one in fields(kind)})
        "".join([say(reason), advice(reason)])  # texts, or it is none
    except (KeyError, TypeError, ValueError, ArithmeticError, AttributeError, RecursionError):
        return None
    return reason


def _valued(name: str, value: Any) -> Any:
    if name in _ENUMS:
        return _ENUMS[name](value)
    if isinstance(value, dict):
        if (inner := fact_of(cast(dict[str, Any], value))) is None:
            raise ValueError(name)  # the whole says no more than its part
        return inner
    if isinstance(value, list):
        return tuple(_valued("", one) for one in cast(list[Any], value))
    return value
