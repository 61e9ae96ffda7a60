"""Properties and arguments of a xacro file, and what the texts with ``${…}`` and ``$(…)`` stand for."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from keyword import iskeyword
from typing import Any

from armctl.decoding import did_you_mean
from armctl.errors import RobotFileError, UnclearArmError
from armctl.lazy_dataclass import dataclass
from armctl.robot.urdf.reading import ArmFiles, Element, MissingPackageError
from armctl.robot.urdf.xacro_expression import Budget, Expressions
from armctl.robot.urdf.xacro_functions import FUNCTIONS, XACRO, Function, Module, Value, shown

_PIECE = re.compile(
    r"(?P<escaped>\$\$+[{(])|\$\{(?P<expression>[^}]*)\}|\$\((?P<command>[^)]*)\)|(?P<plain>[^$]+|\$[^{($]+|\$$)"
)
_TRUTHS = {"true": True, "True": True, "false": False, "False": False}
_MATH: Mapping[str, Value] = FUNCTIONS["math"].entries
_TAKEN = {name for name in vars(math) if not name.startswith("_")} | set(
    "list dict map len str float int bool True False min max round sorted range python math xacro load_yaml "
    "abs_filename dotify".split()
)
"""names that xacro takes for defined everywhere, so that no property gets a default of that name"""
_DEEPEST = 50
"""properties that are made of properties"""


@dataclass(frozen=True, slots=True)
class Argument:
    """What ``<xacro:arg>`` declares, or ``$(arg …)`` asks for."""

    name: str
    value: str
    """in force: as given, else the default"""
    default: str | None
    """None: it has none, or one that was not worked out, as another value was given"""


class Scope:
    """The properties of a file, of a namespace or of one call of a macro, and those around it."""

    def __init__(self, texts: Texts, around: Scope | None, *, namespace: bool = False) -> None:
        self.around = around
        self.namespace = namespace
        self._texts = texts
        self.values: dict[str, Value] = {}
        self.blocks: dict[str, Element] = {}
        self.waiting: dict[str, str] = {}
        """texts of properties that nobody has asked for yet"""

    def get(self, name: str) -> Value:
        """What a property stands for; raises ``KeyError`` where there is none."""
        scope = self._holder(name)
        if scope is None:
            raise KeyError(name)
        if name in scope.waiting:
            scope.values[name] = self._texts.made(name, scope.waiting[name], scope)
            scope.waiting.pop(name, None)
        value = scope.values[name]
        if isinstance(value, MissingPackageError):
            raise MissingPackageError(str(value))
        return value

    def _holder(self, name: str) -> Scope | None:
        scope: Scope | None = self
        while scope is not None and name not in scope.values:
            scope = scope.around
        return scope

    def __contains__(self, name: str) -> bool:
        return self._holder(name) is not None or name in _TAKEN

    def set(self, name: str, value: Value, *, lazy: bool = False) -> None:
        """Define a property here; ``lazy``: its text is evaluated when it is asked for."""
        self.waiting.pop(name, None)
        self.values[name] = literal(value)
        if lazy and isinstance(self.values[name], str):
            self.waiting[name] = self.values[name]

    def remove(self, name: str) -> None:
        """Forget a property, here and around."""
        scope: Scope | None = self
        while scope is not None:
            scope.values.pop(name, None)
            scope.waiting.pop(name, None)
            scope = scope.around

    def set_block(self, name: str, block: Element) -> None:
        """Define a block: ``*name`` is inserted as it is, of ``**name`` what is inside."""
        self.blocks[name] = block

    def block(self, name: str) -> Element | None:
        """The block of this name."""
        scope: Scope | None = self
        while scope is not None:
            if name in scope.blocks:
                return scope.blocks[name]
            scope = scope.around
        return None

    def outermost(self) -> Scope:
        """Where ``scope="global"`` defines."""
        return self if self.around is None else self.around.outermost()

    def callers(self) -> Scope | None:
        """Where ``scope="parent"`` defines: around a macro, that of its caller."""
        scope = self.around
        while scope is not None and scope.namespace and not self.namespace:
            scope = scope.around
        return scope


def literal(value: Value) -> Value:
    """A text as the number or truth value that it writes; quotes around it keep it a text."""
    if not isinstance(value, str):
        return value
    if len(value) >= 2 and value[0] == value[-1] == "'":
        return value[1:-1]
    if "_" in value:  # Python would read 1_5 as 15
        return value
    for read in (int, float):
        try:
            return read(value)
        except ValueError:
            continue
    return _TRUTHS.get(value, value)


def truth(value: Value, written: str) -> bool:
    """What a condition says; refuses a text that is neither a truth value nor a whole number."""
    if not isinstance(value, str):
        return bool(value)
    if value in _TRUTHS:
        return _TRUTHS[value]
    try:
        return bool(int(value))
    except ValueError:
        raise RobotFileError(
            f'the condition "{shown(written)}" is "{shown(value)}", which is neither true nor false'
        ) from None


def is_name(name: str) -> bool:
    """Whether a property may be called so."""
    return name.isidentifier() and not iskeyword(name) and not name.startswith("__")


class Texts:
    """What texts stand for, with the arguments of the file and the functions that read files."""

    def __init__(self, files: ArmFiles, budget: Budget, arguments: Mapping[str, str]) -> None:
        self._files, self._budget = files, budget
        self._given = arguments
        self._arguments: dict[str, str | MissingPackageError] = dict(arguments)
        self._defaults: dict[str, str | None] = {}
        """of the arguments that are declared"""
        self._used: dict[str, None] = {}
        """arguments that were asked for"""
        own = {
            "load_yaml": Function("load_yaml", self._yaml),
            "abs_filename": Function("abs_filename", self._absolute),
        }
        xacro = Module({**XACRO, **own, "arg": Function("arg", self._argument)})
        self._expressions = Expressions(budget, {**own, "xacro": xacro})
        self._being_made: list[tuple[str, Scope]] = []

    def value(self, text: str, scope: Scope) -> Value:
        """What a text stands for: a value if it is one hole and nothing else, a text otherwise."""
        self._budget.spend(1 + (len(text) >> 6))
        if "$" not in text:
            return text
        values: list[Value] = []
        at = 0
        while at < len(text):
            self._budget.spend(1)
            match = _PIECE.match(text, at)
            if match is None:
                raise RobotFileError(f'"{shown(text[at:])}": $ stands before {{…}}, (…) or a plain text')
            at = match.end()
            if match["expression"] is not None:
                inner = self._inner(match["expression"], scope)
                values.append(self._expressions.value(inner, scope))
            elif match["command"] is not None:
                values.append(self._command(self._inner(match["command"], scope)))
            else:
                values.append(match["plain"] or match["escaped"][1:])
        if len(values) == 1:
            return values[0]
        return self._expressions.text(*values)

    def held(self, text: str, scope: Scope) -> Value:
        """As ``value``; what needs a package that is not there is refused where it is used."""
        try:
            return self.value(text, scope)
        except MissingPackageError as missing:
            return missing

    def text(self, text: str, scope: Scope) -> str:
        """What a text stands for, as it is written into the tree."""
        return self._expressions.text(self.value(text, scope))

    def made(self, name: str, text: str, scope: Scope) -> Value:
        """What a property stands for."""
        if (name, scope) in self._being_made:
            round_trip = " → ".join([*(one for one, _ in self._being_made), name])
            raise RobotFileError(f"the properties are made of each other: {shown(round_trip)}")
        if len(self._being_made) >= _DEEPEST:
            raise RobotFileError(f"{name}: properties are made of each other more than {_DEEPEST} deep")
        self._being_made.append((name, scope))
        try:
            return literal(self.value(text, scope))
        finally:
            self._being_made.pop()

    def declare(self, name: str, default: str | None, scope: Scope) -> None:
        """An argument of the file: it stays as it was given, else it is the default."""
        if self._defaults.get(name) is None:
            self._defaults[name] = default if default is None or "$" not in default else None
        if default is None or name in self._arguments:
            return
        value = self.held(default, scope)
        if isinstance(value, MissingPackageError):
            self._arguments[name] = value
        else:
            self._arguments[name] = self._defaults[name] = self._expressions.text(value)

    @property
    def declared(self) -> tuple[Argument, ...]:
        """The arguments of the file that stand for something, those too that it only uses."""
        return tuple(
            Argument(name, value, self._defaults.get(name))
            for name in dict.fromkeys((*self._defaults, *self._used))
            if isinstance(value := self._arguments.get(name), str)
        )

    def require_known(self) -> None:
        """Refuse arguments that were given and that the file has no use for."""
        known = dict.fromkeys((*self._defaults, *self._used))
        for name in self._given:
            if name not in known:
                has = f"has {', '.join(known)}" if known else "has none"
                raise RobotFileError(
                    f"there is no argument {shown(name)!r}{did_you_mean(name, known)}; the file {has}"
                )

    def _inner(self, text: str, scope: Scope) -> str:
        """What is inside of a hole, with its own holes filled."""
        if "$" not in text:
            return text
        return self._expressions.text(self.value(text, scope))

    def _argument(self, name: str) -> str:
        self._used[name] = None
        value = self._arguments.get(name)
        if isinstance(value, MissingPackageError):
            raise MissingPackageError(str(value))
        if value is None:
            needed = [*(one for one in self._defaults if one not in self._arguments and one != name), name]
            given = " ".join(f"{shown(one)}:=VALUE" for one in needed)
            unknown = [one for one in self._given if one not in self._defaults and one not in self._used]
            mistyped = f", {shown(unknown[0])!r} was given" if did_you_mean(name, unknown) else ""
            error = UnclearArmError(
                f"the argument {shown(name)!r} is needed, and the file gives it no default{mistyped}; write "
                f"it behind the file: armctl check {self._files.source.file.name} {given}"
            )
            error.arguments = needed
            raise error
        return value

    def _absolute(self, filename: str) -> str:
        return str(self._files.stack[-1].parent / filename)

    def _yaml(self, filename: str) -> Any:
        return self._files.yaml(filename, lambda text: self._expressions.value(text, Scope(self, None)))

    def _command(self, text: str) -> str:
        """What ``$(…)`` stands for."""
        name, *words = text.split() or [""]
        match name, words:
            case "find", [package]:
                return str(self._files.package(package))
            case "arg", [argument]:
                return self._argument(argument)
            case "optenv", [_, *default]:  # armctl looks at no environment
                return " ".join(default)
            case "dirname", []:
                return str(self._files.stack[-1].parent.absolute())
            case "eval", [_, *_]:
                return self._expressions.text(self._expressions.value(text[len("eval ") :], _Arguments(self)))
            case "env" | "cwd" | "anon", _:
                raise RobotFileError(
                    f"$({shown(text)}): what a robot file says does not depend on where "
                    "armctl runs; write the value"
                )
            case _:
                raise RobotFileError(f"$({shown(text)}): allowed are $(find PACKAGE) and $(arg NAME)")

    def converted_argument(self, name: str) -> Value:
        """An argument as ``$(eval …)`` sees it; raises ``KeyError`` where there is none."""
        if name not in self._arguments:
            raise KeyError(name)
        text = self._argument(name)
        try:
            return float(text) if "." in text else int(text)
        except ValueError:
            return {"true": True, "false": False}.get(text.lower(), text)


class _Arguments:
    """The names that ``$(eval …)`` knows."""

    def __init__(self, texts: Texts) -> None:
        self._texts = texts

    def get(self, name: str) -> Value:
        if name in ("true", "false"):
            return name == "true"
        if name in _MATH:
            raise KeyError(name)
        return self._texts.converted_argument(name)
