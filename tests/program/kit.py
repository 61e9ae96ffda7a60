"""Random programs of every kind of step."""

from __future__ import annotations

from hypothesis import strategies as st

from armctl.program import (
    ArcStep,
    CommentStep,
    EndStep,
    GripperStep,
    LineStep,
    MoveStep,
    PointStep,
    Program,
    RepeatStep,
    SpeedStep,
    Step,
    WaitStep,
)

FLOATS = st.floats(-1e6, 1e6)
SECONDS = st.floats(0, 86_400)
NOTES = st.text(st.characters(blacklist_categories=("Cs",)), max_size=12) | st.sampled_from(
    [
        "=1+1",
        "'",
        "'=x",
        "#",
        "# x",
        '"',
        "'''",
        "a\nimport os",
        "\\",
        " x ",
        "@a",
        "-1",
        "repeat",
        "noch’ eins",
        "a,b;c\td",
    ]
)
BLENDS = st.just(0.0) | st.floats(0, 1000)
PROFILES = st.sampled_from(["cubic", "quintic", "trapezoid", "s-curve"])
MODES = st.sampled_from(["kept", "interpolated", "free"])
MAYBE = st.none() | FLOATS
SPEEDS = st.none() | st.floats(1e-3, 1e4)
TIMES = st.none() | SECONDS


def moves(joints: st.SearchStrategy[int]) -> st.SearchStrategy[MoveStep]:
    angles = joints.flatmap(lambda n: st.lists(FLOATS, min_size=n, max_size=n).map(tuple))
    return st.builds(
        MoveStep, joints_deg=angles, duration_s=TIMES, blend_mm=BLENDS, profile=PROFILES, note=NOTES
    )


POINTS = st.builds(
    PointStep,
    x_mm=FLOATS,
    y_mm=FLOATS,
    z_mm=FLOATS,
    pitch_deg=MAYBE,
    roll_deg=MAYBE,
    choose=st.sampled_from(["least-rotation", "published"]),
    profile=PROFILES,
    duration_s=TIMES,
    blend_mm=BLENDS,
    note=NOTES,
)
LED = {
    "x_mm": FLOATS,
    "y_mm": FLOATS,
    "z_mm": FLOATS,
    "pitch": MODES,
    "pitch_deg": MAYBE,
    "speed_mm_s": SPEEDS,
    "duration_s": TIMES,
    "blend_mm": BLENDS,
    "note": NOTES,
}
LINES = st.builds(LineStep, **LED)
ARCS = st.builds(ArcStep, via_x_mm=FLOATS, via_y_mm=FLOATS, via_z_mm=FLOATS, **LED)
OTHERS = st.one_of(
    st.builds(WaitStep, seconds=SECONDS, note=NOTES),
    st.builds(GripperStep, open_percent=st.floats(0, 100), note=NOTES),
    st.builds(SpeedStep, percent=st.floats(5, 100), note=NOTES),
    st.builds(CommentStep, note=NOTES),
)


def _block(inside: list[tuple[Step, ...]], times: int, begin: str, end: str) -> tuple[Step, ...]:
    steps = tuple(step for part in inside for step in part)
    return (RepeatStep(times=times, note=begin), *steps, EndStep(note=end))


def programs(
    joints: st.SearchStrategy[int] | None = None,
    times: st.SearchStrategy[int] | None = None,
    robot: str = "uzuner",
) -> st.SearchStrategy[Program]:
    """Programs whose blocks match; moves have as many angles as ``joints`` says."""
    joints = st.integers(0, 6) if joints is None else joints
    times = st.integers(1, 1_000_000) if times is None else times
    single = st.one_of(moves(joints), POINTS, LINES, ARCS, OTHERS).map(lambda step: (step,))
    part = st.recursive(
        single,
        lambda inner: st.builds(_block, st.lists(inner, max_size=3), times, NOTES, NOTES),
        max_leaves=8,
    )
    steps = st.lists(part, max_size=5).map(lambda parts: tuple(step for one in parts for step in one))
    return st.builds(Program, robot=st.just(robot), name=NOTES, steps=steps)
