"""Random programs of every kind of step."""

from __future__ import annotations

import re
from typing import cast

from hypothesis import strategies as st
from msgspec import inspect

from armctl.program import CallStep, CountStep, EndStep, FrameStep, Program, RepeatStep, Step
from armctl.program.base_steps import BlockStep, keys_of
from armctl.program.steps import KINDS

FLOATS = st.floats(-1e6, 1e6)
_ODD = ["=1+1", "'", "'=x", "#", "# x", "#}{", '"', "'''", '"""', "'\nimport os\nos.system('x')\n'", "\\"]
_ODD += ["\r\n", "\u2028x", "a\x0cb", " x ", "@a", "-1", "repeat", "a,b;c\td"]
NOTES = st.text(st.characters(blacklist_categories=("Cs",)), max_size=12) | st.sampled_from(_ODD)


def program(*steps: Step, robot: str = "uzuner") -> Program:
    return Program(robot=robot, name="pick", steps=steps)


def _values(node: inspect.Type, joints: st.SearchStrategy[int]) -> st.SearchStrategy[object]:
    """Whatever a key of this type may hold."""
    match node:
        case inspect.UnionType(types=types):
            return st.one_of(*(_values(one, joints) for one in types))
        case inspect.FloatType(gt=gt, ge=ge, le=le):
            return st.floats(-1e6 if gt is ge is None else max(ge or 0, 0 if gt is None else 1e-3), le or 1e6)
        case inspect.LiteralType(values=values):
            return st.sampled_from(values)
        case inspect.VarTupleType():
            return joints.flatmap(lambda n: st.lists(FLOATS, min_size=n, max_size=n).map(tuple))
        case inspect.NoneType():
            return st.none()
        case inspect.StrType(min_length=least) if least:
            return NOTES.filter(lambda text: bool(text.strip()))
        case inspect.StrType(pattern=str(pattern)):
            return st.sampled_from([name for name in ("", "lamp", "door_2", "x") if re.search(pattern, name)])
        case _:
            return NOTES


def _steps(kind: type[Step], joints: st.SearchStrategy[int]) -> st.SearchStrategy[Step]:
    offered = {key.name: key.choices for key in keys_of(kind) if key.choices}
    fields = cast("inspect.StructType", inspect.type_info(kind)).fields
    return st.builds(
        kind,
        **{
            one.name: st.sampled_from(offered[one.name]) if one.name in offered else _values(one.type, joints)
            for one in fields
        },
    )


def _block(inside: list[tuple[Step, ...]], times: int, begin: str, end: str) -> tuple[Step, ...]:
    steps = tuple(step for part in inside for step in part)
    return (RepeatStep(times=times, note=begin), *steps, EndStep(note=end))


def programs(
    joints: st.SearchStrategy[int] | None = None, times: st.SearchStrategy[int] | None = None
) -> st.SearchStrategy[Program]:
    """Programs whose blocks match; moves have as many angles as ``joints`` says."""
    joints = st.integers(0, 6) if joints is None else joints
    times = st.integers(1, 1_000_000) if times is None else times
    markers = [kind for kind in KINDS if issubclass(kind, BlockStep) or kind.closes or kind.divides]
    # a counter is a variable of a script, and no call: tests/program/test_logic.py has it. What a call runs
    # is a file of its own: tests/program/test_calls.py has it; of frames tests/program/test_frames.py
    kinds = [kind for kind in KINDS if kind not in (*markers, CountStep, CallStep, FrameStep)]
    single = st.one_of(*(_steps(kind, joints) for kind in kinds)).map(lambda step: (step,))
    part = st.recursive(
        single,
        lambda inner: st.builds(_block, st.lists(inner, max_size=3), times, NOTES, NOTES),
        max_leaves=8,
    )
    steps = st.lists(part, max_size=5).map(lambda parts: tuple(step for one in parts for step in one))
    return st.builds(Program, robot=st.just("uzuner"), name=NOTES, steps=steps)
