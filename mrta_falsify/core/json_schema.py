"""JSON Schemas (draft 2020-12) of the files that :mod:`.codec` reads.

Editors complete and check a file by its schema. A schema says what fields there are, their types,
limits and meaning; what must fit together only :func:`~mrta_falsify.core.codec.decode` checks.
"""

from __future__ import annotations

import ast
import builtins
import dataclasses
import enum
import functools
import inspect
import textwrap
import types
import typing
from typing import Any

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.codec import Rule

DIALECT = "https://json-schema.org/draft/2020-12/schema"
COMMENT = "#:"  # begins what a field means, behind it or on the lines before
Schema = dict[str, Any]

_SCALARS = {float: "number", int: "integer", str: "string", bool: "boolean"}


class Definitions:
    """The dataclasses that a schema refers to, each once."""

    def __init__(self) -> None:
        self._names: dict[type, str] = {}
        self._made: dict[str, Schema] = {}

    def schema_of(self, hint: Any, rule: Rule | None = None) -> Schema:
        """Describe the data from which ``decode`` builds a value.

        Args:
            hint: a dataclass, or another type that a field of one may have.
            rule: that a number or an array follows.

        Raises:
            TypeError: ``decode`` does not read the type.
        """
        if hint is Any:
            return {}
        if hint in _SCALARS:
            return {"type": _SCALARS[hint], **_limits(rule)}
        if dataclasses.is_dataclass(hint):
            return self._reference(typing.cast(type, hint))
        given = typing.get_args(hint)
        match typing.get_origin(hint) or hint:
            case typing.Union | types.UnionType:
                return self._union(given, rule)
            case typing.Literal:
                return {"enum": list(given)}
            case builtins.tuple if given[1:] == (Ellipsis,):
                return {"type": "array", "items": self.schema_of(given[0], rule)}
            case builtins.tuple:
                items = [self.schema_of(item, rule) for item in given]
                return {"type": "array", "prefixItems": items, **_exactly(len(given))}
            case builtins.dict:
                return {"type": "object", "additionalProperties": self.schema_of(given[1], rule)}
            case np.ndarray:
                return _array(rule or Rule())
        if isinstance(hint, type) and issubclass(hint, enum.Enum):
            return {"enum": [item.value for item in hint]}
        raise TypeError(f"{hint!r} is no type that can be read from a file")

    def object_of(self, kind: type) -> Schema:
        """Describe a dataclass where it stands, its parts by reference."""
        meanings, properties, needed = field_comments(kind), {}, []
        for field in dataclasses.fields(kind):
            hint, rule, is_needed = codec.fields_to_read(kind)[field.name]
            unit = f"[{rule.unit}]" if rule and rule.unit else ""
            text = f"{meanings.get(field.name, '')} {unit}".strip()
            told = {"description": text} if text else {}
            properties[field.name] = {**self.schema_of(hint, rule), **told, **_default(field)}
            needed += [field.name] if is_needed else []
        return {
            "type": "object",
            "description": (inspect.getdoc(kind) or "").partition("\n\n")[0].replace("\n", " "),
            "properties": properties,
            **({"required": needed} if needed else {}),
            **({} if getattr(kind, "OPEN", False) else {"additionalProperties": False}),
        }

    def document(self, root: Schema, *, title: str) -> Schema:
        """Put a schema and what it refers to into one document."""
        made = dict(sorted(self._made.items()))
        return {"$schema": DIALECT, "title": title, **root, "$defs": made}

    def _reference(self, kind: type) -> Schema:
        if kind not in self._names:
            alike = sum(other.__name__ == kind.__name__ for other in self._names)
            name = f"{kind.__name__}{alike + 1}" if alike else kind.__name__
            self._names[kind] = name
            self._made[name] = self.object_of(kind)
        return {"$ref": f"#/$defs/{self._names[kind]}"}

    def _union(self, options: tuple[Any, ...], rule: Rule | None) -> Schema:
        parts = [option for option in options if option is not type(None)]
        if len(parts) > 1:  # the field `kind` tells which one is meant
            schemas = [{**self.schema_of(part), "required": ["kind"]} for part in parts]
        else:
            schemas = [self.schema_of(parts[0], rule)]
        if len(parts) < len(options):
            schemas.append({"type": "null"})
        return {"anyOf": schemas} if len(schemas) > 1 else schemas[0]


def _limits(rule: Rule | None) -> Schema:
    found = (
        {"minimum": rule.low, "exclusiveMinimum": rule.above, "maximum": rule.high} if rule else {}
    )
    return {name: limit for name, limit in found.items() if limit is not None}


def _exactly(length: int) -> Schema:
    return {"minItems": length, "maxItems": length}


def _array(rule: Rule) -> Schema:
    """Describe numbers in nested lists; an empty list stands for any array without numbers."""
    schema: Schema = {"type": "number", **_limits(rule)}
    if rule.allow_missing:
        schema = {"anyOf": [schema, {"type": "null"}]}
    if rule.shape is None:
        return {"anyOf": [schema, {"type": "array"}]}
    for length in reversed(rule.shape):
        sized = {} if isinstance(length, str) else _exactly(length)
        schema = {"type": "array", "items": schema, **sized}
    return schema


def _default(field: dataclasses.Field[Any]) -> Schema:
    value = field.default
    if field.default_factory is not dataclasses.MISSING:
        value = field.default_factory()
    return {} if value is dataclasses.MISSING else {"default": codec.finite(codec.encode(value))}


@functools.cache
def field_comments(kind: type) -> dict[str, str]:
    """Read what the comments of a dataclass say of its fields, those of its bases included."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if dataclasses.is_dataclass(base):
            found |= _own_comments(base)
    return found


def _own_comments(kind: type) -> dict[str, str]:
    try:
        text = textwrap.dedent(inspect.getsource(kind))
        body = typing.cast(ast.ClassDef, ast.parse(text).body[0]).body
    except (OSError, TypeError, SyntaxError):  # no file has it, or it cannot stand alone
        return {}
    lines = text.splitlines()
    found = {}
    for item in body:
        if not isinstance(item, ast.AnnAssign) or not isinstance(item.target, ast.Name):
            continue
        _, _, behind = lines[(item.end_lineno or item.lineno) - 1].partition(COMMENT)
        words = [behind.strip()] if behind else []
        above = item.lineno - 2
        while above >= 0 and lines[above].strip().startswith(COMMENT):
            words.insert(0, lines[above].strip().removeprefix(COMMENT).strip())
            above -= 1
        if words:
            found[item.target.id] = " ".join(words)
    return found
