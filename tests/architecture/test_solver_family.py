"""A new solver family is a class of its own and one line in the registry."""

from __future__ import annotations

import ast
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Self

import numpy as np
import pytest
from click.testing import CliRunner

import armctl
from armctl.arrays import FloatArray
from armctl.cli.kinematics import ik
from armctl.kinematics import Chain, EnergyModel, InverseKinematics, Solutions, Target, families
from armctl.kinematics.solutions import SolvedArm

SOURCES = Path(armctl.__file__).parent
PLOTTER = """
format = 1
name = "plotter"
title = "Two links on a table"

[dh]
convention = "standard"
rows = [
    { a_mm = 300, alpha_deg = 0, d_mm = 0, joint = "shoulder" },
    { a_mm = 200, alpha_deg = 0, d_mm = 0, joint = "elbow" },
]

[[joints]]
name = "shoulder"
title = "Shoulder"
limit_deg = [-170, 170]
speed_deg_s = 60
acceleration_deg_s2 = 180

[[joints]]
name = "elbow"
title = "Elbow"
limit_deg = [-150, 150]
speed_deg_s = 60
acceleration_deg_s2 = 180

[poses]
home = [0, 90]
rest = [0, 120]
zero = [0, 0]
"""


class TwoLinks(InverseKinematics):
    """Two parallel joints about z: the planar triangle."""

    family = "two links in a plane"

    @classmethod
    def of(cls, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> Self | None:
        _, axes = chain.axes()
        flat = chain.n == 2 and np.allclose(axes, [[0.0, 0.0, 1.0]] * 2)
        return cls(chain, limits, energy, titles) if flat else None

    def solve(self, target: Target, step: float, start: FloatArray | None = None) -> Solutions:
        arm = SolvedArm(("left", "right"), self.chain, self.energy)
        points, _ = self.chain.axes()
        tip = self.chain.forward(np.zeros(2))[:3, 3]
        a, b = np.linalg.norm(points[1] - points[0]), np.linalg.norm(tip - points[1])
        x, y, z = target.point
        cosine = (x * x + y * y - a * a - b * b) / (2 * a * b)
        if abs(cosine) > 1.0 or abs(z) > 1e-9:
            straight = np.array([math.atan2(y, x), 0.0])
            return Solutions(arm, target, (), (), reason="off the table", nearest_q=straight)
        found: list[tuple[float, float]] = []
        for bend in (math.acos(cosine), -math.acos(cosine)):
            first = math.atan2(y, x) - math.atan2(b * math.sin(bend), a + b * math.cos(bend))
            found.append((math.remainder(first, math.tau), bend))
        kept = [k for k, q in enumerate(found) if self._inside(q)]
        return Solutions(arm, target, [found[k] for k in kept], kept)

    def _inside(self, q: tuple[float, float]) -> bool:
        return all(low <= angle <= high for angle, (low, high) in zip(q, self.limits, strict=True))


@pytest.fixture
def plotter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A robot file of an arm that no family of armctl solves in closed form, and the line that adds one."""
    monkeypatch.setattr(families, "FAMILIES", (TwoLinks, *families.FAMILIES))
    path = tmp_path / "plotter.toml"
    path.write_text(PLOTTER)
    return path


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
