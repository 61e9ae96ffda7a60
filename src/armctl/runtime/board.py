"""The driver, spoken to in joint angles."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from itertools import chain

import msgspec
import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, EnableError, StateError
from armctl.facts import LevelPassed, Quantities, QuantityLimits, levels_passed
from armctl.facts.angles import DEGREE
from armctl.hardware import Abilities, Driver, HomingState, Readback, Source
from armctl.hardware.boards import board_type, channel_settings
from armctl.hardware.driver import abilities_of, translated
from armctl.robot import Robot
from armctl.robot.signals import ON, Input, Output
from armctl.robot.tools import own_gripper

BoolArray = NDArray[np.bool_]
MOTORS_APART_RAD = 2.0 * DEGREE
"""how far two motors of one joint may stand apart"""
_NOTHING = Quantities()
_CATCH_UP_RAD = 0.05 * DEGREE
"""by how much a setpoint comes nearer to what the weight of another tool asks for: at 50 Hz 2.5°/s"""


class Reading(msgspec.Struct, frozen=True):
    """What the board says of itself."""

    q: FloatArray
    """(n,) [rad]; NaN where it does not know"""
    on: BoolArray
    """(n,) joints whose outputs are on; where the board does not say, those that have a position"""
    opening: float | None = None
    """of the gripper 0..1; None: not known"""
    source: Source = Source.COMMANDED
    errors: tuple[str, ...] = ()
    powered: bool | None = None
    """whether its outputs are on; None: it does not say"""
    homing: HomingState | None = None
    """None: there is nothing to home"""
    quantities: Mapping[str, Quantities] = {}
    """by title: what else it measures of each joint, and of the gripper"""
    warnings: tuple[str, ...] = ()
    """what it reports and goes on with"""
    asked: int = 1
    """questions that were put to the board for it"""
    lost: int = 0
    """those that got no answer and were asked again"""
    delay_s: float | None = None
    """the longest that an answer took; None: not measured"""
    expired: tuple[str, ...] = ()
    """titles of what could not be sent in its time, and was dropped"""
    sent: bool = True
    """nothing that was written waits for the line any more"""
    inputs: Mapping[str, float] = {}
    """what its other pins are at: 0, 1, or a share"""
    outputs: Mapping[str, float] = {}
    gripper_on: bool | None = None
    """whether the gripper's output is on; None: the board does not say"""
    apart: FloatArray = msgspec.field(default_factory=lambda: np.zeros(0))
    """(n,) how far two motors of a joint are apart [rad]; 0 where it has one, or they are not known"""
    home_again: bool = False
    """``errors`` tell already to home the arm"""
    limits: Mapping[str, QuantityLimits] = {}
    """by title: what the quantities may come to"""
    levels: tuple[LevelPassed, ...] = ()
    """which of them are beyond what is warned of, at this moment"""
    changes: Mapping[str, int] = {}
    """by name of an input, how often it has changed since the last reading, where the board counts that"""


class Board:
    """An open board. Every method may raise ``BoardError``; then it is best closed."""

    def __init__(self, robot: Robot, open_driver: Callable[[str], Driver], port: str) -> None:
        """Open the line, set the channels; moves nothing. Without a servo map only a simulated board."""
        self.map = robot.outputs
        """with the tool that is on"""
        self.unit_per_rad = np.abs(self.map.per_rad)
        """(n,) board units a radian"""
        self.power = board_type(robot.board).power
        """what is switched on and off, in words"""
        self._titles = dict(zip(self.map.channels, (joint.title for joint in robot.joints), strict=True))
        own = own_gripper(robot)
        self._drives_gripper = self.map.gripper_channel is not None and own is not None
        if self.map.gripper_channel is not None and own is not None:
            self._titles[self.map.gripper_channel] = own.title
        noun = self._noun = board_type(robot.board).scale.noun
        for one in self.map.mirrors:
            self._titles[one.channel] = f"{robot.joints[one.joint].title} ({noun} {one.channel})"
        self._joint_titles = [joint.title for joint in robot.joints]
        self._signals = robot.signals
        for one in robot.signals.inputs + robot.signals.outputs:
            self._titles[one.channel] = one.title
        self._gripper_output = ""
        """name of the output that is the gripper of the tool that is on; empty: none, or a channel"""
        self._opening: float | None = None
        """where that one was told to go last"""
        self._closed: bool | None = None
        """whether its output is on"""
        self._behind: dict[int, float] = {}
        """by channel: how far outputs of joints are from what the map says, since another tool is on"""
        self.equip(robot)
        self._settings = channel_settings(robot)
        self._ranges = list(zip(self.map.low.tolist(), self.map.high.tolist(), strict=True))
        self._let_go_of(np.zeros(robot.n, dtype=np.bool_))
        self._limits: tuple[Mapping[int, QuantityLimits], Mapping[str, QuantityLimits]] = ({}, {})
        """of the last reading, by channel and by title"""
        self._driver = translated("opening the board", open_driver, port)
        self._torque: dict[int, float] = {}
        """limits of motors by channel: a board that starts anew has forgotten them"""
        self._able = self._driver if isinstance(self._driver, Abilities) else Abilities()
        try:
            identity = translated("opening the board", self._driver.open)
            self.identity = replace(identity, abilities=abilities_of(self._driver))
            if robot.simulated_only is not None and self.identity.simulated:
                self.identity = replace(self.identity, kind="board")  # which one stands in is of no matter
            elif robot.simulated_only is not None:
                raise StateError(
                    f"{robot.name} has no servo map: which pulse is which angle is not known, so only the "
                    "simulated board may be driven (port sim); give each joint of the robot file a servo"
                )
            self.configure()
        except ArmctlError:
            self.close()
            raise

    def equip(self, robot: Robot, q: FloatArray | None = None) -> bool:
        """The same arm with another tool on; whether its gripper is at another output. Moves nothing.

        ``q`` (n,) [rad]: where it is to be held. What another weight asks of its outputs there is made up for
        bit by bit, by what is written next: all at once it would be a jerk.
        """
        output = "" if robot.gripper is None else robot.gripper.output
        changed = output != self._gripper_output
        if q is not None and robot.outputs is not self.map:
            were, are = self.map.outputs(q), robot.outputs.outputs(q)
            behind = {one: value - are[one] + self._behind.get(one, 0.0) for one, value in were.items()}
            self._behind = behind if any(behind.values()) else {}
        self.map, self._gripper_output = robot.outputs, output
        self.switches_gripper = bool(output)
        """whether its gripper is an output: closed while it is on"""
        self.grips = self._drives_gripper or self.switches_gripper
        """whether it moves a gripper; that of the arm also where nothing grips with the tool that is on"""
        if changed:
            self._opening = self._closed = None
        return changed

    @property
    def catching_up(self) -> bool:
        """Whether outputs are not yet what the weight of the tool that is on asks for."""
        return bool(self._behind)

    def configure(self) -> None:
        """Tell the board what each channel may do: one that started anew has forgotten. Moves nothing."""
        translated("setting the channels", self._driver.configure, self._settings)
        if self._torque:
            translated("limiting the torque", self._able.limit_torque, self._torque)
        if self._signals:
            translated("setting inputs and outputs up", self._able.use_signals, self._signals)

    def prepare(self, q: FloatArray, opening: float | None) -> None:
        """Tell the board with which angles (n,) [rad] and opening 0..1 it will be enabled. Moves nothing."""
        first = self._values(q, opening, np.ones(len(q), dtype=np.bool_))
        self._settings = [replace(one, first=first.get(one.channel)) for one in self._settings]
        self.configure()

    def write(self, q: FloatArray | None, opening: float | None, joints: BoolArray | None = None) -> None:
        """Send joint angles (n,) [rad] and a gripper opening 0..1 in one write; None: not sent.

        ``joints``: (n,) which of the angles are sent; None: all. Never those of limp joints.
        """
        sent = self._held if joints is None else joints & self._held
        if q is not None and self._behind:
            most = dict(zip(self.map.channels, (_CATCH_UP_RAD * self.unit_per_rad).tolist(), strict=True))
            left = {one: away - min(max(away, -most[one]), most[one]) for one, away in self._behind.items()}
            self._behind = left if any(left.values()) else {}
        if opening is not None and self._gripper_output:
            self._grip(opening)
        try:
            translated("writing setpoints", self._driver.write, self._values(q, opening, sent))
        except EnableError as refusal:
            raise (
                refusal if refusal.channel is None else refusal.about(self.title(refusal.channel))
            ) from refusal

    def _values(self, q: FloatArray | None, opening: float | None, joints: BoolArray) -> dict[int, float]:
        values: dict[int, float] = {}
        if q is not None:
            # Robot files may round the safe range inwards by an eighth of a microsecond.
            rows = zip(self.map.outputs(q).items(), self._ranges, joints.tolist(), strict=True)
            for (channel, value), (low, high), wanted in rows:
                if wanted:
                    values[channel] = min(max(value + self._behind.get(channel, 0.0), low), high)
            values |= self.map.mirrored(values)
        if opening is not None and not self._gripper_output:
            values |= self.map.gripper_output(opening)
        return values

    def _grip(self, opening: float) -> None:
        """Switch a gripper that is an output as soon as it is to close or open: 0 is on."""
        before, self._opening = self._opening, opening
        closes = opening < ON if before is None or opening == before else opening < before
        if closes != self._closed:
            self.set_output(self._gripper_output, float(closes))
            self._closed = closes

    def read(self) -> Reading:
        """Read back."""
        return translated("reading back", self._read)

    def _read(self) -> Reading:
        back = self._driver.read()
        q = self._angles(back)
        apart = np.zeros(len(q))
        for one in self.map.mirrors:
            if back.positions.get(one.channel) is None:
                q[one.joint] = np.nan
            else:
                away = self.map.disagreement(one, back.positions)
                apart[one.joint] = max(apart[one.joint], away)
        if back.on is not None:
            on = np.array([all(back.on.get(one, False) for one in every) for every in self._channels_of])
        else:
            on = ~np.isnan(q) if back.powered is None else np.full(q.shape, back.powered)
        faults = [f"{self.title(channel)}: {fault}" for channel, fault in (back.faults or {}).items()]
        outputs, opening = self._outputs_of(back)
        errors = (*faults, *back.errors)
        warnings = tuple([f"{self.title(one)}: {words}" for one, words in (back.warnings or {}).items()])
        if back.source is Source.MEASURED and self.map.mirrors:
            warnings += tuple(
                f"the two motors of {joint} stand apart and work against each other; release the arm and put "
                "their horns right"
                for joint, away, limp in zip(
                    self._joint_titles, apart.tolist(), self.limp.tolist(), strict=True
                )
                if away > MOTORS_APART_RAD and not limp
            )
        gripper = self.map.gripper_channel
        gripper_on = None if back.on is None or gripper is None else back.on.get(gripper, False)
        quantities = self._quantities(back)
        levels = tuple(
            level
            for channel, limits in back.limits.items()
            if (now := quantities.get(title := self.title(channel))) is not None
            for level in levels_passed(title, f"{self._noun} {channel}", now, limits)
        )
        return Reading(
            q,
            on,
            opening,
            back.source,
            errors,
            back.powered,
            back.homing,
            quantities,
            warnings,
            back.asked,
            back.lost,
            back.delay_s,
            tuple(map(self.title, back.expired)) if back.expired else (),
            back.sent,
            {name: self._value(self._signals.input(name), level) for name, level in back.inputs.items()},
            outputs,
            gripper_on,
            apart,
            back.home_again,
            self._limits_of(back),
            levels,
            back.changes,
        )

    def _angles(self, back: Readback) -> FloatArray:
        """(n,) [rad] of what it reads; what is sent is read as if it had caught up."""
        measured, told = back.source is Source.MEASURED, back.positions
        if self._behind and not measured:
            behind = self._behind
            told = {k: None if one is None else one - behind.get(k, 0.0) for k, one in told.items()}
        return self.map.angles(told, measured=measured)

    def _outputs_of(self, back: Readback) -> tuple[dict[str, float], float | None]:
        """Values of the outputs, and the opening of the gripper, which may be one of them."""
        levels = back.outputs.items()
        outputs = {name: self._value(self._signals.output(name), level) for name, level in levels}
        if self._gripper_output not in outputs:
            return outputs, self.map.opening(back.positions)
        self._closed = outputs[self._gripper_output] > ON
        return outputs, float(not self._closed)

    def _limits_of(self, back: Readback) -> Mapping[str, QuantityLimits]:
        if back.limits is not self._limits[0]:
            by_title = {self.title(channel): limits for channel, limits in back.limits.items()}
            self._limits = back.limits, by_title
        return self._limits[1]

    def _quantities(self, back: Readback) -> dict[str, Quantities]:
        load, heat, volts, amps = (
            values or {} for values in (back.load, back.temperature, back.voltage, back.current)
        )
        found = {
            self.title(one): Quantities(load.get(one), heat.get(one), volts.get(one), amps.get(one))
            for one in dict.fromkeys(chain(load, heat, volts, amps))
        }
        return {title: one for title, one in found.items() if one != _NOTHING}

    def home(self) -> None:
        """Begin to look for the zeros of the axes: the arm moves."""
        translated("homing", self._driver.home)

    def hold(self) -> None:
        """Brake on the board itself and hold there."""
        translated("stopping the board", self._driver.stop)

    def title(self, channel: int) -> str:
        """What the user calls a channel."""
        return self._titles.get(channel, f"channel {channel}")

    def release(self) -> None:
        """Pulses or motors off: the arm drops."""
        translated(f"switching the {self.power} off", self._driver.release)
        self._behind = {}
        self.take_back()

    def clear_faults(self) -> None:
        """Let what went off by itself be enabled again; what is on stays on."""
        translated("clearing faults", self._able.clear_faults)

    def release_joints(self, joints: BoolArray) -> None:
        """The same for these joints (n,) only: nothing is sent to them until they are taken back."""
        what = f"switching the {self.power} of joints off"
        translated(what, self._able.release_channels, self._channels(joints))
        self._let_go_of(self.limp | joints)

    def take_back(self) -> None:
        """The next setpoint switches joints on that were switched off by themselves."""
        self._let_go_of(np.zeros_like(self.limp))

    def _let_go_of(self, joints: BoolArray) -> None:
        self.limp, self._held = joints, ~joints
        """(n,) joints that were switched off by themselves: nothing is sent to them; and the others"""
        self.limp_titles = tuple([self._joint_titles[i] for i in np.flatnonzero(joints).tolist()])
        """which joints are limp"""

    @property
    def lets_down(self) -> bool:
        """Whether it can take the torque of its motors away by and by."""
        return "scale_torque" in self.identity.abilities

    def scale_torque(self, share: float, joints: BoolArray | None = None) -> None:
        """Let the motors of joints (n,) have this share 0 ... 1 of their torque, on the way to a release.

        ``joints`` None: of all that are on, the gripper's, too.
        """
        channels = None if joints is None else tuple(self._channels(joints))
        translated("taking the torque away", self._able.scale_torque, share, channels)

    def limit_torque(self, share: float, joints: BoolArray) -> None:
        """How strong the motors of joints (n,) may be, 0 ... 1."""
        limits = dict.fromkeys(self._channels(joints), share)
        translated("limiting the torque", self._able.limit_torque, limits)
        self._torque |= limits

    def set_output(self, name: str, value: float) -> None:
        """Switch an output that moves no joint."""
        level = self._value(self._signals.output(name), value)
        translated(f"switching {name}", self._able.set_output, name, level)

    @staticmethod
    def _value(signal: Input | Output | None, level: float) -> float:
        """The value of a pin's level, and the reverse: another package's board knows its own."""
        return level if signal is None else signal.value(level)

    def _channels(self, joints: BoolArray) -> list[int]:
        return [one for i in np.flatnonzero(joints).tolist() for one in self._channels_of[i]]

    @cached_property
    def _channels_of(self) -> list[list[int]]:
        mirrors = self.map.mirrors
        return [
            [channel, *(one.channel for one in mirrors if one.joint == i)]
            for i, channel in enumerate(self.map.channels)
        ]

    def close(self) -> None:
        """Close the line, whatever state it is in; the outputs stay as they are."""
        with suppress(Exception):  # a board that is gone was reported before
            self._driver.close()


def close_opened(opening: Future[Board]) -> None:
    """Close a board that nobody waits for any more."""
    if not opening.cancelled() and opening.exception() is None:
        opening.result().close()
