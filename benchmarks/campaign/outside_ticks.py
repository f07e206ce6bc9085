"""What share of a campaign's CPU time is not spent in ticks?

    python -m benchmarks.campaign.outside_ticks hospital_day --trials 20 --seconds 60

Judges worlds of a scenario one after the other, as a worker does: in one guarded copy of this
process. CPU time is that of all processes. A worker's start is imports, the program, and what its
first trial takes longer than the others; it is spread over the trials of a campaign.

Figures are medians of the trials: a run that is taken back goes on in another process.
"""

from __future__ import annotations

import time

BEGAN = time.process_time()

import argparse  # noqa: E402 - imports are part of what is measured
import dataclasses  # noqa: E402
import functools  # noqa: E402
import json  # noqa: E402
import os  # noqa: E402
import statistics  # noqa: E402
from typing import NamedTuple  # noqa: E402

from mrta_falsify.core.config import Choice, StackConfig  # noqa: E402
from mrta_falsify.core.fleet import Frame  # noqa: E402
from mrta_falsify.core.process_clock import cpu_of_tree  # noqa: E402
from mrta_falsify.trial import Job, campaign_specifications, judge  # noqa: E402
from scenic_worlds.program import compile_program, scenario_path  # noqa: E402
from simulator_interface.guard import Guard  # noqa: E402
from simulator_interface.simulate import EpisodeRun  # noqa: E402


class _Spent(NamedTuple):
    """CPU time of one trial [s]."""

    ticks: float  #: in the process that runs it
    run: float  #: of that process, ticks included
    total: float = 0.0  #: of all processes, the world included


def _run(job: Job) -> _Spent:
    """Judge a world in this process."""
    ticks, original = 0.0, EpisodeRun.advance

    def advance(run: EpisodeRun) -> Frame:
        nonlocal ticks
        before = time.process_time()
        frame = original(run)
        ticks += time.process_time() - before
        return frame

    EpisodeRun.advance = advance  # type: ignore[method-assign]
    began = time.process_time()
    try:
        judge(job)
    finally:
        EpisodeRun.advance = original  # type: ignore[method-assign]
    return _Spent(ticks, time.process_time() - began)


def measure(scenario: str, config: StackConfig, trials: int, seconds: float) -> list[_Spent]:
    """Judge ``trials`` worlds of at most ``seconds`` each, and one before them."""
    program, guard, found = compile_program(scenario_path(scenario)), Guard(), []
    specifications = campaign_specifications(config)
    own, before = os.getpid(), BEGAN
    for number in range(trials + 1):
        realised = program.realise(program.candidate(0, number))
        world = dataclasses.replace(realised.world, horizon=seconds)
        job = Job(world=world, config=config, specifications=specifications, early_stop=True)
        call = functools.partial(_run, job)
        spent: _Spent = guard.run(call, config=config, limits=job.limits, portable=True)
        now = cpu_of_tree(own)
        found.append(spent._replace(total=now - before))
        before = now
    guard.close()
    return found


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario", nargs="?", default="hospital_day")
    parser.add_argument("--engine", default="kinematic")
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=60.0, help="of a trial at most")
    parser.add_argument("--campaign", type=int, default=100, help="trials of a worker")
    arguments = parser.parse_args()
    config = StackConfig(engine=Choice(arguments.engine))
    first, *rest = measure(arguments.scenario, config, arguments.trials, arguments.seconds)
    total, ticks, run = (
        statistics.median(getattr(spent, name) for spent in rest)
        for name in ("total", "ticks", "run")
    )
    start = max(0.0, first.total - total)
    whole = total + start / arguments.campaign
    print(
        json.dumps(
            {
                "worker_start_s": round(start, 3),
                "trial_s": round(total, 4),
                "ticks_s": round(ticks, 4),
                "before_and_after_ticks_s": round(run - ticks, 4),
                "copies_and_world_s": round(total - run, 4),
                "outside_ticks": round((run - ticks + start / arguments.campaign) / whole, 4),
                "outside_ticks_and_their_copies": round(1.0 - ticks / whole, 4),
            }
        )
    )


if __name__ == "__main__":
    main()
