from __future__ import annotations

import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.long import examples
from tests.program.kit import program, programs

from armctl.errors import InputError, ProgramError
from armctl.program import (
    Blocks,
    CommentStep,
    Cursor,
    EndStep,
    Program,
    RepeatStep,
    SpeedStep,
    Step,
    WaitStep,
)

A, B, C = (WaitStep(seconds=k) for k in range(3))
END, COMMENT = EndStep(), CommentStep(note="for people")


def times(n: int) -> RepeatStep:
    return RepeatStep(times=n)


def indices(cursor: Cursor, most: int = 10_000) -> list[int]:
    found: list[int] = []
    while (following := cursor.next()) is not None:
        found.append(following[0])
        assert len(found) <= most
    return found


def run(steps: tuple[Step, ...], first: int, last: int) -> list[int]:
    """The steps of a range, executed by recursion: the oracle."""
    found: list[int] = []
    index = first
    while index < last:
        step = steps[index]
        if isinstance(step, RepeatStep):
            end = matching_end(steps, index)
            found += step.times * run(steps, index + 1, end)
            index = end
        elif not isinstance(step, CommentStep | EndStep):
            found.append(index)
        index += 1
    return found


def matching_end(steps: tuple[Step, ...], begin: int) -> int:
    depth = 0
    for index in range(begin, len(steps)):
        depth += isinstance(steps[index], RepeatStep) - isinstance(steps[index], EndStep)
        if depth == 0:
            return index
    raise AssertionError


@given(programs(times=st.integers(1, 3)))
@settings(max_examples=examples(150))
def test_steps_come_in_the_order_in_which_nested_loops_would_run_them(random: Program) -> None:
    expected = run(random.steps, 0, len(random.steps))
    cursor = Cursor(random)
    assert indices(cursor) == expected
    assert cursor.next() is None


@given(programs(times=st.integers(1, 3)), st.data())
@settings(max_examples=examples(150))
def test_beginning_anywhere_gives_the_end_of_the_whole_run(random: Program, data: st.DataObject) -> None:
    """As if everything from the first pass of all blocks around up to that step had been run already."""
    if not random.steps:
        return
    first = data.draw(st.integers(0, len(random.steps) - 1))
    whole = run(random.steps, 0, len(random.steps))
    # The first visit of ``first`` in the whole run: marks, numbered past all steps, show where it is.
    marked = list(random.steps)
    marked.insert(first, SpeedStep(percent=50))
    visits = run(tuple(marked), 0, len(marked))
    before = len([index for index in visits[: visits.index(first)] if index != first])
    assert indices(Cursor(random, first)) == whole[before:]


def test_a_copy_goes_its_own_way() -> None:
    cursor = Cursor(program(times(3), A, B, END, C))
    assert [cursor.next() for _ in range(3)] == [(1, A), (2, B), (1, A)]
    twin = cursor.copy()
    assert indices(cursor) == [2, 1, 2, 4]
    assert indices(twin) == [2, 1, 2, 4]


def test_what_does_nothing_never_hangs() -> None:
    many = times(1_000_000)
    idle = program(COMMENT, many, COMMENT, many, END, COMMENT, END)
    for first in range(len(idle.steps)):
        assert Cursor(idle, first).next() is None
    assert Cursor(program()).next() is None
    assert indices(Cursor(program(many, many, COMMENT, END, END, A))) == [5]


def test_a_million_times_a_million_takes_no_memory() -> None:
    many = times(1_000_000)
    cursor = Cursor(program(many, many, A, COMMENT, B, END, END))
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(20_000):
            assert cursor.next() is not None
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert grown < 2_000


def test_deep_nesting_is_no_recursion() -> None:
    deep = program(*[times(1)] * 5000, A, *[END] * 5000)
    assert indices(Cursor(deep)) == [5000]
    assert Blocks.of(deep.steps).depths[5000] == 5000


def test_markers_that_do_not_match_are_named() -> None:
    with pytest.raises(ProgramError, match=r"^step 2: 'end' without a 'repeat', 'if' or 'while'"):
        Cursor(program(A, END, B))
    with pytest.raises(ProgramError, match=r"^step 1: this 'repeat' has no 'end'"):
        Cursor(program(times(2), times(2), A, END))
    assert [index for index, _ in Blocks.of((END, times(2), A)).findings] == [0, 1]
    assert Blocks.of((times(2), A, END)).findings == []


def test_no_such_step() -> None:
    for first in (3, -1):
        with pytest.raises(InputError, match=f"pick has no step {first + 1}; it has 3"):
            Cursor(program(A, B, C), first)


def test_depth_and_partners() -> None:
    blocks = Blocks.of((A, times(2), B, times(3), C, END, END))
    assert blocks.depths == [0, 0, 1, 1, 2, 1, 0]
    assert blocks.partners == {1: 6, 6: 1, 3: 5, 5: 3}
    assert [blocks.whole(index) for index in (0, 1, 4, 5)] == [(0, 0), (1, 6), (4, 4), (3, 5)]
