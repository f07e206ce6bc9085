"""Scenic programs by name, and the first candidates of a random campaign on them."""

from __future__ import annotations

import contextlib
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mrta_falsify.campaigns.settings import Mode
from mrta_falsify.commands.folders import Place, located
from mrta_falsify.core.errors import InputError, UnknownNameError
from mrta_falsify.core.world import World

if TYPE_CHECKING:
    from mrta_falsify.core.candidate import Candidate
    from scenic_worlds.program import Program, RejectedScene

MAX_ATTEMPTS = 3000  # scenes tried for one candidate

#: Scenic's global parameters to override: texts like ``gap=0.3``, or values by name
Params = Sequence[str] | Mapping[str, Any]


def parse_params(params: Params) -> dict[str, Any]:
    """Read Scenic parameters from ``NAME=VALUE`` texts; numbers become numbers.

    Raises:
        InputError: a text is not of that form.
    """
    if isinstance(params, Mapping):
        return dict(params)
    found: dict[str, Any] = {}
    for text in params:
        name, separator, value = text.partition("=")
        if not separator or not name.strip().isidentifier():
            raise InputError(f"-p {text}: it must read NAME=VALUE")
        found[name.strip()] = _number_or_text(value)
    return found


def _number_or_text(text: str) -> Any:
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(text)
    return text


def open_scenario(name: Place, params: Params = ()) -> Program:
    """Compile a Scenic program by path or shipped name.

    Args:
        name: ``FILE.scenic``, or a shipped name.
        params: Scenic's global parameters to override.

    Raises:
        InputError: no such program, it does not compile, or it does not use a parameter.
    """
    # Scenic takes a second to import; --help need not.
    from scenic_worlds import program as programs  # noqa: PLC0415

    program = programs.compile_program(programs.scenario_path(str(name)), parse_params(params))
    check_params(program, str(name))
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


def draw_candidates(
    program: Program,
    *,
    count: int,
    seed: int,
    mode: Mode = "repair",
    max_attempts: int = MAX_ATTEMPTS,
) -> Iterator[Drawn]:
    """Draw the first candidates of a random campaign on a program.

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
                with located(str(program.path)):
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
