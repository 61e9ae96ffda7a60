"""URDF files written from steps, and the product of transforms that the same steps say."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray

ROUNDED = {
    "1.5708": math.pi / 2,
    "-1.5708": -math.pi / 2,
    "1.57079": math.pi / 2,
    "3.14159": math.pi,
    "-3.1416": -math.pi,
    "-9.38083e-08": 0.0,
    "2.77556e-17": 0.0,
}
"""angles as exporters write them, and what was meant"""


@dataclass(frozen=True)
class Step:
    """One joint with the link that it carries."""

    joint: str
    kind: str
    parent: str
    child: str
    xyz: str = "0 0 0"
    rpy: str = "0 0 0"
    axis: str = "0 0 1"
    limits: tuple[float, float] = (-2.5, 2.5)
    mimics: str = ""

    @property
    def xml(self) -> str:
        """The joint's element."""
        mimic = f'<mimic joint="{self.mimics}"/>' if self.mimics else ""
        return (
            f'<joint name="{self.joint}" type="{self.kind}"><origin xyz="{self.xyz}" rpy="{self.rpy}"/>'
            f'<parent link="{self.parent}"/><child link="{self.child}"/><axis xyz="{self.axis}"/>'
            f'<limit lower="{self.limits[0]}" upper="{self.limits[1]}" effort="1" velocity="2"/>'
            f"{mimic}</joint>"
        )


def written(path: Path, steps: Sequence[Step]) -> Path:
    """A file of these joints and their links."""
    links = dict.fromkeys(link for step in steps for link in (step.parent, step.child))
    body = "".join(f'<link name="{link}"/>' for link in links) + "".join(step.xml for step in steps)
    path.write_text(f'<robot name="arm">{body}</robot>')
    return path


def turn(axis: ArrayLike, angle: float) -> FloatArray:
    """(4, 4) by Rodrigues' formula; the axis may have any length."""
    x, y, z = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    T = np.eye(4)
    T[:3, :3] += math.sin(angle) * K + (1 - math.cos(angle)) * K @ K
    return T


def product(steps: Sequence[Step], tool: str, q: ArrayLike, exact: Mapping[str, float]) -> FloatArray:
    """Pose (4, 4) of a link: origin, turn, origin, turn … from the root down.

    Args:
        steps: of the file.
        tool: the link.
        q: of the turning joints on the way, in radians.
        exact: what numbers in ``rpy`` mean that do not mean themselves.
    """
    into = {step.child: step for step in steps}
    way: list[Step] = []
    while tool in into:
        way.insert(0, into[tool])
        tool = way[0].parent
    angles = iter(np.asarray(q, dtype=np.float64).tolist())
    pose = np.eye(4)
    for step in way:
        shift = np.eye(4)
        shift[:3, 3] = [float(part) for part in step.xyz.split()]
        roll, pitch, yaw = (exact.get(part, float(part)) for part in step.rpy.split())
        pose = pose @ shift @ turn([0, 0, 1], yaw) @ turn([0, 1, 0], pitch) @ turn([1, 0, 0], roll)
        if step.kind != "fixed":
            pose = pose @ turn([float(part) for part in step.axis.split()], next(angles))
    assert next(angles, None) is None
    return pose
