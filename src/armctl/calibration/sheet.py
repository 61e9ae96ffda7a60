"""A sheet of numbered crosshairs to touch, fitted to an arm's reach; as SVG and as PDF.

The sheet lies flat before the arm, its long side across. Its frame has the origin in the middle, x away from
the base, y to the left and z up. Where it truly lies is found with the rest (``touch_fit``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from html import escape
from typing import Literal

import numpy as np

from armctl.arrays import FloatArray
from armctl.calibration.next_touch import reachable_at
from armctl.calibration.touch_model import LEAST_POINTS
from armctl.errors import CalibrationError
from armctl.lazy_dataclass import dataclass
from armctl.robot import Robot

Paper = Literal["a4", "letter"]
PAPERS_MM: dict[Paper, tuple[float, float]] = {"a4": (297.0, 210.0), "letter": (279.4, 215.9)}
"""along its long side, and along its short one"""
_ROWS, _COLUMNS = 3, 5
_BORDER_MM = 32.0
"""from an edge to the crosshairs: printers leave some of it white, and the scale bar lies there"""
_SHARES = (1.0, 0.8, 0.6, 0.45)
"""of the paper on which the crosshairs lie, where the arm does not reach all of it"""
_ENOUGH = 10
_NEAREST_M = 0.04
_LOOKED_AT = 24
_HEIGHTS_M = tuple(round(0.02 * step, 2) for step in range(11))
"""from the floor upwards: where a sheet is tried"""
SCALE_BAR_MM = 100.0
_BAR_MM = (30.0, 14.0)
"""where its left end is, from the lower left corner"""
_ARM_MM = 6.0


@dataclass(frozen=True, slots=True, eq=False)
class TouchSheet:
    """Crosshairs on paper that lies before an arm; number 1 is the first row of ``points_m``."""

    title: str
    """of the arm"""
    paper: Paper
    points_m: FloatArray
    """(k, 3) in the frame of the sheet, whole millimetres [m]"""
    place_m: FloatArray
    """(3,) where the middle lies as it is drawn, base frame [m]"""
    height_m: float = 0.0
    """how high over the floor it lies, on something flat [m]"""

    @property
    def laid_m(self) -> FloatArray:
        """(k, 3) the crosshairs in the base frame where the sheet lies as it is drawn [m]."""
        return self.points_m + self.place_m

    @property
    def size_mm(self) -> tuple[float, float]:
        """Its width and its depth."""
        return PAPERS_MM[self.paper]

    @property
    def raised(self) -> str:
        """How high it lies, in words; empty: on the floor."""
        return f"about {1000 * self.height_m:.0f} mm high, such as books" if self.height_m else ""

    def svg(self) -> str:
        """The sheet as an SVG file, 1 unit = 1 mm."""
        width, depth = self.size_mm
        parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{depth}mm" '
            f'viewBox="0 0 {width} {depth}">',
            f"<title>{escape(self.title)}</title>",
        ]
        for one in self._drawing():
            if isinstance(one, _Line):
                parts.append(
                    f'<line x1="{one.x:.3f}" y1="{depth - one.y:.3f}" x2="{one.to_x:.3f}" '
                    f'y2="{depth - one.to_y:.3f}" stroke="black" stroke-width="{one.width}"/>'
                )
            else:
                parts.append(
                    f'<text x="{one.x:.3f}" y="{depth - one.y:.3f}" font-size="{one.size}" '
                    f'font-family="Helvetica, Arial, sans-serif">{escape(one.text)}</text>'
                )
        return "\n".join([*parts, "</svg>\n"])

    def pdf(self) -> bytes:
        """The sheet as a PDF file of one page, lines and text only."""
        width, depth = self.size_mm
        content = [f"{_POINTS_A_MM:.6f} 0 0 {_POINTS_A_MM:.6f} 0 0 cm"]
        for one in self._drawing():
            if isinstance(one, _Line):
                content.append(f"{one.width} w {one.x:.3f} {one.y:.3f} m {one.to_x:.3f} {one.to_y:.3f} l S")
            else:
                text = one.text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
                content.append(f"BT /F {one.size} Tf {one.x:.3f} {one.y:.3f} Td ({text}) Tj ET")
        stream = "\n".join(content).encode("cp1252", "replace")
        box = f"0 0 {width * _POINTS_A_MM:.3f} {depth * _POINTS_A_MM:.3f}"
        return _pdf_file([
            b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
            b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
            f"<< /Type /Page /Parent 2 0 R /MediaBox [{box}] /Contents 4 0 R "
            "/Resources << /Font << /F 5 0 R >> >> >>".encode(),
            b"<< /Length %d >>\nstream\n%s\nendstream" % (len(stream), stream),
            b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
        ])  # fmt: skip

    def _drawing(self) -> Iterator[_Line | _Text]:
        """What is printed; the origin is the lower left corner, where the base is below."""
        width, depth = self.size_mm
        for number, (x, y, _) in enumerate((1000 * self.points_m).tolist(), 1):
            across, up = width / 2 - y, depth / 2 + x
            yield _Line(across - _ARM_MM, up, across + _ARM_MM, up, 0.2)
            yield _Line(across, up - _ARM_MM, across, up + _ARM_MM, 0.2)
            yield _Text(across + 1.5, up + 1.5, str(number), 4.5)
        left, up = _BAR_MM
        yield _Line(left, up, left + SCALE_BAR_MM, up, 0.4)
        for end in (left, left + SCALE_BAR_MM):
            yield _Line(end, up - 2, end, up + 2, 0.4)
        yield _Text(left, up + 3.5, "100 mm: measure it; print anew at 100 % where it is another length", 3.2)
        middle = width / 2
        yield _Line(middle, 3, middle, 20, 0.3)
        yield _Line(middle, 3, middle - 2, 7, 0.3)
        yield _Line(middle, 3, middle + 2, 7, 0.3)
        away = 1000 * float(self.place_m[0]) - depth / 2
        where = f"{abs(away):.0f} mm {'below' if away >= 0 else 'above'} this edge"
        yield _Text(middle + 4, 10, f"base of {self.title}: its first axis {where}, about", 3.2)
        down = "tape the sheet down" if not self.height_m else f"lay it on something flat, {self.raised}"
        yield _Text(middle + 4, 5.5, f"{down}; where it truly lies is found by touching", 3.2)
        yield _Text(left, depth - 14, f"{self.title}: {len(self.points_m)} crosshairs to touch", 4.5)


def touch_sheet(robot: Robot, paper: Paper = "a4") -> TouchSheet:
    """The sheet for an arm: in the middle of its reach over the floor, with crosshairs that it can touch.

    An arm whose hand stays level, or that is short, may touch no floor: its sheet lies on something flat, as
    low as can be. May take seconds. ``CalibrationError``: it reaches too few crosshairs at any height.
    """
    best = TouchSheet(robot.title, paper, np.empty((0, 3)), np.array((0.0, 0.0, robot.floor_z)))
    for height in _HEIGHTS_M:
        found = _sheet_at(robot, paper, height)
        best = found if len(found.points_m) > len(best.points_m) else best
        if len(best.points_m) >= _ENOUGH:
            break
    if len(best.points_m) < LEAST_POINTS:
        raise CalibrationError(
            f"{robot.title} reaches {len(best.points_m)} points of a sheet that lies on the floor "
            f"(z = {1000 * robot.floor_z:.0f} mm) or up to {1000 * _HEIGHTS_M[-1]:.0f} mm above it; "
            f"{LEAST_POINTS} are needed: use known places in the base frame, such as the top of a block"
        )
    return best


def _sheet_at(robot: Robot, paper: Paper, height_m: float) -> TouchSheet:
    """The sheet that lies so high over the floor, with as many crosshairs as the arm can touch there."""
    width, depth = PAPERS_MM[paper]
    away = np.linspace(_NEAREST_M, max(robot.chain.length, 2 * _NEAREST_M), _LOOKED_AT)
    line = np.column_stack([away, np.zeros(_LOOKED_AT), np.full(_LOOKED_AT, robot.floor_z + height_m)])
    reached = reachable_at(robot, line, line).points_m[:, 0]
    best, place = np.empty((0, 3)), np.array((0.0, 0.0, robot.floor_z + height_m))
    if not len(reached):
        return TouchSheet(robot.title, paper, best, place, height_m)
    middle = max((reached.min() + reached.max()) / 2, _NEAREST_M + depth / 2000)
    place[0] = round(float(middle), 3)
    for share in _SHARES:
        up = np.linspace(-1, 1, _ROWS) * np.floor(share * (depth / 2 - _BORDER_MM))
        across = np.linspace(1, -1, _COLUMNS) * 2 * np.floor(share * (width / 2 - _BORDER_MM) / 2)
        grid = np.array([(x, y, 0.0) for x in up for y in across]) / 1000
        found = reachable_at(robot, grid, grid + place).points_m
        kept = grid[[bool((found == point).all(axis=1).any()) for point in grid]]
        best = kept if len(kept) > len(best) else best
        if len(best) >= _ENOUGH:
            break
    return TouchSheet(robot.title, paper, best, place, height_m)


@dataclass(frozen=True, slots=True)
class _Line:
    """[mm]."""

    x: float
    y: float
    to_x: float
    to_y: float
    width: float


@dataclass(frozen=True, slots=True)
class _Text:
    """Its left end on the base line [mm]."""

    x: float
    y: float
    text: str
    size: float


_POINTS_A_MM = 72 / 25.4


def _pdf_file(objects: list[bytes]) -> bytes:
    """Numbered objects, the catalog first, with their table and trailer (ISO 32000-1, 7.5)."""
    file, places = bytearray(b"%PDF-1.4\n"), list[int]()
    for number, one in enumerate(objects, 1):
        places.append(len(file))
        file += b"%d 0 obj\n%s\nendobj\n" % (number, one)
    table = len(file)
    file += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    file += b"".join(b"%010d 00000 n \n" % place for place in places)
    file += b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, table)
    return bytes(file)


WRITERS: dict[str, Callable[[TouchSheet], bytes]] = {
    ".svg": lambda sheet: sheet.svg().encode(),
    ".pdf": TouchSheet.pdf,
}
"""by the end of a file's name"""
