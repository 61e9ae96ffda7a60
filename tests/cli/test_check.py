"""``armctl check``: errors refuse, warnings do not, and both can be read by programs."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from armctl.cli.main import DONE, REFUSED, run
from armctl.program import LineStep, MoveStep, Program, Step, save_program
from armctl.robot import load_robot, robots_folder

HOME = MoveStep(joints_deg=(0, 90, -80, -40, 0))
STRETCHED = MoveStep(joints_deg=(0, 0, 0, 0, 0))
LOW = MoveStep(joints_deg=(0, -3, -60, -20, 0))


def call(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    status = run(["check", *arguments])
    out, err = capsys.readouterr()
    return status, out, err


def program(tmp_path: Path, *steps: Step) -> str:
    path = tmp_path / "mine.toml"
    save_program(Program(robot="uzuner", steps=steps), path)
    return str(path)


def test_a_warning_is_told_and_does_not_refuse(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    status, out, err = call(capsys, program(tmp_path, HOME, STRETCHED))
    assert status == DONE
    assert "a sound program, with 1 warning" in out
    assert "warning: " in err and "singularity: the tool cannot move in one direction" in err


def test_json_holds_every_part_of_a_finding(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    status, out, err = call(capsys, program(tmp_path, HOME, STRETCHED, LOW), "--json")
    assert "step 3: the left jaw: " in err and "mm below the floor; " in err and "raise the target" in err
    record = json.loads(out)
    assert status == REFUSED and record["sound"] is False and record["kind"] == "program"
    assert [(f["step"], f["kind"], f["severity"]) for f in record["findings"]] == [
        (2, "singularity", "warning"),
        (3, "floor", "error"),
    ]
    floor = record["findings"][1]
    assert floor["part"] == "the left jaw" and floor["time_s"] > 0 and "below the floor" in floor["what"]
    assert floor["text"].endswith(floor["mend"])


def test_the_first_motion_is_checked_from_where_a_run_begins_it(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    status, _, err = call(capsys, program(tmp_path, LineStep(x_mm=220, y_mm=60, z_mm=100)))
    assert status == REFUSED
    assert "step 1: " in err and "Elbow would need" in err


def test_a_csv_without_a_robot_says_how_to_name_one(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "points.csv"
    path.write_text("x_mm,y_mm,z_mm\n220,0,100\n")
    status, _, err = call(capsys, str(path))
    assert status == REFUSED and "--robot uzuner" in err


@pytest.mark.parametrize("name", ["abaas", "humanoid", "mico", "scorbot", "uzuner"])
def test_shipped_robots_are_sound(capsys: pytest.CaptureFixture[str], name: str) -> None:
    status, out, err = call(capsys, str(robots_folder() / f"{name}.toml"))
    assert status == DONE and "a sound robot" in out and "the tool axis" not in err
    weight = load_robot(name).gravity
    assert f"torques count links of {sum(body.mass_kg for body in weight.bodies):.3g} kg and a payload" in out
    assert ("not checked: gravity torque" in out) == (name in ("humanoid", "mico", "scorbot"))
    if name == "abaas":
        assert "warning: " in err and "the way from home to zero: " in err and "below the floor" in err


def test_a_file_that_cannot_be_read_is_an_error(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    broken = tmp_path / "mine.toml"
    broken.write_text('format = 1\nrobot = "uzuner"\n[[steps]]\ndo = "hop"\n', encoding="utf-8")
    status, out, _ = call(capsys, str(broken), "--json")
    record = json.loads(out)
    assert status == REFUSED
    assert [f["severity"] for f in record["findings"]] == ["error"] and "hop" in record["findings"][0]["text"]


URDF = """<robot name="bench"><link name="base"/><link name="arm/upper"/><link name="arm/hand"/>
<joint name="lift" type="revolute"><parent link="base"/><child link="arm/upper"/><axis xyz="0 1 0"/>
<origin xyz="0 0 0.3"/><limit lower="-1" upper="1" velocity="1"/></joint>
<joint name="end" type="fixed"><parent link="arm/upper"/><child link="arm/hand"/>
<origin xyz="0.1 0 0"/></joint>
</robot>"""


@pytest.mark.parametrize(("behind", "told"), [("", True), ("#arm/hand", False), ("#approach=x", True)])
def test_what_is_assumed_of_a_urdf_is_told(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, behind: str, told: bool
) -> None:
    path = tmp_path / "bench.URDF"
    path.write_text(URDF, encoding="utf-8")
    status, out, _ = call(capsys, f"{path}{behind}")
    assert status == DONE and "a sound robot" in out
    assert (": assumed: the tool is the link arm/hand, which is called a hand" in out) == told
    status, out, _ = call(capsys, f"{path}{behind}", "--json")
    assert "accelerations: full speed within 1/6 s" in json.loads(out)["assumed"]


def test_an_arm_that_left_joints_out_is_not_called_a_sound_robot(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "bench.urdf"
    slide = '<joint name="slide" type="prismatic"><parent link="rail"/><child link="base"/></joint>'
    path.write_text(URDF.replace("</robot>", f'<link name="rail"/>{slide}</robot>'), encoding="utf-8")
    status, out, _ = call(capsys, str(path))
    assert status == DONE
    assert "bench.urdf: sound as an arm of 1 joint, without slide" in out and "a sound robot" not in out
    assert json.loads(call(capsys, str(path), "--json")[1])["left_out"] == ["slide"]


def test_the_case_of_a_suffix_does_not_matter(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "MINE.CSV"
    path.write_text("step,do,note\n1,comment,nothing\n")
    assert call(capsys, str(path), "--robot", "uzuner")[:2] == (DONE, f"{path}: a sound program\n")


def test_a_rest_pose_that_enable_would_refuse_is_an_error(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    text = (robots_folder() / "uzuner.toml").read_text()
    path = tmp_path / "low.toml"
    assert "\nrest = [" in text
    path.write_text(re.sub(r"(?m)^rest = .*$", f"rest = {list(LOW.joints_deg)}", text))
    status, _, err = call(capsys, str(path))
    assert status == REFUSED
    assert re.search(r"the rest pose: .*: \d+\.\d mm below the floor; Enable is refused there", err)
    robot = load_robot("uzuner")
    x, y, z = (1000 * robot.forward(robot.pose("rest"))[:3, 3]).round(1).tolist()
    corners = f"from_mm = [{x - 20}, {y - 20}, {z - 20}]\nto_mm = [{x + 20}, {y + 20}, {z + 20}]\n"
    post = f'[[obstacles]]\ntitle = "the post"\n{corners}'
    path.write_text(f"{text}\n{post}")
    status, _, err = call(capsys, str(path))
    assert status == REFUSED
    assert re.search(r"the rest pose: .* mm inside the post; Enable is refused there", err)
    found = json.loads(call(capsys, str(path), "--json")[1])["findings"]
    assert [one["kind"] for one in found if one["part"] == "the rest pose"] == ["obstacle"]


@pytest.mark.parametrize(
    ("written", "instead", "pin"),
    [("pulse_us = [544, 2400]", "pulse_us = [490, 2400]", 2), ("open_us = 2000", "open_us = 500", 7)],
)
def test_channels_that_the_board_would_refuse_are_an_error(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, written: str, instead: str, pin: int
) -> None:
    text = (robots_folder() / "abaas.toml").read_text()
    assert written in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(written, instead, 1))
    status, _, err = call(capsys, str(path))
    assert status == REFUSED
    assert f"the board: pin {pin}: " in err and "it must lie within 544 … 2912 µs" in err


def test_a_long_program_shows_how_far_it_is_on_a_terminal(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    long = program(tmp_path, *[HOME] * 500)
    assert call(capsys, long)[2] == ""
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    status, _, err = call(capsys, long)
    assert status == DONE and "checking 500 steps" in err and "100%" in err


def test_a_python_script_is_run_with_python(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "pick.py"
    path.write_text("import armctl\n")
    for command in ("check", "run"):
        status = run([command, str(path)])
        assert status == REFUSED
        assert "pick.py: is a Python script; run it with Python: python pick.py" in capsys.readouterr().err


def test_all_that_is_wrong_with_a_robot_file_is_told_at_once_in_the_order_of_its_lines(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Keys, types, choices, contradictions and the board's tables, in one list and in a table each."""
    text = (robots_folder() / "uzuner.toml").read_text()
    wrong = (
        ('convention = "modified"', 'convention = "modifed"', r"'modifed'; did you mean 'modified'\?"),
        ('joint = "elbow" }', 'joint = "elbow", colour = 3 }', r"unknown key 'colour'; .* alpha_deg, a_mm"),
        ('title = "Base"', "title = 3", "title: must be text, not 3"),
        ("[-3.19, 146.831]", "[146.831, -3.19]", r"shoulder\.limit_deg = .*: the lower limit comes first"),
        ("acceleration_deg_s2 = 540", "aceleration_deg_s2 = 540", "Did you mean 'acceleration_deg_s2'?"),
        ("zero_us = 1446.45", "zero_us = nan", r"servo\.zero_us: nan is no number"),
        ("channel = 5", "chanel = 5", r"gripper\.servo: unknown key 'chanel'; .*'channel'"),
        ("home = [0, 90, -80, -40, 0]", "home = [0, 90, -80, -40]", r"poses\.home: 5 angles are needed"),
        ('joint = "base"\nmass_kg', 'joint = "bsae"\nmass_kg', "no joint 'bsae'; did you mean 'base'?"),
    )
    for old, new, _ in wrong:
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "mine.toml"
    path.write_text(text)
    status, _, err = call(capsys, str(path))
    lines = err.splitlines()
    assert status == REFUSED and len(lines) == len(wrong)
    numbers = [int(re.findall(r"mine\.toml: line (\d+)", line)[0]) for line in lines]
    assert numbers == sorted(numbers)
    for (_, new, says), line, number in zip(wrong, lines, numbers, strict=True):
        assert re.search(says, line), line
        assert text.splitlines()[number - 1] in new or new in text.splitlines()[number - 1]


def test_all_steps_that_are_wrong_are_told_at_once(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'format = 1\nrobot = "uzuner"\nstep = 3\n[[steps]]\ndo = "wait"\nsecs = 1\n'
        '[[steps]]\ndo = "hop"\n[[steps]]\ndo = "line"\nx_mm = 1\ny_mm = "2"\n'
    )
    status, out, _ = call(capsys, str(path), "--json")
    told = [finding["text"] for finding in json.loads(out)["findings"]]
    says = (
        r"line 3: unknown key 'step'; .* 'steps'",
        r"line 6, step 1: unknown key 'secs'",
        r"line 8, step 2, key do: must be one of .*, not 'hop'",
        r"line 9, step 3: the key 'z_mm' is missing",
        r"line 12, step 3, key y_mm: must be a number, not '2'",
    )
    assert status == REFUSED
    for one, text in zip(says, told, strict=True):
        assert re.search(one, text), text


@pytest.mark.parametrize(
    ("convention", "rows"),
    [
        ("standard", ["a_mm = 90, alpha_deg = 0, d_mm = 4, joint = 'wrist'"]),
        ("standard", ["a_mm = -90, alpha_deg = 0, d_mm = 0, joint = 'wrist'"]),
        (
            "modified",
            ["a_mm = 110, alpha_deg = 0, d_mm = 0, joint = 'wrist'", "a_mm = 90, alpha_deg = 0, d_mm = 0"],
        ),
    ],
)
def test_a_tool_axis_across_the_link_is_told_with_the_rows_that_mend_it(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, convention: str, rows: list[str]
) -> None:
    ahead = [
        "a_mm = 0, alpha_deg = 90, d_mm = 80, joint = 'base'",
        "a_mm = 120, alpha_deg = 0, d_mm = 0, joint = 'shoulder'",
        "a_mm = 110, alpha_deg = 0, d_mm = 0, joint = 'elbow'",
    ]
    if convention == "modified":
        ahead = [
            "a_mm = 0, alpha_deg = 0, d_mm = 80, joint = 'base'",
            "a_mm = 0, alpha_deg = 90, d_mm = 0, joint = 'shoulder'",
            "a_mm = 120, alpha_deg = 0, d_mm = 0, joint = 'elbow'",
        ]
    joints = "".join(
        f"[[joints]]\nname = '{name}'\ntitle = 'The {name}'\nlimit_deg = [-150, 150]\nspeed_deg_s = 60\n"
        "acceleration_deg_s2 = 360\n"
        for name in ("base", "shoulder", "elbow", "wrist")
    )
    path = tmp_path / "mine.toml"

    def written(*more: str) -> str:
        listed = ",\n".join(f"{{ {row} }}" for row in [*ahead, *rows])
        path.write_text(
            "format = 1\nname = 'mine'\ntitle = 'Mine'\n"
            "poses = { home = [0, 45, 0, 0], rest = [0, 45, 0, 0] }\n"
            f"[dh]\nconvention = '{convention}'\nrows = [{', '.join([listed, *more])}]\n{joints}"
        )
        return str(path)

    status, _, err = call(capsys, written())
    found = re.search(r"warning: .*the tool axis: .*along the link: (\{.*\})$", err, re.MULTILINE)
    assert status == DONE and found is not None
    robot, mended = load_robot(path), load_robot(written(found[1]))
    assert not len(robot.inverse([0.2, 0.0, 0.1], pitch=-0.5).q)
    assert len(mended.inverse([0.2, 0.0, 0.1], pitch=-0.5).q)
    q = np.radians([20.0, 40.0, -30.0, -20.0])
    hand = mended.forward(q)[:3, 3] - mended.frames(q)[3 if convention == "standard" else 4][:3, 3]
    along = mended.forward(q)[:3, 2] @ hand / np.linalg.norm(hand)
    assert along > 0.99
    assert robot.forward(q)[:3, 3] == pytest.approx(mended.forward(q)[:3, 3])
    assert "the tool axis" not in call(capsys, str(path))[2]


def test_a_robot_is_checked_by_its_name(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = call(capsys, "uzuner")
    assert status == DONE and "a sound robot" in out
    status, _, err = call(capsys, "uzunre")
    assert status == REFUSED and "did you mean 'uzuner'?" in err
