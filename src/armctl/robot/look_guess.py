"""A look for an arm that brings none, from its chain, its home pose and what is known of its servos.

A foot, a drum or a servo on each axis, a bar or a tube from joint to joint, and jaws, a suction cup, a pen or
a tip at the end. They are rows like those of a robot file: printed, they are what a maker goes on from.
As a body it is a guess: where parts lie beside their axes, a chain does not say.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.chain import Chain
from armctl.kinematics.frames import LinkFrames
from armctl.lazy_dataclass import dataclass
from armctl.robot.look.rows import MAKES, PAINTS, AnyRow, MakeName, Paint, paint
from armctl.robot.parts import Color, Hand, Look

SOURCE = "the chain alone: sizes are guessed from its lengths"
_THICK = 0.055
"""width of the arm, of the length of its links"""
_TAPER = 0.6
"""how much thinner it is at its tool than at its foot, of that width"""
_HIGH = 0.35
"""of the length of the links: a base so high above the floor hangs, on something that is not drawn"""
_SHORT_MM = 0.1
"""a link that is shorter is not drawn"""
_USUAL: tuple[Paint, Paint] = ("orange", "silver")
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class _Unknown:
    """What is known of an arm without a look."""

    chain: Chain
    names: Sequence[str]
    """of its links, from the base to the tool"""
    home: FloatArray
    """(n,) [rad]: so it stands where the rows describe it"""
    turning: Sequence[bool]
    """of the links: whether their joint turns"""
    driven: Sequence[bool]
    """of the links: whether a motor beside their joint turns them; a rod may turn others from afar"""
    floor_m: float
    look: Look
    hand: Hand
    opens: bool
    """whether a gripper opens its jaws"""


def guessed_look(
    chain: Chain, names: Sequence[str], turning: Sequence[bool], home: FloatArray, floor_m: float,
    look: Look, *, opens: bool,
) -> Look:  # fmt: skip
    """The look of an arm that says nothing of it but its shape and width: the same, with rows.

    ``turning``: of its joints, whether they may turn; ``home`` (n,) [rad]: where the rows describe it, above
    a floor [m]; ``opens``: a gripper opens its jaws.
    """
    coupling = chain.coupling
    arm = _Unknown(
        chain=chain,
        names=names,
        home=home,
        turning=turning if coupling is None else [True] * len(names),
        driven=turning if coupling is None else (np.count_nonzero(coupling, axis=1) == 1).tolist(),
        floor_m=floor_m,
        look=look,
        hand=look.hand or ("jaws" if opens else "tip"),
        opens=opens,
    )
    rows = msgspec.convert(list(_Guess(arm).rows()), tuple[AnyRow, ...])
    return Look(look.links, look.joints, look.shape, look.width, rows, tuple(arm.home.tolist()), SOURCE)


class _Guess:
    """Points and axes of an arm at home [mm], and how wide it is there."""

    def __init__(self, arm: _Unknown) -> None:
        self._arm, self._count = arm, len(arm.names)
        links = LinkFrames.at(arm.chain, arm.home[None])
        poses = [links.pose(i) for i in range(self._count)]
        self._points = [1000 * o[:, 0] for _, o in poses]
        self._axes = [R[:, 2, 0] for R, _ in poses]
        self._tool = 1000 * links.tool[:, 0]
        self._approach = arm.chain.forward(arm.home)[:3, :3]
        stops = [np.zeros(3), *self._points, self._tool]
        self._reach = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(stops))
        self._servo: MakeName | None = arm.look.servo
        scale = arm.look.width / Look().width
        self._size = _THICK * self._reach * scale
        if self._servo is not None:
            self._size = 1.1 * min(MAKES[self._servo].case[:2])

    def _wide(self, link: int) -> float:
        """Of a link [mm]."""
        if self._servo is not None:
            return self._size
        return self._size * (1.5 - _TAPER * max(link, 0) / self._count)

    def _row(self, solid: str, color: Paint | None, link: int = -1, **fields: Any) -> dict[str, Any]:
        said = {key: _rounded(value) for key, value in fields.items()}
        joint = {} if link < 0 else {"joint": self._arm.names[link]}
        return {**joint, "solid": solid, **said, **({} if color is None else {"color": color})}

    def rows(self) -> Iterator[dict[str, Any]]:
        """All of them, from the base to the tool."""
        yield from self._foot()
        yield from self._joints()
        end = yield from self._links()
        yield from self._hand(end)

    def _foot(self) -> Iterator[dict[str, Any]]:
        """A plate on the floor, and a column as high as nothing of the arm comes near at home."""
        size, floor = self._size, 1000 * self._arm.floor_m
        if floor < -_HIGH * self._reach:  # what it hangs on, nobody knows
            size_mm = [1.5 * size] * 3
            yield self._row("box", "graphite", size_mm=np.array(size_mm), body=False)
            return
        yield self._row(
            "tube", "graphite", from_mm=floor * _UP, to_mm=(floor + 0.25 * size) * _UP, width_mm=4.2 * size
        )
        top = max(0.0, floor + 1.3 * size)
        if self._count > 1 and abs(self._axes[1][2]) < 0.5:  # it may lie down on the foot
            top = min(top, self._points[1][2] - 0.5 * self._wide(1) - 0.1 * size)
        if top > floor + 0.3 * size:
            yield self._row(
                "tube",
                "graphite",
                from_mm=floor * _UP,
                to_mm=top * _UP,
                width_mm=np.array([3.2 * size, 2.8 * size]),
            )

    def _joints(self) -> Iterator[dict[str, Any]]:
        """A drum, or a servo in the link before, on each axis that turns."""
        for i, z in enumerate(self._axes):
            if not self._arm.turning[i]:
                continue
            if self._servo is not None and self._arm.driven[i]:
                yield self._motor(self._servo, i, z)
                continue
            wide, here = self._wide(i), self._points[i]
            ends = [self._above_floor(here + side * 0.9 * wide * z) - here for side in (-1, 1)]
            yield self._row("tube", "black", i, from_mm=ends[0], to_mm=ends[1], width_mm=1.3 * wide)

    def _above_floor(self, point: FloatArray) -> FloatArray:
        """A point (3,) of the base frame, lifted to the floor where it is below [mm]."""
        return np.array([*point[:2], max(point[2], 1000 * self._arm.floor_m)])

    def _motor(self, name: MakeName, i: int, z: FloatArray) -> dict[str, Any]:
        """A servo whose case is in the link before, and lies back along it."""
        make = MAKES[name]
        here, before = self._points[i], self._points[i - 1] if i else np.zeros(3)
        back = before - here
        back -= (back @ z) * z
        if np.linalg.norm(back) < 1.0:  # it lies on the axis before: across, away from the tool
            back = self._points[i] - self._tool
            back -= (back @ z) * z
        if np.linalg.norm(back) < 1.0:
            back = np.cross(z, np.eye(3)[np.abs(z).argmin()])
        case = np.asarray(back / np.linalg.norm(back), dtype=np.float64)
        at = here + (0.5 * make.case[2] + make.horn[1]) * z
        if z[2] > 0.9:  # it stands on the floor, or on it where it would be below
            at[2] = max(at[2], 1000 * self._arm.floor_m + make.case[2] + make.horn[1] * (1 + make.idler))
        return self._row(
            "motor", None, i - 1, make=name, shaft=_exact(z), case=_exact(case), at_mm=at - before
        )

    def _links(self) -> Generator[dict[str, Any], None, FloatArray]:
        """Straight from joint to joint; the last one ends where the hand begins: returned (3,) [mm]."""
        stops = [np.zeros(3), *self._points, self._tool]
        hand, end = 2.2 * self._size, self._points[-1]
        last = max(
            (i for i in range(len(stops) - 1) if np.linalg.norm(stops[i + 1] - stops[i]) > _SHORT_MM),
            default=-1,
        )
        for k, (start, end) in enumerate(pairwise(stops)):
            link, length = k - 1, float(np.linalg.norm(end - start))
            if length < _SHORT_MM:
                continue
            if k == last:
                end = end - (end - start) / length * min(hand, 0.7 * length)
            at, wide = self._points[link] if link >= 0 else np.zeros(3), self._wide(link)
            lift = min(max(1000 * self._arm.floor_m + 0.5 * wide - start[2], 0.0), 0.9 * length)
            start = start + (end - start) / length * lift  # a round end reaches on by half its width
            yield self._row(
                "tube",
                self._color(link),
                link,
                from_mm=start - at,
                to_mm=end - at,
                width_mm=np.array([wide, 0.9 * wide]),
                ends="round",
            )
        return end

    def _hand(self, end: FloatArray) -> Iterator[dict[str, Any]]:
        """What ends at the tool point, along its approach axis."""
        link, size, R = self._count - 1, self._size, self._approach
        at, ahead, across = self._points[link], R[:, 2], R[:, 1]
        end, tip = end - at, self._tool - at

        def tube(start: FloatArray, stop: FloatArray, *widths: float, **more: Any) -> dict[str, Any]:
            return self._row(
                "tube", "black", link, from_mm=start, to_mm=stop, width_mm=size * np.array(widths), **more
            )

        if self._arm.hand == "tip":
            yield tube(end, tip, 0.8, 0.1)
            return
        palm = tip - 2.0 * size * ahead
        if np.linalg.norm(palm - end) > 1:
            yield tube(end, palm, 0.7, 0.7, ends="round")
        if self._arm.hand == "pen":
            yield tube(palm, tip - 0.6 * size * ahead, 0.45, 0.45, name="the pen")
            yield tube(tip - 0.6 * size * ahead, tip, 0.45, 0.05, name="the pen")
        elif self._arm.hand == "cup":
            yield tube(palm, tip - 0.7 * size * ahead, 0.4, 0.4)
            yield tube(tip - 0.7 * size * ahead, tip, 0.4, 1.1, name="the suction cup")
        else:
            yield from self._jaws(palm, tip, ahead, across)

    def _jaws(
        self, palm: FloatArray, tip: FloatArray, ahead: FloatArray, across: FloatArray
    ) -> Iterator[dict[str, Any]]:
        link, size = self._count - 1, self._size
        width = {"width_mm": 0.8 * size, "thick_mm": 0.5 * size, "face": ahead}
        ends = {"from_mm": palm - 0.8 * size * across, "to_mm": palm + 0.8 * size * across}
        yield self._row("bar", "black", link, **ends, **width)
        width = {"width_mm": np.array([0.6 * size, 0.3 * size]), "thick_mm": 0.22 * size, "face": across}
        if across[1] < 0:
            across = -across  # to the left
        for side, name in ((1, "the left jaw"), (-1, "the right jaw")):
            aside = side * 0.14 * size * across
            ends = {"from_mm": palm + aside, "to_mm": tip + aside - 0.15 * size * ahead}
            opens = {"open_mm": side * 0.6 * size * across} if self._arm.opens else {}
            yield self._row("bar", "graphite", link, name=name, **ends, **width, **opens)

    def _color(self, link: int) -> Paint:
        look = self._arm.look
        if look.links == Look().links:
            return _USUAL[link % 2]
        return nearest_paint(look.links[max(link, 0) % len(look.links)])


def _rounded(value: Any) -> Any:
    """Of mm: to a tenth; anything else as it is."""
    if not isinstance(value, np.ndarray | float):
        return value
    return (np.round(np.asarray(value, dtype=np.float64), 1) + 0.0).tolist()


def _exact(direction: FloatArray) -> list[float]:
    """A direction as a row writes it: so many digits that two that are across each other stay so."""
    return [round(x, 9) + 0.0 for x in direction.tolist()]


def nearest_paint(color: Color) -> Paint:
    """The colour of the palette that is nearest to another one."""
    return min(PAINTS, key=lambda name: float(np.sum((np.array(paint(name)) - color) ** 2.0)))
