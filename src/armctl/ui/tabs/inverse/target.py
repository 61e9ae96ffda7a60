"""What the Inverse screen asks for: X, Y, Z, pitch, roll, and a target in the scene that can be dragged."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.kinematics import Target
from armctl.ui.session import Session
from armctl.ui.widgets.number_field import EditWatch, NumberField

_GIZMO_SCALE = 0.12
_PITCH_HINT = "Angle of the tool's axis above the horizontal: 0 level, −90 straight down."
_ROLL_HINT = "Angle of the tool about its own axis."
_SHOW_HINT = "A target in the 3D view; drag its arrows to fill X, Y, Z. The arm does not move."


class TargetForm:
    """The fields, and the draggable target coupled with them. ``dragged`` is told of every drag."""

    def __init__(self, session: Session, dragged: Callable[[], Awaitable[None]]) -> None:
        self._session = session
        self._dragged = dragged
        gui, robot = session.gui, session.console.robot
        solver, present = robot.inverse_kinematics, session.snapshot.q_command
        point = 1000 * robot.forward(present)[:3, 3]
        pitch, roll = solver.pitch_and_roll(present)
        self._xyz = [
            NumberField(gui, f"{name} mm", value) for name, value in zip("XYZ", point.tolist(), strict=True)
        ]
        self._use_pitch = gui.add_checkbox("Use pitch", initial_value=False, visible=pitch is not None)
        self._pitch = NumberField(gui, "Pitch °", _degrees(pitch), hint=_PITCH_HINT, visible=False)
        self._use_roll = gui.add_checkbox("Use roll", initial_value=False, visible=roll is not None)
        self._roll = NumberField(gui, "Roll °", _degrees(roll), hint=_ROLL_HINT, visible=False)
        self._show = gui.add_checkbox("Show target", initial_value=False, hint=_SHOW_HINT)
        self._gizmo = session.client.scene.add_transform_controls(
            "/inverse_target", scale=_GIZMO_SCALE, disable_rotations=True, depth_test=False, visible=False,
            position=point / 1000,
        )  # fmt: skip
        self.watch = EditWatch([*self._xyz, self._pitch, self._roll])
        self._attach()

    def _attach(self) -> None:
        session = self._session
        for field in self._xyz:
            session.on(field.handle.on_update, self._on_typed)
        for box in (self._use_pitch, self._use_roll):
            session.on(box.on_update, self._on_use)
            self.watch.watch(box.on_update)
        session.on(self._show.on_update, self._on_show)
        session.on(self._gizmo.on_update, self._on_drag)

    @property
    def texts(self) -> tuple[str | bool, ...]:
        """What the form shows; the same again means that nothing has changed."""
        pitch, roll = self._use_pitch.value, self._use_roll.value
        shown = [field.text for field in self._xyz]
        return (*shown, pitch, self._pitch.text if pitch else "", roll, self._roll.text if roll else "")

    def target(self) -> Target:
        """What the form asks for.

        Raises:
            InputError: a field is empty, or holds no number that can be used.
        """
        position = np.array([field.value for field in self._xyz]) / 1000
        pitch = math.radians(self._pitch.value) if self._use_pitch.value else None
        roll = math.radians(self._roll.value) if self._use_roll.value else None
        return Target.of(position, pitch, roll)

    def fill(self, point_m: FloatArray) -> None:
        """Put a point (3,) [m] into X, Y, Z."""
        for field, value in zip(self._xyz, (1000 * point_m).tolist(), strict=True):
            field.fill(value)
        self._gizmo.position = point_m

    def fill_tool(self, q: FloatArray) -> None:
        """Put the tool's pose at ``q`` (n,) [rad] into all fields."""
        robot = self._session.console.robot
        self.fill(robot.forward(q)[:3, 3])
        angles = robot.inverse_kinematics.pitch_and_roll(q)
        for field, angle in zip((self._pitch, self._roll), angles, strict=True):
            if angle is not None:
                field.fill(math.degrees(angle))

    async def _on_typed(self) -> None:
        try:
            self._gizmo.position = self.target().position
        except ArmctlError:  # half-typed: said when it is used
            return

    async def _on_use(self) -> None:
        self._pitch.visible = self._use_pitch.value
        self._roll.visible = self._use_roll.value

    async def _on_show(self) -> None:
        self._gizmo.visible = self._show.value

    async def _on_drag(self) -> None:
        for field, value in zip(self._xyz, self._gizmo.position.tolist(), strict=True):
            field.fill(round(1000 * value, 1))
        await self._dragged()


def _degrees(angle: float | None) -> float | None:
    return None if angle is None else math.degrees(angle)
