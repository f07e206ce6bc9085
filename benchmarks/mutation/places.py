"""Every place of a source at which a mutation operator applies, and mutants drawn from them."""

from __future__ import annotations

import ast
import random
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.mutation.layers import layer_of, stack_files
from benchmarks.mutation.lines import always_runs
from benchmarks.mutation.mutants import Edit, Mutant, text_digest
from benchmarks.mutation.operators import Change, changes_at, whole_number

#: functions that only refuse input or write text; a fault in them is not one of behaviour
REFUSING = ("_check", "check_", "__post_init__", "__str__", "__repr__", "_describe", "digest")
#: named arguments that bound or describe an option rather than set it
DESCRIBING = ("low", "high", "above", "below", "unit", "text", "shape", "detail", "where", "strict")


@dataclass(frozen=True, slots=True)
class Source:
    """A file of the stack."""

    path: str
    text: str
    tree: ast.AST


@dataclass(frozen=True, slots=True)
class Slip:
    """One thing that can go wrong at a place."""

    node: ast.AST
    change: Change


@dataclass(frozen=True, slots=True)
class Place:
    """What can be changed at one place of a file."""

    source: Source
    line: int
    column: int
    slips: tuple[Slip, ...]  #: at least one


def places_of(path: str, text: str) -> tuple[Place, ...]:
    """List the places of a file, in the order of the text.

    Args:
        path: of the file in the tree, for the edits.
        text: of the file.
    """
    source = Source(path, text, ast.parse(text))
    found: dict[tuple[int, int], list[Slip]] = {}
    for node in _mutable(source.tree):
        key = (node.lineno, node.col_offset)  # type: ignore[attr-defined]
        for change in changes_at(node):
            found.setdefault(key, []).append(Slip(node, change))
    return tuple(Place(source, *key, tuple(found[key])) for key in sorted(found))


def edit_of(source: Source, slip: Slip) -> Edit | None:
    """Write a change into the text of its file; None if no text of it gives the changed tree."""
    wanted = _changed_dump(source.tree, slip.node, slip.change.node)
    for form in ("{}", "({})"):
        changed = _with_source(source.text, slip.node, slip.change, form)
        try:
            made = ast.dump(ast.parse(changed))
        except SyntaxError:
            continue
        if made == wanted:
            return _lines_between(source.path, source.text, changed)
    return None


def _mutable(tree: ast.AST) -> Iterator[ast.AST]:
    """Walk over the nodes whose change is a fault of behaviour."""
    for child in _children(tree):
        if hasattr(child, "lineno") and not _only_keeps(tree, child):
            yield child
        yield from _mutable(child)


def _only_keeps(parent: ast.AST, node: ast.AST) -> bool:
    """Whether a statement of a constructor only keeps a value: without it, every run fails."""
    return (
        isinstance(parent, ast.FunctionDef)
        and parent.name == "__init__"
        and isinstance(node, ast.Assign | ast.AnnAssign)
    )


def _children(node: ast.AST) -> Iterator[ast.AST]:
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "bases", "type_params"):
            continue
        if isinstance(node, ast.Subscript) and name == "slice":
            yield from (part for part in _parts(node) if whole_number(part) is None)
            continue
        for item in value if isinstance(value, list) else [value]:
            if isinstance(item, ast.AST) and not _is_skipped(item):
                yield item


def _parts(node: ast.Subscript) -> Iterator[ast.AST]:
    """List what an index consists of; numbers in it are the index's own, see ``off by one``."""
    for part in node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]:
        if not isinstance(part, ast.Slice):
            yield part
            continue
        yield from (side for side in (part.lower, part.upper, part.step) if side is not None)


def _is_skipped(node: ast.AST) -> bool:
    """Whether nothing inside a node decides what the stack does."""
    if isinstance(node, ast.Raise | ast.Assert | ast.Import | ast.ImportFrom | ast.JoinedStr):
        return True
    if isinstance(node, ast.FunctionDef):
        return any(mark in node.name for mark in REFUSING)
    if isinstance(node, ast.If):
        only_refuses = len(node.body) == 1 and isinstance(node.body[0], ast.Raise)
        is_for_types = "TYPE_CHECKING" in ast.dump(node.test)
        return is_for_types or (only_refuses and not node.orelse)
    if isinstance(node, ast.keyword):
        return node.arg in DESCRIBING
    if isinstance(node, ast.Assign):
        return any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets)
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _changed_dump(tree: ast.AST, node: ast.AST, new: ast.AST) -> str:
    """Dump the tree as it is with ``new`` instead of ``node``, and leave it as it was."""
    replacer = _Replacer(node, new)
    replacer.put(tree)
    dumped = ast.dump(ast.parse(ast.unparse(tree)))
    replacer.undo()
    return dumped


class _Replacer:
    """Puts one node in the place of another, and back."""

    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self._old, self._new = old, new
        self._undo: tuple[ast.AST, str, int | None] | None = None

    def put(self, tree: ast.AST) -> None:
        for parent in ast.walk(tree):
            for name, value in ast.iter_fields(parent):
                if value is self._old:
                    setattr(parent, name, self._new)
                    self._undo = (parent, name, None)
                    return
                if isinstance(value, list):
                    for i, item in enumerate(value):
                        if item is self._old:
                            value[i] = self._new
                            self._undo = (parent, name, i)
                            return

    def undo(self) -> None:
        if self._undo is None:
            return
        parent, name, i = self._undo
        if i is None:
            setattr(parent, name, self._old)
        else:
            getattr(parent, name)[i] = self._old


def _with_source(text: str, node: ast.AST, change: Change, form: str) -> str:
    """Replace the text of a node; of a compound statement only that of its condition."""
    new = change.node
    if isinstance(node, ast.If | ast.While | ast.IfExp) and isinstance(new, type(node)):
        node, new = node.test, new.test
    lines = text.encode().split(b"\n")
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line) + 1)
    begin = starts[node.lineno - 1] + node.col_offset  # type: ignore[attr-defined]
    end = starts[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]
    raw = text.encode()
    piece = form.format(ast.unparse(ast.fix_missing_locations(new)))
    return (raw[:begin] + piece.encode() + raw[end:]).decode()


def _lines_between(path: str, old: str, new: str) -> Edit:
    """Make the edit of whole lines that turns one text into another."""
    before, after = old.split("\n"), new.split("\n")
    same = 0
    while same < min(len(before), len(after)) and before[same] == after[same]:
        same += 1
    tail = 0
    most = min(len(before), len(after)) - same
    while tail < most and before[len(before) - 1 - tail] == after[len(after) - 1 - tail]:
        tail += 1
    end, new_end = len(before) - tail, len(after) - tail
    if end == same or new_end == same:  # an edit needs a line on both sides
        end, new_end = end + 1, new_end + 1
    return Edit(
        path=path,
        line=same + 1,
        before="\n".join(before[same:end]),
        after="\n".join(after[same:new_end]),
        digest=text_digest(old),
    )


# --- drawing ---------------------------------------------------------------------------------


def draw_mutants(
    root: Path, *, count: int, seed: int, may_change: Mapping[str, Collection[int]] | None = None
) -> tuple[Mutant, ...]:
    """Draw mutants at random: in turn from each layer, and there from a file drawn first.

    Args:
        root: of the tree with the sources.
        count: mutants; fewer come back if there are not so many places.
        seed: same seed and same sources, same mutants.
        may_change: numbers of the lines that run, by path; what cannot be watched may be changed
            as well. Everything may if None.
    """
    draw = random.Random(seed)
    layers: dict[str, dict[str, list[Place]]] = {}
    for path in stack_files(root):
        places = list(places_of(path, (root / path).read_text(encoding="utf-8")))
        if may_change is not None:
            places = [place for place in places if _may_change(place, may_change.get(path, ()))]
        if places:
            layers.setdefault(layer_of(path), {})[path] = places
    drawn: list[Mutant] = []
    while len(drawn) < count and layers:
        for layer in sorted(layers):
            mutant = _draw_one(draw, layers[layer], number=len(drawn))
            if mutant is not None and len(drawn) < count:
                drawn.append(mutant)
            if not layers[layer]:
                del layers[layer]
    return tuple(drawn)


def _may_change(place: Place, lines: Collection[int]) -> bool:
    return place.line in lines or always_runs([place.line], place.source.tree)


def _draw_one(draw: random.Random, files: dict[str, list[Place]], number: int) -> Mutant | None:
    """Take a place from those that are left, and a slip there; None if there is none."""
    while files:
        path = draw.choice(sorted(files))
        places = files[path]
        place = places.pop(draw.randrange(len(places)))
        if not places:
            del files[path]
        operators = sorted({slip.change.operator for slip in place.slips})
        operator = draw.choice(operators)
        slip = draw.choice([slip for slip in place.slips if slip.change.operator == operator])
        edit = edit_of(place.source, slip)
        if edit is not None:
            what = change_in_words(edit)
            layer = layer_of(path)
            return Mutant(
                id=f"m{number:03d}", edits=(edit,), operator=operator, layer=layer, what=what
            )
    return None


def change_in_words(edit: Edit) -> str:
    """Say in a line what an edit changes."""
    return f"{_one_line(edit.before)} -> {_one_line(edit.after)}"


def _one_line(text: str) -> str:
    lines: Sequence[str] = [line.strip() for line in text.split("\n")]
    return " ".join(line for line in lines if line)
