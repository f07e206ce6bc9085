"""Scenic's simulator interface over our own tick loop, so that ``scenic -S FILE`` works.

A Scenic time step is a few control ticks of :class:`~simulator_interface.simulate.EpisodeRun`, the
loop that ``mrta-falsify run`` drives; robots without a behaviour are driven by the stack.
How to use it, and what it makes of Scenic's dynamic statements: ``docs/scenic-library.md``.
"""

from __future__ import annotations

import json
import random
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scenic.core import dynamics
from scenic.core.dynamics import GuardViolation
from scenic.core.dynamics.utils import RejectSimulationException
from scenic.core.errors import InvalidScenarioError
from scenic.core.scenarios import Scene
from scenic.core.simulators import SimulationCreationError, Simulator

from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.durable import make_folder, write_atomically
from mrta_falsify.core.errors import InputError, WorldError
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.protocols import Specification
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.trace import write_trace
from mrta_falsify.core.world import World, write_world
from mrta_falsify.specs.library import build_specifications
from simulator_interface.external.transcript import Transcript
from simulator_interface.scenic_bridge.parameters import read_parameters
from simulator_interface.scenic_bridge.scene_contract import BEHAVIORS_FILE
from simulator_interface.scenic_bridge.simulation import PyBulletSimulation
from simulator_interface.scenic_bridge.world_from_scene import world_from_scene
from simulator_interface.simulate import EpisodeRun, Outcome

TIMESTEP = 0.25  # s; five ticks of 20 Hz: Scenic's own work per step is 0.3 to 2 ms

__all__ = ["PyBulletSimulation", "PyBulletSimulator", "program_name", "simulate_scene"]


class PyBulletSimulator(Simulator):  # type: ignore[misc]
    """Runs scenes of programs over ``scenic_worlds.model``.

    Args:
        realise: makes the world of a scene; by default
            :func:`.world_from_scene.world_from_scene` with the program's name and ``param seed``.
        config: the stack under test; by default what the program's parameters say.
        specifications: new specifications for a run; by default those of ``param specs``.
        keep_trace: keep the trace's columns and tables, not only its digest.
        stop: ends a run at the first frame for which it returns a reason.
        told: what a foreign stack has said; it is not asked again.
    """

    def __init__(
        self,
        *,
        realise: Callable[[Scene], World] | None = None,
        config: StackConfig | None = None,
        specifications: Callable[[], Sequence[Specification]] | None = None,
        keep_trace: bool = True,
        stop: Callable[[Frame], str] | None = None,
        transcript: Transcript | None = None,
    ) -> None:
        super().__init__()
        self._stop = stop
        self._transcript = transcript
        self._realise = realise
        self._config = config
        self._specifications = specifications
        self._keep_trace = keep_trace

    def createSimulation(self, scene: Scene, **options: Any) -> PyBulletSimulation:  # noqa: N802
        """See Scenic's ``Simulator``.

        A violated requirement, or a violated guard of a behaviour, ends the run; what was
        logged until then is returned (attribute ``rejected`` says why).

        Raises:
            SimulationCreationError: the scene cannot be run; the message says why.
        """
        if options.get("timestep") is None:
            options["timestep"] = TIMESTEP
        try:
            settings = read_parameters(scene.params)
            realise = self._realise or _realise_with(settings.seed)
            config = self._config or settings.config
            run = EpisodeRun(
                realise(scene),
                config,
                specifications=(
                    self._specifications()
                    if self._specifications is not None
                    else build_specifications(settings.specifications)
                ),
                keep_trace=self._keep_trace,
                stop=self._stop,
                transcript=self._transcript,
            )
        except InputError as error:
            raise SimulationCreationError(str(error)) from error
        simulation = _simulated(scene, run, options)
        outcome = simulation.outcome
        if options.get("verbosity", 0) >= 1:
            print(f"  {_in_words(outcome)}")
        if settings.output is not None:
            _write(simulation, config, settings.output / str(options["name"]))
        return simulation


def simulate_scene(
    scene: Scene,
    world: World,
    config: StackConfig,
    *,
    specifications: Sequence[Specification] = (),
    keep_trace: bool = True,
    on_progress: Callable[[float], None] | None = None,
    stop: Callable[[Frame], str] | None = None,
    transcript: Transcript | None = None,
) -> Outcome:
    """Run one scene through Scenic, as :func:`simulator_interface.simulate.simulate` a world.

    For worlds that are ``scripted``: what behaviours draw comes from ``world.seed``, so the
    same scene and world give the same trace.

    ``scene`` is the sampled scene, for its behaviours and compose block, and ``world`` is made
    of it; the other arguments are those of ``simulate``.

    Raises:
        InputError: the world cannot be run, or the program fails while it runs; file and
            line of the program are named.
    """
    simulator = PyBulletSimulator(
        realise=lambda _: world,
        config=config,
        specifications=lambda: specifications,
        keep_trace=keep_trace,
        stop=_watching(stop, on_progress, config.control_rate),
        transcript=transcript,
    )
    timeout = dynamics.stuckBehaviorWarningTimeout
    dynamics.stuckBehaviorWarningTimeout = (
        0  # the warning is an alarm signal, which a worker must not set
    )
    try:
        simulation = simulator.simulate(scene, verbosity=0, raiseGuardViolations=False)
    except SimulationCreationError as error:
        raise WorldError(f"{world.name}: {error}") from error
    except Exception as error:
        where = _line_of_program(error)
        if not where:
            raise
        raise WorldError(f"{where}: {type(error).__name__}: {error}") from error
    finally:
        dynamics.stuckBehaviorWarningTimeout = timeout
    outcome: Outcome = simulation.outcome
    return outcome


def _watching(
    stop: Callable[[Frame], str] | None,
    on_progress: Callable[[float], None] | None,
    per_second: int,
) -> Callable[[Frame], str]:
    def watch(frame: Frame) -> str:
        if on_progress is not None and frame.sensed.tick % per_second == 0:
            on_progress(frame.sensed.time)
        return stop(frame) if stop is not None else ""

    return watch


def _line_of_program(error: BaseException) -> str:
    """File and line of the program that ``error`` is due to, empty if it is not the program's.

    It is the program's if it was raised in a line of it, or by us because of its arguments.
    """
    frames = traceback.extract_tb(error.__traceback__)
    if not isinstance(error, InvalidScenarioError) and not frames[-1].filename.endswith(".scenic"):
        return ""
    lines = [frame for frame in frames if frame.filename.endswith(".scenic")]
    own = [line for line in lines if Path(line.filename).name != BEHAVIORS_FILE]
    return f"{own[-1].filename}:{own[-1].lineno}" if own else "the program"


def _simulated(scene: Scene, run: EpisodeRun, options: dict[str, Any]) -> PyBulletSimulation:
    """Run a simulation; what behaviours draw comes from Scenic's global generators."""
    try:
        with seeded_globals(run.episode.world.seed, "behaviors"):
            return PyBulletSimulation(scene, run, **options)
    except (RejectSimulationException, GuardViolation) as error:
        if options.get("raiseGuardViolations") and isinstance(error, GuardViolation):
            raise
        simulation: PyBulletSimulation = error.simulation
        simulation.close_rejected(str(error))
        return simulation
    finally:
        run.close()


@contextmanager
def seeded_globals(seed: int, purpose: str) -> Iterator[None]:
    """Seed the global generators that Scenic draws from, and restore them after."""
    before = random.getstate(), np.random.get_state()  # noqa: NPY002
    numbers = stream(seed, purpose)
    random.seed(int(numbers.integers(2**63)))
    np.random.seed(int(numbers.integers(2**32)))  # noqa: NPY002
    try:
        yield
    finally:
        random.setstate(before[0])
        np.random.set_state(before[1])  # noqa: NPY002


def _in_words(outcome: Outcome) -> str:
    broken = [verdict.spec for verdict in outcome.verdicts if verdict.violated]
    unjudged = [verdict.spec for verdict in outcome.verdicts if verdict.not_judged]
    missing = f"; not judged: {', '.join(unjudged)}" if unjudged else ""
    return (
        f"{outcome.sim_time:.1f} s simulated, ended: {outcome.ended}; "
        f"{outcome.tasks.completed} of {outcome.tasks.total} tasks done; "
        f"violated: {', '.join(broken) or 'nothing'}{missing}; trace {outcome.trace.digest[:12]}"
    )


def _write(simulation: PyBulletSimulation, config: StackConfig, folder: Path) -> None:
    """Write the files that show the run and, unless it is scripted, repeat it."""
    make_folder(folder)
    outcome = simulation.outcome
    write_world(simulation.world, folder / "world.json")
    text = yaml.safe_dump(codec.encode(config), sort_keys=False)
    write_atomically(folder / "stack.yaml", text.encode())
    write_trace(outcome.trace, folder / "trace.zip")
    verdicts = json.dumps(codec.encode(outcome.verdicts), indent=1)
    write_atomically(folder / "verdicts.json", (verdicts + "\n").encode())


def _realise_with(seed: int) -> Callable[[Scene], World]:
    return lambda scene: world_from_scene(scene, name=program_name(scene), seed=seed)


def program_name(scene: Scene) -> str:
    """Name a scene's program by its file, ``scenic`` if that is unknown."""
    namespace = getattr(scene.dynamicScenario, "_dummyNamespace", None) or {}
    file = namespace.get("__file__")
    return Path(file).stem if isinstance(file, str) else "scenic"
