"""A grid of cells: a pallet, a tray, a rack."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal, Self

import msgspec
import numpy as np
from msgspec import Meta

from armctl.arrays import FloatArray
from armctl.errors import ProgramError
from armctl.program.base_steps import BlockStep, Field
from armctl.robot import Robot

MOST_CELLS = 10_000
Order = Literal["rows", "columns", "snake"]
_Count = Annotated[int, Meta(ge=1, le=MOST_CELLS)]
_First = Annotated[float, Field("First cell mm", "X, Y, Z of the first cell.", 1, touched=True)]
_RowEnd = Annotated[
    float, Field("Row end mm", "X, Y, Z of the last cell of the first row.", 70, touched=True)
]
_ColumnEnd = Annotated[
    float, Field("Column end mm", "X, Y, Z of the last cell of the first column.", 71, touched=True)
]
CORNERS = tuple(tuple(f"{end}{axis}_mm" for axis in "xyz") for end in ("", "row_", "column_"))
_PLACES = tuple(key for keys in CORNERS for key in keys)
"""keys of the three corners, each of three, and all of them"""


class GridStep(BlockStep, frozen=True, kw_only=True, tag="grid"):
    """Run the steps as far as ``end`` once in each cell of a grid that three corners give.

    Points inside with ``frame = "cell"`` begin at the cell: ``z_mm = 60`` is 60 mm above it. All others stay
    where they are, such as the place that parts are picked from.
    """

    icon: ClassVar = "grid"
    acts: ClassVar[bool] = False
    button: ClassVar = ("Decide and repeat", "Grid", *_PLACES, "rows", "columns")

    x_mm: _First
    y_mm: _First
    z_mm: _First
    row_x_mm: _RowEnd
    row_y_mm: _RowEnd
    row_z_mm: _RowEnd
    column_x_mm: _ColumnEnd
    column_y_mm: _ColumnEnd
    column_z_mm: _ColumnEnd
    rows: Annotated[_Count, Field("Rows", place=72)]
    columns: Annotated[_Count, Field("Columns", "Cells in each row.", 73)]
    layers: Annotated[_Count, Field("Layers", "On top of each other.", 74, more=True)] = 1
    layer_mm: Annotated[
        float, Field("Layer mm", "Height of a layer; below 0: from the top down.", 75, more=True)
    ] = 0.0
    """along Z of the frame; the corners are those of the first layer"""
    order: Annotated[Order, Field("Order", "snake: every other row backwards.", 76, more=True)] = "rows"
    """rows: along each row; columns: along each column; snake: along rows, every other one backwards"""

    @property
    def passes(self) -> int:
        """The cells."""
        return self.rows * self.columns * self.layers

    def moved(self, T: FloatArray) -> Self:
        """Its corners in another frame, as of any step."""
        corners = np.stack(self._corners()) @ T[:3, :3].T + T[:3, 3]
        return msgspec.structs.replace(self, **dict(zip(_PLACES, corners.ravel().tolist(), strict=True)))

    def describe(self) -> str:
        """How many cells, and their order."""
        layers = "" if self.layers == 1 else f" × {self.layers} layers"
        return f"{self.rows} rows × {self.columns} columns{layers}, {self.order}"

    def check(self, robot: Robot) -> None:
        """Refuse too many cells, and corners that give no grid."""
        if self.passes > MOST_CELLS:
            raise ProgramError(f"a grid has at most {MOST_CELLS} cells, not {self.passes}")
        if self.layers > 1 and self.layer_mm == 0:
            raise ProgramError(f"{self.layers} layers need a layer_mm other than 0")
        first, row, column = self._corners()
        sides = [end - first for end, count in ((row, self.columns), (column, self.rows)) if count > 1]
        if any(np.linalg.norm(side) == 0 for side in sides):
            raise ProgramError("several cells would be in the same place: the corners must be apart")
        if len(sides) > 1 and np.linalg.matrix_rank(np.array(sides), tol=1e-6) < 2:
            raise ProgramError("the three corners lie on a line: they give no grid")

    def place(self, number: int) -> tuple[int, int, int]:
        """Row, column and layer of a cell, each from 0; ``number`` counts cells in their order, from 0."""
        layer, rest = divmod(number, self.rows * self.columns)
        if self.order == "columns":
            column, row = divmod(rest, self.rows)
        else:
            row, column = divmod(rest, self.columns)
            if self.order == "snake" and row % 2 == 1:
                column = self.columns - 1 - column
        return row, column, layer

    def cell(self, number: int) -> tuple[float, float, float]:
        """Where a cell is, X, Y, Z in the frame of the step [mm]; ``number`` as in ``place``."""
        first, row_end, column_end = self._corners()
        row, column, layer = self.place(number)
        point = first + (row_end - first) * (column / max(self.columns - 1, 1))
        point = point + (column_end - first) * (row / max(self.rows - 1, 1))
        x, y, z = point.tolist()
        return x, y, z + layer * self.layer_mm

    def _corners(self) -> Sequence[FloatArray]:
        return [np.array([getattr(self, key) for key in keys]) for keys in CORNERS]
