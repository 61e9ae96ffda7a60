"""In words, who of a chain of servos does not answer, and where to look; what is unusual of one that does."""

from __future__ import annotations

from collections.abc import Sequence

from armctl.facts import say
from armctl.hardware.bus import EEPROM_ADVICE
from armctl.hardware.bus.line import BusLine


def settings_words(servo: int, settings: ServoSettings, kept: KeptSettings | None) -> list[str]:
    """What is unusual of the settings of a servo, and what has changed since they were kept."""
    told = [f"servo {servo}: {words}" for words in settings.findings]
    if settings.unfit is not None:
        told.append(f"servo {servo}: {settings.unfit}; {EEPROM_ADVICE}")
    return [*told, *(f"{say(change)}; {EEPROM_ADVICE}" for change in changes(servo, settings, kept))]
