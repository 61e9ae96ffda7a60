"""Position, tool pitch and roll with three pitch joints: every branch of one pose, in plain floats.

The closed form of ``base_yaw.py`` and ``plane_postures.py`` in one piece, for what is solved most often:
joints that turn less than a whole turn, and a target off the base axis. What is special (any base angle
serves, the links are straight or fold onto the first pitch axis) is left to the general solver.

The arm's constants are written into the source of one function, kept in ``PoseBranches.source``: both ways
to face the target, both readings of its pitch, both elbows, one after the other. For an arm with its tool
along the last link the first of the four triangles begins

    def at(x, y, z, pitch, rolls):
        square = x * x + y * y
        if not square >= 1e-09:
            return None
        r, azimuth, height = sqrt(square), atan2(y, x), z - 0.349
        last = pitch
        along, across = 0.145 * cos(last), 0.145 * sin(last)
        ...
        yaw = azimuth
        if -2.7 <= yaw <= 2.7 or not (...) and (yaw := into_window(yaw, w0)) is not None:
            x2, y2 = r - 0.016 - along, height - across
            ...
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, Window, images, into_window, window
from armctl.kinematics.two_link import ON_JOINT, two_link
from armctl.kinematics.yaw_pitch_roll.geometry import LEVEL, YawPitchRoll

FloatArray = NDArray[np.float64]
Postures = tuple[list[int], list[tuple[float, ...]]]
"""indices into ``BRANCHES``, and the joint angles [rad] of each"""
UPRIGHT = 5e-13
"""how near to ±90° the two readings of a pitch are one [rad]"""
_EDGE = 1e-9
"""how near to the base axis the general solver takes over [m²]"""
_ROUNDING = 1e-9
"""how near to ±1 the elbow's cosine must come for rounding to decide"""
SURE = 1.0 - _ROUNDING
"""up to here it does not"""
REACHED = 1.0 + _ROUNDING
"""from here on the links do not reach, whatever the rounding"""
SAME_LENGTH = 1e-15
"""links whose lengths differ by no more are equal but for rounding, and make an isosceles triangle [m]"""


class PoseBranches:
    """One arm inside its limits. Immutable; safe in several threads."""

    at: Callable[[float, float, float, float, Sequence[float]], Postures | None]
    """at(x, y, z, pitch, rolls): every configuration inside the limits, in the order of the general solver.

    A tool point in the base frame [m], the pitch of the approach axis above the horizontal [rad], both
    readings of it within ±90°, and what the roll joint may be at [rad] (ignored by an arm without one). None
    at a special place.
    """
    source: str

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self._geometry = geometry
        self._windows = [window(low, high) for low, high in limits[:4].tolist()]
        self.source = "\n".join(["def at(x, y, z, pitch, rolls):", *_indented(self._body())])
        names: dict[str, Any] = {f"w{i}": w for i, w in enumerate(self._windows)}
        names |= {name: getattr(math, name) for name in ("acos", "atan2", "cos", "sin", "sqrt")}
        names["into_window"] = into_window
        exec(
            compile(self.source, "<pose branches>", "exec"), names
        )  # from this module's own strings and floats
        self.at = names["at"]

    @staticmethod
    def serves(geometry: YawPitchRoll, limits: FloatArray) -> bool:
        """True with three pitch joints, a pitch to ask for, and joints that turn less than a turn."""
        narrow = limits[:4, 1] - limits[:4, 0] < TWO_PI - 2 * LIMIT_TOLERANCE
        return len(geometry.lengths) == 3 and geometry.tool_angle is not None and bool(narrow.all())

    def _body(self) -> list[str]:
        geometry, d = self._geometry, self._geometry.lateral
        tool, l4 = geometry.tool_angle or 0.0, geometry.lengths[2]
        front, back = ("azimuth - aside", "azimuth + aside") if d else ("azimuth", "azimuth")
        return [
            *_local(geometry),
            "square = x * x + y * y" + _plus(-d * d),
            f"if not square >= {_EDGE!r}:",
            "    return None",
            f"r, azimuth, height = sqrt(square), atan2(y, x), z{_plus(-geometry.shoulder.imag)}",
            *([f"aside = atan2({d!r}, r)"] if d else []),
            f"last = pitch{_plus(-tool)}",
            f"along, across = {l4!r} * cos(last), {l4!r} * sin(last)",
            *self._second_reading(tool, l4),
            "outward = cos(pitch)",
            f"inward, opposite = outward < {-LEVEL!r}, outward > {LEVEL!r}",
            "index, found = [], []",
            f"yaw = {_signed(geometry.yaw_sign, front)}",
            *self._facing(0, "r", "inward", "opposite"),
            f"yaw = {_signed(geometry.yaw_sign, f'{back} - {math.pi!r}')}",
            *self._facing(4, "-r", "opposite", "inward"),
            "return index, found",
        ]

    def _second_reading(self, tool: float, l4: float) -> list[str]:
        lines = [
            f"two = {-(math.pi / 2 - UPRIGHT)!r} <= pitch <= {math.pi / 2 - UPRIGHT!r}",
            f"last_2 = {math.pi - tool!r} - pitch",
        ]
        if tool == 0.0:
            return [*lines, "along_2, across_2 = -along, across"]
        return [*lines, f"along_2, across_2 = {l4!r} * cos(last_2), {l4!r} * sin(last_2)"]

    def _facing(self, base: int, r: str, first: str, second: str) -> list[str]:
        """Both readings of the pitch for one way to face, ``yaw`` as it comes."""
        forward = f"{r}{_plus(-self._geometry.shoulder.real)}"
        return [
            *self._inside("yaw", 0),
            *_indented(self._triangle(base, f"{forward} - along", "across", "last", first)),
            "    if two:",
            *_indented(self._triangle(base, f"{forward} - along_2", "across_2", "last_2", second), 2),
        ]

    def _triangle(self, base: int, x: str, across: str, last: str, inward: str) -> list[str]:
        """Both elbows of one reading, the base at ``yaw``."""
        l2, l3, _ = self._geometry.lengths
        inner = f"atan2({l3!r} * sqrt(1.0 - cosine * cosine), {l2!r} + {l3!r} * cosine)"
        if abs(l2 - l3) < SAME_LENGTH:
            inner = "0.5 * bend"
        return [
            f"x2, y2 = {x}, height - {across}",
            f"cosine = (x2 * x2 + y2 * y2 - {l2 * l2 + l3 * l3!r}) * {0.5 / (l2 * l3)!r}",
            f"if {-SURE!r} < cosine < {SURE!r}:",
            "    bend, direction = acos(cosine), atan2(y2, x2)",
            f"    inner = {inner}",
            # a positive bend leaves the elbow down in front, up at the back
            *_indented(self._elbow("bend", "direction - inner", last, base + (0 if base else 2), inward)),
            *_indented(self._elbow("-bend", "direction + inner", last, base + (2 if base else 0), inward)),
            f"elif {-REACHED!r} < cosine < {REACHED!r}:",
            "    return None",
        ]

    def _elbow(self, bend: str, first: str, last: str, branch: int, inward: str) -> list[str]:
        joints = zip(self._geometry.signs, self._geometry.offsets, strict=True)
        (s2, o2), (s3, o3), (s4, o4) = joints
        rolled = self._geometry.roll_joint is not None
        posture = f"(yaw, shoulder, elbow, wrist{', roll' if rolled else ''})"
        keep = [f"index.append({f'{branch} + ' if branch else ''}{inward})", f"found.append({posture})"]
        turned = f"- {bend}" if bend[0] != "-" else f"+ {bend[1:]}"
        return [
            f"elbow = {_signed(s3, bend + _plus(-o3))}",
            *self._inside("elbow", 2),
            f"    first = {first}",
            f"    shoulder = {_signed(s2, 'first' + _plus(-o2))}",
            *_indented(self._inside("shoulder", 1)),
            f"        wrist = {_signed(s4, f'{last} - first {turned}' + _plus(-o4))}",
            *_indented(self._inside("wrist", 3), 2),
            *_indented(["for roll in rolls:", *_indented(keep)] if rolled else keep, 3),
        ]

    def _inside(self, name: str, joint: int) -> list[str]:
        """What follows is for an angle inside its limits: where it is not as it comes, by a whole turn."""
        low, high, _ = limits = self._windows[joint]
        image = f"({name} := into_window({name}, w{joint})) is not None"
        return [f"if {low!r} <= {name} <= {high!r} or not ({_outside(name, limits)}) and {image}:"]


def _outside(name: str, limits: Window) -> str:
    """True only for angles near the limits of which no image is inside: quicker than ``into_window``."""
    low, high, _ = limits
    above, below = high + 2 * LIMIT_TOLERANCE, low - 2 * LIMIT_TOLERANCE
    return f"{above!r} < {name} < {below + TWO_PI!r} or {above - TWO_PI!r} < {name} < {below!r}"


def _local(geometry: YawPitchRoll) -> list[str]:
    """The tool point in coordinates forward, left, up about the base axis, where they are not its own."""
    (x0, y0, z0), frame = geometry.origin.tolist(), geometry.frame.T.tolist()
    lines = [f"x, y, z = x{_plus(-x0)}, y{_plus(-y0)}, z{_plus(-z0)}"] if x0 or y0 or z0 else []
    if frame != np.eye(3).tolist():
        rows = [" + ".join(f"{c!r} * {n}" for c, n in zip(row, "xyz", strict=True) if c) for row in frame]
        lines.append(f"x, y, z = {', '.join(rows)}")
    return lines


def _plus(constant: float) -> str:
    return f" {'-' if constant < 0 else '+'} {abs(constant)!r}" if constant else ""


def _signed(sign: int, text: str) -> str:
    return text if sign > 0 else f"-({text})"


def _indented(lines: Sequence[str], levels: int = 1) -> list[str]:
    return ["    " * levels + line for line in lines]


# Postures of the pitch joints that bring the tip to a point of the tool plane.

_PITCH_TOLERANCE = 1e-6
"""how far from the pitch asked for two pitch joints may leave the tool [rad]"""


class PlanePostures:
    """The closed form in the tool plane of one arm. Immutable; safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self._geometry = geometry
        self._limits = [(float(low), float(high)) for low, high in limits[1 : 1 + len(geometry.lengths)]]

    def at(self, x: float, y: float, tool_angle: float | None) -> list[tuple[float, ...]]:
        """Plane angles [rad], limits not looked at.

        Args:
            x: the tip, forward of the first pitch axis [m].
            y: the tip, above it [m].
            tool_angle: plane angle of the approach axis [rad]; None: any (with two pitch joints).

        Folded onto its own first axis the arm may point anywhere: then the directions are given at which
        a joint is at zero or at a limit, so that one is inside the limits if any is.
        """
        lengths = self._geometry.lengths
        if tool_angle is None:
            return self._unfolded(x, y, None) if len(lengths) == 2 else []
        last = tool_angle - (self._geometry.tool_angle or 0.0)  # absolute direction of the last link
        if len(lengths) == 2:
            return [
                pair
                for pair in self._unfolded(x, y, last)
                if abs(math.remainder(sum(pair) - last, TWO_PI)) < _PITCH_TOLERANCE
            ]
        return self.reaching(x - lengths[2] * math.cos(last), y - lengths[2] * math.sin(last), last)

    def reaching(self, x: float, y: float, last: float | None) -> list[tuple[float, ...]]:
        """``at`` for the end of the second link, with the direction of the third [rad] if there is one."""
        pairs = self._unfolded(x, y, last)
        return pairs if last is None else [(*pair, last - sum(pair)) for pair in pairs]

    def _unfolded(self, x: float, y: float, last: float | None) -> list[tuple[float, ...]]:
        """The two-link triangle of the first links; ``last`` is the direction of the arm's last link."""
        pairs = two_link(x, y, self._geometry.lengths[0], self._geometry.lengths[1])
        if not pairs or math.hypot(x, y) > ON_JOINT:
            return list(pairs)
        bend = pairs[0][1]
        firsts = [self._geometry.plane_angle(0, way) for way in (0.0, *self._limits[0])]
        if last is not None and len(self._geometry.lengths) == 2:
            firsts.append(last - bend)
        elif last is not None:
            firsts += [last - bend - self._geometry.plane_angle(2, way) for way in (0.0, *self._limits[2])]
        return [(first, bend) for first in firsts]

    def joint_images(self, plane: tuple[float, ...]) -> list[tuple[float, ...]]:
        """Every set of joint angles inside the limits that has these plane angles [rad]."""
        choices = [
            images(self._geometry.joint_angle(k, angle), *self._limits[k]) for k, angle in enumerate(plane)
        ]
        return list(itertools.product(*choices))

    def inside(self, r: float, z: float, last: float | None) -> tuple[float, ...] | None:
        """Joint angles inside the limits for a point of the tool plane, or None.

        Args:
            r: the tip, forward of the base axis [m].
            z: the tip, above the base origin [m].
            last: direction of the last link to be kept [rad]; None: any.
        """
        shoulder = self._geometry.shoulder
        tool_angle = None if last is None else last + (self._geometry.tool_angle or 0.0)
        for plane in self.at(r - shoulder.real, z - shoulder.imag, tool_angle):
            for angles in self.joint_images(plane):
                return angles
        return None
