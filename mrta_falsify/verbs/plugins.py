"""What is installed: the components of every extension point, and the planted defects."""

from __future__ import annotations

from dataclasses import dataclass

from mrta_falsify.core import registry
from mrta_falsify.core.defects import defect_names


@dataclass(frozen=True, slots=True)
class Plugins:
    """Registered names."""

    components: dict[str, tuple[str, ...]]  #: by extension point, in the order of a stack
    defects: tuple[str, ...]  #: planted ones, switched on by ``--set defects=[name]``


def plugins() -> Plugins:
    """List the components of every extension point, and the planted defects."""
    return Plugins(
        {point: registry.names(point) for point in registry.EXTENSION_POINTS},
        defect_names(),
    )
