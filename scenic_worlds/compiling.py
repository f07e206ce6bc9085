"""Compiling a Scenic file into a scenario that this project can run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import scenic
from scenic.core.distributions import Samplable, needsSampling
from scenic.core.regions import AllRegion, PointInRegionDistribution, PolygonalFootprintRegion
from scenic.core.scenarios import Scenario

from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.spelling import nearest_name
from scenic_worlds.compile_errors import compile_error_text
from scenic_worlds.primitives import randomness
from scenic_worlds.shipped import MODEL


def undo_unfaithful_pruning(scenario: Scenario) -> None:
    """Let positions have Scenic's own distribution again where pruning has changed it.

    Args:
        scenario: compiled by Scenic, changed in place.
    """
    for thing in scenario.objects:
        position = thing.position
        is_pruned = isinstance(position, Samplable) and position._conditioned is not position
        if is_pruned and not _keeps_distribution(thing, position):
            position.conditionTo(position)


def _keeps_distribution(thing: Any, position: Samplable) -> bool:
    """Whether an object's position is pruned without a change of the distribution."""
    if not isinstance(position, PointInRegionDistribution):
        return False
    if isinstance(position.region, (AllRegion, PolygonalFootprintRegion)):
        return True  # `visible`: only the pruned region can be drawn from
    mutates = needsSampling(thing.mutationScale) or thing.mutationScale != 0
    return not mutates and not needsSampling(position._conditioned.region)


def compile_scenario(path: Path, params: dict[str, Any]) -> Scenario:
    """Compile a Scenic file and check that it is a program of ours.

    Args:
        path: a ``.scenic`` file.
        params: global parameters to override.

    Raises:
        FormatError: it cannot be read or compiled, or has no robots or no tasks. The message
            begins with the file, and the line where there is one.
    """
    if not path.is_file():
        raise FormatError(f"{path}: there is no such file; give the path of a Scenic program")
    try:
        with randomness.seeded(0, "scenic/compile"):
            scenario = scenic.scenarioFromFile(str(path), params=dict(params))
    except SystemExit:
        raise FormatError(f"{path}: the program ends Python by sys.exit") from None
    except Exception as error:
        raise FormatError(compile_error_text(error, path)) from error
    _check_parts(scenario, path)
    undo_unfaithful_pruning(scenario)
    return scenario


def _check_parts(scenario: Scenario, path: Path) -> None:
    """Refuse programs of which no sample is a run."""
    if "_places" not in scenario.params or "horizon" not in scenario.params:
        raise FormatError(f"{path}: has no `model {MODEL}` at its top")
    kinds = [getattr(item, "kind", "") for item in scenario.objects]
    if not any(needsSampling(kind) or kind == "robot" for kind in kinds):
        raise FormatError(f"{path}: has no robot; add at least one, `new Robot with start_room 0`")


def check_tasks(scenario: Scenario, path: Path) -> None:
    """Refuse a program that gives its robots nothing to do.

    Raises:
        FormatError: ``param tasks`` is empty.
    """
    tasks = scenario.params.get("tasks", ())
    if not needsSampling(tasks) and hasattr(tasks, "__len__") and not len(tasks):
        own = [name for name in scenario.params if name != "tasks"]
        misspelt = nearest_name("tasks", own)
        meant = f" (param {misspelt} is not read; did you mean 'tasks'?)" if misspelt else ""
        raise FormatError(
            f"{path}: has no tasks{meant}; give them as "
            "`param tasks = [(arrival_s, start_room, end_room, deadline_s), ...]`"
        )
