"""The links and joints of a URDF file as a tree, and which link of it is the tool."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from armctl.errors import RobotFileError
from armctl.robot.urdf_file import UrdfFile, UrdfJoint

# What the names in a URDF file give away.
TOOL_NAMES = ("tool0", "tcp", "tool", "ee_link", "end_effector", "gripper_base")
"""what the tool link is called by custom, wherever in the file it is; the surest first"""
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_TOOL_WORDS = {"tool", "tcp", "ee", "effector", "eef", "grasp", "gripperframe"}
"""the customary names count in other names too: ``ee_gripper_link``"""
_SENSOR = {"camera", "cam", "imu", "sensor", "optical"}
_FINGER = {"finger", "fingers", "jaw", "jaws", "claw", "claws", "knuckle", "pincer"}
_GRIPPER = {"gripper", "grip"}
_ARM = {"roll", "rotate", "rotation", "rot", "pitch", "yaw", "wrist", "pan", "tilt", "twist", "arm", "to"}


class UrdfTree:
    """The links of a file, hung up by its root."""

    def __init__(self, file: UrdfFile) -> None:
        """Check that the links form one tree.

        Raises:
            RobotFileError: no link, an unknown link, two joints into one link, a loop, or more than one root.
        """
        self.file = file
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
        where = f'{self.file.path}: <joint name="{joint.name}">'
        for tag, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in self.file.links:
                raise RobotFileError(f'{where}: <{tag} link="{link}">: there is no such link')
        if joint.child in self._into:
            other = self._into[joint.child].name
            raise RobotFileError(f'{where}: the link "{joint.child}" already hangs on the joint "{other}"')
        self._into[joint.child] = joint
        self._children[joint.parent].append(joint)

    def children(self, link: str) -> list[UrdfJoint]:
        """The joints that a link carries."""
        return self._children[link]

    def below(self, link: str) -> Iterator[UrdfJoint]:
        """Every joint further from the root than a link, parents first."""
        waiting = list(self._children[link])
        while waiting:
            joint = waiting.pop(0)
            yield joint
            waiting += self._children[joint.child]

    def branch(self, joint: UrdfJoint) -> list[UrdfJoint]:
        """A joint and every one below it."""
        return [joint, *self.below(joint.child)]

    def fixed_below(self, link: str) -> Iterator[UrdfJoint]:
        """The fixed joints that a link carries with no moving one in between."""
        waiting = [link]
        while waiting:
            fixed = [joint for joint in self._children[waiting.pop(0)] if joint.kind == "fixed"]
            yield from fixed
            waiting += [joint.child for joint in fixed]

    def chain(self, tool: str) -> list[UrdfJoint]:
        """The joints from the root link to a link, fixed ones among them.

        Raises:
            RobotFileError: a joint on the way is none that turns freely.
        """
        chain: list[UrdfJoint] = []
        link = tool
        while link != self.root:
            chain.insert(0, self._into[link])
            link = chain[0].parent
        for k, joint in enumerate(chain):
            where = f'{self.file.path}: <joint name="{joint.name}">'
            if joint.kind not in ("revolute", "continuous", "fixed"):
                raise RobotFileError(
                    f'{where}: type="{joint.kind}": the chain of an arm holds revolute, continuous and fixed '
                    f"joints; {self._way_out(joint, chain[:k])}"
                )
            if joint.mimics is not None and joint.kind != "fixed":
                raise RobotFileError(
                    f'{where}: follows the joint "{joint.mimics}"; every joint of an arm is free'
                )
        return chain

    def _way_out(self, joint: UrdfJoint, ahead: list[UrdfJoint]) -> str:
        """What can be done about a joint that does not turn, with these ones ahead of it."""
        if any(one.kind != "fixed" for one in ahead):
            return f"an arm that ends ahead of it is named as {self.file.path.name}#{joint.parent}"
        return 'no joint turns ahead of it; if the arm is to be used with it at rest, make it type="fixed"'


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
    end = _end_of_motion(tree)
    left_out = tuple(joint.name for joint in tree.below(end) if _turns(joint))
    fixed = [joint.child for joint in tree.fixed_below(end)]
    frames = [link for link in fixed if is_tool_frame(link)]
    last = [link for link in frames if not {j.child for j in tree.fixed_below(link)} & set(frames)]
    if last:
        return UrdfTool(_only(tree, last), "which has a name as tool frames have", left_out)
    leaves = [link for link in fixed if not tree.children(link) and not _words(link) & _SENSOR]
    if leaves:
        return UrdfTool(_only(tree, leaves), "the last one", left_out)
    return UrdfTool(end, "which the last joint of the arm moves", left_out)


def customary_tools(links: Iterable[str]) -> list[str]:
    """The links with the surest of ``TOOL_NAMES`` that any has, also behind a prefix (``left_tool0``)."""
    links = list(links)
    for name in TOOL_NAMES:
        behind = tuple(f"{mark}{name}" for mark in "_-/.")
        tools = [link for link in links if link == name] or [link for link in links if link.endswith(behind)]
        if tools:
            return tools
    return []


def is_tool_frame(link: str) -> bool:
    """True where a link's name is one that tool frames have: ``ee_gripper_link``, ``gripper_frame_link``."""
    words = _words(link)
    usual = bool(words & _TOOL_WORDS) or {"gripper", "frame"} <= words
    return usual and not words & (_SENSOR | _FINGER)


def _end_of_motion(tree: UrdfTree) -> str:
    """The link that the last moving joint of the arm carries."""
    link = tree.root
    while True:
        moving = [joint for joint in tree.children(link) if _moving(tree, joint)]
        arms = [
            joint for joint in moving if any(_turns(j) and not _is_gripper(j) for j in tree.branch(joint))
        ]
        if all(_only_gripper(tree, joint) for joint in moving) or _are_fingers(tree, moving, arms):
            return link
        if len(arms) > 1:
            below = [joint.child for first in arms for joint in tree.branch(first)]
            raise _unclear(tree, [link for link in below if not tree.children(link)])
        link = (arms or moving)[0].child


def _moving(tree: UrdfTree, joint: UrdfJoint) -> list[UrdfJoint]:
    return [j for j in tree.branch(joint) if j.kind != "fixed"]


def _only_gripper(tree: UrdfTree, joint: UrdfJoint) -> bool:
    """True when all that moves in this branch is the gripper's own, or follows that."""
    free = [j for j in _moving(tree, joint) if j.mimics is None]
    return bool(free) and all(map(_is_gripper, free))


def _are_fingers(tree: UrdfTree, moving: list[UrdfJoint], arms: list[UrdfJoint]) -> bool:
    if len(moving) < 2 or not arms:
        return len(moving) > 1
    joints = [joint for first in moving for joint in tree.branch(first)]
    names = {joint.name for joint in joints}
    return len(arms) == 1 and any(joint in moving and joint.mimics in names for joint in joints)


def _turns(joint: UrdfJoint) -> bool:
    return joint.kind in ("revolute", "continuous") and joint.mimics is None


def _is_gripper(joint: UrdfJoint) -> bool:
    """True where a joint's name or its link's says that it opens the gripper.

    A link called gripper says nothing: the wrist carries it. So does a joint ``gripper_roll`` or
    ``wrist_to_gripper``.
    """
    own, carried = _words(joint.name), _words(joint.child)
    return bool((own | carried) & _FINGER or (own & _GRIPPER and not own & _ARM))


def _words(name: str) -> set[str]:
    """``leftJaw_link1`` as left, jaw, link."""
    return {word.lower() for word in _WORD.findall(name)}


def _only(tree: UrdfTree, links: list[str]) -> str:
    if len(links) > 1:
        raise _unclear(tree, links)
    return links[0]


def _unclear(tree: UrdfTree, links: list[str]) -> RobotFileError:
    path = tree.file.path
    return RobotFileError(
        f"{path}: several links could be the tool: {', '.join(links)}; name one: {path.name}#{links[0]}"
    )
