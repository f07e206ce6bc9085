"""Which failures are one mode."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mrta_falsify.campaigns.signature import signature, signature_before
from mrta_falsify.campaigns.store import read_campaign
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import Resource, Room, World
from mrta_falsify.specs.deadlock.place_kind import kind_of_place

RECORDED = Path(__file__).parent.parent / "recorded" / "campaigns"


def row(robot, cause, blocked_by="", resource=""):
    return {"robot": robot, "cause": cause, "blocked_by": blocked_by, "resource": resource}


def stuck(rows, *, members=None, near="ward_1", kind="", distance=4.0, objects=(), at=40.0, **more):
    names = members or list(dict.fromkeys(r["robot"] for r in rows))
    place = {"x": 1.0, "y": 2.0, "near": near, "distance": distance, "kind": kind}
    evidence = {"members": names, "cycle": rows, "place": place, "onset": at - 2.0}
    return Verdict(
        spec="no_deadlock",
        robustness=-1.0,
        violated=True,
        violated_at=at,
        who=tuple(names),
        evidence={**evidence, "objects": list(objects), **more},
    )


RING = [row("a", "barrier", "b"), row("b", "barrier", "c"), row("c", "barrier", "a")]


def test_one_gridlock_beside_a_bed_is_one_mode_whichever_queue_is_near():
    bed = {"name": "bed2", "kind": "furniture", "carried_by": ""}
    found = {
        signature([stuck(RING, near=f"queue of ward_{i}", kind="corridor", objects=[bed])])
        for i in (1, 3, 5)
    }
    assert found == {"no_deadlock/3:barrier>barrier>barrier/corridor with furniture"}


def test_a_touch_after_the_deadlock_does_not_change_the_mode():
    gridlock = stuck(RING)
    touch = Verdict(
        spec="no_robot_static_contact", robustness=-0.001, violated=True, violated_at=38.45,
        who=("b",),
    )  # fmt: skip
    assert signature([touch, gridlock]) == signature([gridlock])


def test_the_cycle_is_written_the_same_from_whichever_robot_it_begins():
    rows = [row("a", "queue", "b", "ward"), row("b", "barrier", "c"), row("c", "barrier", "a")]
    turned = [row("z", "queue", "x", "hall"), row("x", "barrier", "y"), row("y", "barrier", "z")]
    assert signature([stuck(rows)]) == signature([stuck(turned[::-1], members=["z", "y", "x"])])
    assert signature([stuck(rows)]) == "no_deadlock/3:barrier>barrier>queue"


def test_who_merely_goes_first_and_who_stands_in_the_way_may_hang_on_a_centimetre():
    one = [row("a", "barrier", "b"), row("b", "cluster", "a")]
    other = [row("a", "barrier", "b"), row("b", "barrier", "a")]
    polite = [row("a", "cluster", "b"), row("b", "cluster", "a")]
    assert signature([stuck(one)]) == signature([stuck(other)])
    assert signature([stuck(polite)]) != signature([stuck(other)])


def test_what_else_a_member_stands_beside_does_not_split_a_mode():
    beside = [row("a", "barrier", "b"), row("a", "wall"), row("b", "barrier", "a")]
    without = [beside[0], beside[2]]
    assert signature([stuck(beside)]) == signature([stuck(without)])


@pytest.mark.parametrize(
    ("objects", "expected"),
    [
        ([("bed2", "furniture", "porter1")], "doorway with pushed furniture"),
        (
            [("bed2", "furniture", "porter1"), ("porter1", "person", "")],
            "doorway with pushed furniture",
        ),
        ([("nurse", "person", ""), ("bed", "furniture", "")], "doorway with furniture and person"),
        ([("wall_3", "wall", "")], "doorway"),
    ],
)
def test_the_kinds_of_things_and_people_that_took_part_are_part_of_the_mode(objects, expected):
    rows = [{"name": n, "kind": kind, "carried_by": by} for n, kind, by in objects]
    verdict = stuck([row("a", "wall")], kind="doorway", objects=rows)
    assert signature([verdict]) == f"no_deadlock/stuck:wall/{expected}"
    assert signature_before([verdict]) == f"no_deadlock/1:wall/{expected}"


def test_crashes_of_different_code_are_different_modes():
    def crash(layer, exception):
        evidence = {"kind": "crash", "layer": layer, "exception": exception}
        return Verdict(
            spec="stack_runs", robustness=-1.0, violated=True, violated_at=1.0, evidence=evidence
        )

    assert signature([crash("planner", "KeyError")]) == "stack_runs/crash/planner/KeyError"
    assert signature([crash("", "SIGSEGV")]) == "stack_runs/crash/SIGSEGV"


def test_claims_of_different_kinds_are_different_modes():
    claim = {"kind": "released", "task": -1, "robot": "a", "room": "ward_1", "reason": "inside"}
    verdict = Verdict(
        spec="honest_events", robustness=-1.0, violated=True, violated_at=1.0,
        evidence={"claims": [claim]},
    )  # fmt: skip
    assert signature([verdict]) == "honest_events/released"


def test_signatures_of_stored_failures_are_made_anew_from_their_verdicts():
    """Five rooms gave five modes of one cause in the version that stored these."""
    stalls = [r for r in read_campaign(RECORDED / "stalls").records if r.failed]
    assert len({record.signature for record in stalls}) == 5
    assert {signature(r.verdicts) for r in stalls} == {"no_deadlock/stuck:stalled/room"}
    assert {signature_before(r.verdicts) for r in stalls} == {"no_deadlock/1:stalled/room"}
    beds = {r.id: r for r in read_campaign(RECORDED / "beds").records if r.failed}
    assert signature(beds["0003"].verdicts) == "no_deadlock/stuck:queue/waiting spot"
    assert signature_before(beds["0003"].verdicts) == "no_deadlock/1:queue/waiting spot"
    assert (
        signature_before(beds["0005"].verdicts) == signature(beds["0005"].verdicts) == "deadlines"
    )


def test_nothing_violated_has_no_signature():
    assert signature([]) == signature_before([]) == ""


# --- kinds, and the form that knew none -----------------------------------------------------

BED = {"name": "bed2", "kind": "furniture", "carried_by": "porter1"}


def test_robots_that_each_cannot_go_on_are_no_deadlock():
    verdict = stuck([row("a", "wall"), row("b", "no-path")], kind="room")
    of_no_kind = "no_deadlock/2:no-path,wall/room"
    assert signature([verdict]) == of_no_kind  # as stored by a version that knew none
    verdict.evidence["kind"] = "stuck"
    assert signature([verdict]) == "no_deadlock/stuck:no-path,wall/room"
    assert signature_before([verdict]) == of_no_kind


def test_a_shut_place_is_signed_by_what_shut_it():
    nurse = {"name": "nurse", "kind": "person", "carried_by": ""}
    rows = [row("a", "no-path", "", "bed2"), row("a", "human", "nurse")]
    verdict = stuck(rows, kind="doorway", objects=[BED, nurse], shut_by=["bed2"])
    verdict.evidence["kind"] = "shut"
    assert signature([verdict]) == "no_deadlock/shut:pushed furniture/doorway"
    before = "no_deadlock/1:human+no-path/doorway with person and pushed furniture"
    assert signature_before([verdict]) == before


def test_the_form_before_is_of_the_edges_that_geometry_showed():
    """A removal that freed nobody has corrected the edge, and who is a member."""
    verdict = stuck(
        [row("a", "wall")],
        kind="room",
        objects=[BED],
        cycle_seen=[row("a", "barrier", "b"), row("b", "barrier", "a")],
        members_alone=["a", "b"],
    )
    assert signature([verdict]) == "no_deadlock/stuck:wall/room with pushed furniture"
    assert signature_before([verdict]) == "no_deadlock/2:barrier>barrier/room"


def test_the_gravest_claim_is_signed_and_the_first_one_in_the_form_before():
    shut = stuck([row("c", "wall")], kind="doorway", at=10.0).evidence | {"kind": "shut"}
    ring = stuck(RING, kind="corridor", at=90.0, others=[shut])
    assert signature([ring]) == "no_deadlock/3:barrier>barrier>barrier/corridor"
    assert signature_before([ring]) == "no_deadlock/1:wall/doorway"


def test_a_signature_survives_json():
    verdict = stuck(RING, kind="crossing")
    again = Verdict(**{**{f: getattr(verdict, f) for f in ("spec", "robustness", "violated")},
                       "evidence": json.loads(json.dumps(verdict.evidence))})  # fmt: skip
    assert signature([again]) == signature([verdict])


# --- kinds of place ------------------------------------------------------------------------


def square(x, y, half):
    return np.array([[x - half, y - half], [x + half, y - half], [x + half, y + half],
                     [x - half, y + half]])  # fmt: skip


@pytest.fixture(scope="module")
def floor():
    ward = Room(
        name="ward", point=np.array([2.0, 6.0]), door=np.array([[1.5, 4.0], [2.5, 4.0]]),
        area=square(2.0, 6.0, 2.0),
    )  # fmt: skip
    room = Resource(
        name="ward", room=0, spots=np.array([[4.0, 3.0]]), request_area=square(2.0, 5.0, 5.0),
        release_area=square(2.0, 5.0, 3.0),
    )  # fmt: skip
    lanes = [
        Resource(name=name, kind="corridor", request_area=area, release_area=area)
        for name, area in (("east", square(9.0, 0.0, 1.0)), ("north", square(10.5, 0.0, 1.0)))
    ]
    return World(
        name="floor", bounds=np.array([-1.0, -5.0, 20.0, 9.0]), rooms=(ward,),
        resources=(room, *lanes),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("points", "kind"),
    [
        ([[2.0, 6.5]], "room"),
        ([[2.0, 3.6]], "doorway"),
        ([[4.1, 3.1]], "waiting spot"),
        ([[8.5, 0.0]], "corridor"),
        ([[9.8, 0.2]], "crossing"),
        ([[16.0, 0.0]], "open floor"),
        ([[2.0, 6.5], [2.0, 3.6], [4.0, 3.0]], "doorway"),
        ([[16.0, 0.0], [8.5, 0.0]], "corridor"),
    ],
)
def test_robots_are_at_the_narrowest_kind_of_place_that_one_of_them_is_at(floor, points, kind):
    assert kind_of_place(floor, np.array(points)) == kind
