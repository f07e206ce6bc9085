"""The project file: which scenarios are searched on which stacks, and which failures are kept."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mrta_falsify.campaigns.settings import DEFAULT_LIMITS, DEFAULTS, MAX_PERTURBED_RUNS
from mrta_falsify.commands.folders import Place
from mrta_falsify.commands.stacks import SHIPPED, is_process, load_stack
from mrta_falsify.core import codec
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.config import StackConfig, decode_config
from mrta_falsify.core.errors import FormatError, UnknownNameError

PROJECT_NAME = "mrta-falsify.yaml"


@dataclass(frozen=True, slots=True, kw_only=True)
class StackEntry:
    """A stack under test, as ``--stack`` and ``--set`` take it."""

    stack: str = SHIPPED
    settings: tuple[str, ...] = ()  #: ``--set`` texts


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioEntry:
    """How a scenario is searched; names and meanings as of ``campaign``."""

    budget: int = quantity(low=1, default=20)
    stacks: tuple[str, ...] = ()  #: names; empty: all
    seed: int = quantity(low=0, default=DEFAULTS.trials.seed)
    sampler: str = DEFAULTS.sampler.name
    specs: tuple[str, ...] = ()
    params: dict[str, Any] = field(default_factory=dict)
    stop_after: int = quantity(low=0, default=DEFAULT_LIMITS.stop_after)
    jittered: int = quantity(low=0, high=MAX_PERTURBED_RUNS, default=2)
    verify: int = quantity(low=0, high=MAX_PERTURBED_RUNS, default=DEFAULTS.trials.verify)


@dataclass(frozen=True, slots=True, kw_only=True)
class ProjectFile:
    """What stands in the file."""

    scenarios: dict[str, ScenarioEntry] = field(default_factory=dict)
    stacks: dict[str, StackEntry] = field(default_factory=lambda: {SHIPPED: StackEntry()})
    corpus: tuple[str, ...] = ()  #: directories of campaigns whose failures are run again
    jittered: int = quantity(
        low=0, high=MAX_PERTURBED_RUNS, default=2
    )  #: copies of each such failure
    keep: str = ".mrta-falsify"  #: directory of what is kept between runs


@dataclass(frozen=True, slots=True)
class Project:
    """A project file, and the folder that its relative paths are relative to."""

    path: Path
    file: ProjectFile

    @property
    def folder(self) -> Path:
        """Of the file."""
        return self.path.parent

    @property
    def kept(self) -> Path:
        """Directory of what is kept between runs."""
        return self.folder / self.file.keep

    def scenario(self, name: str) -> str:
        """Give the file of a scenario if there is one, else its name, which is a shipped one."""
        path = self.folder / name
        return str(path) if path.is_file() else name

    def stack(self, name: str) -> StackConfig:
        """Read a stack by its name in the file.

        Raises:
            InputError: unknown layer, implementation or option, or there is no such file.
        """
        entry = self.file.stacks[name]
        where = f"{self.path}: stacks.{name}"
        if is_process(entry.stack):
            config = decode_config({"stack": entry.stack}, where=where, folder=self.folder)
        elif entry.stack == SHIPPED:
            config = StackConfig()
        elif not (self.folder / entry.stack).is_file():
            raise FormatError(
                f"{where}: there is no file {self.folder / entry.stack}; `mrta-falsify init` "
                "writes one to begin with, and `default` is the shipped stack"
            )
        else:
            config = load_stack(self.folder / entry.stack)
        return load_stack(config, entry.settings)


def read_project(path: Place = PROJECT_NAME) -> Project:
    """Read a project file.

    Raises:
        InputError: it cannot be read, or something in it is unknown or not allowed; the message
            names the field and what is allowed.
    """
    path = Path(path)
    if path.is_dir():
        path = path / PROJECT_NAME
    if not path.is_file():
        raise FormatError(
            f"{path}: there is no such project file; write one with `scenarios:`, "
            "`stacks:` and `corpus:` (docs/every-day.md)"
        )
    data = codec.read_yaml(path)
    file = codec.decode(ProjectFile, _shaped(data), where=str(path))
    if not file.scenarios and not file.corpus:
        raise FormatError(f"{path}: names no scenarios and no corpus, so there is nothing to run")
    for name, entry in file.scenarios.items():
        for stack in entry.stacks:
            if stack not in file.stacks:
                where = f"{path}: scenarios.{name}.stacks"
                raise UnknownNameError("stack", stack, file.stacks, where=where)
    return Project(path, file)


def _shaped(data: Any) -> Any:
    """Write short forms in full: a scenario without fields, a stack that is a text."""
    if not isinstance(data, dict):
        return {} if data is None else data
    shaped = dict(data)
    if isinstance(data.get("scenarios"), dict):
        shaped["scenarios"] = {k: {} if v is None else v for k, v in data["scenarios"].items()}
    if isinstance(data.get("stacks"), dict):
        entries = data["stacks"].items()
        shaped["stacks"] = {k: {"stack": v} if isinstance(v, str) else v for k, v in entries}
    return shaped


def with_portable_paths(config: StackConfig, folder: Path) -> StackConfig:
    """Write the folder of a foreign stack relative to the project, for digests."""
    if config.stack is None or not Path(config.stack.folder).is_relative_to(folder.resolve()):
        return config
    relative = Path(config.stack.folder).relative_to(folder.resolve())
    return dataclasses.replace(
        config, stack=dataclasses.replace(config.stack, folder=str(relative))
    )
