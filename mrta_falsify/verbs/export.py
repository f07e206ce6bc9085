"""Worlds and runs for other systems: Nav2, SDF, MRTA-Sim, MCAP, GIF, MP4."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import ConfigError, WorldError
from mrta_falsify.core.trace import Trace, read_trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.verbs import run as app
from mrta_falsify.verbs.campaign import open_campaign, stored_world
from mrta_falsify.worker import rerun, stack_of
from reports.run_view import RunView

Kind = Literal["nav2", "sdf", "mrta-sim", "mcap", "gif", "mp4"]
KINDS: tuple[str, ...] = get_args(Kind)
OF_RUNS = ("mcap", "gif", "mp4")  #: that need more than a world


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Subject:
    """What is exported."""

    world: World
    config: StackConfig
    trace: Trace | None = None
    verdicts: tuple[Verdict, ...] = ()


def subject_of_world(name: str, config: StackConfig) -> Subject:
    """A world by file or name; it is run when a run is asked for."""
    return Subject(world=app.find_world(name), config=config)


def subject_of_trial(directory: Path, name: str, *, with_trace: bool) -> Subject:
    """A trial of a campaign, with its stored trace if there is one, else run again.

    Raises:
        InputError: no such trial, or it has no world.
    """
    campaign = open_campaign(directory)
    record = campaign.record(name)
    world = stored_world(campaign, record)
    config = stack_of(campaign.settings.trials, record)
    trace = None
    if with_trace:
        stored = campaign.folder(record) / "trace.zip"
        if stored.is_file():
            trace = read_trace(stored)
        else:
            trace = rerun(campaign.settings.trials, record, world).outcome.trace
    return Subject(world=world, config=config, trace=trace, verdicts=record.verdicts)


def export(subject: Subject, kind: str, path: Path) -> tuple[Path, ...]:
    """Write ``subject`` in the form ``kind``.

    Args:
        subject: what.
        kind: ``nav2`` (a directory, or NAME.yaml), ``sdf`` (a file), ``mrta-sim`` (a
            directory), ``mcap``, ``gif`` or ``mp4`` (a file).
        path: where.

    Returns:
        The files written.

    Raises:
        InputError: unknown kind, a missing extra, a place that cannot be written, or a world
            that is nothing without its Scenic program.
    """
    from simulator_interface.formats import mcap, mrta_sim_files, sdf_world  # noqa: PLC0415

    if kind not in KINDS:
        raise ConfigError(f"--format is {kind!r}; it must be one of {', '.join(KINDS)}")
    _check_scripted(subject, kind)
    world, config = subject.world, subject.config
    if kind == "nav2":
        return app.export_nav2(world, path, config)
    app.make_directory(path if kind == "mrta-sim" else path.parent)
    if kind == "sdf":
        sdf_world.write_sdf(world, path)
        return (path,)
    if kind == "mrta-sim":
        return mrta_sim_files.write_mrta_sim(world, app.costmap_of(world, config), path)
    subject = with_trace(subject)
    assert subject.trace is not None
    if kind == "mcap":
        mcap.write_mcap(world, subject.trace, app.costmap_of(world, config), path)
    else:
        from reports import animation  # noqa: PLC0415 - matplotlib loads slowly

        view = RunView(
            world=world,
            trace=subject.trace,
            verdicts=subject.verdicts,
            costmap=app.costmap_of(world, config),
        )
        write = animation.write_gif if kind == "gif" else animation.write_mp4
        write(view, path)
    return (path,)


def _check_scripted(subject: Subject, kind: str) -> None:
    """Refuse what a world that is ``scripted`` cannot give: inputs of a run, or a run.

    Raises:
        WorldError: says why, and what can be exported instead.
    """
    world = subject.world
    if not world.scripted:
        return
    reason = f"because of {world.scripted}"
    if kind == "mrta-sim":
        raise WorldError(
            f"{world.name}: cannot be written for MRTA-Sim, {reason}, which its files cannot "
            "hold; choose nav2, sdf, or the run of a trial as mcap, gif or mp4"
        )
    if kind in OF_RUNS and subject.trace is None:
        raise WorldError(
            f"{world.name}: cannot be run for --format {kind} without its Scenic program, "
            f"{reason}; export a trial of a campaign on the program instead"
        )


def with_trace(subject: Subject) -> Subject:
    """``subject`` with a trace; its world is run if it has none."""
    if subject.trace is not None:
        return subject
    outcome = app.run(subject.world, subject.config)
    return Subject(
        world=subject.world,
        config=subject.config,
        trace=outcome.trace,
        verdicts=outcome.verdicts,
    )
