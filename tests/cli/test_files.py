"""Whatever file a command is given, it says in one line what is wrong with it, and waits for nothing."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from armctl.cli.main import REFUSED, run
from armctl.robot import robots_folder

UZUNER = str(robots_folder() / "uzuner.toml")
COMMANDS = {
    "check FILE.toml": 1024,
    "check FILE.csv --robot uzuner": 1024,
    "check FILE.urdf": 4096,
    "run FILE.toml": 1024,
    "run FILE.csv --robot uzuner": 1024,
    "fk FILE.toml 0": 256,
    "ik FILE.urdf#hand 0 0 0": 4096,
    "run --robot FILE.toml x.csv": 256,
    "calibrate fit uzuner base FILE.csv": 256,
    "calibrate points uzuner FILE.csv": 256,
    "calibrate import FILE.toml": 256,
}
"""and the size above which each refuses [KiB]"""


@pytest.mark.parametrize("command", COMMANDS)
def test_only_regular_files_of_a_size_that_people_have(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    largest = COMMANDS[command]
    suffix = "." + command.partition("FILE.")[2].partition(" ")[0].partition("#")[0]
    made = {name: tmp_path / f"{name}{suffix}" for name in ("folder", "pipe", "device", "large", "none")}
    made["folder"].mkdir()
    os.mkfifo(made["pipe"])
    made["device"].symlink_to("/dev/zero")
    with made["large"].open("wb") as stream:
        stream.truncate(2**40)  # none of it is read
    for name, says in (
        ("folder", "holds no .urdf" if suffix == ".urdf" else "it is a folder, no regular file"),
        ("pipe", "it is a named pipe, no regular file"),
        ("device", "it is a device, no regular file"),
        ("large", f"is larger than {largest} KiB; no such file is"),
        ("none", "cannot be read: No such file or directory"),
    ):
        path = made[name]
        status = run([word.replace(f"FILE{suffix}", str(path)) for word in command.split()])
        out, err = capsys.readouterr()
        assert (status, out) == (REFUSED, "")
        assert err.endswith("\n") and err.count("\n") == 1, err
        assert f"{path}: " in err and says in err


def test_an_arm_has_64_joints_at_most(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    links = "".join(f'<link name="l{i}"/>' for i in range(66))
    joints = "".join(
        f'<joint name="j{i}" type="continuous"><parent link="l{i}"/><child link="l{i + 1}"/></joint>'
        for i in range(65)
    )
    urdf, toml = tmp_path / "snake.urdf", tmp_path / "snake.toml"
    urdf.write_text(f'<robot name="snake">{links}{joints}</robot>')
    joint = 'name = "a"\ntitle = "a"\nlimit_deg = [0, 1]\nspeed_deg_s = 1\nacceleration_deg_s2 = 1\n'
    head, _, rest = Path(UZUNER).read_text().partition("[[joints]]")
    toml.write_text(f"{head}{''.join(f'[[joints]]{chr(10)}{joint}' for _ in range(65))}[[joints]]{rest}")
    assert run(["fk", str(urdf), "0"]) == REFUSED
    assert "65 joints turn between l0 and l65; an arm has 64 at most" in capsys.readouterr().err
    assert run(["fk", f"{urdf}#l64", *["0"] * 64]) == 0
    assert run(["fk", str(toml), "0"]) == REFUSED
    assert "key joints: must have at most 64 values" in capsys.readouterr().err
