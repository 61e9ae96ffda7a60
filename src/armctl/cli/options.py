"""What several commands share: number arguments, the ``--json`` switch, JSON output."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import cast

import click
import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError

QUERY_SETTINGS = {"ignore_unknown_options": True, "help_option_names": ["-h", "--help"]}
"""For commands with number arguments: ``-196`` is a number, not an option."""

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON for programs.")


def finite(value: float | None, what: str) -> float | None:
    """``value`` if it is a finite number.

    Raises:
        InputError: NaN or infinity.
    """
    if value is not None and not math.isfinite(value):
        raise InputError(f"{what} must be a finite number, got {value}")
    return value


def print_json(record: object) -> None:
    """One JSON document; arrays as lists, NaN refused (it is no JSON)."""
    click.echo(json.dumps(record, default=_plain, allow_nan=False, ensure_ascii=False))


def rounded(values: NDArray[np.float64] | Sequence[float], digits: int = 9) -> list[float]:
    """A list for JSON, without the noise of the last bits (and without ``-0.0``)."""
    return [round(float(value), digits) + 0.0 for value in values]


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray | np.generic):
        return cast(NDArray[np.float64], value).tolist()
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")
