"""A program tells the person something, and waits for OK: at most so long, and then as its step says."""

from __future__ import annotations

import pytest
from tests.program.kit import program
from tests.runtime.kit import TICK, Rig, make_rig

from armctl.errors import ProgramError, StateError
from armctl.facts import State
from armctl.program import MessageStep, WaitStep
from armctl.protocol import ConfirmMessage, Pause, Release, Resume, RunProgram, Ticket

ASK = MessageStep(text="Load a part", timeout_s=2.0)


def running(*steps: MessageStep | WaitStep) -> tuple[Rig, Ticket]:
    rig = make_rig().enable()
    return rig, rig.do(RunProgram(program(*steps)))


def test_it_stands_until_somebody_says_ok() -> None:
    rig, ticket = running(MessageStep(text="Load a part"), WaitStep(seconds=0.1))
    rig.run(100.0)
    message = rig.now.message
    assert message is not None and (message.text, message.waits) == ("Load a part", True)
    assert rig.now.state is State.MOVING and "message: Load a part" in rig.texts
    assert rig.now.warnings == ()  # the page shows the message itself
    rig.refuses(ConfirmMessage(message.number + 1), "no message waits for this OK")
    rig.do(ConfirmMessage(message.number)).result(0)
    rig.rests()
    ticket.result(0)
    assert rig.now.message is not None and not rig.now.message.waits
    assert "OK to the message (test)" in rig.texts
    rig.refuses(ConfirmMessage(message.number), "no message waits for this OK")


@pytest.mark.parametrize("otherwise", ["stop", "go on"])
def test_where_nobody_says_ok_the_step_decides(otherwise: str) -> None:
    ask = MessageStep(text="Load a part", timeout_s=2.0, otherwise=otherwise)  # type: ignore[arg-type]
    rig, ticket = running(ask, WaitStep(seconds=0.1))
    begun = rig.clock.now()
    rig.rests()
    waited = "waited 2 s for OK to the message 'Load a part', which did not come"
    if otherwise == "stop":
        assert rig.clock.now() - begun == pytest.approx(2.0, abs=4 * TICK)
        with pytest.raises(ProgramError, match=f"pick: step 1: {waited}"):
            ticket.result(0)
    else:
        assert rig.clock.now() - begun == pytest.approx(2.1, abs=5 * TICK)
        ticket.result(0)
        assert any(waited in text for text in rig.texts)
    assert rig.now.message is not None and not rig.now.message.waits


def test_an_ok_counts_for_one_message_only() -> None:
    rig, ticket = running(ASK, ASK)
    first = rig.run(0.2).message
    assert first is not None
    rig.do(ConfirmMessage(first.number)).result(0)
    second = rig.run(0.2).message
    assert second is not None and second.number == first.number + 1 and second.waits
    rig.refuses(ConfirmMessage(first.number), "no message waits")
    assert not ticket.finished.done()
    rig.do(ConfirmMessage(second.number))
    rig.rests()
    ticket.result(0)


def test_the_time_stands_while_the_program_is_paused() -> None:
    rig, ticket = running(ASK)
    rig.run(1.0)
    rig.do(Pause())
    message = rig.run(60.0).message
    assert message is not None and message.waits
    rig.do(Resume())
    rig.do(ConfirmMessage(message.number)).result(0)
    rig.rests()
    ticket.result(0)


@pytest.mark.parametrize("end", ["stop", "release"])
def test_a_program_that_is_ended_asks_nothing_any_more(end: str) -> None:
    rig, ticket = running(ASK)
    message = rig.run(0.2).message
    assert message is not None and message.waits
    if end == "stop":
        rig.stops()
    else:
        rig.do(Release())
        rig.tick()
    assert rig.now.message is not None and not rig.now.message.waits
    assert isinstance(ticket.finished.exception(0), StateError)
    rig.refuses(ConfirmMessage(message.number), "no message waits")


def test_what_is_only_told_takes_a_tick() -> None:
    rig, ticket = running(MessageStep(text="Tray 1 is full", goes_on="at once"))
    rig.rests(1.0)
    ticket.result(0)
    message = rig.now.message
    assert message is not None and (message.text, message.waits) == ("Tray 1 is full", False)
    assert "message: Tray 1 is full" in rig.texts
