"""In words, who of a chain does not answer, and where to look; what is unusual of who does."""

from __future__ import annotations

from collections.abc import Sequence

from armctl.facts import say
from armctl.facts.english_commands import numbered
from armctl.hardware.bus import EEPROM_ADVICE
from armctl.hardware.bus.line import BusLine
from armctl.hardware.servo_records import KeptSettings, changes
from armctl.hardware.servos import ServoSettings


def missing_words(ids: Sequence[int], found: Sequence[int]) -> tuple[str, ...]:
    """Who of the chain ``ids``, base first, does not answer; empty where all do."""
    missing = [servo for servo in ids if servo not in found]
    if not missing:
        return ()
    words = f"{numbered('servo', missing)} of {len(ids)} did not answer"
    if missing == list(ids[len(found) :]):
        return (f"{words}: whoever is behind a loose plug is silent; look at the one of servo {missing[0]}",)
    return (f"{words}: its plug, its id or its baud rate; `armctl servos` looks for it",)


def nobody_words(line: BusLine, ids: Sequence[int], *, came: bool) -> str:
    """Why nobody answers; ``came``: whether anything came back at all."""
    if line.echoes:
        return (
            f"{line.name}: the adapter answers with what it was sent, and no servo does; are the servos "
            "powered, and is the first plug in?"
        )
    if came:
        return (
            f"{line.name}: something answers, but makes no sense: two servos with one id, another baud rate, "
            "or another kind of bus"
        )
    return (
        f"{line.name}: no servo answers ({numbered('servo', ids)} were asked). Are they powered (USB "
        "alone does not feed them), is the first plug in, and is this the adapter's port?"
    )


def settings_words(servo: int, settings: ServoSettings, kept: KeptSettings | None) -> list[str]:
    """What is unusual of the settings of a servo, and what has changed since they were kept."""
    told = [f"servo {servo}: {words}" for words in settings.findings]
    if settings.unfit is not None:
        told.append(f"servo {servo}: {settings.unfit}; {EEPROM_ADVICE}")
    return [*told, *(f"{say(change)}; {EEPROM_ADVICE}" for change in changes(servo, settings, kept))]
