"""Looks: nothing floats; random ones are drawn as closed solids; what is wrong with one is told."""

from __future__ import annotations

import os
import pickle
from collections import Counter
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from armctl.arrays import FloatArray
from armctl.errors import RobotFileError
from armctl.kinematics.samples import joint_samples
from armctl.robot import Robot, load_robot, robots_folder, shipped_robots
from armctl.robot.body.hulls import distances
from armctl.robot.draft import BUILDS, Draft
from armctl.robot.look.pieces import MASSES_ASSUMED, Piece, masses
from armctl.robot.look.rows import MAKES, PAINTS, Material
from armctl.robot.look.solids import Part
from armctl.robot.look_sound import STRETCHED_M, Solids, faults, stretched
from armctl.robot.record import robot_record

_LONG = bool(os.environ.get("ARMCTL_LONG"))
POSES, LOOKS = (200, 300) if _LONG else (5, 10)


@pytest.mark.parametrize("name", shipped_robots())
def test_shipped_looks_are_sound(name: str) -> None:
    robot = load_robot(name)
    q, openings = joint_samples(robot.limits, POSES), np.random.default_rng(3).random(POSES)
    assert [fault.what for fault in faults(robot, 2)] == []
    assert Solids(robot).floating(q, openings) == [set()] * POSES
    assert max(stretched(robot, q).values(), default=0.0) < STRETCHED_M


# Looks made by chance.


def _arm(rng: Random) -> Draft:
    build = rng.choice(BUILDS)
    return Draft.of_build("made", "Made", build, {one.key: rng.uniform(30, 200) for one in build.lengths})


def _look(rng: Random, arm: Draft) -> dict[str, Any]:
    links = [str(row.get("joint") or row["link"]) for row in _rows(arm) if {"joint", "link"} & row.keys()]
    return {
        "pose_deg": [rng.uniform(-90, 90) for _ in arm.joints],
        "solids": [_row(rng, links) for _ in range(rng.randint(1, 12))],
    }


def _rows(arm: Draft) -> list[dict[str, Any]]:
    table: Any = arm.table
    return table["dh"]["rows"]


def _point(rng: Random, size: float = 100) -> list[float]:
    return [rng.uniform(-size, size) for _ in range(3)]


def _row(rng: Random, links: list[str]) -> dict[str, Any]:
    solid = rng.choice(("box", "tube", "bar", "plate", "bracket", "rod", "motor"))
    row: dict[str, Any] = {"solid": solid, "color": rng.choice(PAINTS)}
    if rng.random() < 0.8:
        row["joint"] = rng.choice(links)
    if rng.random() < 0.3:
        row["mirror"] = rng.choice("xyz")
    if rng.random() < 0.2 and solid != "rod":
        row |= {"open_deg": rng.uniform(-90, 90), "axis": _point(rng, 1), "hinge_mm": _point(rng)}
    if rng.random() < 0.2:
        row["open_mm"] = _point(rng, 30)
    if rng.random() < 0.1 and "joint" in row:
        row["turns_with"] = rng.choice(links)
    width = rng.choice((rng.uniform(2, 40), [rng.uniform(2, 40), rng.uniform(2, 40)]))
    thick = rng.uniform(0.5, 12)
    match solid:
        case "box":
            row |= {"size_mm": [rng.uniform(2, 80) for _ in range(3)], "at_mm": _point(rng)}
            row |= {
                "turn_deg": _point(rng, 180),
                **({"edge_mm": rng.uniform(0, 9)} if rng.random() < 0.3 else {}),
            }
        case "tube":
            row |= {"from_mm": _point(rng), "to_mm": _point(rng), "width_mm": width}
            row["ends"] = rng.choice(("flat", "round"))
        case "bar":
            row |= {"from_mm": _point(rng), "to_mm": _point(rng), "width_mm": width, "thick_mm": thick}
            row["face"] = rng.choice(("x", "-y", _point(rng, 1)))
        case "bracket":
            row |= {"to_mm": _point(rng), "width_mm": 2 * thick + rng.uniform(1, 40), "thick_mm": thick}
            row |= {"deep_mm": rng.uniform(2, 40), "face": rng.choice(("x", "y", "z"))}
        case "plate":
            turns = sorted(rng.uniform(0, 2 * np.pi) for _ in range(rng.randint(2, 8)))
            turns = [0.0, 2.0, 4.0, *turns]
            star = [
                [r * np.cos(t), r * np.sin(t)] for t, r in ((t, rng.uniform(10, 60)) for t in sorted(turns))
            ]
            row |= {"outline_mm": star, "thick_mm": thick, "at_mm": _point(rng), "face": rng.choice("xyz")}
        case "rod":
            row |= {"from_mm": _point(rng), "to_mm": _point(rng), "to_joint": rng.choice(links)}
            row |= {"width_mm": width, **({"thick_mm": thick} if rng.random() < 0.5 else {})}
        case _:
            shaft, case = rng.sample("xyz", 2)
            row |= {"make": rng.choice(list(MAKES)), "shaft": f"-{shaft}", "case": case, "at_mm": _point(rng)}
    return row


@pytest.mark.parametrize("seed", range(LOOKS))
def test_a_random_look_is_drawn_as_closed_solids(seed: int) -> None:
    rng = Random(seed)
    arm = _arm(rng)
    look = _look(rng, arm)
    robot = arm.changed(look=look).robot()
    assert {piece.row for piece in robot.pieces} == set(range(len(look["solids"])))
    for row, said in enumerate(look["solids"]):
        _check_row([piece for piece in robot.pieces if piece.row == row], said)
    body = robot.gripping(rng.random()).collision
    assert len(body.capsules) > 0
    assert np.isfinite(body.gaps(body.frames(joint_samples(robot.limits, 3)))).all()
    assert all(fault.what for fault in faults(robot, 2))


def _check_row(pieces: list[Piece], said: dict[str, Any]) -> None:
    assert pieces
    for piece in pieces:
        assert piece.part
        for part in piece.parts:
            _check_closed(part)
    first = next(piece for piece in pieces if any(part.corners for part in piece.parts))
    same = [piece for piece in pieces if piece.mount is first.mount and piece.jaw is first.jaw]
    drawn = np.concatenate([part.solid.vertices for piece in same for part in piece.parts])
    kept = [corners for piece in same for part in piece.parts for corners in part.corners]
    wide = 1e-3 * max(np.ravel([*np.ravel(said.get("width_mm", 0.0)), said.get("deep_mm", 0.0)]).tolist())
    beside = np.min([distances(one, drawn) for one in kept], axis=0)
    assert beside.max() < 2.5e-4 + 0.04 * wide  # a circle of fourteen sides, a dome of three rings
    assert distances(drawn, np.concatenate(kept)).max() < 2.4e-3 + 0.04 * wide  # without bevels


def _check_closed(part: Part) -> None:
    """Each edge belongs to two faces that go round the same way, and the volume is positive."""
    vertices, faces = part.solid.vertices, part.solid.faces
    edges = Counter(
        (a, b) for face in faces.tolist() for a, b in zip(face, [*face[1:], face[0]], strict=True)
    )
    assert max(edges.values()) == 1
    assert all((b, a) in edges for a, b in edges)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    assert _volume(a, b, c) > 0


def _volume(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    return float(np.einsum("ki,ki->", a, np.cross(b, c)))


# Rows that are wrong: each is told with its row, field, value, and what is allowed.

_BAR = {"solid": "bar", "joint": "elbow", "to_mm": [50, 0, 0], "width_mm": 9, "thick_mm": 4, "color": "red"}
_MOTOR = {"solid": "motor", "make": "micro", "shaft": "y", "case": "x"}
_PLATE = {"solid": "plate", "outline_mm": [[0, 0], [9, 0], [9, 9]], "thick_mm": 2, "color": "red"}
_ROD = {"solid": "rod", "to_joint": "elbow", "width_mm": 3, "color": "red"}
_BOX = {"solid": "box", "size_mm": [1, 2, 3], "color": "red"}
WRONG: list[tuple[dict[str, Any], str, object, tuple[str, ...]]] = [
    (_BAR, "solid", "baar", ("'baar'", "'bar'", "'motor'")),
    (_BAR, "color", "pink", ("'pink'", "'graphite'")),
    (_BAR, "joint", "elbo", ("'elbo'", "shoulder, elbow, wrist")),
    (_BAR, "joint", 4, ("text", "4")),
    (_BAR, "turns_with", "elbo", ("'elbo'", "shoulder, elbow, wrist")),
    (_BAR, "width_mm", 0, ("more than 0", "not 0")),
    (_BAR, "width_mm", [9, -2], ("more than 0", "-2")),
    (_BAR, "width_mm", [9, 9, 9], ("2 values", "[9, 9, 9]")),
    (_BAR, "width_mm", "9", ("a number", "'9'")),
    (_BAR, "thick_mm", -4, ("more than 0", "-4")),
    (_BAR, "thick_mm", None, ("missing",)),
    (_BAR, "to_mm", [50, 0], ("3 values", "[50, 0]")),
    (_BAR, "to_mm", [50, 0, float("nan")], ("nan",)),
    (_BAR, "to_mm", [0, 0, 0], ("the same place", "to_mm")),
    (_BAR, "to", "tool", ("not both",)),
    (_BAR, "from", "toool", ("'toool'", "elbow", "tool")),
    (_BAR, "face", "up", ("'up'", "'x'", "'-z'")),
    (_BAR, "face", [0, 0, 0], ("0, 0, 0",)),
    (_BAR, "mirror", "w", ("'w'", "'x', 'y', 'z'")),
    (_BAR, "open_mm", 3, ("a list", "3")),
    (_BAR, "open_deg", 1000, ("-720 … 720", "1000")),
    (_BAR, "axis", [0, 0, 0], ("0, 0, 0",)),
    (_BAR, "hinge_mm", [1], ("3 values", "[1]")),
    (_BAR, "body", "no", ("true or false", "'no'")),
    (_BAR, "name", "", ("at least 1 character", "''")),
    (_BAR, "colour", 3, ("unknown", "'color'")),
    (_MOTOR, "make", "futaba", ("'futaba'", "'sts3215'")),
    (_MOTOR, "case", "y", ("across the shaft", "'y'")),
    (_MOTOR, "shaft", [0, 0, 0], ("0, 0, 0",)),
    (_PLATE, "outline_mm", [[0, 0], [9, 0]], ("at least 3 values",)),
    (_PLATE, "outline_mm", [[0, 0], [9, 0], [20, 0]], ("no area",)),
    (_PLATE, "outline_mm", [[0, 0], [9, 9], [9, 0], [0, 12]], ("crosses itself",)),
    (_PLATE, "face", "-y", ("'-y'", "'x', 'y', 'z'")),
    (_ROD, "to_joint", "elbo", ("'elbo'", "shoulder, elbow, wrist")),
    (_ROD, "to_joint", None, ("missing",)),
    (_BOX, "size_mm", [1, 2, 0], ("more than 0", "0")),
    (_BOX, "edge_mm", -1, ("0 … 10000", "-1")),
    (_BOX, "turn_deg", [1, 2], ("3 values",)),
    ({**_BAR, "solid": "tube"} | {"thick_mm": None}, "ends", "oval", ("'oval'", "'flat', 'round'")),
    (
        {"solid": "bracket", "to_mm": [9, 0, 0], "width_mm": 9, "deep_mm": 5, "color": "red"},
        "thick_mm",
        5,
        ("two cheeks of 5 mm", "9"),
    ),
]  # fmt: skip


@pytest.mark.parametrize(("right", "key", "value", "words"), WRONG)
def test_a_wrong_row_is_told(right: dict[str, Any], key: str, value: object, words: tuple[str, ...]) -> None:
    arm = Draft.of_build("made", "Made", BUILDS[1], {})
    row = {name: one for name, one in (right | {key: value}).items() if one is not None}
    with pytest.raises(RobotFileError) as refused:
        arm.changed(look={"solids": [_BOX, row]}).robot()
    said = str(refused.value)
    assert "look.solids, row 2" in said
    assert key in said
    for word in words:
        assert word in said


# What ``armctl check`` says of a look.


def _told(*rows: dict[str, Any]) -> list[tuple[int | None, str]]:
    foot = {"solid": "tube", "to_mm": [0, 0, 80], "width_mm": 50, "color": "grey"}
    arm = Draft.of_build("made", "Made", BUILDS[1], {}).changed(
        look={"pose_deg": [0, 90, 0, 0], "solids": [foot, *rows]}
    )
    robot = arm.with_pose("home", [0, 90, 0, 0]).with_pose("rest", [0, 90, 0, 0]).robot()
    return [(fault.row, fault.what) for fault in faults(robot)]


UPPER = {"solid": "tube", "joint": "shoulder", "to": "elbow", "width_mm": 30, "color": "red"}
REST = {"solid": "tube", "joint": "elbow", "to": "tool", "width_mm": 20, "color": "red"}
CUBE = {"solid": "box", "joint": "elbow", "size_mm": [9, 9, 9], "color": "red"}


def test_a_sound_look_has_no_faults() -> None:
    assert _told(UPPER, REST) == []


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({**CUBE, "at_mm": [0, 60, 0]}, "floats"),
        ({**CUBE, "at_mm": [0, 0, 9]}, "is inside"),
        ({"solid": "box", "size_mm": [9, 9, 90], "color": "red"}, "45.0 mm below the floor"),
        (
            {**_ROD, "joint": "shoulder", "to_mm": [0, 0, 40]},
            "changes its length",
        ),
        (
            {**_ROD, "joint": "shoulder", "from_mm": [0, 60, 0], "to_mm": [0, 60, 0]},
            "its pin at shoulder is in the air",
        ),
        ({**CUBE, "at_mm": [0, 14, 0], "open_mm": [0, 10, 0]}, "opens with a gripper, but the arm has none"),
        ({**CUBE, "joint": "base", "at_mm": [0, 0, 40]}, "is inside row 1"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_row_is_told(row: dict[str, Any], words: str) -> None:
    told = _told(UPPER, REST, row)
    assert any(at == 3 and words in what for at, what in told)


@pytest.mark.parametrize(("way", "wrong"), [(10, False), (-10, True), (-60, True)])
def test_jaws_that_close_while_the_gripper_opens_are_told(way: float, wrong: bool) -> None:
    jaw = {**CUBE, "at_mm": [0, 14, 0], "open_mm": [0, way, 0], "mirror": "y"}
    arm = Draft.of_build("made", "Made", BUILDS[1], {}).changed(
        gripper={"title": "Hand", "speed_percent_s": 100}, look={"solids": [UPPER, REST, jaw]}
    )
    said = [fault.row for fault in faults(arm.robot()) if "closes while" in fault.what]
    assert said == ([2] if wrong else [])


def test_an_arm_that_ends_before_its_tool_or_hangs_in_the_air_is_told() -> None:
    assert any("the tool point" in what for _, what in _told(UPPER))
    assert any("above the floor" in what for _, what in _raised())


def _raised() -> list[tuple[int | None, str]]:
    foot = {"solid": "tube", "from_mm": [0, 0, 20], "to_mm": [0, 0, 80], "width_mm": 50, "color": "grey"}
    robot: Robot = Draft.of_build("made", "Made", BUILDS[1], {}).changed(look={"solids": [foot]}).robot()
    return [(fault.row, fault.what) for fault in faults(robot, 1)]


@pytest.mark.parametrize("name", ["scorbot", "mearm"])
def test_an_arm_process_knows_the_arm_it_was_started_with(name: str) -> None:
    """Copied to another process, an arm is told in the same words; else an arm that is held is not found."""
    robot = load_robot(name)
    assert robot_record(pickle.loads(pickle.dumps(robot))) == robot_record(robot)


# What they weigh.

PUBLISHED = ("so100", "so101", "ur5", "pincherx100", "open_manipulator_x", "ar4")


@pytest.mark.parametrize("name", PUBLISHED)
def test_weights_of_a_look_load_the_large_joints_as_published_ones_do(name: str) -> None:
    """Shoulder and elbow, which nearly all that an arm weighs loads; a wrist's torque is a tenth of it."""
    robot = load_robot(name)
    material: Material = "casting" if name == "ur5" else "printed"
    bodies = masses(robot.chain, robot.look.rows, robot.pieces, material)
    q = np.random.default_rng(1).uniform(*robot.limits.T, (500, robot.n))
    true = replace(robot.gravity, payload_kg=0.0).torque(q)
    told = replace(robot.gravity, bodies=bodies, payload_kg=0.0).torque(q)
    rms, off = (np.sqrt(np.mean(one**2, axis=0)) for one in (true, told - true))
    large = rms > 0.4 * rms.max()
    assert large.sum() >= 1 and (off[large] < 0.25 * rms[large]).all()


def test_an_arm_whose_file_gives_no_masses_has_those_of_its_look(tmp_path: Path) -> None:
    text = Draft.of_build("mine", "Mine", BUILDS[1], {}).text()
    file, plain = tmp_path / "mine.toml", tmp_path / "plain.toml"
    box = 'joint = "wrist", solid = "box", size_mm = [100, 10, 10], at_mm = [45, 0, 0], color = "red"'
    motor = 'joint = "shoulder", solid = "motor", make = "standard", shaft = "y", case = "-x"'
    servo = f"{motor}, at_mm = [100, 0, 0]"
    file.write_text(f'{text}\n[look]\nmaterial = "aluminium"\nsolids = [{{ {box} }}, {{ {servo} }}]\n')
    plain.write_text(text)
    robot = load_robot(file)
    assert MASSES_ASSUMED in robot.assumed and not load_robot(plain).gravity.weighs
    bar, motor = robot.gravity.bodies
    assert bar.mass_kg == pytest.approx(2.7 * 0.01, rel=0.03)  # its edges are bevelled
    assert motor.mass_kg == MAKES["standard"].mass_kg
    weight = 9.81 * (bar.mass_kg * (0.12 + 0.11 + 0.045) + motor.mass_kg * 0.09)  # its case lies back
    assert robot.gravity.torque(np.zeros(4))[1] == pytest.approx(weight, rel=0.02)


def test_a_joint_may_have_the_title_of_a_link(tmp_path: Path) -> None:
    text = (robots_folder() / "uarm.toml").read_text()
    file = tmp_path / "uarm.toml"
    file.write_text(text.replace('title = "Hand turn"', 'title = "Hand"'))
    other = load_robot(file)
    assert "Hand" in [joint.title for joint in other.joints]
    assert other.link_names == load_robot("uarm").link_names and list(faults(other, 2)) == []
