"""Which of a URDF's links and joints are the arm: one chain from the root link to the tool."""

from __future__ import annotations

from collections.abc import Iterator

from armctl.errors import RobotFileError
from armctl.robot.urdf_file import UrdfFile, UrdfJoint

TOOL_NAMES = ("tool0", "tcp", "tool", "ee_link", "end_effector", "gripper_base")
"""what the tool link is called by custom, the surest first; also with a prefix (``left_tool0``)"""


class UrdfTree:
    """The links of a file, hung up by its root."""

    def __init__(self, file: UrdfFile) -> None:
        """Check that the links form one tree.

        Raises:
            RobotFileError: no link, an unknown link, two joints into one link, a loop, or more than one root.
        """
        self._file = file
        self._children: dict[str, list[UrdfJoint]] = {name: [] for name in file.links}
        self._into: dict[str, UrdfJoint] = {}
        if not file.links:
            raise RobotFileError(f"{file.path}: there is no <link>")
        for joint in file.joints:
            self._hang(joint)
        roots = [name for name in file.links if name not in self._into]
        if not roots:
            raise RobotFileError(f"{file.path}: the joints form a loop; a robot has one root link")
        if len(roots) > 1:
            raise RobotFileError(
                f"{file.path}: there are several root links ({', '.join(roots)}); join them by a fixed joint"
            )
        self.root = roots[0]
        lost = set(file.links) - {self.root, *(joint.child for joint in self.below(self.root))}
        if lost:
            raise RobotFileError(f"{file.path}: the joints form a loop: {', '.join(sorted(lost))}")

    def _hang(self, joint: UrdfJoint) -> None:
        where = f'{self._file.path}: <joint name="{joint.name}">'
        for tag, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in self._file.links:
                raise RobotFileError(f'{where}: <{tag} link="{link}">: there is no such link')
        if joint.child in self._into:
            other = self._into[joint.child].name
            raise RobotFileError(f'{where}: the link "{joint.child}" already hangs on the joint "{other}"')
        self._into[joint.child] = joint
        self._children[joint.parent].append(joint)

    def below(self, link: str) -> Iterator[UrdfJoint]:
        """Every joint further from the root than a link, parents first."""
        waiting = list(self._children[link])
        while waiting:
            joint = waiting.pop(0)
            yield joint
            waiting += self._children[joint.child]

    def chain(self) -> list[UrdfJoint]:
        """The joints from the root link to the tool, fixed ones among them.

        The tool is the link with a customary name (``TOOL_NAMES``). Without one, the chain follows the moving
        joints from the root; it ends where none is left, or at the palm of a gripper: a link with several
        moving joints that slide or follow each other; and goes on over fixed joints to the last link.

        Raises:
            RobotFileError: several links could be the tool, or a joint on the way is none that turns freely.
        """
        chain = self._way_to(self._tool())
        for joint in chain:
            where = f'{self._file.path}: <joint name="{joint.name}">'
            if joint.kind not in ("revolute", "continuous", "fixed"):
                raise RobotFileError(
                    f'{where}: type="{joint.kind}": '
                    "the chain of an arm holds revolute, continuous and fixed joints"
                )
            if joint.mimics is not None and joint.kind != "fixed":
                raise RobotFileError(
                    f'{where}: follows the joint "{joint.mimics}"; every joint of an arm is free'
                )
        if all(joint.kind == "fixed" for joint in chain):
            raise RobotFileError(f"{self._file.path}: no joint turns between {self.root} and {self._tool()}")
        return chain

    def _way_to(self, link: str) -> list[UrdfJoint]:
        way: list[UrdfJoint] = []
        while link != self.root:
            way.append(self._into[link])
            link = way[-1].parent
        return way[::-1]

    def _tool(self) -> str:
        for name in TOOL_NAMES:
            exact = [link for link in self._file.links if link == name]
            tools = exact or [link for link in self._file.links if _ends_in(link, name)]
            if len(tools) > 1:
                raise self._unclear(tools)
            if tools:
                return tools[0]
        end = self._end_of_motion()
        leaves = [j.child for j in self._fixed_below(end) if not self._children[j.child]]
        if len(leaves) > 1:
            raise self._unclear(leaves)
        return leaves[0] if leaves else end

    def _end_of_motion(self) -> str:
        """The link that the last moving joint of the arm carries."""
        link = self.root
        while True:
            moving = [joint for joint in self._children[link] if self._moves(joint)]
            turning = [joint for joint in moving if self._turns(joint)]
            if not moving or (len(moving) > 1 and self._are_fingers(moving, turning)):
                return link
            if len(turning) > 1:
                raise self._unclear(self._leaves(turning))
            link = (turning or moving)[0].child

    def _moves(self, joint: UrdfJoint) -> bool:
        return any(j.kind != "fixed" for j in (joint, *self.below(joint.child)))

    def _turns(self, joint: UrdfJoint) -> bool:
        """True when a joint of its own turns in this branch."""
        branch = (joint, *self.below(joint.child))
        return any(j.kind in ("revolute", "continuous") and j.mimics is None for j in branch)

    def _are_fingers(self, moving: list[UrdfJoint], turning: list[UrdfJoint]) -> bool:
        names = {j.name for first in moving for j in (first, *self.below(first.child))}
        followers = [j for first in moving for j in (first, *self.below(first.child)) if j.mimics in names]
        return not turning or (len(turning) == 1 and any(j in moving for j in followers))

    def _fixed_below(self, link: str) -> Iterator[UrdfJoint]:
        """The fixed joints that a link carries with no moving one in between."""
        waiting = [link]
        while waiting:
            fixed = [joint for joint in self._children[waiting.pop(0)] if joint.kind == "fixed"]
            yield from fixed
            waiting += [joint.child for joint in fixed]

    def _leaves(self, joints: list[UrdfJoint]) -> list[str]:
        below = [j.child for first in joints for j in (first, *self.below(first.child))]
        return [link for link in below if not self._children[link]]

    def _unclear(self, links: list[str]) -> RobotFileError:
        return RobotFileError(
            f"{self._file.path}: several links could be the tool: {', '.join(links)}; give one of "
            f"them a child link named {TOOL_NAMES[0]} by a fixed joint, or leave only one with "
            f"a customary name ({', '.join(TOOL_NAMES)})"
        )


def _ends_in(link: str, name: str) -> bool:
    return any(link.endswith(f"{mark}{name}") for mark in "_-/.")
