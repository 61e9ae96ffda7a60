"""xacro files expanded: macros, blocks, properties, conditions and includes, by an interpreter of our own.

It gives the tree that the package ``xacro`` gives, and runs no code: expressions are a language of their own
(``xacro_expression``), files are read from the arm's own folders only (``reading``), and all of it is paid
from one ``Budget``, so any file ends. Nothing is mutated: what is read stays as it is, and a new tree is made
of it. What a file prints (``xacro.warning``) is left out.
"""

from __future__ import annotations

import re
from collections import ChainMap
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import TypeAlias, cast

from armctl.errors import RobotFileError
from armctl.lazy_dataclass import dataclass
from armctl.robot.urdf.package import UrdfSource
from armctl.robot.urdf.reading import ArmFiles, Element, MissingPackageError
from armctl.robot.urdf.xacro_expression import Budget
from armctl.robot.urdf.xacro_functions import shown
from armctl.robot.urdf.xacro_properties import Argument, Scope, Texts, is_name, truth

_XACRO = "xacro:"
_DEEPEST = 60
"""macros and includes inside of each other"""
_ELEMENT_STEPS = 10
"""what making an element costs"""
_ASIDE = frozenset({"gazebo", "ros2_control", "transmission"})
"""elements that no arm is made of: they stay empty where they cannot be expanded"""
_NOT_OF_ARMS = frozenset(
    "gazebo gz ign ignition isaac mujoco webots sim simulation simulator control controller controllers "
    "transmission transmissions".split()
)
"""words in the names of files and macros that only simulators and controllers need"""
_WORD = re.compile(r"[a-z]+")
_MOST_PARAMETERS = 500
_PARAMETER = re.compile(r"\s*(?:(?P<name>[^\s:=]+)\s*:?=\s*(?P<passed>\^\|?)?|(?P<only>\S+))")


@dataclass(frozen=True, slots=True)
class Macro:
    """A macro as it is defined."""

    element: Element
    parameters: tuple[str, ...]
    defaults: Mapping[str, tuple[bool, str | None]]
    """by parameter: whether it is passed through from the caller, and the text where it is not"""

    def call(self, name: str) -> str:
        """A call with what it needs, as it is written."""
        needed = [one for one in self.parameters if one not in self.defaults]
        values = "".join(f' {one}="VALUE"' for one in needed if not one.startswith("*"))
        blocks = "".join(f"<{one.lstrip('*')}/>" for one in needed if one.startswith("*"))
        return f"<xacro:{name}{values}" + (f">{blocks}</xacro:{name}>" if blocks else "/>")


Macros: TypeAlias = ChainMap[str, "Macro | Macros"]
"""macros by name, and namespaces of them"""


@dataclass(frozen=True, slots=True)
class Expanded:
    """What a xacro file stands for."""

    root: Element
    arguments: tuple[Argument, ...]
    """that it declares, with what they stand for"""
    left_out: tuple[str, ...]
    """files that are not there, and that only simulators and controllers need"""
    macros: tuple[tuple[str, str], ...]
    """the macros of the main file, each with a call of it as it would be written"""


def is_xacro(root: Element) -> bool:
    """Whether a file has anything for xacro to do."""
    return any(
        _name(one) or any("${" in text or "$(" in text for text in (*one.attrib.values(), one.text or ""))
        for one in cast("Iterable[Element]", root.iter())
    )


def _name(element: Element) -> str | None:
    """``property`` of ``<xacro:property>``; None for what is no element of xacro."""
    return element.tag.removeprefix(_XACRO) if element.tag.startswith(_XACRO) else None


def expand(root: Element, source: UrdfSource, arguments: Mapping[str, str]) -> Expanded:
    """The tree that a xacro file stands for; a refusal names the line, and the file if it is an included one.

    ``arguments``: values of what ``<xacro:arg>`` declares, by name; the file's defaults stand for others.
    ``UnclearArmError``: one is needed.
    """
    expansion = _Expansion(source, arguments)
    try:
        expanded = expansion.whole(root)
    except RecursionError as cause:
        raise RobotFileError("it is nested too deep").about(expansion.where) from cause
    except RobotFileError as refusal:
        raise refusal.about(expansion.where) from refusal
    expansion.require_known_arguments()
    return expanded


class _Expansion:
    def __init__(self, source: UrdfSource, arguments: Mapping[str, str]) -> None:
        self._budget = Budget()
        self._files = ArmFiles(source, self._budget)
        self._texts = Texts(self._files, self._budget, arguments)
        self._main = source.file
        self._depth = 0
        self.require_known_arguments = self._texts.require_known
        self._left_out: dict[str, str] = {}
        """names of files that are not there, and why they are not"""
        self._at: Element | None = None
        """what is being expanded"""

    @property
    def where(self) -> str:
        """Where the expansion has come to."""
        if self._at is None:
            return self._main.name
        file = "" if self._at.file == self._main else f"{self._at.file.name}, "
        return f"{file}line {self._at.line}"

    def whole(self, root: Element) -> Expanded:
        """The tree of the main file."""
        macros: Macros = ChainMap()
        made = self._copied(root, macros, Scope(self._texts, None))
        if space := root.get("xacro:targetNamespace"):
            made.set("xmlns", space)
        own = tuple(
            (name, macro.call(name))
            for name, macro in macros.items()
            if isinstance(macro, Macro) and macro.element.file == self._main
        )
        return Expanded(made, self._texts.declared, tuple(self._left_out), own)

    def _copied(self, element: Element, macros: Macros, scope: Scope) -> Element:
        """An element that is none of xacro, with its texts filled and what is inside expanded."""
        self._at = element
        made, depth, stack = self._empty(element, element.tag), self._depth, len(self._files.stack)
        try:
            for key, text in element.attrib.items():
                if key != "xmlns:xacro" and not key.startswith(_XACRO):
                    made.set(key, self._texts.text(text, scope))
            self._expand_inside(element, made, macros, scope)
        except RobotFileError:
            if element.tag not in _ASIDE or self._budget.left < 0:
                raise
            self._depth = depth
            del self._files.stack[stack:]
            return self._empty(element, element.tag)
        return made

    def _empty(self, like: Element, tag: str) -> Element:
        self._budget.spend(_ELEMENT_STEPS)
        made = Element(tag)
        made.file, made.line = like.file, like.line
        return made

    def _expanded(self, element: Element, macros: Macros, scope: Scope) -> Element:
        """What is inside of an element, expanded, in a new one without attributes."""
        made = self._empty(element, element.tag)
        self._expand_inside(element, made, macros, scope)
        return made

    def _expand_inside(self, element: Element, into: Element, macros: Macros, scope: Scope) -> None:
        """Expand the text and the children of an element into another one."""
        self._at = element
        self._write(into, element.text, scope)
        for child in cast("list[Element]", list(element)):
            self._expand_element(child, into, macros, scope)
            self._at = element
            self._write(into, child.tail, scope)

    def _write(self, into: Element, text: str | None, scope: Scope | None) -> None:
        """Add a text at the end of an element; blank ones are of no use to anybody."""
        if not text or text.isspace():
            return
        if scope is not None:
            text = self._texts.text(text, scope)
        last = into[-1] if len(into) else None
        before = (into.text if last is None else last.tail) or ""
        self._budget.spend(1 + (len(before) + len(text) >> 6))
        if last is None:
            into.text = before + text
        else:
            last.tail = before + text

    def _move(self, from_: Element, into: Element) -> None:
        """Move what is inside of an element to the end of another one."""
        self._write(into, from_.text, None)
        into.extend(from_)

    def _expand_element(self, element: Element, into: Element, macros: Macros, scope: Scope) -> None:
        self._at = element
        self._budget.spend(2)
        match _name(element):
            case None:
                into.append(self._copied(element, macros, scope))
            case "property":
                self._define_property(element, scope)
            case "macro":
                self._budget.spend(len(element.get("params", "")) >> 2)
                name, macro = _macro(element)
                macros[name] = macro
            case "arg":
                name = _required(element, "name")
                self._texts.declare(name, element.get("default"), scope)
            case "if" | "unless" as kind:
                written = _required(element, "value")
                if truth(self._texts.value(written, scope), written) is (kind == "if"):
                    self._move(self._expanded(element, macros, scope), into)
            case "insert_block":
                self._insert_block(_required(element, "name"), into, macros, scope)
            case "include":
                self._include(element, into, macros, scope)
            case "element":
                self._expand_element(self._renamed(element, scope), into, macros, scope)
            case "attribute":
                name, value = (self._texts.text(_required(element, key), scope) for key in ("name", "value"))
                if not name:
                    raise RobotFileError("<xacro:attribute>: its name is empty")
                into.set(name, value)
            case "call":
                name = self._texts.text(_required(element, "macro"), scope)
                self._call(name, element, into, macros, scope)
            case name:
                self._call(name, element, into, macros, scope)

    def _define_property(self, element: Element, scope: Scope) -> None:
        name = self._texts.text(_required(element, "name"), scope)
        if not is_name(name):
            raise RobotFileError(
                f'<xacro:property name="{shown(name)}">: a name has letters, digits and _ only, and '
                "is no word of Python"
            )
        value, default = element.get("value"), element.get("default")
        written = element.get("remove", "false")
        remove = truth(self._texts.value(written, scope), written)
        if (value is not None) + (default is not None) + remove > 1:
            raise RobotFileError(f'<xacro:property name="{name}">: one of value, default and remove')
        if remove:
            scope.remove(name)
            return
        if default is not None:
            if name in scope:
                return
            value = default
        written = element.get("lazy_eval", "true")
        lazy = truth(self._texts.value(written, scope), written)
        target: Scope | None = scope
        match element.get("scope"):
            case "global":
                target, lazy = scope.outermost(), False
            case "parent":
                target, lazy = scope.callers(), False
            case _:
                pass
        if target is None:
            raise RobotFileError(f'<xacro:property name="{name}" scope="parent">: stands in no macro')
        if value is None:
            target.set_block(f"**{name}", element)
        else:
            target.set(name, value if lazy else self._texts.value(value, scope), lazy=lazy)

    def _renamed(self, element: Element, scope: Scope) -> Element:
        """``<xacro:element xacro:name="link" …>`` as ``<link …>``."""
        name = self._texts.text(_required(element, "xacro:name"), scope)
        if not name:
            raise RobotFileError("<xacro:element>: its name is empty")
        made = self._empty(element, name)
        made.attrib.update({key: text for key, text in element.attrib.items() if key != "xacro:name"})
        made.text = element.text
        made.extend(element)
        return made

    def _insert_block(self, name: str, into: Element, macros: Macros, scope: Scope) -> None:
        many, one = scope.block(f"**{name}"), scope.block(f"*{name}")
        if many is not None:
            self._move(self._expanded(many, macros, scope), into)
        elif one is not None:
            into.append(self._copied(one, macros, scope))
        else:
            raise RobotFileError(f'<xacro:insert_block name="{shown(name)}">: there is no such block')

    def _include(self, element: Element, into: Element, macros: Macros, scope: Scope) -> None:
        written = _required(element, "filename")
        try:
            name = self._texts.text(written, scope)
            paths = self._files.named(name)
            lost = "" if all(path.is_file() for path in paths) else f'there is no file "{shown(name)}"'
        except MissingPackageError as missing:
            name, paths, lost = written, [], str(missing)
        optional = truth(element.get("optional", "false"), "optional")
        if lost and _only_for_others(written):
            if not optional:
                self._left_out[written] = lost
            return
        if lost and not paths:
            raise MissingPackageError(lost)
        if space := element.get("ns"):
            space = self._texts.text(space, scope)
            macros[space], around = ChainMap(), scope
            macros, scope = cast("Macros", macros[space]), Scope(self._texts, around, namespace=True)
            around.set(space, scope)
        for path in paths:
            if optional and not path.is_file():
                continue
            self._enter()
            try:
                root = self._files.xml(path)
            except RobotFileError as refusal:
                raise RobotFileError(f'<xacro:include filename="{shown(name)}">: {refusal}') from refusal
            self._files.stack.append(path)
            made = self._expanded(root, macros, scope)
            self._files.stack.pop()
            self._depth -= 1
            self._move(made, into)
            _lift_namespaces(into, {**root.attrib, **made.attrib})

    def _enter(self) -> None:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise RobotFileError(f"macros and includes are nested more than {_DEEPEST} deep")

    def _call(self, name: str, element: Element, into: Element, macros: Macros, scope: Scope) -> None:
        """Expand a call of a macro: its parameters, its blocks, then its body."""
        found = _found(name, macros, scope)
        if found is None and self._left_out and _only_for_others(name):
            return
        if found is None:
            lost = "".join(f"; {shown(file)} was left out: {why}" for file, why in self._left_out.items())
            raise RobotFileError(f"<xacro:{shown(name)}>: there is no such macro{lost}")
        self._enter()
        own_macros, around, macro = found
        own, missing = Scope(self._texts, around), list(macro.parameters)
        for key, text in element.attrib.items():
            if key == "macro" and element.tag == "xacro:call":
                continue
            if key not in missing or key.startswith("*"):
                raise RobotFileError(f"<{element.tag}>: the macro {name} has no parameter {shown(key)!r}")
            missing.remove(key)
            own.set(key, self._texts.held(text, scope))
        blocks = self._expanded(element, macros, scope)
        self._at = element
        given = cast("list[Element]", list(blocks))
        for key in [key for key in missing if key.startswith("*")]:
            if not given:
                raise RobotFileError(f"<{element.tag}>: the macro {name} needs the block {key.lstrip('*')!r}")
            missing.remove(key)
            own.set_block(key, given.pop(0))
        if given:
            raise RobotFileError(f"<{element.tag}>: the macro {name} has no use for <{given[0].tag}>")
        for key in missing:
            own.set(key, self._default(name, macro, key, scope))
        made = self._expanded(macro.element, own_macros.new_child(), own)
        self._at = element
        self._depth -= 1
        self._move(made, into)
        _lift_namespaces(into, {**macro.element.attrib, **made.attrib})

    def _default(self, name: str, macro: Macro, key: str, scope: Scope) -> object:
        """What a parameter is that a call does not give."""
        passed, text = macro.defaults.get(key, (False, None))
        if passed:
            with suppress(KeyError):
                return scope.get(key)
        if text is None:
            raise RobotFileError(f"the macro {name} needs the parameter {key!r}")
        return self._texts.held(text, scope)


def _only_for_others(name: str) -> bool:
    """Whether a file or a macro is one of simulators or controllers, by its name."""
    return not _NOT_OF_ARMS.isdisjoint(_WORD.findall(name.lower()))


def _required(element: Element, key: str) -> str:
    if (value := element.get(key)) is None:
        raise RobotFileError(f"<{element.tag}>: the attribute {key!r} is missing")
    return value


def _lift_namespaces(into: Element, attributes: Mapping[str, str]) -> None:
    """Declarations of XML namespaces hold for where their content has come to."""
    for key, value in attributes.items():
        if key.startswith("xmlns:") and key != "xmlns:xacro":
            into.attrib.setdefault(key, value)


# Macros.


def _found(name: str, macros: Macros, scope: Scope) -> tuple[Macros, Scope, Macro] | None:
    """The macro of a name, with the macros and the properties that its body sees; None: there is none."""
    macro = macros.get(name)
    for space in name.split(".")[:-1] if macro is None else ():
        inner = macros.get(space)
        try:
            properties = scope.get(space)
        except KeyError:
            break
        if not isinstance(inner, ChainMap) or not isinstance(properties, Scope):
            break
        macros, scope = inner, properties
    else:
        macro = macro or macros.get(name.rpartition(".")[2])
    return (macros, scope, macro) if isinstance(macro, Macro) else None


def _macro(element: Element) -> tuple[str, Macro]:
    name, written = _required(element, "name").removeprefix(_XACRO), element.get("params", "")
    if name == "call" or "." in name:
        raise RobotFileError(
            f'<xacro:macro name="{shown(name)}">: a macro is not called call, and has no dot'
        )
    parameters: list[str] = []
    defaults: dict[str, tuple[bool, str | None]] = {}
    match = _PARAMETER.match(written)
    while match is not None:
        if len(parameters) >= _MOST_PARAMETERS:
            raise RobotFileError(
                f'<xacro:macro name="{shown(name)}">: more than {_MOST_PARAMETERS} parameters'
            )
        parameters.append(match["name"] or match["only"])
        end = match.end()
        if match["name"]:
            end = _end_of_default(written, match.end())
            defaults[match["name"]] = match["passed"] is not None, written[match.end() : end] or None
        match = _PARAMETER.match(written, end)
    return name, Macro(element, tuple(parameters), defaults)


def _end_of_default(text: str, begin: int) -> int:
    for opening, closing in (("${", "}"), ("$(", ")")):
        end = begin
        while text.startswith(opening, begin) and (end := text.find(closing, end) + 1):
            if end == len(text) or text[end].isspace():
                return end
    end = begin
    while end < len(text) and not text[end].isspace():
        if text[end] in "'\"":
            end = text.find(text[end], end + 1)
            if end < 0:
                raise RobotFileError(f'params="{shown(text)}": a quote is not closed')
        end += 1
    return end
