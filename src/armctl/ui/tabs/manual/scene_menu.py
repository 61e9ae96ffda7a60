"""A menu where the scene is pressed (right button, or a finger that stays): pose and steps at that place."""

from __future__ import annotations

from functools import partial

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.kinematics import Target
from armctl.motion.choices import solve
from armctl.program import LineStep, PointStep, Step
from armctl.program.edit import PLACES, add
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.ui.dragged_tool import dragged_to
from armctl.ui.next_pose import PoseWriter
from armctl.ui.session import Session
from armctl.ui.tabs.manual.program_editor import ProgramEditor
from armctl.ui.tabs.manual.program_pins import ProgramPins, first_met, pin_radius
from armctl.ui.widgets.html import button, fixed
from armctl.ui.widgets.number_field import parse_numbers

_PART = "menu"
_RAY = ("x", "y", "z", "dx", "dy", "dz", "left", "top")
_FAR = 3.0
"""times the arm's reach: what is pressed beyond is no place for it"""
_NEAR_A_PIN = 1.8
"""of its radius"""
_DIGITS = 1


def read_ray(value: str) -> tuple[FloatArray, FloatArray, tuple[float, float]]:
    """Of a press in the scene: its ray from (3,) [m], along (3,), and where in the window [px]."""
    numbers = np.array(parse_numbers(value, "a press in the scene", _RAY))
    if not numbers[3:6].any():
        raise InputError("a press in the scene has no direction")
    return numbers[:3], numbers[3:6] / np.linalg.norm(numbers[3:6]), (numbers[6], numbers[7])


def pressed_point(
    origin: FloatArray, direction: FloatArray, floor_z: float | None, pins: FloatArray, radius: float
) -> FloatArray | None:
    """Where a ray from ``origin`` along ``direction`` (3,) meets a pin, else the floor (3,) [m].

    None: nowhere. ``floor_z`` [m]; None: only pins count. ``pins`` (k, 3) [m]; of those that it passes within
    ``radius`` [m] the nearest one counts.
    """
    d = direction / np.linalg.norm(direction)
    if (met := first_met(origin, d, pins, radius)) is not None:
        return pins[met]
    if floor_z is None or abs(d[2]) < 1e-9 or (floor_z - origin[2]) / d[2] <= 0.0:
        return None
    point = origin + (floor_z - origin[2]) / d[2] * d
    point[2] = floor_z
    return point


class SceneMenu:
    """One page's menu; it moves nothing."""

    def __init__(self, session: Session, editor: ProgramEditor, pins: ProgramPins) -> None:
        self._session, self._editor, self._pins = session, editor, pins
        self._robot = session.console.robot
        self._writer = PoseWriter(session, "pointed at in the scene")
        self._point: FloatArray | None = None
        """what was pressed (3,) [m]; None: there is no menu"""
        self._place = 0.0, 0.0
        """of the menu in the window [px]"""
        session.on_part_value("scene-press", self._on_scene)
        session.on_part("menu-leave", self._close)
        session.on_press("menu-here", "Next pose here", self._on_here)
        session.on_press("menu-above", "Next pose above it", self._on_above)
        session.on_press("menu-point", "Add as a point", partial(self._on_step, PointStep))
        session.on_press("menu-line", "Add as a line", partial(self._on_step, LineStep))
        session.parts.show(_PART, "")

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw it, as it is now."""
        self._session.parts.show(_PART, "" if self._point is None else self._html(self._point, snapshot))

    def _on_scene(self, _: str, value: str) -> None:
        origin, direction, self._place = read_ray(value)
        radius = _NEAR_A_PIN * pin_radius(self._robot)
        self._point = pressed_point(origin, direction, self._robot.floor_z, self._pins.points, radius)
        if self._point is not None and np.linalg.norm(self._point) > _FAR * self._robot.chain.length:
            self._point = None
        self.refresh(self._session.snapshot)

    def _close(self, _: str = "") -> None:
        self._point = None
        self.refresh(self._session.snapshot)

    # What it does.

    def _take(self) -> FloatArray:
        """The point; the menu is gone."""
        point = self._point
        if point is None:
            raise InputError("the menu is gone; press in the scene again")
        self._close()
        return point

    async def _on_here(self, _: str) -> None:
        await self._show(self._take())

    async def _on_above(self, _: str) -> None:
        point = self._take()
        await self._show(np.array([point[0], point[1], self._tool_z(self._session.snapshot)]))

    async def _show(self, point: FloatArray) -> None:
        before = self._session.next.shown_in(self._session.snapshot)
        is_newest = self._writer.begin()
        q = await self._session.work_out(_led_to, self._robot, point, before)
        if is_newest():
            self._writer.show(q)

    async def _on_step(self, kind: type[PointStep | LineStep], _: str) -> None:
        x, y, z = np.round(1000 * self._take(), _DIGITS).tolist()
        step: Step = kind(x_mm=x, y_mm=y, z_mm=z)
        row = self._editor.selected
        await self._editor.change(lambda program: add(program, step, PLACES[0], row))

    def _tool_z(self, snapshot: Snapshot) -> float:
        return float(self._robot.forward(self._session.next.shown_in(snapshot))[2, 3])

    # What it shows.

    def _html(self, point: FloatArray, snapshot: Snapshot) -> str:
        x, y, z = (fixed(1000 * value, _DIGITS) for value in point.tolist())
        above, why = fixed(1000 * self._tool_z(snapshot), _DIGITS), self._session.why_not(None, snapshot)
        items = (
            ("menu-here", "Next pose here", None),
            ("menu-above", f"Next pose above it, at Z {above}", None),
            ("menu-point", "Add as a point", why),
            ("menu-line", "Add as a line", why),
        )
        buttons = "".join(button(do, label, why=reason, kind="item") for do, label, reason in items)
        left, top = self._place
        return (
            f"<div class=armctl-menu role=group aria-label='What to do there' data-leave=menu-leave "
            f"style='--left:{left:.0f}px;--top:{top:.0f}px'>"
            f"<p>X {x} &ensp;Y {y} &ensp;Z {z} mm</p>{buttons}</div>"
        )


def _led_to(robot: Robot, point: FloatArray, before: FloatArray) -> FloatArray:
    """As ``dragged_to``; where there is none, why (``ArmctlError``)."""
    q = dragged_to(robot, point, before)
    return solve(robot, before, Target.of(point), "least-travel") if q is None else q
