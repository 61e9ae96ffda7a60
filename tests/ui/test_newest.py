"""Requests that overtake each other."""

from __future__ import annotations

import asyncio

import pytest

from armctl.ui.events import Newest, OneAtATime


def test_only_the_newest_request_is_answered() -> None:
    newest = Newest()
    first = newest.begin()
    assert first()
    second = newest.begin()
    assert (first(), second()) == (False, True)
    newest.drop()
    assert not second()


def test_requests_during_a_run_become_one_more_run_also_after_one_that_failed() -> None:
    runs: list[int] = []
    running: list[int] = []

    async def action() -> None:
        running.append(1)
        assert len(running) == 1
        await asyncio.sleep(0)
        running.pop()
        runs.append(1)
        if len(runs) == 1:
            raise ValueError("the first fails")

    async def main() -> None:
        once = OneAtATime(action)
        with pytest.raises(ValueError, match="first"):
            await once.run()
        await asyncio.gather(*(once.run() for _ in range(5)))
        assert len(runs) == 3
        await once.run()
        assert len(runs) == 4

    asyncio.run(main())
