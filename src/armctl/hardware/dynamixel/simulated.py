"""A simulated Dynamixel X servo (XM430-W350)."""

from __future__ import annotations

import math
from collections.abc import Sequence

from armctl.hardware.bus.packets import BROADCAST, BusPacket, Instruction
from armctl.hardware.bus.plant import PlantJoint
from armctl.hardware.bus.simulated import BusServo, Gear, Supply
from armctl.hardware.bus.table import Register
from armctl.hardware.dynamixel.make import (
    ACCESS,
    ALERT,
    ENCODER,
    FULL_PWM,
    GOAL_IS_TORQUE_ON,
    HEAT,
    LENGTH,
    LIMIT,
    OVERLOAD,
    POSITION,
    RANGE,
    REVERSE,
    STEPS_PER_TURN,
    TABLE,
    TIME_BASED,
    UNKNOWN,
    VOLTAGE,
)

_RAM = TABLE["torque"].address
_CLEAR = 0x10
_RESTART_S = 0.4
_P_SCALE = 128
"""PWM a step of error is ``position_p_gain`` by this (e-Manual, gains of the position controller)"""
_RPM = STEPS_PER_TURN / 60
_VELOCITY = 0.229 * _RPM
"""steps/s of a count of velocity"""
_HEAVY, _OVERLOAD_S = 0.9, 2.0
"""share of the torque, and for how long it may be given; ROBOTIS prints no figures"""
_AMPERE = 1 / 0.00269
"""counts of register 126 (XM430)"""
_CURRENT = 126
_GOALS = ("goal_pwm", "goal_velocity", "goal_position")
FACTORY = {
    "model": 1020,
    "firmware_version": 45,
    "id": 1,
    "baud_rate": 3,
    "return_delay_time": 250,
    "operating_mode": 3,
    "secondary_id": 255,
    "protocol_type": 2,
    "moving_threshold": 10,
    "temperature_limit": 80,
    "max_voltage_limit": 160,
    "min_voltage_limit": 95,
    "pwm_limit": 885,
    "velocity_limit": 200,
    "max_position_limit": 4095,
    "shutdown": 52,
}


def factory_memory(**changes: int) -> bytes:
    """What a new servo's table holds, with changes by name."""
    memory = bytearray(TABLE.size)
    for name, number in (FACTORY | changes).items():
        register = TABLE[name]
        memory[register.address : register.end] = TABLE.encode(name, number)
    return bytes(memory)


class SimulatedX(BusServo):
    """A servo that speaks Protocol 2.0: error codes, bus watchdog, hardware errors that last, restart.

    Its profile limits the speed; that of the acceleration is left out. Of a servo whose watchdog is cleared
    the worst is assumed: it goes on to the goal that it had.
    """

    def __init__(self, joint: PlantJoint, gear: Gear, supply: Supply, memory: bytes) -> None:
        super().__init__(TABLE, joint, gear, supply, memory)
        self._kept = bytes(self.memory[:_RAM])
        self._reference = self._speed = 0.0
        self._quiet_s = self._heavy_s = 0.0
        self._base = 0
        """whole turns that positions leave out [steps]"""
        self.sensor_fails = False

    def power_up(self) -> None:
        """Torque off, no error, no watchdog, the goal where the shaft is."""
        self.store(0, self._kept + bytes(TABLE.size - _RAM))
        self.put("status_return_level", 2)
        self.put("velocity_i_gain", 1920)
        self.put("velocity_p_gain", 100)
        self.put("position_p_gain", 800)
        self.put("goal_pwm", self.get("pwm_limit"))
        self._quiet_s = self._heavy_s = 0.0
        self._wrap()
        self.put("goal_position", round(self._position))

    @property
    def introduction(self) -> bytes:
        """Model and firmware."""
        return bytes(self.memory[0:2] + self.memory[6:7])

    @property
    def watchdog_tripped(self) -> bool:
        """Whether it holds by itself, for want of instructions."""
        return self.get("bus_watchdog") < 0

    def errors(self) -> int:
        """The alert that stands in every answer after a hardware error."""
        return ALERT if self.get("hardware_error_status") else 0

    def fail(self, error: int) -> None:
        """A hardware error: it lasts, and where ``shutdown`` says so the torque is gone."""
        self.put("hardware_error_status", self.get("hardware_error_status") | error)
        if error & self.get("shutdown"):
            self.put("torque", 0)

    def overhear(self) -> None:
        """Any instruction feeds its watchdog."""
        self._quiet_s = 0.0

    def answers(self, instruction: int) -> bool:
        """Level 0: pings; 1: reads too; 2: all."""
        least: dict[int, int] = {Instruction.PING: 0, Instruction.READ: 1}
        return self.get("status_return_level") >= least.get(instruction, 2)

    def other(self, packet: BusPacket) -> BusPacket | None:
        """Restart, factory values, turns cleared; it answers before it starts anew."""
        code = 0 if packet.code in (Instruction.REBOOT, Instruction.FACTORY_RESET, _CLEAR) else UNKNOWN
        said = BusPacket(self.id, self.errors() | code)
        answers = self.answers(packet.code) and packet.id != BROADCAST
        if packet.code == Instruction.FACTORY_RESET and self.get("torque"):
            said = BusPacket(self.id, self.errors() | ACCESS)
        elif packet.code == Instruction.FACTORY_RESET:
            number = 1 if packet.data[:1] == b"\xff" else self.id
            self._kept = factory_memory(id=number, model=self.get("model"))[:_RAM]
            self.restart(_RESTART_S)
        elif packet.code == Instruction.REBOOT:
            self.restart(_RESTART_S)
        elif packet.code == _CLEAR and not self.get("torque"):
            self._wrap()
        return said if answers else None

    def written(self, address: int, data: bytes) -> int:
        """Take it, or refuse all of it with an error code."""
        end = address + len(data)
        touched = [one for one in TABLE.registers if one.address < end and one.end > address]
        if error := self._refusal(touched, address, end):
            return error
        before = bytes(self.memory)
        self.store(address, data)
        for register in touched:
            if error := self._out_of_range(register):
                self.store(0, before)
                return error
        if address < _RAM:
            self._kept = bytes(self.memory[:_RAM])
        self._obey({one.name for one in touched}, was_on=before[_RAM] == 1)
        return 0

    def _refusal(self, touched: Sequence[Register], address: int, end: int) -> int:
        """What it refuses whatever the value is; 0: nothing."""
        if any(one.address < address or one.end > end for one in touched):
            return LENGTH
        if not touched or end > TABLE.size:
            return ACCESS
        if any(not one.writable or (one.kept and self.get("torque")) for one in touched):
            return ACCESS
        if self.watchdog_tripped and any(one.name in _GOALS for one in touched):
            return RANGE
        return 0

    def _out_of_range(self, register: Register) -> int:
        """Why it does not take the value that stands in its table now; 0: it does."""
        number = self.get(register.name)
        if register.high is not None and abs(number) > register.high:
            return RANGE
        match register.name:
            case "bus_watchdog":
                return RANGE if number < 0 else 0
            case "goal_pwm":
                return 0 if abs(number) <= self.get("pwm_limit") else LIMIT
            case "goal_position" if self.get("operating_mode") == POSITION:
                low, high = self.get("min_position_limit"), self.get("max_position_limit")
                return 0 if low <= number <= high else LIMIT
            case _:
                return 0

    def _obey(self, names: set[str], *, was_on: bool) -> None:
        """Do what the new values ask for."""
        if "goal_position" in names:
            if self.get("drive_mode") & GOAL_IS_TORQUE_ON:
                self.put("torque", 1)
            away = abs(self.get("goal_position") - self._reference)
            self._speed = 1000 * away / max(1, self.get("profile_velocity"))
        if self.get("hardware_error_status") & self.get("shutdown"):
            self.put("torque", 0)  # it takes the 1, and stays off
        if self.get("torque") and not was_on:
            self._wrap()
            self._reference, self._quiet_s, self._heavy_s = self._position, 0.0, 0.0

    def _wrap(self) -> None:
        """Positions begin within one turn again."""
        turned = self._turned
        self._base = round(turned - turned % STEPS_PER_TURN)

    @property
    def _turned(self) -> float:
        """[steps] before the homing offset, in its own direction."""
        return STEPS_PER_TURN - self.shaft if self.get("drive_mode") & REVERSE else self.shaft

    @property
    def _position(self) -> float:
        return self._turned - self._base + self.get("homing_offset")

    def drive(self, dt: float) -> float:
        """P control toward a reference that moves at the speed of the profile."""
        self._look_after(dt)
        if not self.get("torque"):
            self._heavy_s = 0.0
            return 0.0
        self._guard(dt)
        if not self.watchdog_tripped:
            most = self._most_speed * dt
            self._reference += max(-most, min(most, self.get("goal_position") - self._reference))
        error = self._reference - self._position
        limit = abs(self.get("goal_pwm")) / FULL_PWM
        share = max(-limit, min(limit, error * self.get("position_p_gain") / _P_SCALE / FULL_PWM))
        self._heavy_s = self._heavy_s + dt if abs(share) >= _HEAVY else 0.0
        return -share if self.get("drive_mode") & REVERSE else share

    @property
    def _most_speed(self) -> float:
        """Of its reference [steps/s]."""
        profile = self.get("profile_velocity")
        if profile == 0:
            return float("inf")
        return self._speed if self.get("drive_mode") & TIME_BASED else profile * _VELOCITY

    def _look_after(self, dt: float) -> None:
        """Hardware errors."""
        volts = round(10 * self.supply.volts)
        if not self.get("min_voltage_limit") <= volts <= self.get("max_voltage_limit"):
            self.fail(VOLTAGE)
        if self.heat > self.get("temperature_limit"):
            self.fail(HEAT)
        if self.sensor_fails:
            self.fail(ENCODER)
        if self._heavy_s > _OVERLOAD_S:
            self.fail(OVERLOAD)
        if not self.get("torque"):
            self._quiet_s = 0.0

    def _guard(self, dt: float) -> None:
        """The bus watchdog: without an instruction for its time the servo stops where it is."""
        self._quiet_s += dt
        limit = self.get("bus_watchdog")
        if limit > 0 and self._quiet_s > limit * 0.02:
            self.put("bus_watchdog", -1)
            self._reference = self._position

    def measure(self) -> None:
        """Position, speed, load, voltage, temperature, current."""
        put = self.put
        way = -1 if self.get("drive_mode") & REVERSE else 1
        speed = way * self.joint.speed * self.gear.per_rad
        put("present_position", round(self._position))
        put("present_velocity", max(-2047, min(2047, round(speed / _VELOCITY))))
        put("present_pwm", round(way * FULL_PWM * max(-1.0, min(1.0, self.share))))
        current = round(way * math.copysign(self.amps, self.share) * _AMPERE)
        self.memory[_CURRENT : _CURRENT + 2] = current.to_bytes(2, "little", signed=True)
        put("present_input_voltage", round(10 * self.supply.volts))
        put("present_temperature", min(255, max(0, round(self.heat))))
        put("moving", int(abs(speed) > self.get("moving_threshold") * _VELOCITY))
        put("position_trajectory", round(self._reference))
