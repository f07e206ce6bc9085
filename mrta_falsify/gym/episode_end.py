"""How an episode of an environment ended, as a search wants to know it."""

from __future__ import annotations

from dataclasses import dataclass

from mrta_falsify.campaigns.signature import signature
from mrta_falsify.core.feedback import Feedback
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.gym.drawing import PlayedWorld
from mrta_falsify.specs.objectives import search_score
from mrta_falsify.trial import Judged


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeEnd:
    """What is in ``infos[robot]["end"]`` at the last step of an episode."""

    ended: str  #: why
    verdicts: tuple[Verdict, ...]
    margins: dict[str, float]  #: by specification, below 0: violated
    descriptors: dict[str, float]  #: in [0, 1], what kind of trouble it was
    score: float  #: smaller is closer to a violation; what a sampler minimises
    failed: bool  #: a specification is violated
    signature: str  #: of the failure mode, empty: no failure
    world_digest: str
    trace_digest: str  #: the same actions in the same world give the same

    def feedback(self, number: int, played: PlayedWorld) -> Feedback:
        """Tell a sampler what became of its proposal ``number``."""
        assert played.u is not None, "worlds of a program have a point"
        return Feedback(
            number=number,
            u=played.u,
            score=self.score,
            objectives=self.margins,
            descriptors=self.descriptors,
            failed=self.failed,
            signature=self.signature,
        )


def episode_end(judged: Judged) -> EpisodeEnd:
    """Sum up a finished episode."""
    outcome = judged.outcome
    return EpisodeEnd(
        ended=outcome.ended,
        verdicts=judged.verdicts,
        margins=judged.margins,
        descriptors=judged.descriptors,
        score=search_score(judged.margins),
        failed=judged.failed,
        signature=signature(judged.verdicts),
        world_digest=outcome.trace.world_digest,
        trace_digest=outcome.trace.digest,
    )
