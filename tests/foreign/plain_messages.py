"""Messages as plain objects, with the defaults of their definitions."""

from __future__ import annotations

from types import SimpleNamespace

from simulator_interface.foreign.interfaces import FieldType, humble_types

ZEROS = {"string": "", "bool": False, "float32": 0.0, "float64": 0.0}


def make(name: str) -> SimpleNamespace:
    """Make a message of Humble's."""
    return SimpleNamespace(
        **{
            field.name: _zero(field.type) if field.default is None else field.default
            for field in humble_types()[name].fields
        }
    )


def _zero(held: FieldType):
    if held.container == "sequence":
        return []
    if held.container == "array":
        return [ZEROS.get(held.element, 0)] * held.size
    return ZEROS.get(held.element, 0) if held.is_primitive else make(held.element)
