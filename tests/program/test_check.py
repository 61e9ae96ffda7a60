from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from armctl.errors import InputError
from armctl.motion import Finding
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
    Step,
    WaitStep,
    check_program,
)
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")
HOME = MoveStep(joints_deg=(0, 90, -80, -40, 0))
NEAR = PointStep(x_mm=200, y_mm=0, z_mm=85)


def found(*steps: Step, robot: str = "uzuner", motions: bool = True) -> list[str]:
    return [str(f) for f in check_program(Program(robot=robot, steps=steps), ROBOT, motions=motions)]


LIFTED, DOWN = PointStep(x_mm=200, y_mm=0, z_mm=100, pitch_deg=-90), dict(x_mm=200, y_mm=0, pitch_deg=-90)
PICKED = GripperStep(open_percent=30, part_x_mm=30, part_y_mm=30, part_z_mm=30)
SUNK = "the carried part: at 0.66 s, 3.0 mm below the floor"


def test_a_part_counts_from_the_step_that_says_its_size_to_the_next_gripper_step() -> None:
    """It stands on the floor with its middle at the tool: lifted, put back, and not put down lower."""
    pick, low = PointStep(z_mm=15, **DOWN), PointStep(z_mm=12, **DOWN)
    assert found(HOME, LIFTED, pick, PICKED, LIFTED, pick, GripperStep(open_percent=80), LIFTED, low) == []
    (refused,) = found(HOME, LIFTED, pick, PICKED, LIFTED, low)
    assert refused.startswith(f"step 6: {SUNK}")
    # what one pass of a block carries at its end, the next one begins with
    again = [RepeatStep(times=3), LIFTED, low, PICKED, EndStep()]
    assert found(HOME, LIFTED, low, PICKED, *again) != []
    (refused,) = found(HOME, GripperStep(open_percent=30), *again)
    assert refused.startswith(f"step 5: {SUNK}")


def test_a_program_begins_with_what_the_arm_carries() -> None:
    what = Program(robot="uzuner", steps=(PointStep(z_mm=12, **DOWN),))
    start = LIFTED.end(ROBOT)
    arm = ROBOT.gripping(0.3)
    assert check_program(what, arm, start=start) == []
    (refused,) = check_program(what, arm.carrying(PICKED.effect.part), start=start)
    assert str(refused).startswith(f"step 1: {SUNK}")


def test_a_good_program() -> None:
    least_travel = PointStep(x_mm=200, y_mm=50, z_mm=100, choose="least-travel")
    assert found(HOME, NEAR, WaitStep(seconds=1), GripperStep(open_percent=0), least_travel, HOME) == []
    assert found(least_travel, NEAR) == []


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (MoveStep(joints_deg=(0, 90)), "step 2: 5 joint angles are needed"),
        (MoveStep(joints_deg=(0, 90, -91.2, 0, 0)), "step 2: Elbow: -91.20° is outside -84.36° … 95.07°"),
        (
            MoveStep(joints_deg=(0, 60, -80, -40, 0), duration_s=0.1),
            "step 2: Shoulder: 30.00° in 0.100 s needs",
        ),
        (MoveStep(joints_deg=(0, float("nan"), 0, 0, 0)), "step 2: key joints_deg[1]: nan is no number"),
        (PointStep(x_mm=900, y_mm=0, z_mm=0), "step 2: "),
        (PointStep(x_mm=200, y_mm=0, z_mm=85, choose="cheapest"), "step 2: there is no criterion 'cheapest'"),
        (PointStep(x_mm=float("nan"), y_mm=0, z_mm=85), "step 2: key x_mm: nan is no number to use"),
        (GripperStep(open_percent=250), "step 2: key open_percent: must be 0 … 100, not 250"),
        (
            GripperStep(open_percent=0, part_x_mm=20, part_z_mm=0.05),
            "step 2: key part_z_mm: must be 0.1 … 1000, not 0.05",
        ),
        (
            GripperStep(open_percent=0, part_x_mm=20, part_z_mm=30),
            "step 2: the size of a part needs all of part_x_mm, part_y_mm, part_z_mm",
        ),
        (WaitStep(seconds=-1), "step 2: key seconds: must be 0 … 86400, not -1"),
        (LineStep(x_mm=200, y_mm=0, z_mm=85, pitch="interpolated"), 'step 2: pitch = "interpolated" and'),
        (LineStep(x_mm=200, y_mm=0, z_mm=85, pitch_deg=3), 'step 2: pitch = "kept" and pitch_deg = 3'),
        (
            LineStep(x_mm=200, y_mm=0, z_mm=85, orientation="interpolated"),
            'step 2: orientation = "interpolated" and rx_deg, ry_deg, rz_deg = None do not go together',
        ),
        (
            LineStep(x_mm=200, y_mm=0, z_mm=85, orientation="interpolated", rx_deg=1),
            "step 2: an orientation needs all of rx_deg, ry_deg, rz_deg",
        ),
        (
            LineStep(x_mm=200, y_mm=0, z_mm=85, orientation="kept", pitch="free"),
            'step 2: pitch = "free" and orientation = "kept" do not go together',
        ),
        (PointStep(x_mm=200, y_mm=0, z_mm=85, ry_deg=1), "step 2: an orientation needs all of rx_deg"),
        (
            PointStep(x_mm=200, y_mm=0, z_mm=85, rx_deg=0, ry_deg=1, rz_deg=2, pitch_deg=3),
            "step 2: give either a rotation, or pitch and roll, not both",
        ),
        (RepeatStep(times=2), "step 2: this 'repeat' has no 'end'"),
        (EndStep(), "step 2: 'end' without a 'repeat', 'if' or 'while'"),
    ],
)
def test_what_is_wrong_with_a_step(step: Step, message: str) -> None:
    (text,) = found(HOME, step, NEAR)
    assert text.startswith(message)


def test_the_program_as_a_whole() -> None:
    assert found(HOME, robot="abaas") == ["it is for the robot 'abaas', this one is 'uzuner'"]
    assert found() == ["it has no steps"]
    assert found(PointStep(x_mm=900, y_mm=0, z_mm=0), motions=False) == []
    program = Program(robot="uzuner", steps=(GripperStep(open_percent=1),))
    assert [f.what for f in check_program(program, replace(ROBOT, gripper=None))] == [
        "uzuner has no gripper; delete the step"
    ]


def all_findings(*steps: Step, **more: object) -> list[Finding]:
    return check_program(Program(robot="uzuner", steps=steps), ROBOT, **more)  # type: ignore[arg-type]


LOW = MoveStep(joints_deg=(0, -3, -60, -20, 0))
STRETCHED = MoveStep(joints_deg=(0, 0, 0, 0, 0))


def test_a_finding_of_the_preflight_says_when_where_what_and_how_to_mend_it() -> None:
    (finding,) = [f for f in all_findings(HOME, CommentStep(note="down"), LOW) if f.kind == "floor"]
    assert (finding.step, finding.part, finding.severity) == (2, "the left jaw", "error")
    assert finding.time is not None and finding.time > 0
    assert "below the floor" in finding.what and "raise the target" in finding.mend
    assert str(finding) == (f"step 3: the left jaw: at {finding.time:.2f} s, {finding.what}; {finding.mend}")
    (finding,) = all_findings(HOME, STRETCHED)
    assert (finding.step, finding.severity, finding.kind) == (1, "warning", "singularity")


def test_where_it_starts_matters_only_when_it_is_told() -> None:
    assert all_findings(LOW, motions=True) == []
    found = all_findings(LOW, start=ROBOT.pose("home"))
    assert [(f.step, f.kind) for f in found] == [(0, "floor")]
    with pytest.raises(InputError):
        all_findings(LOW, start=[1.0, float("nan"), 0, 0, 0])


def test_a_payload_counts() -> None:
    out = MoveStep(joints_deg=(0, 5, 5, 5, 0))
    assert {f.kind for f in all_findings(HOME, out, payload_kg=1.5)} >= {"torque"}
    assert "torque" not in {f.kind for f in all_findings(HOME, out)}


def test_lines_and_arcs_are_planned_from_where_the_step_before_ends() -> None:
    here = PointStep(x_mm=200, y_mm=0, z_mm=120, choose="published")
    line = LineStep(x_mm=200, y_mm=60, z_mm=120)
    arc = ArcStep(via_x_mm=205, via_y_mm=30, via_z_mm=120, x_mm=200, y_mm=0, z_mm=120)
    assert all_findings(here, line, arc) == []
    far = LineStep(x_mm=500, y_mm=60, z_mm=120)
    (finding,) = all_findings(here, far)
    assert (finding.step, finding.severity) == (1, "error")
    assert all_findings(far) == []  # nothing is known of where it starts


def test_a_block_is_entered_again_from_where_it_ends() -> None:
    # from home the first pass is clear of the short duration, the second one comes from farther away
    near = MoveStep(joints_deg=(10, 90, -80, -40, 0), duration_s=1.0)
    away = MoveStep(joints_deg=(100, 90, -80, -40, 0))
    once = all_findings(HOME, RepeatStep(times=1), near, away, EndStep())
    assert once == []
    (finding,) = all_findings(HOME, RepeatStep(times=2), near, away, EndStep())
    assert finding.step == 2 and "needs" in finding.what
    assert all_findings(HOME, RepeatStep(times=9), near, away, EndStep()) == [finding]


def test_blocks_in_blocks_cost_no_more_than_their_steps() -> None:
    deep = 400  # two passes of each would be 2 ** 400
    steps = [*[RepeatStep(times=3)] * deep, HOME, STRETCHED, *[EndStep()] * deep]
    (finding,) = all_findings(*steps)
    assert (finding.step, finding.kind) == (deep + 1, "singularity")


def test_findings_come_in_the_order_of_the_steps() -> None:
    found = all_findings(HOME, LOW, WaitStep(seconds=-1), HOME, LOW)
    assert [f.step for f in found] == sorted(f.step for f in found if f.step is not None)
    assert {f.step for f in found} == {1, 2, 4}


def test_a_long_program_is_checked_like_its_motions_one_by_one() -> None:
    rng = np.random.default_rng(2)
    low, high = np.degrees(ROBOT.limits).T
    steps = [
        MoveStep(joints_deg=tuple(rng.uniform(low + 0.01, high - 0.01).tolist()), blend_mm=10)
        for _ in range(40)
    ]
    together = all_findings(*steps)
    apart = [
        replace(finding, step=k + 1)
        for k in range(39)
        for finding in all_findings(*steps[k : k + 2])
        if finding.step == 1
    ]
    assert [str(f) for f in together] == [str(f) for f in apart]
    assert together


def test_a_check_tells_how_far_it_is_and_ends_when_it_is_told_to() -> None:
    there = MoveStep(joints_deg=(10, 90, -80, -40, 0))
    seen: list[tuple[int, int]] = []
    all_findings(HOME, WaitStep(seconds=1), there, HOME, progress=lambda *told: seen.append(told))
    assert seen == [(1, 4), (3, 4), (4, 4)]

    class CancelledError(Exception):
        """Somebody pressed Cancel."""

    def cancel(done: int, _: int) -> None:
        if done > 1:
            raise CancelledError

    with pytest.raises(CancelledError):
        all_findings(HOME, there, HOME, progress=cancel)


@pytest.mark.parametrize(
    ("wrong", "fact"),
    [
        (MoveStep(joints_deg=(0.0, 60.0, -60.0, 200.0, 0.0)), "200.00°"),
        (MoveStep(joints_deg=(0.0, 60.0, -60.0, 20.0, 0.0), duration_s=math.inf), "inf"),
        (MoveStep(joints_deg=(0.0, 60.0, -60.0, 20.0)), "5 joint angles"),
    ],
)
def test_one_wrong_step_is_found_among_many(wrong: MoveStep, fact: str) -> None:
    good = MoveStep(joints_deg=(0.0, 60.0, -60.0, 20.0, 0.0))
    program = Program(robot="uzuner", steps=(good,) * 200 + (wrong,) + (good,) * 200)
    (finding,) = check_program(program, ROBOT, motions=False)
    assert finding.step == 200
    assert fact in str(finding)
