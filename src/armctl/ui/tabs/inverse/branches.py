"""The branches of a target: a table, and every one as a coloured ghost."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.robot import Robot
from armctl.ui.scene.arm_model import ArmFigure
from armctl.ui.scene.ghost import THICKER
from armctl.ui.session import Session
from armctl.ui.tabs.inverse.answer import BranchVerdict, RankedSolutions, short_branch
from armctl.ui.widgets.html import LiveHtml, fixed, muted, table

TAB = "Inverse"
_MOST_GHOSTS = 8
_OPACITY, _THICKER_EACH = 0.4, 0.03
_LEGEND = "In the 3D view green is the branch of least energy, blue is possible, red is refused."
_CHOSEN, _POSSIBLE, _REFUSED = (47, 158, 68), (34, 139, 230), (224, 49, 49)
_SAME_PLACE_M = 1e-3
_SWEPT_MEND = (
    "This leaves joints free, so there are infinitely many solutions. To see the branches, "
    "ask for more of the tool's orientation above, then press Solve."
)
_NOTHING = "Nothing is solved yet."


class BranchView:
    """The branches of the newest answer; ``toggled`` is called when their ghosts come or go."""

    def __init__(self, session: Session, toggled: Callable[[], None]) -> None:
        self._toggled = toggled
        self._robot, self._ghost = session.console.robot, session.ghost
        self._scene = session.client.scene
        self._ghosts: list[viser.FrameHandle | viser.LabelHandle] = []
        self._answer: RankedSolutions | None = None
        gui = session.gui
        self._ticked = gui.add_checkbox("Show as ghosts", initial_value=False, disabled=True)
        self._legend = LiveHtml(gui, muted(_LEGEND), visible=False)
        self._table = LiveHtml(gui, muted(_NOTHING))
        session.on(self._ticked.on_update, self._on_ticked)

    @property
    def as_ghosts(self) -> bool:
        """Whether the branches are in the 3D view now."""
        return self._ticked.value and self._answer is not None and bool(self._answer.verdicts)

    def show(self, found: RankedSolutions) -> None:
        """Show the branches of an answer."""
        self._answer = found
        self._legend.visible = bool(found.verdicts)
        self._ticked.disabled = not found.verdicts
        self._table.show(branches_html(found))
        self._draw()

    def forget(self) -> None:
        """There is no answer any more."""
        self._answer = None
        self._legend.visible = False
        self._ticked.disabled = True
        self._table.show(muted(_NOTHING))
        self._draw()

    def refresh(self) -> None:
        """Show the ghosts while the tab is open."""
        for node in self._ghosts:
            node.visible = self._ghost.in_view(TAB)

    def _on_ticked(self) -> None:
        self._draw()
        self._toggled()

    def _give_up(self) -> None:
        """Another screen shows something: the branches leave the view."""
        self._ticked.value = False
        self._draw()

    def _draw(self) -> None:
        for node in self._ghosts:
            node.remove()
        self._ghosts = []
        if self._answer is None or not self.as_ghosts:
            return
        self._ghost.claim(self, self._give_up)
        groups = same_place(self._robot, self._answer.verdicts[:_MOST_GHOSTS])
        shown = [min(alike, key=lambda one: (bool(one.refused), not one.chosen)) for alike in groups]
        places = self._label_places(np.array([one.branch.q for one in shown]))
        for i, (alike, best, place) in enumerate(zip(groups, shown, places, strict=True)):
            # each thicker than the one before, the first than the next pose: shared surfaces would flicker
            thicker = THICKER + (1 + i) * _THICKER_EACH
            color = _REFUSED if best.refused else _CHOSEN if best.chosen else _POSSIBLE
            figure = ArmFigure(
                self._scene, self._robot, f"/branches/{i}", color=color, opacity=_OPACITY, thicker=thicker
            )
            opening, part = self._ghost.held
            figure.pose(best.branch.q, opening)
            figure.carry(part)
            words = ", ".join(one.label for one in alike)
            self._ghosts += [figure.root, self._scene.add_label(f"/branches/label{i}", words, position=place)]

    def _label_places(self, q: FloatArray) -> FloatArray:
        """(k, 3) origins of the one frame at which the arms at ``q`` (k, n) [rad] are farthest apart [m]."""
        points = self._robot.frames(q)[:, :, :3, 3]  # (k, frames, 3)
        apart = np.linalg.norm(points[:, None] - points[None], axis=-1)  # (k, k, frames)
        apart[np.arange(len(q)), np.arange(len(q))] = np.inf
        return points[:, int(apart.min(axis=(0, 1)).argmax()) if len(q) > 1 else points.shape[1] // 2]


def branches_html(found: RankedSolutions) -> str:
    """Every branch with its energy, and why some are refused."""
    if not found.verdicts:
        if not found.solutions.success:
            return muted("No branch meets this target; the reason stands above.")
        if found.solutions.target.rotation is None:
            return muted(_SWEPT_MEND)
        if found.solutions.free_joint is None:
            return muted("No branch has this orientation; List has the nearest.")
        return muted("One joint is free here, so there are infinitely many solutions. See List for a few.")
    joints = (f"{joint.title} °" for joint in found.robot.joints)
    head = ["#", "branch", *joints, f"energy {found.unit}", "verdict"]
    rows = [
        [
            str(one.number),
            short_branch(one.branch.name),
            *(fixed(value, 2) for value in found.robot.shown(one.branch.q).tolist()),
            "–" if one.branch.forbidden else fixed(found.energy_of(one.branch.q), 3),
            "refused" if one.refused else "chosen" if one.chosen else "possible",
        ]
        for one in found.verdicts
    ]
    notes = [f"{one.number} is refused: {one.refused}." for one in found.verdicts if one.refused]
    marked = next((i for i, one in enumerate(found.verdicts) if one.chosen), None)
    if marked is not None:
        one = found.verdicts[marked]
        said = "has" if one.refused else "is chosen among the possible ones:"
        notes.append(f"{one.number} {said} the least energy by {found.criterion}.")
    return table(head, rows, marked=marked, words=(0, 1, len(head) - 1), small=True) + "".join(
        muted(note) for note in notes
    )


def same_place(robot: Robot, found: Sequence[BranchVerdict]) -> list[list[BranchVerdict]]:
    """Groups of branches whose links are in the same place, e.g. with the base turned by 180°."""
    groups: list[list[BranchVerdict]] = []
    for one in found:
        points = robot.frames(one.branch.q)[:, :3, 3]
        for group in groups:
            if np.abs(points - robot.frames(group[0].branch.q)[:, :3, 3]).max() < _SAME_PLACE_M:
                group.append(one)
                break
        else:
            groups.append([one])
    return groups
