"""Channels of a Maestro that are inputs and outputs: the bytes of Pololu's guide 0J40, section 5.e."""

from __future__ import annotations

import pytest
from tests.hardware.maestro.conftest import ScriptedTransport

from armctl.errors import BoardError
from armctl.hardware import ChannelSettings
from armctl.hardware.maestro import MaestroModel
from armctl.hardware.maestro.driver import MaestroDriver
from armctl.hardware.maestro.simulated import ChannelConfig, ChannelMode, MaestroSettings, SimulatedMaestro
from armctl.hardware.transport import Connection
from armctl.robot.signals import Input, Output, Signals

BUTTON, KNOB = Input("button", "Button", 12), Input("knob", "Knob", 3, "analog")
LAMP = Output("lamp", "Lamp", 7)
SIGNALS = Signals((BUTTON, KNOB), (LAMP,))


def test_the_bytes_of_a_session() -> None:
    line = ScriptedTransport(
        ("a1", "00 00"),
        ("90 00  a1", "00 00 00 00"),
        ("87 01 00 00  89 01 00 00  a1", "00 00"),
        # servo at 1500 µs, button high, knob at 512 of 1023, lamp low
        ("90 01  90 0c  90 03  90 07  a1", "70 17  ff 03  00 02  00 00  00 00"),
        ("84 07 70 2e", ""),  # Set Target 6000: high
        ("90 01  90 0c  90 03  90 07  a1", "70 17  00 00  00 00  70 17  00 00"),
        ("84 07 00 00", ""),  # Set Target 0: low
        ("84 01 00 00", ""),  # release: the servo only
    )
    driver = MaestroDriver(Connection(lambda: line, lambda: 0.0), model=MaestroModel.MINI_18)
    driver.open()
    driver.configure([ChannelSettings(1, 1000.0, 2000.0)])
    driver.use_signals(SIGNALS)
    back = driver.read()
    assert back.inputs == {"button": 1.0, "knob": pytest.approx(512 / 1023)}
    assert back.outputs == {"lamp": 0.0} and back.positions == {1: 1500.0}
    driver.set_output("lamp", 1.0)
    back = driver.read()
    assert back.inputs == {"button": 0.0, "knob": 0.0} and back.outputs == {"lamp": 1.0}
    driver.set_output("lamp", 0.0)
    driver.release()
    line.assert_done()


def talked(*exchanges: tuple[str, str]) -> tuple[MaestroDriver, ScriptedTransport]:
    """A driver with one lamp, connected; then the board answers these."""
    line = ScriptedTransport(("a1", "00 00"), ("90 00  a1", "00 00 00 00"), *exchanges)
    driver = MaestroDriver(Connection(lambda: line, lambda: 0.0), model=MaestroModel.MINI_18)
    driver.open()
    driver.use_signals(Signals((), (LAMP,)))
    return driver, line


def test_an_output_that_does_not_read_what_it_was_told_is_told_again() -> None:
    off, on = ("90 07  a1", "00 00  00 00"), ("90 07  a1", "70 17  00 00")
    driver, line = talked(
        ("84 07 70 2e", ""),
        off,  # the write was lost
        ("84 07 70 2e", ""),
        on,
        off,  # what something else switches later is left alone
    )
    driver.set_output("lamp", 1.0)
    assert [driver.read().outputs["lamp"] for _ in range(3)] == [0.0, 1.0, 0.0]
    line.assert_done()


def test_an_output_that_never_comes_on_is_a_fault() -> None:
    off = ("90 07  a1", "00 00  00 00")
    driver, line = talked(*[("84 07 70 2e", ""), off] * 25)
    driver.set_output("lamp", 1.0)
    with pytest.raises(BoardError, match="Lamp: the board did not switch channel 7 though told 25 times"):
        for _ in range(25):
            driver.read()
    line.assert_done()


def test_the_simulated_board_answers_as_the_guide_says() -> None:
    channels = {
        12: ChannelConfig(mode=ChannelMode.INPUT),
        3: ChannelConfig(mode=ChannelMode.INPUT),
        7: ChannelConfig(mode=ChannelMode.OUTPUT),
    }
    board = SimulatedMaestro(MaestroModel.MINI_18, MaestroSettings(channels=channels))
    board.advance(0.0)
    assert board.feed(bytes.fromhex("90 0c 90 03 90 07")).hex(" ") == "00 00 00 00 00 00"
    board.levels = {12: 0.7, 3: 0.5}
    board.feed(bytes.fromhex("84 07 70 2e  84 0c 70 2e"))  # a target of an input does nothing
    assert board.feed(bytes.fromhex("90 0c 90 03 90 07")).hex(" ") == "ff 03 00 02 70 17"


def test_a_channel_that_is_set_for_a_servo_is_told(connect) -> None:
    board = SimulatedMaestro(MaestroModel.MINI_18)
    driver = connect(board, [])
    driver.use_signals(Signals((BUTTON,)))
    board.feed(bytes.fromhex("84 0c 70 2e"))
    assert driver.read().warnings[12].startswith("it reads 6000, and an input 1023 at most: set the mode")


def test_channels_that_the_board_has_not_are_refused(connect) -> None:
    driver = connect(SimulatedMaestro(MaestroModel.MICRO_6), model=MaestroModel.MICRO_6)
    with pytest.raises(BoardError, match="Lamp is on channel 7: the board has channels 0 … 5"):
        driver.use_signals(Signals((), (LAMP,)))
    driver = connect(SimulatedMaestro(MaestroModel.MINI_24), model=MaestroModel.MINI_24)
    with pytest.raises(BoardError, match=r"Tank is on channel 12: .* voltages on channels 0 … 11 only"):
        driver.use_signals(Signals((Input("tank", "Tank", 12, "analog"),)))
    with pytest.raises(BoardError, match="told of no output 'siren'"):
        driver.set_output("siren", 1.0)


def test_outputs_outlive_the_host_unless_the_board_has_a_timeout() -> None:
    for timeout_units, position in ((0, 6000), (50, 0)):  # 0.5 s, and "On startup or error" is Off
        channels = {7: ChannelConfig(mode=ChannelMode.OUTPUT)}
        settings = MaestroSettings(timeout_units=timeout_units, channels=channels)
        board = SimulatedMaestro(MaestroModel.MINI_18, settings)
        board.advance(0.0)
        board.feed(bytes.fromhex("84 07 70 2e"))
        board.advance(60.0)
        assert board.channel(7).position == position
