"""Carries out commands: checks the state, begins what is asked for, answers the ticket."""

from __future__ import annotations

import math
from concurrent.futures import Future
from dataclasses import dataclass, replace

import numpy as np

import armctl.runtime.commands as c
from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, BoardError, InputError, StateError
from armctl.kinematics import Target
from armctl.motion import Trajectory, plan_joints, plan_target
from armctl.program import Program, require_runnable
from armctl.runtime.core import POWERED, Core
from armctl.runtime.joint_servo import tool_turns
from armctl.runtime.led import JOG_EXPIRY_S, Jogger
from armctl.runtime.live_target import FOLLOW_EXPIRY_S, Follower, LiveGoal, live_goal
from armctl.runtime.mover import PathMover
from armctl.runtime.planner import PendingEdit, PendingMotion, checked_trajectory
from armctl.runtime.power import enable, hint, home, release
from armctl.runtime.program_runner import ProgramRunner, begun_program
from armctl.runtime.snapshot import State

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
    ticket: c.Ticket
    given_at: float
    """controller clock [s]"""
    number: int
    """in the order in which they were given, stops included"""


def dispatch(core: Core, order: Order, now: float) -> None:
    """Carry out one order; a refusal goes to its ticket and into the log."""
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
            core.connect(port, who, now)
        case c.Disconnect():
            return core.leave(order.ticket, who)
        case c.Enable(q):
            enable(core, q, who, now)
        case c.HomeAxes():
            home(core, order.ticket, who, now)
            return False
        case c.Release():
            release(core, who)
        case c.ClearFault():
            core.clear_fault(who)
        case c.Pause():
            core.pause(who)
        case c.Resume():
            core.resume(who)
        case c.SetSpeed(fraction):
            core.set_speed(fraction, who)
        case c.Jog() | c.JogTool():
            _jog(core, order.command, order, now)
        case c.FollowTarget(target):
            _follow_target(core, target, order, now)
        case c.MoveGripper(opening):
            _move_gripper(core, opening, order)
            return False
        case c.RunProgram():
            _run_program(core, order.command, order)
            return False
        case c.UpdateProgram(program):
            _update_program(core, program, order)
            return False
        case c.MoveJoints(q, duration_s, profile):
            start, goal = _standing_start(core), core.robot.check_limits(q)
            future = core.planner.submit(plan_joints, core.robot, start, goal, duration_s, profile)
            return _move(core, order, start, future, "move")
        case c.MoveTo(target, choose, duration_s, profile):
            start = _standing_start(core)
            future = core.planner.submit(plan_target, core.robot, start, target, choose, duration_s, profile)
            return _move(core, order, start, future, "move to a point")
        case c.Follow(trajectory):
            start = _standing_start(core)
            future = core.planner.submit(checked_trajectory, core.robot, start, trajectory)
            return _move(core, order, start, future, "trajectory")
    return True


def _move(core: Core, order: Order, start: FloatArray, future: Future[Trajectory], label: str) -> bool:
    who = order.origin.who
    core.await_motion(
        PendingMotion(
            order.ticket,
            who,
            label,
            start,
            future,
            lambda: PathMover(core.robot, future.result(), core.speed, label),
        )
    )
    return False


def _standing_start(core: Core) -> FloatArray:
    """Where the arm holds (n,) [rad], if a motion may begin from there."""
    q = _held_at(core, "a motion")
    if core.motion is not None:
        raise StateError("another motion is being planned; stop it first")
    return q


def _held_at(core: Core, what: str) -> FloatArray:
    """Where the arm holds (n,) [rad]."""
    q = core.gate.q
    if core.state is not State.HOLDING or q is None:
        raise StateError(f"{what} needs the arm holding, it is {core.state.value}{hint(core)}")
    return q


def _jog(core: Core, command: c.Jog | c.JogTool, order: Order, now: float) -> None:
    if core.still_held(order.given_at):
        raise StateError("the arm was stopped while it was jogged; let go first")
    wanted = (
        _checked_rate(core, command.rate) if isinstance(command, c.Jog) else _checked_tool_jog(core, command)
    )
    activity = core.activity
    if not isinstance(activity, Jogger):
        q = _held_at(core, "a jog")
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
    if core.still_held(order.given_at):
        raise StateError(_STOPPED_FOLLOWING)
    if not isinstance(activity, Follower):
        q = _held_at(core, "to follow a target")

        def solve(q: FloatArray, target: Target, pitch: float | None) -> Future[LiveGoal]:
            return core.planner.submit(live_goal, core.robot, core.clear, q, target, pitch)

        activity = Follower(core.robot, core.clear, q, core.speed, solve)
        core.begin(activity, None, order.origin.who, now)
    elif core.stopped_by:
        raise StateError(_STOPPED_FOLLOWING)
    activity.aim(target, order.given_at + FOLLOW_EXPIRY_S)


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


def _move_gripper(core: Core, opening: float, order: Order) -> None:
    gripper = core.robot.gripper
    if gripper is None or core.board is None or core.board.outputs.map.gripper_channel is None:
        what = "is not connected" if gripper is not None and core.board is None else "has no gripper"
        raise StateError(f"{core.robot.name} {what}")
    if not 0 <= opening <= 1:
        raise InputError(f"{gripper.title}: {100 * opening:g} % is outside 0 … 100 %")
    if core.state not in POWERED or core.gate.q is None:
        raise StateError(f"the gripper needs the arm enabled, it is {core.state.value}{hint(core)}")
    if isinstance(core.activity, ProgramRunner) and core.activity.gripping:
        raise StateError("the program moves the gripper now; stop or wait")
    core.gripper.move_to(float(opening), order.ticket)
    order.ticket.accept()


def _run_program(core: Core, command: c.RunProgram, order: Order) -> None:
    start = _standing_start(core)
    robot, program, loops, first = core.robot, command.program, command.loops, command.first
    future = core.planner.submit(begun_program, robot, program, loops, first, command.count, start)

    def take() -> ProgramRunner:
        return ProgramRunner(robot, loops, first, future.result(), core.planner, core.gripper, core.speed)

    label = f"program {program.name!r}"
    core.await_motion(PendingMotion(order.ticket, order.origin.who, label, start, future, take))


def _update_program(core: Core, program: Program, order: Order) -> None:
    runner = core.activity
    if not isinstance(runner, ProgramRunner):
        raise StateError("no program runs; press Run")

    def take() -> None:
        if core.activity is not runner:  # another run may have begun: the edit was not for it
            raise StateError("the program has ended; run it again")
        runner.update(program)
        name, who = program.name, order.origin.who
        core.log.info(f"program {name!r} was edited; this takes effect at the next pass ({who})")

    future = core.planner.submit(require_runnable, core.robot, program)
    label = f"edit of {program.name!r}"
    core.await_edit(PendingEdit(order.ticket, order.origin.who, label, future, take))
