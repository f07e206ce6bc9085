"""A report as Markdown, and trials as JUnit XML."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from mrta_falsify.core import task_history as errands
from reports.contents import Case, Mode, Report, Table
from reports.sentences import edge_sentence, sentence

MOST_MODES = 100  # told in Markdown
MOST_IDS = 20  # of a mode's trials
#: what XML 1.0 cannot hold, such as the colours of a terminal
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


# --- Markdown --------------------------------------------------------------------------------


def markdown(report: Report) -> str:
    """The report as Markdown: modes, one case each, commands.

    Names and texts are escaped: what looks like HTML or Markdown in them stays as it is.
    """
    lines = [f"# {_plain(report.title)}", "", _plain(report.headline) + ".", ""]
    lines += _paragraphs(f"**{_plain(text)}**" for text in report.warnings)
    lines += [f"- {label}: {_plain(text)}" for label, text in report.facts]
    lines += ["", *_paragraphs(map(_plain, report.notes))]
    for table in report.tables:
        lines += _table(table)
    for number, mode in enumerate(report.modes[:MOST_MODES], start=1):
        lines += _mode(number, mode)
    if len(report.modes) > MOST_MODES:
        lines += [f"{len(report.modes) - MOST_MODES} further modes are left out.", ""]
    for error in report.errors:
        count = f"{len(error.ids)} trials" if len(error.ids) > 1 else f"trial {error.ids[0]}"
        lines.append(f"- error of the toolkit in {count}: {_plain(error.reason)}")
    return "\n".join(lines).rstrip() + "\n"


def _mode(number: int, mode: Mode) -> Iterator[str]:
    shown = ", ".join(mode.ids[:MOST_IDS]) + (", ..." if len(mode.ids) > MOST_IDS else "")
    yield from (f"## Mode {number}: {_code(mode.signature)}", "")
    yield from (f"{len(mode.ids)} trials: {shown}" if len(mode.ids) > 1 else f"Trial {shown}", "")
    if mode.cases:
        yield from _case(mode.cases[0])
    else:
        yield from (_plain(mode.happened), "")


def _case(case: Case) -> Iterator[str]:
    violated = [verdict for verdict in case.verdicts if verdict.violated]
    yield from _paragraphs(_plain(sentence(verdict)) for verdict in violated[:1])
    edges = violated[0].evidence.get("cycle", []) if violated else []
    yield from _bullets(edge_sentence(edge) for edge in edges)
    tasks = errands.tasks_of(violated[0]) if violated else []
    yield from _bullets(errands.stories(tasks, case.world, case.trace))
    if case.layer or case.layer_evidence:
        text = f"Suspected layer: {case.layer or 'none'}. {case.layer_evidence}"
        yield from (_plain(text.strip()), "")
    if case.identical:
        parts = f", {case.parts}" if case.parts else ""
        yield from (f"Replay: {case.identical[0]} of {case.identical[1]} identical{parts}.", "")
    if case.jittered:
        yield from (
            f"With small differences it fails in {case.jittered[0]} of {case.jittered[1]} runs.",
            "",
        )
    gone = [row.change for row in case.counterfactuals if row.failure_gone]
    if case.counterfactuals:
        changes = f": {'; '.join(gone)}" if gone else ""
        text = f"{len(gone)} of {len(case.counterfactuals)} changes remove the failure{changes}."
        yield from (_plain(text), "")
    yield from _bullets(case.removals)
    if case.minimised is not None:
        left = ", ".join(f"{before} to {after} {name}" for name, before, after in case.counts)
        yield from (_plain(f"Smallest world: {left or f'{len(case.removed)} things less'}."), "")
    yield from _family(case)
    for what, command in case.commands:
        yield f"{_plain(what)}: {_code(command)}  "
    yield ""


def _family(case: Case) -> Iterator[str]:
    family = case.family
    if family is None:
        return
    yield from ("Failure family: runs of this program fail like this when", "")
    yield from _bullets(family.rule)
    yield from (_plain(family.precision), "")
    if family.program:
        yield from (f"As a program: {_code(family.program)}", "")


def _table(table: Table) -> Iterator[str]:
    yield from (f"## {_plain(table.title)}", "")
    yield from _paragraphs(map(_plain, table.notes))
    if not table.rows:
        return
    for row in (table.columns, ["---"] * len(table.columns), *table.rows):
        yield "| " + " | ".join(_plain(text) for text in row) + " |"
    yield ""


def _paragraphs(texts: Iterable[str]) -> Iterator[str]:
    for text in texts:
        yield from (text, "")


def _bullets(texts: Iterable[str]) -> Iterator[str]:
    rows = [f"- {_plain(text)}" for text in texts]
    if rows:
        yield from (*rows, "")


def _plain(text: str) -> str:
    """``text`` on one line, with nothing in it that Markdown would take for its own."""
    flat = " ".join(text.split())
    flat = flat.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"([\\`*|\[\]])", r"\\\1", flat)


def _code(text: str) -> str:
    """``text`` as a code span, which ends where more backticks stand than in it."""
    flat = " ".join(text.split())
    longest = max((len(run) for run in re.findall("`+", flat)), default=0)
    fence = "`" * (longest + 1)
    room = " " if longest else ""
    return f"{fence}{room}{flat}{room}{fence}"


# --- JUnit -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class TestResult:
    """One trial as a CI server sees it."""

    __test__ = False  # for pytest

    name: str
    time: float  #: [s] of computing
    failure: Complaint | None = None  #: a violation
    error: Complaint | None = None  #: of the toolkit


@dataclass(frozen=True, slots=True, kw_only=True)
class Complaint:
    """What went wrong."""

    kind: str
    message: str  #: one line
    text: str  #: in full


def junit(name: str, results: Sequence[TestResult]) -> str:
    """Trials as JUnit XML: a failure is a violation, an error one of the toolkit.

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
        time=f"{sum(result.time for result in results):.3f}",
    )
    for result in results:
        case = ET.SubElement(
            suite, "testcase", classname=_xml(name), name=_xml(result.name),
            time=f"{result.time:.3f}",
        )  # fmt: skip
        for tag, complaint in (("failure", result.failure), ("error", result.error)):
            if complaint is not None:
                element = ET.SubElement(
                    case, tag, type=_xml(complaint.kind), message=_xml(complaint.message)
                )
                element.text = _xml(complaint.text)
    ET.indent(suite)
    return ET.tostring(suite, encoding="unicode", xml_declaration=True) + "\n"


def _xml(text: str) -> str:
    return _NOT_XML.sub("\ufffd", text)
