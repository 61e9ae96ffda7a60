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

import math
import struct
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.checks import require_finite
from armctl.kinematics.compiled.chain_program import Angle, ChainProgram
from armctl.kinematics.compiled.straight_line import Value
from armctl.kinematics.cos_sin import LARGEST_ANGLE, SCRATCH, cos_sin

FloatArray = NDArray[np.float64]
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
