"""The study "joint by joint" of the Trajectory tab: how fast each joint alone moves the tip."""

from __future__ import annotations

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.facts.angles import DEGREE, to_degrees
from armctl.kinematics.workspace import longest_levers
from armctl.lazy_dataclass import dataclass
from armctl.motion.analysis import JointStudy, Turning, study_csv, study_joints
from armctl.motion.figure import color_of
from armctl.robot import Robot
from armctl.ui.session import Session
from armctl.ui.widgets.graph import Curves, Graph, PlotLine, graph_html
from armctl.ui.widgets.html import LiveHtml, fixed, heading, muted, strong, table

PAPER_DEG_S = 20.0
_PART, _TITLE = "study", "Tip speed by joint (mm/s)"
_TOGETHER = "#868e96"
_NONE = "Nothing is shown yet: press Show. A study moves nothing."
_PRINTED_M_S = {"abaas": 8.32}
"""tip speeds that a paper prints at 20 °/s and that cannot be [m/s]"""


@dataclass(frozen=True, slots=True, eq=False)
class ShownStudy:
    """A study from a named pose, and how far the tip can come from each joint's axis (n,) [m]."""

    robot: Robot
    start_name: str
    study: JointStudy
    levers: FloatArray


class StudyView:
    """Plot, figures and export of one page's study, in a box of their own."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.shown: ShownStudy | None = None
        gui = session.gui
        self.box = gui.add_folder(None, visible=False)
        with self.box:
            self._note = LiveHtml(gui, muted(_NONE))
            self._graph = Graph(session, _PART, self._on_cursor, self._draw, scrolls=True)
            session.parts.add(gui, _PART)
            self._figures = LiveHtml(gui)
            export = gui.add_button("Export study (CSV)", icon=viser.Icon.DOWNLOAD, color="gray")
        # the reason stands above already
        session.needs(None, export, also=lambda _: None if self.shown else _NONE, told=False, anyone=True)
        session.on(export.on_click, self._on_export)

    def take(self, shown: ShownStudy) -> None:
        """Show another study."""
        self.shown, study = shown, shown.study
        turn, then = "All joints turn at once", "A joint that has come to its limit stays there."
        if study.total is None:
            turn = "Each joint alone turns"
            then = (
                "A joint that turns alone carries the tip along a circle about its axis, so its line is "
                "level; it ends at the joint's limit."
            )
        how = f"{turn} at {_deg_s(study.speed)} from {shown.start_name}, towards its farther limit."
        self._note.show(strong(fastest_words(shown)) + muted(f"{how} {then}"))
        self._graph.reset()
        self._draw()
        self._figures.show(study_html(shown))

    def _on_cursor(self, share: float) -> None:
        self._graph.share = share
        self._draw()

    def _draw(self) -> None:
        if self.shown is not None:
            self._session.parts.show(_PART, graph_html(self._graph, study_curves(self.shown), _TITLE))

    async def _on_export(self) -> None:
        if self.shown is None:
            raise InputError("there is no study to export: press Show first")
        text = await self._session.work_out(study_csv, self.shown.robot, self.shown.study)
        self._session.download("joint-by-joint.csv", text)


def make_study(
    robot: Robot, start_name: str, start: FloatArray, turning: Turning, speed: float, duration_s: float | None
) -> ShownStudy:
    """Compute a study from ``start`` (n,) [rad]; arguments and errors as ``study_joints``."""
    study = study_joints(robot, start, turning, speed, duration_s)
    return ShownStudy(robot, start_name, study, longest_levers(robot.chain, robot.limits))


def study_curves(shown: ShownStudy) -> Curves:
    """Tip speed over time, one line a joint, in mm/s."""
    robot, study = shown.robot, shown.study
    speeds = 1000 * study.tip_speed
    lines = [
        PlotLine(robot.joints[joint].title, np.ascontiguousarray(speeds[:, i]), color_of(joint))
        for i, joint in enumerate(study.moving)
    ]
    if study.total is not None:
        lines.append(PlotLine("all together", 1000 * study.total, _TOGETHER))
    return Curves(study.time, tuple(lines))


def study_html(shown: ShownStudy) -> str:
    """The joints' figures, what is possible at most, and how the curves were checked."""
    robot, study, levers = shown.robot, shown.study, shown.levers
    rows: list[list[str]] = []
    for i, peak in zip(study.moving, study.peaks.tolist(), strict=True):
        figures = peak, study.speed * levers[i], levers[i]
        rows.append([robot.joints[i].title, *(fixed(1000 * value, 1) for value in figures)])
    html = table(["tip speed mm/s", "largest here", "any pose: ω·R", "R mm"], rows)
    if study.total is not None:
        html += muted(f"All joints together: at most {fixed(1000 * float(study.total.max()), 1)} mm/s.")
    if study.held:
        names = ", ".join(robot.joints[i].title for i in study.held)
        html += muted(f"Left out, because its limits hold it still: {names}.")
    slower = [robot.joints[i] for i in study.moving if study.speed > robot.joints[i].speed * (1 + 1e-9)]
    if slower:
        names = ", ".join(f"{joint.title} ({_deg_s(joint.speed)})" for joint in slower)
        html += muted(f"Faster than the real arm may turn: {names}.")
    html += heading("At most") + muted(_at_most(shown))
    mismatch = f"{study.mismatch:.0e}".replace("e-0", "e-").replace("-", "−")
    return html + muted(
        f"J·q̇ and central differences of the forward kinematics agree within {mismatch} of the largest speed."
    )


def fastest_words(shown: ShownStudy) -> str:
    """Which joint moves the tip fastest, and which comes next."""
    robot, study = shown.robot, shown.study
    order: list[int] = np.argsort(-study.peaks).tolist()
    ranked = [(robot.joints[study.moving[i]].title, 1000 * float(study.peaks[i])) for i in order]
    (first, best), *others = ranked
    if best == 0.0:
        return "No joint moves the tip from this pose."
    text = f"{first} moves the tip fastest: {fixed(best, 1)} mm/s"
    if others:
        text += f"; next is {others[0][0]} with {fixed(others[0][1], 1)} mm/s"
    return f"{text}."


def _at_most(shown: ShownStudy) -> str:
    reach, speed = float(shown.levers.max()), shown.study.speed
    text = (
        "A joint gives the tip its speed times the tip's distance from its axis, which is "
        f"{fixed(1000 * reach, 1)} mm at most: {_deg_s(speed)} give "
        f"{fixed(1000 * speed * reach, 1)} mm/s at most."
    )
    printed, speed = _PRINTED_M_S.get(shown.robot.name), PAPER_DEG_S * DEGREE
    if printed is not None:
        text += (
            f" The {fixed(printed, 2)}·10³ mm/s that the paper prints at 20 °/s cannot be: that would take "
            f"an arm of {fixed(printed / speed, 1)} m; right is "
            f"{fixed(1000 * speed * reach, 0)} mm/s at most."
        )
    return text


def _deg_s(speed: float) -> str:
    return f"{round(to_degrees(speed), 3):g} °/s"
