"""The arms that most tests try: those of the papers; and quick ones, for tests that wait for motions."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from armctl.robot import load, robots_folder

FIVE = ("abaas", "humanoid", "mico", "scorbot", "uzuner")
BENCH_URDF = """<robot name="bench_arm">
  <link name="base"/><link name="tower"/><link name="upper"/>
  <link name="fore"/><link name="hand"/><link name="gripper_frame_link"/>
  <joint name="turn" type="continuous"><parent link="base"/><child link="tower"/><axis xyz="0 0 1"/></joint>
  <joint name="lift" type="revolute"><parent link="tower"/><child link="upper"/><origin xyz="0 0 0.1"/>
    <axis xyz="0 -1 0"/><limit lower="-0.5" upper="2" velocity="2" effort="3"/></joint>
  <joint name="bend" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.2 0 0"/>
    <axis xyz="0 -1 0"/><limit lower="-2" upper="2" velocity="2" effort="3"/></joint>
  <joint name="swing" type="revolute"><parent link="fore"/><child link="hand"/><origin xyz="0.15 0.02 0"/>
    <axis xyz="0 0.6 0.8"/><limit lower="-1" upper="1" velocity="2" effort="3"/></joint>
  <joint name="end" type="fixed"><parent link="hand"/><child link="gripper_frame_link"/>
    <origin xyz="0.05 0 0.01"/></joint>
</robot>
"""
"""an arm of four joints that no family solves"""
_FASTER = {"speed_deg_s": 4, "acceleration_deg_s2": 16}


def quick_robot(folder: Path, name: str = "uzuner") -> Path:
    """The file of an arm that is four times as fast: the same motions, in a quarter of the time."""
    text = (robots_folder() / f"{name}.toml").read_text(encoding="utf-8")
    keys = "|".join(_FASTER)
    text = re.sub(
        rf"^({keys}) = (\d+)$",
        lambda one: f"{one[1]} = {_FASTER[one[1]] * int(one[2])}",
        text,
        flags=re.MULTILINE,
    )
    file = folder / "quick.toml"
    file.write_text(text, encoding="utf-8")
    return file


def quick_arms(folder: Path, patch: pytest.MonkeyPatch) -> None:
    """Let shipped arms with servos be quick in this process; motors with encoders have their own speed."""
    robots = shutil.copytree(robots_folder(), folder / "robots")
    for name in ("uzuner", "abaas", "mico"):
        quick_robot(folder, name).replace(robots / f"{name}.toml")
    patch.setattr(load, "robots_folder", lambda: robots)
