"""Whether a failure needs people: all removed from the start, and shortly before the onset."""

from __future__ import annotations

import dataclasses

from mrta_falsify.analysis.explain.case import Case
from mrta_falsify.analysis.explain.rows import RUNS, experiment_of, fate_of
from mrta_falsify.core.findings import ChangedRun, Explanation, Fate
from mrta_falsify.lab import Edit, Experiment, RunResult, Vote

#: of a row's fates, what they say of the failure; others tell nothing
FAILS = {"fails": True, "passes": False, "avoids": False}


class People:
    """All people removed at once, in the world itself and in copies with small differences."""

    least = 2

    def applies(self, case: Case) -> bool:
        """See :class:`.case.Question`."""
        return bool(case.job.world.humans)

    def ask(self, case: Case, found: Explanation, runs: int) -> Explanation:
        """See :class:`.case.Question`."""
        moments = (0.0, case.before_onset) if case.before_onset > 0.0 else (0.0,)
        copies = min(RUNS, max(1, runs // len(moments)))
        told = []
        for at in moments:
            own = _without_people(case, at)
            results = list(case.lab.map(own.with_perturbation(k) for k in range(copies)))
            told.append(_changed(case, at, results))
        return dataclasses.replace(found, absences=(*found.absences, *told))


def _without_people(case: Case, at: float) -> Experiment:
    """Describe a run without people from a time [s] on; at 0 none is there at all."""
    own = experiment_of(case.job, case.failure, at, None, 0)
    world = case.job.world
    if at == 0.0:
        return dataclasses.replace(own, world=dataclasses.replace(world, humans=()))
    people = tuple(range(len(world.humans)))
    return dataclasses.replace(own, edits=(Edit(at=at, without_people=people),))


def _changed(case: Case, at: float, results: list[RunResult]) -> ChangedRun:
    """Say what became of the failure."""
    names = tuple(human.name for human in case.job.world.humans)
    fates = [fate_of(result, case.failure, since=at) for result in results]
    vote = Vote.of(FAILS.get(fate) for fate in fates)
    fate: Fate = "stays" if vote.robust else "gone"
    if not vote.runs:
        fate = "otherwise" if "otherwise" in fates else "unknown"
    what = names[0] if len(names) == 1 else f"all {len(names)} people"
    return ChangedRun(
        group="humans",
        things=names,
        change=f"{what} from {at:.1f} s on" if at else what,
        fate=fate,
        detail=_detail(fate, vote, results),
        vote=vote if vote.runs else None,
    )


def _detail(fate: Fate, vote: Vote, results: list[RunResult]) -> str:
    if fate == "otherwise":
        return "violated in another way"
    if fate == "unknown":
        return results[0].detail or "the runs could not be judged"
    return f"fails in {vote.failed} of {vote.runs} runs"
