"""Setting servos up: who is on a bus, and one change at a time.

Nothing here runs while an arm is connected: whoever sets servos up has the line for himself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from armctl.errors import BoardError, BoardTimeoutError, InputError, out_of_range
from armctl.hardware.bus.line import ATTEMPTS, BusLine
from armctl.hardware.bus.make import Limits, ServoMake, bring_on
from armctl.hardware.servos import FoundServo
from armctl.hardware.transport import Transport

IDS = range(253)
"""that a servo may have"""
_PING_S, _SIMULATED_PING_S = 0.004, 0.02
"""how long a scan waits for an id that may not be there"""
_NUDGE_TORQUE = 0.3
NUDGE_DEG = 2.0
"""by which a servo turns at most to show which one it is"""


class BusSetup:
    """A bus to be set up. ``open_line`` opens its port at a baud rate; one line is open at a time."""

    def __init__(
        self,
        make: ServoMake,
        open_line: Callable[[int], Transport],
        now: Callable[[], float],
        timeout_s: float,
        *,
        simulated: bool = False,
    ) -> None:
        """``timeout_s``: how long an answer of a servo that is there may take."""
        self._timeout_s = timeout_s
        self._make, self._open_line, self._now = make, open_line, now
        self._simulated, self._ping_s = simulated, _SIMULATED_PING_S if simulated else _PING_S
        self._line: BusLine | None = None
        self._baud = 0

    def close(self) -> None:
        """Close the port. Never raises."""
        if self._line is not None:
            self._line.close()
            self._line = None

    def at(self, baud: int) -> BusLine:
        """The open line at this rate."""
        if self._line is None or self._baud != baud:
            self.close()
            self._line = BusLine(self._open_line(baud), self._make.form, self._now, self._timeout_s, baud)
            self._baud = baud
            self._line.look_for_echo(1, self._make.table["model"].address)
        return self._line

    def scan(
        self,
        bauds: Sequence[int] | None = None,
        ids: Iterable[int] = IDS,
        likely: Iterable[int] = (),
        progress: Callable[[float], None] = lambda _: None,
    ) -> list[FoundServo]:
        """All that answer, at any of ``bauds`` (None: all that the make knows), by rate and id.

        ``likely`` ids are asked again and again; the others once, and not for long.
        ``progress`` is called with the share of the work that is done, and may raise to end it.
        """
        rates, wanted, sure = list(bauds or self._make.bauds), list(ids), set(likely)
        if self._simulated:  # its servos answer at whatever rate they are asked
            rates = rates[:1]
        found: list[FoundServo] = []
        for i, baud in enumerate(rates):
            line = self.at(baud)
            for k, servo in enumerate(wanted):
                progress((i + k / len(wanted)) / len(rates))
                patience = (ATTEMPTS, None) if servo in sure else (1, self._ping_s)
                if line.ping(servo, *patience) is None:
                    continue
                if (one := self.look(baud, servo)) is not None:
                    found.append(one)
        progress(1.0)
        return found

    def look(self, baud: int, servo: int) -> FoundServo | None:
        """A servo that answers; None where it no longer does."""
        make, line = self._make, self.at(baud)
        try:
            settings = make.settings(line, servo)
            seen = make.understood(
                line.read(servo, make.telemetry.address, make.telemetry.size), make.telemetry
            )
            for block in make.in_turn:
                seen = make.understood(line.read(servo, block.address, block.size), block).after(seen)
        except BoardTimeoutError:
            return None
        name = make.models.get(settings.model, f"model {settings.model}")
        return FoundServo(
            servo,
            baud,
            name,
            settings,
            seen.position,
            seen.voltage,
            seen.temperature,
            seen.on,
            seen.wrong,
        )

    def change_id(self, baud: int, old: int, new: int) -> FoundServo:
        """Give the servo ``old`` another id, in its EEPROM, and see that it has it.

        ``InputError``: no such id; ``BoardError``: another servo has it, or the servo did not take it.
        """
        if new not in IDS:
            raise InputError(f"an id of {out_of_range(new, IDS[0], IDS[-1])}")
        line = self.at(baud)
        if line.ping(old) is None:
            raise BoardTimeoutError(f"servo {old} does not answer at {baud} baud; nothing was changed")
        if old != new and line.ping(new) is not None:
            raise BoardError(
                f"there is a servo {new} already; nothing was changed. Plug in one new servo at a time"
            )
        self._make.write_kept(line, old, "id", new, answers_as=new)
        found = self.look(baud, new)
        if found is None or (old != new and line.ping(old, attempts=1) is not None):
            raise BoardError(f"servo {old} did not take the id {new}; look again with `armctl servos`")
        return found

    def change_baud(self, baud: int, servo: int, new: int) -> FoundServo:
        """Have a servo answer at the rate ``new``, by its EEPROM, and see that it does.

        ``InputError``: its make has no such rate; ``BoardError``: its torque is on, or it did not take it.
        """
        make = self._make
        if new not in make.baud_numbers:
            rates = ", ".join(map(str, make.bauds))
            raise InputError(f"a rate of {new} baud; the servos of a {make.title} have {rates}")
        line, (name, number) = self.at(baud), (make.baud_register, make.baud_numbers[new])
        make.require_limp(line, servo)
        make.unlock(line, servo)
        line.write(servo, make.table[name].address, make.table.encode(name, number))
        at = new if self.at(new).ping(servo) is not None else baud
        make.lock(self.at(at), servo)
        found = self.look(at, servo)
        if found is None or at != new:
            raise BoardError(f"servo {servo} did not take {new} baud; look for it at every rate")
        return found

    def write(self, baud: int, servo: int, name: str, number: int) -> None:
        """Write a register of its EEPROM, lock it, and see that it is there."""
        self._make.write_kept(self.at(baud), servo, self._make.registers.get(name, name), number)

    def nudge(self, baud: int, servo: int, degrees: float = NUDGE_DEG) -> None:
        """Turn it a little and back, weakly, to show which one it is; limp afterwards if it was before."""
        if not 0.0 < abs(degrees) <= NUDGE_DEG:
            raise InputError(f"a nudge of {out_of_range(abs(degrees), 0.1, NUDGE_DEG, '°')}")
        line, make = self.at(baud), self._make
        if not make.limits_torque:
            raise BoardError(
                "these servos take no torque limit: turn the joint by hand, and look which position changes"
            )
        found = self.look(baud, servo)
        if found is None or found.position is None:
            raise BoardTimeoutError(f"servo {servo} does not answer at {baud} baud")
        if found.on:
            raise BoardError(f"the torque of servo {servo} is on: it holds an arm. Release it first")
        limits = Limits(_NUDGE_TORQUE, make.steps_per_turn / 8)
        place, _ = bring_on(make, line, servo, found.settings, found.position, limits)
        way = round(degrees * make.steps_per_turn / 360)
        if not found.settings.lowest <= place + way <= found.settings.highest:
            way = -way
        try:
            for goal in (*_ramp(place, place + way), *_ramp(place + way, place)):
                line.tell(make.form.sync_write(make.goal_address, {servo: make.goal_bytes(goal)}))
                self._wait(_NUDGE_STEP_S)
        finally:
            off = make.off(line, servo)
        if not off:
            raise BoardTimeoutError(
                f"servo {servo} did not confirm that its torque is off again; cut the power of the servos"
            )

    def _wait(self, seconds: float) -> None:
        """Let time pass as an answer would."""
        until = self._now() + seconds
        while self._now() < until and self._line is not None:
            self._line.pause(until - self._now())


_NUDGE_STEP_S = 0.02
_NUDGE_STEPS = 15


def _ramp(start: int, end: int) -> list[int]:
    return [round(start + (end - start) * k / _NUDGE_STEPS) for k in range(1, _NUDGE_STEPS + 1)]
