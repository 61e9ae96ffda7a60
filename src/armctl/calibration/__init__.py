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
from armctl.calibration.fit import LEAST_MARKS, JointFit, Mark, fit_joint
from armctl.calibration.record import (
    Calibration,
    CalibrationStore,
    JointCalibration,
    Version,
    decode_calibration,
    encode_calibration,
    iso_time,
    read_calibration,
    read_marks,
    read_points,
    renamed,
)
from armctl.calibration.tool_error import LEAST_POINTS, ToolError, tool_error

__all__ = [
    "LEAST_MARKS",
    "LEAST_POINTS",
    "Calibration",
    "CalibrationStore",
    "CheckPose",
    "JointCalibration",
    "JointFit",
    "Mark",
    "ToolError",
    "Version",
    "calibrated",
    "check_pose",
    "decode_calibration",
    "differences",
    "encode_calibration",
    "fit_joint",
    "iso_time",
    "narrowed",
    "own_calibration",
    "own_map",
    "read_calibration",
    "read_marks",
    "read_points",
    "renamed",
    "safe_outputs",
    "tool_error",
]
