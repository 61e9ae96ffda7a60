"""Random arms as URDF files, with rods, counterweights, jaws, fingers, wheels, covers and cameras on them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random
from typing import Literal

BUILDS = ("zyy", "zyyy", "zyyr", "zyyyr", "zyyry", "zyyryr", "zyyyzy", "zyryryr", "zyryyyr")
"""the axes of arms of 3 to 7 joints: about the vertical, pitch, and along the link (r)"""
NamesOf = Literal["ros", "numbers", "cad"]
_ROS = {"z": "pan", "y": "pitch", "r": "roll"}
_AXES = {"z": "0 0 1", "y": "0 1 0", "r": "0 0 1"}


@dataclass
class RandomArm:
    """One file, and what is right for it."""

    seed: int
    xml: str = ""
    joints: list[str] = field(default_factory=list[str])
    links: list[str] = field(default_factory=list[str])
    """of the arm, the base first; the last one is the tool"""
    parts: list[str] = field(default_factory=list[str])
    """what is on it, in words"""
    clear: bool = True
    """whether the tree and the names leave nothing open"""


def random_arm(seed: int) -> RandomArm:
    """The arm of a seed: a random build with up to five random parts at random places."""
    return _Maker(seed).made()


class _Maker:
    def __init__(self, seed: int) -> None:
        self._rng = Random(seed)
        self._arm = RandomArm(seed)
        self._names: NamesOf = self._rng.choice(("ros", "numbers", "cad", "cad"))
        self._solid = self._rng.choice(("box", "mesh", "mesh without masses"))
        self._effort = self._rng.choice((0.0, 10.0))
        self._taken: set[str] = set()
        self._xml: list[str] = []

    def made(self) -> RandomArm:
        rng, arm = self._rng, self._arm
        build = rng.choice(BUILDS)
        reach = rng.choice((1.6, 2.2, 2.9, math.pi))
        servo = rng.random() < 0.2  # all joints from 0 to 180°
        last = self._link("base", 0.3)
        for k, axis in enumerate(build):
            name = self._name(f"{_ROS[axis]}_{k}" if self._names == "ros" else f"joint_{k + 1}", "Revolute")
            link = self._link(f"link_{k + 1}", 0.4 - 0.05 * k)
            limits = (0.0, math.pi) if servo else (-reach, reach)
            self._joint(name, "revolute", last, link, (0, 0, 0.1), _AXES[axis], limits, effort=self._effort)
            arm.joints.append(name)
            arm.links.append(last)
            last = link
        arm.links.append(last)
        parts: list[Callable[[], None]] = [self._rod, self._rod, self._wheels, self._cover, self._camera]
        parts += [self._counterweight, self._free_rod]
        for part in rng.sample(parts, rng.randint(0, 4)):
            part()
        rng.choice((lambda: None, self._jaw, self._fingers, self._slider))()
        order = self._xml
        rng.shuffle(order)  # no file has to begin at the base
        arm.xml = f'<robot name="random">{"".join(order)}</robot>'
        return arm

    # What is on it.

    def _rod(self) -> None:
        """One or two links that follow a joint of the arm."""
        place, leader = self._place(), self._rng.choice(self._arm.joints)
        for _ in range(self._rng.randint(1, 2)):
            name, link = self._name("parallel_bar", "Revolute"), self._link("bar_link", 0.02)
            factor = self._rng.choice((1.0, 1.0, -1.0))
            mimic = f'<mimic joint="{leader}" multiplier="{factor}"/>'
            self._joint(name, "revolute", place, link, (-0.03, 0, 0.06), "0 1 0", (-1.8, 1.8), mimic=mimic)
            self._arm.parts.append(f"{name} on {place} follows {leader}")
            place = link

    def _free_rod(self) -> None:
        self._turning("rod", (-1.8, 1.8))

    def _counterweight(self) -> None:
        if self._rng.random() < 0.5:
            self._fixed("counterweight", self._place())
        else:
            self._turning("counterweight", (-0.8, 0.8))

    def _turning(self, what: str, limits: tuple[float, float]) -> None:
        """A link that turns by itself, beside the arm."""
        told = self._effort and self._solid != "mesh without masses"  # else nothing tells the last two apart
        place = self._rng.choice(self._arm.links[: -1 if told else -2])
        name, link = self._name(f"{what}_joint", "Revolute"), self._link(f"{what}_link", 0.01)
        self._joint(name, "revolute", place, link, (-0.03, 0, 0.02), "0 1 0", limits)
        self._arm.parts.append(f"{name} on {place}")
        self._arm.clear &= self._names == "ros" or place not in self._arm.links[-3:]

    def _wheels(self) -> None:
        place = self._rng.choice([*self._arm.links[:1] * 4, *self._arm.links])
        for k in range(self._rng.randint(2, 4)):
            name, link = self._name(f"wheel_{k}_joint", "Revolute"), self._link(f"wheel_{k}", 0.1)
            self._joint(name, "continuous", place, link, (0.05 * k, 0.05, 0), "0 1 0", None)
            self._arm.parts.append(f"{name} on {place}")
        self._arm.clear &= self._names == "ros" or place not in self._arm.links[-3:]

    def _cover(self) -> None:
        self._fixed("cover", self._place())

    def _camera(self) -> None:
        self._fixed("camera_link", self._place())

    def _jaw(self) -> None:
        limits = self._rng.choice(((0.0, 1.2), (-1.5, 0.0), (-0.2, 1.7), (-0.6, 0.6), None))
        name, link = self._name("gripper_jaw", "Revolute"), self._link("moving_jaw", 0.02)
        axis = "1 0 0" if self._rng.random() < 0.8 else "0 1 0"
        self._joint(
            name, "revolute" if limits else "continuous", self._hand, link, (0, 0.02, 0.03), axis, limits
        )
        self._arm.parts.append(f"jaw {name}, {limits}")
        self._arm.clear &= self._names == "ros"

    def _fingers(self) -> None:
        kind = self._rng.choice(("prismatic", "revolute"))
        follows, first = self._rng.random() < 0.7, ""
        limits = (0.0, 0.03) if kind == "prismatic" else (0.0, 0.9)
        for side in (1, -1):
            name, link = self._name("finger_joint", "Slider"), self._link("finger", 0.02)
            mimic = f'<mimic joint="{first}"/>' if first and follows else ""
            axis = f"0 {side} 0" if kind == "prismatic" else f"{side} 0 0"
            self._joint(name, kind, self._hand, link, (0, 0.02 * side, 0.03), axis, limits, mimic=mimic)
            self._arm.parts.append(f"finger {name}, {kind}{' follows' if mimic else ''}")
            first = name
        self._arm.clear &= self._names == "ros" or kind == "prismatic"

    def _slider(self) -> None:
        name, link = self._name("gripper_slide", "Slider"), self._link("slide", 0.02)
        self._joint(name, "prismatic", self._hand, link, (0, 0.02, 0.03), "0 1 0", (0.0, 0.03))
        self._arm.parts.append(f"slider {name}")
        self._arm.clear &= self._names == "ros"

    # How it is written.

    @property
    def _hand(self) -> str:
        return self._arm.links[-1]

    def _place(self) -> str:
        return self._rng.choice(self._arm.links)

    def _fixed(self, what: str, place: str) -> None:
        name, link = self._name(f"{what}_fixed", "Rigid"), self._link(what, 0.01)
        self._joint(name, "fixed", place, link, (0.02, 0, 0.05), "0 0 1", None)
        self._arm.parts.append(f"{link} fixed on {place}")

    def _name(self, plain: str, kind: str) -> str:
        return self._new(plain if self._names == "ros" else "", f"{kind} ")

    def _new(self, plain: str, cad: str) -> str:
        """A name that nothing has yet; CAD numbers them in any order."""
        while True:
            name = plain or f"{cad}{self._rng.randint(1, 99)}"
            if name not in self._taken:
                self._taken.add(name)
                return name
            plain = plain and f"{plain}_{self._rng.randint(1, 99)}"

    def _link(self, plain: str, mass: float) -> str:
        name = self._new(plain if self._names == "ros" else "", "Component_v1_")
        solid = '<box size="0.03 0.03 0.08"/>' if self._solid == "box" else f'<mesh filename="{name}.stl"/>'
        middle = "0 0 0.04" if self._solid == "box" else "0 0 0"
        inertia = f'<inertial><origin xyz="0 0 0.04"/><mass value="{mass}"/></inertial>'
        self._xml.append(
            f'<link name="{name}"><visual><origin xyz="{middle}"/><geometry>{solid}</geometry></visual>'
            f"{'' if self._solid == 'mesh without masses' else inertia}</link>"
        )
        return name

    def _joint(
        self,
        name: str,
        kind: str,
        parent: str,
        child: str,
        xyz: tuple[float, float, float],
        axis: str,
        limits: tuple[float, float] | None,
        *,
        mimic: str = "",
        effort: float = 0.0,
    ) -> None:
        limit = (
            "" if limits is None else f'<limit lower="{limits[0]}" upper="{limits[1]}" effort="{effort}"/>'
        )
        self._xml.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz[0]} {xyz[1]} {xyz[2]}"/><axis xyz="{axis}"/>{limit}{mimic}</joint>'
        )
