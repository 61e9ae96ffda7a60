"""The printed tables of the papers, recomputed."""

from armctl.published.report import Comparison, Report
from armctl.published.uzuner import uzuner_report

__all__ = ["Comparison", "Report", "published_reports", "uzuner_report"]


def published_reports() -> list[Report]:
    """Every printed table that armctl recomputes."""
    return [uzuner_report()]
