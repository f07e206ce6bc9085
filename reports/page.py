"""The HTML page of a campaign or a run: one file that opens from disk and needs no network."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import jinja2
from markupsafe import Markup

from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.world import World
from reports import floor_drawings, time_charts
from reports.case_drawings import DrawnCase, draw_case, moment_name
from reports.colours import css_variables
from reports.contents import CaseContents, Mode, ReportContents, TrialScores
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnPage:
    """What a page shows beside its sentences: drawings and packed data, empty where there are none.

    It holds as many cases as there is room for; the page only counts the others.
    """

    cases: dict[str, DrawnCase]  #: by id
    trials: Markup  #: the table of all trials, packed
    scores: Markup
    progress: Markup  #: failures found so far
    situations: Markup  #: seen so far
    importances: Markup  #: of parameters
    slices: tuple[tuple[str, Markup], ...]  #: name of a parameter, and scores over it
    coverage: Markup  #: where trials came closest to trouble

    def costmaps(self) -> dict[str, str]:
        """Map the data address of each different costmap picture to its id in the page."""
        shown = [run for one in self.cases.values() for run in (one.main, one.minimised) if run]
        uris = [run.costmap.uri for one in shown for run in one.runs() if run.costmap is not None]
        return {uri: f"costmap-{i}" for i, uri in enumerate(dict.fromkeys(uris))}


def draw_page(report: ReportContents, *, most_bytes: int = MAX_BYTES) -> DrawnPage:
    """Draw what a page shows.

    Args:
        report: what it says.
        most_bytes: size of all cases and the table of trials together.
    """
    table = pack_trials(report.table) if report.table is not None else ""
    return DrawnPage(
        cases=_draw_cases(_by_urgency(report), most_bytes - len(table)),
        trials=Markup(table),
        slices=_draw_slices(report),
        importances=draw_importances(report.importances) if report.importances else Markup(),
        **_draw_search(report.trials, report.floor),
    )


def _draw_search(trials: TrialScores | None, floor: World | None) -> dict[str, Markup]:
    """Draw how a search went, by the names of :class:`DrawnPage`."""
    if trials is None or not trials.numbers:
        return dict.fromkeys(("scores", "progress", "situations", "coverage"), Markup())
    has_progress = any(trials.failed) and len(trials.numbers) > 1
    has_situations = len(trials.situations) > 1
    return {
        "scores": time_charts.draw_scores(trials),
        "progress": time_charts.draw_progress(trials) if has_progress else Markup(),
        "situations": time_charts.draw_situations(trials) if has_situations else Markup(),
        "coverage": floor_drawings.draw_coverage(floor, trials) if floor else Markup(),
    }


def write_page(report: ReportContents, path: Path, *, drawn: DrawnPage | None = None) -> None:
    """Write the page.

    Args:
        report: what it says.
        path: the HTML file.
        drawn: what it shows; drawn here if None.

    Raises:
        PlaceError: the file cannot be written.
    """
    write_atomically(path, render_page(report, drawn=drawn).encode())


def render_page(report: ReportContents, *, drawn: DrawnPage | None = None) -> str:
    """Render the page as HTML text.

    Args:
        report: what it says.
        drawn: what it shows; drawn here if None.
    """
    drawn = draw_page(report) if drawn is None else drawn
    return template("page.html").render(
        report=report,
        page=drawn,
        drawn=drawn.cases,
        costmaps=drawn.costmaps(),
        undrawn=_undrawn,
        style=own_text("report.css"),
        colours=Markup(css_variables()),
        script=_script(has_table=bool(drawn.trials), has_replay=bool(drawn.cases)),
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


def _draw_slices(report: ReportContents) -> tuple[tuple[str, Markup], ...]:
    """Draw slices of the most important parameters, each with its name."""
    if report.trials is None:
        return ()
    drawn = [(one.name, draw_slice(one, report.trials)) for one in report.importances[:MAX_SLICES]]
    return tuple((name, plot) for name, plot in drawn if plot is not None)


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
