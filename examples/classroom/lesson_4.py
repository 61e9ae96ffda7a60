"""Lesson 4: whose arm is best? Replace each ``...`` by your answer, then run: python lesson_4.py points.csv

With more files than one it ranks the arms of the class: python lesson_4.py anna.csv ben.csv cem.csv
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from exercises import check, near

import armctl
from armctl.calibration import TouchFit, fit_touches, read_touches, touch_errors
from armctl.errors import ArmctlError

ROBOT = armctl.load_robot("uzuner")  # your arm
FRAME = "sheet"  # "base" for known places

# 1. How far is the tool off before the correction, in mm (RMS)? (Calibration, Known points)
BEFORE_MM = ...

# 2. … and with the correction?
AFTER_MM = ...

# 3. Which joint is to blame most? As the page calls it, in quotes.
BLAMED = ...

# 4. Which of your points is missed most by the arm as it was? Its number, from 1.
WORST_POINT = ...


# 5. Some touches miss their points by these distances. What is their RMS (root of the mean of the squares)?
def rms(distances: list[float]) -> float:
    """One number for all of them."""
    raise NotImplementedError("write this function")


# What follows checks your answers.


def fitted(path: Path) -> TouchFit:
    return fit_touches(ROBOT, read_touches(path, ROBOT, FRAME))


def is_blamed(fit: TouchFit, answer: str) -> bool:
    return bool(fit.causes) and getattr(fit.causes[0], "part", "").casefold() == answer.strip().casefold()


def is_rms(_: object) -> bool:
    distances = np.random.default_rng(4).uniform(0.1, 9.0, 20)
    return abs(rms(distances.tolist()) - float(np.sqrt(np.mean(distances**2)))) < 1e-6


def one(path: Path) -> None:
    """Check the answers about the points in a file."""
    try:
        fit = fitted(path)
        missed = np.linalg.norm(touch_errors(ROBOT, read_touches(path, ROBOT, FRAME)), axis=1)
    except ArmctlError as error:
        sys.exit(str(error))
    before, after = 1000 * fit.before.rms, 1000 * fit.after.rms
    check(
        (BEFORE_MM, near(before, 0.1), "The page says 'Tool error'; it is the first number."),
        (AFTER_MM, near(after, 0.1), "'with the correction': what is left at points that were left out."),
        (BLAMED, lambda answer: is_blamed(fit, answer), "The first line below the error names it."),
        (WORST_POINT, lambda k: k == int(np.argmax(missed)) + 1, "The largest number of 'off by mm'."),
        (rms, is_rms, "Square the distances, take their mean, then the root."),
    )


def ranked(paths: list[Path]) -> None:
    """Whose arm is best: by what is left with the correction, as that is what the arm can do."""
    rows: list[tuple[float, float, str]] = []
    for path in paths:
        try:
            fit = fitted(path)
            rows.append((1000 * fit.after.rms, 1000 * fit.before.rms, path.stem))
        except ArmctlError as error:
            print(f"{path.stem}: {error}")
    for place, (after, before, name) in enumerate(sorted(rows), 1):
        print(f"{place}. {name}: {after:.1f} mm with its correction, {before:.1f} mm before")


if __name__ == "__main__":
    files = [Path(name) for name in sys.argv[1:]]
    if not files:
        sys.exit("say which points: python lesson_4.py points.csv")
    one(files[0]) if len(files) == 1 else ranked(files)
