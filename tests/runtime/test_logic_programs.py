"""Generated programs with branches, loops, counters and waits: what the check says is what happens."""

from __future__ import annotations

import os
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from random import Random

import numpy as np
import pytest
from tests.runtime.kit import TICK
from tests.runtime.signal_kit import BUTTON, bench_of, robot_with

from armctl.arrays import FloatArray
from armctl.facts import State
from armctl.program import (
    CalledProgram,
    CallStep,
    CommentStep,
    CountStep,
    ElseStep,
    EndStep,
    GridStep,
    IfStep,
    LineStep,
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
from armctl.program.rehearsal import Rehearsal, rehearse
from armctl.protocol import RunProgram

SOUND, FAULTY = (1000, 1000) if os.environ.get("ARMCTL_LONG") else (4, 20)
SLOT, END, ADD = CommentStep(note="a path leads here"), EndStep(), CountStep(counter="n", add=1)
HOME = MoveStep(joints_deg=(0, 90, -80, -40, 0))
ABOVE, AT = PointStep(x_mm=0, y_mm=0, z_mm=30, frame="cell"), LineStep(x_mm=0, y_mm=0, z_mm=0, frame="cell")
CALLED = (
    CalledProgram(
        file="ring.toml", robot="uzuner", steps=(SetStep(output="bell"), HOME, CallStep(program="off"))
    ),
    CalledProgram(
        file="off.toml", robot="uzuner", steps=(WaitStep(seconds=0.2), SetStep(output="bell", value=0))
    ),
    CalledProgram(file="lost.toml", missing="beside"),
)


def grid(rows: int, columns: int, last_x_mm: float = 220.0) -> GridStep:
    """Cells in reach, if the last of a column is."""
    return GridStep(
        x_mm=180, y_mm=-30, z_mm=80, row_x_mm=180, row_y_mm=30, row_z_mm=80, column_x_mm=last_x_mm,
        column_y_mm=-30, column_z_mm=80, rows=rows, columns=columns,
    )  # fmt: skip


def generated(rng: Random, depth: int = 0) -> list[Step]:
    """Steps that an arm with a button can run; what may be added at a ``SLOT`` is run on some path."""
    steps: list[Step] = [SLOT]
    for _ in range(rng.randint(1, 3 if depth else 4)):
        what = rng.randrange(9 if depth < 3 else 5)
        inside = generated(rng, depth + 1) if what >= 5 else []
        blend = rng.choice((0, 30))
        counter = f"k{depth}_{rng.randrange(10**6)}"
        few = WhileStep(watch="counter", counter=counter, compare="below", value=rng.randint(1, 3))
        steps += {
            0: [MoveStep(joints_deg=(rng.randint(-30, 30), 90, -80, -40, 0), blend_mm=blend)],
            1: [WaitStep(seconds=rng.choice((0.1, 0.4)))],
            2: [SetStep(output="bell", value=rng.randint(0, 1)), ADD],
            3: [PointStep(x_mm=200, y_mm=rng.randint(-40, 40), z_mm=110, choose="published")],
            4: rng.choice(([CallStep(program="ring")], [grid(rng.randint(1, 2), 2), ABOVE, AT, ABOVE, END])),
            5: [IfStep(watch="button", value=rng.randint(0, 1)), *inside, ElseStep(), HOME, END],
            6: [RepeatStep(times=rng.randint(1, 2)), *inside, END],
            7: [few, *inside, CountStep(counter=counter, add=1), END],
            8: [
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
        [CallStep(program="lost")],
        [grid(rng.randint(2, 5), rng.randint(1, 3), 420), ABOVE, AT, ABOVE, END],
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
    faulty = Program(robot="uzuner", steps=(*steps[:at], *fault(rng), *steps[at:]), called=CALLED)
    found = check_program(faulty, robot, start=robot.pose("home"))
    assert [one for one in found if one.severity == "error"], seed


@dataclass(frozen=True)
class Run:
    """A sound program, foretold and run on the manual clock."""

    foretold: Rehearsal
    took: float
    seen: list[int]
    """steps, tick by tick"""
    end: FloatArray


def run(seed: int, folder: Path) -> Run:
    rng, robot = Random(1_000_000 + seed), robot_with(folder)
    bench = bench_of(robot)
    pressed = rng.random() < 0.5
    bench.board.levels[BUTTON] = 0.0 if pressed else 1.0
    bench.run(4 * TICK)
    steps = (HOME, *generated(rng))
    program, start = Program(robot="uzuner", name="p", steps=steps, called=CALLED), bench.now.q_command
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
    return Run(foretold, bench.clock.now() - began, seen, bench.now.q_command)


@pytest.mark.parametrize("seed", range(SOUND))
def test_a_sound_one_runs_as_was_foretold(seed: int, tmp_path: Path) -> None:
    ran = run(seed, tmp_path)
    # Of steps that take no time some are over before a snapshot shows them.
    lasting = {step.index for step in ran.foretold.steps}
    lasting -= {step.index for step in ran.foretold.steps if step.duration <= TICK}
    order = [step.index for step in ran.foretold.steps]
    was, should = ([k for k, _ in groupby(filter(lasting.__contains__, some))] for some in (ran.seen, order))
    assert was == should
    # the command comes at one tick, and the end is seen at the next
    assert ran.took == pytest.approx(ran.foretold.duration, rel=0.02, abs=3 * TICK)
    np.testing.assert_allclose(ran.end, ran.foretold.trajectory.end, atol=1e-9)
