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
    SUSPEND_NOTE,
    UDEV_RULES_NAME,
    braille_note,
    modem_manager_note,
    permission_hint,
    program_using,
    suspend_note,
    taken_devices,
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
    awake = [line for line in udev_rules().splitlines() if line.endswith('ATTR{power/control}="on"')]
    assert len(awake) == len(rules)  # the devices of the same chips are never suspended
    for line, port in zip(awake, rules, strict=True):
        assert port.replace("ATTRS", "ATTR").startswith(line.removesuffix('ATTR{power/control}="on"'))
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


# brltty and autosuspend, found in a made-up /sys and in udev's files.


@pytest.fixture
def sysfs(tmp_path: Path) -> Path:
    """A CH340 with its port ttyUSB0, an Arduino with ttyACM0, and a CP2102 without a port."""
    folder = tmp_path / "sys"
    for place, vendor, product, port in (
        ("1-1", "1a86", "7523", "ttyUSB0"),
        ("1-2", "2341", "0042", "tty/ttyACM0"),
        ("1-3", "10c4", "ea60", ""),
    ):
        usb = folder / "devices/pci/usb1" / place
        interface = usb / f"{place}:1.0"
        for one in (interface / port, usb / "power", folder / "bus/usb/devices"):
            one.mkdir(parents=True, exist_ok=True)
        for name, text in (("idVendor", vendor), ("idProduct", product), ("serial", f"S-{place}")):
            (usb / name).write_text(f"{text}\n")
        (usb / "power/control").write_text("on\n")
        (usb / "power/autosuspend_delay_ms").write_text("2000\n")
        (folder / "bus/usb/devices" / place).symlink_to(usb)
        if port:
            tty = folder / "class/tty" / Path(port).name
            tty.mkdir(parents=True)
            (tty / "device").symlink_to(interface if "/" in port else interface / port)
    (folder / "class/tty/ttyS0").mkdir()
    return folder


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """udev's two folders of rules: the user's, which is empty, and that of the packages."""
    own, packages = tmp_path / "etc", tmp_path / "lib"
    own.mkdir()
    packages.mkdir()
    (packages / "85-brltty.rules").write_text(
        '# Device: 10C4:EA60\n# ENV{PRODUCT}=="10c4/ea60/*", ENV{BRLTTY_BRAILLE_DRIVER}="bm"\n'
        '# Device: 1A86:7523\nENV{PRODUCT}=="1a86/7523/*", ENV{BRLTTY_BRAILLE_DRIVER}="bm", GOTO="run"\n'
    )
    (packages / "60-serial.rules").write_text('ENV{PRODUCT}=="2341/42/*"\n')
    return own, packages


def test_brltty_is_named_where_its_rules_name_the_chip(sysfs: Path, folders: tuple[Path, Path]):
    note = braille_note("/dev/ttyUSB0", folders, sysfs)
    assert note is not None
    assert str(folders[1] / "85-brltty.rules") in note
    assert "sudo apt remove brltty" in note
    assert "sudo ln -sf /dev/null /etc/udev/rules.d/85-brltty.rules" in note
    for device in ("/dev/ttyACM0", "/dev/ttyS0", "/dev/ttyUSB7"):
        assert braille_note(device, folders, sysfs) is None
    # what the note advises ends it
    (folders[0] / "85-brltty.rules").symlink_to("/dev/null")
    assert braille_note("/dev/ttyUSB0", folders, sysfs) is None


def test_a_device_without_a_port_that_brltty_takes(sysfs: Path, folders: tuple[Path, Path]):
    assert list(taken_devices(folders, sysfs)) == []  # only a comment names the CP2102
    rules = folders[1] / "90-brltty-usb-generic.rules"
    rules.write_text('ENV{PRODUCT}=="10c4/ea60/*", GOTO="brltty_usb_run"\n')
    (taken,) = taken_devices(folders, sysfs)  # the CH340 has its port
    assert (taken.place, taken.vendor, taken.product, taken.serial_number) == ("1-3", 0x10C4, 0xEA60, "S-1-3")
    assert str(rules) in taken.why
    assert "plug the board in again" in taken.why
    assert list(taken_devices(folders, sysfs / "missing")) == []


def test_a_device_that_may_be_suspended(sysfs: Path):
    assert suspend_note("/dev/ttyUSB0", sysfs) is None
    power = sysfs / "bus/usb/devices/1-1/power"
    (power / "control").write_text("auto\n")
    assert suspend_note("/dev/ttyUSB0", sysfs) == SUSPEND_NOTE
    assert "armctl ports --udev" in SUSPEND_NOTE
    assert suspend_note("/dev/ttyACM0", sysfs) is None
    (power / "autosuspend_delay_ms").write_text("-1000\n")
    assert suspend_note("/dev/ttyUSB0", sysfs) is None
