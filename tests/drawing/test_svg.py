"""SVG files read to strokes, against svgelements: another reader, whose curves are sampled densely."""

# pyright: reportUnknownVariableType=false, reportUnknownMemberType=false, reportUnknownArgumentType=false
# svgelements has no types

from __future__ import annotations

import io
import math
from itertools import product

import numpy as np
import pytest
import svgelements
from hypothesis import given
from hypothesis import strategies as st

from armctl.arrays import FloatArray
from armctl.drawing.files import DRAWING_FILES, parse_drawing, read_drawing
from armctl.drawing.plan import distances
from armctl.drawing.svg import read_svg
from armctl.errors import DrawingError

MOST_OFF_MM = 0.05
HEAD = '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
PAGES = (
    'width="100mm" height="60mm" viewBox="0 0 100 60"',
    'width="4in" height="3in"',
    'width="120mm" height="60mm" viewBox="-10 -5 40 40"',
    'width="300" height="200" viewBox="0 0 150 50" preserveAspectRatio="xMinYMax slice"',
    'width="8cm" height="5cm" viewBox="0 0 200 90" preserveAspectRatio="none"',
)
BODIES = (
    '<path d="M10 10 L40 12 V30 H5 Z m30 0 l5 5"/>',
    '<path d="M5,30c5-20 15,20 25-5S45,40 60 10 70 30 80 20"/>',
    '<path d="M5 5Q20 40 35 5T65 5 t20 10"/>',
    '<path d="M10 20 A15 8 30 1 0 40 25 a10 10 0 01 12-3 A 3 3 0 0 1 80 30 a5 9 0 1150-12"/>',
    '<rect x="5" y="6" width="30" height="20" rx="4"/>'
    '<rect x="45" y="6" width="20" height="9" rx="3" ry="20"/>',
    '<circle cx="30" cy="25" r="18"/><ellipse cx="60" cy="25" rx="15" ry="6" transform="rotate(30 60 25)"/>',
    '<line x1="2" y1="3" x2="40" y2="33" stroke="red"/><polyline points="1,1 5,9,9 2 30 30"/>'
    '<polygon points="50,10 70,10 60,28"/>',
    '<g transform="translate(5 3) scale(1.5 0.7)"><g transform="rotate(20)"><path d="M0 0C10 0 10 20 20 20"/>'
    '<g transform="skewX(15) matrix(1 .2 -.1 .9 2 3)"><circle cx="20" cy="12" r="6"/></g></g></g>',
    '<defs><path id="a" d="M0 0 q5 10 10 0"/></defs><use href="#a" x="10" y="10"/>'
    '<use xlink:href="#a" transform="translate(30 20) rotate(45) scale(2)"/>',
    '<path d="M0 0L10 0 10 10zl-4 4M1e1-2.5.5.5"/>',
)
CASES = list(product(PAGES, BODIES))


def svg(page: str, body: str) -> str:
    return f"{HEAD} {page}>{body}</svg>"


QUANTIZATION_MM = 0.1
"""length of the chords to which vpype cuts curves, if it is not told otherwise"""


def flattened(text: str) -> list[FloatArray]:
    """The lines of a file as svgelements has them, flattened as vpype does it [mm], y downwards.

    A curve of the length L is sampled at ⌈L / quantization⌉ equal steps of its parameter, at least two. The
    matrix comes first, so lengths are those of the page.
    """
    parsed = svgelements.SVG.parse(io.StringIO(text), ppi=96.0, reify=False)
    lines: list[FloatArray] = []
    for element in parsed.elements():
        if not isinstance(element, svgelements.Shape):
            continue
        matrix, element.transform = svgelements.Matrix(element.transform), svgelements.Matrix()
        for part in svgelements.Path(element).as_subpaths():
            points = [
                (point.x, point.y)
                for piece in svgelements.Path(part)
                if not isinstance(piece, svgelements.Move)
                for point in (matrix.point_in_matrix_space(piece.point(t)) for t in places(piece, matrix))
                if piece.start is not None
            ]
            if points and np.ptp(np.array(points), axis=0).max() > 1e-6:
                lines.append(np.array(points) * 25.4 / 96)
    return lines


def places(piece: svgelements.PathSegment, matrix: svgelements.Matrix) -> list[float]:
    """Where vpype samples a piece of a path, 0 … 1."""
    if isinstance(piece, svgelements.Line | svgelements.Close):
        return [0.0, 1.0]
    rough = [matrix.point_in_matrix_space(piece.point(t)) for t in np.linspace(0.0, 1.0, 65).tolist()]
    length = np.linalg.norm(np.diff([(point.x, point.y) for point in rough], axis=0), axis=1).sum()
    return np.linspace(0.0, 1.0, max(2, math.ceil(length * 25.4 / 96 / QUANTIZATION_MM))).tolist()


@pytest.mark.parametrize(("page", "body"), CASES, ids=lambda text: text[:24])
def test_its_lines_are_where_another_reader_has_them(page: str, body: str) -> None:
    text = svg(page, body)
    ours, theirs = read_svg(text), flattened(text)
    assert len(ours.strokes) == len(theirs)
    top = max(float(stroke.points[:, 1].max()) for stroke in ours.strokes)
    up = top + min(float(line[:, 1].min()) for line in theirs)
    for stroke, line in zip(ours.strokes, theirs, strict=True):
        line = np.stack([line[:, 0], up - line[:, 1]], axis=1)
        assert distances(line, stroke.points).max() < MOST_OFF_MM
        assert distances(stroke.points, line).max() < MOST_OFF_MM


def test_the_page_stands_upright() -> None:
    drawing = read_svg(svg('width="100mm" height="60mm" viewBox="0 0 100 60"', '<path d="M0 0H10M0 60H20"/>'))
    assert [stroke.points.round(6).tolist() for stroke in drawing.strokes] == [
        [[0.0, 60.0], [10.0, 60.0]],
        [[0.0, 0.0], [20.0, 0.0]],
    ]


@pytest.mark.parametrize("attributes", ['display="none"', 'style="visibility: hidden"', 'fill="none"'])
def test_what_is_not_seen_is_not_drawn(attributes: str) -> None:
    drawing = read_svg(svg("", f'<rect {attributes} width="9" height="9"/><circle r="3"/>'))
    assert len(drawing.strokes) == 1


def test_pictures_are_named_as_left_out() -> None:
    body = '<path d="M0 0L9 9"/>\n<image href="x.png"/><foreignObject>Hello</foreignObject>'
    assert read_svg(svg("", body)).left_out == ("a picture (line 2)", "a foreign object (line 2)")
    with pytest.raises(DrawingError, match="it draws nothing; left out: a picture"):
        read_svg(svg("", '<image href="x.png"/>'))


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ('\n<path id="p" d="M0 0 L5 x"/>', "line 2, <path id='p'>: path data: L needs a number"),
        ('<path d="L5 5"/>', "line 1, <path>: path data: it begins with L"),
        ('<path d="M0 0 A5 5 0 2 0 1 1"/>', "A needs a flag, 0 or 1,"),
        ('<rect width="-3" height="2"/>', "<rect>: width is -3; it cannot be negative"),
        ('<circle r="3furlongs"/>', "<circle>: r: '3furlongs' is no length"),
        ('<g transform="turn(3)"/>', "<g>: transform: 'turn(3)' is none"),
        ('<g transform="rotate(1 2)"/>', "rotate takes 1 or 3 numbers, not 2"),
        ('<polygon points="1 2 3"/>', "points: 3 numbers are no pairs"),
        ('<use href="#none"/>', "no element has the id 'none'"),
        ('<g id="a"><use href="#a"/></g>', "it draws itself again"),
        ('<path d="M0 0L1e11 0"/>', "m away from the page"),
        ("<g>" * 120 + "</g>" * 120, "more than 100 elements in each other"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(body: str, says: str) -> None:
    with pytest.raises(DrawingError) as refusal:
        read_svg(svg("", body))
    assert says in str(refusal.value)


def test_use_of_use_does_not_take_for_ever() -> None:
    layers = "".join(
        f'<g id="l{k}">{f"<use href=%sl{k - 1}%s/>" % (chr(34) + "#", chr(34)) * 10}</g>'
        for k in range(1, 12)
    )
    with pytest.raises(DrawingError, match="more than"):
        read_svg(svg("", f'<g id="l0"><path d="M0 0L1 1"/></g>{layers}'))


def test_entities_and_other_files_are_refused() -> None:
    with pytest.raises(DrawingError, match="it declares entities"):
        read_svg('<!DOCTYPE svg [<!ENTITY a "b">]><svg>&a;</svg>')
    with pytest.raises(DrawingError, match="is not XML"):
        read_svg("nothing")
    with pytest.raises(DrawingError, match=r"a.png: a drawing is a file \.svg, "):
        read_drawing("a.png")
    with pytest.raises(DrawingError, match="is larger than 4096 KiB"):
        parse_drawing("a.svg", b" " * (DRAWING_FILES.most_bytes + 1))


PIECES = st.sampled_from(
    [
        *"MmLlHhVvCcSsQqTtAaZz",
        "0",
        "1",
        "-3.5",
        "1e3",
        "1e999",
        ".",
        ",",
        "NaN",
        "0 0",
        "5 5 0 1 0 9 9",
        "\x01",
    ]
)


@given(st.lists(PIECES, max_size=14).map(" ".join) | st.text(max_size=40))
def test_no_path_crashes_the_reader(path: str) -> None:
    escaped = path.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    try:
        drawing = read_svg(svg("", f'<path d="M0 0 {escaped}"/><path d="M0 0L1 1"/>'))
    except DrawingError:
        return
    assert all(np.isfinite(stroke.points).all() for stroke in drawing.strokes)


@given(st.binary(max_size=200) | st.text(max_size=200).map(str.encode))
def test_no_file_crashes_the_reader(content: bytes) -> None:
    for name in ("a.svg", "a.gcode"):
        for begin in (b"", svg("", "").encode()[:-6], b"G1 X1 Y1\n"):
            try:
                drawing = parse_drawing(name, begin + content)
            except DrawingError:
                continue
            assert drawing.strokes
