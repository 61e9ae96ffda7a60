"""The form of a drawing on a page: what is shown of the file, and what is touched of the surface."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.ui.page_kit import FakePage

from armctl.drawing.files import parse_drawing
from armctl.errors import StateError
from armctl.facts import State
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.manual.drawing import DrawingForm, preview_svg
from armctl.ui.tabs.manual.shared_program import SharedProgram

ROBOT = load_robot("uzuner")
FILE = Path(__file__).resolve().parents[2] / "examples" / "name.svg"


class DrawingPage(FakePage):
    def __init__(self, server: GuardedServer, folder: Path) -> None:
        super().__init__(server, ROBOT, ROBOT.pose("home"))
        self.shared = SharedProgram("uzuner", folder)
        self.console.shared = lambda kind: self.shared
        self.form = DrawingForm(self.session)

    def require_operator(self) -> None:
        """It operates."""


def test_a_file_is_seen_before_it_is_placed(server: GuardedServer, tmp_path: Path) -> None:
    page = DrawingPage(server, tmp_path)
    assert "<i>1</i> The drawing" in page.html and "armctl-preview" not in page.html
    label = "Choose a drawing (SVG, G-code)"
    page._handles[label] = SimpleNamespace(value=None)
    page.form._upload = SimpleNamespace(value=SimpleNamespace(name="name.svg", content=FILE.read_bytes()))
    page.press(label)
    assert "armctl-preview" in page.html and "<i class='done'>✓</i> The drawing" in page.html


def test_a_preview_has_each_stroke_the_right_way_up_and_stays_small() -> None:
    drawing = parse_drawing("name.svg", FILE.read_bytes())
    svg = preview_svg(drawing)
    assert svg.count("M") == len(drawing.strokes)
    (low, high) = drawing.box
    first = re.search(r"M([\d.]+) ([\d.]+)", svg)
    assert first is not None
    x, y = drawing.strokes[0].points[0]
    assert float(first[1]) == pytest.approx(x - low[0], abs=0.01)
    assert float(first[2]) == pytest.approx(high[1] - y, abs=0.01)
    many = "M0 0" + "".join(f"L{k % 100} {k / 10}" for k in range(1, 9000))
    large = parse_drawing(
        "many.svg", f"<svg xmlns='http://www.w3.org/2000/svg'><path d='{many}'/></svg>".encode()
    )
    assert len(preview_svg(large)) < 60_000


def test_what_is_touched_and_what_is_missing_stand_in_a_list_of_one_height(
    server: GuardedServer, tmp_path: Path
) -> None:
    page = DrawingPage(server, tmp_path)
    page.press("Touch here", "Origin")
    assert page.html.count("<b>✓ Origin</b> (") == 1 and "○ Upwards: somewhere on its left edge" in page.html
    page.press("Touch here", "To the right")
    assert "<i>2</i> The surface" in page.html
    page.press("Touch here", "More")
    assert "✓ More: 1 touched" in page.html
    page.press("Touch here", "Origin")  # begins anew
    assert "○ More: where the surface bends" in page.html
    page.snapshot.state = State.MOVING
    with pytest.raises(StateError, match="touch when it stands"):
        page.press("Touch here", "Upwards")
