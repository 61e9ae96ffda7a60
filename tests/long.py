"""How much a test tries at random: a third of it, and all in a long run."""

from __future__ import annotations

import os

LONG = bool(os.environ.get("ARMCTL_LONG"))


def examples(count: int) -> int:
    """For ``max_examples`` of Hypothesis."""
    return count if LONG else max(5, count // 3)
