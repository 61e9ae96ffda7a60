from __future__ import annotations

import pytest

from armctl.hardware import ChannelSettings
from armctl.hardware.channel_refusal import channel_refusal
from armctl.robot import BoardKind, load_robot
from armctl.runtime import channel_settings


@pytest.mark.parametrize("name", ["abaas", "humanoid", "mico", "scorbot", "uzuner"])
def test_what_is_shipped_is_taken(name: str) -> None:
    robot = load_robot(name)
    assert channel_refusal(robot.board, channel_settings(robot), robot.axes, robot.differential) is None


@pytest.mark.parametrize(
    ("kind", "channel", "low", "high", "says"),
    [
        ("maestro", 23, 600.0, 2400.0, None),
        ("maestro", 24, 600.0, 2400.0, "channel 24: the largest Maestro has channels 0 … 23"),
        ("maestro", 0, 2400.0, 600.0, "channel 0: 2400 … 600"),
        ("firmata", 2, 544.0, 2400.0, None),
        ("firmata", 1, 544.0, 2400.0, "pin 1 cannot drive a servo"),
        ("firmata", 2, 490.0, 2400.0, "it must lie within 544 … 2912"),
        ("encoder", 0, -10.0, 10.0, "axis 0"),  # nothing says how it is homed
    ],
)
def test_what_a_board_has_not_is_told(
    kind: BoardKind, channel: int, low: float, high: float, says: str | None
) -> None:
    told = channel_refusal(kind, [ChannelSettings(channel, low, high, 100.0, 100.0)])
    assert told is None if says is None else told is not None and says in told
