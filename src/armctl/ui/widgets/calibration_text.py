"""A calibration as people read it: tables, lines and words, as HTML."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

from armctl.boards import SIMULATED_SERIAL, UNNUMBERED
from armctl.calibration import (
    LEAST_MARKS,
    LEAST_POINTS,
    Calibration,
    CheckPose,
    JointFit,
    Mark,
    Version,
    differences,
    narrowed,
    own_calibration,
)
from armctl.errors import ArmctlError, StateError
from armctl.ui.tabs.calibration.shared_calibration import CalibrationWork, SharedCalibration
from armctl.ui.tabs.calibration.touched_points import TouchedPoints
from armctl.ui.widgets.html import (
    date_and_time,
    fixed,
    heading,
    muted,
    refused,
    sentence,
    strong,
    table,
    with_minus,
)

_BOARDS = {
    None: "its board: none is there yet",
    SIMULATED_SERIAL: "the simulated board",
    UNNUMBERED: "a board without a serial number (one calibration for all such boards)",
}


def in_force_html(calibration: Calibration | None, board: str | None) -> str:
    """Which calibration the arm runs by."""
    on = _BOARDS.get(board, f"board {board}")
    if calibration is None:
        return strong("In force: the robot file") + muted(f"This arm is not calibrated on {on}.")
    note = f" “{calibration.note}”" if calibration.note else ""
    return strong(f"In force: calibration of {date_and_time(calibration.made)}{note}") + muted(
        f"{joints_words(calibration)} of this arm on {on}; the rest is as in the robot file."
    )


def marks_html(marks: Sequence[Mark], fit: JointFit | None, unit: str) -> str:
    """The marks with their residuals; one that does not fit is marked."""
    if not marks:
        return muted(
            "No marks yet: jog the joint to a mark of the protractor, type the angle, press Add mark."
        )
    rows = [
        [
            str(number),
            fixed(mark.output, 1),
            fixed(math.degrees(mark.angle), 2),
            "" if fit is None else _residual(fit, number - 1),
        ]
        for number, mark in enumerate(marks, 1)
    ]
    wrong = None if fit is None else fit.suspect
    return table(("mark", unit, "angle °", "residual °"), rows, marked=wrong, names=False)


def numbered(count: int) -> tuple[str, ...]:
    """Entries of a list of marks or points; the page hides the list while there are none."""
    return tuple(str(number) for number in range(1, max(count, 1) + 1))


def fit_html(work: CalibrationWork, joint: str) -> str:
    """What the marks of a joint come to, beside what its robot file says."""
    marks, unit = work.joint(joint).marks, work.map.unit
    try:
        fit = work.fit(joint)
    except ArmctlError as error:
        return refused(sentence(str(error)))
    if fit is None:
        left = LEAST_MARKS - len(marks)
        return muted(f"{left} more mark{'' if left == 1 else 's'} needed, as far apart as the joint allows.")
    own = own_calibration(work.robot, joint)
    rows = [
        ["sign", _sign(fit.per_rad), _sign(own.per_rad)],
        ["offset (at 0°)", f"{fixed(fit.zero, 1)} {unit}", f"{fixed(own.zero, 1)} {unit}"],
        ["scale", f"{_per_degree(fit.per_rad)} {unit}/°", f"{_per_degree(own.per_rad)} {unit}/°"],
        ["residual, RMS", f"{fixed(math.degrees(fit.rms_rad), 2)}°", ""],
    ]
    if (outputs := work.robot.output_map) is not None and outputs.homed:
        homes = (fit.angle(0.0), -own.zero / own.per_rad)
        rows.insert(1, ["home (0 counts) is at", *(f"{fixed(math.degrees(home), 2)}°" for home in homes)])
    text = table(("", "by the marks", "robot file"), rows)
    text += "".join(muted(sentence(words)) for words in differences(work.robot, joint, fit))
    return text if fit.advice is None else text + refused(sentence(fit.advice))


def limits_html(work: CalibrationWork, joint: str) -> str:
    """The safe limits of a joint, and where they come from."""
    try:
        low, high = work.limits(joint)
    except ArmctlError as error:
        return refused(sentence(str(error)))
    mine, now = work.joint(joint), None if work.in_force is None else work.in_force.joints.get(joint)
    if mine.low is not None or mine.high is not None:
        said = "set here"
    elif now is not None and not mine.by_default:
        said = "as in force" if (low, high) == (now.low, now.high) else "as in force, by the new marks"
    else:
        said = "as the robot file allows"
    return f"<div><b>{fixed(low, 1)} … {fixed(high, 1)} {work.map.unit}</b> ({said})</div>"


def overview_html(work: CalibrationWork) -> str:
    """What was measured so far, a row a joint."""
    unit = work.map.unit
    rows = [[one.title, *_measured(work, one.name)] for one in work.robot.joints]
    text = heading(f"What was measured (outputs in {unit})")
    text += table(("", "marks", "RMS", "at 0°", "per degree", "safe"), rows)
    if work.map.gripper_channel is not None:
        said = "" if work.jaws else " (as before)"
        text += (
            f"<div>Gripper: closed at {fixed(work.jaw('closed'), 1)}, open at "
            f"{fixed(work.jaw('open'), 1)} {unit}{said}</div>"
        )
    if work.unfinished:
        text += refused(f"{', '.join(work.unfinished)}: fewer than {LEAST_MARKS} marks are not used.")
    return text


def draft_html(desk: SharedCalibration) -> str:
    """What saving would do, or why nothing can be saved."""
    try:
        drawn = desk.draft()
    except StateError as error:
        return muted(sentence(str(error)))
    except ArmctlError as error:
        return refused(sentence(str(error)))
    return "".join(muted(sentence(words)) for words in narrowed(desk.work.robot, drawn))


def check_pose_html(pose: CheckPose) -> str:
    """What one should see in the test pose."""
    *joints, tool = (with_minus(words) for words in pose.words)
    said = f"<b>{escape(', '.join(joints))}</b>; {escape(tool)}."
    return f"<div>You should see ({escape(pose.title)}): {said}</div>"


def kept_html(versions: Sequence[Version]) -> str:
    """Where they are kept."""
    if not versions:
        return muted("Nothing was saved of this arm on this board yet.")
    return f"<div style='overflow-wrap:anywhere'>{muted(f'Kept in {versions[0].path.parent}.')}</div>"


def version_label(version: Version) -> str:
    """An earlier calibration, as one line of a list."""
    if version.problem is not None:
        return f"{version.number}: cannot be read"
    what = "robot file" if version.calibration is None else joints_words(version.calibration)
    back = "" if version.again is None else f", back to {version.again}"
    note = f" “{version.note}”" if version.note and version.calibration is not None else ""
    return f"{version.number}: {date_and_time(version.made)}, {what}{back}{note}"


def joints_words(calibration: Calibration) -> str:
    """What a calibration covers."""
    count = len(calibration.joints)
    joints = f"{count} joint{'' if count == 1 else 's'}"
    return joints if calibration.gripper is None else f"{joints} and the gripper"


def _measured(work: CalibrationWork, joint: str) -> list[str]:
    count = str(len(work.joint(joint).marks) or "–")
    try:
        fit = work.fit(joint)
        low, high = work.limits(joint)
    except ArmctlError:
        return [count, "no line", "", "", ""]
    safe = f"{fixed(low, 0)} … {fixed(high, 0)}"
    if fit is None:
        return [count, "", "", "", safe]
    doubt = " ✗" if fit.suspect is not None else " ?" if fit.advice else ""
    rms = f"{fixed(math.degrees(fit.rms_rad), 2)}°{doubt}"
    return [count, rms, fixed(fit.zero, 1), fixed(math.radians(fit.per_rad), 3), safe]


def _residual(fit: JointFit, index: int) -> str:
    sign = " ✗" if index == fit.suspect else ""
    return fixed(math.degrees(fit.residuals_rad[index]), 2) + sign


def _sign(per_rad: float) -> str:
    return "+" if per_rad > 0 else "−"


def _per_degree(per_rad: float) -> str:
    return fixed(abs(math.radians(per_rad)), 3)


def points_html(points: TouchedPoints) -> str:
    """The touched points, and how far from each the arm believes its tool to be."""
    rows = [
        [str(number), *(fixed(1000 * value, 1) for value in touch.point_m), fixed(1000 * distance, 2)]
        for number, (touch, distance) in enumerate(
            zip(points.touches, points.distances_m.tolist(), strict=True), 1
        )
    ]
    head = ("point", "X mm", "Y mm", "Z mm", "off by mm")
    return table(head, rows, names=False) if rows else ""


def told_html(points: TouchedPoints) -> str:
    """What the touched points tell, and what robot file or calibration should say."""
    told, count = points.told, len(points.touches)
    if count < LEAST_POINTS:
        left = LEAST_POINTS - count
        return muted(f"{left} more point{'' if left == 1 else 's'} needed.") if count else ""
    if told is None:
        return muted("Comparing …")
    if isinstance(told, str):
        return refused(sentence(told))
    first, *rest = told.words
    text = strong(sentence(first)) + "".join(f"<div>{escape(sentence(words))}</div>" for words in rest)
    if told.changes:
        text += heading("Suggested values")
        text += f"<pre style='margin:0;font-size:11.5px;user-select:text'>{escape(told.toml())}</pre>"
    return text
