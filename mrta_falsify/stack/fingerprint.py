"""A hash over any value of the stack's memory, bit by bit."""

from __future__ import annotations

import dataclasses
import hashlib

import numpy as np


def fingerprint(value: object, seen: hashlib._Hash) -> None:
    """Feed ``value`` to ``seen``: arrays by their bytes, objects by their fields in order.

    Components without fields (a planner, options) count by the name of their class.
    """
    if isinstance(value, np.ndarray):
        seen.update(repr((value.dtype.str, value.shape)).encode())
        seen.update(np.ascontiguousarray(value).tobytes())
    elif dataclasses.is_dataclass(value):
        _fields(value, [field.name for field in dataclasses.fields(value)], seen)
    elif isinstance(value, dict):
        for key in sorted(value, key=repr):
            seen.update(repr(key).encode())
            fingerprint(value[key], seen)
    elif isinstance(value, (list, tuple)):
        seen.update(f"[{len(value)}".encode())
        for item in value:
            fingerprint(item, seen)
    elif hasattr(value, "__dict__") and not isinstance(value, type):
        _fields(value, sorted(vars(value)), seen)
    else:
        seen.update(repr(value).encode())


def _fields(value: object, names: list[str], seen: hashlib._Hash) -> None:
    seen.update(type(value).__name__.encode())
    for name in names:
        seen.update(name.encode())
        fingerprint(getattr(value, name), seen)
