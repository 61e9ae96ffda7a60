"""The printed figures of the papers, recomputed."""

from armctl.published.abaas import abaas_report
from armctl.published.humanoid import humanoid_report
from armctl.published.mico import mico_report
from armctl.published.report import Comparison, Improvement, Report
from armctl.published.scorbot import scorbot_report
from armctl.published.uzuner import uzuner_report

__all__ = ["REPORTS", "Comparison", "Improvement", "Report"]

REPORTS = {
    "uzuner": uzuner_report,
    "abaas": abaas_report,
    "scorbot": scorbot_report,
    "humanoid": humanoid_report,
    "mico": mico_report,
}
"""What recomputes each paper, by the name of its robot."""
