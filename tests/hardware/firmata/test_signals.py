"""Pins of StandardFirmata beside its servos: inputs, pull-ups, analog ones, outputs and PWM."""

from __future__ import annotations

import pytest
from tests.hardware.firmata.conftest import CHANNELS, FRAME_S, Session

from armctl.errors import BoardError, BoardTimeoutError
from armctl.hardware.faults import FaultyModel, trouble
from armctl.hardware.firmata.codec import AnalogReport, CapabilityReport, DigitalReport, PinMode
from armctl.hardware.firmata.signals import FirmataSignals
from armctl.hardware.firmata.simulated import SimulatedFirmata
from armctl.robot.signals import Input, Output, Signals

BUTTON, DOOR = Input("button", "Button", 23, "pull-up"), Input("door", "Door", 24)
KNOB = Input("knob", "Knob", 55, "analog")
LAMP, FAN = Output("lamp", "Lamp", 25), Output("fan", "Fan", 10, "pwm")
SIGNALS = Signals((BUTTON, DOOR, KNOB), (LAMP, FAN))


def rig(connect, board: SimulatedFirmata | FaultyModel | None = None, signals: Signals = SIGNALS) -> Session:
    session = connect(SimulatedFirmata() if board is None else board)
    session.driver.use_signals(signals)
    return session


def test_pins_are_set_up_with_the_bytes_of_the_protocol(connect) -> None:
    session = connect(SimulatedFirmata())
    before = len(session.line.bursts)
    session.driver.use_signals(SIGNALS)
    sent = " ".join(session.line.bursts[before:])
    for wanted in ("f4 17 00", "f4 18 00", "f4 0a 03", "92 00 01", "f0 7a 0a 00 f7"):
        assert wanted in sent
    assert "f4 19" not in sent  # pin 25 is an output already
    session.frame()
    assert session.line.bursts[-2] == "d2 01 d3 01 c1 01"  # ahead of the questions for the servos
    board = session.board
    assert [board.mode(pin) for pin in (23, 24, 25, 10, 55)] == [
        PinMode.INPUT, PinMode.INPUT, PinMode.OUTPUT, PinMode.PWM, PinMode.ANALOG,
    ]  # fmt: skip


def test_inputs_are_seen_in_the_next_frame(connect) -> None:
    session = rig(connect)
    assert session.frame().inputs["door"] == 0.0
    assert session.frame().inputs == {"button": 1.0, "door": 0.0, "knob": 0.0}  # the button is pulled up
    session.board.levels |= {23: 0.0, 24: 1.0, 55: 0.25}
    assert session.frame().inputs == {"button": 0.0, "door": 1.0, "knob": pytest.approx(256 / 1023)}
    session.board.levels[24] = 0.0
    assert session.frame().inputs["door"] == 0.0


def test_pins_that_are_set_up_once_more_are_known_on(connect) -> None:
    session = rig(connect)
    session.driver.set_output("lamp", 1.0)
    session.board.levels |= {24: 1.0, 55: 0.25}
    session.frame()
    before = session.frame()
    session.driver.configure(CHANNELS)
    session.driver.use_signals(SIGNALS)  # an old sketch reports only what changes
    assert session.frame().inputs == before.inputs
    assert before.inputs == {"button": 1.0, "door": 1.0, "knob": pytest.approx(256 / 1023)}
    assert before.outputs == session.frame().outputs == {"lamp": 1.0, "fan": 0.0}


def lose(session: Session) -> None:
    """Another program lets go of a servo: the driver gives the arm up, on a line that works."""
    session.switch_on(dict.fromkeys((9, 22), 1500.0))
    session.board.feed(bytes.fromhex("f4 09 01"))
    with pytest.raises(BoardError, match="no longer drives pin 9"):
        for _ in range(20):
            session.frame()


def test_an_output_is_still_switched_where_the_arm_was_given_up(connect) -> None:
    signals = Signals((BUTTON,), (LAMP, Output("bell", "Bell", 16)))
    session = rig(connect, signals=signals)
    session.driver.set_output("lamp", 1.0)
    lose(session)
    before = len(session.line.bursts)
    session.driver.set_output("bell", 1.0)
    session.driver.set_output("lamp", 0.0)
    assert [session.board.value(pin) for pin in (16, 25)] == [1, 0]
    # Not with the input, which a board that has started anew would drive.
    assert session.line.bursts[before:] == ["92 01 00 " * 2 + "92 01 00", "93 00 00 " * 2 + "93 00 00"]
    with pytest.raises(BoardError, match="no longer drives pin 9"):
        session.frame()


def test_an_output_is_not_switched_on_a_line_on_which_a_write_broke_off(connect, monkeypatch) -> None:
    session = rig(connect)
    session.frame()

    def breaks(data: bytes) -> None:
        raise BoardError("the line is gone")

    with monkeypatch.context() as broken:
        broken.setattr(session.line, "write", breaks)
        with pytest.raises(BoardError, match="the line is gone"):
            session.driver.set_output("lamp", 1.0)
    before = len(session.line.bursts)
    with pytest.raises(BoardError, match="an earlier write broke off"):
        session.driver.set_output("lamp", 0.0)
    assert len(session.line.bursts) == before


def test_an_output_that_was_not_confirmed_is_not_given_up_when_pins_are_set_up_once_more(connect) -> None:
    session = rig(connect)
    session.frame()
    session.driver.set_output("lamp", 1.0)
    session.board.feed(bytes.fromhex("93 00 00"))  # as if the write had been lost
    session.driver.configure(CHANNELS)
    session.driver.use_signals(SIGNALS)
    for _ in range(10):
        session.frame()
    assert session.board.value(25) == 1


def test_inputs_of_a_sketch_that_runs_on_are_known_when_it_is_connected_to_again(connect) -> None:
    session = rig(connect)
    session.board.levels[24] = 1.0
    session.frame()
    session.driver.open()
    session.driver.configure(CHANNELS)
    session.driver.use_signals(SIGNALS)
    told = session.frame().inputs
    assert (told["button"], told["door"]) == (1.0, 1.0)


def test_an_input_that_was_not_reported_is_not_taken_for_low() -> None:
    pin = {PinMode.INPUT: 1, PinMode.INPUT_PULLUP: 1, PinMode.OUTPUT: 1, PinMode.ANALOG: 10, PinMode.PWM: 8}
    signals = FirmataSignals(SIGNALS, CapabilityReport((pin,) * 70))
    signals.settle()  # this sketch answers: it is waited for
    assert signals.inputs == {}
    signals.take(DigitalReport(2, 0x80))
    assert signals.inputs == {"button": 1.0}
    signals.take(DigitalReport(3, 0))
    signals.take(AnalogReport(55, 0))
    assert signals.inputs == {"button": 1.0, "door": 0.0, "knob": 0.0}


def test_outputs_are_switched_and_driven(connect) -> None:
    session = rig(connect)
    session.frame()
    session.driver.set_output("lamp", 1.0)
    session.driver.set_output("fan", 0.5)
    assert "93 02 00" in " ".join(session.line.bursts[-2:])
    session.frame()
    session.frame()
    assert session.frame().outputs == {"lamp": 1.0, "fan": 0.5}
    assert (session.board.value(25), session.board.value(10)) == (1, 128)
    session.driver.set_output("lamp", 0.0)
    session.frame()
    assert session.board.value(25) == 0 and session.board.value(10) == 128


def test_a_pull_up_survives_an_output_of_its_port(connect) -> None:
    near = Signals((BUTTON,), (Output("lamp", "Lamp", 22),))
    session = connect(SimulatedFirmata(), [])
    session.driver.use_signals(near)
    session.frame()
    session.driver.set_output("lamp", 1.0)
    session.frame()
    assert session.frame().inputs == {"button": 1.0}
    assert (session.board.value(22), session.board.value(23)) == (1, 1)


def test_an_output_that_is_on_stays_on_and_is_found(connect) -> None:
    board = SimulatedFirmata()
    board.advance(0.0)
    board.feed(bytes.fromhex("93 02 00"))
    session = rig(connect, board)
    assert session.frame().outputs["lamp"] == 1.0 and board.value(25) == 1


def test_an_output_whose_write_was_lost_is_told_again(connect, clock) -> None:
    board = SimulatedFirmata()
    begin = clock.now()
    session = rig(connect, FaultyModel(board, 0, [trouble("drop-command@30+0.1")]))
    while clock.now() < begin + 30.01:
        session.frame()
    session.driver.set_output("lamp", 1.0)
    assert board.value(25) == 0
    for _ in range(40):
        session.frame()
    assert board.value(25) == 1


def test_an_output_that_never_comes_on_is_a_fault(connect) -> None:
    board = SimulatedFirmata()
    session = rig(connect, board)
    board.feed(bytes.fromhex("f4 19 00"))  # another program makes an input of it
    session.driver.set_output("lamp", 1.0)
    with pytest.raises(BoardError, match="Lamp: the board did not switch pin 25 though told 25 times"):
        for _ in range(60):
            session.frame()


def test_the_pin_that_is_pulsed_on_purpose_is_none_of_the_arms(connect) -> None:
    session = connect(SimulatedFirmata(), [])
    session.driver.use_signals(Signals((), (Output("lamp", "Lamp", 13),)))
    assert session.board.pulses(13) == ()
    assert not {25, 10} & set(session.driver._markers)


@pytest.mark.parametrize(
    ("signals", "said"),
    [
        (Signals((), (Output("fan", "Fan", 22, "pwm"),)), "Fan: pin 22 .* cannot be pwm; .*: 2 … 10, 13;"),
        (Signals((), (Output("fan", "Fan", 44, "pwm"),)), "Fan: pin 44 has no PWM while servos are on"),
        (Signals((Input("knob", "Knob", 22, "analog"),)), "Knob: pin 22 .* cannot be analog; .* 54 … 69"),
        (Signals((Input("door", "Door", 1),)), "Door: pin 1 of this board cannot be digital"),
    ],
)
def test_a_pin_that_cannot_do_it_is_refused(connect, signals: Signals, said: str) -> None:
    session = connect(SimulatedFirmata())
    with pytest.raises(BoardError, match=said):
        session.driver.use_signals(signals)


def test_pins_that_the_board_does_not_set_are_told(connect, clock) -> None:
    board = SimulatedFirmata()
    session = connect(FaultyModel(board, 0, [trouble("drop-command@30")]))
    clock.advance(30.0)
    with pytest.raises(BoardTimeoutError, match="did not tell the state of pins 23, 24"):
        session.driver.use_signals(SIGNALS)
    assert FRAME_S == 0.02
