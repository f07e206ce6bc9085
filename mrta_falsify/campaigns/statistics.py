"""How likely is a violation? Intervals that cover as often as they say.

Only draws from the scenario's own distribution say anything about a probability. So scenes must
be accepted as Scenic would (mode ``exact``), and only trials count that were drawn evenly: all of
``random``, one in five of ``auto``. A sampler may also estimate the probability itself
(:mod:`~mrta_falsify.campaigns.rare_events`). A search that looks for failures finds more of them
than there are.
"""

from __future__ import annotations

from mrta_falsify.campaigns.settings import CampaignSettings
from mrta_falsify.core.probability import Probability, failure_probability
from mrta_falsify.core.run_result import Vote


def why_no_probability(
    settings: CampaignSettings,
    *,
    any_uniform: bool,
    stopped_early: bool,
    is_estimating: bool = False,
    accepted: tuple[int, int] = (0, 0),
) -> str:
    """Say why the trials of a campaign allow no interval; empty if they do.

    Args:
        settings: of the campaign.
        any_uniform: whether trials are drawn evenly, whatever has been found.
        stopped_early: whether what was found decided how many trials there are.
        is_estimating: whether the sampler estimates the probability itself.
        accepted: proposals that the scenario took as they were, of how many.
    """
    if not any_uniform and not is_estimating:
        exact = "" if settings.trials.mode == "exact" else " with --mode exact"
        if settings.sampler.name == "auto":
            return (
                "no trial counts yet: of sampler auto those count that are drawn evenly, one in "
                f"five{' and only' + exact if exact else ''}"
            )
        return (
            f"sampler {settings.sampler.name} looks for failures; use --sampler random{exact}, or "
            "auto, of which one trial in five counts, or splitting if failures are rare"
        )
    if settings.trials.mode != "exact":
        as_they_were, proposals = accepted
        first = "repaired scenes do not have the scenario's distribution"
        if proposals and not as_they_were:
            return (
                f"{first}, and none of {proposals} proposals was accepted as it was, so that "
                "--mode exact would reject most: check names what rejects them"
            )
        return f"{first}; use --mode exact"
    if stopped_early:
        return (
            "the campaign stopped because of what it found; run it without --stop-after and "
            "--until-saturated"
        )
    return ""


def chance_in_vote(copies: Vote, most: int) -> Probability:
    """Estimate how probably a copy of a world fails, from copies that ended once decided.

    Copies that were not run count both ways, as trials without an answer do. So the interval
    covers although what the first copies did decided how many there are.

    Args:
        copies: that were run.
        most: copies that would have been run.
    """
    return failure_probability(copies.failed, copies.runs, undecided=max(most - copies.runs, 0))
