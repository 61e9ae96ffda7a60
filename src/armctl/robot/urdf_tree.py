"""The links and joints of a URDF file as a tree."""

from __future__ import annotations

from collections.abc import Iterator

from armctl.errors import RobotFileError
from armctl.robot.urdf_file import UrdfFile, UrdfJoint


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
        chain = self._way_to(tool)
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

    def _way_to(self, link: str) -> list[UrdfJoint]:
        way: list[UrdfJoint] = []
        while link != self.root:
            way.append(self._into[link])
            link = way[-1].parent
        return way[::-1]
