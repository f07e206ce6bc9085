"""Scalars of other tools' YAML files, as they were written: numbers, truth and text of them.

``codec.read_yaml(..., as_text=...)`` gives lists, dicts and text. What a scalar is depends on where
it stands, as in the tools themselves (yaml-cpp): ``101`` is a number or a name, ``5e-2`` a number.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Any

from mrta_falsify.core.spelling import nearest_name
from mrta_falsify.core.words import listed

NOTHING = ("", "~", "null", "Null", "NULL")  # what says that a field is empty
TRUE = ("true", "yes", "on", "y")  # in small letters, as yaml-cpp has them
FALSE = ("false", "no", "off", "n")
_PLAIN = re.compile(r"[-+]?(\d[\d_]*\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?\.(inf|nan)", re.IGNORECASE)


def is_empty(value: Any) -> bool:
    """Whether nothing was written."""
    return value is None or value in NOTHING


def number_in(value: Any) -> float | None:
    """Read a number, infinity and NaN as YAML has them included; None: it is none."""
    if not isinstance(value, str) or not _PLAIN.fullmatch(value):
        return None
    plain = value.lower().replace("_", "")  # as YAML 1.1 has 1_000
    return float(plain.replace(".inf", "inf").replace(".nan", "nan"))


def whole_in(value: Any) -> int | None:
    """Read a whole number; None: it is none."""
    number = number_in(value)
    if number is None or not math.isfinite(number) or number != int(number):
        return None
    return int(number)


def truth_in(value: Any) -> bool | None:
    """Read ``true`` or ``false``, in the spellings of YAML 1.1; None: it is neither."""
    word = value.lower() if isinstance(value, str) else ""
    return True if word in TRUE else False if word in FALSE else None


def unused_note(what: str, given: Iterable[str], known: Iterable[str]) -> list[str]:
    """Say in one note which fields of another tool's file are not used; empty: all are.

    Args:
        what: has the fields, as ``the map``.
        given: names of its fields.
        known: those that are read.
    """
    known = tuple(known)
    unused = [str(name) for name in given if name not in known]
    if not unused:
        return []
    hints = [nearest for name in unused if (nearest := nearest_name(name, known))]
    meant = f" (did you mean {listed(hints)}?)" if hints else ""
    verb = "is" if len(unused) == 1 else "are"
    return [f"{listed(unused)} of {what} {verb} not used{meant}"]


def shown(data: Any) -> str:
    """Show what was written, in at most 60 characters: numbers and truth without quotes."""
    text = _text(data)
    return text if len(text) <= 60 else text[:57] + "..."


def _text(data: Any) -> str:
    if isinstance(data, list):
        return f"[{', '.join(map(_text, data))}]"
    if isinstance(data, dict):
        return f"{{{', '.join(f'{key}: {_text(value)}' for key, value in data.items())}}}"
    is_plain = number_in(data) is not None or truth_in(data) is not None
    return data if is_plain else repr(data)
