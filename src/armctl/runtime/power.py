"""Switching the outputs on and off, all of them or some: how the arm is taken over where it stands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import (
    BoardError,
    BoardTimeoutError,
    EnableError,
    InputError,
    MotionRefusedError,
    StateError,
)
from armctl.facts import Need, NotHomed, Several, StandsOutside, ToDo
from armctl.facts.angles import DEGREE
from armctl.facts.commands import (
    LineSlow,
    MotorsApart,
    NoBoard,
    NothingOn,
    NothingTo,
    OnUnconfirmed,
    PoseUnknown,
    ReadingsDiffer,
    Released,
    ShareOutside,
    UnknownName,
)
from armctl.hardware import Source
from armctl.hardware.boards import board_type
from armctl.kinematics import Chain
from armctl.kinematics.target import checked_number
from armctl.motion.clearance import touching
from armctl.protocol import Enable
from armctl.protocol.snapshot import POWERED
from armctl.runtime.activity import Activity, Order, Setpoint
from armctl.runtime.board import MOTORS_APART_RAD, Board, BoolArray, Reading
from armctl.runtime.core import Core

ADOPT_TOLERANCE_RAD = 0.25 * DEGREE
"""how far outside a limit a joint may stand when it is taken over, and two readings may differ"""
_ADOPT_TOLERANCE_STEPS = 1.5
"""the same in steps of the board, where these are coarser: an encoder at rest wavers by a count"""
LEAST_TORQUE = 0.05
"""share of the torque that a limit leaves at least: with none the arm would drop, which is a release"""
_INTERVAL_S = 0.3
"""from servo to servo: one at a time draws little current, and STOP can come between"""
_HELD_UP_S = 5.0
"""so long all ticks may come too late for anything to be switched on"""
_CONFIRM_READINGS = 5
_GRIPPER_OUTSIDE = 0.1
"""how far outside its ends a gripper may be measured when it is taken over, as a share of its way"""
_CONFIRMED_S = 2.0
"""so long a board may take to confirm that a servo came on"""
_UNKNOWN_OPENING = 0.5
"""where a gripper comes on that nobody has seen: so it jumps by half of its way at most"""


def enable(core: Core, command: Enable, order: Order, now: float) -> bool:
    """Pulses on where the arm stands; whether that is done at once: servos that were off take their time."""
    wanted, who = command.q, order.origin.who
    if core.state in POWERED and core.gate.q is not None and wanted is None and not core.limp:
        return True
    core.require(Need.OFF, "enable")
    if (board := core.board) is None:
        raise StateError(NoBoard())
    core.rack.require_confirmed()
    goal = core.robot.check_limits(core.robot.pose("rest") if wanted is None else wanted)
    if command.opening is not None and not 0 <= checked_number(command.opening, "the opening") <= 1:
        raise InputError(ShareOutside("opening", command.opening, 0, 1))
    reading = _where_it_is(core, board, now)
    if reading.homing is not None and not reading.homing.done:
        raise EnableError(NotHomed())
    # Only what is measured says where a joint stands that is off.
    live = ~np.isnan(reading.q) & (reading.on | (reading.source is Source.MEASURED))
    if reading.source is Source.MEASURED and not live.all() and reading.errors:
        raise EnableError(NothingOn(reading.errors))
    if not (live.all() or wanted is not None or board.identity.simulated):
        raise EnableError(PoseUnknown(board.power, str(core.poses.last or "")))
    start = taken_over(core, board, np.where(live, reading.q, goal))
    led = bool(core.limp)  # by a hand, which may have led it into itself
    if (led or not live.all()) and (touch := touching(core.around, core.robot, start)) is not None:
        raise MotionRefusedError(Several((touch, ToDo("other pose"))))
    if wanted is not None and live.any() and (np.abs(start - goal) > _tolerance(board)).any():
        core.log.warn("enabled where the arm stands, not in the pose asked for: move there now")
    grips = board.grips
    if grips and reading.source is Source.MEASURED and reading.opening is None and reading.errors:
        raise EnableError(NothingOn(reading.errors))
    opening = _opening_inside(core, reading)
    if live.all() and (opening is not None or not grips):
        _retake(core, board)
        core.adopt(start, opening, now)
        try:
            board.write(start, None if reading.gripper_on is None else opening)
        except EnableError:
            core.forget()
            raise
        _require_on(core, board, now)
        core.hold(f"enabled ({who}); {_how_it_began(core, live, reading.source)}")
        return True
    if grips and opening is None:
        opening = _UNKNOWN_OPENING if command.opening is None else command.opening
    try:
        board.prepare(start, opening)
    except BoardTimeoutError as silence:
        raise EnableError(
            f"the board does not answer in time; nothing was switched on: {silence}"
        ) from silence
    _retake(core, board)
    core.monitor.enabled()
    core.presume(start)
    core.log.add(f"enable ({who}): {_how_it_began(core, live, reading.source)}")
    core.begin(Enabling(core, board, start, live, opening, now), who, now, order.ticket, order.motion)
    return False


def _opening_inside(core: Core, reading: Reading) -> float | None:
    """Where the gripper stands, 0 ... 1; refused where it is measured clearly outside: it would jump in."""
    opening, gripper = reading.opening, core.rack.on.switched_gripper
    if opening is None or gripper is None:
        return opening
    if reading.source is Source.MEASURED and not -_GRIPPER_OUTSIDE <= opening <= 1 + _GRIPPER_OUTSIDE:
        raise EnableError(
            f"{gripper.title}: it stands at {100 * opening:.0f} %, outside its 0 ... 100 %: turn it by hand, "
            "or set its two ends in the robot file"
        )
    return min(1.0, max(0.0, opening))


def _require_on(core: Core, board: Board, now: float) -> None:
    """See that the outputs came on; an answer may get lost."""
    for _ in range(_CONFIRM_READINGS):
        seen = core.monitor.read(board, now)
        if seen is not None and seen.on.all() and seen.gripper_on is not False:
            return
    core.forget()
    raise EnableError(OnUnconfirmed(board.power))


def _retake(core: Core, board: Board) -> None:
    """An arm that held without some joints is taken over like one that is off: what is on stays on."""
    if core.limp:
        core.power_off("some joints are off; Enable takes the arm over as it stands")
        core.monitor.enabled()  # nothing was switched off
        board.take_back()


def release(core: Core, who: str, names: Sequence[str] | None = None) -> None:
    """Outputs off: the arm drops. Of some joints only, by name: these go limp, the others hold."""
    if core.board is None:
        raise StateError(NothingTo("release", core.state))
    if names is not None:
        core.drop_motion(StateError(Released(who, joints=True)))
        core.board.release_joints(named_joints(core, names))
        core.log.warn(f"RELEASE ({who}): {', '.join(core.limp)}: {core.board.power} off")
        return
    core.board.release()
    core.log.warn(f"RELEASE ({who}): {core.board.power} off")
    core.power_off(f"released ({who})")
    core.signals.switch(core.board, "release")


def limit_torque(core: Core, share: float, names: Sequence[str], who: str) -> None:
    """How strong the motors of some joints (none named: of all) may be, 0 ... 1."""
    joints = named_joints(core, names)
    if not LEAST_TORQUE <= checked_number(share, "the torque limit") <= 1:
        raise InputError(ShareOutside("torque limit", share, LEAST_TORQUE, 1))
    if core.board is None:
        raise StateError(NoBoard())
    q, reading = core.gate.q, core.monitor.reading
    if q is not None and reading.source is Source.MEASURED:
        sag = board_type(core.robot.board).sag_deg * DEGREE
        away = (np.abs(reading.q - q) > sag) & ~core.board.limp
        if away.any():  # a stronger motor would throw it back to its setpoint
            names = [core.robot.joints[i].title for i in np.flatnonzero(away)]
            raise StateError(
                f"{', '.join(names)}: away from where it was told to be; release the arm and enable it first"
            )
    core.board.limit_torque(share, joints)
    core.log.add(f"torque limit {100 * share:.0f} % of {', '.join(names) or 'all joints'} ({who})")


def set_output(core: Core, name: str, value: float, who: str) -> None:
    """Switch an output of the board that moves no joint; that of the gripper only where the arm is off."""
    core.require(Need.CONNECTED, f"output {name}")
    gripper = core.robot.gripper
    if gripper is not None and gripper.output == name and core.state in POWERED:
        raise StateError(
            f"output {name} is the gripper's, and what it holds counts in all that moves: use the gripper "
            "(on the page, in a program, with arm.gripper)"
        )
    core.signals.set(core.board, name, value)
    core.log.add(f"output {name}: {value:g} ({who})")


def named_joints(core: Core, names: Sequence[str]) -> BoolArray:
    """(n,) which joints these are, by name; none named: all."""
    known = core.robot.joint_names
    for name in names:
        if name not in known:
            raise InputError(UnknownName("joint", name, tuple(known)))
    return np.array([not names or name in names for name in known])


class Enabling(Activity):
    """Switches servos on, one after the other from the base outward, the gripper last; streams nothing.

    Each gets one pulse width, that of the pose in which the arm is said to stand. The arm is taken over once
    every servo has had the time to come there from the farthest end of its range, at the speed limit of its
    joint: what was said of the pose may be wrong. On the simulated board they come on from tick to tick.
    """

    label = "enabling"
    gripping = True  # it comes on with the arm

    def __init__(
        self, core: Core, board: Board, q: FloatArray, live: BoolArray, opening: float | None, now: float
    ) -> None:
        """``q`` (n,) [rad]; ``live`` (n,): what is on already; ``opening`` None: there is no gripper."""
        self._core, self._board = core, board
        self._q, self._opening = q, opening
        self._on, self._seen_on = live.copy(), live.copy()
        self._gripper_on = opening is None or core.monitor.reading.opening is not None
        self._last = core.monitor.reading
        self._quick = board.identity.simulated
        self._stopped = False
        self._next_at = self._arrived_at = self._asked_at = self._advanced_at = now
        core.monitor.take_dropped()  # of what was asked for before
        core.poses.switching_on(q, opening, now)
        if live.any():
            board.write(q, None, live)

    @property
    def standing(self) -> bool:
        """It is over."""
        return self.done

    @property
    def progress(self) -> float | None:
        """How many of the servos are on."""
        return float(np.mean([*self._seen_on, self._gripper_on]))

    @property
    def notice(self) -> str | None:
        """How far it is."""
        if self.done:
            return None
        count = f"{int(self._seen_on.sum())} of {len(self._on)} servos on"
        return f"enabling: {count}, they take their places; keep clear"

    def advance(self, now: float, dt: float) -> Setpoint | None:
        """Switch the next servo on, or take the arm over."""
        robot, reading = self._core.robot, self._core.monitor.reading
        gripper = self._core.rack.on.switched_gripper
        self._advanced_at = now
        if self._stopped:
            self._conclude()
        if self.done:
            return None
        if reading is not self._last:
            self._last = reading
            self._look_at(reading)
        if self.done or self._core.monitor.doubts:
            return None
        if self._waits_for_board(now):
            return None
        if not self._on.all():
            if now >= self._next_at:
                joint = np.arange(len(self._q)) == int(np.argmin(self._on))
                self._board.write(self._core.gate.checked(self._q), None, joint)
                self._on |= joint
                low, high = robot.limits.T
                farthest = np.maximum(self._q - low, high - self._q)
                self._wait(float((farthest / robot.speed_limits)[joint].item()), now)
        elif not self._gripper_on and gripper is not None and self._opening is not None:
            if now >= self._next_at:
                self._board.write(None, self._opening)
                self._gripper_on = True
                self._wait(max(self._opening, 1 - self._opening) / gripper.speed, now)
        elif now >= self._arrived_at:
            self._core.adopt(self._q, self._opening, now)
            self._core.monitor.enabled()
            self._done = True
        return None

    def stop(self) -> None:
        """Switch on no more; what is on, stays on. A fault that stops it has a cause of its own to tell."""
        self._stopped = True

    def halt(self) -> None:
        """Nothing is switched on for now; where that does not end, enabling does."""
        if self._stopped:
            self._conclude()
        elif self._core.monitor.read_at - self._advanced_at > _HELD_UP_S:
            self.error = EnableError(
                f"enabling ended: for {_HELD_UP_S:.0f} s this computer was too busy to switch a servo on "
                "safely; close other programs, then enable again"
            )
            self._conclude()

    def _look_at(self, reading: Reading) -> None:
        """End where the board reports an error; a fault where it has switched servos off that were on."""
        off = self._seen_on & ~reading.on
        self._seen_on |= self._on & reading.on
        gone = self._core.monitor.switched_off(off)
        if gone is not None:
            raise MotionRefusedError(gone)
        if dropped := self._core.monitor.take_dropped():
            self.error = EnableError(
                f"enabling ended: the line was busy for too long, {', '.join(dropped)} could not be "
                "switched on in time, and will not come on later; check the line and enable again"
            )
            self._conclude()
        elif reading.errors:
            self.error = BoardError(
                f"enabling ended, the board reports {'; '.join(reading.errors)}; see to that and enable again"
            )
            self._conclude()

    def _waits_for_board(self, now: float) -> bool:
        """Whether the board has yet to confirm the servo that was switched on last; too late ends it."""
        waiting = self._on & ~self._seen_on
        grips = self._gripper_on and self._opening is not None and self._core.monitor.reading.opening is None
        if not waiting.any() and not grips:
            self._asked_at = now
            return False
        if now - self._asked_at > _CONFIRMED_S:
            robot = self._core.robot
            titles = [robot.joints[i].title for i in np.flatnonzero(waiting)]
            if grips and (gripper := self._core.rack.on.switched_gripper) is not None:
                titles.append(gripper.title)
            self.error = EnableError(
                f"enabling ended: the board has not confirmed within {_CONFIRMED_S:.0f} s that "
                f"{', '.join(titles)} came on; check the line and the supply, then enable again"
            )
            self._conclude()
        return True

    def _conclude(self) -> None:
        """It was ended while the board goes on: say what is on."""
        if not self.done:
            self._board.hold()  # what still waits to be switched on must not come on later
        if not self.done and self._seen_on.any() and not self._seen_on.all():
            on = ", ".join(
                joint.title
                for joint, is_on in zip(self._core.robot.joints, self._seen_on, strict=True)
                if is_on
            )
            self._core.log.warn(f"{on}: on and held; the others are off. Enable goes on, Release ends it")
        self._done = True

    def _wait(self, arrival_s: float, now: float) -> None:
        if not self._quick:
            self._next_at = now + _INTERVAL_S
            self._arrived_at = max(self._arrived_at, now + arrival_s)


def _where_it_is(core: Core, board: Board, now: float) -> Reading:
    """What two readings agree on: answers carry no checksum, and the arm is held where they say it is.

    On a line that is too slow they are refused: what is sent there would move the arm too late.
    """
    try:
        board.configure()
    except BoardTimeoutError as silence:
        raise EnableError(
            f"the board does not answer in time; nothing was switched on: {silence}"
        ) from silence
    first, second = (core.monitor.read(board, now) for _ in range(2))
    if first is None or second is None:
        raise EnableError("the board did not answer where it is; try again")
    slowest = board_type(core.robot.board).slowest_answer_s
    delay = core.monitor.slow_line(slowest)
    if delay is not None and not board.identity.simulated:
        raise EnableError(LineSlow(delay, slowest))
    if (apart := second.apart > MOTORS_APART_RAD).any():
        raise EnableError(MotorsApart(tuple(core.robot.joints[i].title for i in np.flatnonzero(apart))))
    differs = np.isnan(first.q) != np.isnan(second.q)
    differs |= np.nan_to_num(np.abs(first.q - second.q)) > _tolerance(board)
    if differs.any():
        raise EnableError(ReadingsDiffer(tuple(core.robot.joints[i].title for i in np.flatnonzero(differs))))
    return second


def _tolerance(board: Board) -> FloatArray:
    """(n,) difference that says nothing [rad]."""
    return np.maximum(ADOPT_TOLERANCE_RAD, _ADOPT_TOLERANCE_STEPS / board.unit_per_rad)


def taken_over(core: Core, board: Board, q: FloatArray) -> FloatArray:
    """``q`` (n,) [rad] inside the limits; refused where a joint stands clearly outside."""
    low, high = core.robot.limits.T
    outside = np.maximum(low - q, q - high) - _tolerance(board)
    i = int(outside.argmax())
    if outside[i] > 0:
        joint = core.robot.joints[i]
        reason = StandsOutside(joint.title, float(q[i]), joint.lower, joint.upper)
        raise EnableError(Several((reason, _back_inside(core))))
    q = np.clip(_links_turned_back(core.robot.chain, np.clip(q, low, high), _tolerance(board)), low, high)
    if beyond := core.robot.turns_beyond(q):
        raise EnableError(Several((*beyond, _back_inside(core))))
    return q


def _back_inside(core: Core) -> ToDo:
    measured = core.monitor.reading.source is Source.MEASURED
    return ToDo("turn back" if measured else "support and enable")


def _links_turned_back(chain: Chain, q: FloatArray, tolerance: FloatArray) -> FloatArray:
    """``q`` (n,) [rad] with the angles between links inside their limits, where they are hardly outside."""
    for limit, row in zip(chain.turn_limits, chain.turn_rows(), strict=True):
        turn = float(row @ q)
        off = turn - min(max(turn, limit.lower), limit.upper)
        if 0.0 < abs(off) <= float(np.abs(row) @ tolerance):
            q = q - off * (1 + 1e-9) * row / float(row @ row)
    return q


def _how_it_began(core: Core, live: BoolArray, source: Source) -> str:
    if live.all():
        what = "encoders say" if source is Source.MEASURED else "board already sent pulses"
        return f"the {what} where the arm is, it stays there"
    if live.any():
        on = ", ".join(joint.title for joint, is_on in zip(core.robot.joints, live, strict=True) if is_on)
        return f"{on} stay, the others come on one after the other"
    return "the servos come on one after the other, in the pose that was given"
