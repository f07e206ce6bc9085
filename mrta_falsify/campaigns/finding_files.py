"""Findings about a failure, kept in files beside its trial."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TypeVar

from mrta_falsify.core import codec
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.findings import (
    Certificate,
    Explanation,
    Finding,
    Minimisation,
    ReplayCheck,
    derived_names,
    finding_data,
)

FINDING_VERSION = 2  # of the files; version 1 wrote no number, and the same keys
FILE_NAMES: dict[type[Finding], str] = {
    Explanation: "explain.json",
    Minimisation: "minimize.json",
    ReplayCheck: "verify.json",
    Certificate: "certificate.json",
}

F = TypeVar("F", Explanation, Minimisation, ReplayCheck, Certificate)


def write_finding(folder: Path, finding: Finding) -> None:
    """Write a finding beside a trial, in place of an earlier one of its kind.

    Raises:
        PlaceError: it cannot be written, or the folder was removed.
    """
    data = {"version": FINDING_VERSION, **finding_data(finding)}
    text = json.dumps(data, indent=1) + "\n"
    write_atomically(folder / FILE_NAMES[type(finding)], text.encode())


def read_finding(folder: Path, kind: type[F]) -> F | None:
    """Read a finding that was kept beside a trial.

    Args:
        folder: of the trial.
        kind: of the finding.

    Returns:
        None if there is no such file.

    Raises:
        FormatError: the file cannot be read, or has another version.
        InputError: the file is damaged; the message names the field.
    """
    path = folder / FILE_NAMES[kind]
    if not path.is_file():
        return None
    data = codec.read_json(path)
    if isinstance(data, dict):
        version = data.pop("version", 1)
        if version not in (1, FINDING_VERSION):
            known = f"this toolkit reads versions 1 to {FINDING_VERSION}"
            raise FormatError(f"{path}: has format version {version}; {known}")
        for name in derived_names(kind):  # found anew
            told = data.pop(name, 0.0)
            if isinstance(told, bool) or not isinstance(told, int | float):
                raise FormatError(f"{path}: {name} is {codec.shown(told)}; it must be a number")
    return codec.decode(kind, data, where=str(path))
