"""What the documentation's site has beside the pages of docs/: a hook of MkDocs.

- Files of the repository that pages link to become pages below ``sources/``, and links lead there.
- ``options.md``, ``api/``, ``components.md``, ``fields.md``, ``files.md`` and ``json.md`` are made
  from the parser, the public names, the registry, and the comments beside fields.
- ``<!-- made: NAME -->`` in a page stands for a table of ``TABLES``.
"""

from __future__ import annotations

import ast
import dataclasses
import functools
import importlib
import inspect
import os
import re
import sys
import textwrap
import types
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import click
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import mrta_falsify as mf
from mrta_falsify.campaigns.trial_index import TrialRow
from mrta_falsify.cli import main
from mrta_falsify.cli.exits import MEANINGS
from mrta_falsify.cli.group import COMMANDS
from mrta_falsify.commands.allocate import PlanSummary
from mrta_falsify.commands.bench.timing_values import Speeds
from mrta_falsify.commands.campaign_summary import CampaignSummary
from mrta_falsify.commands.certificates import CertifiedTrial
from mrta_falsify.commands.check import CheckSummary
from mrta_falsify.commands.ci.project import ProjectFile, ScenarioEntry, StackEntry
from mrta_falsify.commands.ci.running import CiResult
from mrta_falsify.commands.compare import Comparison
from mrta_falsify.commands.doctor import HealthCheck
from mrta_falsify.commands.estimate import CostEstimate
from mrta_falsify.commands.floor_import import ImportedFloor
from mrta_falsify.commands.incident.importing import ImportedLog
from mrta_falsify.commands.issue import IssueFiles
from mrta_falsify.commands.replay import ReplaySummary
from mrta_falsify.commands.run import RunSummary
from mrta_falsify.commands.sample import SampleIndex
from mrta_falsify.commands.stack_test.testing import DoorReport
from mrta_falsify.commands.zoo import SceneCheck
from mrta_falsify.core import defects, findings, fleet, protocols, registry, world
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.observed import observed_in
from mrta_falsify.core.trace import COLUMNS
from mrta_falsify.testing.planted import PLANTS
from scenic_worlds.layouts.hospital import hospital
from scenic_worlds.layouts.warehouse import warehouse
from scenic_worlds.shipped import scenario_names, scenario_path
from scenic_worlds.zoo import load_scene, scene_names

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
SOURCES = "sources"  # folder of the site for what lies outside docs/
LINK = re.compile(r"(\]\()([^)#\s]+)(#[^)\s]*)?(\))")
PICTURES = (".png", ".gif", ".svg", ".jpg")
LANGUAGES = {".py": "python", ".json": "json", ".yaml": "yaml", ".cpp": "cpp", ".scenic": "python"}
LONGEST = 60_000  # characters of a source that a page shows
ROLE = re.compile(r":(?:func|class|meth|mod|data|attr|exc):(?=<code)")  # of reStructuredText


JSON_WORDS = {"None": "null", "False": "false", "True": "true"}
JSON_TYPES = {
    str: "text",
    int: "whole number",
    float: "number",
    bool: "true or false",
    type(None): "null",
    Path: "path",
    Any: "value",
}


class Printed(typing.NamedTuple):
    """A JSON object that a command prints or writes."""

    kind: type  #: whose fields it has
    begin: str = ""  #: sentence before its table
    more: Mapping[str, str] = MappingProxyType({})  #: fields that the command adds


PRINTED: dict[str, tuple[Printed, ...]] = {
    "run": (Printed(RunSummary),),
    "import": (Printed(ImportedFloor, "Of a floor:"), Printed(ImportedLog, "Of a log:")),
    "check": (
        Printed(
            CheckSummary,
            "Of several programs: `programs`, a list of these objects, or of `{scenario, error}`.",
        ),
    ),
    "sample": (Printed(SampleIndex, "`samples.json`:"),),
    "campaign": (Printed(CampaignSummary), Printed(CostEstimate, "With `--dry-run`:")),
    "list": (Printed(TrialRow, "A list of objects, one a trial:"),),
    "replay": (Printed(ReplaySummary),),
    "explain": (Printed(findings.Explanation, "Also `explain.json` beside the trial:"),),
    "certify": (
        Printed(
            CertifiedTrial,
            "`deadlocks`, the number of trials that violate `no_deadlock`; `certified`, the number "
            "of those with a certificate; and `trials`, a list of objects:",
        ),
    ),
    "minimize": (
        Printed(
            findings.Minimisation, "Also `minimize.json` beside the trial:", {"id": "text | trial"}
        ),
    ),
    "corpus": (
        Printed(
            findings.Recheck,
            "A number by each fate, and `failures`, a list of objects:",
        ),
        Printed(
            SceneCheck,
            "Of the zoo: a number by each fate, and `scenes`, a list of objects:",
            {"is_as_known": "true or false | the stack does at least as well as the known answer"},
        ),
    ),
    "ci": (
        Printed(
            CiResult,
            "",
            {
                "new`, `ongoing`, `flaky`, `resolved": "whole number | changes of each kind",
                "page": "path | page of the run",
            },
        ),
    ),
    "issue": (Printed(IssueFiles),),
    "compare": (Printed(Comparison),),
    "allocate": (Printed(PlanSummary, "Batch and task are positions in the file, from 0."),),
    "bench": (Printed(Speeds),),
    "doctor": (
        Printed(
            HealthCheck, "`ok`, whether nothing needed is broken, and `checks`, a list of objects:"
        ),
    ),
    "stack-test": (Printed(DoorReport, "", {"passed": "true or false | no check failed"}),),
}


# --- files outside docs/ ------------------------------------------------------------------------


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are made, and what pages link to outside docs/."""
    for source in sorted(_linked_outside()):
        name = _place(source)
        if source.suffix in PICTURES:
            files.append(File.generated(config, name, abs_src_path=str(source)))
        else:
            files.append(File.generated(config, name, content=_text(source)))
    for name, text in _made_pages().items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: Any, files: Files) -> str:
    """Put in the tables that are made, and let links to files outside docs/ lead to their pages."""
    for name, made in TABLES.items():
        mark = f"<!-- made: {name} -->"
        markdown = markdown.replace(mark, made()) if mark in markdown else markdown
    source = _source(page.file.src_uri)
    if source is None or (source.suffix != ".md" and source.is_file()):
        return markdown
    here = Path(page.file.src_uri).parent

    def mapped(found: re.Match[str]) -> str:
        target = _target(source, found[2])
        if target is None:
            return found[0]
        return f"{found[1]}{os.path.relpath(_place(target), here)}{found[3] or ''}{found[4]}"

    return LINK.sub(mapped, markdown)


def on_page_content(html: str, page: Page, config: Any, files: Files) -> str:
    """Show docstrings without the marks of reStructuredText."""
    if not page.file.src_uri.startswith("api/"):
        return html
    return ROLE.sub("", html).replace("::</p>", ":</p>")


@functools.cache
def _linked_outside() -> frozenset[Path]:
    """Find the files outside docs/ that its pages, and pages among these files, link to."""
    found = set[Path]()
    waiting = list(DOCS.rglob("*.md"))
    while waiting:
        page = waiting.pop()
        for _, name, _, _ in LINK.findall(page.read_text(encoding="utf-8")):
            target = _target(page, name)
            if target is None or target.is_relative_to(DOCS) or target in found:
                continue
            found.add(target)
            waiting += [target] if target.suffix == ".md" else []
    return frozenset(found)


def _target(page: Path, link: str) -> Path | None:
    """Find the file or folder that a link of a page leads to; None if there is none."""
    path = Path(os.path.normpath((page if page.is_dir() else page.parent) / link))
    return path if path.exists() and path.is_relative_to(ROOT) else None


def _place(path: Path) -> str:
    """Say where a file or folder of the repository is in the site."""
    if path.is_relative_to(DOCS):
        return path.relative_to(DOCS).as_posix()
    name = f"{SOURCES}/{path.relative_to(ROOT).as_posix()}"
    if path.is_dir():
        return f"{name}/index.md"
    return name if path.suffix in (".md", *PICTURES) else f"{name}.md"


def _source(uri: str) -> Path | None:
    """Find the file that a page of the site was made from; None if it was made from values."""
    if not uri.startswith(f"{SOURCES}/"):
        path = DOCS / uri
        return path if path.is_file() else None
    path = ROOT / uri.removeprefix(f"{SOURCES}/")
    if path.is_file():
        return path
    return path.parent if path.name == "index.md" else path.with_suffix("")


def _text(source: Path) -> str:
    if source.is_dir():
        return "\n".join([f"# {source.name}", *map(_shown, sorted(_children(source)))])
    text = source.read_text(encoding="utf-8")
    if source.suffix == ".md":
        return text
    return f"# {source.name}\n\n`{source.relative_to(ROOT).as_posix()}`\n\n{_fenced(source)}"


def _children(folder: Path) -> Iterator[Path]:
    return (path for path in folder.iterdir() if path.suffix in (*LANGUAGES, ".md"))


def _shown(path: Path) -> str:
    return f"\n## {path.name}\n\n{_fenced(path)}"


def _fenced(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    if len(text) > LONGEST:
        text = f"{text[:LONGEST]}\n... {len(text) - LONGEST} more characters"
    return f"````{LANGUAGES.get(path.suffix, 'text')}\n{text}\n````\n"


# --- pages that are made ------------------------------------------------------------------------


def _made_pages() -> dict[str, str]:
    homes = {name: home.replace(":", ".") for name, home in mf.HOMES.items()}
    verbs = {name: homes.pop(name) for name in mf.VERBS}
    return {
        "options.md": options_page(),
        "components.md": components_page(),
        "fields.md": fields_page(),
        "json.md": json_page(),
        "files.md": files_page(),
        "api/commands.md": _api("Python: commands", "Functions named as the commands.", verbs),
        "api/values.md": _api("Python: values and files", "The other names of `mf`.", homes),
        "api/protocols.md": "# Python: protocols\n\nWhat a layer, an engine, a sampler, a "
        "specification or an executor has to do.\n\n::: mrta_falsify.core.protocols\n"
        "    options:\n      show_root_heading: false\n      show_root_toc_entry: false\n"
        "      filters: ['!^_']\n",
    }


def _api(title: str, text: str, homes: dict[str, str]) -> str:
    blocks = (
        f"::: {home}\n    options:\n      heading: mf.{name}\n      toc_label: mf.{name}\n"
        for name, home in sorted(homes.items())
    )
    begin = f"# {title}\n\n```python\nimport mrta_falsify as mf\n```\n\n{text}\n"
    return "\n".join([begin, *blocks])


def options_page() -> str:
    """Write the page of all options, from the parser."""
    context = click.Context(main, info_name=main.name)
    codes = "\n".join(f"| {code} | {text} |" for code, text in MEANINGS.items())
    begin = (
        "# Options of all commands\n\nMade from the parser, as `mrta-falsify --help-json` is. What "
        "commands are for, and the fields of their JSON: [commands](commands.md).\n\n"
        f"| Exit code | Means |\n|---|---|\n{codes}\n"
    )
    return "\n".join([begin, *(_section(name, context) for name in main.list_commands(context))])


def _section(name: str, parent: click.Context) -> str:
    command = main.get_command(parent, name)
    assert command is not None
    context = click.Context(command, info_name=name, parent=parent)
    usage = " ".join([context.command_path, *command.collect_usage_pieces(context)])
    texts = [inspect.cleandoc(text) for text in (command.help, command.epilog) if text]
    lines = [f"## {name}", "", f"```\n{usage}\n```", "", "\n\n".join(texts), ""]
    options = [param for param in command.params if isinstance(param, click.Option)]
    if options:
        rows = (_row(option, context) for option in options)
        lines += ["| Option | | Default |", "|---|---|---|", *rows, ""]
    listed = COMMANDS[name]
    own = {1: listed.violated, 3: listed.failed}
    lines += [f"Exit code {code}: {text}.\n" for code, text in own.items() if text]
    return "\n".join(lines)


def _row(option: click.Option, context: click.Context) -> str:
    told = option.to_info_dict()
    value = "" if option.is_flag else f" {option.make_metavar(context)}".replace("|", "\\|")
    flags = ", ".join(f"`{flag}`" for flag in option.opts)
    notes = [option.help or "", _range(told["type"]), "Required." if option.required else ""]
    has_default = not option.is_flag and told["default"] not in (None, (), [])
    default = f"`{told['default']}`" if has_default else ""
    text = " ".join(note for note in notes if note).replace("|", "\\|")
    return f"| {flags}{value} | {text} | {default} |"


def _range(kind: dict[str, Any]) -> str:
    low, high = kind.get("min"), kind.get("max")
    begin = "" if low is None else f"{'above' if kind.get('min_open') else 'from'} {low:g}"
    end = "" if high is None else f"to {high:g}"
    return f"{begin} {end}".strip().capitalize() + ("." if begin or end else "")


# --- fields with the comments beside them -------------------------------------------------------


def fields_page() -> str:
    """Write the page of what a tick consists of, from the comments in its source."""
    begin = (
        "# Fields of a tick\n\nWhat specifications, controllers and traces see of one control "
        "tick. N robots, H people, A obstacle points for each robot; map frame unless it says "
        "body frame. Made from the source.\n"
    )
    seen = (
        fleet.Frame,
        fleet.Sensed,
        fleet.FleetState,
        fleet.Command,
        fleet.Intent,
        fleet.StackEvent,
        fleet.BlockedBy,
        protocols.ControlView,
        protocols.ControlResult,
    )
    return "\n".join([begin, *(f"## {kind.__name__}\n\n{_fields_of(kind)}" for kind in seen)])


def files_page() -> str:
    """Write the page of what files of users hold, from the comments in its source."""
    parts = {
        "World": (
            world.World,
            world.Wall,
            world.Furniture,
            world.Room,
            world.Lane,
            world.Resource,
            world.RobotSpec,
            world.HumanSpec,
            world.Task,
            world.Blockage,
            world.CommsOutage,
        ),
        "Project file of `ci`": (ProjectFile, ScenarioEntry, StackEntry),
        "Foreign stack": (ExternalStack,),
    }
    lines = [
        "# Fields of files\n\nA field with a default may be left out. Lengths in metres, angles in "
        "radians, times in seconds, map frame. Made from the source.\n"
    ]
    for title, kinds in parts.items():
        lines += [f"## {title}\n"]
        for kind in kinds:
            lines += [f"### {kind.__name__}\n", f"{_summary(kind)}\n", _fields_of(kind)]
    return "\n".join(lines)


# --- tables in pages ----------------------------------------------------------------------------


def scenarios_table() -> str:
    """Write the table of the shipped scenarios, from their first sentences."""
    rows = ["| Program | | |", "|---|---|---|"]
    for name in scenario_names():
        text = ast.get_docstring(ast.parse(_opening(scenario_path(name)))) or ""
        title, _, stresses = text.partition("\n")
        rows.append(f"| `{name}` | {title} | {' '.join(stresses.split())} |")
    return "\n".join(rows)


def _opening(program: Path) -> str:
    """Read the docstring of a Scenic program, in its quotes."""
    text = program.read_text(encoding="utf-8")
    return text[: text.index('"""', 3) + 3]


def columns_table() -> str:
    """Write the table of a trace's columns, from the comments beside the fields of a frame."""
    comments = {
        name: text
        for kind in (fleet.Sensed, fleet.Command, fleet.Intent)
        for name, text in _comments(kind)
    }
    comments["command"] = comments["twist"]
    rows = ["| Column | Shape | |", "|---|---|---|"]
    for name, column in COLUMNS.items():
        shape = ", ".join(["K", *map(str, column.shape)]) + ("" if column.shape else ",")
        rows.append(f"| `{name}` | ({shape}) | {comments[name].replace('``', '`')} |")
    return "\n".join(rows)


def scenes_table() -> str:
    """Write the table of the zoo's scenes, from their files."""
    rows = ["| | Scene | Source | Known answer |", "|---|---|---|---|"]
    for number, scene in enumerate(map(load_scene, scene_names()), 1):
        place = scene.source.removeprefix("https://")
        source = f"[{place.removeprefix('github.com/')}]({scene.source})"
        source = source if place != scene.source else "our own"
        rows.append(
            f"| {number} | ![{scene.title}](pictures/zoo/{scene.name}.png) `{scene.name}`: "
            f"{scene.title} | {source}: {scene.published} | {scene.answer}. {scene.why} |"
        )
    return "\n".join(rows)


def faults_table() -> str:
    """Write the table of the planted faults, from the registry and their test worlds."""
    rows = [
        "| Fault | Layer | What it does | Test world | Specification |",
        "|---|---|---|---|---|",
    ]
    for name, plant in PLANTS.items():
        fault = defects.defect(name)
        rows.append(
            f"| `{name}` | {fault.layer} | {fault.what} | {plant.scene} | `{plant.specification}` |"
        )
    return "\n".join(rows)


def _arguments_table(function: Callable[..., Any]) -> str:
    """Write the table of a function's arguments, from its docstring."""
    docstring = inspect.cleandoc(function.__doc__ or "")
    told = re.search(r"Args:\n(.*?)(?:\n\n|$)", docstring, re.DOTALL)
    assert told is not None
    texts = re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", told[1], re.MULTILINE)
    parameters = inspect.signature(function).parameters
    rows = ["| Parameter | Default | |", "|---|---|---|"]
    for name, text in texts:
        rows.append(f"| `{name}` | `{parameters[name].default!r}` | {' '.join(text.split())} |")
    return "\n".join(rows)


#: tables that ``<!-- made: NAME -->`` in a page stands for
TABLES: dict[str, Callable[[], str]] = {
    "scenes": scenes_table,
    "scenarios": scenarios_table,
    "columns": columns_table,
    "faults": faults_table,
    "hospital": lambda: _arguments_table(hospital),
    "warehouse": lambda: _arguments_table(warehouse),
}


# --- fields of JSON -----------------------------------------------------------------------------


def json_page() -> str:
    """Write the page of what ``--format json`` prints, from the values that are printed."""
    begin = (
        "# Fields of JSON\n\nWhat each command prints with `--format json`. A field of which the "
        "table says *if any* is left out where there is nothing to say. JSON has no infinity: a "
        "number without bound is `null`. Units stand in names (`_s`, `_ms`) or in brackets. Made "
        "from the source.\n"
    )
    return "\n".join([begin, *(_json_section(command) for command in sorted(PRINTED))])


def _json_section(command: str) -> str:
    printed = PRINTED[command]
    lines = [f"## {command}\n"]
    for kind, begin, more in printed:
        lines += [f"{begin}\n"] if begin else []
        lines += [_json_table(kind, more)]
    held = dict.fromkeys(kind for top, _, _ in printed for kind in _values_in(top))
    for top, _, _ in printed:
        held.pop(top)
    for kind in held:
        lines += [f"**{kind.__name__}**: {_summary(kind)}\n", _json_table(kind, {})]
    return "\n".join(lines)


def _json_table(kind: type, more: Mapping[str, str]) -> str:
    comments = _all_comments(kind)
    rows = [f"| `{name}` | {text} |" for name, text in more.items()]
    hints = _hints(kind)
    for field in dataclasses.fields(kind):
        left_out = "if any" if "later" in field.metadata else ""
        note = "; ".join(filter(None, (comments.get(field.name, ""), left_out)))
        note = _cell(note)
        note = re.sub(r"\b(None|False|True)\b", lambda found: JSON_WORDS[found[0]], note)
        rows.append(f"| `{field.name}` | {_json_type(hints[field.name])} | {note} |")
    for name in getattr(kind, "DERIVED", ()):
        told = _hints(getattr(kind, name).fget)["return"]
        rows.append(f"| `{name}` | {_json_type(told)} | {_summary(getattr(kind, name))} |")
    return "\n".join(["| Field | Is | |", "|---|---|---|", *rows, ""])


def _json_type(hint: Any) -> str:
    """Say in a word or two what a field is in JSON."""
    kinds = typing.get_args(hint)
    origin = typing.get_origin(hint)
    if origin is typing.Literal:
        return ", ".join(f"`{value}`" for value in kinds if value != "")
    if origin in (typing.Union, types.UnionType):
        return " or ".join(_json_type(kind) for kind in kinds)
    if origin is dict:
        return f"{_json_type(kinds[1])} by name" if len(kinds) == 2 else "object"
    if origin is tuple and kinds[-1] is not Ellipsis:
        return f"[{', '.join(map(_json_type, kinds))}]"
    if origin in (tuple, list, Sequence):
        return f"list of {_json_type(kinds[0])}"
    if hint in JSON_TYPES:
        return JSON_TYPES[hint]
    return hint.__name__ if dataclasses.is_dataclass(hint) else "value"


def _hints(owner: Any) -> dict[str, Any]:
    """Resolve the type hints of a class or function, also those imported for types only."""
    module = sys.modules[owner.__module__]
    known = dict(vars(module))
    blocks = (
        part for part in ast.parse(inspect.getsource(module)).body if isinstance(part, ast.If)
    )
    for part in (part for block in blocks for part in block.body):
        if isinstance(part, ast.ImportFrom) and part.module:
            source = importlib.import_module(part.module)
            known |= {name.name: getattr(source, name.name) for name in part.names}
    return typing.get_type_hints(owner, known, known)


def _values_in(kind: type) -> Iterator[type]:
    """Find the dataclasses that a printed value holds, itself included."""
    yield kind
    for hint in _hints(kind).values():
        waiting = [hint]
        while waiting:
            part = waiting.pop()
            waiting += typing.get_args(part)
            if dataclasses.is_dataclass(part) and isinstance(part, type):
                yield from _values_in(part)


def components_page() -> str:
    """Write the page of all components and their options, from the registry."""
    lines = [
        "# Layers and their options\n\nEvery registered component, with the options that "
        "`--set LAYER.OPTION=VALUE` or a stack file sets. Made from the source.\n"
    ]
    for point in registry.EXTENSION_POINTS:
        names = registry.names(point)
        lines += [f"## {point}\n"] if names else []
        for name in names:
            component = registry.load(point, name)
            lines += [f"### {name}\n", f"{_summary(component)}\n"]
            lines += [_fields_of(component.Options)]
    return "\n".join(lines)


def _fields_of(kind: type) -> str:
    """Make a table of a dataclass's fields: default with unit, comment and range."""
    comments = _all_comments(kind)
    shapes = {name: row.shape for name, row in observed_in(kind).items()}
    rows = []
    for field in dataclasses.fields(kind):
        rule = field.metadata.get("rule")
        unit = f" {rule.unit}" if rule is not None and rule.unit else ""
        default = "" if field.default is dataclasses.MISSING else f"`{field.default!r}`{unit}"
        shape = str(shapes[field.name]).replace("'", "") if shapes.get(field.name) else ""
        notes = [
            f"{shape} {comments.get(field.name, '')}".strip(),
            _limits(rule) if rule is not None else "",
        ]
        text = "; ".join(note for note in notes if note)
        rows.append(f"| `{field.name}` | {default} | {_cell(text)} |")
    if not rows:
        return "No options.\n"
    return "\n".join(["| Field | Default | |", "|---|---|---|", *rows, ""])


def _limits(rule: Any) -> str:
    bounds = {"from": rule.low, "above": rule.above, "to": rule.high}
    found = " ".join(f"{word} {value:g}" for word, value in bounds.items() if value is not None)
    return found


def _summary(documented: Any) -> str:
    """Give the first paragraph of a docstring as Markdown, in one line."""
    first = inspect.cleandoc(documented.__doc__ or "").split("\n\n")[0]
    return " ".join(first.split()).replace("``", "`")


def _cell(comment: str) -> str:
    """Write a comment as a cell of a table."""
    return re.sub(r":\w+:(?=`)", "", comment.replace("|", "\\|").replace("``", "`"))


def _all_comments(kind: type) -> dict[str, str]:
    """Give the comments of a class and of those it derives from, by field."""
    return {key: text for base in reversed(kind.__mro__) for key, text in _comments(base)}


def _comments(kind: type) -> Iterator[tuple[str, str]]:
    """Find the comments ``#:`` beside the fields of a class, or above them."""
    try:
        lines = textwrap.dedent(inspect.getsource(kind)).splitlines()
    except (OSError, TypeError):
        return
    (node,) = ast.parse("\n".join(lines)).body
    assert isinstance(node, ast.ClassDef)
    for part in node.body:
        if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name):
            above = []
            line = part.lineno - 2
            while lines[line].strip().startswith("#:"):
                above.insert(0, lines[line].strip().removeprefix("#:").strip())
                line -= 1
            beside = lines[(part.end_lineno or part.lineno) - 1].partition("#:")[2].strip()
            yield part.target.id, " ".join([*above, beside]).strip()
