"""Which lines of the stack run: a mutant changes nothing where its lines are not reached.

Modules are imported with a note of its line before each statement, which costs next to nothing
where a trace function would make a run five times as long. Compiled functions are left as they
are, and what forked processes run is not seen.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType

#: decorators that leave a function to Python
PLAIN_MARKS = (
    *("abstractmethod", "cache", "cached_property", "classmethod", "contextmanager", "lru_cache"),
    *("overload", "override", "property", "setter", "staticmethod", "wraps"),
)
NOTES = "_lines_that_ran"  # name of the set in a watched module


@dataclass(slots=True)
class WatchedFile:
    """One file, and what has run of it."""

    ran: set[int] = field(default_factory=set)  #: first lines of statements
    ends: dict[int, int] = field(default_factory=dict)  #: last line of each statement or header

    def lines(self) -> tuple[int, ...]:
        """List the lines of what has run."""
        ranges = (range(first, self.ends[first] + 1) for first in self.ran)
        return tuple(sorted({line for lines in ranges for line in lines}))


class LineWatch:
    """Imports files with notes; install it before any of them is imported."""

    def __init__(self, root: Path, files: Collection[str]) -> None:
        """Watch files.

        Args:
            root: of the tree that is imported.
            files: relative to it.
        """
        self._paths = {str(root / path): path for path in files}
        self._files = {path: WatchedFile() for path in files}

    def install(self) -> None:
        """Take part in imports from now on."""
        sys.meta_path.insert(0, self)

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """See :class:`importlib.abc.MetaPathFinder`."""
        spec = PathFinder.find_spec(name, path, target)
        if spec is None or spec.origin not in self._paths:
            return None
        spec.loader = _Loader(name, str(spec.origin), self._files[self._paths[spec.origin]])
        return spec

    def clear(self) -> None:
        """Forget what has run."""
        for file in self._files.values():
            file.ran.clear()

    def lines(self) -> dict[str, tuple[int, ...]]:
        """List the lines that have run, by file."""
        found = {path: file.lines() for path, file in self._files.items()}
        return {path: lines for path, lines in found.items() if lines}


class _Loader(SourceFileLoader):
    """Loads a file with notes, never from a cache of bytecode."""

    def __init__(self, name: str, path: str, file: WatchedFile) -> None:
        super().__init__(name, path)
        self._file = file

    def get_code(self, fullname: str) -> CodeType:
        path = self.get_filename(fullname)
        tree = ast.parse(self.get_data(path))
        noted = ast.fix_missing_locations(_Notes(self._file).visit(tree))
        code: CodeType = compile(noted, path, "exec", dont_inherit=True)
        return code

    def exec_module(self, module: ModuleType) -> None:
        module.__dict__[NOTES] = self._file.ran
        super().exec_module(module)


class _Notes(ast.NodeTransformer):
    """Puts a note before each statement of functions that are not compiled."""

    def __init__(self, file: WatchedFile) -> None:
        self._file = file
        self._depth = 0  #: functions around

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Note the statements of a function; leave compiled ones as they are."""
        if is_compiled(node):
            return node
        self._depth += 1
        self.generic_visit(node)
        self._depth -= 1
        return node

    def generic_visit(self, node: ast.AST) -> ast.AST:
        """Note the statements of every block inside a function."""
        super().generic_visit(node)
        if self._depth and not isinstance(node, ast.ClassDef):
            for name in ("body", "orelse", "finalbody"):
                block = getattr(node, name, None)
                if isinstance(block, list):
                    setattr(node, name, self._noted(block))
        return node

    def _noted(self, block: list[ast.stmt]) -> list[ast.stmt]:
        noted: list[ast.stmt] = []
        for statement in block:
            is_text = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
            if not is_text:
                noted.append(self._note(statement))
            noted.append(statement)
        return noted

    def _note(self, statement: ast.stmt) -> ast.stmt:
        inside = getattr(statement, "body", None)
        end = statement.end_lineno or statement.lineno
        if isinstance(inside, list) and inside:
            end = max(statement.lineno, inside[0].lineno - 1)
        self._file.ends[statement.lineno] = max(end, self._file.ends.get(statement.lineno, 0))
        note = ast.parse(f"{NOTES}.add({statement.lineno})").body[0]
        return ast.copy_location(note, statement)


def is_compiled(function: ast.FunctionDef) -> bool:
    """Whether a function may be compiled by numba: it has a mark that is not one of Python's."""
    return any(_name_of(mark) not in PLAIN_MARKS for mark in function.decorator_list)


def _name_of(mark: ast.expr) -> str:
    """Name the last part of a decorator, ``cache`` of ``functools.cache``."""
    called = mark.func if isinstance(mark, ast.Call) else mark
    return called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", "")


def always_runs(lines: Iterable[int], tree: ast.AST) -> bool:
    """Whether some lines of a file cannot be watched: outside functions, or in compiled ones.

    Args:
        lines: their numbers.
        tree: of the file.
    """
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    for line in lines:
        around = [f for f in functions if f.body[0].lineno <= line <= (f.end_lineno or 0)]
        if not around or any(is_compiled(function) for function in around):
            return True
    return False
