"""Xacro files that try to run code, to read what is not theirs, or to take time and memory.

An audit hook of the interpreter watches each: nothing is executed, imported or started, and no file is opened
outside of the arm's folder. That each ends soon is counted in calls, not in seconds.
"""

from __future__ import annotations

import codecs
import itertools
import os
import random
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import pytest
from tests.robot.xacro_kit import by_armctl, robot

from armctl.errors import RobotFileError
from armctl.robot import load_robot

LONG = bool(os.environ.get("ARMCTL_LONG"))
COUNT = 1000
"""files to choose from; unless it may take long, those are left out in which nothing is new"""
SECRET = "swordfish"
MOST_CALLS = 15_000_000
"""calls and returns of the refusal of one file: less than a second, where nobody counts them"""
COUNTED = 60 if LONG else 15
"""files whose calls are counted, which takes three times as long"""

# What is tried. {n} is a number, {word} a name, {outside} a folder that is not the arm's.

RUNS = (
    "__import__('os').system('touch {outside}/owned')",
    "().__class__.__base__.__subclasses__()[{n}]",
    "''.__class__.__mro__[1].__subclasses__()",
    "[x for x in (1).__class__.__base__.__subclasses__() if x.__name__ == '{word}']",
    "(i.gi_frame for i in [0]).gi_frame",
    "(g.gi_frame.f_back.f_back.f_builtins for g in [{n}])",
    "[g for g in [(i for i in [1])]][0].gi_frame.f_back.f_globals['__builtins__']",
    "(lambda: {n})()",
    "(lambda f: f(f))(lambda f: f(f))",
    "(x := {n})",
    "eval('{n}')",
    "exec('{word} = 1')",
    "compile('1', '', 'eval')",
    "open('{outside}/secret.txt').read()",
    "getattr(1, 'real')",
    "getattr(getattr('', '__class__'), '__mro__')",
    "setattr(xacro, 'load_yaml', 1)",
    "vars(xacro)",
    "python.vars(math)",
    "python.type('')",
    "python.type('x', (), dict())",
    "globals()['{word}']",
    "locals()",
    "dir()",
    "input()",
    "breakpoint()",
    "math.__loader__.load_module('os')",
    "math.__spec__",
    "xacro.load_yaml.__globals__",
    "load_yaml.__self__.files",
    "load_yaml.call",
    "math.entries",
    "cos.call.__self__",
    "str.join.__objclass__",
    "str.mro()",
    "'{word}'.__class__",
    "'%s' % math",
    "'%({word})s' % dict({word}=1)",
    "map(eval, ['1'])",
    "list(map(python.sorted, [[1]]))",
    "sorted([1, 2], key=len)",
    "max([1, 2], key=str)",
    "python.filter(None, [1])",
    "*[1, 2]",
    "[*[1, 2]]",
    "dict(**dict(a=1))",
    "print('{word}')",
    "xacro._texts",
    "python.__import__('os')",
    "await {word}",
    "(yield {n})",
    "1 if 2",
    "{word}.{word}.{word}",
    "b'{word}'",
    "...",
    "1j ** {n}",
    "[1, 2][0]()",
    "'\\\\x41'",
    "{word}({n})",
    "not_there_{n}",
)
EVALS = (
    "f'{{word}}'",
    "f'{{word}!r:>{{n}}}'",
    "''.__class__.__mro__",
    "lambda: {n}",
    "[x.gi_frame for x in [1]]",
    "{word}.path",
    "'{word}' % {n}",
    "9 ** 9 ** {n}",
    "[[0] * 9999] * 9999",
)
"""in $(eval …), which has no room for a bracket"""
FORMATS = (
    "{0.__class__}",
    "{0.__class__.__mro__[1].__subclasses__}",
    "{0[0]}",
    "{0!r}",
    "{:1000{n}}",
    "{:>{1}}",
    "{:0{n}00d}",
    "{:.{n}00f}",
    "{0:{0.real}}",
    "{:%Y}",
    "{none.{word}}",
    "{{0}",
    "{",
)
READS = (
    "load_yaml('/etc/passwd')",
    "xacro.load_yaml('{outside}/secret.yaml')",
    "load_yaml('../outside/secret.yaml')",
    "load_yaml('link/secret.yaml')",
    "load_yaml('linked.yaml')['password']",
    "load_yaml('/proc/self/environ')",
    "load_yaml('/proc/self/mem')",
    "load_yaml('/dev/zero')",
    "load_yaml('/dev/tty')",
    "load_yaml('fifo')",
    "load_yaml('.')",
    "load_yaml('http://127.0.0.1:{n}/a.yaml')",
    "load_yaml('file://{outside}/secret.yaml')",
    "load_yaml('$(find outside)/secret.yaml')",
    "load_yaml('$(find etc)/passwd')",
    "load_yaml('$(find ..)/outside/secret.yaml')",
    "load_yaml('$(find arm)/../outside/secret.yaml')",
    "load_yaml(xacro.abs_filename('../outside/secret.yaml'))",
    "load_yaml('{word}' * {n})",
    "load_yaml('arm' + '/../' * {n})",
    "load_yaml({n})",
    "load_yaml('run.yaml')",
    "load_yaml('merge.yaml')",
    "load_yaml('unit.yaml')",
    "'$(env HOME)'",
    "'$(cwd)'",
    "'$(find outside)'",
)
HANGS = (
    "9 ** 9 ** 9",
    "{n} ** {n} ** {n}",
    "2 ** (10 ** {n})",
    "10 ** 299 * 10 ** {n}",
    "'{word}' * 10 ** {n}",
    "[0] * 10 ** 9",
    "[[0] * 9999] * 9999",
    "python.range(10 ** {n})[0:10 ** 9]",
    "list(python.range(10 ** 9))",
    "len(python.range(10 ** 30))",
    "{n} in python.range(10 ** 12)",
    "python.sum(python.range(10 ** 10))",
    "python.sum([[1]] * 9999, [])",
    "[i for i in python.range(10 ** 9)]",
    "[i + j + k for i in range(999) for j in range(999) for k in range(999)]",
    "[[j for j in range(9999)] for i in range(9999)]",
    "len([1 for i in range(19999) for j in range(19999) if 0 > i + j])",
    "round(1, -10 ** {n})",
    "round(10 ** 200, -{n}000000)",
    "'a'.zfill(10 ** 9)",
    "('ab' * 40000).replace('a', 'b' * 40000)",
    "('a' * 50000).join(list('a' * 9999))",
    "('a' * 90000).strip('b' * 50000 + 'a')",
    "('a' * 90000).rfind('b' + 'a' * 40000)",
    "xacro.tokenize('a' * 90000, 'abcdefgh' * 50)",
    "int('9' * 9999)",
    "str(10 ** 5000)",
    "math.factorial(10 ** {n})",
    "math.comb(10 ** 9, 10 ** 8)",
    "python.hash({n})",
    "load_yaml('laughs.yaml')",
    "load_yaml('laughs.yaml') == load_yaml('laughs.yaml')",
    "load_yaml('circle.yaml')",
    "load_yaml('deep.yaml')",
    "load_yaml('braces.yaml')",
    "load_yaml('wide.yaml')",
    "load_yaml('huge.yaml')",
    "load_yaml('number.yaml')",
    "{'(' * depth}{n}{')' * depth}",
    "{'[' * depth}{n}{']' * depth}",
    "{'-' * depth}{n}",
    "{'not ' * depth}{n}",
    "{'1+' * depth}{n}",
    "{'9**' * depth}{n}",
    "x{'.x' * depth}",
)
MACRO = "<xacro:macro name='m' params={}>{}</xacro:macro>"
PLACES: tuple[Callable[[str], str], ...] = (
    lambda text: f"<link name={quoteattr(text)}/>",
    lambda text: f"<a><b c='1' d={quoteattr(text)}/></a>",
    lambda text: f"<a>{escape(text)}</a>",
    lambda text: f"<xacro:property name='p' value={quoteattr(text)}/><link name='${{p}}'/>",
    lambda text: f"<xacro:property name='p' value={quoteattr(text)} lazy_eval='false'/>",
    lambda text: f"<xacro:property name={quoteattr(text)} value='1'/>",
    lambda text: f"<xacro:if value={quoteattr('x' + text)}><a/></xacro:if>",
    lambda text: f"<xacro:arg name='a' default={quoteattr(text)}/><a b='$(arg a)'/>",
    lambda text: MACRO.format("'x'", "<a b='${x}'/>") + f"<xacro:m x={quoteattr(text)}/>",
    lambda text: MACRO.format(quoteattr(f"x:={text}"), "<a b='${x}'/>") + "<xacro:m/>",
    lambda text: (
        MACRO.format("'*x'", "<xacro:insert_block name='x'/>")
        + f"<xacro:m><a b={quoteattr(text)}/></xacro:m>"
    ),
    lambda text: (
        f"<xacro:property name='p'><a b={quoteattr(text)}/></xacro:property><xacro:insert_block name='p'/>"
    ),
    lambda text: f"<xacro:include filename={quoteattr('none' + text)}/>",
    lambda text: f"<xacro:call macro={quoteattr('m' + text)}/>",
    lambda text: f"<xacro:element xacro:name={quoteattr('xacro:' + text)}/>",
    lambda text: f"<a><xacro:attribute name='n' value={quoteattr(text)}/></a>",
    lambda text: f"<xacro:include filename='part.xacro'/><xacro:part x={quoteattr(text)}/>",
)
"""where an expression stands; each of them is evaluated"""
INCLUDES = (
    "/etc/passwd", "/proc/self/environ", "/proc/self/cmdline", "/dev/zero", "/dev/stdin", "fifo", ".", "link",
    "{outside}/secret.xacro", "../outside/secret.xacro", "link/secret.xacro", "linked.xacro", "../outside/*",
    "/proc/*/environ", "*/*.xacro", "http://127.0.0.1:{n}/a.xacro", "file:///etc/passwd", "ftp://host/{word}",
    "package://outside/secret.xacro", "$(find outside)/secret.xacro", "$(find arm)/../outside/secret.xacro",
    "$(find ../outside)/secret.xacro", "$(env HOME)/a.xacro", "{word}.xacro", "arm.xacro", "~/.ssh/id_rsa",
    "laughs.xacro", "deep.xacro", "twice.xacro", "entity.xacro", "a/{dots}etc/passwd",
)  # fmt: skip
WHOLE = (
    "<xacro:macro name='m' params=''><xacro:m/></xacro:macro><xacro:m/>",
    "<xacro:macro name='m' params=''><xacro:m/><xacro:m/></xacro:macro><xacro:m/>",
    "<xacro:macro name='m' params='n'><a/><xacro:if value='${{n}}'>{calls}</xacro:if></xacro:macro>"
    "<xacro:m n='{n}0'/>",
    "<xacro:macro name='a' params=''><xacro:b/></xacro:macro>"
    "<xacro:macro name='b' params=''><xacro:a/></xacro:macro><xacro:a/>",
    "<xacro:property name='a' value='${{a}}'/><link name='${{a}}'/>",
    "<xacro:property name='a' value='${{b}}'/><xacro:property name='b' value='${{a + {n}}}'/>"
    "<link name='${{b}}'/>",
    "<xacro:property name='p0' value='{word}{word}'/>{doubled}<link name='${{p{last}}}'/>",
    "<xacro:property name='p0' value='${{[1, 2]}}'/>{listed}<link name='${{p{last}}}'/>",
    "<xacro:property name='p0' value='${{[1, 2]}}'/>{listed}<link name='${{p{last} == p{last}}}'/>",
    "{chained}<xacro:property name='p{last}' value='1'/><link name='${{p0}}'/>",
    "<xacro:macro name='m' params='*b n'><xacro:if value='${{n}}'>"
    "<xacro:m n='${{n - 1}}'><a>{inserts}</a></xacro:m></xacro:if>"
    "<xacro:insert_block name='b'/></xacro:macro><xacro:m n='{n}9'><a/></xacro:m>",
    "<xacro:property name='b'><xacro:insert_block name='b'/></xacro:property><xacro:insert_block name='b'/>",
    "<xacro:macro name='m' params=\"a:={word}{quotes}'\"/>",
    "<xacro:macro name='m' params='{many}'/><xacro:m/>",
    "<xacro:element xacro:name='xacro:m'/>",
    "<a b='{dollars}${{'/>",
    "{nested}",
)


def number(chance: random.Random) -> str:
    return str(chance.choice((7, 12, 99, 400, 1001, 65536, 10**9)))


def filled(text: str, chance: random.Random, outside: Path) -> str:
    """What is tried, with its numbers and names."""
    depth = chance.choice((300, 400, 900, 1600))
    for bracket in ("(", "[", ")", "]", "-", "not ", "1+", "9**", ".x"):
        text = text.replace(f"{{'{bracket}' * depth}}", bracket * depth)
    text = text.replace("{outside}", str(outside)).replace("{dots}", "../" * chance.randint(3, 40))
    return text.replace("{n}", number(chance)).replace(
        "{word}", chance.choice(("os", "sys", "subprocess", "a"))
    )


def whole(chance: random.Random) -> str:
    last = chance.randint(60, 200)
    pairs = [(f"p{k}", f"p{k + 1}") for k in range(last)]
    chosen = chance.choice(WHOLE)
    return chosen.format(
        n=chance.choice((3, 5, 8)),
        word=chance.choice(("x", "left")) * chance.randint(1, 30),
        calls="<xacro:m n='${n - 1}'/>" * chance.randint(2, 12),
        inserts="<xacro:insert_block name='b'/>" * chance.randint(2, 9),
        doubled="".join(f"<xacro:property name='{b}' value='${{{a}}}${{{a}}}'/>" for a, b in pairs),
        listed="".join(
            f"<xacro:property name='{b}' value='${{[{a}, {a}]}}' lazy_eval='false'/>" for a, b in pairs
        ),
        chained="".join(f"<xacro:property name='{a}' value='${{{b} + 1}}'/>" for a, b in pairs),
        last=last,
        quotes="".join(chance.choice(("'x'", "x")) for _ in range(60)),
        many=" ".join(f"a{k}" for k in range(chance.randint(501, 900))),
        dollars="$a" * chance.randint(1, 99),
        nested="<a>" * 300 + "</a>" * 300,
    )


def hostile(chance: random.Random, outside: Path) -> str:
    """One file."""
    kinds = ("expression",) * 6 + ("eval", "format", "include", "include", "whole", "whole", "entity")
    kind = chance.choice(kinds)
    if kind == "include":
        name, space = filled(chance.choice(INCLUDES), chance, outside), chance.choice(("", " ns='space'"))
        return robot(f"<xacro:include filename={quoteattr(name)}{space}/><link name='${{secret}}'/>")
    if kind == "whole":
        return robot(whole(chance))
    if kind == "entity":
        levels = range(1, chance.randint(3, 12))
        laughs = "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in levels)
        file = chance.choice(
            (str(outside / "secret.txt"), "/etc/passwd", f"/proc/{chance.randint(1, 99)}/mem")
        )
        outer = f'<!ENTITY a0 SYSTEM "file://{file}">'
        return f"<!DOCTYPE robot [{outer}{laughs}]>{robot(f'<a>&a{levels[-1]};</a>')}"
    if kind == "format":
        pattern = filled(chance.choice(FORMATS), chance, outside)
        given = chance.choice(("1", "math", "xacro", "cos", "'a'", "[1]", "none=1"))
        return robot(
            f"<xacro:property name='p' value={quoteattr(pattern)}/><a b=\"${{p.format({given})}}\"/>"
        )
    place = chance.choice(PLACES)
    if kind == "eval":
        return robot(place(f"$(eval {filled(chance.choice(EVALS), chance, outside)})"))
    return robot(place(f"${{{filled(chance.choice(chance.choice((RUNS, READS, HANGS))), chance, outside)}}}"))


YAML = {
    "run.yaml": "a: !!python/object/apply:os.system ['touch owned']",
    "merge.yaml": "a: &a {x: 1}\nb: {<<: [*a, *a]}",
    "unit.yaml": "a: !degrees __import__('os').getcwd()",
    "laughs.yaml": "a: &a [x, x, x, x, x, x, x, x]\n"
    + "".join(f"{b}: &{b} [{', '.join(['*' + a] * 9)}]\n" for a, b in itertools.pairwise("abcdefghi")),
    "circle.yaml": "&a [*a]",
    "deep.yaml": "[" * 90_000,
    "braces.yaml": "{" * 90_000,
    "wide.yaml": "[" + "[]," * 60_000 + "]",
    "huge.yaml": "x" * 300_000,
    "number.yaml": "a: 0x" + "f" * 90_000,
}


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an arm, beside one that is none of its business."""
    folder = tmp_path_factory.mktemp("hostile") / "arm"
    outside = folder.parent / "outside"
    for place in (folder, outside):
        place.mkdir()
    for name, content in YAML.items():
        (folder / name).write_text(content)
    (outside / "secret.txt").write_text(SECRET)
    (outside / "secret.yaml").write_text(f"password: {SECRET}")
    (outside / "secret.xacro").write_text(robot(f'<xacro:property name="secret" value="{SECRET}"/>'))
    (folder / "part.xacro").write_text(
        robot('<xacro:macro name="part" params="x"><a b="${x}"/></xacro:macro>')
    )
    (folder / "deep.xacro").write_text(robot("<a>" * 5000 + "</a>" * 5000))
    (folder / "twice.xacro").write_text(robot('<xacro:include filename="twice.xacro"/>' * 2))
    (folder / "entity.xacro").write_text("<!DOCTYPE a [<!ENTITY b SYSTEM 'file:///etc/passwd'>]><a>&b;</a>")
    (folder / "laughs.xacro").write_text(robot("<a b=\"${load_yaml('laughs.yaml')}\"/>"))
    (folder / "link").symlink_to(outside)
    (folder / "linked.yaml").symlink_to(outside / "secret.yaml")
    (folder / "linked.xacro").symlink_to(outside / "secret.xacro")
    os.mkfifo(folder / "fifo")
    return folder


class Watch:
    """What the interpreter does while a file is expanded."""

    def __init__(self) -> None:
        self.on = False
        self.opened: list[str] = []
        self.ran: list[str] = []
        sys.addaudithook(self._event)  # for good: it cannot be taken off

    def _event(self, event: str, arguments: tuple[object, ...]) -> None:
        if not self.on:
            return
        if event == "exec" and sys._getframe(1).f_globals["__name__"] == "dataclasses":
            return  # methods of our own records, made when one is used
        if event == "open":
            self.opened.append(str(arguments[0]))
        elif event in ("exec", "import") or event.split(".")[0] in ("os", "subprocess", "socket", "ctypes"):
            if event not in ("os.scandir", "os.listdir"):
                self.ran.append(f"{event} {arguments!r:.80}")

    @contextmanager
    def over(self) -> Iterator[None]:
        self.opened, self.ran, self.on = [], [], True
        try:
            yield
        finally:
            self.on = False


@pytest.fixture(scope="module")
def watch() -> Watch:
    codecs.lookup("utf-8-sig")  # what files are read with is imported once
    return Watch()


class Chance(random.Random):
    """One that tells what was chosen."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self.chosen: list[object] = []

    def choice(self, seq: Sequence[Any]) -> Any:
        self.chosen.append(super().choice(seq))
        return self.chosen[-1]


def cases(outside: Path) -> Iterator[str]:
    """Different ones."""
    chance, seen, tried = Chance(30), set[str](), set[object]()
    while len(seen) < COUNT:
        chance.chosen.clear()
        text = hostile(chance, outside)
        if text in seen:
            continue
        seen.add(text)
        if LONG or not tried.issuperset(chance.chosen):
            tried.update(chance.chosen)
            yield text


@pytest.mark.slow
def test_hostile_files_run_nothing_and_read_nothing(arm: Path, watch: Watch) -> None:
    file = arm / "arm.xacro"
    for text in cases(arm.parent / "outside"):
        file.write_text(text)
        with pytest.raises(RobotFileError) as refused, watch.over():
            by_armctl(file)
        says = str(refused.value)
        assert not watch.ran, text
        assert all(Path(one).resolve().is_relative_to(arm) for one in watch.opened), (text, watch.opened)
        assert "line " in says or "holds a document type" in says, (text, says)
        assert SECRET not in says and "\n" not in says and len(says) < 900, (text, says)
        assert not list(arm.parent.rglob("owned"))


@pytest.mark.slow
def test_a_hostile_file_is_refused_after_a_bounded_number_of_calls(arm: Path) -> None:
    file, calls = arm / "arm.xacro", 0

    def count(_frame: FrameType, _event: str, _argument: object) -> None:
        nonlocal calls
        calls += 1

    texts = list(cases(arm.parent / "outside"))
    for text in texts[:: len(texts) // COUNTED]:
        file.write_text(text)
        calls = 0
        sys.setprofile(count)
        try:
            with pytest.raises(RobotFileError):
                by_armctl(file)
        finally:
            sys.setprofile(None)
        assert calls < MOST_CALLS, text


@pytest.mark.parametrize(
    "expression",
    [
        "[x[0] % x[1] for x in [map(int, ['f'*100000, 'f'*50000], [16, 16])] for i in range(100)]",
        "len(python.set([i*(2**61-1) for i in range(1, 10000)]))",
        "[int('f'*100000, 16)]",
        "(2**59) * (2**59)",
    ],
)
def test_whole_numbers_that_take_long_are_refused(tmp_path: Path, expression: str) -> None:
    file = tmp_path / "arm.urdf.xacro"
    file.write_text(
        '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        f'<xacro:property name="p" value="${{{expression}}}"/><link name="${{p}}"/></robot>'
    )
    with pytest.raises(RobotFileError, match="a whole number of more than 18 digits"):
        load_robot(file)


def test_a_file_of_very_many_elements_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(f'<robot name="a">{"<a/>" * 200_000}</robot>')
    with pytest.raises(RobotFileError, match="more than 100000 elements"):
        load_robot(file)
