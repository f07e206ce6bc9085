"""One self-contained HTML page of a run: no script, no address of another machine."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from pathlib import Path

import jinja2
import yaml

from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import StackEvent
from reports.colours import robot_colour
from reports.figure_panel import robustness_text
from reports.run_view import RunView

MAX_EVENTS = 2000  # rows of the event table; a four-hour shift has more than a page can show
MAX_EVIDENCE = 4000  # characters


@dataclass(frozen=True, slots=True, kw_only=True)
class _TaskRow:
    number: int
    start: str
    end: str
    arrival: float
    deadline: float
    robot: str
    colour: str
    picked_up: str
    dropped_off: str
    state: str  #: "in time", "late" or "not delivered"


@dataclass(frozen=True, slots=True, kw_only=True)
class _EventRow:
    time: float
    kind: str
    robot: str
    task: str
    resource: str
    detail: str


def write_page(
    view: RunView,
    path: Path,
    *,
    picture: Path,
    command: str,
    config: StackConfig,
    versions: dict[str, str],
    animation: Path | None = None,
) -> None:
    """Write the page of one run.

    Args:
        view: what was run and how it was judged.
        path: the HTML file.
        picture: PNG to embed.
        command: what reproduces the run.
        config: the stack that was run.
        versions: of the libraries the digests depend on.
        animation: GIF to embed, if there is one.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("reports", "templates"),
        autoescape=True,
        trim_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["robustness"] = robustness_text
    environment.filters["evidence"] = _evidence_text
    trace = view.trace
    page = environment.get_template("run.html").render(
        world=view.world,
        headline=headline(view),
        violated=any(verdict.violated for verdict in view.verdicts),
        facts=view.facts,
        verdicts=view.verdicts,
        picture=_data_uri(picture, "image/png"),
        animation=_data_uri(animation, "image/gif") if animation is not None else "",
        tasks=_task_rows(view),
        events=[_event_row(view, event) for event in trace.events[:MAX_EVENTS]],
        event_count=len(trace.events),
        command=command,
        stack=yaml.safe_dump(codec.encode(config), sort_keys=False),
        versions="\n".join(f"{name} {number}" for name, number in sorted(versions.items())),
    )
    path.write_text(page, encoding="utf-8")


def headline(view: RunView) -> str:
    """The result of a run in one line."""
    broken = [verdict.spec for verdict in view.verdicts if verdict.violated]
    if broken:
        return f"{len(broken)} of {len(view.verdicts)} specifications violated: {', '.join(broken)}"
    return f"all {len(view.verdicts)} specifications hold"


def _data_uri(path: Path, kind: str) -> str:
    return f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"


def _evidence_text(evidence: dict[str, object]) -> str:
    text = json.dumps(codec.encode(evidence), indent=1, sort_keys=True)
    return text if len(text) <= MAX_EVIDENCE else text[:MAX_EVIDENCE] + "\n..."


def _task_rows(view: RunView) -> list[_TaskRow]:
    picked: dict[int, StackEvent] = {}
    dropped: dict[int, StackEvent] = {}
    for event in view.trace.events:
        if event.kind == "picked-up":
            picked.setdefault(event.task, event)
        elif event.kind == "dropped-off":
            dropped.setdefault(event.task, event)
    rows = []
    for number, task in enumerate(view.world.tasks):
        up, down = picked.get(number), dropped.get(number)
        carrier = down or up
        if down is None:
            state = "not delivered"
        else:
            state = "in time" if down.time <= task.deadline else "late"
        rows.append(
            _TaskRow(
                number=number,
                start=_room(view, task.start),
                end=_room(view, task.end),
                arrival=task.arrival,
                deadline=task.deadline,
                robot=_robot(view, carrier.robot) if carrier else "",
                colour=robot_colour(carrier.robot) if carrier else "",
                picked_up=f"{up.time:.1f} s" if up else "",
                dropped_off=f"{down.time:.1f} s" if down else "",
                state=state,
            )
        )
    return rows


def _event_row(view: RunView, event: StackEvent) -> _EventRow:
    detail = event.detail
    if event.other >= 0:
        detail = f"{_robot(view, event.other)} {detail}".strip()
    return _EventRow(
        time=event.time,
        kind=event.kind,
        robot=_robot(view, event.robot),
        task=str(event.task) if event.task >= 0 else "",
        resource=event.resource,
        detail=detail,
    )


def _robot(view: RunView, number: int) -> str:
    robots = view.world.robots
    return robots[number].name if 0 <= number < len(robots) else ""


def _room(view: RunView, number: int) -> str:
    name = view.world.rooms[number].name
    return str(number) if name in ("", str(number)) else f"{number} {name}"
