"""A gamepad, a 3D mouse, two thumbs: what is pushed becomes a jog inside all limits, while it is held."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from tests.runtime.kit import TICK
from tests.ui.page_kit import FakePage

from armctl.errors import ArmctlError, StateError
from armctl.protocol import Jog, JogTool, MoveGripper
from armctl.protocol.commands import JOG_EXPIRY_S
from armctl.protocol.snapshot import Doing
from armctl.robot import load_robot
from armctl.runtime.jog import Jogger
from armctl.runtime.joint_servo import KeepClear
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.manual.sticks import FORWARD, LEFT, LIFT, RESTS_S, TURN, UP, StickAim, StickJog

LONG = bool(os.environ.get("ARMCTL_LONG"))
UZUNER, UR5, SCORBOT = load_robot("uzuner"), load_robot("ur5"), load_robot("scorbot")
RATES = 0.03, 0.25
"""along [m/s], about [rad/s]"""


def pushed(**axes: float) -> np.ndarray:
    """(6,)"""
    of = {"forward": FORWARD, "left": LEFT, "up": UP, "turn": TURN, "lift": LIFT}
    found = np.zeros(6)
    for name, value in axes.items():
        found[of[name]] = value
    return found


def tool(aim: StickAim, **axes: float) -> JogTool:
    command = aim.tool(pushed(**axes), RATES, "base")
    assert command is not None
    return command


def test_a_stick_moves_the_tool_as_fast_as_it_is_pushed() -> None:
    aim = StickAim(UZUNER)
    np.testing.assert_allclose(tool(aim, forward=1.0).linear, [0.03, 0, 0])
    np.testing.assert_allclose(tool(aim, forward=0.5).linear, [0.015, 0, 0])
    np.testing.assert_allclose(tool(aim, left=-0.4).linear, [0, -0.012, 0])
    np.testing.assert_allclose(tool(aim, up=1.0, left=0.1).linear, [0, 0, 0.03], atol=1e-9)
    assert np.linalg.norm(tool(aim, forward=1.0, left=1.0).linear) == pytest.approx(0.03)
    assert aim.tool(np.zeros(6), RATES, "base") is None


def test_a_hand_that_wavers_keeps_its_direction_and_one_that_turns_changes_it() -> None:
    aim = StickAim(UZUNER)
    first = tool(aim, forward=1.0).linear
    for degrees in (10, -20, 25, 29, -29):
        now = tool(aim, forward=np.cos(np.radians(degrees)), left=np.sin(np.radians(degrees))).linear
        np.testing.assert_allclose(now, first)
    np.testing.assert_allclose(tool(aim, forward=0.7, left=0.7).linear[:2], [0.021, 0.021], atol=3e-4)
    aim.let_go()
    np.testing.assert_allclose(tool(aim, forward=0.9, left=0.2).linear[1:], [0, 0])


def test_turning_is_what_the_arm_can() -> None:
    aim = StickAim(UZUNER)
    assert tool(aim, turn=-0.5).roll_rate == pytest.approx(-0.125)
    assert tool(aim, lift=1.0, forward=0.3).pitch_rate == pytest.approx(0.25)
    assert [name for _, name in aim.moved(joints=False)] == ["X", "Y", "Z", "Roll", "Pitch"]
    assert [name for _, name in aim.moved(joints=True)] == [joint.title for joint in UZUNER.joints]
    scara = StickAim(load_robot("uarm"))  # its tool stays level
    assert scara.tool(pushed(lift=1.0), RATES, "base") is None
    assert "Pitch" not in dict(map(reversed, scara.moved(joints=False)))


def test_joints_turn_all_at_once() -> None:
    command = StickAim(UR5).joints(pushed(left=1.0, forward=-0.5, up=0.2), 0.2)
    assert command is not None
    np.testing.assert_allclose(command.rate, [0.2, -0.1, 0.04, 0, 0, 0])
    assert StickAim(UR5).joints(np.zeros(6), 0.4) is None


JOGGED = Doing("jog", pausable=False, gripping=False, stopping=False, jogged=True)


class Pushing:
    """A page with the sticks switched on, and what it has sent."""

    def __init__(self, server: GuardedServer) -> None:
        self.page = FakePage(server, UZUNER, UZUNER.pose("home"))
        self.page.require_operator = lambda: None  # type: ignore[attr-defined]
        self.page.snapshot.doing = JOGGED
        self.now = 100.0
        self.sent: list[Jog | JogTool] = []
        self.refusal: ArmctlError | None = None
        self.sticks = StickJog(self.page.session, self._send, lambda: 0.25, lambda: RATES, lambda: self.now)
        self.page.press(str(self.sticks._switch.label))

    async def _send(self, command: Callable[[], Jog | JogTool]) -> None:
        self.sent.append(command())
        if self.refusal is not None:
            raise self.refusal

    def says(self, *axes: float, late_s: float = 0.0) -> None:
        """The page says what is pushed; it is read ``late_s`` later."""
        told = [*axes, *[0.0] * (6 - len(axes)), 1000 * (self.now - 40.0)]
        self.now += late_s
        asyncio.run(self.page.parts.done("sticks", "", " ".join(f"{one:.2f}" for one in told)))

    def lets_go(self, said: str = "let go") -> None:
        asyncio.run(self.page.parts.done("sticks", "", said))


@pytest.fixture
def pushing(server: GuardedServer) -> Pushing:
    return Pushing(server)


def test_letting_go_is_sent_once_and_at_once(pushing: Pushing) -> None:
    for _ in range(3):
        pushing.says(1.0)
    assert [type(one) for one in pushing.sent] == [JogTool] * 3
    pushing.lets_go()
    assert isinstance(last := pushing.sent[-1], Jog) and not last.rate.any()
    pushing.lets_go()
    pushing.says()
    assert len(pushing.sent) == 4
    pushing.says(0.0, 1.0)
    pushing.says()  # still held, and the stick is back in its middle
    assert isinstance(last := pushing.sent[-1], Jog) and not last.rate.any()


@pytest.mark.parametrize("doing", [None, replace(JOGGED, stopping=True)])
def test_after_a_stop_nothing_is_sent(pushing: Pushing, doing: Doing | None) -> None:
    pushing.says(1.0)
    pushing.lets_go("stopped")  # by its own button: the snapshot does not tell yet
    assert len(pushing.sent) == 1
    pushing.says(1.0)
    pushing.page.snapshot.doing = doing
    pushing.lets_go()
    assert len(pushing.sent) == 2


def test_what_was_pushed_long_ago_is_not_done(pushing: Pushing) -> None:
    pushing.says(1.0)
    pushing.says(1.0, late_s=0.5)
    assert len(pushing.sent) == 1
    pushing.says(1.0)  # in time again
    assert len(pushing.sent) == 2
    pushing.lets_go()
    pushing.says(1.0)
    assert len(pushing.sent) == 4


@pytest.mark.parametrize(
    "value", ["1 2", "2 0 0 0 0 0 5", "x 0 0 0 0 0 5", "nan 0 0 0 0 0 5", "1e400 0 0 0 0 0 5"]
)
def test_nothing_else_than_six_numbers_and_a_time_moves_the_arm(pushing: Pushing, value: str) -> None:
    with pytest.raises(ArmctlError, match="sticks"):
        asyncio.run(pushing.page.parts.done("sticks", "", value))
    assert pushing.sent == []


def test_switched_off_nothing_moves_and_a_page_that_watches_is_switched_off(pushing: Pushing) -> None:
    assert "data-sticks" in pushing.page.parts["sticks"]
    pushing.page.operates = False
    pushing.page.act(lambda: pushing.sticks.refresh(pushing.page.snapshot))  # type: ignore[arg-type]
    assert "data-sticks" not in pushing.page.parts["sticks"]
    pushing.says(1.0)
    asyncio.run(pushing.page.parts.done("sticks-jaw", "", "open"))
    assert pushing.sent == [] and pushing.page.sent == []


def test_the_hand_feels_that_the_arm_is_held_back(pushing: Pushing) -> None:
    pushing.says(1.0)
    pushing.page.snapshot.doing = replace(JOGGED, notice="jog: Elbow at the limit")
    pushing.page.act(lambda: pushing.sticks.refresh(pushing.page.snapshot))  # type: ignore[arg-type]
    assert "data-sticks='held'" in pushing.page.parts["sticks"]
    pushing.lets_go()
    pushing.page.act(lambda: pushing.sticks.refresh(pushing.page.snapshot))  # type: ignore[arg-type]
    assert "data-sticks=''" in pushing.page.parts["sticks"]


def test_its_name_is_shown_and_its_buttons_move_the_gripper(pushing: Pushing) -> None:
    assert "No gamepad" in pushing.page.parts["sticks"]
    asyncio.run(pushing.page.parts.done("sticks-seen", "", "Pad <b>"))
    assert "Pad &lt;b&gt;" in pushing.page.parts["sticks"]
    for what in ("open", "close", "sing"):
        asyncio.run(pushing.page.parts.done("sticks-jaw", "", what))
    assert [cast(MoveGripper, one).opening for one in pushing.page.sent] == [1.0, 0.0]


def test_a_refusal_is_raised(pushing: Pushing) -> None:
    pushing.refusal = StateError("the arm is off; enable first")
    with pytest.raises(StateError):
        pushing.says(1.0)


def test_it_says_how_soon_the_arm_rests(pushing: Pushing) -> None:
    assert "the arm rests within 0.1 s" in pushing.page.parts["sticks"]


def test_no_joint_is_led_faster_than_it_can_rest_from() -> None:
    most = 0.06 * UZUNER.acceleration_limits / UZUNER.speed_limits  # 0.04 s until it brakes
    command = StickAim(UZUNER).joints(np.ones(6), 1.0)
    assert command is not None
    np.testing.assert_allclose(command.rate, np.minimum(most, 1.0))
    half = StickAim(UZUNER).joints(0.5 * np.ones(6), 1.0)
    assert half is not None  # the stick keeps its feel
    np.testing.assert_allclose(half.rate, 0.5 * command.rate)


AXIS = st.sampled_from([0.0, 0.0, 0.0, 0.3, -0.7, 1.0, -1.0])
HANDS = st.lists(
    st.tuples(st.booleans(), st.lists(AXIS, min_size=6, max_size=6), st.integers(1, 8)),
    min_size=1,
    max_size=12,
)


CLEAR = KeepClear(UZUNER)
AGAINST_ITSELF = [
    (True, [-1.0, -0.7, -1.0, 0.0, 0.0, 1.0], 5),
    (False, [0.0] * 6, 1),
    (True, [0.3, -0.7, 0.0, -0.7, -0.7, 1.0], 4),
    (True, [0.0, 1.0, 1.0, 0.0, 1.0, 0.3], 6),
    (True, [0.0, 1.0, 0.0, 1.0, 1.0, 0.0], 6),
    (True, [0.0, -0.7, 0.0, 0.0, 0.0, -1.0], 6),
    (True, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], 6),
]
"""the tool is pushed against the arm, which leads it beside its line"""


@example(AGAINST_ITSELF, "base", 0.08582905899092078, 0.3)
@given(HANDS, st.sampled_from(["base", "tool", None]), st.floats(0.005, 0.15), st.floats(0.05, 1.0))
@settings(max_examples=100_000 if LONG else 60, deadline=None)
def test_whatever_hands_do_no_limit_is_passed_and_the_arm_rests_soon_after_they_let_go(
    hands: list[tuple[bool, list[float], int]], frame: str | None, speed: float, share: float
) -> None:
    aim, arm = StickAim(UZUNER), Led()
    for held, axes, times in hands:
        if not held:
            aim.let_go()
            arm.let_go()
            continue
        values = np.array(axes)
        for _ in range(times):
            if frame is None:
                command = aim.joints(values, share)
            else:
                command = aim.tool(values, (speed, 8 * speed), "tool" if frame == "tool" else "base")
            arm.lead(command or Jog(np.zeros(5)), ticks=3)
    arm.let_go()


class Led:
    """A jogger on a clock of its own; at each tick no limit is passed."""

    def __init__(self) -> None:
        self.now, self.q, self.v = 0.0, UZUNER.pose("home"), np.zeros(5)
        self.jogger = Jogger(UZUNER, CLEAR, self.q, 1.0)

    def lead(self, command: Jog | JogTool, ticks: int) -> None:
        self.jogger.lead(command, self.now + JOG_EXPIRY_S)
        for _ in range(ticks):
            self.tick()

    def tick(self) -> None:
        self.now += TICK
        set_to = self.jogger.advance(self.now, TICK)
        q, v = (self.q, np.zeros(5)) if set_to is None else (set_to.q, set_to.velocity)
        assert (UZUNER.limits[:, 0] - 1e-9 <= q).all() and (q <= UZUNER.limits[:, 1] + 1e-9).all()
        assert (np.abs(v) <= UZUNER.speed_limits + 1e-9).all()
        assert (np.abs(v - self.v) <= UZUNER.acceleration_limits * TICK + 1e-9).all()
        self.q, self.v = q, v

    def let_go(self) -> None:
        """It slows down from the next tick on, and rests as soon as it says."""
        self.jogger.lead(Jog(np.zeros(5)), self.now + JOG_EXPIRY_S)
        for _ in range(round(RESTS_S / TICK) - 1):  # what is said is taken at the next tick
            self.tick()
        assert not self.v.any()
