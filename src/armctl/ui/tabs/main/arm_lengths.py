"""Lengths and rows of an arm in the making: rows read from text, lengths written beside their links."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.robot import Robot
from armctl.robot.draft import Build
from armctl.ui.widgets.number_field import parse_number

ROWS_HINT = "One row a line: a mm, alpha °, d mm, theta °, then the joint's name (none: a fixed row)."
_MM = 1e-3


def rows_of(text: str) -> list[dict[str, object]]:
    """DH rows of lines ``a alpha d theta joint`` [mm, degrees]. Raises ``InputError`` with the line."""
    rows: list[dict[str, object]] = []
    for number, line in enumerate(text.splitlines(), 1):
        parts = line.partition("#")[0].replace(",", " ").replace(";", " ").split()
        if not parts:
            continue
        if len(parts) not in (4, 5):
            raise InputError(
                f"row {number}: four numbers and a joint's name are needed, got {len(parts)} words"
            )
        keys = ("a_mm", "alpha_deg", "d_mm", "theta_deg")
        row: dict[str, object] = {
            key: parse_number(part, f"row {number}, {key}") for key, part in zip(keys, parts, strict=False)
        }
        if len(parts) == 5:
            row["joint"] = parts[4].lower()
        rows.append(row)
    if not rows:
        raise InputError(f"there is no row yet; {ROWS_HINT}")
    return rows


def length_spans(
    build: Build, lengths_mm: Mapping[str, float], robot: Robot, q: FloatArray
) -> dict[str, FloatArray]:
    """Where each length of a build lies with the arm at ``q`` (n,) [rad], by its key: its ends (2, 3) [m].

    ``robot`` is that of the build with these lengths, in its base frame. A length of 0 lies nowhere.
    """
    rows, frames = build.rows(lengths_mm), robot.frames(q)
    spans: dict[str, FloatArray] = {}
    for one in build.lengths:
        longer = build.rows({**lengths_mm, one.key: lengths_mm[one.key] + 1.0})
        for k, (row, other) in enumerate(zip(rows, longer, strict=True)):
            start, end = frames[k], frames[k + 1]
            d_mm = cast("float", row["d_mm"])
            foot = start[:3, 3] + _MM * d_mm * start[:3, 2]  # standard rows: first d, then a
            if row["d_mm"] != other["d_mm"] and row["d_mm"]:
                spans[one.key] = np.stack([start[:3, 3], foot])
            if row["a_mm"] != other["a_mm"] and row["a_mm"]:
                spans[one.key] = np.stack([foot, end[:3, 3]])
    return spans


class LengthLabels:
    """The lengths of the arm that is drawn below a node of the scene, each in the middle of its link."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._scene, self._root = scene, root
        self._labels: dict[str, viser.LabelHandle] = {}

    def show(self, build: Build, lengths_mm: Mapping[str, float], robot: Robot, q: FloatArray) -> None:
        """Write them where they are with the arm at ``q`` (n,) [rad]."""
        spans = length_spans(build, lengths_mm, robot, q)
        above = False
        for one in build.lengths:
            words = f"{one.title} {lengths_mm[one.key]:g} mm"
            shown = self._labels.get(one.key)
            if shown is not None and (one.key not in spans or shown.text != words):
                self._labels.pop(one.key).remove()
            if one.key not in spans:
                continue
            middle = spans[one.key].mean(axis=0)
            x, y, z = np.abs(np.diff(spans[one.key], axis=0)[0]).tolist()
            above = above if z > x + y else not above
            if one.key not in self._labels:
                name = f"{self._root}/lengths/{one.key}"
                # beside what stands; above and below what lies by turns: a phone has no room in a row
                lying = "bottom-center" if above else "top-center"
                beside = "center-right" if z > x + y else lying
                label = self._scene.add_label(name, words, position=middle, anchor=beside)
                self._labels[one.key] = label
            elif np.abs(self._labels[one.key].position - middle).max() > _MM:
                self._labels[one.key].position = middle

    def clear(self) -> None:
        """Write nothing, as the arm is drawn no more."""
        while self._labels:
            self._labels.popitem()[1].remove()
