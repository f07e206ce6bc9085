"""Requirements of a program's author: where they are written, and whether they hold."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from scenic.core.distributions import RejectionException
from scenic.core.requirements import CompiledRequirement, SamplingRequirement

from mrta_falsify.core.errors import FormatError, InputError


def requirement_place(requirement: CompiledRequirement) -> str:
    """Locate a user's requirement as ``file:line``; the file without its folder."""
    return f"{Path(requirement_file(requirement)).name}:{requirement.line}"


def requirement_file(requirement: CompiledRequirement) -> str:
    """Find the file of a user's requirement, as it was given to Scenic."""
    code = requirement.proposition.atomics()[0].closure.__code__
    return str(code.co_filename)


def requirement_text(requirement: CompiledRequirement) -> str:
    """Name a requirement for messages: by its name if its author gave it one."""
    name = str(requirement.name or "")
    unnamed = not name or name == f"requirement on line {requirement.line}"
    return "requirement" if unnamed else f"requirement {name!r}"


def is_falsified(requirement: SamplingRequirement, sample: Mapping[Any, Any]) -> bool:
    """Ask Scenic whether a requirement fails; a rejection raised inside counts as one.

    Raises:
        FormatError: the user's expression fails; says where.
    """
    try:
        return bool(requirement.falsifiedBy(sample))
    except (RejectionException, InputError) as error:
        if isinstance(error, RejectionException):
            return True
        raise
    except Exception as error:
        if not isinstance(requirement, CompiledRequirement):
            raise
        place = f"{requirement_file(requirement)}:{requirement.line}"
        raise FormatError(
            f"{place}: {requirement_text(requirement)} cannot be evaluated: "
            f"{type(error).__name__}: {error}"
        ) from error
