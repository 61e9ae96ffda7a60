"""The Manual screen as an operator uses it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import ServedArm, served_arm

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
    WaitStep,
    load_program,
    save_program,
)
from armctl.runtime import State

pytestmark = pytest.mark.browser

HOME = [0.0, 90.0, -80.0, -40.0, 0.0]
BROKEN = """format = 1
robot = "uzuner"
name = "broken"
[[steps]]
do = "wait"
seconds = 1
[[steps]]
do = "move"
joint_deg = [0, 90, -80, -40, 0]
"""


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedArm]:
    with served_arm(tmp_path / "programs") as served:
        yield served


def opened(screen: Screen, served: ServedArm, inner: str) -> None:
    screen.open(served.url, until="STOP")
    screen.open_tab("Manual")
    screen.open_tab(inner)


def wait_for_deg(screen: Screen, served: ServedArm, degrees: list[float]) -> None:
    screen.wait_until(
        lambda: served.commanded_deg == degrees and served.now.state is State.HOLDING,
        f"the arm stands at {degrees}",
    )


def click_in(screen: Screen, row: str, button: str) -> None:
    screen.click(button, within=screen.row(row))


def unfold(screen: Screen, folder: str, button: str) -> None:
    screen.press(screen.page.get_by_text(folder, exact=True))
    lies_at: list[object] = []

    def rests() -> bool:
        lies_at.append(screen.button(button).bounding_box())
        return len(lies_at) > 5 and all(box == lies_at[-1] for box in lies_at[-5:])

    screen.wait_until(rests, "the folder has unfolded")


def test_a_slider_moves_the_arm_only_after_go(screen: Screen, served: ServedArm) -> None:
    opened(screen, served, "Joints")
    screen.type_into("Base °", "25.5")
    screen.wait_for_text("The ghost shows the new pose.")
    screen.screenshot("manual-joints")
    assert served.commanded_deg == HOME
    screen.click("Go")
    wait_for_deg(screen, served, [25.5, *HOME[1:]])
    screen.wait_for_text(re.compile("The sliders show the arm"))
    assert screen.errors == []


def test_sliders_go_back_to_the_present_pose_and_then_follow_the_arm(
    screen: Screen, served: ServedArm
) -> None:
    opened(screen, served, "Joints")
    screen.nudge("Elbow °")
    screen.wait_for_text("The ghost shows the new pose.")
    screen.click("Sliders to present pose")
    screen.wait_until(lambda: screen.number("Elbow °") == -80, "the slider is back")
    click_in(screen, "Wrist roll", "+")
    wait_for_deg(screen, served, [*HOME[:4], 1.0])
    screen.wait_until(lambda: screen.number("Wrist roll °") == 1, "the slider has followed")


def test_quick_steps_add_up(screen: Screen, served: ServedArm) -> None:
    opened(screen, served, "Joints")
    screen.choose("Step °", "5")
    for _ in range(4):
        click_in(screen, "Base", "+")
    wait_for_deg(screen, served, [20.0, *HOME[1:]])
    assert screen.notifications() == []


def test_a_step_past_the_limit_is_refused_in_words(screen: Screen, served: ServedArm) -> None:
    opened(screen, served, "Joints")
    screen.choose("Step °", "10")
    click_in(screen, "Elbow", "−")
    screen.wait_for_notification(
        re.compile(r"Elbow: -10° from -80\.00° leads to -90\.00°, the limit is -84\.36°")
    )
    screen.choose("Step °", "0.1")
    click_in(screen, "Elbow", "−")
    wait_for_deg(screen, served, [0.0, 90.0, -80.1, -40.0, 0.0])


def test_the_arm_jogs_while_the_button_is_held(screen: Screen, served: ServedArm) -> None:
    opened(screen, served, "Jog & gripper")
    screen.choose("Joint", "Shoulder")
    screen.hold("Jog +", 600)
    screen.wait_until(lambda: served.now.state is State.HOLDING, "the arm stands again")
    assert 90.5 < served.commanded_deg[1] < 110
    assert [served.commanded_deg[i] for i in (0, 2, 3, 4)] == [HOME[i] for i in (0, 2, 3, 4)]
    screen.type_into("Gripper %", "30")
    screen.click("Set gripper")
    screen.wait_for_text(re.compile("Commanded: 30 %"))
    screen.screenshot("manual-jog")
    assert served.now.gripper == pytest.approx(0.3)


def test_a_held_jog_that_is_refused_says_so_once(screen: Screen, served: ServedArm) -> None:
    served.arm.release()
    opened(screen, served, "Jog & gripper")
    screen.hold("Jog −", 700)
    screen.wait_for_notification("a jog needs the arm holding, it is off")
    assert len(screen.notifications()) == 1
    assert sum("refused" in event.text for event in served.now.events) == 1


def test_record_reorder_undo_and_run_once(screen: Screen, served: ServedArm) -> None:
    opened(screen, served, "Serial motion")
    screen.click("Record pose")
    screen.wait_until(lambda: len(served.steps) == 1, "a pose is recorded")
    served.arm.go_joints([20, 90, -80, -40, 0])
    screen.click("Record pose")
    screen.click("Add wait")
    screen.wait_until(lambda: len(served.steps) == 3, "three steps are recorded")
    first, second = MoveStep(joints_deg=tuple(HOME)), MoveStep(joints_deg=(20.0, *HOME[1:]))
    assert served.steps == (first, second, WaitStep(seconds=1.0))

    screen.click("Delete")
    screen.wait_until(lambda: len(served.steps) == 2, "the wait is deleted")
    screen.click("Up")
    screen.wait_until(lambda: served.steps == (second, first), "the second pose comes first")
    screen.click("Undo")
    screen.wait_until(lambda: served.steps == (first, second), "the order is as before")
    screen.screenshot("manual-serial")

    served.arm.go_joints(HOME)
    screen.click("Run once")
    wait_for_deg(screen, served, [20.0, *HOME[1:]])
    assert any("program 'untitled' finished" in event.text for event in served.now.events)


def test_new_steps_go_before_the_selected_row_or_in_its_place(screen: Screen, served: ServedArm) -> None:
    served.put(tuple(HOME), (10.0, *HOME[1:]))
    opened(screen, served, "Serial motion")
    screen.type_into("Selected row", "2")
    screen.choose("New steps go", "before the selected row")
    screen.type_into("Wait s", "2.5")
    screen.click("Add wait")
    screen.wait_until(lambda: len(served.steps) == 3, "the wait is inserted")
    assert served.steps[1] == WaitStep(seconds=2.5)
    screen.choose("New steps go", "in place of the selected row")
    served.arm.gripper(40)
    screen.click("Record gripper")
    screen.wait_until(lambda: served.steps[2] == GripperStep(open_percent=40), "the last step is replaced")
    screen.type_into("Selected row", "9")
    screen.wait_for_notification("there is no row 9; the program has 3")


def test_a_loop_runs_until_stop_and_its_step_is_marked(screen: Screen, served: ServedArm) -> None:
    served.put(tuple(HOME), (5.0, *HOME[1:]))
    opened(screen, served, "Serial motion")
    screen.click("Loop")
    screen.wait_for_text(re.compile(r"runs step \d of 2, pass [2-9] of ∞"))
    screen.wait_for_text(re.compile(r"▶ [12]"))
    screen.click("Pause", within=screen.row("While it runs"))
    screen.wait_until(lambda: served.now.state is State.PAUSED, "the program pauses")
    screen.click("Resume", within=screen.row("While it runs"))
    screen.wait_until(lambda: served.now.state is State.MOVING, "the program goes on")
    screen.click("STOP")
    screen.wait_until(lambda: served.now.state is State.HOLDING, "the arm has stopped")
    screen.wait_for_text("test · 2 steps")
    assert served.now.program is None


def test_n_times_from_the_selected_step(screen: Screen, served: ServedArm) -> None:
    served.put((15.0, *HOME[1:]), (5.0, *HOME[1:]), (8.0, *HOME[1:]))
    opened(screen, served, "Serial motion")
    screen.type_into("Selected row", "3")
    screen.type_into("Times N", "2")
    screen.tick("From selected step")
    screen.click("Run N times")
    seen: set[tuple[int, int]] = set()

    def over() -> bool:
        progress = served.now.program
        if progress is not None:
            seen.add((progress.loop, progress.step))
        return served.now.state is State.HOLDING and bool(seen)

    screen.wait_until(over, "two passes")
    assert (0, 0) not in seen
    assert {(0, 2), (1, 0), (1, 2)} <= seen
    assert served.commanded_deg == [8.0, *HOME[1:]]


def test_a_broken_upload_names_step_and_key_and_changes_nothing(
    screen: Screen, served: ServedArm, tmp_path: Path
) -> None:
    served.put(tuple(HOME))
    before = served.steps
    file = tmp_path / "broken.toml"
    file.write_text(BROKEN)
    opened(screen, served, "Serial motion")
    unfold(screen, "Files", "Upload")
    screen.upload("Upload", file)
    screen.wait_for_notification(re.compile(r"broken\.toml: line 9, step 2: unknown key 'joint_deg'"))
    assert served.steps == before
    file.write_text(BROKEN.replace("joint_deg", "joints_deg"))
    screen.upload("Upload", file)
    screen.wait_until(lambda: len(served.steps) == 2, "the mended file is on the list")
    screen.wait_until(lambda: screen.value("Name") == "broken", "its name is shown")
    file = tmp_path / "far.csv"
    file.write_text("x_mm,y_mm,z_mm\n220,0,100\n999,0,100\n")
    screen.upload("Upload", file)
    screen.wait_for_notification(re.compile(r"far\.csv: step 2: too far by 671\.0 mm"))
    screen.wait_for_text("Pre-flight: refused, 1 error")


def test_save_load_and_downloads(screen: Screen, served: ServedArm) -> None:
    served.put(tuple(HOME))
    opened(screen, served, "Serial motion")
    unfold(screen, "Files", "Upload")
    screen.type_into("Name", "pick one")
    screen.click("Save")
    screen.wait_until(lambda: served.edited.saved() == ["pick one"], "the file is there")
    assert load_program(served.edited.folder / "pick one.toml").steps == served.steps
    screen.click("Delete")
    screen.wait_until(lambda: served.steps == (), "the list is empty")
    assert screen.value("Saved programs") == "pick one"
    screen.click("Load")
    screen.wait_until(lambda: len(served.steps) == 1, "the program is loaded")
    screen.type_into("Name", "../elsewhere")
    screen.click("Save")
    screen.wait_for_notification("is no program name")
    screen.screenshot("manual-files")
    with screen.page.expect_download() as download:
        screen.click("CSV")
    assert Path(download.value.path()).read_text().startswith("step,do,base_deg,")


def test_a_long_list_is_paged(screen: Screen, served: ServedArm) -> None:
    served.put(*((0.1 * k, *HOME[1:]) for k in range(40)))
    opened(screen, served, "Serial motion")
    screen.wait_for_text("page 1 of 3")
    screen.click("Next ▶")
    screen.wait_for_text("page 2 of 3")
    screen.screenshot("manual-long")
    screen.type_into("Selected row", "40")
    screen.wait_for_text("page 3 of 3")


def test_a_page_that_watches_can_neither_edit_nor_run(screens: Screens, served: ServedArm) -> None:
    served.put(tuple(HOME))
    first, second = screens(), screens()
    opened(first, served, "Serial motion")
    opened(second, served, "Serial motion")
    second.click("Delete")
    second.wait_for_notification("this page is watching")
    assert len(served.steps) == 1


def downloaded(screen: Screen, button: str) -> Path:
    with screen.page.expect_download() as download:
        screen.click(button)
    path = Path(download.value.path())
    return path.rename(path.with_name(download.value.suggested_filename))


def test_every_kind_of_step_is_recorded_edited_taken_back_exported_and_read_again(
    screen: Screen, served: ServedArm
) -> None:
    opened(screen, served, "Serial motion")
    screen.click("Record pose")
    screen.click("Point")
    served.arm.go_joints([10, 90, -80, -40, 0])
    screen.click("Line")
    screen.click("Arc")
    screen.wait_for_notification("an arc needs a point on its way")
    screen.click("Set via")
    screen.wait_for_text(re.compile(r"Arc via \(.*\) mm"))
    served.arm.go_joints([20, 90, -80, -40, 0])
    screen.click("Arc")
    screen.wait_until(lambda: len(served.steps) == 4, "pose, point, line and arc are on the list")
    assert [type(step) for step in served.steps] == [MoveStep, PointStep, LineStep, ArcStep]

    unfold(screen, "Speed, comment, repeat", "Add repeat")
    screen.click("Add speed")
    screen.type_into("Comment", "=SUM(A1)")
    screen.click("Add comment")
    screen.type_into("Rows to repeat", "2-3")
    screen.click("Add repeat")
    screen.wait_until(lambda: len(served.steps) == 8, "the block is there")
    kinds = [MoveStep, RepeatStep, PointStep, LineStep, EndStep, ArcStep, SpeedStep, CommentStep]
    assert [type(step) for step in served.steps] == kinds
    screen.screenshot("manual-every-kind")

    screen.type_into("Selected row", "4")
    unfold(screen, "Selected step", "Apply to step")
    screen.type_into("Tool speed mm/s", "25")
    screen.type_into("Blend mm", "-1")
    screen.click("Apply to step")
    screen.wait_for_notification("Blend mm: must be 0")
    screen.type_into("Blend mm", "5")
    screen.screenshot("manual-step-form")
    line = served.steps[3]
    screen.click("Apply to step")
    screen.wait_until(lambda: served.steps[3] != line, "the line is edited")
    edited = served.steps
    assert isinstance(edited[3], LineStep)
    assert (edited[3].speed_mm_s, edited[3].blend_mm) == (25, 5)
    screen.click("Undo")
    screen.wait_until(lambda: served.steps[3] == line, "the line is as it was")
    screen.click("Redo")
    screen.wait_until(lambda: served.steps == edited, "the line is edited again")

    unfold(screen, "Files", "Upload")
    for button in ("Download", "CSV"):
        file = downloaded(screen, button)
        screen.click("Delete")
        screen.wait_until(lambda: served.steps != edited, "a step is deleted")
        screen.upload("Upload", file)
        screen.wait_until(lambda: served.steps == edited, f"{file.name} gives the same steps")
    assert "import armctl" in downloaded(screen, "Python").read_text()
    points = downloaded(screen, "CSV X-Y-Z")
    assert points.read_text().startswith("step,do,x_mm,y_mm,z_mm,")
    assert "'=SUM(A1)" in points.read_text()
    screen.screenshot("manual-files-unfolded")
    assert screen.errors == []


def test_a_file_that_is_too_large_is_refused_in_words_and_the_page_goes_on(
    screen: Screen, served: ServedArm, tmp_path: Path
) -> None:
    opened(screen, served, "Serial motion")
    unfold(screen, "Files", "Upload")
    film, wait = tmp_path / "film.toml", tmp_path / "wait.toml"
    with film.open("wb") as file:
        file.truncate(30 << 20)
    screen.upload("Upload", film)
    screen.wait_for_notification(
        "film.toml was not taken: it has 30.0 MiB, the largest that is taken has 8 MiB"
    )
    screen.wait_until(lambda: screen.is_enabled("Upload"), "another file can be sent")
    save_program(Program(robot="uzuner", steps=(WaitStep(seconds=1),)), wait)
    screen.upload("Upload", wait)
    screen.wait_until(lambda: served.steps == (WaitStep(seconds=1),), "its steps are on the list")


def test_the_check_names_the_step_and_a_run_is_refused_by_it(screen: Screen, served: ServedArm) -> None:
    served.put(tuple(HOME), (0.0, 90.0, -95.0, -40.0, 0.0))
    opened(screen, served, "Serial motion")
    screen.click("Check")
    screen.wait_for_text(re.compile("Pre-flight: refused"))
    screen.screenshot("manual-verdict")
    screen.click("Run once")
    screen.wait_for_notification(re.compile(r"test: step 2: .*-95\.00°"))
    assert served.now.program is None
    screen.type_into("Selected row", "2")
    screen.click("Delete")
    screen.wait_until(lambda: len(served.steps) == 1, "the step is deleted")
    screen.click("Check")
    screen.wait_for_text(re.compile("Pre-flight: (clear|may be run)"))


def test_single_steps_go_through_a_repeat_as_a_whole_run_does(screen: Screen, served: ServedArm) -> None:
    served.put((5.0, *HOME[1:]), (10.0, *HOME[1:]), (15.0, *HOME[1:]))
    opened(screen, served, "Serial motion")
    unfold(screen, "Speed, comment, repeat", "Add repeat")
    screen.type_into("Rows to repeat", "1-2")
    screen.click("Add repeat")
    screen.wait_until(lambda: len(served.steps) == 5, "the block is there")
    for base in (5.0, 10.0, 5.0, 10.0, 15.0):
        screen.click("Step")
        wait_for_deg(screen, served, [base, *HOME[1:]])
    screen.wait_for_notification("The program is over after this step")


def test_a_program_is_edited_while_it_loops(screen: Screen, served: ServedArm) -> None:
    served.put((5.0, *HOME[1:]), (10.0, *HOME[1:]))
    opened(screen, served, "Serial motion")
    screen.click("Loop")
    screen.wait_for_text(re.compile(r"runs step \d of 2"))
    screen.type_into("Selected row", "2")
    unfold(screen, "Selected step", "Apply to step")
    screen.click("Pause", within=screen.row("While it runs"))
    screen.wait_until(lambda: served.now.state is State.PAUSED, "the program pauses")
    screen.type_into("Angles °", "20, 90, -80, -40, 0")
    screen.click("Apply to step")
    screen.wait_for_text("the edit takes effect at the next pass")
    screen.screenshot("manual-edit-waits")
    assert served.commanded_deg[0] <= 10
    screen.click("Resume", within=screen.row("While it runs"))
    screen.wait_until(lambda: served.commanded_deg[0] > 15, "the edit has taken effect")
    screen.wait_for_text(re.compile(r"runs step \d of 2"))
    screen.wait_for_text(re.compile(r"▶ [12]"))
    assert screen.notifications() == []
    screen.type_into("Angles °", "0, -3, -60, -20, 0")
    screen.click("Apply to step")
    screen.wait_for_notification(re.compile(r"The next pass would stop there.*below the floor", re.DOTALL))
