"""What rows of a look name: colours, and motors that one can buy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

Theme = Literal["light", "dark"]
Paint = Literal[
    "black",
    "graphite",
    "grey",
    "silver",
    "white",
    "cream",
    "yellow",
    "orange",
    "red",
    "green",
    "blue",
    "sky",
    "brass",
    "wood",
]
PAINTS: tuple[Paint, ...] = get_args(Paint)

_ON_LIGHT_AND_DARK: dict[Paint, tuple[str, str]] = {
    "black": ("33383e", "4d545c"),
    "graphite": ("4f565e", "6f7780"),
    "grey": ("868e96", "98a1aa"),
    "silver": ("b9c0c7", "c6ccd2"),
    "white": ("e6e9ec", "e6e9ec"),
    "cream": ("e9dcc3", "dccfb4"),
    "yellow": ("f5c518", "f0c020"),
    "orange": ("e8641b", "ea6f2a"),
    "red": ("d02f2f", "d94545"),
    "green": ("2f9e44", "3fae55"),
    "blue": ("1c7ed6", "3a8fe0"),
    "sky": ("8fc1ea", "8ab8de"),
    "brass": ("b8902f", "c29a3a"),
    "wood": ("c79a63", "bd915c"),
}


def paint(name: Paint, theme: Theme = "light") -> tuple[int, int, int]:
    """Red, green and blue (0..255): black is lifted on a dark ground, white lowered on a light one."""
    red, green, blue = bytes.fromhex(_ON_LIGHT_AND_DARK[name][theme == "dark"])
    return red, green, blue


@dataclass(frozen=True, slots=True)
class Make:
    """A servo or stepper motor, in the frame of its shaft [mm].

    Its case lies below the horn, along ``case`` from the shaft.
    """

    title: str
    """what a user calls it"""
    case: tuple[float, float, float]
    """along, across, and up to where the shaft leaves it"""
    shaft: float
    """from the near end of the case"""
    horn: tuple[float, float]
    """width and height"""
    color: Paint
    horn_color: Paint
    mass_kg: float
    """with its horn"""
    ears: tuple[float, float, float] | None = None
    """over all, thickness, height above the bottom of the case"""
    idler: bool = False
    """a second horn at the other side"""


# Masses: data sheets of MG90S, MG996R, HS-805BB, STS3215, XL430-W250, AX-12A, 17HS4401 and 23HS22.
MakeName = Literal["micro", "standard", "giant", "sts3215", "dynamixel", "ax12", "nema17", "nema23"]
MAKES: dict[MakeName, Make] = {
    "micro": Make("9 g servo", (22.8, 12.2, 22.5), 6, (11.5, 6), "blue", "white", 0.0134, (32.3, 2.5, 17)),
    "standard": Make("standard servo", (40.5, 20, 38), 10, (21, 5), "black", "white", 0.055, (54.5, 2.6, 28)),
    "giant": Make("giant servo", (66, 30, 58), 17.5, (30, 7), "black", "white", 0.152, (83, 4, 42)),
    "sts3215": Make("STS3215", (45.2, 24.7, 33.4), 10.2, (20, 3.1), "black", "silver", 0.055, idler=True),
    "dynamixel": Make(
        "Dynamixel X", (46.5, 28.5, 34), 11.25, (19, 3), "graphite", "black", 0.057, idler=True
    ),
    "ax12": Make("AX-12", (50, 32, 38), 11.5, (22, 3), "black", "white", 0.0546, idler=True),
    "nema17": Make("NEMA 17", (42.3, 42.3, 40), 21.15, (22, 2), "black", "silver", 0.28),
    "nema23": Make("NEMA 23", (56.4, 56.4, 56), 28.2, (38, 2), "black", "silver", 0.7),
}

Material = Literal["printed", "acrylic", "wood", "aluminium", "casting"]
DENSITIES: dict[Material, float] = {
    "printed": 0.38,
    "acrylic": 1.19,
    "wood": 0.6,
    "aluminium": 2.7,
    "casting": 1.3,
}
"""[kg/dm³] of what a solid looks like from outside: printed parts are walls round a few struts, castings of
industrial arms hold their motors and gears. Both were found from published masses of seven arms."""
