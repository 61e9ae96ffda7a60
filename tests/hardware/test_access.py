from __future__ import annotations

import grp
import os
import pwd
import subprocess
import sys
from pathlib import Path

import pytest

from armctl.hardware.access import (
    MODEM_MANAGER_NOTE,
    UDEV_RULES_NAME,
    modem_manager_note,
    permission_hint,
    program_using,
    udev_rules,
)
from armctl.hardware.boards import board_types
from armctl.system import may_open


def test_the_hint_names_the_group_that_owns_the_device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    group = grp.struct_group(("uucp", "x", tmp_path.stat().st_gid, []))
    monkeypatch.setattr(grp, "getgrgid", lambda number: group if number == group.gr_gid else None)
    assert permission_hint(str(tmp_path)).startswith(
        "run `sudo usermod -aG uucp $USER`, then log out and in again"
    )
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


def test_the_udev_rules_cover_every_board_that_the_listing_knows():
    rules = [line for line in udev_rules().splitlines() if line.startswith("ATTRS")]
    for vendor, product in [numbers for board in board_types() for numbers in board.usb]:
        assert any(
            f'ATTRS{{idVendor}}=="{vendor:04x}"' in line
            and ("idProduct" not in line or f'ATTRS{{idProduct}}=="{product or 0:04x}"' in line)
            for line in rules
        ), f"{vendor:04x}:{product}"
    for line in rules:
        assert 'TAG+="uaccess"' in line
        assert 'ENV{ID_MM_DEVICE_IGNORE}="1"' in line  # ModemManager keeps away
        assert 'MODE="0660"' in line  # never the whole world
    assert UDEV_RULES_NAME.split("-")[0] < "73"  # before the rules that hand the tag on
    assert UDEV_RULES_NAME in udev_rules()  # its own install line


# Who has a port open, read out of a made-up /proc and udev database (and once out of the real ones).

DEVICE = "/dev/null"  # a device that is there on every computer: character device 1:3


@pytest.fixture
def proc(tmp_path: Path) -> Path:
    """A /proc with two programs, and one that lets nobody look."""
    folder = tmp_path / "proc"
    for number, name, files in (
        ("12", "bash", ["/dev/pts/0"]),
        ("812", "minicom", ["/dev/pts/1", "/dev/ttyACM0"]),
    ):
        (folder / number / "fd").mkdir(parents=True)
        (folder / number / "comm").write_text(f"{name}\n")
        for descriptor, target in enumerate(files):
            (folder / number / "fd" / str(descriptor)).symlink_to(target)
    (folder / "7").mkdir()
    (folder / "self").mkdir()
    return folder


def test_the_program_that_has_a_port_open(proc: Path, tmp_path: Path):
    (tmp_path / "arm").symlink_to("/dev/ttyACM0")
    for name in ("/dev/ttyACM0", str(tmp_path / "arm")):
        assert program_using(name, proc) == "minicom (process 812)"
    assert program_using("/dev/ttyACM1", proc) is None
    assert program_using("/dev/pts/1", proc) is None  # the program that serves it does not use it
    assert program_using("/dev/ttyACM0", proc / "missing") is None
    (proc / "812" / "comm").unlink()  # it ends meanwhile
    assert program_using("/dev/ttyACM0", proc) == "a program (process 812)"
    (proc / "812").rename(proc / str(os.getpid()))  # what this program has open does not count
    assert program_using("/dev/ttyACM0", proc) is None


def test_another_process_of_this_user_is_seen_in_the_real_proc(tmp_path: Path):
    device = tmp_path / "ttyACM0"
    device.touch()
    code = "import os, sys; os.open(sys.argv[1], os.O_RDWR); print(1, flush=True); sys.stdin.read()"
    other = subprocess.Popen(
        [sys.executable, "-c", code, str(device)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert other.stdout is not None
    assert other.stdout.readline() == "1\n"
    found = program_using(str(device))
    other.communicate()
    assert found is not None
    assert found.endswith(f"(process {other.pid})")
    assert program_using(str(device)) is None


def test_modem_manager_matters_where_it_runs_and_no_udev_rule_covers_the_port(proc: Path, tmp_path: Path):
    assert modem_manager_note(DEVICE, proc, tmp_path) is None
    (proc / "600").mkdir()
    (proc / "600" / "comm").write_text("ModemManager\n")
    assert modem_manager_note(DEVICE, proc, tmp_path) == MODEM_MANAGER_NOTE
    record = tmp_path / "c1:3"
    record.write_text("S:arm\nE:ID_MM_DEVICE_IGNORE=1\n")
    assert modem_manager_note(DEVICE, proc, tmp_path) is None
    record.write_text("S:arm\nE:ID_MM_CANDIDATE=1\n")
    assert modem_manager_note(DEVICE, proc, tmp_path) == MODEM_MANAGER_NOTE
