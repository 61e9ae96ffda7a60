"""Only ``ui/viser_seam`` touches what viser does not document."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

UI = Path(__file__).parents[2] / "src" / "armctl" / "ui"
SEAM = "viser_"
"""its module, scripts and styles begin so"""
KNOWN = {
    "_gui_input_handle_from_uuid",
    "_impl",
    "_insert_message",
    "_live_connections",
    "_scene_lifecycle_lock",
    "_viser_server",
    "_websock_connection",
    "_websock_interface",
    "_websock_server",
}
"""private names of viser that armctl uses, or has used: also not on an object of its own that viser reads"""
OF_THE_PAGE = re.compile(
    r"__viser|viser-user:|mantine|tabler|#root|data-dock|u-over|scene tree", re.IGNORECASE
)
"""what is found by reading viser's page"""


def outside(*suffixes: str) -> list[Path]:
    return [path for path in UI.rglob("*") if path.suffix in suffixes and not path.name.startswith(SEAM)]


def is_inside(module: str) -> bool:
    """Whether a module is one of viser's private ones."""
    first, *rest = module.split(".")
    return first == "viser" and any(part == "infra" or re.match("_(?!_)", part) for part in rest)


def hooks(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of each hook into viser that a module has of its own."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, one.name) for one in node.names if is_inside(one.name))
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            names = [f"{node.module}.{one.name}" for one in node.names]
            yield from ((node.lineno, name) for name in names if is_inside(name))
        elif isinstance(node, ast.Attribute):
            name = ast.unparse(node)
            if node.attr in KNOWN or is_inside(name):
                yield node.lineno, name
            elif isinstance(node.ctx, ast.Store | ast.Del) and name.startswith("viser."):
                yield node.lineno, f"a change of {name}"
        elif isinstance(node, ast.Call) and ast.unparse(node.func) in ("getattr", "setattr", "delattr"):
            of, name, *_ = [*map(ast.unparse, node.args), ""]
            if name.startswith(("'_", '"_')) or (
                of.startswith("viser.") and ast.unparse(node.func) != "getattr"
            ):
                yield node.lineno, ast.unparse(node)


@pytest.mark.parametrize(
    "line",
    [
        "from viser import _messages as wire",
        "from viser.infra import StateSerializer",
        "import viser._gui_api",
        "viser._gui_api.x()",
        "server._websock_server.stop()",
        "viser.GuiApi.add_text = other",
        "delattr(viser.GuiButtonGroupHandle, 'disabled')",
        "getattr(handle, '_impl')",
    ],
)
def test_a_hook_is_recognised(line: str) -> None:
    assert list(hooks(ast.parse(line)))


def test_python_outside_the_seam_has_no_hook_into_viser() -> None:
    found = [
        f"{path.relative_to(UI)}:{line}: {what}"
        for path in outside(".py")
        for line, what in hooks(ast.parse(path.read_text("utf-8")))
    ]
    assert not found, f"move it to viser_seam: {found}"


def test_private_attributes_of_others_are_touched_by_the_seam_alone() -> None:
    """ruff (SLF001) finds them by their underscore; who lets one pass says so in the line."""
    allowed = [
        path.name for path in outside(".py") if re.search("SLF001|reportPrivate", path.read_text("utf-8"))
    ]
    assert not allowed, f"move it to viser_seam: {allowed}"


def test_scripts_and_styles_outside_the_seam_know_nothing_of_the_page_of_viser() -> None:
    found = [
        f"{path.relative_to(UI)}: {hit[0]}"
        for path in outside(".js", ".css", ".py")
        if (hit := OF_THE_PAGE.search(path.read_text("utf-8"))) is not None
    ]
    assert not found, f"move it to viser_seam: {found}"


def test_no_style_that_asks_what_is_inside_matches_everything() -> None:
    """In a list of 2,000 rows such a rule has all of them styled anew by each change: ten times as slow."""
    found = [
        f"{path.name}: {selector}"
        for path in UI.rglob("*.css")
        for selector in re.findall(
            r"^[^@\n{}]*:has\([^\n{}]*[ >+~]\*\s*(?=[{,])", path.read_text("utf-8"), re.M
        )
    ]
    assert not found, f"name the elements that are meant: {found}"
