"""What a campaign will cost, before it is begun."""

from __future__ import annotations

import dataclasses
import tempfile
from dataclasses import dataclass
from pathlib import Path

from mrta_falsify.campaigns.settings import CampaignSettings
from mrta_falsify.campaigns.stats import CampaignStats
from mrta_falsify.campaigns.store import trial_folder
from mrta_falsify.commands.crowd_cost import cost_of
from mrta_falsify.commands.programs import MAX_ATTEMPTS, draw_candidates
from mrta_falsify.commands.workers import count_cores
from mrta_falsify.core.candidate import uniform_point
from mrta_falsify.lab import open_program
from mrta_falsify.worker import TrialRunner

BYTES_OF_RECORD = 4000  # of a line in the log, as measured, without its point
BYTES_OF_DIMENSION = 30  # of one coordinate of the point


@dataclass(frozen=True, slots=True, kw_only=True)
class CostEstimate:
    """The cost of a campaign, from a few trials run on the spot."""

    budget: int  #: simulated candidates
    trials: int  #: that were run here
    dimensions: int
    trial_s: float  #: computing time of one trial, scene included [s]
    hours: float  #: wall clock of the whole budget
    megabytes: float  #: on disc, if as many trials fail as did here
    failed: int  #: of the trials run


def crowd_of(settings: CampaignSettings) -> str:
    """Say what the first world of a campaign costs, before it is run; empty if it is no crowd.

    Raises:
        InputError: the program does not compile.
    """
    trials = settings.trials
    program = open_program(dataclasses.replace(trials, sources_digest=""))
    (drawn,) = draw_candidates(
        program, count=1, seed=trials.seed, mode=trials.mode, max_attempts=MAX_ATTEMPTS
    )
    if drawn.world is None:
        return ""
    cost = cost_of(drawn.world, trials.stack)
    return str(cost) if cost.is_crowd else ""


def estimate_cost(
    settings: CampaignSettings, budget: int, *, workers: int | None = None, trials: int = 2
) -> CostEstimate:
    """Run the first trials of a campaign without storing them, and extrapolate.

    Args:
        settings: of the campaign.
        budget: simulated candidates.
        workers: processes it will have.
        trials: to run here.

    Raises:
        InputError: no scene is accepted.
    """
    stats = CampaignStats(settings)
    size = 0
    with tempfile.TemporaryDirectory() as folder:
        here = dataclasses.replace(settings.trials, directory=folder, sources_digest="")
        runner = TrialRunner(here, open_program(here))
        for number in range(trials):
            u = uniform_point(here.seed, number, settings.cube.dimensions)
            stats.take(runner.run(number, u))
            kept = trial_folder(Path(folder), number)
            size += sum(path.stat().st_size for path in kept.rglob("*") if path.is_file())
    spent = stats.computed_s / trials
    per_line = BYTES_OF_RECORD + BYTES_OF_DIMENSION * settings.cube.dimensions
    return CostEstimate(
        budget=budget,
        trials=trials,
        dimensions=settings.cube.dimensions,
        trial_s=spent,
        hours=spent * budget / min(count_cores(workers), settings.window) / 3600.0,
        megabytes=(size / trials + per_line) * budget / 1e6,
        failed=stats.failed,
    )
