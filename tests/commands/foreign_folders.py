"""Campaign folders as somebody else could send them: each names something that leaves a mark."""

from __future__ import annotations

import dataclasses
import itertools
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.campaigns.rules import RULES
from mrta_falsify.campaigns.settings import CampaignSettings, TrialSettings
from mrta_falsify.campaigns.store import Store, trial_folder
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.feedback import Cube
from mrta_falsify.core.record import versions
from mrta_falsify.core.trace import Trace, write_trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World, write_world
from mrta_falsify.testing.records import trial_record
from mrta_falsify.trial import on_kinematic_engine

PROGRAM = """
model scenic_worlds.model
{payload}
new Robot with name "robot1", with start_room 0
param tasks = [(0, 0, 2, 100)]
param horizon = 40
"""
POLICY = "mrta_falsify.stack.policy.policy_controller:PolicyController"
SHIPPED = "bed_in_the_doorway"
_numbers = itertools.count()


@dataclass(frozen=True)
class Folder:
    """A foreign campaign, beside what it names."""

    directory: Path
    beside: Path  #: the folder it was unpacked into, in which commands are run
    mark: Path  #: there once something of it has run
    module: str  #: name of a Python module that leaves the mark, in ``beside``

    @property
    def payload(self) -> str:
        """Python code that leaves the mark."""
        return f"import pathlib; pathlib.Path({str(self.mark)!r}).write_text('ran')"

    def change(self, edit: Callable[[dict[str, Any]], None]) -> None:
        """Change what ``campaign.json`` says."""
        path = self.directory / "campaign.json"
        data = json.loads(path.read_text())
        edit(data)
        path.write_text(json.dumps(data))

    def set(self, *keys: str, value: Any) -> None:
        """Set one value in ``campaign.json``."""

        def edit(data: dict[str, Any]) -> None:
            for key in keys[:-1]:
                data = data[key]
            data[keys[-1]] = codec.encode(value)

        self.change(edit)

    def write_module(self) -> str:
        """Write the Python module, and return ``module:Class`` in it."""
        (self.beside / f"{self.module}.py").write_text(self.payload)
        return f"{self.module}:Evil"

    def write_program(self, path: Path | None = None) -> Path:
        """Write the Scenic program, by default into the folder."""
        path = path or self.directory / "day.scenic"
        path.write_text(PROGRAM.format(payload=self.payload))
        return path

    def lose(self, *names: str) -> None:
        """Leave out files of the trial."""
        for name in names:
            (self.directory / "trials" / "0000" / name).unlink()

    def lead_out(self, name: str) -> None:
        """Put a file or folder elsewhere, with a link in its place."""
        path, elsewhere = self.directory / name, self.beside / "elsewhere"
        elsewhere.mkdir(exist_ok=True)
        if path.exists():
            shutil.move(path, elsewhere / path.name)
        else:
            (elsewhere / path.name).write_text("")
        path.symlink_to(elsewhere / path.name)


def make_folder(tmp_path: Path, world: World, trace: Trace) -> Folder:
    """Write a campaign of one failure on shipped parts, without a seal."""
    beside = tmp_path / "unpacked"
    directory = beside / "downloaded"
    settings = CampaignSettings(
        trials=TrialSettings(
            scenario=SHIPPED,
            stack=on_kinematic_engine(StackConfig()),
            specifications=("no_robot_static_contact",),
            sources_digest="0" * 64,
            directory=str(directory),
        ),
        sampler=Choice("random"),
        cube=Cube(dimensions=1),
        rules=RULES,
        budget=1,
    )
    verdict = Verdict(
        spec="no_robot_static_contact",
        robustness=-0.1,
        violated=True,
        violated_at=3.0,
        who=("robot1",),
    )
    record = trial_record(
        0,
        np.zeros(1),
        world=world.digest(),
        verdicts=(verdict,),
        signature="no_robot_static_contact/robot-wall",
        trace_file="trials/0000/trace.zip",
        trace=trace.digest,
        versions=versions(),
    )
    with Store.create(directory, settings) as store:
        folder = trial_folder(directory, 0)
        folder.mkdir(parents=True)
        write_world(world, folder / "world.json")
        write_trace(trace, folder / "trace.zip")
        store.add(record)
    (directory / "seal.json").unlink(missing_ok=True)
    return Folder(directory, beside, tmp_path / "RAN", f"evil_module_{next(_numbers)}")


# --- payloads --------------------------------------------------------------------------------


def program_in_the_folder(folder: Folder) -> None:
    folder.lose("world.json")
    folder.set("trials", "scenario", value=str(folder.write_program()))


def program_relative_to_here(folder: Folder) -> None:
    folder.lose("world.json")
    folder.write_program()
    folder.set("trials", "scenario", value="downloaded/day.scenic")


def program_by_dots(folder: Folder) -> None:
    folder.lose("world.json", "trace.zip")
    folder.write_program(folder.beside / "day.scenic")
    folder.set("trials", "scenario", value="downloaded/../day.scenic")


def program_by_a_link(folder: Folder) -> None:
    folder.lose("world.json")
    folder.write_program(folder.beside / "outside.scenic")
    (folder.directory / "day.scenic").symlink_to(folder.beside / "outside.scenic")
    folder.set("trials", "scenario", value=str(folder.directory / "day.scenic"))


def program_without_digest(folder: Folder) -> None:
    folder.lose("world.json")
    folder.set("trials", "scenario", value=str(folder.write_program()))
    folder.set("trials", "sources_digest", value="")


def program_imports_a_module(folder: Folder) -> None:
    folder.lose("world.json")
    folder.write_module()
    (folder.beside / "day.scenic").write_text(PROGRAM.format(payload=f"import {folder.module}"))
    folder.set("trials", "scenario", value=str(folder.beside / "day.scenic"))


def program_of_a_scripted_world(folder: Folder) -> None:
    path = folder.directory / "trials" / "0000" / "world.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"scripted": "a behaviour"}))
    folder.set("trials", "scenario", value=str(folder.write_program()))


def command_of_a_stack(folder: Folder) -> None:
    stack = ExternalStack(
        command=("sh", "-c", f"echo ran > {folder.mark}"), folder=str(folder.beside)
    )
    folder.set("trials", "stack", "stack", value=stack)


def command_by_its_environment(folder: Folder) -> None:
    (folder.beside / "sitecustomize.py").write_text(folder.payload)
    stack = ExternalStack(
        command=("python3", "-c", "pass"),
        folder=str(folder.beside),
        env={"PYTHONPATH": str(folder.beside)},
    )
    folder.set("trials", "stack", "stack", value=stack)


def address_of_a_stack(folder: Folder) -> None:
    stack = ExternalStack(connect="127.0.0.1:9", folder=str(folder.beside))
    folder.set("trials", "stack", "stack", value=stack)


def layer_by_a_command(folder: Folder) -> None:
    name = f"exec:sh -c 'echo ran > {folder.mark}'"
    folder.set("trials", "stack", "allocator", value=Choice(name))


def _component(*keys: str) -> Callable[[Folder], None]:
    def payload(folder: Folder) -> None:
        folder.set(*keys, value=Choice(folder.write_module()))

    return payload


def component_in_options(folder: Folder) -> None:
    options = {"dynamics": folder.write_module()}
    folder.set("trials", "stack", "controller", value=Choice("cluster_cbf", options))


def policy_file(folder: Folder) -> None:
    (folder.directory / "policy.py").write_text(folder.payload)
    options = {"file": str(folder.directory / "policy.py")}
    folder.set("trials", "stack", "controller", value=Choice(POLICY, options))


def component_in_a_package(folder: Folder) -> None:
    package = folder.beside / folder.module
    package.mkdir()
    (package / "__init__.py").write_text(folder.payload)
    (package / "inner.py").write_text("")
    name = f"{folder.module}.inner:Evil"
    folder.set("trials", "stack", "planner", value=Choice(name))


def specification(folder: Folder) -> None:
    folder.set("trials", "specifications", value=[folder.write_module()])


def specification_with_options(folder: Folder) -> None:
    name = folder.write_module() + "{factor: 2}"
    folder.set("trials", "specifications", value=["no_deadlock", name])


def specification_looked_for_last(folder: Folder) -> None:
    folder.set("trials", "then", value=[folder.write_module()])


def link_to_a_world(folder: Folder) -> None:
    folder.lead_out("trials/0000/world.json")


def link_to_a_trial(folder: Folder) -> None:
    folder.lead_out("trials/0000")


def link_to_all_trials(folder: Folder) -> None:
    folder.lead_out("trials")


def link_to_the_log(folder: Folder) -> None:
    folder.lead_out("records.jsonl")


def link_to_what_is_written(folder: Folder) -> None:
    folder.lead_out("corpus.journal.jsonl")


def engine_that_confirms(folder: Folder) -> None:
    folder.set("trials", "confirm", value=[folder.write_module()])


def other_stack(folder: Folder) -> None:
    config = on_kinematic_engine(StackConfig(allocator=Choice(folder.write_module())))
    folder.set("trials", "against", value=config)


def parameter_of_a_shipped_program(folder: Folder) -> None:
    folder.lose("world.json")
    folder.set("trials", "params", value={"engine": folder.write_module()})


def settings_in_a_parameter(folder: Folder) -> None:
    folder.lose("world.json")
    folder.set("trials", "params", value={"settings": f"planner={folder.write_module()}"})


#: what would run where a stored failure is run again
OF_RUNS: dict[str, Callable[[Folder], None]] = {
    function.__name__: function
    for function in (
        program_in_the_folder,
        program_relative_to_here,
        program_by_dots,
        program_by_a_link,
        program_without_digest,
        program_imports_a_module,
        program_of_a_scripted_world,
        command_of_a_stack,
        command_by_its_environment,
        address_of_a_stack,
        layer_by_a_command,
        component_in_options,
        component_in_a_package,
        policy_file,
        specification,
        specification_with_options,
        specification_looked_for_last,
        link_to_a_world,
        link_to_a_trial,
        link_to_all_trials,
        link_to_the_log,
        link_to_what_is_written,
        parameter_of_a_shipped_program,
        settings_in_a_parameter,
    )
} | {
    f"component_{layer}": _component("trials", "stack", layer)
    for layer in ("allocator", "planner", "costmap", "human_model", "engine")
}
#: what would run only where the campaign goes on
OF_RESUMING: dict[str, Callable[[Folder], None]] = {
    "sampler": _component("sampler"),
    "engine_that_confirms": engine_that_confirms,
    "other_stack": other_stack,
}


def foreign_copy(folder: Folder, to: Path) -> Folder:
    """Copy a folder as another one of the same content."""
    shutil.copytree(folder.directory, to, symlinks=True)
    return dataclasses.replace(folder, directory=to)
