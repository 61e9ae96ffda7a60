"""Which tool of its arm is on: the arm with each of them, prepared, and how it is changed."""

from __future__ import annotations

from armctl.errors import EnableError
from armctl.facts import ToolToConfirm
from armctl.lazy_dataclass import dataclass
from armctl.motion import Floor, Obstacles
from armctl.motion.clearance import kept_out
from armctl.robot import Gripper, Robot
from armctl.robot.tools import own_gripper, tool_of
from armctl.runtime.joint_servo import KeepClear

Around = tuple[Floor | Obstacles, ...]


@dataclass(frozen=True, slots=True)
class EquippedArm:
    """An arm with one of its tools on."""

    robot: Robot
    around: Around
    """what it must stay out of"""
    clear: KeepClear
    """what jogs and live targets stay clear by"""

    @property
    def switched_gripper(self) -> Gripper | None:
        """What comes on with the arm: what grips with this tool, or else the arm's own gripper."""
        return self.robot.gripper or own_gripper(self.robot)


class ToolRack:
    """The arm with each of its tools, worked out ahead: to change one takes no time from a tick.

    On a real board somebody has to say which tool is on before anything is switched on: the computer cannot
    see it, and the tip of another one would be elsewhere. One tool alone leaves nothing to say.
    """

    def __init__(self, robot: Robot) -> None:
        arms = [robot.with_tool(tool.name) for tool in robot.tools] or [robot]
        self._arms = {arm.tool: EquippedArm(arm, kept_out(arm), KeepClear(arm)) for arm in arms}
        self.on = self._arms[robot.tool]
        """the arm with the tool that is on"""
        self.unconfirmed = False
        """nobody has said since the connection that this one is on"""
        self._said = False
        """somebody has said so at some time: that is newer than where the arm was seen last"""

    def change(self, name: str) -> None:
        """Another tool is on from now on; ``InputError``: there is none of that name."""
        self.on = self._arms[tool_of(self.on.robot.tools, name).name]
        self.unconfirmed, self._said = False, True

    def connected(self, *, simulated: bool) -> None:
        """A board is connected: what is on its arm, nobody knows but by having looked."""
        self.unconfirmed = len(self._arms) > 1 and not simulated

    def presume(self, name: str) -> bool:
        """A tool was on when the arm was seen last; whether that is another one than it was taken for."""
        known = self._arms.get(name, self.on)
        if not self.unconfirmed or self._said or known is self.on:
            return False
        self.on = known
        return True

    def require_confirmed(self) -> None:
        """Refuse (``EnableError``) to switch on what may have another tool on."""
        if self.unconfirmed:
            raise EnableError(ToolToConfirm(self.on.robot.tool, tuple(self._arms)))
