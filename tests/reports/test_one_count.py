"""`list`, `show` and the report of one campaign give the same counts and the same first failure."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from mrta_falsify.campaigns.signature import signature
from mrta_falsify.campaigns.store import Store
from mrta_falsify.commands.report.build import build_report
from mrta_falsify.commands.stored_trials import (
    list_trials,
    open_campaign,
    show_trial,
    what_happened,
)
from mrta_falsify.core.claims import KIND_TEXT
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.specs.library import default_specifications
from mrta_falsify.testing.records import changed
from mrta_falsify.trial import late_or_undone
from tests.reports.planted import stalled_campaign

OTHERS = ("no_deadlock", "stack_runs", "repeatable")
SPECS = [name for name in default_specifications() if name not in OTHERS]
CAMPAIGNS = [
    pytest.param(range(3), id="few"),
    pytest.param(range(3, 203), id="many", marks=pytest.mark.long),
]


@pytest.fixture(scope="module")
def planted(stalled, tmp_path_factory):
    return stalled_campaign(tmp_path_factory.mktemp("planted") / "campaign", stalled)


def drawn_campaign(planted, directory, seed: int):
    """A campaign with the settings of ``planted``, and records that are drawn."""
    random = np.random.default_rng(seed)
    (deadlock,) = planted.records
    with Store.create(directory, planted.settings) as store:
        for number in range(random.integers(1, 12)):
            candidate = dataclasses.replace(deadlock.candidate, number=number)
            record = changed(deadlock, candidate=candidate, trace_file="")
            broken = random.choice(SPECS, size=random.integers(3), replace=False)
            if random.random() < 0.7:
                verdicts = tuple(
                    Verdict(
                        spec=str(name),
                        robustness=-float(random.uniform(0.1, 1.0)),
                        violated=True,
                        violated_at=float(random.uniform(1.0, 50.0)),
                        who=(f"robot{random.integers(1, 4)}",),
                    )
                    for name in broken
                )
                after = len(broken) > 0 and set(broken) <= set(late_or_undone())
                rank = ("secondary" if after else "primary") if verdicts else "none"
                record = changed(
                    record,
                    verdicts=verdicts,
                    rank=rank,
                    signature=signature(verdicts),
                    score=-1.0 if verdicts else 0.5,
                )
            if random.random() < 0.2:
                record = changed(record, status="error", verdicts=(), signature="", error="gone")
            store.add(record)
    return open_campaign(directory)


@pytest.mark.parametrize("seeds", CAMPAIGNS)
def test_lists_and_pages_count_alike(seeds, planted, tmp_path):
    for seed in seeds:
        campaign = drawn_campaign(planted, tmp_path / str(seed), seed)
        rows = list_trials(campaign.directory)
        failed = [row for row in rows if row.failed]
        report = build_report(campaign)
        facts, text = dict(report.facts), " ".join(report.summary)
        if not any(row.status == "ok" for row in rows):
            continue

        told = {id: mode for mode in report.modes for id in mode.ids}
        assert sorted(told) == sorted(row.id for row in failed), seed
        for row in failed:
            record = show_trial(campaign.directory, row.id)
            assert row.signature == told[row.id].signature == record.signature, seed
            assert row.headline == what_happened(campaign, record)[0], seed
        for mode in report.modes:
            first = next(row for row in failed if row.id == mode.ids[0])
            assert mode.happened == first.headline, seed

        assert sum(report.trials.failed) == len(failed), seed
        outcomes = [row.outcome for row in report.table.rows]
        kinds = {text: outcomes.count(text) for text in KIND_TEXT.values()}
        assert sum(kinds.values()) == sum("no_deadlock" in row.violated for row in failed), seed
        assert kinds["deadlock"] == int(facts["deadlocks"]), seed
        assert kinds["stuck"] == int(facts["stuck"]), seed
        assert sum(kinds.values()) + outcomes.count("failure") == len(failed), seed
        assert sum(report.trials.deadlocked) == kinds["deadlock"], seed
        named = re.search(r"first of these came in trial (\d+) of (\d+)", text)
        expected = "trial {} of {}".format(*named.groups()) if named else "none"
        assert facts["first failure"] == expected, seed
        ways = re.search(r"fail in (one|\d+)", text)
        modes = re.search(r"in (one|\d+) modes?", report.headline)
        assert (ways and ways[1]) == (modes and modes[1]), seed
