"""Do claimed wait edges hold? Take the blocker away just after the claim, and look who moves.

    python -m experiments.oracle.edges runs/a runs/b --count 100 --seed 1 -o edges.jsonl

Edges are those of members and victims in the evidence of `no_deadlock` of stored campaigns,
``cycle`` and ``chain``. ``--count`` edges to robots are drawn by ``--seed``, and up to ``--others``
edges to people and to solids, which are reported apart. Each world is run again to just after the
claim. An edge *holds* if the waiting robot makes progress within 120 s once the blocker is gone,
and makes none in the same run with it. Progress: it reaches its next stop, or comes a metre nearer
to its goal than it ever was since it had that goal, along free space, or straight where no way
leads there; a robot pushed back and forth makes none. At its goal, in a queue, only a stop counts.
Where a robot waits for several, an edge holds as well if the robot moves without all of them, but
not without all but this one. New work may bring another robot into its way: an edge that holds only
as long as none comes holds, and is counted apart.

A foreign stack may remember what it has promised to a robot, so removal decides nothing where it
frees nobody. The stacks of this benchmark write down for whom they wait; that decides.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import sys
import tempfile
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from scipy import sparse
from scipy.sparse.csgraph import dijkstra
from shapely.geometry import Polygon

from experiments.oracle.figures import share
from experiments.oracle.own_state import state_at
from experiments.oracle.rows import Row, cpu_seconds, run_command
from experiments.oracle.stacks import is_ours, with_state_file
from experiments.oracle.stops import StopCount
from mrta_falsify.campaigns.store import read_campaign
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.world import Blockage, World
from mrta_falsify.lab.stored import stored_world
from mrta_falsify.lab import stack_of
from simulator_interface.episode import Episode
from mrta_falsify.process.supervisor import run_supervised

ORACLE = "no_deadlock"
JUST_AFTER = 0.1  # s after the claim
WITHIN = 120.0  # s in which a robot must make progress
NEARER = 1.0  # m
EVERY = 20  # ticks between two places that are noted
CELL, INFLATED = 0.1, 0.2  # m, of the map of free space
IDLE = "it moves without the other one as long as no new work comes"
SAME = 1e-9  # m or rad between two runs that are one


@dataclass(frozen=True)
class Edge:
    """One claimed wait edge."""

    campaign: str  #: directory
    trial: str
    at: float  #: when it was claimed [s]
    robot: str
    cause: str
    other: str  #: robot, person, or solid
    kind: str  #: robot, person, blockage, furniture, wall, other
    together: tuple[str, ...]  #: all robots for which the same robot is said to wait

    @property
    def name(self) -> str:
        """Name of its row."""
        return f"{self.campaign}:{self.trial}:{self.robot}>{self.other}:{self.cause}"


# --- which edges -------------------------------------------------------------------------------


def claimed_edges(directory: Path) -> Iterator[Edge]:
    """List the wait edges that a campaign claims, each once a trial."""
    campaign = read_campaign(directory)
    for record in campaign.records:
        verdict = next((v for v in record.verdicts if v.spec == ORACLE), None)
        if verdict is None or not verdict.violated:
            continue
        world = stored_world(campaign, record)
        rows = [*verdict.evidence.get("cycle", ()), *verdict.evidence.get("chain", ())]
        seen = set()
        for row in rows:
            other = row["blocked_by"] or row["resource"]
            if not other or (row["robot"], other) in seen:
                continue
            seen.add((row["robot"], other))
            yield Edge(
                campaign=str(directory),
                trial=record.id,
                at=float(verdict.evidence["detected_at"]),
                robot=row["robot"],
                cause=row["cause"],
                other=other,
                kind=_kind(world, other),
                together=tuple(
                    sorted({r["blocked_by"] for r in rows if r["robot"] == row["robot"]} - {""})
                ),
            )


def _kind(world: World, name: str) -> str:
    for kind, things in (
        ("robot", world.robots),
        ("person", world.humans),
        ("blockage", [e for e in world.events if isinstance(e, Blockage)]),
        ("furniture", world.furniture),
        ("wall", world.walls),
    ):
        if any(thing.name == name for thing in things):
            return kind
    return "other"


def draw(edges: Collection[Edge], *, count: int, others: int, seed: int) -> list[Edge]:
    """Draw edges to robots, and to others, without repetition."""
    random = np.random.default_rng(seed)
    ordered = sorted(edges, key=lambda edge: edge.name)
    drawn = []
    for most, pool in (
        (count, [edge for edge in ordered if edge.kind == "robot"]),
        (others, [edge for edge in ordered if edge.kind != "robot"]),
    ):
        drawn += [pool[k] for k in random.permutation(len(pool))[:most]]
    return drawn


# --- one run to a moment, and what becomes of a robot from there ---------------------------------


class Rerun:
    """A run to just after a claim."""

    def __init__(self, world: World, config: StackConfig) -> None:
        if config.stack is not None and config.stack.branch == "never":
            outside = dataclasses.replace(config.stack, branch="auto")
            config = dataclasses.replace(config, stack=outside)
        self.world = world
        self._episode = Episode(world, config)
        self._frames = self._episode.frames()
        self._count = StopCount(world, is_outside=config.stack is not None)
        self.frame: Frame | None = None
        #: places of each robot since it has its goal, one a second [m]
        self._been: list[list[Array]] = [[] for _ in world.robots]

    def __enter__(self) -> Rerun:
        return self

    def __exit__(self, *reason: object) -> None:
        self._frames.close()

    def advance(self, until: float) -> None:
        """Go on until a moment [s]."""
        for frame in self._frames:
            self._count.update(frame)
            self._note(frame)
            self.frame = frame
            if frame.sensed.time >= until - 1e-6:
                return

    def _note(self, frame: Frame) -> None:
        before = self.frame
        for i, been in enumerate(self._been):
            if before is not None and (frame.intent.goal[i] != before.intent.goal[i]).any():
                been.clear()
            if not been or frame.sensed.tick % EVERY == 0:
                been.append(frame.sensed.pose[i, :2].copy())

    @property
    def can_remove(self) -> bool:
        """Whether the engine can take robots away."""
        return self._episode.can_remove

    def moves(self, robot: int, without: Collection[int] = (), *, idle: bool = False) -> bool:
        """Whether a robot makes progress within 120 s in a copy of the run.

        Args:
            robot: that is looked at.
            without: robots that are taken away.
            idle: nothing new comes from outside any more.
        """
        assert self.frame is not None
        goal, place = self.frame.intent.goal[robot], self.frame.sensed.pose[robot, :2]
        to_go, nearest = None, 0.0
        if np.isfinite(goal).all() and np.hypot(*(goal - place)) > NEARER:
            to_go = FreeDistance(self.world, self.frame, goal)
            if np.isinf(to_go(place)):
                to_go = functools.partial(_straight, goal)
            nearest = min(to_go(point) for point in (place, *self._been[robot]))

        def follow() -> bool:
            self._episode.become_copy()
            if idle:
                self._episode.forget_events()
            for other in without:
                self._episode.remove(other)
            served = self._count.reached[robot]
            end = self.frame.sensed.time + WITHIN
            for frame in self._frames:
                self._count.update(frame)
                now = frame.sensed.pose[robot, :2]
                if self._count.reached[robot] > served:
                    return True
                if to_go is not None and to_go(now) <= nearest - NEARER:
                    return True
                if frame.sensed.time >= end:
                    return False
            return False

        return bool(run_supervised(follow))


def _straight(goal: Array, point: Array) -> float:
    return float(np.hypot(*(goal - point)))


class FreeDistance:
    """Length of the way to a goal past walls, furniture and blockages [m]; robots do not count."""

    def __init__(self, world: World, frame: Frame, goal: Array) -> None:
        time, poses = frame.sensed.time, frame.sensed.furniture_pose
        solids = [Polygon(corners) for corners in world.solid_polygons()]
        solids += [
            Polygon(piece.outline_at(pose))
            for piece, pose in zip(world.movable_furniture(), poses, strict=False)
        ]
        solids += [
            Polygon(event.polygon)
            for event in world.events
            if isinstance(event, Blockage) and event.start <= time < event.end
        ]
        solid = shapely.union_all(solids).buffer(INFLATED)
        shapely.prepare(solid)
        low, high = world.bounds[:2], world.bounds[2:]
        shape = np.ceil((high - low) / CELL).astype(int) + 1
        self._low, self._shape = low, shape
        x, y = (low[k] + CELL * np.arange(shape[k]) for k in (0, 1))
        grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        self._free = ~shapely.contains_xy(solid, *grid.T)
        self._cells = grid
        self._distance = dijkstra(self._graph(), indices=self._cell(goal))

    def __call__(self, point: Array) -> float:
        """Distance of a point ``(2,)``; inf: no way."""
        return float(self._distance[self._cell(point)])

    def _cell(self, point: Array) -> int:
        i, j = np.clip(np.round((point - self._low) / CELL).astype(int), 0, self._shape - 1)
        cell = int(i * self._shape[1] + j)
        if self._free[cell]:
            return cell
        away = np.where(self._free, np.hypot(*(self._cells - point).T), np.inf)
        return int(np.argmin(away))

    def _graph(self) -> sparse.csr_matrix:
        number = np.arange(len(self._free)).reshape(self._shape)
        free = self._free.reshape(self._shape)
        pairs, lengths = [], []
        for (di, dj), length in (((1, 0), 1.0), ((0, 1), 1.0), ((1, 1), 2**0.5), ((1, -1), 2**0.5)):
            a = (slice(0, -di or None), slice(max(0, -dj), -dj if dj > 0 else None))
            b = (slice(di, None), slice(max(0, dj), dj if dj < 0 else None))
            both = free[a] & free[b]
            pairs.append(np.stack([number[a][both], number[b][both]]))
            lengths.append(np.full(int(both.sum()), CELL * length))
        rows, cols = np.concatenate(pairs, axis=1)
        size = len(self._free)
        return (
            sparse.coo_matrix((np.concatenate(lengths), (rows, cols)), shape=(size, size))
            .tocsr()
            .maximum(
                sparse.coo_matrix(
                    (np.concatenate(lengths), (cols, rows)), shape=(size, size)
                ).tocsr()
            )
        )


# --- one edge ----------------------------------------------------------------------------------


def checked(edge: Edge) -> Row:
    """Check one edge.

    Returns:
        Its row: ``holds`` True, False, or None where it cannot be decided, and why.
    """
    began = cpu_seconds()
    campaign = read_campaign(Path(edge.campaign))
    record = campaign.record(edge.trial)
    world, config = stored_world(campaign, record), stack_of(campaign.settings.trials, record)
    number = {robot.name: i for i, robot in enumerate(world.robots)}
    if edge.kind == "robot" and is_ours(config):
        holds, why = _by_own_state(edge, world, config, number)
    elif edge.kind == "robot":
        holds, why = _by_removal(edge, world, config, number)
    else:
        holds, why = _by_another_world(edge, world, config, number)
    row = {"case": edge.name, **dataclasses.asdict(edge), "holds": holds, "why": why}
    return row | {"cpu_s": round(cpu_seconds() - began, 1)}


def _by_own_state(
    edge: Edge, world: World, config: StackConfig, number: dict[str, int]
) -> tuple[bool | None, str]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "state.jsonl"
        with Rerun(world, with_state_file(config, path)) as run:
            run.advance(edge.at + JUST_AFTER)
        why, robots = state_at(path, edge.at + JUST_AFTER).get(number[edge.robot], ("none", ()))
    names = [world.robots[i].name for i in robots]
    return edge.other in names, f"the stack: {why} {', '.join(names)}".strip()


def _by_removal(
    edge: Edge, world: World, config: StackConfig, number: dict[str, int]
) -> tuple[bool | None, str]:
    robot, other = number[edge.robot], number[edge.other]
    rest = [number[name] for name in edge.together if name in number and name != edge.other]
    with Rerun(world, config) as run:
        run.advance(edge.at + JUST_AFTER)
        if not run.can_remove:
            return None, "the engine takes no robot away"
        if run.moves(robot):
            return False, "it moves with the other one there"
        if run.moves(robot, [other]):
            return True, "it moves without the other one"
        if rest and run.moves(robot, [other, *rest]) and not run.moves(robot, rest):
            return True, "it moves without all for which it waits, and not without the rest"
        if run.moves(robot, [other], idle=True) and not run.moves(robot, idle=True):
            return True, IDLE
    if config.stack is not None:
        return None, "not decidable by removal: the stack may remember what it has promised"
    return False, "it stays without the other one"


def _by_another_world(
    edge: Edge, world: World, config: StackConfig, number: dict[str, int]
) -> tuple[bool | None, str]:
    """Run a world in which the person or solid goes just after the claim; up to then it is one."""
    moment = edge.at + JUST_AFTER
    other = _without(world, edge, moment)
    if other is None:
        return None, f"nothing of this kind can be taken away ({edge.kind})"
    robot = number[edge.robot]
    with Rerun(world, config) as run:
        run.advance(moment)
        poses = run.frame.sensed.pose
        if run.moves(robot):
            return False, "it moves with it there"
    with Rerun(other, config) as run:
        run.advance(moment)
        if np.abs(run.frame.sensed.pose - poses).max() > SAME:
            return None, "the run is another one if it is to go later"
        if run.moves(robot):
            return True, "it moves without it"
    return False, "it stays without it"


def _without(world: World, edge: Edge, moment: float) -> World | None:
    if edge.kind == "person":
        humans = tuple(
            dataclasses.replace(h, leaves_at=moment) if h.name == edge.other else h
            for h in world.humans
        )
        return dataclasses.replace(world, humans=humans)
    if edge.kind == "blockage":
        events = tuple(
            dataclasses.replace(e, end=moment) if e.name == edge.other else e for e in world.events
        )
        return dataclasses.replace(world, events=events)
    if edge.kind not in ("furniture", "wall"):
        return None
    field = "walls" if edge.kind == "wall" else "furniture"
    things = getattr(world, field)
    thing = next(thing for thing in things if thing.name == edge.other)
    if getattr(thing, "movable", False):
        return None
    stand_in = Blockage(
        name=f"{thing.name}_for_a_time", polygon=thing.polygon, start=0.0, end=moment
    )
    return dataclasses.replace(
        world,
        **{field: tuple(item for item in things if item is not thing)},
        events=(*world.events, stand_in),
    )


# --- all ----------------------------------------------------------------------------------------


def report(rows: Collection[Row]) -> dict[str, object]:
    """Share of edges that hold, by what the robot is said to wait for, and those that do not."""
    found: dict[str, object] = {}
    for kind in ("robot", "person", "blockage", "furniture", "wall", "other"):
        own = [row for row in rows if row["kind"] == kind]
        decided = [row for row in own if row["holds"] is not None]
        if own:
            found[kind] = {
                **share(sum(row["holds"] for row in decided), len(decided)),
                "of these only without new work": sum(row["why"] == IDLE for row in decided),
                "undecided": len(own) - len(decided),
            }
    found["fail"] = [f"{row['case']}: {row['why']}" for row in rows if row["holds"] is False]
    found["undecided"] = [f"{row['case']}: {row['why']}" for row in rows if row["holds"] is None]
    return found


def _row(edges: dict[str, Edge], name: str) -> Row:
    return checked(edges[name])


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("campaigns", nargs="+", type=Path, help="directories of campaigns")
    parser.add_argument("--count", type=int, default=100, help="edges to robots")
    parser.add_argument("--others", type=int, default=40, help="edges to people and solids at most")
    parser.add_argument("--seed", type=int, default=1, help="of the draw")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("-o", "--output", type=Path, default=Path("oracle_edges.jsonl"))
    arguments = parser.parse_args()
    try:
        known = [edge for path in arguments.campaigns for edge in claimed_edges(path)]
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    if not known:
        print("these campaigns claim no wait edge", file=sys.stderr)
        return 2
    drawn = draw(known, count=arguments.count, others=arguments.others, seed=arguments.seed)
    print(f"{len(known)} edges, {len(drawn)} drawn", file=sys.stderr)
    edges = {edge.name: edge for edge in drawn}
    make = functools.partial(_row, edges)
    return run_command(arguments.output, make, list(edges), arguments.workers, report)


if __name__ == "__main__":
    sys.exit(main())
