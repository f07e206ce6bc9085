"""The wiring of names: worlds, stacks, runs and their files, for the command line and Python."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import json
import math
import shlex
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from mrta_falsify.campaigns.attribution import suspected_layer
from mrta_falsify.campaigns.signature import leading
from mrta_falsify.core import codec, registry
from mrta_falsify.core.config import LAYERS, StackConfig, apply_setting, read_config
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.defects import DEFECTS
from mrta_falsify.core.errors import FormatError, InputError, UnknownNameError
from mrta_falsify.core.record import versions
from mrta_falsify.core.trace import write_trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World, read_world, write_world
from mrta_falsify.specs.library import default_specifications
from mrta_falsify.trial import Job, run_job
from reports.run_view import RunView
from scenic_worlds import layouts, variation
from simulator_interface import starts
from simulator_interface.formats import mrta_sim, nav2

if TYPE_CHECKING:
    from scenic_worlds.program import Realised
    from simulator_interface.simulate import Outcome

# --- worlds ----------------------------------------------------------------------------


@contextlib.contextmanager
def located(where: str) -> Iterator[None]:
    """Names the file or option that an input error raised inside comes from."""
    try:
        yield
    except InputError as error:
        text = str(error)
        if not text.startswith(where):
            error.args = (f"{where}: {text}",)
        raise


def find_world(
    name: str,
    *,
    seed: int | None = None,
    tasks: Path | None = None,
    robots: Path | None = None,
    humans: Path | None = None,
) -> World:
    """World by file, by shipped name, or sampled from a Scenic program, ready to run.

    Args:
        name: a world file (``.json``), a Scenic program (``.scenic``), or a shipped name
            of either.
        seed: varies a fixed world (see :func:`scenic_worlds.variation.vary_world`) or
            samples a program; without, a fixed world is taken as it is and a program
            is sampled with seed 0.
        tasks: MRTA-Sim testcase that replaces the tasks; its ``agents`` place the robots,
            unless ``robots`` is given.
        robots: MRTA-Sim robot setup that replaces the robots.
        humans: MRTA-Sim waypoint file that replaces the people.

    Returns:
        A world whose robots all start on free floor.

    Raises:
        InputError: no such file or name, a file that is not what it should be, files that
            contradict each other, a robot start that is taken.
    """
    return find_start(name, seed=seed, tasks=tasks, robots=robots, humans=humans).world


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Start:
    """What a run begins with."""

    world: World
    scene: Any = None  #: Scenic's, if the world was sampled from a program


def find_start(
    name: str,
    *,
    seed: int | None = None,
    tasks: Path | None = None,
    robots: Path | None = None,
    humans: Path | None = None,
) -> Start:
    """World as of :func:`find_world`, with the scene it was sampled from, if it was."""
    scene = None
    if name in layouts.world_names():
        world, fixed = layouts.load_world(name), True
    elif name.endswith(".scenic") or name in scenario_names():
        sampled = _sample_program(name, seed or 0)
        world, scene, fixed = sampled.world, sampled.scene, False
    elif name.endswith(".json") or Path(name).exists():
        world, fixed = read_world(Path(name)), True
    else:
        raise UnknownNameError("world", name, (*layouts.world_names(), *scenario_names()))
    world = _with_inputs(world, tasks, robots, humans)
    with located(name):
        starts.check_starts(world)
        if fixed and seed is not None:
            world = variation.vary_world(world, seed)
    return Start(world=world, scene=scene)


def scenario_names() -> tuple[str, ...]:
    """Names of the shipped Scenic programs, without loading Scenic."""
    folder = Path(layouts.__file__).parent.parent / "scenarios"
    return tuple(sorted(path.stem for path in folder.glob("*.scenic")))


def _sample_program(name: str, seed: int) -> Realised:
    if name.endswith(".scenic") and not Path(name).is_file():
        raise FormatError(f"{name}: cannot be read: no such file")
    # Scenic takes two seconds to import; only this road needs it.
    program = importlib.import_module("scenic_worlds.program")
    compiled = program.compile_program(program.scenario_path(name))
    realised: Realised = compiled.realise(compiled.candidate(seed))
    return realised


def _with_inputs(
    world: World, tasks: Path | None, robots: Path | None, humans: Path | None
) -> World:
    if robots is not None:
        found = mrta_sim.robots_from_setup(world.robots, mrta_sim.read_robot_setup(robots))
        with located(str(robots)):
            world = dataclasses.replace(world, robots=found)
            starts.check_starts(world)
    if tasks is not None:
        stream = mrta_sim.read_task_stream(tasks, rooms=len(world.rooms))
        placed = world.robots
        if stream.agents and robots is None:
            placed = mrta_sim.robots_at_rooms(world.robots, stream.agents, world.rooms)
        with located(str(tasks)):
            world = dataclasses.replace(world, tasks=stream.tasks, robots=placed)
            starts.check_starts(world)
    if humans is not None:
        with located(str(humans)):
            world = dataclasses.replace(world, humans=mrta_sim.read_human_routes(humans))
    return world


# --- stacks ----------------------------------------------------------------------------


def load_stack(path: Path | None = None, settings: Sequence[str] = ()) -> StackConfig:
    """Stack configuration of a YAML file (or the default), with ``--set`` texts applied.

    Every layer's name and options are checked here, so that a mistake is reported with
    the file or option it stands in.

    Raises:
        InputError: unknown layer, implementation or option, or a value not allowed.
    """
    config = StackConfig()
    if path is not None:
        config = read_config(path)
        check_stack(config, where=str(path))
    for setting in settings:
        config = apply_setting(config, setting)
        check_stack(config, where=f"--set {setting}")
    return config


def check_stack(config: StackConfig, *, where: str) -> None:
    """Refuse unknown implementations and options.

    Raises:
        InputError: the first one found, prefixed with ``where``.
    """
    for layer in LAYERS:
        choice = getattr(config, layer)
        component = registry.load(layer, choice.name, where=f"{where}: {layer}")
        codec.decode(component.Options, choice.options, where=f"{where}: {layer}")


# --- runs ------------------------------------------------------------------------------


def run(
    world: World,
    config: StackConfig | None = None,
    *,
    specifications: Sequence[str] = (),
    keep_trace: bool = True,
    on_progress: Callable[[float], None] | None = None,
    scene: Any = None,
) -> Outcome:
    """Run the full stack in ``world`` and judge it.

    Args:
        world: what to simulate.
        config: the stack under test; the default stack if None.
        specifications: names, or ``stl:FORMULA``; all that ship if empty.
        keep_trace: False keeps only the trace's digest.
        on_progress: called about once per simulated second with the time [s].
        scene: that ``world`` was sampled from (:func:`find_start`); only worlds that are
            ``scripted`` need it.

    Raises:
        InputError: the world cannot be run, or a name is unknown.
    """
    starts.check_starts(world)
    job = Job(
        world=world,
        config=config or StackConfig(),
        specifications=tuple(specifications) or default_specifications(),
        scene=scene,
    )
    return run_job(job, keep_trace=keep_trace, on_progress=on_progress)


def summary(outcome: Outcome) -> dict[str, Any]:
    """What ``run --format json`` prints; robustness is null where it is unbounded."""
    return {
        "world_digest": outcome.trace.world_digest,
        "trace_digest": outcome.trace.digest,
        "sim_time_s": round(outcome.sim_time, 6),
        "wall_s": round(outcome.wall_s, 3),
        "real_time_factor": round(outcome.sim_time / max(outcome.wall_s, 1e-9), 2),
        "tasks": codec.encode(outcome.tasks),
        "robots": len(outcome.trace.robots),
        "robots_finished": outcome.robots_finished,
        "contacts": dict(outcome.contacts),
        "verdicts": [_verdict_row(verdict) for verdict in outcome.verdicts],
        "ended": outcome.ended,
    }


def _verdict_row(verdict: Verdict) -> dict[str, Any]:
    return {
        "spec": verdict.spec,
        "robustness": verdict.robustness if math.isfinite(verdict.robustness) else None,
        "violated": verdict.violated,
        "violated_at_s": verdict.violated_at,
        "who": list(verdict.who),
    }


def finite(data: Any) -> Any:
    """JSON-shaped ``data`` with null in place of NaN and infinity, which JSON cannot say."""
    if isinstance(data, dict):
        return {key: finite(item) for key, item in data.items()}
    if isinstance(data, list):
        return [finite(item) for item in data]
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data


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
) -> RunFiles:
    """Write everything a run leaves behind.

    Args:
        outcome: of :func:`run` on ``world``.
        world: the world that was run.
        directory: made if it does not exist; files of an earlier run are replaced.
        config: the stack that was run; the default stack if None.
        gif: also write an animation.
        mp4: also write a video.

    Returns:
        Paths of world.json, stack.yaml, trace.zip, verdicts.json, picture.png, report.html.

    Raises:
        InputError: the directory cannot be made.
    """
    from reports import animation, page, run_picture  # noqa: PLC0415 - matplotlib loads slowly
    from reports.run_report import report_of_run  # noqa: PLC0415

    config = config or StackConfig()
    folder = make_directory(Path(directory))
    files = RunFiles(
        directory=folder,
        world=folder / "world.json",
        stack=folder / "stack.yaml",
        trace=folder / "trace.zip",
        verdicts=folder / "verdicts.json",
        picture=folder / "picture.png",
        report=folder / "report.html",
        gif=folder / "run.gif" if gif else None,
        mp4=folder / "run.mp4" if mp4 else None,
    )
    write_world(world, files.world)
    files.stack.write_text(yaml.safe_dump(codec.encode(config), sort_keys=False), encoding="utf-8")
    write_trace(outcome.trace, files.trace)
    text = json.dumps(finite(codec.encode(outcome.verdicts)), indent=1, allow_nan=False)
    files.verdicts.write_text(text + "\n", encoding="utf-8")
    view = view_of(outcome, world, config)
    run_picture.write_picture(view, files.picture)
    if files.gif is not None:
        animation.write_gif(view, files.gif)
    if files.mp4 is not None:
        animation.write_mp4(view, files.mp4)
    command = ["mrta-falsify", "run", str(files.world), "--stack", str(files.stack)]
    speed = outcome.sim_time / max(outcome.wall_s, 1e-9)
    computed = ("computed in", f"{outcome.wall_s:.1f} s ({speed:.1f}x real time)")
    report = report_of_run(
        dataclasses.replace(view, facts=(*view.facts, computed)),
        command=shlex.join(command),
        stack=yaml.safe_dump(codec.encode(config), sort_keys=False),
        versions=versions(),
        picture=files.picture,
        animation=files.gif,
        first=leading(outcome.verdicts),
        layer=suspected_layer(outcome.verdicts, outcome.trace),
    )
    page.write_page(report, files.report)
    return files


def make_directory(directory: Path) -> Path:
    """``directory``, made if missing.

    Raises:
        FormatError: it cannot be made, or is a file.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or str(error)
        raise FormatError(f"{directory}: cannot be used as a directory: {reason}") from None
    return directory


def view_of(outcome: Outcome, world: World, config: StackConfig) -> RunView:
    """What pictures and pages of a run are made from."""
    tasks = outcome.tasks
    touched = [
        f"{count} {kind.replace('_', '-')}" for kind, count in outcome.contacts.items() if count
    ]
    facts = (
        ("simulated", f"{outcome.sim_time:.1f} s, ended: {outcome.ended}"),
        ("tasks done", f"{tasks.completed} of {tasks.total}, {tasks.late} late or missing"),
        ("robots finished", f"{outcome.robots_finished} of {len(world.robots)}"),
        ("contacts", ", ".join(touched) or "none"),
        ("people", f"{len(world.humans)}"),
        ("seed", f"{world.seed}"),
        ("world digest", outcome.trace.world_digest[:12]),
        ("trace digest", outcome.trace.digest[:12]),
    )
    return RunView(
        world=world,
        trace=outcome.trace,
        verdicts=outcome.verdicts,
        costmap=costmap_of(world, config),
        facts=facts,
    )


def costmap_of(world: World, config: StackConfig | None = None) -> Costmap:
    """Costmap of ``world`` at time 0 as the stack sees it, planted defects included."""
    config = config or StackConfig()
    source = registry.build("costmap", config.costmap, defects=config.defects).bind(world)
    built: Costmap = source.costmap(0.0)
    return built


# --- other verbs -------------------------------------------------------------------------


def plugins() -> dict[str, list[str]]:
    """Registered names of every extension point, and the planted defects."""
    table = {point: list(registry.names(point)) for point in registry.EXTENSION_POINTS}
    return {**table, "defects": sorted(DEFECTS)}


def export_nav2(world: World, path: Path, config: StackConfig | None = None) -> tuple[Path, Path]:
    """Write the costmap's static map as a Nav2 map.

    Args:
        world: walls, furniture and the blockages of time 0.
        path: ``NAME.yaml``, or a directory that gets ``map.yaml``.
        config: its ``costmap`` layer sets resolution and inflation.

    Returns:
        The YAML file and the PGM file beside it.

    Raises:
        InputError: the place cannot be written.
    """
    target = path if path.suffix == ".yaml" else path / "map.yaml"
    make_directory(target.parent)
    nav2.write_nav2_map(costmap_of(world, config), target)
    return target, target.with_suffix(".pgm")
