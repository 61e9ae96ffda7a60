"""The arithmetic of one chain, compiled: in plain floats for one pose, in numpy calls for many.

The source is written from the chain's ``ChainProgram`` and kept in ``MatrixKernel.source``. For a yaw and
two pitch joints with links of 0.3 m and 0.2 m, the tool pose reads in plain floats

    def one(out, q0, q1, q2):
        if not q0 * q0 + q1 * q1 + q2 * q2 <= 262144.0:
            return False
        a0 = q0
        c0, s0 = cos(a0), sin(a0)
        ...
        a2 = a1 + q2
        c2, s2 = cos(a2), sin(a2)
        w4 = 0.2 * c2 + 0.3 * c1
        put(out, 0, (c0 * c2), -(c0 * s2), s0, (c0 * w4), (c2 * s0), ...
        return True

and for many poses, with one ufunc call an operation, cosines and sines in the rows of ``c`` and ``s`` and
registers in the rows of ``r``:

    def fill(c, s, r, T):
        c0, c1, c2, = c
        ...
        multiply(c0, c2, T[0, 0])
        multiply(c2, k0, r0)
        multiply(c1, k1, r2)
        add(r0, r2, r1)
        multiply(c0, r1, T[0, 3])
        ...
"""

from __future__ import annotations

import itertools
import math
import struct
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.cos_sin import LARGEST_ANGLE, SCRATCH, cos_sin
from armctl.kinematics.target import require_finite

# Straight-line arithmetic: sums and products of named numbers, folded, then written out as source code.
#
# A chain of joints is worth writing out once: nine 4 x 4 products of an arm come down to some forty sums
# and products when zeros, ones and fixed rows are folded away. The same program is written twice: in plain
# floats for one pose, and as numpy calls into registers for many. ``chain_kernel.py`` shows the result.


class Value(NamedTuple):
    """``factor`` times a named number; a plain constant where the name is empty."""

    factor: float
    name: str = ""

    def times(self, factor: float) -> Value:
        """The value times a constant; costs nothing until it is used in a sum."""
        return Value(self.factor * factor, self.name) if self.factor * factor else ZERO


ZERO = Value(0.0)
ONE = Value(1.0)
Vector = tuple[Value, Value, Value]


class _Step(NamedTuple):
    """One named number: a product of two others, or a sum of terms and a constant."""

    factors: tuple[str, str] | None
    terms: tuple[Value, ...] = ()
    constant: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        return self.factors or tuple(term.name for term in self.terms)


class StraightLine:
    """A growing program. Equal sums and products are computed once."""

    def __init__(self) -> None:
        self._steps: dict[str, _Step] = {}
        self._known: dict[_Step, str] = {}

    def _named(self, step: _Step) -> str:
        name = self._known.get(step)
        if name is None:
            name = self._known[step] = f"w{len(self._steps)}"
            self._steps[name] = step
        return name

    def product(self, a: Value, b: Value) -> Value:
        """The product."""
        if not a.name or not b.name:
            return b.times(a.factor) if not a.name else a.times(b.factor)
        first, second = sorted((a.name, b.name))
        return Value(a.factor * b.factor, self._named(_Step((first, second))))

    def total(self, *values: Value) -> Value:
        """The sum of some values."""
        factors: dict[str, float] = {}
        for value in values:
            factors[value.name] = factors.get(value.name, 0.0) + value.factor
        constant = factors.pop("", 0.0)
        terms = [Value(factor, name) for name, factor in factors.items() if factor]
        if not terms:
            return Value(constant)
        if len(terms) == 1 and not constant:
            return terms[0]
        sign = 1.0 if terms[0].factor > 0 else -1.0  # so that a sum and its opposite are one step
        step = _Step(None, tuple(term.times(sign) for term in terms), sign * constant)
        return Value(sign, self._named(step))

    def dot(self, a: Sequence[Value], b: Sequence[Value]) -> Value:
        """The inner product."""
        return self.total(*(self.product(x, y) for x, y in zip(a, b, strict=True)))

    def needed(self, outputs: Iterable[Value]) -> list[str]:
        """The steps that some outputs rest on, in order."""
        wanted = {value.name for value in outputs}
        for name in reversed(self._steps):
            if name in wanted:
                wanted.update(self._steps[name].names)
        return [name for name in self._steps if name in wanted]

    def inputs(self, outputs: Sequence[Value]) -> set[str]:
        """Names that some outputs rest on and that are no steps."""
        names = {n for step in self.needed(outputs) for n in self._steps[step].names}
        return (names | {value.name for value in outputs}) - self._steps.keys() - {""}

    def _uses(self, names: list[str], outputs: Iterable[Value]) -> Counter[str]:
        uses = Counter(value.name for value in outputs)
        for name in names:
            uses.update(self._steps[name].names)
        return uses

    def as_floats(self, outputs: Sequence[Value]) -> tuple[list[str], list[str]]:
        """Statements in plain floats, and an expression for each output; what is used once is written in."""
        names = self.needed(outputs)
        uses = self._uses(names, outputs)
        written: dict[str, str] = {}
        statements: list[str] = []
        for name in names:
            step = self._steps[name]
            if step.factors is not None:
                text = " * ".join(written.get(n, n) for n in step.factors)
            else:
                text = _signed_sum([_scaled(t, written.get(t.name, t.name)) for t in step.terms])
                text += _plus(step.constant)
            if uses[name] == 1:
                written[name] = f"({text})"
            else:
                statements.append(f"{name} = {text}")
        results: list[str] = []
        for value in outputs:
            sign, text = _scaled(value, written.get(value.name, value.name)) if value.name else ("", "")
            results.append(f"{sign}{text}" if value.name else repr(value.factor))
        return statements, results

    def as_arrays(self, outputs: Sequence[tuple[str, Value]]) -> ArrayCode:
        """The program as numpy calls.

        Args:
            outputs: (place, value): where each value is to be written; places hold zeros beforehand.
        """
        values = [value for _, value in outputs]
        names = self.needed(values)
        writer = _ArrayWriter(self._steps, self._uses(names, values))
        return writer.write(names, outputs)


class ArrayCode(NamedTuple):
    """Calls of numpy that fill their places; registers are ``r0``, ``r1`` …, constants ``k0``, ``k1`` …."""

    lines: list[str]
    registers: int
    constants: list[float]


def _scaled(term: Value, text: str) -> tuple[str, str]:
    """Sign and text of a term."""
    size = abs(term.factor)
    return ("-" if term.factor < 0 else ""), text if size == 1.0 else f"{size!r} * {text}"


def _signed_sum(terms: list[tuple[str, str]]) -> str:
    (sign, first), *rest = terms
    return f"{sign}{first}" + "".join(f" {sign or '+'} {text}" for sign, text in rest)


def _plus(constant: float) -> str:
    return "" if not constant else f" {'-' if constant < 0 else '+'} {abs(constant)!r}"


class _ArrayWriter:
    """Writes numpy calls with as few registers as will do: one is free again after its last use."""

    def __init__(self, steps: dict[str, _Step], uses: Counter[str]) -> None:
        self._steps, self._uses = steps, uses
        self._places: dict[str, str] = {}
        self._free: list[str] = []
        self._code = ArrayCode([], 0, [])
        self._registers = 0

    def write(self, names: list[str], outputs: Sequence[tuple[str, Value]]) -> ArrayCode:
        stores: dict[str, list[tuple[str, float]]] = {}
        for place, value in outputs:
            if value.name or value.factor:
                stores.setdefault(value.name, []).append((place, value.factor))
        for place, factor in stores.pop("", []):
            self._code.lines.append(f"{place} = {factor!r}")
        for name in [n for n in stores if n not in self._steps]:
            self._store(name, stores.pop(name))
        for name in names:
            step, wanted = self._steps[name], stores.get(name, [])
            if self._uses[name] == 1 and wanted:  # straight to its place, by no register
                self._compute(step, *wanted[0])
            else:
                register = self._take()
                self._compute(step, register, 1.0)
                self._places[name] = register
                self._store(name, wanted)
            for used in step.names:
                self._done_with(used)
        return self._code._replace(registers=self._registers)

    def _take(self) -> str:
        if not self._free:
            self._free.append(f"r{self._registers}")
            self._registers += 1
        return self._free.pop()

    def _done_with(self, name: str) -> None:
        self._uses[name] -= 1
        if self._uses[name] == 0 and name in self._places:
            self._free.append(self._places.pop(name))

    def _place(self, name: str) -> str:
        return self._places.get(name, name)

    def _call(self, ufunc: str, *operands: str) -> None:
        self._code.lines.append(f"{ufunc}({', '.join(operands)})")

    def _constant(self, value: float) -> str:
        constants = self._code.constants
        if value not in constants:
            constants.append(value)
        return f"k{constants.index(value)}"

    def _store(self, name: str, wanted: list[tuple[str, float]]) -> None:
        for place, factor in wanted:
            self._scale(self._place(name), factor, place)
            self._done_with(name)

    def _scale(self, operand: str, factor: float, out: str) -> None:
        if factor == 1.0:
            self._call("copyto", out, operand)
        elif factor == -1.0:
            self._call("negative", operand, out)
        else:
            self._call("multiply", operand, self._constant(factor), out)

    def _compute(self, step: _Step, out: str, factor: float) -> None:
        scratch = self._take()
        if step.factors is not None:
            left, right = map(self._place, step.factors)
            if factor != 1.0:
                self._scale(left, factor, scratch)
                left = scratch
            self._call("multiply", left, right, out)
        else:
            terms = [term.times(factor) for term in step.terms]
            self._sum(terms, step.constant * factor, scratch, out)
        self._free.append(scratch)

    def _sum(self, terms: list[Value], constant: float, scratch: str, out: str) -> None:
        terms.sort(key=lambda term: term.factor != 1.0)  # one that needs no factor leads, if any does
        lead, *rest = terms
        so_far = self._place(lead.name)
        held = self._take()
        if lead.factor != 1.0:
            self._scale(so_far, lead.factor, held)
            so_far = held
        for i, term in enumerate(rest):
            operand = self._place(term.name)
            if abs(term.factor) != 1.0:
                self._scale(operand, abs(term.factor), scratch)
                operand = scratch
            target = out if i == len(rest) - 1 and not constant else held
            self._call("add" if term.factor > 0 else "subtract", so_far, operand, target)
            so_far = target
        if constant:
            self._call("add", so_far, self._constant(constant), out)
        self._free.append(held)


# The tool pose and the Jacobian of a chain of joints as straight-line arithmetic.
#
# Neighbouring joints with parallel axes are taken together: inside such a group the chain is planar, only
# the sums of the joint angles count, and each link turns with one of them. With F_g the frame of group g,
# φ_k the sum up to its joint k and (u_k, v_k, w) the tool point seen from joint k in F_g:
#
# * the tool point is found from the tool backwards: (u, v, w)_k = (u, v, w)_(k+1) + Rz(φ_k) link_k, so
# that what only turns about itself drops out and links behind each other become one constant;
# * the rotation is found from the base forwards, one product a group;
# * joint k turns the tool point by z x lever = u_k y - v_k x, with x, y, z the columns of F_g.

FloatArray = NDArray[np.float64]
_PARALLEL = 1e-15
"""sine of the angle between two axes that rounding alone keeps apart"""
Columns = tuple[Vector, Vector, Vector]


class Angle(NamedTuple):
    """A sum of joint angles: ``±q[joint] + constant``, added to the angle ``before`` it in its group."""

    before: int | None
    joint: int
    sign: int
    constant: float


@dataclass
class _Group:
    """Joints with parallel axes: the fixed transform ahead of them, and what follows each of them."""

    rotation: FloatArray
    translation: FloatArray
    turns: list[tuple[Value, Value]] = field(default_factory=list[tuple[Value, Value]])
    """(cos φ_k, sin φ_k)"""
    senses: list[int] = field(default_factory=list[int])
    """+1 or -1: whether joint k turns about +z or -z of the group's frame"""
    links: list[FloatArray] = field(default_factory=list[FloatArray])
    """from joint k to the next, in the frame that turns with joint k"""


class ChainProgram:
    """Straight-line arithmetic of one chain: ``segments`` ahead of each turn about z, and a ``tail``."""

    def __init__(self, segments: Sequence[FloatArray], tail: FloatArray) -> None:
        self.line = StraightLine()
        self.angles: list[Angle] = []
        self._groups = self._grouped(segments)
        self._tail = tail
        self._frames, rotation = self._forwards()
        self._levers, tip = self._backwards()
        self.pose: list[Value] = [
            entry for i in range(3) for entry in (rotation[0][i], rotation[1][i], rotation[2][i], tip[i])
        ] + [ZERO, ZERO, ZERO, ONE]
        """row by row"""
        self.jacobian: list[Value] = self._jacobian()
        """row by row"""

    def _grouped(self, segments: Sequence[FloatArray]) -> list[_Group]:
        groups: list[_Group] = []
        quarters, sense, rest = 0, 1, 0.0
        for joint, segment in enumerate(segments):
            R, t = segment[:3, :3], segment[:3, 3]
            together = bool(groups) and np.abs([*R[:2, 2], *R[2, :2]]).max() < _PARALLEL
            if together:
                groups[-1].links.append(t)
                turned, rest = _quarter_turns(sense * math.atan2(R[1, 0], R[0, 0]))
                quarters += turned
                sense *= 1 if R[2, 2] > 0 else -1
                before = len(self.angles) - 1
            else:
                groups.append(_Group(R, t))
                quarters, sense, rest, before = 0, 1, 0.0, None
            index = len(self.angles)
            self.angles.append(Angle(before, joint, sense, rest))
            cos, sin = Value(1.0, f"c{index}"), Value(1.0, f"s{index}")
            for _ in range(quarters % 4):
                cos, sin = sin.times(-1.0), cos
            groups[-1].turns.append((cos, sin))
            groups[-1].senses.append(sense)
        return groups

    def _turned(self, group: _Group, k: int, v: Vector) -> Vector:
        """A vector that turns with joint k, in the group's frame."""
        (cos, sin), sense = group.turns[k], group.senses[k]
        line, across = self.line, v[1].times(sense)
        return (
            line.total(line.product(cos, v[0]), line.product(sin, across).times(-1.0)),
            line.total(line.product(sin, v[0]), line.product(cos, across)),
            v[2].times(sense),
        )

    def _sum(self, a: Vector, b: Vector) -> Vector:
        x, y, z = (self.line.total(p, q) for p, q in zip(a, b, strict=True))
        return x, y, z

    def _times(self, columns: Columns, rotation: FloatArray) -> Columns:
        x, y, z = (self._apply(columns, _constants(rotation[:, j])) for j in range(3))
        return x, y, z

    def _apply(self, columns: Columns, v: Vector) -> Vector:
        x, y, z = (self.line.dot([column[i] for column in columns], v) for i in range(3))
        return x, y, z

    def _forwards(self) -> tuple[list[Columns], Columns]:
        """Columns of each group's frame, and of the tool's."""
        frames: list[Columns] = []
        columns: Columns = ((ONE, ZERO, ZERO), (ZERO, ONE, ZERO), (ZERO, ZERO, ONE))
        for group in self._groups:
            columns = self._times(columns, group.rotation)
            frames.append(columns)
            (cos, sin), sense = group.turns[-1], group.senses[-1]
            along: Vector = (cos, sin, ZERO)
            across: Vector = (sin.times(-sense), cos.times(sense), ZERO)
            upright: Vector = (ZERO, ZERO, Value(float(sense)))
            columns = (
                self._apply(columns, along), self._apply(columns, across), self._apply(columns, upright)
            )  # fmt: skip
        return frames, self._times(columns, self._tail[:3, :3])

    def _backwards(self) -> tuple[list[list[Vector]], Vector]:
        """The tool point from each joint, in its group's frame; and from the base."""
        levers: list[list[Vector]] = []
        tip = _constants(self._tail[:3, 3])
        for group in reversed(self._groups):
            tip = self._turned(group, len(group.turns) - 1, tip)
            seen = [tip]
            for k in range(len(group.links) - 1, -1, -1):
                tip = self._sum(tip, self._turned(group, k, _constants(group.links[k])))
                seen.insert(0, tip)
            levers.insert(0, seen)
            fixed: Columns = (
                _constants(group.rotation[:, 0]),
                _constants(group.rotation[:, 1]),
                _constants(group.rotation[:, 2]),
            )
            tip = self._sum(self._apply(fixed, tip), _constants(group.translation))
        return levers, tip

    def _jacobian(self) -> list[Value]:
        line = self.line
        columns: list[list[Value]] = []
        for group, (x, y, z), levers in zip(self._groups, self._frames, self._levers, strict=True):
            for sense, (u, v, _) in zip(group.senses, levers, strict=True):
                linear = [
                    line.total(line.product(yi, u), line.product(xi, v).times(-1.0)).times(sense)
                    for xi, yi in zip(x, y, strict=True)
                ]
                columns.append(linear + [zi.times(sense) for zi in z])
        return list(itertools.chain.from_iterable(zip(*columns, strict=True)))


def _constants(v: FloatArray) -> Vector:
    x, y, z = (Value(float(entry)) for entry in v)
    return x, y, z


def _quarter_turns(angle: float) -> tuple[int, float]:
    """Whole quarter turns in an angle, which cost nothing, and what is left [rad]."""
    quarters = round(angle / (math.pi / 2))
    rest = angle - quarters * (math.pi / 2)
    return quarters, rest if abs(rest) > _PARALLEL else 0.0


_CHUNK = 8192
"""configurations worked on at a time: what they need stays in the cache, and the cost of a call is spread"""
_SQUARE_SUM = LARGEST_ANGLE**2


class MatrixKernel(NamedTuple):
    """One matrix (pose or Jacobian) as a function of the joint angles."""

    one: Callable[..., bool]
    """(rows, columns) to be written, and n joint angles [rad]; False where one is huge or not finite"""
    add_angles: Callable[[FloatArray, FloatArray], None]
    """(n, m) joint angles -> (angles, m) sums of those that turn about parallel axes"""
    fill: Callable[[FloatArray, FloatArray, FloatArray, FloatArray], None]
    """(angles, m) cosines, sines, (registers, m) scratch -> (rows, columns, m), zeros beforehand"""
    angles: int
    registers: int
    source: str

    def many(self, q: FloatArray, out: FloatArray) -> None:
        """Matrices of many configurations.

        Args:
            q: (k, n) joint angles [rad].
            out: (rows, columns, k) of zeros, written.

        Raises:
            InputError: an angle is not finite.
        """
        size = min(len(q), _CHUNK)
        blocks = np.empty((3 + SCRATCH, self.angles, size))
        registers = np.empty((self.registers, size))
        for at in range(0, len(q), _CHUNK):
            part = q[at : at + _CHUNK]
            if len(part) < size:
                blocks, registers = blocks[..., : len(part)], registers[:, : len(part)]
            angle, cos, sin = blocks[0], blocks[1], blocks[2]
            self.add_angles(part.T, angle)
            # false with NaN too: a sum of squares is the cheapest look at every angle
            if not sum(np.dot(row, row) for row in angle) <= _SQUARE_SUM:
                self.add_angles(small_angles(part, at).T, angle)
            cos_sin(angle, cos, sin, blocks[3:])
            self.fill(cos, sin, registers, out[..., at : at + len(part)])


def small_angles(q: FloatArray, first_row: int = 0) -> FloatArray:
    """The same turns by angles that are small enough for their sums to keep their digits.

    Args:
        q: (..., n) joint angles [rad].
        first_row: what the first row is called in a message.

    Raises:
        InputError: one is not finite.
    """
    require_finite(q, "joint angles", first_row)
    return np.where(np.abs(q) <= 2 * math.pi, q, np.arctan2(np.sin(q), np.cos(q)))


def pose_kernel(program: ChainProgram) -> MatrixKernel:
    """The tool pose (4, 4)."""
    return _compiled(program, program.pose, (4, 4))


def jacobian_kernel(program: ChainProgram) -> MatrixKernel:
    """The geometric Jacobian (6, n)."""
    return _compiled(program, program.jacobian, (6, len(program.angles)))


def _compiled(program: ChainProgram, entries: list[Value], shape: tuple[int, int]) -> MatrixKernel:
    line = program.line
    used = _used_angles(program.angles, line.inputs(entries))
    code = line.as_arrays([(f"T[{i // shape[1]}, {i % shape[1]}]", v) for i, v in enumerate(entries)])
    head = [f"{_names(kind, used)} = {kind}" for kind in "cs" if used]
    if code.registers:
        head.append(f"{_names('r', range(code.registers))} = r")
    squares = " + ".join(f"q{k} * q{k}" for k in range(len(program.angles)))
    joints = ", ".join(f"q{k}" for k in range(len(program.angles)))
    statements, results = line.as_floats(entries)
    source = "\n\n\n".join(
        (
            _function(
                f"one(out, {joints})",
                [
                    f"if not {squares} <= {_SQUARE_SUM}:",
                    "    return False",
                    *_angles_of_one(program.angles, used),
                    *statements,
                    f"put(out, 0, {', '.join(results)})",
                    "return True",
                ],
            ),
            _function("add_angles(q, a)", _angles_of_many(program.angles, used)),
            _function("fill(c, s, r, T)", [*head, *code.lines]),
        )
    )
    names: dict[str, Any] = {f"k{i}": np.array(k) for i, k in enumerate(code.constants)}
    names |= {name: getattr(np, name) for name in ("add", "subtract", "multiply", "negative", "copyto")}
    # packed straight into the array's memory: a third of what an array made of a list costs
    names |= {"cos": math.cos, "sin": math.sin, "put": struct.Struct(f"{len(entries)}d").pack_into}
    exec(compile(source, "<chain kernel>", "exec"), names)  # built from this package's own strings and floats
    return MatrixKernel(
        one=names["one"], add_angles=names["add_angles"], fill=names["fill"],
        angles=len(used), registers=code.registers, source=source,
    )  # fmt: skip


def _names(kind: str, numbers: Sequence[int]) -> str:
    return "".join(f"{kind}{i}, " for i in numbers).rstrip()


def _function(signature: str, lines: Sequence[str]) -> str:
    return "\n    ".join([f"def {signature}:", *(lines or ["pass"])])


def _used_angles(angles: Sequence[Angle], names: set[str]) -> list[int]:
    """Those whose cosine or sine is needed, and those that they are added to."""
    used = {i for i in range(len(angles)) if not names.isdisjoint((f"c{i}", f"s{i}"))}
    for i in reversed(range(len(angles))):
        before = angles[i].before
        if i in used and before is not None:
            used.add(before)
    return sorted(used)


def _angles_of_one(angles: Sequence[Angle], used: Sequence[int]) -> list[str]:
    lines: list[str] = []
    for i in used:
        angle = angles[i]
        text = ("-" if angle.sign < 0 else "") + f"q{angle.joint}"
        if angle.before is not None:
            text = f"a{angle.before} {'-' if angle.sign < 0 else '+'} q{angle.joint}"
        lines.append(f"a{i} = {text}" + (f" + {angle.constant!r}" if angle.constant else ""))
        lines.append(f"c{i}, s{i} = cos(a{i}), sin(a{i})")
    return lines


def _angles_of_many(angles: Sequence[Angle], used: Sequence[int]) -> list[str]:
    row = {i: f"a[{at}]" for at, i in enumerate(used)}
    lines: list[str] = []
    for i, place in row.items():
        before, joint, sign, constant = angles[i]
        if before is None:
            whole = f"copyto({place}, q[{joint}])" if sign > 0 else f"negative(q[{joint}], {place})"
            lines.append(whole)
        else:
            lines.append(f"{'add' if sign > 0 else 'subtract'}({row[before]}, q[{joint}], {place})")
        if constant:
            lines.append(f"add({place}, {constant!r}, {place})")
    return lines
