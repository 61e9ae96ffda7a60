"""The C references: compiled when the benchmark runs, called through ctypes. Benchmark tooling only.

Every function returns new arrays, as armctl's does, so that both sides pay for their memory.
"""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import tempfile
from ctypes import Structure, byref, c_double, c_long, c_void_p
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import ClassVar

import numpy as np
from benchmarks.planar_arm import FloatArray, PlanarArm
from benchmarks.row import NotMeasuredError
from numpy.typing import NDArray

SOURCES = Path(__file__).parent / "c"
PLAIN = ("-O3", "-march=native", "-fPIC")
FAST = (*PLAIN, "-ffast-math", "-mprefer-vector-width=512")
"""lets the compiler use its vectorised sine, arc cosine, …: the limit that armctl is held against"""
FLAGS = {
    "paper_sweep": PLAIN,
    "forward": FAST,
    "least_rotation": FAST,
    "pose": FAST,
    "interval_sweep": FAST,
}
_BRANCHES = 8


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
    """All references in one library, built anew in each run.

    Raises:
        NotMeasuredError: there is no C compiler, or it refuses.
    """
    compiler = shutil.which("cc")
    if compiler is None:
        raise NotMeasuredError("no C compiler: cc is not on the path")
    with tempfile.TemporaryDirectory() as folder:
        objects = [str(Path(folder) / f"{name}.o") for name in FLAGS]
        target = str(Path(folder) / "references.so")
        for (name, flags), out in zip(FLAGS.items(), objects, strict=True):
            _run(compiler, *flags, "-c", str(SOURCES / f"{name}.c"), "-o", out)
        # linked without -ffast-math, which would flush denormals to zero for all of Python
        _run(compiler, "-shared", *objects, "-o", target, "-lmvec", "-lm")
        found = ctypes.CDLL(target)
    found.paper_sweep.restype = found.interval_sweep.restype = c_long
    found.least_sum.restype = c_double
    return found


def _run(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise NotMeasuredError(f"{Path(command[0]).name} failed: {done.stderr.strip().splitlines()[-1]}")


def _at(array: FloatArray | NDArray[np.uint8]) -> c_void_p:
    return c_void_p(array.ctypes.data)


@dataclass
class CArm:
    """One arm's references in C."""

    arm: PlanarArm

    def __post_init__(self) -> None:
        self._c, self._library = _struct(self.arm), library()

    def forward(self, q: FloatArray) -> FloatArray:
        """(k, 5) -> (k, 4, 4); uzuner's build only."""
        T = np.empty((len(q), 4, 4))
        self._library.forward_batch(byref(self._c), _at(q), c_long(len(q)), _at(T))
        return T

    def jacobian(self, q: FloatArray) -> FloatArray:
        """(k, 5) -> (k, 6, 5); uzuner's build only."""
        J = np.empty((len(q), 6, 5))
        self._library.jacobian_batch(byref(self._c), _at(q), c_long(len(q)), _at(J))
        return J

    def grid(self, step: float) -> FloatArray:
        """The whole multiples of ``step`` inside the limits of the first pitch joint."""
        low, high = self.arm.limits[1].tolist()
        return step * np.arange(math.ceil(low / step - 1e-6), math.floor(high / step + 1e-6) + 1)

    def paper_sweep(self, position: FloatArray, step: float, capacity: int) -> FloatArray:
        """(k, 4) solutions by the paper's own loop; ``capacity`` rows are room enough."""
        q = np.empty((capacity, 4))
        found = self._library.paper_sweep(byref(self._c), _at(position), c_double(step), _at(q))
        return q[:found]

    def least_sum(self, q: FloatArray) -> float:
        """The least sum of absolute angles among (k, 4) rows; infinite where there are none."""
        return float(self._library.least_sum(_at(q), c_long(len(q))))

    def interval_sweep(self, position: FloatArray, table: FloatArray, step: float) -> FloatArray:
        """(k, 5) solutions; ``table`` (3, grid) is the grid, its cosines and its sines."""
        size = table.shape[1]
        q = np.empty((5, 4 * size))
        grid, c, s = (_at(row) for row in table)
        found = self._library.interval_sweep(
            byref(self._c), _at(position), grid, c, s, c_long(size), c_double(step), _at(q), c_long(4 * size)
        )
        return q[:, :found].T

    def least_rotation(self, positions: FloatArray) -> FloatArray:
        """(k, 3) -> (k, 5), NaN where out of reach; the roll joint at zero."""
        q = np.empty((len(positions), 5))
        self._library.least_rotation_batch(
            byref(self._c), _at(positions), c_long(len(q)), _at(q), c_double(math.nan)
        )
        return q

    def pose(
        self, positions: FloatArray, pitch: FloatArray, roll: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """(k, 3), (k), (k) -> all branches (k, 8, 5) and which of them are inside the limits (k, 8)."""
        count = len(positions)
        q, found = np.empty((count, _BRANCHES, 5)), np.empty((count, _BRANCHES), np.uint8)
        self._library.pose_batch(
            byref(self._c), _at(positions), _at(pitch), _at(roll), c_long(count), _at(q), _at(found),
            c_double(math.nan),
        )  # fmt: skip
        return q, found.view(np.bool_)
