"""New steps: the kinds that can be put on the list, by group, and how one is made where the arm is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np

from armctl.errors import StateError
from armctl.motion import usual_pitch
from armctl.program import Step
from armctl.program import steps as registry
from armctl.program.base_steps import keys_of
from armctl.program.conditions import COUNTER
from armctl.program.frames import BASE
from armctl.program.grid_step import CORNERS
from armctl.program.motion_steps import END, RPY, VIA, tool_turn
from armctl.program.standing_steps import EDGES
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.ui.console import present_pose
from armctl.ui.widgets.angle_fields import slider_degrees

Point = tuple[float, float, float]
SET_VIA, ARC = "Set via", "Arc"
_, _ROW, _COLUMN = CORNERS
_TOOL_KEYS = {
    *END,
    *VIA,
    *_ROW,
    *_COLUMN,
    *RPY,
    "joints_deg",
    "pitch_deg",
    "roll_deg",
    "pitch",
    "plane_mm",
}
"""keys whose values are read off where the arm stands"""
_HAND_KEYS = {"open_percent", "close_percent", *EDGES}
_RECORDED = {*_TOOL_KEYS, *_HAND_KEYS, "orientation"} - {*_ROW, "plane_mm"}
"""keys of steps that are recorded by a press of their button, and need nothing more"""
_DIGITS = 3
_HALF_OPEN = 0.5
"""jaws that are no nearer together hold nothing"""
_TIMEOUT_S, _SIDE_MM = 10.0, 50.0
_FIRST: Mapping[str, Any] = {
    "times": 2,
    "rows": 3,
    "columns": 4,
    "seconds": 1.0,
    "percent": 50.0,
    "add": 1,
    "text": "Press OK to go on",
    "timeout_s": _TIMEOUT_S,
}
"""what stands in the fields of a new step at first"""
_NOT_KNOWN = {
    "open_percent": "the gripper has not been told to move yet; press 'Set gripper' first",
    VIA[0]: f"an arc needs a point on its way: bring the tool there and press {SET_VIA!r}, "
    f"then go on to its end and press {ARC!r}",
    "program": "no other program is saved yet; Save one in Files",
    "file": "there is no drawing yet; choose a file in Manual → Drawing",
}


def recorded_kinds(robot: Robot) -> dict[str, dict[str, type[Step]]]:
    """The kinds of steps that can be put on the list of an arm, by group and name."""
    rows: dict[str, dict[str, type[Step]]] = {}
    signals = _signals_here(robot)
    hand = robot.gripper is not None or "output" in signals
    for kind in registry.KINDS:
        if not kind.button or (kind.handles and not hand):
            continue
        group, label, *keys = kind.button
        lacks = {
            "open_percent": robot.gripper is None,
            "output": "output" not in signals,
            "tool": not robot.tools,
        }
        if any(lacks.get(key) for key in keys):
            continue
        rows.setdefault(group, {})[label] = kind
    return rows


def quick_kinds(robot: Robot) -> dict[str, dict[str, type[Step]]]:
    """Those of them with a button of their own: they record where the arm and its gripper are."""
    quick = {
        group: {
            label: kind
            for label, kind in kinds.items()
            if kind.button[2:] and not kind.handles and _RECORDED.issuperset(kind.button[2:])
        }
        for group, kinds in recorded_kinds(robot).items()
    }
    return {group: kinds for group, kinds in quick.items() if kinds}


CELL_GROUP = "In each cell"


def cell_kinds(robot: Robot) -> dict[str, type[Step]]:
    """Those that can be put at the cell of a grid around them: they have one place."""
    kinds = [kind for group in recorded_kinds(robot).values() for kind in group.values()]
    named = [(kind.button[1], kind) for kind in kinds if any(key.name == "frame" for key in keys_of(kind))]
    return {label: kind for label, kind in named if set(END) < set(kind.button) and VIA[0] not in kind.button}


def in_each_cell(step: Step) -> Step:
    """The same at the cell itself, with the pitch that comes of the place."""
    names = {key.name for key in keys_of(type(step))}
    turn = dict.fromkeys(names & {"pitch_deg", "roll_deg", *RPY})
    return msgspec.structs.replace(step, **dict.fromkeys(END, 0.0), **turn, frame="cell")


def step_here(
    kind: type[Step],
    robot: Robot,
    snapshot: Snapshot,
    via_mm: Point | None = None,
    names: Mapping[str, str] | None = None,
) -> Step:
    """A step made where the arm is, the rest of it to be edited; ``StateError``: something is not known.

    ``via_mm``: on an arc. ``names``: by key, of what it may be about, such as a saved ``program``.
    """
    keys = kind.button[2:]
    here: dict[str, Any] = dict(zip(EDGES, snapshot.part_mm or (None, None, None), strict=True))
    here |= {
        **_FIRST,
        "tool": robot.tool,
        "counter": "parts",
        "frame": BASE,
        **(names or {}),
        **_signals_here(robot),
    }
    if "watch" in keys:
        here |= _condition_here(robot, waits="timeout_s" in keys, counter=here["counter"])
    if snapshot.gripper is not None:
        here["open_percent"] = round(100 * snapshot.gripper, 1)
    if kind.handles:  # as it holds a part now; else closed, until it is edited in the row
        grips = snapshot.gripper is not None and snapshot.gripper < _HALF_OPEN
        here["close_percent"] = here["open_percent"] if grips else 0.0
    if _TOOL_KEYS.intersection(keys):
        here |= _tool_here(robot, present_pose_deg(robot, snapshot))
    if via_mm is not None:
        here |= zip(VIA, via_mm, strict=True)
    for key in keys:
        if key not in here:
            raise StateError(_NOT_KNOWN[key])
    if kind.handles and robot.gripper is None:
        keys = (*keys, "output")
    return kind(**{key: here[key] for key in keys})


def _signals_here(robot: Robot) -> dict[str, Any]:
    """The first output, to be edited in the row."""
    own = "" if robot.gripper is None else robot.gripper.output
    outputs = [one.name for one in robot.signals.outputs if one.name != own]
    return {"output": outputs[0]} if outputs else {}


def _condition_here(robot: Robot, *, waits: bool, counter: str) -> dict[str, Any]:
    """The first input; without one a load to wait for, or a counter to ask for."""
    if robot.signals.inputs:
        first = robot.signals.inputs[0]
        compare, value = ("above", 0.5) if first.kind == "analog" else ("equals", 1.0)
        return {"watch": first.name, "joint": "", "counter": "", "compare": compare, "value": value}
    if waits:
        joint = robot.joints[0].name
        return {"watch": "load", "joint": joint, "counter": "", "compare": "above", "value": 40.0}
    return {"watch": COUNTER, "joint": "", "counter": counter, "compare": "below", "value": 3.0}


def _tool_here(robot: Robot, pose_deg: tuple[float, ...]) -> Mapping[str, Any]:
    """Keys of steps and their values at a pose.

    Of an arm that can turn its tool about any axis, its orientation; else its pitch and roll, but no pitch
    where the place of the tool decides about it.
    """
    q = robot.read(pose_deg)
    angles: dict[str, float | None] = dict.fromkeys(("pitch_deg", "roll_deg", *RPY))
    angles |= tool_turn(robot, q, _DIGITS)
    if robot.orients_tool:
        modes = {"pitch": None, "orientation": "interpolated"}
    else:
        modes = {"pitch": "free" if usual_pitch(robot) == "free" else None, "orientation": None}
        if modes["pitch"] is not None:
            angles["pitch_deg"] = None
    x, y, z = tool_point_mm(robot, pose_deg)
    to_x, to_y = (round(one + _SIDE_MM, _DIGITS) for one in (x, y))
    corners = {
        key: value
        for keys, point in ((END, (x, y, z)), (_ROW, (x, to_y, z)), (_COLUMN, (to_x, y, z)))
        for key, value in zip(keys, point, strict=True)
    }
    plane = (x, y, z, to_x, y, z, x, to_y, z)
    return {"joints_deg": pose_deg, "plane_mm": plane, **corners, **modes, **angles}


def tool_point_mm(robot: Robot, pose_deg: tuple[float, ...]) -> Point:
    """Where the tool is at a pose [mm], to a micrometre."""
    x, y, z = (np.round(1000 * robot.forward(robot.read(pose_deg))[:3, 3], _DIGITS) + 0.0).tolist()
    return x, y, z


def present_pose_deg(robot: Robot, snapshot: Snapshot) -> tuple[float, ...]:
    """The pose to record, in degrees; ``StateError``: not known."""
    return tuple(slider_degrees(robot, present_pose(snapshot)))
