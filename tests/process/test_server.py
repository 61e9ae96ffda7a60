"""What the arm process does for its clients, and against them."""

from __future__ import annotations

import asyncio
import re
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.process.kit import (
    HOME,
    PATIENCE_S,
    ROBOT,
    SECRET,
    Address,
    Client,
    WebSocketLine,
    served,
    websocket,
)
from tests.runtime.signal_kit import robot_with
from websockets.exceptions import ConnectionClosed

from armctl.errors import InputError, StateError
from armctl.facts import State
from armctl.kinematics import Target
from armctl.process import connections
from armctl.process.lines import LocalLine
from armctl.process.link import Link
from armctl.process.records import (
    SILENCE_S,
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
from armctl.process.server import Server
from armctl.program import MoveStep, Program, WaitStep
from armctl.protocol import (
    Arrive,
    Event,
    LockControl,
    MoveGripper,
    MoveJoints,
    MoveTo,
    Origin,
    RememberWrongPins,
    RunProgram,
    SetOutput,
    SetSpeed,
    SimulateInput,
    TakeControl,
    UpdateProgram,
    WrongPins,
)
from armctl.protocol.recording import unpacked
from armctl.runtime.pin import LATEST_ANSWER_S

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


def refusal(line: Any, codec: Codec) -> str:
    """What is said last on a line, before it is closed."""
    said = ""
    with pytest.raises((OSError, ConnectionClosed)):
        while True:
            record = codec.from_arm(line.receive())
            if isinstance(record, Refused):
                said = record.error
    line.close()
    return said


def test_at_a_fast_tick_clients_see_50_moments_of_a_motion_a_second_and_all_else_at_once(
    operator: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    moving = replace(operator.snapshot, state=State.MOVING, busy=True, stamp=10.0)

    async def told(*changes: dict[str, Any]) -> list[bool]:
        """Whether clients are woken by each of these ticks, 10 ms from one to the next."""
        server, woken = Server(SECRET), list[object]()
        monkeypatch.setattr(asyncio.get_running_loop(), "call_soon_threadsafe", woken.append)
        seen = list[int]()
        for k, change in enumerate(changes):
            server.tell(replace(moving, stamp=10.0 + 0.01 * k, **change))
            seen.append(len(woken))
        return [after > before for before, after in zip([0, *seen], seen, strict=False)]

    assert asyncio.run(told({}, {}, {}, {}, {})) == [True, False, True, False, True]
    paused, still = {"state": State.PAUSED}, {"state": State.HOLDING, "busy": False}
    assert asyncio.run(told({}, paused, paused, still, still)) == [True, True, False, True, True]
    assert asyncio.run(told({}, {"events": (Event(10.0, "info", "step 2"),)})) == [True, True]


@pytest.mark.parametrize("json", [False, True], ids=["msgpack", "json"])
def test_a_client_moves_the_arm_and_sees_it_before_it_is_answered(operator: Client, json: bool) -> None:
    with Client.remote(operator.address, "mine", json=json) as client:
        client.does(TakeControl())
        client.seen.clear()
        client.does(MoveJoints(client.turned(3)))
        *_, last = [one for one in client.seen if isinstance(one, Seen)]
        assert isinstance(client.seen[-1], Answer)
        np.testing.assert_allclose(last.snapshot.q_command, client.turned(3))
        answers = [one for one in client.seen if isinstance(one, Answer)]
        assert [(one.accepted, one.finished) for one in answers] == [(True, False), (False, True)]
        pose = {"point": [0.2, 0.01, 0.1], "roll": None}
        assert client.outcome(client.ask_raw("move-to", target=pose)) is None
        np.testing.assert_allclose(ROBOT.forward(client.snapshot.q_command)[:3, 3], [0.2, 0.01, 0.1])
        client.does(MoveTo(Target.of([0.2, 0.0, 0.1])))
        with pytest.raises(StateError, match="mine operates the arm; take control first"):
            operator.does(BACK)
        assert operator.outcome(operator.stop()) is None  # STOP is everybody's
        operator.does(TakeControl())


@pytest.mark.parametrize(
    ("command", "values", "says"),
    [
        (
            "move-to",
            {"target": {"point": [0, 0, 0], "pich": 1}},
            "a target has no 'pich'; it is made of point",
        ),
        ("move-to", {"target": {"pitch": 1}}, "a target needs a point"),
        ("move-joints", {"q": ["1", "2"]}, r"must be numbers, got \['1', '2'\] - at `\$\.q`"),
        ("move-joints", {"q": [0] * 5, "speed": 1}, "unknown field `speed`"),
        ("move-joints", {"q": [None] * 5}, "finite"),
        ("move", {}, "Invalid value 'move'"),
    ],
)
def test_what_is_wrong_with_a_command_is_said_and_the_connection_goes_on(
    operator: Client, command: str, values: dict[str, object], says: str
) -> None:
    error = operator.outcome(operator.ask_raw(command, **values))
    assert re.search(says, str(error))
    operator.does(SetSpeed(1.0))


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
    with Client.remote(operator.address, watch=True) as late:
        early = [one for record in late.seen if isinstance(record, Logged) for one in record.events]
        assert set(told) <= set(early)


def test_who_watches_stops_the_arm_and_nothing_else(operator: Client) -> None:
    with Client.remote(operator.address, "guest", watch=True) as guest:
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
    operator.until(lambda now: len(now.control.parties) == 1)


def test_the_teachers_pin_opens_every_lock(tmp_path: Path) -> None:
    with (
        served(tmp_path, pin="4711") as address,
        Client.remote(address, "pupil") as pupil,
        Client.remote(address, "teacher", json=True, watch=True) as teacher,
    ):
        pupil.does(LockControl(True))
        teacher.does(TakeControl("4711"))
        teacher.does(LockControl(True, "4711"))
        with pytest.raises(StateError, match="the teacher has locked control"):
            pupil.does(TakeControl())
        guess, right = pupil.ask(TakeControl("1")), pupil.ask(TakeControl("4711"))
        assert "before the next PIN" in str(pupil.outcome(right))  # at once, unlike that of the guess
        assert "that is not the teacher's PIN" in str(pupil.outcome(guess))
        (told,) = pupil.snapshot.control.wrong_pins
        assert told == WrongPins("pupil", "programs at 127.0.0.1", 1)
        teacher.does(LockControl(False, "4711"))
        pupil.until(lambda now: now.control.operates(teacher.id))
        assert b"4711" not in b"".join(Codec().encode(one) for one in (*pupil.seen, *teacher.seen))


def test_a_client_that_guesses_does_not_delay_the_right_pin_of_others(tmp_path: Path) -> None:
    with served(tmp_path, pin="4711") as address, ExitStack() as stack:
        guesser = stack.enter_context(Client.remote(address, "guesser"))
        late: list[float] = []
        for k in range(30):
            for _ in range(6):
                guesser.ask(TakeControl(str(k)))
            with Client.remote(address, "teacher", watch=True) as teacher:
                begun = time.monotonic()
                teacher.does(LockControl(True, "4711"))
                late.append(time.monotonic() - begun)
        assert max(late) < LATEST_ANSWER_S / 2  # as late as that the guesser's own answers come


def test_a_page_that_guesses_holds_up_no_other_page_of_its_console(tmp_path: Path) -> None:
    """The answer to its wrong PIN is late; what others ask for meanwhile is not."""
    with served(tmp_path, pin="4711") as address:
        console = Link(LocalLine(address, SECRET), "console", ROBOT)
        try:
            for page in ("page 1", "page 2", "page 3"):
                console.submit(Arrive(page), Origin(page)).result(PATIENCE_S)
            guesses = [console.submit(TakeControl("0"), Origin("page 2"))]
            for ask, page in ((SetSpeed(0.5), "page 1"), (TakeControl("4711"), "page 3")):
                console.submit(ask, Origin(page)).result(PATIENCE_S)
                assert not guesses[0].finished.done()
        finally:
            console.close()


def test_only_its_own_console_tells_an_arm_of_wrong_pins(operator: Client) -> None:
    with pytest.raises(InputError, match="remember-wrong-pins"):
        operator.does(RememberWrongPins((WrongPins("Ann", "pages at 10.0.0.9", 1000),)))
    assert operator.snapshot.control.wrong_pins == ()


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
    with suppress(ConnectionClosed):  # refused at the first one already
        for record in records:
            line.send(codec.encode(record))
    assert says in refusal(line, codec)


@pytest.mark.parametrize(
    ("secret", "says"), [("wrong", "must know the secret"), (SECRET, "first record must be a hello")]
)
def test_the_local_socket_is_for_who_knows_its_secret(arm_at: Address, secret: str, says: str) -> None:
    line = LocalLine(arm_at, secret)
    line.send(Codec().encode(Trust(SECRET)))
    assert says in refusal(line, Codec())


def test_a_flood_is_shut_out_and_what_it_moved_is_stopped(operator: Client) -> None:
    with Client.remote(operator.address, "watcher", watch=True) as watcher:
        operator.ask(SLOWLY)
        watcher.until(lambda now: now.state is State.MOVING)
        beat = operator.codec.encode(Beat())
        with pytest.raises(ConnectionClosed):
            for _ in range(100_000):
                operator.line.send(beat)
        assert "more than 1000 records in a second" in refusal(operator.line, operator.codec)
        now = watcher.until(lambda now: now.state is State.HOLDING)
        assert "its connection is gone" in now.cause


def test_there_is_room_for_so_many_clients(arm_at: Address) -> None:
    with ExitStack() as clients:
        for _ in range(63):  # and the one that keeps the arm
            last = clients.enter_context(Client(LocalLine(arm_at, SECRET), watch=True))
        with pytest.raises(ConnectionClosed):
            Client.remote(arm_at, watch=True)
        last.say(Hello("again"))
        assert "a hello comes once" in refusal(last.line, last.codec)
        with Client.remote(arm_at, watch=True) as one_more:
            one_more.hear(Seen)


def test_what_a_client_moves_stops_with_its_connection(operator: Client) -> None:
    with Client.remote(operator.address, "watcher", watch=True) as watcher:
        for waits in (True, False):  # also when it leaves before the motion has been planned
            with Client.remote(operator.address, "leaver") as leaver:
                leaver.does(TakeControl())
                leaver.ask(SLOWLY)
                if waits:
                    watcher.until(lambda now: now.state is State.MOVING)
            watcher.until(lambda now: now.control.operator is None)
            watcher.until(lambda now: now.state is State.HOLDING)
            assert watcher.outcome(watcher.stop()) is None
            assert watcher.snapshot.state is State.HOLDING
        assert any("its connection is gone" in one.text for one in logged(watcher))
        operator.does(TakeControl())


def test_a_client_that_is_killed_leaves_outputs_as_stop_does(tmp_path: Path) -> None:
    with (
        served(tmp_path, robot_with(tmp_path)) as address,
        Client.remote(address, "watcher", watch=True) as watcher,
    ):
        with Client.remote(address, "leaver") as leaver:
            leaver.enables()
            leaver.does(SetOutput("bell", 1.0))
            leaver.ask(SLOWLY)
            watcher.until(lambda now: now.state is State.MOVING and now.outputs["bell"] == 1.0)
        now = watcher.until(lambda now: now.state is State.HOLDING)
        assert now.outputs == {"lamp": 1.0, "pump": 1.0, "bell": 1.0}  # at_stop of the lamp is on
        watcher.does(TakeControl())
        watcher.does(SimulateInput("button", 1.0))
        watcher.until(lambda now: now.inputs["button"] == 1.0 and now.edges["button"] == 1)


def logged(client: Client) -> list[Any]:
    return [one for record in client.seen if isinstance(record, Logged) for one in record.events]


def test_what_a_silent_client_moves_is_stopped(tmp_path: Path) -> None:
    with (
        served(tmp_path, silence_s=0.3) as address,
        Client.remote(address, "watcher", watch=True) as watcher,
        Client(LocalLine(address, SECRET), "silent") as silent,  # its line gives no sign of life
    ):
        silent.enables()
        silent.ask(SLOWLY)
        watcher.until(lambda now: now.cause == "stopped by silent: no sign of life for 0.3 s")
        silent.does(SetSpeed(0.05))
        silent.ask(MoveGripper(0.0))
        watcher.until(lambda now: now.state is State.HOLDING and now.busy)
        watcher.until(lambda now: not now.busy)
        assert watcher.snapshot.gripper is not None and watcher.snapshot.gripper > 0.1
    with served(tmp_path) as address, Client.remote(address, "answers pings") as lively:
        lively.enables()
        lively.does(MoveJoints(lively.turned(5), SILENCE_S + 0.4))  # says nothing by itself


def test_a_client_that_reads_nothing_holds_up_nobody_and_can_stop(operator: Client) -> None:
    with Client.remote(operator.address, "reads", watch=True) as reads:
        deaf = websocket(operator.address)
        deaf.recv_events_paused = True  # type: ignore[attr-defined]
        deaf.send(Codec(json=True).encode(Hello("deaf", watch=True)), text=True)
        first = reads.until(lambda now: len(now.control.parties) == 3).tick
        moving = operator.ask(SLOWLY)
        ticks = [reads.hear(Seen).snapshot.tick for _ in range(25)]
        assert np.median(np.diff(ticks)) <= 3  # a busy machine leaves some out
        assert ticks[-1] > first
        deaf.send(Codec(json=True).encode(Stop(1)), text=True)
        assert "stopped by deaf" in str(operator.outcome(moving))
        deaf.close()


def test_stop_overtakes_a_big_program_and_drops_it(operator: Client) -> None:
    big = Program(robot="uzuner", name="big", steps=(WaitStep(seconds=0.01),) * 19_000)
    asked, moving = operator.ask(RunProgram(big, None)), operator.ask(SLOWLY)
    stopped = operator.stop()
    answers: dict[int, str] = {}
    while len(answers) < 3:
        record = operator.hear(Answer)
        if record.finished:
            answers[record.id] = record.error
    assert next(iter(answers)) == stopped
    assert answers[asked] == answers[moving] == "stopped before it began"
    assert operator.snapshot.state is State.HOLDING
    with pytest.raises(StateError, match="no program runs"):  # carried out where no STOP comes
        operator.does(UpdateProgram(big))


def test_a_big_record_that_is_wrong_ends_the_connection_in_words(arm_at: Address) -> None:
    with Client.remote(arm_at, json=True) as client:
        client.line.send(b'{"type": "hello", "name": "' + b"x" * 100_000 + b'"}')
        assert "a hello comes once" in refusal(client.line, client.codec)


def test_the_frames_of_a_websocket(arm_at: Address) -> None:
    with Client.remote(arm_at, json=True) as client:
        line = client.line
        assert isinstance(line, WebSocketLine)
        beat = client.codec.encode(Stop(77)).decode()
        line.socket.send([beat[:5], beat[5:9], "", beat[9:]])
        assert client.outcome(77) is None or client.snapshot.board is None
        pong = line.socket.ping(b"there?")
        client.hear(Seen)
        assert pong.wait(5.0)
        with pytest.raises(ConnectionClosed) as closed:
            line.socket.send("x" * (5 * 1024 * 1024))
            while True:
                line.receive()
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1009
    with Client.remote(arm_at, watch=True) as client:
        assert isinstance(client.line, WebSocketLine)
        client.line.socket.close(1000, "bye")


def test_the_last_minute_is_given(operator: Client) -> None:
    operator.say(Recall(501))
    last = operator.hear(Recalled)
    assert last.id == 501
    assert unpacked(last.content).why == "asked for"


def test_only_the_last_owner_ends_the_arm(tmp_path: Path) -> None:
    ended = threading.Event()
    with served(tmp_path) as address:
        link = Link(LocalLine(address, SECRET), "second owner", ROBOT)
        link.close()
        with Client.remote(address, watch=True) as client:  # it goes on
            first = client.snapshot.tick
            client.until(lambda now: now.tick > first + 2)
        with Client(LocalLine(address, SECRET), "ends it") as ending:
            ending.say(End())
            with pytest.raises(OSError):
                while True:
                    ending.next()
        ended.set()
    assert ended.is_set()


@pytest.mark.logs_a_defect
def test_a_defect_in_serving_a_client_ends_its_connection(
    arm_at: Address, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(self: Codec, record: Ask) -> None:
        raise RuntimeError("defect")

    big = Program(robot="uzuner", name="big", steps=(WaitStep(seconds=0.01),) * 4_000)
    with Client.remote(arm_at) as client:
        monkeypatch.setattr(Codec, "command", broken)
        asked = client.ask(RunProgram(big))
        with pytest.raises(ConnectionClosed):
            client.outcome(asked)
    assert "serving it failed" in caplog.text


def test_a_client_that_pings_and_does_not_read_is_shut_out(
    arm_at: Address, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Client.remote(arm_at) as client:
        monkeypatch.setattr(connections, "MOST_UNSENT", -1)
        client.say(Beat())
        with pytest.raises(ConnectionClosed):
            client.hear(Refused)


def test_what_takes_long_to_decode_holds_up_nobodys_stop(
    operator: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, begun, go_on = Codec.command, threading.Event(), threading.Event()

    def slow(self: Codec, record: Ask) -> Any:
        begun.set()
        assert go_on.wait(20)
        return whole(self, record)

    program = Program(robot="uzuner", name="some", steps=(WaitStep(seconds=0.01),) * 300)
    with Client.remote(operator.address, watch=True) as other:
        monkeypatch.setattr(Codec, "command", slow)
        asked = operator.ask(RunProgram(program))
        assert begun.wait(20)
        try:
            assert other.outcome(other.stop()) is None
        finally:
            go_on.set()
        assert operator.outcome(asked) is not None
