"""Work in a process of its own is bounded, ends when nobody waits for it, and takes no time of others."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from armctl.apart import GIVEN_UP, Tell, apart, is_given_up
from armctl.errors import LimitError, RobotFileError, StateError
from armctl.process.heavy_work import check_program_apart
from armctl.program import MoveStep, Program, check_program
from armctl.robot import load_robot

PATIENCE_S = 60.0
STEPS = 1500 if os.environ.get("ARMCTL_LONG") else 250


def doubled(request: bytes, tell: Tell) -> bytes:
    sys.stdout.write("what a library prints is no result")
    for part in (b"a", b"b"):
        tell(part)
    return 2 * request


def refuses(request: bytes, tell: Tell) -> bytes:
    raise RobotFileError(f"not with {request!r}")


def breaks(request: bytes, tell: Tell) -> bytes:
    raise RuntimeError("a defect")


def runs_for_ever(request: bytes, tell: Tell) -> bytes:
    tell(str(os.getpid()).encode())
    while True:
        pass


def takes_all_memory(request: bytes, tell: Tell) -> bytes:
    kept: list[np.ndarray] = []
    while True:
        kept.append(np.zeros(256 << 20, np.uint8))  # nobody writes to it: the bound is one of addresses


def is_nice(request: bytes, tell: Tell) -> bytes:
    return str(os.nice(0)).encode()


def work(name: str) -> str:
    return f"{__name__}:{name}"


def gone(pid: int) -> bool:
    """Whether a process has ended, or is only still to be waited for by its parent."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


def ends(pid: int) -> None:
    end = time.monotonic() + PATIENCE_S
    while not gone(pid):
        assert time.monotonic() < end
        os.sched_yield()


def test_a_result_and_what_is_told_on_the_way() -> None:
    told: list[bytes] = []
    assert apart(work("doubled"), b"x" * 3_000_000, seconds=60, told=told.append) == b"x" * 6_000_000
    assert told == [b"a", b"b"]


def test_a_refusal_arrives_as_it_was() -> None:
    with pytest.raises(RobotFileError, match=r"^not with b'this'$"):
        apart(work("refuses"), b"this", seconds=60)


def test_a_defect_is_logged_and_refused_in_words(caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(LimitError, match="log has the details"):
        apart(work("breaks"), b"", seconds=60)
    assert "RuntimeError: a defect" in caplog.text


def test_others_go_first() -> None:
    assert int(apart(work("is_nice"), b"", seconds=60)) >= os.nice(0) + 10


def test_its_processor_time_is_bounded() -> None:
    told: list[bytes] = []
    with pytest.raises(LimitError, match="more than 4 s of the processor"):  # it begins with imports
        apart(work("runs_for_ever"), b"", seconds=4, told=told.append)
    ends(int(told[0]))


def test_its_memory_is_bounded() -> None:
    with pytest.raises(LimitError, match="more than 3 GiB of memory"):
        apart(work("takes_all_memory"), b"", seconds=60)


def test_it_ends_as_soon_as_nobody_wants_it() -> None:
    told: list[bytes] = []

    def look() -> None:
        if told:
            raise StateError("cancelled")

    with pytest.raises(StateError, match="cancelled"):
        apart(work("runs_for_ever"), b"", seconds=PATIENCE_S, told=told.append, look=look)
    ends(int(told[0]))


def test_it_ends_where_it_is_given_up() -> None:
    told: list[bytes] = []
    given_up = threading.Event()

    def tell(pid: bytes) -> None:
        told.append(pid)
        given_up.set()

    token = GIVEN_UP.set(given_up)
    try:
        assert not is_given_up()
        with pytest.raises(LimitError, match="cancelled"):
            apart(work("runs_for_ever"), b"", seconds=PATIENCE_S, told=tell)
        assert is_given_up() and gone(int(told[0]))
    finally:
        GIVEN_UP.reset(token)


def test_it_ends_when_who_asked_is_killed() -> None:
    ask = (
        f"import sys; sys.path[:] = {sys.path!r}; from armctl.apart import apart;"
        f"apart({work('runs_for_ever')!r}, b'', seconds=60, told=lambda pid: print(pid.decode(), flush=True))"
    )
    asker = subprocess.Popen([sys.executable, "-c", ask], stdout=subprocess.PIPE)
    assert asker.stdout is not None
    pid = int(asker.stdout.readline())
    asker.kill()
    asker.wait()
    asker.stdout.close()
    ends(pid)


def long_program(steps: int) -> tuple[Program, np.ndarray]:
    robot, rng = load_robot("uzuner"), np.random.default_rng(1)
    home = robot.pose("home")
    poses = np.degrees(home) + rng.uniform(-5, 5, (steps, 5))
    return Program(robot="uzuner", steps=tuple(MoveStep(joints_deg=tuple(q)) for q in poses.tolist())), home


def test_a_long_check_finds_the_same_and_takes_its_time_elsewhere() -> None:
    program, home = long_program(STEPS)
    robot, told = load_robot("uzuner"), list[tuple[int, int]]()
    begun = time.process_time()
    here = check_program(program, robot, start=home)
    cost, begun = time.process_time() - begun, time.process_time()
    found = check_program_apart(program, robot, start=home, progress=lambda done, of: told.append((done, of)))
    assert found == here and found
    assert time.process_time() - begun < 0.5 * cost
    assert told[0][1] == STEPS and told[-1][0] > STEPS / 1.5 and told == sorted(told)


def test_a_long_check_can_be_left() -> None:
    program, home = long_program(15_000)
    left = threading.Event()

    def progress(done: int, _: int) -> None:
        left.set()
        raise StateError("it is outdated")

    with pytest.raises(StateError, match="it is outdated"):
        check_program_apart(program, load_robot("uzuner"), start=home, progress=progress)
    assert left.is_set()


def test_values_that_no_file_holds_are_told_as_ever() -> None:
    program, home = long_program(40)
    steps = (*program.steps, MoveStep(joints_deg=(float("nan"),) * 5))
    odd = Program(robot="uzuner", steps=steps)
    robot = load_robot("uzuner")
    assert check_program_apart(odd, robot, start=home) == check_program(odd, robot, start=home)
