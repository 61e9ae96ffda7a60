"""How a URDF robot is named: its file, and behind a ``#`` the tool link and which axis of it points ahead."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armctl.errors import RobotFileError

FloatArray = NDArray[np.float64]
_NAMED = re.compile(r"(?P<path>.+?\.urdf)(?:#(?P<wanted>.*))?", re.IGNORECASE | re.DOTALL)
_APPROACH = "approach="
AXES = {f"{sign}{axis}": (sign, k) for sign in ("", "-") for k, axis in enumerate("xyz")}
"""the axes of a link, as ``approach=`` names them: sign and column"""


@dataclass(frozen=True, slots=True)
class UrdfName:
    """``arm.urdf``, ``arm.urdf#link``, ``arm.urdf#link,approach=x`` or ``arm.urdf#approach=x``."""

    path: Path
    link: str | None = None
    """the tool link; None: the one that the file suggests"""
    approach: str = "z"
    """the axis of the tool link that armctl takes for the tool's z, a key of ``AXES``"""

    @classmethod
    def of(cls, name: str | Path) -> UrdfName | None:
        """Read a robot's name; None where it names no URDF file.

        Raises:
            RobotFileError: something behind the ``#`` that says neither a link nor an axis.
        """
        text = name.as_posix() if isinstance(name, Path) else name  # a link's own slashes are kept everywhere
        match = _NAMED.fullmatch(text)
        if match is None:
            return None
        path, wanted = Path(match["path"]), match["wanted"]
        if wanted is None:
            return cls(path)
        parts = [part.strip() for part in wanted.split(",")]
        axes = [part.removeprefix(_APPROACH) for part in parts if part.startswith(_APPROACH)]
        links = [part for part in parts if not part.startswith(_APPROACH)]
        if "" in parts or len(links) > 1 or len(axes) > 1 or not set(axes) <= set(AXES):
            raise RobotFileError(
                f"{text}: behind the # stands the name of the tool link, {_APPROACH}AXIS "
                f"({', '.join(AXES)}), or both with a comma between; got {wanted!r}"
            )
        return cls(path, links[0] if links else None, axes[0] if axes else "z")

    @property
    def direction(self) -> FloatArray:
        """(3,) the approach axis in the tool link's frame."""
        sign, column = AXES[self.approach]
        return np.eye(3)[column] * (-1.0 if sign else 1.0)


def is_urdf(name: str | Path) -> bool:
    """True for the name of a URDF robot: a path that ends in ``.urdf``, with or without a tool link."""
    return _NAMED.fullmatch(str(name)) is not None
