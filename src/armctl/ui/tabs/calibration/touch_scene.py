"""Where a point is: its sheet in the scene, and a pose above it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.calibration import TouchSheet
from armctl.errors import InputError
from armctl.motion import Profile
from armctl.motion.choices import first_possible, may_go_to
from armctl.robot import Robot
from armctl.ui.dragged_tool import dragged_to
from armctl.ui.scene.ghost import Lines, segments
from armctl.ui.session import Session

ABOVE_M = (0.03, 0.06, 0.1)
FAR_ABOVE_M = (0.06, 0.1, 0.03)
"""before it is known where the sheet lies for this arm: zeros by eye put a tip 25 mm off"""
_LEAST_ABOVE_M, _SURE = 0.015, 3.0
_SHEET, _CROSS_M = (73, 80, 87), 0.005


class SheetInScene:
    """The sheet where it should lie, in the view of one page, while its tab is open."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._lines = Lines(session.client.scene, "/sheet/lines", _SHEET)
        self._label: viser.LabelHandle | None = None
        self._drawn: tuple[TouchSheet | None, int | None] = (None, None)

    def refresh(self, sheet: TouchSheet | None, number: int | None) -> None:
        """Draw its crosshairs and its edge, and the ``number`` of the one that is next."""
        sheet = sheet if self._session.sees("Calibration") else None
        number = None if sheet is None else number
        if self._drawn[0] is sheet and self._drawn[1] == number:
            return
        if self._drawn[0] is not sheet:
            self._lines.show(np.zeros((0, 2, 3)) if sheet is None else sheet_lines(sheet))
        self._drawn = sheet, number
        if self._label is not None:
            self._label.remove()
        self._label = None
        if sheet is not None and number is not None:
            at = tuple(sheet.laid_m[number - 1].tolist())
            self._label = self._session.client.scene.add_label("/sheet/next", str(number), position=at)


def sheet_lines(sheet: TouchSheet) -> FloatArray:
    """The edge of a sheet and its crosshairs, where it lies as it is drawn: (k, 2, 3), base frame [m]."""
    y, x = 0.0005 * np.array(sheet.size_mm)  # its long side is across
    corners = sheet.place_m + np.array([(-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)])
    arms = _CROSS_M * np.array([[(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)], [(0.0, -1.0, 0.0), (0.0, 1.0, 0.0)]])
    crosses = (sheet.laid_m[:, None, None] + arms).reshape(-1, 2, 3)
    return np.concatenate([segments(np.vstack([corners, corners[:1]])), crosses])


def lifts_for(height_sd_m: float) -> tuple[float, ...]:
    """How far above a point the tool is sent [m]: nearer, the better it is known how high it truly comes."""
    least = max(_LEAST_ABOVE_M, 0.005 + _SURE * height_sd_m)
    return (min(least, ABOVE_M[-1]), *(one for one in ABOVE_M if one > least))


def pose_above(
    robot: Robot,
    point: FloatArray,
    near: FloatArray,
    start: FloatArray,
    side: Profile = "cubic",
    lifts: Sequence[float] = ABOVE_M,
    ahead: Callable[[FloatArray], FloatArray] | None = None,
) -> tuple[FloatArray, Profile]:
    """A configuration (n,) [rad] to which the arm may go from ``start`` with the tool above a point (3,) [m].

    The one nearest to ``near`` (n,), where that may be, else any. And how it goes there: as ``side`` says,
    where it may. ``lifts``: how far above [m], the first that can be had. ``ahead``: how far beyond a point
    the arm has to be sent, (3,) [m] at a configuration, so that its tool truly comes there; None: it need
    not. ``InputError``: there is none.
    """

    def how(q: FloatArray) -> tuple[FloatArray, Profile]:
        return q, side if may_go_to(robot, start, q, None, side) else "cubic"

    for lift in lifts:
        target = above = point + np.array((0.0, 0.0, lift))
        if ahead is not None:
            target = above + ahead(near)
        q = dragged_to(robot, target, near)
        if q is not None and ahead is not None:
            q = dragged_to(robot, above + ahead(q), q)
        if q is not None and may_go_to(robot, start, q):
            return how(q)
        others = robot.inverse(target, start=start).q
        found = first_possible(robot, start, others, partial(may_go_to, robot, start))
        if found is not None:
            return how(others[found])
    raise InputError("the arm finds no free way above this point: jog it there, or choose another one")
