"""Forward in random sequences of moves, edits and reloads: what is said and drawn is what is sent."""

from __future__ import annotations

import os
import re

import numpy as np
import pytest
from tests.ui.page_kit import FakePage

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.facts import State
from armctl.kinematics import Target
from armctl.protocol import MoveJoints
from armctl.robot import Robot, load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.next_pose import PoseWriter
from armctl.ui.tabs.forward import screen as forward_screen
from armctl.ui.tabs.forward.figures import LAST, REFERENCE, SHOWN
from armctl.ui.tabs.forward.screen import CoupledJoints, ForwardScreen
from armctl.ui.widgets import number_field

ROBOT = load_robot("uzuner")
LOW, HIGH = ROBOT.limits.T
SEQUENCES = 100 if os.environ.get("ARMCTL_LONG") else 6
STEPS = 25
FOLLOWS = "The fields follow the arm until you edit them."


class Bench:
    """One page, and somebody else who moves the arm."""

    def __init__(self, server: GuardedServer, seed: int) -> None:
        self.server, self.random = server, np.random.default_rng(seed)
        self.present = ROBOT.pose("home")
        self.reload()

    def reload(self) -> None:
        self.server.gui.reset()
        self.page = FakePage(self.server, ROBOT, self.present)
        self.page.ghost.see("Forward")
        self.screen = ForwardScreen(self.page.session)
        self.other = PoseWriter(self.page.session, "another screen")
        self.edited = False

    def refresh(self) -> None:
        self.page.snapshot.q_command = self.page.snapshot.q = self.present
        self.page.refresh(self.screen)

    def another_moves(self) -> None:
        there = self.random.uniform(LOW, HIGH)
        for part in (0.3, 0.7, 1.0):
            self.present = self.present + part * (there - self.present)
            self.page.snapshot.state, self.page.snapshot.busy = State.MOVING, True
            if self.random.random() < 0.7:
                self.refresh()
        self.page.snapshot.state, self.page.snapshot.busy = State.HOLDING, False

    def type_angle(self) -> None:
        self.edited = True
        joint = ROBOT.joints[self.random.integers(ROBOT.n)]
        angle = np.degrees(self.random.uniform(joint.lower - 0.2, joint.upper + 0.2))
        self.page.put(f"{joint.title} °", self.random.choice(["", "4,5"], p=[0.5, 0.5])
                      if self.random.random() < 0.15 else f"{angle:.2f}")  # fmt: skip

    def type_pose(self) -> None:
        self.edited = True
        self.page.put(f"{self.random.choice(list('XYZ'))} mm", f"{self.random.uniform(-300, 300):.1f}")

    def fill(self) -> None:
        what = str(self.random.choice(["present pose", "home", "zero"]))
        self.edited = what != "present pose"
        self.page.put("Fill with", what)

    def show_for(self) -> None:
        self.page.put("Show for", str(self.random.choice(SHOWN)))

    def another_tab(self) -> None:
        """Another screen writes the next pose, and the tab is opened again."""
        self.page.ghost.see("Inverse")
        self.page.next.set(self.random.uniform(LOW, HIGH), self.other)
        self.edited = False  # the fields show that pose now
        self.refresh()
        self.page.ghost.see("Forward")

    def forget(self) -> None:
        """The × of the next pose."""
        had_one = self.page.next.q is not None
        self.page.act(lambda: self.page.parts.done("forget", ""))
        self.edited = self.edited and not had_one

    def line_go(self) -> None:
        """The *Go* of the line of the next pose: it sends what is drawn."""
        drawn, before = self.page.next.q, len(self.page.sent)
        adds = self.screen._writer.shown and self.screen._shown.value == SHOWN[1]
        try:
            self.page.go()
        except ArmctlError:
            assert len(self.page.sent) == before
            return
        command = self.page.sent[-1]
        assert isinstance(command, MoveJoints) and drawn is not None and np.array_equal(command.q, drawn)
        if self.screen._writer.shown and not adds:
            self.edited = False
        self.present = command.q

    def row(self, name: str) -> FloatArray | None:
        """(n,) what the row for a button says [degrees, to 0.1]; None: it leads nowhere."""
        found = re.search(rf"<td>{name}</td>((?:<td[^>]*>[^<]*</td>)+)", self.page.html)
        if found is None:
            return None
        cells = re.findall(r">([^<]+)</td>", found.group(1).replace("−", "-"))
        if "–" in cells:
            return None
        return np.array([float(cell) for cell in cells[: ROBOT.n]])

    def looks_true(self) -> None:
        html, following = self.page.html, self.page.next
        assert (FOLLOWS in html) is not (self.edited or following.q is not None)
        reference, last = self.row("reference"), self.row("last")
        said = re.search(rf"The ghost shows the ({'|'.join(map(re.escape, SHOWN))})(, as it was then)?", html)
        assert (said is not None) is self.screen._writer.shown
        if said is not None:
            assert following.q is not None
            leads = last if said.group(1) == SHOWN[1] else reference
            as_now = leads is not None and bool(np.abs(np.degrees(following.q) - leads).max() < 0.06)
            assert as_now is (said.group(2) is None), "the arm has been moved since, or not"
        elif following.q is not None:  # another screen's, which the fields show
            assert "The fields show the next pose" in html and reference is not None
            assert np.abs(np.degrees(following.q) - reference).max() < 0.06
        elif reference is not None and self.screen._shown.value == SHOWN[0]:
            goal, inside = np.radians(reference), 1e-3
            outside = bool(((goal < LOW + inside) | (goal > HIGH - inside)).any())
            stands_there = np.abs(goal - self.present).max() < 2e-3
            assert outside or stands_there, "what the button would do is not drawn"

    def press(self, button: str) -> None:
        row = self.row("reference" if button == REFERENCE else "last")
        if button == REFERENCE and not self.edited and self.page.next.q is None:
            row = np.degrees(self.present)  # "it would stay where it is"
        before = len(self.page.sent)
        try:
            self.page.press(button)
        except ArmctlError:
            assert len(self.page.sent) == before
            return
        command = self.page.sent[-1]
        assert isinstance(command, MoveJoints) and row is not None
        assert np.abs(np.degrees(command.q) - row).max() < 0.06
        shown = self.page.shown_at_sending[-1]
        assert shown is None or np.array_equal(shown, command.q)
        assert shown is not None or np.abs(command.q - self.present).max() < 1e-3
        self.edited = True
        arrives = self.random.random() < 0.7 or np.abs(command.q - self.present).max() < 1e-9
        self.present = command.q if arrives else 0.5 * (self.present + command.q)
        if button == REFERENCE and arrives:
            self.edited = False  # once it is there the fields follow it again
            self.refresh()


@pytest.mark.parametrize("seed", range(SEQUENCES))
def test_what_is_said_and_drawn_is_what_the_buttons_do(
    server: GuardedServer, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(number_field, "_QUIET_S", 0.0)
    monkeypatch.setattr(number_field, "_SETTLE_S", 0.0)
    bench = Bench(server, seed)
    ways = (
        bench.another_moves, bench.another_moves, bench.type_angle, bench.type_angle, bench.type_pose,
        bench.fill, bench.show_for, bench.another_tab, bench.reload, bench.forget, bench.line_go,
        lambda: bench.press(REFERENCE), lambda: bench.press(LAST),
    )  # fmt: skip
    for _ in range(STEPS):
        ways[bench.random.integers(len(ways))]()
        bench.refresh()
        bench.looks_true()


def test_fields_that_follow_hold_the_pose_of_the_arm_to_all_digits(server: GuardedServer) -> None:
    bench = Bench(server, 0)
    for _ in range(5):
        bench.another_moves()
        bench.refresh()
        assert np.abs(bench.screen._angles.array - bench.present).max() < 1e-12
    bench.page.put("Base °", "12.5")
    held = bench.screen._angles.array
    bench.another_moves()
    bench.refresh()
    assert np.array_equal(bench.screen._angles.array, held)


def test_a_pose_out_of_reach_is_told_in_place_of_figures_and_velocities(
    server: GuardedServer,
) -> None:
    bench = Bench(server, 0)
    bench.page.put("Z mm", "700")
    bench.refresh()
    told = "The pose fields and the joint angles are not the same pose: too far by "
    assert bench.page.html.count(told) == 2 and "tool turns °/s" not in bench.page.html
    bench.page.put("Base", "20")  # a joint rate
    assert bench.page.html.count(told) == 2
    bench.page.put("Fill with", "home")
    bench.refresh()
    assert told not in bench.page.html and "tool turns °/s" in bench.page.html


def test_what_is_typed_before_the_tab_has_heard_of_a_motion_is_not_written_over(
    server: GuardedServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The pose is still being solved when the fields would follow the arm for the first time."""
    bench, solve, solved = Bench(server, 3), forward_screen.coupled_joints, list[Target]()
    bench.present = bench.present + np.radians([20.0, -5.0, 5.0, 0.0, 0.0])

    def solve_late(robot: Robot, target: Target, before: FloatArray) -> CoupledJoints:
        bench.refresh()
        solved.append(target)
        return solve(robot, target, before)

    monkeypatch.setattr(forward_screen, "coupled_joints", solve_late)
    bench.page.put("X mm", "150")
    bench.refresh()
    assert [1000 * target.position[0] for target in solved] == [150.0]
    assert bench.screen._coupling.pose.xyz.fields[0].text == "150"
