"""Does a search kill a mutant: campaigns of one sampler on a few scenarios, with a budget."""

from __future__ import annotations

import json
import random
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.mutation.bench import Bench, Trial, trial_of
from benchmarks.mutation.mutants import Mutant
from benchmarks.mutation.process import StackProcess, expected
from benchmarks.mutation.runs import Run, kind_of, reasons
from benchmarks.mutation.worlds import OPENING, Source, known_sources, realised, stack_of
from mrta_falsify.campaigns.runner import ROBUST_SHARE, build_sampler
from mrta_falsify.campaigns.settings import CampaignSettings, TrialSettings
from mrta_falsify.copies import counted
from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import Choice
from mrta_falsify.core.feedback import Cube, Feedback, Rehearsed
from mrta_falsify.core.protocols import Rehearsal, RehearsingSampler, Sampler
from mrta_falsify.core.world import World
from mrta_falsify.specs.causes import COSTLY
from scenic_worlds.variation import jittered_worlds

EXPLAIN_RUNS = 16  # runs and continuations of one explanation
EXPLAIN_S = 900.0  # s of CPU for it
REJECTED = 50  # proposals in a row without a world, after which a scenario is left
JITTERED = 4  # copies of each failing world that the sampler is told of


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """How mutants are searched for."""

    sampler: str
    budget: int  #: simulated candidates of a mutant, over all its scenarios
    lanes: int  #: scenarios of a mutant
    seed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Searched:
    """What one search for one mutant came to."""

    mutant: str
    sampler: str
    layer: str  #: of the mutant
    trials: int  #: simulated candidates, copies apart
    found_at: int = 0  #: number of the trial that kills it, from 1; 0: none does
    source: str = ""
    kind: str = ""  #: of the failure
    why: tuple[str, ...] = ()
    copies: str = ""
    named: str = ""  #: layer, by ``explain``
    guess: str = ""  #: layer that the trace alone points to
    reason: str = ""  #: of ``explain``
    sources: tuple[str, ...] = ()  #: that were searched
    own: int = 0  #: failures of worlds in which the sound stack fails as well
    knife_edges: int = 0  #: failures that most copies do not share
    cpu_s: float = 0.0  #: of the mutant's runs, without compiling
    compile_s: float = 0.0  #: of CPU
    wall_s: float = 0.0  #: in all
    world: str = ""  #: file of the world that kills it


class Lane:
    """One scenario with its sampler."""

    def __init__(self, source: Source, plan: Plan, sound: StackProcess) -> None:
        answer = sound.ask({"do": "cube", "scenario": source.place}, cpu_s=OPENING)
        cube = codec.decode(Cube, expected(answer, source.name)["cube"], where=source.name)
        trials = TrialSettings(scenario=source.place, seed=plan.seed, jittered=JITTERED)
        settings = CampaignSettings(trials=trials, sampler=Choice(plan.sampler), cube=cube)
        self.source = source
        self.cube = cube
        self.stack = stack_of(source.settings)
        self.sampler: Sampler = build_sampler(settings)
        self._seed = plan.seed
        if isinstance(self.sampler, RehearsingSampler):
            self.sampler.rehearse_by(self._rehearsal(sound))

    def _rehearsal(self, sound: StackProcess) -> Rehearsal:
        """Look at scenes in the process of the sound stack, which has the program."""

        def look_at(u: Array) -> Rehearsed | None:
            request = {"do": "rehearse", "scenario": self.source.place, "seed": self._seed}
            answer = sound.ask({**request, "u": u.tolist()}, cpu_s=OPENING)
            found = expected(answer, f"{self.source.name}: a rehearsal")
            if "rejected" in found:
                return None
            return Rehearsed(np.array(found["u"]), np.array(found["demands"]))

        return look_at

    def next_world(self, sound: StackProcess) -> tuple[int, dict[str, Any]] | None:
        """Ask for proposals until one has a world: its number and what was realised."""
        for _ in range(REJECTED):
            asked = self.sampler.ask()
            u = asked.u.tolist()
            found = realised(sound, self.source, seed=self._seed, number=asked.number, u=u)
            if found is not None:
                return asked.number, found
            self.sampler.tell(Feedback(number=asked.number, u=asked.u, fate="rejected"))
        return None


def search(
    bench: Bench, mutant: Mutant, plan: Plan, sound: StackProcess, running: list[StackProcess]
) -> Searched:
    """Search until the mutant is killed by the copies' rule, or the budget is used up."""
    began = time.monotonic()
    with trial_of(bench, mutant, sound, running) as trial:
        lanes = [Lane(source, plan, sound) for source in _sources(trial, plan)]
        hunt = _Search(trial, plan)
        for number in range(plan.budget):
            if not lanes or hunt.step(lanes[number % len(lanes)], lanes):
                break
        told = hunt.found
        return Searched(
            mutant=mutant.id,
            sampler=plan.sampler,
            layer=mutant.layer,
            trials=hunt.trials,
            sources=tuple(lane.source.name for lane in lanes),
            own=hunt.own,
            knife_edges=hunt.knife_edges,
            cpu_s=trial.cpu_s,
            compile_s=trial.compile_s,
            wall_s=time.monotonic() - began,
            **told,
        )


def _sources(trial: Trial, plan: Plan) -> list[Source]:
    """Draw the scenarios of a mutant among those in some world of which its lines run."""
    bench = trial.bench
    reached = set()
    for case in bench.cases:
        run = bench.sound.known(case.world, case.stack)
        if run is not None and trial.reaches(run):
            reached.add(case.source)
    sources = [source for source in known_sources() if source.name in reached]
    draw = random.Random(f"{plan.seed} {trial.mutant.id}")
    return draw.sample(sources, min(plan.lanes, len(sources)))


class _Search:
    """One search in progress."""

    def __init__(self, trial: Trial, plan: Plan) -> None:
        self._trial, self._plan = trial, plan
        self.trials = self.own = self.knife_edges = 0
        self.found: dict[str, Any] = {}

    def step(self, lane: Lane, lanes: list[Lane]) -> bool:
        """Run the next candidate of a lane; whether it kills the mutant."""
        trial = self._trial
        asked = lane.next_world(trial.sound_process)
        if asked is None:
            lanes.remove(lane)
            return False
        number, made = asked
        world = codec.decode(World, made["world"], where=lane.source.name)
        self.trials += 1
        run = self._run(lane, world)
        why = trial.why_failed(run, world, lane.stack)
        if why and self._kills(lane, world, run, why):
            return True
        u = np.asarray(made["u"], dtype=np.float64)
        lane.sampler.tell(self._feedback(lane, world, run, number, u))
        return False

    def _run(self, lane: Lane, world: World) -> Run:
        """Run a candidate; where the mutant's lines do not run, it does as the sound stack."""
        trial = self._trial
        if self._plan.sampler == "random" and not trial.reached_everywhere:
            # Its worlds are those of all mutants, so that the sound stack runs in each only once.
            sound = trial.bench.sound.run(trial.sound_process, world, lane.stack, lines=True)
            if not trial.reaches(sound):
                return sound
        return trial.run(world, lane.stack)

    def _kills(self, lane: Lane, world: World, run: Run, why: tuple[str, ...]) -> bool:
        trial = self._trial
        if reasons(trial.sound(world, lane.stack)):
            self.own += 1
            return False
        told = trial.told(world, lane.stack)
        if not told.apart:
            self.knife_edges += 1
            return False
        explained = explanation(trial, lane, world, why)
        self.found = {
            "found_at": self.trials,
            "source": lane.source.name,
            "kind": kind_of(why),
            "why": why,
            "copies": str(told),
            "named": explained.get("layer", ""),
            "guess": explained.get("guess", run.guess),
            "reason": explained.get("reason", explained.get("error", "")),
            "world": self._keep(world),
        }
        return True

    def _keep(self, world: World) -> str:
        folder = self._trial.bench.directory / "kills"
        folder.mkdir(exist_ok=True)
        file = folder / f"{self._trial.mutant.id}-{self._plan.sampler}.json"
        file.write_text(json.dumps(codec.encode(world)), encoding="utf-8")
        return str(file.relative_to(self._trial.bench.directory))

    def _feedback(self, lane: Lane, world: World, run: Run, number: int, u: np.ndarray) -> Feedback:
        """Tell the sampler about a run as a campaign with copies does."""
        if run.fate != "judged":
            return Feedback(number=number, u=u, fate="rejected")
        known: dict[str, Any] = {
            "objectives": run.objectives,
            "score": run.score,
            "signature": run.signature,
        }
        if run.violated:
            worlds = jittered_worlds(world, JITTERED)
            known |= told_of_copies(run, [self._trial.run(copy, lane.stack) for copy in worlds])
        return Feedback(
            number=number,
            u=u,
            fate="judged",
            descriptors=run.descriptors,
            blamed=lane.cube.blocks_of(run.blamed),
            failed=bool(run.violated),
            **known,
        )


def told_of_copies(run: Run, copies: Sequence[Run]) -> dict[str, Any]:
    """Give what a sampler is told of a failure whose copies were run."""
    judged = [run, *(copy for copy in copies if copy.fate == "judged")]
    jittered = counted([bool(reasons(copy)) for copy in copies], [one.objectives for one in judged])
    assert jittered is not None
    return {
        "objectives": jittered.objectives,
        "score": ROBUST_SHARE - jittered.chance.mean,
        "signature": run.signature if jittered.robust else f"{jittered}: {run.signature}",
    }


def explanation(trial: Trial, lane: Lane, world: World, why: Sequence[str]) -> dict[str, Any]:
    """Ask the mutated stack's own ``explain`` for the layer; empty-handed if it cannot say.

    Args:
        trial: of the mutant.
        lane: whose stack it is.
        world: in which it failed.
        why: it did, as :func:`~benchmarks.mutation.runs.reasons` lists.
    """
    costly = [name for name in why if name.startswith(COSTLY)]
    request = {
        "do": "explain",
        "world": codec.encode(world),
        "stack": codec.encode(lane.stack),
        "specifications": costly or trial.bench.sound.specifications,
        "sound_costs": trial.sound(world, lane.stack).costs,
        "max_runs": EXPLAIN_RUNS,
    }
    return trial.process.ask(request, cpu_s=EXPLAIN_S)
