"""Finding out who is at the other end of a line that has just been opened."""

from __future__ import annotations

from armctl.errors import BoardProtocolError, BoardTimeoutError
from armctl.hardware.encoder.messages import FIRMWARE, PROTOCOL, Banner, decode_banner
from armctl.hardware.encoder.session import EncoderSession
from armctl.hardware.transport import Transport

_HELLO_S = 0.5
_START_S = 2.5  # a Mega that is reset by the opening of its port says nothing for 1.7 s
_LISTENING_ROUNDS = 2
_SPEAKING_ROUNDS = 10

# Firmata's "report firmware", as a query and at the beginning of the answer.
_FIRMATA_QUERY = b"\xf0\x79\xf7"
_FIRMATA_REPORT = b"\xf0\x79"
_FLASHING = "firmware/README.md says how under Flashing"
FLASH_IT = f"flash armctl's encoder firmware ({_FLASHING})"


def greet(session: EncoderSession, transport: Transport, *, resets: bool) -> Banner:
    """Make sure that armctl's firmware answers, in the version that this armctl speaks.

    Args:
        session: a new session over ``transport``; it begins with this.
        transport: the open line.
        resets: whether opening the line starts the board anew. Then nothing is sent until the board
            speaks: its boot loader would take it for an upload.

    Raises:
        BoardTimeoutError: nobody answers.
        BoardProtocolError: somebody else answers, or in another version.
    """
    silence: BoardTimeoutError | None = None
    for _ in range(_LISTENING_ROUNDS if resets else _SPEAKING_ROUNDS):
        if resets:
            session.wait_until(lambda: session.heard.spoken, _START_S)
        try:
            hello = session.command("HELLO", _HELLO_S)
        except BoardTimeoutError as error:
            silence = error
            continue
        banner = decode_banner(hello)
        _check(banner, transport.name)
        session.heard.begin()
        return banner
    raise _who_else(session, transport) from silence


def protocol_advice(banner: Banner) -> str:
    """What to do about a board that speaks another protocol than this armctl."""
    if banner.protocol < PROTOCOL:
        return f"flash the board again, with the firmware that comes with this armctl ({_FLASHING})"
    return (
        "this armctl is older than the board's firmware: update armctl, or flash the board with the "
        f"firmware that comes with this one ({_FLASHING})"
    )


def _check(banner: Banner, name: str) -> None:
    if banner.firmware != FIRMWARE:
        raise BoardProtocolError(f"{name}: {banner.firmware} answers, not {FIRMWARE}; {FLASH_IT}")
    if banner.protocol != PROTOCOL:
        raise BoardProtocolError(
            f"{name}: the board's firmware {banner.version} speaks protocol {banner.protocol}, this armctl "
            f"needs protocol {PROTOCOL}; {protocol_advice(banner)}"
        )


def _who_else(session: EncoderSession, transport: Transport) -> BoardProtocolError | BoardTimeoutError:
    """What to say when armctl's firmware does not answer."""
    if _FIRMATA_REPORT not in session.heard.prelude:
        transport.write(_FIRMATA_QUERY)
        session.wait_until(lambda: _FIRMATA_REPORT in session.heard.prelude, _HELLO_S)
    heard = session.heard.prelude
    if _FIRMATA_REPORT in heard:
        return BoardProtocolError(
            f"{transport.name}: StandardFirmata is on this board, not armctl's encoder firmware; {FLASH_IT}"
            ", or choose the board firmata if the arm has servos"
        )
    if session.heard.spoken:
        return BoardTimeoutError(
            f"{transport.name}: an armctl encoder board sends, but does not answer; check the wire that "
            "leads to the board, and that nothing else uses the port"
        )
    if heard:
        shown = heard[:40].decode("ascii", "backslashreplace")
        return BoardProtocolError(
            f"{transport.name}: something else answers there ({shown!r}); is it the right port, at 115200 "
            f"baud? If it is: {FLASH_IT}"
        )
    return BoardTimeoutError(
        f"{transport.name}: no answer. Is this the port of the Arduino Mega, and is it powered? If it is "
        f"new: {FLASH_IT}"
    )
