"""The HTML page of a campaign or a run: one file that opens from disk and needs no network."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import jinja2
from markupsafe import Markup

from mrta_falsify.core.durable import write_atomically
from reports import floor_drawings, time_charts
from reports.case_drawings import DrawnCase, draw_case, moment_name
from reports.colours import css_variables
from reports.contents import CaseContents, Mode, ReportContents
from reports.importance_drawings import draw_importances, draw_slice
from reports.packing import pack_trials
from reports.sentences import (
    account_sentences,
    consequence_sentence,
    evidence_text,
    robustness_text,
    violation_sentence,
)

MAX_SLICES = 4  # parameters plotted one by one
MAX_BYTES = 4_500_000  # bytes of all cases of a page; keeps the page under 5 MB


def write_page(
    report: ReportContents, path: Path, *, drawn: Mapping[str, DrawnCase] | None = None
) -> None:
    """Write the page.

    Args:
        report: what it says.
        path: the HTML file.
        drawn: see :func:`render_page`.

    Raises:
        PlaceError: the file cannot be written.
    """
    write_atomically(path, render_page(report, drawn=drawn).encode())


def draw_cases(report: ReportContents, *, most_bytes: int = MAX_BYTES) -> dict[str, DrawnCase]:
    """Draw as many cases as the page has room for, by id.

    Args:
        report: what the page says.
        most_bytes: size of all cases and the table of trials together.
    """
    table = pack_trials(report.table) if report.table is not None else ""
    return _draw_cases(_by_urgency(report), most_bytes - len(table))


def render_page(report: ReportContents, *, drawn: Mapping[str, DrawnCase] | None = None) -> str:
    """Render the page as HTML text.

    Args:
        report: what it says.
        drawn: the cases that it shows, as of :func:`draw_cases`; it only counts the others. None:
            those that there is room for.
    """
    table = pack_trials(report.table) if report.table is not None else ""
    drawn = draw_cases(report) if drawn is None else drawn
    trials, floor = report.trials, report.floor
    return template("page.html").render(
        report=report,
        style=own_text("report.css"),
        colours=Markup(css_variables()),
        trial_data=Markup(table),
        script=_script(has_table=bool(table), has_replay=bool(drawn)),
        undrawn=_undrawn,
        scores=time_charts.draw_scores(trials) if trials and trials.numbers else "",
        progress=time_charts.draw_progress(trials)
        if trials and any(trials.failed) and len(trials.numbers) > 1
        else "",
        situations=time_charts.draw_situations(trials)
        if trials and len(trials.situations) > 1
        else "",
        importances=draw_importances(report.importances) if report.importances else "",
        slices=_draw_slices(report),
        coverage=floor_drawings.draw_coverage(floor, trials)
        if floor and trials and trials.numbers
        else "",
        drawn=drawn,
        costmaps=_name_costmaps(drawn.values()),
    )


def template(name: str) -> jinja2.Template:
    """Load one of our own templates; what it is given is escaped."""
    return _environment().get_template(name)


def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("reports", "templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["violation_sentence"] = violation_sentence
    environment.filters["consequence_sentence"] = consequence_sentence
    environment.filters["account_sentences"] = account_sentences
    environment.filters["robustness"] = robustness_text
    environment.filters["evidence"] = evidence_text
    environment.filters["moment_name"] = moment_name
    return environment


def own_text(name: str) -> Markup:
    """Read a file of our own templates, to be put into the page unescaped."""
    return Markup((Path(__file__).parent / "templates" / name).read_text(encoding="utf-8"))


def _script(*, has_table: bool, has_replay: bool) -> Markup:
    names = ["page.js"] + ["table.js"] * has_table + ["replay.js"] * has_replay
    return Markup("\n").join(own_text(name) for name in names)


def _draw_slices(report: ReportContents) -> list[tuple[str, Markup]]:
    """Draw slices of the most important parameters, each with its name."""
    if report.trials is None:
        return []
    drawn = [(one.name, draw_slice(one, report.trials)) for one in report.importances[:MAX_SLICES]]
    return [(name, plot) for name, plot in drawn if plot is not None]


def _undrawn(modes: Iterable[Mode], drawn: Mapping[str, DrawnCase]) -> list[Mode]:
    """List the modes of which no case is drawn."""
    return [mode for mode in modes if not mode.cases or mode.cases[0].id not in drawn]


def _by_urgency(report: ReportContents) -> list[CaseContents]:
    """List the cases to draw: the first of each mode, then the second of each, and so on."""
    if report.run is not None:
        return [report.run] if report.run.trace.columns else []
    most = max((len(mode.cases) for mode in report.modes), default=0)
    return [mode.cases[i] for i in range(most) for mode in report.modes if i < len(mode.cases)]


def _draw_cases(cases: Iterable[CaseContents], most_bytes: int) -> dict[str, DrawnCase]:
    """Draw as many cases as fit, by id; at least one."""
    drawn: dict[str, DrawnCase] = {}
    room = most_bytes
    for case in cases:
        found = draw_case(case)
        room -= found.size
        if room < 0 and drawn:
            break
        drawn[case.id] = found
    return drawn


def _name_costmaps(drawn: Iterable[DrawnCase]) -> dict[str, str]:
    """Map the data address of each different costmap picture to its id in the page."""
    shown = [run for case in drawn for run in (case.main, case.minimised) if run is not None]
    runs = [run for one in shown for run in one.runs()]
    uris = [run.costmap.uri for run in runs if run.costmap is not None]
    return {uri: f"costmap-{i}" for i, uri in enumerate(dict.fromkeys(uris))}
