from __future__ import annotations

import re
from dataclasses import replace

import pytest
from tests.runtime.kit import make_rig

from armctl.facts import Quantities, State
from armctl.hardware import BoardIdentity
from armctl.protocol import AxisHoming, Snapshot
from armctl.robot import load_robot
from armctl.ui import PortChoice
from armctl.ui.enabling import enable_note
from armctl.ui.tabs.main.boards import board_html, homing_html, ports_html
from armctl.ui.widgets.motors import motors_html


def words(html: str) -> str:
    return " ".join(re.sub("<[^>]*>|&nbsp;", " ", html).split())


@pytest.fixture
def snapshot() -> Snapshot:
    return make_rig(robot=load_robot("scorbot")).now


def test_boards_are_listed_with_serial_number_and_why_one_cannot_be_used() -> None:
    ports = [
        PortChoice("sim", "Simulated board"),
        PortChoice("/dev/ttyACM0", "Arduino Mega", None, "8573", listed=True),
        PortChoice("/dev/ttyACM1", "Micro Maestro", "no permission", notes=("a <note>",), listed=True),
    ]
    assert words(ports_html(ports)) == (
        "Arduino Mega · serial number 8573 Micro Maestro Cannot be used: no permission. A &lt;note&gt;."
    )


def test_what_is_connected_is_told_with_its_notes(snapshot: Snapshot) -> None:
    assert words(board_html(snapshot)) == "Not connected."
    board = BoardIdentity("encoder board", "/dev/ttyACM0", "8573", notes=("motors & more",))
    assert words(
        board_html(replace(snapshot, board=board, quantities={"Base": Quantities(temperature_c=41.0)}))
    ) == ("encoder board on /dev/ttyACM0 · serial number 8573 Motor Heat °C Base 41 Motors &amp; more.")


def test_what_motors_measure_stands_in_a_table_with_a_dash_where_one_measures_nothing() -> None:
    measured = {"Base": Quantities(load=-0.123, current_a=0.5), "J<aw": Quantities(load=0.0)}
    assert words(motors_html(measured)) == "Motor Load % Current A Base −12 0.50 J&lt;aw 0 –"
    assert motors_html({"Base": Quantities()}) == motors_html({}) == ""


def test_homing_shows_every_axis(snapshot: Snapshot) -> None:
    assert homing_html(snapshot) == ""
    state = (("Waist", True, False), ("Elbow", False, True), ("R<oll", False, False))
    axes = tuple(AxisHoming(*axis) for axis in state)
    assert words(homing_html(replace(snapshot, homing=axes))) == "Homed 1 of 3: ✓ Waist … Elbow ○ R&lt;oll"


@pytest.mark.parametrize(
    ("board", "powered", "homed", "said"),
    [
        ("maestro", False, None, "asks where the arm stands"),
        ("maestro", True, None, "takes the arm over where it stands"),
        ("firmata", True, None, "takes the arm over where it stands"),
        ("encoder", False, False, "moves every axis slowly to its home switch"),
        ("encoder", False, None, "moves every axis slowly to its home switch"),
        ("encoder", True, False, "The motors are on and hold the arm where it stands"),
        ("encoder", False, True, "they hold the arm where it stands"),
    ],
)
def test_what_enable_will_do(
    snapshot: Snapshot, board: str, powered: bool, homed: bool | None, said: str
) -> None:
    homing = () if homed is None else (AxisHoming("Waist", homed, False),)
    assert said in enable_note(replace(snapshot, powered=powered, homing=homing), board)
    lost = replace(snapshot, state=State.FAULT, board=None)
    assert "Connect is in Main" in enable_note(lost, "encoder")
    again = "The board is plugged in again (/dev/ttyACM1). Press Connect in Main."
    assert again in enable_note(lost, "encoder", "/dev/ttyACM1")
    there = replace(lost, board=BoardIdentity("encoder board", "/dev/ttyACM0"))
    assert "Connect" not in enable_note(there, "encoder")
    assert "the line above says what to do" in enable_note(replace(there, unreachable=True), board)
