"""Scenic's parse of a file, kept for all tests of a process.

Compiling a program parses the whole library anew, which is most of what it costs. A text gives
the same Python syntax tree each time, so the tests parse it once; everything after that runs as
it does for users.
"""

from __future__ import annotations

import ast
import functools
import sys
from typing import Any


class _Known(ast.AST):
    """Stands for the syntax tree of a text that was compiled before."""

    def __init__(self, source: str, filename: str) -> None:
        super().__init__()
        self.key = (source, filename)


def share_parses() -> None:
    """Parse each Scenic file once in this process; does nothing if Scenic is not loaded."""
    translator = sys.modules.get("scenic.syntax.translator")
    sources = sys.modules.get("scenic_worlds.sources")
    if translator is None or sources is None or hasattr(translator, "known_trees"):
        return
    parse, compile_tree = translator.parse_string, translator.compileScenicAST
    trees: dict[tuple[str, str], Any] = {}

    def parse_once(source: str, mode: str, *, filename: str, **options: Any) -> Any:
        if (source, filename) in trees:
            return _Known(source, filename)
        tree = parse(source, mode, filename=filename, **options)
        tree.key = (source, filename)
        return tree

    def compile_once(tree: Any, *, filename: str, **options: Any) -> Any:
        if tree.key not in trees:
            trees[tree.key] = compile_tree(tree, filename=filename, **options)
        python, requirements = trees[tree.key]
        return python, list(requirements)

    translator.known_trees = trees
    translator.parse_string = parse_once
    translator.compileScenicAST = compile_once
    sources._python_imports = functools.cache(sources._python_imports)
