"""What one check came to."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Verdict(Enum):
    """How a check ended."""

    OK = "ok"
    WARNING = "warning"
    FAILED = "failed"
    NOT_CHECKED = "not checked"


@dataclass(frozen=True, slots=True)
class Finding:
    """One check: what was looked at, what was seen, and what to do about it."""

    check: str
    verdict: Verdict
    seen: str
    advice: str = ""


def ok(check: str, seen: str) -> Finding:
    """All is well."""
    return Finding(check, Verdict.OK, seen)


def warning(check: str, seen: str, advice: str = "") -> Finding:
    """It works, but the user should know."""
    return Finding(check, Verdict.WARNING, seen, advice)


def failed(check: str, seen: str, advice: str = "") -> Finding:
    """It does not work."""
    return Finding(check, Verdict.FAILED, seen, advice)


def not_checked(check: str, seen: str, advice: str = "") -> Finding:
    """It cannot be told, or an earlier failure stands before it."""
    return Finding(check, Verdict.NOT_CHECKED, seen, advice)
