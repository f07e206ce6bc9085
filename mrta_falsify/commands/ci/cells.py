"""The cells of a project: each scenario, and each corpus, on each stack."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mrta_falsify.campaigns.code_digest import code_digest
from mrta_falsify.campaigns.rules import JUDGED_SINCE, signed
from mrta_falsify.campaigns.settings import CampaignSettings
from mrta_falsify.campaigns.signature import signature_before
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.commands.campaign_settings import new_settings
from mrta_falsify.commands.ci.ledger import CellState, Example, Finding
from mrta_falsify.commands.ci.project import Project, ScenarioEntry, with_portable_paths
from mrta_falsify.commands.corpus import on_recorded_engine
from mrta_falsify.commands.folders import located
from mrta_falsify.commands.stored_trials import open_campaign
from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.lab import specifications_of
from mrta_falsify.specs.causes import kind_of, leading
from reports.sentences import violation_sentence

CAMPAIGNS = "campaigns"  # folder of searches, in what is kept


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """A scenario or a corpus on a stack."""

    name: str  #: ``SCENARIO on STACK``
    config: StackConfig
    parts: dict[str, str]  #: digests of all that its result depends on, by what it is
    jittered: int  #: copies of each stored failure that is run again
    search: CampaignSettings | None = None  #: None: a corpus
    stop_after: int = 0  #: of the search
    corpus: tuple[Finding, ...] = ()  #: what is stored in a corpus

    @property
    def digest(self) -> str:
        """Of all that the result depends on."""
        return codec.digest(self.parts)

    def changed(self, before: CellState | None) -> tuple[str, ...]:
        """Name what has changed since the last run; empty: nothing."""
        if before is None:
            return ("first run",)
        return tuple(part for part in self.parts if self.parts[part] != before.parts.get(part))


def cells_of(project: Project) -> Iterator[Cell]:
    """Yield the cells of a project; each scenario is compiled.

    Raises:
        InputError: a scenario, stack or corpus cannot be read; the message names it.
    """
    stacks = {name: project.stack(name) for name in project.file.stacks}
    for scenario, entry in project.file.scenarios.items():
        for name in entry.stacks or stacks:
            with located(f"{project.path}: scenarios.{scenario}"):
                yield _search_cell(project, scenario, entry, name, stacks[name])
    for directory in project.file.corpus:
        for name, config in stacks.items():
            with located(f"{project.path}: corpus"):
                yield _corpus_cell(project, directory, name, config)


def _search_cell(
    project: Project, scenario: str, entry: ScenarioEntry, stack: str, config: StackConfig
) -> Cell:
    name = f"{scenario} on {stack}"
    settings = new_settings(
        project.scenario(scenario),
        output=project.kept,
        stack=config,
        specs=entry.specs,
        params=[f"{key}={value}" for key, value in entry.params.items()],
        sampler=entry.sampler,
        seed=entry.seed,
        jittered=entry.jittered,
        verify=entry.verify,
    )
    settings = dataclasses.replace(settings, budget=entry.budget)
    portable = dataclasses.replace(
        settings,
        trials=dataclasses.replace(
            settings.trials, scenario=scenario, stack=StackConfig(), directory=""
        ),
        rules=1,  # the code tells it already
    )
    parts = {
        "scenario": codec.digest([portable, entry.stop_after]),
        **_stack_parts(project, config, specifications_of(settings.trials)),
    }
    folder = project.kept / CAMPAIGNS / _folder_name(name, codec.digest(parts))
    trials = dataclasses.replace(settings.trials, directory=str(folder.resolve()))
    return Cell(
        name=name,
        config=config,
        parts=parts,
        jittered=entry.jittered,
        search=dataclasses.replace(settings, trials=trials),
        stop_after=entry.stop_after,
    )


def _corpus_cell(project: Project, directory: str, stack: str, config: StackConfig) -> Cell:
    campaign = open_campaign(project.folder / directory)
    failures = [record for record in campaign.records if record.failed]
    config = on_recorded_engine(campaign, config)
    settings = dataclasses.replace(campaign.settings.trials, stack=config)
    return Cell(
        name=f"{directory} on {stack}",
        config=config,
        parts={
            "corpus": codec.digest(
                [project.file.jittered, [[r.id, r.world_digest] for r in failures]]
            ),
            **_stack_parts(project, config, specifications_of(settings)),
        },
        jittered=project.file.jittered,
        corpus=_stored_findings(project, campaign),
    )


def _stack_parts(
    project: Project, config: StackConfig, specifications: tuple[str, ...]
) -> dict[str, str]:
    return {
        "stack": with_portable_paths(config, project.folder).digest(),
        "code": code_digest(config, specifications),
    }


def _stored_findings(project: Project, campaign: Campaign) -> tuple[Finding, ...]:
    """Take what is stored in a corpus for what was known before."""
    found: dict[str, Finding] = {}
    for record in campaign.records:
        verdict = leading(record.verdicts)
        if verdict is None:
            continue
        mode = signed(record.verdicts, campaign.settings.rules)
        earlier = found.get(mode)
        examples = earlier.examples if earlier is not None else ()
        before = earlier.before if earlier is not None else ()
        found[mode] = Finding(
            signature=mode,
            fate="failing",
            examples=(*examples, example_of(project, campaign, record.id)),
            sentence=violation_sentence(verdict),
            since=0,
            rules=min(campaign.settings.rules, JUDGED_SINCE),
            before=tuple(dict.fromkeys((*before, signature_before(record.verdicts)))),
            failure_kind=kind_of(record.verdicts),
        )
    return tuple(found.values())


def example_of(project: Project, campaign: Campaign, id: str) -> Example:
    """Name a stored failure by the campaign's directory, relative to the project."""
    return Example(os.path.relpath(campaign.directory, project.folder), id)


def _folder_name(name: str, digest: str) -> str:
    return f"{re.sub(r'[^A-Za-z0-9.-]+', '-', name)[-60:]}-{digest[:12]}"


def search_folder(cell: Cell) -> Path:
    """Name the directory of a cell's search."""
    assert cell.search is not None
    return Path(cell.search.trials.directory)
