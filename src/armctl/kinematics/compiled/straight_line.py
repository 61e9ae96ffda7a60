"""Straight-line arithmetic: sums and products of named numbers, folded, then written out as source code.

A chain of joints is worth writing out once: nine 4 x 4 products of an arm come down to some forty sums
and products when zeros, ones and fixed rows are folded away. The same program is written twice: in plain
floats for one pose, and as numpy calls into registers for many. ``chain_kernel.py`` shows the result.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple


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
