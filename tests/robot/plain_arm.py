"""A plain arm of five joints, for files that differ from it in one thing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

LINKS = ("base", "l1", "l2", "l3", "l4", "hand")
_BOX = '<box size="0.03 0.03 0.08"/>'
_JOINTS = {
    "pan": ("0 0 0.05", "0 0 1"),
    "lift": ("0 0 0.06", "0 1 0"),
    "elbow": ("0 0 0.12", "0 1 0"),
    "wrist": ("0 0 0.12", "0 1 0"),
    "roll": ("0 0 0.06", "0 0 1"),
}
NAMES = tuple(_JOINTS)


def plain_arm(
    changed: Mapping[str, Mapping[str, str]] | None = None,
    *,
    visual: str = _BOX,
    collision: str = _BOX,
    mass: str = "0.1",
) -> str:
    """The text of its URDF file.

    ``changed``: by joint, its ``type``, ``xyz``, ``rpy``, ``axis``, or attributes of its limit. ``visual``
    and ``collision``: what stands inside of the geometry of each link.
    """
    parts = [
        f'<link name="{name}"><visual><origin xyz="0 0 0.04"/><geometry>{visual}</geometry></visual>'
        f'<collision><origin xyz="0 0 0.04"/><geometry>{collision}</geometry></collision>'
        f'<inertial><mass value="{mass}"/></inertial></link>'
        for name in LINKS
    ]
    for k, (name, (xyz, axis)) in enumerate(_JOINTS.items()):
        own = {"type": "revolute", "xyz": xyz, "rpy": "0 0 0", "axis": axis}
        own |= {"lower": "-1.8", "upper": "1.8", "effort": "10", "velocity": "2"}
        own |= (changed or {}).get(name, {})
        limit = " ".join(f'{key}="{own[key]}"' for key in ("lower", "upper", "effort", "velocity"))
        parts.append(
            f'<joint name="{name}" type="{own["type"]}"><parent link="{LINKS[k]}"/>'
            f'<child link="{LINKS[k + 1]}"/><origin xyz="{own["xyz"]}" rpy="{own["rpy"]}"/>'
            f'<axis xyz="{own["axis"]}"/><limit {limit}/></joint>'
        )
    return '<?xml version="1.0"?>\n<robot name="demo">\n' + "\n".join(parts) + "\n</robot>\n"


def write_plain_arm(path: Path, changed: Mapping[str, Mapping[str, str]] | None = None, **kind: str) -> Path:
    """Its file at a path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(plain_arm(changed, **kind))
    return path
