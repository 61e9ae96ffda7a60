"""The verdict that stands over a program is about the program that is on the list."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import AsyncMock, Mock

import pytest
from tests.runtime.kit import ROBOT, make_rig

from armctl.errors import StateError
from armctl.motion import Finding
from armctl.program import (
    EndStep,
    FrameStep,
    IfStep,
    MoveStep,
    PointStep,
    Program,
    Step,
    UserFrame,
    WaitForStep,
    WaitStep,
    WhileStep,
)
from armctl.program.edit import put_frame
from armctl.protocol import Snapshot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.manual import program_run
from armctl.ui.tabs.manual.program_run import ProgramRun
from armctl.ui.tabs.manual.shared_program import SharedProgram

FAR = PointStep(x_mm=999, y_mm=0, z_mm=100)
HOME = MoveStep(joints_deg=(0, 90, -80, -40, 0))


@dataclass
class Bench:
    desk: SharedProgram
    verdict: Mock
    run: ProgramRun
    offers: list[Callable[[Snapshot], str | None]]
    """why what runs a program would be refused"""
    snapshot: Snapshot

    @property
    def shown(self) -> str:
        return self.verdict.show.call_args.args[0]

    def put(self, *steps: Step) -> None:
        self.desk.put(Program(robot="uzuner", name="test", steps=steps))


@pytest.fixture
def bench(server: GuardedServer, tmp_path: Path) -> Bench:
    desk, verdict = SharedProgram("uzuner", tmp_path), Mock()
    offers: list[Callable[[Snapshot], str | None]] = []
    session: Any = SimpleNamespace(
        gui=server.gui,
        console=SimpleNamespace(robot=ROBOT, shared=lambda kind: desk),
        held=ROBOT,
        snapshot=make_rig().now,
        on=lambda attach, action: None,
        needs=lambda *controls, **conditions: offers.append(conditions["also"]),
        closed=False,
    )
    run = ProgramRun(session, cast(Any, None), verdict, nullcontext())
    return Bench(desk, verdict, run, offers, session.snapshot)


def test_a_check_tells_step_and_reason_until_the_program_is_another(bench: Bench) -> None:
    bench.put(HOME, FAR)
    (finding,) = asyncio.run(bench.run.check())
    assert str(finding).startswith("step 2: too far by 671.0 mm")
    assert "Pre-flight: refused, 1 error" in bench.shown
    bench.run.refresh()
    assert bench.verdict.visible
    bench.put(HOME)
    bench.run.refresh()
    assert not bench.verdict.visible


def test_what_would_be_refused_again_is_not_offered_until_program_or_arm_are_others(bench: Bench) -> None:
    def refused() -> set[str | None]:
        return {also(bench.snapshot) for also in bench.offers}

    bench.put(HOME, FAR)
    assert refused() == {None}
    asyncio.run(bench.run.check())
    assert refused() == {None, "step 2 cannot run: its row says why"}
    checked = bench.snapshot
    bench.snapshot = replace(checked, q_command=checked.q_command + 0.1)
    assert refused() == {None}
    bench.snapshot = replace(checked, gripper=0.4)
    assert refused() == {None}
    bench.snapshot = checked
    bench.put(HOME)
    assert refused() == {None}


def test_a_program_whose_frame_was_moved_is_checked_anew(bench: Bench) -> None:
    steps = (HOME, FrameStep(frame="table"), PointStep(x_mm=0, y_mm=0, z_mm=0))
    here, away = (UserFrame(x_mm=x, y_mm=0, z_mm=100) for x in (200, 999))
    bench.desk.put(Program(robot="uzuner", name="test", frames={"table": here}, steps=steps))
    assert asyncio.run(bench.run.check()) == []
    bench.desk.edit(put_frame(bench.desk.program, "table", away))
    (finding,) = asyncio.run(bench.run.check())
    assert str(finding).startswith("step 3: too far by")


def test_a_check_that_was_overtaken_shows_nothing_of_its_own(bench: Bench) -> None:
    async def overtaken() -> None:
        bench.put(HOME, FAR)
        first = asyncio.create_task(bench.run.check())
        await asyncio.sleep(0)
        assert "Checking" in bench.shown
        bench.put(HOME)
        await first
        assert not bench.verdict.visible
        await bench.run.check()

    asyncio.run(overtaken())
    assert bench.verdict.visible
    assert "refused" not in bench.shown


def test_an_empty_list_is_not_checked(bench: Bench) -> None:
    with pytest.raises(StateError, match="the list is empty"):
        asyncio.run(bench.run.check())
    assert not bench.verdict.visible


def test_a_check_of_a_long_program_says_how_far_it_is_and_can_be_cancelled(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    reached, go_on = threading.Event(), threading.Event()

    def check(*_: object, progress: Callable[[int, int], None], **__: object) -> list[Finding]:
        progress(12, 100)
        reached.set()
        assert go_on.wait(10)
        progress(13, 100)
        return []

    async def cancel() -> None:
        checking = asyncio.create_task(bench.run.check())
        await asyncio.to_thread(reached.wait, 10)
        bench.run.refresh()
        assert "12 of 100 steps" in bench.shown
        await bench.run._on_cancel()
        go_on.set()
        await checking

    monkeypatch.setattr("armctl.ui.tabs.manual.program_run.check_program_apart", check)
    bench.put(HOME)
    with pytest.raises(StateError, match="the check was cancelled"):
        asyncio.run(cancel())
    assert not bench.verdict.visible


PRESSED = IfStep(watch="button", trigger="edge")
LOOP = WhileStep(watch="button", trigger="edge")
PAUSE = WaitStep(seconds=0.1)
AWAITED = WaitForStep(watch="button", trigger="edge", timeout_s=9)


@pytest.mark.parametrize(
    ("steps", "edges", "rows"),
    [
        ((PAUSE, PRESSED, HOME, EndStep()), (4, 5, 5), [1, 2, 0]),  # pressed while the first step ran
        ((PAUSE, PRESSED, HOME, EndStep()), (4, 4), [1, 0]),
        ((PRESSED, HOME, EndStep(), PAUSE), (4,), [3]),  # pressed before the program began
        ((LOOP, PAUSE, EndStep(), HOME), (4,), [3]),
        ((PAUSE, LOOP, PAUSE, EndStep(), HOME), (4, 5, 5, 5), [1, 2, 1, 4]),  # one press is one pass
        ((PAUSE, LOOP, PAUSE, EndStep(), HOME), (4, 5, 7, 7), [1, 2, 1, 2]),
        ((AWAITED, PRESSED, HOME, EndStep()), (4, 5), [1, 0]),  # it was waited for
        ((AWAITED, PAUSE, PRESSED, HOME, EndStep()), (4, 5, 7), [1, 2, 3]),
    ],
)
def test_single_steps_know_the_edges_since_they_began(
    bench: Bench, steps: tuple[Step, ...], edges: tuple[int, ...], rows: list[int]
) -> None:
    editor, session = SimpleNamespace(selected=0), cast(Any, bench.run._session)
    vars(editor).update(select=lambda row: vars(editor).update(selected=row))
    bench.run._editor = cast(Any, editor)
    sent = AsyncMock()
    vars(session).update(submit=sent, notify=lambda *_: None)
    bench.put(*steps)
    seen: list[int] = []
    for count in edges:
        session.snapshot = replace(session.snapshot, inputs={"button": 1.0}, edges={"button": count})
        asyncio.run(bench.run._step())
        seen.append(editor.selected)
    assert seen == rows and sent.await_count == len(rows)


def test_what_is_being_checked_is_not_checked_a_second_time(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[threading.Event] = []

    def check(*_: object, **__: object) -> list[Finding]:
        begun.append(threading.Event())
        assert begun[-1].wait(10)
        return []

    async def twice() -> None:
        first, second = asyncio.create_task(bench.run.check()), asyncio.create_task(bench.run.check())
        while not begun:
            await asyncio.sleep(0)
        assert "Checking" in bench.shown
        begun[0].set()
        assert await first is await second

    monkeypatch.setattr("armctl.ui.tabs.manual.program_run.check_program_apart", check)
    bench.put(HOME)
    asyncio.run(twice())
    assert len(begun) == 1
    assert "Pre-flight: clear" in bench.shown


def test_who_runs_a_program_waits_for_no_check_of_others(bench: Bench) -> None:
    ended = threading.Event()
    others = [program_run._LOOKING.submit(ended.wait, 10) for _ in range(3)]

    async def both() -> None:
        looking = asyncio.create_task(bench.run.check())
        await asyncio.sleep(0)
        start = bench.run._session.snapshot.q_command
        assert await bench.run._check(await bench.run._program(), start, to_run=True) == []
        assert not any(other.done() for other in others)
        assert not looking.done()
        ended.set()
        assert await looking == []

    bench.put(HOME)
    asyncio.run(both())
    assert "Pre-flight: clear" in bench.shown


def test_a_check_that_was_cancelled_can_be_asked_for_again(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object, **__: object) -> list[Finding]:
        raise StateError("the check was cancelled")

    monkeypatch.setattr("armctl.ui.tabs.manual.program_run.check_program_apart", refused)
    bench.put(HOME)
    with pytest.raises(StateError):
        asyncio.run(bench.run.check())
    monkeypatch.undo()
    asyncio.run(bench.run.check())
    assert "Pre-flight" in bench.shown
