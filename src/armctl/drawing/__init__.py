"""Drawings: SVG and G-code read to strokes, laid onto a touched plane, and planned for a pen."""

from armctl.drawing.files import DRAWING_SUFFIXES, read_drawing
from armctl.drawing.plane import DrawingPlane
from armctl.drawing.strokes import Drawing, Stroke

__all__ = ["DRAWING_SUFFIXES", "Drawing", "DrawingPlane", "Stroke", "read_drawing"]
