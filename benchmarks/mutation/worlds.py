"""The worlds that mutants run in: uniform draws from small wards, and scenes of the corpus."""

from __future__ import annotations

import functools
import gzip
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from benchmarks.defects.worlds import PLANTS
from benchmarks.mutation.process import StackProcess, expected
from benchmarks.mutation.trees import ROOT
from mrta_falsify.core import codec, registry
from mrta_falsify.core.config import LAYERS, Choice, StackConfig, apply_setting
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.world import World
from mrta_falsify.trial import campaign_specifications
from scenic_worlds.shipped import scenario_names

OF_SUITE = ROOT / "benchmarks" / "falsification" / "scenarios"
RECORDED = ROOT / "tests" / "recorded"
#: recorded worlds that are no small wards: one run takes as long as fifty of a ward
LARGE = ("hospital_day", "warehouse_shift")
#: judge as well as those of campaigns, where they are registered
ALSO = ("exclusive_use", "honest_events", "kinematic_limits", "stack_runs")
OPENING = 300.0  # s of CPU to compile a Scenic program or to make a world


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """A Scenic program on small floors, and how the stack that it is run with differs."""

    scenario: str  #: of the suite, or shipped
    settings: tuple[str, ...] = ()  #: as ``--set`` takes them
    share: int = 2  #: of the uniform worlds; 1 where a run takes several seconds

    @property
    def name(self) -> str:
        """Scenario and settings in a word."""
        return "-".join((self.scenario, *(text.partition("=")[2] for text in self.settings)))

    @property
    def place(self) -> str:
        """Path of the program, or its shipped name."""
        own = OF_SUITE / f"{self.scenario}.scenic"
        return str(own) if own.is_file() else self.scenario

    @property
    def exists(self) -> bool:
        """Whether there are such a program and such layers."""
        known = Path(self.place).is_file() or self.scenario in scenario_names()
        try:
            stack = stack_of(self.settings)
        except InputError:
            return False
        return known and all(getattr(stack, at).name in registry.names(at) for at in LAYERS)


#: each alternative layer in at least one; what does not exist (a scenario that is called
#: otherwise, a layer that needs an extra) is left out
PORTFOLIO = (
    Source(scenario="single_file"),
    Source(scenario="narrow_pair"),
    Source(scenario="three_walkers"),
    Source(scenario="cluttered_corridor"),
    Source(scenario="radio_gaps_tight"),
    Source(scenario="closing_doors"),
    Source(scenario="same_room"),
    Source(scenario="late_batches"),
    Source(scenario="single_file", settings=("controller=decentralised_cbf",)),
    Source(scenario="narrow_pair", settings=("priority_rule=distance_to_goal",)),
    Source(scenario="late_batches", settings=("allocator=auction",)),
    Source(scenario="late_batches", settings=("allocator=exact",)),
    Source(scenario="same_room", settings=("allocator=chain",)),
    Source(scenario="same_room", settings=("allocator=in_turn",)),
    Source(scenario="same_room", settings=("allocator=nearest", "queue_policy=deadline_first")),
    Source(scenario="cluttered_corridor", settings=("planner=ompl",)),
    Source(scenario="three_walkers", settings=("waypoint_generator=direct",)),
    Source(scenario="narrow_doors", share=1),
    Source(scenario="single_file_corridor", share=1),
    Source(scenario="slow_doors", share=1),
    Source(scenario="lifts_and_chargers", share=1),
    Source(scenario="parked_robots", share=1),
    Source(scenario="crowded_refuges", share=1),
    Source(scenario="fast_robots", share=1),
    Source(scenario="holonomic_fleet", settings=("controller.dynamics=holonomic",), share=1),
)


def known_sources() -> tuple[Source, ...]:
    """List the sources of the portfolio that exist."""
    return tuple(source for source in PORTFOLIO if source.exists)


def mutation_specifications() -> tuple[str, ...]:
    """List what judges a mutant: the specifications of campaigns, and more if registered."""
    known = registry.names("specification")
    more = [name for name in ALSO if name in known]
    return tuple(dict.fromkeys((*campaign_specifications(), *more)))


def stack_of(settings: Sequence[str]) -> StackConfig:
    """Make the stack with some settings, on the kinematic engine.

    Raises:
        InputError: a setting names no layer.
    """
    return functools.reduce(apply_setting, settings, StackConfig(engine=Choice("kinematic")))


@dataclass(frozen=True, kw_only=True)
class Case:
    """A world of the benchmark."""

    name: str
    source: str  #: name of the source, or ``corpus``
    settings: tuple[str, ...]  #: of the stack
    data: dict[str, Any]  #: of the world, JSON-shaped

    @cached_property
    def world(self) -> World:
        """The world as a value."""
        return codec.decode(World, self.data, where=self.name)

    @cached_property
    def stack(self) -> StackConfig:
        """The sound stack of this world."""
        return stack_of(self.settings)


def uniform_cases(sound: StackProcess, count: int, seed: int) -> Iterator[Case]:
    """Draw worlds uniformly, equally many from each source.

    Args:
        sound: makes the worlds.
        count: worlds in all; a rejected draw is left out.
        seed: of the draws.
    """
    sources = known_sources()
    parts = [source for source in sources for _ in range(source.share)]
    for source in sources:
        numbers = [n for n in range(count) if parts[n % len(parts)] is source]
        for number in range(len(numbers)):
            made = realised(sound, source, seed=seed, number=number)
            if made is not None:
                yield Case(
                    name=f"{source.name}-{number}",
                    source=source.name,
                    settings=source.settings,
                    data=made["world"],
                )


def realised(
    sound: StackProcess, source: Source, *, seed: int, number: int, u: list[float] | None = None
) -> dict[str, Any] | None:
    """Make the world of a candidate, with its point and digest; None for a rejected one."""
    request = {"do": "realise", "scenario": source.place, "seed": seed, "number": number, "u": u}
    answer = expected(sound.ask(request, cpu_s=OPENING), f"{source.name} {number}")
    return None if "rejected" in answer else answer


def corpus_cases() -> Iterator[Case]:
    """List the recorded worlds, and those of the planted defects, without their defects."""
    settings: dict[str, tuple[str, ...]] = {}
    for row in codec.read_json(RECORDED / "runs.json")["cases"]:
        stack = codec.decode(StackConfig, row["stack"], where=row["name"])
        settings[row["name"]] = settings_of(stack)
    for name, of in sorted(settings.items()):
        if name not in LARGE:
            packed = (RECORDED / "worlds" / f"{name}.json.gz").read_bytes()
            data = json.loads(gzip.decompress(packed))
            yield Case(name=f"recorded-{name}", source="corpus", settings=of, data=data)
    for name, plant in sorted(PLANTS.items()):
        data = codec.encode(plant.world(0))
        yield Case(name=f"defect-{name}", source="corpus", settings=(), data=data)


def settings_of(stack: StackConfig) -> tuple[str, ...]:
    """List the layers of a stack that are not the default ones, the engine apart."""
    chosen = {layer: getattr(stack, layer).name for layer in LAYERS if layer != "engine"}
    default = StackConfig()
    return tuple(
        f"{layer}={name}" for layer, name in chosen.items() if name != getattr(default, layer).name
    )


# --- kept worlds -----------------------------------------------------------------------------


def write_cases(cases: list[Case], path: Path) -> None:
    """Write worlds to a file, for all later calls."""
    rows = [
        {"name": case.name, "source": case.source, "settings": case.settings, "data": case.data}
        for case in cases
    ]
    unfinished = path.with_suffix(".part")
    unfinished.write_bytes(gzip.compress(json.dumps(rows).encode(), mtime=0))
    unfinished.rename(path)


def read_cases(path: Path) -> tuple[Case, ...]:
    """Read the worlds of a file."""
    rows = json.loads(gzip.decompress(path.read_bytes()))
    return tuple(Case(**{**row, "settings": tuple(row["settings"])}) for row in rows)
