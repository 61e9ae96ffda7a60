"""Manual → Drawing: what is chosen or written becomes a file beside the programs."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.ui.page_kit import FakePage

from armctl.drawing import read_drawing
from armctl.errors import DrawingError
from armctl.program import Program
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.manual.drawing import DrawingForm

UZUNER = load_robot("uzuner")


@pytest.fixture
def page(server: GuardedServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakePage:
    page = FakePage(server, UZUNER, UZUNER.pose("home"))
    page.require_operator = lambda: None  # type: ignore[attr-defined]

    def nothing(*_: object) -> None:
        """Other parts of the page."""

    shared = SimpleNamespace(
        folder=tmp_path / "programs", file_came=nothing, program=Program(robot="uzuner", name="p")
    )
    page.console.shared = lambda _: shared
    for part in ("ProgramEditor", "ToolSteps", "ToolJog"):
        monkeypatch.setattr(f"armctl.ui.tabs.manual.drawing.{part}", nothing)
    DrawingForm(page.session)
    return page


def test_a_name_that_is_typed_is_a_drawing(page: FakePage, tmp_path: Path) -> None:
    page.field("Or write").value = "Ada & Şule"
    page.press("Write this")
    drawing = read_drawing(tmp_path / "programs" / "Ada_Şule.svg")
    low, high = drawing.box
    assert float(page.field("Width mm").value) == pytest.approx(high[0] - low[0], abs=0.06)
    assert f"<b>Ada_Şule.svg</b>: {len(drawing.strokes)} strokes" in page.html
    page.field("Or write").value = "  "
    with pytest.raises(DrawingError, match="there is nothing to write"):
        page.press("Write this")
