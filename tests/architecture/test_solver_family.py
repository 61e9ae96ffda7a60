"""A new solver family is a class of its own and one line in the registry."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import pytest
from click.testing import CliRunner
from examples.extending.family import TwoLinks

import armctl
from armctl.cli.kinematics import ik
from armctl.kinematics.families import registry as families

SOURCES = Path(armctl.__file__).parent
PLOTTER = Path(__file__).parents[2] / "examples" / "extending" / "plotter.toml"


@pytest.fixture
def plotter(monkeypatch: pytest.MonkeyPatch) -> Path:
    """A robot file of an arm that no family of armctl solves in closed form, and the line that adds one."""
    monkeypatch.setattr(families, "FAMILIES", (TwoLinks, *families.FAMILIES))
    return PLOTTER


def test_a_new_family_answers_ik(plotter: Path) -> None:
    answer = CliRunner().invoke(ik, [str(plotter), "300", "200", "0", "--all", "--json"])
    assert answer.exit_code == 0, answer.output
    told = json.loads(answer.stdout)
    assert told["count"] == 2
    assert told["solutions_deg"][0] == pytest.approx([0.0, 90.0], abs=1e-6)
    assert sorted(q[1] for q in told["solutions_deg"]) == pytest.approx([-90.0, 90.0], abs=1e-6)
    assert told["branch"] in ("left", "right")

    refused = CliRunner().invoke(ik, [str(plotter), "600", "0", "0", "--json"])
    told = json.loads(refused.stdout)
    assert told["reason"] == "off the table"
    assert told["nearest_mm"] == pytest.approx([500.0, 0.0, 0.0], abs=1e-6)


def test_what_the_family_leaves_out_has_an_answer(plotter: Path) -> None:
    robot = armctl.load_robot(plotter)
    solver = robot.inverse_kinematics
    assert isinstance(solver, TwoLinks)
    assert (solver.pitch_joints, solver.free_joint, solver.roll_joint, solver.plane) == ((), None, None, None)
    assert [branch.name for branch in robot.branches([0.3, 0.2, 0.0])] == ["left", "right"]
    assert not solver.section().exact
    with pytest.raises(armctl.errors.InputError, match="two links in a plane"):
        robot.inverse_batch([[0.3, 0.2, 0.0]])
    with pytest.raises(armctl.errors.InputError, match="two links in a plane"):
        robot.least_rotation([0.3, 0.2, 0.0])


def test_arms_of_the_other_families_keep_theirs(plotter: Path) -> None:
    told = [armctl.load_robot(name).inverse_kinematics.family for name in ("uzuner", "humanoid")]
    assert told == ["yaw, parallel pitch joints, roll", "spherical shoulder, elbow, roll"]


def test_nobody_outside_kinematics_asks_what_kind_a_solver_is() -> None:
    asked: list[str] = []
    for path in SOURCES.rglob("*.py"):
        if SOURCES / "kinematics" in path.parents:
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            called = isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
            if called and node.func.id == "isinstance" and "Solver" in ast.unparse(node.args[1]):
                asked.append(f"{path.relative_to(SOURCES)}:{node.lineno}")
    assert asked == []
