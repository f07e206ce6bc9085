"""Run the full stack in one world, judge it, and write what the run leaves behind."""

from __future__ import annotations

import dataclasses
import json
import math
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from mrta_falsify.commands.folders import Place, make_directory
from mrta_falsify.commands.stacks import Stack, costmap_of, load_stack
from mrta_falsify.commands.worlds import FoundWorld, find_world_and_scene
from mrta_falsify.core import codec
from mrta_falsify.core.codec import finite, later
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.durable import staged, write_atomically
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.external import Coupling
from mrta_falsify.core.interruption import describe_interrupt
from mrta_falsify.core.record import versions
from mrta_falsify.core.stack_failure import MEMORY_LIMIT, TICK_LIMIT, StackLimits
from mrta_falsify.core.tight_ways import TightWay
from mrta_falsify.core.trace import write_trace
from mrta_falsify.core.verdict import Verdict, VerdictOutcome
from mrta_falsify.core.world import World, write_world
from mrta_falsify.possibility import Possibility, look_at
from mrta_falsify.specs.causes import leading
from mrta_falsify.specs.library import default_specifications, spec_names
from mrta_falsify.trial import Job, run_job
from reports.contents import RunView
from reports.sentences import coupling_facts, violation_sentence
from simulator_interface import starts
from simulator_interface.guard import guarded

if TYPE_CHECKING:
    from simulator_interface.simulate import Outcome, TaskCount

UNTOLD = "the stack does not tell"
#: files of a run; it is there if its verdicts are
VERDICTS = "verdicts.json"
OTHER_FILES = (
    "world.json",
    "stack.yaml",
    "trace.zip",
    "picture.png",
    "report.html",
    "run.gif",
    "run.mp4",
)
SHOW_WINDOW = "engine.gui=true"  # the setting that ``--gui`` stands for


def run(
    world: World | FoundWorld | Place,
    stack: Stack | None = None,
    *,
    settings: Sequence[str] = (),
    seed: int | None = None,
    tasks: Place | None = None,
    robots: Place | None = None,
    humans: Place | None = None,
    specs: str | Sequence[str] = (),
    tick_limit: float = TICK_LIMIT,
    memory_limit: float = MEMORY_LIMIT,
    output: Place | None = None,
    gui: bool = False,
    gif: bool = False,
    mp4: bool = False,
    keep_trace: bool = True,
    on_progress: Callable[[float], None] | None = None,
) -> Outcome:
    """Run the full stack in ``world`` and judge it.

    Args:
        world: what to simulate, as of :func:`~mrta_falsify.commands.worlds.find_world`, or what
            ``find_world_and_scene`` found.
        stack: the stack under test, or its YAML file; the default stack if None.
        settings: ``--set`` texts applied to the stack.
        seed: varies a fixed world, or samples a program.
        tasks: MRTA-Sim testcase that replaces the tasks.
        robots: MRTA-Sim robot setup that replaces the robots.
        humans: MRTA-Sim waypoint file that replaces the people.
        specs: names of specifications, or ``stl:FORMULA``; all that ship if empty.
        tick_limit: CPU time for one tick [s], after which the stack hangs.
        memory_limit: resident memory that the stack may take up [GiB].
        output: directory for the files of :func:`write_run`; none are written if None.
        gui: show the physics engine's window.
        gif: also write an animation to ``output``.
        mp4: also write a video to ``output``.
        keep_trace: False keeps only the trace's digest.
        on_progress: called about once per simulated second with the time [s].

    Raises:
        InputError: the world cannot be run, or a name is unknown.
        Interrupted: Ctrl-C; there is no verdict, and nothing is written.
    """
    if (gif or mp4) and output is None:
        raise ConfigError("gif and mp4 need an output directory")
    config = load_stack(stack, (*settings, SHOW_WINDOW) if gui else settings)
    if not isinstance(world, FoundWorld):
        world = find_world_and_scene(world, seed=seed, tasks=tasks, robots=robots, humans=humans)
    if output is not None:
        make_directory(Path(output))
    starts.check_starts(world.world)
    job = Job(
        world=world.world,
        config=config,
        specifications=spec_names(specs) or default_specifications(),
        scene=world.scene,
        limits=StackLimits(tick=tick_limit, memory=memory_limit),
    )
    clock = _Clock(world.world, on_progress)
    with describe_interrupt(clock.state), guarded():
        outcome = run_job(job, keep_trace=keep_trace, on_progress=clock.show)
        if output is not None:
            write_run(outcome, world.world, output, config=config, gif=gif, mp4=mp4)
    return outcome


class _Clock:
    """Knows how far a run has come."""

    def __init__(self, world: World, on_progress: Callable[[float], None] | None) -> None:
        self._time = 0.0
        self._world = world
        self._on_progress = on_progress

    def show(self, time: float) -> None:
        self._time = time
        if self._on_progress is not None:
            self._on_progress(time)

    def state(self) -> tuple[str, str]:
        horizon = f"of at most {self._world.horizon:.0f} s"
        came = f"{self._world.name} came to {self._time:.0f} s {horizon}"
        return "nothing", f"{came} and has no verdict; the same command begins anew"


# --- what is printed ---------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictSummary:
    """A verdict in one line."""

    spec: str
    robustness: float | None  #: null where it is unbounded or was not judged
    violated: bool
    violated_at_s: float | None
    who: tuple[str, ...]
    outcome: VerdictOutcome
    not_judged: str  #: what was missing to judge it; empty: it was judged
    evidence: dict[str, Any] = field(default_factory=dict)  #: empty unless violated


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSummary:
    """What ``run --format json`` prints of a run."""

    world_digest: str
    trace_digest: str
    sim_time_s: float
    wall_s: float
    real_time_factor: float  #: simulated time over wall-clock time
    tasks: TaskCount
    robots: int
    robots_finished: int  #: robots with nothing on board and no open task
    #: by pair; ``robot_human_at_rest``: people who walked into a robot at rest
    contacts: dict[str, int]
    verdicts: tuple[VerdictSummary, ...]
    #: ``all-tasks-done`` or ``horizon``; ``stack-crashed``, ``stack-hung``, ``stack-took-memory``
    #: or ``stack-answered-nonsense`` of a foreign stack
    ended: str
    seed: int | None = None  #: that varied or sampled the world
    stack_digest: str = ""
    output: str = later("")  #: directory of the files, if any were written
    stack_failure: str = later("")  #: how the stack failed to answer, in words
    #: foreign stack: whether it is asked or runs by itself
    coupling: Coupling | None = later(None)
    #: ways that a task needs and that are too narrow for every robot that may serve it
    shut: tuple[TightWay, ...] = later(())
    impossible: str = later("")  #: why no stack can do the world
    #: what is narrow, and furniture that does not fit to where it is to be pushed
    notes: tuple[str, ...] = later(())


def summarise_run(
    outcome: Outcome,
    *,
    world: World | None = None,
    config: StackConfig | None = None,
    seed: int | None = None,
    output: Place | None = None,
) -> RunSummary:
    """Sum a run up.

    Args:
        outcome: of :func:`run`.
        world: that was run; None: whether a stack can do it is not said.
        config: the stack that was run; the default stack if None.
        seed: that varied or sampled the world.
        output: directory of the files, if any were written.
    """
    specifications = [verdict.spec for verdict in outcome.verdicts]
    possible = look_at(world, specifications) if world is not None else Possibility()
    return RunSummary(
        world_digest=outcome.trace.world_digest,
        trace_digest=outcome.trace.digest,
        sim_time_s=round(outcome.sim_time, 6),
        wall_s=round(outcome.wall_s, 3),
        real_time_factor=round(outcome.sim_time / max(outcome.wall_s, 1e-9), 2),
        tasks=outcome.tasks,
        robots=len(outcome.trace.robots),
        robots_finished=outcome.robots_finished,
        contacts=dict(outcome.contacts),
        verdicts=tuple(map(_summarise_verdict, outcome.verdicts)),
        ended=outcome.ended,
        seed=seed,
        stack_digest=(config or StackConfig()).digest(),
        output=str(output) if output is not None else "",
        coupling=outcome.coupling,
        stack_failure=" ".join(
            violation_sentence(verdict)
            for verdict in outcome.verdicts
            if verdict.violated and verdict.spec in ("stack_runs", "repeatable")
        ),
        shut=possible.shut,
        impossible=possible.reason,
        notes=possible.notes,
    )


def _summarise_verdict(verdict: Verdict) -> VerdictSummary:
    is_known = math.isfinite(verdict.robustness) and not verdict.not_judged
    return VerdictSummary(
        spec=verdict.spec,
        robustness=verdict.robustness if is_known else None,
        violated=verdict.violated,
        violated_at_s=verdict.violated_at,
        who=verdict.who,
        outcome=verdict.outcome,
        not_judged=verdict.not_judged,
        evidence=verdict.evidence if verdict.violated else {},
    )


# --- files -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFiles:
    """Where the files of one run are."""

    directory: Path
    world: Path
    stack: Path
    trace: Path
    verdicts: Path
    picture: Path
    report: Path
    gif: Path | None = None
    mp4: Path | None = None


def write_run(
    outcome: Outcome,
    world: World,
    directory: Path | str,
    *,
    config: StackConfig | None = None,
    gif: bool = False,
    mp4: bool = False,
    again: str = "",
) -> RunFiles:
    """Write everything a run leaves behind.

    Args:
        outcome: of :func:`run` on ``world``.
        world: the world that was run.
        directory: made if it does not exist; files of an earlier run are replaced.
        config: the stack that was run; the default stack if None.
        gif: also write an animation.
        mp4: also write a video.
        again: command that makes the run again; empty: it runs the world on the stack.

    Returns:
        Paths of world.json, stack.yaml, trace.zip, verdicts.json, picture.png, report.html.

    Raises:
        InputError: the directory cannot be made.
        PlaceError: a file cannot be written; those of an earlier run are as before.
    """
    config = config or StackConfig()
    folder = make_directory(Path(directory))
    files = _files_in(folder, gif=gif, mp4=mp4)
    with staged(folder, mark=VERDICTS, others=OTHER_FILES) as stage:
        written = _files_in(stage, gif=gif, mp4=mp4)
        _write_files(outcome, world, config, written=written, kept=files, again=again)
    return files


def _files_in(folder: Path, *, gif: bool, mp4: bool) -> RunFiles:
    world, stack, trace, picture, report, animation, video = (folder / name for name in OTHER_FILES)
    return RunFiles(
        directory=folder,
        world=world,
        stack=stack,
        trace=trace,
        verdicts=folder / VERDICTS,
        picture=picture,
        report=report,
        gif=animation if gif else None,
        mp4=video if mp4 else None,
    )


def _write_files(
    outcome: Outcome,
    world: World,
    config: StackConfig,
    *,
    written: RunFiles,
    kept: RunFiles,
    again: str,
) -> None:
    """Write the files of a run to ``written``; the report names them as ``kept``."""
    from reports import animation, page, run_picture  # noqa: PLC0415 - matplotlib loads slowly
    from reports.run_report import report_of_run  # noqa: PLC0415

    write_world(world, written.world)
    stack = yaml.safe_dump(codec.encode(config), sort_keys=False)
    write_atomically(written.stack, stack.encode())
    write_trace(outcome.trace, written.trace)
    text = json.dumps(finite(codec.encode(outcome.verdicts)), indent=1, allow_nan=False)
    write_atomically(written.verdicts, (text + "\n").encode())
    view = view_of(outcome, world, config)
    run_picture.write_picture(view, written.picture)
    if written.gif is not None:
        animation.write_gif(view, written.gif)
    if written.mp4 is not None:
        animation.write_mp4(view, written.mp4)
    command = ["mrta-falsify", "run", str(kept.world), "--stack", str(kept.stack)]
    speed = outcome.sim_time / max(outcome.wall_s, 1e-9)
    computed = ("computed in", f"{outcome.wall_s:.1f} s ({speed:.1f}x real time)")
    report = report_of_run(
        dataclasses.replace(view, facts=(*view.facts, computed)),
        command=again or shlex.join(command),
        stack=stack,
        versions=versions(),
        picture=written.picture,
        animation=written.gif,
        whole=config.stack is not None,
    )
    page.write_page(report, written.report)


def view_of(outcome: Outcome, world: World, config: StackConfig) -> RunView:
    """Collect what pictures and pages of a run are made from."""
    tasks = outcome.tasks
    touched = [
        f"{count} {kind.replace('_', '-')}" for kind, count in outcome.contacts.items() if count
    ]
    done = ("tasks done", f"{tasks.completed} of {tasks.total}, {tasks.late} late or missing")
    finished = ("robots finished", f"{outcome.robots_finished} of {len(world.robots)}")
    facts = (
        ("simulated", f"{outcome.sim_time:.1f} s, ended: {outcome.ended}"),
        *((done, finished) if tasks.told else (("tasks done", UNTOLD),)),
        ("contacts", ", ".join(touched) or "none"),
        *coupling_facts(outcome.coupling),
        ("people", f"{len(world.humans)}"),
        ("seed", f"{world.seed}"),
        ("world digest", outcome.trace.world_digest[:12]),
        ("trace digest", outcome.trace.digest[:12]),
    )
    return RunView(
        world=world,
        trace=outcome.trace,
        verdicts=outcome.verdicts,
        costmap=costmap_of(world, _with_map_that_works(outcome, config)),
        facts=facts,
    )


def _with_map_that_works(outcome: Outcome, config: StackConfig) -> StackConfig:
    """Draw the shipped costmap where the stack's own has failed."""
    first = leading(outcome.verdicts)
    has_failed = first is not None and first.evidence.get("layer") == "costmap"
    return dataclasses.replace(config, costmap=StackConfig().costmap) if has_failed else config
