"""Hypothesis strategies for the values that flow through the house."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.geometry import rectangle, transform
from mrta_falsify.core.world import (
    LINKS,
    Blockage,
    CommsOutage,
    Furniture,
    HumanSpec,
    RobotSpec,
    Room,
    Task,
    Wall,
    World,
)

SIZE = 40.0  # m, side of generated floors


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, allow_infinity=False)


points = st.tuples(numbers(0.0, SIZE), numbers(0.0, SIZE))
polygons = st.builds(
    lambda place, yaw, size: frozen_array(transform(rectangle(*size), (*place, yaw))),
    points,
    numbers(-np.pi, np.pi),
    st.tuples(numbers(0.1, 4.0), numbers(0.1, 4.0)),
)


def _named(kind: str, build, items: st.SearchStrategy, most: int) -> st.SearchStrategy[tuple]:
    return st.lists(items, max_size=most).map(
        lambda found: tuple(build(f"{kind}{i}", item) for i, item in enumerate(found))
    )


@st.composite
def worlds(draw: st.DrawFn) -> World:
    """Any world that obeys the schema; robots may overlap with each other and with walls."""
    rooms = draw(st.lists(points, min_size=1, max_size=5))
    robots = draw(
        _named(
            "robot",
            lambda name, pose: RobotSpec(name=name, pose=frozen_array(pose)),
            st.tuples(numbers(0.0, SIZE), numbers(0.0, SIZE), numbers(-np.pi, np.pi)),
            4,
        )
    )
    number = st.integers(0, len(rooms) - 1)
    tasks = draw(
        st.lists(
            st.builds(
                lambda arrival, start, end, slack: Task(
                    arrival=arrival, start=start, end=end, deadline=arrival + slack
                ),
                numbers(0.0, 500.0),
                number,
                number,
                numbers(0.0, 500.0),
            ),
            max_size=5,
        )
    )
    return World(
        name=draw(st.text(min_size=1, max_size=12)),
        bounds=frozen_array([0.0, 0.0, SIZE, SIZE]),
        walls=draw(_named("wall", lambda n, p: Wall(name=n, polygon=p), polygons, 3)),
        furniture=draw(
            _named("item", lambda n, p: Furniture(name=n, kind="bed", polygon=p), polygons, 3)
        ),
        rooms=tuple(Room(name=f"room{i}", point=frozen_array(p)) for i, p in enumerate(rooms)),
        travel_times=frozen_array(np.zeros((len(rooms), len(rooms)))),
        robots=robots,
        humans=draw(
            _named(
                "human",
                lambda n, route: HumanSpec(name=n, route=frozen_array(route)),
                st.lists(points, min_size=1, max_size=4),
                3,
            )
        ),
        tasks=tuple(tasks),
        events=draw(_events(tuple(robot.name for robot in robots))),
        seed=draw(st.integers(0, 2**63 - 1)),
    )


def _events(robots: tuple[str, ...]) -> st.SearchStrategy[tuple]:
    window = st.tuples(numbers(0.0, 100.0), numbers(0.0, 100.0)).map(sorted)
    blockage = st.tuples(st.just("blockage"), window, polygons)
    names = st.sets(st.sampled_from(robots)) if robots else st.just(set())
    outage = st.tuples(
        st.just("outage"), window, st.tuples(names, st.sets(st.sampled_from(LINKS), min_size=1))
    )

    def build(name: str, entry):
        kind, (start, end), detail = entry
        if kind == "blockage":
            return Blockage(name=name, polygon=detail, start=start, end=end)
        who, links = detail
        return CommsOutage(
            name=name,
            robots=tuple(sorted(who)),
            links=tuple(sorted(links)),
            start=start,
            end=end,
        )

    return _named("event", build, st.one_of(blockage, outage), 3)
