"""Whether a campaign was made by this user on this machine, and which of its files lie elsewhere.

A campaign is sealed when it is made: ``seal.json`` in its folder authenticates ``campaign.json``,
and where the user's own program and components lie and what is in them, by the user's secret key,
which lies elsewhere (:mod:`mrta_falsify.core.user_state`). A folder that was sent, or that was
changed since, has no such seal, nor has one of an older version or of another user.
"""

from __future__ import annotations

import hashlib
import hmac
import itertools
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from mrta_falsify.campaigns.code_content import content_digest
from mrta_falsify.core import codec
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.user_state import secret_key

SETTINGS, SEAL, RECORDS = "campaign.json", "seal.json", "records.jsonl"
OLD_RECORDS = "records.{}.jsonl"  # of an older format, by its number
INDEX = "records.index"
#: what a campaign reads and writes in its folder
OWN = (
    *(SETTINGS, SEAL, RECORDS, *map(OLD_RECORDS.format, (1, 2)), INDEX),
    *("lock", "trials", "bisect.worktrees"),
)
OWN_ENDINGS = (".journal.jsonl", ".part")
#: version and target that settings had when they were sealed; these may have changed since
SEALED_AS = {"version": (3, 2), "target": ("trials", "mrta_falsify.worker:open_trials")}
CHANGING = ("budget", "time_limit")  #: settings that may change when a campaign is resumed

_followed: set[Path] = set()  # folders whose files may lie elsewhere


def write_seal(directory: Path, places: Mapping[str, str]) -> None:
    """Seal a campaign that this user has made; without a key there is no seal.

    Args:
        directory: with its settings.
        places: of components and files that the settings name.
    """
    key = secret_key(make=True)
    if key is None:
        return
    sealed = {
        name: {"place": place, "content": content_digest([Path(place)])}
        for name, place in places.items()
    }
    seal = {"mac": _mac(key, codec.read_json(directory / SETTINGS), sealed), "places": sealed}
    write_atomically(directory / SEAL, (json.dumps(seal, indent=1) + "\n").encode())


def is_made_here(directory: Path, places: Mapping[str, str] | None = None) -> bool:
    """Whether this user made a campaign on this machine.

    Args:
        directory: of the campaign.
        places: where programs, components and files lie now that it names. Each must lie where it
            did, or be the same still.
    """
    sealed = _sealed_places(directory)
    if sealed is None:
        return False
    return all(_is_same(sealed.get(name), place) for name, place in (places or {}).items())


def _is_same(sealed: Any, place: str) -> bool:
    """Whether what lies at a place was sealed: it lay there, or its content is the same."""
    if not isinstance(sealed, dict):
        return False
    content = sealed.get("content")
    return sealed.get("place") == place or (
        content is not None and content == content_digest([Path(place)])
    )


def has_seal(directory: Path) -> bool:
    """Whether a campaign has a seal of this user, which fits its settings."""
    return _sealed_places(directory) is not None


def follow_links(directory: Path) -> None:
    """Let files of a campaign lie elsewhere, in this process: its user has said so."""
    _followed.add(directory.resolve())


def _sealed_places(directory: Path) -> dict[str, Any] | None:
    """Read where things lay when a campaign was sealed; None: it has no seal of this user."""
    key = secret_key()
    if key is None or not (directory / SEAL).is_file():
        return None
    try:
        seal, settings = (dict(codec.read_json(directory / name)) for name in (SEAL, SETTINGS))
        mac, places = seal["mac"], dict(seal["places"])
        names = {name: (settings.get(name), *others) for name, others in SEALED_AS.items()}
        forms = [dict(zip(names, form, strict=True)) for form in itertools.product(*names.values())]
        macs = [_mac(key, {**settings, **form}, places) for form in forms]
        is_ours = any(hmac.compare_digest(str(mac).encode(), own.encode()) for own in macs)
    except (InputError, KeyError, TypeError, ValueError):
        return None
    return places if is_ours else None


def _mac(key: bytes, settings: Any, places: Mapping[str, Any]) -> str:
    told = {name: value for name, value in dict(settings).items() if name not in CHANGING}
    text = json.dumps([told, dict(places)], sort_keys=True)
    return hmac.new(key, text.encode(), hashlib.sha256).hexdigest()


# --- files that lie elsewhere ----------------------------------------------------------------


def links_out(directory: Path, *folders: Path) -> Iterator[tuple[Path, Path]]:
    """Yield links by which files of a campaign lie outside its folder, and where they lead.

    Args:
        directory: of the campaign; what it reads and writes itself is looked at.
        folders: in it, that are looked at with all they hold.
    """
    top = directory.resolve()
    for path in _entries(directory, folders):
        target = path.resolve()
        if not target.is_relative_to(top):
            yield path, target


def _entries(directory: Path, folders: tuple[Path, ...]) -> Iterator[Path]:
    for path in _links_in(directory):
        if path.name in OWN or path.name.endswith(OWN_ENDINGS):
            yield path
    for folder in folders:
        yield folder  # a link above it leads out, too
        for top, inner, _ in os.walk(folder):
            yield from _links_in(Path(top))
            inner.sort()


def _links_in(folder: Path) -> Iterator[Path]:
    try:
        with os.scandir(folder) as entries:
            yield from sorted(Path(entry.path) for entry in entries if entry.is_symlink())
    except OSError:
        return


def refuse_links(directory: Path, *folders: Path) -> None:
    """Refuse a campaign of somebody else that keeps files elsewhere.

    Raises:
        InputError: names the link, and where it leads.
    """
    for path, target in links_out(directory, *folders):
        if directory.resolve() not in _followed and not has_seal(directory):
            raise InputError(
                f"{path}: is a link out of the folder, to {target}, and {directory} was not made "
                "by you on this machine; copy what it leads to into the folder"
            )
