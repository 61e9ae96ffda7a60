"""Joints that a hand leads: only where the board can, by name, and never without a tick."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest
from tests.ui.page_kit import FakePage

from armctl.errors import InputError
from armctl.hardware import BoardIdentity, Source
from armctl.protocol import Enable, Release
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.manual.by_hand import ByHand, can_be_led

ROBOT = load_robot("so101")
ABLE = BoardIdentity("servo bus", "sim", abilities=("release_channels", "limit_torque"))
UNABLE = BoardIdentity("Maestro", "sim", abilities=("release_channels",))


@pytest.fixture
def page(server: GuardedServer) -> FakePage:
    page = FakePage(server, ROBOT, np.zeros(ROBOT.n))
    vars(page.snapshot).update(board=ABLE, source=Source.MEASURED, limp=())
    return page


@pytest.fixture
def by_hand(page: FakePage) -> Iterator[ByHand]:
    yield ByHand(page.session)


def test_ticked_joints_go_limp_by_name_and_all_come_back(page: FakePage, by_hand: ByHand) -> None:
    with pytest.raises(InputError, match="no joint is ticked"):
        page.press("Let ticked joints go limp")
    for name in ("shoulder_lift", "wrist_flex"):
        vars(by_hand)["_ticks"][name].value = True
    page.press("Let ticked joints go limp")
    page.press("Take them back as they stand")
    assert page.sent == [Release(("shoulder_lift", "wrist_flex")), Enable()]


def test_nothing_goes_limp_before_a_joint_is_ticked(page: FakePage, by_hand: ByHand) -> None:
    (also,) = [
        one.also for one in page.offers if one.also and "ticked" in str(one.also(page.session.snapshot))
    ]
    vars(by_hand)["_ticks"]["wrist_flex"].value = True
    assert also(page.session.snapshot) is None


def test_it_says_which_joints_are_limp(page: FakePage, by_hand: ByHand) -> None:
    vars(page.snapshot).update(limp=("Wrist <flex",))
    page.refresh(by_hand)
    assert "Limp: Wrist &lt;flex." in page.html


@pytest.mark.parametrize(
    ("board", "source"),
    [
        (None, Source.MEASURED),
        (UNABLE, Source.TRANSMITTED),
        (BoardIdentity("encoders", "x"), Source.MEASURED),
    ],
)
def test_it_is_offered_only_where_single_joints_can_be_limp_and_measured(
    board: BoardIdentity | None, source: Source
) -> None:
    assert not can_be_led(SimpleNamespace(board=board, source=source))  # type: ignore[arg-type]
    assert can_be_led(SimpleNamespace(board=ABLE, source=Source.MEASURED))  # type: ignore[arg-type]


def test_where_points_are_touched_it_says_what_to_do_once_the_arm_has_sunk(page: FakePage) -> None:
    ByHand(page.session, hint="it sinks: step it back")
    assert "it sinks: step it back" in page.html
