"""What a check finds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning"]
"""error: the motion is refused. warning: it is shown, and the motion may be run."""
Kind = Literal[
    "limits",
    "reach",
    "speed",
    "acceleration",
    "rest",
    "floor",
    "obstacle",
    "self-collision",
    "singularity",
    "torque",
    "program",
]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong with a trajectory."""

    time: float
    """when it is worst [s]"""
    part: str
    """the joint, or the part of the arm"""
    what: str
    """what is wrong, with numbers"""
    mend: str
    """what to do about it"""
    kind: Kind
    """which check found it"""
    severity: Severity = "error"

    def __str__(self) -> str:
        return f"{self.part}: at {self.time:.2f} s, {self.what}; {self.mend}"
