"""What a project file names that is not ours, and would run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from mrta_falsify.campaigns.foreign import (
    Foreign,
    of_choice,
    of_judging,
    of_specifications,
    of_stack,
    of_values,
    places_of,
)
from mrta_falsify.campaigns.made_here import is_made_here
from mrta_falsify.campaigns.settings import TrialSettings
from mrta_falsify.campaigns.store import SETTINGS, read_campaign_settings
from mrta_falsify.commands.ci.project import Project, StackEntry
from mrta_falsify.commands.stacks import SHIPPED, is_process
from mrta_falsify.commands.trust import of_program
from mrta_falsify.core.config import Choice, StackConfig, apply_setting, decode_config, read_config


def of_project(project: Project) -> Iterator[Foreign]:
    """Yield programs, stacks and components that a project names, and folders elsewhere.

    Nothing of it is loaded.

    Raises:
        InputError: a stack cannot be read.
    """
    for name, entry in project.file.stacks.items():
        yield from of_stack(_named(project, name, entry))
    for scenario, search in project.file.scenarios.items():
        yield from of_program(TrialSettings(scenario=project.scenario(scenario)))
        yield from of_values(search.params)
        yield from of_choice("sampler", Choice(search.sampler))
        yield from of_specifications(search.specs)
    for directory in project.file.corpus:
        yield from _of_corpus(project.folder / directory)
    top = project.folder.resolve()
    for folder in (project.file.keep, *project.file.corpus):
        place = (project.folder / folder).resolve()
        if not place.is_relative_to(top):
            yield Foreign("file", folder, place if place.exists() else None)


def _of_corpus(directory: Path) -> Iterator[Foreign]:
    """Yield what stored failures name beside their stack, unless this user has made them."""
    if not (directory / SETTINGS).is_file():
        return  # it is told where it is run
    trials = read_campaign_settings(directory).trials
    found = (*of_judging(trials), *of_choice("engine", trials.stack.engine))
    if not is_made_here(directory, places_of(found)):
        yield from found


def _named(project: Project, name: str, entry: StackEntry) -> StackConfig:
    """Read a stack as it is named; its components are not looked for."""
    where, file = f"{project.path}: stacks.{name}", project.folder / entry.stack
    config = StackConfig()
    if is_process(entry.stack):
        config = decode_config({"stack": entry.stack}, where=where, folder=project.folder)
    elif entry.stack != SHIPPED and file.is_file():
        config = read_config(Path(file))
    for setting in entry.settings:
        config = apply_setting(config, setting)
    return config
