"""A simulated Feetech servo, of the STS or the SCS series."""

from __future__ import annotations

import math
from collections.abc import Mapping

from armctl.hardware.bus.packets import BROADCAST, BusPacket, Instruction, PacketForm
from armctl.hardware.bus.plant import PlantJoint
from armctl.hardware.bus.simulated import BusServo, Gear, Supply
from armctl.hardware.bus.table import ControlTable
from armctl.hardware.feetech.make import (
    CURRENT,
    HEAT,
    MULTI_TURN,
    OVERLOAD,
    SENSOR,
    STEPS_PER_TURN,
    TABLE,
    VOLTAGE,
    FeetechMake,
)

_RAM = TABLE["torque"].address
_SIZE = 71
_CALIBRATE = 0x0B
_THIS_IS_THE_MIDDLE = 128
_MIDDLE = STEPS_PER_TURN // 2
_RESTART_S = 1.0
_DUTY_PER_RAD, _P_GAIN = 0.0073 * STEPS_PER_TURN / math.tau, 32
"""share of the torque a radian of error, at this gain: 14 N·m/rad of an STS3215 at 12 V"""
_ABSENT = {"offset": 0, "mode": 0, "torque_limit": 1000, "protection_current": 511}
FACTORY = {
    "firmware_major": 3,
    "firmware_minor": 10,
    "model": 777,
    "id": 1,
    "status_level": 1,
    "highest": 4095,
    "hottest": 70,
    "most_voltage": 140,
    "least_voltage": 40,
    "most_torque": 1000,
    "phase": 12,
    "unloading": 44,
    "led_alarm": 47,
    "p_gain": 32,
    "d_gain": 32,
    "start_force": 16,
    "forward_dead_zone": 1,
    "backward_dead_zone": 1,
    "protection_current": 500,
    "resolution": 1,
    "protection_torque": 20,
    "protection_time": 200,
    "overload_torque": 80,
    "over_current_time": 200,
}


def factory_memory(
    table: ControlTable = TABLE, factory: Mapping[str, int] = FACTORY, **changes: int
) -> bytes:
    """What a new servo's table holds, with changes by name."""
    memory = bytearray(_SIZE)
    for name, number in {**factory, **changes}.items():
        register = table[name]
        memory[register.address : register.end] = table.encode(name, number)
    return bytes(memory)


class SimulatedFeetech(BusServo):
    """A servo that speaks Feetech's protocol: table, goals that switch torque on, protection, EEPROM lock.

    ``memory`` is what it holds from the factory; what is written while ``lock`` is 1 is forgotten at the
    next power cut. What its series has no register for, is as an STS has it from the factory.
    """

    def __init__(
        self, make: FeetechMake, joint: PlantJoint, gear: Gear, supply: Supply, memory: bytes
    ) -> None:
        super().__init__(make.table, joint, gear, supply, memory)
        self._make = make
        self._kept, self._factory = bytes(self.memory[:_RAM]), bytes(memory)
        self._stiffness = _DUTY_PER_RAD / _P_GAIN * math.tau / make.steps_per_turn
        if not make.limits_torque:  # one of the small series: as stiff with its own gain
            self._stiffness *= _P_GAIN / self.get("p_gain")
        self._way = self._overloaded_s = 0.0
        self._reference = 0.0
        self._latched = 0
        self.sensor_fails = False

    def _decoded(self, name: str) -> int:
        return super()._decoded(name) if name in self.table else _ABSENT[name]

    def power_up(self) -> None:
        """Torque off, goal 0, the torque limit from the EEPROM; that is locked, or open in some series."""
        self.store(0, self._kept + bytes(_SIZE - _RAM))
        if self._make.limits_torque:
            self.put("torque_limit", self.get("most_torque"))
        self.put("lock", int(self._make.wakes_locked))
        self._overloaded_s, self._latched = 0.0, 0

    def handle(self, packet: BusPacket, form: PacketForm) -> BusPacket | None:
        """A series that cannot answer all at once does not answer a ping to all either."""
        if packet.id == BROADCAST and packet.code == Instruction.PING and not form.sync_reads:
            return None
        return super().handle(packet, form)

    def errors(self) -> int:
        """What is wrong now, and the overload that lasts until the next goal."""
        volts, wrong = round(10 * self.supply.volts), self._latched
        if not self.get("least_voltage") <= volts <= self.get("most_voltage"):
            wrong |= VOLTAGE
        if self.sensor_fails:
            wrong |= SENSOR
        if self.heat > self.get("hottest"):
            wrong |= HEAT
        if self.amps > self.get("protection_current") * 0.0065:
            wrong |= CURRENT
        return wrong

    def answers(self, instruction: int) -> bool:
        """Level 0 answers pings and reads only."""
        level = self.get("status_level")
        return level != 0 or instruction in (Instruction.PING, Instruction.READ)

    def other(self, packet: BusPacket) -> BusPacket | None:
        """Restart, factory values, calibration."""
        if packet.code == Instruction.REBOOT:
            self.restart(_RESTART_S)
            return None
        if packet.code == Instruction.FACTORY_RESET:
            number = self.id
            self.store(0, self._factory[:_RAM])
            self.put("id", number)
            self._kept = bytes(self.memory[:_RAM])
        elif packet.code == _CALIBRATE and "offset" in self.table:
            self._calibrate(int.from_bytes(packet.data[:2], "little") if packet.data else _MIDDLE)
        return BusPacket(self.id, self.errors()) if self.answers(packet.code) else None

    def written(self, address: int, data: bytes) -> int:
        """Take it as the servo does: a register that takes no such value is left as it was."""
        self.store(address, data)
        written = range(address, address + len(data))
        if address < _RAM and self.get("lock") == 0:
            self._kept = bytes(self.memory[:_RAM])
        if self.table["torque"].address in written:
            self._torque_written()
        if self.table["goal_position"].address in written:
            self._goal_written()
        return 0

    def _torque_written(self) -> None:
        if self.get("torque") == _THIS_IS_THE_MIDDLE and "offset" in self.table:
            self._calibrate(_MIDDLE)
            self.put("torque", 0)
        elif self.get("torque") == 1:
            self._reference = self._position

    def _goal_written(self) -> None:
        if self.get("mode") != 0:
            return
        if self.get("highest") > self.get("lowest"):
            goal = min(self.get("highest"), max(self.get("lowest"), self.get("goal_position")))
            self.put("goal_position", goal)
        self._latched, self._overloaded_s = 0, 0.0
        if self.get("torque") != 1 and self.get("goal_position") != self.get("present_position"):
            self._reference = self._position
            self.put("torque", 1)

    def _calibrate(self, steps: int) -> None:
        """What the shaft shows now shall read ``steps``; the offset stays in the EEPROM."""
        offset = round(self.shaft) - steps
        half = STEPS_PER_TURN // 2
        self.put("offset", max(1 - half, (offset + half) % STEPS_PER_TURN - half))
        self._kept = bytes(self.memory[:_RAM])
        self.measure()

    @property
    def _position(self) -> float:
        place = self.shaft - self.get("offset")
        if "offset" not in self.table:  # a potentiometer, which ends
            return min(float(self._make.last_step), max(0.0, place))
        return place if self.get("phase") & MULTI_TURN else place % STEPS_PER_TURN

    def drive(self, dt: float) -> float:
        """P control of the position toward a reference that moves at the speed limit."""
        if self.get("torque") != 1 or self.errors() & (VOLTAGE | SENSOR | HEAT) & self.get("unloading"):
            return 0.0
        goal, speed = float(self.get("goal_position")), abs(self.get("goal_speed"))
        most = speed * dt if speed else float("inf")
        self._reference += max(-most, min(most, goal - self._reference))
        error = self._reference - self._position
        limit = self.get("torque_limit") / 1000
        if self._latched & OVERLOAD:
            limit = min(limit, self.get("protection_torque") / 100)
        share = max(-limit, min(limit, error * self._stiffness * self.get("p_gain")))
        heavy = abs(share) > self.get("overload_torque") / 100
        self._overloaded_s = self._overloaded_s + dt if heavy else 0.0
        if self._overloaded_s > self.table["protection_time"].scale * self.get("protection_time"):
            self._latched |= OVERLOAD
        return share

    def measure(self) -> None:
        """Position, speed, load, voltage, temperature, current."""
        put = self.put
        put("present_position", max(-32767, min(32767, round(self._position))) % (1 << 15))
        speed = self.joint.speed * self.gear.per_rad
        put("present_speed", round(max(-32767.0, min(32767.0, speed))))
        put("present_load", round(1000 * max(-1.0, min(1.0, self.share))))
        put("present_voltage", min(255, round(10 * self.supply.volts)))
        put("present_temperature", min(255, round(self.heat)))
        put("status", self.errors())
        put("moving", int(abs(speed) > 1.0))
        if "present_current" in self.table:
            put("present_current", round(self.amps / 0.0065))
