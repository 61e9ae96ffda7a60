"""Text of SVG files as outlines: letters against matplotlib's, their places against a browser's."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

from armctl.drawing import letters
from armctl.drawing.files import parse_drawing, written_drawing
from armctl.drawing.font_files import read_letters
from armctl.drawing.svg import read_svg
from armctl.drawing.svg_text import Letter, TextLine
from armctl.errors import DrawingError

FONTS = Path(matplotlib.get_data_path(), "fonts", "ttf")
MM = 25.4 / 96


@pytest.fixture(autouse=True, scope="module")
def read_here() -> Iterator[None]:
    """Letters are read in this process, a process for each test would take a minute."""
    letters.letters_of.cache_clear()

    def here(work: str, request: bytes, *, seconds: float) -> bytes:
        assert work.endswith(":read_letters") and seconds > 0
        return read_letters(request, lambda _: None)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(letters, "apart", here)
        yield
    letters.letters_of.cache_clear()


def svg(body: str) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 200 100" width="200" height="100">{body}</svg>'
    )


def placed(body: str, monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, float, float]]:
    """Every letter of a file, and its place [px]."""
    found: list[tuple[Letter, float, float]] = []
    places = TextLine.places

    def noted(self: TextLine) -> list[tuple[Letter, float, float]]:
        found.extend(places(self))
        return found

    monkeypatch.setattr(TextLine, "places", noted)
    read_svg(svg(body))
    return [(one.letter, x, y) for one, x, y in found]


# As Chromium places these letters (getStartPositionOfChar), with the same fonts; it rounds to 1/64 px.
IN_A_BROWSER = [
    (
        "<text x='5' y='20' font-size='10'>AVATAR To, we Çağrı ş</text>",
        [
            5,
            11.19,
            17.39,
            23.45,
            28.8,
            35.62,
            42.58,
            45.77,
            50.17,
            56.28,
            59.47,
            62.64,
            70.83,
            76.97,
            80.16,
            87.14,
            93.27,
            99.61,
            103.72,
            106.5,
            109.69,
        ],
        [20] * 21,
    ),
    (
        "<text x='50' y='20' font-size='10' text-anchor='middle'>AVATAR  "
        "<tspan font-weight='bold'>bold</tspan> x</text>",
        [12.74, 18.93, 25.13, 31.2, 36.54, 43.37, 50.32, 53.52, 60.68, 67.54, 70.98, 78.15, 81.32],
        [20] * 13,
    ),
    (
        "<text x='90' y='20' font-size='10' text-anchor='end'>one"
        "<tspan x='90' dy='1.2em'>two lines</tspan></text>",
        [71.39, 77.5, 83.84, 45.34, 49.25, 57.44, 63.55, 66.73, 69.52, 72.3, 78.62, 84.78],
        [20] * 3 + [32] * 9,
    ),
    (
        "<text font-size='10'><tspan x='3 9 20' y='10'>abcd</tspan>"
        "<tspan dx='2 3' dy='1 -1'>ef g</tspan></text>",
        [3, 9, 20, 25.48, 33.86, 43.02, 46.53, 49.7],
        [10, 10, 10, 10, 11, 10, 10, 10],
    ),
    (
        "<g style='font-size:8px;font-style:italic'><text x='5' y='20'>\n  slanted\n  words "
        "<tspan style='font-size:150%'>big</tspan>\n</text></g>",
        [
            5,
            9.16,
            11.39,
            16.28,
            21.36,
            24.5,
            29.42,
            34.5,
            37.03,
            43.58,
            48.47,
            51.77,
            56.84,
            61.02,
            63.56,
            71.17,
            74.5,
        ],
        [20] * 17,
    ),
    (
        "<text x='5' y='20' font-size='10' letter-spacing='1'>AV spaced</text>",
        [5, 12.19, 20.03, 24.22, 30.42, 37.77, 44.91, 51.39, 58.55],
        [20] * 9,
    ),
    (
        "<text x='5' y='20' font-size='10' xml:space='preserve'>  a   b </text>",
        [5, 8.17, 11.34, 17.48, 20.66, 23.83, 27.02, 33.36],
        [20] * 8,
    ),
    (
        "<text x='5' y='20' font-size='5mm' font-family='Times, serif'>Serif 12</text>",
        [5, 17.92, 29.09, 38.11, 44.16, 51.14, 57.14, 69.14],
        [20] * 8,
    ),
    (
        "<text x='5' y='20' font-size='10' font-family='monospace'>mono fi</text>",
        [5, 11.02, 17.03, 23.05, 29.08, 35.09, 41.11],
        [20] * 7,
    ),
    (
        "<text x='20 30 40' y='5 6' font-size='10'>x<tspan>yz</tspan>w<tspan x='70'>q</tspan></text>",
        [20, 30, 40, 45.25, 70],
        [5, 6, 6, 6, 6],
    ),
]


@pytest.mark.parametrize(
    ("body", "x", "y"), IN_A_BROWSER, ids=[f"{body[:40]}" for body, _, _ in IN_A_BROWSER]
)
def test_letters_stand_where_a_browser_puts_them(
    body: str, x: list[float], y: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = placed(body, monkeypatch)
    np.testing.assert_allclose([at for _, at, _ in found], x, atol=0.1)
    np.testing.assert_allclose([at for _, _, at in found], y, atol=0.1)


@pytest.mark.parametrize(
    ("attributes", "file"),
    [
        ("", "DejaVuSans"),
        ("font-weight='700'", "DejaVuSans-Bold"),
        ("font-family='DejaVu Serif' font-style='italic'", "DejaVuSerif-Italic"),
        ("style='font-family:monospace;font-weight:bold;font-style:oblique'", "DejaVuSansMono-BoldOblique"),
    ],
)
def test_letters_are_outlines_of_their_font(attributes: str, file: str) -> None:
    for letter in "Ağ&8şi%":
        drawing = read_svg(
            svg(f"<text x='7' y='90' font-size='50' {attributes}>{letter.replace('&', '&amp;')}</text>")
        )
        theirs = TextPath((7, 10), letter, size=50, prop=FontProperties(fname=str(FONTS / f"{file}.ttf")))
        polygons = [np.asarray(line, dtype=np.float64) for line in theirs.to_polygons(closed_only=False)]
        lines = [MM * line for line in polygons if len(line) > 1]
        assert len(drawing.strokes) == len(lines)
        corners = np.concatenate(lines)
        for got, wanted in zip(drawing.box, (corners.min(axis=0), corners.max(axis=0)), strict=True):
            np.testing.assert_allclose(got, wanted, atol=0.25)  # matplotlib rounds to its pixels
        assert all((stroke.points[0] == stroke.points[-1]).all() for stroke in drawing.strokes)


def test_a_text_is_moved_with_its_group_and_lies_on_the_line_that_is_asked_for() -> None:
    plain = read_svg(svg("<text x='10' y='20'>H</text>"))
    moved = read_svg(svg("<g transform='translate(5 -3) scale(2)'><text x='10' y='20'>H</text></g>"))
    expected = 2 * plain.box[0] - np.array([0, 100 * MM]) + np.array([5 * MM, 3 * MM])
    np.testing.assert_allclose(moved.box[0], expected, atol=1e-9)
    hanging = read_svg(svg("<text x='10' y='20' dominant-baseline='hanging'>H</text>"))
    assert hanging.box[1][1] == pytest.approx((100 - 20) * MM, abs=0.1)


def test_what_is_not_seen_is_not_written_and_keeps_its_room(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = read_svg(svg("<text y='20'><tspan visibility='hidden'>WW</tspan>i</text>"))
    assert len(shown.strokes) == 2 and shown.box[0][0] > 20 * MM
    for hides in ("visibility='hidden'", "display='none'", "fill='none'"):
        with pytest.raises(DrawingError, match="draws nothing"):
            read_svg(svg(f"<text {hides} y='20'>no</text>"))
    body = "<text y='20'><title>not this</title>a<tspan display='none'>b</tspan>c</text>"
    assert [one for one, _, _ in placed(body, monkeypatch)] == ["a", "c"]


def test_what_is_left_out_of_a_text_is_named() -> None:
    body = "<text y='20' rotate='45' textLength='90'>a中中文<textPath href='#p'>round</textPath></text>"
    assert read_svg(svg(body)).left_out == (
        "<textPath> in a text (line 1)",
        "the textLength of <text> (line 1)",
        "the rotate of <text> (line 1)",
        "the letters '中文' (line 1)",
    )


@pytest.mark.parametrize(
    ("body", "says"),
    [
        (
            "\n<text id='t' font-size='-2'>a</text>",
            "line 2, <text id='t'>: font-size is -2; it cannot be negative",
        ),
        ("<text font-size='big'>a</text>", "font-size: 'big' is no length"),
        ("<text dy='1.x em'>a</text>", "dy: '1.x' is no length"),
        ("<text x='1eem'>a</text>", "x: '1eem' is no length"),
        (f"<text>{'a' * 2001}</text>", "more than 2000 letters; divide the text"),
    ],
)
def test_what_is_wrong_with_a_text_is_said_with_its_place(body: str, says: str) -> None:
    with pytest.raises(DrawingError) as refusal:
        read_svg(svg(body))
    assert says in str(refusal.value)


def test_how_letters_would_look_matters_only_where_something_is_written() -> None:
    assert read_svg(
        svg("<g font-size='calc(1em + 2px)'><path d='M0 0L9 9' style='font-size:50vw'/></g>")
    ).strokes
    with pytest.raises(DrawingError, match=r"line 1, <text>: line 1, <g>: font-size: '5vw' is no length"):
        read_svg(svg("<g font-size='5vw'><text>a</text></g>"))
    low, high = read_svg(svg("<text y='50' style='font-size:2rem'>H</text>")).box
    assert high[1] - low[1] == pytest.approx(32 * 0.729 * MM, rel=0.01)


def test_a_line_of_text_becomes_a_drawing() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        name, content = written_drawing("  Ada  & <Şule>\n")
    assert name == "Ada_Şule.svg"
    drawing = parse_drawing(name, content)
    assert not drawing.left_out
    height = drawing.box[1][1] - drawing.box[0][1]
    assert 14.5 < height < 21
    assert written_drawing("?!")[0] == "text.svg"
    with pytest.raises(DrawingError, match="there is nothing to write; type a name"):
        written_drawing(" \n ")
