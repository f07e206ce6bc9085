"""Samplers on the same scenario: how often and how soon they find a failure, and how many kinds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mrta_falsify.campaigns.settings import DEFAULT_LIMITS, DEFAULTS
from mrta_falsify.campaigns.store import StoreError
from mrta_falsify.commands.campaign_settings import new_settings
from mrta_falsify.commands.folders import Place, make_directory
from mrta_falsify.commands.programs import Params
from mrta_falsify.commands.search_outcomes import SamplerRow, sampler_rows, survival_curves
from mrta_falsify.commands.searches import (
    ComparisonPlan,
    OnSearch,
    check_is_comparison,
    outcomes,
    run_searches,
)
from mrta_falsify.commands.stacks import Stack
from mrta_falsify.commands.workers import count_cores
from mrta_falsify.core import registry
from mrta_falsify.core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """What a comparison of samplers has found."""

    budget: int
    samplers: tuple[SamplerRow, ...]
    picture: str  #: file with the survival curves


def compare(
    scenario: Place,
    output: Place,
    *,
    samplers: Sequence[str] = ("random", "auto"),
    repeats: int = 10,
    budget: int = DEFAULT_LIMITS.budget,
    seed: int = DEFAULTS.trials.seed,
    all_failures: bool = False,
    jittered: int = DEFAULTS.trials.jittered,
    workers: int | None = None,
    stack: Stack | None = None,
    settings: Sequence[str] = (),
    specs: str | Sequence[str] = (),
    params: Params = (),
    resume: bool = False,
    on_search: OnSearch = lambda done, total, text: None,
) -> Comparison:
    """Compare samplers: falsification rate, simulations to the first failure, failure modes.

    Args:
        scenario: shipped name or path of a Scenic program.
        output: directory of the comparison, empty or missing unless it is resumed.
        samplers: registered names; the others are compared with the first one.
        repeats: searches per sampler.
        budget: simulations per search.
        seed: of the first repeat; each repeat has the next one.
        all_failures: run each budget out, to count failure modes.
        jittered: copies of each failing world; most must fail for it to count.
        workers: searches at a time; one per core if None.
        stack: the stack under test, or its YAML file; the default stack if None.
        settings: ``--set`` texts applied to the stack.
        specs: names of specifications, or ``stl:FORMULA``; those of campaigns if empty.
        params: Scenic's global parameters to override.
        resume: continue the comparison in ``output``.
        on_search: called after each search with the number done, the total and a line about it.

    Raises:
        InputError: anything of it is wrong; a directory that holds something else.
        Interrupted: Ctrl-C; finished trials are kept.
    """
    from reports.figure_searches import write_searches  # noqa: PLC0415 - matplotlib loads slowly

    directory = Path(output)
    _check_samplers(samplers)
    if resume:
        check_is_comparison(directory)
    elif any(path.suffix != ".part" for path in make_directory(directory).iterdir()):
        raise StoreError(f"{directory}: is not empty; continue it with --resume")
    plan = ComparisonPlan(
        settings=new_settings(
            scenario,
            output=directory,
            stack=stack,
            settings=settings,
            specs=specs,
            params=params,
            jittered=jittered,
            verify=0,  # how often a failure comes again says nothing of a sampler
        ),
        samplers=tuple(samplers),
        repeats=repeats,
        budget=budget,
        first_seed=seed,
        stop_after=0 if all_failures else 1,
    )
    run_searches(plan, directory, workers=count_cores(workers), on_search=on_search)
    found = outcomes(plan, directory)
    picture = directory / "comparison.png"
    write_searches({Path(scenario).stem: survival_curves(found)}, budget, picture)
    return Comparison(
        budget=budget,
        samplers=sampler_rows(found, budget),
        picture=str(picture),
    )


def _check_samplers(names: Sequence[str]) -> None:
    for name in names:
        registry.load("sampler", name, where="--samplers")
    if not names:
        raise ConfigError("--samplers: name at least one")
    if len(set(names)) < len(names):
        raise ConfigError(f"--samplers {','.join(names)}: each may be named once")
