"""kill -9; the benchmark of the same name does it a hundred times."""

from __future__ import annotations

import pytest

from benchmarks.campaign.survival import disturb


@pytest.mark.slow
def test_kill_9_loses_nothing_doubles_nothing_and_changes_nothing(tmp_path):
    report = disturb(tmp_path, kills=6, budget=400, seed=1)
    assert report.kills == 6
    assert (report.lost, report.doubled, report.different, report.orphans) == (0, 0, 0, 0)
