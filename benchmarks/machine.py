"""What a table was measured on: figures without it mean nothing."""

from __future__ import annotations

import os
import platform
from datetime import UTC, datetime
from pathlib import Path

import numpy as np


def facts() -> dict[str, str | int]:
    """Date, processor and versions."""
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "cores": os.cpu_count() or 1,
        "cpu": _processor(),
        "vectors": _vectors(),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def sentence(of: dict[str, str | int]) -> str:
    """The facts as a caption."""
    return (
        f"{of['date']}: {of['cores']} cores of {of['cpu']} ({of['vectors']}), Python {of['python']}, "
        f"numpy {of['numpy']}{', a quick run' if of.get('run') == 'quick' else ''}"
    )


def _lines_of_cpuinfo() -> dict[str, str]:
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    pairs = (line.partition(":") for line in reversed(lines))
    return {key.strip(): value.strip() for key, _, value in pairs}


def _processor() -> str:
    return _lines_of_cpuinfo().get("model name") or platform.processor() or platform.machine()


def _vectors() -> str:
    """The widest vectors: numpy's arc cosine and tangent are several times faster with AVX-512."""
    flags = _lines_of_cpuinfo().get("flags", "").split()
    return "AVX-512" if "avx512f" in flags else "AVX2, no AVX-512" if "avx2" in flags else "no AVX2"
