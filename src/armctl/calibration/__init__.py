"""What was measured of one arm on one board: marks, fits, the record, where it is kept, and its use."""

from armctl.calibration.apply import (
    CheckPose,
    calibrated,
    check_pose,
    default_outputs,
    differences,
    narrowed,
    own_calibration,
    safe_outputs,
)
from armctl.calibration.fit import LEAST_MARKS, JointFit, Mark, fit_joint
from armctl.calibration.record import (
    Calibration,
    JointCalibration,
    decode_calibration,
    encode_calibration,
    read_calibration,
)
from armctl.calibration.store import CalibrationStore, Stored, Version, renamed
from armctl.calibration.table import read_marks, read_points
from armctl.calibration.tool_error import LEAST_POINTS, Blame, Change, ToolError, tool_error

__all__ = [
    "LEAST_MARKS",
    "LEAST_POINTS",
    "Blame",
    "Calibration",
    "CalibrationStore",
    "Change",
    "CheckPose",
    "JointCalibration",
    "JointFit",
    "Mark",
    "Stored",
    "ToolError",
    "Version",
    "calibrated",
    "check_pose",
    "decode_calibration",
    "default_outputs",
    "differences",
    "encode_calibration",
    "fit_joint",
    "narrowed",
    "own_calibration",
    "read_calibration",
    "read_marks",
    "read_points",
    "renamed",
    "safe_outputs",
    "tool_error",
]
