"""Are worlds that are called impossible for a shut room impossible, and are shut rooms found?

    python -m experiments.validity.shut_rooms run ROWS.jsonl [--count 100] [--called 300]
    python -m experiments.validity.shut_rooms table ROWS.jsonl

Small hospital floors, each with things put at one or two doors at random. Three parts:

- `called`: worlds in which `possibility` finds a room shut. They are run on two stacks, the shipped
  one and one that plans for the half width of the narrowest body; neither may deliver the tasks.
- `shut`: worlds shut by hand, of which it must find nearly all.
- `open`: worlds with a gap that a robot passes, of which it must find none. Those in which either
  stack does the task into the room, or out of it, are counted as well: there the gap was passed.

What is shut by hand, and what has a gap, is decided by distances between neighbours at the door:
jamb, things in their order, jamb. `run` goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import itertools
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry import Polygon, box

from mrta_falsify.core.probability import blaker_interval
from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.geometry import rectangle, transform
from mrta_falsify.core.tight_ways import things_text
from mrta_falsify.core.world import Blockage, Furniture, HumanSpec, RobotSpec, Task, World
from mrta_falsify.possibility import body_disc, look_at
from mrta_falsify.trial import campaign_specifications
from scenic_worlds.layouts.hospital import hospital
from simulator_interface.engines.bodies import check_start_footprints
from simulator_interface.simulate import frames_of

HORIZON = 150.0  # s
SHUT = 0.25  # m; no Waffle passes less, whose body is 0.265 m wide
PASSED = 0.34  # m; a Waffle passes more, whose body is 0.305 m from wheel to wheel
BESIDE = 1.2  # m on either side of a door in which walls count as its jamb
PARTS = ("called", "shut", "open")

Row = dict[str, Any]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parts = parser.add_subparsers(dest="part", required=True)
    running = parts.add_parser("run")
    running.add_argument("rows", type=Path)
    running.add_argument("--count", type=int, default=100, help="worlds of `shut`, and of `open`")
    running.add_argument("--called", type=int, default=300, help="worlds of `called`")
    running.add_argument("--seed", type=int, default=45)
    showing = parts.add_parser("table")
    showing.add_argument("rows", type=Path)
    args = parser.parse_args()
    if args.part == "run":
        for part, count in (("shut", args.count), ("called", args.called), ("open", args.count)):
            _run_part(part, count, args.seed, args.rows)
    print("\n".join(table(_read(args.rows))))


def _run_part(part: str, count: int, seed: int, path: Path) -> None:
    rows = [row for row in _read(path) if row["part"] == part and row["seed"] == seed]
    first = max((row["draw"] for row in rows), default=-1) + 1
    for draw in itertools.count(first):
        if len(rows) >= count:
            return
        made = _made(part, seed, draw)
        if made is None:
            continue
        world, room = made
        row = {"part": part, "seed": seed, "draw": draw, **_judged(part, world, room)}
        rows.append(row)
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")


def _read(path: Path) -> list[Row]:
    """Read the whole lines of a file that may be missing."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    return [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]


# --- worlds -----------------------------------------------------------------------------------


def _made(part: str, seed: int, draw: int) -> tuple[World, int] | None:
    """Make a world of a part, and the room at whose door things stand; None: this draw is none."""
    random = np.random.default_rng((seed, PARTS.index(part), draw))
    world = _floor(random)
    rooms = random.permutation(len(world.rooms)).tolist()
    room, others = rooms[0], rooms[1:]
    things = list(_things(random, world, room))
    kind = _kind(world, room, things)
    if kind is None or (part != "called" and kind != part):
        return None
    if part == "called" and random.random() < 0.4:
        things += _things(random, world, others[0])
    world = _furnished(random, world, things)
    world = _manned(random, world, room, others, binds=part == "called")
    try:
        check_start_footprints(world)
    except InputError:
        return None
    if part == "called" and not look_at(world, campaign_specifications()).shut:
        return None
    return world, room


def _floor(random: np.random.Generator) -> World:
    return hospital(
        shape=str(random.choice(["line", "ell", "ring", "comb"])),  # type: ignore[arg-type]
        rooms=int(random.integers(3, 6)),
        corridor_width=float(random.uniform(1.9, 2.8)),
        door_width=[float(random.uniform(0.8, 1.4)) for _ in range(5)],
        door_offset=[float(random.uniform(0.0, 1.0)) for _ in range(5)],
        spots=1,
        station=False,
        parking=2,
    )


def _things(random: np.random.Generator, world: World, room: int) -> Iterator[Polygon]:
    """Put one thing into a door, or two beside each other, or one before it."""
    one, other = np.asarray(world.rooms[room].door)
    along = (other - one) / np.hypot(*(other - one))
    width, angle = float(np.hypot(*(other - one))), float(np.arctan2(along[1], along[0]))
    across = np.array([-along[1], along[0]])
    how = random.choice(["in", "pair", "before"], p=[0.5, 0.25, 0.25])
    if how == "before":
        length, depth = width + random.uniform(0.3, 1.5), random.uniform(0.4, 0.8)
        side = random.choice([-1.0, 1.0]) * (depth / 2 + random.uniform(0.05, 0.7))
        middle = (one + other) / 2 + random.uniform(-0.3, 0.3) * along + side * across
        turn = random.uniform(-0.15, 0.15)
        yield _placed(length, depth, middle, angle + turn)
        return
    count = 2 if how == "pair" else 1
    for i in range(count):
        share = width / count
        length = random.uniform(0.3, 1.0) * share if count == 1 else random.uniform(0.4, 1) * share
        middle = one + (i + 0.5) * share * along + random.uniform(-0.25, 0.25) * share * along
        middle = middle + random.uniform(-0.25, 0.25) * across
        yield _placed(length, random.uniform(0.3, 0.9), middle, angle + random.uniform(-0.6, 0.6))


def _placed(length: float, depth: float, middle: Array, angle: float) -> Polygon:
    return Polygon(transform(rectangle(length, depth), (*middle, angle)))


def _kind(world: World, room: int, things: Sequence[Polygon]) -> str | None:
    """Say whether things shut a door, or leave a gap that a robot passes; None: neither is sure."""
    one, other = np.asarray(world.rooms[room].door)
    middle = (one + other) / 2
    along = (other - one) / np.hypot(*(other - one))
    walls = shapely.union_all([Polygon(wall.polygon) for wall in world.walls])
    if any(walls.intersection(thing).area > 1e-6 for thing in things):
        return None
    if any(a.intersects(b) for a, b in itertools.combinations(things, 2)):
        return None
    turn = float(np.arctan2(along[1], along[0]))
    half = float(np.hypot(*(other - one))) / 2
    jambs = [
        walls.intersection(
            Polygon(transform(np.array(box(*limits).exterior.coords)[:-1], (*middle, turn)))
        )
        for limits in (
            (-half - BESIDE, -0.4, -0.5 * half, 0.4),
            (0.5 * half, -0.4, half + BESIDE, 0.4),
        )
    ]
    ordered = sorted(things, key=lambda thing: np.dot(np.array(thing.centroid.coords[0]), along))
    row = [jambs[0], *ordered, jambs[1]]
    gaps = [a.distance(b) for a, b in itertools.pairwise(row)]
    return "shut" if max(gaps) < SHUT else "open" if max(gaps) > PASSED else None


def _furnished(random: np.random.Generator, world: World, things: Sequence[Polygon]) -> World:
    """Make the things furniture, furniture that nobody pushes, or blockages that do not end."""
    furniture, events = [], []
    for i, thing in enumerate(things):
        polygon = frozen_array(
            np.array(shapely.geometry.polygon.orient(thing).exterior.coords)[:-1]
        )
        how = random.choice(["fixed", "movable", "blockage"], p=[0.6, 0.2, 0.2])
        if how == "blockage":
            event = Blockage(name=f"block_{i}", polygon=polygon, start=0.0, end=HORIZON)
            events.append(event)
        else:
            piece = Furniture(
                name=f"trolley_{i}", kind="trolley", polygon=polygon, movable=how == "movable"
            )
            furniture.append(piece)
    return dataclasses.replace(world, furniture=tuple(furniture), events=tuple(events))


def _manned(
    random: np.random.Generator, world: World, room: int, others: Sequence[int], *, binds: bool
) -> World:
    """Put robots into the other rooms, and a task that ends or begins in the room first."""
    models = ["waffle", "waffle"]
    if binds and random.random() < 0.25:
        models[1] = "burger"
    starts = list(others[:2])
    if binds and random.random() < 0.3:
        starts[1] = room
    robots = tuple(
        RobotSpec(
            name=f"robot{i + 1}",
            model=model,
            pose=frozen_array([*world.rooms[start].point, random.uniform(-np.pi, np.pi)]),
            **(
                {"radius": 0.13, "max_speed": 0.22, "cruise_speed": 0.2}
                if model == "burger"
                else {}
            ),
        )
        for i, (model, start) in enumerate(zip(models, starts, strict=True))
    )
    pairs = [(int(random.choice(others)), room)]
    if random.random() < 0.5:
        pairs = [(end, start) for start, end in pairs]
    pairs += [tuple(int(k) for k in random.choice(len(world.rooms), 2)) for _ in range(2)]
    tasks = []
    for start, end in pairs:
        robot = f"robot{random.integers(1, len(robots) + 1)}" if random.random() < 0.2 else ""
        arrival = float(random.uniform(0.0, 10.0))
        tasks.append(
            Task(
                arrival=arrival, start=start, end=end, deadline=900.0, robot=robot if binds else ""
            )
        )
    walker: tuple[HumanSpec, ...] = ()
    if random.random() < 0.3:
        points = np.array([world.rooms[k].point for k in others[:2]])
        walker = (HumanSpec(name="visitor", route=frozen_array(points + 0.6)),)
    return dataclasses.replace(
        world, robots=robots, tasks=tuple(tasks), humans=walker, horizon=HORIZON
    )


# --- runs -------------------------------------------------------------------------------------


def _judged(part: str, world: World, room: int) -> Row:
    found = look_at(world, campaign_specifications())
    row: Row = {
        "room": world.rooms[room].name,
        "reason": found.reason,
        "shut": [
            [way.task, way.room, things_text(way.by), round(way.gap, 3)] for way in found.shut
        ],
        "narrow": [
            [way.task, way.room, things_text(way.by), round(way.gap, 3)] for way in found.narrow
        ],
    }
    if part == "called":
        concerned = {way.task for way in found.shut}
        row["shipped"] = sorted(_delivered(world, StackConfig()) & concerned)
        row["narrow_stack"] = sorted(_delivered(world, narrow_stack(world)) & concerned)
    elif part == "open":
        stacks = (StackConfig(), narrow_stack(world))
        row["passed"] = any(0 in _delivered(world, stack, until=0) for stack in stacks)
    return row


def narrow_stack(world: World) -> StackConfig:
    """Make the shipped stack, planning for the half width of the narrowest body of a world."""
    half = min(body_disc(robot).half_width for robot in world.robots)
    return dataclasses.replace(StackConfig(), costmap=Choice("layered", {"robot_radius": half}))


def _delivered(world: World, config: StackConfig, until: int | None = None) -> set[int]:
    """Run a world, at most until a task is delivered, and list the tasks that are."""
    config = dataclasses.replace(config, engine=Choice("kinematic"))
    done: set[int] = set()
    for frame in frames_of(world, config):
        done |= {event.task for event in frame.confirmed if event.kind == "dropped-off"}
        if until in done:
            break
    return done


# --- table ------------------------------------------------------------------------------------


def table(rows: Sequence[Row]) -> Iterator[str]:
    """Count the parts, with intervals of 95 % (Blaker), and list what should not be."""
    by_part = collections.defaultdict(list)
    for row in rows:
        by_part[row["part"]].append(row)
    called, shut, gaps = (by_part[part] for part in PARTS)
    yield _line("called: the shipped stack delivers", [bool(r["shipped"]) for r in called])
    yield _line("called: the narrow stack delivers", [bool(r["narrow_stack"]) for r in called])
    yield _line("shut by hand: found", [bool(r["shut"]) for r in shut])
    yield _line("shut by hand: the room is named", [_names_room(r) for r in shut])
    yield _line("with a gap: called impossible", [bool(r["reason"]) for r in gaps])
    yield _line("with a gap: one of the stacks passes it", [r["passed"] for r in gaps])
    for row in rows:
        is_wrong = {
            "called": bool(row.get("shipped") or row.get("narrow_stack")),
            "shut": not row["shut"],
            "open": bool(row["reason"]),
        }[row["part"]]
        if is_wrong:
            yield f"look at: {json.dumps(row)}"


def _names_room(row: Row) -> bool:
    return any(room == row["room"] for _, room, _, _ in row["shut"])


def _line(what: str, hits: Sequence[bool]) -> str:
    if not hits:
        return f"{what}: none was run"
    low, high = blaker_interval(sum(hits), len(hits))
    return f"{what}: {sum(hits)} of {len(hits)} [{low:.3f}, {high:.3f}]"


if __name__ == "__main__":
    main()
