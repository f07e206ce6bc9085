"""How an episode of an environment ended, as a search wants to know it."""

from __future__ import annotations

from dataclasses import dataclass

from mrta_falsify.campaigns.signature import signature
from mrta_falsify.core.feedback import Feedback
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.gym.drawing import PlayedWorld
from mrta_falsify.specs.causes import kind_of, primary, secondary
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
    kind: str  #: deadlock, stuck or shut; empty: none of them
    signature: str  #: of the failure mode, empty: no failure
    world_digest: str
    trace_digest: str  #: the same actions in the same world give the same

    @property
    def is_primary(self) -> bool:
        """Whether it failed, and not only because the world shut a place."""
        return bool(primary(self.verdicts))

    def feedback(self, number: int, played: PlayedWorld) -> Feedback:
        """Tell a sampler what became of its proposal ``number``.

        A place that the world shut is no failure to it.
        """
        assert played.u is not None, "worlds of a program have a point"
        return Feedback(
            number=number,
            u=played.u,
            score=self.score,
            objectives={n: m for n, m in self.margins.items() if n not in secondary(self.verdicts)},
            descriptors=self.descriptors,
            failed=self.is_primary,
            signature=self.signature if self.is_primary else "",
        )


def episode_end(judged: Judged) -> EpisodeEnd:
    """Sum up a finished episode."""
    outcome = judged.outcome
    return EpisodeEnd(
        ended=outcome.ended,
        verdicts=judged.verdicts,
        margins=judged.margins,
        descriptors=judged.descriptors,
        score=search_score(judged.margins, judged.secondary),
        failed=judged.failed,
        kind=kind_of(judged.verdicts),
        signature=signature(judged.verdicts),
        world_digest=outcome.trace.world_digest,
        trace_digest=outcome.trace.digest,
    )
