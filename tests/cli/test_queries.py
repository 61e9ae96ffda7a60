"""fk, ik, robots, published and the group itself: what they print, and how they refuse."""

from __future__ import annotations

import errno
import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.robot.panda_kit import panda_file

from armctl.cli.main import DONE, REFUSED, WRONG_USAGE, run
from armctl.kinematics import rotation_of
from armctl.robot import load_robot, robots_folder


def call(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    status = run(words)
    out, err = capsys.readouterr()
    return status, out, err


def test_ik_gives_the_least_rotation_of_the_papers_point(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = call(
        capsys, "ik", "uzuner", "220", "-196", "85", "--choose", "least-rotation", "--json"
    )
    record = json.loads(out)
    assert (status, err) == (DONE, "")
    np.testing.assert_allclose(record["best_deg"], [-42.402, 0.0, -0.678, -48.795, 0.0], atol=5e-4)
    assert record["count"] == 3520
    assert record["error_mm"] < 1e-6
    assert record["reason"] is None and record["nearest_mm"] is None
    assert record["branch"] == "front elbow-up"
    _, out, _ = call(capsys, "ik", "uzuner", "220", "-196", "85")
    for text in ("3520 solutions", "-42.402", "-48.795", "front elbow-up", "Wrist pitch", "degrees"):
        assert text in out


def test_ik_says_where_its_list_may_be_incomplete(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "askew.urdf"
    axes = ("0 0 1", "0.6 0.8 0", "0 1 0", "0.8 0 0.6")
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="0.1 0 0.1"/><axis xyz="{axis}"/><limit lower="-2" upper="2"/></joint>'
        for i, axis in enumerate(axes)
    )
    links = "".join(f'<link name="l{i}"/>' for i in range(5))
    file.write_text(f'<robot name="askew">{links}{joints}</robot>')
    status, out, _ = call(capsys, "ik", str(file), "300", "50", "250")
    assert status == DONE
    assert "inside the limits; found by search, there may be others" in out
    status, out, _ = call(capsys, "ik", str(file), "3000", "50", "250", "--json")
    assert status == REFUSED
    assert json.loads(out)["complete"] is False


def test_ik_all_lists_every_solution_and_each_one_is_right(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = call(capsys, "ik", "uzuner", "150", "100", "120", "--all", "--step", "0.5", "--json")
    record = json.loads(out)
    assert len(record["solutions_deg"]) == len(record["branches"]) == record["count"] > 20
    tips = load_robot("uzuner").forward(np.radians(record["solutions_deg"]))[:, :3, 3]
    np.testing.assert_allclose(1000 * tips, np.tile([150, 100, 120], (record["count"], 1)), atol=1e-6)


def test_ik_takes_pitch_and_roll(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = call(capsys, "ik", "uzuner", "200", "0", "100", "--pitch", "-90", "--roll", "-20", "--json")
    record = json.loads(out)
    robot = load_robot("uzuner")
    T = robot.forward(np.radians(record["best_deg"]))
    np.testing.assert_allclose(T[:3, 2], [0, 0, -1], atol=1e-9)
    assert record["best_deg"][4] == pytest.approx(-20)


def test_ik_says_what_least_torque_counts(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    asked = "200", "0", "100", "--choose", "least-torque"
    _, _, err = call(capsys, "ik", "uzuner", *asked)
    assert "least-torque counts links of 0.7 kg and a payload of 0.15 kg" in err
    bare = tmp_path / "bare.toml"
    text = (robots_folder() / "uzuner.toml").read_text()
    text = re.sub(r"\[\[bodies\]\]\n(.+\n)+", "", text)  # its look would give it masses, too
    bare.write_text(text[: text.index("[look]")])
    status, _, err = call(capsys, "ik", str(bare), *asked)
    assert status != 0 and "gives no masses of links; add a table [[bodies]]" in err
    assert call(capsys, "ik", str(bare), *asked[:3])[2] == ""


@pytest.mark.parametrize(
    ("point", "says"),
    [
        (("300", "0", "600"), "too far by 200.0 mm"),
        (("0", "0", "300"), "3.62 mm cylinder"),
        (("-300", "0", "100"), "joint limits forbid it"),
    ],
)
def test_ik_says_why_there_is_no_solution(
    capsys: pytest.CaptureFixture[str], point: tuple[str, ...], says: str
) -> None:
    status, out, err = call(capsys, "ik", "uzuner", *point, "--json")
    record = json.loads(out)
    assert status == REFUSED
    assert record["count"] == 0 and record["best_deg"] is None
    assert says in record["reason"]
    assert says in err and err.count("\n") == 1
    nearest = np.array(record["nearest_mm"])
    assert load_robot("uzuner").inverse(nearest / 1000).success
    status, out, err = call(capsys, "ik", "uzuner", *point)
    assert status == REFUSED and out == "" and says in err


def test_ik_all_says_why_the_other_branches_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = call(capsys, "ik", "mico", "300", "-200", "200", "--all", "--json")
    record = json.loads(out)
    assert (status, err) == (DONE, "")
    assert record["count"] == 2
    assert [branch["branch"] for branch in record["refused"]] == ["front elbow-down", "back elbow-down"]
    why = "Shoulder needs 61.05°, its limits are -220.00° … 40.00°"
    assert record["refused"][0]["why"] == why
    tip = load_robot("mico").forward(np.radians(record["refused"][0]["deg"]))[:3, 3]
    np.testing.assert_allclose(1000 * tip, [300, -200, 200], atol=1e-6)
    status, out, _ = call(capsys, "ik", "mico", "300", "-200", "200", "--all")
    assert status == DONE and "2 branches refused" in out and why in out
    _, out, _ = call(capsys, "ik", "mico", "300", "-200", "200", "--json")
    assert "refused" not in json.loads(out)


def test_ik_all_lists_refused_branches_where_there_is_no_solution(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("ik", "scorbot", "300", "100", "300", "--pitch", "-28.6", "--all")
    status, out, err = call(capsys, *words, "--json")
    record = json.loads(out)
    assert status == REFUSED and record["count"] == 0
    assert len(record["refused"]) == 6 and all("needs" in branch["why"] for branch in record["refused"])
    status, out, again = call(capsys, *words)
    assert status == REFUSED and again == err and "6 branches refused" in out
    assert "Waist needs -161.57°, its limits are -155.00° … 155.00°" in out


@pytest.mark.parametrize("robot", ["humanoid", "mico", "scorbot"])
def test_columns_are_as_wide_as_their_titles(capsys: pytest.CaptureFixture[str], robot: str) -> None:
    arm = load_robot(robot)
    x, y, z = (1000 * arm.forward(arm.pose("home"))[:3, 3]).tolist()
    _, out, _ = call(capsys, "ik", robot, f"{x}", f"{y}", f"{z}")
    head = next(line for line in out.splitlines() if line.startswith("degrees"))
    values = next(line for line in out.splitlines() if line.startswith("least-rotation"))
    for joint in arm.joints:
        assert f"  {joint.title}" in head
        end = head.index(joint.title) + len(joint.title)
        assert values[end - 1].isdigit() and values[end : end + 1] in ("", " ")


@pytest.mark.parametrize(
    ("words", "expected", "says"),
    [
        (("ik", "uzuner", "nan", "0", "100"), WRONG_USAGE, "finite"),
        (("ik", "uzuner", "200", "0", "100", "--step", "0"), WRONG_USAGE, "step"),
        (("ik", "uzuner", "200", "0", "100", "--start", "1,2"), WRONG_USAGE, "5"),
        (("ik", "uzuner", "200", "0", "100", "--start", "1,2,3,4,nan"), WRONG_USAGE, "finite"),
        (("ik", "uzuner", "200", "0", "100", "--pitch", "1000"), WRONG_USAGE, "1000 must be within -360 "),
        (("ik", "uzuner", "200", "0"), WRONG_USAGE, "Missing argument 'Z'"),
        (("ik", "uzuner", "abc", "0", "100"), WRONG_USAGE, "'abc'"),
        (("ik", "uzuner", "200", "0", "100", "7"), WRONG_USAGE, "unexpected"),
        (("ik", "uzuner", "200", "0", "100", "--choose", "luck"), WRONG_USAGE, "luck"),
        (("ik", "uzuner", "2", "0", "1", "--pitch", "0", "--rpy", "0", "0", "0"), WRONG_USAGE, "not both"),
        (
            ("ik", "uzuner", "2", "0", "1", *"--quaternion 1 0 0 0 --rpy 0 0 0".split()),
            WRONG_USAGE,
            "not both",
        ),
        (("ik", "uzuner", "2", "0", "1", *"--quaternion 1 0 0 0 --roll 0".split()), WRONG_USAGE, "not both"),
        (("ik", "uzuner", "2", "0", "1", *"--quaternion 0 0 0 0".split()), WRONG_USAGE, "no orientation"),
        (("ik", "nobody", "200", "0", "100"), REFUSED, "shipped are"),
        (("ik", "./nobody.toml", "200", "0", "100"), REFUSED, "nobody.toml"),
        (("fk", "uzuner", "1", "2", "3"), WRONG_USAGE, "uzuner needs 5 joint angles in degrees, got 3: base"),
        (("dance",), WRONG_USAGE, "dance"),
        (("run", "p.toml", "--speed", "nan"), WRONG_USAGE, "nan is not a finite number"),
        (("run", "p.toml", "--speed", "4"), WRONG_USAGE, "4 must be within 5 … 100"),
        (("run", "p.toml", "--loops", "1.5"), WRONG_USAGE, "1.5"),
        (("run", "p.toml", "--loops", "3", "--forever"), WRONG_USAGE, "--loops 3 or --forever, not both"),
        (("--robot", "nobody"), REFUSED, "there is no robot 'nobody'"),  # those of `serve`
        (("--no-browser", "--robot", "nobody"), REFUSED, "there is no robot 'nobody'"),
        (("--nonsense",), WRONG_USAGE, "--nonsense"),
        (("serve", "--host", "0.0.0.0", "--no-token"), REFUSED, "a token is needed"),
        (("serve", "--allow-host", "http://pi"), REFUSED, "'http://pi' is no host name"),
        (("serve", "--tls-cert", "c.pem"), WRONG_USAGE, "--tls-cert and --tls-key belong together"),
        (("serve", "--tls-cert", "c.pem", "--tls-key", "k.pem"), REFUSED, "c.pem: cannot be read"),
        (("check", "nothing.toml"), REFUSED, "nothing.toml"),
    ],
)
def test_bad_input_is_one_line_and_no_traceback(
    capsys: pytest.CaptureFixture[str], words: tuple[str, ...], expected: int, says: str
) -> None:
    status, _, err = call(capsys, *words)
    assert status == expected
    assert says in err
    assert err.count("\n") == 1 and "Traceback" not in err


def test_fk_gives_position_rotation_and_matrix(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = call(capsys, "fk", "uzuner", "10", "-3", "20", "-30.5", "15", "--json")
    record = json.loads(out)
    T = load_robot("uzuner").forward(np.radians([10, -3, 20, -30.5, 15]))
    assert (status, err) == (DONE, "")
    np.testing.assert_allclose(record["position_mm"], 1000 * T[:3, 3], atol=1e-6)
    np.testing.assert_allclose(np.array(record["matrix"])[:3, :3], T[:3, :3], atol=1e-9)
    np.testing.assert_allclose(np.array(record["matrix"])[:, 3], [*(1000 * T[:3, 3]), 1], atol=1e-6)
    assert len(record["rpy_deg"]) == 3
    assert record["tool_pitch_deg"] == pytest.approx(np.degrees(np.arcsin(T[2, 2])), abs=1e-4)
    np.testing.assert_allclose(rotation_of(quaternion=record["quaternion_wxyz"]), T[:3, :3], atol=1e-9)


@pytest.mark.parametrize("by", ["--rpy", "--quaternion"])
def test_a_whole_orientation_of_six_and_seven_joints(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, by: str
) -> None:
    for robot, q in (("ur5", "10,-70,80,-90,-80,30"), (str(panda_file(tmp_path)), "5,-20,10,-120,8,100,40")):
        _, out, _ = call(capsys, "fk", robot, *q.split(","), "--json")
        told = json.loads(out)
        point, turned = told["position_mm"], told["rpy_deg" if by == "--rpy" else "quaternion_wxyz"]
        words = (*map(str, point), by, *map(str, turned), "--choose", "least-travel", "--start", q)
        status, out, err = call(capsys, "ik", robot, *words, "--json")
        told = json.loads(out)
        assert (status, err) == (DONE, "")
        np.testing.assert_allclose(told["best_deg"], [float(part) for part in q.split(",")], atol=1e-4)
        assert told["orientation_error_deg"] < 1e-6 and told["error_mm"] < 1e-5
        assert (told["incomplete_reason"] is None) == told["complete"] == (robot == "ur5")
        status, out, _ = call(capsys, "ik", robot, *words)
        assert status == DONE and ("joint 7 swept" in out) == (robot != "ur5")


def test_fk_prints_no_negative_zero(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = call(capsys, "fk", "uzuner", "0", "90", "-80", "-40", "0")
    assert status == DONE
    assert "-0.0000 " not in out and "yaw    0.0000" in out
    assert "tool pitch       -30.0000  degrees above the horizontal" in out


def test_fk_outside_the_limits_is_computed_with_a_warning(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = call(capsys, "fk", "uzuner", "0", "0", "-100", "0", "0", "--json")
    assert status == DONE
    assert "Elbow" in json.loads(out)["outside_limits"]
    assert "Elbow: -100.00° is outside -84.36° … 95.07°" in err


def test_robots_lists_what_is_shipped(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = call(capsys, "robots", "--json")
    records = {record["name"]: record for record in json.loads(out)}
    assert status == DONE and records["uzuner"]["simulated_only"] is None
    assert records["ur5"]["simulated_only"] == load_robot("ur5").no_board
    _, out, _ = call(capsys, "robots")
    assert "Wrist pitch" in out and "-102.80°" in out
    assert "simulated only: armctl does not speak to its controller" in out


def test_published_prints_every_figure(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = call(capsys, "published", "uzuner", "--json")
    (report,) = json.loads(out)
    assert status == DONE and report["agrees"] and len(report["rows"]) == 14
    _, out, _ = call(capsys, "published", "abaas", "uzuner")
    assert "\n\nuzuner: " in out and "14 of 14 figures reproduced" in out and "erratum" in out


def test_help_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = call(capsys, "--help")
    assert status == DONE
    for name in ("serve", "robots", "ports", "fk", "ik", "run", "check", "published", "simulate"):
        assert name in out


def test_ik_imports_neither_viser_nor_scipy_nor_matplotlib() -> None:
    code = (
        "import sys; from armctl.cli.main import run; "
        "status = run(['ik', 'uzuner', '220', '-196', '85', '--json']); "
        "heavy = {'viser', 'scipy', 'serial', 'rich', 'matplotlib'} & set(sys.modules); "
        "sys.exit(f'imported {heavy}' if heavy else status)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["count"] == 3520


# Where nobody reads the output, or it cannot be written.


def armctl(*words: str, stdout: int) -> tuple[int, str]:
    """Exit status and stderr of a process of its own: what Python does at its end counts too."""
    done = subprocess.run(
        [sys.executable, "-m", "armctl", *words], stdout=stdout, stderr=subprocess.PIPE, text=True, timeout=60
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize("words", [("fk", "uzuner", "0", "0", "0", "0", "0"), ("--help",)])
def test_a_full_disk_is_one_line(words: tuple[str, ...]) -> None:
    with Path("/dev/full").open("w") as full:  # takes no byte, as a full disk
        status, said = armctl(*words, stdout=full.fileno())
    assert status == REFUSED
    assert said == f"armctl: the output cannot be written: {os.strerror(errno.ENOSPC)}\n"


def test_a_pipe_that_nobody_reads_on_ends_in_silence() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    try:
        status, said = armctl("robots", stdout=writing)
    finally:
        os.close(writing)
    assert (status, said) == (REFUSED, "")


def test_an_orientation_that_the_arm_cannot_take_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = call(capsys, *"ik uzuner 220 -60 100 --rpy 0 0 0".split())
    assert status == DONE and "orientation error  161.404°" in out
    assert "not in that orientation: the nearest that was found there is 161° off" in err


def test_json_is_the_same_in_every_language(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LC_ALL", "tr_TR.UTF-8")
    _, out, err = call(capsys, "ik", "uzuner", "300", "0", "600", "--json")
    assert json.loads(out)["reason"].startswith("too far by 200.0 mm")
    assert "200.0 mm" in err and "too far" not in err
    _, out, _ = call(capsys, "ik", "scorbot", "0", "0", "450", "--json")
    assert "may turn while the tool stays" in json.loads(out)["incomplete_reason"]
    _, out, _ = call(capsys, "ik", "scorbot", "0", "0", "450")
    assert "takım yerinde dururken Waist" in out and "may turn" not in out


def test_a_tool_of_the_arm_is_asked_for(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    text = (robots_folder() / "uzuner.toml").read_text(encoding="utf-8")
    file = tmp_path / "two.toml"
    file.write_text(
        f'{text}\n[[tools]]\nname = "jaws"\ngripper = true\n'
        '[[tools]]\nname = "pen"\noffset_mm = [0, 0, 100]\n',
        encoding="utf-8",
    )
    home = ("0", "60", "-40", "20", "0", "--json")

    def tip(*asked: str) -> list[float]:
        return list(json.loads(call(capsys, "fk", *asked, str(file), *home)[1])["position_mm"])

    plain = json.loads(call(capsys, "fk", "uzuner", *home)[1])["position_mm"]
    assert tip() == tip("--tool", "jaws") == plain
    assert math.dist(tip("--tool", "pen"), plain) == pytest.approx(100, abs=1e-6)
    _, out, _ = call(capsys, "ik", str(file), *map(str, tip("--tool", "pen")), "--tool", "pen", "--json")
    assert json.loads(out)["error_mm"] == pytest.approx(0, abs=1e-3)
    status, _, err = call(capsys, "ik", str(file), "200", "0", "100", "--tool", "saw")
    assert status == 1 and "the arm has no tool 'saw'; it has 'jaws', 'pen'" in err
    status, out, err = call(capsys, "check", str(file))
    assert status == 0 and "with the tool pen" in err and "a sound robot" in out
