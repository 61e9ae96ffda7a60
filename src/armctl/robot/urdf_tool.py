"""Which link of a URDF file is the tool: the one that the user names, else the one that the file suggests."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armctl.errors import RobotFileError
from armctl.robot.urdf_file import UrdfJoint, customary_tools, is_of_gripper, is_sensor, is_tool_frame
from armctl.robot.urdf_tree import UrdfTree


@dataclass(frozen=True, slots=True)
class UrdfTool:
    """The tool link, and why it is that one."""

    link: str
    why: str
    left_out: tuple[str, ...] = ()
    """joints that turn, and are taken for the gripper's own"""


def named_tool(tree: UrdfTree, link: str) -> UrdfTool:
    """The link of that name.

    Raises:
        RobotFileError: there is none; lists those that there are.
    """
    if link not in tree.file.links:
        raise RobotFileError(
            f"{tree.file.path}: there is no link {link!r}; it has {', '.join(tree.file.links)}"
        )
    return UrdfTool(link, "as named")


def suggested_tool(tree: UrdfTree) -> UrdfTool:
    """The link that is most likely the tool.

    One with a customary name. Without one, the arm follows the moving joints from the root. It ends where
    none is left, or at a gripper: at a link with several moving joints that slide or follow each other, or
    whose joints are the gripper's own by their names. From there it goes on over fixed joints, to the link
    that has a name as tool frames have, else to the last one that is no camera.

    Raises:
        RobotFileError: several links could be the tool.
    """
    if tools := customary_tools(tree.file.links):
        return UrdfTool(_only(tree, tools), "which has a customary name")
    return _Search(tree).tool()


class _Search:
    """Follows the moving joints to where the arm ends."""

    def __init__(self, tree: UrdfTree) -> None:
        self._tree = tree

    def tool(self) -> UrdfTool:
        end = self._end_of_motion()
        left_out = tuple(joint.name for joint in self._tree.below(end) if _turns(joint))
        fixed = [joint.child for joint in self._tree.fixed_below(end)]
        frames = [link for link in fixed if is_tool_frame(link)]
        last = [link for link in frames if not {j.child for j in self._tree.fixed_below(link)} & set(frames)]
        if last:
            return UrdfTool(_only(self._tree, last), "which has a name as tool frames have", left_out)
        leaves = [link for link in fixed if not self._tree.children(link) and not is_sensor(link)]
        if leaves:
            return UrdfTool(_only(self._tree, leaves), "the last one", left_out)
        return UrdfTool(end, "which the last joint of the arm moves", left_out)

    def _end_of_motion(self) -> str:
        """The link that the last moving joint of the arm carries."""
        link = self._tree.root
        while True:
            moving = [joint for joint in self._tree.children(link) if self._moving(joint)]
            arms = [joint for joint in moving if self._is_arm(joint)]
            if all(self._is_gripper(joint) for joint in moving) or self._are_fingers(moving, arms):
                return link
            if len(arms) > 1:
                raise unclear_tool(self._tree, self._leaves(arms))
            link = (arms or moving)[0].child

    def _moving(self, joint: UrdfJoint) -> list[UrdfJoint]:
        return [j for j in self._tree.branch(joint) if j.kind != "fixed"]

    def _is_gripper(self, joint: UrdfJoint) -> bool:
        """True when all that moves in this branch is the gripper's own, or follows that."""
        free = [j for j in self._moving(joint) if j.mimics is None]
        return bool(free) and all(map(is_of_gripper, free))

    def _is_arm(self, joint: UrdfJoint) -> bool:
        """True when a joint of the arm turns in this branch."""
        return any(_turns(j) and not is_of_gripper(j) for j in self._moving(joint))

    def _are_fingers(self, moving: list[UrdfJoint], arms: list[UrdfJoint]) -> bool:
        if len(moving) < 2 or not arms:
            return len(moving) > 1
        names = {j.name for first in moving for j in self._tree.branch(first)}
        followers = [j for first in moving for j in self._tree.branch(first) if j.mimics in names]
        return len(arms) == 1 and any(j in moving for j in followers)

    def _leaves(self, joints: list[UrdfJoint]) -> list[str]:
        below = [j.child for first in joints for j in self._tree.branch(first)]
        return [link for link in below if not self._tree.children(link)]


def _turns(joint: UrdfJoint) -> bool:
    return joint.kind in ("revolute", "continuous") and joint.mimics is None


def _only(tree: UrdfTree, links: list[str]) -> str:
    if len(links) > 1:
        raise unclear_tool(tree, links)
    return links[0]


def unclear_tool(tree: UrdfTree, links: list[str]) -> RobotFileError:
    """The refusal of a file with several links that could be the tool."""
    path = tree.file.path
    return RobotFileError(
        f"{path}: several links could be the tool: {', '.join(links)}; name one: {path.name}#{links[0]}"
    )


# How a URDF robot is named: its file, and behind a ``#`` the tool link and which axis of it points ahead.

FloatArray = NDArray[np.float64]
_NAMED = re.compile(r"(?P<path>.+?\.urdf)(?:#(?P<wanted>.*))?", re.IGNORECASE | re.DOTALL)
_APPROACH = "approach="
AXES = {f"{sign}{axis}": (sign, k) for sign in ("", "-") for k, axis in enumerate("xyz")}
"""the axes of a link, as ``approach=`` names them: sign and column"""


@dataclass(frozen=True, slots=True)
class UrdfName:
    """``arm.urdf``, ``arm.urdf#link``, ``arm.urdf#link,approach=x`` or ``arm.urdf#approach=x``."""

    path: Path
    link: str | None = None
    """the tool link; None: the one that the file suggests"""
    approach: str = "z"
    """the axis of the tool link that armctl takes for the tool's z, a key of ``AXES``"""

    @classmethod
    def of(cls, name: str | Path) -> UrdfName | None:
        """Read a robot's name; None where it names no URDF file.

        Raises:
            RobotFileError: something behind the ``#`` that says neither a link nor an axis.
        """
        text = name.as_posix() if isinstance(name, Path) else name  # a link's own slashes are kept everywhere
        match = _NAMED.fullmatch(text)
        if match is None:
            return None
        path, wanted = Path(match["path"]), match["wanted"]
        if wanted is None:
            return cls(path)
        parts = [part.strip() for part in wanted.split(",")]
        axes = [part.removeprefix(_APPROACH) for part in parts if part.startswith(_APPROACH)]
        links = [part for part in parts if not part.startswith(_APPROACH)]
        if "" in parts or len(links) > 1 or len(axes) > 1 or not set(axes) <= set(AXES):
            raise RobotFileError(
                f"{text}: behind the # stands the name of the tool link, {_APPROACH}AXIS "
                f"({', '.join(AXES)}), or both with a comma between; got {wanted!r}"
            )
        return cls(path, links[0] if links else None, axes[0] if axes else "z")

    @property
    def direction(self) -> FloatArray:
        """(3,) the approach axis in the tool link's frame."""
        sign, column = AXES[self.approach]
        return np.eye(3)[column] * (-1.0 if sign else 1.0)


def is_urdf(name: str | Path) -> bool:
    """True for the name of a URDF robot: a path that ends in ``.urdf``, with or without a tool link."""
    return _NAMED.fullmatch(str(name)) is not None
