"""The driver of a servo bus, for servos of any make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from armctl.errors import ArmctlError, BoardError, BoardTimeoutError, EnableError
from armctl.facts import QuantityLimits
from armctl.facts.commands import ReleaseUnconfirmed
from armctl.facts.english_commands import numbered
from armctl.hardware.board_type import Kept, nothing_kept
from armctl.hardware.bus import SCALE, BusSettings
from armctl.hardware.bus.known import DOUBTED, KnownServo
from armctl.hardware.bus.line import BusLine
from armctl.hardware.bus.make import SAG_DEG, Limits, ServoMake, Telemetry, bring_on
from armctl.hardware.bus.who import missing_words, nobody_words, settings_words
from armctl.hardware.driver import (
    Abilities,
    BoardIdentity,
    ChannelSettings,
    ChannelTable,
    Readback,
    Source,
)
from armctl.hardware.transport import Connection

_MISSED = 5
"""readings in a row without an answer after which a servo counts as gone"""
_GONE_S, _GONE_SIMULATED_S = 0.25, 1.0
"""... and for so long: a servo that starts anew is silent for longer; a busy computer may be late"""
_ALL_OFF = (
    "all servos have switched their torque off: their supply was interrupted, or another program did it; "
    "check the supply"
)
_LOOK_AGAIN_S = 0.5
"""how often a servo that is gone is asked whether it is there again"""
_RESTART_S = 2.0
"""how long a servo may take to start anew"""
_LONGEST_STEP_S = 0.05
"""time that a step of a goal counts for at most: what was late is not made up for by a jump"""


class BusDriver(Abilities):
    """A servo bus behind the ``Driver`` protocol. A channel is the id of a servo; units are its steps.

    ``open`` and ``configure`` move nothing and write no EEPROM. The first setpoint of a servo that is limp
    begins the torque-on rite (``make.switch_on``), which refuses with ``EnableError`` where torque would be
    a jump. A servo that is limp, or that has not answered of late, is never sent a goal. One that starts anew
    by itself stays limp until ``configure`` or ``release``. ``stop`` holds: goals are never far ahead.
    """

    def __init__(
        self,
        connection: Connection,
        make: ServoMake,
        servos: Sequence[int],
        timeout_s: float,
        settings: BusSettings,
        gripper: int | None = None,
        notes: Sequence[str] = (),
        kept: Kept = nothing_kept,
    ) -> None:
        """``servos``: the ids that the robot has, base first; ``timeout_s``: how long an answer may take.

        What stops the servo ``gripper``, it holds, and goes on. ``kept``: as in ``Setup``.
        """
        self._connection, self._make, self._timeout_s, self._kept = connection, make, timeout_s, kept
        self._sag = make.still_steps * SAG_DEG
        self._gone_s = _GONE_SIMULATED_S if connection.simulated else _GONE_S
        self._gripper, self._notes = gripper, tuple(notes)
        self._torque, self._supply_v = settings.torque_of, settings.supply_v
        self._line: BusLine | None = None
        self._ids = tuple(servos)
        self._servos: dict[int, KnownServo] = {}
        self._table = ChannelTable(SCALE)
        self._turn = 0
        self._limits: Mapping[int, QuantityLimits] = {}  # the same object until they change

    def open(self) -> BoardIdentity:
        """Open the line, see which servos answer, and read what stands in their EEPROM."""
        self.close()
        transport, info = self._connection.open()
        baud, serial = self._connection.baud, info.serial_number if info else None
        line = self._line = BusLine(transport, self._make.form, self._now, self._timeout_s, baud)
        self._servos = {
            one: KnownServo(one, torque=self._torque.get(one, 1.0), supply_v=self._supply_v)
            for one in self._ids
        }
        try:
            earlier = self._look_round(line, serial)
        except ArmctlError:
            self.close()
            raise
        return BoardIdentity(
            kind=self._make.title,
            port=line.name,
            serial_number=serial,
            simulated=self._connection.simulated,
            notes=() if self._connection.simulated else self._notes,
            earlier=earlier,
        )

    def configure(self, channels: Sequence[ChannelSettings]) -> None:
        """Take what each servo may do. Sends nothing: what a limp servo is set to is part of the rite.

        Servos that had started anew by themselves are limp as any other from now on.
        """
        table = ChannelTable(SCALE, channels, self._check)
        for one in self._servos.values():
            if one.went_off or one.gave_way:
                one.on = one.went_off = one.gave_way = False
                one.why_so = ""
        for one in channels:
            self._servos.setdefault(one.channel, KnownServo(one.channel, gone=True))
        self._table = table

    def write(self, setpoints: Mapping[int, float]) -> None:
        """Send goals [steps] in one packet. Servos that are limp are switched on first, base first."""
        line = self._opened
        goals = {servo: self._table.admit(servo, value) for servo, value in setpoints.items()}
        limp = [servo for servo in goals if not self._servos[servo].on or self._servos[servo].seen.refuses]
        switched, found = list[int](), set[int]()
        for servo in limp:
            try:
                if self._switch_on(line, self._servos[servo]):
                    switched.append(servo)
                else:
                    found.add(servo)
            except (EnableError, BoardTimeoutError) as error:
                for one in switched:  # not those that held before: the arm would drop
                    self._off(line, self._servos[one])
                refusal = error if isinstance(error, EnableError) else EnableError(error.reason)
                refusal.channel = servo
                raise refusal from error
        for servo, goal in goals.items():
            one = self._servos[servo]
            kept = servo in found and one.goal is not None and abs(goal - one.goal) <= self._sag
            # One that was found holding goes on so, and sinks no further; one not heard never catches up.
            if one.takes_goals and not (one.gave_way or kept):
                one.wanted = goal
        self._send(line)

    def read(self) -> Readback:
        """What the servos measure. One that misses some readings keeps its last position for that time.

        ``BoardTimeoutError``: none of them answered.
        """
        line = self._opened
        self._send(line)  # before what takes milliseconds: what was lost, or is still on its way
        self._ask(line)
        count = line.take_count()
        servos, now = [self._servos[one] for one in self._table.channels], self._now()
        faults, warnings = dict[int, str](), dict[int, str]()
        for one, needs in zip(servos, self._table.settings, strict=True):
            if (words := one.fault(now)) is not None:
                faults[one.id] = words
            if (words := one.warning(needs, now, grips=one.id == self._gripper)) is not None:
                warnings[one.id] = words
        limits = {one.id: one.limits(grips=one.id == self._gripper) for one in servos}
        self._limits = limits if limits != self._limits else self._limits
        all_off = len(servos) > 1 and all(one.went_off for one in servos)
        known = [one for one in servos if not one.gone]
        return Readback(
            positions={one.id: None if one.gone else one.seen.position for one in servos},
            source=Source.MEASURED,
            errors=(_ALL_OFF,) if all_off else (),
            faults={} if all_off else faults,
            warnings=warnings,
            load={one.id: one.seen.load for one in known},
            temperature={one.id: one.seen.temperature for one in known},
            voltage={one.id: one.seen.voltage for one in known},
            current={one.id: one.seen.current for one in known},
            limits=self._limits,
            asked=count.asked,
            lost=count.lost,
            delay_s=count.slowest_s,
            on={one.id: bool(one.seen.on) and not one.let_go for one in servos},
        )

    def stop(self) -> None:
        """Every servo that is on holds the goal that it was sent last."""
        for one in self._servos.values():
            one.wanted = one.goal

    def home(self) -> None:
        """Refuses: these servos know where they are."""
        raise BoardError("bus servos need no homing: their sensors know where they are")

    def release(self) -> None:
        """Torque off, servo by servo: the arm drops. ``BoardError`` names those that did not confirm."""
        self._release(tuple(self._servos))

    def release_channels(self, channels: Sequence[int]) -> None:
        """The same for these only."""
        self._release(channels)

    def clear_faults(self) -> None:
        """Servos that went off by themselves may be enabled again; those with latched errors start anew."""
        self._release([one.id for one in self._servos.values() if one.went_off])

    def limit_torque(self, limits: Mapping[int, float]) -> None:
        """How strong servos may be: a share 0 ... 1 of their full torque."""
        line = self._opened
        silent = [servo for servo, share in limits.items() if not self._limit(line, servo, share)]
        _require_limits(line, silent)

    def scale_torque(self, share: float, channels: Sequence[int] | None = None) -> None:
        """Those that are on have a share 0 ... 1 of the torque that each may have; see ``Abilities``."""
        line = self._opened
        wanted = self._servos if channels is None else channels
        silent: list[int] = []
        on = [one for one in self._servos.values() if one.on and not one.gone and one.id in wanted]
        for one in on:
            held = share != 1.0 or not one.weak or self._held_where_it_is(line, one)
            if not held or not self._tell_limit(line, one, one.torque, share):
                silent.append(one.id)
        _require_limits(line, silent)

    def _held_where_it_is(self, line: BusLine, one: KnownServo) -> bool:
        """Make the place where a weak servo is now its goal: it would be thrown back to the one it has."""
        place = self._make.hold_here(line, one.id)
        if place is not None:
            one.goal, one.wanted, one.sent_at = place, place, self._now()
        return place is not None

    def close(self) -> None:
        """Close the line; never raises. The servos go on holding."""
        if self._line is not None:
            self._line.close()
            self._line = None

    @property
    def _opened(self) -> BusLine:
        if self._line is None:
            raise BoardError("the line to the servos is not open; connect first")
        return self._line

    def _now(self) -> float:
        return self._connection.now()

    def _look_round(self, line: BusLine, serial: str | None) -> tuple[str, ...]:
        """Who answers; in words, what is unusual."""
        ids, kept = self._ids, self._kept(serial)
        model = self._make.table["model"]
        came = any([line.look_for_echo(servo, model.address) for servo in ids[:1]])
        found = [servo for servo in ids if line.ping(servo) is not None]
        if not found and ids:
            raise BoardTimeoutError(nobody_words(line, ids, came=came))
        notes: list[str] = []
        for servo in found:
            one = self._servos[servo]
            try:
                one.settings = self._make.settings(line, servo)
                self._take_rest(line, one)
            except BoardTimeoutError:
                one.gone = True
                continue
            notes += settings_words(servo, one.settings, kept.get(servo))
        for servo in set(ids) - set(found):
            self._servos[servo].gone = True
        return (*missing_words(ids, found), *notes)

    def _check(self, settings: ChannelSettings) -> None:
        if not SCALE.holds_range(settings, 0, self._make.last_step):
            raise BoardError(
                f"servo {settings.channel}: a range of {settings.minimum:g} … {settings.maximum:g} steps; "
                f"whole steps of 0 … {self._make.last_step} are possible"
            )

    # Power.

    def _switch_on(self, line: BusLine, one: KnownServo) -> bool:
        """Bring a servo under goals; whether its torque was off."""
        if one.gone or one.seen.position is None:
            raise EnableError(f"servo {one.id} does not answer; look at its plug and its power")
        if one.settings is None:
            one.settings = self._make.settings(line, one.id)
        limits = Limits(one.torque, self._speed_of(one.id))
        one.goal, limp = bring_on(self._make, line, one.id, one.settings, one.seen.position, limits)
        one.on, one.went_off, one.gave_way = True, False, False
        one.limited(one.torque, 1.0)
        one.seen = Telemetry(on=True, refuses=False, gave_way=False).after(one.seen)
        one.wanted, one.sent_at = one.goal, self._now()
        return limp

    def _off(self, line: BusLine, one: KnownServo) -> bool:
        one.on = one.went_off = one.gave_way = False
        one.goal = one.wanted = None
        one.seen = Telemetry(on=False).after(one.seen)
        confirmed = self._make.off(line, one.id)
        whole = one.eased == 1.0 and not one.maybe
        one.eased, one.maybe = 1.0, ()
        if confirmed and not whole:  # for other programs; what is switched on again gets it anew
            self._make.limit_torque(line, one.id, one.torque)
        if confirmed and one.seen.latched and self._make.clear(line, one.id):
            one.gone, one.asked_at = True, self._now()
            one.restarts_until = one.asked_at + _RESTART_S
        return confirmed

    def _release(self, servos: Sequence[int]) -> None:
        line = self._opened
        if not servos:
            return
        address, off = self._torque_off
        line.tell(
            self._make.form.sync_write(address, dict.fromkeys(servos, off))
        )  # all at once, then one by one
        present = [one for servo in servos if not (one := self._servos[servo]).gone]
        absent = [one for servo in servos if (one := self._servos[servo]).gone]
        silent = [one.id for one in present if not self._off(line, one)]
        for one in absent:  # it may hear though it is not heard
            one.on = one.went_off = one.gave_way = False
            one.goal = one.wanted = None
            line.tell(self._make.form.write(one.id, *self._torque_off))
        if silent:
            raise BoardTimeoutError(ReleaseUnconfirmed(line.name, "", "servo", tuple(silent)))

    @property
    def _torque_off(self) -> tuple[int, bytes]:
        return self._make.table["torque"].address, b"\0"

    def _limit(self, line: BusLine, servo: int, share: float) -> bool:
        """Whether it confirms its new limit; one that is limp gets it when it is switched on."""
        one, limit = self._servos[servo], share * self._torque.get(servo, 1.0)
        if one.on and not one.gone:
            return self._tell_limit(line, one, limit, 1.0)
        one.limited(limit, 1.0)
        return True

    def _tell_limit(self, line: BusLine, one: KnownServo, torque: float, eased: float) -> bool:
        """Whether it confirms; one that does not may have either limit until its next reading tells."""
        one.maybe += ((torque, eased),)
        if confirmed := self._make.limit_torque(line, one.id, torque * eased):
            one.limited(torque, eased)
        return confirmed

    # Goals.

    def _send(self, line: BusLine) -> None:
        """Send goals that differ from those that the servos have, no faster than the joints may move."""
        now = self._now()
        rows: dict[int, bytes] = {}
        if any(one.on and not one.let_go and not one.takes_goals for one in self._servos.values()):
            return  # one of them is not heard: the others wait, or the arm leaves its path
        for servo in self._table.channels:
            one = self._servos[servo]
            if not one.takes_goals or one.wanted is None or one.goal is None:
                continue
            lost = one.seen.goal is not None and one.seen_at > one.sent_at and one.seen.goal != one.goal
            if one.wanted == one.goal and not lost:
                continue
            one.goal = self._toward(one, one.goal, one.wanted, now)
            one.sent_at = now
            rows[servo] = self._make.goal_bytes(one.goal)
        if rows:
            line.tell(self._make.form.sync_write(self._make.goal_address, rows))

    def _toward(self, one: KnownServo, goal: int, wanted: int, now: float) -> int:
        """The next goal on the way to the one that is wanted, no faster than the joint may move."""
        speed = self._speed_of(one.id)
        if speed is None:
            return wanted
        most = max(1, round(speed * min(_LONGEST_STEP_S, now - one.sent_at)))
        return goal + max(-most, min(most, wanted - goal))

    def _speed_of(self, servo: int) -> float | None:
        """How fast its joint may move [steps/s]."""
        settings = self._table.of(servo)
        return None if settings is None else settings.speed

    # Readings.

    def _ask(self, line: BusLine) -> None:
        """Read the telemetry of all that are there, and look again for those that are gone."""
        make, now = self._make, self._now()
        present = [one for servo in self._table.channels if not (one := self._servos[servo]).gone]
        if present:
            ids = [one.id for one in present]
            answers = line.read_all(ids, make.telemetry.address, make.telemetry.size)
            lost = [servo for servo in ids if servo not in answers]
            if lost:  # once more: what a whole reading misses is mostly one packet
                answers |= line.read_all(lost, make.telemetry.address, make.telemetry.size)
            for one in present:
                if one.id in answers:
                    self._take(one, make.understood(answers[one.id], make.telemetry))
                else:
                    one.missed += 1
                    if one.missed >= DOUBTED:
                        one.wanted = one.goal  # what was not sent in its time is not made up for
            if not answers:
                raise BoardTimeoutError(f"{line.name}: none of the servos answers")
            for one in present:
                one.gone = one.missed >= _MISSED and self._now() - one.seen_at >= self._gone_s
        if present and make.in_turn:
            self._turn += 1
            one = present[self._turn % len(present)]
            block = make.in_turn[self._turn // len(present) % len(make.in_turn)]
            request = make.form.read(one.id, block.address, block.size)
            answers = line.exchange(request, [one.id], block.size)
            if one.id in answers:
                self._take(one, make.understood(answers[one.id], block))
        for servo in self._table.channels:
            one = self._servos[servo]
            if one.gone and now - one.asked_at >= _LOOK_AGAIN_S:
                one.asked_at = now
                self._look_again(line, one)
                break  # one at a time: each costs the wait for an answer that may not come

    def _look_again(self, line: BusLine, one: KnownServo) -> None:
        block = self._make.telemetry
        request = self._make.form.read(one.id, block.address, block.size)
        answer = line.exchange(request, [one.id], block.size).get(one.id)
        if answer is not None:
            one.gone, one.seen, one.settings, one.doubted = False, Telemetry(), None, None
            self._take(one, self._make.understood(answer, block))
            self._take_rest(line, one)

    def _take_rest(self, line: BusLine, one: KnownServo) -> None:
        """Read what is else read in turn."""
        for block in self._make.in_turn:
            self._take(one, self._make.understood(line.read(one.id, block.address, block.size), block))

    def _take(self, one: KnownServo, seen: Telemetry) -> None:
        """Believe an answer, unless its position is too far from the one before; the next one decides."""
        now = self._now()
        if not one.believes(seen.position, now, self._make.steps_per_turn):
            return
        if seen.position is not None:
            one.missed, one.seen_at = 0, now
        one.seen = seen.after(one.seen)
        limit = seen.torque_limit
        other = limit is not None and not one.has_limit(limit) and self._make.keeps_limit
        forgot = other or bool(seen.forgot)
        if one.on and not one.went_off and (one.seen.on is False or forgot):
            one.went_off = True
            one.goal = one.wanted = None
            if one.seen.on and self._line is not None:  # it had started anew, and a goal switched it on
                self._make.off(self._line, one.id)
        place = one.gives_way(now, grips=one.id == self._gripper)
        if place is not None and self._line is not None:
            row = {one.id: self._make.goal_bytes(place)}
            self._line.tell(self._make.form.sync_write(self._make.goal_address, row))
        if self._supply_v is None and one.seen.voltage is not None:
            one.supply_v = max(one.supply_v or 0.0, one.seen.voltage)
        one.note(grips=one.id == self._gripper)


def _require_limits(line: BusLine, silent: Sequence[int]) -> None:
    if silent:
        raise BoardTimeoutError(f"{line.name}: {numbered('servo', silent)} did not confirm the torque limit")
