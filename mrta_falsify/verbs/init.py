"""Before a campaign: a scenario to start from, and what a campaign will cost."""

from __future__ import annotations

import dataclasses
import tempfile
from dataclasses import dataclass
from pathlib import Path

from mrta_falsify.campaigns.settings import CampaignSettings
from mrta_falsify.campaigns.store import trial_folder
from mrta_falsify.core.candidate import uniform_point
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.verbs.campaign import local_workers
from mrta_falsify.worker import Trials, open_program

SCENARIO = '''"""A ward with a few visitors and two bursts of deliveries.

What it stresses: change this line when you know.
"""
model scenic_worlds.model

for i in range(4):
    new Robot with name f'robot{i + 1}', with start_room i

for i in range(3):
    new Human with name f'visitor{i + 1}',
        with route [i, 5 - i],
        with speed Range(0.6, 1.3)

# A bed somewhere in a corridor, and a trolley beside it.
bed = new Bed in corridors, facing Range(0, 360) deg
new Trolley in corridors

param tasks = [
    (0, DiscreteRange(0, 2), DiscreteRange(3, 5), Range(150, 250)),
    (0, DiscreteRange(3, 5), DiscreteRange(0, 2), Range(150, 250)),
    (Range(20, 60), DiscreteRange(0, 2), DiscreteRange(3, 5), Range(250, 350)),
    (Range(20, 60), DiscreteRange(3, 5), DiscreteRange(0, 2), Range(250, 350)),
]
param horizon = 400
'''
STACK = """# The stack under test: a name per layer, or options (see `mrta-falsify plugins`).
planner: astar
controller: cluster_cbf
priority_rule: fixed
engine: kinematic      # bullet for physics
"""
FILES = {"my_scenario.scenic": SCENARIO, "stack.yaml": STACK}


def write_start(directory: Path) -> tuple[Path, ...]:
    """Write a scenario and a stack to begin with.

    Args:
        directory: made if missing; files that are there are never overwritten.

    Returns:
        The files.

    Raises:
        FormatError: a file is there already, or cannot be written.
    """
    paths = [directory / name for name in FILES]
    for path in paths:
        if path.exists():
            raise FormatError(f"{path}: is there already; nothing was written")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for path, text in zip(paths, FILES.values(), strict=True):
            path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise FormatError(f"{directory}: cannot be written: {error.strerror}") from None
    return tuple(paths)


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """What a campaign will cost, from a few trials run on the spot."""

    trials: int  #: that were run
    dimensions: int
    trial_s: float  #: computing time of one trial, scene included [s]
    hours: float  #: wall clock of the whole budget
    megabytes: float  #: on disc, if as many trials fail as did here
    failed: int  #: of the trials run


def estimate(
    settings: CampaignSettings, budget: int, *, workers: int | None = None, trials: int = 2
) -> Estimate:
    """Run the first trials of a campaign without storing them, and extrapolate.

    Args:
        settings: of the campaign.
        budget: simulated candidates.
        workers: processes it will have.
        trials: to run here.

    Raises:
        InputError: no scene is accepted.
    """
    records: list[TrialRecord] = []
    size = 0
    with tempfile.TemporaryDirectory() as folder:
        here = dataclasses.replace(settings.trials, directory=folder, sources_digest="")
        runner = Trials(here, open_program(here))
        for number in range(trials):
            u = uniform_point(here.seed, number, settings.cube.dimensions)
            records.append(runner.run(number, u))
            kept = trial_folder(Path(folder), number)
            size += sum(path.stat().st_size for path in kept.glob("*")) if kept.is_dir() else 0
    spent = sum(record.scene_s + record.wall_s for record in records) / trials
    processes = int(local_workers(workers).options["workers"])
    per_line = 30 * settings.cube.dimensions + 4000  # bytes of a record
    return Estimate(
        trials=trials,
        dimensions=settings.cube.dimensions,
        trial_s=spent,
        hours=spent * budget / processes / 3600.0,
        megabytes=(size / trials + per_line) * budget / 1e6,
        failed=sum(record.failed for record in records),
    )
