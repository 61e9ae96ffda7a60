"""A simulated Feetech STS servo."""

from __future__ import annotations

from armctl.hardware.bus.packets import BusPacket, Instruction
from armctl.hardware.bus.plant import PlantJoint
from armctl.hardware.bus.simulated import BusServo, Gear, Supply
from armctl.hardware.feetech.make import (
    CURRENT,
    HEAT,
    MULTI_TURN,
    OVERLOAD,
    SENSOR,
    STEPS_PER_TURN,
    TABLE,
    VOLTAGE,
)

_RAM = TABLE["torque"].address
_SIZE = 71
_CALIBRATE = 0x0B
_THIS_IS_THE_MIDDLE = 128
_MIDDLE = STEPS_PER_TURN // 2
_RESTART_S = 1.0
_DUTY_PER_STEP = 0.0073 / 32
"""share of the torque a step of error and a unit of P: 14 N·m/rad at P = 32 and 12 V"""
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
    "protection_current": 310,
    "resolution": 1,
    "protection_torque": 20,
    "protection_time": 200,
    "overload_torque": 80,
    "over_current_time": 200,
}


def factory_memory(**changes: int) -> bytes:
    """What a new servo's table holds, with changes by name."""
    memory = bytearray(_SIZE)
    for name, number in (FACTORY | changes).items():
        register = TABLE[name]
        memory[register.address : register.end] = TABLE.encode(name, number)
    return bytes(memory)


class SimulatedSts(BusServo):
    """A servo that speaks Feetech's protocol: table, goals that switch torque on, protection, EEPROM lock.

    ``memory`` is what it holds from the factory; what is written while ``lock`` is 1 is forgotten at the
    next power cut.
    """

    def __init__(self, joint: PlantJoint, gear: Gear, supply: Supply, memory: bytes) -> None:
        super().__init__(TABLE, joint, gear, supply, memory)
        self._kept = bytes(self.memory[:_RAM])
        self._way = self._overloaded_s = 0.0
        self._reference = 0.0
        self._latched = 0
        self.sensor_fails = False

    def power_up(self) -> None:
        """Torque off, goal 0, the torque limit from the EEPROM, the EEPROM locked."""
        self.store(0, self._kept + bytes(_SIZE - _RAM))
        self.put("torque_limit", self.get("most_torque"))
        self.put("lock", 1)
        self._overloaded_s, self._latched = 0.0, 0

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
            self._kept = factory_memory(id=number)[:_RAM]
            self.store(0, self._kept)
        elif packet.code == _CALIBRATE:
            self._calibrate(int.from_bytes(packet.data[:2], "little") if packet.data else _MIDDLE)
        return BusPacket(self.id, self.errors()) if self.answers(packet.code) else None

    def written(self, address: int, data: bytes) -> int:
        """Take it as the servo does: a register that takes no such value is left as it was."""
        self.store(address, data)
        written = range(address, address + len(data))
        if address < _RAM and self.get("lock") == 0:
            self._kept = bytes(self.memory[:_RAM])
        if TABLE["torque"].address in written:
            self._torque_written()
        if TABLE["goal_position"].address in written:
            self._goal_written()
        return 0

    def _torque_written(self) -> None:
        if self.get("torque") == _THIS_IS_THE_MIDDLE:
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
        if self.get("phase") & MULTI_TURN:
            return place
        return place % STEPS_PER_TURN

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
        share = max(-limit, min(limit, error * _DUTY_PER_STEP * self.get("p_gain")))
        heavy = abs(share) > self.get("overload_torque") / 100
        self._overloaded_s = self._overloaded_s + dt if heavy else 0.0
        if self._overloaded_s > self.get("protection_time") / 100:
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
        put("present_current", round(self.amps / 0.0065))
