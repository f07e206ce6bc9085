"""Sample worlds from a Scenic program: JSON, picture and Nav2 map of each."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrta_falsify.campaigns.settings import DEFAULTS, Mode
from mrta_falsify.commands.check import SHEET_WORLDS
from mrta_falsify.commands.folders import Place, make_directory
from mrta_falsify.commands.programs import (
    MAX_ATTEMPTS,
    Drawn,
    Params,
    draw_candidates,
    open_scenario,
)
from mrta_falsify.commands.stacks import Stack, costmap_of, load_stack
from mrta_falsify.core import codec
from mrta_falsify.core.codec import later
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.world import World, write_world
from mrta_falsify.possibility import look_at
from mrta_falsify.trial import campaign_specifications
from simulator_interface.formats import nav2


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleRow:
    """A candidate in ``samples.json``: a world, or why there is none."""

    number: int
    attempts: int
    error: str = later("")
    seed: int | None = later(None)
    u: tuple[float, ...] = later(())
    world_digest: str = later("")
    world: str = later("")  #: file name
    impossible: str = later("")  #: why no stack can do it, by the specifications of a campaign
    notes: tuple[str, ...] = later(())  #: what is narrow in it, and what is pushed in vain


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleIndex:
    """What ``samples.json`` holds."""

    scenario: str
    sources_digest: str
    params: dict[str, Any]
    mode: Mode
    seed: int
    samples: tuple[SampleRow, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Samples:
    """Files of sampled worlds."""

    directory: Path
    worlds: tuple[Path, ...]  #: each with a picture and a Nav2 map of the same name
    sheet: Path
    index: Path  #: candidates and digests
    rejected: int  #: candidates without a valid scene
    impossible: int  #: worlds that no stack can do


def sample(
    scenario: Place,
    output: Place,
    *,
    count: int = 10,
    seed: int = DEFAULTS.trials.seed,
    params: Params = (),
    mode: Mode = DEFAULTS.trials.mode,
    max_attempts: int = MAX_ATTEMPTS,
    stack: Stack | None = None,
    settings: Sequence[str] = (),
    on_progress: Callable[[float], None] = lambda done: None,
) -> Samples:
    """Sample worlds and write each as JSON, picture and Nav2 map, and all as a contact sheet.

    Args:
        scenario: path or shipped name of a program.
        output: directory, made if missing; files of the same names are replaced.
        count: candidates to draw.
        seed: of the campaign whose candidates they are.
        params: Scenic's global parameters to override.
        mode: how scenes are accepted.
        max_attempts: scenes to try for each.
        stack: its ``costmap`` layer makes the maps.
        settings: ``--set`` texts applied to the stack.
        on_progress: called with the number of worlds done.

    Raises:
        InputError: anything is wrong with the program.
        PlaceError: a file cannot be written.
    """
    program = open_scenario(scenario, params)
    config = load_stack(stack, settings)
    folder = make_directory(Path(output))
    rows: list[SampleRow] = []
    shown: list[tuple[World, str]] = []
    specifications = campaign_specifications(config)
    candidates = draw_candidates(
        program, count=count, seed=seed, mode=mode, max_attempts=max_attempts
    )
    for item in candidates:
        file = folder / f"world_{item.number:03d}.json"
        if item.world is not None:
            title = f"{program.name}, candidate {item.number} of seed {seed}"
            _write_sample(item.world, file, config, title)
            if len(shown) < SHEET_WORLDS:
                shown.append((item.world, f"{item.number:03d}"))
        rows.append(_row(item, file, specifications))
        on_progress(len(rows))
    index = SampleIndex(
        scenario=str(program.path),
        sources_digest=program.sources_digest,
        params=program.params,
        mode=mode,
        seed=seed,
        samples=tuple(rows),
    )
    samples = Samples(
        directory=folder,
        worlds=tuple(folder / row.world for row in rows if row.world),
        sheet=folder / "contact_sheet.png",
        index=folder / "samples.json",
        rejected=sum(not row.world for row in rows),
        impossible=sum(bool(row.impossible) for row in rows),
    )
    _draw_sheet(shown, samples.sheet, title=program.name)
    write_atomically(samples.index, (json.dumps(codec.encode(index), indent=1) + "\n").encode())
    return samples


def _write_sample(world: World, file: Path, config: StackConfig, title: str) -> None:
    """Write a world, and its picture and map beside it."""
    from reports import contact_sheet  # noqa: PLC0415 - matplotlib loads slowly

    write_world(world, file)
    costmap = costmap_of(world, config)
    nav2.write_nav2_map(costmap, file.with_suffix(".yaml"))
    picture = file.with_suffix(".png")
    contact_sheet.write_world_picture(world, picture, costmap=costmap, title=title)


def _draw_sheet(shown: Sequence[tuple[World, str]], path: Path, *, title: str) -> None:
    from reports import contact_sheet  # noqa: PLC0415 - matplotlib loads slowly

    contact_sheet.write_contact_sheet(
        [world for world, _ in shown], path, title=title, captions=[text for _, text in shown]
    )


def _row(item: Drawn, file: Path, specifications: Sequence[str]) -> SampleRow:
    row = SampleRow(number=item.number, attempts=item.attempts, error=item.error)
    if item.world is None or item.candidate is None:
        return row
    possible = look_at(item.world, specifications)
    return dataclasses.replace(
        row,
        seed=item.candidate.seed,
        u=tuple(item.candidate.u.tolist()),
        world_digest=item.world.digest(),
        world=file.name,
        impossible=possible.reason,
        notes=possible.notes,
    )
