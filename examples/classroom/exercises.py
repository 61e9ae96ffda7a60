"""Tells which answers of a lesson are right, with a hint where one is not."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, NoReturn

Exercise = tuple[Any, Callable[[Any], bool], str]
"""an answer (``...``: none yet), what says whether it is right, and a hint"""


def near(right: float, within: float) -> Callable[[float], bool]:
    """A number is right when it is so near."""
    return lambda answer: abs(answer - right) <= within


def check(*exercises: Exercise) -> NoReturn:
    """Print a line for each exercise, and end with status 0 when all are right."""
    done = 0
    for number, (answer, is_right, hint) in enumerate(exercises, 1):
        if answer is ...:
            print(f"{number}. open")
            continue
        try:
            right = bool(is_right(answer))
        except NotImplementedError:
            print(f"{number}. open")
            continue
        except Exception as error:  # of a function that a student wrote
            right, hint = False, f"{type(error).__name__}: {error}"
        done += right
        print(f"{number}. right" if right else f"{number}. not yet. {hint}")
    print(f"{done} of {len(exercises)} are right.")
    sys.exit(0 if done == len(exercises) else 1)
