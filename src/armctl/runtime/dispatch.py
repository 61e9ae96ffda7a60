"""What each command does: checks the state, begins it, answers on its ticket."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError, BoardError, InputError, StateError
from armctl.kinematics import Target
from armctl.motion import Trajectory
from armctl.program import Program
from armctl.runtime import commands as c
from armctl.runtime import power
from armctl.runtime.core import POWERED, Core
from armctl.runtime.led import JOG_EXPIRY_S, Jogger
from armctl.runtime.live_target import FOLLOW_EXPIRY_S, Follower
from armctl.runtime.planner import Pending, PendingEdit
from armctl.runtime.program_runner import ProgramRunner
from armctl.runtime.snapshot import State
from armctl.runtime.ticket import Ticket
from armctl.runtime.tool_line import tool_turns

FloatArray = NDArray[np.float64]
SLOWEST = 0.05
JOG_GAP_S = 0.2
"""A jog that was held during a STOP must be let go for this long before it moves the arm again."""
_TURNS = ("pitch", "roll")
_STOPPED_FOLLOWING = "the arm was stopped; switch the live target on again once it stands"
FASTEST_TOOL_M_S, FASTEST_TURN_RAD_S = 0.5, math.pi
"""What the tool may be jogged at; the joints' own limits are mostly lower."""
HELD = (c.Jog, c.JogTool, c.FollowTarget)
"""Commands that count only for a moment: whoever gives them goes on giving them."""
MOVING = (
    c.Enable,
    c.HomeAxes,
    c.Resume,
    c.MoveJoints,
    c.MoveTo,
    c.Follow,
    *HELD,
    c.MoveGripper,
    c.RunProgram,
)
"""Commands that a STOP drops when they were given before it."""


@dataclass(frozen=True, slots=True)
class Order:
    """A command on its way to the controller thread."""

    command: c.Command
    origin: c.Origin
    ticket: Ticket
    given_at: float
    """controller clock [s]"""
    number: int
    """in the order in which they were given, stops included"""


def dispatch(core: Core, order: Order, now: float) -> None:
    """Carry out one order; whatever refuses it ends up on its ticket and in the log."""
    try:
        if core.leaving is not None and not isinstance(order.command, c.Release):
            raise StateError("disconnecting as soon as the arm stands")
        if _carry_out(core, order, now):
            order.ticket.finish()
    except ArmctlError as error:
        name = type(order.command).__name__
        core.log.warning(f"{name} ({order.origin.who}) refused: {error}")
        order.ticket.refuse(error)
        if isinstance(error, BoardError) and core.board is not None:
            core.fault(error)


def _carry_out(core: Core, order: Order, now: float) -> bool:
    """Whether it is over at once."""
    who = order.origin.who
    match order.command:
        case c.Connect(port):
            power.connect(core, port, who, now)
        case c.Disconnect():
            return _disconnect(core, order, who)
        case c.Enable(q):
            power.enable(core, q, who, now)
        case c.HomeAxes():
            power.home(core, order.ticket, who, now)
            return False
        case c.Release():
            power.release(core, who)
        case c.ClearFault():
            power.clear_fault(core, who)
        case c.Pause():
            _pause(core, who)
        case c.Resume():
            _resume(core, who)
        case c.SetSpeed(fraction):
            _set_speed(core, fraction, who)
        case c.Jog(rate):
            _jog(core, lambda: _checked_rate(core, rate), order, now)
        case c.JogTool() as tool_jog:
            _jog(core, lambda: _checked_tool_jog(core, tool_jog), order, now)
        case c.FollowTarget(target):
            _follow_target(core, target, order, now)
        case c.MoveGripper(opening):
            return _move_gripper(core, opening, order)
        case c.RunProgram():
            return _run_program(core, order.command, order)
        case c.UpdateProgram(program):
            return _update_program(core, program, order)
        case c.MoveJoints(q, duration_s, profile):
            start = _standing_start(core)
            goal = core.robot.check_limits(q)
            return _plan(core, order, start, core.planner.joints(start, goal, duration_s, profile), "move")
        case c.MoveTo(target, choose, duration_s, profile):
            start = _standing_start(core)
            future = core.planner.target(start, target, choose, duration_s, profile)
            return _plan(core, order, start, future, "move to a point")
        case c.Follow(trajectory):
            start = _standing_start(core)
            return _plan(core, order, start, core.planner.check(start, trajectory), "trajectory")
    return True


def _plan(core: Core, order: Order, start: FloatArray, future: Future[Trajectory], label: str) -> bool:
    core.upcoming.await_motion(Pending(order.ticket, order.origin.who, start, label, future))
    return False


def _standing_start(core: Core) -> FloatArray:
    """Where the arm holds (n,) [rad], if a motion may begin from there."""
    q = core.gate.q
    if core.state is not State.HOLDING or q is None:
        raise StateError(f"a motion needs the arm holding, it is {core.state.value}{_hint(core)}")
    if core.upcoming.has_motion:
        raise StateError("another motion is being planned; stop it first")
    return q


def _hint(core: Core) -> str:
    match core.state:
        case State.DISCONNECTED:
            return "; connect and enable first"
        case State.OFF:
            homing = core.monitor.reading.homing
            return "; enable first" if homing is None or homing.done else f"; {power.HOME_FIRST}"
        case State.MOVING | State.PAUSED:
            return f" ({core.cause}); stop first"
        case State.FAULT:
            return f" ({core.cause}); clear the fault first"
        case State.HOLDING:
            return ""


def _disconnect(core: Core, order: Order, who: str) -> bool:
    if core.state is State.DISCONNECTED:
        return True
    if core.activity is not None:
        core.stop(c.Origin(f"disconnect, {who}"), Ticket())
        core.leaving = order.ticket
        return False
    core.disconnect(f"disconnected ({who})")
    return True


def _pause(core: Core, who: str) -> None:
    activity = core.activity
    if activity is None or core.state not in (State.MOVING, State.PAUSED):
        raise StateError(f"there is nothing to pause: {core.state.value}")
    if core.stopped_by:
        raise StateError("the arm is stopping; let it come to rest")
    if not activity.pausable:
        raise StateError(f"{activity.label} cannot be paused; press STOP")
    activity.pause()
    core.pausing = True
    core.log.info(f"pause ({who})")
    core.cause = f"{activity.label} pausing ({who})" if core.state is State.MOVING else core.cause


def _resume(core: Core, who: str) -> None:
    activity = core.activity
    if activity is None or not core.pausing:
        raise StateError(f"there is nothing to resume: {core.state.value}")
    activity.resume()
    core.pausing = False
    core.enter(State.MOVING, f"{activity.label} resumed ({who})")


def _set_speed(core: Core, fraction: float, who: str) -> None:
    if not SLOWEST <= fraction <= 1:
        raise InputError(f"a speed of {100 * fraction:g} % is outside {100 * SLOWEST:.0f} … 100 %")
    core.speed = float(fraction)
    if core.activity is not None:
        core.activity.set_speed(core.speed)
    core.log.info(f"speed {100 * fraction:.0f} % ({who})")


def _jog(core: Core, checked: Callable[[], FloatArray | c.JogTool], order: Order, now: float) -> None:
    _require_let_go(core, order, "the arm was stopped while it was jogged; let go first")
    wanted = checked()
    activity = core.activity
    if not isinstance(activity, Jogger):
        q = _led_start(core, "a jog")
        if not (wanted.twist if isinstance(wanted, c.JogTool) else wanted).any():
            return
        activity = Jogger(core.robot, core.clear, q, core.speed)
        core.begin(activity, None, order.origin.who, now)
    elif core.stopped_by:
        raise StateError("the arm is stopping; let go first")
    activity.command(wanted, order.given_at + JOG_EXPIRY_S)


def _follow_target(core: Core, target: Target | None, order: Order, now: float) -> None:
    activity = core.activity
    if target is None:
        if isinstance(activity, Follower):
            activity.stop()
        return
    _require_let_go(core, order, _STOPPED_FOLLOWING)
    if not isinstance(activity, Follower):
        q = _led_start(core, "to follow a target")
        activity = Follower(core.robot, core.clear, q, core.speed, core.planner.live_goal)
        core.begin(activity, None, order.origin.who, now)
    elif core.stopped_by:
        raise StateError(_STOPPED_FOLLOWING)
    activity.aim(target, order.given_at + FOLLOW_EXPIRY_S)


def _require_let_go(core: Core, order: Order, why_not: str) -> None:
    """Refuse what is held since before a STOP: it must be let go of first."""
    gap = order.given_at - core.jogged_at
    core.jogged_at = order.given_at
    if core.jog_locked and gap < JOG_GAP_S:
        raise StateError(why_not)
    core.jog_locked = False


def _led_start(core: Core, what: str) -> FloatArray:
    """Where the arm holds (n,) [rad], if it may be led from there."""
    q = core.gate.q
    if core.state is not State.HOLDING or q is None:
        raise StateError(f"{what} needs the arm holding, it is {core.state.value}{_hint(core)}")
    return q


def _checked_rate(core: Core, rate: FloatArray) -> FloatArray:
    """A copy of ``rate`` (n,) that may be jogged with; whoever gave it may go on writing to it."""
    rate = np.array(rate, dtype=np.float64)
    if rate.shape != (core.robot.n,) or not np.isfinite(rate).all() or bool((np.abs(rate) > 1).any()):
        raise InputError(f"a jog needs {core.robot.n} rates between -1 and 1, got {rate.tolist()}")
    for joint, value in zip(core.robot.joints, rate, strict=True):
        if value and joint.lower == joint.upper:
            raise InputError(
                f"{joint.title} is held at {math.degrees(joint.lower):.2f}°: both its limits are there, "
                "it cannot be jogged"
            )
    return rate


def _checked_tool_jog(core: Core, jog: c.JogTool) -> c.JogTool:
    """A copy of ``jog`` that the tool may be moved with."""
    linear = np.array(jog.linear, dtype=np.float64)
    jog = replace(jog, linear=linear)
    if linear.shape != (3,) or not np.isfinite(jog.twist).all():
        raise InputError(f"a jog of the tool needs three speeds and two rates, got {jog.twist.tolist()}")
    speed, rate = float(np.linalg.norm(linear)), max(abs(jog.pitch_rate), abs(jog.roll_rate))
    if speed > FASTEST_TOOL_M_S or rate > FASTEST_TURN_RAD_S:
        raise InputError(
            f"a jog of the tool at {1000 * speed:.0f} mm/s and {math.degrees(rate):.0f} °/s is too fast; "
            f"at most {1000 * FASTEST_TOOL_M_S:.0f} mm/s and {math.degrees(FASTEST_TURN_RAD_S):.0f} °/s"
        )
    if rate:
        for turn, can, name in zip(
            (jog.pitch_rate, jog.roll_rate), tool_turns(core.robot), _TURNS, strict=True
        ):
            if turn and not can:
                raise InputError(f"the tool of {core.robot.name} cannot {name} while its point stays")
    return jog


def _move_gripper(core: Core, opening: float, order: Order) -> bool:
    gripper = core.robot.gripper
    if gripper is None or core.board is None or not core.board.outputs.has_gripper:
        what = "is not connected" if gripper is not None and core.board is None else "has no gripper"
        raise StateError(f"{core.robot.name} {what}")
    if not 0 <= opening <= 1:
        raise InputError(f"{gripper.title}: {100 * opening:g} % is outside 0 … 100 %")
    if core.state not in POWERED or core.gate.q is None:
        raise StateError(f"the gripper needs the arm enabled, it is {core.state.value}{_hint(core)}")
    if isinstance(core.activity, ProgramRunner) and core.activity.gripping:
        raise StateError("the program moves the gripper now; stop or wait")
    core.gripper.move_to(float(opening), order.ticket)
    order.ticket.accept()
    return False


def _run_program(core: Core, command: c.RunProgram, order: Order) -> bool:
    start = _standing_start(core)
    program, loops, first = command.program, command.loops, command.first
    future = core.planner.begin(program, loops, first, command.count, start)
    label = f"program {program.name!r}"
    core.upcoming.await_motion(Pending(order.ticket, order.origin.who, start, label, future, loops, first))
    return False


def _update_program(core: Core, program: Program, order: Order) -> bool:
    if not isinstance(core.activity, ProgramRunner):
        raise StateError("no program runs; press Run")
    future = core.planner.check_program(program)
    core.upcoming.await_edit(PendingEdit(order.ticket, order.origin.who, program, future))
    return False
