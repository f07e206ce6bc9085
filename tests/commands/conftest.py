"""Fixtures that tests of several commands use."""

from __future__ import annotations

import pytest

from tests.reports.planted import stalled_campaign


@pytest.fixture
def campaign(stalled, tmp_path):
    """A campaign directory with one failure."""
    return stalled_campaign(tmp_path / "campaign", stalled)
