"""Signatures of rules 1 are those of commit 73399d2, on 2,000 random runs of its evidence."""

from __future__ import annotations

import hashlib
import random

from mrta_falsify.campaigns.signature import signature_before
from mrta_falsify.core.verdict import Verdict

RUNS = 2000
#: of the lines that ``signature`` of 73399d2 gives for these runs
DIGEST = "7295cfe1488fe3dda26d8b951fbf595c79515082f5e0c3ff00d3f39e2fda7895"
ROBOTS = [f"robot{i}" for i in range(1, 6)]
CAUSES = ["queue", "barrier", "cluster", "human", "wall", "no-path", "stalled"]
OBJECTS = [("bed1", "furniture", "nurse"), ("chair", "furniture", ""), ("nurse", "person", "")]
OTHERS = (
    *("progress", "no_starvation", "no_livelock", "deadlines", "no_robot_robot_contact"),
    *("human_clearance", "no_robot_human_contact", "stack_runs"),
)


def rows_of(draw, robots):
    rows = []
    for robot in robots:
        for _ in range(draw.randint(0, 2)):
            cause = draw.choice(CAUSES)
            other = "nurse" if cause == "human" else draw.choice([*ROBOTS, ""])
            resource = draw.choice(["", "bed1", "ward_1"])
            other = "" if other == robot else other
            row = {"robot": robot, "cause": cause, "blocked_by": other, "resource": resource}
            rows.append(row)
    return rows


def claim(draw):
    members = draw.sample(ROBOTS, draw.randint(1, 3))
    onsets = {name: draw.uniform(5.0, 60.0) for name in members}
    victims = [name for name in ROBOTS if name not in members and draw.random() < 0.3]
    objects = [
        dict(zip(("name", "kind", "carried_by"), row, strict=True))
        for row in draw.sample(OBJECTS, draw.randint(0, 3))
    ]
    kind = draw.choice(["doorway", "room", ""])
    found = {
        "members": members,
        "root": draw.choice(members),
        "onsets": onsets,
        "onset": max(onsets.values()),
        "detected_at": draw.uniform(60.0, 90.0),
        "victims": victims,
        "cycle": rows_of(draw, members),
        "objects": objects,
        "place": {"x": 1.0, "y": 1.0, "near": "ward_1", "distance": 1.0, "kind": kind},
    }
    if draw.random() < 0.7:
        found["chain"] = rows_of(draw, victims)
    if draw.random() < 0.2:  # as the oldest versions
        del found["members"]
    return found


def violated(spec, at, who, evidence):
    return Verdict(
        spec=spec, robustness=-1.0, violated=True, violated_at=at, who=tuple(who), evidence=evidence
    )


def random_run(draw):
    verdicts = []
    if draw.random() < 0.8:
        found = claim(draw)
        found["others"] = [claim(draw) for _ in range(draw.choice([0, 0, 1, 2]))]
        who = found.get("members", ROBOTS[:2])
        verdicts.append(violated("no_deadlock", draw.uniform(60.0, 95.0), who, found))
    for spec in OTHERS:
        if draw.random() < 0.3:
            evidence = {"since": draw.uniform(0.0, 90.0)} if draw.random() < 0.5 else {}
            if spec == "progress" and draw.random() < 0.5:
                evidence["held_by"] = draw.sample(["wall", "robot"], draw.randint(0, 2))
            at = draw.choice([None, draw.uniform(0.0, 120.0)])
            who = draw.sample(ROBOTS, draw.randint(0, 2))
            verdicts.append(violated(spec, at, who, evidence))
    return verdicts


def test_the_form_of_rules_1_is_kept():
    draw = random.Random(5)
    told = [signature_before(random_run(draw)) for _ in range(RUNS)]
    assert len(set(told)) > 500
    assert hashlib.sha256("\n".join(told).encode()).hexdigest() == DIGEST
