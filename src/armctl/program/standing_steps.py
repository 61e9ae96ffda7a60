"""Steps that move no joint: a wait, the gripper, the speed of what follows."""

from __future__ import annotations

from typing import Annotated, ClassVar

from msgspec import Meta

from armctl.errors import ProgramError
from armctl.program.base_steps import Effect, Field, Seconds, Step
from armctl.robot import CarriedPart, Robot
from armctl.robot.body.arm_body import LARGEST_PART_MM, THINNEST_PART_MM, edge_words
from armctl.robot.tools import grippers, tool_of

SLOWEST_PERCENT = 5
_PART_HINT = (
    "How large the part between the jaws is from then on, along X, Y, Z of the tool; its middle is at the "
    "tool point. Empty: there is none."
)
EdgeKey = Annotated[
    Annotated[float, Meta(ge=THINNEST_PART_MM, le=LARGEST_PART_MM)] | None, Field("Part mm", _PART_HINT, 51)
]
EDGES = ("part_x_mm", "part_y_mm", "part_z_mm")
"""keys of what is between the jaws"""


class HoldsPart:
    """What steps with the size of a part share. No struct: each writes its keys in an order of its own."""

    __slots__ = ()
    part_x_mm: float | None
    part_y_mm: float | None
    part_z_mm: float | None

    @property
    def part_mm(self) -> tuple[float | None, ...] | None:
        """Edges of what is between the jaws after it, as far as given (``CarriedPart``); None: nothing."""
        edges = (self.part_x_mm, self.part_y_mm, self.part_z_mm)
        return None if edges == (None, None, None) else edges


class WaitStep(Step, frozen=True, kw_only=True, tag="wait"):
    """Stand still."""

    icon: ClassVar = "wait"
    words: ClassVar = "{0.seconds:g} s"
    call: ClassVar = ("wait", "seconds")
    button: ClassVar = ("Wait and tell", "Wait", "seconds")

    seconds: Annotated[Seconds, Field("Wait time s", head="wait_s")]

    @property
    def effect(self) -> Effect:
        """The time."""
        return Effect(wait_s=self.seconds)


class GripperStep(HoldsPart, Step, frozen=True, kw_only=True, tag="gripper"):
    """Open the gripper to a percentage: 0 closed, 100 open.

    The steps after it are checked with the part that is between the jaws then.
    """

    icon: ClassVar = "gripper"
    call: ClassVar = ("gripper", "open_percent", "part_mm")
    button: ClassVar = ("Record", "Record gripper", "open_percent", *EDGES)

    open_percent: Annotated[
        float, Meta(ge=0, le=100), Field("Open %", "0 closed, 100 open.", head="gripper_percent")
    ]

    part_x_mm: EdgeKey = None
    part_y_mm: EdgeKey = None
    part_z_mm: EdgeKey = None

    @property
    def effect(self) -> Effect:
        """The opening, and the part."""
        x, y, z = self.part_x_mm, self.part_y_mm, self.part_z_mm
        part = None if x is None or y is None or z is None else CarriedPart((x, y, z))
        return Effect(opening=self.open_percent / 100, part=part)

    def describe(self) -> str:
        """The opening, and the size of the part."""
        part = "" if self.part_mm is None else f", round a part of {edge_words(self.part_mm)}"
        return f"{self.open_percent:g} % open{part}"

    def check(self, robot: Robot) -> None:
        """Refuse an arm without a gripper, and a part of which not all edges are given."""
        if not grippers(robot):
            raise ProgramError(f"{robot.name} has no gripper; delete the step")
        if self.part_mm is not None and None in self.part_mm:
            raise ProgramError(f"the size of a part needs all of {', '.join(EDGES)}")


class ToolStep(Step, frozen=True, kw_only=True, tag="tool"):
    """Say that another tool is on: its tip, weight, body and gripper count in all that comes after it.

    It moves and switches nothing: a changer (``set``) or a person (``message``) has put the tool on ahead of
    it. It stays on as a thing does: in later passes, and behind a called program that has put it on.
    """

    icon: ClassVar = "tool"
    words: ClassVar = "{0.tool} from here on"
    call: ClassVar = ("set_tool", "tool")
    button: ClassVar = ("Program", "Tool", "tool")

    tool: Annotated[
        str,
        Meta(pattern=r"^[a-z][a-z0-9_]*$"),
        Field("Tool", "A tool of the robot file.", 42, head="tool_name", offers="tools"),
    ]

    @property
    def effect(self) -> Effect:
        """The tool."""
        return Effect(tool=self.tool)

    def check(self, robot: Robot) -> None:
        """Refuse a tool that the arm has not."""
        tool_of(robot.tools, self.tool)


class SpeedStep(Step, frozen=True, kw_only=True, tag="speed"):
    """Run the steps after it at a percentage of their speed, on top of the operator's override."""

    icon: ClassVar = "speed"
    words: ClassVar = "{0.percent:g} % from here on"
    call: ClassVar = ("set_speed", "percent")
    button: ClassVar = ("Program", "Speed", "percent")

    percent: Annotated[
        float,
        Meta(ge=SLOWEST_PERCENT, le=100),
        Field("Percent", "Speed of the steps after this one.", head="speed_percent"),
    ]

    @property
    def effect(self) -> Effect:
        """The percentage."""
        return Effect(percent=self.percent)
