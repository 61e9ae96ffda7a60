"""Drawings: SVG and G-code read to strokes, laid onto a touched plane, and planned for a pen."""

from armctl.drawing.files import DRAWING_SUFFIXES, read_drawing
from armctl.drawing.plane import DrawingPlane
from armctl.drawing.strokes import PenDrawing, Stroke

__all__ = ["DRAWING_SUFFIXES", "DrawingPlane", "PenDrawing", "Stroke", "read_drawing"]
