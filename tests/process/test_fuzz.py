"""Messages that nobody would write: ten thousand here, more with ``ARMCTL_FUZZ=1000000``."""

from __future__ import annotations

import asyncio
import os
import random
from collections.abc import Callable, Iterable
from typing import Any

import msgspec
import numpy as np
import pytest
from tests.process.kit import HOME, ROBOT
from tests.process.test_records import default

from armctl.process import server as server_module
from armctl.process.host import Host
from armctl.process.records import Ask, Codec, Hello, Record, Stop, Trust, commands
from armctl.process.server import Server
from armctl.protocol import Connect, Enable

COUNT = int(os.environ.get("ARMCTL_FUZZ", "10000"))
ODD: tuple[Any, ...] = (
    None, True, -1, 0, 1e308, float("nan"), "", "x" * 300, [], [[]], {}, b"\xff", [None] * 5, "sim",
)  # fmt: skip


class Fed:
    """A connection on which some messages come."""

    def __init__(self, messages: Iterable[bytes]) -> None:
        self.alive: Callable[[int], None] = lambda _: None
        self.said: list[bytes] = []
        self._messages = iter(messages)

    async def receive(self) -> bytes:
        await asyncio.sleep(0)
        for message in self._messages:
            return message
        raise EOFError

    async def send(self, data: bytes) -> None:
        self.said.append(data)

    def abort(self) -> None:
        self._messages = iter(())


def mutated(value: Any, chance: random.Random) -> Any:
    """A plain value with something else in one place of it."""
    if isinstance(value, dict) and value and chance.random() < 0.9:
        key = chance.choice(list(value))
        if chance.random() < 0.1:
            return {one: value[one] for one in value if one != key}
        return value | {key: mutated(value[key], chance)}
    if isinstance(value, list) and value and chance.random() < 0.8:
        place = chance.randrange(len(value))
        return [*value[:place], mutated(value[place], chance), *value[place + 1 :]]
    if isinstance(value, float) and chance.random() < 0.5:
        return value * chance.choice([-1, 1.5, 1e3, 1e-300])
    return chance.choice(ODD)


def plain(codec: Codec) -> list[dict[str, Any]]:
    """Every request, as another program would write it."""
    wire: Any = msgspec.json if codec.json else msgspec.msgpack
    asked: list[Record] = [Ask(k, default(kind)) for k, kind in enumerate(commands())]
    return [wire.decode(codec.encode(one)) for one in [*asked, Stop(99)]]


def messages(codec: Codec, plain: list[dict[str, Any]], chance: random.Random, count: int) -> Iterable[bytes]:
    wire: Any = msgspec.json if codec.json else msgspec.msgpack
    for _ in range(count):
        record = chance.choice(plain)
        inside = record.get("command")
        if chance.random() < 0.97 and inside:  # else the connection mostly ends
            changed = mutated(inside, chance)
            yield wire.encode(record | {"command": changed})
        elif chance.random() < 0.5:
            yield wire.encode(mutated(record, chance))
        else:
            data = bytearray(wire.encode(record))
            data[chance.randrange(len(data))] = chance.randrange(256)
            yield bytes(data)


def test_no_message_breaks_the_arm_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_module, "_MOST_A_SECOND", 10**9)
    broken: list[dict[str, Any]] = []

    kinds = [(codec, plain(codec)) for codec in (Codec(), Codec(json=True))]

    async def fuzz() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _, context: broken.append(context))
        server, chance, done = Server("secret"), random.Random(7), 0
        with Host(ROBOT) as arm:
            server.arm = arm
            await asyncio.to_thread(arm.submit(Connect("sim")).result, 20)
            await asyncio.to_thread(arm.submit(Enable(HOME)).result, 20)
            while done < COUNT:
                (codec, known), many = chance.choice(kinds), chance.randrange(1, 200)
                line = Fed([codec.encode(Hello("fuzz")), *messages(codec, known, chance, many)])
                await server.attend(line, True)
                done += many
                q = arm.snapshot.q_command
                assert ((ROBOT.limits[:, 0] - 1e-9 <= q) & (q <= ROBOT.limits[:, 1] + 1e-9)).all()
            codec = Codec()
            owner = Fed([codec.encode(Trust("secret")), codec.encode(Hello("honest"))])
            await server.attend(owner, False)
            assert owner.said, "it answers no more"
            assert np.isfinite(arm.snapshot.q_command).all()

    asyncio.run(fuzz())
    assert not broken, broken[0]
