"""Components by name: entry points for what is installed, ``module:Class`` for one's own.

A component registers with one line of ``pyproject.toml``::

    [project.entry-points."mrta_falsify.planner"]
    my_planner = "my_package.my_module:MyPlanner"
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
import importlib.metadata
import os
import warnings
from dataclasses import dataclass
from typing import Any

from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice
from mrta_falsify.core.defects import with_defects
from mrta_falsify.core.errors import ConfigError, InputNote, UnknownNameError
from mrta_falsify.core.external import EXEC
from mrta_falsify.core.modules import look_here_for

#: extension points; each is an entry-point group ``mrta_falsify.<name>``
EXTENSION_POINTS = (
    "allocator",
    "queue_policy",
    "priority_rule",
    "waypoint_generator",
    "planner",
    "costmap",
    "controller",
    "dynamics",
    "human_model",
    "engine",
    "sampler",
    "specification",
    "executor",
    "importer",
    "exporter",
    "stack_adapter",
)

#: components that are gone, by extension point, and what does their work now
REMOVED = {
    "sampler": {
        **dict.fromkeys(("annealing", "local_search", "nsga2"), "evolution"),
        **dict.fromkeys(("surrogate", "demanding", "situations"), "auto"),
        **dict.fromkeys(("cross_entropy", "verifai_mab", "verifai_halton"), "verifai_ce or halton"),
    }
}
#: components that another one answers for, by extension point
RENAMED = {"allocator": {"smt": "exact"}}
LAST_WITH_THEM = "45907df"  #: the last commit that has them

OUTSIDE = "simulator_interface.external.layers"  #: module of layers that run by ``exec:``


class WithoutOptions:
    """A component with nothing to choose."""

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Nothing to choose."""

    def __init__(self, options: Options) -> None:
        self._options = options


@functools.cache
def _entry_points(point: str) -> dict[str, str]:
    if point not in EXTENSION_POINTS:
        raise UnknownNameError("extension point", point, EXTENSION_POINTS)
    found = importlib.metadata.entry_points(group=f"mrta_falsify.{point}")
    if not found:
        raise ConfigError(
            f"no {point} is registered: what is installed is older than the code; install the "
            "package again"
        )
    return {entry.name: entry.value for entry in sorted(found, key=lambda entry: entry.name)}


def names(point: str) -> tuple[str, ...]:
    """List the registered names of an extension point, sorted."""
    return tuple(_entry_points(point))


def target_of(point: str, name: str) -> str:
    """Give ``module:Class`` of a component; empty for a name that is not registered."""
    return _entry_points(point).get(name, name if ":" in name else "")


def load(point: str, name: str, *, where: str = "") -> Any:
    """Load the class (or function) registered as ``name``, or named as ``module:Class``.

    ``exec:CMD`` is a layer that runs in a process of its own. A module that is named is looked for
    on Python's path, then in the current directory (see :mod:`mrta_falsify.core.modules`).

    Raises:
        UnknownNameError: the name is not registered.
        ConfigError: ``module:Class`` cannot be imported, or is not a component.
    """
    known = _entry_points(point)
    if name not in known and name in RENAMED.get(point, {}):
        now = RENAMED[point][name]
        warnings.warn(InputNote(f"the {point} {name!r} is gone, {now!r} answers"), stacklevel=2)
        name = now
    if name.startswith(EXEC):
        return importlib.import_module(OUTSIDE).external_layer(point, name)
    if name not in known and name in REMOVED.get(point, {}):
        raise ConfigError(
            f"{f'{where}: ' if where else ''}the {point} {name!r} has been removed; use "
            f"{REMOVED[point][name]}, or commit {LAST_WITH_THEM}, which resumes campaigns of it"
        )
    if name not in known and ":" not in name:
        raise UnknownNameError(point, name, known, where=where)
    target = known.get(name, name)
    module_name, _, attribute = target.partition(":")
    prefix = f"{where}: " if where else ""
    if name not in known:
        look_here_for(module_name)
    try:
        component = getattr(importlib.import_module(module_name), attribute)
    except ModuleNotFoundError as error:
        places = "" if name in known else f"; looked on Python's path and in {os.getcwd()}"
        raise ConfigError(f"{prefix}{point} {name!r} cannot be loaded: {error}{places}") from error
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        # the last two are of a name that no module can have
        raise ConfigError(f"{prefix}{point} {name!r:.80} cannot be loaded: {error}") from error
    if not hasattr(component, "Options"):
        raise ConfigError(f"{prefix}{name!r} cannot be used as {point}: it has no `Options`")
    return component


def build(
    point: str, choice: Choice, *, where: str = "stack", defects: tuple[str, ...] = ()
) -> Any:
    """Build the component of ``choice``, its options checked against ``Component.Options``.

    Args:
        point: extension point.
        choice: registered name and options.
        where: what error messages begin with.
        defects: planted defects switched on; a component whose options have a field ``defects``
            is told them, too.

    Raises:
        UnknownNameError: unknown name.
        InputError: unknown or ill-typed option.
    """
    # An option names the component by itself; elsewhere the layer says which one is meant.
    place = where if where.startswith("--") else f"{where}.{point}"
    component = with_defects(load(point, choice.name, where=place), defects)
    options = codec.decode(component.Options, choice.options, where=f"{where}.{point}")
    if defects and any(f.name == "defects" for f in dataclasses.fields(component.Options)):
        options = dataclasses.replace(options, defects=defects)
    return component(options)
