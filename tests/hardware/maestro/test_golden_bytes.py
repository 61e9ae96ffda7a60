"""Whole sessions, every byte of both directions written down: driver and simulated board held to the same.

From Pololu's guide 0J40: the commands of section 5.e, compact and in the Pololu form for device 12, alone and
with the CRC-7 of section 5.d. The CRCs were worked out by the guide's long division. Two spaces part the
commands of one write.
"""

from __future__ import annotations

import pytest
from tests.hardware.maestro.conftest import ScriptedTransport

from armctl.hardware import ChannelSettings, Source
from armctl.hardware.maestro import MaestroModel
from armctl.hardware.maestro.codec import MaestroErrors
from armctl.hardware.maestro.driver import MaestroDriver
from armctl.hardware.maestro.simulated import MaestroSettings, SimulatedMaestro
from armctl.hardware.transport import Connection

Session = tuple[tuple[str, str], ...]

MICRO_COMPACT: Session = (
    ("a1", "00 00"),  # Get Errors
    ("90 00  a1", "00 00 00 00"),  # Get Position of channel 0: off
    ("87 01 0c 01  89 01 04 00  87 02 00 00  89 02 00 00  a1", "00 00"),  # Set Speed, Set Acceleration
    ("84 01 20 1f  84 02 70 2e", ""),  # Set Target: 1000 and 1500 µs
    ("90 01  90 02  a1", "a0 0f 70 17 00 00"),  # read
    ("90 01  90 02  a1", "a0 0f 70 17 00 00"),  # stop: where is it?
    ("84 01 20 1f  84 02 70 2e", ""),  # stay there
    ("84 01 00 00  84 02 00 00", ""),  # release
)
MICRO_COMPACT_CRC: Session = (
    ("a1", ""),  # incomplete to this board
    ("1b", "00 00"),  # and complete
    ("90 00 65  a1 1b", "00 00 00 00"),
    ("87 01 0c 01 3f  89 01 04 00 7c  87 02 00 00 75  89 02 00 00 39  a1 1b", "00 00"),
    ("84 01 20 1f 19  84 02 70 2e 18", ""),
    ("90 01 24  90 02 76  a1 1b", "a0 0f 70 17 00 00"),
    ("90 01 24  90 02 76  a1 1b", "a0 0f 70 17 00 00"),
    ("84 01 20 1f 19  84 02 70 2e 18", ""),
    ("84 01 00 00 32  84 02 00 00 50", ""),
)
MICRO_POLOLU_CRC: Session = (
    ("aa 0c 21", ""),
    ("78", "00 00"),
    ("aa 0c 10 00 01  aa 0c 21 78", "00 00 00 00"),
    (
        "aa 0c 07 01 0c 01 36  aa 0c 09 01 04 00 75  aa 0c 07 02 00 00 7c  aa 0c 09 02 00 00 30  aa 0c 21 78",
        "00 00",
    ),
    ("aa 0c 04 01 20 1f 10  aa 0c 04 02 70 2e 11", ""),
    ("aa 0c 10 01 40  aa 0c 10 02 12  aa 0c 21 78", "a0 0f 70 17 00 00"),
    ("aa 0c 10 01 40  aa 0c 10 02 12  aa 0c 21 78", "a0 0f 70 17 00 00"),
    ("aa 0c 04 01 20 1f 10  aa 0c 04 02 70 2e 11", ""),
    ("aa 0c 04 01 00 00 3b  aa 0c 04 02 00 00 59", ""),
)
MINI_COMPACT: Session = (
    ("a1", "00 00"),
    ("90 00  a1", "00 00 00 00"),
    ("87 0a 00 00  89 0a 00 00  87 0b 00 00  89 0b 00 00  a1", "00 00"),
    ("9f 02 0a 20 1f 70 2e", ""),  # Set Multiple Targets: channels 10 and 11
    ("90 0a  90 0b  a1", "a0 0f 70 17 00 00"),
    ("9f 02 0a 00 00 00 00", ""),
)
MINI_COMPACT_CRC: Session = (
    ("a1", ""),
    ("1b", "00 00"),
    ("90 00 65  a1 1b", "00 00 00 00"),
    ("87 0a 00 00 28  89 0a 00 00 64  87 0b 00 00 79  89 0b 00 00 35  a1 1b", "00 00"),
    ("9f 02 0a 20 1f 70 2e 27", ""),
    ("90 0a 3a  90 0b 7b  a1 1b", "a0 0f 70 17 00 00"),
    ("9f 02 0a 00 00 00 00 05", ""),
)


@pytest.mark.parametrize("session", [MICRO_COMPACT, MICRO_COMPACT_CRC])
def test_the_driver_on_a_micro(session):
    transport = ScriptedTransport(*session)
    driver = MaestroDriver(Connection(lambda: transport, lambda: 0.0), model=MaestroModel.MICRO_6)
    driver.open()
    driver.configure(
        [
            ChannelSettings(2, 992.0, 2000.0),
            ChannelSettings(1, 992.0, 2000.0, speed=3500.0, acceleration=1250.0),
        ]
    )
    driver.write({2: 1500.0, 1: 1000.0})
    readback = driver.read()
    assert readback.positions == {1: 1000.0, 2: 1500.0}
    assert readback.source is Source.TRANSMITTED
    assert readback.errors == ()
    driver.stop()
    driver.release()
    driver.close()
    transport.assert_done()
    assert transport.closed == 1


@pytest.mark.parametrize("session", [MINI_COMPACT, MINI_COMPACT_CRC])
def test_the_driver_on_a_mini(session):
    transport = ScriptedTransport(*session)
    driver = MaestroDriver(Connection(lambda: transport, lambda: 0.0), model=MaestroModel.MINI_12)
    driver.open()
    driver.configure([ChannelSettings(10, 992.0, 2000.0), ChannelSettings(11, 992.0, 2000.0)])
    driver.write({10: 1000.0, 11: 1500.0})
    assert driver.read().positions == {10: 1000.0, 11: 1500.0}
    driver.release()
    transport.assert_done()


@pytest.mark.parametrize(
    ("model", "crc", "session"),
    [
        pytest.param(MaestroModel.MICRO_6, False, MICRO_COMPACT, id="Micro, compact"),
        pytest.param(MaestroModel.MICRO_6, True, MICRO_COMPACT_CRC, id="Micro, compact with CRC"),
        pytest.param(MaestroModel.MICRO_6, True, MICRO_POLOLU_CRC, id="Micro, Pololu with CRC"),
        pytest.param(MaestroModel.MINI_12, False, MINI_COMPACT, id="Mini, compact"),
        pytest.param(MaestroModel.MINI_12, True, MINI_COMPACT_CRC, id="Mini, compact with CRC"),
    ],
)
def test_the_simulated_board_answers_the_same_bytes(model: MaestroModel, crc: bool, session: Session):
    """Each answer must be the one written down, and nothing may be an error."""
    board = SimulatedMaestro(model, MaestroSettings(crc=crc))
    board.advance(0.0)
    for request, reply in session:
        assert board.feed(bytes.fromhex(request)).hex(" ") == reply
        assert board.errors == MaestroErrors(0)
    taken = [entry.raw.hex(" ") for entry in board.log]
    halves = " ".join(" ".join(request.split()) for request, _ in session)
    assert " ".join(taken) == halves


# What no session of the driver sends: each answer of the board, and its registers, to bytes from the guide.
OTHER_COMMANDS = [
    ("93", "93 13", "aa 0c 13", "aa 0c 13 70", "00"),  # Get Moving State
    ("a2", "a2 49", "aa 0c 22", "aa 0c 22 2a", ""),  # Go Home
    ("ae", "ae 23", "aa 0c 2e", "aa 0c 2e 40", "01"),  # Get Script Status: it stands
    ("a4", "a4 7c", "aa 0c 24", "aa 0c 24 1f", ""),  # Stop Script
]


@pytest.mark.parametrize(("compact", "compact_crc", "pololu", "pololu_crc", "reply"), OTHER_COMMANDS)
def test_other_commands_in_every_form(compact, compact_crc, pololu, pololu_crc, reply):
    for crc, requests in ((False, (compact, pololu)), (True, (compact_crc, pololu_crc))):
        board = SimulatedMaestro(settings=MaestroSettings(crc=crc))
        for request in requests:
            assert board.feed(bytes.fromhex(request)).hex(" ") == reply
        assert board.errors == MaestroErrors(0)


def test_scripts_and_a_minis_pwm_switch_no_servo_off():
    """Guide, section 5.e: status 00 is running, 01 is stopped."""
    board = SimulatedMaestro(MaestroModel.MINI_12)
    board.feed(bytes.fromhex("84 02 70 2e 8a 40 3e 00 7d"))
    assert board.pwm == (8000, 16000)
    for start in ("a7 00", "a8 01 7f 01", "aa 0c 27 00", "aa 0c 28 01 7f 01"):
        assert board.feed(bytes.fromhex(f"ae {start} ae a4 ae")).hex(" ") == "01 00 01"
    assert (board.target_us(2), board.errors) == (1500.0, MaestroErrors(0))
    micro = SimulatedMaestro()
    micro.feed(bytes.fromhex("8a 40 3e 00 7d"))
    assert micro.errors == MaestroErrors.SERIAL_PROTOCOL


@pytest.mark.parametrize(
    ("wrong", "register"),
    [
        ("83 01 17", "10 00"),  # the guide's CRC example: right, but no command of a Maestro
        ("84 02 70 2e a1", "10 00"),  # no CRC at all, before another command
        ("aa 0c 04 02 70 2e 18", "08 00"),  # the CRC of the compact form
    ],
)
def test_what_a_micro_with_crc_refuses(wrong: str, register: str):
    board = SimulatedMaestro(settings=MaestroSettings(crc=True))
    board.feed(bytes.fromhex("84 02 70 2e 18"))
    assert board.target_us(2) == 1500.0
    board.feed(bytes.fromhex(wrong).removesuffix(b"\xa1"))
    assert board.feed(bytes.fromhex("a1 1b")).hex(" ") == register
    assert board.target_us(2) is None  # off, as its home is
