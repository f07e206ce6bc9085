"""The zoo: scenes with known answers, on any stack."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

from mrta_falsify.campaigns.executors import Finished
from mrta_falsify.campaigns.settings import CampaignSettings, TrialSettings
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import InputError, WorldError
from mrta_falsify.specs import repeatable
from mrta_falsify.trial import judge, on_kinematic_engine
from mrta_falsify.verbs.corpus import (
    STORED,
    RecheckRun,
    answering,
    finished_jobs,
    judged_run,
    run_of,
)
from mrta_falsify.verbs.stacks import Stack, load_stack
from mrta_falsify.verbs.stored_failures import keeps_engine
from mrta_falsify.verbs.workers import count_cores
from mrta_falsify.worker import trial_job
from scenic_worlds.variation import perturb_world
from scenic_worlds.zoo import PREFIX, Answer, Scene, load_scene, scene_names

ZOO = PREFIX.rstrip("/")  #: name of all scenes together
TIME_LIMIT = 60.0  # s that one run may work and sleep

#: flaky: the scene passes, but a copy with small differences fails; refused: the stack runs other
#: scenes, but cannot be started in this one
SceneFate: TypeAlias = Literal["passes", "fails", "flaky", "timeout", "not judged", "refused"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneCheck:
    """What a stack did in a scene of the zoo."""

    name: str
    title: str
    source: str
    answer: Answer  #: that is known: a good stack passes, or even a good one fails
    fate: SceneFate
    violated: tuple[str, ...]  #: specifications
    sentence: str  #: about the violation that came first
    jittered_failures: int
    jittered: int  #: runs of copies with small differences

    @property
    def is_as_known(self) -> bool:
        """Whether the stack did at least as well as a good one is known to do."""
        return self.fate in ("passes", self.answer)


def is_zoo(name: str) -> bool:
    """Whether ``name`` means the zoo or a scene of it, and not a directory."""
    return name == ZOO or name.startswith(PREFIX)


def scenes_named(name: str = ZOO) -> tuple[Scene, ...]:
    """Load all scenes (``zoo``), or one (``zoo/NAME``).

    Raises:
        UnknownNameError: no such scene.
    """
    names = scene_names() if name == ZOO else (name.removeprefix(PREFIX),)
    return tuple(load_scene(one) for one in names)


def run_zoo(
    name: str = ZOO,
    *,
    stack: Stack | None = None,
    settings: Sequence[str] = (),
    jittered: int = 2,
    workers: int | None = None,
    time_limit: float | None = None,
    on_done: Callable[[SceneCheck], None] = lambda row: None,
) -> tuple[SceneCheck, ...]:
    """Run the scenes of the zoo on a stack.

    Args:
        name: ``zoo``, or ``zoo/NAME`` for one scene.
        stack: the stack, or its YAML file; the default one if None.
        settings: ``--set`` texts applied to the stack.
        jittered: copies with small differences that are run of each scene.
        workers: processes; one per core if None.
        time_limit: what one run may work and sleep [s]; 60 if None.
        on_done: called with each row, in the order in which they end.

    Returns:
        One row per scene. They run on the kinematic engine unless the stack names one.

    Raises:
        InputError: no such scene, an unknown layer, or a stack that starts in no scene.
        HarnessError: a run crashed.
    """
    scenes = scenes_named(name)
    config = load_stack(stack, settings)
    if keeps_engine(stack, settings):
        config = on_kinematic_engine(config)
    asked = [(scene, copy) for scene in scenes for copy in (STORED, *range(jittered))]
    jobs = [{"scene": scene.name, "copy": copy} for scene, copy in asked]
    runs: dict[str, dict[int, RecheckRun]] = {scene.name: {} for scene in scenes}
    rows: dict[str, SceneCheck] = {}
    pool = count_cores(workers)
    with contextlib.closing(finished_jobs(_settings(config, time_limit), jobs, pool)) as ended:
        for finished in ended:
            scene, copy = asked[finished.number]
            runs[scene.name][copy] = _run_of(finished, scene.name)
            if len(runs[scene.name]) == 1 + jittered:
                rows[scene.name] = _row(scene, runs[scene.name])
                on_done(rows[scene.name])
    if all(row.fate == "refused" for row in rows.values()):
        raise InputError(rows[scenes[0].name].sentence)
    return tuple(rows[scene.name] for scene in scenes)


def counts_of_scenes(rows: Sequence[SceneCheck]) -> dict[SceneFate, int]:
    """Count scenes by what the stack did in them."""
    fates: tuple[SceneFate, ...] = get_args(SceneFate)
    return {fate: sum(row.fate == fate for row in rows) for fate in fates}


def _settings(config: StackConfig, time_limit: float | None) -> CampaignSettings:
    """Settings that make workers run scenes instead of trials."""
    return CampaignSettings(
        trials=TrialSettings(scenario=ZOO, stack=config),
        target=f"{__name__}:{open_scenes.__name__}",
        time_limit=time_limit or TIME_LIMIT,
    )


def _run_of(finished: Finished, scene: str) -> RecheckRun:
    """Read what a worker answered; a stack may refuse one scene and run another."""
    try:
        return run_of(finished, scene)
    except InputError as error:
        return RecheckRun(fate="refused", error=str(error))


def _row(scene: Scene, runs: dict[int, RecheckRun]) -> SceneCheck:
    own = runs[STORED]
    copies = [run for number, run in runs.items() if number != STORED and run.fate == "ran"]
    failures = [run for run in copies if run.failed]
    fate: SceneFate = "passes"
    if own.failed:
        fate = "fails"
    elif own.fate == "timeout":
        fate = "timeout"
    elif own.fate == "refused":
        fate = "refused"
    elif failures:
        fate = "flaky"
    elif any(run.fate == "timeout" for run in runs.values()):
        fate = "timeout"
    elif set(own.not_judged) - {repeatable.NAME}:  # a scene may end before the stack is asked again
        fate = "not judged"
    told = own if own.failed or not failures else failures[0]
    return SceneCheck(
        name=scene.name,
        title=scene.title,
        source=scene.source,
        answer=scene.answer,
        fate=fate,
        violated=told.violated,
        sentence=told.sentence or told.error,
        jittered_failures=len(failures),
        jittered=len(copies),
    )


# --- in a worker ---------------------------------------------------------------------------


def open_scenes(settings: TrialSettings) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Open the zoo; the result runs one job after the other.

    Args:
        settings: with the stack and its limits.

    Returns:
        A function from ``{"number": n, "scene": name, "copy": k}`` to an encoded
        :class:`~mrta_falsify.verbs.corpus.RecheckRun`.
    """
    return answering(lambda job: run_scene(settings, load_scene(job["scene"]), job["copy"]))


def run_scene(settings: TrialSettings, scene: Scene, copy: int) -> RecheckRun:
    """Run a scene, or a jittered copy of it.

    Args:
        settings: with the stack and its limits.
        scene: of the zoo.
        copy: seed of the copy; ``STORED`` for the scene itself.
    """
    world = scene.world
    if copy != STORED:
        try:
            world = perturb_world(world, copy)
        except WorldError:
            return RecheckRun(fate="no place")
    job = trial_job(settings, world, settings.stack)
    return judged_run(judge(job, keep_trace=False).verdicts)
