"""A campaign that holds a record of every kind, by hand."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from mrta_falsify.campaigns.record_formats import migrated
from mrta_falsify.campaigns.rules import RULES
from mrta_falsify.campaigns.settings import CampaignSettings, TrialSettings
from mrta_falsify.campaigns.signature import signature
from mrta_falsify.campaigns.store import Campaign, Store, read_campaign
from mrta_falsify.core import codec
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.feedback import Cube
from mrta_falsify.core.probability import Probability
from mrta_falsify.core.record import EngineRun, OtherRun, PerturbedRuns, Repeats, TrialRecord
from mrta_falsify.core.tight_ways import TightWay
from mrta_falsify.core.verdict import Verdict, unjudged

LAST = ("deadlines",)
HOLDS = Verdict(spec="no_deadlock", robustness=20.0, violated=False)
UNJUDGED = unjudged("honest_events", "the stack tells no events")
SHUT_WAY = TightWay(task=1, room="ward_1", by=("trolley_1",), gap=0.41, needed=0.6)


def violated(spec: str, *who: str, **evidence: object) -> Verdict:
    return Verdict(
        spec=spec, robustness=-1.0, violated=True, violated_at=50.0, who=who, evidence=evidence
    )


def claimed(kind: str, *members: str) -> Verdict:
    place = {"x": 1.0, "y": 1.0, "near": "ward_1", "distance": 0.2, "kind": "doorway"}
    rows = [{"robot": m, "cause": "wall", "blocked_by": "", "resource": "bed1"} for m in members]
    bed = {"name": "bed1", "kind": "furniture", "carried_by": "porter1"}
    return violated(
        "no_deadlock", *members, kind=kind, members=list(members), cycle=rows, chain=[],
        onset=40.0, place=place, objects=[bed], shut_by=["bed1"], shut_room="ward_1",
        shut_since=30.0,
    )  # fmt: skip


DEADLOCK, STUCK, SHUT = (
    claimed("deadlock", "robot1", "robot2"),
    claimed("stuck", "robot3"),
    claimed("shut", "robot1"),
)
CONTACT, LATE = violated("no_robot_robot_contact", "robot1", "robot2"), violated("deadlines")


def votes(failed: int) -> PerturbedRuns:
    return PerturbedRuns(runs=4, failed=failed)


def other(fate: str, failed: int | None = None, *verdicts: Verdict) -> OtherRun:
    copies = None if failed is None else votes(failed)
    return OtherRun(
        fate=fate,  # type: ignore[arg-type]
        score=-1.0 if fate == "fails" else 1.0,
        verdicts=verdicts or (HOLDS,),
        signature=signature(verdicts),
        jittered=copies,
        runs=1 if copies is None else 5,
        wall_s=2.0,
    )


def again(same: int) -> Repeats:
    chance = Probability(failures=same, trials=2, estimate=same / 2, low=0.0, high=1.0)
    return Repeats(same=chance, otherwise=0, identical=same)


def engine(fails: bool) -> EngineRun:
    return EngineRun(engine="mujoco", failed=fails)


def judged(number: int, *verdicts: Verdict, **fields: object) -> TrialRecord:
    failed = any(verdict.violated for verdict in verdicts)
    told: dict[str, object] = {
        "candidate": Candidate(number=number, u=np.array([number / 16.0])),
        "status": "ok",
        "proposal_digest": "p",
        "world_digest": f"{number:064x}",
        "verdicts": verdicts,
        "score": -1.0 if failed else 1.0 + number,
        "signature": signature(verdicts),
        "situations": (f"situation {number % 5}", "common"),
        "sim_time": 60.0 + number,
        "wall_s": 1.0 + number,
        "scene_s": 0.5,
        "attempts": 1 + number % 2,
    }
    return flat(**{**told, **fields})


def lost(number: int, status: str, error: str, **fields: object) -> TrialRecord:
    candidate = Candidate(number=number, u=np.array([number / 16.0]))
    return flat(candidate=candidate, status=status, error=error, scene_s=0.25, **fields)


def flat(**fields: object) -> TrialRecord:
    """Make a record by the names that its parts have in format 2."""
    data = {name: codec.encode(value) for name, value in fields.items()}
    return codec.decode(TrialRecord, migrated(data))


RECORDS = (
    judged(0, HOLDS, uniform=True),
    lost(1, "rejected", "no scene"),
    judged(
        2, DEADLOCK, LATE, uniform=True, jittered=votes(1), other=other("passes", 0),
        repeated=again(1),
    ),
    lost(3, "crashed", "Traceback\nRuntimeError: gone", uniform=True),
    judged(
        4, DEADLOCK, jittered=votes(4), other=other("passes", 0), repeated=again(2),
        screening=EngineRun(engine="kinematic", failed=True), confirmed=(engine(True),),
    ),
    judged(5, HOLDS, screening=EngineRun(engine="kinematic", failed=True)),
    judged(6, STUCK, uniform=True, jittered=votes(4), other=other("fails", None, DEADLOCK)),
    judged(7, CONTACT, jittered=votes(3), other=other("not judged")),
    judged(8, HOLDS, LATE, uniform=True, is_afterthought=True),
    judged(9, SHUT, uniform=True, is_shut=True, shut=(SHUT_WAY,)),
    lost(10, "impossible", "ward_1 is shut by trolley_1", shut=(SHUT_WAY,)),
    lost(11, "timeout", "killed after 60 s"),
    judged(12, HOLDS, UNJUDGED, uniform=True),
    judged(
        13, CONTACT, uniform=True, jittered=votes(4), other=other("passes", 1),
        repeated=again(0), confirmed=(engine(False),),
    ),
    judged(14, CONTACT, UNJUDGED, jittered=votes(3), other=other("passes", 2)),
    judged(15, HOLDS, HOLDS, uniform=True),
)  # fmt: skip


def campaign(directory: Path, *, against: bool, sampler: str = "random") -> Campaign:
    """Store all records, with or without another stack to compare with."""
    trials = TrialSettings(
        scenario="by hand",
        specifications=("no_deadlock", "no_robot_robot_contact"),
        then=LAST,
        jittered=4,
        screen=True,
        confirm=("mujoco",),
        mode="exact",
        verify=2,
        against=StackConfig(control_rate=10) if against else None,
    )
    settings = CampaignSettings(
        trials=trials, cube=Cube(dimensions=1), rules=RULES, sampler=Choice(sampler)
    )
    with Store.create(directory, settings) as store:
        for record in RECORDS:
            store.add(record if against else dataclasses.replace(record, other=None))
    return read_campaign(directory)
