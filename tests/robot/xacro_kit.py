"""xacro files expanded by armctl and by the package ``xacro``, for comparison."""

from __future__ import annotations

import contextlib
import io
import sys
import types
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.dom import minidom
from xml.etree import ElementTree

import pytest

from armctl.errors import RobotFileError
from armctl.robot.urdf import UrdfSource
from armctl.robot.urdf.reading import parse_xml
from armctl.robot.urdf.xacro import expand

Tree = tuple[str, dict[str, str], str, list[Any]]


def robot(content: str, name: str = "arm") -> str:
    """A file with this content."""
    return f'<robot name="{name}" xmlns:xacro="http://www.ros.org/wiki/xacro">{content}</robot>'


def write(folder: Path, files: Mapping[str, str]) -> Path:
    """The files below a folder; the first of them is the arm's."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(robot(content) if name.endswith(".xacro") else content)
    return folder / next(iter(files))


def by_armctl(file: Path, arguments: Mapping[str, str] | None = None) -> Tree:
    """The tree that armctl makes of a file."""
    return _tree(expand(parse_xml(file.read_bytes(), file), UrdfSource.at(file), arguments or {}).root)


def by_package(
    file: Path, monkeypatch: pytest.MonkeyPatch, arguments: Mapping[str, str] | None = None
) -> Tree:
    """The tree that the package makes of it, which finds packages where armctl finds them."""

    def find(name: str) -> str:
        place = UrdfSource.at(file).package(name)
        if place is None:
            raise RobotFileError(name)
        return str(place.absolute())

    package, module = types.ModuleType("ament_index_python"), types.ModuleType("packages")
    vars(module)["get_package_share_directory"] = find
    monkeypatch.setitem(sys.modules, "ament_index_python", package)
    monkeypatch.setitem(sys.modules, "ament_index_python.packages", module)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        made = import_module("xacro").process_file(str(file), mappings=dict(arguments or {}))
    return _tree_of_document(made.documentElement)


def _tree_of_document(node: minidom.Element) -> Tree:
    texts, inside = [""], list[tuple[Tree, str]]()
    for child in node.childNodes:
        if isinstance(child, minidom.Element):
            inside.append((_tree_of_document(child), ""))
            texts.append("")
        elif isinstance(child, minidom.Text):
            texts[-1] += child.data
    first, *tails = (" ".join(text.split()) for text in texts)
    attributes = {name: str(value) for name, value in node.attributes.items()}
    return (
        node.tagName,
        attributes,
        first,
        [(one, tail) for (one, _), tail in zip(inside, tails, strict=True)],
    )


def _tree(element: ElementTree.Element) -> Tree:
    """What an element says, whatever blanks stand in it."""
    inside = [(_tree(child), " ".join((child.tail or "").split())) for child in element]
    return element.tag, dict(element.attrib), " ".join((element.text or "").split()), inside
