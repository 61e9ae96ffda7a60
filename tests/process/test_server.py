"""What the arm process does for its clients, and against them."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.process.kit import HOME, ROBOT, SECRET, Address, Client, WebSocketLine, served, websocket
from websockets.exceptions import ConnectionClosed
from websockets.frames import Opcode

from armctl.errors import ArmctlError, InputError, StateError
from armctl.process.link import Link, LocalLine
from armctl.process.records import (
    Answer,
    Ask,
    Beat,
    Codec,
    End,
    Hello,
    Logged,
    Recall,
    Recalled,
    Record,
    Refused,
    Running,
    Seen,
    Stop,
    Trust,
    Welcome,
)
from armctl.program import MoveStep, Program, WaitStep
from armctl.runtime import (
    Arrive,
    LockControl,
    MoveJoints,
    MoveTo,
    Release,
    RunProgram,
    SetSpeed,
    State,
    TakeControl,
)
from armctl.kinematics import Target

AWAY = HOME + np.radians([60, 0, 0, 0, 0])
SLOWLY = MoveJoints(AWAY, 20.0)
BACK = MoveJoints(HOME)


@pytest.fixture(scope="module")
def arm_at(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Address]:
    """An arm for all of these tests; each leaves it standing."""
    with served(tmp_path_factory.mktemp("arm")) as address:
        yield address


@pytest.fixture
def operator(arm_at: Address) -> Iterator[Client]:
    """A client that operates the arm, which stands at home."""
    with Client.remote(arm_at, "operator") as client:
        client.does(TakeControl())
        if client.snapshot.state is State.HOLDING:
            client.does(BACK)
        else:
            client.enables()
        yield client
        client.outcome(client.stop())


def refusal(line: Any, codec: Codec) -> str:
    """What is said last on a line, before it is closed."""
    said = ""
    with pytest.raises((OSError, ConnectionClosed)):
        while True:
            record = codec.from_arm(line.receive())
            if isinstance(record, Refused):
                said = record.error
    return said


@pytest.mark.parametrize("json", [False, True], ids=["msgpack", "json"])
def test_a_client_moves_the_arm_and_sees_it_before_it_is_answered(operator: Client, json: bool) -> None:
    with Client.remote(operator.line_address, "mine", json=json) as client:
        client.does(TakeControl())
        client.seen.clear()
        client.does(MoveJoints(client.turned(3)))
        *_, last = [one for one in client.seen if isinstance(one, Seen)]
        assert isinstance(client.seen[-1], Answer)
        np.testing.assert_allclose(last.snapshot.q_command, client.turned(3))
        answers = [one for one in client.seen if isinstance(one, Answer)]
        assert [(one.accepted, one.finished) for one in answers] == [(True, False), (False, True)]
        client.say_raw(
            {
                "type": "ask",
                "id": 90,
                "command": {"command": "move-to", "target": {"point": [0.2, 0.01, 0.1], "roll": None}},
            }
        )
        assert client.outcome(90) is None
        client.outcome(client.stop())
        np.testing.assert_allclose(ROBOT.forward(client.snapshot.q_command)[:3, 3], [0.2, 0.01, 0.1])
        client.does(MoveTo(Target.of([0.2, 0.0, 0.1])))
        with pytest.raises(StateError, match="mine operates the arm; take control first"):
            operator.does(BACK)
        assert operator.outcome(operator.stop()) is None  # STOP is everybody's
        operator.does(TakeControl())
        with pytest.raises(InputError, match="a target has no 'pich'; it is made of point, pitch"):
            raise client.outcome(client.asks_raw("move-to", target={"point": [0, 0, 0], "pich": 1})) or OSError
        with pytest.raises(InputError, match=r"must be numbers, got \['1', '2'\] - at `\$\.q`"):
            raise client.outcome(client.asks_raw("move-joints", q=["1", "2"])) or OSError
        with pytest.raises(InputError, match="unknown field `speed`"):
            raise client.outcome(client.asks_raw("move-joints", q=[0] * 5, speed=1)) or OSError


def test_log_and_program_are_carried_once(operator: Client) -> None:
    operator.seen.clear()
    steps = (MoveStep(joints_deg=tuple(np.degrees(operator.turned(2)))), WaitStep(seconds=0.1))
    operator.does(RunProgram(Program(robot="uzuner", name="two", steps=steps), 2))
    programs = [one for one in operator.seen if isinstance(one, Running)]
    assert [one.running.name for one in programs] == ["two"]
    told = [one for record in operator.seen if isinstance(record, Logged) for one in record.events]
    assert len(told) == len(set(told)) > 1
    seen = [one.snapshot for one in operator.seen if isinstance(one, Seen)]
    assert len(seen) > 5
    assert not any(one.events or (one.program and one.program.running.steps) for one in seen)
    with Client.remote(operator.line_address, watch=True) as late:
        early = [one for record in late.seen if isinstance(record, Logged) for one in record.events]
        assert set(told) <= set(early)


def test_who_watches_stops_the_arm_and_nothing_else(operator: Client) -> None:
    with Client.remote(operator.line_address, "guest", watch=True) as guest:
        party = guest.until(lambda now: now.control.party(guest.id) is not None).control.party(guest.id)
        assert party is not None
        assert (party.name, party.operates) == ("guest", False)
        moving = operator.ask(SLOWLY)
        guest.until(lambda now: now.state is State.MOVING)
        with pytest.raises(StateError, match="operator operates the arm"):
            guest.does(SetSpeed(0.5))
        assert guest.outcome(guest.stop()) is None
        assert guest.snapshot.state is State.HOLDING
        assert "stopped by guest" in str(operator.outcome(moving))
        operator.does(LockControl(True))
        with pytest.raises(StateError, match="operator has locked control"):
            guest.does(TakeControl())
        operator.does(LockControl(False))
        guest.does(TakeControl())
        now = operator.until(lambda now: now.control.operates(guest.id))
        assert not now.control.operates(operator.id)
        operator.does(TakeControl())
        guest.does(Arrive("visitor\n\x1b[31m" + "x" * 200))
        guest.until(lambda now: any(one.name.startswith("visitor") for one in now.control.parties))
    operator.until(lambda now: len(now.control.parties) == 1)


def test_the_teachers_pin_opens_every_lock(tmp_path: Path) -> None:
    with (
        served(tmp_path, pin="4711") as address,
        Client.remote(address, "pupil") as pupil,
        Client.remote(address, "teacher", json=True, watch=True) as teacher,
    ):
        pupil.does(LockControl(True))
        with pytest.raises(StateError, match="that is not the teacher's PIN"):
            teacher.does(TakeControl("1"))
        with pytest.raises(StateError, match="wait a moment before the next PIN"):
            teacher.does(TakeControl("4711"))
        assert b"4711" not in b"".join(Codec().encode(one) for one in (*pupil.seen, *teacher.seen))


@pytest.mark.parametrize(
    ("records", "says"),
    [
        ((Ask(1, BACK),), "the first record must be a hello"),
        ((Trust(SECRET), Hello("owner")), "the first record must be a hello"),
        ((Hello("a"), Hello("b")), "a hello comes once"),
        ((Hello("a"), End()), "only who started the arm may end it"),
        ((Hello("a"), Welcome("1", "you", {})), "cannot be read: Invalid value 'welcome'"),
    ],
)
@pytest.mark.parametrize("json", [False, True], ids=["msgpack", "json"])
def test_what_comes_out_of_order_is_refused(
    arm_at: Address, records: tuple[Record, ...], says: str, json: bool
) -> None:
    codec, line = Codec(json=json), WebSocketLine(arm_at, text=json)
    for record in records:
        line.send(codec.encode(record))
    assert says in refusal(line, codec)


@pytest.mark.parametrize(
    ("first", "says"),
    [
        (Trust("wrong"), "must know the secret"),
        (Hello("nobody"), "must know the secret"),
        (Trust(SECRET), "first record must be a hello"),
    ],
)
def test_the_local_socket_is_for_who_knows_its_secret(arm_at: Address, first: Record, says: str) -> None:
    line = LocalLine(arm_at, SECRET)  # says it once
    line.close()
    line = LocalLine(arm_at, "" if first != Trust(SECRET) else SECRET)
    line.send(Codec().encode(first))
    assert says in refusal(line, Codec())


def test_a_flood_is_shut_out_and_stops_what_it_moved(operator: Client) -> None:
    with Client.remote(operator.line_address, "watcher", watch=True) as watcher:
        operator.ask(SLOWLY)
        watcher.until(lambda now: now.state is State.MOVING)
        beat = operator.codec.encode(Beat())
        with pytest.raises(ConnectionClosed):
            for _ in range(100_000):
                operator.line.send(beat)
        assert "more than 1000 records in a second" in refusal(operator.line, operator.codec)
        now = watcher.until(lambda now: now.state is State.HOLDING)
        assert "its connection is gone" in now.cause
        operator.__init__(WebSocketLine(operator.line_address), "operator")  # type: ignore[misc]


def test_there_is_room_for_so_many_clients(arm_at: Address) -> None:
    clients = list[Client]()
    with pytest.raises(ConnectionClosed):
        for _ in range(65):
            clients.append(Client.remote(arm_at, watch=True))
    assert len(clients) == 64
    clients.pop().line.close()
    first = clients[0]
    first.until(lambda now: len(now.control.parties) < 64)
    clients.append(Client.remote(arm_at, watch=True))
    for client in clients:
        client.line.close()
