"""Verdicts in words: the root first, with what took part, and what followed."""

from __future__ import annotations

import pytest

from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.wait_account import PresentObject, WaitsFor, wait_account
from reports.sentences import (
    NOISE,
    account_sentences,
    beside_sentences,
    blocked_text,
    consequence_sentence,
    violation_sentence,
    wait_sentence,
    who_text,
)

BED = {"name": "bed2", "kind": "furniture", "carried_by": "porter1"}


def row(robot, cause, blocked_by="", resource=""):
    return {"robot": robot, "cause": cause, "blocked_by": blocked_by, "resource": resource}


def violated(spec, *who, at=42.0, **evidence):
    return Verdict(
        spec=spec, robustness=-1.0, violated=True, violated_at=at, who=who, evidence=evidence
    )


def stuck(*rows, members, **evidence):
    shown = {"members": members, "cycle": rows, "onset": 40.0, "chain": [], **evidence}
    return violated("no_deadlock", *members, **shown)


PAIR = (row("robot1", "barrier", "robot2"), row("robot2", "barrier", "robot1"))


def test_a_symmetric_pair_waits_for_each_other_and_has_no_victim():
    assert violation_sentence(stuck(*PAIR, members=["robot1", "robot2"])) == (
        "robot1 and robot2 wait for each other (found at 42.0 s); "
        "they have made no progress since 40.0 s."
    )


def test_the_headline_names_the_root_first_then_what_took_part_then_who_is_held_up():
    verdict = stuck(
        row("robot3", "no-path"),
        members=["robot3"],
        victims=["robot1", "robot2"],
        objects=[BED, {"name": "porter1", "kind": "person", "carried_by": ""}],
    )
    assert violation_sentence(verdict) == (
        "robot3 is stuck behind bed2 (pushed by porter1) (found at 42.0 s); "
        "it has made no progress since 40.0 s; while it stands, robot1 and robot2 do "
        "not get to the next stop either."
    )
    assert who_text(verdict) == "robot3 (robot1, robot2)"
    ring = stuck(*PAIR, members=["robot1", "robot2"], root="robot2", objects=[BED])
    assert violation_sentence(ring).startswith(
        "robot2 and robot1 wait for each other beside bed2 (pushed by porter1) (found"
    )


def test_a_robot_that_is_not_yet_in_the_way_is_told_by_what_goes_on_without_it():
    later = {**row("robot1", "barrier", "robot2"), "seen": False}
    account = wait_account(stuck(later, PAIR[1], members=["robot1", "robot2"]))
    assert account_sentences(account) == (
        "robot1 goes on once robot2 is gone.",
        "robot2 cannot drive on because robot1 stands in its path.",
    )
    assert [arrow.text for arrow in account.arrows] == ["held by", "barrier"]


def test_members_that_stand_apart_have_their_own_places_and_no_common_one():
    mean = {"x": 5.0, "y": 0.0, "near": "ward", "distance": 4.0, "kind": "room"}
    places = {
        "robot1": {"x": 1.0, "y": 0.0, "near": "kitchen", "distance": 0.2, "kind": "room"},
        "robot2": {"x": 9.0, "y": 0.0, "near": "lab", "distance": 1.5, "kind": "room"},
    }
    apart = stuck(*PAIR, members=["robot1", "robot2"], place=mean, places=places)
    assert "ward" not in violation_sentence(apart)
    assert account_sentences(wait_account(apart))[-1] == (
        "When it was found, robot1 was at kitchen (x 1.0 m, y 0.0 m) and "
        "robot2 was 1.5 m from lab (x 9.0 m, y 0.0 m)."
    )
    near = {**places, "robot2": {**places["robot1"], "x": 2.5}}
    together = stuck(*PAIR, members=["robot1", "robot2"], place=mean, places=near)
    assert "4.0 m from ward" in violation_sentence(together)
    assert len(account_sentences(wait_account(together))) == len(PAIR)


@pytest.mark.parametrize(
    ("evidence", "told"),
    [
        ({}, "robot1 and robot2 wait for each other (found"),  # of a version that gave no bound
        ({"stands_for": 240.0}, "robot1 and robot2 wait for each other for at least 240 s (found"),
        (
            {"stands_for": 240.0, "for_good": True},
            "robot1 and robot2 wait for each other for good (found",
        ),
        (
            {"kind": "stuck", "stands_for": 240.0},
            "robot1 and robot2 are stuck for at least 240 s (found",
        ),
    ],
)
def test_a_sentence_says_for_how_long_robots_were_shown_to_stand(evidence, told):
    found = violation_sentence(stuck(*PAIR, members=["robot1", "robot2"], **evidence))
    assert found.startswith(told)
    assert "deadlock" not in found


def test_a_shut_place_is_named_with_what_shut_it_and_since_when():
    verdict = stuck(
        row("robot3", "no-path", resource="bed2"),
        members=["robot3"],
        objects=[BED],
        kind="shut",
        shut_room="ward_3",
        shut_by=["bed2"],
        shut_since=141.2,
        stands_for=240.0,
    )
    assert violation_sentence(verdict) == (
        "ward_3 is shut by bed2 (pushed by porter1) since 141 s: robot3 cannot go on for at least "
        "240 s (found at 42.0 s); it has made no progress since 40.0 s."
    )


def test_what_only_work_freed_and_what_the_run_refuted_is_told_beside_the_verdict():
    holds = Verdict(
        spec="no_deadlock",
        robustness=4.0,
        violated=False,
        evidence={
            "held_until_work": [{"robots": ["robot1"], "since": 12.0, "until": 60.0}],
            "contradictions": [
                {"members": ["robot2"], "claimed_at": 10.0, "refuted_at": 44.0, "robot": "robot2"}
            ],
        },
    )
    held, refuted = beside_sentences([holds])
    assert held == ("robot1 was held until new work arrives, from 12.0 s to 60.0 s: no failure.")
    assert "at 10.0 s it claimed that robot2 stands, at 44.0 s the run refuted it" in refuted
    assert beside_sentences([stuck(*PAIR, members=["robot1", "robot2"])]) == ()


def test_no_path_says_whose_bed_fills_the_door():
    bed = PresentObject("bed2", "furniture", "porter1")
    told = "robot3 has a goal but no path to it; bed2 (pushed by porter1) cuts it off."
    assert wait_sentence(WaitsFor("robot3", "no-path", resource="bed2"), [bed]) == told
    assert wait_sentence(WaitsFor("robot3", "no-path", resource="unreachable"), [bed]) == (
        "robot3 has a goal but no path to it; walls cut it off for good."
    )


def test_no_path_blames_nothing_where_nothing_is_known_to_close_the_way():
    bed = PresentObject("bed2", "furniture", "porter1")
    told = wait_sentence(WaitsFor("robot3", "no-path"), [bed])
    assert told == "robot3 has a goal but no path to it."


def test_what_closes_the_way_together_is_told_together():
    beds = row("robot3", "no-path", resource="bed1"), row("robot3", "no-path", resource="bed2")
    account = wait_account(stuck(*beds, members=["robot3"], objects=[BED]))
    assert account_sentences(account) == (
        "robot3 has a goal but no path to it; bed1 and bed2 (pushed by porter1) cut it off.",
    )


def test_a_free_room_that_is_not_granted_is_told_as_such():
    told = wait_sentence(WaitsFor("robot1", "queue", resource="ward_1"))
    assert told == "robot1 waits for ward_1, and no robot keeps it out."


def test_each_wait_is_told_once_the_roots_first():
    verdict = stuck(*PAIR, PAIR[0], members=["robot1", "robot2"], root="robot2")
    assert account_sentences(wait_account(verdict)) == (
        "robot2 cannot drive on because robot1 stands in its path.",
        "robot1 cannot drive on because robot2 stands in its path.",
    )


def test_a_touch_after_the_onset_is_told_as_a_consequence():
    gridlock = stuck(*PAIR, members=["robot1", "robot2"])
    touch = violated("no_robot_static_contact", "robot1", at=40.45)
    assert consequence_sentence(touch, gridlock) == (
        "A consequence of it, 0.5 s after the onset: "
        "a robot touched a wall or furniture at 40.5 s: robot1."
    )
    other = violated("no_robot_static_contact", "robot9", at=40.45)
    assert consequence_sentence(other, gridlock) == violation_sentence(other)


@pytest.mark.parametrize(
    ("verdict", "expected"),
    [
        (
            violated("stack_runs", kind="crash", layer="planner", exception="KeyError"),
            "The planner crashed at 42.00 s: KeyError.",
        ),
        (violated("stack_runs", kind="hang"), "The stack hung at 42.00 s."),
        (
            violated("repeatable", "robot1", field="command", first="0.1", again="0.2"),
            "Asked the same again at 42.00 s, the stack answered otherwise: command was 0.1 and "
            f"then 0.2. {NOISE}",
        ),
        (
            violated("exclusive_use", "robot1", "robot2", resource="ward_1", capacity=1),
            "More robots were in a resource than it has room for at 42.0 s: robot1 and robot2; "
            "ward_1 has room for 1.",
        ),
        (
            violated(
                "honest_events", "robot1",
                claims=[{"kind": "dropped-off", "task": 3, "room": "ward_1", "reason": "12 m"}],
            ),
            "The stack said what its robots did not do at 42.0 s: robot1; it claimed dropped-off "
            "of task3 at ward_1: 12 m.",
        ),
        (
            violated("no_robot_static_contact", "robot1", nearest={"x": 1.0, "y": -2.0}),
            "A robot touched a wall or furniture at 42.0 s: robot1 at x 1.0 m, y -2.0 m.",
        ),
    ],
)  # fmt: skip
def test_the_evidence_of_other_violations_is_in_their_sentence(verdict, expected):
    assert violation_sentence(verdict) == expected


@pytest.mark.parametrize(
    ("spent", "expected"),
    [
        ({}, "until 9.0 s, robot1 had not been blocked"),
        ({"stalled": 0.05}, "at 9.0 s, robot1 stood with nothing in the way"),
        ({"solid": 0.0}, "at 9.0 s, robot1 was held up by solid"),
        ({"stalled": 2.5}, "until 9.0 s, robot1 had stood for 2.5 s (nothing in the way)"),
        (
            {"barrier": 1.0, "queue": 3.0, "stalled": 2.0, "wall": 0.01},
            "until 9.0 s, robot1 had stood for 3.0 s (queue), 1.0 s (barrier) and 2.0 s "
            "(nothing in the way) (times may overlap)",
        ),
    ],
)
def test_what_held_robots_up_is_said_by_cause(spent, expected):
    assert blocked_text("robot1", 9.0, spent) == expected


def test_a_victim_with_nothing_in_its_way_is_told_by_whom_it_is_held():
    victim = {"chain": [row("robot3", "stalled")], "victims": ["robot3"]}
    alone = stuck(row("robot4", "stalled"), members=["robot4"], **victim)
    assert account_sentences(wait_account(alone)) == (
        "robot4 has a goal and nothing in its way, but does not drive.",
        "robot3 has nothing in its way, but goes on only once robot4 is gone.",
    )
    pair = stuck(*PAIR, members=["robot1", "robot2"], **victim)
    assert account_sentences(wait_account(pair))[-1] == (
        "robot3 has nothing in its way, but goes on only without one of robot1 and robot2."
    )


@pytest.mark.parametrize(
    ("held", "text"),
    [
        (
            {"held_s": 42.5, "held": {"robot": 40.0, "person": 3.0}, "holders": {"robot2": 40.0}},
            "robot1 was held for 42.5 of the 90.5 s since 82.0 s: by robots for 40.0 s and people "
            "for 3.0 s (longest by robot2).",
        ),
        (
            {"held_s": 1.0, "held": {"solid": 1.0}, "holders": {}},
            "robot1 was held for only 1.0 of the 90.5 s since 82.0 s.",
        ),
    ],
)
def test_lost_progress_says_what_held_the_robot(held, text):
    evidence = {"robot": "robot1", "since": 82.0, "time": 172.5, "held_by": [], **held}
    verdict = Verdict(
        spec="progress",
        robustness=-0.5,
        violated=True,
        violated_at=172.5,
        who=("robot1",),
        evidence=evidence,
    )
    start = "A robot with work made no progress at 172.5 s: robot1; "
    assert violation_sentence(verdict) == start + text
