"""The real Firmata driver and a simulated Mega on the controller's own clock, on bad lines."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.runtime.board_bench import BoardBench

from armctl.errors import StateError
from armctl.facts import State
from armctl.hardware.faults import Trouble, trouble
from armctl.hardware.firmata.codec import PinMode, pin_mode
from armctl.hardware.firmata.driver import FirmataDriver
from armctl.hardware.firmata.simulated import SimulatedFirmata
from armctl.hardware.transport import Connection
from armctl.protocol import Connect, Enable, MoveJoints, Release, SetOutput
from armctl.robot import Robot, load_robot, robots_folder

ABAAS = load_robot("abaas")
REST, HOME = ABAAS.pose("rest"), ABAAS.pose("home")


BUTTON = """
[[inputs]]
name = "button"
channel = 30
kind = "pull-up"
active_low = true
debounce_ms = 20
"""


def bench_of(*troubles: Trouble, robot: Robot = ABAAS) -> BoardBench[SimulatedFirmata]:
    bench = BoardBench.of(
        robot,
        SimulatedFirmata(),
        lambda line, now: FirmataDriver(Connection(line, now, simulated=True), 0.25, 0.2),
        troubles=troubles,
    )
    bench.do(Connect("sim"))
    return bench


def enable(bench: BoardBench[SimulatedFirmata]) -> None:
    bench.do(Enable(REST))
    bench.until(State.HOLDING)


def test_enable_on_a_late_line_is_no_board_that_switched_off() -> None:
    bench = bench_of(trouble("delay=0.06:1"))
    for _ in range(5):
        enable(bench)
        assert bench.run(1.0).state is State.HOLDING
        assert bench.now.warnings == ()
        bench.do(Release())


def test_a_few_lost_answers_are_told_and_the_arm_does_not_crawl() -> None:
    bench = bench_of(trouble("drop-reply:0.04@15"))
    enable(bench)
    bench.run(15.0)
    bench.do(MoveJoints(HOME, duration_s=8))
    began = bench.clock.now()
    bench.until(State.HOLDING)
    assert bench.now.cause == "move finished"
    assert bench.clock.now() - began < 8.5
    assert any("% of the questions" in words for words in bench.now.warnings)


def test_what_is_lost_for_a_third_of_a_second_stops_the_motion_and_says_so() -> None:
    bench = bench_of(trouble("drop-command@20+0.3"))
    enable(bench)
    bench.run(119.0 - bench.clock.now())
    motion = bench.do(MoveJoints(HOME, duration_s=8))
    bench.until(State.HOLDING)
    with pytest.raises(StateError, match=r"instead of the .* last sent: bytes were lost"):
        motion.result(0)
    bench.run(1.0)
    assert bench.now.state is State.HOLDING


def robot_with(folder: Path, more: str) -> Robot:
    text = (robots_folder() / "abaas.toml").read_text(encoding="utf-8")
    path = folder / "abaas.toml"
    path.write_text(text + more, encoding="utf-8")
    return load_robot(path)


@pytest.mark.parametrize("troubles", [(), ("drop@20+0.3",)], ids=["sound", "silent"])
def test_a_button_that_nobody_presses_is_never_read_as_pressed(tmp_path: Path, troubles: list[str]) -> None:
    bench = bench_of(*map(trouble, troubles), robot=robot_with(tmp_path, BUTTON))
    assert bench.now.inputs.get("button") in (0.0, None)
    enable(bench)
    seen = {bench.run(0.02).inputs.get("button") for _ in range(round((125.0 - bench.clock.now()) / 0.02))}
    assert seen == {0.0} and bench.now.edges == {"button": 0}
    bench.board.levels[30] = 0.0
    bench.run(0.2)
    assert bench.now.inputs == {"button": 1.0}


PUMP = """
[[outputs]]
name = "pump"
channel = 30
at_fault = "off"
at_stop = "off"
at_release = "off"
"""


def test_outputs_go_where_they_should_at_a_fault_that_the_board_has_told(tmp_path: Path) -> None:
    bench = bench_of(robot=robot_with(tmp_path, PUMP))
    enable(bench)
    bench.do(SetOutput("pump", 1.0))
    bench.run(0.2)
    assert bench.board.value(30) == 1
    bench.board.feed(pin_mode(3, PinMode.OUTPUT))  # another program lets go of the shoulder
    bench.until(State.FAULT)
    assert "no longer drives pin 3" in bench.now.cause
    assert bench.board.value(30) == 0
    assert any("off at the fault" in event.text for event in bench.now.events)
