"""Arms as people have them: folders, zip files, packages, xacro, and the side file beside them."""

from __future__ import annotations

import io
import os
import threading
import zipfile
from pathlib import Path

import numpy as np
import pytest
from tests.robot.urdf_kit import Step, written

from armctl import load_robot
from armctl.apart import GIVEN_UP
from armctl.errors import LimitError, RobotFileError, UnclearArmError
from armctl.robot.urdf import (
    UrdfSource,
    add_to_package,
    changed_side_file,
    encode_side_file,
    install_package,
)
from armctl.robot.urdf import unpacking as packages

STEPS = (
    Step("pan", "continuous", "base", "body", "0 0 0.1"),
    Step("lift", "revolute", "body", "upper", "0.02 0 0.05", axis="0 1 0"),
    Step("elbow", "revolute", "upper", "lower", "0 0 0.2", axis="0 1 0"),
    Step("end", "fixed", "lower", "tool0", "0 0 0.15"),
)
CORNERS = "vertex 0 0 0\nvertex .1 0 0\nvertex 0 .1 .1"
MESH = f"solid a\nfacet normal 0 0 1\nouter loop\n{CORNERS}\nendloop\nendfacet\nendsolid a\n"


@pytest.fixture(autouse=True)
def _own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("XDG_CACHE_HOME", "XDG_DATA_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))


def arm_text(tmp_path: Path, mesh: str = "") -> str:
    text = written(tmp_path / "scratch.urdf", STEPS).read_text()
    (tmp_path / "scratch.urdf").unlink()
    visual = f'<link name="upper"><visual><geometry><mesh filename="{mesh}"/></geometry></visual></link>'
    return text.replace('<link name="upper"/>', visual) if mesh else text


def zipped(files: dict[str, str | bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in files.items():
            packed.writestr(name, content)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("uri", "place"),
    [
        ("package://my_arm/meshes/upper.stl", "my_arm/meshes/upper.stl"),
        ("package://named_inside/meshes/upper.stl", "my_arm/meshes/upper.stl"),  # its package.xml says so
        ("package://other/upper.stl", "other/upper.stl"),
        ("package://renamed/meshes/upper.stl", "my_arm/meshes/upper.stl"),
        ("model://my_arm/meshes/upper.stl", "my_arm/meshes/upper.stl"),
        ("package://my_arm_description/meshes/upper.stl", "my_arm/meshes/upper.stl"),
        ("../meshes/upper.stl", "my_arm/meshes/upper.stl"),
        ("file://../meshes/upper.stl", "my_arm/meshes/upper.stl"),
        ("meshes/a%20b.stl", "my_arm/urdf/meshes/a b.stl"),
        ("package://far/upper.stl", "elsewhere/far/upper.stl"),  # by ROS_PACKAGE_PATH
        ("package://share/upper.stl", "ros/share/share/upper.stl"),  # by AMENT_PREFIX_PATH
    ],
)
def test_where_a_mesh_is(tmp_path: Path, uri: str, place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = tmp_path / place
    mesh.parent.mkdir(parents=True)
    mesh.write_text(MESH)
    (tmp_path / "my_arm/urdf").mkdir(parents=True, exist_ok=True)
    (tmp_path / "my_arm/package.xml").write_text("<package><name>named_inside</name></package>")
    (tmp_path / "other").mkdir(exist_ok=True)
    (tmp_path / "other/package.xml").write_text("no XML")
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{tmp_path / 'elsewhere'}{os.pathsep}")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ros"))
    file = tmp_path / "my_arm/urdf/arm.urdf"
    file.write_text(arm_text(tmp_path, uri))
    found = UrdfSource.at(file).find(uri)
    assert found is not None and found.samefile(mesh)
    (shape,) = load_robot(file).shapes
    assert Path(shape.file).samefile(mesh) and shape.link == 1


def test_an_absolute_path_and_what_is_no_mesh(tmp_path: Path) -> None:
    mesh = tmp_path / "upper.stl"
    mesh.write_text(MESH)
    file = tmp_path / "a/b/arm.urdf"
    file.parent.mkdir(parents=True)
    file.write_text(arm_text(tmp_path))
    source = UrdfSource.at(file)
    assert source.find(str(mesh)) == mesh and source.find(mesh.as_uri()) == mesh
    for uri in ("http://host/upper.stl", "package://none/none.stl", "a\0b.stl", ""):
        assert source.find(uri) is None


def test_a_file_that_another_one_includes_is_a_part_of_an_arm(tmp_path: Path) -> None:
    part = '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:property name="reach" value="0.1"/></robot>'
    include = """<xacro:include\n filename='$(find arm)/urdf/a_part.xacro'/>"""
    (tmp_path / "a_part.xacro").write_text(part)
    (tmp_path / "b_arm.xacro").write_text(part.replace("<xacro:property", f"{include}<xacro:property"))
    assert UrdfSource.at(tmp_path).file == tmp_path / "b_arm.xacro"
    (tmp_path / "c_arm.xacro").write_text(part)
    with pytest.raises(UnclearArmError, match=r"several arms: b_arm\.xacro, c_arm\.xacro; name one"):
        UrdfSource.at(tmp_path)
    others = include.replace("a_part", "b_arm") + include.replace("a_part", "c_part")
    (tmp_path / "a_part.xacro").write_text(others)
    (tmp_path / "c_part.xacro").write_text(include)
    (tmp_path / "c_arm.xacro").unlink()
    with pytest.raises(UnclearArmError, match=r"several arms: a_part\.xacro, b_arm\.xacro, c_part\.xacro"):
        UrdfSource.at(tmp_path)  # each is a part of another one
    (tmp_path / "b_arm.xacro").write_text(f"<!-- {include} --><xacro:include filename='b_arm.xacro'/>")
    (tmp_path / "a_part.xacro").write_text(part)
    (tmp_path / "c_part.xacro").write_text("<xacro:include " * 50_000)  # what is no include takes no time
    with pytest.raises(UnclearArmError, match=r"several arms: a_part\.xacro, b_arm\.xacro, c_part\.xacro"):
        UrdfSource.at(tmp_path)  # a comment includes nothing, and none is a part of itself


@pytest.mark.parametrize(
    ("files", "named", "says"),
    [
        ({"a/arm.urdf": ""}, "", None),
        ({"a/arm.urdf": "", "b/arm.xacro": ""}, "", None),
        ({"a/arm.urdf.xacro": "", "b/macro.xacro": ""}, "", None),
        ({"a/one.urdf": "", "two.urdf": ""}, "", "holds several arms: two.urdf, a/one.urdf; name one"),
        ({"a/one.urdf": "", "two.urdf": ""}, "/a/one.urdf", None),
        ({"meshes/a.stl": ""}, "", "holds no .urdf and no .xacro file"),
    ],
)
@pytest.mark.parametrize("packed", [False, True])
def test_a_folder_or_a_zip_file_with_an_arm(
    tmp_path: Path, files: dict[str, str], named: str, says: str | None, packed: bool
) -> None:
    text = arm_text(tmp_path)
    place = tmp_path / ("arm.zip" if packed else "arm")
    if packed:
        place.write_bytes(zipped({name: text for name in files}))
    else:
        for name in files:
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            (place / name).write_text(text)
    if says is None:
        assert load_robot(f"{place}{named}").joint_names == ("pan", "lift", "elbow")
        assert load_robot(f"{place}{named}#lower,approach=x").source.endswith(
            "to lower, whose x axis is taken for the tool's z"
        )
    else:
        with pytest.raises(RobotFileError, match="holds") as refused:
            load_robot(f"{place}{named}")
        assert says in str(refused.value)


def test_meshes_of_a_zip_file_are_found_wherever_they_are_and_nowhere_else(tmp_path: Path) -> None:
    outside = tmp_path / "outside.stl"
    outside.write_text(MESH)
    for uri, here in (("package://x/y/upper.stl", True), (str(outside), False), ("../../outside.stl", False)):
        (tmp_path / "arm.zip").write_bytes(zipped({"arm.urdf": arm_text(tmp_path, uri), "m/upper.stl": MESH}))
        robot = load_robot(tmp_path / "arm.zip")
        assert len(robot.shapes) == here
        assert any("is not found" in text for text in robot.assumed) is not here


@pytest.mark.parametrize(
    "name", ["../arm.urdf", "/arm.urdf", "a/../../arm.urdf", "..\\arm.urdf", "C:/arm.urdf"]
)
def test_a_zip_file_that_leads_out_of_its_folder_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "arm.zip").write_bytes(zipped({name: arm_text(tmp_path)}))
    with pytest.raises(RobotFileError, match="leads out of the folder"):
        load_robot(tmp_path / "arm.zip")


def test_bombs_and_broken_zip_files_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "arm.zip"
    good = zipped({"arm.urdf": arm_text(tmp_path)})
    for content in (b"", b"PK\x03\x04", good[:-30], good[:60] + bytes(40) + good[100:]):
        path.write_bytes(content)
        with pytest.raises(RobotFileError, match=r"arm\.zip: is no zip file that can be read"):
            load_robot(path)
    monkeypatch.setattr(packages, "_MOST_UNPACKED_BYTES", 1 << 20)
    path.write_bytes(zipped({"arm.urdf": arm_text(tmp_path), "a.stl": bytes(3 << 20)}))
    assert path.stat().st_size < 10_000
    with pytest.raises(RobotFileError, match="holds more than 1 MiB"):
        load_robot(path)
    path.write_bytes(zipped({"arm.urdf": arm_text(tmp_path), "photo.jpg": bytes(3 << 20), ".x/a.stl": MESH}))
    assert load_robot(path).n == 3  # what an arm has no use for is not unpacked
    monkeypatch.setattr(packages, "MOST_FILES", 10)
    path.write_bytes(zipped({f"{k}.stl": MESH for k in range(11)}))
    with pytest.raises(RobotFileError, match="holds 11 files; 10 at most"):
        load_robot(path)


def test_links_of_a_zip_file_are_left_out(tmp_path: Path) -> None:
    link = zipfile.ZipInfo("upper.stl")
    link.external_attr = 0o120777 << 16
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as packed:
        packed.writestr("arm.urdf", arm_text(tmp_path, "upper.stl"))
        packed.writestr(link, "/etc/passwd")
    (tmp_path / "arm.zip").write_bytes(stream.getvalue())
    assert load_robot(tmp_path / "arm.zip").shapes == ()


def test_only_the_newest_zip_files_stay_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packages, "_KEPT", 2)
    for k in range(4):
        path = tmp_path / f"arm{k}.zip"
        path.write_bytes(zipped({"arm.urdf": arm_text(tmp_path), "note.txt": str(k)}))
        assert load_robot(path).n == 3
    assert len(list((tmp_path / "XDG_CACHE_HOME/armctl/urdf").iterdir())) == 2


def test_what_comes_through_a_page_stays_in_a_folder_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robots, text = tmp_path / "XDG_DATA_HOME/armctl/robots", arm_text(tmp_path, "package://a/upper.stl")
    place = install_package("My arm (1).urdf", text.encode(), robots)
    assert place == robots / "My_arm_1"
    assert install_package("My arm (1).urdf", text.encode(), robots).name == "My_arm_1_2"
    assert load_robot("My_arm_1").shapes == ()
    add_to_package(place, "../../upper.stl", MESH.encode())
    (shape,) = load_robot("My_arm_1#lower").shapes
    assert Path(shape.file) == place / "meshes/upper.stl"
    for name, content in (("arm.txt", b""), ("arm.zip", b"none")):
        with pytest.raises(RobotFileError, match=r"arm is a \.urdf|is no zip file"):
            install_package(name, content, robots)
    with pytest.raises(RobotFileError, match="only meshes"):
        add_to_package(place, "arm.urdf", b"")
    with pytest.raises(RobotFileError, match="only meshes"):
        add_to_package(tmp_path, "upper.stl", b"")
    monkeypatch.setattr(packages, "MOST_FILES", 3)
    add_to_package(place, "upper.stl", MESH.encode())  # in place of the one that is there
    with pytest.raises(RobotFileError, match=r"lower\.stl: an arm from a page has 3 files"):
        add_to_package(place, "lower.stl", MESH.encode())
    monkeypatch.setattr(packages, "_MOST_NAMESAKES", 3)
    with pytest.raises(RobotFileError, match="holds 2 arms 'My_arm_1': delete some of them"):
        install_package("My arm (1).urdf", text.encode(), robots)


@pytest.mark.parametrize("way", ["/", "../outside/", "link/"])
def test_a_side_file_from_a_page_names_no_file_elsewhere(tmp_path: Path, way: str) -> None:
    outside, robots = tmp_path / "outside", tmp_path / "XDG_DATA_HOME/armctl/robots"
    outside.mkdir()
    (outside / "arm.urdf").write_text(arm_text(tmp_path))
    named = (
        f"{outside}/arm.urdf" if way == "/" else f"../{way}arm.urdf" if way[0] == "." else f"{way}arm.urdf"
    )
    place = install_package("a.zip", zipped({"a.armctl.toml": f'format = 1\nurdf = "{named}"'}), robots)
    (robots / "outside").symlink_to(outside)
    (place / "link").symlink_to(outside)
    with pytest.raises(RobotFileError, match="leads out of the folder"):
        load_robot(place)


def test_a_side_file_from_a_page_names_one_of_its_own_folder(tmp_path: Path) -> None:
    files = {"a.armctl.toml": 'format = 1\nurdf = "sub/arm.urdf"', "sub/arm.urdf": arm_text(tmp_path)}
    place = install_package("a.zip", zipped(dict(files)), tmp_path / "robots")
    source = UrdfSource.at(place)
    assert source.folder == place and source.side_path == place / "a.armctl.toml"
    assert load_robot(place).n == 3


@pytest.mark.parametrize("named", [".", "a.armctl.toml", "b.armctl.toml", "sub"])
def test_a_side_file_names_no_side_file(tmp_path: Path, named: str) -> None:
    folder = tmp_path / "arms"
    (folder / "sub").mkdir(parents=True)
    (folder / "a.armctl.toml").write_text(f'format = 1\nurdf = "{named}"')
    if named == "sub":
        (folder / "sub/b.armctl.toml").write_text('format = 1\nurdf = ".."')
    with pytest.raises(RobotFileError, match="names a side file"):
        load_robot(folder / "a.armctl.toml")


# The side file.

SIDE: dict[str, object] = {
    "format": 1,
    "name": "mine",
    "title": "Mine",
    "tool": {"link": "lower", "approach": "x", "offset_mm": [0, 0, 150]},
    "joints": [
        {"name": "pan", "limit_deg": [-400, 400], "servo": {"channel": 0, "zero_us": 1500, "us_per_deg": 2,
                                                            "pulse_us": [600, 2400]}},
        {"name": "lift", "title": "Lift", "limit_deg": [-45, 90], "speed_deg_s": 30,
         "servo": {"channel": 1, "zero_us": 1500, "us_per_deg": 10, "pulse_us": [600, 2400]}},
        {"name": "elbow", "limit_deg": [-80, 80], "acceleration_deg_s2": 90, "stall_torque_nm": 2,
         "servo": {"channel": 2, "zero_us": 1500, "us_per_deg": 10, "pulse_us": [600, 2400]}},
    ],
    "gripper": {"title": "Claw", "speed_percent_s": 100,
                "servo": {"channel": 3, "closed_us": 900, "open_us": 2000}},
    "board": {"kind": "firmata"},
    "poses": {"home": [0, 20, 60], "rest": [0, -45, 80], "up": [0, 0, 0]},
    "points": {"A": [200, 0, 100]},
    "floor": {"z_mm": -300},
    "payload_kg": 0.2,
    "obstacles": [{"title": "wall", "from_mm": [500, -500, 0], "to_mm": [600, 500, 500]}],
}  # fmt: skip


def beside(tmp_path: Path, **changes: object) -> Path:
    path = tmp_path / "arm.urdf"
    path.write_text(arm_text(tmp_path))
    (tmp_path / "arm.armctl.toml").write_text(encode_side_file(SIDE | changes))
    return path


def test_the_side_file_says_what_the_urdf_file_leaves_open(tmp_path: Path) -> None:
    path = beside(tmp_path)
    robot = load_robot(path)
    assert (robot.name, robot.title, robot.board) == ("mine", "Mine", "firmata")
    assert load_robot(tmp_path / "arm.armctl.toml") == robot
    assert np.degrees(robot.limits) == pytest.approx(np.array([[-400, 400], [-45, 90], [-80, 80]]))
    assert np.degrees(robot.speed_limits) == pytest.approx([np.degrees(2), 30, np.degrees(2)])
    assert np.degrees(robot.acceleration_limits) == pytest.approx([np.degrees(12), 180, 90])
    assert robot.jerk_limits == pytest.approx(robot.acceleration_limits / 0.05)
    assert robot.joints[2].stall_torque == 2 and robot.joints[1].title == "Lift"
    assert {name: np.degrees(q).round(9).tolist() for name, q in robot.poses.items()} == SIDE["poses"]
    assert robot.point("A") == pytest.approx([0.2, 0, 0.1])
    assert (robot.floor_z, robot.gravity.payload_kg, robot.obstacles[0].title) == (-0.3, 0.2, "wall")
    outputs = robot.output_map
    assert outputs is not None and outputs.channels == (0, 1, 2) and outputs.gripper_channel == 3
    assert robot.gripper is not None and robot.gripper.title == "Claw"
    # the tool: 150 mm along z of the link lower, where tool0 is, but pointing along x
    plain = load_robot(f"{path}#tool0")
    for q in ([0.1, 0.2, 0.3], [-1.0, 0.5, -0.4]):
        assert robot.forward(q)[:3, 3] == pytest.approx(plain.forward(q)[:3, 3], abs=1e-12)
        assert robot.forward(q)[:3, 2] == pytest.approx(
            load_robot(f"{path}#lower,approach=x").forward(q)[:3, 2]
        )
    assert not any("home" in text or "floor" in text or "±180" in text for text in robot.assumed)
    assert not any("faster" in text for text in robot.assumed)
    joints = [{"name": "lift", "speed_deg_s": 200}]
    fast = load_robot(beside(tmp_path, joints=joints, board=None, gripper=None, poses={}))
    assert (
        "faster than the URDF file allows, by the side file: lift 200 °/s instead of 115 °/s" in fast.assumed
    )


def test_without_a_word_on_it_everything_stays_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(arm_text(tmp_path))
    plain = load_robot(path)
    (tmp_path / "arm.armctl.toml").write_text("format = 1\n")
    assert load_robot(path) == plain
    (tmp_path / "elsewhere").mkdir()
    named = tmp_path / "elsewhere/other.armctl.toml"
    named.write_text('format = 1\nurdf = "../arm.urdf"\nname = "other"\nposes = {home = [0, 10, 20]}')
    other = load_robot(named)
    assert other.name == "other" and other.pose("rest") == pytest.approx(np.radians([0, 10, 20]))
    assert "rest pose: as the home pose" in other.assumed
    named.write_text("format = 1")
    with pytest.raises(RobotFileError, match=r"there is no other\.urdf beside it"):
        load_robot(named)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"joints": [{"name": "none"}]}, r"there is no joint 'none'; it has pan, lift, elbow"),
        ({"joints": [{"name": "pan"}, {"name": "pan"}]}, "two entries have the same name"),
        (
            {"joints": [{"name": "lift", "limit_deg": [-200, 0]}]},
            r"the URDF file allows -143\.24° … 143\.24°",
        ),
        ({"joints": [{"name": "lift", "limit_deg": [5, 0]}]}, "the lower limit comes first"),
        ({"joints": [{"name": "pan", "servo": {"channel": 0}}]}, r"joints\.lift\.servo is missing"),
        ({"poses": {"home": [0, 0]}}, r"poses\.home: 3 angles are needed \(pan, lift, elbow\), there are 2"),
        ({"poses": {"home": [0, 0, 99]}}, r"poses\.home: elbow = 99\.00° is outside -80\.00° … 80\.00°"),
        ({"tool": {"link": "none"}}, "there is no link 'none'; it has base, body"),
        ({"board": {"kind": "none"}}, "key board.kind: must be one of"),
    ],
)
def test_what_a_side_file_may_not_say(tmp_path: Path, changes: dict[str, object], says: str) -> None:
    path = beside(tmp_path, **changes)
    with pytest.raises(RobotFileError, match=says) as refused:
        load_robot(path)
    assert str(path) in str(refused.value)


def test_rounded_limits_and_poses_are_taken_as_the_limits(tmp_path: Path) -> None:
    """2.5 rad is 143.2394…°, and a page writes 143.24."""
    joints = [{"name": "lift", "limit_deg": [-143.24, 143.24]}]
    path = beside(tmp_path, joints=joints, gripper=None, poses={"home": [0, 143.24, 0]})
    robot = load_robot(path)
    assert robot.limits[1].tolist() == [-2.5, 2.5] and robot.pose("home")[1] == 2.5


class GivenUpAfter(threading.Event):
    """Nobody waits any more once it has been asked so often."""

    def __init__(self, looks: int) -> None:
        super().__init__()
        self.left = looks

    def is_set(self) -> bool:
        self.left -= 1
        return self.left < 0


def test_an_upload_that_nobody_waits_for_ends_at_each_file_and_leaves_nothing(tmp_path: Path) -> None:
    files = {name: arm_text(tmp_path).encode() for name in ("a.urdf", "b.xacro", "c.xml")}
    robots, looks = tmp_path / "robots", 2 * len(files)  # unpacked, and written
    token = GIVEN_UP.set(None)
    try:
        for look in range(looks):
            GIVEN_UP.set(GivenUpAfter(look))
            with pytest.raises(LimitError, match="cancelled"):
                install_package("arm.zip", zipped(files), robots)
            assert not robots.exists() or [*robots.iterdir()] == []
        GIVEN_UP.set(GivenUpAfter(looks))
        assert install_package("arm.zip", zipped(files), robots) == robots / "arm"
    finally:
        GIVEN_UP.reset(token)


def test_changes_are_merged_and_the_file_before_is_kept(tmp_path: Path) -> None:
    path = beside(tmp_path)
    side = tmp_path / "arm.armctl.toml"
    changed_side_file(side, {"floor": {"z_mm": -100}, "poses": {"rest": [0, -20, 0]}, "points": None})
    robot = load_robot(path)
    assert (robot.floor_z, dict(robot.points)) == (-0.1, {})
    assert np.degrees(robot.pose("rest")) == pytest.approx([0, -20, 0])
    assert np.degrees(robot.pose("home")) == pytest.approx([0, 20, 60])
    assert (tmp_path / "arm.armctl.toml~").is_file()
    with pytest.raises(RobotFileError, match="mistyped"):
        changed_side_file(side, {"flour": {}})
    assert load_robot(path) == robot
    (tmp_path / "taken").write_text("")
    with pytest.raises(RobotFileError, match="cannot be written"):
        changed_side_file(tmp_path / "taken/arm.armctl.toml", {})
