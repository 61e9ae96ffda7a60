from __future__ import annotations

import math
from dataclasses import replace

import pytest
from tests.hardware.encoder.kit import AXES, CHANNELS, encoder_axis

from armctl.errors import BoardError
from armctl.hardware import ChannelSettings
from armctl.hardware.boards import channel_settings
from armctl.hardware.encoder.axes import AxisTable, EncoderSettings
from armctl.hardware.encoder.messages import request
from armctl.robot import load_robot


def table(channels=CHANNELS, axes=AXES, differential=None) -> AxisTable:
    return AxisTable(channels, EncoderSettings(tuple(axes), differential), 6)


def test_the_lines_of_a_configuration():
    assert table(differential=(3, 4)).configuration == (
        "PAIR 3 4",
        "CFG 0 min=-1000 max=1000 vmax=2000 amax=20000",
        "CFG 0 kp=653 ki=653 kd=0 brk=51 dmax=255 ferr=600 stall=300",
        "CFG 0 hdir=1 hv=400 hpos=0 hord=2 hmode=0 inv=0 minv=0 sinv=0",
        "CFG 1 min=-1000 max=900 vmax=1000 amax=10000",
        "CFG 1 kp=653 ki=653 kd=0 brk=51 dmax=255 ferr=600 stall=300",
        "CFG 1 hdir=-1 hv=400 hpos=0 hord=3 hmode=0 inv=0 minv=0 sinv=0",
        "CFG 2 min=-500 max=500 vmax=1000 amax=10000",
        "CFG 2 kp=653 ki=653 kd=0 brk=51 dmax=255 ferr=600 stall=300",
        "CFG 2 hdir=1 hv=400 hpos=0 hord=1 hmode=0 inv=0 minv=0 sinv=0",
        "CFG 3 hord=0",
        "CFG 4 hord=0",
        "CFG 5 hord=0",
    )
    assert table().configuration[0] == "PAIR NONE"
    assert table().homing_order == (2, 0, 1)


def test_a_motor_gets_no_more_drive_than_it_may_have():
    lines = table(CHANNELS[:1], [encoder_axis(0, max_drive_percent=50.0)]).configuration
    assert "dmax=127" in lines[2]  # half of 255, rounded down


def test_a_gripper_is_homed_at_its_stop_which_is_outside_its_range():
    axis = encoder_axis(5, home_order=9, home_toward=-1, home_by="stall", switch_inverted=True)
    lines = table([ChannelSettings(5, 50.0, 1650.0, 2400.0, 24000.0)], [axis]).configuration
    assert lines[-3] == "CFG 5 min=0 max=1650 vmax=2400 amax=24000"
    assert lines[-1] == "CFG 5 hdir=-1 hv=400 hpos=0 hord=1 hmode=1 inv=0 minv=0 sinv=1"


def test_the_scorbot_fits_the_board():
    robot = load_robot("scorbot")
    lines = AxisTable(channel_settings(robot), robot.board_settings, 6).configuration
    assert all(len(request(65535, line)) <= 97 for line in lines)


def test_setpoints():
    assert table().setpoints_line({0: 100.4, 2: -500.0}, 30) == "P 100 - -500 - - - 30"
    # Rounding must not lead out of the range.
    assert table().setpoints_line({1: -1000.5}, 30) == "P - -1000 - - - - 30"
    assert table().setpoints_line({1: 900.5}, 30) == "P - 900 - - - - 30"


@pytest.mark.parametrize(
    ("channels", "axes", "words"),
    [
        ([replace(CHANNELS[0], channel=6)], AXES, "axis 6: the board has axes 0 … 5"),
        ([replace(CHANNELS[0], channel=-1)], AXES, "axis -1: the board has axes 0 … 5"),
        ([CHANNELS[0], CHANNELS[0]], AXES, "axis 0 is configured twice"),
        ([CHANNELS[0]], AXES[1:], "axis 0 has no encoder settings"),
    ],
)
def test_axes_that_the_board_cannot_have(channels, axes, words):
    with pytest.raises(BoardError, match=words):
        table(channels, axes)


@pytest.mark.parametrize(
    ("limits", "axis", "words"),
    [
        ({"speed": None}, {}, "an encoder board needs a speed"),
        ({"acceleration": None}, {}, "an encoder board needs a speed and an acceleration"),
        ({"speed": 6001.0}, {}, "speed 6001 is outside 1 … 6000, which is what an encoder board"),
        ({"acceleration": 0.0}, {}, "acceleration 0 is outside 1 … 65535"),
        ({"minimum": math.nan}, {}, "minimum nan"),
        ({"maximum": 2e6}, {}, r"maximum 2e\+06"),
        ({"minimum": 5.0, "maximum": 5.0}, {}, "5 … 5 counts is no range"),
        ({}, {"home_speed": 0.5}, "homing speed 0.5 is outside 1 … 6000"),
        ({}, {"following_error": 4e4}, "following error 40000 is outside"),
        ({}, {"stall_s": 0.01}, "stall time 0.01 is outside 0.02 … 5"),
        ({}, {"breakaway_percent": 110.0}, "breakaway 1.1 is outside 0 … 1"),
        ({}, {"max_drive_percent": 110.0}, "largest drive 1.1 is outside 0.0039"),
        ({}, {"max_drive_percent": 0.3}, "largest drive 0.003 is outside"),
        ({}, {"p_percent": 100.0}, "gain p 1 is outside 0 … 0.5"),
        ({}, {"i_percent_s": -10.0}, "gain i -0.1 is outside"),
        ({}, {"d_percent": math.inf}, "gain d inf is outside"),
    ],
)
def test_settings_that_the_board_cannot_have(limits, axis, words):
    with pytest.raises(BoardError, match=f"axis 0.*{words}"):
        table([replace(CHANNELS[0], **limits)], [encoder_axis(0, **axis)])
