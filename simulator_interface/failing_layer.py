"""Which layer's code failed, from a traceback; and tracebacks without paths of a machine."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

from mrta_falsify.core import registry
from mrta_falsify.core.config import STACK_LAYERS, StackConfig
from mrta_falsify.core.errors import InputError

#: whose code lies where, in this project
SHIPPED = {
    "mrta_falsify/stack/allocation/": "allocator",
    "mrta_falsify/stack/dispatcher.py": "dispatcher",
    "mrta_falsify/stack/resources/": "queue_policy",
    "mrta_falsify/stack/priority.py": "priority_rule",
    "mrta_falsify/stack/waypoints.py": "waypoint_generator",
    "mrta_falsify/stack/itinerary.py": "waypoint_generator",
    "mrta_falsify/stack/planning/": "planner",
    "mrta_falsify/stack/planning_service.py": "planner",
    "mrta_falsify/stack/replanning.py": "planner",
    "mrta_falsify/stack/lookahead.py": "controller",
    "mrta_falsify/stack/control/": "controller",
    "simulator_interface/costmap_layers.py": "costmap",
    "simulator_interface/lethal_cells.py": "costmap",
    "simulator_interface/inflation.py": "costmap",
}
ROOT = Path(__file__).resolve().parents[1]
MAX_FRAMES = 8  # of a traceback that evidence keeps, the innermost ones
#: a line of what faulthandler writes of a thread
DUMPED = re.compile(r'^  File "(?P<file>.*)", line (?P<line>\d+|\?\?\?) in (?P<function>.*)$', re.M)


class Place(NamedTuple):
    """One frame of a traceback."""

    file: str
    line: int  #: 0: not known
    function: str
    owner: type | None = None  #: class of ``self``, if that is known

    def __str__(self) -> str:
        """Write it as ``file:line in function``, the file without where this machine has it."""
        line = f":{self.line}" if self.line else ""
        return f"{portable_path(self.file)}{line} in {self.function}"


def portable_path(file: str) -> str:
    """Write a source file relative to where Python found it, or by its name alone."""
    roots = [str(ROOT), *(entry or os.getcwd() for entry in sys.path)]
    inside = [os.path.relpath(file, root) for root in roots if _lies_in(file, root)]
    return min(inside, key=len, default=os.path.basename(file))


def _lies_in(file: str, root: str) -> bool:
    return os.path.isabs(file) and file.startswith(os.path.join(root, ""))


# --- the frames ----------------------------------------------------------------------------


def places_in(trace: TracebackType | None) -> list[Place]:
    """List the frames of an exception's traceback below its first, outermost first."""
    found = []
    step = trace.tb_next if trace is not None else None
    while step is not None:
        code = step.tb_frame.f_code
        owner = step.tb_frame.f_locals.get("self")
        kind = None if owner is None else type(owner)
        found.append(Place(code.co_filename, step.tb_lineno, code.co_name, kind))
        step = step.tb_next
    return found


def dumped_places(text: str, below: str) -> list[Place]:
    """Read the frames that faulthandler wrote of one thread, outermost first.

    Args:
        text: what it wrote, innermost frame first.
        below: file whose frames, and what called them, are left out.
    """
    found = []
    for match in DUMPED.finditer(text):
        if match["file"] == below:
            break
        line = int(match["line"]) if match["line"].isdigit() else 0
        found.append(Place(match["file"], line, match["function"]))
    return found[::-1]


def texts_of(places: Sequence[Place]) -> tuple[str, ...]:
    """Write the innermost frames, innermost last."""
    return tuple(map(str, places[-MAX_FRAMES:]))


def shared_places(one: Sequence[Place], other: Sequence[Place]) -> list[Place]:
    """Keep the outer frames that two tracebacks share, without lines: where a loop is stuck."""
    found = []
    for a, b in zip(one, other, strict=False):
        if (a.file, a.function) != (b.file, b.function):
            break
        found.append(a._replace(line=0))
    return found


# --- the layer -----------------------------------------------------------------------------


def layer_of_places(places: Sequence[Place], config: StackConfig) -> str:
    """Name the layer whose code failed: of the innermost frame that belongs to one.

    Args:
        places: frames, outermost first.
        config: the stack under test.

    Returns:
        The layer, empty if no frame belongs to one.
    """
    owners, files = _components(config)
    for place in reversed(places):
        layer = owners.get(place.owner) if place.owner is not None else None
        layer = layer or files.get(place.file) or _shipped_layer(place.file)
        if layer:
            return layer
    return ""


def _components(config: StackConfig) -> tuple[dict[type, str], dict[str, str]]:
    """Find the layers of classes, and of the files that hold the class of one layer only."""
    owners: dict[type, str] = {}
    files: dict[str, set[str]] = {}
    for layer in STACK_LAYERS:
        try:
            component = registry.load(layer, getattr(config, layer).name)
        except InputError:
            continue
        owners[component] = layer
        module = sys.modules.get(component.__module__)
        files.setdefault(str(getattr(module, "__file__", "")), set()).add(layer)
    return owners, {file: next(iter(of)) for file, of in files.items() if len(of) == 1}


def _shipped_layer(file: str) -> str:
    path = Path(file)
    if not path.is_relative_to(ROOT):
        return ""
    place = path.relative_to(ROOT).as_posix()
    return next((layer for start, layer in SHIPPED.items() if place.startswith(start)), "")
