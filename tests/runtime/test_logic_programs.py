"""Generated programs with branches, loops, counters and waits: what the check says is what happens."""

from __future__ import annotations

import os
from itertools import groupby
from pathlib import Path
from random import Random

import numpy as np
import pytest
from tests.runtime.kit import TICK
from tests.runtime.signal_kit import BUTTON, bench_of, robot_with

from armctl.facts import State
from armctl.program import (
    CommentStep,
    CountStep,
    ElseStep,
    EndStep,
    IfStep,
    MoveStep,
    PointStep,
    Program,
    RepeatStep,
    SetStep,
    Step,
    WaitForStep,
    WaitStep,
    WhileStep,
    check_program,
)
from armctl.program.base_steps import Question, Senses
from armctl.program.rehearsal import rehearse
from armctl.protocol import RunProgram

SOUND, FAULTY = (500, 500) if os.environ.get("ARMCTL_LONG") else (8, 40)
SLOT, END, ADD = CommentStep(note="a path leads here"), EndStep(), CountStep(counter="n", add=1)
HOME = MoveStep(joints_deg=(0, 90, -80, -40, 0))


def generated(rng: Random, depth: int = 0) -> list[Step]:
    """Steps that an arm with a button can run; what may be added at a ``SLOT`` is run on some path."""
    steps: list[Step] = [SLOT]
    for _ in range(rng.randint(1, 3 if depth else 4)):
        what = rng.randrange(8 if depth < 3 else 4)
        inside = generated(rng, depth + 1) if what >= 4 else []
        blend = rng.choice((0, 30))
        counter = f"k{depth}_{rng.randrange(10**6)}"
        few = WhileStep(watch="counter", counter=counter, compare="below", value=rng.randint(1, 3))
        steps += {
            0: [MoveStep(joints_deg=(rng.randint(-30, 30), 90, -80, -40, 0), blend_mm=blend)],
            1: [WaitStep(seconds=rng.choice((0.1, 0.4)))],
            2: [SetStep(output="bell", value=rng.randint(0, 1)), ADD],
            3: [PointStep(x_mm=200, y_mm=rng.randint(-40, 40), z_mm=110, choose="published")],
            4: [IfStep(watch="button", value=rng.randint(0, 1)), *inside, ElseStep(), HOME, END],
            5: [RepeatStep(times=rng.randint(1, 2)), *inside, END],
            6: [few, *inside, CountStep(counter=counter, add=1), END],
            7: [
                CountStep(counter=counter, to=1),
                WaitForStep(watch="counter", counter=counter, timeout_s=1),
                IfStep(watch="counter", counter=counter),
                *inside,
                END,
            ],
        }[what]
    return [*steps, SLOT]


def fault(rng: Random) -> list[Step]:
    """Something that must be found before it runs, on one of two branches."""
    bad: list[list[Step]] = [
        [PointStep(x_mm=900, y_mm=0, z_mm=0)],
        [PointStep(x_mm=200, y_mm=0, z_mm=-40)],
        [MoveStep(joints_deg=(0, 90, -150, -90, 0))],
        [WaitForStep(watch="counter", counter="late", value=1, timeout_s=5), CountStep(counter="late", to=1)],
        [WhileStep(watch="counter", counter="late", compare="below", value=1), HOME, END],
        [
            CountStep(counter="nth", to=0),
            RepeatStep(times=1000),
            CountStep(counter="nth", add=1),
            IfStep(watch="counter", counter="nth", compare="above", value=rng.randint(2, 50)),
            PointStep(x_mm=200, y_mm=0, z_mm=-40),
            END,
            HOME,
            END,
        ],
    ]
    chosen = rng.choice(bad)
    return [IfStep(watch="button", value=rng.randint(0, 1)), HOME, ElseStep(), *chosen, END, HOME]


@pytest.mark.parametrize("seed", range(FAULTY))
def test_each_seeded_fault_is_found(seed: int, tmp_path: Path) -> None:
    rng, robot = Random(seed), robot_with(tmp_path)
    steps = generated(rng)
    at = rng.choice([index for index, step in enumerate(steps) if step is SLOT])
    faulty = Program(robot="uzuner", steps=(*steps[:at], *fault(rng), *steps[at:]))
    found = check_program(faulty, robot, start=robot.pose("home"))
    assert [one for one in found if one.severity == "error"], seed


@pytest.mark.parametrize("seed", range(SOUND))
def test_a_sound_one_runs_as_was_foretold(seed: int, tmp_path: Path) -> None:
    rng, robot = Random(1_000_000 + seed), robot_with(tmp_path)
    bench = bench_of(robot)
    pressed = rng.random() < 0.5
    bench.board.levels[BUTTON] = 0.0 if pressed else 1.0
    bench.run(4 * TICK)
    program, start = Program(robot="uzuner", name="p", steps=(HOME, *generated(rng))), bench.now.q_command
    assert [one for one in check_program(program, robot, start=start) if one.severity == "error"] == []

    def answer(question: Question, senses: Senses) -> bool:
        return question.holds(Senses({}, {"button": float(pressed)}, counters=senses.counters))

    foretold = rehearse(robot, program, start, answer=answer)
    ticket = bench.do(RunProgram(program))
    began, seen = bench.clock.now(), [0]
    while bench.now.state is State.MOVING:
        if bench.now.program is not None:
            seen.append(bench.now.program.step)
        bench.run(TICK)
    ticket.finished.result(0)
    took = bench.clock.now() - began
    # Of steps that take no time some are over before a snapshot shows them.
    lasting = {step.index for step in foretold.steps}
    lasting -= {step.index for step in foretold.steps if step.duration <= TICK}
    order = [step.index for step in foretold.steps]
    was, should = ([k for k, _ in groupby(filter(lasting.__contains__, some))] for some in (seen, order))
    assert was == should
    # A step is begun at a tick: each may take up to two more than it lasts.
    assert -TICK <= took - foretold.duration <= 0.02 * foretold.duration + 2 * TICK * len(foretold.steps)
    np.testing.assert_allclose(bench.now.q_command, foretold.trajectory.end, atol=1e-9)
