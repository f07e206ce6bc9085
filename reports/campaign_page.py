"""The report of a campaign: one HTML file that opens from disk and asks nobody for anything."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup
from PIL import Image

from mrta_falsify.core import task_history as errands
from mrta_falsify.core.costmap import INSCRIBED, LETHAL, UNKNOWN, Costmap
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.verdict import Verdict
from reports import drawings, packing
from reports import time_charts as charts
from reports.colours import costmap_colours
from reports.contents import Case, Report
from reports.sentences import edge_sentence, sentence

MOST_BYTES = 4_500_000  # of the cases of a page, so that it stays under 5 MB
COSTMAP_STEP = 21  # cost values that share a colour


def write_report(report: Report, path: Path, *, most_bytes: int = MOST_BYTES) -> None:
    """Write the page.

    Args:
        report: what it says.
        path: the HTML file.
        most_bytes: see :func:`render`.

    Raises:
        FormatError: it cannot be written.
    """
    try:
        path.write_text(render(report, most_bytes=most_bytes), encoding="utf-8")
    except OSError as error:
        raise FormatError(f"{path}: cannot be written: {error.strerror}") from None


def render(report: Report, *, most_bytes: int = MOST_BYTES) -> str:
    """The page as HTML text.

    Args:
        report: what it says.
        most_bytes: size of its cases in all; those for which there is no room are only counted.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("reports", "templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["sentence"] = sentence
    environment.filters["edge_sentence"] = edge_sentence
    trials = report.trials
    drawn = _drawn_cases(report, most_bytes)
    return environment.get_template("report.html").render(
        report=report,
        style=_own_text("report.css"),
        script=_own_text("replay.js") if drawn else "",
        scores=charts.scores(trials.numbers, trials.scores, trials.failed)
        if trials.numbers
        else "",
        coverage=drawings.coverage(report.floor, trials.places, trials.failed)
        if report.floor is not None and trials.numbers
        else "",
        drawn=drawn,
        costmaps=_costmaps(drawn),
    )


def _drawn_cases(report: Report, most_bytes: int) -> dict[str, DrawnCase]:
    """Cases by id, drawn, as far as there is room: of each mode the first, then the second."""
    most = max((len(mode.cases) for mode in report.modes), default=0)
    queue = [mode.cases[i] for i in range(most) for mode in report.modes if i < len(mode.cases)]
    drawn: dict[str, DrawnCase] = {}
    room = most_bytes
    for case in queue:
        found = DrawnCase(
            main=draw_case(case),
            minimised=draw_case(case.minimised) if case.minimised is not None else None,
        )
        room -= found.size
        if room < 0 and drawn:
            break
        drawn[case.id] = found
    return drawn


def _costmaps(drawn: dict[str, DrawnCase]) -> dict[str, str]:
    """Names of the different costmap pictures, by data address."""
    parts = [part for case in drawn.values() for part in (case.main, case.minimised) if part]
    uris = [part["costmap"]["uri"] for part in parts if part["costmap"]]
    return {uri: f"costmap-{i}" for i, uri in enumerate(dict.fromkeys(uris))}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnCase:
    """Drawings and data of a case and of its smallest world, by name, for the template."""

    main: dict[str, Any]
    minimised: dict[str, Any] | None

    @property
    def size(self) -> int:
        """Bytes of what was drawn."""
        return sum(_size(part) for part in (self.main, self.minimised) if part is not None)


def _size(part: Any) -> int:
    if isinstance(part, str):
        return len(part)
    rows = (
        part.values() if isinstance(part, dict) else part if isinstance(part, (list, tuple)) else ()
    )
    return sum(_size(row) for row in rows)


def _own_text(name: str) -> Markup:
    """A file of our own templates, to be put into the page as it is."""
    return Markup((Path(__file__).parent / "templates" / name).read_text(encoding="utf-8"))


def draw_case(case: Case) -> dict[str, Any]:
    """Drawings and data of a case, by name, for the template."""
    violated = [verdict for verdict in case.verdicts if verdict.violated]
    edges, members = cycle_of(violated)
    found = min((v.violated_at for v in violated if v.violated_at is not None), default=0.0)
    onset = next(
        (v.evidence["onset"] for v in violated if isinstance(v.evidence.get("onset"), float)), found
    )
    tasks = errands.tasks_of(violated[0]) if violated else []
    who = members or [name for v in violated[:1] for name in v.who if name in case.trace.robots]
    who = who or errands.robots_of(tasks, case.trace)
    return {
        "violated": violated,
        "edges": edges,
        "errands": errands.stories(tasks, case.world, case.trace),
        "members": members,
        "data": Markup(packing.pack(case.world, case.trace, case.verdicts)),
        "begin": max(0.0, onset - 10.0),
        "jumps": _jumps(onset, found, bool(members), case.trace.duration),
        "place": place_of(violated, case, who),
        "close": any("place" in verdict.evidence for verdict in violated[:1]),
        "graph": drawings.wait_for_graph(edges, case.world) if edges else "",
        "moment": drawings.moment(case.world, case.trace, found, edges, members=who),
        "timelines": charts.timelines(case.trace, [(t, name) for name, t in _marks(onset, found)]),
        "signals": charts.signals(case.trace, violated, who),
        "costmap": costmap_picture(case.costmap) if case.costmap is not None else None,
    }


def _marks(onset: float, found: float) -> list[tuple[str, float]]:
    return [("found", found)] if onset == found else [("onset", onset), ("found", found)]


def _jumps(onset: float, found: float, deadlock: bool, end: float) -> list[tuple[str, float]]:
    jumps = [("start", 0.0)]
    if deadlock:
        jumps += [("before onset", max(0.0, onset - 10.0)), ("onset", onset)]
    return [*jumps, ("found", found), ("end", end)]


def cycle_of(violated: Sequence[Verdict]) -> tuple[list[dict[str, str]], list[str]]:
    """Edges and members of the deadlock among ``violated``, empty if there is none."""
    for verdict in violated:
        if verdict.spec == "no_deadlock":
            return list(verdict.evidence.get("cycle", [])), list(verdict.who)
    return [], []


def place_of(violated: Sequence[Verdict], case: Case, who: Sequence[str]) -> str:
    """``x,y`` [m] of a close-up, empty if nothing has a place."""
    for verdict in violated:
        place = verdict.evidence.get("place")
        if isinstance(place, dict) and "x" in place:
            return f"{float(place['x']):.2f},{float(place['y']):.2f}"
    if not who:
        return ""
    number = case.trace.robots.index(who[0])
    found = violated[0].violated_at if violated else None
    tick = len(case.trace) - 1 if found is None else round(found / case.trace.dt)
    x, y = case.trace.columns["pose"][min(tick, len(case.trace) - 1), number, :2]
    return f"{x:.2f},{y:.2f}"


def costmap_picture(costmap: Costmap) -> dict[str, str]:
    """The costmap as a PNG data address, with its extent in the map frame [m]."""
    # 13 steps of inflation and the three special values: four bits a cell
    step = np.minimum(np.arange(256) // COSTMAP_STEP, 12).astype(np.uint8)
    step[[INSCRIBED, LETHAL, UNKNOWN]] = 13, 14, 15
    shown = [*range(0, 13 * COSTMAP_STEP, COSTMAP_STEP), INSCRIBED, LETHAL, UNKNOWN]
    image = Image.fromarray(step[costmap.cost][::-1], "P")
    image.putpalette(costmap_colours()[shown].tobytes())
    buffer = io.BytesIO()
    image.save(buffer, "PNG", bits=4)
    rows, cols = costmap.cost.shape
    x, y = (float(value) for value in costmap.origin)
    extent = (x, y, x + cols * costmap.resolution, y + rows * costmap.resolution)
    return {
        "uri": "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode(),
        "extent": ",".join(f"{value:.3f}" for value in extent),
    }
