"""The frames of the program on a page: taught by three presses, renamed, deleted, jogged along, drawn."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from tests.robot.test_tools import arm_with_tools
from tests.ui.page_kit import FakePage

from armctl.errors import InputError, ProgramError
from armctl.facts import State
from armctl.kinematics import rotation_from_rpy
from armctl.program import FrameStep, PointStep, Program, Step, UserFrame
from armctl.program.edit import PLACES, add
from armctl.protocol import JogTool
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.manual.frames import ADD, DELETE, NEW, RENAME, FrameForm
from armctl.ui.tabs.manual.jog import ToolJog
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.tabs.manual.step_form import KnownNames, StepEdit

ROBOT = load_robot("uzuner")
TOUCHES = {"Origin": (180, -60, 60), "On +x": (180, 60, 60), "On the +y side": (120, 0, 60)}
"""by button, where the tool is [mm]: x along y of the base"""
TAUGHT = UserFrame(x_mm=180, y_mm=-60, z_mm=60, rz_deg=90)


class FramesPage(FakePage):
    def __init__(self, server: GuardedServer, folder: Path) -> None:
        super().__init__(server, ROBOT, ROBOT.pose("home"))
        self.shared = SharedProgram("uzuner", folder)
        self.console.shared = lambda kind: self.shared
        self.snapshot.program = None
        self.said: list[str] = []
        self.name = self.me
        self.jog = ToolJog(self.session)
        self.form = FrameForm(self.session)
        for (
            container
        ) in self.gui._container_handle_from_uuid.values():  # fields that do nothing by themselves
            for one in container._children.values():
                if (label := getattr(one, "label", None)) in ("Frame name", "Along the"):
                    self._handles[label], self._actions[label] = one, lambda: None

    def require_operator(self) -> None:
        pass

    def notify(self, title: str, text: str = "", *_: object) -> None:
        self.said.append(f"{title}: {text}")

    def touch(self, label: str) -> None:
        x, y, z = TOUCHES[label]
        q = ROBOT.inverse(np.array([x, y, z]) / 1000).best()
        self.snapshot.q = self.snapshot.q_command = q
        self.press("Touch here", label)

    @property
    def frames(self) -> dict[str, UserFrame]:
        return self.shared.program.frames

    def begin(self, *steps: Step, **frames: UserFrame) -> None:
        self.shared.edit(Program(robot="uzuner", name="test", steps=steps, frames=frames))
        self.draw()

    def draw(self) -> None:
        self.jog.refresh()
        self.form.refresh()


@pytest.fixture
def page(server: GuardedServer, tmp_path: Path) -> Iterator[FramesPage]:
    made = FramesPage(server, tmp_path)
    yield made
    made.begin()  # its axes are gone from the scene that the next one shares


def test_three_presses_teach_a_frame_and_undo_takes_it_back(page: FramesPage) -> None:
    page.begin(PointStep(x_mm=200, y_mm=0, z_mm=100))
    page.put("Frame name", "table")
    for label in TOUCHES:
        assert page.frames == {}
        page.touch(label)
    frame = page.frames["table"]
    for key in ("x_mm", "y_mm", "z_mm", "rx_deg", "ry_deg", "rz_deg"):
        assert getattr(frame, key) == pytest.approx(getattr(TAUGHT, key), abs=0.05)
    assert page.reads("Frame") == "table" and page.options("Frame") == (NEW, "base", "table")
    assert page.said and page.said[0].startswith("Frame taught: table: (180.01, −60")
    assert "may be turned by 0.58, 0.34, 0.34° about its x, y and z" in page.html
    assert "180.0, −60.0, 60.0" in page.html
    page.shared.undo()
    page.draw()
    assert page.frames == {} and page.reads("Frame") == NEW


def test_taught_anew_it_takes_its_program_along(page: FramesPage) -> None:
    steps = (FrameStep(frame="table"), PointStep(x_mm=10, y_mm=0, z_mm=40))
    page.begin(*steps, table=UserFrame(x_mm=0, y_mm=0, z_mm=0))
    before = page.shared.version
    page.put("Frame", "table")
    for label in TOUCHES:
        page.touch(label)
    assert page.frames["table"].rz_deg == pytest.approx(90, abs=0.05)
    assert page.shared.program.steps == steps and page.shared.version > before


def test_a_press_that_gives_no_frame_is_refused_and_forgotten(page: FramesPage) -> None:
    page.touch("Origin")
    page.touch("On +x")
    page.snapshot.q_command = page.snapshot.q  # the tool has not moved
    with pytest.raises(InputError, match=r"on \+x and the point on the \+y side are 0\.0 mm"):
        page.press("Touch here", "On the +y side")
    assert page.frames == {} and "Still to touch: On the +y side" in page.html
    page.touch("On the +y side")
    assert list(page.frames) == ["frame 1"]


def test_nothing_is_touched_while_the_arm_moves_nor_for_the_base(page: FramesPage) -> None:
    page.snapshot.state = State.MOVING
    with pytest.raises(Exception, match="the arm is moving; touch when it stands"):
        page.touch("Origin")
    page.snapshot.state = State.HOLDING
    page.put("Frame", "base")
    page.touch("Origin")
    page.touch("On +x")
    with pytest.raises(InputError, match="base is the frame of the arm"):
        page.touch("On the +y side")


def test_a_touch_is_that_of_the_tool_that_a_paused_program_has_put_on(
    server: GuardedServer, tmp_path: Path
) -> None:
    page = FramesPage(server, tmp_path)
    page.console.robot = arm_with_tools(tmp_path)  # the page follows once the program is over
    page.snapshot.tool, page.snapshot.state = "pen", State.PAUSED
    page.touch("Origin")
    pen = page.console.robot.with_tool("pen")
    x, y, z = (1000 * pen.forward(page.snapshot.q)[:3, 3]).tolist()
    assert f"Origin ({x:.1f}, {y:.1f}, {z:.1f})".replace("-", "−") in page.html.replace("-", "−")


def test_it_is_renamed_chosen_by_a_step_and_deleted(page: FramesPage) -> None:
    page.begin(PointStep(x_mm=200, y_mm=0, z_mm=100), table=TAUGHT)
    page.put("Frame", "table")
    page.press("Chosen frame", ADD)
    assert page.shared.program.steps[-1] == FrameStep(frame="table")
    page.put("Frame name", "left table")
    page.press("Chosen frame", RENAME)
    assert page.frames == {"left table": TAUGHT} and page.reads("Frame") == "left table"
    with pytest.raises(ProgramError, match="step 2 chooses the frame 'left table'"):
        page.press("Chosen frame", DELETE)
    page.shared.edit(Program(robot="uzuner", frames=page.frames))
    page.press("Chosen frame", DELETE)
    assert page.frames == {} and page.reads("Frame") == NEW
    with pytest.raises(InputError, match="choose the frame above that you want to delete"):
        page.press("Chosen frame", DELETE)


def test_what_is_recorded_below_the_step_is_given_in_its_frame(page: FramesPage) -> None:
    page.begin(FrameStep(frame="table"), table=TAUGHT)
    changed, _ = add(page.shared.program, PointStep(x_mm=170, y_mm=-50, z_mm=90), PLACES[0], 0)
    assert changed.steps[-1] == PointStep(x_mm=10, y_mm=10, z_mm=30)


def test_the_tool_is_jogged_along_a_frame(page: FramesPage) -> None:
    turned = UserFrame(x_mm=0, y_mm=0, z_mm=0, rx_deg=20, ry_deg=-10, rz_deg=70)
    page.begin(table=turned)
    assert page.options("Along the") == ("base axes", "tool axes", "axes of table")
    page.put("Along the", "axes of table")
    R = rotation_from_rpy(*np.radians((20, -10, 70)))
    for axis, column in zip("XYZ", R.T, strict=True):
        sent = page.jog.command(axis, -1.0)
        assert isinstance(sent, JogTool) and sent.frame == "base"
        np.testing.assert_allclose(sent.linear, -0.03 * column, atol=1e-12)
    turning = page.jog.command("Ry", 1.0)
    assert turning.angular is not None
    np.testing.assert_allclose(turning.angular / np.linalg.norm(turning.angular), R[:, 1], atol=1e-12)
    assert page.jog.command("X", 1.0, "tool").frame == "tool"  # a key
    page.begin()
    assert page.reads("Along the") == "base axes"


def test_its_axes_stand_in_the_scene_where_it_is(page: FramesPage) -> None:
    page.begin(table=TAUGHT)
    (axes, label) = cast(Any, page.form)._nodes
    np.testing.assert_allclose(axes.position, (0.18, -0.06, 0.06))
    assert label.text == "table"


def test_the_row_of_a_step_offers_the_frames_of_its_program() -> None:
    html = StepEdit("1").html(FrameStep(frame="gone"), ROBOT, KnownNames(frames=("table", "<b>")))
    for name in ("base", "table", "&lt;b&gt;"):
        assert f"<option value='{name}'>{name}</option>" in html
    assert "<option value='gone' selected>gone</option>" in html
