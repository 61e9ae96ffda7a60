"""Requests that overtake each other."""

from __future__ import annotations

import asyncio

from armctl.ui.newest import Newest, OneAtATime


def test_only_the_newest_request_is_answered() -> None:
    newest = Newest()
    first = newest.begin()
    assert first()
    second = newest.begin()
    assert (first(), second()) == (False, True)
    newest.drop()
    assert not second()


def test_requests_during_a_run_become_one_more_run() -> None:
    runs: list[int] = []
    running: list[int] = []

    async def action() -> None:
        running.append(1)
        assert len(running) == 1
        await asyncio.sleep(0)
        runs.append(len(runs))
        running.pop()

    async def main() -> None:
        once = OneAtATime(action)
        await asyncio.gather(*(once.run() for _ in range(5)))
        assert len(runs) == 2
        await once.run()
        assert len(runs) == 3

    asyncio.run(main())


def test_an_action_that_fails_can_be_run_again() -> None:
    tries: list[int] = []

    async def action() -> None:
        tries.append(1)
        if len(tries) == 1:
            raise ValueError

    async def main() -> None:
        once = OneAtATime(action)
        try:
            await once.run()
        except ValueError:
            await once.run()

    asyncio.run(main())
    assert len(tries) == 2
