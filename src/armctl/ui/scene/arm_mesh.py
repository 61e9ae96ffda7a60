"""One mesh of an arm as it is drawn, and the names of the frames that meshes are in."""

from __future__ import annotations

from dataclasses import dataclass

from armctl.robot.look.stock import Paint, Theme, paint
from armctl.robot.parts import Color
from armctl.robot.solids import Solid

TOOL = "tool"
"""the frame at the tool point"""


def link_frame(link: int) -> str:
    """The name of a link's frame below the arm's own; -1: the base."""
    return f"link{link}" if link >= 0 else "base"


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """One surface of one colour."""

    name: str
    """below the arm's own: that of its frame, and what tells it from others there"""
    solid: Solid
    """in that frame [m]"""
    color: Color | Paint
    flat: bool = False
    """each triangle is seen, as machines have edges; else its normals leave only doubled vertices sharp"""

    def color_in(self, theme: Theme) -> Color:
        """Red, green and blue (0..255)."""
        return paint(self.color, theme) if isinstance(self.color, str) else self.color
