"""What a person sees who types the name of an object."""

from __future__ import annotations

from pathlib import Path

import pytest

import mrta_falsify as mf
from mrta_falsify.core.config import Choice, StackConfig

RECORDED = Path(__file__).parent / "recorded" / "campaigns" / "beds"


def test_public_objects_are_written_in_one_line(hall, hall_trace):
    campaign = mf.open_campaign(RECORDED)
    failing = next(record for record in campaign.records if record.failed)
    found = [campaign, failing, failing.verdicts[0], hall, hall_trace, StackConfig()]
    found += [campaign.stats()]
    for thing in found:
        text = repr(thing)
        assert text.startswith(f"<{type(thing).__name__}")
        assert "\n" not in text
        assert len(text) < 200


@pytest.mark.parametrize(
    ("config", "text"),
    [
        (StackConfig(), "<StackConfig as shipped>"),
        (
            StackConfig(planner=Choice("ompl"), defects=("fourth_waiter_dropped",)),
            "<StackConfig planner=ompl, defects=('fourth_waiter_dropped',)>",
        ),
    ],
)
def test_a_stack_shows_what_is_not_as_shipped(config, text):
    assert repr(config) == text
