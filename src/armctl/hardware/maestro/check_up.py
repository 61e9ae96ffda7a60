"""The check-up of a Maestro that answers."""

from __future__ import annotations

from armctl.facts.english_commands import numbered
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
from armctl.hardware.maestro import FACTORY_MAXIMUM_US, FACTORY_MINIMUM_US, MaestroModel
from armctl.hardware.maestro.codec import error_words
from armctl.hardware.maestro.driver import MaestroLine

_CHECK_UP_TIMEOUT_S = 0.25
_SURE_CHANNELS = MaestroModel.MICRO_6.channels
"""what every Maestro has; asking a board for a channel that it has not is an error: its servos go home"""


def examine_maestro(check_up: CheckUp, model: MaestroModel | None) -> list[Finding]:
    """The findings of ``BoardType.examine``; ``model`` is None where the USB listing does not tell it."""
    needs, reported = check_up.needs, "; ".join(check_up.reported)
    line = MaestroLine(check_up.line, _CHECK_UP_TIMEOUT_S)
    line.probe()
    count = _SURE_CHANNELS if model is None else model.channels
    first = min((one.channel for one in needs.channels if one.channel < count), default=0)
    return [
        ok("serial mode", "commands over this port are obeyed"),
        ok("CRC", "on; armctl sends it with every command" if line.crc else "off"),
        warning(
            "error register",
            reported,
            "read and cleared now; if it comes back while only armctl uses the board, check cable and supply",
        )
        if reported
        else ok("error register", "empty"),
        *_channels(line, model, count, needs),
        _ranges(needs),
        not_checked(
            "watchdog",
            "a Maestro does not tell whether its serial timeout is set, and trying it would send the servos "
            "home",
            'set "Timeout" to 0.5 s in the Maestro Control Center (Serial Settings), and "On startup or '
            'error" of each channel to what is safest for the arm',
        ),
        round_trips(lambda: line.read([first]), check_up.now),
        not_checked(
            "supply",
            "a Maestro does not tell its servos' voltage",
            "the servos need a supply of their own (USB feeds only the board), strong enough for all of them "
            "at once; when servos twitch or the board restarts, that supply is the first suspect",
        ),
    ]


def _channels(
    line: MaestroLine, model: MaestroModel | None, count: int, needs: ChannelsToCheck
) -> list[Finding]:
    """Whether the board has the channels, and what they do now."""
    wanted = sorted(one.channel for one in needs.channels)
    if not wanted:
        return [needs.not_known("channels")]
    beyond = [channel for channel in wanted if channel >= count]
    findings: list[Finding] = []
    if beyond and model is not None:
        seen = f"{numbered('channel', beyond)}: a {model.label} has 0 … {count - 1}"
        findings.append(failed("channels", seen, "change the robot file, or use a larger Maestro"))
    elif beyond:
        findings.append(
            not_checked(
                "channels",
                f"{numbered('channel', beyond)}: the model cannot be told from this port, and not "
                "every Maestro has them",
                "name the USB port itself, then the model is known",
            )
        )
    known = [channel for channel in wanted if channel < count]
    positions, errors = line.read(known)
    if errors:
        findings.append(failed("channels", f"{numbered('channel', known)}: {'; '.join(error_words(errors))}"))
    elif not beyond:
        findings.append(ok("channels", f"{numbered('channel', known)}: the board has them"))
    on = [f"{channel} at {pulse:g} µs" for channel, pulse in positions.items() if pulse is not None]
    findings.append(ok("outputs", f"on: {', '.join(on)}" if on else "all pulses are off"))
    return findings


def _ranges(needs: ChannelsToCheck) -> Finding:
    """The board's own ranges cannot be read over a serial port; the factory's are known."""
    wider = [
        f"channel {one.channel} {one.minimum:g} … {one.maximum:g} µs"
        for one in needs.channels
        if one.minimum < FACTORY_MINIMUM_US or one.maximum > FACTORY_MAXIMUM_US
    ]
    factory = f"{FACTORY_MINIMUM_US:g} … {FACTORY_MAXIMUM_US:g} µs"
    if not needs.channels:
        return needs.not_known("ranges")
    if not wider:
        return ok("ranges", f"the robot file stays inside the factory's {factory}")
    return not_checked(
        "ranges",
        f"the robot file wants more than the factory's {factory}: {', '.join(wider)}; the board's own "
        "ranges cannot be read over this port",
        "set Min and Max of these channels in the Maestro Control Center (Channel Settings), or the board "
        "cuts their targets off",
    )
