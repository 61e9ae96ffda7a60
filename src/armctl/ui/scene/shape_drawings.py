"""The shapes of an arm's files as they are drawn, kept for all pages."""

from __future__ import annotations

import os
from collections.abc import Mapping

from armctl.robot import Robot
from armctl.robot.meshes import Drawn, coarse_solids
from armctl.robot.parts import Shape
from armctl.robot.solids import grown
from armctl.ui.scene.arm_mesh import Mesh, link_frame

MOST_DRAWN, MOST_GHOSTLY = 30_000, 8_000
"""triangles of an arm (0.8 MB for each page), and of a ghost, of which a page may have many"""
_KEPT = 8
"""drawings: those of four arms"""


class _Drawings:
    """The drawings of some arms, as every page and every ghost asks for them, and reading takes seconds."""

    def __init__(self) -> None:
        self._kept: dict[tuple[tuple[Shape, ...], int], tuple[object, Drawn]] = {}

    def of(self, shapes: tuple[Shape, ...], most: int, *, anew: bool) -> Drawn:
        known = self._kept.get((shapes, most))
        if known is None or (anew and known[0] != _stamps(shapes)):
            return self.keep(shapes, most, coarse_solids(shapes, most))
        self._kept[shapes, most] = self._kept.pop((shapes, most))  # the newest: what is shown stays
        return known[1]

    def keep(self, shapes: tuple[Shape, ...], most: int, drawn: Drawn) -> Drawn:
        self._kept.pop((shapes, most), None)
        while len(self._kept) >= _KEPT:
            del self._kept[next(iter(self._kept))]
        self._kept[shapes, most] = _stamps(shapes), drawn
        return drawn


_DRAWINGS = _Drawings()


def drawn_solids(shapes: tuple[Shape, ...], most: int = MOST_DRAWN) -> Drawn:
    """As ``coarse_solids``, kept; read anew where a file has changed. May take seconds."""
    return _DRAWINGS.of(shapes, most, anew=True)


def keep_drawn(shapes: tuple[Shape, ...], drawn: Mapping[int, Drawn]) -> None:
    """Keep drawings by their number of triangles: the pages draw an arm as it was when it was opened."""
    for most, one in drawn.items():
        _DRAWINGS.keep(shapes, most, one)


def _stamps(shapes: tuple[Shape, ...]) -> tuple[tuple[int, int] | None, ...]:
    """What changes with the files: their times and sizes; None: there is none."""
    return tuple(_stamp(shape.file) for shape in shapes)


def _stamp(file: str) -> tuple[int, int] | None:
    try:
        status = os.stat(file)
    except (OSError, ValueError):
        return None
    return status.st_mtime_ns, status.st_size


def shape_meshes(robot: Robot, out: float, most: int) -> list[tuple[int, Mesh]]:
    """What the arm's file shows of its links, and of which link: ``out`` [m] larger all round."""
    look, found = robot.look, list[tuple[int, Mesh]]()
    for i, (link, color, solid) in enumerate(_DRAWINGS.of(robot.shapes, most, anew=False)):
        color = color or look.links[max(link, 0) % len(look.links)]
        solid = grown(solid, out) if out > 0 else solid
        found.append((link, Mesh(f"{link_frame(link)}/s{i}", solid, color, flat=True)))
    return found
