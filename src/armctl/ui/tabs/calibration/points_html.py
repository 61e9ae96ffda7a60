"""What the Known points tab says: which point is next, how far the tool is off, what is to blame."""

from __future__ import annotations

from html import escape

import numpy as np

from armctl.arrays import FloatArray
from armctl.calibration import LEAST_POINTS, TouchFit, TouchSheet
from armctl.facts import say, say_with_advice
from armctl.facts.causes import WorstPoint
from armctl.robot import Robot
from armctl.ui.tabs.calibration.touched_points import TouchedPoints
from armctl.ui.widgets.html import (
    date_and_time,
    fixed,
    folded,
    muted,
    numbers,
    refused,
    sentence,
    strong,
    table,
)

_CHECK_POINTS = 3


def counted(points: int) -> str:
    """How many, in words."""
    return f"{points} point{'' if points == 1 else 's'}"


def offered_html(points: TouchedPoints) -> str:
    """What was touched before armctl was started; or why what is touched now would not survive that."""
    if points.offered is None:
        return "" if points.not_kept is None else refused(sentence(points.not_kept))
    kept = points.offered
    on = "known places" if kept.sheet is None else "a sheet"
    when = f", the last one {date_and_time(kept.made)}" if kept.made else ""
    text = strong(f"Kept from before: {counted(len(kept.touches))} on {on}{when}")
    if kept.sheet is not None:
        text += muted("Go on with them if neither the sheet nor the base was moved since.")
    return text


def again_label(index: int) -> str:
    """The button that has a point touched again, from 0."""
    return f"Touch point {index + 1} again"


def sheet_html(sheet: TouchSheet) -> str:
    """What to do with the sheet."""
    lies = f"lay it on something flat, {sheet.raised}, and tape it down" if sheet.raised else "tape it down"
    high = "type its true height in 'Heights and load'" if sheet.raised else (
        "where the arm stops above the paper because of the floor, lay the sheet on books, and type how high "
        "in 'Heights and load'"
    )  # fmt: skip
    return muted(
        f"Print the sheet at 100 %, check its scale bar, {lies} about where it says; {high}. Some crosshairs "
        "touched on a block of known height tell more."
    )


def next_html(points: TouchedPoints) -> str:
    """Which crosshair to touch next."""
    if points.next is None:
        return muted("Looking for the next one …" if points.unknown else "Choose a crosshair to touch.")
    on = f", on the block ({fixed(1000 * points.next.height_m, 1)} mm)" if points.next.height_m else ""
    again = "" if points.retaken is None else f" again, for point {points.retaken + 1}"
    told = strong(f"Touch crosshair {points.next.number} {'next' if not again else again[1:]}{on}")
    away = " Take the block away before Go, and put it on the crosshair then." if points.next.height_m else ""
    told += muted(
        f"Press Go below the picture: the tip comes to 15 mm or more above it.{away} Step it onto the "
        "middle, look from two sides, and press Here. Then lift it."
    )
    if points.doubtful is not None and not again:
        told += refused(
            f"Point {points.doubtful + 1} does not fit the others. Press "
            f"'{again_label(points.doubtful)}' below the result before you go on."
        )
    elif len(points.touches) >= _CHECK_POINTS:
        told += muted("This one tells most of what is still uncertain, also where it was touched before.")
    return told


def tip_html(robot: Robot, q: FloatArray) -> str:
    """Where the tip is at ``q`` (n,) [rad]; NaN: nobody knows."""
    if np.isnan(q).any():
        return muted("Nobody knows where the tip is; enable the arm first.")
    tip = numbers(1000 * robot.forward(q)[:3, 3], 1)
    return f"<div>The tip, by the calibration in force: <b>{tip} mm</b></div>"


def points_html(points: TouchedPoints) -> str:
    """The touched points, and how far the tool misses each as it is calibrated now; ✗: it does not fit."""
    errors: list[float | None] = [None] * len(points.touches)
    if points.errors_m is not None:
        errors = list(points.errors_m.tolist())
    fit = points.result if isinstance(points.result, TouchFit) else None
    left = None if fit is None or not fit.correct else np.linalg.norm(fit.missed_m, axis=1).tolist()
    wrong = set[int]() if fit is None else {one.number for one in fit.mistaken}
    rows = [
        [
            str(number),
            *([] if points.sheet is None else [str(touch.number or "")]),
            *(fixed(1000 * value, 1) for value in touch.point_m),
            ("" if error is None else fixed(1000 * error, 1)) + (" ✗" if number in wrong else ""),
            *([] if left is None else [fixed(1000 * left[number - 1], 1)]),
        ]
        for number, (touch, error) in enumerate(zip(points.touches, errors, strict=True), 1)
    ]
    cross = [] if points.sheet is None else ["cross-hair"]
    corrected = [] if left is None else ["corrected"]
    head = ("point", *cross, "X mm", "Y mm", "Z mm", "off by mm", *corrected)
    return table(head, rows, words=()) if rows else ""


def result_html(points: TouchedPoints) -> str:
    """What was corrected, the tool error, what is to blame, and the suggested values."""
    result, count = points.result, len(points.touches)
    text = "" if points.corrected is None else _corrected_html(points, *points.corrected)
    if count < LEAST_POINTS:
        left = LEAST_POINTS - count
        so_far = _sizes_html("Tool error at these points", points.errors_m) if count >= _CHECK_POINTS else ""
        more = muted(f"{left} more point{'' if left == 1 else 's'} needed for a correction.") if count else ""
        return text + so_far + more
    if result is None:
        return text + muted("Comparing …")
    if isinstance(result, str):
        return text + refused(sentence(result))
    text += strong(f"Tool error {_millimetres(result.before.rms)}")
    if result.correct:
        low, high = fixed(1000 * result.expected.low, 1), _millimetres(result.expected.high)
        text += strong(f"with the correction {_millimetres(result.after.rms)}")
        text += muted(
            f"RMS at points that were left out of the fit; largest {_millimetres(result.before.largest)}, "
            f"with the correction {_millimetres(result.after.largest)}. At points nearby that nobody has "
            f"touched: {low} to {high} RMS, in 9 of 10 cases."
        )
    told = [*result.mistaken, *result.causes, *(() if result.verdict is None else (result.verdict,))]
    text += "".join(f"<div>{escape(sentence(say_with_advice(one)))}</div>" for one in told)
    worst = points.doubtful
    if worst is not None and not result.mistaken:
        x, y, z = result.missed_m[worst].tolist()
        text += f"<div>{escape(sentence(say(WorstPoint(worst + 1, (x, y, z)))))}</div>"
    if result.held:
        text += folded("What these points do not tell", [sentence(say(one)) for one in result.held])
    if suggested := points.suggestion:
        text += (
            "<details style='font-size:11.5px;opacity:.75'><summary style='cursor:pointer'>Suggested values"
        )
        text += f"</summary><pre style='margin:0;user-select:text'>{escape(suggested)}</pre></details>"
    return text


def _corrected_html(points: TouchedPoints, before: float, after: float) -> str:
    text = strong(f"Corrected: {_millimetres(before)} before, {_millimetres(after)} after")
    since = None if points.errors_m is None else points.errors_m[points.used :]
    left = _CHECK_POINTS - (len(points.touches) - points.used)
    if left > 0:
        return text + muted(f"Touch {left} more point{'' if left == 1 else 's'} to check it.")
    return text + _sizes_html("Checked by points touched since", since)


def _sizes_html(what: str, errors_m: FloatArray | None) -> str:
    if errors_m is None:
        return ""
    rms = float(np.sqrt(np.mean(errors_m**2)))
    sizes = f"{_millimetres(rms)} RMS, largest {_millimetres(float(errors_m.max()))}"
    return f"<div>{what} ({len(errors_m)}): <b>{sizes}</b></div>"


def _millimetres(length_m: float) -> str:
    return f"{fixed(1000 * length_m, 2 if length_m < 0.001 else 1)} mm"
