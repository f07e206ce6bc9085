"""Trials as JUnit XML: a failure is a violation, an error is one of the toolkit.

A trial without a failure is skipped if something was not judged.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

#: what XML 1.0 cannot hold, such as the colours of a terminal
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True, slots=True, kw_only=True)
class Complaint:
    """What went wrong in a trial."""

    kind: str
    message: str  #: one line
    text: str  #: in full


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialResult:
    """One trial as a CI server sees it."""

    name: str
    time: float  #: [s] of computing
    failure: Complaint | None = None  #: a violation
    error: Complaint | None = None  #: of the toolkit
    skipped: str = ""  #: what was not judged, and why; empty: a trial that passes did so


def render_junit(name: str, results: Sequence[TrialResult]) -> str:
    """Render trials as JUnit XML.

    Args:
        name: of the suite.
        results: one per trial.
    """
    suite = ET.Element(
        "testsuite",
        name=_xml(name),
        tests=str(len(results)),
        failures=str(sum(result.failure is not None for result in results)),
        errors=str(sum(result.error is not None for result in results)),
        skipped=str(sum(bool(result.skipped) for result in results)),
        time=f"{sum(result.time for result in results):.3f}",
    )
    for result in results:
        case = ET.SubElement(
            suite,
            "testcase",
            classname=_xml(name),
            name=_xml(result.name),
            time=f"{result.time:.3f}",
        )
        _add_complaint(case, "failure", result.failure)
        _add_complaint(case, "error", result.error)
        if result.skipped:
            ET.SubElement(case, "skipped", message=_xml(result.skipped))
    ET.indent(suite)
    return ET.tostring(suite, encoding="unicode", xml_declaration=True) + "\n"


def _add_complaint(case: ET.Element, tag: str, complaint: Complaint | None) -> None:
    if complaint is None:
        return
    element = ET.SubElement(case, tag, type=_xml(complaint.kind), message=_xml(complaint.message))
    element.text = _xml(complaint.text)


def _xml(text: str) -> str:
    return _NOT_XML.sub("\ufffd", text)
