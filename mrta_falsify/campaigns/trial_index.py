"""Rows of trials, one line each, and the index beside a large campaign's log that holds them.

``records.index`` is one line as those of the log: checksum, tab, JSON. Who writes the log writes it
anew when done. It is believed only if log and settings are byte for byte those that it was made
from; otherwise the log is read. This module imports little, so that a long list comes at once.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import importlib.metadata
import json
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from mrta_falsify.campaigns.made_here import INDEX, RECORDS, SETTINGS, has_seal, refuse_links
from mrta_falsify.core.codec import later
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.errors import InputError, PlaceError
from mrta_falsify.core.words import listed

INDEX_VERSION = 1
INDEXED = 1000  # trials from which on an index is worth its file
WORLD = "world"  #: in place of a layer, where the world shut a place
CHECKSUM_LENGTH = 16  # hex digits of sha256


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialRow:
    """A trial in one line, as ``list --format json`` prints it."""

    id: str
    status: Literal["ok", "rejected", "impossible", "crashed", "timeout"]
    score: float
    signature: str
    failed: bool
    jittered: int  #: perturbed runs
    jittered_failures: int  #: perturbed runs that fail
    violated: tuple[str, ...]  #: specifications
    headline: str  #: what happened first, in a sentence; empty if nothing is violated
    who: str  #: robots concerned, the root first, those held up in brackets
    layer: str  #: suspected layer: by ``explain`` once it was run, a first guess before
    engine: str
    sim_time_s: float
    wall_s: float
    attempts: int  #: scenes drawn until one was valid
    world_digest: str
    trace_digest: str
    error: str
    not_judged: tuple[str, ...] = later(())  #: specifications
    repeats: int = later(0)  #: runs again with nothing changed, of a foreign stack
    repeats_failed: int = later(0)  #: those that fail in the same way
    other_engines: str = later("")  #: on which a robust failure was run, and the outcome
    #: what the other stack does, with ``--against``
    other: Literal["", "passes", "fails", "not judged"] = later("")
    other_jittered: int = later(0)  #: the same perturbed runs on the other stack
    other_jittered_failures: int = later(0)  #: those that fail
    kind: str = later("")  #: deadlock, stuck or shut (by the world)


FIELDS = dataclasses.fields(TrialRow)
ALWAYS = tuple(field.name for field in FIELDS if "later" not in field.metadata)
OPTIONAL = tuple(field.name for field in FIELDS if "later" in field.metadata)  # told if not empty
LISTS = frozenset(("violated", "not_judged"))
KINDS: dict[str, tuple[type, ...]] = {
    "str": (str,),
    "float": (float, int),
    "int": (int,),
    "bool": (bool,),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialIndex:
    """All rows of a campaign, and what its trials say together."""

    rows: tuple[TrialRow, ...]  #: by number; layers as rules on the traces suspect them
    ranked: frozenset[str]  #: ids of the judged trials whose failure counts for something
    #: sentences of the summary, those before and those after the suspected layers
    summary: tuple[tuple[str, ...], tuple[str, ...]]


def rows_data(rows: Sequence[TrialRow]) -> list[dict[str, Any]]:
    """Encode rows as JSON-shaped data, as :func:`mrta_falsify.core.codec.encode` does."""
    data = []
    for row in rows:
        told = {name: getattr(row, name) for name in ALWAYS}
        told |= {name: value for name in OPTIONAL if (value := getattr(row, name))}
        data.append(told)
    return data


def explained_rows(directory: Path, index: TrialIndex) -> tuple[TrialRow, ...]:
    """Give the rows of an index with the layers that ``explain`` has named since."""
    trials = directory / "trials"
    return tuple(
        dataclasses.replace(row, layer=_explained_layer(directory, row))
        if row.failed and (trials / row.id / "explain.json").is_file()
        else row
        for row in index.rows
    )


def _explained_layer(directory: Path, row: TrialRow) -> str:
    from mrta_falsify.campaigns.finding_files import read_finding  # noqa: PLC0415 - loads slowly
    from mrta_falsify.core.findings import Explanation  # noqa: PLC0415

    folder = directory / "trials" / row.id
    with contextlib.suppress(InputError):  # a damaged file, or one that lies elsewhere
        refuse_links(directory, folder)
        found = read_finding(folder, Explanation)
        return row.layer if found is None else found.layer
    return row.layer


def index_summary(index: TrialIndex, rows: Sequence[TrialRow]) -> tuple[str, ...]:
    """Sum a campaign up in sentences.

    Args:
        index: of the campaign.
        rows: all of them, with the layers that are known by now.
    """
    before, after = index.summary
    layers = (row.layer for row in rows if row.id in index.ranked)
    return (*before, *layer_sentences(layers), *after)


def layer_sentences(layers: Iterable[str]) -> tuple[str, ...]:
    """Say which parts of the stack are suspected, and how often; nothing if none is.

    Args:
        layers: suspected in each failing trial; empty: none.
    """
    suspected = Counter(layer.replace("_", " ") for layer in layers)
    none, shut = suspected.pop("", 0), suspected.pop(WORLD, 0)
    if not suspected:
        return ()
    named = [f"the {name} ({count})" for name, count in suspected.most_common()]
    named += [f"none ({none})"] if none else []
    named += [f"none, the world shut a place ({shut})"] if shut else []
    return (f"Suspected part of the stack, by trials: {listed(named)}.",)


def write_index(directory: Path, index: TrialIndex) -> None:
    """Write the index beside the log, whose owner the caller is.

    A disk that has no room for it costs the index and not the campaign.
    """
    data = {
        **_head(directory),
        "columns": {
            field.name: [getattr(row, field.name) for row in index.rows] for field in FIELDS
        },
        "ranked": sorted(index.ranked),
        "summary": index.summary,
    }
    text = json.dumps(data, separators=(",", ":"))
    with contextlib.suppress(PlaceError):
        write_atomically(directory / INDEX, f"{_checksum(text)}\t{text}\n".encode())


def read_index(directory: Path) -> TrialIndex | None:
    """Read the index of a campaign; None: there is none, or it is not that of the log."""
    if not has_seal(directory):
        return None  # somebody else could have written it
    paths = [directory / name for name in (INDEX, RECORDS, SETTINGS)]
    if not all(path.is_file() and not path.is_symlink() for path in paths):
        return None
    try:
        checksum, _, text = paths[0].read_text(encoding="utf-8").rstrip("\n").partition("\t")
        if checksum != _checksum(text):
            return None
        data = json.loads(text)
        if any(data[name] != value for name, value in _head(directory).items()):
            return None
        columns = [_column(field, data["columns"][field.name]) for field in FIELDS]
        before, after = (tuple(map(str, part)) for part in data["summary"])
        ranked = frozenset(map(str, data["ranked"]))
        names = [field.name for field in FIELDS]
        rows = tuple(
            TrialRow(**dict(zip(names, row, strict=True))) for row in zip(*columns, strict=True)
        )
    except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None
    return TrialIndex(rows=rows, ranked=ranked, summary=(before, after))


def _column(field: dataclasses.Field[Any], values: list[Any]) -> list[Any]:
    """Check the values of a column.

    Raises:
        TypeError: one is of another type.
        ValueError: one is not finite.
    """
    if field.name in LISTS:
        if set(map(type, values)) - {list} or {type(v) for row in values for v in row} - {str}:
            raise TypeError(field.name)
        return list(map(tuple, values))
    if set(map(type, values)) - set(KINDS.get(str(field.type), (str,))):
        raise TypeError(field.name)
    if field.type == "float" and not all(map(math.isfinite, values)):
        raise ValueError(field.name)
    return values


def _head(directory: Path) -> dict[str, Any]:
    """Say which version writes an index, and of which log and settings."""
    with (directory / RECORDS).open("rb") as log:
        digest = hashlib.file_digest(log, "sha256").hexdigest()
    return {
        "version": INDEX_VERSION,
        "toolkit": importlib.metadata.version("mrta-falsify"),
        "bytes": (directory / RECORDS).stat().st_size,
        "log": digest,
        "settings": hashlib.sha256((directory / SETTINGS).read_bytes()).hexdigest(),
    }


def _checksum(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:CHECKSUM_LENGTH]
