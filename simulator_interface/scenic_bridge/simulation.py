"""Scenic's ``Simulation`` over our own tick loop: one run, and what a program does in it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from scenic.core.dynamics.utils import RejectSimulationException
from scenic.core.errors import InvalidScenarioError
from scenic.core.requirements import RequirementType
from scenic.core.scenarios import Scene
from scenic.core.simulators import (
    Simulation,
    SimulationCreationError,
    SimulationResult,
    TerminationType,
)
from scenic.core.vectors import Vector

from mrta_falsify.core.directives import Appear, StandStill, WaitUntil, begins_outside
from mrta_falsify.core.errors import InputError, WorldError
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.world import HumanSpec, World
from mrta_falsify.core.world_checks import check_pushes
from simulator_interface.people.scripts import Errand
from simulator_interface.scenic_bridge.actions import Reader, is_of_library
from simulator_interface.scenic_bridge.objects import Body
from simulator_interface.scenic_bridge.world_from_scene import (
    footprint,
    is_composed,
    late_person,
    object_names,
)
from simulator_interface.simulate import Outcome, Run
from simulator_interface.staging import FOR_EVER


class _EpisodeOver(Exception):  # noqa: N818 - it is no error
    """All tasks are done, or the horizon is reached."""


class PyBulletSimulation(Simulation):  # type: ignore[misc]
    """One run, a few ticks per Scenic time step.

    Attributes:
        run: the loop, with the frame of the last tick.
        rejected: the requirement or guard that was violated, empty: none.
    """

    objects: list[Any]

    def __init__(self, scene: Scene, run: Run, **options: Any) -> None:
        # Scenic's constructor runs the whole simulation.
        self.run = run
        self.rejected = ""
        self._episode = run.episode
        self._outcome: Outcome | None = None
        self._bodies: dict[int, Body] = {}
        self._moving: list[Any] = []
        self._names = object_names(scene)
        self._late = [
            i for i, human in enumerate(self._episode.world.humans) if _is_free_place(human)
        ]
        self._live: set[int] = set()  # people whom Scenic tells what to do
        self._told: dict[int, Errand] = {}  # in this time step
        self._is_watched = _looks_at_objects(scene)
        self._reader = Reader(scene.params["_places"], self._names)
        self._ticks = whole_ticks(float(options["timestep"]), self._episode.dt)
        options["enableReplay"] = False
        super().__init__(scene, **options)

    # --- what came of it -----------------------------------------------------------------

    @property
    def outcome(self) -> Outcome:
        """Trace, verdicts and counts to date; the run ends with being asked for them."""
        if self._outcome is None:
            self.run.end(self._reason())
            self._outcome = self.run.outcome()
        return self._outcome

    def _reason(self) -> str:
        if self.rejected:
            return f"rejected: {self.rejected}"
        return f"scenic: {self.result.terminationReason}" if self.result else "interrupted"

    @property
    def world(self) -> World:
        """The world as it came to be, with what appeared while it ran.

        It replays without Scenic unless Scenic told somebody what to do (``scripted``).
        """
        world = self._episode.world
        names = ", ".join(world.humans[i].name for i in sorted(self._live))
        return replace(world, scripted=f"behaviors of its own ({names})" if names else "")

    @property
    def frame(self) -> Frame:
        """The last tick."""
        assert self.run.frame is not None
        return self.run.frame

    def close_rejected(self, reason: str) -> None:
        """Keep what was logged until a requirement or guard was violated."""
        self.rejected = reason
        self.result = SimulationResult(
            self.trajectory,
            self.actionSequence,
            TerminationType.simulationTerminationCondition,
            f"violated: {reason}",
            self.records,
        )

    # --- Scenic asks ---------------------------------------------------------------------

    def setup(self) -> None:
        """See Scenic's ``Simulation``."""
        super().setup()
        self.run.advance()

    def _run(self, dynamicScenario: Any, maxSteps: int | None) -> Any:  # noqa: N803
        try:
            ended = super()._run(dynamicScenario, maxSteps)
        except _EpisodeOver:
            ended = TerminationType.scenarioComplete, self.run.ended
        except RejectSimulationException:
            # Scenic checks requirements before it records: take the violating moment along.
            self.recordCurrentState()
            final = dynamicScenario._evaluateRecordedExprs(
                RequirementType.recordFinal, self.currentTime
            )
            self.records.update(final)
            raise
        self._read_back()
        return ended

    def scheduleForAgents(self) -> list[Any]:  # noqa: N802
        """See Scenic's ``Simulation``; the place where a run that is over stops."""
        if self.run.ended:
            raise _EpisodeOver
        return list(self.agents)

    def createObjectInSimulator(self, obj: Any) -> None:  # noqa: N802
        """See Scenic's ``Simulation``; the world already holds what the scene holds."""
        name = self._names.get(id(obj), "")
        if name:
            self._bodies[id(obj)] = self._find_body(obj, name)
        elif not hasattr(obj, "kind"):
            self._bodies[id(obj)] = Body("still", obj.position)
        else:
            self._bodies[id(obj)] = self._add_body(obj)
        if self._bodies[id(obj)].kind != "still":
            self._moving.append(obj)

    def _find_body(self, obj: Any, name: str) -> Body:
        world = self._episode.world
        robots = [robot.name for robot in world.robots]
        humans = [human.name for human in world.humans]
        pieces = [item.name for item in world.movable_furniture()]
        if obj.kind in ("robot", "human") and name in humans:
            number = humans.index(name)
            told = is_of_library(obj.behavior) or obj.behavior is None
            return Body(
                "human", obj.position, number, float(obj.yaw), obj.behavior if told else None
            )
        if obj.kind == "robot" and name in robots:
            return Body("robot", obj.position, robots.index(name))
        if name in pieces:
            return Body("piece", obj.position, pieces.index(name), float(obj.yaw))
        return Body("still", obj.position)  # or not active

    def _add_body(self, obj: Any) -> Body:
        """An object that appears while the episode runs."""
        if not getattr(obj, "active", True):
            return Body("still", obj.position)
        number = len(self._names) + 1
        name = str(getattr(obj, "name", None) or f"{obj.kind}_{number}")
        self._names[id(obj)] = name
        try:
            if obj.kind == "human" or (obj.kind == "robot" and obj.behavior is not None):
                return self._add_person(obj, name)
            if obj.kind in ("robot", "comms_outage"):
                raise WorldError(
                    f"a {obj.kind} cannot appear while the simulation runs; give it to the "
                    "scene (a late robot has joins_at, an outage has during)"
                )
            taken = {event.name for event in self._episode.world.events}
            end = float(obj.during[1]) if obj.kind == "blockage" else FOR_EVER
            self._episode.add_blockage(
                name if name not in taken else f"{name}_{number}",
                footprint(obj),
                height=float(obj.height),
                end=end,
            )
        except InputError as error:
            raise SimulationCreationError(f"{name}: {error}") from error
        return Body("still", obj.position)

    def _add_person(self, obj: Any, name: str) -> Body:
        if not self._late:
            raise WorldError(
                "no place is free for people who appear while the simulation runs; write "
                "`param late_people = N`, as many as may appear"
            )
        number = self._late.pop(0)
        place = self._episode.world.humans[number]
        spec = late_person(obj, name, self._reader)
        entry = (WaitUntil(time=self.frame.sensed.time), Appear(point=spec.route[0]))
        is_told = is_of_library(obj.behavior) or obj.behavior is None
        spec = replace(
            spec,
            name=place.name,
            directives=(*entry, *(spec.directives if is_told else (StandStill(),))),
        )
        self._episode.replace_person(number, spec)
        return Body(
            "human", obj.position, number, float(obj.yaw), obj.behavior if is_told else None
        )

    # --- errands ---------------------------------------------------------------------------

    def errand_of(
        self, behavior: Any, name: str, args: tuple[Any, ...], options: dict[str, Any]
    ) -> Errand:
        """What a library behaviour that begins now carries out.

        It is the errand that the world already holds, if that was made of this behaviour.

        Raises:
            InvalidScenarioError: an argument that cannot be, with our words.
        """
        body = self._bodies[id(behavior._agent)]
        if body.kind != "human":
            return Errand(())
        if body.behavior is behavior:
            held = self._episode.crowd.errand_of(body.number)
            if held is not None:
                return held
        try:
            directives = self._reader.read(name, args, options)
            check_pushes(self._episode.world, directives)
        except InputError as error:
            raise InvalidScenarioError(str(error)) from error
        return Errand(directives)

    def carry_on(self, agent: Any, errand: Errand) -> None:
        """Let a person go on with an errand in this time step."""
        body = self._bodies[id(agent)]
        if body.kind == "human":
            self._told[body.number] = errand

    def executeActions(self, allActions: Any) -> None:  # noqa: N802, N803
        """See Scenic's ``Simulation``; people with behaviours of the program's own obey it."""
        self._told = {}
        super().executeActions(allActions)
        crowd = self._episode.crowd
        for agent in self.agents:
            body = self._bodies[id(agent)]
            if body.kind != "human" or agent.behavior is body.behavior:
                continue
            self._live.add(body.number)
            told = self._told.get(body.number)
            if not _is_entering(crowd.errand_of(body.number)):
                crowd.assign(body.number, told)

    # --- time passes -------------------------------------------------------------------------

    def step(self) -> None:
        """See Scenic's ``Simulation``."""
        for _ in range(self._ticks):
            if self.run.ended:
                return
            self.run.advance()

    def updateObjects(self) -> None:  # noqa: N802
        """Read back what has moved since it was last read, if anything in the program looks."""
        if self.currentTime > 0 and not self._is_watched:
            return
        self._read_back()

    def _read_back(self) -> None:
        everything: list[Any] = self.objects
        if self.currentTime > 0:
            self.objects = [obj for obj in self._moving if self._has_moved(obj)]
        try:
            super().updateObjects()
        finally:
            self.objects = everything

    def _has_moved(self, obj: Any) -> bool:
        body = self._bodies[id(obj)]
        state = body.state(self.frame.sensed)
        moved = state != body.read
        body.read = state
        return moved

    def currentState(self) -> tuple[Vector, ...]:  # noqa: N802
        """Positions of all objects, which make up the trajectory."""
        if self.currentTime == 0:
            return tuple(obj.position for obj in self.objects)
        sensed = self.frame.sensed
        return tuple(self._bodies[id(obj)].place(sensed) for obj in self.objects)

    def getProperties(self, obj: Any, properties: set[str]) -> dict[str, Any]:  # noqa: N802
        """See Scenic's ``Simulation``."""
        state = self._bodies[id(obj)].properties(self.frame.sensed)
        return {name: state[name] if name in state else getattr(obj, name) for name in properties}

    def destroy(self) -> None:
        """Free the engine."""
        self.run.close()


def _looks_at_objects(scene: Scene) -> bool:
    """Whether anything in a program can ask for the state of an object while it runs."""
    watching = (
        scene.temporalRequirements,
        scene.monitors,
        scene.terminationConditions,
        scene.terminateSimulationConditions,
        scene.recordedExprs,
        is_composed(scene),
    )
    if any(bool(part) for part in watching):
        return True
    return any(obj.behavior is not None or obj.sensors for obj in scene.objects)


def whole_ticks(timestep: float, period: float) -> int:
    """Control ticks of ``period`` [s] in a Scenic time step [s].

    Raises:
        SimulationCreationError: it is no multiple of the period.
    """
    ticks = timestep / period
    if abs(ticks - round(ticks)) > 1e-6 or ticks < 1.0 - 1e-6:
        raise SimulationCreationError(
            f"timestep is {timestep:g} s; it must be a multiple of the control period of "
            f"{period:g} s"
        )
    return round(ticks)


def _is_free_place(human: HumanSpec) -> bool:
    first = human.directives[0] if human.directives else None
    return isinstance(first, WaitUntil) and first.time == FOR_EVER


def _is_entering(errand: Errand | None) -> bool:
    if errand is None or errand.done:
        return False
    return begins_outside(errand.directives[errand.index :])
