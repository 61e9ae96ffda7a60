"""What differs between the servos that were found on a bus and those that an arm needs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from armctl.facts import Reason
from armctl.facts.servos import (
    ServoAtBaud,
    ServoOffset,
    ServoRange,
    ServoSilent,
    ServoStranger,
    ServoTold,
    ServoUnfit,
)
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.servo_records import KeptSettings, changes
from armctl.hardware.servos import Difference, FoundServo, Mend


def differences(
    found: Sequence[FoundServo],
    channels: Sequence[ChannelSettings],
    baud: int,
    names: Mapping[int, str],
    kept: Mapping[int, KeptSettings] | None = None,
) -> list[Difference]:
    """What is not as an arm needs it, in the order of its chain; ``names`` of its joints by servo.

    ``kept``: the settings that armctl has kept as right, by servo.
    """
    by_id: dict[int, list[FoundServo]] = {}
    for one in found:
        by_id.setdefault(one.id, []).append(one)
    wanted = [one.channel for one in channels]
    strangers = [servo for servo in by_id if servo not in wanted]
    told = _of_silent([one for one in wanted if one not in by_id], wanted, strangers, by_id, names)
    for needs in channels:
        for one in by_id.get(needs.channel, ()):
            told += _of_one(one, needs, baud, None if kept is None else kept.get(one.id))
    told += [Difference(servo, ServoStranger(servo)) for servo in strangers]
    return told


def _of_silent(
    missing: Sequence[int],
    wanted: Sequence[int],
    strangers: Sequence[int],
    by_id: Mapping[int, Sequence[FoundServo]],
    names: Mapping[int, str],
) -> list[Difference]:
    told: list[Difference] = []
    behind = len(missing) > 1 and list(missing) == list(wanted[wanted.index(missing[0]) :])
    for servo in missing:
        name = names.get(servo, "joint")
        if behind:
            told.append(Difference(servo, ServoSilent(servo, name, behind=missing[0])))
        elif strangers:
            one = by_id[strangers[0]][0]
            mend = Mend(one.id, one.baud, new_id=servo)
            told.append(Difference(servo, ServoSilent(servo, name, stranger=one.id), mend))
        else:
            told.append(Difference(servo, ServoSilent(servo, name)))
    return told


def _of_one(
    one: FoundServo, needs: ChannelSettings, baud: int, kept: KeptSettings | None
) -> list[Difference]:
    own, found = one.settings, list[tuple[Reason, Mend | None]]()
    if one.baud != baud:
        found.append((ServoAtBaud(one.id, one.baud, baud), Mend(one.id, one.baud, new_baud=baud)))
    if own.unfit is not None:
        found.append((ServoUnfit(one.id, own.unfit), _writes(one, *own.cure) if own.cure else None))
    elif needs.minimum < own.lowest or needs.maximum > own.highest:
        lowest, highest = math.floor(needs.minimum), math.ceil(needs.maximum)
        wider = (("lowest", min(own.lowest, lowest)), ("highest", max(own.highest, highest)))
        mend = _writes(one, *(pair for pair in wider if pair[1] not in (own.lowest, own.highest)))
        reason = ServoRange(one.id, own.lowest, own.highest, needs.minimum, needs.maximum)
        found.append((reason, mend))
    changed = changes(one.id, own, kept)
    found += [(change, _writes(one, (change.register, change.kept))) for change in changed]
    if own.offset and kept is None:
        found.append((ServoOffset(one.id, own.offset), None))
    found += [(ServoTold(one.id, words), None) for words in (*own.findings, *one.faults)]
    return [Difference(one.id, reason, mend) for reason, mend in found]


def _writes(one: FoundServo, *numbers: tuple[str, int]) -> Mend:
    return Mend(one.id, one.baud, numbers=numbers)
