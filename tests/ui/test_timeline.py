"""The motion to the next pose over time, as it is drawn under the scene."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from tests.ui.page_kit import FakePage

from armctl.facts import State
from armctl.motion import plan_joints
from armctl.program import MoveStep, PointStep, Program, Step, WaitStep
from armctl.program.rehearsal import rehearse
from armctl.protocol import ProgramProgress
from armctl.robot import load_robot
from armctl.ui import timeline
from armctl.ui.guard import GuardedServer
from armctl.ui.next_pose import NextPoses, PoseWriter
from armctl.ui.tabs.manual import program_ahead
from armctl.ui.tabs.manual.program_ahead import MOST_STEPS, ProgramAhead
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.timeline import QUANTITIES, Timeline, track
from armctl.ui.widgets.graph import (
    Bound,
    Curves,
    Graph,
    PlotLine,
    PlotMark,
    graph_html,
    legend,
    plot_html,
)

UZUNER = load_robot("uzuner")
HOME = UZUNER.pose("home")
THERE = HOME + np.radians([40.0, -10.0, 20.0, 0, 15.0])


def shown(page: FakePage) -> str:
    return page.parts["timeline"]


class Bench:
    def __init__(self, server: GuardedServer, *, kept: str | None = None) -> None:
        self.page = FakePage(server, UZUNER, HOME)
        self.page.snapshot.program = None
        self.shared = SharedProgram("uzuner", Path("nowhere"))
        self.page.console.shared = {
            NextPoses: self.page.console.shared(NextPoses), SharedProgram: self.shared,
        }.__getitem__  # fmt: skip
        ahead = ProgramAhead(self.page.console)
        self.page.console.shared = {SharedProgram: self.shared, ProgramAhead: ahead}.__getitem__
        self.downloads: dict[str, str] = {}
        self.page.download = self.downloads.__setitem__  # type: ignore[attr-defined]
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
    assert "<svg viewBox='0 0 1000" not in shown(bench.page) and ">Graph<" in bench.page.parts["next"]
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


def to(*degrees: float) -> Step:
    return MoveStep(joints_deg=(degrees[0], *UZUNER.shown(HOME).tolist()[1:]))


def clips(page: FakePage) -> list[tuple[str, float, float]]:
    """Key, left edge and width [%] of each clip."""
    found = re.findall(r"left:([\d.]+)%;width:([\d.]+)%' data-do=step data-key=(\d+)", shown(page))
    return [(key, float(left), float(width)) for left, width, key in found]


class Played(Bench):
    """The program is drawn."""

    def __init__(self, server: GuardedServer, *steps: Step) -> None:
        super().__init__(server, kept="open")
        self.put(*steps)
        self.do("timeline-of", "program")
        self.see()

    def put(self, *steps: Step) -> None:
        self.shared.edit(Program(robot="uzuner", name="test", steps=steps))

    def see(self) -> None:
        self.refresh()  # it is asked for
        self.refresh()  # and is there


def test_the_program_is_drawn_as_it_is_rehearsed_with_its_steps_below(server: GuardedServer) -> None:
    bench = Played(server, to(30), WaitStep(seconds=1), to(-20))
    found = rehearse(UZUNER, bench.shared.program, HOME)
    assert f"/ {found.duration:.2f} s" in shown(bench.page)
    for (key, left, width), step in zip(clips(bench.page), found.steps, strict=True):
        assert key == bench.shared.keys[step.index]
        assert left == pytest.approx(100 * step.begins / found.duration, abs=0.01)
        assert width == pytest.approx(100 * step.duration / found.duration, abs=0.01)
    bench.do("timeline-at", "", "400")
    q = found.sample(0.4 * found.duration).q
    assert bench.page.ghost.q == pytest.approx(q)
    bench.put(to(30))  # edited: it is another motion
    bench.see()
    assert len(clips(bench.page)) == 1 and not bench.page.ghost.seen


def test_the_cursor_runs_with_the_program_unless_somebody_holds_it(
    server: GuardedServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Played(server, to(30), WaitStep(seconds=1), to(-20))
    now, program = bench.page.snapshot, bench.shared.program
    found = rehearse(UZUNER, program, HOME)
    now.velocity_command = now.acceleration_command = np.zeros(5)
    now.state, now.busy, now.q_command = State.MOVING, True, HOME + 0.01

    def runs(step: int, loop: int = 0) -> float:
        now.program = ProgramProgress("test", step, 3, loop, None, program, program)
        bench.refresh()
        return bench.line.graph.share * found.duration

    assert runs(0) == 0.0 and "cursor runs" in shown(bench.page)
    now.stamp += 0.5
    assert runs(0) == pytest.approx(0.5)
    figures = re.findall(r"<b>(.*?)</b>", shown(bench.page))  # where the arm is now
    assert figures == [f"{angle:.1f}".replace("-", "−") for angle in np.degrees(now.q_command) + 0.0]
    assert runs(1) == pytest.approx(found.steps[1].begins)
    now.stamp, now.speed = now.stamp + 0.25, 0.5  # a wait lasts as long at any speed
    assert runs(1) == pytest.approx(found.steps[1].begins + 0.25)
    now.stamp, now.state = now.stamp + 5.0, State.PAUSED
    assert runs(1) == pytest.approx(found.steps[1].begins + 0.25)
    bench.do("timeline-at", "", "900")
    assert runs(1) == pytest.approx(0.9 * found.duration) and bench.page.ghost.seen
    monkeypatch.setattr(timeline, "_HELD_S", 0.0)
    assert runs(0, loop=1) == 0.0 and not bench.page.ghost.seen
    now.program, now.state, now.busy = None, State.HOLDING, False
    bench.refresh()
    assert bench.line.graph.share == 1.0 and "cursor runs" not in shown(bench.page)


def test_a_program_that_ends_early_is_drawn_as_far_and_says_why(
    server: GuardedServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program_ahead, "BUDGET_S", 60.0)  # of a slow machine, too
    bench = Played(server, to(30), PointStep(x_mm=5000, y_mm=0, z_mm=0), to(0))
    assert len(clips(bench.page)) == 1 and "step 2: " in shown(bench.page)
    bench.put(PointStep(x_mm=5000, y_mm=0, z_mm=0))
    bench.see()
    assert "too far" in shown(bench.page).lower() and not clips(bench.page)
    bench.put()
    bench.see()
    assert "list is empty" in shown(bench.page)
    bench.put(*(to(1 + i % 2) for i in range(MOST_STEPS + 5)))
    bench.see()
    assert len(clips(bench.page)) == MOST_STEPS and f"the first {MOST_STEPS} steps" in shown(bench.page)
    monkeypatch.setattr(program_ahead, "BUDGET_S", 0.0)
    bench.put(to(1), to(2), to(3))
    bench.see()
    assert len(clips(bench.page)) == 1 and "the first 1 step of a pass" in shown(bench.page)


def test_zoom_and_pan_keep_what_is_under_the_pointer(server: GuardedServer) -> None:
    bench = Played(server, *(to(10 * i) for i in range(1, 9)))
    page = bench.page

    def window() -> tuple[float, float]:
        return bench.line.graph.window

    def under(share: float) -> float:
        low, high = window()
        return low + share * (high - low)

    random = np.random.default_rng(3)
    for _ in range(200):
        at, down = random.uniform(0, 1), random.uniform(-3, 3)
        before, (low, high) = under(at), window()
        bench.do(
            "timeline-wheel", "", f"{at:.4f} {down:.4f} {random.uniform(-1, 1) if down > 2 else 0.0:.4f}"
        )
        low, high = window()
        assert 0.0 <= low < high <= 1.0
        if 1e-9 < low and high < 1 - 1e-9 and down <= 2:
            assert under(at) == pytest.approx(before, abs=1e-3)
        assert all(0.0 <= left and left + width <= 100.02 for _, left, width in clips(page))
    for garbage in ("", "1 2", "nan 0 0", "0 x 0"):
        bench.do("timeline-wheel", "", garbage)
    bench.do("timeline-zoom", "all")
    assert window() == (0.0, 1.0) and len(clips(page)) == 8
    bench.do("timeline-at", "", "500")
    bench.do("timeline-zoom", "in")
    low, high = window()
    assert low < 0.5 < high and high - low == pytest.approx(1 / 1.5)
    bench.do("timeline-zoom", "out")
    assert window() == pytest.approx((0.0, 1.0))


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_what_is_downloaded_is_what_is_drawn(server: GuardedServer, quantity: str) -> None:
    bench = Played(server, to(30), to(-20))
    bench.do("timeline-shows", quantity)
    bench.do("timeline-zoom", "in")
    bench.do("timeline-csv")
    ((name, text),) = bench.downloads.items()
    head, *rows = text.splitlines()
    assert name.startswith("program-") and head.startswith("time s,")
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    motion = bench.line._motion
    assert motion is not None
    times = bench.line.graph.times(motion.duration)
    assert table[:, 0] == pytest.approx(times, rel=1e-4)
    assert table[:, 1:] == pytest.approx(track(UZUNER, motion, quantity, times).values, rel=1e-4, abs=1e-4)
    assert len(head.split(",")) == table.shape[1]


def test_a_joint_that_comes_near_its_limit_has_it_drawn(server: GuardedServer) -> None:
    motion = plan_joints(UZUNER, HOME, THERE)
    times = np.linspace(0.0, motion.duration, 500)
    fast = track(UZUNER, motion, "Speed", times)
    assert fast.bounds == pytest.approx((-60.0, 60.0)) and fast.nearest.startswith(fast.names[fast.line])
    slow = track(UZUNER, plan_joints(UZUNER, HOME, THERE, 60.0), "Speed", np.linspace(0.0, 60.0, 500))
    assert slow.bounds is None
    bench = Bench(server, kept="open")
    bench.set(THERE)
    bench.do("timeline-shows", "Speed")
    assert shown(bench.page).count("<rect") == 2


def test_the_numbers_beside_a_graph_stand_where_their_values_are(server: GuardedServer) -> None:
    page = FakePage(server, UZUNER, HOME)
    led: list[float] = []
    graph = Graph(page.session, "one", led.append, lambda: None)
    time = np.linspace(0.0, 4.0, 401)
    ends = np.where(time <= 3.0, 10 * time, np.nan)
    lines = PlotLine("<a>", 50 * time - 40, "#111"), PlotLine("b", ends, "#222", dash=(3.0, 3.0))
    curves = Curves(time, lines, (Bound("a ≤ 120", 120.0, "#111", is_upper=True),))
    for speed, window in ((1.0, (0.0, 1.0)), (0.5, (0.0, 1.0)), (1.0, (0.25, 0.5))):
        graph.window = window
        drawn = curves.at(graph.times(4.0))
        html = graph.plot(drawn, "a motion", 4, speed)
        levels = re.findall(r"<small style='top:([\d.]+)%'>(−?[\d.]+)</small>", html)
        grid = [float(y) for y in re.findall(r"class='grid' d='M0,([\d.]+)H", html)]
        assert [float(top) for top, _ in levels] == pytest.approx(grid, abs=0.1) and len(levels) >= 2
        tops = np.array([float(top) for top, _ in levels])
        values = np.array([float(text.replace("−", "-")) for _, text in levels])
        first = re.search(r"stroke='#111' stroke-width='1\.6' d='M0,([\d.]+) ", html)
        assert first is not None  # of the line that begins at −40, or later
        beside = np.polyval(np.polyfit(tops, values, 1), float(first[1]))
        assert beside == pytest.approx(float(drawn.lines[0].y[0]), abs=0.5)
        for left, written in re.findall(r"<small style='left:([\d.]+)%'>([\d.]+) s</small>", html):
            share = window[0] + 0.01 * float(left) * (window[1] - window[0])
            assert float(written) * speed == pytest.approx(4.0 * share, abs=0.01)
        assert html.count("<rect") == 1
    graph.window = 0.75, 1.0
    html = graph.plot(curves.at(graph.times(4.0)), "a motion", 4)
    (ended,) = re.findall(r"stroke='#222'[^>]* d='M([^']*)'", html)
    assert max(float(point.split(",")[0]) for point in ended.split()) < 20
    page.act(lambda: page.parts.done("one-at", "", "500"))
    assert led == [pytest.approx(0.875)]
    assert "<a>" not in legend(curves.lines, [0.0, float("nan")], curves.bounds)


def test_a_line_has_gaps_where_it_has_no_value_and_a_mark_stands_where_it_is() -> None:
    x = np.linspace(-10.0, 10.0, 5)
    broken = PlotLine("a", np.array([0.0, 5.0, np.nan, 5.0, 0.0]), "#111")
    unknown = PlotLine("b", np.full(5, np.nan), "#222")
    html = plot_html(
        Curves(x, (broken, unknown), marks=(PlotMark("least", 5.0, 10.0, "#333"),), unit="°"), 4, 0.25
    )
    (drawn,) = re.findall(r"stroke='#111'[^>]* d='M([^']*)'", html)
    assert [[point.split(",")[0] for point in run.split()] for run in drawn.split("M")] == [
        ["0", "250"],
        ["750", "1000"],
    ]
    assert "#222" not in html and "style='left:25.0%'" in html
    (mark,) = re.findall(r"class='mark' stroke='#333' d='M([\d.]+),([\d.]+)h", html)
    assert float(mark[0]) == 750.0
    tops = dict((text, float(top)) for top, text in re.findall(r"top:([\d.]+)%'>([\d.]+)<", html))
    assert float(mark[1]) == pytest.approx(tops["10"], abs=0.1)  # it is in view
    assert "−10°</small>" in html
    nothing = plot_html(Curves(x, (unknown,)), 4)
    assert "nan" not in nothing and "<svg" in nothing


def test_a_motion_that_ends_where_it_begins_has_no_graph(server: GuardedServer) -> None:
    graph = Graph(FakePage(server, UZUNER, HOME).session, "one", lambda _: None, lambda: None)
    still = Curves(np.zeros(5), (PlotLine("a", np.zeros(5), "#111"),))
    assert "ends where it begins" in graph_html(graph, still, "Joint position (°)")
    level = graph_html(graph, Curves(np.linspace(0, 1, 5), still.lines), "Joint position (°)")
    assert "<svg" in level and "nan" not in level
