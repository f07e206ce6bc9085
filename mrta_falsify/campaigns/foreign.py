"""Code that is not ours and that a campaign names: what would run, and who vouches for it.

A campaign's folder may come from somebody else, and what its files name is data. Before a verb runs
foreign code that such a file names, it asks :func:`permit`. Code of a folder that this user made on
this machine runs as ever (:mod:`.made_here`). Elsewhere the user says so once, and the digest of
what would run is remembered.
"""

from __future__ import annotations

import os
import re
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from mrta_falsify.campaigns import made_here
from mrta_falsify.campaigns.code_content import content_digest
from mrta_falsify.campaigns.settings import CampaignSettings, TrialSettings
from mrta_falsify.core import codec, registry
from mrta_falsify.core.config import LAYERS, Choice, StackConfig
from mrta_falsify.core.errors import NeedsOption
from mrta_falsify.core.external import CONNECT, EXEC, ExternalStack
from mrta_falsify.core.modules import is_ours, place_of
from mrta_falsify.core.user_state import remember, trusted_digests
from mrta_falsify.core.words import listed
from mrta_falsify.specs.library import specification_choice

#: False: foreign code needs a key or an earlier trust. True: it may run. A function: it may run,
#: and the function is told what it is
Trust = bool | Callable[[str], None]
Kind = Literal["Scenic program", "command", "address", "component", "file", "link"]

CODE = (".py", ".npz")  # of policies

#: registered, or module:Class
_NAME = re.compile(r"[A-Za-z_][\w-]*|[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")
_FILE = re.compile(r"[^:\s][^:]*(/[^:]*|\.[A-Za-z]\w{0,9})(:\w+)?")


@dataclass(frozen=True, slots=True)
class Foreign:
    """Something that is not the toolkit's, and that would be run or read."""

    kind: Kind
    name: str  #: as it is named
    place: Path | None = None  #: its file or folder; None: it is nowhere, or elsewhere on the path
    others: tuple[Path, ...] = ()  #: files and folders that belong to it

    def __str__(self) -> str:
        """Write it as in ``the command python stack.py in /home/me/stack``."""
        at = f" ({self.place})" if self.place is not None else ""
        return f"the {self.kind} {self.name}{at}"


# --- what would run ------------------------------------------------------------------------


def of_component(point: str, name: str) -> Iterator[Foreign]:
    """Yield what a name of a component stands for, unless it is ours or not known.

    Args:
        point: extension point.
        name: registered, ``module:Class``, or ``exec:CMD``.
    """
    if name.startswith((EXEC, CONNECT)):
        yield from _of_text(name)
        return
    module = registry.target_of(point, name).partition(":")[0]
    if module and not is_ours(module):
        yield Foreign("component", name, place_of(module))


def of_choice(point: str, choice: Choice) -> Iterator[Foreign]:
    """Yield what a component and its options name; an option may be a component, or a file."""
    yield from of_component(point, choice.name)
    yield from of_values(choice.options)


def of_values(data: Any) -> Iterator[Foreign]:
    """Yield what texts in JSON-shaped data may stand for: commands, components and files."""
    if isinstance(data, str):
        yield from _of_text(data)
    elif isinstance(data, dict):
        for value in data.values():
            yield from of_values(value)
    elif isinstance(data, (list, tuple)):
        for value in data:
            yield from of_values(value)


def _of_text(text: str) -> Iterator[Foreign]:
    if text.startswith(EXEC):
        yield _command(text.removeprefix(EXEC), Path.cwd())
        return
    if text.startswith(CONNECT):
        yield Foreign("address", text.removeprefix(CONNECT))
        return
    if "," in text:  # a list of names
        for part in text.split(","):
            yield from _of_text(part)
        return
    _, _, value = text.partition("=")  # of a setting, as planner=my:Planner
    if value:
        yield from _of_text(value)
    name = text.partition("{")[0].strip()  # options of a specification follow it
    path = Path(name.partition(":")[0])
    if _FILE.fullmatch(name) and (path.suffix in CODE or _is_there(path)):
        yield Foreign("file", name, path.resolve() if _is_there(path) else None)
        return
    targets = [registry.target_of(point, name) for point in registry.EXTENSION_POINTS]
    if any(":" in target for target in targets) and _NAME.fullmatch(name):
        for target in dict.fromkeys(targets):
            module = target.partition(":")[0]
            if module and not is_ours(module):
                yield Foreign("component", name, place_of(module))
    elif _FILE.fullmatch(name):
        yield Foreign("file", name)


def _is_there(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a name that no file can have
        return False


def _command(text: str, folder: Path) -> Foreign:
    try:
        words = shlex.split(text)
    except ValueError:
        words = [text]
    return Foreign("command", text, folder.resolve(), _files_of(words, folder))


def _files_of(words: Iterable[str], folder: Path) -> tuple[Path, ...]:
    paths = (folder / word for word in words if word)
    return tuple(sorted({path.resolve() for path in paths if _is_there(path)}))


def of_outside(stack: ExternalStack | None) -> Iterator[Foreign]:
    """Yield the command, or the address, of a foreign stack."""
    if stack is None:
        return
    if stack.connect:
        yield Foreign("address", stack.connect)
        return
    given = [f"{name}={value}" for name, value in sorted(stack.env.items())]
    places = [part for value in stack.env.values() for part in value.split(os.pathsep)]
    folder = Path(stack.folder or ".")
    files = _files_of((*stack.command, *places), folder)
    yield Foreign("command", shlex.join([*given, *stack.command]), folder.resolve(), files)


def of_stack(config: StackConfig) -> Iterator[Foreign]:
    """Yield what a stack, its engine and its people name."""
    yield from of_outside(config.stack)
    for layer in LAYERS:
        yield from of_choice(layer, getattr(config, layer))


def of_specifications(names: Iterable[str]) -> Iterator[Foreign]:
    """Yield what specifications name."""
    for name in names:
        if not name.startswith("stl:"):
            yield from of_choice("specification", specification_choice(name))


def of_judging(trials: TrialSettings) -> Iterator[Foreign]:
    """Yield what judges the trials of a campaign."""
    yield from of_specifications((*trials.specifications, *trials.then))


def of_settings(settings: CampaignSettings) -> Iterator[Foreign]:
    """Yield all that a campaign names, but for its program."""
    trials = settings.trials
    yield from of_stack(trials.stack)
    if trials.against is not None:
        yield from of_stack(trials.against)
    yield from of_judging(trials)
    for engine in trials.confirm:
        yield from of_component("engine", engine)
    yield from of_choice("sampler", settings.sampler)


def sealed_places(settings: CampaignSettings) -> dict[str, str]:
    """Say where all lies that a campaign names, as :func:`places_of`, its program too."""
    program = Path(settings.trials.scenario)
    found = [*of_settings(settings), *of_values(settings.trials.params)]
    if program.suffix == ".scenic" and program.is_file():
        found.append(Foreign("Scenic program", settings.trials.scenario, program.resolve()))
    return places_of(found)


def of_links(directory: Path, *folders: Path) -> Iterator[Foreign]:
    """Yield the files of a campaign that lie elsewhere, reached by a link.

    Args:
        directory: of the campaign; its own files are looked at.
        folders: in it, of which all files are looked at.
    """
    for path, target in made_here.links_out(directory, *folders):
        yield Foreign("link", str(path), target)


_told: set[str] = set()  # what the user of this process was told to have trusted


# --- who vouches ---------------------------------------------------------------------------


def permit(directory: Path, foreign: Iterable[Foreign], trust: Trust) -> None:
    """Refuse foreign code, unless this user made the folder that names it, or trusts it.

    Args:
        directory: of the campaign that names it, or the file of the project.
        foreign: that would be run or read.
        trust: whether the user says that it may, which is remembered.

    Raises:
        NeedsOption: it may not; says what would run.
    """
    found = tuple(dict.fromkeys(foreign))
    if not found or made_here.is_made_here(directory, places_of(found)):
        return
    what, digest = listed([str(one) for one in found]), digest_of(found)
    if digest is None or digest not in trusted_digests():
        if not trust:
            raise NeedsOption(
                f"{directory} was not made by you on this machine, and this command would run or "
                f"read what the folder names: {what}",
                "--trust",
            )
        is_kept = digest is not None and remember(digest)
        if callable(trust) and what not in _told:
            trust(f"trusted: {what}" + ("" if is_kept else "; this cannot be remembered"))
        _told.add(what)
    if any(one.kind == "link" for one in found):
        made_here.follow_links(directory)
    write_no_caches()


def places_of(foreign: Iterable[Foreign]) -> dict[str, str]:
    """Say where programs, components and files lie, by the names that a campaign gives them."""
    return {
        one.name: str(one.place)
        for one in foreign
        if one.place is not None and one.kind in ("Scenic program", "component", "file")
    }


def write_no_caches() -> None:
    """Write no compiled modules beside foreign code, so that its digest stays what it is."""
    sys.dont_write_bytecode = True
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"


def digest_of(foreign: Sequence[Foreign]) -> str | None:
    """Compute the digest of what would run: names, files, and the folders that they lie in.

    None if there is too much to read.
    """
    seen = []
    for one in sorted(foreign, key=lambda one: (one.kind, one.name)):
        content = content_digest([path for path in (one.place, *one.others) if path])
        if content is None:
            return None
        seen.append([one.kind, one.name, content])
    return codec.digest(seen)
