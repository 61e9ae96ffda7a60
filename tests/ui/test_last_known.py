from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.runtime.kit import make_rig

from armctl.errors import BoardTimeoutError
from armctl.facts import State
from armctl.protocol import AxisHoming, Connect, Enable, Release
from armctl.robot import load_robot
from armctl.ui.console import LastKnown, known

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home")


@pytest.fixture
def last_known() -> LastKnown:
    return LastKnown()


def test_an_arm_of_which_nothing_was_known_is_drawn_where_enable_leads_to(last_known: LastKnown) -> None:
    snapshot = make_rig().now
    last_known.note(snapshot)
    assert np.array_equal(last_known.drawn(snapshot), ROBOT.first_pose)
    assert last_known.words(snapshot, "maestro") == "unknown; drawn where Enable would put it"
    assert last_known.words(snapshot, "encoder") == "unknown until the arm is homed; drawn where homing ends"
    assert not last_known.remembers(snapshot)


def test_a_lost_arm_stays_where_it_was_last_known_until_it_is_enabled_again(last_known: LastKnown) -> None:
    rig = make_rig().enable(HOME)
    last_known.note(rig.run(0.1))
    assert last_known.words(rig.now, "maestro") == "transmitted"
    rig.driver.fail["read"] = BoardTimeoutError("nobody answers")
    lost = rig.until(lambda snapshot: snapshot.state is State.FAULT)
    last_known.note(lost)
    assert np.abs(lost.q_command - HOME).max() > 0.1  # where Enable would put it is somewhere else
    assert last_known.drawn(lost) == pytest.approx(HOME, abs=0.01)
    assert np.array_equal(last_known.standing(lost), last_known.drawn(lost))
    assert last_known.words(lost, "maestro") == "last known; unknown until the arm is enabled again"
    assert last_known.remembers(lost)

    rig.driver.fail.clear()
    rig.driver.positions.clear()  # the board has started anew
    rig.do(Connect("sim"))
    assert rig.run(0.1).state is State.OFF
    last_known.note(rig.now)
    assert last_known.drawn(rig.now) == pytest.approx(HOME, abs=0.01)
    rig.finishes(Enable())
    last_known.note(rig.run(0.1))
    assert last_known.drawn(rig.now) == pytest.approx(ROBOT.pose("rest"), abs=0.01)
    assert np.array_equal(last_known.standing(rig.now), rig.now.q_command)
    assert last_known.words(rig.now, "maestro") == "transmitted"
    assert not last_known.remembers(rig.now)


def test_a_released_arm_is_drawn_where_it_was_known_last(last_known: LastKnown) -> None:
    rig = make_rig().enable(HOME)
    last_known.note(rig.now)
    unread = replace(rig.now, q=np.full(5, np.nan))
    assert known(unread) == pytest.approx(HOME)  # what was commanded stands for what the board does not tell
    assert last_known.words(unread, "firmata") == "commanded"
    rig.do(Release())
    last_known.note(rig.run(0.1))
    assert rig.now.state is State.OFF
    assert last_known.drawn(rig.now) == pytest.approx(HOME, abs=0.01)
    assert last_known.remembers(rig.now)


def test_each_joint_is_known_by_itself_while_the_arm_is_homed(last_known: LastKnown) -> None:
    snapshot = make_rig(robot=load_robot("scorbot")).now
    stood = np.radians([10.0, -20.0, 30.0, 40.0, 50.0])
    last_known.note(replace(snapshot, q=stood))
    axes = tuple(AxisHoming(f"axis {i}", i == 0, i == 1) for i in range(5))
    homing = replace(snapshot, q=np.array([0.5, *[np.nan] * 4]), homing=axes)
    last_known.note(homing)
    assert last_known.drawn(homing) == pytest.approx([0.5, *stood[1:]])
    assert last_known.words(homing, "encoder") == "last known; unknown until the arm is homed again"
