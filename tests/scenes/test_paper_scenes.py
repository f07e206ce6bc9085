"""The scenes that the paper shows (its figures 2, 5 and 9), and a corridor blocked mid-run."""

from __future__ import annotations

import numpy as np
import pytest

from mrta_falsify.core.fleet import Phase
from mrta_falsify.testing.watching import (
    AT_REST,
    events,
    first_time,
    goal_is,
    longest,
    path_at,
    separation,
    span,
    speed,
    tick_of,
    violations,
    watch,
    went_well,
    when,
)
from tests.scenes import worlds

PAPERS_RULE = "controller.followers=brake"  # all but the leader of a cluster stand still


class TestIdleRobotMovedAside:
    """Figure 2c: the green agent has moved out of the way of the red agent."""

    @pytest.mark.parametrize("engine", ["kinematic", "bullet"])
    def test_leader_moves_an_idle_robot_out_of_its_way(self, engine):
        outcome = watch(worlds.idle_robot_in_a_passage(), engine=engine)
        trace = outcome.trace
        assert went_well(outcome)
        # It moved, although it never had anything to do of its own ...
        assert set(trace.columns["phase"][:, 1].tolist()) <= {Phase.OFF, Phase.IDLE}
        assert not events(trace, "makes-room")
        way = trace.columns["pose"][:, 1, :2] - trace.columns["pose"][0, 1, :2]
        assert np.hypot(*way.T).max() > 0.5
        # ... only while robot 1 commanded it, and no longer than robot 1 needed.
        moving = speed(trace, 1) > AT_REST
        assert (trace.columns["leader"][moving, 1] == 0).all()
        passed = first_time(trace, trace.columns["pose"][:, 0, 0] > 8.0)
        assert not moving[tick_of(trace, passed) :].any()

    def test_idle_robot_stays_where_nobody_leads_it(self):
        world = worlds.idle_robot_in_a_passage()
        outcome = watch(world, "controller=decentralised_cbf")
        assert outcome.contacts["robot_robot"] == 0
        assert (outcome.trace.columns["leader"][:, 1] == 1).all()


class TestQueueTail:
    """Figure 2d: planning to the end of the queue, then to the place that was given."""

    def test_robot_plans_to_the_tail_and_then_into_an_empty_room(self):
        world = worlds.queue_of_an_empty_room()
        outcome = watch(world)
        trace = outcome.trace
        tail, room = world.resources[2].spots[-1], world.rooms[2].point
        given = when(trace, "granted", 0, resource="ward_2")
        before, after = tick_of(trace, given) - 1, tick_of(trace, given) + 2
        assert went_well(outcome)
        assert np.hypot(*(path_at(trace, 0, before)[-1] - tail)) < 0.3
        assert trace.columns["queue"][: before + 1, 0].max() == -1  # it knew of no place yet
        assert goal_is(trace, 0, room)[after]
        assert events(trace, "replanned", 0, time=given)
        assert path_at(trace, 0, after) is not path_at(trace, 0, before)
        arrived = when(trace, "picked-up", 0)
        assert np.hypot(*(path_at(trace, 0, tick_of(trace, arrived) - 2)[-1] - room)) < 0.3

    def test_robot_plans_to_the_tail_then_to_each_place_it_is_given(self):
        world = worlds.queue_of_a_busy_room()
        outcome = watch(world)
        trace = outcome.trace
        queue, room = trace.columns["queue"][:, 0], world.rooms[2].point
        spots = world.resources[2].spots
        asked = when(trace, "waits-for", 0, resource="ward_2")
        head = first_time(trace, queue == 0, after=asked)
        granted = when(trace, "granted", 0, resource="ward_2")
        assert went_well(outcome)
        assert asked < head < granted
        ends = [path_at(trace, 0, tick_of(trace, t))[-1] for t in (asked - 0.1, asked + 0.1)]
        assert np.hypot(*(ends[0] - spots[-1])) < 0.3  # the tail
        assert np.hypot(*(ends[1] - spots[1])) < 0.3  # second place
        assert goal_is(trace, 0, spots[0])[tick_of(trace, head + 0.1)]
        assert goal_is(trace, 0, room)[tick_of(trace, granted + 0.1)]
        for moment in (asked, head, granted):
            assert events(trace, "replanned", 0, time=moment)
        # It stood at the head spot until the room was free.
        place = trace.columns["pose"][tick_of(trace, granted), 0, :2]
        assert np.hypot(*(place - spots[0])) < 0.3
        assert trace.columns["phase"][tick_of(trace, granted) - 1, 0] == Phase.QUEUEING

    def test_room_has_one_robot_at_a_time_and_nobody_is_forgotten(self):
        outcome = watch(worlds.queue_of_a_busy_room())
        holder = None
        for event in outcome.trace.events:
            if event.resource != "ward_2":
                continue
            if event.kind == "granted":
                assert holder is None
                holder = event.robot
            elif event.kind == "released" and event.robot == holder:
                holder = None
        served = [e.robot for e in events(outcome.trace, "picked-up", resource="ward_2")]
        assert sorted(served) == [0, 1, 2]


class TestWaitThenReplan:
    """Figure 5: the green agent waits for the blue one, re-plans, and follows its path."""

    def test_follower_waits_for_the_leader_then_replans_and_goes(self):
        outcome = watch(worlds.meeting_at_a_door(), PAPERS_RULE)
        trace = outcome.trace
        ready = when(trace, "picked-up", 0)
        free = first_time(trace, trace.columns["leader"][:, 0] == 0, after=ready)
        waiting = span(trace, ready, free)
        assert went_well(outcome)
        assert free - ready > 3.0
        assert (speed(trace, 0)[waiting] < AT_REST).all()
        assert (trace.columns["leader"][waiting, 0] == 1).all()
        assert (speed(trace, 1)[waiting] > 0.5).mean() > 0.8  # the other one passes
        causes = {s.edge.cause for s in trace.edges if s.edge.robot == 0 and s.edge.other == 1}
        assert "cluster" in causes
        again = [e.time for e in events(trace, "replanned", 0) if e.time > ready + 1.0]
        assert again
        assert again[0] <= free + 5.0
        moves = first_time(trace, speed(trace, 0) > 0.3, after=free)
        assert moves < free + 3.0

    def test_by_default_a_robot_waits_only_while_the_leader_needs_the_place(self):
        outcome = watch(worlds.meeting_in_a_corridor())
        trace = outcome.trace
        met = first_time(trace, separation(trace, 0, 1) < 4.0, after=5.0)
        parted = first_time(
            trace,
            trace.columns["pose"][:, 0, 0] < trace.columns["pose"][:, 1, 0] - 0.5,
            after=met,
        )
        meeting = span(trace, met, parted)
        assert went_well(outcome)
        # robot1 comes out of the room that robot2 is let into, so robot2 waits.
        assert longest(speed(trace, 1)[meeting] < AT_REST, trace.dt) >= 0.5
        assert speed(trace, 0)[meeting].min() > 0.3
        again = [e.time for e in events(trace, "replanned", 1) if met < e.time < parted + 5.0]
        assert again
        assert speed(trace, 1)[span(trace, parted, parted + 3.0)].max() > 0.5

    def test_default_rule_costs_less_time_than_the_papers(self):
        world = worlds.meeting_at_a_door()
        assert watch(world).sim_time < watch(world, PAPERS_RULE).sim_time


class TestLeadershipPassesOn:
    """Figure 9: three agents in a cluster; as the leader leaves, the next one leads the rest."""

    @pytest.mark.parametrize("rule", ["controller.followers=yield", PAPERS_RULE])
    def test_next_robot_leads_the_smaller_cluster(self, rule):
        outcome = watch(worlds.three_robots_close_together(), rule)
        trace = outcome.trace
        cluster, leader = trace.columns["cluster"], trace.columns["leader"]
        assert went_well(outcome)
        began = when(trace, "assigned", 0) + 0.5
        left = first_time(trace, cluster[:, 2] == 2, after=began)
        assert left < np.inf
        together = span(trace, began, left)
        assert (cluster[together] == 0).all()
        assert (leader[together] == 2).all()
        tick = tick_of(trace, left)
        assert leader[tick].tolist() == [1, 1, 2]
        assert cluster[tick].tolist() == [0, 0, 2]

    def test_under_the_papers_rule_one_robot_moves_at_a_time(self):
        trace = watch(worlds.three_robots_close_together(), PAPERS_RULE).trace
        cluster, leader = trace.columns["cluster"], trace.columns["leader"]
        began = when(trace, "assigned", 0) + 0.5
        shrunk = first_time(trace, cluster[:, 2] == 2, after=began)
        alone = first_time(trace, leader[:, 0] == 0, after=shrunk)
        before, between = span(trace, began, shrunk), span(trace, shrunk + 1.0, alone)
        assert (speed(trace, 0)[before] < AT_REST).all()
        assert (speed(trace, 1)[before] < AT_REST).all()
        assert speed(trace, 2)[before].max() > 0.5
        assert (speed(trace, 0)[between] < AT_REST).all()
        assert speed(trace, 1)[between].max() > 0.5
        assert speed(trace, 0)[tick_of(trace, alone) :].max() > 0.5

    def test_every_cluster_has_one_leader_and_it_is_active_where_one_is(self):
        trace = watch(worlds.three_robots_close_together()).trace
        cluster, leader = trace.columns["cluster"], trace.columns["leader"]
        for tick in range(0, len(trace), 5):
            for label in np.unique(cluster[tick]):
                members = np.flatnonzero(cluster[tick] == label)
                leaders = set(leader[tick, members].tolist())
                assert len(leaders) == 1
                assert leaders <= set(members.tolist())


class TestBlockedCorridor:
    """A corridor that is closed for a time, from the paper's list of future work."""

    def test_robot_waits_at_a_blocked_corridor_and_goes_when_it_is_open(self):
        world = worlds.blocked_corridor()
        outcome = watch(world)
        trace, bed = outcome.trace, world.events[0]
        assert went_well(outcome)
        lost = when(trace, "no-path", 0, detail="unreachable")
        assert bed.start <= lost < bed.start + 5.0
        closed = span(trace, lost + 2.0, bed.end)
        assert (speed(trace, 0)[closed] < AT_REST).all()
        assert (trace.columns["phase"][closed, 0] == Phase.PLANNING).all()
        assert "no-path" in {s.edge.cause for s in trace.edges if s.edge.robot == 0}
        found = [e.time for e in events(trace, "replanned", 0) if e.time >= bed.end]
        assert found[0] <= bed.end + 0.5
        assert bed.end < when(trace, "dropped-off", 0)

    def test_the_others_go_on_while_one_robot_has_no_path(self):
        world = worlds.blocked_corridor()
        trace = watch(world).trace
        assert when(trace, "dropped-off", 1) < world.events[0].end

    def test_robot_drives_round_a_blockage_that_leaves_a_gap(self):
        world = worlds.blocked_corridor(gap=1.2)
        outcome = watch(world)
        assert went_well(outcome)
        assert not events(outcome.trace, "no-path")
        x = outcome.trace.columns["pose"][:, 0, 0]
        assert first_time(outcome.trace, x > 8.0) < world.events[0].end

    def test_blockage_is_no_deadlock(self):
        assert violations(watch(worlds.blocked_corridor())) == {}
