"""The formats of other systems that worlds and runs are written in, as extension points.

Each is a :class:`~mrta_falsify.core.exporting.Exporter` that calls its own writer.
"""

from __future__ import annotations

from pathlib import Path

from mrta_falsify.core.exporting import Exported
from mrta_falsify.core.registry import WithoutOptions
from simulator_interface.formats import nav2


class _Format(WithoutOptions):
    """A format of a world, in one file."""

    of_run = False
    of_folder = False


class Nav2Map(_Format):
    """The costmap as a Nav2 map: ``NAME.yaml``, or a directory that gets ``map.yaml``."""

    def write(self, exported: Exported, path: Path) -> tuple[Path, ...]:
        """See :class:`~mrta_falsify.core.exporting.Exporter`."""
        return nav2.write_map_files(exported.costmap(), path)


class SdfWorld(_Format):
    """A world of Gazebo."""

    def write(self, exported: Exported, path: Path) -> tuple[Path, ...]:
        """See :class:`~mrta_falsify.core.exporting.Exporter`."""
        from simulator_interface.formats.sdf_world import write_sdf  # noqa: PLC0415

        write_sdf(exported.world, path)
        return (path,)


class MrtaSimFiles(_Format):
    """All input files of MRTA-Sim."""

    of_folder = True

    def write(self, exported: Exported, path: Path) -> tuple[Path, ...]:
        """See :class:`~mrta_falsify.core.exporting.Exporter`."""
        from simulator_interface.formats.mrta_sim_files import write_mrta_sim  # noqa: PLC0415

        return write_mrta_sim(exported.world, exported.costmap(), path)


class OpenRmf(_Format):
    """A building map of Open-RMF, and a script that dispatches the tasks."""

    of_folder = True

    def write(self, exported: Exported, path: Path) -> tuple[Path, ...]:
        """See :class:`~mrta_falsify.core.exporting.Exporter`."""
        from simulator_interface.formats.open_rmf import write_open_rmf  # noqa: PLC0415

        return write_open_rmf(exported.world, path)


class Mcap(_Format):
    """A run with ROS 2 messages, for Foxglove."""

    of_run = True

    def write(self, exported: Exported, path: Path) -> tuple[Path, ...]:
        """See :class:`~mrta_falsify.core.exporting.Exporter`."""
        from simulator_interface.formats.mcap import write_mcap  # noqa: PLC0415

        write_mcap(exported.world, exported.run(), exported.costmap(), path)
        return (path,)
