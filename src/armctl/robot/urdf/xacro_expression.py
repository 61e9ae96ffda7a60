"""Expressions of xacro files, ``${…}``: a small language of its own, with nothing of Python behind it.

The text is parsed by ``ast``, and every node is evaluated here, by hand: numbers, texts, lists, dictionaries,
arithmetic, comparisons, conditions, comprehensions, and the functions and methods of ``xacro_functions``. Any
other node is refused. A dot finds an entry of a dictionary or of a namespace, or a method of the table; it
never reaches an attribute of an object. All that is computed and made is paid from one ``Budget``.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NoReturn, Protocol, cast

from armctl.errors import RobotFileError
from armctl.lazy_dataclass import dataclass
from armctl.robot.urdf.xacro_functions import (
    FUNCTIONS,
    LONGEST,
    METHODS,
    SIZES,
    Function,
    Value,
    shown,
    weight,
)

MOST_STEPS = 1_000_000
"""what one file may cost, in steps of about a microsecond"""
_MOST_BITS = 1000
"""of a power of whole numbers"""
_DEEPEST = 150
"""parts of an expression inside of each other"""
_LONGEST_EXPRESSION = 5000
_FAILURES = (
    ArithmeticError,
    AttributeError,
    LookupError,
    MemoryError,
    NameError,
    RecursionError,
    SyntaxError,
    TypeError,
    ValueError,
)
"""of what an expression computes, and of parsing it"""


class Budget:
    """What reading one file may still cost, all that it includes with it."""

    def __init__(self) -> None:
        self.left = MOST_STEPS
        """steps"""

    def spend(self, steps: int) -> None:
        """Take the cost of what comes next; refuses when it is used up."""
        self.left -= steps
        if self.left < 0:
            raise RobotFileError(
                f"to expand it takes more than {MOST_STEPS} steps, as no robot file does that does not go "
                "in circles; expand it where ROS is, and use the .urdf file"
            )


class Names(Protocol):
    """What names stand for: properties, the entries of a namespace, the variables of a comprehension."""

    def get(self, name: str) -> Value:
        """Raises ``KeyError`` where there is no such name."""
        ...


@dataclass(frozen=True, slots=True)
class _Variables:
    """The variables of a comprehension, before the names around it."""

    around: Names
    values: Mapping[str, Value]

    def get(self, name: str) -> Value:
        return self.values[name] if name in self.values else self.around.get(name)


class Expressions:
    """Evaluates the expressions of one file and of what it includes."""

    def __init__(self, budget: Budget, functions: Mapping[str, Value]) -> None:
        """``functions``: further names that all files know, as ``{"load_yaml": Function(…)}``."""
        self._budget = budget
        self._known = {**FUNCTIONS, **functions}
        self._trees: dict[str, ast.expr] = {}
        self._depth = 0
        self._kinds: Mapping[type[ast.AST], Callable[[Any, Names], Value]] = {
            ast.Constant: lambda node, _: self.checked(node.value),
            ast.Name: self._name,
            ast.Attribute: self._dotted,
            ast.Subscript: self._subscript,
            ast.Slice: self._slice,
            ast.UnaryOp: self._unary,
            ast.BinOp: self._binary,
            ast.BoolOp: self._boolean,
            ast.Compare: self._comparison,
            ast.IfExp: self._condition,
            ast.Call: self._call,
            ast.List: lambda node, names: self._each(node.elts, names),
            ast.Tuple: lambda node, names: tuple(self._each(node.elts, names)),
            ast.Dict: self._dictionary,
            ast.ListComp: self._comprehension,
            ast.GeneratorExp: self._comprehension,
        }

    def value(self, text: str, names: Names) -> Value:
        """What an expression stands for; refuses what it may not hold and what cannot be computed."""
        try:
            return self._value(self._tree(text.strip()), names)
        except _FAILURES as cause:
            why = str(cause)
            if isinstance(cause, KeyError):
                why = f"there is no entry {why}"
            elif isinstance(cause, SyntaxError):
                why = cause.msg
            raise RobotFileError(f"${{{shown(text)}}}: cannot be computed: {shown(why)}") from cause

    def text(self, *values: Value) -> str:
        """Values as they are written into the tree, one behind the other."""
        try:
            self._budget.spend(sum(map(weight, values)))
            return cast("str", self.checked("".join(map(str, values))))
        except (OverflowError, RecursionError, TypeError) as cause:
            raise RobotFileError(f"cannot be written into the tree: {cause}") from cause

    def checked(self, value: Value) -> Value:
        """A value as it is, if it is one; refuses one that is too large."""
        match value:
            case bool() | float() | None | Function():
                pass
            case int():
                weight(value)
            case str():
                if len(value) > LONGEST:
                    raise OverflowError(f"a text of more than {LONGEST} characters")
                self._budget.spend(len(value) >> 4)
            case list() | tuple() | dict() | set() | range():
                self._budget.spend(weight(cast("Value", value)))
            case _:
                raise TypeError(f"a value of the kind {type(value).__name__}, which no robot file needs")
        return cast("Value", value)

    def _tree(self, text: str) -> ast.expr:
        if text not in self._trees:
            self._budget.spend(20 + len(text))
            if len(text) > _LONGEST_EXPRESSION:
                raise OverflowError(f"it has more than {_LONGEST_EXPRESSION} characters")
            if "\\" in text:
                raise ValueError("it has a backslash")
            self._trees[text] = ast.parse(text, mode="eval").body
        return self._trees[text]

    def _value(self, node: ast.expr, names: Names) -> Value:
        self._budget.spend(1)
        evaluated = self._kinds.get(type(node))
        if evaluated is None:
            _refuse(node)
        self._depth += 1
        try:
            if self._depth > _DEEPEST:
                raise OverflowError(f"it is nested more than {_DEEPEST} deep")
            return evaluated(node, names)
        finally:
            self._depth -= 1

    def _each(self, nodes: Sequence[ast.expr], names: Names) -> list[Value]:
        return [self._value(node, names) for node in nodes]

    def _name(self, node: ast.Name, names: Names) -> Value:
        try:
            return names.get(node.id)
        except KeyError:
            if node.id in self._known:
                return self._known[node.id]
        raise NameError(f"there is no property {node.id!r}")

    def _dotted(self, node: ast.Attribute, names: Names) -> Value:
        return self._member(self._value(node.value, names), node.attr)

    def _member(self, value: Value, name: str) -> Value:
        """What a dot finds: an entry. Never an attribute of an object."""
        if not name.startswith("__") and isinstance(value, dict) and name in value:
            return cast("dict[Any, Any]", value)[name]
        if not name.startswith("__") and not isinstance(value, _PLAIN):
            try:
                return cast("Names", value).get(name)
            except KeyError:
                pass
        raise KeyError(name)

    def _subscript(self, node: ast.Subscript, names: Names) -> Value:
        value, key = self._value(node.value, names), self._value(node.slice, names)
        if not isinstance(value, str | list | tuple | dict | range):
            raise TypeError("only texts, lists and dictionaries have entries")
        return self.checked(cast("Any", value)[key]) if isinstance(key, slice) else cast("Any", value)[key]

    def _slice(self, node: ast.Slice, names: Names) -> slice:
        ends = [
            None if one is None else self._value(one, names) for one in (node.lower, node.upper, node.step)
        ]
        return slice(*ends)

    def _unary(self, node: ast.UnaryOp, names: Names) -> Value:
        value = self._value(node.operand, names)
        if isinstance(node.op, ast.Not):
            return not value
        if type(node.op) not in _UNARY:
            _refuse(node.op)
        return _UNARY[type(node.op)](value)

    def _binary(self, node: ast.BinOp, names: Names) -> Value:
        one, other, kind = self._value(node.left, names), self._value(node.right, names), type(node.op)
        if kind not in _BINARY:
            _refuse(node.op)
        if not (isinstance(one, int | float) and isinstance(other, int | float)):
            self._budget.spend(weight(one) + weight(other))
        if kind is ast.Mod and isinstance(one, str):
            raise TypeError("texts are put together by + and format")
        if kind in (ast.BitOr, ast.BitAnd) and not (isinstance(one, set) and isinstance(other, set)):
            raise TypeError("| and & take sets")
        if kind is ast.Mult:
            self._bound_repeated(one, other)
            self._bound_repeated(other, one)
        if kind is ast.Pow and isinstance(one, int) and isinstance(other, int):
            if one.bit_length() * other > _MOST_BITS:
                raise OverflowError(f"a power of more than {_MOST_BITS} bits")
        return self.checked(_BINARY[kind](one, other))

    def _bound_repeated(self, sequence: Value, count: Value) -> None:
        if isinstance(sequence, str | list | tuple) and isinstance(count, int):
            self._bound(len(cast("Sequence[Value]", sequence)) * count)

    def _bound(self, size: int) -> None:
        if size > LONGEST:
            raise OverflowError(f"more than {LONGEST} characters or elements")
        self._budget.spend(max(size, 0) >> 4)

    def _boolean(self, node: ast.BoolOp, names: Names) -> Value:
        value: Value = None
        for part in node.values:
            value = self._value(part, names)
            if bool(value) is isinstance(node.op, ast.Or):
                break
        return value

    def _comparison(self, node: ast.Compare, names: Names) -> Value:
        one = self._value(node.left, names)
        for op, right in zip(node.ops, node.comparators, strict=True):
            other = self._value(right, names)
            self._budget.spend(weight(one) + weight(other))
            if isinstance(op, ast.Is | ast.IsNot):
                if not isinstance(one, bool | None) and not isinstance(other, bool | None):
                    raise TypeError("'is' asks for None, True and False; use ==")
            if not _COMPARED[type(op)](one, other):
                return False
            one = other
        return True

    def _condition(self, node: ast.IfExp, names: Names) -> Value:
        return self._value(node.body if self._value(node.test, names) else node.orelse, names)

    def _dictionary(self, node: ast.Dict, names: Names) -> Value:
        if None in node.keys:
            raise TypeError("** is not known here")
        keys = self._each(cast("list[ast.expr]", node.keys), names)
        return dict(zip(keys, self._each(node.values, names), strict=True))

    def _comprehension(self, node: ast.ListComp | ast.GeneratorExp, names: Names) -> list[Value]:
        return self.checked([self._value(node.elt, row) for row in self._rows(node.generators, names)])

    def _rows(self, loops: Sequence[ast.comprehension], names: Names) -> Iterator[Names]:
        """The variables of a comprehension, row by row."""
        loop, *inner = loops
        if loop.is_async:
            _refuse(loop)
        items = self._value(loop.iter, names)
        self._budget.spend(weight(items))
        for item in list(items):
            self._budget.spend(5)
            row = _Variables(names, dict(_assigned(loop.target, item)))
            if all(self._value(test, row) for test in loop.ifs):
                yield from self._rows(inner, row) if inner else (row,)

    def _call(self, node: ast.Call, names: Names) -> Value:
        if any(one.arg is None for one in node.keywords):
            raise TypeError("** is not known here")
        call, given = self._called(node.func, names)
        given += self._each(node.args, names)
        options = {str(one.arg): self._value(one.value, names) for one in node.keywords}
        self._budget.spend(5 + sum(map(weight, given)) + sum(map(weight, options.values())))
        if call in SIZES:
            self._bound(SIZES[call](*given, **options))
        return self.checked(call(*given, **options))

    def _called(self, node: ast.expr, names: Names) -> tuple[Callable[..., Any], list[Value]]:
        """The function of a call, and the value before the dot if it is a method."""
        if isinstance(node, ast.Attribute):
            value = self._value(node.value, names)
            method = METHODS.get(type(cast("object", value)), {}).get(node.attr)
            if method is not None:
                return method, [value]
            function = self._member(value, node.attr)
        else:
            function = self._value(node, names)
        if not isinstance(function, Function):
            raise TypeError(f"{shown(self.text(function))!r} is no function")
        return function.call, []


def _refuse(node: ast.AST) -> NoReturn:
    kind = type(node).__name__
    raise TypeError(f"{_REFUSED.get(kind, kind)} has no place in a robot file")


_REFUSED: Mapping[str, str] = {
    "Lambda": "a lambda",
    "NamedExpr": "an assignment",
    "JoinedStr": "an f-string",
    "Starred": "a star",
    "Await": "await",
    "Yield": "yield",
    "YieldFrom": "yield",
}


def _assigned(target: ast.expr, item: Value) -> Iterator[tuple[str, Value]]:
    """The variables of ``for target in``, with an item taken apart."""
    if isinstance(target, ast.Name):
        yield target.id, item
    elif isinstance(target, ast.Tuple | ast.List):
        if not isinstance(item, list | tuple | str) or len(cast("Sequence[Any]", item)) != len(target.elts):
            raise ValueError(f"an item is no list of {len(target.elts)}")
        for part, one in zip(target.elts, cast("Sequence[Any]", item), strict=True):
            yield from _assigned(part, one)
    else:
        _refuse(target)


# Operators.

_PLAIN = (int, float, str, list, tuple, dict, set, range, Function, type(None), slice)
_UNARY: Mapping[type[ast.AST], Callable[[Any], Any]] = {ast.USub: operator.neg, ast.UAdd: operator.pos}
_BINARY: Mapping[type[ast.AST], Callable[[Any, Any], Any]] = {
    kind: getattr(operator, name)
    for kind, name in {
        ast.Add: "add",
        ast.Sub: "sub",
        ast.Mult: "mul",
        ast.Div: "truediv",
        ast.FloorDiv: "floordiv",
        ast.Mod: "mod",
        ast.Pow: "pow",
        ast.BitOr: "or_",
        ast.BitAnd: "and_",
    }.items()
}
_COMPARED: Mapping[type[ast.AST], Callable[[Any, Any], bool]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
    ast.In: lambda one, other: one in other,
    ast.NotIn: lambda one, other: one not in other,
}
