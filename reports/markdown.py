"""A report as Markdown: modes, one case each, commands."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from mrta_falsify.core import task_history
from mrta_falsify.core.wait_account import wait_account
from mrta_falsify.specs.books import confirmed
from reports.contents import CaseContents, Mode, ReportContents, Table
from reports.sentences import account_sentences, consequence_sentence, violation_sentence

MAX_MODES = 100  # in full
MAX_IDS = 20  # of a mode's trials


def render_markdown(report: ReportContents) -> str:
    """Render a report as Markdown.

    Names and texts are escaped: what looks like HTML or Markdown in them stays as it is.
    """
    lines = [f"# {plain(report.title)}", "", plain(report.headline) + ".", ""]
    lines += [*_bullets(report.summary)]
    lines += [f"Count it again: {code(report.counted_by)}", ""] if report.counted_by else []
    lines += _paragraphs(f"**{plain(text)}**" for text in report.warnings)
    lines += [f"- {label}: {plain(text)}" for label, text in report.facts]
    lines += ["", *_paragraphs(map(plain, report.notes))]
    for table in report.tables:
        lines += _table(table)
    for number, mode in enumerate(report.modes[:MAX_MODES], start=1):
        lines += _mode(number, mode)
    if len(report.modes) > MAX_MODES:
        lines += [f"{len(report.modes) - MAX_MODES} further modes are left out.", ""]
    for error in report.errors:
        count = f"{len(error.ids)} trials" if len(error.ids) > 1 else f"trial {error.ids[0]}"
        lines.append(f"- error of the toolkit in {count}: {plain(error.reason)}")
    return "\n".join(lines).rstrip() + "\n"


def _mode(number: int, mode: Mode) -> Iterator[str]:
    shown = ", ".join(mode.ids[:MAX_IDS]) + (", ..." if len(mode.ids) > MAX_IDS else "")
    trials = f"{len(mode.ids)} trials: {shown}" if len(mode.ids) > 1 else f"Trial {shown}"
    yield from (f"## Mode {number}: {code(mode.signature)}", "", trials, "")
    if mode.cases:
        yield from _case(mode.cases[0])
    else:
        yield from (plain(mode.happened), "")


def _case(case: CaseContents) -> Iterator[str]:
    yield from _what_happened(case)
    yield from _what_was_checked(case)
    yield from _bullets(case.certified)
    yield from _bullets(case.removals)
    yield from _bullets(case.needs)
    if case.minimised is not None:
        left = ", ".join(f"{before} to {after} {name}" for name, before, after in case.counts)
        less = f"{len(case.removed)} things removed"
        tried = f"; {case.tried}" if case.tried else ""
        yield from (plain(f"Smallest world: {left or less}{tried}."), "")
    for what, command in case.commands:
        yield f"{plain(what)}: {code(command)}  "
    yield ""


def _what_happened(case: CaseContents) -> Iterator[str]:
    violated = [verdict for verdict in case.verdicts if verdict.violated]
    if not violated:
        return
    first, *others = violated
    yield from (plain(violation_sentence(first)), "")
    if others:
        told = " ".join(consequence_sentence(verdict, first) for verdict in others)
        yield from (plain(f"Also violated: {told}"), "")
    yield from _bullets(account_sentences(wait_account(first, case.trace)))
    tasks = task_history.tasks_of(first)
    yield from _bullets(task_history.stories(tasks, case.world, confirmed(case.trace, case.world)))


def _what_was_checked(case: CaseContents) -> Iterator[str]:
    if case.layer or case.layer_evidence:
        text = f"Suspected layer: {case.layer or 'none'}. {case.layer_evidence}"
        yield from (plain(text.strip()), "")
    if case.identical:
        same, runs = case.identical
        parts = f", {case.parts}" if case.parts else ""
        yield from (f"Replay: {same} of {runs} identical{parts}.", "")
    if case.compared:
        yield from (plain(f"Against the other stack: {'; '.join(case.compared)}."), "")
    if case.repeated:
        yield from (plain(f"{case.repeated[0].upper()}{case.repeated[1:]}."), "")
    if case.jittered:
        failed, runs = case.jittered
        yield from (f"Of {runs} perturbed runs, {failed} fail in a primary specification.", "")
    if case.confirmed:
        yield from (f"On other engines, perturbed runs included: {case.confirmed}.", "")
    if case.rows:
        rows = (f"{row.change} fails in {row.failed} of {row.runs} runs" for row in case.rows)
        yield from (plain(f"{'; '.join(rows)}."), "")
    if case.counterfactuals:
        gone = [row.change for row in case.counterfactuals if row.failure_gone]
        changes = f": {'; '.join(gone)}" if gone else ""
        text = f"{len(gone)} of {len(case.counterfactuals)} changes remove the failure{changes}."
        yield from (plain(text), "")


def _table(table: Table) -> Iterator[str]:
    yield from (f"## {plain(table.title)}", "")
    yield from _paragraphs(map(plain, table.notes))
    if not table.rows:
        return
    for row in (table.columns, ["---"] * len(table.columns), *table.rows):
        yield "| " + " | ".join(plain(text) for text in row) + " |"
    yield ""


def _paragraphs(texts: Iterable[str]) -> Iterator[str]:
    for text in texts:
        yield from (text, "")


def _bullets(texts: Iterable[str]) -> Iterator[str]:
    rows = [f"- {plain(text)}" for text in texts]
    if rows:
        yield from (*rows, "")


def plain(text: str) -> str:
    """Put ``text`` on one line and escape what Markdown would take for its own."""
    flat = " ".join(text.split())
    flat = flat.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"([\\`*|\[\]])", r"\\\1", flat)


def code(text: str) -> str:
    """Put ``text`` in a code span, fenced by more backticks than stand in it."""
    flat = " ".join(text.split())
    longest = max((len(run) for run in re.findall("`+", flat)), default=0)
    fence = "`" * (longest + 1)
    room = " " if longest else ""
    return f"{fence}{room}{flat}{room}{fence}"
