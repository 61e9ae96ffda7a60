"""Carries out commands: checks the state, begins what is asked for, answers the ticket."""

from __future__ import annotations

import math
from functools import partial
from typing import get_args

import msgspec
import numpy as np

import armctl.protocol.commands as c
from armctl.arrays import FloatArray
from armctl.decoding import must_be
from armctl.errors import ArmctlError, BoardError, InputError, MotionRefusedError, StateError
from armctl.facts import Need, State
from armctl.facts.angles import to_degrees
from armctl.facts.commands import ShareOutside
from armctl.kinematics.target import as_numbers, checked_number
from armctl.motion import Trajectory, plan_choice, plan_joints
from armctl.motion.choices import not_the_best
from armctl.program.feed import require_runnable
from armctl.protocol.commands import FOLLOW_EXPIRY_S, JOG_EXPIRY_S, STREAM_EXPIRY_S
from armctl.protocol.snapshot import tool_turns
from armctl.robot import CarriedPart
from armctl.runtime.activity import Order
from armctl.runtime.core import Core
from armctl.runtime.homing import home
from armctl.runtime.jog import Jogger
from armctl.runtime.live_target import Follower, Streamer
from armctl.runtime.mover import PathMover
from armctl.runtime.planner import checked_trajectory
from armctl.runtime.power import enable, limit_torque, set_output
from armctl.runtime.program_feed import begun_program
from armctl.runtime.program_runner import ProgramRunner
from armctl.runtime.releasing import let_down

_STOPPED_FOLLOWING = "the arm was stopped; switch the live target on again once it stands"
FASTEST_TOOL_M_S, FASTEST_TURN_RAD_S = 0.5, math.pi
"""What the tool may be jogged at; the joints' own limits are mostly lower."""


def dispatch(core: Core, order: Order, now: float) -> None:
    """Carry out one order; a refusal goes to its ticket and into the log."""
    try:
        if core.leaving is not None and not isinstance(order.command, c.Release):
            raise StateError("disconnecting as soon as the arm stands")
        if not isinstance(order.command, c.ControlCommand):
            core.desk.require(order.origin.who)
        if isinstance(order.command, c.MovingCommand) and not isinstance(order.command, c.HeldCommand):
            core.require_no_gap(now)
        if _carry_out(core, order, now):
            order.ticket.end()
    except ArmctlError as error:
        # without where it came from, which leads back to the order: a flood of refusals is no garbage then
        core.refuse(order, order.label, error.with_traceback(None))
        if isinstance(error, BoardError) and core.board is not None:
            core.fault(error)


def _carry_out(core: Core, order: Order, now: float) -> bool:
    """Whether it is over at once."""
    who = order.origin.who
    match order.command:
        case c.MoveJoints(q, duration_s, profile):
            start, goal = _held_at(core, "a motion"), core.robot.check_limits(q)
            core.plan(order, "move", start, None, plan_joints, goal, duration_s, profile)
            return False
        case c.MoveTo(target, choose, duration_s, profile):
            start = _held_at(core, "a motion")
            take = partial(_to_a_point, core, order)
            core.plan(order, _TO_A_POINT, start, take, plan_choice, target, choose, duration_s, profile)
            return False
        case c.Follow(trajectory):
            core.plan(order, "trajectory", _held_at(core, "a motion"), None, checked_trajectory, trajectory)
            return False
        case c.RunProgram(program, loops, first, count):
            take, label = partial(ProgramRunner, core, loops, first), f"program {program.name!r}"
            start = _held_at(core, "a motion")
            core.plan(order, label, start, take, begun_program, program, loops, first, count)
            return False
        case c.UpdateProgram():
            _update_program(core, order, order.command)
            return False
        case c.ConfirmMessage(number):
            _confirm(core, order.command, number, who)
        case c.MoveGripper(opening, part_mm):
            _move_gripper(core, opening, CarriedPart.of(part_mm), order)
            return False
        case c.HomeAxes():
            home(core, order, now)
            return False
        case c.StreamJoints(q, last):
            checked = core.robot.check_limits(q)
            _stream(core, msgspec.structs.replace(order.command, q=checked), order, now)
            return not last
        case c.Cancel(motion):
            core.cancel(motion, order.origin, order.ticket)
            return False
        case c.Pause():
            core.pause(who)
        case c.Resume():
            core.resume(who)
        case c.SetSpeed(fraction):
            core.set_speed(checked_number(fraction, "the speed"), who)
        case c.Jog() | c.JogTool():
            _jog(core, order.command, order, now)
        case c.FollowTarget():
            _follow_target(core, order.command, order, now)
        case c.ControlCommand():
            return _about_control(core, order, now)
        case _:
            return _about_board(core, order, now)
    return True


def _about_board(core: Core, order: Order, now: float) -> bool:
    """Its line, its outputs; whether it is over at once."""
    who = order.origin.who
    match order.command:
        case c.Enable():
            return enable(core, order.command, order, now)
        case c.Disconnect():
            return core.leave(order.ticket, who)
        case c.Connect(port):
            core.connect(order, port, now)
            return False
        case c.Release(joints):
            return let_down(core, order.ticket, who, now, joints)
        case c.LimitTorque(share, joints):
            limit_torque(core, share, joints, who)
        case c.SetOutput(name, value):
            set_output(core, name, value, who)
        case c.SetTool(name):
            core.set_tool(name, who, now)
        case c.SimulateInput(name, value):
            core.signals.simulate(core.board, name, value, who)
        case c.PlayInputs(script):
            core.signals.play(core.board, script, who)
        case c.ClearFault():
            core.clear_fault(who)
        case _:
            raise InputError(f"not a command: {order.command!r}")
    return True


def _about_control(core: Core, order: Order, now: float) -> bool:
    """Who operates; whether it is over at once."""
    who = order.origin.who
    match order.command:
        case c.Arrive(name, watch):
            core.desk.arrive(order.origin, name, now, watch=watch)
        case c.Leave(why):
            party = core.desk.control.party(who)
            operated = core.desk.leave(who, why, now)
            if operated and party is not None and core.busy and core.state is not State.PAUSED:
                core.stop(c.Origin(party.name, why))
        case c.TakeControl(pin):
            return core.desk.take(order.origin, pin, now, order.ticket)
        case c.LockControl(locked, pin):
            return core.desk.lock(order.origin, locked, pin, now, order.ticket)
        case c.LendControl(to):
            core.desk.lend(who, to)
        case c.RememberWrongPins(wrong_pins):
            core.desk.remember(wrong_pins, now)
        case _:
            raise InputError(f"not a command: {order.command!r}")
    return True


def _held_at(core: Core, what: str) -> FloatArray:
    """Where the arm holds (n,) [rad]."""
    core.require(Need.HOLDING, what)
    if core.gate.q is None:
        raise StateError("nobody knows where the arm is; enable again")
    return core.gate.q


def _jog(core: Core, command: c.Jog | c.JogTool, order: Order, now: float) -> None:
    if core.still_held(order.given_at):
        raise StateError("the arm was stopped while it was jogged; let go first")
    if isinstance(command, c.Jog):
        wanted: c.Jog | c.JogTool = c.Jog(_checked_rate(core, command.rate))
    else:
        wanted = _checked_tool_jog(core, command)
    core.require(Need.JOG, "a jog")
    activity = core.led_by(wanted)
    if activity is None:
        q = _held_at(core, "a jog")
        if not (wanted.twist if isinstance(wanted, c.JogTool) else wanted.rate).any():
            return
        activity = Jogger(core.robot, core.clear, q, core.speed)
        core.begin(activity, order.origin.who, now)
    activity.lead(wanted, order.given_at + JOG_EXPIRY_S)


def _follow_target(core: Core, command: c.FollowTarget, order: Order, now: float) -> None:
    activity, leaves = core.led_by(command), command.target is None
    stopping = activity is not None and core.stopped_by is not None
    if not leaves and (core.still_held(order.given_at) or stopping):
        raise StateError(_STOPPED_FOLLOWING)
    if activity is None:
        if leaves:
            return
        q = _held_at(core, "to follow a target")
        activity = Follower(core.robot, core.clear, q, core.speed, core.submit)
        core.begin(activity, order.origin.who, now)
    activity.lead(command, order.given_at + FOLLOW_EXPIRY_S)


def _stream(core: Core, command: c.StreamJoints, order: Order, now: float) -> None:
    motion = order.motion
    if not motion:
        raise InputError("a stream needs a name of its own (motion), so that a STOP ends it")
    if motion == core.stopped_motion:
        raise StateError(f"the setpoint stream is over ({core.cause}); begin another one")
    activity = core.led_by(command)
    if activity is None:
        activity = Streamer(core.robot, core.clear, _held_at(core, "a setpoint stream"), core.speed)
        core.begin(activity, order.origin.who, now, motion=motion)
    elif motion != core.motion:
        raise StateError("another setpoint stream runs; stop it first")
    elif core.stopped_by is not None:
        raise StateError("the arm is stopping; begin another stream once it stands")
    activity.lead(command, order.given_at + STREAM_EXPIRY_S)
    if command.last:
        core.await_last(order.ticket)


def _checked_rate(core: Core, rate: FloatArray) -> FloatArray:
    """A copy of ``rate`` (n,) that may be jogged with: its sender may go on writing to it."""
    rate = as_numbers(rate, "the rates of a jog")
    if rate.shape != (core.robot.n,) or not np.isfinite(rate).all() or bool((np.abs(rate) > 1).any()):
        raise InputError(f"a jog needs {core.robot.n} rates between -1 and 1, got {rate.tolist()}")
    for joint, value in zip(core.robot.joints, rate, strict=True):
        if value and joint.lower == joint.upper:
            raise InputError(
                f"{joint.title} is held at {joint.said(joint.lower)}: both its limits are there, "
                "it cannot be jogged"
            )
    return rate


def _checked_rest(rests_s: float | None) -> float | None:
    if rests_s is not None and not checked_number(rests_s, "the time in which a jog rests") > 0.0:
        raise InputError(f"a jog rests within a time that is more than 0 s, got {rests_s:g} s")
    return rests_s


def _checked_tool_jog(core: Core, jog: c.JogTool) -> c.JogTool:
    """A copy of ``jog`` that the tool may be moved with."""
    linear = as_numbers(jog.linear, "the speeds of a jog")
    turns = (checked_number(jog.pitch_rate, "the pitch rate"), checked_number(jog.roll_rate, "the roll rate"))
    if linear.shape != (3,) or not np.isfinite(linear).all():
        raise InputError(f"a jog of the tool needs three speeds, got {linear.tolist()}")
    if jog.frame not in get_args(c.Frame):
        raise InputError(f"a jog's frame {must_be(get_args(c.Frame))}, not {jog.frame!r}")
    angular = None if jog.angular is None else as_numbers(jog.angular, "the turn of a jog")
    if angular is not None and (angular.shape != (3,) or not np.isfinite(angular).all()):
        raise InputError(f"a jog of the tool turns it about three axes, got {angular.tolist()}")
    jog = msgspec.structs.replace(
        jog, linear=linear, pitch_rate=turns[0], roll_rate=turns[1], angular=angular,
        rests_s=_checked_rest(jog.rests_s),
    )  # fmt: skip
    speed, rate = float(np.linalg.norm(linear)), float(np.abs(jog.twist[3:]).max())
    if speed > FASTEST_TOOL_M_S or rate > FASTEST_TURN_RAD_S:
        raise InputError(
            f"a jog of the tool at {1000 * speed:.0f} mm/s and {to_degrees(rate):.0f} °/s is too fast; "
            f"at most {1000 * FASTEST_TOOL_M_S:.0f} mm/s and {to_degrees(FASTEST_TURN_RAD_S):.0f} °/s"
        )
    if angular is not None and angular.any() and not core.robot.orients_tool:
        raise InputError(f"the tool of {core.robot.name} cannot turn about any axis while its point stays")
    if rate:
        pitches, rolls = tool_turns(core.robot)
        for turn, can, name in ((jog.pitch_rate, pitches, "pitch"), (jog.roll_rate, rolls, "roll")):
            if turn and not can:
                raise InputError(f"the tool of {core.robot.name} cannot {name} while its point stays")
    return jog


_TO_A_POINT = "move to a point"


def _to_a_point(core: Core, order: Order, planned: tuple[Trajectory, MotionRefusedError | None]) -> PathMover:
    trajectory, refusal = planned
    if refusal is not None:
        core.log.warn(f"{_TO_A_POINT} ({order.origin.who}): {not_the_best(refusal)}")
    return PathMover(core.robot, trajectory, core.speed, _TO_A_POINT)


def _move_gripper(core: Core, opening: float, part: CarriedPart | None, order: Order) -> None:
    gripper = core.robot.gripper
    if gripper is None or core.board is None or not core.board.grips:
        tool = f" with the tool {core.robot.tool!r} on" if core.robot.tool else ""
        nothing = f"has no gripper{tool}"
        what = "is not connected" if gripper is not None and core.board is None else nothing
        raise StateError(f"{core.robot.name} {what}")
    opening = checked_number(opening, f"the opening of {gripper.title}")
    if not 0 <= opening <= 1:
        raise InputError(ShareOutside("gripper", opening, 0, 1, gripper.title))
    core.require(Need.GRIPPER, "the gripper")
    core.move_gripper(order, opening, part)


def _confirm(core: Core, command: c.ConfirmMessage, number: int, who: str) -> None:
    runner = core.led_by(command)
    if runner is None or runner.awaits != number:
        raise StateError("no message waits for this OK any more: the program has gone on, or has ended")
    runner.lead(command, math.inf)
    core.log.add(f"OK to the message ({who})")


def _update_program(core: Core, order: Order, command: c.UpdateProgram) -> None:
    runner, program = core.led_by(command), command.program
    if runner is None:
        raise StateError("no program runs; press Run")

    def take(_: None) -> None:
        if core.activity is not runner:  # another run may have begun: the edit was not for it
            raise StateError("the program has ended; run it again")
        runner.lead(command, math.inf)
        name, who = program.name, order.origin.who
        core.log.add(f"program {name!r} was edited; this takes effect at the next pass ({who})")

    future = core.submit(require_runnable, core.robot, program)
    core.await_edit(order, f"edit of {program.name!r}", future, take)
