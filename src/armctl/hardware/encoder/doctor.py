"""The check-up of an Arduino with armctl's encoder firmware that answers."""

from __future__ import annotations

from collections.abc import Iterable

from armctl.hardware.encoder.messages import PROTOCOL, Banner, decode_banner
from armctl.hardware.encoder.session import EncoderSession, protocol_advice
from armctl.hardware.findings import CheckUp, Finding, Needs, failed, not_checked, ok, round_trips, warning

_TIMEOUT_S = 0.5
_SUPPLY_ADVICE = (
    "the motors need a supply of their own, and the Arduino one that does not sag when they start"
)


def examine_encoder(check_up: CheckUp) -> list[Finding]:
    """What can be asked without moving or changing anything; ``BoardError`` where the board falls silent."""
    session = EncoderSession(check_up.line, check_up.now, _TIMEOUT_S)
    banner = decode_banner(session.command("HELLO"))
    firmware = f"{banner.firmware} {banner.version}, protocol {banner.protocol}"
    status = session.fresh_status()
    homed, closed = (
        _listed(axis for axis, on in enumerate(flags) if on) or "none"
        for flags in (status.homed, status.switches)
    )
    wrong = "; ".join(status.words())
    return [
        ok("firmware", firmware)
        if banner.protocol == PROTOCOL
        else failed(
            "firmware", f"{firmware}; this armctl needs protocol {PROTOCOL}", protocol_advice(banner)
        ),
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
        ok("watchdog", "the firmware switches the motors off when it hears nothing for at most 500 ms"),
        round_trips(lambda: session.command("PING"), check_up.now),
        warning("supply", "the board last started because its supply voltage had sagged", _SUPPLY_ADVICE)
        if banner.reset == "brownout"
        else not_checked(
            "supply", f"last started by: {banner.reset}; the board does not measure it", _SUPPLY_ADVICE
        ),
    ]


def _axes(banner: Banner, needs: Needs) -> Finding:
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
