"""What is made of meshes is kept by content, and nothing that is wrong with an entry does harm."""

from __future__ import annotations

import hashlib
import os
import pickle
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from armctl.robot import Robot, load_robot
from armctl.robot.body import fitting
from armctl.robot.body import meshes as mesh_cache
from armctl.robot.body.arm_body import ArmBody
from armctl.robot.body.meshes import Drawn, coarse_solids

BOX = "".join(f"v {x} {y} {z}\n" for x in (0, 0.1) for y in (0, 0.1) for z in (0, 0.2))
FACES = "f 1 2 4 3\nf 5 6 8 7\nf 1 2 6 5\nf 3 4 8 7\nf 1 3 7 5\nf 2 4 8 6\n"
URDF = (
    '<robot name="post"><link name="base"/><link name="tip"><visual><geometry>'
    '<mesh filename="box.obj"/></geometry></visual></link><joint name="turn" type="revolute">'
    '<parent link="base"/><child link="tip"/><axis xyz="0 0 1"/><origin xyz="0 0 0.1"/>'
    '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
)


@pytest.fixture(autouse=True)
def entries(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the entries, empty."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return mesh_cache.folder()


def arm(folder: Path, box: str = BOX) -> Robot:
    folder.mkdir(exist_ok=True)
    (folder / "box.obj").write_text(box + FACES)
    (folder / "arm.urdf").write_text(URDF)
    return load_robot(folder / "arm.urdf")


def made(robot: Robot) -> tuple[Robot, int]:
    """The arm with its body, and how often this was worked out."""
    count = 0

    def counted(*given: object) -> ArmBody:
        nonlocal count
        count += 1
        return fit(*given)  # type: ignore[arg-type]

    fit = fitting.fitted_body
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fitting, "fitted_body", counted)
        return robot.with_body(), count


def test_an_arm_is_worked_out_once_wherever_it_lies(tmp_path: Path) -> None:
    first, count = made(arm(tmp_path / "here"))
    assert count == 1
    again, count = made(arm(tmp_path / "there"))
    assert count == 0
    assert again.capsules == first.capsules
    assert again.assumed == first.assumed
    assert again.capsules is not None
    assert not again.capsules[0].as_hull.corners.flags.writeable
    # what the body does not depend on
    assert made(replace(arm(tmp_path / "here"), floor_z=-1.0, poses={}, title="another"))[1] == 0


def test_what_it_is_made_of_makes_another_entry(tmp_path: Path) -> None:
    robot = arm(tmp_path / "arm")
    made(robot)
    larger = made(arm(tmp_path / "arm", BOX.replace("0.2", "0.3")))
    assert larger[1] == 1
    moved = replace(robot.shapes[0], pose=robot.shapes[0].pose + np.eye(4, k=3) * 0.01)
    assert made(replace(robot, shapes=(moved,)))[1] == 1
    assert made(replace(robot, look=replace(robot.look, width=2 * robot.look.width)))[1] == 1
    assert len(list(mesh_cache.folder().iterdir())) == 4


def test_another_version_of_the_code_makes_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = arm(tmp_path / "arm")
    made(robot)
    monkeypatch.setattr(mesh_cache, "_code", lambda: b"another")
    assert made(robot)[1] == 1


class _Bomb:
    def __reduce__(self) -> tuple[Callable[[str], int], tuple[str]]:
        return os.system, ("touch unpickled",)


def _sealed(data: bytes) -> bytes:
    return b"armctl meshes\n" + hashlib.sha256(data).digest() + data


def _with_nan(path: Path) -> None:
    whole = msgspec.msgpack.decode(path.read_bytes()[len(_sealed(b"")) :])
    whole["capsules"][0]["start"][2] = np.full(3, np.nan).tobytes()
    path.write_bytes(_sealed(msgspec.msgpack.encode(whole)))


def _flipped(path: Path, at: float) -> None:
    data = bytearray(path.read_bytes())
    data[int(at * (len(data) - 1))] ^= 1
    path.write_bytes(data)


def _link(path: Path) -> None:
    path.rename(path.with_name("elsewhere"))
    path.symlink_to("elsewhere")


HARM: dict[str, Callable[[Path], object]] = {
    "empty": lambda path: path.write_bytes(b""),
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    **{f"a bit at {at}": lambda path, at=at: _flipped(path, at) for at in (0.0, 0.001, 0.5, 1.0)},
    "a pickle": lambda path: path.write_bytes(_sealed(pickle.dumps(_Bomb()))),
    "a pickle alone": lambda path: path.write_bytes(pickle.dumps(_Bomb())),
    "something else": lambda path: path.write_bytes(_sealed(msgspec.msgpack.encode({"capsules": 3}))),
    "no number": _with_nan,
    "writable by others": lambda path: path.chmod(0o666),
    "a link": _link,
}


@pytest.mark.parametrize("harm", HARM.values(), ids=HARM)
def test_a_harmed_entry_is_made_anew(
    harm: Callable[[Path], object], tmp_path: Path, entries: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    robot = arm(tmp_path / "arm")
    right, _ = made(robot)
    (entry,) = entries.iterdir()
    harm(entry)
    again, count = made(robot)
    assert count == 1
    assert again == right
    assert not entry.is_symlink()
    assert entry.stat().st_mode & 0o777 == 0o600
    assert entries.stat().st_mode & 0o777 == 0o700
    assert made(robot) == (right, 0)
    assert not (tmp_path / "unpickled").exists()


def test_without_a_place_to_keep_it_an_arm_is_opened_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    robot = arm(tmp_path / "arm")
    assert [made(robot)[1], made(robot)[1]] == [1, 1]


def test_what_cannot_be_read_is_not_kept(tmp_path: Path, entries: Path) -> None:
    robot = arm(tmp_path / "arm")
    (tmp_path / "arm" / "box.obj").unlink()
    assert made(robot)[1] == 1
    assert not entries.exists()
    arm(tmp_path / "arm")
    whole, count = made(robot)
    assert count == 1
    assert not any("passed over" in text for text in whole.assumed)


def test_the_entry_that_was_used_longest_ago_goes(
    tmp_path: Path, entries: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arms = [arm(tmp_path / f"arm{k}", BOX.replace("0.2", f"0.{k}5")) for k in range(3)]
    made(arms[0])
    (first,) = entries.iterdir()
    made(arms[1])
    second = next(one for one in entries.iterdir() if one != first)
    os.utime(first, (1000.0, 1000.0))
    os.utime(second, (2000.0, 2000.0))
    assert made(arms[0])[1] == 0  # now it is the newest
    both = first.stat().st_size + second.stat().st_size
    monkeypatch.setattr(mesh_cache, "MOST_BYTES", both)
    made(arms[2])
    assert first.exists()
    assert not second.exists()
    assert len(list(entries.iterdir())) == 2


def test_drawings_are_kept_too(tmp_path: Path, entries: Path) -> None:
    shapes = arm(tmp_path / "arm").shapes
    drawn = mesh_cache.keep(Drawn, shapes, 500, make=lambda: coarse_solids(shapes, 500))
    shutil.rmtree(tmp_path / "arm")
    assert mesh_cache.kept(Drawn, shapes, 500) is None  # nobody knows what it would be of
    shapes = arm(tmp_path / "arm").shapes
    again = mesh_cache.kept(Drawn, shapes, 500)
    assert again is not None
    assert again[0][:2] == drawn[0][:2]
    assert np.array_equal(again[0][2].faces, drawn[0][2].faces)
    assert mesh_cache.kept(Drawn, shapes, 501) is None
    assert len(list(entries.iterdir())) == 1
