"""JSON Schemas of the files that users write, for their editors."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from mrta_falsify.commands.ci.project import ProjectFile, ScenarioEntry, StackEntry
from mrta_falsify.commands.folders import Place
from mrta_falsify.core import registry
from mrta_falsify.core.config import LAYERS, StackConfig
from mrta_falsify.core.defects import defect_names
from mrta_falsify.core.durable import make_folder, write_atomically
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.external import ADAPTER, CONNECT, EXEC, ExternalStack
from mrta_falsify.core.json_schema import Definitions, Schema
from mrta_falsify.core.world import World
from simulator_interface.formats.floor_fields import FloorFile
from simulator_interface.formats.mrta_sim import TaskFile

#: texts beside registered names: a class of one's own, or a layer in a process of its own
OWN_NAMES = f"^({EXEC}|[^:]+:[^:]+$)"


def write_schemas(directory: Place) -> tuple[Path, ...]:
    """Write the JSON Schema of each kind of file, as ``stack.schema.json``.

    Args:
        directory: made where it is missing; schemas of before are replaced.

    Returns:
        The files, sorted.

    Raises:
        PlaceError: one cannot be written.
    """
    folder = make_folder(Path(directory))
    paths = []
    for name, schema in sorted(file_schemas().items()):
        paths.append(folder / f"{name}.schema.json")
        write_atomically(paths[-1], (json.dumps(schema, indent=2) + "\n").encode())
    return tuple(paths)


def file_schemas() -> dict[str, Schema]:
    """Describe stack, project, floor, tasks and world files, by these names."""
    made: dict[str, Callable[[Definitions], Schema]] = {
        "floor": lambda known: known.object_of(FloorFile),
        "project": _project,
        "stack": _stack,
        "tasks": lambda known: known.object_of(TaskFile),
        "world": lambda known: known.object_of(World),
    }
    schemas = {}
    for name, make in made.items():
        known = Definitions()
        schemas[name] = known.document(make(known), title=f"mrta-falsify: {name} file")
    return schemas


# --- files with short forms -----------------------------------------------------------------


def _project(known: Definitions) -> Schema:
    schema = known.object_of(ProjectFile)
    own = schema["properties"]
    scenario, stack = known.schema_of(ScenarioEntry), known.schema_of(StackEntry)
    own["scenarios"]["additionalProperties"] = {"anyOf": [scenario, {"type": "null"}]}
    own["stacks"]["additionalProperties"] = {"anyOf": [stack, {"type": "string"}]}
    return schema


def _stack(known: Definitions) -> Schema:
    schema = known.object_of(StackConfig)
    own = schema["properties"]
    for layer in LAYERS:
        own[layer] = {"anyOf": [*_names(layer), *_with_options(layer, known)]}
    own["defects"]["items"] = {"type": "string", "examples": list(defect_names())}
    outside = known.schema_of(ExternalStack)
    adapters = "".join(f"|{name}:" for name in registry.names(ADAPTER))
    text = {"type": "string", "pattern": f"^({EXEC}|{CONNECT}{adapters})"}
    own["stack"] = {"anyOf": [text, outside, {"type": "null"}]}
    return {**schema, "type": ["object", "null"]}


def _names(layer: str) -> list[Schema]:
    known = (*registry.names(layer), *registry.RENAMED.get(layer, {}))
    return [{"enum": list(known)}, {"type": "string", "pattern": OWN_NAMES}]


def _with_options(layer: str, known: Definitions) -> list[Schema]:
    """Describe a layer with options: ``{name: astar, resolution: 0.1}``.

    Without a name the options are those of the default. A component of one's own, and one that is
    not installed whole, has options that no schema knows.
    """
    default = getattr(StackConfig(), layer)
    forms: list[Schema] = [
        {
            "type": "object",
            "properties": {"name": {"type": "string", "pattern": OWN_NAMES}},
            "required": ["name"],
        }
    ]
    for name in registry.names(layer):
        named: Schema = {"name": {"const": name}}
        try:
            options = known.object_of(registry.load(layer, name).Options)
        except ConfigError:  # a package that it needs is missing
            forms.append({"type": "object", "properties": named, "required": ["name"]})
            continue
        forms += [
            {
                "type": "object",
                "properties": {**named, **options["properties"]},
                "required": ["name", *options.get("required", ())],
                "additionalProperties": False,
            },
            {
                "type": "object",
                "properties": {**named, "options": options},
                "required": ["name", "options"],
                "additionalProperties": False,
            },
        ]
        if name == default.name:
            forms.append(options)
    return forms
