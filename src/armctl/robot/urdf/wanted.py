"""What stands behind the ``#`` of an arm's name: the tool, and the arguments of a xacro file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias
from urllib.parse import unquote

from armctl.errors import RobotFileError

AXES = {f"{sign}{axis}": (sign, k) for sign in ("", "-") for k, axis in enumerate("xyz")}
"""the axes of a link, as ``approach=`` names them: sign and column"""
_APPROACH, EXACT = "approach=", "exact="
GIVES = ":="
"""between the name and the value of an argument, as ROS has it"""
ArgumentValue: TypeAlias = str | bool | int | float


@dataclass(frozen=True, slots=True)
class Wanted:
    """What stands behind the ``#`` of an arm's name."""

    link: str | None
    """the tool link"""
    approach: str | None
    """the axis of it that is taken for z"""
    exact: bool
    """whether nearly right angles are taken as right"""
    arguments: Mapping[str, str]
    """of a xacro file, by name"""

    @classmethod
    def of(cls, text: str | None) -> Wanted:
        """Read ``link``, ``approach=x``, ``exact=yes`` and ``name:=value``, any of them, commas between."""
        if text is None:
            return cls(None, None, False, {})
        parts = [part.strip() for part in text.split(",")]
        given = [part.partition(GIVES) for part in parts if GIVES in part]
        axes = [part.removeprefix(_APPROACH) for part in parts if part.startswith(_APPROACH)]
        links = [part for part in parts if GIVES not in part and not part.startswith((_APPROACH, EXACT))]
        arguments = {name.strip(): unquote(value) for name, _, value in given}
        unclear = len(links) > 1 or len(axes) > 1 or len(arguments) < len(given)
        exact = f"{EXACT}yes" in parts
        unclear = unclear or any(part.startswith(EXACT) and part != f"{EXACT}yes" for part in parts)
        if unclear or "" in (*parts, *arguments) or not set(axes) <= set(AXES):
            raise RobotFileError(
                f"behind the # stands the name of the tool link, {_APPROACH}AXIS ({', '.join(AXES)}), "
                f"{EXACT}yes, and NAME{GIVES}VALUE for each argument of a xacro file, with commas between; "
                f"got {text!r}"
            )
        return cls(links[0] if links else None, axes[0] if axes else None, exact, arguments)


def argument_texts(values: Mapping[str, object]) -> dict[str, str]:
    """The values of arguments as xacro takes them: texts, ``true`` and ``false``."""
    for name, value in values.items():
        if not isinstance(value, str | int | float):
            raise RobotFileError(f"the argument {name!r} is {value!r}; it must be a text, a number or a bool")
    return {
        name: str(value).lower() if isinstance(value, bool) else str(value) for name, value in values.items()
    }
