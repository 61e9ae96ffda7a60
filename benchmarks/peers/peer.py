"""Bringing in a peer that may not be there."""

from __future__ import annotations

import importlib
import warnings
from types import ModuleType

from benchmarks.row import NotMeasuredError


def load(module: str) -> ModuleType:
    """A module of a peer.

    Raises:
        NotMeasuredError: it is not installed, or does not load beside this numpy.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # peers deprecate their own modules on import
            return importlib.import_module(module)
    except (ImportError, OSError, AttributeError) as error:  # the last: built for another numpy
        raise NotMeasuredError(f"not installed: {error}") from error
