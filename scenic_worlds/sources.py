"""Which files a Scenic program is made of, and one digest of them all.

Scenic's own hash covers the top-level file only; an edit of an imported file would go
unnoticed.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import re
from pathlib import Path
from typing import Any

from mrta_falsify.core import codec
from mrta_falsify.core.world import World

ENDINGS = (".scenic", ".sc", ".py")
#: imports of a Scenic file; its grammar is not Python's, so they are found by their form
_IMPORT = re.compile(r"^[ \t]*(?:model|import|from)[ \t]+([.\w, \t]+)", re.MULTILINE)
OWN_PACKAGE = "scenic_worlds"


def source_files(path: Path) -> tuple[Path, ...]:
    """List the program's file and all it imports from beside it or from the library, sorted.

    Args:
        path: of the program.
    """
    folder = path.resolve().parent
    found: set[Path] = set()
    waiting = [path.resolve()]
    while waiting:
        file = waiting.pop()
        if file in found:
            continue
        found.add(file)
        for name in _imported_names(file):
            waiting.extend(_files_of(name, file.parent, folder))
    return tuple(sorted(found))


def sources_digest(path: Path, layout: Any) -> str:
    """Digest (sha256) the program's files and, unless it is random, its layout.

    Args:
        path: of the program.
        layout: the world of its layout; anything else is not covered.
    """
    digest = hashlib.sha256()
    top = path.resolve()
    for file in (top, *(f for f in source_files(path) if f != top)):
        content = file.read_bytes()
        digest.update(f"{file.name} {len(content)}\n".encode() + content)
    if isinstance(layout, World):
        digest.update(codec.digest(layout).encode())
    return digest.hexdigest()


def _imported_names(file: Path) -> set[str]:
    """List dotted names that a file may import; relative ones keep their leading dots."""
    text = file.read_text(encoding="utf-8", errors="replace")
    if file.suffix == ".py":
        return _python_imports(text)
    names: set[str] = set()
    for match in _IMPORT.finditer(text):
        for part in match[1].split(","):
            words = part.split()
            if words:
                names.add(words[0])
    return names


def _python_imports(text: str) -> set[str]:
    try:
        tree = ast.parse(text)
    except SyntaxError:
        return set()
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            stem = "." * node.level + (node.module or "")
            names.add(stem)
            separator = "" if stem.endswith(".") else "."
            names.update(f"{stem}{separator}{alias.name}" for alias in node.names)
    return names


def _files_of(name: str, here: Path, top: Path) -> list[Path]:
    """Find the files of a module of the library, or beside the program."""
    parts = [part for part in name.split(".") if part]
    if not parts:
        return []
    folders = [here, top]
    if parts[0] == OWN_PACKAGE:
        spec = importlib.util.find_spec(OWN_PACKAGE)
        places = list(spec.submodule_search_locations or ()) if spec else []
        folders, parts = [Path(place) for place in places], parts[1:]
    found = []
    for folder in folders:
        base = folder.joinpath(*parts)
        candidates = [base.with_name(base.name + ending) for ending in ENDINGS] if parts else []
        candidates.append(base / "__init__.py")
        found += [file.resolve() for file in candidates if file.is_file()]
    return found
