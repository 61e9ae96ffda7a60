"""What commands need of the arm. The controller refuses by it, and pages tell by it beforehand."""

from __future__ import annotations

from dataclasses import dataclass

from armctl.facts import Need, NotNow, State
from armctl.kinematics.velocity import position_leaves_pitch
from armctl.robot import Robot

POWERED = (State.HOLDING, State.MOVING, State.PAUSED)
_MET_IN = {
    Need.HOLDING: (State.HOLDING,),
    Need.JOG: (State.HOLDING,),
    Need.PAUSE: (),
    Need.GRIPPER: POWERED,
    Need.OFF: (State.OFF,),
    Need.OFF_OR_HOLDING: (State.OFF, State.HOLDING),
    Need.HOLDING_SOME: (State.HOLDING,),
}


@dataclass(frozen=True, slots=True)
class Doing:
    """What moves the arm now, as far as it decides which commands are taken."""

    label: str
    """its name"""
    pausable: bool
    gripping: bool
    """the gripper is not free"""
    stopping: bool
    """it comes to rest, and does not go on"""
    notice: str | None = None
    """what holds it back, in words"""
    jogged: bool = False
    """it goes on by jogs"""

    def takes(self, need: Need) -> bool:
        """Whether what needs this is taken meanwhile."""
        match need:
            case Need.GRIPPER:
                return not self.gripping
            case Need.PAUSE:
                return self.pausable and not self.stopping
            case _:
                return need is Need.JOG and self.jogged and not self.stopping


def unmet(
    need: Need,
    state: State,
    *,
    asked: str = "",
    connected: bool,
    homed: bool,
    cause: str = "",
    doing: Doing | None = None,
    limp: tuple[str, ...] = (),
) -> NotNow | None:
    """Why a command is refused, and what to do: "off; enable first". None: its need is met.

    ``asked``: what is asked for; ``connected``: there is a board; ``homed``: every axis that has to knows
    where it is; ``cause``: of the state, to be named in the answer; ``doing``: what moves the arm; ``limp``:
    titles of joints that were released by themselves.
    """
    if limp and need is Need.OFF and state is State.HOLDING:  # Enable takes them back
        return None
    if state is not State.HOLDING or need not in (Need.HOLDING, Need.JOG):
        limp = ()
    if not limp and (state in _MET_IN[need] if doing is None else doing.takes(need)):
        return None
    label, stopping = ("", False) if doing is None else (doing.label, doing.stopping)
    return NotNow(asked, need, state, cause, label, stopping, connected, homed, limp)


def tool_turns(robot: Robot) -> tuple[bool, bool]:
    """Whether the tool of an arm can be pitched, and rolled, while its point stays."""
    roll = robot.inverse_kinematics.roll_joint
    rolls = roll is not None and bool(robot.limits[roll, 0] < robot.limits[roll, 1])
    return position_leaves_pitch(robot.chain, robot.limits), rolls
