"""An exception of Scenic's, or of the program's own code, as one sentence with file and line."""

from __future__ import annotations

import builtins
import inspect
import re
import traceback
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

from scenic.core.distributions import RandomControlFlowError, RejectionException
from scenic.core.errors import ScenicError
from scenic.core.object_types import Constructible, Object
from scenic.core.scenarios import Scenario

from mrta_falsify.core.errors import InputError
from mrta_falsify.core.spelling import did_you_mean
from scenic_worlds.checking import names_in_worlds
from scenic_worlds.origins import SCENIC_ENDINGS, origin_of
from scenic_worlds.shipped import MODEL, is_library_file, library_names


def misplaced_object(error: BaseException) -> tuple[Any, str] | None:
    """Find the object that Scenic complains about; say what is wrong in the worlds' names.

    Scenic checks fixed objects before it returns the scenario, and calls them "unnamed Bed";
    which objects it was looking at is in its frames.
    """
    if not isinstance(error, ScenicError):
        return None
    text = str(error).strip()
    for frame, _ in traceback.walk_tb(error.__traceback__):
        local = frame.f_locals
        scenario = local.get("self")
        if isinstance(scenario, Scenario) and frame.f_code.co_name == "validate":
            names = names_in_worlds(scenario.objects)
            return local.get("oi"), _validation_reason(text, local, names)
        scenario, thing = local.get("scenario"), local.get("obj")
        if isinstance(scenario, Scenario) and isinstance(thing, Object):
            name = names_in_worlds(scenario.objects).get(thing, "an object")
            if "does not fit" in text:
                return thing, _never_fits(name, local)
            return thing, f"{name}: {text}"
    return None


def _validation_reason(text: str, local: dict[str, Any], names: dict[Any, str]) -> str:
    thing, other = local.get("oi"), local.get("oj")
    if " intersects " in text:
        here, there = _placed(thing, names), _placed(other, names)
        return f"{here} stands where {there} already stands; both are fixed, so no scene is valid"
    if "does not fit" in text:
        container = getattr(thing, "regionContainedIn", None)
        name = _region_name(container) or _region_name(local.get("container"))
        return f"{_placed(thing, names)} is not inside its region ({name})"
    return f"{names.get(thing, 'an object')}: {text}"


def _placed(thing: Any, names: dict[Any, str]) -> str:
    position = thing.position
    return f"{names.get(thing, 'an object')} at ({position.x:g}, {position.y:g})"


def _never_fits(name: str, local: dict[str, Any]) -> str:
    """Say why no position of an object is allowed, from what Scenic's pruning looked at."""
    drawn_from = _region_name(local.get("base"))
    container = _region_name(getattr(local.get("obj"), "regionContainedIn", None))
    where = f"`in {drawn_from}`" if drawn_from else "its position"
    reason = (
        f"{name} fits nowhere: {where} places its centre so that no part of {container} holds it"
    )
    if not drawn_from.startswith("along_wall("):
        return f"{reason}; make it smaller, or place it in a larger region"
    return (
        f"{name} fits nowhere: `in {drawn_from}` puts its centre into the strip beside the wall, "
        f"so it would stand in the wall; write `on {drawn_from}`, which puts its back edge there"
    )


def _region_name(region: Any) -> str:
    if region is None:
        return ""
    return str(getattr(region, "name", None) or type(region).__name__)


_WRONG_MODEL = re.compile(r"could not import world model ([.\w]+)")
_WRONG_KEYWORD = re.compile(r"(\w+)\(\) got an unexpected keyword argument '(\w+)'")


def compile_error_text(error: BaseException, path: Path) -> str:
    """Say where compiling failed and why, as ``FILE:LINE: REASON``.

    Args:
        error: as raised, with its traceback.
        path: of the program; stands alone where no line is known.
    """
    misplaced = misplaced_object(error)
    if misplaced is not None:
        thing, reason = misplaced
        origin = origin_of(thing)
        where = f"{origin[0]}:{origin[1]}" if origin else str(path)
        return f"{where}: {reason}"
    line = getattr(error, "lineno", None)
    if line:
        where = f"{getattr(error, 'filename', None) or path}:{line}"
    else:
        where = scenic_line(error.__traceback__, path)
    return f"{where}: {_reason(error, path)}"


# --- where -----------------------------------------------------------------------------------


def scenic_line(trace: TracebackType | None, path: Path) -> str:
    """Find the innermost ``file:line`` in Scenic code; the user's before the library's."""
    found = _scenic_frame(trace, path)
    return f"{found[0].f_code.co_filename}:{found[1]}" if found else str(path)


def _scenic_frame(trace: TracebackType | None, path: Path) -> tuple[FrameType, int] | None:
    """Find the innermost frame in Scenic code and its line; the user's before the library's."""
    frames = [
        (frame, line)
        for frame, line in traceback.walk_tb(trace)
        if frame.f_code.co_filename.endswith(SCENIC_ENDINGS)
    ]
    own = [(frame, line) for frame, line in frames if _is_own(frame.f_code.co_filename, path)]
    chosen = own or frames
    return chosen[-1] if chosen else None


def _is_own(filename: str, path: Path) -> bool:
    return Path(filename) == path or not is_library_file(filename)


# --- why -------------------------------------------------------------------------------------


def _reason(error: BaseException, path: Path) -> str:
    """Explain an exception in one sentence."""
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
    if isinstance(error, NameError):
        return f"unknown name: {text}{_name_hint(error, path)}"
    if isinstance(error, AttributeError):
        return f"unknown name: {text}{_attribute_hint(error)}"
    if isinstance(error, ModuleNotFoundError):
        return _missing_module(text, str(error.name))
    wrong_model = _WRONG_MODEL.search(text)
    if wrong_model is not None:
        return text + did_you_mean(wrong_model[1], [MODEL])
    if text == "EOF in multi-line statement":
        return f"{text}: a bracket or a quote that was opened above is not closed"
    if isinstance(error, ScenicError):
        return text
    return f"{type(error).__name__}: {text}{_keyword_hint(text, error.__traceback__, path)}"


def _name_hint(error: NameError, path: Path) -> str:
    """Say what an undefined name was meant to be, or which line it lacks."""
    name = str(error.name or "")
    found = _scenic_frame(error.__traceback__, path)
    if not name or found is None:
        return ""
    frame, line = found
    visible = _visible_names(frame)
    hint = did_you_mean(name, _of_the_same_use(name, visible, frame, line))
    if hint or library_names() <= visible.keys():
        return hint
    meant = "" if name in library_names() else did_you_mean(name, library_names())
    if Path(frame.f_code.co_filename) != path:  # an imported file imports what it needs
        return meant
    return f"; the library's names need the line `model {MODEL}` before them{meant}"


def _visible_names(frame: FrameType) -> dict[str, Any]:
    names = {**vars(builtins), **frame.f_globals, **frame.f_locals}
    return {name: value for name, value in names.items() if not name.startswith("_")}


def _of_the_same_use(
    name: str, visible: Mapping[str, Any], frame: FrameType, line: int
) -> Iterable[str]:
    """Keep only Scenic classes behind `new`, every visible name elsewhere."""
    file = Path(frame.f_code.co_filename)
    lines = (
        file.read_text(encoding="utf-8", errors="replace").splitlines() if file.is_file() else []
    )
    text = lines[line - 1] if 0 < line <= len(lines) else ""
    if not re.search(rf"\bnew\s+{re.escape(name)}\b", text):
        return visible
    return [
        other
        for other, value in visible.items()
        if isinstance(value, type) and issubclass(value, Constructible)
    ]


def _attribute_hint(error: AttributeError) -> str:
    thing, name = error.obj, str(error.name or "")
    if not name or thing is None:
        return ""
    own = getattr(thing, "properties", ())
    known = {*dir(thing), *(own if isinstance(own, tuple) else ())}
    return did_you_mean(name, [other for other in known if not other.startswith("_")])


def _keyword_hint(text: str, trace: TracebackType | None, path: Path) -> str:
    """Name the nearest parameter to one that a function of the program does not have."""
    match, found = _WRONG_KEYWORD.search(text), _scenic_frame(trace, path)
    if match is None or found is None:
        return ""
    function = _visible_names(found[0]).get(match[1])
    try:
        return did_you_mean(match[2], inspect.signature(function).parameters)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return ""


def _missing_module(text: str, name: str) -> str:
    if name.partition(".")[0] != "verifai":
        return text
    return (
        f"{text}; `model {MODEL}` at the top makes VerifaiRange, VerifaiDiscreteRange "
        "and VerifaiOptions work without VerifAI"
    )
