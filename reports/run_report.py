"""The report of a single run: a report of one case."""

from __future__ import annotations

import base64
import bisect
from collections.abc import Mapping, Sequence
from pathlib import Path

from mrta_falsify.core.fleet import StackEvent
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.specs.attribution import guess
from mrta_falsify.specs.books import confirmed
from mrta_falsify.specs.causes import by_cause, cause_begins, leading
from reports.contents import CaseContents, EmbeddedImage, ReportContents, RunView, Table
from reports.sentences import beside_sentences, guess_text

MAX_EVENTS = 2000  # rows of the event table; an eight-hour shift has nine times as many
MAX_TASKS = 60  # rows of a task table that is shown unasked
IMAGE_KINDS = {".png": "image/png", ".gif": "image/gif"}


def report_of_run(
    view: RunView,
    *,
    command: str,
    stack: str,
    versions: Mapping[str, str],
    picture: Path,
    animation: Path | None = None,
    whole: bool = False,
) -> ReportContents:
    """Collect what the page of one run says.

    Args:
        view: what was run and how it was judged.
        command: what reproduces the run.
        stack: YAML of the stack that was run.
        versions: of the libraries that the digests depend on.
        picture: PNG to embed.
        animation: GIF to embed, if there is one.
        whole: the stack's layers are not known.
    """
    first = leading(view.verdicts)
    found = guess(view.verdicts, view.trace, whole=whole)
    case = CaseContents(
        id=view.world.name,
        signature="",
        world=view.world,
        trace=view.trace,
        verdicts=by_cause(view.verdicts),
        facts=(),
        commands=(("Run it again", command),),
        costmap=view.costmap,
        layer=found.layer,
        layer_evidence=guess_text(found, first, view.trace) if first is not None else "",
    )
    around = cause_begins(first) if first is not None else 0.0
    images = [embed(picture, "From above", "floor plan with the ways of all robots and people")]
    if animation is not None:
        images.append(embed(animation, "Animation", "the run as an animation"))
    return ReportContents(
        title=view.world.name,
        headline=run_headline(view.verdicts),
        notes=beside_sentences(view.verdicts),
        facts=view.facts,
        run=case,
        stack=stack,
        versions=tuple(sorted(versions.items())),
        tables=(task_table(view.world, view.trace), event_table(view.trace, around)),
        images=tuple(images),
    )


def run_headline(verdicts: Sequence[Verdict]) -> str:
    """State the result of a run in one line."""
    broken = [verdict.spec for verdict in verdicts if verdict.violated]
    unjudged = [verdict.spec for verdict in verdicts if verdict.not_judged]
    if broken:
        return f"{len(broken)} of {len(verdicts)} specifications violated: {', '.join(broken)}"
    if unjudged:
        holding = len(verdicts) - len(unjudged)
        return (
            f"{holding} of {len(verdicts)} specifications hold; not judged: {', '.join(unjudged)}"
        )
    return f"all {len(verdicts)} specifications hold"


def embed(path: Path, title: str, alt: str) -> EmbeddedImage:
    """Read a picture (PNG or GIF) to be put into a page."""
    data = base64.b64encode(path.read_bytes()).decode()
    return EmbeddedImage(title=title, uri=f"data:{IMAGE_KINDS[path.suffix]};base64,{data}", alt=alt)


def task_table(world: World, trace: Trace) -> Table:
    """List the tasks of a run: who had each, when it was picked up and delivered."""
    first: dict[tuple[str, int], StackEvent] = {}
    for event in confirmed(trace, world).events:
        first.setdefault((event.kind, event.task), event)
    rows = []
    for number, task in enumerate(world.tasks):
        up, down = first.get(("picked-up", number)), first.get(("dropped-off", number))
        carrier = down or up
        state = "not delivered"
        if down is not None:
            state = "in time" if down.time <= task.deadline else "late"
        rows.append(
            (
                str(number),
                _room(world, task.start),
                _room(world, task.end),
                f"{task.arrival:.0f} s",
                _robot(trace, carrier.robot) if carrier else "",
                f"{up.time:.1f} s" if up else "",
                f"{down.time:.1f} s" if down else "",
                f"{task.deadline:.0f} s",
                state,
            )
        )
    columns = ("task", "from", "to", "known at", "robot", "picked up", "delivered", "due", "state")
    many = len(rows) > MAX_TASKS
    title = f"Tasks ({len(rows)})" if many else "Tasks"
    return Table(title=title, columns=columns, rows=tuple(rows), folded=many)


def event_table(trace: Trace, around: float = 0.0) -> Table:
    """List what the stack reported, in order; if that is too much, what was near a time.

    Args:
        trace: of the run.
        around: time [s] in the middle of what is shown, inf: the end.
    """
    events, count = trace.events, len(trace.events)
    middle = bisect.bisect_left(events, around, key=lambda event: event.time)
    begin = max(0, min(middle - MAX_EVENTS // 2, count - MAX_EVENTS))
    shown = events[begin : begin + MAX_EVENTS]
    title = f"Events ({count})"
    if len(shown) < count:
        title = f"Events ({shown[0].time:.0f} to {shown[-1].time:.0f} s, {len(shown)} of {count})"
    return Table(
        title=title,
        columns=("time", "event", "robot", "task", "resource", "detail"),
        rows=tuple(_event_row(trace, event) for event in shown),
        folded=True,
    )


def _event_row(trace: Trace, event: StackEvent) -> tuple[str, ...]:
    return (
        f"{event.time:.2f} s",
        event.kind,
        _robot(trace, event.robot),
        str(event.task) if event.task >= 0 else "",
        event.resource,
        f"{_robot(trace, event.other)} {event.detail}".strip(),
    )


def _robot(trace: Trace, number: int) -> str:
    return trace.robots[number] if 0 <= number < len(trace.robots) else ""


def _room(world: World, number: int) -> str:
    name = world.rooms[number].name
    return str(number) if name in ("", str(number)) else f"{number} {name}"
