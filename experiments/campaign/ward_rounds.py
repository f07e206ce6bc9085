"""Settings of campaigns on ``ward_rounds.scenic``, for experiments."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from mrta_falsify.campaigns.settings import CampaignSettings
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.commands.campaign_settings import new_settings

PROGRAM = Path(__file__).parent / "ward_rounds.scenic"


def ward_rounds(
    directory: Path, *, sampler: str = "random", seed: int = 0, mode: str = "exact"
) -> CampaignSettings:
    """A campaign on the kinematic engine."""
    return new_settings(
        str(PROGRAM),
        output=directory,
        stack=dataclasses.replace(StackConfig(), engine=Choice("kinematic")),
        sampler=sampler,
        seed=seed,
        mode=mode,
    )
