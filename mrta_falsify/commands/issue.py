"""A stored failure as an issue for someone else's tracker: text, pictures, scene, commands."""

from __future__ import annotations

import dataclasses
import shlex
from dataclasses import dataclass
from pathlib import Path

import yaml

from mrta_falsify.analysis.minimize.sentences import minimal_text
from mrta_falsify.campaigns.finding_files import read_finding
from mrta_falsify.campaigns.foreign import of_choice
from mrta_falsify.campaigns.store import Campaign, StoreError
from mrta_falsify.commands.export import ExportSubject, write_export
from mrta_falsify.commands.folders import Place, make_directory
from mrta_falsify.commands.made_again import keep_run
from mrta_falsify.commands.pictures import trial_view
from mrta_falsify.commands.stored_trials import (
    failure_sentences,
    open_campaign,
    read_run,
    what_happened,
)
from mrta_falsify.commands.trust import Trust, map_of, open_to_run, permit
from mrta_falsify.core import codec
from mrta_falsify.core.claims import KIND_TEXT
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import Minimisation
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.wait_account import wait_account
from mrta_falsify.core.world import write_world
from mrta_falsify.lab import stack_of
from mrta_falsify.specs.causes import kind_of, leading
from reports.contents import RunView
from reports.issue_text import IssueContents, render_issue
from scenic_worlds.writing import write_program
from simulator_interface.formats.nav2_goals import write_goals

TEXT_NAME, FOLDER_NAME = "issue.md", "issue"
WORLD, PROGRAM, STACK, PICTURE, GIF = (
    "world.json",
    "world.scenic",
    "stack.yaml",
    "run.png",
    "run.gif",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class IssueFiles:
    """An issue that was written."""

    text: Path
    files: tuple[Path, ...]  #: beside it


def issue(
    directory: Place,
    id: str | int,
    output: Place | None = None,
    *,
    run: bool = False,
    trust: Trust = False,
) -> IssueFiles:
    """Write a failure as an issue: what happened, the world, commands, versions, pictures.

    The smallest world is taken if ``minimize`` has been run. Beside the text lie the world, the
    stack's file, a picture, a GIF, and the scene for Nav2, MRTA-Sim and Open-RMF.

    Args:
        directory: of the campaign.
        id: of the trial.
        output: a directory for it; ``issue`` beside the trial if None.
        run: make the world and the trace again that were not kept.
        trust: then run what is not ours, though somebody else has made the campaign.

    Raises:
        InputError: no such trial, it did not fail, or a file is missing or damaged.
    """
    campaign = open_to_run(directory, trust) if run else open_campaign(directory)
    record = campaign.record(str(id))
    if not record.failed:
        raise StoreError(f"trial {record.id} violates nothing, so there is nothing to report")
    if run:
        keep_run(campaign, record, trust)
        costmap = campaign.settings.trials.stack.costmap
        permit(campaign.directory, of_choice("costmap", costmap), trust)
    config = _portable(stack_of(campaign.settings.trials, record))
    found = read_finding(campaign.folder(record), Minimisation)
    view = _view(campaign, record, found, config)
    folder = make_directory(
        Path(output) if output is not None else campaign.folder(record) / FOLDER_NAME
    )
    program = _write_scene(view, config, folder)
    _write_pictures(view, folder)
    formats, missing = _write_formats(view, config, folder, only_ours=not run)
    contents = IssueContents(
        signature=record.signature,
        happened=_happened(campaign, record, view),
        program=program,
        about_world=_about(found),
        commands=_commands(config),
        versions=tuple(sorted(record.origin.versions.items())),
        pictures=(("The run from above", PICTURE), ("The run", GIF)),
        formats=formats,
        missing=missing,
        facts=_facts(record, view),
    )
    text = folder / TEXT_NAME
    write_atomically(text, render_issue(contents).encode())
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path != text)
    return IssueFiles(text=text, files=tuple(files))


def _portable(config: StackConfig) -> StackConfig:
    """Let the stack's command be relative to the file, and its programs be found by their names."""
    if config.stack is None:
        return config
    words = (Path(word) for word in config.stack.command)
    command = tuple(word.name if word.is_absolute() else str(word) for word in words)
    return dataclasses.replace(
        config, stack=dataclasses.replace(config.stack, folder="", command=command)
    )


def _view(
    campaign: Campaign, record: TrialRecord, found: Minimisation | None, config: StackConfig
) -> RunView:
    """Get the run of the smallest world, or of the trial's own."""
    folder = campaign.folder(record)
    if found is None:
        return trial_view(campaign, record)
    world, trace = read_run(folder / "world.min.json", folder / "trace.min.zip")
    return RunView(world=world, trace=trace, verdicts=found.verdicts, costmap=map_of(world, config))


def _happened(campaign: Campaign, record: TrialRecord, view: RunView) -> tuple[str, ...]:
    """Say what happened in two sentences; the second one says how large the world is if need be."""
    told = _sentences(campaign, record, view)
    world = view.world
    size = (
        f"The world has {len(world.robots)} robots, {len(world.humans)} people and "
        f"{len(world.tasks)} tasks."
    )
    return (*told, size)[:2]


def _sentences(campaign: Campaign, record: TrialRecord, view: RunView) -> tuple[str, ...]:
    if view.verdicts is record.verdicts:
        return what_happened(campaign, record)
    verdict = leading(view.verdicts)
    assert verdict is not None, "a smallest world fails"
    return failure_sentences(view.verdicts, wait_account(verdict, view.trace))


def _about(found: Minimisation | None) -> str:
    if found is None:
        return "The world as it was found; it may get much smaller by minimize, which was not run."
    return f"The smallest world found after {found.runs} runs: {minimal_text(found)}."


def _write_scene(view: RunView, config: StackConfig, folder: Path) -> str:
    """Write the world, also as a program, and the stack; return the program, empty if none."""
    write_world(view.world, folder / WORLD)
    write_atomically(folder / STACK, yaml.safe_dump(codec.encode(config), sort_keys=False).encode())
    try:
        write_program(view.world, folder / PROGRAM)
    except InputError:  # it needs its own program
        return ""
    return (folder / PROGRAM).read_text(encoding="utf-8")


def _write_pictures(view: RunView, folder: Path) -> None:
    from reports.animation import write_gif  # noqa: PLC0415 - matplotlib loads slowly
    from reports.run_picture import write_picture  # noqa: PLC0415

    write_picture(view, folder / PICTURE)
    write_gif(view, folder / GIF)


def _write_formats(
    view: RunView, config: StackConfig, folder: Path, *, only_ours: bool
) -> tuple[tuple[tuple[str, str], ...], tuple[str, ...]]:
    """Write the scene for other systems; what cannot be written is said."""
    subject = ExportSubject(world=view.world, config=config, trace=view.trace, only_ours=only_ours)
    written, missing = [], []
    for what, kind in (
        ("Nav2, map and goals", "nav2"),
        ("MRTA-Sim, all input files", "mrta-sim"),
        ("Open-RMF, building map and dispatch script", "open-rmf"),
    ):
        try:
            write_export(subject, kind, make_directory(folder / kind))
        except InputError as error:
            missing.append(f"{what}: {error}")
            continue
        written.append((what, f"{kind}/"))
    write_goals(view.world, folder / "nav2" / "goals.yaml")
    return tuple(written), tuple(missing)


def _commands(config: StackConfig) -> tuple[tuple[str, str], ...]:
    run = shlex.join(["mrta-falsify", "run", WORLD, "--stack", STACK, "-o", "again"])
    what = "Run the world"
    if config.stack is not None:
        what = f"Run the world; {STACK} lies beside the stack, which is {config.stack.label()}"
    install = ("Install, in a checkout of mrta-falsify", "pip install -c constraints.txt .")
    return (install, (what, run))


def _facts(record: TrialRecord, view: RunView) -> tuple[tuple[str, str], ...]:
    copies = (f"{record.vote.failed} of {record.vote.runs}",) if record.vote else ()
    kind = kind_of(record.verdicts)
    return (
        *((("kind", KIND_TEXT[kind]),) if kind else ()),
        ("world digest", view.world.digest()),
        ("trace digest", view.trace.digest),
        ("engine", record.engine),
        *(("perturbed runs that fail", text) for text in copies),
        *((("the same run again", str(record.repeats)),) if record.repeats else ()),
    )
