"""The command ``ci``: run what has changed, and write its report."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mrta_falsify.commands.campaign import OnFeedback
from mrta_falsify.commands.ci.project import PROJECT_NAME, read_project
from mrta_falsify.commands.ci.reporting import contents_of, junit_of
from mrta_falsify.commands.ci.running import CellOutcome, CiResult, run_project
from mrta_falsify.commands.ci.what_runs import of_project
from mrta_falsify.commands.folders import Place, make_directory
from mrta_falsify.commands.trust import Trust, permit
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.errors import PlaceError
from mrta_falsify.core.renamed import renamed_keywords
from reports.markdown import render_markdown
from reports.page import write_page

PAGE_NAME = "report.html"  # in what is kept


@renamed_keywords(on_told="on_feedback")
def ci(
    project: Place = PROJECT_NAME,
    output: Place | None = None,
    *,
    junit: Place | None = None,
    markdown: Place | None = None,
    everything: bool = False,
    workers: int | None = None,
    trust: Trust = False,
    on_cell: Callable[[CellOutcome], None] = lambda cell: None,
    on_feedback: OnFeedback = lambda record, progress: None,
) -> CiResult:
    """Run what has changed since the last run of a project, and write what became of its findings.

    A cell is a scenario or a corpus on a stack. One that has changed has its known failures run
    again, and its scenario searched.

    Args:
        project: the project file, or its directory.
        output: the page; ``report.html`` in what the project keeps if None.
        junit: also as JUnit XML.
        markdown: also as Markdown.
        everything: run cells that have not changed, too.
        workers: processes; one per core if None. They change no result.
        trust: run what is not ours and the project names: its programs, stacks and components.
        on_cell: called with each cell before it runs, or is left out.
        on_feedback: called with each trial of a search.

    Raises:
        InputError: something that the project names is wrong.
        PlaceError: a file cannot be written; finished trials and re-runs are kept.
        Interrupted: Ctrl-C; finished trials and re-runs are kept for the next call.
    """
    read = read_project(project)
    permit(read.path, of_project(read), trust)
    page = Path(output) if output is not None else read.kept / PAGE_NAME
    places = [Path(place) for place in (page, junit, markdown) if place is not None]
    for place in places:
        make_directory(place.parent)

    def write(result: CiResult) -> None:
        contents = contents_of(read, result)
        write_page(contents, page)
        if junit is not None:
            write_atomically(Path(junit), junit_of(read, result).encode())
        if markdown is not None:
            write_atomically(Path(markdown), render_markdown(contents).encode())

    try:
        return run_project(
            read,
            everything=everything,
            workers=workers,
            trust=trust,
            on_cell=on_cell,
            on_feedback=on_feedback,
            on_result=write,
        )
    except PlaceError as error:
        error.then = "call ci again (finished trials and re-runs are kept)"
        raise
