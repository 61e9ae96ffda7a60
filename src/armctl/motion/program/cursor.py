"""The steps of a program in the order in which they are executed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

from armctl.errors import InputError
from armctl.motion.program.blocks import Blocks
from armctl.motion.program.program import CommentStep, EndStep, Program, RepeatStep, Step


class Cursor:
    """Where one pass of a program is; repeats are counted, never written out.

    Only steps that do something are handed out: not comments, nor the markers of blocks. Blocks without
    such a step are passed over whole, however often they are to be repeated. A copy has one counter for
    each open block of its own and shares the rest.
    """

    def __init__(self, program: Program, first: int = 0) -> None:
        """Stand before a step.

        Args:
            program: whose steps.
            first: index of the step to begin with. Inside a block, this is the first of the block's
                passes; on its ``end``, that pass is over at once.

        Raises:
            ProgramError: a ``repeat`` without ``end`` or the reverse; names the step.
            InputError: no such step.
        """
        steps = program.steps
        blocks = Blocks.of(program)
        if not 0 <= first < max(len(steps), 1):
            raise InputError(f"{program.name} has no step {first + 1}; it has {len(steps)}")
        self._steps = steps
        self._blocks = blocks
        self._goals = _goals(steps, blocks)
        self._next = self._goals[first]
        self._left: list[int] = []
        """passes still to be begun or under way, for each open block, the outermost first"""
        for begin in blocks.around(first) if steps else ():
            step = steps[begin]
            if isinstance(step, RepeatStep) and self._goals[begin] == begin:
                self._left.append(step.times)

    def copy(self) -> Self:
        """Another cursor at the same place."""
        twin = object.__new__(type(self))
        twin._steps, twin._blocks, twin._goals = self._steps, self._blocks, self._goals
        twin._next = self._next
        twin._left = self._left.copy()
        return twin

    def next(self) -> tuple[int, Step] | None:
        """Index and step of what is executed next; None at the end of the pass, and from then on."""
        while self._next < len(self._steps):
            index = self._next
            step = self._steps[index]
            following = index + 1
            if isinstance(step, RepeatStep):
                self._left.append(step.times)
            elif isinstance(step, EndStep):
                self._left[-1] -= 1
                if self._left[-1] > 0:
                    following = (self._blocks.partner(index) or 0) + 1
                else:
                    self._left.pop()
            else:
                self._next = self._goals[following]
                return index, step
            self._next = self._goals[following]
        return None


def _goals(steps: Sequence[Step], blocks: Blocks) -> list[int]:
    """(steps + 1) From each place, the next step that does something or belongs to a block that does."""
    goals = [len(steps)] * (len(steps) + 1)
    acting = _acting(steps)
    for index in range(len(steps) - 1, -1, -1):
        partner = blocks.partner(index)
        begin, end = (index, index) if partner is None else sorted((index, partner))
        idle = isinstance(steps[index], CommentStep) or (partner is not None and acting[begin] == acting[end])
        goals[index] = goals[index + 1] if idle else index
    return goals


def _acting(steps: Sequence[Step]) -> list[int]:
    """For each place, how many steps before it do something."""
    counts: list[int] = []
    count = 0
    for step in steps:
        counts.append(count)
        count += not isinstance(step, CommentStep | RepeatStep | EndStep)
    return counts
