"""Scenic programs by name: check them, sample worlds from them; for the command line and Python."""

from __future__ import annotations

import json
import re
import statistics
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import InputError, UnknownNameError
from mrta_falsify.core.world import World, write_world
from mrta_falsify.verbs import run as app
from simulator_interface.formats import nav2

if TYPE_CHECKING:
    from mrta_falsify.core.candidate import Candidate, SearchSpace
    from scenic_worlds.lint import Lint
    from scenic_worlds.program import Program, RejectedScene

Mode = Literal["repair", "exact"]

MAX_ATTEMPTS = 3000  # scenes tried for one candidate
SHEET_WORLDS = 24  # worlds on a contact sheet at most


# --- programs ----------------------------------------------------------------------------------


def open_scenario(name: str, params: dict[str, Any] | None = None) -> Program:
    """Compile a Scenic program by path or shipped name.

    Args:
        name: ``FILE.scenic``, or a shipped name.
        params: global parameters to override.

    Raises:
        InputError: no such program, it does not compile, or it does not use a parameter.
    """
    # Scenic takes a second to import; --help need not.
    from scenic_worlds import program as programs  # noqa: PLC0415

    program = programs.compile_program(programs.scenario_path(name), params)
    check_params(program, name)
    return program


def check_params(program: Program, name: str) -> None:
    """Refuse overrides that the program cannot notice: most are misspelt.

    Raises:
        UnknownNameError: a parameter that none of its files mentions.
    """
    from scenic_worlds.sources import source_files  # noqa: PLC0415

    text = "\n".join(
        file.read_text(encoding="utf-8", errors="replace")
        for file in source_files(program.path)
        if file.suffix == ".scenic"
    )
    for given in program.params:
        if not re.search(rf"\b{re.escape(given)}\b", text):
            known = [p for p in program.scenario.params if p[0] != "_" and p not in program.params]
            raise UnknownNameError("parameter", given, known, where=f"-p: {name}")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drawn:
    """One candidate of a program, realised or rejected."""

    number: int
    seconds: float  #: of computing
    attempts: int
    rejections: dict[str, int]
    world: World | None = None
    candidate: Candidate | None = None  #: after repair
    error: str = ""  #: why there is no world


def draw(
    program: Program,
    *,
    count: int,
    seed: int,
    mode: Mode = "repair",
    max_attempts: int = MAX_ATTEMPTS,
) -> Iterator[Drawn]:
    """The first candidates of a random campaign on a program.

    Args:
        program: compiled.
        count: how many.
        seed: of the campaign; the same candidates as ``campaign --sampler random --seed``.
        mode: how scenes are accepted.
        max_attempts: scenes to try for each.

    Raises:
        RejectedScene: the first candidate has no valid scene.
        InputError: the first candidate has a value that no world can have, or cannot be run;
            later ones like that are drawn without a world.
    """
    from scenic_worlds.program import RejectedScene  # noqa: PLC0415

    for number in range(count):
        asked = program.candidate(seed, number)
        began = time.perf_counter()
        try:
            found = program.realise(asked, mode, max_attempts=max_attempts)
        except RejectedScene as error:
            if number == 0:
                raise
            yield _rejected(number, time.perf_counter() - began, error)
            continue
        except InputError as error:
            if number == 0:
                with app.located(str(program.path)):
                    raise
            seconds = time.perf_counter() - began
            yield Drawn(number=number, seconds=seconds, attempts=1, rejections={}, error=str(error))
            continue
        yield Drawn(
            number=number,
            seconds=time.perf_counter() - began,
            attempts=found.attempts,
            rejections=found.rejections,
            world=found.world,
            candidate=found.candidate,
        )


def _rejected(number: int, seconds: float, error: RejectedScene) -> Drawn:
    return Drawn(
        number=number,
        seconds=seconds,
        attempts=error.attempts,
        rejections=error.rejections,
        error=str(error),
    )


# --- check -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Check:
    """What is known of a program after it was compiled and sampled."""

    scenario: str
    path: Path
    mode: Mode
    space: SearchSpace
    compile_s: float
    drawn: tuple[Drawn, ...]
    lint: tuple[Lint, ...]

    @property
    def worlds(self) -> tuple[World, ...]:
        """The sampled worlds, in order."""
        return tuple(item.world for item in self.drawn if item.world is not None)

    @property
    def acceptance(self) -> float:
        """Share of uniform samples that are valid as they are.

        In mode exact all attempts are uniform samples; in mode repair the first of each
        candidate is.
        """
        if self.mode == "exact":
            return len(self.worlds) / sum(item.attempts for item in self.drawn)
        return sum(item.attempts == 1 and not item.error for item in self.drawn) / len(self.drawn)

    @property
    def rejections(self) -> list[tuple[str, int]]:
        """Who rejected how often, most frequent first."""
        counts: Counter[str] = Counter()
        for item in self.drawn:
            counts.update(item.rejections)
        return sorted(counts.items(), key=lambda entry: (-entry[1], entry[0]))


def check(
    name: str,
    *,
    count: int = 20,
    seed: int = 0,
    params: dict[str, Any] | None = None,
    mode: Mode = "repair",
    max_attempts: int = MAX_ATTEMPTS,
    on_progress: Callable[[float], None] = lambda done: None,
) -> Check:
    """Compile a program, sample it and lint it.

    Args:
        name: path or shipped name.
        count: scenes to sample.
        seed: of the campaign whose candidates are taken.
        params: global parameters to override.
        mode: how scenes are accepted.
        max_attempts: scenes to try for each.
        on_progress: called with the number of scenes done.

    Raises:
        InputError: anything is wrong with the program; says what and where.
    """
    from scenic_worlds import lint  # noqa: PLC0415 - loads Scenic, which is not compiling

    began = time.perf_counter()
    program = open_scenario(name, params)
    compile_s = time.perf_counter() - began
    drawn = []
    for item in draw(program, count=count, seed=seed, mode=mode, max_attempts=max_attempts):
        drawn.append(item)
        on_progress(len(drawn))
    return Check(
        scenario=program.name,
        path=program.path,
        mode=mode,
        space=program.space,
        compile_s=compile_s,
        drawn=tuple(drawn),
        lint=lint.lint_program(program.scenario, program.path, program.space),
    )


def check_summary(done: Check) -> dict[str, Any]:
    """What ``check --format json`` prints."""
    scenes = len(done.worlds)
    times = [1e3 * item.seconds for item in done.drawn]
    return {
        "scenario": done.scenario,
        "mode": done.mode,
        "dimensions": [codec.encode(dimension) for dimension in done.space.dimensions],
        "k": len(done.space),
        "opaque": [d.name for d in done.space.dimensions if d.kind == "opaque"],
        "compile_s": round(done.compile_s, 4),
        "scene_ms": {
            "median": round(statistics.median(times), 3),
            "p90": round(_quantile(times, 0.9), 3),
        },
        "acceptance": round(done.acceptance, 6),
        "attempts": sum(item.attempts for item in done.drawn),
        "scenes": scenes,
        "failed": len(done.drawn) - scenes,
        "rejections": [{"who": who, "count": count} for who, count in done.rejections],
        "lint": [codec.encode(finding) for finding in done.lint],
    }


def _quantile(values: Sequence[float], share: float) -> float:
    """Value that ``share`` of the values do not exceed."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def write_check(done: Check, directory: Path) -> list[Path]:
    """Write ``check.json`` and, if there are worlds, ``contact_sheet.png``.

    Raises:
        InputError: the directory cannot be made.
    """
    folder = app.make_directory(directory)
    report = folder / "check.json"
    report.write_text(json.dumps(app.finite(check_summary(done)), indent=1) + "\n", "utf-8")
    written = [report]
    if done.worlds:
        written.append(folder / "contact_sheet.png")
        write_contact_sheet(done, written[-1])
    return written


def write_contact_sheet(done: Check, path: Path) -> None:
    """Picture of the first sampled worlds of a check."""
    from reports import contact_sheet  # noqa: PLC0415 - matplotlib loads slowly

    shown = [item for item in done.drawn if item.world is not None][:SHEET_WORLDS]
    contact_sheet.write_contact_sheet(
        [item.world for item in shown if item.world is not None],
        path,
        title=done.scenario,
        captions=[f"{item.number:03d}" for item in shown],
    )


# --- sample ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Samples:
    """Files of sampled worlds."""

    directory: Path
    worlds: tuple[Path, ...]  #: each with a picture and a Nav2 map of the same name
    sheet: Path
    index: Path  #: candidates and digests
    rejected: int  #: candidates without a valid scene


def sample(
    name: str,
    directory: Path,
    *,
    count: int,
    seed: int = 0,
    params: dict[str, Any] | None = None,
    mode: Mode = "repair",
    max_attempts: int = MAX_ATTEMPTS,
    config: StackConfig | None = None,
    on_progress: Callable[[float], None] = lambda done: None,
) -> Samples:
    """Sample worlds and write each as JSON, picture and Nav2 map, and all as a contact sheet.

    Args:
        name: path or shipped name of a program.
        directory: made if missing; files of the same names are replaced.
        count: candidates to draw.
        seed: of the campaign whose candidates they are.
        params: global parameters to override.
        mode: how scenes are accepted.
        max_attempts: scenes to try for each.
        config: its ``costmap`` layer makes the maps.
        on_progress: called with the number of worlds done.

    Raises:
        InputError: anything is wrong with the program, or the files cannot be written.
    """
    from reports import contact_sheet  # noqa: PLC0415 - matplotlib loads slowly

    program = open_scenario(name, params)
    folder = app.make_directory(directory)
    files: list[Path] = []
    rows: list[dict[str, Any]] = []
    shown: list[tuple[World, str]] = []
    for item in draw(program, count=count, seed=seed, mode=mode, max_attempts=max_attempts):
        rows.append(_index_row(item))
        if item.world is not None:
            file = folder / f"world_{item.number:03d}.json"
            write_world(item.world, file)
            costmap = app.costmap_of(item.world, config)
            nav2.write_nav2_map(costmap, file.with_suffix(".yaml"))
            contact_sheet.write_world_picture(
                item.world,
                file.with_suffix(".png"),
                costmap=costmap,
                title=f"{program.name}, candidate {item.number} of seed {seed}",
            )
            rows[-1]["world"] = file.name
            files.append(file)
            if len(shown) < SHEET_WORLDS:
                shown.append((item.world, f"{item.number:03d}"))
        on_progress(len(rows))
    sheet = folder / "contact_sheet.png"
    contact_sheet.write_contact_sheet(
        [world for world, _ in shown],
        sheet,
        title=program.name,
        captions=[caption for _, caption in shown],
    )
    index = folder / "samples.json"
    head = {
        "scenario": str(program.path),
        "sources_digest": program.sources_digest,
        "params": program.params,
        "mode": mode,
        "seed": seed,
    }
    index.write_text(json.dumps({**head, "samples": rows}, indent=1) + "\n", encoding="utf-8")
    return Samples(
        directory=folder,
        worlds=tuple(files),
        sheet=sheet,
        index=index,
        rejected=len(rows) - len(files),
    )


def _index_row(item: Drawn) -> dict[str, Any]:
    row: dict[str, Any] = {"number": item.number, "attempts": item.attempts}
    if item.world is None or item.candidate is None:
        return {**row, "error": item.error}
    return {
        **row,
        "seed": item.candidate.seed,
        "u": item.candidate.u.tolist(),
        "world_digest": item.world.digest(),
    }
