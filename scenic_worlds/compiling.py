"""Compiling a Scenic file: Scenic's exceptions turned into sentences with file and line."""

from __future__ import annotations

import traceback
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any

import scenic
from scenic.core.distributions import RandomControlFlowError, RejectionException, needsSampling
from scenic.core.errors import ScenicError
from scenic.core.object_types import Object
from scenic.core.scenarios import Scenario

from mrta_falsify.core.errors import FormatError, InputError
from scenic_worlds.checking import names_in_worlds
from scenic_worlds.primitives import randomness

LIBRARY = Path(__file__).parent
SCENIC_ENDINGS = (".scenic", ".sc")


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
        raise FormatError(f"{_where(error, path)}: {_reason(error)}") from error
    _check_parts(scenario, path)
    return scenario


def _check_parts(scenario: Scenario, path: Path) -> None:
    """Refuse programs of which no sample is a run."""
    if "_places" not in scenario.params:
        raise FormatError(f"{path}: has no `model scenic_worlds.model` at its top")
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
        raise FormatError(
            f"{path}: has no tasks; give them as "
            "`param tasks = [(arrival_s, start_room, end_room, deadline_s), ...]`"
        )


# --- where -----------------------------------------------------------------------------------


def _where(error: BaseException, path: Path) -> str:
    """``file:line`` that an exception points to, the file alone if it names no line."""
    line = getattr(error, "lineno", None)
    if line:
        file = getattr(error, "filename", None)
        return f"{file or path}:{line}"
    return scenic_line(error.__traceback__, path)


def scenic_line(trace: TracebackType | None, path: Path) -> str:
    """Innermost ``file:line`` of a traceback in Scenic code; the user's before our library's."""
    frames = [f for f in traceback.extract_tb(trace) if f.filename.endswith(SCENIC_ENDINGS)]
    own = [f for f in frames if not _is_library(f.filename, path)]
    for frame in reversed(own or frames):
        return f"{frame.filename}:{frame.lineno}"
    return str(path)


def _is_library(filename: str, path: Path) -> bool:
    file = Path(filename)
    return file.parent == LIBRARY and file != path


# --- why -------------------------------------------------------------------------------------


def _reason(error: BaseException) -> str:
    """One sentence for an exception of Scenic's, or of the program's own code."""
    text = str(error).strip() or type(error).__name__
    if isinstance(error, InputError):
        return text
    if isinstance(error, RandomControlFlowError):
        return (
            f"{text}: `if`, loops and comparisons cannot depend on a random value; "
            "use a property such as `with active Uniform(True, False)`, or `require`"
        )
    if isinstance(error, RejectionException):
        return f"no scene can be valid: {text}"
    if isinstance(error, (NameError, AttributeError)):
        return f"unknown name: {text}"
    if isinstance(error, ModuleNotFoundError):
        return _missing_module(text, str(error.name))
    if isinstance(error, ScenicError):
        return _with_object_names(text, error.__traceback__)
    return f"{type(error).__name__}: {text}"


def _missing_module(text: str, name: str) -> str:
    if name.partition(".")[0] != "verifai":
        return text
    return (
        f"{text}; `model scenic_worlds.model` at the top makes VerifaiRange, VerifaiDiscreteRange "
        "and VerifaiOptions work without VerifAI"
    )


def _with_object_names(text: str, trace: TracebackType | None) -> str:
    """Scenic's message about objects that have no name, with the names they get in worlds.

    Scenic checks fixed objects before anybody holds the scenario, and says "unnamed Bed"; which
    objects it was looking at is in its frames.
    """
    while trace is not None:
        local = trace.tb_frame.f_locals
        scenario = local.get("self")
        if isinstance(scenario, Scenario) and trace.tb_frame.f_code.co_name == "validate":
            return _overlap(text, local, names_in_worlds(scenario.objects))
        scenario = local.get("scenario")
        if isinstance(scenario, Scenario) and isinstance(local.get("obj"), Object):
            names = names_in_worlds(scenario.objects)
            return _named(text, [names.get(local["obj"], "an object")])
        trace = trace.tb_next
    return text


def _overlap(text: str, local: dict[str, Any], names: dict[Any, str]) -> str:
    things = [local.get("oi")]
    if " intersects " in text:
        things.append(local.get("oj"))
        first, second = (_placed(thing, names) for thing in reversed(things))
        return f"{second} stands where {first} already stands; both are fixed, so no scene is valid"
    if "does not fit" in text:
        return f"{_placed(things[0], names)} is not inside its region ({_region(local)})"
    return _named(text, [names.get(thing, "an object") for thing in things])


def _placed(thing: Any, names: dict[Any, str]) -> str:
    position = thing.position
    return f"{names.get(thing, 'an object')} at ({position.x:g}, {position.y:g})"


def _region(local: dict[str, Any]) -> str:
    container = local.get("container")
    name = getattr(getattr(local.get("oi"), "regionContainedIn", None), "name", None)
    return str(name or getattr(container, "name", None) or type(container).__name__)


def _named(text: str, names: Iterable[str]) -> str:
    return f"{', '.join(names)}: {text}"
