"""Figures of the code and the documents: how large the rooms are, and what is said twice.

    python tools/house_figures.py [DIRECTORY] [--list]

Counts the five packages of the product. A function's lines leave out its docstring. A name is
defined twice if two modules define it in public. ``--list`` names the offenders.
"""

from __future__ import annotations

import argparse
import ast
import collections
import json
import re
import statistics
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

PACKAGES = ("mrta_falsify", "scenic_worlds", "simulator_interface", "samplers", "reports")
WINDOW = 6  # lines that make a duplicate
LONG_SENTENCE = 30  # words
WIDE = 100  # columns
MOST_PARAMETERS = 8


class Function(NamedTuple):
    """One function of the product."""

    where: str
    lines: int
    parameters: int
    keyword_only: int


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("directory", type=Path, nargs="?", default=Path(__file__).parent.parent)
    parser.add_argument("--list", action="store_true", help="name the offenders, too")
    options = parser.parse_args()
    root = options.directory
    files = sorted(path for package in PACKAGES for path in (root / package).rglob("*.py"))
    sizes = sorted(len(path.read_text().splitlines()) for path in files)
    functions = [one for path in files for one in functions_of(path, root)]
    lengths = sorted(one.lines for one in functions)
    patterns = ("*.md", "docs/**/*.md", "examples/**/*.md", "tests/*.md")
    pages = sorted(page for pattern in patterns for page in root.glob(pattern))
    wide = [where for page in pages for where in wide_lines(page, root)]
    long = [text for page in pages for text in long_sentences(page, root)]
    complex_ = complex_functions(root)
    twice = modules_twice(files)
    names = names_twice(files, root)
    crowded = [one for one in functions if one.parameters > MOST_PARAMETERS]
    positional = [one for one in crowded if one.parameters - one.keyword_only > MOST_PARAMETERS]
    rows = [
        ("modules", len(files)),
        ("lines", sum(sizes)),
        (
            "module median / p90 / largest",
            f"{statistics.median(sizes):g} / {p90(sizes)} / {sizes[-1]}",
        ),
        ("functions", len(functions)),
        (
            "function median / p90 / longest",
            f"{statistics.median(lengths):g} / {p90(lengths)} / {lengths[-1]}",
        ),
        ("functions over 40 / over 60 lines", f"{over(lengths, 40)} / {over(lengths, 60)}"),
        (
            f"functions over {MOST_PARAMETERS} parameters / of them positional",
            f"{len(crowded)} / {len(positional)}",
        ),
        ("complexity over 10 (ruff C901)", len(complex_)),
        (f"pairs of places that share {WINDOW} lines", len(duplicates(files, root))),
        ("module names used twice", len(twice)),
        ("public names defined twice", len(names)),
        (f"sentences over {LONG_SENTENCE} words in documents", len(long)),
        (f"lines over {WIDE} columns in documents", len(wide)),
    ]
    for name, value in rows:
        print(f"{name:52} {value}")
    if options.list:
        for path in files:
            size = len(path.read_text().splitlines())
            if size > 400:
                print(f"module {path.relative_to(root)}: {size} lines")
        for one in functions:
            if one.lines > 60 or one in positional:
                print(f"{one.where}: {one.lines} lines, {one.parameters} parameters")
        print(*complex_, *twice, *names, *wide, *long, sep="\n")


def p90(values: list[int]) -> int:
    """The ninetieth percentile of sorted values."""
    return values[int(0.9 * (len(values) - 1))]


def over(values: list[int], limit: int) -> int:
    """How many values are larger than a limit."""
    return sum(value > limit for value in values)


def functions_of(path: Path, root: Path) -> Iterator[Function]:
    """Every function and method of a module."""
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        body = node.body
        lines = node.end_lineno - node.lineno + 1
        if ast.get_docstring(node) is not None:
            lines -= body[0].end_lineno - body[0].lineno + 1
        taken = node.args
        named = [
            one.arg for one in (*taken.posonlyargs, *taken.args) if one.arg not in ("self", "cls")
        ]
        yield Function(
            where=f"{path.relative_to(root)}:{node.lineno} {node.name}",
            lines=lines,
            parameters=len(named) + len(taken.kwonlyargs),
            keyword_only=len(taken.kwonlyargs),
        )


def complex_functions(root: Path) -> list[str]:
    """Functions that ruff calls too complex."""
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "ruff",
            "check",
            "--isolated",
            "--select",
            "C901",
            "--config",
            "lint.mccabe.max-complexity=10",
            "--output-format",
            "json",
            *PACKAGES,
        ],
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
    )
    return [
        f"{Path(row['filename']).name}:{row['location']['row']} {row['message']}"
        for row in json.loads(done.stdout)
    ]


def duplicates(files: list[Path], root: Path) -> set[tuple[str, str]]:
    """Pairs of files, or a file with itself, that share a run of lines; one a pair."""
    seen: dict[tuple[str, ...], list[tuple[str, int]]] = collections.defaultdict(list)
    for path in files:
        name = str(path.relative_to(root))
        code = [
            line.strip()
            for line in path.read_text().splitlines()
            if re.search(r"\w", line) and not re.match(r"\s*(#|from |import )", line)
        ]
        for i in range(len(code) - WINDOW + 1):
            seen[tuple(code[i : i + WINDOW])].append((name, i))
    pairs = set()
    for places in seen.values():
        for i, (name, at) in enumerate(places):
            for other, there in places[:i]:
                if name != other or abs(at - there) >= WINDOW:
                    pairs.add((min(name, other), max(name, other)))
    return pairs


def modules_twice(files: list[Path]) -> list[str]:
    """Module names that stand in more than one folder."""
    stems = collections.Counter(path.stem for path in files if not path.stem.startswith("__"))
    return [f"module {stem}: {count} times" for stem, count in sorted(stems.items()) if count > 1]


def names_twice(files: list[Path], root: Path) -> list[str]:
    """Public classes and functions that more than one module defines."""
    homes = collections.defaultdict(list)
    for path in files:
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                homes[node.name].append(str(path.relative_to(root)))
    return [f"name {name}: {', '.join(at)}" for name, at in sorted(homes.items()) if len(at) > 1]


def _prose(page: Path) -> str:
    return re.sub(r"```.*?```", "\n\n", page.read_text(), flags=re.DOTALL)


def wide_lines(page: Path, root: Path) -> list[str]:
    """Lines of a page that are wider than they may be; tables and bare links have no choice."""
    return [
        f"{page.relative_to(root)}:{number}: {len(line)} columns"
        for number, line in enumerate(page.read_text().splitlines(), 1)
        if len(line) > WIDE and not line.lstrip().startswith(("|", "!["))
    ]


def long_sentences(page: Path, root: Path) -> list[str]:
    """Sentences of a page with too many words; a bullet or a table cell ends one."""
    found = []
    for block in re.split(r"\n\s*\n|\n\s*(?:[-*]|\d+\.)\s|\n#+ |\|", _prose(page)):
        text = re.sub(r"`[^`]*`", "x", re.sub(r"\]\([^)]*\)", "]", " ".join(block.split())))
        for sentence in re.split(r"(?<=[.!?])\s+", text):
            words = re.findall(r"[\w'-]*[A-Za-z][\w'-]*", sentence)
            if len(words) > LONG_SENTENCE:
                found.append(f"{page.relative_to(root)}: {len(words)} words: {sentence}")
    return found


if __name__ == "__main__":
    main()
