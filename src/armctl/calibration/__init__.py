"""What was measured of one arm on one board: marks, fits, the record, where it is kept, and its use."""

from armctl.calibration.apply import (
    CheckPose,
    calibrated,
    check_pose,
    differences,
    narrowed,
    own_calibration,
    own_map,
    safe_outputs,
)
from armctl.calibration.correction import Change, changes, corrected, suggestion
from armctl.calibration.fit import LEAST_MARKS, JointFit, Mark, fit_joint
from armctl.calibration.kept_touches import MOST_TOUCHES, KeptTouches, TouchedPoint, TouchesFile
from armctl.calibration.next_touch import Aim, next_touch, reachable, reachable_at
from armctl.calibration.record import (
    Calibration,
    CalibrationStore,
    JointCalibration,
    JointDeflection,
    LengthChange,
    Version,
    decode_calibration,
    encode_calibration,
    iso_time,
    read_calibration,
    renamed,
)
from armctl.calibration.sheet import PAPERS_MM, Paper, TouchSheet, touch_sheet
from armctl.calibration.tables import read_marks, read_touches, touches_csv
from armctl.calibration.tool_point import LEAST_SIDES, ToolPoint, teach_tool
from armctl.calibration.touch_model import LEAST_POINTS, Frame, Touches
from armctl.calibration.touch_report import TouchFit, fit_touches, touch_errors

__all__ = [
    "LEAST_MARKS",
    "LEAST_POINTS",
    "LEAST_SIDES",
    "MOST_TOUCHES",
    "PAPERS_MM",
    "Aim",
    "Calibration",
    "CalibrationStore",
    "Change",
    "CheckPose",
    "Frame",
    "JointCalibration",
    "JointDeflection",
    "JointFit",
    "KeptTouches",
    "LengthChange",
    "Mark",
    "Paper",
    "ToolPoint",
    "TouchFit",
    "TouchSheet",
    "TouchedPoint",
    "Touches",
    "TouchesFile",
    "Version",
    "calibrated",
    "changes",
    "check_pose",
    "corrected",
    "decode_calibration",
    "differences",
    "encode_calibration",
    "fit_joint",
    "fit_touches",
    "iso_time",
    "narrowed",
    "next_touch",
    "own_calibration",
    "own_map",
    "reachable",
    "reachable_at",
    "read_calibration",
    "read_marks",
    "read_touches",
    "renamed",
    "safe_outputs",
    "suggestion",
    "teach_tool",
    "touch_errors",
    "touch_sheet",
    "touches_csv",
]
