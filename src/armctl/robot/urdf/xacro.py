"""xacro files: plain properties, arithmetic, arguments and unused macros here; anything more by the package.

The package ``xacro`` evaluates Python expressions, so it runs in a process of its own, with a time limit, and
never on files that came through a page.
"""

from __future__ import annotations

import ast
import math
import operator
import os
import re
import subprocess
import sys
import types
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from armctl.errors import RobotFileError

Value = int | float | str
_XACRO = "xacro:"
_HOLE = re.compile(r"\$\$\{|\$\$\(|\$\{(?P<expression>[^{}]*)\}|\$\((?P<call>[^()]*)\)")
_LARGEST = 1e12
"""no number of an expression grows beyond"""
_LONGEST = 1000
"""characters of an expression, and of what a property or an argument stands for"""
_MOST_MADE, _MOST_EVALUATED = 4_000_000, 100_000
"""characters that all holes of a file may make, and expressions that are computed for them"""
_MOST_DIGITS = 15
"""places to which ``round`` goes"""
_DEEPEST = 50
"""properties that are made of properties"""
_TIMEOUT_S = 60.0
_OPERATORS: Mapping[type[ast.AST], str] = {
    ast.Add: "add",
    ast.Sub: "sub",
    ast.Mult: "mul",
    ast.Div: "truediv",
    ast.FloorDiv: "floordiv",
    ast.Mod: "mod",
    ast.Pow: "pow",
    ast.USub: "neg",
    ast.UAdd: "pos",
}
"""names in the module ``operator``"""


def _rounded(value: float, digits: int = 0) -> float:
    if abs(digits) > _MOST_DIGITS:
        raise OverflowError(f"round goes to {_MOST_DIGITS} places at most")
    return round(value, digits) if digits else round(value)


_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    **{name: getattr(math, name) for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sqrt")},
    **{name: getattr(math, name) for name in ("radians", "degrees", "hypot", "fabs")},
    "abs": abs,
    "min": min,
    "max": max,
    "round": _rounded,
}
_CONSTANTS: Mapping[str, Value] = {"pi": math.pi, "tau": math.tau, "e": math.e}


class BeyondPlainError(Exception):
    """It takes the package; the text says what for."""


def is_xacro(root: ElementTree.Element) -> bool:
    """Whether a file has anything for xacro to do."""
    return any(_name(element) or _holes(element) for element in root.iter())


def _holes(element: ElementTree.Element) -> bool:
    return any("${" in text or "$(" in text for text in (*element.attrib.values(), element.text or ""))


def _name(element: ElementTree.Element) -> str | None:
    """``property`` of ``<xacro:property>``; None for what is no element of xacro."""
    return element.tag.removeprefix(_XACRO) if element.tag.startswith(_XACRO) else None


def expand(root: ElementTree.Element) -> None:
    """Expand a file in place that holds plain properties and arguments, arithmetic and unused macros only.

    ``BeyondPlainError``: it holds more; the tree is then half done. ``RobotFileError``: an expression
    cannot be read.
    """
    used = {_name(element) for top in root if _name(top) != "macro" for element in top.iter()}
    for element in root:
        if _name(element) == "macro" and element.get("name", "").removeprefix(_XACRO) in used:
            raise BeyondPlainError(f"the macro {element.get('name')}")
    names: dict[str, str] = {}
    arguments: dict[str, str] = {}
    for element in list(root):
        match _name(element):
            case None:
                continue
            case "property" if element.get("name") and (value := element.get("value")) is not None:
                if names.setdefault(element.get("name", ""), value) != value:
                    raise BeyondPlainError(f"the property {element.get('name')}, which changes")
            case "property" if len(element) and element.get("name") and not element.get("default"):
                pass  # a block: what inserts it is refused below
            case "arg" if element.get("name"):
                if (default := element.get("default")) is not None:
                    arguments[element.get("name", "")] = default
            case "macro":
                pass
            case other:
                raise BeyondPlainError(f"<xacro:{other}>")
        root.remove(element)
    inside = next((name for element in root.iter() if (name := _name(element)) is not None), None)
    if inside is not None:
        raise BeyondPlainError(f"<xacro:{inside}>")
    values = _Values(names, arguments)
    for element in root.iter():
        for key, text in element.attrib.items():
            element.set(key, values.filled(text))
        if element.text:
            element.text = values.filled(element.text)


class _Values:
    """The properties of a file, evaluated when they are asked for."""

    def __init__(self, names: Mapping[str, str], arguments: Mapping[str, str]) -> None:
        self._names, self._arguments = names, arguments
        self._depth = self._made = self._evaluations = 0
        self._texts: dict[str, str | None] = {}
        """properties and arguments as they were made; None: it is being made"""

    def filled(self, text: str) -> str:
        """The text with what its holes stand for."""

        def value(match: re.Match[str]) -> str:
            if match["expression"] is not None:
                return counted(str(self._evaluated(match["expression"])))
            if match["call"] is None:
                return match[0][1:]
            command, _, name = match["call"].strip().partition(" ")
            if command != "arg":
                raise BeyondPlainError(f"$({command} …)")
            if name.strip() not in self._arguments:
                raise RobotFileError(f"$(arg {name.strip()}): the file gives it no default")
            return counted(self._nested(f"$(arg {name.strip()})", self._arguments[name.strip()]))

        def counted(made: str) -> str:
            self._made += len(made)
            if self._made > _MOST_MADE:
                raise RobotFileError(f"its properties and arguments make more than {_MOST_MADE} characters")
            return made

        return _HOLE.sub(value, text)

    def _nested(self, key: str, text: str) -> str:
        """What a property or an argument stands for, made once; ``key`` is how it is written."""
        if key in self._texts and (made := self._texts[key]) is not None:
            return made
        self._depth += 1
        if self._depth > _DEEPEST or key in self._texts:
            raise RobotFileError(f"{text!r}: its properties are made of each other")
        self._texts[key] = None
        made = self.filled(text)
        if len(made) > _LONGEST:
            raise RobotFileError(f"{key}: a text of more than {_LONGEST} characters")
        self._texts[key] = made
        self._depth -= 1
        return made

    def _property(self, name: str) -> Value:
        if name not in self._names:
            if name in _CONSTANTS:
                return _CONSTANTS[name]
            raise RobotFileError(f"${{{name}}}: there is no such property")
        text = self._nested(f"${{{name}}}", self._names[name])
        for read in (int, float):
            try:
                return read(text)
            except ValueError:
                continue
        return text

    def _evaluated(self, expression: str) -> Value:
        where = f"${{{expression}}}"
        self._evaluations += 1
        if self._evaluations > _MOST_EVALUATED:
            raise RobotFileError(f"more than {_MOST_EVALUATED} expressions are computed for it")
        if len(expression) > _LONGEST:
            raise RobotFileError(f"an expression of more than {_LONGEST} characters: {expression[:40]}…")
        try:
            return self._value(ast.parse(expression.strip(), mode="eval").body, where)
        except (SyntaxError, ArithmeticError, TypeError, ValueError, RecursionError, MemoryError) as cause:
            raise RobotFileError(f"{where}: cannot be computed: {cause}") from cause

    def _value(self, node: ast.expr, where: str) -> Value:
        match node:
            case ast.Constant(value=int() | float() | str() as value):
                found: Value = value
            case ast.Name(id=name):
                found = self._property(name)
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _OPERATORS:
                found = _applied(op, self._value(operand, where))
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                one, other = self._value(left, where), self._value(right, where)
                if isinstance(one, str) or isinstance(other, str):
                    if type(op) is not ast.Add:
                        raise TypeError(f"{one!r} and {other!r} are not both numbers")
                elif type(op) is ast.Pow and (abs(one) > _LARGEST or abs(other) > 64):
                    raise OverflowError("a power beyond 64")
                found = _applied(op, one, other)
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(value=ast.Name(id="math"), attr=name),
                          args=arguments, keywords=[]) if name in _FUNCTIONS:  # fmt: skip
                found = _FUNCTIONS[name](*(self._value(one, where) for one in arguments))
            case ast.Attribute(value=ast.Name(id="math"), attr=name) if name in _CONSTANTS:
                found = _CONSTANTS[name]
            case _:
                raise BeyondPlainError(where)
        if type(found) not in (int, float, bool, str):
            raise ValueError("no number comes of it")
        if len(found) > _LONGEST if isinstance(found, str) else not abs(found) <= _LARGEST:
            raise OverflowError("it grows too large")
        return found


def _applied(op: ast.AST, *values: Value) -> Any:
    function: Callable[..., Any] = getattr(operator, _OPERATORS[type(op)])
    return function(*values)


# By the package.


def expanded_by_package(file: Path, why: str) -> bytes:
    """The URDF of a xacro file, by the package ``xacro``; refuses in one line."""
    if find_spec("xacro") is None:
        raise RobotFileError(
            f"needs {why}, which the package xacro expands: pip install xacro; or expand it where "
            f"ROS is: xacro {file.name} > {file.name.split('.')[0]}.urdf"
        )
    command = [sys.executable, "-P", "-m", "armctl.robot.urdf.xacro", str(file.absolute())]
    try:
        # armctl is found where we find it
        paths = os.environ | {"PYTHONPATH": os.pathsep.join(os.path.abspath(entry) for entry in sys.path)}
        done = subprocess.run(command, capture_output=True, timeout=_TIMEOUT_S, check=False, env=paths)
    except subprocess.TimeoutExpired as cause:
        raise RobotFileError(f"xacro has not ended within {_TIMEOUT_S:.0f} s") from cause
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().splitlines() or ["no reason given"]
        raise RobotFileError(f"xacro: {lines[-1]}")
    return done.stdout


def _main(file: Path, missing: list[str]) -> None:
    """The process of its own: print the expanded file; ``missing`` gets what is said of a package."""
    from armctl.robot.urdf.package import UrdfSource

    source = UrdfSource(file)

    def find(name: str) -> str:
        place = source.package(name)
        if place is None:
            missing.append(f"$(find {name}): no folder above the file holds a package of that name")
            raise RobotFileError(missing[-1])
        return str(place.absolute())

    if find_spec("ament_index_python") is None:  # where ROS is not, packages are looked for as for meshes
        package, module = types.ModuleType("ament_index_python"), types.ModuleType("packages")
        vars(module)["get_package_share_directory"] = find
        sys.modules |= {"ament_index_python": package, "ament_index_python.packages": module}
    from importlib import import_module

    print(import_module("xacro").process_file(str(file)).toxml())  # noqa: T201


if __name__ == "__main__":
    not_found: list[str] = []
    try:
        _main(Path(sys.argv[1]), not_found)
    except Exception as failed:  # xacro wraps what is raised, in several lines
        sys.exit(" ".join([*not_found, str(failed)][0].split()) or type(failed).__name__)
