from __future__ import annotations

import grp
import os
import pwd
import re
from pathlib import Path

import pytest

from armctl.hardware.access import UDEV_RULES_NAME, may_open, permission_hint, udev_rules
from armctl.hardware.boards import board_types


def test_the_hint_names_the_group_that_owns_the_device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    device = tmp_path / "ttyACM0"
    device.touch()
    group = grp.struct_group(("uucp", "x", device.stat().st_gid, []))
    monkeypatch.setattr(grp, "getgrgid", lambda number: group if number == group.gr_gid else None)
    assert permission_hint(str(device)).startswith(
        "run `sudo usermod -aG uucp $USER`, then log out and in again"
    )


def test_without_a_group_to_join_it_is_the_usual_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    assert "-aG dialout" in permission_hint(str(tmp_path / "missing"))
    monkeypatch.setattr(grp, "getgrgid", lambda number: grp.struct_group(("root", "x", 0, [])))
    assert "-aG dialout" in permission_hint(str(tmp_path))


@pytest.mark.parametrize(
    ("groups", "begins"), [([4], "you are in the group uucp already"), ([4, 14], "run `sudo")]
)
def test_who_has_joined_the_group_since_the_login_is_told_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, groups: list[int], begins: str
):
    me = pwd.getpwuid(os.getuid()).pw_name
    group = grp.struct_group(("uucp", "x", 14, [me]))
    monkeypatch.setattr(grp, "getgrgid", lambda _number: group)
    monkeypatch.setattr(grp, "getgrnam", lambda _name: group)
    monkeypatch.setattr(os, "getgroups", lambda: groups)
    assert permission_hint(str(tmp_path)).startswith(begins)


def test_may_open_asks_for_both_directions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    device = tmp_path / "ttyACM0"
    assert may_open(str(device)) is False
    device.touch()
    assert may_open(str(device)) is True
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.W_OK)
    assert may_open(str(device)) is False


@pytest.fixture
def rules() -> list[str]:
    """The lines of the rules that grant something."""
    return [line for line in udev_rules().splitlines() if line.startswith("ATTRS")]


def test_the_udev_rules_cover_every_board_that_the_listing_knows(rules: list[str]):
    for vendor, product in [numbers for board in board_types() for numbers in board.usb]:
        assert any(
            f'ATTRS{{idVendor}}=="{vendor:04x}"' in line
            and ("idProduct" not in line or f'ATTRS{{idProduct}}=="{product or 0:04x}"' in line)
            for line in rules
        ), f"{vendor:04x}:{product}"


def test_each_udev_rule_grants_access_and_keeps_modem_manager_away(rules: list[str]):
    for line in rules:
        assert 'TAG+="uaccess"' in line
        assert 'ENV{ID_MM_DEVICE_IGNORE}="1"' in line
        assert re.search(r'MODE="0660"', line)  # never the whole world


def test_the_udev_rules_come_before_those_that_hand_the_tag_on():
    assert UDEV_RULES_NAME.split("-")[0] < "73"
    assert UDEV_RULES_NAME in udev_rules()  # its own install line
