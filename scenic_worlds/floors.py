"""Floors with random parameters, for ``param layout``.

::

    from scenic_worlds.floors import hospital
    param layout = hospital(corridor_width=Range(2.2, 3.4), rooms=8)
    model scenic_worlds.model

The parameters are those of the layout functions (``docs/layouts.md``), each fixed or random.
"""

from __future__ import annotations

from scenic_worlds.layouts.hospital import hospital as _hospital
from scenic_worlds.layouts.warehouse import warehouse as _warehouse
from scenic_worlds.lifted import lifted

hospital = lifted(_hospital)
warehouse = lifted(_warehouse)

__all__ = ["hospital", "warehouse"]
