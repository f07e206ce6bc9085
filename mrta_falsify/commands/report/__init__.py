"""The command ``report``: the report of a campaign, built from its store alone."""

from mrta_falsify.commands.report.build import (
    MAX_CASES,
    build_report,
    junit_report,
    markdown_report,
    write_report,
)

__all__ = ["MAX_CASES", "build_report", "junit_report", "markdown_report", "write_report"]
