"""Requests about one world under the stack of this process: judge it, explain its failure."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from mrta_falsify.campaigns.signature import signature
from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.protocols import Costs
from mrta_falsify.core.stack_failure import StackLimits
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.world import World
from mrta_falsify.specs.attribution import guess
from mrta_falsify.specs.objectives import search_score
from mrta_falsify.trial import Job, judge
from mrta_falsify.verbs.explain.explaining import explain_job
from mrta_falsify.worker import blamed

DELIVERED = "dropped-off"  # event of the stack at a delivery
#: CPU time for one tick in an explanation [s]; ten times what the slowest shipped stack takes.
#: A hang costs it twice in each of the runs, which have to stay within the explanation's limit.
TICK = 10.0
ALLOCATED = ("allocated", "allocation-refused")  # events of the stack after a call


def run(request: dict[str, Any]) -> dict[str, Any]:
    """Judge one world."""
    judged = judge(_job_of(request))
    outcome = judged.outcome
    return {
        "fate": "judged",
        "violated": [verdict.spec for verdict in judged.verdicts if verdict.violated],
        "signature": signature(judged.verdicts),
        "guess": guess(judged.verdicts, outcome.trace).layer if judged.failed else "",
        "score": search_score(judged.margins),
        "objectives": judged.margins,
        "descriptors": judged.descriptors,
        "situations": judged.situations,
        "blamed": blamed(judged),
        "costs": costs_of(outcome.trace),
        "digest": outcome.trace.digest,
        "sim_s": outcome.sim_time,
    }


def explain(request: dict[str, Any]) -> dict[str, Any]:
    """Name the layer that a failure belongs to; the stack's crashes and hangs are verdicts here.

    A mutant that only costs more is compared with what the request says of the sound stack, since
    a reference stack in this process would be mutated as well.
    """
    job = dataclasses.replace(
        _job_of(request),
        early_stop=False,
        limits=StackLimits(tick=TICK),
        reference=_reference(request["sound_costs"]),
    )
    found = explain_job(job, max_runs=request["max_runs"])
    return {"layer": found.layer, "guess": found.guess, "reason": found.reason, "runs": found.runs}


def costs_of(trace: Trace) -> dict[str, float]:
    """Compute what a run cost: way [m], time of the last delivery [s], calls of the allocator."""
    steps = np.diff(trace.columns["pose"][:, :, :2], axis=0)
    times = [event.time for event in trace.events if event.kind == DELIVERED]
    return {
        "way": float(np.hypot(steps[..., 0], steps[..., 1]).sum()),
        "time": float(max(times, default=trace.duration)),
        "calls": float(sum(event.kind in ALLOCATED for event in trace.events)),
    }


def _reference(costs: dict[str, float]) -> Costs:
    return Costs(way=(costs["way"],), time=costs["time"], calls=int(costs["calls"]), undelivered=0)


def _job_of(request: dict[str, Any]) -> Job:
    return Job(
        world=codec.decode(World, request["world"], where="world"),
        config=codec.decode(StackConfig, request["stack"], where="stack"),
        specifications=tuple(request["specifications"]),
        early_stop=True,
    )
