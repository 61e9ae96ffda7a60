"""The nearest point that the tool can reach: exact, by the conditions that an optimum must meet.

In the tool plane, at the nearest point each pitch joint is either at a limit or points its rest of the
arm straight at (or away from) the target. So there are 3^m choices of which joints are at which limit,
and for each the free groups of links lie on one line: 64 candidates for three joints. The base is then
turned to where it serves that point best, and the two steps repeat until nothing changes.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import images
from armctl.kinematics.yaw_pitch_roll import YawPitchRoll

FloatArray = NDArray[np.float64]
_ROUNDS = 40
Plane = tuple[float, ...]


class NearestReach:
    """Nearest reachable points of one arm. Immutable; safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self.geometry = geometry
        self.base_limits = (float(limits[0, 0]), float(limits[0, 1]))
        self.plane_limits = [geometry.plane_limits(k, limits) for k in range(len(geometry.lengths))]
        self._groups = [
            group for fixed in itertools.product((0, 1, None), repeat=len(geometry.lengths))
            for group in self._collinear(fixed)
        ]  # fmt: skip

    def solve(self, x: float, y: float, z: float, tool_angle: float | None = None) -> FloatArray | None:
        """Base and pitch joint angles (1 + m,) [rad] of the nearest reachable point.

        Args:
            x, y, z: the target about the base axis: forward, left, up [m].
            tool_angle: absolute plane angle of the last link to be kept [rad]; None: free.

        Returns:
            None when no configuration has that tool angle.
        """
        geometry = self.geometry
        low, high = self.base_limits
        rho, azimuth = math.hypot(x, y), math.atan2(y, x)
        forward = math.sqrt(max(0.0, rho * rho - geometry.lateral**2))
        starts = {low, high}
        for r in (forward, -forward):
            starts.add(self._face(azimuth, r))
        best, best_distance = None, math.inf
        for start in sorted(starts):
            found = self._settle(start, x, y, z, tool_angle)
            if found is not None and found[1] < best_distance - 1e-12:
                best, best_distance = found
        return best

    def _settle(
        self, yaw: float, x: float, y: float, z: float, tool_angle: float | None
    ) -> tuple[FloatArray, float] | None:
        """Alternate between the tool plane and the base, from one base angle: joint angles and distance [m]."""
        geometry = self.geometry
        best: tuple[FloatArray, float] | None = None
        for _ in range(_ROUNDS):
            local = complex(x, y) * cmath.exp(-1j * geometry.yaw_sign * yaw)
            found = self._planar(complex(local.real, z) - geometry.shoulder, tool_angle)
            if found is None:
                return None
            plane, tip = found
            tip += geometry.shoulder
            yaw = self._face(math.atan2(y, x), tip.real)
            local = complex(x, y) * cmath.exp(-1j * geometry.yaw_sign * yaw)
            distance = math.hypot(abs(local - complex(tip.real, geometry.lateral)), z - tip.imag)
            if best is not None and distance > best[1] - 1e-13:
                break
            best = self._joints(yaw, plane), distance
        return best

    def _face(self, azimuth: float, r: float) -> float:
        """The base angle inside its limits that brings a point at forward distance r nearest to an azimuth."""
        turn = self.geometry.yaw_sign * (azimuth - math.atan2(self.geometry.lateral, r))
        inside = images(turn, *self.base_limits)
        if inside:
            return min(inside, key=abs)
        return min(self.base_limits, key=lambda limit: abs(math.remainder(limit - turn, 2 * math.pi)))

    def _joints(self, yaw: float, plane: Plane) -> FloatArray:
        return np.array([yaw, *(self.geometry.joint_angle(k, t) for k, t in enumerate(plane))])

    def _planar(self, point: complex, tool_angle: float | None) -> tuple[Plane, complex] | None:
        """Plane angles inside their limits whose tip is nearest to a point, and that tip."""
        best, best_distance = None, math.inf
        candidates = self._free(point) if tool_angle is None else self._at_tool_angle(point, tool_angle)
        for plane in candidates:
            inside: list[float] = []
            for angle, limits in zip(plane, self.plane_limits, strict=True):
                image = images(angle, *limits)
                if not image:
                    break
                inside.append(image[0])
            else:
                tip = self._tip(inside)
                distance = abs(tip - point)
                if distance < best_distance:
                    best, best_distance = (tuple(inside), tip), distance
        return best

    def _tip(self, plane: list[float]) -> complex:
        return sum(
            length * cmath.exp(1j * angle)
            for length, angle in zip(self.geometry.lengths, itertools.accumulate(plane), strict=True)
        )  # fmt: skip

    def _collinear(self, fixed: tuple[int | None, ...]) -> Iterator[tuple[tuple[float | None, ...], list[complex]]]:
        """A choice of joints at limits: their plane angles (None: free) and the link groups it leaves.

        The first group stands still; each further one begins with a free joint and is given as seen from
        that joint's own link.
        """
        angles = tuple(
            None if side is None else self.plane_limits[k][side] for k, side in enumerate(fixed)
        )  # fmt: skip
        groups, heading = [0j], 0.0
        for length, angle in zip(self.geometry.lengths, angles, strict=True):
            if angle is None:
                groups.append(complex(length))
                heading = 0.0
            else:
                heading += angle
                groups[-1] += length * cmath.exp(1j * heading)
        yield angles, groups

    def _free(self, point: complex) -> Iterator[Plane]:
        """Candidates with the tool angle free."""
        for angles, groups in self._groups:
            toward = cmath.phase(point - groups[0])
            for senses in itertools.product((0.0, math.pi), repeat=len(groups) - 1):
                plane: list[float] = []
                heading, group = 0.0, 0
                for angle in angles:
                    if angle is None:
                        lead = toward + senses[group] - cmath.phase(groups[group + 1])
                        plane.append(lead - heading)
                        heading, group = lead, group + 1
                    else:
                        plane.append(angle)
                        heading += angle
                yield tuple(plane)

    def _at_tool_angle(self, point: complex, tool_angle: float) -> Iterator[Plane]:
        """Candidates with the last link's direction kept: two links, and a limit on the sum of their angles."""
        l2, l3, l4 = self.geometry.lengths
        wrist = point - l4 * cmath.exp(1j * tool_angle)
        limits2, limits3, limits4 = self.plane_limits
        sums = [tool_angle - v for v in limits4]
        pairs: list[tuple[float, float]] = []
        toward = cmath.phase(wrist)
        for flip in (0.0, math.pi):
            pairs += [(toward + flip, 0.0), (toward + flip, math.pi)]
            pairs += [(v, cmath.phase(wrist - l2 * cmath.exp(1j * v)) + flip - v) for v in limits2]
            for v in limits3:
                pairs.append((toward + flip - cmath.phase(l2 + l3 * cmath.exp(1j * v)), v))
            for total in sums:
                first = cmath.phase(wrist - l3 * cmath.exp(1j * total)) + flip
                pairs.append((first, total - first))
        pairs += list(itertools.product(limits2, limits3))
        pairs += [(v, total - v) for v in limits2 for total in sums]
        pairs += [(total - v, v) for v in limits3 for total in sums]
        for t2, t3 in pairs:
            yield t2, t3, tool_angle - t2 - t3
