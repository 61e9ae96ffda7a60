"""Dynamixel X servos: control table, what it means, and what torque-on takes.

Source: ROBOTIS e-Manual, the pages of XL330, XC330, XL430, XC430, XM430, XH430, XM540 and their kin, whose
tables are alike as far as armctl reads them. Only register 126 differs (current or load); it is not read.
"""

from __future__ import annotations

from types import MappingProxyType

from armctl.errors import BoardTimeoutError, EnableError
from armctl.facts import QuantityLimits
from armctl.facts.servos import ServoUnconfirmed
from armctl.hardware.bus.line import ATTEMPTS, BusLine
from armctl.hardware.bus.make import Block, Limits, ServoMake, Telemetry
from armctl.hardware.bus.packets import BusPacket
from armctl.hardware.bus.table import ControlTable, Register, Sign
from armctl.hardware.dynamixel.packets import DynamixelForm
from armctl.hardware.servos import ServoSettings

_TWOS = Sign.TWOS
TABLE = ControlTable(
    (
        Register("model", 0, 2, kept=True, writable=False),
        Register("model_information", 2, 4, kept=True, writable=False),
        Register("firmware_version", 6, 1, kept=True, writable=False),
        Register("id", 7, 1, kept=True, high=252),
        Register("baud_rate", 8, 1, kept=True, high=7),
        Register("return_delay_time", 9, 1, kept=True, high=254, unit="µs", scale=2.0),
        Register("drive_mode", 10, 1, kept=True, high=13),
        Register("operating_mode", 11, 1, kept=True, high=16),
        Register("secondary_id", 12, 1, kept=True),
        Register("protocol_type", 13, 1, kept=True, low=1, high=22),
        Register("homing_offset", 20, 4, kept=True, high=1_044_479, unit="steps", sign=_TWOS),
        Register("moving_threshold", 24, 4, kept=True, high=1023, unit="rpm", scale=0.229),
        Register("temperature_limit", 31, 1, kept=True, high=100, unit="°C"),
        Register("max_voltage_limit", 32, 2, kept=True, high=160, unit="V", scale=0.1),
        Register("min_voltage_limit", 34, 2, kept=True, high=160, unit="V", scale=0.1),
        Register("pwm_limit", 36, 2, kept=True, high=885, unit="%", scale=100 / 885),
        Register("velocity_limit", 44, 4, kept=True, high=2047, unit="rpm", scale=0.229),
        Register("max_position_limit", 48, 4, kept=True, high=4095, unit="steps"),
        Register("min_position_limit", 52, 4, kept=True, high=4095, unit="steps"),
        Register("shutdown", 63, 1, kept=True),
        Register("torque", 64, 1, high=1),
        Register("led", 65, 1, high=1),
        Register("status_return_level", 68, 1, high=2),
        Register("registered_instruction", 69, 1, writable=False),
        Register("hardware_error_status", 70, 1, writable=False),
        Register("velocity_i_gain", 76, 2, high=16_383),
        Register("velocity_p_gain", 78, 2, high=16_383),
        Register("position_d_gain", 80, 2, high=16_383),
        Register("position_i_gain", 82, 2, high=16_383),
        Register("position_p_gain", 84, 2, high=16_383),
        Register("feedforward_2nd_gain", 88, 2, high=16_383),
        Register("feedforward_1st_gain", 90, 2, high=16_383),
        Register("bus_watchdog", 98, 1, high=127, unit="ms", scale=20.0, sign=_TWOS),
        Register("goal_pwm", 100, 2, high=885, unit="%", scale=100 / 885, sign=_TWOS),
        Register("goal_velocity", 104, 4, high=2047, unit="rpm", scale=0.229, sign=_TWOS),
        Register("profile_acceleration", 108, 4, high=32_767),
        Register("profile_velocity", 112, 4, high=32_767),
        Register("goal_position", 116, 4, high=1_048_575, unit="steps", sign=_TWOS),
        Register("realtime_tick", 120, 2, unit="ms", writable=False),
        Register("moving", 122, 1, writable=False),
        Register("moving_status", 123, 1, writable=False),
        Register("present_pwm", 124, 2, unit="%", scale=100 / 885, sign=_TWOS, writable=False),
        Register("present_velocity", 128, 4, unit="rpm", scale=0.229, sign=_TWOS, writable=False),
        Register("present_position", 132, 4, unit="steps", sign=_TWOS, writable=False),
        Register("velocity_trajectory", 136, 4, unit="rpm", scale=0.229, sign=_TWOS, writable=False),
        Register("position_trajectory", 140, 4, unit="steps", sign=_TWOS, writable=False),
        Register("present_input_voltage", 144, 2, unit="V", scale=0.1, writable=False),
        Register("present_temperature", 146, 1, unit="°C", writable=False),
    )
)
STEPS_PER_TURN = 4096
FULL_PWM = 885
BAUDS = (1_000_000, 57_600, 115_200, 2_000_000, 3_000_000, 4_000_000, 9_600)
"""the likeliest first; a new servo has 57,600"""
MODELS = MappingProxyType(
    {
        1000: "XH430-W350",
        1010: "XH430-W210",
        1020: "XM430-W350",
        1030: "XM430-W210",
        1040: "XH430-V350",
        1050: "XH430-V210",
        1060: "XL430-W250",
        1070: "XC430-W150",
        1080: "XC430-W240",
        1090: "2XL430-W250",
        1100: "XH540-W270",
        1110: "XH540-W150",
        1120: "XM540-W270",
        1130: "XM540-W150",
        1140: "XH540-V270",
        1150: "XH540-V150",
        1160: "2XC430-W250",
        1190: "XL330-M077",
        1200: "XL330-M288",
        1210: "XC330-T181",
        1220: "XC330-T288",
        1230: "XC330-M181",
        1240: "XC330-M288",
    }
)
REVERSE, TIME_BASED, GOAL_IS_TORQUE_ON = 1 << 0, 1 << 2, 1 << 3
"""bits of ``drive_mode``: steps grow the other way; profiles are times; a goal switches torque on"""
POSITION, CURRENT_BASED = 3, 5
"""operating modes that control the position"""
ALERT = 1 << 7
"""of the error of an answer: the servo has a hardware error"""
RESULT_FAIL, UNKNOWN, CRC_ERROR, RANGE, LENGTH, LIMIT, ACCESS = range(1, 8)
"""what else the error of an answer may be"""
REFUSALS = MappingProxyType(
    {
        RESULT_FAIL: "it could not do that",
        UNKNOWN: "it does not know that instruction",
        CRC_ERROR: "the packet arrived spoilt",
        RANGE: "out of range, or its bus watchdog has tripped",
        LENGTH: "too short for that register",
        LIMIT: "outside the limits of its EEPROM",
        ACCESS: "that register cannot be written now",
    }
)
VOLTAGE, HEAT, ENCODER, SHOCK, OVERLOAD = (1 << bit for bit in (0, 2, 3, 4, 5))
"""bits of ``hardware_error_status`` and of ``shutdown``"""
ERRORS = MappingProxyType(
    {
        VOLTAGE: "its supply is outside the voltages that its EEPROM allows",
        HEAT: "it is too hot: let it cool down, and take load off",
        ENCODER: "its angle sensor fails",
        SHOCK: "electrical shock, or too little power: look at the supply and its plugs",
        OVERLOAD: "overload: take away what is in its way or too heavy",
    }
)
WATCHDOG_MS = 500
"""A servo under torque stops where it is when it has heard no instruction for so long. It is as long as the
runtime lets a computer be late before it ends the motion; shorter would make a fault of it.
Goals are never more than a few ticks ahead, so the arm comes no farther in that time than these."""
_WATCHDOG = WATCHDOG_MS // 20
_TRIPPED = (
    f"its bus watchdog stopped it after {WATCHDOG_MS} ms of silence; it holds and takes no goals until "
    "Enable or Release"
)
_KEPT, _STATE = Block(0, 69), Block(64, 7)


class DynamixelMake(ServoMake):
    """X servos with Protocol 2.0."""

    title = "Dynamixel servo bus"
    form = DynamixelForm()
    table = TABLE
    steps_per_turn = STEPS_PER_TURN
    last_step = STEPS_PER_TURN - 1
    bauds = BAUDS
    baud_register = "baud_rate"
    baud_numbers = MappingProxyType(
        {9_600: 0, 57_600: 1, 115_200: 2, 1_000_000: 3, 2_000_000: 4, 3_000_000: 5, 4_000_000: 6}
    )
    registers = MappingProxyType(
        {
            "offset": "homing_offset",
            "lowest": "min_position_limit",
            "highest": "max_position_limit",
            "mode": "operating_mode",
        }
    )
    telemetry = Block(98, 49)
    in_turn = (_STATE,)
    goal_address = 116
    delay_register = "return_delay_time"
    watchdog_ms = WATCHDOG_MS
    models = MODELS

    def understood(self, packet: BusPacket, block: Block) -> Telemetry:
        """Measured values, goal and watchdog in one block; torque and hardware errors in the other."""
        t, data, first = self.table, packet.data, block.address
        if block == _STATE:
            errors = t.decode("hardware_error_status", data, first)
            return Telemetry(on=t.decode("torque", data, first) == 1, latched=_in_words(errors))
        tripped = t.decode("bus_watchdog", data, first) < 0
        return Telemetry(
            position=t.decode("present_position", data, first),
            goal=t.decode("goal_position", data, first),
            torque_limit=abs(t.decode("goal_pwm", data, first)) / FULL_PWM,
            load=t.decode("present_pwm", data, first) / FULL_PWM,
            voltage=t.value("present_input_voltage", data, first),
            temperature=t.value("present_temperature", data, first),
            faults=(_TRIPPED,) if tripped else (),
            refuses=tripped,
        )

    def settings(self, line: BusLine, servo: int) -> ServoSettings:
        """Its EEPROM, in one answer.

        A servo whose status level keeps it from answering is told to answer until it is switched off.
        """
        findings: list[str] = []
        level = self._answering(line, servo)
        if level is not None:
            findings.append(
                f"it answered pings{' and reads' if level else ''} only (register 68 was {level}); that is 2 "
                "now, until its supply is cut"
            )
        data = line.read(servo, _KEPT.address, _KEPT.size).data
        kept = {one.name: self.table.decode(one.name, data, 0) for one in self.table.registers if one.kept}
        mode, drive = kept["operating_mode"], kept["drive_mode"]
        lowest, highest = kept["min_position_limit"], kept["max_position_limit"]
        if mode == CURRENT_BASED:
            lowest, highest = 0, STEPS_PER_TURN - 1  # the limits of the EEPROM do not hold in it
            findings.append("it is in mode 5 (register 11): position with a limited current")
        if drive & REVERSE:
            findings.append("it counts the other way round (bit 0 of register 10)")
        if drive & TIME_BASED:
            findings.append("its profiles are times (bit 2 of register 10); armctl sets them to 0: none")
        if (offset := kept["homing_offset"]) != 0:
            findings.append(f"its homing offset is {offset} steps (register 20)")
        if missing := [words for bit, words in _PROTECTIONS.items() if not kept["shutdown"] & bit]:
            findings.append(f"it does not switch itself off on {' or '.join(missing)} (register 63)")
        if kept["model"] not in self.models:
            findings.append(f"its model number {kept['model']} is not known; it is taken for an X servo")
        return ServoSettings(
            kept["model"],
            str(kept["firmware_version"]),
            lowest,
            highest,
            offset,
            mode,
            tuple(findings),
            *_unfit(mode, drive, lowest, highest),
            QuantityLimits(
                temperature_c=self.table.value("temperature_limit", data, 0) or None,  # 0: it has none
                voltage_v=self.table.value("min_voltage_limit", data, 0) or None,
            ),
        )

    def goal_bytes(self, steps: int) -> bytes:
        """A goal."""
        return self.table.encode("goal_position", steps)

    def prepare(self, line: BusLine, servo: int, limits: Limits) -> None:
        """No hardware error; no profile, which would lag behind; the torque limited; the watchdog set."""
        state = line.read(servo, _STATE.address, _STATE.size, more=True)
        errors = _in_words(self.table.decode("hardware_error_status", state.data, _STATE.address))
        if errors:
            raise EnableError(f"servo {servo}: {'; '.join(errors)}. Release restarts it, then enable again")
        self.put(line, servo, "profile_acceleration", 0)  # be they speeds or times: 0 is none
        self.put(line, servo, "profile_velocity", 0)
        self.put(line, servo, "bus_watchdog", 0)  # one that has tripped takes no limit either
        self.put(line, servo, "goal_pwm", self._pwm(line, servo, limits.torque))
        self.put(line, servo, "bus_watchdog", _WATCHDOG)

    def on_at(self, line: BusLine, servo: int, position: int) -> None:
        """Goal, read back with the place, torque, read back, watchdog. Any error in an answer ends it.

        A servo that refuses a goal keeps the old one, and torque on would be a jump to that.
        """
        self.put(line, servo, "bus_watchdog", 0)  # one that has tripped refuses goals
        self.set_goal(line, servo, position, more=True)
        self.put(line, servo, "torque", 1)
        self.require_on(line, servo)
        self.put(line, servo, "bus_watchdog", _WATCHDOG)

    def off(self, line: BusLine, servo: int) -> bool:
        """Torque off, and the watchdog too, tripped or not; an alert says nothing against it."""
        answer = line.write(servo, self.table["torque"].address, b"\0")
        if answer is None or answer.code & ~ALERT:
            return False
        line.write(servo, self.table["bus_watchdog"].address, b"\0")  # else the rite clears it
        return True

    def limit_torque(self, line: BusLine, servo: int, share: float) -> bool:
        """A share of the PWM that its EEPROM allows: in modes of position, ``goal_pwm`` is a limit."""
        try:
            data = self.table.encode("goal_pwm", self._pwm(line, servo, share))
        except BoardTimeoutError:
            return False
        answer = line.write(servo, self.table["goal_pwm"].address, data)
        return answer is not None and not answer.code & ~ALERT

    def clear(self, line: BusLine, servo: int) -> bool:
        """Restart it: nothing else brings its torque back after a hardware error.

        It is silent while it starts, so one whose answer was lost is silent, too; the next readings tell.
        """
        for _ in range(ATTEMPTS):
            if servo in line.exchange(self.form.reboot(servo), [servo], 0):
                break
        return True

    def _answering(self, line: BusLine, servo: int) -> int | None:
        """See to it that it confirms what is written; the status level that it had, None: it did."""
        register = self.table["status_return_level"]
        try:
            level = line.read(servo, register.address, register.size).data[0]
        except BoardTimeoutError:
            level = 0
        if level == register.high:
            return None
        if line.write(servo, register.address, bytes((2,))) is None:
            raise BoardTimeoutError(ServoUnconfirmed(servo, "told"))
        return level

    def _pwm(self, line: BusLine, servo: int, share: float) -> int:
        register = self.table["pwm_limit"]
        data = line.read(servo, register.address, register.size, more=True).data
        return round(share * self.table.decode("pwm_limit", data, register.address))

    def put(self, line: BusLine, servo: int, name: str, number: int) -> BusPacket:
        """As of any make; ``EnableError`` says which error the servo answers with."""
        answer = super().put(line, servo, name, number)
        if code := answer.code & ~ALERT:
            words = REFUSALS.get(code, "an unknown error")
            raise EnableError(
                f"servo {servo} refuses {number} as its {name.replace('_', ' ')} (error {code}: {words})"
            )
        return self.sound(servo, answer)

    def sound(self, servo: int, answer: BusPacket) -> BusPacket:
        """``answer``; ``EnableError`` where it tells of any error."""
        if answer.code:
            raise EnableError(f"servo {servo} reports a hardware error; release the arm and enable it again")
        return answer


_PROTECTIONS = MappingProxyType({HEAT: "heat", OVERLOAD: "overload"})


def _in_words(errors: int) -> tuple[str, ...]:
    return tuple(words for bit, words in ERRORS.items() if errors & bit)


def _unfit(
    mode: int, drive: int, lowest: int, highest: int
) -> tuple[str | None, tuple[tuple[str, int], ...]]:
    """Why no torque may be switched on, and what to write so that it may."""
    if mode not in (POSITION, CURRENT_BASED):
        why = f"it is in mode {mode} (register 11); mode 3 controls its position within one turn"
        return why, (("mode", POSITION),)
    if drive & GOAL_IS_TORQUE_ON:
        why = "a goal switches its torque on by itself (bit 3 of register 10): after a restart it would jump"
        return why, (("drive_mode", drive & ~GOAL_IS_TORQUE_ON),)
    if lowest >= highest:
        why = f"its limits are {lowest} … {highest} steps (registers 52 and 48): none is left"
        return why, (("lowest", 0), ("highest", STEPS_PER_TURN - 1))
    return None, ()


DYNAMIXEL = DynamixelMake()
