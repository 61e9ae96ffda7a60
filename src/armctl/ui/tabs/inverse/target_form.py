"""What is asked for: X, Y, Z, how the tool is turned, and a target in the scene that can be dragged."""

from __future__ import annotations

from collections.abc import Awaitable
from contextlib import nullcontext

import viser

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.facts.angles import from_degrees, to_degrees
from armctl.kinematics import Target
from armctl.ui.events import Action
from armctl.ui.session import Session
from armctl.ui.widgets.angle_fields import Container, OrientationFields
from armctl.ui.widgets.html import LiveHtml, muted
from armctl.ui.widgets.number_field import DraggedPoint, EditWatch, Following, NumberField

_PITCH_HINT = "Angle of the tool's axis above the horizontal: 0 level, −90 straight down."
_ROLL_HINT = "Angle of the tool about its own axis."
_SHOW_HINT = "A target in the 3D view; drag its arrows to fill X, Y, Z. The arm does not move."
_NEITHER = "Tick pitch, roll or both. As long as neither is ticked, the point alone counts."
ANY, PITCH_AND_ROLL, WHOLE = "any: position only", "tool pitch and roll", "whole orientation"


class TargetForm:
    """The fields, and the target coupled with them; ``dragged`` runs at every drag."""

    def __init__(self, session: Session, dragged: Action, rare: Container | None = None) -> None:
        """``rare``: where the quaternion and the switch of the target stand; None: beside the others."""
        self._robot, self._dragged = session.console.robot, dragged
        gui, present = session.gui, session.snapshot.q_command
        pose = self._robot.forward(present)
        angles = self._robot.inverse_kinematics.pitch_and_roll(present)
        scene, tip = session.client.scene, pose[:3, 3]
        self.point = DraggedPoint(gui, scene, session.on, "/inverse_target", tip, self._on_dragged)
        session.other_arrows.append(self.point.target)
        self._kind = self._orientation = None
        if self._robot.orients_tool:
            begins = WHOLE if self._robot.criterion == "least-travel" else ANY  # as the paper that it is from
            self._kind = gui.add_dropdown("Orientation", (ANY, PITCH_AND_ROLL, WHOLE), initial_value=begins)
            self._orientation = OrientationFields(gui, pose[:3, :3], visible=begins == WHOLE, apart=rare)
        self._turns: list[tuple[viser.GuiCheckboxHandle, NumberField, bool]] = []
        for name, hint, angle in zip(("pitch", "roll"), (_PITCH_HINT, _ROLL_HINT), angles, strict=True):
            has = angle is not None
            use = gui.add_checkbox(f"Use {name}", initial_value=False, visible=has and self._kind is None)
            degrees = None if angle is None else to_degrees(angle)
            field = NumberField(gui, f"{name.capitalize()} °", degrees, hint=hint, visible=False)
            self._turns.append((use, field, has))
        self._neither = LiveHtml(gui, muted(_NEITHER), visible=False)
        with rare or nullcontext():
            self._show = gui.add_checkbox("Show target", initial_value=False, hint=_SHOW_HINT)
        xyz = self.point.xyz.fields
        typed = () if self._orientation is None else self._orientation.fields
        turns = [field for _, field, _ in self._turns]
        self.watch = EditWatch([*xyz, *turns, *typed])
        self.following = Following(self.watch, self._fill_tool, session.spawn, present)
        if self._orientation is not None:
            self._orientation.attach(session.on, self.following.edit)
        for field in turns:
            session.on(field.handle.on_update, self.following.edit)
        for field in xyz:
            session.on(field.handle.on_update, self._on_typed)
        for chosen in (*(use for use, _, _ in self._turns), self._kind):
            if chosen is not None:
                session.on(chosen.on_update, self._on_checked)
                self.watch.watch(chosen.on_update)
        session.on(self._show.on_update, self._on_checked)

    @property
    def texts(self) -> tuple[str | None, ...]:
        """What the form shows; the same again means that nothing has changed."""
        whole = self._whole
        turns = (field.text if self._uses(use) else None for use, field, _ in self._turns)
        return *self.point.xyz.texts, *turns, *(() if whole is None else whole.texts)

    def target(self) -> Target:
        """What the form asks for; errors name the field that holds no number that can be used."""
        position, whole = self.point.xyz.array, self._whole
        if whole is not None:
            return Target.of(position, rotation=whole.rotation)
        turns = (from_degrees(field.value) if self._uses(use) else None for use, field, _ in self._turns)
        return Target.of(position, *turns)

    def _fill_tool(self, q: FloatArray) -> None:
        pose = self._robot.forward(q)
        self.point.put(pose[:3, 3])
        if self._orientation is not None:
            self._orientation.fill(pose[:3, :3])
        angles = self._robot.inverse_kinematics.pitch_and_roll(q)
        for (_, field, _), angle in zip(self._turns, angles, strict=True):
            if angle is not None:
                field.fill(to_degrees(angle))

    @property
    def _whole(self) -> OrientationFields | None:
        """The fields of the whole orientation, where it is asked for."""
        return None if self._kind is None or self._kind.value != WHOLE else self._orientation

    def _uses(self, use: viser.GuiCheckboxHandle) -> bool:
        return use.value and (self._kind is None or self._kind.value == PITCH_AND_ROLL)

    def _on_dragged(self) -> Awaitable[object] | None:
        self.following.edit()
        return self._dragged()

    def _on_typed(self) -> None:
        self.following.edit()
        try:
            self.point.target.position = Target.of(self.point.xyz.array).position
        except ArmctlError:  # half-typed: said when it is used
            pass

    def _on_checked(self) -> None:
        for use, field, has in self._turns:
            use.visible = has and (self._kind is None or self._kind.value == PITCH_AND_ROLL)
            field.visible = self._uses(use)
        if self._orientation is not None:
            self._orientation.show(visible=self._whole is not None)
        asks = self._kind is not None and self._kind.value == PITCH_AND_ROLL
        self._neither.visible = asks and not any(use.value for use, _, _ in self._turns)
        self.point.target.visible = self._show.value
