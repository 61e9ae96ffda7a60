"""Fields for the whole orientation of a tool: as turns about the base's axes, and as a quaternion."""

from __future__ import annotations

from collections.abc import Awaitable
from functools import partial

import viser

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.kinematics import quaternion_wxyz, roll_pitch_yaw, rotation_from_rpy
from armctl.kinematics.target import rotation_from_quaternion
from armctl.ui.widgets.events import Action, On
from armctl.ui.widgets.html import LiveHtml, muted
from armctl.ui.widgets.number_field import DEGREES, FieldArray, NumberField, NumbersField, TextEntry

CONVENTION = "R = Rz(yaw) · Ry(pitch) · Rx(roll): turns about the base's x, then y, then z axis."
_TURNS = (
    ("Rx °", "Roll: the turn about the base's x axis, which comes first."),
    ("Ry °", "Pitch: the turn about the base's y axis, after that; not the tool's own pitch."),
    ("Rz °", "Yaw: the turn about the base's z axis, which comes last."),
)
_QUATERNION_HINT = "The same orientation as w, x, y, z, of any length. Type either; the other one follows."


class OrientationFields:
    """Rx, Ry and Rz, and the quaternion: each shows what was typed into the other."""

    def __init__(self, gui: viser.GuiApi, rotation: FloatArray, *, visible: bool = True) -> None:
        """Add them to the present container, filled with ``R_base_tool`` (3, 3)."""
        turns = [NumberField(gui, label, None, hint=hint, visible=visible) for label, hint in _TURNS]
        self._rpy = FieldArray(turns, DEGREES)
        self._quaternion = NumbersField(
            gui, "Quaternion", "wxyz", quaternion_wxyz(rotation), 1.0, _QUATERNION_HINT,
            digits=6, visible=visible,
        )  # fmt: skip
        self._note = LiveHtml(gui, muted(CONVENTION), visible=visible)
        self._by_quaternion = False
        self.fields: tuple[TextEntry, ...] = (*turns, self._quaternion)
        self.fill(rotation)

    def attach(self, on: On, changed: Action) -> None:
        """Let both follow each other; ``changed`` runs after each edit."""

        def typed(*, by_quaternion: bool) -> Awaitable[object] | None:
            self._by_quaternion = by_quaternion
            self._follow()
            return changed()

        *turns, quaternion = self.fields
        for field in turns:
            on(field.handle.on_update, partial(typed, by_quaternion=False))
        on(quaternion.handle.on_update, partial(typed, by_quaternion=True))

    @property
    def texts(self) -> tuple[str, ...]:
        """What the fields show."""
        return tuple(field.text for field in self.fields)

    @property
    def rotation(self) -> FloatArray:
        """``R_base_tool`` (3, 3) as it was typed last; errors name the field."""
        if self._by_quaternion:
            return rotation_from_quaternion(self._quaternion.array)
        return rotation_from_rpy(*self._rpy.array.tolist())

    def fill(self, rotation: FloatArray) -> None:
        """Show ``R_base_tool`` (3, 3)."""
        self._by_quaternion = False
        self._rpy.fill(roll_pitch_yaw(rotation))
        self._quaternion.fill(quaternion_wxyz(rotation))

    def show(self, *, visible: bool) -> None:
        """Show or hide all of it."""
        for field in self.fields:
            field.visible = visible
        self._note.visible = visible

    def _follow(self) -> None:
        """Bring what was not typed into up to date."""
        try:
            rotation = self.rotation
        except ArmctlError:  # half-typed: said when it is used
            return
        if self._by_quaternion:
            self._rpy.fill(roll_pitch_yaw(rotation))
        else:
            self._quaternion.fill(quaternion_wxyz(rotation))
