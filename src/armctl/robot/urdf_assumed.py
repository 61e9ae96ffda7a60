"""What is assumed of an arm from a URDF file: what the file leaves open, and what armctl takes otherwise."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics import DHChain
from armctl.kinematics.yaw_pitch_roll.geometry import recognise
from armctl.robot.urdf_file import UrdfJoint
from armctl.robot.urdf_name import AXES, UrdfName
from armctl.robot.urdf_rounding import Rounding
from armctl.robot.urdf_tool import UrdfTool

FloatArray = NDArray[np.float64]
ASSUMED_SPEED = math.radians(60)
"""[rad/s]"""
_UNSEEN = 1e-9
"""a shift of the tool that is not worth a word [m]"""
_ALONG = math.cos(math.radians(1))
"""cosine from which on two directions are the same to somebody who looks at the arm"""
_LEANS = 1e-6
"""angle from which on a base is not upright [rad]"""
_SHORTEST = 1e-6
"""length from which on a link has a direction [m]"""


def assumed_of(
    name: UrdfName, tool: UrdfTool, chain: list[UrdfJoint], names: list[str], dh: DHChain
) -> tuple[str, ...]:
    """The assumptions, a sentence each.

    Args:
        name: what was asked for.
        tool: the tool link.
        chain: the joints from the root to the tool, fixed ones among them.
        names: of the moving ones among them.
        dh: the same chain as rows.
    """
    moving = [joint for joint in chain if joint.kind != "fixed"]
    return (
        *_tool(name, tool),
        *_approach(name, tool, names, dh),
        *_leaning(names, dh),
        *_held(chain),
        *_rounding(chain),
        *_numbers(moving, names),
    )


def _tool(name: UrdfName, tool: UrdfTool) -> Iterable[str]:
    if name.link is None:
        out = (
            f"; taken for the gripper's own and left out: {', '.join(tool.left_out)}" if tool.left_out else ""
        )
        yield f"the tool is the link {tool.link}, {tool.why}{out} (another: {name.path.name}#LINK)"


def _approach(name: UrdfName, tool: UrdfTool, names: list[str], dh: DHChain) -> Iterable[str]:
    """Frames of ROS often have x ahead, where armctl takes z."""
    ahead = _ahead(dh)
    if ahead is None or name.approach != "z":
        return
    along = dh.forward(np.zeros(dh.n))[:3, :3].T @ ahead.direction
    axes = [axis for axis, (sign, k) in AXES.items() if (-along[k] if sign else along[k]) > _ALONG]
    if not axes or axes == ["z"]:
        return
    geometry = recognise(dh)
    none = ", so that no pitch can be asked for" if geometry and geometry.tool_angle is None else ""
    where = f"along the axis of {names[-1]}" if ahead.rolls else "along the last link"
    yield (
        f"pitch is the elevation of the tool's z axis; in the link {tool.link} not z but {axes[0]} points "
        f"ahead, {where}{none} ({name.path.name}#{tool.link},approach={axes[0]} takes {axes[0]} for z)"
    )


@dataclass(frozen=True, slots=True)
class _Ahead:
    """The direction that the tool points in by the arm's build, all joints at zero."""

    direction: FloatArray
    """(3,) unit vector, base frame"""
    rolls: bool
    """it is the axis of the last joint, which rolls the tool; else the last link's"""


def _ahead(dh: DHChain) -> _Ahead | None:
    """Where the tool points; None where the arm ends on the axis of a joint that does not roll."""
    points, axes = dh.axes()
    tip, last = dh.forward(np.zeros(dh.n))[:3, 3], axes[-1]
    if dh.n > 1 and np.linalg.norm(np.cross(last, axes[-2])) > math.sin(math.acos(_ALONG)):
        outward = float((tip - points[-2]) @ last)
        return _Ahead(last * math.copysign(1.0, outward), rolls=True)
    link = tip - points[-1]
    across = link - (link @ last) * last
    length = float(np.linalg.norm(across))
    return _Ahead(across / length, rolls=False) if length > _SHORTEST else None


def _leaning(names: list[str], dh: DHChain) -> Iterable[str]:
    geometry = recognise(dh)
    if geometry is None:
        return
    lean = math.atan2(float(np.hypot(*geometry.frame[:2, 2])), float(geometry.frame[2, 2]))
    if lean > _LEANS:
        yield (
            f"pitch is measured from the plane that the axis of {names[0]} stands on, not from the "
            f"horizontal: that axis leans by {math.degrees(lean):.1f}° in the root frame"
        )


def _held(chain: list[UrdfJoint]) -> Iterable[str]:
    held = [
        f"{joint.name} at {math.degrees(joint.held_at):.1f}°" for joint in chain if joint.held_at is not None
    ]
    if held:
        yield f"fixed, as both limits are the same: {', '.join(held)}"


def _rounding(chain: list[UrdfJoint]) -> Iterable[str]:
    total, shift, reach = Rounding(), 0.0, 0.0
    for joint in reversed(chain):
        total += joint.rounding
        shift += joint.rounding.shift * reach
        reach += float(np.linalg.norm(joint.origin[:3, 3]))
    if shift < _UNSEEN:
        return
    parts: list[str] = []
    if total.quarters:
        kinds = ", ".join(sorted(set(total.quarters)))
        parts.append(f"{_count(len(total.quarters), 'angle')} written as rounded quarter turns ({kinds})")
    if total.zeros:
        parts.append(f"{_count(total.zeros, 'number')} below 1e-6 written for zero")
    yield f"exact: {' and '.join(parts)}; the tool moves by at most {1000 * shift:.2g} mm"


def _count(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _numbers(moving: list[UrdfJoint], names: list[str]) -> Iterable[str]:
    endless = [name for name, joint in zip(names, moving, strict=True) if joint.kind == "continuous"]
    if endless:
        yield f"limits of ±180° of the continuous joints: {', '.join(endless)}"
    pairs = [(name, joint.limit) for name, joint in zip(names, moving, strict=True)]
    slow = [name for name, limit in pairs if limit is None or limit.velocity == 0]
    if slow:
        yield f"a speed of 60°/s of joints without one: {', '.join(slow)}"
    yield "accelerations: full speed within 1/6 s"
    yield "home and rest poses: all joints at zero, or at the limit next to it"
    yield "the floor, at the height of the base frame"
