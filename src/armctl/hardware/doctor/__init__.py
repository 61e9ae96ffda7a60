"""A check-up of a port and the board behind it, which moves nothing."""

from armctl.hardware.doctor.examination import Patient, examine
from armctl.hardware.doctor.finding import Finding, Verdict
from armctl.hardware.doctor.personal import without_personal_data

__all__ = ["Finding", "Patient", "Verdict", "examine", "without_personal_data"]
