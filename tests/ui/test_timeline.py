"""The motion to the next pose over time, as it is drawn under the scene."""

from __future__ import annotations

import re

import numpy as np
import pytest
from tests.ui.page_kit import FakePage

from armctl.motion import plan_joints
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.next_pose import PoseWriter
from armctl.ui.timeline import QUANTITIES, Timeline, track

UZUNER = load_robot("uzuner")
HOME = UZUNER.pose("home")
THERE = HOME + np.radians([40.0, -10.0, 20.0, 0, 15.0])


def shown(page: FakePage) -> str:
    return page.parts["timeline"]


class Bench:
    def __init__(self, server: GuardedServer, *, kept: str | None = None) -> None:
        self.page = FakePage(server, UZUNER, HOME)
        self.kept: dict[str, str] = {} if kept is None else {"timeline": kept}
        self.page.recall = self._recall  # type: ignore[attr-defined]
        self.page.remember = self.kept.__setitem__  # type: ignore[attr-defined]
        self.page.act(lambda: setattr(self, "line", Timeline(self.page.session)))
        self.writer = PoseWriter(self.page.session, "somebody")

    async def _recall(self, key: str) -> str | None:
        return self.kept.get(key)

    def refresh(self) -> None:
        self.page.refresh(self.line)  # type: ignore[attr-defined]

    def do(self, what: str, key: str = "", value: str = "") -> None:
        self.page.act(lambda: self.page.parts.done(what, key, value))

    def set(self, q: np.ndarray) -> None:
        self.page.act(lambda: self.writer.show(q))
        self.refresh()


@pytest.mark.parametrize("name", ["uzuner", "ur5"])
def test_what_is_drawn_are_the_derivatives_of_the_motion_and_the_tool(name: str) -> None:
    robot = load_robot(name)
    start = robot.pose("home")
    motion = plan_joints(robot, start, start + 0.2, checked=False)
    t = np.linspace(0.0, motion.duration, 2001)
    drawn = {quantity: track(robot, motion, quantity, t).values for quantity in QUANTITIES}
    assert drawn["Angle"] == pytest.approx(np.degrees(motion.sample(t).q))
    for rate, of in (("Speed", "Angle"), ("Accel.", "Speed")):
        differences = np.gradient(drawn[of], t, axis=0)[2:-2]
        assert np.abs(differences - drawn[rate][2:-2]).max() < 0.01 * np.abs(drawn[rate]).max()
    assert drawn["Tool"] == pytest.approx(1000 * robot.forward(motion.sample(t).q)[:, :3, 3])
    share = np.abs(drawn["Speed"]).max(axis=0) / np.degrees(robot.speed_limits)
    told = track(robot, motion, "Speed", t).nearest
    assert (
        told == f"{robot.joints[int(share.argmax())].title} at {100 * share.max():.0f} % of its speed limit"
    )


def test_it_is_folded_until_somebody_opens_it_and_the_browser_remembers(server: GuardedServer) -> None:
    bench = Bench(server)
    bench.set(THERE)
    assert "<svg viewBox='0 0 1000" not in shown(bench.page) and ">Graph<" in shown(bench.page)
    bench.do("timeline")
    assert "<svg viewBox='0 0 1000" in shown(bench.page) and bench.kept == {"timeline": "open"}
    bench.page.next.clear()
    bench.refresh()
    assert "is drawn here" in shown(bench.page)  # as high as before
    bench.do("timeline")
    assert bench.kept == {"timeline": "folded"}
    again = Bench(server, kept="open")
    again.set(THERE)
    assert "<svg viewBox='0 0 1000" in shown(again.page)


def test_the_cursor_moves_a_ghost_that_is_never_sent(server: GuardedServer) -> None:
    bench = Bench(server, kept="open")
    bench.set(THERE)
    page, motion = bench.page, bench.page.next.trajectory
    assert motion is not None and f"/ {motion.duration:.2f} s" in shown(page)
    bench.do("timeline-at", "", "250")
    q = motion.sample(0.25 * motion.duration).q
    assert page.ghost.seen and page.ghost.q is not None and page.ghost.q == pytest.approx(q)
    figures = re.findall(r"<b>(.*?)</b>", shown(page))
    assert figures == [f"{angle:.1f}".replace("-", "−") for angle in np.round(np.degrees(q), 1) + 0.0]
    assert page.next.q is not None and np.array_equal(page.next.q, THERE)
    for quantity in QUANTITIES:
        bench.do("timeline-shows", quantity)
        assert f"chip on' data-do='timeline-shows' data-key='{quantity}'" in shown(page)
    for garbage in ("", "nan", "x", "1e999"):
        bench.do("timeline-at", "", garbage)
    bench.do("timeline-shows", "Nonsense")
    bench.do("timeline-at", "", "5000")  # beyond the end: the end
    assert not page.ghost.seen
    bench.do("timeline-at", "", "100")
    bench.set(THERE + 0.05)  # another motion
    assert not page.ghost.seen and page.sent == []
