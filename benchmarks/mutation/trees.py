"""Trees of sources: the sound one, and one for each mutant, so that no source is ever touched.

The sound tree is a copy, made once: what is edited meanwhile changes no result. A mutant's tree
links the files of the sound one, caches of compiled code included, and has its own text of the
files that the mutant changes. What numba compiles anew, because a text or one that it imports has
changed, lands beside the sources, and so in that mutant's tree alone.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tomllib
from pathlib import Path

from benchmarks.mutation.mutants import Mutant, mutated_texts
from mrta_falsify.campaigns.code_digest import SUFFIXES
from mrta_falsify.core import codec
from mrta_falsify.core.record import versions

ROOT = Path(__file__).resolve().parents[2]
#: copied once; the first two hold the stack and are linked for each mutant
PACKAGES = ("mrta_falsify", "simulator_interface", "scenic_worlds", "samplers", "reports")
MUTABLE = PACKAGES[:2]


def sound_tree(directory: Path, source: Path = ROOT) -> Path:
    """Copy the sources, with their compiled caches, unless that was done before."""
    tree = directory.resolve() / "sound"
    if tree.is_dir():
        return tree
    unfinished = tree.with_name("sound.part")
    shutil.rmtree(unfinished, ignore_errors=True)
    for package in PACKAGES:
        shutil.copytree(source / package, unfinished / package)  # keeps times, hence caches
    _write_metadata(source / "pyproject.toml", unfinished)
    unfinished.rename(tree)
    return tree


def digest_of(tree: Path) -> str:
    """Hash the sources of a tree, with the versions of what they run on.

    A journal is told by it whose runs it holds. The digest of a campaign's code is of no use here:
    that is of the sources as they are now, and a tree may be older.
    """
    files = sorted(file for file in tree.rglob("*") if file.suffix in SUFFIXES)
    texts = {str(file.relative_to(tree)): _digest_of_file(file) for file in files}
    return codec.digest([versions(), texts])


def _digest_of_file(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _write_metadata(project: Path, tree: Path) -> None:
    """Name the components of a tree, so that they are found whatever is installed."""
    told = tomllib.loads(project.read_text(encoding="utf-8"))["project"]
    name, version = told["name"], told["version"]
    folder = tree / f"{name.replace('-', '_')}-{version}.dist-info"
    folder.mkdir()
    head = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
    (folder / "METADATA").write_text(head, encoding="utf-8")
    lines = []
    for group, entries in told["entry-points"].items():
        lines += [f"[{group}]", *(f"{key} = {value}" for key, value in entries.items()), ""]
    (folder / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")


def mutated_tree(directory: Path, mutant: Mutant) -> Path:
    """Make the tree of a mutant, unless it is there; remove it by :func:`remove_tree`.

    Args:
        directory: of the trees.
        mutant: to apply.

    Raises:
        StaleMutantError: the mutant was made for other sources.
    """
    sound = sound_tree(directory)
    texts = mutated_texts(mutant, sound)
    tree = directory.resolve() / mutant.id
    if tree.is_dir():
        return tree
    unfinished = tree.with_name(f"{mutant.id}.part")
    shutil.rmtree(unfinished, ignore_errors=True)
    for package in MUTABLE:
        shutil.copytree(sound / package, unfinished / package, copy_function=_link)
    for path, text in texts.items():
        file = unfinished / path
        file.unlink()  # a link: writing into it would change the sound tree
        file.write_text(text, encoding="utf-8")
        for cache in (file.parent / "__pycache__").glob(f"{file.stem}.*.pyc"):
            cache.unlink()
    unfinished.rename(tree)
    return tree


def remove_tree(directory: Path, mutant: Mutant) -> None:
    """Remove the tree of a mutant, its compiled code with it."""
    shutil.rmtree(directory.resolve() / mutant.id, ignore_errors=True)


def search_path(directory: Path, tree: Path) -> str:
    """Write the ``PYTHONPATH`` of a process that runs the stack of a tree."""
    places = dict.fromkeys((tree, sound_tree(directory), ROOT))
    return os.pathsep.join(map(str, places))


def _link(source: str, target: str) -> None:
    try:
        os.link(source, target)
    except OSError:  # a file system without links
        shutil.copy2(source, target)
