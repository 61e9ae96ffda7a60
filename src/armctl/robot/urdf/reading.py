"""The files of an arm read: XML and YAML within bounds, and only from where an arm's files may be.

A xacro file names further files. They are regular files below the folder that the arm was unpacked into, or
below the package of the file, or below packages that ``$(find …)`` finds. What a link leads to counts.
"""

from __future__ import annotations

import fnmatch
import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, cast
from xml.etree import ElementTree
from xml.parsers import expat

import yaml

from armctl.documents import DocumentKind
from armctl.errors import RobotFileError
from armctl.robot.urdf.package import UrdfSource
from armctl.robot.urdf.unpacking import MOST_FILES
from armctl.robot.urdf.xacro_expression import Budget
from armctl.robot.urdf.xacro_functions import FixedList, shown, weight

URDF_FILES = DocumentKind(RobotFileError, most_bytes=4 * 1024 * 1024)
YAML_FILES = DocumentKind(RobotFileError, most_bytes=256 * 1024)
_PART_BYTES = 64 * 1024
"""handed to the XML parser at once, which lets no other thread run meanwhile"""
_DEEPEST = 100
"""elements inside of each other"""
_DEEPEST_YAML = 30
_LONGEST_NUMBER = 100
"""characters of a number in YAML"""
_NODE_STEPS, _PLACE_STEPS, _PACKAGE_STEPS = 100, 100, 2000
"""what it costs to read a node of YAML, to find where a name leads, and to look for a package"""
_WILD = frozenset("*?[")
_MOST_ELEMENTS = 100_000
"""of one file: each takes half a kilobyte of memory"""


class Element(ElementTree.Element):
    """An element that knows where it is written."""

    file: Path = Path()
    line: int = 0


class MissingPackageError(RobotFileError):
    """No folder holds the package that ``$(find …)`` names."""


def parse_xml(content: bytes, file: Path) -> Element:
    """The root element of an XML file; refuses document types and what is nested too deep."""
    builder, parser = ElementTree.TreeBuilder(element_factory=Element), expat.ParserCreate("utf-8")
    content = _in_utf8(content)
    depth, count, literal = 0, 0, False

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth += 1
        count += 1
        if count > _MOST_ELEMENTS:
            raise RobotFileError(f"has more than {_MOST_ELEMENTS} elements; an arm has some hundred")
        if depth > _DEEPEST:
            raise RobotFileError(
                f"line {parser.CurrentLineNumber}: more than {_DEEPEST} elements in each other"
            )
        # as ROS reads them: prefixes are part of the names, and many files do not declare theirs
        for name, meaning in attributes.items():
            if name.startswith("xmlns:") and name != "xmlns:xacro" and "xacro" in meaning:
                raise RobotFileError(f'{name}="{meaning}": call the prefix of xacro "xacro"')
        element = builder.start(tag, attributes)
        if isinstance(element, Element):
            element.file, element.line = file, parser.CurrentLineNumber

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def data(text: str) -> None:  # xacro leaves CDATA sections as they are
        builder.data(text.replace("${", "$${").replace("$(", "$$(") if literal else text)

    def section(begins: bool) -> None:
        nonlocal literal
        literal = begins

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = data
    parser.StartCdataSectionHandler = lambda: section(True)
    parser.EndCdataSectionHandler = lambda: section(False)
    parser.StartDoctypeDeclHandler = _refuse_document_type
    parser.buffer_text = True
    try:
        for begin in range(0, len(content), _PART_BYTES):
            parser.Parse(content[begin : begin + _PART_BYTES], False)
        parser.Parse(b"", True)
    except (expat.ExpatError, ValueError, LookupError) as cause:  # LookupError: an unknown encoding
        raise RobotFileError(f"is not XML: {cause}") from cause
    return cast("Element", builder.close())


_ENCODING = re.compile(rb"""<\?xml[^>]*?encoding\s*=\s*["']([\w.:-]+)["']""")
_HEAD_BYTES = 4096
_CODECS = {
    **dict.fromkeys(("gb2312", "gbk", "gb18030", "cp936"), "gb18030"),
    **dict.fromkeys(("big5", "big5-hkscs", "cp950"), "big5hkscs"),
    **dict.fromkeys(("shift_jis", "shift-jis", "sjis", "windows-31j", "cp932"), "cp932"),
    **dict.fromkeys(("euc-kr", "ks_c_5601-1987", "cp949"), "cp949"),
    "euc-jp": "euc_jp",
    "koi8-r": "koi8_r",
    **{f"windows-{k}": f"cp{k}" for k in range(1250, 1259)},
    **{f"iso-8859-{k}": f"iso8859_{k}" for k in (*range(2, 12), *range(13, 17))},
}
"""what is decoded as declared; else UTF-8, or as Windows writes the languages of western Europe"""


def _in_utf8(content: bytes) -> bytes:
    """An XML file in UTF-8, with its declaration at the very begin; lines keep their numbers."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        declared = "utf-16"
    else:
        match = _ENCODING.search(content[:_HEAD_BYTES])
        declared = _CODECS.get(match[1].decode().lower(), "utf-8-sig") if match else "utf-8-sig"
    try:
        text = content.decode(declared)
    except UnicodeDecodeError as cause:
        if declared != "utf-8-sig":
            raise RobotFileError(f"is not {declared}, as its begin says; save it as UTF-8") from cause
        text = content.decode("cp1252", errors="replace")
    at = _behind_comments(text)
    end = text.find("?>", at) + 2
    if text.startswith("<?xml", at) and end > 1:
        text = f"<?xml version='1.0'?>{text[:at]}{text[end:]}"
    return text.encode()


def _behind_comments(text: str) -> int:
    """Where something stands in a text that is no blank and no comment."""
    at = 0
    while True:
        at += len(text[at:]) - len(text[at:].lstrip())
        end = text.find("-->", at) + 3
        if not text.startswith("<!--", at) or end < 3:
            return at
        at = end


def _refuse_document_type(name: str, *_: object) -> None:
    """URDF has none, and its entities can grow without bound or name other files."""
    if name.lower() == "html":
        raise RobotFileError("is a web page and not the file itself; download the file (on GitHub by Raw)")
    raise RobotFileError(f"holds a document type ({name!r}); a URDF file has none, take it out")


class ArmFiles:
    """The files that the xacro file of one arm names; the last of ``stack`` is the one being read."""

    def __init__(self, source: UrdfSource, budget: Budget) -> None:
        self.source = source
        self.stack = [source.file]
        self._roots = list(source.roots)
        self._budget = budget
        self._parsed: dict[Path, Element] = {}
        self._packages: dict[str, Path | None] = {}

    def place(self, name: str) -> Path:
        """Where a name leads from the file being read; refuses a place outside."""
        self._budget.spend(_PLACE_STEPS)
        path = self.stack[-1].parent / name
        try:
            real = path.resolve()
        except (OSError, RuntimeError, ValueError) as cause:  # links in a circle, names that no file has
            raise RobotFileError(f'"{shown(name)}" is no name of a file') from cause
        if not any(real.is_relative_to(root) for root in self._roots):
            raise RobotFileError(
                f'"{shown(name)}" leads out of the folder {self._roots[0]}; a robot file reads only files '
                "of its own folder or package, and of packages that $(find …) names"
            )
        return path

    def named(self, name: str) -> list[Path]:
        """The files that the ``filename`` of an include means: one, or all that match its last part."""
        if not _WILD & set(name):
            return [self.place(name)]
        folder, _, pattern = name.rpartition("/")
        if _WILD & set(folder):
            raise RobotFileError(f'"{shown(name)}": only the name of a file may hold * ? [ ], no folder')
        place = self.place(folder + "/" if folder or name.startswith("/") else ".")
        try:
            with os.scandir(place) as entries:
                found = [entry.name for _, entry in zip(range(MOST_FILES), entries, strict=False)]
        except OSError:
            return []
        if len(found) == MOST_FILES:
            raise RobotFileError(f'"{shown(name)}": the folder holds {MOST_FILES} files or more')
        self._budget.spend(len(found))
        names = [one for one in found if not one.startswith(".") and fnmatch.fnmatchcase(one, pattern)]
        return [self.place(f"{folder}/{one}" if folder else one) for one in sorted(names)]

    def xml(self, path: Path) -> Element:
        """The root element of a file that ``place`` found."""
        if path not in self._parsed:
            content = URDF_FILES.read(path)
            self._budget.spend(len(content) >> 4)
            self._parsed[path] = parse_xml(content, path)
        return self._parsed[path]

    def yaml(self, name: str, evaluated: Callable[[str], Any]) -> Any:
        """What a YAML file holds; ``evaluated`` computes a number with a unit: ``!degrees 90 / 2``."""
        path = self.place(name)
        try:
            text = YAML_FILES.text(YAML_FILES.read(path))
        except RobotFileError as refusal:
            raise refusal.about(f'load_yaml("{shown(name)}")') from refusal
        self._budget.spend(len(text))
        loader = _YamlLoader(text, self._budget, evaluated)
        self.stack.append(path)
        try:
            value = loader.get_single_data()
            self._budget.spend(weight(value))
        except yaml.MarkedYAMLError as cause:
            line = f"line {cause.problem_mark.line + 1}: " if cause.problem_mark else ""
            raise RobotFileError(f"{path.name}: {line}{shown(cause.problem or 'is no YAML')}") from cause
        except (yaml.YAMLError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError,
                RecursionError) as cause:  # fmt: skip
            raise RobotFileError(f"{path.name}: is no YAML that can be read: {shown(str(cause))}") from cause
        except RobotFileError as refusal:
            raise refusal.about(path.name) from refusal
        finally:
            self.stack.pop()
        return value

    def package(self, name: str) -> Path:
        """The folder of a package, of which more may be read from then on."""
        if name not in self._packages:
            self._budget.spend(_PACKAGE_STEPS)
            self._packages[name] = self.source.package(name)
        place = self._packages[name]
        if place is None:
            raise MissingPackageError(
                f"$(find {shown(name)}): no folder above the file holds a package of that name; put the "
                "package, a folder with its package.xml, beside that of the arm"
            )
        if (root := place.resolve()) not in self._roots:
            self._roots.append(root)
        return place.absolute()


_UNITS: Mapping[str, float] = {
    "!radians": 1.0,
    "!degrees": 0.017453292519943295,
    "!meters": 1.0,
    "!millimeters": 0.001,
    "!foot": 0.3048,
    "!inches": 0.0254,
}


class _YamlLoader(yaml.SafeLoader):
    """PyYAML's safe loader with bounds, and with the units of xacro. It makes plain data only."""

    def __init__(self, text: str, budget: Budget, evaluated: Callable[[str], Any]) -> None:
        super().__init__(text)
        self._budget, self._evaluated, self._depth = budget, evaluated, 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        self._budget.spend(_NODE_STEPS)
        self._depth += 1
        if self._depth > _DEEPEST_YAML:
            raise RobotFileError(f"it is nested more than {_DEEPEST_YAML} deep")
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Merges can grow without bound, and no robot file needs them."""
        if any(key.tag == "tag:yaml.org,2002:merge" for key, _ in node.value):
            raise RobotFileError("it has a merge (<<), which armctl does not read; write the entries out")

    def number(self, node: yaml.ScalarNode) -> float:
        """A whole number or one with a point, of few digits."""
        if len(node.value) > _LONGEST_NUMBER:
            raise RobotFileError(f"a number of more than {_LONGEST_NUMBER} characters")
        whole = node.tag == "tag:yaml.org,2002:int"
        return self.construct_yaml_int(node) if whole else self.construct_yaml_float(node)

    def with_unit(self, node: yaml.ScalarNode) -> float:
        return float(self._evaluated(str(self.construct_scalar(node)))) * _UNITS[node.tag]

    def day(self, node: yaml.ScalarNode) -> str:
        """A date is a text: no robot file computes with one."""
        return str(self.construct_yaml_timestamp(node))

    def fixed_list(self, node: yaml.SequenceNode) -> Any:
        values = FixedList()
        yield values
        values.extend(self.construct_sequence(node))


for _tag in ("int", "float"):
    _YamlLoader.add_constructor(f"tag:yaml.org,2002:{_tag}", _YamlLoader.number)
for _tag in _UNITS:
    _YamlLoader.add_constructor(_tag, _YamlLoader.with_unit)
_YamlLoader.add_constructor("tag:yaml.org,2002:timestamp", _YamlLoader.day)
_YamlLoader.add_constructor("tag:yaml.org,2002:seq", _YamlLoader.fixed_list)
