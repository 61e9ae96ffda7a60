"""The kinds of steps of a program: one struct each makes files, forms, CSV columns and scripts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Union

from armctl.program.base_steps import Key, Step, keys_of
from armctl.program.draw_step import DrawStep
from armctl.program.frames import FrameStep
from armctl.program.grid_step import GridStep
from armctl.program.logic_steps import CallStep, CountStep, ElseStep, EndStep, IfStep, RepeatStep, WhileStep
from armctl.program.message_step import MessageStep
from armctl.program.motion_steps import ArcStep, LineStep, MoveStep, PointStep
from armctl.program.pick_steps import PickStep, PlaceStep
from armctl.program.signal_steps import SetStep, WaitForStep
from armctl.program.standing_steps import GripperStep, SpeedStep, ToolStep, WaitStep


class CommentStep(Step, frozen=True, kw_only=True, tag="comment"):
    """Nothing: its note is for people."""

    icon: ClassVar = "comment"
    acts: ClassVar[bool] = False
    button: ClassVar = ("Program", "Comment")


KINDS: tuple[type[Step], ...] = (
    MoveStep,
    PointStep,
    LineStep,
    ArcStep,
    DrawStep,
    PickStep,
    PlaceStep,
    WaitStep,
    GripperStep,
    SetStep,
    WaitForStep,
    MessageStep,
    RepeatStep,
    IfStep,
    ElseStep,
    WhileStep,
    GridStep,
    EndStep,
    CountStep,
    SpeedStep,
    ToolStep,
    FrameStep,
    CallStep,
    CommentStep,
)
"""the registry: every kind of step that a program may hold"""


if TYPE_CHECKING:
    AnyStep = Step
else:  # the steps that a program may hold where it is decoded by its type
    AnyStep = Union[KINDS]  # noqa: UP007


def any_step() -> Any:
    """The union of all kinds of steps, to decode one."""
    return Union[KINDS]  # noqa: UP007


def all_keys() -> tuple[Key, ...]:
    """The keys of all kinds of steps, each name once, in the order of their fields and columns."""
    found = {key.name: key for kind in KINDS for key in keys_of(kind)}
    return tuple(sorted(found.values(), key=lambda key: key.field.place))
