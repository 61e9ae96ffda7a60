"""What a copy of an arm takes along, and what stays with the arm that it is a copy of."""

from __future__ import annotations

from pathlib import Path

import pytest

from armctl.calibration import Calibration, CalibrationStore, JointCalibration, calibrated
from armctl.program import DrawStep, MoveStep, Program, RepeatStep, load_program, save_program
from armctl.program.steps import CallStep, EndStep
from armctl.robot import Robot, load_robot, robot_path
from armctl.robot.draft import Draft
from armctl.ui.own_copy import Carried, carry_over, is_same_arm

UZUNER = load_robot("uzuner")
BOARDS = ("simulated", "00123456")


def copy_of(**changed: object) -> Robot:
    draft = Draft.of_file(robot_path("uzuner")).changed(name="my_uzuner", title="My arm")
    return draft.changed(**changed).robot()


def with_button() -> Robot:
    return copy_of(inputs=[{"name": "button", "channel": 6}])


class Kept:
    """Programs, a drawing and calibrations of Uzuner's arm."""

    def __init__(self, folder: Path) -> None:
        self.programs, self.store = folder / "programs", CalibrationStore(folder / "calibrations")
        place = self.programs / "uzuner"
        place.mkdir(parents=True)
        (place / "star.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
        move = MoveStep(joints_deg=tuple(UZUNER.shown(UZUNER.pose("home")).tolist()))
        draw = DrawStep(file=str(place / "star.svg"), plane_mm=(180, 30, 30, 180, -70, 30, 250, 30, 30))
        for name, steps in {
            "wave": (RepeatStep(times=2), move, EndStep()),
            "star": (move, draw),
            "both": (CallStep(program="wave"), move),
        }.items():
            save_program(Program(robot="uzuner", name=name, steps=steps), place / f"{name}.toml")
        joint = JointCalibration(zero=1490.0, per_rad=590.0, low=700.0, high=2300.0)
        for board in BOARDS:
            self.store.save(Calibration("uzuner", board, "µs", {"base": joint}, note="protractor"))
        self.store.save(Calibration("mico", "00123456", "µs", {}))

    def to(self, copy: Robot) -> Carried:
        return carry_over(UZUNER, copy, self.programs, self.store)

    def program(self, robot: str, name: str) -> Program:
        return load_program(self.programs / robot / f"{name}.toml")


@pytest.fixture
def kept(tmp_path: Path) -> Kept:
    return Kept(tmp_path)


def test_the_same_arm_with_a_button_more_gets_copies_of_all_of_it(kept: Kept) -> None:
    copy = with_button()
    assert copy.signals != UZUNER.signals and is_same_arm(UZUNER, copy)
    came = kept.to(copy)
    assert came == Carried(programs=3, drawings=1, boards=tuple(sorted(BOARDS)))
    assert came.words("Uzuner") == (
        "Copied from Uzuner, which keeps its own: 3 saved programs, 1 drawing, "
        "the calibration on 00123456, the calibration on simulated."
    )
    for name in ("wave", "star", "both"):
        copied, original = kept.program("my_uzuner", name), kept.program("uzuner", name)
        assert (copied.robot, original.robot) == ("my_uzuner", "uzuner")
        assert len(copied.steps) == len(original.steps)
    drawn = kept.program("my_uzuner", "star").steps[1]
    assert isinstance(drawn, DrawStep) and Path(drawn.file) == kept.programs / "my_uzuner" / "star.svg"
    (called,) = kept.program("my_uzuner", "both").called
    assert called.robot == "my_uzuner" and not called.missing
    for board in BOARDS:
        measured = kept.store.load("my_uzuner", board)
        assert measured is not None and measured.note == "copied from uzuner: protractor"
        outputs = calibrated(copy, measured).output_map
        assert outputs is not None and outputs.zero[0] == pytest.approx(1490.0)


def test_what_the_copy_has_already_stays(kept: Kept) -> None:
    copy = with_button()
    kept.to(copy)
    mine = Calibration("my_uzuner", "simulated", "µs", {}, gripper=(1100.0, 1900.0))
    kept.store.save(mine)
    (kept.programs / "my_uzuner" / "wave.toml").write_text("mine")
    assert kept.to(copy) == Carried() and Carried().words("Uzuner") == ""
    assert (kept.programs / "my_uzuner" / "wave.toml").read_text() == "mine"
    now = kept.store.load("my_uzuner", "simulated")
    assert now is not None and now.gripper == (1100.0, 1900.0)


def test_an_arm_that_is_built_otherwise_gets_nothing_and_the_page_says_so(kept: Kept, tmp_path: Path) -> None:
    limited = Draft.of_file(robot_path("uzuner")).changed(name="my_uzuner")
    limited = limited.with_joint("base", limit_deg=[-60.0, 60.0])
    for other in (limited.robot(), copy_of(floor={"z_mm": -20.0}), load_robot("mico")):
        assert not is_same_arm(UZUNER, other)
        came = kept.to(other)
        assert came.stay and not came.boards and "stay with Uzuner" in came.words("Uzuner")
        assert not (kept.programs / other.name).exists()
    none = carry_over(UZUNER, limited.robot(), tmp_path / "nothing", CalibrationStore(tmp_path / "none"))
    assert none.words("Uzuner") == ""


def test_a_program_that_cannot_be_read_is_named_and_the_others_come(kept: Kept) -> None:
    (kept.programs / "uzuner" / "torn.toml").write_text("do = [")
    came = kept.to(with_button())
    assert came.programs == 3 and len(came.boards) == 2
    (problem,) = came.problems
    assert "torn.toml" in problem and "Not copied: " in came.words("Uzuner")
    assert not (kept.programs / "my_uzuner" / "torn.toml").exists()
