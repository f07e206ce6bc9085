"""Worlds and runs for other systems: Nav2, SDF, MRTA-Sim, Open-RMF, MCAP, GIF, MP4."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from mrta_falsify.campaigns.foreign import of_choice
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.errors import ConfigError, NeedsOption, WorldError
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.lab import stack_of
from mrta_falsify.lab.stored import kept_trace, kept_world
from mrta_falsify.verbs.folders import Place, make_directory
from mrta_falsify.verbs.made_again import keep_run
from mrta_falsify.verbs.run import run as run_world
from mrta_falsify.verbs.stacks import Stack, costmap_of, load_stack
from mrta_falsify.verbs.stored_trials import open_campaign
from mrta_falsify.verbs.trust import Trust, map_of, open_to_run, permit
from mrta_falsify.verbs.worlds import find_world
from reports.run_view import RunView
from simulator_interface.formats import nav2

ExportKind = Literal["nav2", "sdf", "mrta-sim", "open-rmf", "mcap", "gif", "mp4"]
KINDS: tuple[str, ...] = get_args(ExportKind)
OF_FOLDERS = ("mrta-sim", "open-rmf")  #: that are several files
OF_RUNS = ("mcap", "gif", "mp4")  #: that need more than a world


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExportSubject:
    """What is exported."""

    world: World
    config: StackConfig
    trace: Trace | None = None
    only_ours: bool = False  #: a map that is not ours to build is not built
    verdicts: tuple[Verdict, ...] = ()


def export(
    target: World | Place,
    id: str | int | None = None,
    *,
    format: str,
    output: Place,
    stack: Stack | None = None,
    settings: Sequence[str] = (),
    run: bool = False,
    trust: Trust = False,
) -> tuple[Path, ...]:
    """Write a world, or a trial of a campaign, for another system.

    A world is run first where a run is asked for. Of a trial nothing is run, unless ``run``.

    Args:
        target: a world, or a file or name of one; the directory of a campaign with ``id``.
        id: of the trial.
        format: see :func:`write_export`.
        output: where to write.
        stack: the stack of a world, or its YAML file; a trial has its own.
        settings: ``--set`` texts applied to the stack of a world.
        run: make again what a trial did not keep, its world or trace.
        trust: then run what is not ours, though somebody else has made the campaign.

    Returns:
        The files written.

    Raises:
        InputError: unknown format, world or trial.
        PlaceError: a file cannot be written.
    """
    _check_format(format)
    if id is not None:
        if stack is not None or settings:
            raise ConfigError("--stack and --set belong to a WORLD; a trial has its own stack")
        assert not isinstance(target, World)
        subject = trial_subject(target, id, with_trace=format in OF_RUNS, run=run, trust=trust)
    else:
        subject = ExportSubject(world=find_world(target), config=load_stack(stack, settings))
    return write_export(subject, format, Path(output))


def trial_subject(
    directory: Place,
    id: str | int,
    *,
    with_trace: bool,
    run: bool = False,
    trust: Trust = False,
) -> ExportSubject:
    """Get a trial of a campaign as it was kept.

    Args:
        directory: of the campaign.
        id: of the trial.
        with_trace: its run is needed.
        run: make again what was not kept.
        trust: then run what is not ours, though somebody else has made the campaign.

    Raises:
        InputError: no such trial, it has no world, or what is needed was not kept.
    """
    campaign = open_to_run(directory, trust) if run else open_campaign(directory)
    record = campaign.record(str(id))
    config = stack_of(campaign.settings.trials, record)
    if run:
        keep_run(campaign, record, trust, with_trace=with_trace)
        permit(campaign.directory, of_choice("costmap", config.costmap), trust)
    return ExportSubject(
        world=kept_world(campaign, record),
        config=config,
        trace=kept_trace(campaign, record) if with_trace else None,
        only_ours=not run,
        verdicts=record.verdicts,
    )


def write_export(subject: ExportSubject, kind: str, path: Path) -> tuple[Path, ...]:
    """Write ``subject`` in the format ``kind``.

    Args:
        subject: what.
        kind: ``nav2`` (a directory, or NAME.yaml), ``sdf`` (a file), ``mrta-sim`` or
            ``open-rmf`` (a directory), ``mcap``, ``gif`` or ``mp4`` (a file).
        path: where.

    Returns:
        The files written.

    Raises:
        InputError: unknown kind, a missing extra, or a world that cannot do without its Scenic
            program.
        PlaceError: a file cannot be written.
    """
    from simulator_interface.formats import (  # noqa: PLC0415
        mcap,
        mrta_sim_files,
        open_rmf,
        sdf_world,
    )

    _check_format(kind)
    _check_scripted(subject, kind)
    world = subject.world
    if kind == "nav2":
        return _write_nav2(_map_of(subject), path)
    make_directory(path if kind in OF_FOLDERS else path.parent)
    if kind == "sdf":
        sdf_world.write_sdf(world, path)
        return (path,)
    if kind == "mrta-sim":
        return mrta_sim_files.write_mrta_sim(world, _map_of(subject), path)
    if kind == "open-rmf":
        return open_rmf.write_open_rmf(world, path)
    trace, verdicts = _run_of(subject)
    if kind == "mcap":
        mcap.write_mcap(world, trace, _map_of(subject), path)
        return (path,)
    from reports import animation  # noqa: PLC0415 - matplotlib loads slowly

    costmap = map_of(world, subject.config) if subject.only_ours else _map_of(subject)
    view = RunView(world=world, trace=trace, verdicts=verdicts, costmap=costmap)
    write = animation.write_gif if kind == "gif" else animation.write_mp4
    write(view, path)
    return (path,)


def export_nav2(world: World, path: Place, config: StackConfig | None = None) -> tuple[Path, Path]:
    """Write the costmap's static map as a Nav2 map.

    Args:
        world: walls, furniture and the blockages of time 0.
        path: ``NAME.yaml``, or a directory that gets ``map.yaml``.
        config: its ``costmap`` layer sets resolution and inflation.

    Returns:
        The YAML file and the PGM file beside it.

    Raises:
        InputError: the place cannot be a directory.
        PlaceError: a file cannot be written.
    """
    return _write_nav2(costmap_of(world, config), Path(path))


def _write_nav2(costmap: Costmap, path: Path) -> tuple[Path, Path]:
    target = path if path.suffix == ".yaml" else path / "map.yaml"
    make_directory(target.parent)
    nav2.write_nav2_map(costmap, target)
    return target, target.with_suffix(".pgm")


def _map_of(subject: ExportSubject) -> Costmap:
    """Build the map that the stack sees.

    Raises:
        NeedsOption: it is not ours to build, and only what is ours may run.
    """
    choice = subject.config.costmap
    if subject.only_ours and any(of_choice("costmap", choice)):
        raise NeedsOption(f"the map is built by the component {choice.name}", "--run")
    return costmap_of(subject.world, subject.config)


def _check_format(kind: str) -> None:
    if kind not in KINDS:
        raise ConfigError(f"--format is {kind!r}; it must be one of {', '.join(KINDS)}")


def _check_scripted(subject: ExportSubject, kind: str) -> None:
    """Refuse what a world that is ``scripted`` cannot give: inputs of a run, or a run.

    Raises:
        WorldError: says why, and what can be exported instead.
    """
    world = subject.world
    if not world.scripted:
        return
    reason = f"because of {world.scripted}"
    if kind in OF_FOLDERS:
        raise WorldError(
            f"{world.name}: cannot be written for {kind}, {reason}, which its files cannot "
            "hold; choose nav2, sdf, or the run of a trial as mcap, gif or mp4"
        )
    if kind in OF_RUNS and subject.trace is None:
        raise WorldError(
            f"{world.name}: cannot be run for --format {kind} without its Scenic program, "
            f"{reason}; export a trial of a campaign on the program instead"
        )


def _run_of(subject: ExportSubject) -> tuple[Trace, tuple[Verdict, ...]]:
    """Trace and verdicts of a subject; its world is run if it has none."""
    if subject.trace is not None:
        return subject.trace, subject.verdicts
    outcome = run_world(subject.world, subject.config)
    return outcome.trace, outcome.verdicts
