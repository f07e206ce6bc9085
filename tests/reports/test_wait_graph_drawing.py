"""What the wait-for graph of a report shows: who waits for whom, and the things that took part."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.wait_account import PresentObject, WaitAccount, WaitsFor
from mrta_falsify.core.world import RobotSpec, World
from reports.wait_graph_drawing import draw_wait_graph


@pytest.fixture
def world():
    robots = tuple(
        RobotSpec(name=f"robot{i}", pose=frozen_array(np.array([i, 0.0, 0.0]))) for i in (1, 2, 3)
    )
    return World(name="one", bounds=frozen_array([0.0, 0.0, 4.0, 3.0]), robots=robots)


@pytest.mark.parametrize(
    ("cause", "node"),
    [("no-path", "no way"), ("wall", "solid"), ("queue", "the queue")],
)
def test_the_node_fits_the_cause(cause, node, world):
    account = WaitAccount(waits=(WaitsFor("robot1", cause),), members=("robot1",))
    assert f"robot1 waits for {node} ({cause})" in draw_wait_graph(account, world)


def test_a_robot_with_nothing_in_its_way_waits_for_no_node(world):
    waits = (WaitsFor("robot1", "stalled"), WaitsFor("robot2", "barrier", "robot1"))
    account = WaitAccount(waits=waits, members=("robot1",), victims=("robot2",))
    assert account.nodes == ("robot2", "robot1")
    assert draw_wait_graph(account, world).count("<polygon") == 1
    alone = WaitAccount(waits=waits[:1], members=("robot1",))
    assert (alone.arrows, alone.nodes) == ((), ("robot1",))


def test_every_arrow_of_a_cycle_is_drawn_and_its_root_has_a_rim(world):
    names = ("robot1", "robot2", "robot3")
    waits = tuple(
        WaitsFor(a, "barrier", b) for a, b in zip(names, names[1:] + names[:1], strict=True)
    )
    drawn = draw_wait_graph(WaitAccount(waits=waits, members=names), world)
    assert drawn.count("<polygon") == 3  # heads of arrows
    assert drawn.count('stroke="var(--bad)" stroke-width="3"') == 1


def test_things_and_those_who_push_them_are_nodes(world):
    account = WaitAccount(
        waits=(WaitsFor("robot1", "no-path", resource="bed2"),),
        members=("robot1",),
        objects=(PresentObject("bed2", "furniture", carried_by="porter1"),),
    )
    drawn = draw_wait_graph(account, world)
    assert "robot1 waits for bed2 (no-path)" in drawn
    assert "bed2 is pushed by porter1" in drawn
    assert drawn.count("<circle") == 3
    assert ">porter1</text>" in drawn


def test_labels_of_crossing_arrows_do_not_hide_each_other(world):
    names = [f"robot{i}" for i in range(1, 6)]
    pairs = [(i, (i + step) % 5) for step in (1, 3) for i in range(5)]
    waits = tuple(WaitsFor(names[a], "cluster", names[b]) for a, b in pairs)
    drawn = draw_wait_graph(WaitAccount(waits=waits, members=tuple(names)), world)
    texts = re.findall(r'<text x="([\d.-]+)" y="([\d.-]+)"[^>]*>cluster</text>', drawn)
    assert len(texts) == len(pairs)
    places = [(float(x), float(y)) for x, y in texts]
    for (x, y), (u, v) in itertools.combinations(places, 2):
        assert abs(x - u) > 40.0 or abs(y - v) > 11.0  # the label has seven letters of 11 px
