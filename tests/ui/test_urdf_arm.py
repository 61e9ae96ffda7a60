"""A URDF arm brought in through the page, and the side file that the page writes."""

from __future__ import annotations

import asyncio
import io
import os
import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import viser
from tests.robot.urdf_kit import Step, written
from tests.ui.page_kit import FakePage

from armctl import load_robot
from armctl.errors import InputError, RobotFileError, StateError, UnclearArmError
from armctl.motion.clearance import clear_pose
from armctl.robot.urdf import install_package
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.main import urdf_arm
from armctl.ui.tabs.main.urdf_arm import UrdfArm, _installed, _Present, _saved

LYING = (
    Step("pan", "revolute", "base", "body", "0 0 0.1"),
    Step("lift", "revolute", "body", "upper", "0 0 0.05", axis="0 1 0"),
    Step("elbow", "revolute", "upper", "lower", "0.3 0 0", axis="0 1 0"),
    Step("end", "fixed", "lower", "tool0", "0.1 0 -0.4"),
)
"""at zero its tool is below the floor"""


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    return written(tmp_path / "arm.urdf", LYING)


def test_tool_rest_pose_and_floor_are_kept_beside_the_file(arm: Path, tmp_path: Path) -> None:
    present = _Present.of(f"{arm}#tool0")
    assert (present.name, present.links) == (str(arm), ("base", "body", "upper", "lower", "tool0"))
    assert present.source.side_path is None
    q = clear_pose(load_robot(arm))
    assert q is not None and np.abs(q).sum() > 0
    rest = np.degrees(q).round(4).tolist()
    changes = {"tool": {"link": "lower", "approach": "x"}, "poses": {"rest": rest}, "floor": {"z_mm": -5.0}}
    side = _saved(present, changes, tmp_path / "robots")
    assert side == tmp_path / "arm.armctl.toml"
    robot = load_robot(arm)
    assert robot.pose("rest") == pytest.approx(q, abs=1e-6) and robot.floor_z == -0.005
    assert robot.source.endswith("to lower, whose x axis is taken for the tool's z")
    assert _Present.of(str(arm)).side.tool.link == "lower"
    # what cannot be opened is not kept
    before = side.read_bytes()
    with pytest.raises(RobotFileError, match="no link 'none'"):
        _saved(_Present.of(str(arm)), {"tool": {"link": "none"}}, tmp_path / "robots")
    assert side.read_bytes() == before
    side.unlink()
    with pytest.raises(RobotFileError, match="3 angles are needed"):
        _saved(present, {"poses": {"rest": [1]}}, tmp_path / "robots")
    assert not side.exists()


def test_beside_a_file_in_a_folder_of_somebody_else_it_goes_into_the_users_folder(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(urdf_arm.os, "access", lambda folder, mode: os.path.basename(folder) == "robots")
    side = _saved(_Present.of(str(arm)), {"floor": {"z_mm": -600}}, tmp_path / "robots")
    assert side == tmp_path / "robots/arm.armctl.toml"
    assert load_robot(side).floor_z == -0.6 and load_robot(arm).floor_z == 0
    again = _Present.of(str(side))
    assert again.source.side_path == side
    assert _saved(again, {"floor": {"z_mm": -700}}, tmp_path / "robots") == side


def test_another_arms_side_file_of_the_same_name_is_left_alone(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(urdf_arm.os, "access", lambda folder, mode: os.path.basename(folder) == "robots")
    (tmp_path / "other").mkdir()
    other = written(tmp_path / "other/arm.urdf", LYING)
    robots = tmp_path / "robots"
    sides = [_saved(_Present.of(str(one)), {"floor": {"z_mm": -600}}, robots) for one in (arm, other, other)]
    assert [side.name for side in sides] == ["arm.armctl.toml", "arm_2.armctl.toml", "arm_2.armctl.toml"]
    assert [_Present.of(str(side)).source.file for side in sides[:2]] == [arm, other]


def test_nothing_is_written_while_the_arm_cannot_be_opened_anew(arm: Path, tmp_path: Path) -> None:
    def refuse() -> None:
        raise StateError("it stands")

    robots = SimpleNamespace(
        require_reopenable=refuse, present=SimpleNamespace(name=str(tmp_path / "robots/a"))
    )
    session = SimpleNamespace(
        require_operator=lambda: None, robots=robots, console=SimpleNamespace(files=tmp_path)
    )
    place = install_package("a.urdf", arm.read_bytes(), tmp_path / "robots")
    before = sorted(tmp_path.rglob("*"))
    page = SimpleNamespace(
        _session=session,
        _present=_Present.of(str(place)),
        _upload=SimpleNamespace(value=SimpleNamespace(name="a.stl", content=b"x")),
    )
    for click in (UrdfArm._on_save, UrdfArm._on_upload):
        with pytest.raises(StateError, match="it stands"):
            asyncio.run(click(page))  # type: ignore[arg-type]
    assert sorted(tmp_path.rglob("*")) == before


FORKED = (
    *LYING[:-1],
    Step("back", "fixed", "lower", "back_tcp", "0 0 0.1"),
    Step("front", "fixed", "lower", "front_tcp", "0.1 0 -0.4"),
)
"""two links that have a tool's name"""


def zipped(files: dict[str, bytes]) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as packed:
        for name, part in files.items():
            packed.writestr(name, part)
    return content.getvalue()


def test_the_choices_for_what_a_file_leaves_open_are_kept(arm: Path, tmp_path: Path) -> None:
    forked = written(tmp_path / "forked.urdf", FORKED).read_bytes()
    packed = zipped({"pack/a.urdf": arm.read_bytes(), "pack/b/forked.urdf": forked})
    robots = tmp_path / "robots"
    with pytest.raises(UnclearArmError) as unclear:
        _installed("arms.zip", packed, robots, {})
    assert unclear.value.arms == ["pack/a.urdf", "pack/b/forked.urdf"]
    chosen = {"arm": unclear.value.arms[1]}
    with pytest.raises(UnclearArmError) as unclear:
        _installed("arms.zip", packed, robots, chosen)
    assert (unclear.value.arms, unclear.value.links) == ((), ["back_tcp", "front_tcp"])
    assert list(robots.iterdir()) == []
    choice = _installed("arms.zip", packed, robots, {**chosen, "link": "front_tcp"})
    assert choice.name == str(robots / "arms")
    assert load_robot(choice.name).source.endswith("to front_tcp")


def test_of_several_side_files_the_chosen_one_stays(arm: Path, tmp_path: Path) -> None:
    sides = {
        f"{name}.armctl.toml": f'urdf = "a.urdf"\nfloor = {{ z_mm = {mm} }}'
        for name, mm in (("x", -7), ("y", -9))
    }
    files = {name: f"format = 1\n{text}".encode() for name, text in sides.items()}
    packed = zipped({"a.urdf": arm.read_bytes(), **files})
    with pytest.raises(UnclearArmError) as unclear:
        _installed("arms.zip", packed, tmp_path / "robots", {})
    assert unclear.value.arms == list(files)
    choice = _installed("arms.zip", packed, tmp_path / "robots", {"arm": "y.armctl.toml"})
    assert load_robot(choice.name).floor_z == -0.009


def test_an_arm_that_cannot_be_opened_is_not_kept(arm: Path, tmp_path: Path) -> None:
    robots = tmp_path / "robots"
    choice = _installed("my arm.urdf", arm.read_bytes(), robots, {})
    assert (choice.name, choice.title) == (str(robots / "my_arm"), "arm")
    assert load_robot(choice.name).n == 3
    with pytest.raises(RobotFileError, match=r"is not XML") as refused:
        _installed("other.urdf", b"no", robots, {})
    assert str(tmp_path) not in str(refused.value)
    for side, told in (
        ("no", "a.armctl.toml: expected '='"),
        ('format = 1\nurdf = "../b.urdf"', 'a.armctl.toml: urdf = "../b.urdf" leads out of the folder'),
        ('format = 1\nurdf = "b.urdf"', "arms.zip: cannot be read: "),
    ):
        with pytest.raises(RobotFileError) as refused:
            _installed("arms.zip", zipped({"a.armctl.toml": side.encode()}), robots, {})
        assert str(tmp_path) not in str(refused.value) and told in str(refused.value)
    assert [one.name for one in robots.iterdir()] == ["my_arm"]
    with pytest.raises(InputError, match="is no URDF arm"):
        _Present.of("uzuner")


XACRO = b"""<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="tall" default="0.3"/>
<link name="base"/><link name="upper"/><link name="tool0"/>
<joint name="pan" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 $(arg tall)"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="lift" type="revolute"><parent link="upper"/><child link="tool0"/><origin xyz="$(arg long) 0 0"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


class ArmPage(FakePage):
    """With a list of robots, of which ``name`` is open."""

    def __init__(self, server: GuardedServer, name: Path, files: Path) -> None:
        robot = load_robot(name)
        super().__init__(server, robot, robot.pose("home"))
        self.console.files = files
        self.robots = SimpleNamespace(
            present=SimpleNamespace(name=str(name)),
            require_reopenable=lambda: None,
            offer=lambda choice: None,
        )
        self.opened: list[str] = []
        self.notify = lambda *words: None

    def require_operator(self) -> None:
        """Nobody else is there."""

    async def change_robot(self, name: str) -> None:
        self.opened.append(name)

    async def reopen_arm(self) -> None:
        self.opened.append(self.robots.present.name)

    def fields(self) -> dict[str, viser.GuiInputHandle[str]]:
        """Those into which text is typed, by label."""
        boxes = self.gui._container_handle_from_uuid.values()
        every = (one for box in boxes for one in box._children.values())
        return {one.label: one for one in every if isinstance(one, viser.GuiTextHandle)}

    def upload(self, name: str, content: bytes) -> None:
        self._handles["Upload an arm"]._impl.value = viser.UploadedFile(name, content)
        self.press("Upload an arm")


def test_arguments_of_an_uploaded_xacro_file_are_asked_for_and_changed_later(
    arm: Path, tmp_path: Path, server: GuardedServer
) -> None:
    page = ArmPage(server, arm, tmp_path / "files")
    UrdfArm(page.session)
    page.upload("a.urdf.xacro", XACRO)
    assert page.opened == [] and "tall" not in page.fields()  # what has a default is not asked for
    page.fields()["long"].value = "0.25"
    page.press("Open the arm")
    (place,) = page.opened
    home = np.zeros(2)
    assert load_robot(place).forward(home)[[0, 2], 3] == pytest.approx([0.25, 0.3])
    # and then, in the page of that arm: both the one that is declared and the one that is only used
    page = ArmPage(server, Path(place), tmp_path / "files")
    UrdfArm(page.session)
    page.press("Tool, rest pose and floor")
    fields = page.fields()
    assert (fields["tall"].value, fields["long"].value) == ("0.3", "0.25")
    fields["tall"].value, fields["long"].value = "0.5", "0.4"
    page.press("Save and open anew")
    assert page.opened == [place]
    assert load_robot(place).forward(home)[[0, 2], 3] == pytest.approx([0.4, 0.5])
    page.press("Tool, rest pose and floor")
    page.fields()["tall"].value = "0.3"  # its default again: the side file does not keep it
    page.press("Save and open anew")
    (side,) = Path(place).rglob("*.armctl.toml")
    assert "long" in side.read_text() and "tall" not in side.read_text()
