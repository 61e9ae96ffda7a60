"""What the limits of a URDF joint say: how far it turns, or that it does not turn at all."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from armctl.errors import RobotFileError
from armctl.robot.urdf_file import UrdfJoint
from armctl.robot.urdf_rounding import exact_rotation
from armctl.robot.urdf_rows import frame_along

WIDEST = 4 * math.pi
"""no limit of a joint is farther from zero [rad]"""


def limits_of(joint: UrdfJoint, path: Path) -> tuple[float, float]:
    """Lower and upper limit [rad] of a turning joint; ±180° of a continuous one.

    Raises:
        RobotFileError: a revolute joint without limits, or with some that cannot be meant.
    """
    if joint.kind == "continuous":
        return -math.pi, math.pi
    where, limit = f'{path}: <joint name="{joint.name}">', joint.limit
    if limit is None:
        raise RobotFileError(f"{where}: <limit> is missing; a revolute joint needs lower and upper")
    lower, upper = limit.lower, limit.upper
    if not -WIDEST <= lower <= upper <= WIDEST:
        degrees = " (they look like degrees)" if max(abs(lower), abs(upper)) > WIDEST else ""
        raise RobotFileError(
            f"{where}: <limit lower={lower} upper={upper}>: the lower limit comes first, "
            f"both in radians within ±{WIDEST:.2f}{degrees}"
        )
    if lower == upper == 0.0:  # exporters write that where nobody has filled the limits in
        raise RobotFileError(
            f"{where}: <limit lower={lower} upper={upper}>: both are 0, which is also what is read where "
            "they are not written; write the angles that the joint may take, or make it "
            'type="fixed" if it does not turn'
        )
    return lower, upper


def fixed_where_held(joint: UrdfJoint, path: Path) -> UrdfJoint:
    """The joint itself, or a fixed one at the one angle that its limits leave it.

    Raises:
        RobotFileError: as ``limits_of``.
    """
    if joint.kind == "fixed":
        return joint
    lower, upper = limits_of(joint, path)
    if lower < upper:
        return joint
    turn, rounding = exact_rotation(["0", "0", repr(lower)])
    along, held = frame_along(joint.axis), np.eye(4)
    held[:3, :3] = along[:3, :3] @ turn @ along[:3, :3].T
    return replace(
        joint, kind="fixed", origin=joint.origin @ held, rounding=joint.rounding + rounding, held_at=lower
    )
