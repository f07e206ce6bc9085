from __future__ import annotations

import numpy as np
import pytest

from mrta_falsify.campaigns.executors import ProcessExecutor, SerialExecutor
from mrta_falsify.campaigns.rare_events import mean_interval, rare_probability
from mrta_falsify.campaigns.runner import run_campaign
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import Store, read_campaign
from mrta_falsify.commands.campaign_summary import probability_of
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice
from mrta_falsify.core.feedback import Estimates
from mrta_falsify.core.seeding import stream
from tests.campaigns.standin import settings

SPLITTING = Choice(
    "samplers.splitting:SplittingSampler",
    {"repeats": 6, "chains": 4, "steps": 2, "pilot": 8},
)


@pytest.mark.parametrize("spread", [0.3, 0.8])
def test_the_interval_covers_the_mean_of_skewed_estimates(spread):
    draws = stream(3, "test").lognormal(-(spread**2) / 2.0, spread, size=(1500, 10))
    ends = np.array([mean_interval(row) for row in draws])
    covered = ((ends[:, 0] <= 1.0) & (ends[:, 1] >= 1.0)).mean()
    assert covered > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / 1500)


def test_estimates_that_are_zero_are_pooled_with_their_neighbours():
    assert mean_interval([0.2, 0.0, 0.1, 0.3, 0.2, 0.1, 0.0, 0.2]) is not None
    assert mean_interval([0.0] * 10) is None
    assert mean_interval([0.1] * 3) is None
    assert mean_interval([0.9] * 9 + [0.95])[1] <= 1.0


def test_without_enough_estimates_the_uniform_trials_speak():
    found = rare_probability(Estimates(repeats=(0.0,) * 10, uniform_trials=300, uniform_failures=0))
    assert found.low == 0.0
    assert 0.005 < found.high < 0.02
    assert "10 of 10 runs" in found.note
    assert "uniform" in found.method


def run(directory, executor, budget, *, mode="exact"):
    chosen = settings(sampler=SPLITTING, dimensions=6, reject_above=0.9)
    chosen = codec.decode(
        type(chosen),
        {**codec.encode(chosen), "trials": {**codec.encode(chosen.trials), "mode": mode}},
        where="test",
    )
    new = not (directory / "campaign.json").exists()
    with Store.create(directory, chosen) if new else Store.resume(directory) as store:
        try:
            executor.open(store.settings)
            run_campaign(store, Limits(budget=budget), executor)
        finally:
            executor.close()
    return read_campaign(directory)


def chance_in(campaign, *, stopped_early=False):
    return probability_of(campaign, campaign.stats(), stopped_early=stopped_early)


def serial():
    return SerialExecutor(SerialExecutor.Options())


def test_a_campaign_prints_an_interval_of_a_rare_violation(tmp_path):
    early = chance_in(run(tmp_path, serial(), 20))
    assert "looking for levels" in early.note
    found = chance_in(run(tmp_path, serial(), 400))
    # Irwin and Hall: the mean of six uniform numbers is below 0.3 with probability 0.04505, in
    # 0.00037 of all cases with the first above 0.9, where there is no scene.
    truth = (0.04505 - 0.00037) / 0.9
    assert 0.0 < found.low < truth < found.high
    assert "12 independent runs" in found.method
    assert not found.note


def test_in_pieces_and_on_two_workers_it_is_the_same_campaign(tmp_path):
    whole = run(tmp_path / "whole", serial(), 150)
    run(tmp_path / "pieces", serial(), 40)
    two = ProcessExecutor(ProcessExecutor.Options(workers=2))
    pieces = run(tmp_path / "pieces", two, 150)
    assert [codec.encode(r) for r in pieces.records] == [codec.encode(r) for r in whole.records]


def test_repaired_scenes_and_an_early_stop_allow_no_estimate(tmp_path):
    found = run(tmp_path, serial(), 5, mode="repair")
    assert "repaired scenes" in chance_in(found).why_not
    exact = run(tmp_path / "exact", serial(), 5)
    stopped = chance_in(exact, stopped_early=True)
    assert "stop-after" in stopped.why_not
