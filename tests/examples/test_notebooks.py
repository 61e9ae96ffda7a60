"""The notebooks run from top to bottom, and print what is kept in their files.

After a change: ``python -m tests.examples.test_notebooks`` runs them and keeps what they print and draw.
"""

from __future__ import annotations

import copy
import re
import tempfile
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from nbformat import NotebookNode

NOTEBOOKS = sorted((Path(__file__).parents[2] / "examples").glob("*.ipynb"))
MOST_BYTES = 300_000
"""a notebook keeps small figures only"""


def run(kept: NotebookNode, folder: Path) -> NotebookNode:
    """A notebook after a run from a fresh start."""
    fresh = copy.deepcopy(kept)
    place = {"metadata": {"path": str(folder)}}
    NotebookClient(fresh, timeout=120, kernel_name="python3", record_timing=False, resources=place).execute()
    return fresh


def printed(notebook: NotebookNode) -> list[str]:
    """What each cell of code prints, and how many figures it draws."""
    cells: list[str] = []
    for cell in notebook.cells:
        if cell.cell_type == "code":
            text = "".join(one.get("text", "") for one in cell.outputs)
            figures = sum("image/png" in one.get("data", {}) for one in cell.outputs)
            cells.append(f"{text}[{figures} figures]")
    return cells


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_it_prints_what_its_file_shows(path: Path, tmp_path: Path) -> None:
    kept = nbformat.read(path, as_version=4)
    assert printed(run(kept, tmp_path)) == printed(kept)
    shown = re.findall(r'src="([^"]+\.html)"', path.read_text(encoding="utf-8").replace('\\"', '"'))
    assert shown or path.name != "first_arm.ipynb", "it shows its twin"
    assert all((tmp_path / page).stat().st_size > 10_000 for page in shown)
    assert sum("[1 figures]" in one for one in printed(kept)) >= 2
    assert path.stat().st_size < MOST_BYTES


def main() -> None:
    """Run all and keep what they print."""
    for path in NOTEBOOKS:
        with tempfile.TemporaryDirectory() as folder:
            fresh = run(nbformat.read(path, as_version=4), Path(folder))
        fresh.metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
        nbformat.write(fresh, path)


if __name__ == "__main__":
    main()
