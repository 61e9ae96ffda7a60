"""The paper's own loop in C, compiled when the benchmark runs and called through ctypes."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import tempfile
from ctypes import Structure, byref, c_double, c_long, c_void_p
from functools import cache
from pathlib import Path
from typing import ClassVar

import numpy as np
from benchmarks.planar_arm import FloatArray, PlanarArm
from benchmarks.row import NotMeasuredError

_SOURCE = Path(__file__).with_name("paper_loop.c")


class _Arm(Structure):
    _fields_: ClassVar = [
        ("lateral", c_double),
        ("shoulder_r", c_double),
        ("shoulder_z", c_double),
        ("length", c_double * 3),
        ("sign", c_double * 4),
        ("offset", c_double * 3),
        ("low", c_double * 5),
        ("high", c_double * 5),
    ]


def _struct(arm: PlanarArm) -> _Arm:
    limits = np.vstack([arm.limits, arm.roll_limits]).tolist()
    return _Arm(
        arm.lateral,
        arm.shoulder_r,
        arm.shoulder_z,
        (c_double * 3)(*arm.lengths),
        (c_double * 4)(arm.yaw_sign, *arm.signs),
        (c_double * 3)(*arm.offsets),
        (c_double * 5)(*(low for low, _ in limits)),
        (c_double * 5)(*(high for _, high in limits)),
    )


@cache
def library() -> ctypes.CDLL:
    """The loop, built anew in each run.

    Raises:
        NotMeasuredError: there is no C compiler, or it refuses.
    """
    compiler = shutil.which("cc")
    if compiler is None:
        raise NotMeasuredError("no C compiler: cc is not on the path")
    with tempfile.TemporaryDirectory() as folder:
        target = str(Path(folder) / "paper_loop.so")
        command = [compiler, "-O3", "-march=native", "-fPIC", "-shared", str(_SOURCE), "-o", target, "-lm"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise NotMeasuredError(f"cc failed: {done.stderr.strip().splitlines()[-1]}")
        found = ctypes.CDLL(target)
    found.paper_sweep.restype = c_long
    found.least_sum.restype = c_double
    return found


def _at(array: FloatArray) -> c_void_p:
    return c_void_p(array.ctypes.data)


class PaperLoop:
    """The loop for one arm, over the multiples of ``step`` inside the limits of the first pitch joint."""

    def __init__(self, arm: PlanarArm, step: float) -> None:
        self._c, self._library, self._step = _struct(arm), library(), step
        low, high = arm.limits[1].tolist()
        self._capacity = 4 * (math.floor(high / step + 1e-6) - math.ceil(low / step - 1e-6) + 1)

    def solutions(self, position: FloatArray) -> FloatArray:
        """(k, 4) joint angles [rad] that put the tip at a position (3,) [m]."""
        q = np.empty((self._capacity, 4))
        found = self._library.paper_sweep(byref(self._c), _at(position), c_double(self._step), _at(q))
        return q[:found]

    def least_sum(self, q: FloatArray) -> float:
        """The least sum of absolute angles among (k, 4) rows; infinite where there are none."""
        return float(self._library.least_sum(_at(q), c_long(len(q))))
