"""Fixtures that tests of several commands use."""

from __future__ import annotations

import pytest

from mrta_falsify.trial import Job
from tests.reports.planted import BROKEN, stored


@pytest.fixture
def campaign(stalled, tmp_path):
    """A campaign directory with one failure."""
    world, judged = stalled
    job = Job(world=world, config=BROKEN, early_stop=True, specifications=("no_deadlock",))
    return stored(tmp_path / "campaign", job, judged)
