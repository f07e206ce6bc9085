"""kill -9; the benchmark of the same name does it a hundred times."""

from __future__ import annotations

import pytest

from tests.survival.kills import disturb


@pytest.mark.parametrize(
    ("kills", "budget"),
    [
        pytest.param(2, 120, marks=pytest.mark.slow),
        pytest.param(6, 400, marks=pytest.mark.long),
    ],
)
def test_kill_9_loses_nothing_doubles_nothing_and_changes_nothing(tmp_path, kills, budget):
    report = disturb(tmp_path, kills=kills, budget=budget, seed=1)
    assert report.kills == kills
    assert (report.lost, report.doubled, report.different, report.orphans) == (0, 0, 0, 0)
