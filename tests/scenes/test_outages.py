"""Each communication link cut for 20 s (DESIGN.md, "Communication outages").

Robot 1 follows robot 2 down a corridor when robot 1's link goes down.
"""

from __future__ import annotations

import numpy as np
import pytest

from mrta_falsify.core.fleet import Phase
from mrta_falsify.core.world import LINKS
from mrta_falsify.testing.watching import (
    AT_REST,
    events,
    first_time,
    separation,
    span,
    speed,
    tick_of,
    watch,
    went_well,
    when,
)
from tests.scenes import worlds

CUT, BACK = worlds.OUTAGE
LIFETIME = 0.25  # s, a remote command older than this is not followed
ALL = ("robot1", "robot2")


def outage(link, who=("robot1",)):
    return watch(worlds.two_robots_in_a_row(link, who=who))


@pytest.mark.parametrize(
    "who",
    [
        pytest.param(("robot1",), id="one robot"),
        pytest.param(ALL, id="all robots", marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("link", LINKS)
def test_every_task_is_done_without_contact_whatever_link_is_cut(link, who):
    outcome = outage(link, who)
    assert went_well(outcome)
    for kind, time in (("comms-lost", CUT), ("comms-back", BACK)):
        found = events(outcome.trace, kind, time=time)
        assert [(e.robot, e.detail) for e in found] == [(i, link) for i in range(len(who))]


@pytest.mark.parametrize("link", LINKS)
def test_nothing_changes_before_the_link_is_cut(link):
    whole, cut = outage(None).trace, outage(link).trace
    before = span(whole, 0.0, CUT)
    np.testing.assert_array_equal(whole.columns["pose"][before], cut.columns["pose"][before])


class TestLeaderLink:
    def test_robot_follows_until_the_link_is_cut_and_leads_itself_then(self):
        trace = outage("leader").trace
        leader = trace.columns["leader"][:, 0]
        assert (leader[span(trace, 2.0, CUT)] == 1).all()
        assert (leader[span(trace, CUT, BACK)] == 0).all()

    def test_last_command_holds_for_a_quarter_of_a_second(self):
        trace = outage("leader").trace
        command = trace.columns["command"][:, 0]
        last = command[tick_of(trace, CUT) - 1]
        held = command[span(trace, CUT, CUT + LIFETIME - trace.dt)]
        np.testing.assert_array_equal(held, np.broadcast_to(last, held.shape))
        assert command[tick_of(trace, CUT + LIFETIME + trace.dt), 0] < last[0] - 0.01

    def test_robot_then_brakes_to_rest_and_goes_on_alone(self):
        outcome = outage("leader")
        trace, own = outcome.trace, speed(outcome.trace, 0)
        rest = first_time(trace, own <= AT_REST + 0.01, after=CUT)
        assert rest < CUT + LIFETIME + 2.0
        braking = own[span(trace, CUT + LIFETIME + trace.dt, rest)]
        assert (np.diff(braking) < 0.0).all()
        assert own[span(trace, rest, BACK)].max() > 0.5
        assert when(trace, "granted", 0, resource="ward_4") < BACK

    def test_robot_whose_leader_lost_its_link_brakes_or_leads_itself_as_well(self):
        trace = outage("leader", ("robot2",)).trace
        assert (trace.columns["leader"][span(trace, CUT, BACK), 0] == 0).all()
        assert separation(trace, 0, 1).min() > 0.5


class TestStatesLink:
    def test_robot_that_does_not_hear_the_others_stops_until_it_does(self):
        trace = outage("states").trace
        own = speed(trace, 0)
        assert (own[span(trace, CUT + 1.5, BACK)] < AT_REST).all()
        assert own[span(trace, BACK, BACK + 3.0)].max() > 0.5

    def test_robot_that_is_not_heard_is_in_no_cluster(self):
        trace = outage("states").trace
        cluster = trace.columns["cluster"]
        assert (cluster[tick_of(trace, CUT) - 1] == 0).all()
        assert (cluster[span(trace, CUT, BACK)] == [0, 1]).all()

    def test_the_others_go_on(self):
        trace = outage("states").trace
        assert when(trace, "picked-up", 1) < BACK


class TestPlannerLink:
    def test_robot_uses_up_its_path_and_waits_for_a_new_one(self):
        trace = outage("planner").trace
        during = [e.time for e in events(trace, "replanned", 0) if CUT <= e.time < BACK]
        assert not during
        assert speed(trace, 0)[span(trace, CUT, CUT + 3.0)].min() > 0.5  # it has a path
        waits = trace.columns["phase"][:, 0] == Phase.PLANNING
        since = first_time(trace, waits, after=CUT)
        assert since < BACK
        waiting = span(trace, since + 2.0, BACK)
        assert waits[waiting].all()
        assert (speed(trace, 0)[waiting] < AT_REST).all()

    def test_robot_plans_as_soon_as_the_link_is_back(self):
        trace = outage("planner").trace
        assert events(trace, "replanned", 0, time=BACK)
        assert speed(trace, 0)[span(trace, BACK, BACK + 3.0)].max() > 0.5

    def test_the_others_get_their_plans(self):
        trace = outage("planner").trace
        assert [e for e in events(trace, "replanned", 1) if CUT <= e.time < BACK]


class TestDispatcherLink:
    def test_robot_finishes_its_itinerary(self):
        trace, whole = outage("dispatcher").trace, outage(None).trace
        for kind in ("picked-up", "dropped-off"):
            assert when(trace, kind, 0) == when(whole, kind, 0)
        assert when(trace, "picked-up", 0) < BACK + 5.0

    def test_new_task_goes_to_a_robot_that_can_be_reached(self):
        trace = outage("dispatcher").trace
        assert [e.robot for e in events(trace, "assigned", task=2)] == [1]
        assert when(trace, "assigned", task=2) == 15.0

    def test_new_task_waits_while_nobody_can_be_reached(self):
        trace = outage("dispatcher", ALL).trace
        assigned = when(trace, "assigned", task=2)
        assert BACK <= assigned < BACK + 1.0
        before = events(trace, "allocated")[2]
        assert before.time == 15.0
        assert "robot" in before.detail
