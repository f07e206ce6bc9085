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

from mrta_falsify.core.directives import begins_outside
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.world import World
from mrta_falsify.core.world_checks import check_pushes
from simulator_interface.people.scripts import Script
from simulator_interface.scenic_bridge.tracked_objects import TrackedObjects
from simulator_interface.scenic_bridge.world_from_scene import is_composed
from simulator_interface.simulate import EpisodeRun, Outcome


class _EpisodeOver(Exception):  # noqa: N818 - not an error
    """All tasks are done, or the horizon is reached."""


class PyBulletSimulation(Simulation):  # type: ignore[misc]
    """One run, a few ticks per Scenic time step.

    Attributes:
        run: the loop, with the frame of the last tick.
        rejected: the requirement or guard that was violated, empty: none.
    """

    objects: list[Any]

    def __init__(self, scene: Scene, run: EpisodeRun, **options: Any) -> None:
        # Scenic's constructor runs the whole simulation.
        self.run = run
        self.rejected = ""
        self._episode = run.episode
        self._outcome: Outcome | None = None
        self._tracked = TrackedObjects(scene, self._episode)
        self._live: set[int] = set()  # people whom Scenic tells what to do
        self._told: dict[int, Script] = {}  # in this time step
        self._is_watched = _looks_at_objects(scene)
        self._ticks = whole_ticks(float(options["timestep"]), self._episode.dt)
        options["enableReplay"] = False
        super().__init__(scene, **options)

    # --- results -----------------------------------------------------------------

    @property
    def outcome(self) -> Outcome:
        """Trace, verdicts and counts to date; reading them ends the run."""
        if self._outcome is None:
            self.run.end(self._reason())
            self._outcome = self.run.outcome()
        return self._outcome

    def _reason(self) -> str:
        if self.rejected:
            return f"rejected: {self.rejected}"
        assert self.result is not None, "an unfinished run has no outcome"
        return f"scenic: {self.result.terminationReason}"

    @property
    def world(self) -> World:
        """The world as it came to be, with what appeared while it ran.

        It replays without Scenic unless Scenic directed a person (``scripted``).
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
        self._tracked.add(obj, self.run.frame)

    # --- scripts ---------------------------------------------------------------------------

    def script_of(
        self, behavior: Any, name: str, args: tuple[Any, ...], options: dict[str, Any]
    ) -> Script:
        """Make the script of a library behaviour that begins now.

        The script that the world already holds is taken up if it was made of this behaviour.

        Raises:
            InvalidScenarioError: an argument is not allowed; the message says which and why.
        """
        body = self._tracked[behavior._agent]
        if body.kind != "human":
            return Script(())
        if body.behavior is behavior:
            held = self._episode.crowd.script_of(body.number)
            if held is not None:
                return held
        try:
            directives = self._tracked.reader.read(name, args, options)
            check_pushes(self._episode.world, directives)
        except InputError as error:
            raise InvalidScenarioError(str(error)) from error
        return Script(directives)

    def carry_on(self, agent: Any, script: Script) -> None:
        """Let a person go on with a script in this time step."""
        body = self._tracked[agent]
        if body.kind == "human":
            self._told[body.number] = script

    def executeActions(self, allActions: Any) -> None:  # noqa: N802, N803
        """See Scenic's ``Simulation``; people with behaviours of the program's own obey it."""
        self._told = {}
        super().executeActions(allActions)
        crowd = self._episode.crowd
        for agent in self.agents:
            body = self._tracked[agent]
            if body.kind != "human" or agent.behavior is body.behavior:
                continue
            self._live.add(body.number)
            told = self._told.get(body.number)
            if not _is_entering(crowd.script_of(body.number)):
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
            self.objects = [obj for obj in self._tracked.moving if self._has_moved(obj)]
        try:
            super().updateObjects()
        finally:
            self.objects = everything

    def _has_moved(self, obj: Any) -> bool:
        body = self._tracked[obj]
        state = body.state(self.frame.sensed)
        moved = state != body.read
        body.read = state
        return moved

    def currentState(self) -> tuple[Vector, ...]:  # noqa: N802
        """Read the positions of all objects, which make up the trajectory."""
        if self.currentTime == 0:
            return tuple(obj.position for obj in self.objects)
        sensed = self.frame.sensed
        return tuple(self._tracked[obj].place(sensed) for obj in self.objects)

    def getProperties(self, obj: Any, properties: set[str]) -> dict[str, Any]:  # noqa: N802
        """See Scenic's ``Simulation``."""
        state = self._tracked[obj].properties(self.frame.sensed)
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
    """Count the control ticks of ``period`` [s] in a Scenic time step [s].

    Raises:
        SimulationCreationError: it is not a multiple of the period.
    """
    ticks = timestep / period
    if abs(ticks - round(ticks)) > 1e-6 or ticks < 1.0 - 1e-6:
        raise SimulationCreationError(
            f"timestep is {timestep:g} s; it must be a multiple of the control period of "
            f"{period:g} s"
        )
    return round(ticks)


def _is_entering(script: Script | None) -> bool:
    if script is None or script.done:
        return False
    return begins_outside(script.directives[script.index :])
