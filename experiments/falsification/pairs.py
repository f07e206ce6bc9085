"""The pairs of the suites: a scenario, a stack, and what counts as a failure."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import yaml

from mrta_falsify.campaigns.settings import CampaignSettings
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.trial import campaign_specifications, primary_and_secondary
from mrta_falsify.commands.campaign_settings import new_settings
from mrta_falsify.commands.searches import ComparisonPlan
from mrta_falsify.commands.stacks import load_stack

HERE = Path(__file__).parent
#: the lists of pairs by version
SUITES = {
    "suite": HERE / "suite.yaml",
    "tuning": HERE / "suite_tuning.yaml",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """One scenario on one stack."""

    name: str
    scenario: str  #: in scenarios/, without its ending
    half: Literal["easy", "hard"] = "hard"
    defects: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()  #: of the stack, as ``--set`` takes them
    specifications: tuple[str, ...] = ()  #: what counts as a failure; empty: as in campaigns
    then: tuple[str, ...] = ()  #: what is looked for last; no failure

    @property
    def stack(self) -> StackConfig:
        """On the kinematic engine."""
        sound = StackConfig(engine=Choice("kinematic"), defects=self.defects)
        return load_stack(sound, self.settings)

    @property
    def judged_by(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """All that judge a trial, and those of them that are looked for last."""
        if not self.then:
            return self.specifications or campaign_specifications(self.stack), ()
        return primary_and_secondary(self.specifications, self.then, self.stack)

    @property
    def path(self) -> Path:
        """The scenario."""
        return HERE / "scenarios" / f"{self.scenario}.scenic"

    def searches(self, directory: Path, *, jittered: int = 0) -> CampaignSettings:
        """Make the settings of searches on this pair."""
        judged, last = self.judged_by
        return new_settings(
            str(self.path),
            output=directory,
            stack=self.stack,
            specs=tuple(name for name in judged if name not in last),
            then=last,
            window=1,  # a search runs in one process: nothing has to run ahead
            jittered=jittered,
        )

    def plan(
        self, directory: Path, options: argparse.Namespace, *, stop_after: int = 1
    ) -> ComparisonPlan:
        """Plan searches on this pair."""
        return ComparisonPlan(
            settings=self.searches(directory, jittered=options.jittered),
            samplers=tuple(options.samplers),
            repeats=options.repeats,
            budget=options.budget,
            first_seed=options.seed,
            stop_after=stop_after,
        )


def read_suite(version: str = "suite") -> dict[str, Pair]:
    """Read the pairs of a version by name."""
    path = SUITES[version]
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    pairs = [codec.decode(Pair, pair, where=str(path)) for pair in data["pairs"]]
    return {pair.name: pair for pair in pairs}
