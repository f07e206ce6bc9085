"""What is installed: the components of every extension point, and the planted defects."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mrta_falsify.commands.file_schemas import write_schemas
from mrta_falsify.commands.folders import Place
from mrta_falsify.core import registry
from mrta_falsify.core.defects import defect_names


@dataclass(frozen=True, slots=True)
class Plugins:
    """Registered names."""

    components: dict[str, tuple[str, ...]]  #: by extension point, in the order of a stack
    defects: tuple[str, ...]  #: planted ones, switched on by ``--set defects=[name]``
    schemas: tuple[Path, ...] = ()  #: files that were written


def plugins(schemas: Place | None = None) -> Plugins:
    """List the components of every extension point, and the planted defects.

    Args:
        schemas: directory to write JSON Schemas of stack, project, floor, tasks and world files to,
            which know these components and their options; None: none are written.

    Raises:
        PlaceError: a schema cannot be written.
    """
    return Plugins(
        {point: registry.names(point) for point in registry.EXTENSION_POINTS},
        defect_names(),
        () if schemas is None else write_schemas(schemas),
    )
