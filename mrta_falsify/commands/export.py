"""Worlds and runs for other systems: Nav2, SDF, MRTA-Sim, Open-RMF, MCAP, GIF, MP4."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from mrta_falsify.campaigns.foreign import of_choice
from mrta_falsify.commands.folders import Place, make_directory
from mrta_falsify.commands.made_again import keep_run
from mrta_falsify.commands.run import run as run_world
from mrta_falsify.commands.stacks import Stack, costmap_of, load_stack
from mrta_falsify.commands.stored_trials import open_campaign
from mrta_falsify.commands.trust import Trust, map_of, open_to_run, permit
from mrta_falsify.commands.worlds import find_world
from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.errors import ConfigError, NeedsOption, WorldError
from mrta_falsify.core.exporting import Exported, Exporter
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.lab import stack_of
from mrta_falsify.lab.stored import kept_trace, kept_world
from simulator_interface.formats import nav2

POINT = "exporter"


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
    exporter = exporter_named(format)
    if id is not None:
        if stack is not None or settings:
            raise ConfigError("--stack and --set belong to a WORLD; a trial has its own stack")
        assert not isinstance(target, World)
        subject = trial_subject(target, id, with_trace=exporter.of_run, run=run, trust=trust)
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
        kind: a registered exporter: ``nav2`` (a directory, or NAME.yaml), ``sdf`` (a file),
            ``mrta-sim`` or ``open-rmf`` (a directory), ``mcap``, ``gif`` or ``mp4`` (a file).
        path: where.

    Returns:
        The files written.

    Raises:
        InputError: unknown kind, a missing extra, or a world that cannot do without its Scenic
            program.
        PlaceError: a file cannot be written.
    """
    exporter = exporter_named(kind)
    _check_scripted(subject, kind, exporter)
    make_directory(path if exporter.of_folder else path.parent)
    trace, verdicts = _run_of(subject) if exporter.of_run else (None, ())
    exported = Exported(
        world=subject.world,
        costmap=partial(_map_of, subject),
        trace=trace,
        verdicts=verdicts,
        picture_map=partial(_picture_map_of, subject),
    )
    return exporter.write(exported, path)


def exporter_named(kind: str) -> Exporter:
    """Build the exporter of a format.

    Raises:
        ConfigError: there is none, or it cannot be loaded.
    """
    if kind not in registry.names(POINT) and ":" not in kind:
        known = ", ".join(registry.names(POINT))
        raise ConfigError(f"--format is {kind!r}; it must be one of {known}")
    exporter: Exporter = registry.build(POINT, Choice(kind), where="--format")
    return exporter


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
    return nav2.write_map_files(costmap_of(world, config), Path(path))


def _map_of(subject: ExportSubject) -> Costmap:
    """Build the map that the stack sees.

    Raises:
        NeedsOption: it is not ours to build, and only what is ours may run.
    """
    choice = subject.config.costmap
    if subject.only_ours and any(of_choice("costmap", choice)):
        raise NeedsOption(f"the map is built by the component {choice.name}", "--run")
    return costmap_of(subject.world, subject.config)


def _picture_map_of(subject: ExportSubject) -> Costmap | None:
    """Build the map for a picture; None: it is not ours to build."""
    if subject.only_ours:
        return map_of(subject.world, subject.config)
    return _map_of(subject)


def _check_scripted(subject: ExportSubject, kind: str, exporter: Exporter) -> None:
    """Refuse what a world that is ``scripted`` cannot give: inputs of a run, or a run.

    Raises:
        WorldError: says why, and what can be exported instead.
    """
    world = subject.world
    if not world.scripted:
        return
    reason = f"because of {world.scripted}"
    if exporter.of_folder:
        raise WorldError(
            f"{world.name}: cannot be written for {kind}, {reason}, which its files cannot "
            "hold; choose nav2, sdf, or the run of a trial as mcap, gif or mp4"
        )
    if exporter.of_run and subject.trace is None:
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
