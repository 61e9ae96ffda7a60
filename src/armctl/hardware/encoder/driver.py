"""The driver for armctl's own firmware for motors with encoders (firmware/README.md), and its check-up."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

from armctl.errors import ArmctlError, BoardError, BoardTimeoutError, StateError
from armctl.hardware.board_type import (
    ChannelsToCheck,
    CheckUp,
    Finding,
    failed,
    not_checked,
    ok,
    round_trips,
    warning,
)
from armctl.hardware.driver import Abilities, BoardIdentity, ChannelSettings, HomingState, Readback, Source
from armctl.hardware.encoder.axes import AxisTable, EncoderSettings
from armctl.hardware.encoder.messages import (
    HOMED_AGAIN,
    PROTOCOL,
    RESET_FLAGS,
    Banner,
    BoardFlag,
    Mode,
    Realtime,
    Status,
    decode_banner,
    fault_words,
    flag_words,
    lost_words,
)
from armctl.hardware.encoder.pins import SparePins, check_pins
from armctl.hardware.encoder.session import UNKNOWN_RESET, EncoderSession, protocol_advice
from armctl.hardware.transport import Connection
from armctl.robot.signals import Signals

WATCHDOG_MS = 500
SILENCE_NOTE = (
    f"the board switches its motors off {WATCHDOG_MS} ms after it last heard from this computer: if the "
    "program or the cable fails, or on Disconnect, joints that their gears do not hold sink"
)

_REACH_MS = 30  # longer than the 20 ms between setpoints: one that comes late finds the arm still moving
_KEEP_ALIVE_S = 0.1
_BYTE_ATTEMPTS = 3

_UNEXPECTED = "unexpected"
_RESETS = {
    "power": " (its supply was interrupted)",
    "external": " (its port was opened by another program, or its reset button pressed)",
    "brownout": " (its supply voltage sagged)",
    "watchdog": " (its program hung)",
    _UNEXPECTED: (
        " (in the middle of work: its supply voltage sagged, its reset button was pressed, or another "
        "program opened its port)"
    ),
}


class EncoderDriver(Abilities):
    """An encoder board behind the ``Driver`` protocol. A channel is an axis; units are joint counts.

    ``stop`` sets the board's hold, which refuses setpoints; the next ``write`` releases it. Motors that
    the board has switched off by itself (trip, watchdog, reset) stay off: ``write`` refuses until
    ``release`` or ``home``, which clear the board's faults. The board also switches them off half a second
    after the last line, so ``read`` must be called more often: it sends a line where nothing else was sent.

    ``settings`` is how each axis is controlled and homed; ``timeout_s`` how long an answer may take, with the
    repetitions of a lost line.
    """

    def __init__(self, connection: Connection, settings: EncoderSettings, timeout_s: float = 0.1) -> None:
        self._connection = connection
        self._arm = settings
        self._timeout_s = timeout_s
        self._opened: EncoderSession | None = None
        self._forget_board()

    def open(self) -> BoardIdentity:
        """Open the line and check the firmware and its axes; up to 5 s where this restarts the board."""
        self.close()
        self._forget_board()
        transport, info = self._connection.open()
        session = self._opened = EncoderSession(transport, self._connection.now, self._timeout_s)
        try:
            banner = session.greet(resets=self._connection.restarts_board)
            last = max((one.entry.axis for one in self._arm.axes), default=0)
            if last >= banner.axes:
                raise BoardError(
                    f"{session.name}: the board has axes 0 … {banner.axes - 1}, but the robot file uses axis "
                    f"{last}; choose the robot that belongs to this board, or change its file"
                )
            self._seen = session.fresh_status()
        except ArmctlError:
            self.close()
            raise
        self._count = banner.axes
        earlier = _earlier(banner, self._seen)
        return BoardIdentity(
            kind=f"armctl encoder board, firmware {banner.version}",
            port=session.name,
            serial_number=info.serial_number if info else None,
            simulated=self._connection.simulated,
            notes=() if self._connection.simulated else (SILENCE_NOTE,),
            earlier=tuple(f"before armctl connected, the board had reported: {one}" for one in earlier),
        )

    def configure(self, channels: Sequence[ChannelSettings]) -> None:
        """Send limits, gains and homing unless the board has them; ``StateError`` where motors are on."""
        session = self._board
        table = AxisTable(channels, self._arm, self._count)
        self._send_settings(session, table)
        self._table = table

    def use_signals(self, signals: Signals) -> None:
        """Name the spare pins that are inputs and outputs; an output that is one already stays as it is."""
        check_pins(signals)
        self._pins = SparePins(signals)
        self._send_pins(self._board)

    def set_output(self, name: str, value: float) -> None:
        """Switch a spare pin; the board answers. ``BoardTimeoutError`` where it does not."""
        session = self._board
        self._send_pins(session)
        session.command(self._pins.request(name, value))

    def _send_pins(self, session: EncoderSession) -> None:
        """Tell the board what its pins are, which it forgets when it starts anew."""
        if self._pins.sent_at == session.restarts:
            return
        for line in self._pins.configuration:
            session.command(line)
        self._pins.sent_at = session.restarts

    def write(self, setpoints: Mapping[int, float]) -> None:
        """Send setpoints [joint counts] in one line, whose answer is not waited for: ``read`` takes it.

        Motors that are off are switched on first, and hold where they stand: the first setpoints should
        be where that is. ``StateError`` where an axis is not homed, during homing, and after the board has
        switched its motors off by itself.
        """
        session = self._board
        line = self._table.setpoints_line(setpoints, _REACH_MS)
        if not setpoints:
            return
        self._check_may_move(setpoints)
        if not self._on:
            session.command("EN 1")
            self._on = True
        if self._seen is not None and self._seen.mode is Mode.HELD:
            session.realtime(Realtime.RELEASE_HOLD)
        session.post(line)

    def read(self) -> Readback:
        """What the encoders measure [joint counts], and what is wrong; None for an axis without a zero.

        A setpoint that the board refused is among the errors; one that got lost is sent again.
        """
        session = self._board
        refusals = session.settle()
        status = self._seen = session.fresh_status()
        reset = session.restarted
        if reset == UNKNOWN_RESET:  # what it said of that was lost
            reset = next((one for one, flag in RESET_FLAGS.items() if flag in status.flags), reset)
        told = RESET_FLAGS.get(reset or "", BoardFlag(0))  # by what is said of the restart
        errors = list(flag_words(status.flags & ~told))
        if reset is not None:
            why = _RESETS.get(reset, "")
            errors.insert(
                0, f"the board has started anew{why}: its motors are off and its zeros are lost; home again"
            )
        faults = {
            axis: fault_words(fault, session.homing_failures.get(axis, ""))
            for axis, fault in enumerate(status.faults)
            if fault
        }
        # A board that brakes after a silence switches its motors off in a moment.
        goes_off = not status.mode.powered or BoardFlag.WATCHDOG in status.flags
        if self._on and (goes_off or session.restarted is not None):
            self._on, self._went_off = False, True
        if self._went_off:
            refusals = ()  # they follow from it
            if not errors and not faults:
                errors.append("the board switched its motors off by itself")
        if session.idle_s >= _KEEP_ALIVE_S:
            session.post("PING")
        asked, session.asked, lost, session.lost = session.asked, 0, session.lost, 0
        delay_s, session.delay_s = session.delay_s, None
        homed = {axis: status.homed[axis] for axis in self._table.axes}
        warnings = {
            axis: lost_words(status.lost[axis]) for axis in homed if homed[axis] and status.lost[axis]
        }
        running: int | None = None
        if status.mode is Mode.HOMING and homed:
            # the last axis has its zero a moment before the board says that homing is done
            order = self._table.homing_order
            running = next((axis for axis in order if not homed[axis]), order[-1])
        return Readback(
            positions={axis: float(status.counts[axis]) if known else None for axis, known in homed.items()},
            source=Source.MEASURED,
            errors=(*errors, *(f"a setpoint was refused: {one}" for one in refusals)),
            powered=status.mode.powered and not self._went_off,
            faults=faults,
            homing=HomingState(homed, running),
            warnings=warnings,
            asked=asked,
            lost=lost,
            delay_s=delay_s,
            home_again=reset is not None or any(fault & HOMED_AGAIN for fault in status.faults),
            **self._pins.read(session.changes, known=self._pins.sent_at == session.restarts),
        )

    def stop(self) -> None:
        """Slow down within the acceleration limits and hold; also ends homing."""
        session = self._board
        if not self._insist(session, Realtime.HOLD, Mode.ON, Mode.HOMING):
            raise BoardTimeoutError(
                f"{session.name}: the board does not confirm that it holds; cut the motors' power if it moves"
            )
        self._seen = session.status

    def home(self) -> None:
        """Clear faults and home each axis in turn: the arm moves. ``StateError`` where it is homing."""
        session = self._board
        if not self._table.axes:
            raise BoardError("no axis is configured, so there is nothing to home; configure the board first")
        status = session.fresh_status()
        if not status.mode.powered:
            self._sent_settings = None  # it may have started anew unseen, and would home with other settings
        self._send_settings(session, self._table)
        if status.latched:
            session.command("CLR")
        if status.mode is Mode.HELD:
            self._insist(session, Realtime.RELEASE_HOLD, Mode.HELD)  # where that fails, HOME is refused
        session.command("HOME")
        self._acknowledge(session, on=True)

    def release(self) -> None:
        """Motors off: joints that their gears do not hold sink. Clears latched faults.

        Where the board does not answer, the emergency byte is sent too, and ``BoardTimeoutError`` raised.
        """
        session = self._board
        try:
            session.command("EN 0")
        except BoardTimeoutError as silence:
            session.realtime(Realtime.MOTORS_OFF)
            raise BoardTimeoutError(
                f"{session.name}: the board does not confirm that its motors are off; without a word from "
                f"this computer it switches them off after {WATCHDOG_MS} ms. Cut their supply before you "
                "reach in"
            ) from silence
        if session.fresh_status().latched:
            session.command("CLR")
        self._acknowledge(session, on=False)

    def close(self) -> None:
        """Close the line; never raises. The board switches its motors off when it hears nothing more.

        Its outputs do then what the robot file says for a fault; here they are told to stay as they are.
        """
        if self._opened is not None:
            with suppress(ArmctlError):  # the line may be broken
                for line in self._pins.kept if self._pins.sent_at is not None else ():
                    self._opened.command(line)
            self._opened.close()
            self._opened = None

    @property
    def _board(self) -> EncoderSession:
        if self._opened is None:
            raise BoardError("the encoder board is not connected; connect first")
        return self._opened

    def _forget_board(self) -> None:
        """Know nothing any more of the board: it may be another one, or freshly started."""
        self._count = 0
        self._table = AxisTable((), self._arm, 0)
        self._configured = False
        self._sent_settings: tuple[tuple[str, ...], int] | None = None
        """the lines that the board has, and after how many restarts; None where that is not certain"""
        self._on = False  # armctl has switched the motors on
        self._went_off = False
        """the board has switched them off by itself; until the user has taken note they stay off"""
        self._seen: Status | None = None
        self._pins = SparePins(Signals())

    def _send_settings(self, session: EncoderSession, table: AxisTable) -> None:
        """Send the settings unless the board has them: it forgets them when it starts anew."""
        session.drain()
        if self._sent_settings == (table.configuration, session.restarts):
            return
        status = session.fresh_status()
        if status.mode.powered:
            raise StateError(
                f"{session.name}: the motors are on, and with other settings; release first, or wait half a "
                "second after another program has let go of the board"
            )
        if not self._configured and status.latched:
            session.command("CLR")  # from before armctl connected; reported in the identity
        restarts, self._sent_settings, self._configured = session.restarts, None, True
        for line in (f"WD {WATCHDOG_MS}", *table.configuration):
            session.command(line)
        self._sent_settings = table.configuration, restarts

    def _insist(self, session: EncoderSession, byte: Realtime, *ended: Mode) -> bool:
        """Send a byte that the board obeys at once, until its status shows none of ``ended``; whether so."""
        session.drain()
        session.status = None  # what was said until now does not show yet what is asked for
        for _ in range(_BYTE_ATTEMPTS):
            session.realtime(byte)
            session.realtime(Realtime.STATUS)
            if session.wait_until(
                lambda: session.status is not None and session.status.mode not in ended,
                self._timeout_s / _BYTE_ATTEMPTS,
            ):
                return True
        return False

    def _check_may_move(self, setpoints: Mapping[int, float]) -> None:
        if self._went_off:
            raise StateError(
                "the board switched its motors off by itself; release (which clears its faults), see to the "
                "cause and enable again"
            )
        seen = self._seen
        if seen is not None and seen.mode is Mode.HOMING:
            raise StateError("the board is homing; wait until it is done, or stop it")
        lost = [str(axis) for axis in sorted(setpoints) if seen is None or not seen.homed[axis]]
        if lost:
            raise StateError(f"axis {', '.join(lost)}: not homed, so nobody knows where it is; home first")

    def _acknowledge(self, session: EncoderSession, *, on: bool) -> None:
        """The user has taken note; the motors are ``on`` from now on, or off."""
        session.acknowledge()
        self._on = on
        self._went_off = False
        self._send_pins(session)
        self._seen = session.fresh_status()


def _earlier(banner: Banner, status: Status) -> list[str]:
    """What the board reports of the time before armctl connected, in words."""
    flags = status.flags
    if banner.reset in ("watchdog", _UNEXPECTED):
        # The reset by the opening of the port, soon after another program, is none that anyone wonders at.
        flags &= ~BoardFlag.INTERRUPTED
    hung = ["its program hung, and its watchdog started it anew"] if banner.reset == "watchdog" else []
    return hung + replace(status, flags=flags).words()


# The check-up of a board that answers.

_CHECK_UP_TIMEOUT_S = 0.5
_ENCODER_ADVICE = (
    "check the encoders' plugs and supply; keep their wires short, twisted with ground, away from the motors"
)
_SUPPLY_ADVICE = (
    "the motors need a supply of their own, and the Arduino one that does not sag when they start"
)


def examine_encoder(check_up: CheckUp) -> list[Finding]:
    """What can be asked without moving or changing anything; ``BoardError`` where the board falls silent."""
    session = EncoderSession(check_up.line, check_up.now, _CHECK_UP_TIMEOUT_S)
    banner = decode_banner(session.command("HELLO"))
    firmware = f"{banner.firmware} {banner.version}, protocol {banner.protocol}"
    if banner.protocol != PROTOCOL:
        what = f"{firmware}; this armctl needs protocol {PROTOCOL}"
        return [failed("firmware", what, protocol_advice(banner))]
    status = session.fresh_status()
    homed, closed = (
        _listed(axis for axis, on in enumerate(flags) if on) or "none"
        for flags in (status.homed, status.switches)
    )
    wrong = "; ".join(_earlier(banner, status))
    lost = [f"axis {axis}: {lost_words(edges)}" for axis, edges in enumerate(status.lost) if edges]
    return [
        ok("firmware", firmware),
        _axes(banner, check_up.needs),
        not_checked("ranges", "armctl tells the board its soft limits when it connects"),
        ok(
            "outputs",
            f"motors {'on' if status.mode.powered else 'off'}; homed axes: {homed}; "
            f"home switches closed: {closed}; counts {_listed(status.counts)}",
        ),
        warning("error register", wrong, "Release in the page, or homing, clears it")
        if wrong
        else ok("error register", "empty"),
        warning("encoders", "; ".join(lost), _ENCODER_ADVICE)
        if lost
        else ok("encoders", "no edge was lost since homing, or since the start"),
        ok("watchdog", "the firmware switches the motors off when it hears nothing for at most 500 ms"),
        round_trips(lambda: session.command("PING"), check_up.now),
        warning("supply", "the board last started because its supply voltage had sagged", _SUPPLY_ADVICE)
        if banner.reset == "brownout"
        else not_checked(
            "supply", f"last started by: {banner.reset}; the board does not measure it", _SUPPLY_ADVICE
        ),
    ]


def _axes(banner: Banner, needs: ChannelsToCheck) -> Finding:
    if not needs.channels:
        return needs.not_known("channels")
    axes = [one.channel for one in needs.channels]
    beyond = [axis for axis in axes if axis >= banner.axes]
    if beyond:
        seen = f"axis {_listed(beyond)}: the board has axes 0 … {banner.axes - 1}"
        return failed("channels", seen, "change the robot file")
    return ok("channels", f"axes {_listed(axes)}: the board has them")


def _listed(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, numbers))
