from __future__ import annotations

import os
from pathlib import Path

import pytest

from armctl.errors import PortError
from armctl.hardware.simulation import DeviceLink

GONE = "/dev/pts/999999"


def test_it_points_to_the_device_until_it_is_removed(tmp_path: Path):
    path = tmp_path / "arm"
    link = DeviceLink(path, "/dev/pts/7")
    assert os.readlink(path) == "/dev/pts/7"
    link.remove()
    assert not path.is_symlink()
    link.remove()


def test_a_left_over_of_a_simulator_is_replaced(tmp_path: Path):
    path = tmp_path / "arm"
    path.symlink_to(GONE)
    DeviceLink(path, "/dev/pts/7")
    assert os.readlink(path) == "/dev/pts/7"


def test_a_left_over_that_points_to_our_own_pty_by_chance_is_replaced(tmp_path: Path):
    device = tmp_path / "pty"
    device.touch()
    path = tmp_path / "arm"
    path.symlink_to(device)
    DeviceLink(path, str(device))
    assert os.readlink(path) == str(device)


def test_a_file_a_folder_and_foreign_links_are_left_alone(tmp_path: Path):
    (tmp_path / "file").write_text("precious")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "file")
    (tmp_path / "dangling").symlink_to(tmp_path / "nothing")
    (tmp_path / "live").symlink_to("/dev/pts")
    for name in ("file", "folder", "link", "dangling", "live"):
        with pytest.raises(PortError, match=f"{name}: already there, and not a left-over"):
            DeviceLink(tmp_path / name, "/dev/pts/7")
    assert (tmp_path / "file").read_text() == "precious"
    assert os.readlink(tmp_path / "dangling") == str(tmp_path / "nothing")


def test_a_place_where_no_link_can_be_made(tmp_path: Path):
    with pytest.raises(PortError, match="no link can be made there"):
        DeviceLink(tmp_path / "missing" / "arm", "/dev/pts/7")


def test_what_somebody_else_put_there_is_not_removed(tmp_path: Path):
    path = tmp_path / "arm"
    link = DeviceLink(path, "/dev/pts/7")
    path.unlink()
    path.symlink_to("/dev/pts/8")
    link.remove()
    assert os.readlink(path) == "/dev/pts/8"
