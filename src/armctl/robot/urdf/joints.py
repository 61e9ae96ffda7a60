"""Which joints of a URDF file are the arm: what its tree, its geometry and its names tell.

From the root, the arm follows the branch with the most joints that turn freely. One with less is beside the
arm: a wheel, a rod, a counterweight. The arm ends where no such joint is left. Names decide where they say
something (``names``): what opens a gripper or aims a camera does not count, as long as nothing else follows.

Most names say nothing. The last joint of the tree may be a jaw then, and two branches of the same length may
be two arms, or two fingers. Such a file is not decided here: ``ArmEnds`` has all ends that there may be.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from armctl.arrays import FloatArray
from armctl.lazy_dataclass import dataclass
from armctl.robot.urdf.tree import UrdfJoint, UrdfTree, is_free

# What the names of links and joints tell: tools, grippers, cameras, wheels. Many names tell nothing.

TOOL_NAMES = ("tool0", "tcp", "tool", "ee_link", "end_effector", "gripper_base")
"""what the tool link is called by custom, wherever in the file it is; the surest first"""
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_TOOL_WORDS = {"tool", "tcp", "ee", "effector", "eef", "grasp", "gripperframe"}
"""the customary names count in other names too: ``ee_gripper_link``"""
_CAMERA = {"camera", "cameras", "cam"}
_SENSOR = _CAMERA | {"imu", "sensor", "optical", "accelerometer", "led"}
_FINGER = {"finger", "fingers", "jaw", "jaws", "claw", "claws", "knuckle", "pincer", "thumb", "pinky"}
_STILL = {"fixed", "static"}
_MOVING = {"moving", "movable"}
_GRIPPER = {"gripper", "grip"}
_HAND = _GRIPPER | {"hand", "palm"}
_TURN = {"roll", "rotate", "rotation", "rot", "pitch", "yaw", "wrist", "pan", "tilt", "twist"}
_WRIST = _TURN | {"to"}
_ARM = _WRIST | {"arm"}
_BESIDE = {
    "wheel", "wheels", "caster", "castor", "track", "propeller", "rotor", "antenna",
    "rod", "rods", "counterweight", "spring", "damper", "piston",
}  # fmt: skip


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


def is_hand(link: str) -> bool:
    """True where a link's name is one of what carries the fingers."""
    words = _words(link)
    return bool(words & _HAND) and not words & (_SENSOR | _FINGER)


def is_sensor(link: str) -> bool:
    """True where a link's name is one of a camera, another sensor or a lamp."""
    return bool(_words(link) & _SENSOR)


def opens_gripper(joint: str, carried: str) -> bool:
    """True where a joint's name, or that of the link that it carries, says that it opens the gripper.

    A link called gripper says nothing: the wrist carries it. So does a joint ``gripper_roll`` or
    ``wrist_to_gripper``, and a ``Wrist_Roll`` that carries the ``Fixed_Jaw``. ``arm`` may be a prefix of all
    joints: ``arm_gripper`` opens it where it carries a jaw.
    """
    own, link = _words(joint), _words(carried)
    if own & _FINGER:
        return True
    moves = bool(link & _FINGER or own & _GRIPPER or (link & _GRIPPER and link & _MOVING))
    return moves and not (own & (_WRIST if link & _FINGER else _ARM) or link & _STILL)


def is_beside(joint: str, carried: str) -> bool:
    """True where the names say that a joint opens the gripper, aims a camera, or turns a wheel or a rod."""
    own, link = _words(joint), _words(carried)
    return opens_gripper(joint, carried) or bool(own & _BESIDE or link & (_BESIDE | _CAMERA))


def turns_arm(joint: str, carried: str) -> bool:
    """True where the names say that a joint is one of the arm: ``wrist_roll``."""
    return bool(_words(joint) & _TURN) and not opens_gripper(joint, carried)


def is_moving_part(link: str) -> bool:
    """True where a link's name says that it moves against the others beside it: ``moving_part_v2``."""
    return bool(_words(link) & _MOVING)


def unlikely(link: str) -> int:
    """How little a name is that of a tool."""
    if is_tool_frame(link):
        return 0
    words = _words(link)
    return 4 if words & _SENSOR else 1 if words & _HAND else 3 if words & (_FINGER | _BESIDE) else 2


def _words(name: str) -> set[str]:
    """``leftJaw_link1`` as left, jaw, link."""
    return {word.lower() for word in _WORD.findall(name)}


_MOST_FINGER_JOINTS, _MOST_HAND_JOINTS = 3, 5
"""of one of two fingers, and of three and more; a branch with more is an arm"""
_FEWEST_AHEAD, _MOST_JOINTS = 3, 7
"""joints of an arm ahead of a hand or a jaw, and of a whole arm, as arms mostly are"""
_ONE_SIDED = 0.25
"""share of the range on the smaller side of zero, below which a joint turns to one side only"""
_NARROW = 0.7
"""share of the usual range of the joints ahead, below which one is narrow"""
_WIDEST_JAW = math.radians(120)
"""range up to which a jaw may open"""
_PARALLEL = math.cos(math.radians(5))
_ACROSS = math.sin(math.radians(15))
"""cosine of the angle between two axes, above and below which they count as parallel and at right angles"""
_NEAR = 1e-6
"""lengths below this have no direction [m]"""
_JAW, _PERHAPS_JAW = 3, -1
"""signs of a jaw (``_Joints.jaw_signs``) from which on it is asked, and doubted in words"""
_PAIR = 3
"""signs of a jaw for a joint that another one beside it follows, as fingers do"""


@dataclass(frozen=True, slots=True)
class ArmEnds:
    """Where the arm may end."""

    links: tuple[str, ...]
    """what its last joint carries, the likeliest first"""
    why: str = ""
    """what the file leaves open, in words; empty: the first link is the end"""
    perhaps_jaw: tuple[str, str] | None = None
    """the last joint and the link ahead of it, where that joint may be a jaw, but hardly is"""
    signs: int = 0
    """of a jaw, for that joint"""

    @property
    def all(self) -> tuple[str, ...]:
        """The links, and that ahead of what may be a jaw."""
        ahead = () if self.perhaps_jaw is None else self.perhaps_jaw[1:]
        return (*ahead, *self.links) if self.signs > 0 else (*self.links, *ahead)


def arm_ends(tree: UrdfTree) -> ArmEnds:
    """Where the arm of a file ends."""
    return _Joints(tree).ends(tree.root, ())


class _Joints:
    """The joints of one file, counted from their ends."""

    def __init__(self, tree: UrdfTree) -> None:
        self._tree = tree
        self.reach = dict.fromkeys(tree.links, 0)
        """joints of an arm beyond each link, at most"""
        for joint in reversed(list(tree.below(tree.root))):
            self.reach[joint.parent] = max(self.reach[joint.parent], self.count(joint))

    def count(self, joint: UrdfJoint) -> int:
        """How many joints of an arm a branch has, its first joint included."""
        beyond = self.reach[joint.child]
        beside = is_beside(joint.name, joint.child)
        return beyond + (is_free(joint) and not (beside and not beyond))

    def ends(self, link: str, ahead: Sequence[UrdfJoint]) -> ArmEnds:
        """Where the arm may end beyond a link; ``ahead``: the joints of the arm up to there."""
        while True:  # a file may be deeper than Python's stack
            exits = self._tree.exits(link)
            live = sorted((joint for joint in exits if self.count(joint)), key=self.count, reverse=True)
            if not live:
                return self._without_a_joint(link, exits, ahead)
            most = self.count(live[0])
            second = self.count(live[1]) if len(live) > 1 else 0
            if most == 1 and is_free(live[0]):
                return self._at_the_last(link, exits, live, ahead)
            alike = most < second + 2 and (second > 1 or (most == 2 and len(live) > 2))
            if most > 1 and (alike or self._are_fingers(live, ahead)):
                return self._of_branches(link, live, ahead)
            link, ahead = live[0].child, (*ahead, live[0])

    def _beyond(self, joint: UrdfJoint, ahead: Sequence[UrdfJoint]) -> ArmEnds:
        return self.ends(joint.child, (*ahead, joint))

    def _of_branches(self, link: str, live: Sequence[UrdfJoint], ahead: Sequence[UrdfJoint]) -> ArmEnds:
        """Several branches with two joints and more: arms, or the fingers of a hand."""
        most, second = map(self.count, live[:2])
        branches = [joint for joint in live if self.count(joint) >= max(2, most - 1)]
        branches.sort(key=lambda joint: (not self._has_tool(joint), -self.count(joint), -self._mass(joint)))
        found = [self._beyond(joint, ahead) for joint in branches]
        ends = [end for one in found for end in one.all]
        here = [link] if any(map(is_free, ahead)) else []
        names = ", ".join(joint.name for joint in (branches if second > 1 else live))
        why = f"{names} begin branches of about as many joints: arms, fingers, or an arm and rods"
        first = [link, *ends] if self._are_fingers(live, ahead) else [*ends, *here]
        return ArmEnds(tuple(dict.fromkeys(first)), why)

    def _are_fingers(self, live: Sequence[UrdfJoint], ahead: Sequence[UrdfJoint]) -> bool:
        """Whether branches beyond several joints are as short as the fingers of a hand."""
        counts = [self.count(joint) for joint in live]
        several = sum(count > 1 for count in counts)
        most = _MOST_FINGER_JOINTS if several == 2 else _MOST_HAND_JOINTS
        return several > 1 and max(counts) <= most and sum(map(is_free, ahead)) > _FEWEST_AHEAD

    def _at_the_last(
        self, link: str, exits: Sequence[UrdfJoint], live: Sequence[UrdfJoint], ahead: Sequence[UrdfJoint]
    ) -> ArmEnds:
        """One more joint, or several beside each other with nothing behind them."""
        twins = {
            one.name for one in live if any(one is not other and self._alike(one, other) for other in live)
        }
        signs = {one.name: self.jaw_signs(one, ahead) + 2 * (one.name in twins) for one in live}
        if len(live) == 1:
            (joint,) = live
            found, jaw = self._beyond(joint, ahead), signs[joint.name]
            followers = [one for one in exits if one.mimics == joint.name]
            pair = _PAIR if followers else 0
            if jaw >= 0 and any(self._alike(joint, one) for one in followers):
                return ArmEnds((link,))
            if sum(map(is_free, ahead)) < _FEWEST_AHEAD or jaw + pair < _PERHAPS_JAW:
                return found
            if jaw + pair < _JAW:
                return replace(found, perhaps_jaw=(joint.name, link), signs=jaw)
            why = f"{joint.name} may be the last joint of the arm, or a jaw"
            return ArmEnds((link, *found.links) if jaw > 0 else (*found.links, link), why)
        called = any(opens_gripper(joint.name, joint.child) for joint in exits)
        called = called and not any(self._is_called_arm(joint) for joint in live)
        if called or (min(signs.values()) >= _JAW and len(twins) == len(live)):
            return ArmEnds((link,))
        order = sorted(live, key=lambda joint: (signs[joint.name], *self._slightness(joint)))
        ends = [end for joint in order for end in self._beyond(joint, ahead).links]
        hand = 0 if signs[order[0].name] > 1 else 1
        why = f"{', '.join(joint.name for joint in order)} may be joints of the arm, fingers, or beside it"
        return ArmEnds(tuple(dict.fromkeys([*ends[:hand], link, *ends[hand:]])), why)

    def _without_a_joint(self, link: str, exits: Sequence[UrdfJoint], ahead: Sequence[UrdfJoint]) -> ArmEnds:
        """No joint turns freely any more. One that slides may open the gripper, or make a SCARA of the arm.

        One that follows others may keep the hand level.
        """
        called = [joint for joint in exits if opens_gripper(joint.name, joint.child)]
        followed = {joint.mimics for joint in exits}
        slides = [joint for joint in exits if joint.kind == "prismatic" and joint.mimics is None]
        if len(slides) == 1 and slides[0].name not in followed and not called:
            (slide,) = slides
            if self._all_along(slide, ahead):
                return self._beyond(slide, ahead)
            why = f"{slide.name} slides, which no joint of an arm does here; it may open the gripper"
            return ArmEnds((link,), why)
        level = [joint for joint in exits if joint.mimics is not None and joint.kind != "prismatic"]
        if len(level) == 1 and len(exits) == 1 and not called:
            rods = self._followers(level[0])
            if self._keeps_level(rods, ahead):
                return self.ends(rods[-1].child, (*ahead, *rods))
        return ArmEnds((link,))

    def _followers(self, joint: UrdfJoint) -> list[UrdfJoint]:
        """A joint that follows another, and those right behind it that do, too."""
        found = [joint]
        while len(exits := self._tree.exits(found[-1].child)) == 1 and exits[0].mimics is not None:
            found += exits
        return found

    def _keeps_level(self, rods: Sequence[UrdfJoint], ahead: Sequence[UrdfJoint]) -> bool:
        """Whether joints that follow undo all that two parallel joints behind a yaw joint turn."""
        axis = self._axis(rods[0])
        net = {joint.name: 0.0 for joint in ahead if is_free(joint)}
        for joint in (*ahead, *rods):
            leader = joint.mimics or joint.name
            if leader in net:
                net[leader] += float(self._axis(joint) @ axis) * joint.multiplier
        turned = [name for name in net if self._is_parallel(name, ahead, axis)]
        return len(turned) == 2 and len(net) == 3 and all(abs(net[name]) < _NEAR for name in turned)

    def _is_parallel(self, name: str, joints: Sequence[UrdfJoint], axis: FloatArray) -> bool:
        return any(one.name == name and abs(float(self._axis(one) @ axis)) > _PARALLEL for one in joints)

    def jaw_signs(self, joint: UrdfJoint, ahead: Sequence[UrdfJoint]) -> int:
        """How much the last joint of the tree looks like a jaw; below ``_PERHAPS_JAW``: not at all.

        A jaw turns to one side, at right angles to the joint that rolls it. It swings what it carries, which
        is light, and nothing hangs on it. None of that is sure: a wrist may be built so, too.
        """
        free = [one for one in ahead if is_free(one)]
        body = self._tree.body(joint.child)
        if self._is_called_arm(joint) or any(one.mimics is None for one in self._tree.exits(joint.child)):
            return -4
        bare = [link for link in body[1:] if not self._tree.links[link].is_solid]
        if any(map(is_tool_frame, body)) or (bare and self._tree.links[joint.child].is_solid):
            return -4
        signs = 2 * (is_moving_part(joint.child) or is_hand(joint.parent))
        signs += _range_signs(joint, free) + self._swings(joint)
        if not free:
            return signs
        before = free[-1]
        cosine = abs(float(self._axis(joint) @ self._axis(before)))
        if cosine > _PARALLEL:
            signs -= 1
        elif cosine < _ACROSS:
            signs += self._rolls(free)
        signs += joint.effort < 0.5 * before.effort
        signs += self._mass(joint) < 0.25 * self._mass_of_body(before.child)
        return signs + 3 * (len(free) >= _MOST_JOINTS)

    def _is_called_arm(self, joint: UrdfJoint) -> bool:
        return turns_arm(joint.name, joint.child)

    def _swings(self, joint: UrdfJoint) -> int:
        """1 where what a joint carries lies beside its axis, -2 where it lies along it, 0 if not known."""
        arm = self._middle(joint) - self._tree.pose(joint.child)[:3, 3]
        along = abs(float(arm @ self._axis(joint)))
        across = math.sqrt(max(float(arm @ arm) - along * along, 0.0))
        if max(along, across) < _NEAR:
            return 0
        return 1 if across > along else -2 if along > 2 * across else 0

    def _middle(self, joint: UrdfJoint) -> FloatArray:
        """(3,) centre of mass of what a joint carries, or the middle of its shapes, in the root frame."""
        links = [(self._tree.links[name], self._tree.pose(name)) for name in self._tree.body(joint.child)]
        start = self._tree.pose(joint.child)[:3, 3]
        mass = sum(link.mass_kg for link, _ in links)
        moments = [link.mass_kg * (T[:3, :3] @ link.com + T[:3, 3]) for link, T in links]
        middle = np.sum(moments, axis=0) / mass if mass else start
        places = [(T @ shape.pose)[:3, 3] for link, T in links for shape in link.visual or link.collision]
        if places and np.linalg.norm(middle - start) < _NEAR:
            middle = np.mean(places, axis=0)
        return middle

    def _rolls(self, joints: Sequence[UrdfJoint]) -> bool:
        """Whether the last of several joints rolls what it carries: it stands ahead on its own axis."""
        if len(joints) < 2:
            return False
        joint, before = joints[-1], joints[-2]
        step = self._tree.pose(joint.child)[:3, 3] - self._tree.pose(before.child)[:3, 3]
        step -= (step @ self._axis(before)) * self._axis(before)
        return abs(float(step @ self._axis(joint))) > max(0.7 * float(np.linalg.norm(step)), _NEAR)

    def _all_along(self, slide: UrdfJoint, ahead: Sequence[UrdfJoint]) -> bool:
        """Whether all joints ahead turn about the direction of a slide, as those of a SCARA do."""
        turns = [one for one in ahead if is_free(one)]
        return bool(turns) and all(abs(self._axis(one) @ self._axis(slide)) > _PARALLEL for one in turns)

    def _alike(self, one: UrdfJoint, other: UrdfJoint) -> bool:
        """Whether two joints beside each other turn alike, as fingers and wheels do."""
        ranges = [sorted(round(abs(end), 3) for end in joint.limits or ()) for joint in (one, other)]
        along = abs(float(self._axis(one) @ self._axis(other)))
        same_mass = math.isclose(self._mass(one), self._mass(other), rel_tol=0.1)
        return one.kind == other.kind and ranges[0] == ranges[1] and along > _PARALLEL and same_mass

    def _slightness(self, joint: UrdfJoint) -> tuple[float, ...]:
        """How little a last joint looks like one of the arm: for the order of what is offered."""
        held = len(self._tree.body(joint.child)) + len(self._tree.exits(joint.child))
        return -held, self._swings(joint), -joint.effort, -self._mass(joint)

    def _axis(self, joint: UrdfJoint) -> FloatArray:
        """(3,) unit vector in the root frame, all joints at zero."""
        return self._tree.pose(joint.child)[:3, :3] @ joint.axis

    def _mass(self, joint: UrdfJoint) -> float:
        links = [joint.child, *(one.child for one in self._tree.below(joint.child))]
        return sum(self._tree.links[link].mass_kg for link in links)

    def _mass_of_body(self, link: str) -> float:
        return sum(self._tree.links[part].mass_kg for part in self._tree.body(link))

    def _has_tool(self, joint: UrdfJoint) -> bool:
        """Whether a branch has a link or joint that is called after a tool or a gripper."""
        below = [joint, *self._tree.below(joint.child)]
        return any(
            is_tool_frame(one.child) or is_hand(one.child) or opens_gripper(one.name, one.child)
            for one in below
        )


def _is_one_sided(joint: UrdfJoint) -> bool:
    if joint.kind != "revolute" or joint.limits is None:
        return False
    lower, upper = joint.limits
    return lower < upper and (-lower < _ONE_SIDED * upper or upper < _ONE_SIDED * -lower)


def _range_signs(joint: UrdfJoint, others: Sequence[UrdfJoint]) -> int:
    """What the range of a last joint says of it, held against those ahead of it."""
    if joint.kind == "continuous":
        return int(not any(one.kind == "continuous" for one in others))
    lower, upper = joint.limits or (0.0, 0.0)
    widths = sorted(one.limits[1] - one.limits[0] for one in others if one.kind == "revolute" and one.limits)
    narrow = bool(widths) and upper - lower < min(_NARROW * widths[len(widths) // 2], _WIDEST_JAW)
    if _is_one_sided(joint):
        return narrow + 2 * (2 * sum(map(_is_one_sided, others)) <= len(others))
    return -2 if lower <= -math.pi / 2 and upper >= math.pi / 2 else int(narrow)
