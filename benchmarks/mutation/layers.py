"""Which layer of the stack a file belongs to, in the words of ``explain``."""

from __future__ import annotations

from pathlib import Path

from simulator_interface.failing_layer import SHIPPED

#: layer by the beginning of a path, the longest one counts; "": code that several layers share,
#: for which no layer is right or wrong
LAYERS = {
    "mrta_falsify/stack/": "",
    **SHIPPED,
}
#: below the folders above, but not of the stack under test: people walk by them, digests are
#: made of them, or they hold the names of a package only
NOT_UNDER_TEST = (
    "mrta_falsify/stack/by_sight.py",
    "mrta_falsify/stack/humans.py",
    "mrta_falsify/stack/wall_grid.py",
    "mrta_falsify/stack/fingerprint.py",
)


def layer_of(path: str) -> str:
    """Name the layer of a file; empty if several share it or it is not of the stack."""
    known = [prefix for prefix in LAYERS if path.startswith(prefix)]
    return LAYERS[max(known, key=len)] if known else ""


def stack_files(root: Path) -> tuple[str, ...]:
    """List the files that make up the stack under test, relative to ``root``, sorted."""
    found = set()
    for prefix in LAYERS:
        place = root / prefix
        files = place.rglob("*.py") if place.is_dir() else [place]
        found |= {file.relative_to(root).as_posix() for file in files if file.is_file()}
    left_out = {path for path in found if path in NOT_UNDER_TEST or path.endswith("__init__.py")}
    return tuple(sorted(found - left_out))
