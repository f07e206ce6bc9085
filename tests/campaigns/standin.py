"""A scenario in closed form: quick trials with a known answer, crashes and hangs on demand."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from mrta_falsify.campaigns.rules import RULES
from mrta_falsify.campaigns.runner import point_digest
from mrta_falsify.campaigns.settings import STORED_TARGETS, CampaignSettings, TrialSettings
from mrta_falsify.core import codec
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.feedback import Cube
from mrta_falsify.core.record import Origin, SearchData, TrialRecord
from mrta_falsify.core.run_result import RunResult, Vote
from mrta_falsify.core.seeding import candidate_seed
from mrta_falsify.core.verdict import Verdict

RANDOM = Choice("random")
TARGET = "tests.campaigns.standin:open_trials"
STORED_TARGETS[TARGET] = TARGET  # so that such a campaign can be read
FAULTS = ("crash", "raise", "unfit", "hang")


def open_trials(settings: TrialSettings) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Fails where the mean of u is below 0.3; rejects where u[0] > ``params.reject_above``.

    With ``trials.jittered`` copies lie up to 0.3 higher, evenly.
    ``params``: ``sleep`` [s] per trial; ``crash``, ``raise``, ``hang`` and ``unfit`` numbers of
    trials that do so, where there is a file ``tries`` only ``times`` times; ``starts``: how each
    start ends that is counted in the file ``begun``, ``k`` by a kill, ``e`` by an exception.
    """
    params = settings.params
    if params.get("refuse"):
        raise InputError("standin.scenic:3: refused")
    for ending in params.get("starts", "")[_count(params.get("begun", "")) :][:1]:
        print(f"it ends by {ending}", file=sys.stderr, flush=True)
        if ending == "k":
            os.kill(os.getpid(), signal.SIGKILL)
        raise RuntimeError(f"on demand: {ending}")

    def trial(job: dict[str, Any]) -> dict[str, Any]:
        number, u = job["number"], np.asarray(job["u"])
        time.sleep(params.get("sleep", 0.0))
        faults = {name: number in params.get(name, ()) for name in FAULTS}
        if any(faults.values()) and "tries" in params:
            with open(params["tries"], "a+", encoding="ascii") as tries:
                tries.seek(0)
                if len(tries.read()) >= params["times"]:
                    faults = {}
                tries.write("x")
        if faults.get("crash"):
            os._exit(7)
        if faults.get("raise"):
            raise RuntimeError("on demand")
        if faults.get("unfit"):
            raise InputError("the stack cannot be started")
        if faults.get("hang"):
            time.sleep(3600.0)
        candidate = Candidate(number=number, u=u, seed=candidate_seed(settings.seed, number))
        record = TrialRecord(
            candidate=candidate,
            origin=Origin(proposal=point_digest(u)),
            error="no scene",
        )
        if len(u) and u[0] > params.get("reject_above", 1.0):
            return codec.encode(record)
        margin = float(np.mean(u)) - 0.3
        verdict = Verdict(
            spec="no_deadlock",
            robustness=margin,
            violated=margin < 0.0,
            violated_at=12.0 if margin < 0.0 else None,
        )
        copies = margin + np.linspace(0.0, 0.3, settings.jittered)
        result = RunResult(
            status="judged",
            verdicts=(verdict,),
            margins={"no_deadlock": margin},
            signature="no_deadlock" if margin < 0.0 else "",
            rank="primary" if margin < 0.0 else "none",
            sim_time=60.0,
            wall_s=params.get("sleep", 0.0),
        )
        done = TrialRecord(
            candidate=candidate,
            origin=record.origin,
            result=result,
            vote=Vote(runs=len(copies), failed=int((copies < 0.0).sum()))
            if len(copies) and margin < 0.0
            else None,
            search=SearchData(score=margin),
        )
        return codec.encode(done)

    return trial


def _count(begun: str) -> int:
    """Count a start of a worker in a file; return how many there were before."""
    if not begun:
        return 0
    with open(begun, "a+", encoding="ascii") as file:
        file.write("x")
        return file.tell() - 1


def settings(
    *,
    seed: int = 0,
    dimensions: int = 3,
    sampler: Choice = RANDOM,
    window: int = 4,
    time_limit: float = 60.0,
    jittered: int = 0,
    **params: Any,
) -> CampaignSettings:
    """Settings of a campaign over the stand-in."""
    return CampaignSettings(
        trials=TrialSettings(scenario="standin", seed=seed, params=params, jittered=jittered),
        target=TARGET,
        sampler=sampler,
        cube=Cube(dimensions=dimensions),
        window=window,
        time_limit=time_limit,
        rules=RULES,
    )
