"""Programs that call others on the arm: what the check foretold is what runs."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from random import Random

import msgspec
import numpy as np
import pytest
from tests.program.kit import program
from tests.runtime.kit import ROBOT, TICK, Rig, make_rig
from tests.runtime.signal_kit import bench_of, robot_with
from tests.runtime.test_logic_programs import CALLED, generated

from armctl.errors import ProgramError
from armctl.facts import CalledStep, State
from armctl.program import (
    CalledProgram,
    CallStep,
    EndStep,
    GripperStep,
    MessageStep,
    MoveStep,
    Program,
    RepeatStep,
    SpeedStep,
    Step,
    WaitForStep,
    WaitStep,
    WhileStep,
    check_program,
)
from armctl.program.base_steps import Question, Senses
from armctl.program.rehearsal import pose_after, rehearse
from armctl.protocol import RunProgram, UpdateProgram

HOME = MoveStep(joints_deg=(0, 90, -80, -40, 0))
LEFT, RIGHT = MoveStep(joints_deg=(20, 90, -80, -40, 0)), MoveStep(joints_deg=(-20, 90, -80, -40, 0))
CALL, END = CallStep(program="a"), EndStep()


def calling(*steps: Step, **called: tuple[Step, ...]) -> Program:
    """A program, and those that it calls by their names, as they were read."""
    files = tuple(CalledProgram(file=f"{name}.toml", robot="uzuner", steps=on) for name, on in called.items())
    return Program(robot="uzuner", name="main", steps=steps, called=files)


def rig_at_home() -> Rig:
    return make_rig().enable(ROBOT.pose("home"))


def places_seen(rig: Rig) -> list[tuple[int, tuple[CalledStep, ...]]]:
    shown = [(s.program.step, s.program.calls) for s in rig.history if s.program is not None]
    return [here for here, _ in groupby(shown)]


def test_it_tells_in_which_program_it_is() -> None:
    rig = rig_at_home()
    main = calling(HOME, CALL, LEFT, a=(LEFT, CallStep(program="b")), b=(WaitStep(seconds=0.2), RIGHT))
    ticket = rig.do(RunProgram(main))
    rig.rests()
    ticket.result(0)
    first, inner = CalledStep("a", 0), CalledStep("a", 1)
    assert places_seen(rig) == [
        (0, ()),
        (1, (first,)),
        (1, (inner, CalledStep("b", 0))),
        (1, (inner, CalledStep("b", 1))),
        (2, ()),
    ]
    shares = [s.progress for s in rig.history if s.progress is not None]
    assert shares == sorted(shares) and 0.3 < shares[len(shares) // 2] < 0.9
    assert all(s.program.steps == 3 for s in rig.history if s.program is not None)


@pytest.mark.parametrize("seed", range(3))
def test_what_the_check_foretold_is_what_runs(seed: int, tmp_path: Path) -> None:
    rng, robot = Random(2_000_000 + seed), robot_with(tmp_path)
    bench = bench_of(robot)
    inside = (SpeedStep(percent=60), *generated(rng), CallStep(program="b"))
    twice = (RepeatStep(times=2), CALL, LEFT, END)
    main = calling(
        HOME, *twice, RIGHT, *generated(rng), CALL, HOME, a=inside, b=(RIGHT, WaitStep(seconds=0.3))
    )
    main = msgspec.structs.replace(main, called=(*main.called, *CALLED))
    start = bench.now.q_command
    assert [one for one in check_program(main, robot, start=start) if one.severity == "error"] == []

    def answer(question: Question, senses: Senses) -> bool:
        return question.holds(Senses({}, {"button": 0.0}, counters=senses.counters))

    foretold = rehearse(robot, main, start, answer=answer)
    ticket, begun = bench.do(RunProgram(main)), bench.clock.now()
    while bench.now.state is State.MOVING:
        bench.run(TICK)
    ticket.finished.result(0)
    took = bench.clock.now() - begun
    assert took == pytest.approx(foretold.duration, rel=0.02, abs=3 * TICK)
    np.testing.assert_allclose(bench.now.q_command, foretold.trajectory.end, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_many_short_steps_take_as_long_as_foretold(seed: int) -> None:
    rng, home = Random(seed), np.degrees(ROBOT.pose("home"))

    def step() -> Step:
        near = MoveStep(joints_deg=tuple((home + [rng.uniform(-3, 3) for _ in home]).tolist()))
        wait = WaitStep(seconds=rng.choice([0.01, 0.05, 0.2]))
        grip, slow = (
            GripperStep(open_percent=rng.choice([0, 50])),
            SpeedStep(percent=rng.choice([20, 50, 100])),
        )
        return rng.choice([near, near, wait, grip, slow])

    rig, main = rig_at_home(), program(*(step() for _ in range(30)))
    foretold = rehearse(ROBOT, main, ROBOT.pose("home"), rig.now.gripper)
    begun, ticket = rig.clock.now(), rig.do(RunProgram(main))
    rig.rests()
    ticket.result(0)
    assert rig.clock.now() - begun == pytest.approx(foretold.duration, abs=3 * TICK)


def test_the_duration_is_foretold_to_two_percent() -> None:
    rig, main = rig_at_home(), calling(LEFT, CALL, LEFT, a=(SpeedStep(percent=10), RIGHT, LEFT, RIGHT))
    foretold = rehearse(ROBOT, main, ROBOT.pose("home"))
    begun, ticket = rig.clock.now(), rig.do(RunProgram(main))
    rig.rests()
    ticket.result(0)
    assert rig.clock.now() - begun == pytest.approx(foretold.duration, rel=0.02)


def test_a_speed_ends_with_the_program_that_set_it() -> None:
    slow = (SpeedStep(percent=20), RIGHT)
    main = calling(
        HOME, RepeatStep(times=2), LEFT, CALL, LEFT, END, SpeedStep(percent=50), CALL, LEFT, a=slow
    )
    steps = [one for one in rehearse(ROBOT, main, ROBOT.pose("home")).steps if one.duration > 0]
    plain = rehearse(ROBOT, program(HOME, LEFT, RIGHT, LEFT), ROBOT.pose("home")).steps[-1].duration
    took = [one.duration / plain for one in steps[1:]]
    # (a swing to LEFT from where it stands already takes no time)
    assert took[:2] == pytest.approx([5, 1]) and took[2:4] == pytest.approx([5, 1])
    assert took[-2:] == pytest.approx([5, 2])


def test_one_step_is_all_of_the_called_program() -> None:
    rig = rig_at_home()
    wait = WhileStep(watch="counter", counter="n", compare="above", value=0)
    main = calling(HOME, CALL, HOME, a=(LEFT, wait, HOME, END, RepeatStep(times=2), RIGHT, LEFT, END))
    rig.finishes(RunProgram(main, first=1, count=1))
    np.testing.assert_allclose(np.degrees(rig.now.q_command), LEFT.joints_deg, atol=1e-9)
    assert {step for step, _ in places_seen(rig)} == {1}
    rig.finishes(RunProgram(main, first=1, count=2))
    np.testing.assert_allclose(np.degrees(rig.now.q_command), HOME.joints_deg, atol=1e-9)
    end = pose_after(ROBOT, main, 1, ROBOT.pose("home"))
    assert end is not None
    np.testing.assert_allclose(np.degrees(end), LEFT.joints_deg, atol=1e-9)
    assert pose_after(ROBOT, calling(CALL, a=(WaitStep(seconds=1),)), 0, ROBOT.pose("home")) is None


@pytest.mark.parametrize("otherwise", ["stop", "go on"])
def test_a_time_out_in_a_called_program_names_the_place(otherwise: str) -> None:
    rig = rig_at_home()
    ask = MessageStep(text="Part there?", timeout_s=0.5, otherwise=otherwise)  # type: ignore[arg-type]
    ticket = rig.do(RunProgram(calling(CALL, HOME, a=(LEFT, ask, RIGHT))))
    rig.rests()
    if otherwise == "go on":
        ticket.result(0)
        np.testing.assert_allclose(np.degrees(rig.now.q_command), HOME.joints_deg, atol=1e-9)
        return
    with pytest.raises(ProgramError, match=r"main: step 1: in 'a', step 2: waited 0\.5 s for OK"):
        ticket.result(0)
    np.testing.assert_allclose(np.degrees(rig.now.q_command), LEFT.joints_deg, atol=1e-9)


def test_what_cannot_be_called_is_refused_before_a_motion() -> None:
    rig = rig_at_home()
    rig.refuses(RunProgram(calling(LEFT, CALL)), "step 2: the program 'a' that it calls", ProgramError)
    circle = calling(LEFT, CALL, a=(CallStep(program="b"),), b=(CALL,))
    rig.refuses(RunProgram(circle), "main → a → b → a", ProgramError)
    rig.sends_nothing(0.2)
    ticket = rig.do(RunProgram(calling(HOME, a=()), loops=None))
    rig.refuses(
        UpdateProgram(calling(CALL)), "step 1: the program 'a' that it calls was not sent", ProgramError
    )
    rig.stops()
    assert ticket.finished.exception(0) is not None


def test_an_edit_of_the_caller_comes_with_the_next_pass() -> None:
    rig = rig_at_home()
    rig.do(RunProgram(calling(LEFT, CALL, a=(RIGHT,)), loops=3))
    rig.run(0.1)
    rig.do(UpdateProgram(calling(LEFT, CALL, a=(HOME,)))).result(0)
    assert rig.now.program is not None and rig.now.program.coming.called[0].steps == (HOME,)
    rig.rests()
    np.testing.assert_allclose(np.degrees(rig.now.q_command), HOME.joints_deg, atol=1e-9)
    turned = [np.degrees(s.q_command[0]) for s in rig.history]
    assert min(turned) == pytest.approx(-20, abs=0.01)  # the first pass was that of before


def test_a_wait_for_an_input_in_a_called_program(tmp_path: Path) -> None:
    bench = bench_of(robot_with(tmp_path))
    wait = WaitForStep(watch="button", timeout_s=1)
    ticket = bench.do(RunProgram(calling(CALL, a=(CallStep(program="b"),), b=(HOME, wait))))
    while bench.now.state is State.MOVING:
        bench.run(TICK)
    with pytest.raises(ProgramError, match=r"step 1: in 'a', step 1: in 'b', step 2: waited 1 s for button"):
        ticket.finished.result(0)
