"""Finds, explains and reproduces deadlocks in multi-robot task-allocation stacks.

The verbs of the command line, from Python::

    import mrta_falsify as mf

    world = mf.vary_world(mf.load_world("aws_hospital_day"), seed=3)
    outcome = mf.run(world)
    mf.write_run(outcome, world, "out")

Names are resolved on first use (PEP 562), so importing a lower floor never runs an upper one.
"""

from __future__ import annotations

import importlib
import importlib.metadata
from typing import Any

_NAMES_OF = {
    "mrta_falsify.verbs.run": (
        "export_nav2",
        "find_world",
        "plugins",
        "run",
        "summary",
        "write_run",
    ),
    "mrta_falsify.verbs.bench": ("bench",),
    "mrta_falsify.core.config": ("Choice", "StackConfig", "apply_setting", "read_config"),
    "mrta_falsify.core.errors": ("HarnessError", "InputError", "MrtaFalsifyError"),
    "mrta_falsify.core.trace": ("Trace", "read_trace", "write_trace"),
    "mrta_falsify.core.verdict": ("Verdict",),
    "mrta_falsify.core.world": ("World", "read_world", "write_world"),
    "mrta_falsify.verbs.doctor": ("doctor",),
    "mrta_falsify.verbs.check": (
        "check",
        "check_summary",
        "open_scenario",
        "sample",
        "write_check",
    ),
    "mrta_falsify.verbs.travel_times": ("measure_travel_times",),
    "scenic_worlds.layouts": ("layout_names", "load_layout", "load_world", "world_names"),
    "scenic_worlds.variation": ("vary_world",),
    "simulator_interface.simulate": ("Outcome", "frames_of", "simulate"),
}
_HOME = {name: module for module, names in _NAMES_OF.items() for name in names}

__all__ = sorted((*_HOME, "__version__"))  # noqa: PLE0605 - one table says where names live


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return importlib.metadata.version("mrta-falsify")
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return list(__all__)
