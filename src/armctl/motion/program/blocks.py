"""Which ``repeat`` belongs to which ``end``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from armctl.errors import ProgramError
from armctl.motion.program.program import EndStep, Program, RepeatStep, Step

_OUTSIDE = -1


@dataclass(frozen=True, slots=True)
class Blocks:
    """The repeat blocks of a program whose markers match."""

    _partners: dict[int, int]
    """index of a marker to that of the one it belongs to, both ways"""
    _parents: Sequence[int]
    """for each step the index of the innermost ``repeat`` around it; a block's own markers lie outside"""
    _depths: Sequence[int]

    @classmethod
    def of(cls, program: Program) -> Self:
        """Match the markers of a program.

        Raises:
            ProgramError: a ``repeat`` without an ``end`` or the reverse; names the first such step.
        """
        found = block_findings(program)
        if found:
            index, what = found[0]
            raise ProgramError(f"step {index + 1}: {what}")
        partners, parents, depths, _ = _scan(program.steps)
        return cls(partners, parents, depths)

    def partner(self, index: int) -> int | None:
        """Index of the marker that belongs to the one at ``index``; None for any other step."""
        return self._partners.get(index)

    def depth(self, index: int) -> int:
        """How many blocks are around a step; 0: none. A block's markers are as deep as what is around it."""
        return self._depths[index]

    def around(self, index: int) -> list[int]:
        """Indices of the ``repeat`` steps that the step lies in, the outermost first.

        An ``end`` lies in the block that it ends, so that a run that begins there goes on with the next pass.
        """
        inner = self._partners[index] if self._partners.get(index, index) < index else self._parents[index]
        found: list[int] = []
        while inner != _OUTSIDE:
            found.append(inner)
            inner = self._parents[inner]
        return found[::-1]


def block_findings(program: Program) -> list[tuple[int, str]]:
    """What is wrong with a program's blocks: (index of the step, what), in the order of the steps."""
    return _scan(program.steps)[3]


def depths_of(steps: Sequence[Step]) -> list[int]:
    """How many blocks are around each step, also where markers do not match."""
    return _scan(steps)[2]


def partner_of(steps: Sequence[Step], index: int) -> int | None:
    """Index of the marker that belongs to the one at ``index``; None where there is none."""
    return _scan(steps)[0].get(index)


def _scan(steps: Sequence[Step]) -> tuple[dict[int, int], list[int], list[int], list[tuple[int, str]]]:
    partners: dict[int, int] = {}
    parents: list[int] = []
    depths: list[int] = []
    findings: list[tuple[int, str]] = []
    open_blocks: list[int] = []
    for index, step in enumerate(steps):
        if isinstance(step, EndStep):
            if open_blocks:
                begin = open_blocks.pop()
                partners[begin], partners[index] = index, begin
            else:
                findings.append((index, "'end' without a 'repeat' before it; delete it, or add the 'repeat'"))
        parents.append(open_blocks[-1] if open_blocks else _OUTSIDE)
        depths.append(len(open_blocks))
        if isinstance(step, RepeatStep):
            open_blocks.append(index)
    findings += [
        (index, "this 'repeat' has no 'end'; add one behind the last step to repeat") for index in open_blocks
    ]
    return partners, parents, depths, sorted(findings)
