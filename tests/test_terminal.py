"""The person at the terminal: reads what a program says, and presses Enter for OK."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from threading import Event

import pytest
from tests.runtime.kit import TEST, make_rig

from armctl.protocol import Command, ConfirmMessage, Message, Origin, Snapshot, Ticket
from armctl.system import open_pseudo_terminal
from armctl.terminal import PersonAtTerminal

ASKS, TELLS = Message("Load a part", 7, True), Message("Tray 1 is full", 8, False)


class Asking:
    """A link to an arm that shows messages, and takes an OK."""

    def __init__(self) -> None:
        self.snapshot: Snapshot = make_rig().now
        self.confirmed = Event()
        self.asked: list[Command] = []

    def show(self, message: Message) -> None:
        self.snapshot = replace(self.snapshot, message=message)

    def submit(self, command: Command, origin: Origin | None = None) -> Ticket:
        self.asked.append(command)
        self.show(replace(ASKS, waits=False))
        self.confirmed.set()
        return Ticket.ended()


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    """The person's end, and the program's."""
    opened = open_pseudo_terminal()
    assert opened is not None
    yield opened[0], opened[1]
    os.close(opened[0])
    os.close(opened[1])


def test_enter_is_ok_but_not_one_that_came_before(
    terminal: tuple[int, int], capsys: pytest.CaptureFixture[str]
) -> None:
    hands, keys = terminal
    link = Asking()
    os.write(hands, b"\n")
    person = PersonAtTerminal(link, TEST, keys)  # type: ignore[arg-type]
    person.tell(ASKS)
    link.show(ASKS)
    assert "message: Load a part [press Enter]" in capsys.readouterr().err
    assert not person.look()
    os.write(hands, b"\n")
    assert person.look()
    assert link.asked == [ConfirmMessage(7)]


def test_in_a_with_block_it_looks_by_itself(
    terminal: tuple[int, int], capsys: pytest.CaptureFixture[str]
) -> None:
    hands, keys = terminal
    link = Asking()
    with PersonAtTerminal(link, TEST, keys):  # type: ignore[arg-type]
        link.show(ASKS)
        while not link.confirmed.wait(0.01):
            os.write(hands, b"\n")
        link.show(TELLS)
    told = capsys.readouterr().err
    assert told.count("Load a part") == 1 and told.endswith("message: Tray 1 is full\n")


def test_where_nobody_can_press_enter_that_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    link = Asking()
    with PersonAtTerminal(link, TEST):  # type: ignore[arg-type]
        link.show(ASKS)
    assert "Load a part [nobody can press Enter here" in capsys.readouterr().err
    assert link.asked == []
