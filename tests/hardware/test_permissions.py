from __future__ import annotations

import grp
import os
from pathlib import Path

import pytest

from armctl.hardware.permissions import may_open, permission_hint


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


def test_may_open_asks_for_both_directions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    device = tmp_path / "ttyACM0"
    assert may_open(str(device)) is False
    device.touch()
    assert may_open(str(device)) is True
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.W_OK)
    assert may_open(str(device)) is False
