"""The zoo: scenes with known answers, on any stack."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from mrta_falsify.campaigns.settings import TrialSettings
from mrta_falsify.commands.corpus import keeps_engine, not_judged
from mrta_falsify.commands.stacks import Stack, load_stack
from mrta_falsify.commands.workers import count_cores
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.lab import Experiment, Lab, RunResult, experiment_of_trial
from mrta_falsify.specs import repeatable
from mrta_falsify.specs.causes import leading
from mrta_falsify.trial import on_kinematic_engine
from reports.sentences import violation_sentence
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
    answer: Answer  #: known answer
    fate: SceneFate
    violated: tuple[str, ...]  #: specifications
    sentence: str  #: what was violated first
    jittered_failures: int  #: perturbed runs that fail
    jittered: int  #: perturbed runs

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
        on_done: called with each row, in the order of the scenes.

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
    rows = []
    with Lab(workers=count_cores(workers), time_limit=time_limit or TIME_LIMIT) as lab:
        results = lab.map(one for scene in scenes for one in _experiments(scene, config, jittered))
        for scene in scenes:
            own, *copies = itertools.islice(results, 1 + jittered)
            rows.append(_row(scene, own, copies))
            on_done(rows[-1])
    if all(row.fate == "refused" for row in rows):
        raise InputError(rows[0].sentence)
    return tuple(rows)


def _experiments(scene: Scene, config: StackConfig, jittered: int) -> Iterator[Experiment]:
    """Yield the runs of a scene: its world, then copies with small differences."""
    own = experiment_of_trial(TrialSettings(scenario=ZOO, stack=config), scene.world, config)
    return (own.with_perturbation(number) for number in range(1 + jittered))


def counts_of_scenes(rows: Sequence[SceneCheck]) -> dict[SceneFate, int]:
    """Count scenes by what the stack did in them."""
    fates: tuple[SceneFate, ...] = get_args(SceneFate)
    return {fate: sum(row.fate == fate for row in rows) for fate in fates}


def _row(scene: Scene, own: RunResult, perturbed: Sequence[RunResult]) -> SceneCheck:
    copies = [run for run in perturbed if run.status in ("judged", "not_judged")]
    failures = [run for run in copies if run.violated]
    fate: SceneFate = "passes"
    if own.violated:
        fate = "fails"
    elif own.status == "timeout":
        fate = "timeout"
    elif own.status == "impossible":
        fate = "refused"
    elif failures:
        fate = "flaky"
    elif any(run.status == "timeout" for run in perturbed):
        fate = "timeout"
    elif not_judged(own) - {repeatable.NAME}:  # a scene may end before the stack is asked again
        fate = "not judged"
    told = own if own.violated or not failures else failures[0]
    first = leading(told.verdicts)
    return SceneCheck(
        name=scene.name,
        title=scene.title,
        source=scene.source,
        answer=scene.answer,
        fate=fate,
        violated=told.violated,
        sentence=violation_sentence(first) if first is not None else _why_not(told),
        jittered_failures=len(failures),
        jittered=len(copies),
    )


def _why_not(result: RunResult) -> str:
    return result.detail if result.status == "impossible" else ""
