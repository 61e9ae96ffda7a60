"""Feetech's servos: the control table of STS and SMS, what tables mean, and what torque-on takes.

Sources: Feetech's memory tables and protocol manual; the vendor's SDK. Where LeRobot differs (baud indices
5 to 7), the vendor is followed.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from types import MappingProxyType

from armctl.errors import BoardError, BoardTimeoutError, EnableError
from armctl.facts import QuantityLimits
from armctl.facts.servos import ServoTold, ServoUnconfirmed
from armctl.hardware.bus.line import ATTEMPTS, BusLine
from armctl.hardware.bus.make import Block, Limits, ServoMake, Telemetry
from armctl.hardware.bus.packets import BusPacket
from armctl.hardware.bus.table import ControlTable, Register, Sign
from armctl.hardware.feetech.packets import FeetechForm
from armctl.hardware.servos import ServoSettings

_MAGNITUDE = Sign.MAGNITUDE


def kept_settings(last_step: int) -> tuple[Register, ...]:
    """What all series keep alike at the addresses 0 … 27; ``last_step``: the last of a shaft's turn."""
    return (
        Register("firmware_major", 0, 1, kept=True, writable=False),
        Register("firmware_minor", 1, 1, kept=True, writable=False),
        Register("big_endian", 2, 1, kept=True, writable=False),
        Register("model", 3, 2, kept=True, writable=False),
        Register("id", 5, 1, kept=True, high=253),
        Register("baud", 6, 1, kept=True, high=7),
        Register("return_delay", 7, 1, kept=True, high=254, unit="µs", scale=2.0),
        Register("status_level", 8, 1, kept=True, high=1),
        Register("lowest", 9, 2, kept=True, high=last_step, unit="steps"),
        Register("highest", 11, 2, kept=True, high=last_step, unit="steps"),
        Register("hottest", 13, 1, kept=True, high=100, unit="°C"),
        Register("most_voltage", 14, 1, kept=True, unit="V", scale=0.1),
        Register("least_voltage", 15, 1, kept=True, unit="V", scale=0.1),
        Register("most_torque", 16, 2, kept=True, high=1000, unit="%", scale=0.1),
        Register("phase", 18, 1, kept=True),
        Register("unloading", 19, 1, kept=True),
        Register("led_alarm", 20, 1, kept=True),
        Register("p_gain", 21, 1, kept=True),
        Register("d_gain", 22, 1, kept=True),
        Register("i_gain", 23, 1, kept=True),
        Register("start_force", 24, 2, kept=True, high=1000, unit="%", scale=0.1),
        Register("forward_dead_zone", 26, 1, kept=True, high=32, unit="steps"),
        Register("backward_dead_zone", 27, 1, kept=True, high=32, unit="steps"),
    )


TELEMETRY = (
    Register("present_load", 60, 2, unit="%", scale=0.1, sign=_MAGNITUDE, sign_bit=10, writable=False),
    Register("present_voltage", 62, 1, unit="V", scale=0.1, writable=False),
    Register("present_temperature", 63, 1, unit="°C", writable=False),
    Register("put_off", 64, 1, writable=False),
    Register("status", 65, 1, writable=False),
    Register("moving", 66, 1, writable=False),
)
"""what all series measure alike, beside position and speed"""
TABLE = ControlTable(
    (
        *kept_settings(4095),
        Register("protection_current", 28, 2, kept=True, high=511, unit="A", scale=0.0065),
        Register("resolution", 30, 1, kept=True, low=1, high=3),
        Register("offset", 31, 2, kept=True, unit="steps", sign=_MAGNITUDE, sign_bit=11),
        Register("mode", 33, 1, kept=True, high=3),
        Register("protection_torque", 34, 1, kept=True, high=100, unit="%"),
        Register("protection_time", 35, 1, kept=True, high=254, unit="s", scale=0.01),
        Register("overload_torque", 36, 1, kept=True, high=100, unit="%"),
        Register("speed_p_gain", 37, 1, kept=True),
        Register("over_current_time", 38, 1, kept=True, high=254, unit="s", scale=0.01),
        Register("speed_i_gain", 39, 1, kept=True),
        Register("torque", 40, 1, high=128),
        Register("acceleration", 41, 1, high=254, unit="steps/s²", scale=100.0),
        Register("goal_position", 42, 2, unit="steps", sign=_MAGNITUDE, sign_bit=15),
        Register("goal_time", 44, 2, high=1000, unit="%", scale=0.1, sign=_MAGNITUDE, sign_bit=10),
        Register("goal_speed", 46, 2, unit="steps/s", sign=_MAGNITUDE, sign_bit=15),
        Register("torque_limit", 48, 2, high=1000, unit="%", scale=0.1),
        Register("lock", 55, 1, high=1),
        Register("present_position", 56, 2, unit="steps", sign=_MAGNITUDE, sign_bit=15, writable=False),
        Register("present_speed", 58, 2, unit="steps/s", sign=_MAGNITUDE, sign_bit=15, writable=False),
        *TELEMETRY,
        Register("present_current", 69, 2, unit="A", scale=0.0065, sign=_MAGNITUDE, writable=False),
    )
)
STEPS_PER_TURN = 4096
BAUDS = (1_000_000, 500_000, 250_000, 128_000, 115_200, 76_800, 57_600, 38_400)
"""by the number in the register ``baud``"""
MODELS = MappingProxyType({777: "STS3215", 2825: "STS3250", 1545: "STS3032", 2057: "STS3020"})
_MOST_SPEED = 32_767
MULTI_TURN = 1 << 4
"""the bit of ``phase`` with which positions leave 0 … 4095"""
VOLTAGE, SENSOR, HEAT, CURRENT, OVERLOAD = (1 << bit for bit in (0, 1, 2, 3, 5))
"""bits of the error byte"""
ERRORS = MappingProxyType(
    {
        VOLTAGE: "its supply is outside the voltages that its EEPROM allows",
        SENSOR: "its angle sensor fails",
        HEAT: "it is too hot: let it cool down, and take load off",
        CURRENT: "its motor draws too much current: look for something in its way",
        OVERLOAD: "overload: it has given way. Take away what is in its way or too heavy, then move it",
    }
)
_KEPT = Block(0, 40)
_TOLD = (
    "torque", "goal_position", "goal_speed", "torque_limit", "present_position", "present_load",
    "present_voltage", "present_temperature", "present_current",
)  # fmt: skip
"""registers that each reading tells, where a series has them; in the order of their addresses"""


class FeetechMake(ServoMake):
    """Servos of one of Feetech's series, whose table says what they have."""

    bauds = BAUDS
    baud_register = "baud"
    baud_numbers = MappingProxyType({baud: number for number, baud in enumerate(BAUDS)})
    registers = MappingProxyType[str, str]({})
    goal_address = 42

    def __init__(
        self,
        title: str,
        table: ControlTable,
        models: Mapping[int, str],
        *,
        steps_per_turn: float,
        last_step: int,
        telemetry: Block,
        sync_reads: bool = True,
        wakes_locked: bool = True,
    ) -> None:
        """Without a torque limit in its table, its speed tells whether a servo has started anew."""
        self.title, self.table, self.models = title, table, models
        self.steps_per_turn, self.last_step = steps_per_turn, last_step
        self.telemetry, self.wakes_locked = telemetry, wakes_locked
        self.form = FeetechForm(sync_reads=sync_reads)
        self.limits_torque = self.keeps_limit = "torque_limit" in table
        self._told = tuple(one for one in _TOLD if one in table)
        self._read = table.reader(self._told, telemetry.address)

    def understood(self, packet: BusPacket, block: Block) -> Telemetry:
        """All but the EEPROM is in one block: what a servo was told as well as what it measures."""
        t, limited, wrong = self.table, self.limits_torque, packet.code & ~OVERLOAD
        read = self._read if block == self.telemetry else t.reader(self._told, block.address)
        told = dict(zip(self._told, read(packet.data), strict=True))
        position, goal = told["present_position"], told["goal_position"]
        on, load = told["torque"] == 1, told["present_load"] / 1000
        away = abs(goal - position) > self.still_steps
        current = told.get("present_current")
        return Telemetry(
            position=position,
            goal=goal,
            on=on,
            torque_limit=told["torque_limit"] / 1000 if limited else None,
            forgot=not limited and told["goal_speed"] == 0,
            load=load,
            voltage=t.scaled("present_voltage", told["present_voltage"]),
            temperature=t.scaled("present_temperature", told["present_temperature"]),
            current=None if current is None else t.scaled("present_current", current),
            gave_way=bool(packet.code & OVERLOAD),
            unloaded=bool(wrong) and on and load == 0.0 and away,
            faults=tuple([words for bit, words in ERRORS.items() if wrong & bit]) if wrong else (),
        )

    def settings(self, line: BusLine, servo: int) -> ServoSettings:
        """Its EEPROM, in one answer."""
        data, t = line.read(servo, _KEPT.address, _KEPT.size).data, self.table
        kept = {one.name: t.decode(one.name, data, _KEPT.address) for one in t.registers if one.kept}
        mode, phase = kept.get("mode", 0), kept["phase"] if "mode" in kept else 0
        lowest, highest = kept["lowest"], kept["highest"]
        unfit, cure = None, tuple[tuple[str, int], ...]()
        findings: list[str] = []
        if kept["big_endian"] != self._big_endian:
            series = "STS" if self._big_endian else "SCS"
            unfit = (
                f"it is of the {series} series (register 2), which is another kind of board in a robot file"
            )
        elif mode != 0:
            cure = (("mode", 0),)
            unfit = f"it is in mode {mode} (register 33), which does not control its position; mode 0 does"
        elif phase & MULTI_TURN:
            cure = (("phase", phase & ~MULTI_TURN),)
            unfit = "it counts over several turns (bit 4 of register 18), so its positions leave 0 … 4095"
        elif lowest >= highest:
            cure = (("lowest", 0), ("highest", self.last_step))
            if lowest == highest == 0:  # no limits: it turns without end
                unfit = "it has no limits (registers 9 and 11 are 0)"
            else:
                unfit = f"its limits are {lowest} … {highest} steps (registers 9 and 11): none is left"
        if unfit is None and kept["status_level"] == 0:
            unfit = "it does not confirm what is written (register 8 is 0; 1 is right)"
            cure = (("status_level", 1),)
        if (model := kept["model"]) not in self.models:
            findings.append(f"its model number {model} is not known")
        current_a = t.value("protection_current", data, _KEPT.address) if "protection_current" in t else None
        return ServoSettings(
            model,
            f"{data[0]}.{data[1]}",
            lowest,
            highest,
            kept.get("offset", 0),
            mode,
            tuple(findings),
            unfit,
            cure,
            QuantityLimits(
                load=kept["overload_torque"] / 100 or None,  # 0: it has none
                temperature_c=t.value("hottest", data, _KEPT.address) or None,
                voltage_v=t.value("least_voltage", data, _KEPT.address) or None,
                current_a=current_a or None,
            ),
        )

    @property
    def _big_endian(self) -> bool:
        return self.table.order == "big"

    def is_one(self, line: BusLine, servo: int) -> bool:
        """Both series answer a ping alike; register 2 tells which it is."""
        register = self.table["big_endian"]
        return (line.read(servo, register.address, register.size, more=True).data[0] == 1) == self._big_endian

    def goal_bytes(self, steps: int) -> bytes:
        """A goal."""
        return self.table.encode("goal_position", steps)

    def prepare(self, line: BusLine, servo: int, limits: Limits) -> None:
        """No ramp, which would lag behind the stream of goals; speed and torque no more than they may be.

        The speed is the last line of defence: whatever throws a servo, it goes no faster. 0 is full speed.
        """
        speed = min(_MOST_SPEED, max(1, round(limits.speed))) if limits.speed is not None else None
        wanted = {
            "acceleration": 0,
            "goal_time": 0,
            "goal_speed": (0 if self.limits_torque else _MOST_SPEED) if speed is None else speed,
            "torque_limit": round(1000 * limits.torque),
        }
        for name, number in wanted.items():
            if name in self.table:
                self.put(line, servo, name, number)

    def on_at(self, line: BusLine, servo: int, position: int) -> None:
        """Goal, read back with the place, torque, read back.

        A goal that differs from the present position switches torque on by itself, so all else is done by
        now, and the goal is the place that has just been read.
        """
        if not self.set_goal(line, servo, position).on:
            self.put(line, servo, "torque", 1)
        answer = self.require_on(line, servo)
        why = [words for bit, words in ERRORS.items() if answer.code & bit & ~OVERLOAD]
        if why:
            raise EnableError(ServoTold(servo, "; ".join(why)))

    def off(self, line: BusLine, servo: int) -> bool:
        """Torque off, and read back: answers carry no number, a late one may be to something else.

        The error byte of an answer says nothing against it.
        """
        register = self.table["torque"]
        for _ in range(ATTEMPTS):
            line.write(servo, register.address, b"\0")
            with suppress(BoardTimeoutError):
                if line.read(servo, register.address, register.size, more=True).data == b"\0":
                    return True
        return False

    def limit_torque(self, line: BusLine, servo: int, share: float) -> bool:
        """A share of its full torque; some series have no such limit."""
        if not self.limits_torque:
            return False
        data = self.table.encode("torque_limit", round(1000 * share))
        return line.write(servo, self.table["torque_limit"].address, data) is not None

    def unlock(self, line: BusLine, servo: int) -> None:
        """Without it the servo takes what is written, and forgets it at the next power cut."""
        self._set_lock(line, servo, 0)

    def lock(self, line: BusLine, servo: int) -> None:
        """An open EEPROM is what makes servos seem dead later."""
        self._set_lock(line, servo, 1)

    def _set_lock(self, line: BusLine, servo: int, lock: int) -> None:
        """It is read back: a servo of status level 0 confirms nothing that it is told."""
        address = self.table["lock"].address
        line.write(servo, address, bytes((lock,)))
        if line.read(servo, address, 1, more=True).data[0] != lock:
            raise BoardError(ServoUnconfirmed(servo, "locked" if lock else "open"))


FEETECH = FeetechMake(
    "Feetech servo bus",
    TABLE,
    MODELS,
    steps_per_turn=STEPS_PER_TURN,
    last_step=STEPS_PER_TURN - 1,
    telemetry=Block(40, 31),
)
"""STS and SMS servos"""
