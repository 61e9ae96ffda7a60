"""A check-up of a port and the board behind it, which moves nothing."""

from armctl.hardware.doctor.examination import Patient, examine, without_personal_data
from armctl.hardware.doctor.finding import Finding, Verdict

__all__ = ["Finding", "Patient", "Verdict", "examine", "without_personal_data"]
