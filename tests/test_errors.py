"""Errors that a page of the docs helps with end with its address."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from armctl import errors
from armctl.cli.main import REFUSED, run
from armctl.errors import DOCS, ArmctlError, InputError, UnreachableError, out_of_range, with_help

ROOT = Path(__file__).parents[1]
KINDS = [one for one in vars(errors).values() if isinstance(one, type) and issubclass(one, ArmctlError)]


def test_each_section_is_there() -> None:
    page = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    headings = re.findall(r"^## (.+)$", page, re.MULTILINE)
    anchors = {re.sub(r"[^\w]+", "-", heading.lower()).strip("-") for heading in headings}
    sections = {kind.section for kind in KINDS if kind.section}
    assert len(sections) > 10 and sections <= anchors


def test_the_address_is_that_of_the_published_docs() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["urls"]["Documentation"] == DOCS
    assert f"site_url: {DOCS}\n" in (ROOT / "mkdocs.yml").read_text(encoding="utf-8")


def test_the_address_ends_the_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["ik", "uzuner", "900", "0", "0"]) == REFUSED
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("armctl: ") and err.count("\n") == 1
    assert err.endswith(f" – see {DOCS}troubleshooting/#the-target-is-out-of-reach\n")
    assert with_help(UnreachableError("too far")).startswith("too far – see ")
    assert with_help(InputError("not finite")) == "not finite"


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (140.0, "140 % is outside 0 … 100 %"),
        (100.0000001, "100.0000001 % is outside 0 … 100 %"),
        (-1e-9, "-1e-09 % is outside 0 … 100 %"),
        (float("nan"), "nan % is outside 0 … 100 %"),
    ],
)
def test_what_is_outside_a_range_does_not_read_as_its_end(value: float, said: str) -> None:
    assert out_of_range(value, 0, 100, "%") == said
