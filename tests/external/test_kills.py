"""kill -9 with a foreign stack; the benchmark kills 50 of each kind."""

from __future__ import annotations

import sys

import pytest

from tests.external.kills import VICTIMS, disturb

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="processes are kept on Linux"),
]


@pytest.mark.parametrize(
    "kills",
    [pytest.param(1, marks=pytest.mark.long), pytest.param(5, marks=pytest.mark.long)],
)
def test_kill_9_of_stack_worker_and_campaign_leaves_nothing_and_changes_nothing(tmp_path, kills):
    report = disturb(tmp_path, kills=kills, seed=1)
    assert report.kills == dict.fromkeys(VICTIMS, kills)
    assert (report.lost, report.doubled, report.different, report.left) == (0, 0, 0, 0), report
