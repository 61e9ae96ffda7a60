"""What travels arrives as it was, and what is none is refused in words."""

from __future__ import annotations

from dataclasses import fields, replace

import msgspec
import numpy as np
import pytest
from tests.process.kit import ROBOT

from armctl.errors import ArmctlError, InputError, MotionRefusedError, ProgramError, StateError
from armctl.facts import Quantities
from armctl.kinematics import Target
from armctl.motion import Trajectory, plan_joints, plan_line, plan_spline
from armctl.motion.trajectory import JoinedTrajectory, Sample, SlowedTrajectory
from armctl.process.records import (
    Answer,
    Ask,
    Codec,
    Seen,
    answer,
    commands,
    error_of,
)
from armctl.process.snapshots import SnapshotWriter
from armctl.program import CalledProgram, CallStep, MoveStep, Program, WaitStep
from armctl.protocol import Command, Follow, FollowTarget, MoveJoints, MoveTo, RunProgram, Snapshot

HOME = ROBOT.pose("home")
AWAY = HOME + np.radians([30, -20, 30, 10, 0])
BOTH = pytest.mark.parametrize("json", [False, True], ids=["msgpack", "json"])


def travelled(command: Command, json: bool) -> Command:
    codec = Codec(json=json)
    record = codec.from_client(codec.encode(Ask(7, command, "page 1")))
    assert isinstance(record, Ask) and (record.id, record.who) == (7, "page 1")
    return codec.command(record)


def default(kind: type[Command]) -> Command:
    """One with plain values in what it needs."""
    plain = {
        "port": "sim", "q": AWAY, "target": Target.of([0.2, 0, 0.1], 0.3), "rate": np.zeros(5),
        "locked": True, "number": 3, "share": 0.5, "value": 1.0,
        "linear": np.zeros(3), "opening": 0.5, "fraction": 0.5, "trajectory": plan_joints(ROBOT, HOME, AWAY),
        "program": Program(robot="uzuner", steps=(MoveStep(joints_deg=(1, 2, 3, 4, 5)), WaitStep(seconds=1))),
    }  # fmt: skip
    needed = [one.name for one in msgspec.structs.fields(kind) if one.required]
    return kind(**{name: plain.get(name, "x") for name in needed})


@BOTH
@pytest.mark.parametrize("kind", commands(), ids=lambda kind: kind.__name__)
def test_every_command_arrives_as_it_was(kind: type[Command], json: bool) -> None:
    command = default(kind)
    arrived = travelled(command, json)
    assert type(arrived) is kind
    for name in command.__struct_fields__:
        was, now = getattr(command, name), getattr(arrived, name)
        if isinstance(was, np.ndarray):
            np.testing.assert_array_equal(was, now)
        elif name != "trajectory":
            assert was == now


class Own:
    """A trajectory of a caller's own class."""

    duration, start, end = 2.0, HOME, HOME + 0.1

    def sample(self, t: object) -> Sample:
        u = np.asarray(t, dtype=np.float64)[..., None] / 2
        ones = np.ones(5)
        way, speed = 3 * u**2 - 2 * u**3, (6 * u - 6 * u**2) / 2
        return Sample(HOME + 0.1 * way * ones, 0.1 * speed * ones, 0 * way * ones, 0 * way * ones)


def _motions() -> list[Trajectory]:
    straight = plan_joints(ROBOT, HOME, AWAY, profile="s-curve")
    line = plan_line(ROBOT, AWAY, ROBOT.forward(AWAY)[:3, 3] + [0, 0.02, 0.01], pitch="free")
    spline = plan_spline(ROBOT, [HOME, AWAY, HOME + 0.05])
    back = plan_joints(ROBOT, AWAY, HOME)
    return [straight, line, spline, SlowedTrajectory(line, 1.5), JoinedTrajectory([straight, back]), Own()]


@BOTH
@pytest.mark.parametrize("motion", _motions(), ids=lambda motion: type(motion).__name__)
def test_a_trajectory_is_the_same_motion_on_the_other_side(motion: Trajectory, json: bool) -> None:
    arrived = travelled(Follow(motion), json)
    assert isinstance(arrived, Follow)
    times = np.linspace(0, motion.duration, 101)
    there = arrived.trajectory.sample(times)
    assert arrived.trajectory.duration == pytest.approx(motion.duration, rel=1e-12)
    np.testing.assert_allclose(there.q, motion.sample(times).q, atol=1e-9)
    np.testing.assert_allclose(there.velocity, motion.sample(times).velocity, atol=1e-6)


@pytest.mark.parametrize(
    ("command", "says"),
    [
        (MoveTo(Target((1e9, 0.0, 0.0))), "a wrong unit"),
        (FollowTarget(Target((float("nan"), 0.0, 0.0))), "target position"),
        (RunProgram(Program(robot="u", steps=(WaitStep(seconds=float("inf")),))), "seconds"),
        (RunProgram(Program(robot="u", steps=(WaitStep(seconds=0),) * 20_001)), "20000 at most"),
        (MoveJoints(AWAY, float("inf")), "duration_s must be a finite number"),
        (MoveJoints("far"), "cannot be read"),  # pyright: ignore[reportArgumentType]
    ],
)  # fmt: skip
def test_a_value_that_no_constructor_would_take_is_refused_at_the_door(command: Command, says: str) -> None:
    codec = Codec()
    record = codec.from_client(codec.encode(Ask(1, command)))
    assert isinstance(record, Ask)
    with pytest.raises(ArmctlError, match=says):
        codec.command(record)


@pytest.mark.parametrize("data", [b"", b"\xff", b"\x93" * 3000, b"null", b"[[[", b'{"type":"ask"}'])
@BOTH
def test_bytes_that_are_no_record_are_refused_in_words(data: bytes, json: bool) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        Codec(json=json).from_client(data)


@pytest.mark.parametrize("error", [StateError("off"), MotionRefusedError("too fast"), ArmctlError("other")])
def test_errors_keep_their_class_and_words(error: ArmctlError) -> None:
    codec = Codec()
    arrived = codec.from_arm(codec.encode(answer(3, error)))
    assert isinstance(arrived, Answer) and arrived.finished
    back = error_of(arrived)
    assert type(back) is type(error) and str(back) == str(error)


def test_an_error_of_a_module_of_its_own_arrives_as_what_it_is_one_of() -> None:
    class TooOddError(MotionRefusedError):
        """Known here only."""

    assert type(error_of(answer(1, TooOddError("odd")))) is MotionRefusedError


@BOTH
def test_a_snapshot_arrives_whole_with_what_is_not_known(json: bool, holding_snapshot: object) -> None:
    codec = Codec(json=json)
    assert isinstance(holding_snapshot, Snapshot)
    write, was = SnapshotWriter(), replace(holding_snapshot, events=())
    hot = replace(was, tick=was.tick + 1, quantities={"Base": Quantities(0.5, 60.0)}, warnings=("hot",))
    for sent, told in ((holding_snapshot, was), (hot, hot), (was, was)):
        record = codec.from_arm(write(codec, sent))
        assert isinstance(record, Seen)
        for one in fields(told):
            np.testing.assert_equal(getattr(record.snapshot, one.name), getattr(told, one.name))


@BOTH
def test_programs_of_others_are_told_the_quantities_in_words_too(
    json: bool, holding_snapshot: Snapshot
) -> None:
    hot = replace(holding_snapshot, quantities={"Base": Quantities(0.5, 60.0)})
    for house in (False, True):
        codec = Codec(json=json, house=house)
        record = (msgspec.json if json else msgspec.msgpack).decode(SnapshotWriter()(codec, hot))
        told = None if house else {"Base": "load 50 %, 60 °C"}
        assert record["snapshot"].get("measured") == told
        assert isinstance(codec.from_arm(SnapshotWriter()(codec, hot)), Seen)


def test_a_program_travels_with_those_that_it_calls() -> None:
    called = CalledProgram(file="grip.toml", robot="uzuner", steps=(WaitStep(seconds=1),))
    program = Program(robot="uzuner", steps=(CallStep(program="grip"),), called=(called,))
    long = msgspec.structs.replace(called, steps=20_001 * (WaitStep(seconds=1),))
    many = tuple(msgspec.structs.replace(called, file=f"{k}.toml") for k in range(201))
    for json in (False, True):
        assert travelled(RunProgram(program), json) == RunProgram(program)
        with pytest.raises(ProgramError, match="20001 steps"):
            travelled(RunProgram(msgspec.structs.replace(program, called=(long,))), json)
        with pytest.raises(InputError, match="200"):
            travelled(RunProgram(msgspec.structs.replace(program, called=many)), json)
