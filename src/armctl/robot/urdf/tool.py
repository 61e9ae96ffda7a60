"""Which link of a URDF file is the tool, and which joints stand beside the arm."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TypeAlias
from urllib.parse import unquote

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import RobotFileError, UnclearArmError
from armctl.lazy_dataclass import dataclass
from armctl.robot.urdf.joints import (
    ArmEnds,
    arm_ends,
    customary_tools,
    is_beside,
    is_hand,
    is_sensor,
    is_tool_frame,
    unlikely,
)
from armctl.robot.urdf.tree import UrdfJoint, UrdfTree, is_free

# What stands behind the ``#`` of an arm's name: the tool, and the arguments of a xacro file.

AXES = {f"{sign}{axis}": (sign, k) for sign in ("", "-") for k, axis in enumerate("xyz")}
"""the axes of a link, as ``approach=`` names them: sign and column"""
_APPROACH, EXACT = "approach=", "exact="
GIVES = ":="
"""between the name and the value of an argument, as ROS has it"""
ArgumentValue: TypeAlias = str | bool | int | float


@dataclass(frozen=True, slots=True)
class Wanted:
    """What stands behind the ``#`` of an arm's name."""

    link: str | None
    """the tool link"""
    approach: str | None
    """the axis of it that is taken for z"""
    exact: bool
    """whether nearly right angles are taken as right"""
    arguments: Mapping[str, str]
    """of a xacro file, by name"""

    @classmethod
    def of(cls, text: str | None) -> Wanted:
        """Read ``link``, ``approach=x``, ``exact=yes`` and ``name:=value``, any of them, commas between."""
        if text is None:
            return cls(None, None, False, {})
        parts = [part.strip() for part in text.split(",")]
        given = [part.partition(GIVES) for part in parts if GIVES in part]
        axes = [part.removeprefix(_APPROACH) for part in parts if part.startswith(_APPROACH)]
        links = [part for part in parts if GIVES not in part and not part.startswith((_APPROACH, EXACT))]
        arguments = {name.strip(): unquote(value) for name, _, value in given}
        unclear = len(links) > 1 or len(axes) > 1 or len(arguments) < len(given)
        exact = f"{EXACT}yes" in parts
        unclear = unclear or any(part.startswith(EXACT) and part != f"{EXACT}yes" for part in parts)
        if unclear or "" in (*parts, *arguments) or not set(axes) <= set(AXES):
            raise RobotFileError(
                f"behind the # stands the name of the tool link, {_APPROACH}AXIS ({', '.join(AXES)}), "
                f"{EXACT}yes, and NAME{GIVES}VALUE for each argument of a xacro file, with commas between; "
                f"got {text!r}"
            )
        return cls(links[0] if links else None, axes[0] if axes else None, exact, arguments)


def argument_texts(values: Mapping[str, object]) -> dict[str, str]:
    """The values of arguments as xacro takes them: texts, ``true`` and ``false``."""
    for name, value in values.items():
        if not isinstance(value, str | int | float):
            raise RobotFileError(f"the argument {name!r} is {value!r}; it must be a text, a number or a bool")
    return {
        name: str(value).lower() if isinstance(value, bool) else str(value) for name, value in values.items()
    }


_TURNING = ("revolute", "continuous")
_MOST_NAMED = 40
"""links in one refusal"""
_PARALLEL = 0.996
"""cosine from which on two axes count as parallel"""
_FEWEST_RODS = 2
"""that keep a hand level"""
_SAME = 1e-9
"""how far apart two axes may be that are one: sine, and metres"""


@dataclass(frozen=True, slots=True)
class UrdfTool:
    """The tool link, and why it is that one."""

    link: str
    why: str = ""
    """empty: it was named"""
    perhaps_jaw: tuple[str, str] | None = None
    """as in ``ArmEnds``"""


def suggested_tool(tree: UrdfTree) -> UrdfTool:
    """The link that is most likely the tool; refuses to choose where the file leaves that open.

    It is one with a customary name, if the arm reaches it. Else it hangs on what the last joint of the arm
    carries: the link that has a name as tool frames have, the hand that carries the fingers, or the last bare
    frame. Else it is what the last joint carries: a part that is fixed to that may be a cover.
    """
    arm = arm_ends(tree)
    if not any(is_free(joint) for end in arm.links for joint in tree.route(end)):
        return UrdfTool(_tools(tree, arm.links[0])[0][0])  # which is refused: no arm leads there
    if named := _customary(tree, arm):
        tool = UrdfTool(named, "which has a customary name")
    elif arm.why:
        raise _unclear(tree, [link for end in arm.links for link in _tools(tree, end)[0]], arm.why)
    else:
        links, why = _tools(tree, arm.links[0])
        if len(links) > 1:
            raise _unclear(tree, links)
        tool = UrdfTool(links[0], why, arm.perhaps_jaw)
    if level := _kept_level(tree, tree.route(tool.link)):
        raise _unclear(tree, [tool.link], level)
    return tool


def left_out(tree: UrdfTree, way: Sequence[UrdfJoint]) -> tuple[str, ...]:
    """The joints that move of their own and are none of the arm's: of a lift, a gripper, or beside it."""
    held = [
        joint for joint in tree.route(way[-1].child) if joint.kind not in _TURNING and joint.kind != "fixed"
    ]
    return tuple(one.name for one in (*held, *_own(tree, way), *_beside(tree, way)) if one.mimics is None)


def about_tool(tree: UrdfTree, tool: UrdfTool, way: Sequence[UrdfJoint]) -> Iterator[str]:
    """The tool link, what is left out beyond it, and a last joint that may be a jaw."""
    file = tree.path.name
    if tool.why:
        own = ", ".join(joint.name for joint in _own(tree, way) if is_free(joint))
        out = f"; taken for the gripper's own and left out: {own}" if own else ""
        yield f"the tool is the link {tool.link}, {tool.why}{out} (another: {file}#LINK)"
    if tool.perhaps_jaw is not None:
        joint, link = tool.perhaps_jaw
        yield (
            f"{joint} is the last of the arm's {sum(map(is_free, way))} joints; it may be a jaw as well "
            f"({file}#{link} ends the arm ahead of it)"
        )


def about_beside(tree: UrdfTree, way: Sequence[UrdfJoint]) -> Iterator[str]:
    """The joints off the way to the tool, and those of them that share an axis with a joint of the arm."""
    beside = _beside(tree, way)
    if beside:
        some = [joint.name + (f" (follows {joint.mimics})" if joint.mimics else "") for joint in beside]
        file = tree.path.name
        yield f"beside the arm and left out: {', '.join(some)} (an arm with one of them: {file}#LINK)"
    if rods := _rods(tree, way):
        yield (
            f"{', '.join(rods)}: parallel to joints of the arm; where rods close a loop with them, some "
            "joints of the arm follow others, which a URDF file says with <mimic>"
        )
    carriers = tree.carriers()
    for joint in beside:
        for other in way:
            together = is_free(other) and carriers[joint.parent] == carriers[other.parent]
            if joint.kind in _TURNING and together and _on_one_axis(tree, joint, other):
                yield (
                    f"{joint.name} turns about the axis of {other.name}; if both are servos that drive one "
                    "joint, connect both to its output: armctl has one output for each joint"
                )


def _rods(tree: UrdfTree, way: Sequence[UrdfJoint]) -> list[str]:
    """The joints beside the arm that turn by themselves, parallel to several of the arm, as rods do."""
    axes = [_axis(tree, joint) for joint in way if is_free(joint)]
    return [
        joint.name
        for joint in _beside(tree, way)
        if is_free(joint)
        and joint.kind == "revolute"
        and not is_beside(joint.name, joint.child)
        and sum(abs(float(_axis(tree, joint) @ axis)) > _PARALLEL for axis in axes) > 1
    ]


def _kept_level(tree: UrdfTree, way: Sequence[UrdfJoint]) -> str:
    """Why the last of three parallel joints may be turned by rods and not by a motor; empty: it hardly is.

    The rods of a palletiser keep its hand level. A file whose joints all turn by themselves does not say so.
    """
    free = [joint for joint in way if is_free(joint)]
    moved = [one.name for joint in free for one in tree.below(joint.child)]
    rods = [name for name in _rods(tree, way) if name in moved]  # no legs of what carries the arm
    if len(rods) < _FEWEST_RODS:
        return ""
    for joints in zip(free, free[1:], free[2:], strict=False):
        one, two, three = (_axis(tree, joint) for joint in joints)
        if min(abs(float(one @ two)), abs(float(two @ three))) > _PARALLEL:
            return (
                f"{', '.join(rods)} may be rods that keep the hand level; {joints[2].name} follows "
                f"{joints[0].name} and {joints[1].name} then, which a URDF file says with <mimic>"
            )
    return ""


def _own(tree: UrdfTree, way: Sequence[UrdfJoint]) -> list[UrdfJoint]:
    """The joints that move beyond the last one of the arm."""
    end = [joint.child for joint in way if joint.kind != "fixed"][-1]
    on_way = {joint.name for joint in way}
    return [one for one in tree.below(end) if one.kind != "fixed" and one.name not in on_way]


def _beside(tree: UrdfTree, way: Sequence[UrdfJoint]) -> list[UrdfJoint]:
    """The joints that move ahead of the end of the arm, and are not on the way there."""
    known = {joint.name for joint in (*way, *_own(tree, way))}
    return [one for one in tree.below(tree.root) if one.kind != "fixed" and one.name not in known]


def _on_one_axis(tree: UrdfTree, one: UrdfJoint, other: UrdfJoint) -> bool:
    """Whether two joints share an axis, all others at zero."""
    step = tree.pose(other.child)[:3, 3] - tree.pose(one.child)[:3, 3]
    apart = np.cross(_axis(tree, one), np.array([_axis(tree, other), step]))
    return bool(np.abs(apart).max() < _SAME)


def _axis(tree: UrdfTree, joint: UrdfJoint) -> FloatArray:
    """(3,) unit vector in the root frame, all joints at zero."""
    return tree.pose(joint.child)[:3, :3] @ joint.axis


def _customary(tree: UrdfTree, arm: ArmEnds) -> str | None:
    """The link with a customary name that the arm reaches; refuses where there are several.

    The name counts ahead of the last joint, too, which is the gripper's own then. Where more of the arm lies
    beyond it, as arms do beyond a torso, or it stands beside the arm, the name may mislead.
    """
    named, carriers = customary_tools(tree.links), tree.carriers()
    count = {tree.root: 0}
    for joint in tree.below(tree.root):
        count[joint.child] = count[joint.parent] + is_free(joint)
    most = max(count[end] for end in arm.links)
    ahead = {joint.child for end in arm.links for joint in tree.route(end) if joint.kind != "fixed"}

    def reached(link: str) -> bool:
        fewest = max(most - 1, 1) if carriers[link] in ahead else most
        return carriers[link] == arm.links[0] or count[link] >= fewest > 0

    if last := [link for link in named if reached(link)]:
        return _only(tree, last)
    if elsewhere := [link for link in named if count[link]]:
        tools = [link for end in arm.links for link in _tools(tree, end)[0][:1]]
        why = f"{', '.join(elsewhere)} has the name of a tool, but the arm goes another way or on from there"
        raise _unclear(tree, [*tools, *elsewhere], why)
    return None


def _tools(tree: UrdfTree, end: str) -> tuple[list[str], str]:
    """The links that may be the tool where the last joint of the arm carries ``end``, and why."""
    drawn = any(link.visual for link in tree.links.values())
    fixed = [link for link in tree.body(end)[1:] if not (drawn and _only_collides(tree, link))]
    frames = [link for link in fixed if is_tool_frame(link)]
    if frames:
        return _last(tree, frames), "which has a name as tool frames have"
    hands = [link for link in fixed if is_hand(link)] or _carry_fingers(tree, end)
    if len(hands) == 1:
        return hands, "which is called a hand" if is_hand(hands[0]) else "which carries the fingers"
    bare = [link for link in fixed if not tree.links[link].is_solid and not is_sensor(link)]
    if bare := _last(tree, bare):
        return bare if len(bare) == 1 else [end, *sorted(bare, key=unlikely)], "the last frame"
    return [end], "which the last joint of the arm moves"


def _only_collides(tree: UrdfTree, name: str) -> bool:
    link = tree.links[name]
    return bool(link.collision and not link.visual)


def _last(tree: UrdfTree, links: Sequence[str]) -> list[str]:
    """Those of several links with none of them behind it."""
    passed: set[str] = set()
    for link in links:
        while (joint := tree.into(link)) is not None and joint.kind == "fixed" and joint.parent not in passed:
            link = joint.parent
            passed.add(link)
    return [link for link in links if link not in passed]


def _carry_fingers(tree: UrdfTree, end: str) -> list[str]:
    """The link that carries all of several joints which move."""
    parents = [joint.parent for joint in tree.exits(end)]
    return [parents[0]] if len(parents) > 1 and len(set(parents)) == 1 else []


def _only(tree: UrdfTree, links: Sequence[str]) -> str:
    if len(links) > 1:
        raise _unclear(tree, sorted(links, key=unlikely))
    return links[0]


def _unclear(tree: UrdfTree, links: Sequence[str], why: str = "") -> UnclearArmError:
    links = list(dict.fromkeys(links))
    some = ", ".join(links[:_MOST_NAMED]) + ", …" * (len(links) > _MOST_NAMED)
    one = len(links) == 1
    which = f"the arm may end at {some}" if one else f"several links could be the tool: {some}"
    name = f"name {'it' if one else 'one'}: {tree.path.name}#{links[0]}"
    error = UnclearArmError(f"{which}{f' ({why})' if why else ''}; {name}")
    error.links = links
    return error
