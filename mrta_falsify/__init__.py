"""Finds, explains and reproduces deadlocks in multi-robot task-allocation stacks.

Every command of the command line is a function here, with the same name (``-`` becomes ``_``,
``import`` is ``import_``), the same options and the same defaults; it returns a value::

    import mrta_falsify as mf

    found = mf.campaign("hospital_day", "runs/first", budget=20)
    for row in mf.list("runs/first", failed=True):
        print(row.id, row.signature)
    mf.report("runs/first")

Names are resolved on first use (PEP 562), so importing a lower floor never runs an upper one.
"""

from __future__ import annotations

import importlib
import sys
from typing import Any

from mrta_falsify.core.renamed import RenamedModules, renamed_attribute

sys.meta_path.insert(0, RenamedModules())  # before modules are found by where they lie

#: the commands, and the functions that do their work
VERBS = {
    "allocate": "mrta_falsify.commands.allocate:allocate",
    "bench": "mrta_falsify.commands.bench.benchmark:bench",
    "campaign": "mrta_falsify.commands.campaign:campaign",
    "certify": "mrta_falsify.commands.certificates:certify_trials",
    "check": "mrta_falsify.commands.check:check",
    "ci": "mrta_falsify.commands.ci.command:ci",
    "compare": "mrta_falsify.commands.compare:compare",
    "corpus": "mrta_falsify.commands.corpus:recheck_corpus",
    "demo": "mrta_falsify.commands.demo:demo",
    "doctor": "mrta_falsify.commands.doctor:doctor",
    "stack_test": "mrta_falsify.commands.stack_test.testing:stack_test",
    "explain": "mrta_falsify.commands.explain:explain_trial",
    "export": "mrta_falsify.commands.export:export",
    "import_": "mrta_falsify.commands.floor_import:import_floor",
    "init": "mrta_falsify.commands.init:init",
    "issue": "mrta_falsify.commands.issue:issue",
    "list": "mrta_falsify.commands.stored_trials:list_trials",
    "minimize": "mrta_falsify.commands.minimize:minimize_trial",
    "plugins": "mrta_falsify.commands.plugins:plugins",
    "replay": "mrta_falsify.commands.replay:replay",
    "report": "mrta_falsify.commands.report.writing:write_reports",
    "run": "mrta_falsify.commands.run:run",
    "sample": "mrta_falsify.commands.sample:sample",
    "show": "mrta_falsify.commands.stored_trials:show_trial",
    "travel_times": "mrta_falsify.commands.travel_times:write_travel_times",
}

#: names that changed; the old one still works, with a warning
RENAMED = {"door_test": "stack_test"}

#: names that are gone, and what does their work
REMOVED = {"bisect_failures": "`git bisect run` with `corpus --only` (docs/every-day.md)"}

_NAMES_OF = {
    "mrta_falsify.commands.campaign": ("CampaignResult", "resume_campaign"),
    "mrta_falsify.commands.campaign_settings": ("new_settings",),
    "mrta_falsify.commands.campaign_summary": ("summarise_campaign",),
    "mrta_falsify.commands.check": ("summarise_check", "write_check"),
    "mrta_falsify.commands.estimate": ("estimate_cost",),
    "mrta_falsify.commands.export": ("export_nav2",),
    "mrta_falsify.commands.incident.importing": ("import_log",),
    "mrta_falsify.commands.programs": ("open_scenario",),
    "mrta_falsify.commands.run": ("summarise_run", "write_run"),
    "mrta_falsify.commands.stacks": ("load_stack",),
    "mrta_falsify.commands.stored_trials": ("open_campaign",),
    "mrta_falsify.commands.travel_times": ("measure_travel_times",),
    "mrta_falsify.commands.worlds": ("find_world",),
    "mrta_falsify.commands.zoo": ("run_zoo",),
    "mrta_falsify.core.config": ("Choice", "StackConfig", "apply_setting", "read_config"),
    "mrta_falsify.core.errors": ("HarnessError", "InputError", "MrtaFalsifyError", "PlaceError"),
    "mrta_falsify.core.trace": ("Trace", "read_trace", "write_trace"),
    "mrta_falsify.core.verdict": ("Verdict",),
    "mrta_falsify.core.world": ("World", "read_world", "write_world"),
    "scenic_worlds.layouts": ("layout_names", "load_layout", "load_world", "world_names"),
    "scenic_worlds.variation": ("vary_world",),
    "simulator_interface.simulate": ("Outcome", "frames_of", "simulate"),
}
#: every public name but these two, and where it lives, ``module:name``
HOMES = VERBS | {name: f"{module}:{name}" for module, names in _NAMES_OF.items() for name in names}

__all__ = sorted((*HOMES, "VERBS", "__version__"))  # noqa: PLE0605 - one table says where names live


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib import metadata  # noqa: PLC0415 - 30 ms that few imports need

        return metadata.version("mrta-falsify")
    if name in RENAMED:
        return renamed_attribute(sys.modules[__name__], name, RENAMED)
    if name in REMOVED:
        raise AttributeError(f"{__name__}.{name} is gone: {REMOVED[name]}")
    if name not in HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, _, attribute = HOMES[name].partition(":")
    value = getattr(importlib.import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__]  # `list` is a verb here
