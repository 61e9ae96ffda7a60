"""Who asks is known before what is asked is decoded; and no client costs more than it may."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from tests.process.kit import HOME, ROBOT, SECRET, Address, Client, WebSocketLine, served
from tests.process.test_server import refusal
from websockets.exceptions import ConnectionClosed

from armctl.errors import ArmctlError, InputError, StateError
from armctl.facts import State
from armctl.motion import plan_joints
from armctl.process.limits import (
    MOST_BYTES_A_SECOND,
    MOST_BYTES_WATCHING,
    Arrivals,
    Meter,
    Traffic,
    near,
    source_of,
    who_gives_way,
)
from armctl.process.lines import LocalLine
from armctl.process.records import MOST_ELSE, Answer, Ask, Codec, Hello, Recall, Recalled, Stop, Trust
from armctl.program import MoveStep, Program, WaitStep
from armctl.protocol import (
    Arrive,
    Command,
    Follow,
    Jog,
    Leave,
    LockControl,
    MoveJoints,
    RunProgram,
    SetSpeed,
    TakeControl,
)
from armctl.ui.api import schema

BOTH = pytest.mark.parametrize("json", [False, True], ids=["msgpack", "json"])
PROGRAM = Program(robot="uzuner", steps=(WaitStep(seconds=0.01),) * 300)
FOLLOW = Follow(plan_joints(ROBOT, HOME, HOME + 0.1))
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="other systems have one address of their own")


@pytest.fixture(scope="module")
def arm_at(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Address]:
    with served(tmp_path_factory.mktemp("arm"), pin="4711") as address:
        yield address


@pytest.fixture
def operator(arm_at: Address) -> Iterator[Client]:
    with Client.remote(arm_at, "operator") as client:
        client.does(TakeControl())
        if client.until(lambda now: not now.busy).state is not State.HOLDING:
            client.enables()
        yield client


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The kinds of commands that were decoded."""
    whole, kinds = Codec.command, list[str]()

    def noted(self: Codec, record: Ask) -> Command:
        kinds.append(self.kind(record))
        return whole(self, record)

    monkeypatch.setattr(Codec, "command", noted)
    return kinds


# Who asks.


@BOTH
def test_what_a_watcher_asks_for_is_refused_by_its_tag_and_never_decoded(
    operator: Client, decoded: list[str], json: bool
) -> None:
    with Client.remote(operator.address, "guest", json=json, watch=True) as guest:
        for command in (FOLLOW, RunProgram(PROGRAM), Jog(np.zeros(5)), SetSpeed(0.5)):
            with pytest.raises(StateError, match="operator operates the arm; take control first"):
                guest.does(command)
        assert decoded == []
        guest.line.send(guest.codec.encode(Ask(77, FOLLOW)).replace(b"follow", b"folly!"))
        assert "Invalid value 'folly!'" in str(guest.outcome(77))
        with pytest.raises(StateError, match="only the operator may lock control"):
            guest.does(LockControl(True))  # everybody may ask that
        assert decoded == ["lock-control"]


def test_a_lock_and_an_arm_that_nobody_operates_are_judged_alike(tmp_path: Path, decoded: list[str]) -> None:
    with served(tmp_path, pin="4711") as address, Client.remote(address, "guest", watch=True) as guest:
        with pytest.raises(StateError, match="nobody operates the arm; take control first"):
            guest.does(FOLLOW)
        guest.does(LockControl(True, "4711"))
        with pytest.raises(StateError, match="the teacher has locked control"):
            guest.does(FOLLOW)
        assert "follow" not in decoded


def test_who_owns_the_link_is_judged_by_the_party_it_speaks_for(operator: Client) -> None:
    """By the controller, in the order of what its pages ask for: none of them waits for another one."""
    with Client(LocalLine(operator.address, SECRET), "console") as console:
        console.say(Ask(1, Arrive("a page", watch=True), "page 1"))
        console.say(Ask(2, FOLLOW, "page 1"))
        assert "operator operates the arm" in str(console.outcome(2))
        console.say(Ask(3, SetSpeed(0.9), operator.id))
        assert console.outcome(3) is None
        console.say(Ask(4, Leave(), "page 1"))
        assert console.outcome(4) is None


def outcomes(client: Client, numbers: list[int]) -> list[str]:
    """What became of some commands, in whichever order they are answered."""
    found: dict[int, str] = {}
    while not set(numbers) <= set(found):
        record = client.hear(Answer)
        if record.finished:
            found[record.id] = record.error
    return [found[number] for number in numbers]


def test_what_comes_right_behind_a_hello_or_taking_control_waits_for_its_answer(operator: Client) -> None:
    with Client.remote(operator.address, "quick", watch=True) as quick:
        numbers = [quick.ask(TakeControl()), quick.ask(SetSpeed(0.5)), quick.ask(RunProgram(PROGRAM))]
        numbers.append(quick.stop())
        taken, speed, program, stopped = outcomes(quick, numbers)
        assert taken == speed == stopped == ""
        assert "stopped" in program  # by what has overtaken it
        quick.does(SetSpeed(1.0))
    operator.line.close()
    with Client.remote(operator.address, "sees", watch=True) as sees:
        sees.until(lambda now: now.control.operator is None)
        codec, line = Codec(), WebSocketLine(operator.address)
        for record in (Hello("hasty"), Ask(1, SetSpeed(1.0)), Ask(2, RunProgram(PROGRAM))):
            line.send(codec.encode(record))  # without waiting for the welcome
        sees.until(lambda now: now.state is State.MOVING)
        line.close()


@BOTH
@pytest.mark.parametrize("command", [Leave(), Leave("gone"), Arrive("somebody"), Arrive()])
def test_leaving_and_arriving_are_nobodys_to_send(operator: Client, command: Command, json: bool) -> None:
    with Client.remote(operator.address, "guest", json=json, watch=True) as guest:
        kind = type(command).__name__.lower()
        with pytest.raises(InputError, match=f"cannot be read: Invalid value '{kind}'"):
            guest.does(command)
        operator.line.close()  # nobody operates now
        guest.until(lambda now: now.control.operator is None)
        assert guest.snapshot.control.party(guest.id) is not None
        with pytest.raises(StateError, match="nobody operates the arm; take control first"):
            guest.does(MoveJoints(HOME))
    said = msgspec.json.decode(schema())
    assert not {"Arrive", "Leave"} & set(said["$defs"])


def test_a_client_says_nothing_in_anothers_name_and_forges_no_line(operator: Client) -> None:
    forged = "guest\n2026-01-01 STOP (operator)\x1b[2J"
    with Client.remote(operator.address, forged, watch=True) as guest:
        party = guest.until(lambda now: now.control.party(guest.id) is not None).control.party(guest.id)
        assert party is not None and party.name.isprintable()
        guest.say(Ask(1, SetSpeed(0.5), operator.id, "as the operator"))
        assert "operator operates the arm" in str(guest.outcome(1))
        guest.say(Stop(2, operator.id, "\nforged\n"))
        assert guest.outcome(2) is None
        lines = [one.text for one in guest.until(lambda now: not now.busy).events]
        assert all(line.isprintable() for line in lines)
        guest.say(Trust(SECRET))
        assert "a hello comes once" in refusal(guest.line, guest.codec)


def test_a_program_for_whom_there_is_no_party_is_shut_out(
    arm_at: Address, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("armctl.runtime.control.MOST_PARTIES", 0)
    with Client.remote(arm_at, "one too many") as client:
        assert "are there already; close one" in refusal(client.line, client.codec)


# What is asked.


def curve(coefficients: Any) -> dict[str, Any]:
    pieces = len(coefficients)
    return {"breaks": list(range(pieces + 1)), "coefficients": coefficients}


def path(coefficients: Any) -> dict[str, Any]:
    return {"type": "path", "curve": curve(coefficients), "law": curve([[[0.0], [1.0]]])}


def nested(depth: int) -> dict[str, Any]:
    inner: dict[str, Any] = {"type": "straight", "start": [0] * 5, "end": [0] * 5, "duration": 1, "way": None}
    for _ in range(depth):
        inner = {"type": "slowed", "motion": inner, "factor": 1.0}
    return inner


ROW = [0.0] * 5
ODD: dict[str, tuple[Any, str]] = {
    "13 coefficients": (path([[ROW] * 13]), "13 coefficients of 5 joints; 12 of 64 at most"),
    "1,000 coefficients": (path([[ROW] * 100]), "100 coefficients of 5 joints; 12 of 64 at most"),
    "4,000 coefficients": (path([[ROW] * 4000]), "a piece of a curve in 2?[0-9]+ bytes"),
    "65 joints": (path([[[0.0] * 65] * 2]), "2 coefficients of 65 joints"),
    "20,001 pieces": (path([[[0.0]]] * 20_001), "of 20001 pieces|length <= 20001"),
    "no piece": (path([]), "do not fit"),
    "no row": (path([[]]), "needs a row of coefficients"),
    "ragged rows": (path([[[0.0], [0.0, 1.0]]]), "of one length"),
    "ragged pieces": (path([[[0.0]], [[0.0], [1.0]]]), "piece 2 of a curve has another number"),
    "words": (path([[["x"] * 5]]), "Expected `float`, got `str`"),
    "no numbers": (path([5]), "cannot be read"),
    "too deep": (nested(9), "more than 8 others inside each other"),
    "too many parts": ({"type": "joined", "parts": [nested(0)] * 1001}, "length <= 1000"),
    "too many parts in parts": (
        {"type": "joined", "parts": [{"type": "joined", "parts": [nested(0)] * 600}] * 2},
        "more than 1000 parts",
    ),
}


@BOTH
@pytest.mark.parametrize("what", ODD)
def test_a_trajectory_larger_than_any_that_is_needed_is_refused_in_words(
    operator: Client, what: str, json: bool
) -> None:
    trajectory, says = ODD[what]
    with Client.remote(operator.address, "mine", json=json) as client:
        client.does(TakeControl())
        error = client.outcome(client.ask_raw("follow", trajectory=trajectory))
        assert isinstance(error, ArmctlError) and re.search(says, str(error)), error
        client.does(MoveJoints(client.turned(1)))  # the planner is free
        client.does(MoveJoints(HOME))


@BOTH
def test_a_command_is_as_large_as_its_kind_needs(operator: Client, json: bool) -> None:
    with Client.remote(operator.address, "mine", json=json) as client:
        client.does(TakeControl())
        asked = client.ask_raw("take-control", pin="1" * 5000)
        assert re.search(r"a take-control of 5\d\d\d bytes is too large; 4096", str(client.outcome(asked)))
        steps = (MoveStep(joints_deg=(1.25, 2.25, 3.25, 4.25, 5.25), note="x" * 20),) * 19_000
        program = Program(robot="another", name="large", steps=steps)
        assert len(client.codec.encode(Ask(1, RunProgram(program)))) > 2_000_000
        assert "another" in str(client.outcome(client.ask(RunProgram(program))))
        many = {"robot": "uzuner", "steps": [{"do": "end"}] * 20_001}
        assert "it has 20001 steps; a program has 20000 at most" in str(
            client.outcome(client.ask_raw("run-program", program=many))
        )
        one = {"robot": "uzuner", "steps": [{"do": "move", "joints_deg": [0] * 20_000}]}
        assert "step 1 is larger than 16 KiB" in str(
            client.outcome(client.ask_raw("run-program", program=one))
        )
        sizes = (MOST_ELSE - 200, MOST_ELSE)
        numbers = [client.ask_raw("set-speed", fraction=1.0, more="x" * size) for size in sizes]
        first, second = outcomes(client, numbers)
        assert "unknown field" in first
        assert "is too large; 262144 at most" in second


def test_large_records_are_of_who_operates_alone(operator: Client) -> None:
    large = Program(robot="uzuner", name="large", steps=(WaitStep(seconds=0.01, note="x" * 20),) * 10_000)
    with Client.remote(operator.address, "guest", watch=True) as guest:
        guest.ask(RunProgram(large))
        words = "a record of .* bytes or more; 262144 at most, as operator operates the arm"
        assert re.search(words, refusal(guest.line, guest.codec))
    with Client.remote(operator.address, "quick", watch=True) as quick:
        quick.ask(TakeControl())
        asked = quick.ask(RunProgram(large, None))  # waits until control is taken
        quick.until(lambda now: now.state is State.MOVING)
        stopped, ran = outcomes(quick, [quick.stop(), asked])
        assert stopped == ""
        assert "stopped by quick" in ran


def test_a_large_record_that_is_not_finished_goes_when_another_client_sends_one(arm_at: Address) -> None:
    """Where the server has let the first one in; it may also read that only once the second operates."""
    large = Program(robot="uzuner", name="large", steps=(WaitStep(seconds=0.01, note="x" * 20),) * 10_000)
    told: list[str] = []
    while len(told) < 10 and not any("another client operates the arm now" in one for one in told):
        with Client.remote(arm_at, "first", watch=True) as first:
            first.does(TakeControl())
            assert isinstance(first.line, WebSocketLine)
            with suppress(ConnectionClosed):  # it is shut out before it has sent all
                first.line.socket.send(_unfinished(iter(["x" * 400_000]), first, large))
            told.append(refusal(first.line, first.codec))
        assert "operates the arm" in told[-1]
    assert "another client operates the arm now" in told[-1]


def _unfinished(frames: Iterator[str], first: Client, large: Program) -> Iterator[str]:
    """A message in parts, in the middle of which another client takes control, and sends a large program."""
    yield next(frames)
    with Client.remote(first.address, "second", watch=True) as second:
        second.does(TakeControl())
        assert second.outcome(second.ask(RunProgram(large, 1, 20_000))) is not None
    yield ""


@pytest.mark.parametrize("number", [2**53 + 1, -(2**60), 10**30])
def test_a_number_that_no_answer_could_carry_is_refused(arm_at: Address, number: int) -> None:
    with Client.remote(arm_at, json=True, watch=True) as client:
        client.line.send(b'{"type": "stop", "id": %d}' % number)
        assert "cannot be read" in refusal(client.line, client.codec)


# How much, how often, and how many.


def test_the_last_minute_is_not_given_all_the_time(operator: Client) -> None:
    operator.say(Recall(501))
    assert operator.hear(Recalled).id == 501
    operator.say(Recall(502))
    assert re.search(r"was given a moment ago; ask again in \d\.\d s", str(operator.outcome(502)))


def test_the_last_minute_is_packed_once_for_all_who_ask_for_it(
    operator: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    import threading

    begun, go_on, packings = threading.Event(), threading.Event(), list[object]()

    def slow(recording: object) -> bytes:
        packings.append(recording)
        begun.set()
        assert go_on.wait(20)
        return b"packed"

    monkeypatch.setattr("armctl.process.server.packed", slow)
    with ExitStack() as clients:
        asking = [clients.enter_context(Client.remote(operator.address, watch=True)) for _ in range(5)]
        for client in asking:
            client.say(Recall(1))
        assert begun.wait(20)
        for client in asking:  # what it has said before is taken by now
            assert client.outcome(client.stop()) is None
        go_on.set()
        assert {client.hear(Recalled).content for client in asking} == {b"packed"}
    assert len(packings) == 1


def test_who_operates_is_asked_about_so_often(operator: Client) -> None:
    with Client.remote(operator.address, "guest", watch=True) as guest:
        asked = [guest.ask(TakeControl("1")) for _ in range(45)]  # within two seconds
        errors = outcomes(guest, asked)
        assert any("more than 20 a second about who operates; wait a moment" in error for error in errors)
        assert guest.outcome(guest.stop()) is None


def test_a_client_sends_so_much_in_a_second_and_all_that_watch_so_much_together() -> None:
    now = [0.0]
    traffic = Traffic(lambda: now[0])

    def sends(meter: Meter, records: int, size: int = 1, *, operates: bool = False) -> None:
        traffic.count(meter, records, size, 1000, operates=operates)

    floods = [Meter() for _ in range(4)]
    for meter in floods[:3]:
        sends(meter, 1000)
    with pytest.raises(InputError, match="more than 1000 records in a second; send less"):
        sends(floods[0], 1)
    little, operator = Meter(), Meter()
    sends(little, 300)  # who sends little goes on, and who operates
    sends(operator, 1000, MOST_BYTES_A_SECOND, operates=True)
    with pytest.raises(InputError, match="all that do not operate the arm together send too much"):
        sends(floods[3], 301)  # who comes anew to flood does not get far
    now[0] = 1.0
    for meter in floods[:2]:
        sends(meter, 1, MOST_BYTES_WATCHING)
    with pytest.raises(InputError, match="more than 1 MiB in a second; send less"):
        sends(floods[0], 1)
    sends(little, 1, 128 << 10)
    with pytest.raises(InputError, match="together send too much"):
        sends(little, 1)
    with pytest.raises(InputError, match="more than 8 MiB in a second; send less"):
        sends(operator, 1, MOST_BYTES_A_SECOND + 1, operates=True)


class Seated:
    def __init__(self, source: str, name: str) -> None:
        self.source, self.name = source, name


@pytest.mark.parametrize(
    ("seated", "newcomer", "leaves"),
    [
        ("aaaa", "b", 3),  # the last of the computer that has most
        ("aabb", "c", 1),
        ("aabb", "a", None),  # it would only change sides
        ("ab", "c", None),
        ("aaab", "b", 2),
        ("aab", "b", None),
        ("aaaab", "b", 3),
    ],
)
def test_places_are_shared_among_computers_and_names(seated: str, newcomer: str, leaves: int | None) -> None:
    by_source = [Seated(one, "program") for one in seated]
    by_name = [Seated("here", one) for one in seated]
    expected = None if leaves is None else by_source[leaves]
    assert who_gives_way(by_source, newcomer, "program") is expected
    expected = None if leaves is None else by_name[leaves]
    assert who_gives_way(by_name, "here", newcomer) is expected


@pytest.mark.parametrize(
    ("peer", "source"),
    [
        (("192.168.1.5", 40_000), "192.168.1.5"),
        (("::ffff:192.168.1.5", 40_000, 0, 0), "192.168.1.5"),
        (("2001:db8:1:2:aaaa::1", 1, 0, 0), "2001:db8:1:2::/64"),
        (("fe80::1%eth0", 1, 0, 0), "fe80::/64"),
        (("::1", 1, 0, 0), "::1"),
        ("", ""),
        (None, ""),
        (("@", 1), ""),
    ],
)
def test_a_computer_is_known_by_its_address(peer: object, source: str) -> None:
    assert source_of(peer) == source


@LINUX
def test_one_computer_cannot_take_all_places_from_others(arm_at: Address) -> None:
    with ExitStack() as clients:
        hog = [
            clients.enter_context(Client.remote(arm_at, f"hog {k}", watch=True, source="127.0.0.2"))
            for k in range(63)
        ]
        hog[0].does(TakeControl())
        other = clients.enter_context(Client.remote(arm_at, "other", watch=True))
        other.until(lambda now: now.control.party(other.id) is not None)
        said = refusal(hog[-1].line, hog[-1].codec)
        assert "all 64 places are taken, and others have fewer of them" in said
        assert hog[0].outcome(hog[0].stop()) is None
        with pytest.raises(ConnectionClosed):
            Client.remote(arm_at, "hog 64", watch=True, source="127.0.0.2")
        clients.enter_context(Client(LocalLine(arm_at, SECRET), "owner"))  # there is always room for it


def test_connections_that_say_nothing_take_no_places(
    arm_at: Address, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("armctl.process.server._MOST_UNNAMED", 5)
    silent = [WebSocketLine(arm_at) for _ in range(8)]
    with Client.remote(arm_at, watch=True) as client:
        client.until(lambda now: now.control.party(client.id) is not None)
    with pytest.raises((OSError, ConnectionClosed)):
        silent[0].receive()
    for line in silent:
        line.close()


def test_a_computer_connects_so_often(arm_at: Address, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    arrivals = Arrivals(lambda: now[0])
    assert [arrivals.take("a") for _ in range(121)] == [True] * 120 + [False]
    assert arrivals.take("b")
    now[0] = 1.0
    assert [arrivals.take("a") for _ in range(11)] == [True] * 10 + [False]
    monkeypatch.setattr("armctl.process.limits._AT_ONCE", 0.0)
    line, codec = WebSocketLine(arm_at, text=True, source="127.0.0.1"), Codec(json=True)
    line.send(codec.encode(Hello("again")))
    assert "too many connections from this computer" in refusal(line, codec)


@pytest.mark.parametrize(
    ("address", "is_"),
    [
        ("10.0.0.5", "10.0.0.5"),
        ("::ffff:10.0.0.5", "10.0.0.5"),
        ("::1", "::1"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        ("2001:db8:1:2:ffff::1", "2001:db8:1:2::/64"),
        ("fe80::1%eth0", "fe80::/64"),
        ("unix", "unix"),
    ],
)
def test_a_computer_with_many_addresses_is_one_source(address: str, is_: str) -> None:
    assert near(address) == is_
