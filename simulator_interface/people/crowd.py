"""People on their routes and scripts: where each goes, and the model that moves them.

A route is a list of points; the way between two of them is planned on the costmap, so that
no route leads through a bed. The model sees one point of the way only, at most as far ahead as its
sight.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.fleet import Sensed
from mrta_falsify.core.protocols import CostmapSource, CrowdView, HumanModel, Planner
from mrta_falsify.core.world import Blockage, HumanSpec, World
from simulator_interface.engines.rays import polygon_edges
from simulator_interface.people.margins import Bystanders
from simulator_interface.people.scripts import SOON, STANDS, Now, Script, ScriptPlayer
from simulator_interface.people.walking import (
    LOOK_AHEAD,
    NO_WAY,
    ProgressRows,
    Walker,
    Walking,
    all_walk_on,
    fresh_rows,
)
from simulator_interface.staging import Stage, StagedSource, without_later

REDRAWN = 0.25  # m or rad; people see a piece of furniture where it was until it moved by this


@dataclass(slots=True)
class Crowd:
    """All people of a world."""

    world: World
    model: HumanModel
    planner: Planner
    source: CostmapSource
    dt: float  #: control period [s]
    player: ScriptPlayer = field(init=False)  #: carries out the directives
    _walking: Walking = field(init=False)
    _walkers: list[Walker] = field(default_factory=list)
    _rows: ProgressRows = field(default_factory=lambda: fresh_rows(0))  #: of the walkers
    _routes: _Routes | None = None  #: of the walkers, None: some have changed
    _at_work: dict[int, Script | None] = field(default_factory=dict)  #: people with directives
    _edges: Array = field(default_factory=lambda: np.zeros((0, 4)))
    _drawn: Array = field(init=False)  #: (F, 3) furniture poses that ``_edges`` show
    _resting: tuple[int, ...] = ()
    _added: tuple[Blockage, ...] = ()
    _staged: tuple[BoolArray, Array] | None = None
    _present: BoolArray = field(init=False)  #: (H,) as long as the next two hold
    _present_for: tuple[float, float] = (np.inf, np.inf)  #: from, until [s]
    _present_inside: BoolArray | None = None
    _pausing: tuple[int, ...] = field(init=False)  #: people who pause on their routes
    _radius: Array = field(init=False)
    _reacts: BoolArray = field(init=False)
    _robot_radius: Array = field(init=False)

    def __post_init__(self) -> None:
        sight = getattr(self.model, "sight", LOOK_AHEAD)
        self._walking = Walking(self.planner, self.source, sight)
        self.player = ScriptPlayer(self.world, self._walking, self.dt)
        self._robot_radius = np.array([robot.radius for robot in self.world.robots])
        self._read_people()

    def _read_people(self) -> None:
        humans = self.world.humans
        self._present_inside = None
        self._pausing = tuple(i for i, human in enumerate(humans) if human.pause > 0.0)
        self._radius = np.array([human.radius for human in humans])
        self._reacts = np.array([human.reacts_to_robots for human in humans], dtype=np.bool_)

    # --- between two ticks -----------------------------------------------------------

    def start(self) -> Array:
        """Plan the ways of all people, and return their start positions ``(H, 2)`` [m]."""
        self._furnish(0.0)
        self._walking.look(0.0)
        self._draw_edges(0.0)
        positions = np.zeros((len(self.world.humans), 2))
        for i, spec in enumerate(self.world.humans):
            positions[i], walker = self._begin(spec)
            self._walkers.append(walker)
            if spec.directives:
                self._at_work[i] = Script(spec.directives)
        self._rows = fresh_rows(len(self._walkers))
        for i, walker in enumerate(self._walkers):
            self._rows[i] = walker.rows[walker.row]
            walker.rows, walker.row = self._rows, i
        self._staged = (self.player.inside, self.player.furnishings.pose)
        return positions

    def _begin(self, spec: HumanSpec) -> tuple[Array, Walker]:
        begin = self._walking.begin
        if spec.directives:
            return begin(spec.route[:1], repeat=False, speed=spec.speed, share=0.0)
        return begin(
            spec.route,
            repeat=spec.repeat,
            speed=spec.speed,
            share=spec.start,
            pause=spec.pause,
        )

    def script_of(self, person: int) -> Script | None:
        """Look up the script of a person, None: it follows a route, or does nothing."""
        return self._at_work.get(person)

    def assign(self, person: int, script: Script | None) -> None:
        """Give a person something else to do, None: stand. The old script lets go."""
        before = self._at_work.get(person)
        if before is not None and before is not script:
            before.suspend()
        self._at_work[person], self._routes = script, None

    def add_blockage(self, blockage: Blockage) -> None:
        """Add a blockage that is put down while the episode runs; it has not started yet."""
        self.world = dataclasses.replace(self.world, events=(*self.world.events, blockage))
        self._added += (blockage,)
        assert isinstance(self.source, StagedSource)
        self.source.add_blockage(blockage)

    def forget_after(self, time: float) -> None:
        """Leave out all events that start after ``time`` [s]."""
        events = tuple(without_later(self.world.events, time))
        self.world = dataclasses.replace(self.world, events=events)

    def replace_person(self, person: int, spec: HumanSpec) -> None:
        """Replace a person who has not appeared yet."""
        humans = list(self.world.humans)
        humans[person] = spec
        self.world = dataclasses.replace(self.world, humans=tuple(humans))
        self._read_people()
        self.player.set_speed(person, spec.speed)
        self._walkers[person] = dataclasses.replace(self._walkers[person], speed=spec.speed)
        self.assign(person, Script(spec.directives))

    def remove(self, person: int) -> None:
        """Let a person leave the building for good; what it pushes stays where it is."""
        if person in self._at_work:
            self.assign(person, None)
        self.player.leave(person)

    def stage(self) -> Stage | None:
        """Make the stage for the engine's next tick, None: nothing has changed."""
        inside, pose = self.player.inside, self.player.furnishings.pose
        known = self._staged
        if known is not None and known[0] is inside and known[1] is pose and not self._added:
            return None
        self._staged = (inside, pose)
        stage = Stage(
            inside=inside, placed=self.player.placed, furniture_pose=pose, added=self._added
        )
        self._added = ()
        return stage

    def present(self, time: float) -> BoolArray:
        """Say which people ``(H,)`` are in the building at ``time`` [s]."""
        inside, (first, end) = self.player.inside, self._present_for
        if not first <= time < end or inside is not self._present_inside:
            self._present_for, self._present_inside = (time, self._next_change(time)), inside
            self._present = present_humans(self.world, time) & inside
        return self._present

    def _next_change(self, time: float) -> float:
        """Find when a person next appears or leaves after ``time`` [s], inf: never."""
        times = [at for human in self.world.humans for at in (human.appears_at, human.leaves_at)]
        return min((at for at in times if at > time), default=np.inf)

    # --- a tick ----------------------------------------------------------------------------------

    def velocities(self, sensed: Sensed) -> Array:
        """Decide velocities ``(H, 2)`` [m/s] for the tick after ``sensed``."""
        if not self._walkers:
            return np.zeros((0, 2))
        self._look(sensed.time)
        position, present = sensed.human_position, self.present(sensed.time)
        target, desired = np.empty(position.shape), np.empty(len(position))
        led: dict[int, Array] = {}
        if self._at_work:
            position = position.copy()  # a script that lets a person appear writes here
        self._fill_on_routes(target, desired, position, sensed.time)
        if self._at_work:
            led = self._fill_scripted(target, desired, self._now(sensed, position, present))
        view = CrowdView(
            dt=self.dt,
            position=position,
            velocity=sensed.human_velocity,
            target=target,
            desired_speed=desired,
            radius=self._radius,
            reacts_to_robots=self._reacts,
            present=present,
            robot_position=sensed.pose[:, :2],
            robot_velocity=_map_velocity(sensed),
            robot_radius=self._robot_radius,
            walls=self._edges,
        )
        velocity = self.model.velocities(view)
        for i, exactly in led.items():
            velocity[i] = exactly
        return velocity

    def _fill_on_routes(self, target: Array, desired: Array, position: Array, time: float) -> None:
        """Write targets and speeds of the people on routes; the others stand."""
        for i in self._pausing:
            walker = self._walkers[i]
            if time >= walker.rests_until - SOON and i not in self._at_work:
                self._walking.go_on(walker, position[i], time)
                self._routes = None
        if self._routes is None:
            self._routes = self._list_routes()
        ways, first, speed = self._routes
        desired[:] = speed
        needs_way, ground = np.empty(len(position), dtype=np.bool_), self._walking.ground
        if not all_walk_on(ways, first, self._rows, position, time, ground, target, needs_way):
            return
        for i in needs_way.nonzero()[0].tolist():
            walker, self._routes = self._walkers[i], None
            target[i] = self._walking.target(walker, position[i], time)
            desired[i] = walker.speed if len(walker.way) else 0.0

    def _list_routes(self) -> _Routes:
        ways = [
            NO_WAY if i in self._at_work else walker.way for i, walker in enumerate(self._walkers)
        ]
        speeds = [
            walker.speed if len(way) else 0.0
            for way, walker in zip(ways, self._walkers, strict=True)
        ]
        first = np.cumsum([0, *map(len, ways)]).astype(np.int64)
        return _Routes(np.concatenate([NO_WAY, *ways]), first, np.array(speeds))

    def _fill_scripted(self, target: Array, desired: Array, now: Now) -> dict[int, Array]:
        """Write targets and speeds of the people with scripts.

        Returns:
            Exact velocities ``(2,)`` [m/s] of the people who are led, by number.
        """
        self.player.begin_tick()
        led: dict[int, Array] = {}
        for i, script in self._at_work.items():
            step = self.player.step(i, script, now) if script is not None else STANDS
            target[i] = now.around.person[i] if step.target is None else step.target
            desired[i] = 0.0 if step.target is None else step.speed
            if step.velocity is not None:
                led[i] = step.velocity
        return led

    def _now(self, sensed: Sensed, position: Array, present: BoolArray) -> Now:
        return Now(
            time=sensed.time,
            around=Bystanders(
                robot=sensed.pose[:, :2],
                robot_radius=self._robot_radius,
                person=position,
                person_radius=self._radius,
                present=present,
                blocks=polygon_edges([b.polygon for b in _standing(self.world, sensed.time)]),
            ),
        )

    def _look(self, time: float) -> None:
        """Take in the map and the solids of the moment."""
        things = self.player.furnishings
        if things.pieces:
            self._furnish(time)
        pose = things.pose
        moved = len(pose) > 0 and np.abs(pose - self._drawn).max() > REDRAWN
        if self._walking.look(time) or moved:
            self._draw_edges(time)

    def _draw_edges(self, time: float) -> None:
        things = self.player.furnishings
        outlines = [things.outline(k) for k in range(len(things.pieces))]
        self._edges = solid_edges(self.world, time, outlines)
        self._drawn = things.pose

    def _furnish(self, time: float) -> None:
        things = self.player.furnishings
        resting = things.at_rest(time)
        if resting != self._resting:
            self._resting = resting
            assert isinstance(self.source, StagedSource)
            self.source.furnish(tuple(things.outline(k) for k in resting))


class _Routes(NamedTuple):
    """The ways of all people on routes, one after the other."""

    ways: Array  #: (P, 2) [m]
    first: IntArray  #: (H + 1,) point of each person
    speed: Array  #: (H,) desired [m/s], 0: stands


def present_humans(world: World, time: float) -> BoolArray:
    """Say which people ``(H,)`` may be in the building at ``time`` [s], apart from scripts."""
    return np.array([h.appears_at <= time < h.leaves_at for h in world.humans], dtype=np.bool_)


def solid_edges(world: World, time: float, outlines: Sequence[Array] = ()) -> Array:
    """List edges ``(S, 4)`` x1, y1, x2, y2 [m] of everything solid at ``time`` [s].

    ``outlines`` ``(V, 2)`` [m] are those of movable furniture.
    """
    blockages = (event.polygon for event in _standing(world, time))
    return polygon_edges([*world.solid_polygons(), *blockages, *outlines])


def _standing(world: World, time: float) -> list[Blockage]:
    return [
        event
        for event in world.events
        if isinstance(event, Blockage) and event.start <= time < event.end
    ]


def _map_velocity(sensed: Sensed) -> Array:
    """Velocities ``(N, 2)`` [m/s] of the robots, map frame."""
    heading = sensed.pose[:, 2]
    velocity = np.empty((len(heading), 2))
    _fill_turned(sensed.velocity, np.cos(heading), np.sin(heading), velocity)
    return velocity


@njit(cache=True)
def _fill_turned(velocity: Array, cos: Array, sin: Array, turned: Array) -> None:
    """Write velocities ``(N, 3)`` of body frames, by their headings, to those of the map's."""
    for i in range(len(turned)):
        forward, left = velocity[i, 0], velocity[i, 1]
        turned[i, 0] = cos[i] * forward - sin[i] * left
        turned[i, 1] = sin[i] * forward + cos[i] * left
