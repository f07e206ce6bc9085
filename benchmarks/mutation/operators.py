"""Mutation operators: what can go wrong with one node of a syntax tree."""

from __future__ import annotations

import ast
import copy
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

#: of a comparison: the neighbouring operator, which differs at the bound only, and the opposite
BOUNDARY: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
}
OPPOSITE: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.Gt,
    ast.LtE: ast.GtE,
    ast.Gt: ast.Lt,
    ast.GtE: ast.LtE,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.BitOr: ast.BitAnd,
    ast.BitAnd: ast.BitOr,
}
#: functions that are taken for their counterparts
COUNTERPARTS = {
    "min": "max",
    "minimum": "maximum",
    "argmin": "argmax",
    "any": "all",
    "floor": "ceil",
    "sin": "cos",
}
SWAPPED = {**COUNTERPARTS, **{there: here for here, there in COUNTERPARTS.items()}}
CONTAINERS = (ast.List, ast.Tuple, ast.Set, ast.JoinedStr)


class Change(NamedTuple):
    """One thing that can go wrong at a node."""

    operator: str  #: name of the mutation operator
    node: ast.AST  #: what stands there instead


def changes_at(node: ast.AST) -> Iterator[Change]:
    """List what can go wrong at a node; the node itself is left as it is."""
    rules: dict[type[ast.AST], Callable[[Any], Iterator[Change]]] = {
        ast.Compare: _comparisons,
        ast.BinOp: _arithmetic,
        ast.AugAssign: _augmented,
        ast.BoolOp: _connectives,
        ast.UnaryOp: _signs,
        ast.Constant: _constants,
        ast.Call: _calls,
        ast.Attribute: _names,
        ast.Name: _names,
        ast.If: _conditions,
        ast.While: _conditions,
        ast.IfExp: _conditions,
        ast.Subscript: _indices,
    }
    rule = rules.get(type(node))
    if rule is not None:
        yield from rule(node)
    if isinstance(node, ast.stmt):
        yield from _deletions(node)


def _comparisons(node: ast.Compare) -> Iterator[Change]:
    for name, table in (("boundary", BOUNDARY), ("comparison", OPPOSITE)):
        for i, op in enumerate(node.ops):
            if type(op) in table:
                changed = copy.deepcopy(node)
                changed.ops[i] = table[type(op)]()
                yield Change(name, changed)


def _arithmetic(node: ast.BinOp) -> Iterator[Change]:
    if isinstance(node.op, ast.Add) and _holds_containers(node.left, node.right):
        return  # a sum of lists or texts
    if type(node.op) in ARITHMETIC:
        changed = copy.deepcopy(node)
        changed.op = ARITHMETIC[type(node.op)]()
        yield Change("arithmetic", changed)


def _augmented(node: ast.AugAssign) -> Iterator[Change]:
    if type(node.op) in ARITHMETIC and not _holds_containers(node.value):
        changed = copy.deepcopy(node)
        changed.op = ARITHMETIC[type(node.op)]()
        yield Change("arithmetic", changed)


def _holds_containers(*nodes: ast.AST) -> bool:
    return any(
        isinstance(node, CONTAINERS)
        or (isinstance(node, ast.Constant) and isinstance(node.value, str))
        for node in nodes
    )


def _connectives(node: ast.BoolOp) -> Iterator[Change]:
    changed = copy.deepcopy(node)
    changed.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
    yield Change("and for or", changed)


def _signs(node: ast.UnaryOp) -> Iterator[Change]:
    if isinstance(node.op, ast.Not):
        yield Change("dropped not", copy.deepcopy(node.operand))
    if isinstance(node.op, ast.USub) and not isinstance(node.operand, ast.Constant):
        yield Change("dropped sign", copy.deepcopy(node.operand))


def _constants(node: ast.Constant) -> Iterator[Change]:
    value = node.value
    if isinstance(value, bool):
        yield Change("constant", ast.Constant(not value))
    elif isinstance(value, int):
        yield Change("constant", ast.Constant(value + 1))
    elif isinstance(value, float):
        yield Change("constant", ast.Constant(2.0 * value if value else 1.0))
        if value:
            yield Change("constant", ast.Constant(0.5 * value))


def _calls(node: ast.Call) -> Iterator[Change]:
    if isinstance(node.func, ast.Name) and node.func.id == "range":
        last = min(len(node.args), 2) - 1
        if last >= 0 and not isinstance(node.args[last], ast.Starred):
            changed = copy.deepcopy(node)
            changed.args[last] = _plus(changed.args[last], -1)
            yield Change("off by one", changed)
    for i, (one, other) in enumerate(zip(node.args, node.args[1:], strict=False)):
        if ast.dump(one) != ast.dump(other) and _may_be_mixed_up(one, other):
            changed = copy.deepcopy(node)
            changed.args[i], changed.args[i + 1] = changed.args[i + 1], changed.args[i]
            yield Change("swapped arguments", changed)


def _may_be_mixed_up(one: ast.expr, other: ast.expr) -> bool:
    """Whether two arguments look alike; others are told apart by any run, and by every reader."""
    return type(one) is type(other) and not isinstance(one, ast.Starred | ast.List | ast.Lambda)


def _names(node: ast.Attribute | ast.Name) -> Iterator[Change]:
    """Take a function for its counterpart, called or passed on."""
    name = node.attr if isinstance(node, ast.Attribute) else node.id
    if name in SWAPPED and isinstance(node.ctx, ast.Load):
        changed = copy.deepcopy(node)
        if isinstance(changed, ast.Attribute):
            changed.attr = SWAPPED[name]
        else:
            changed.id = SWAPPED[name]
        yield Change("counterpart", changed)


def _conditions(node: ast.If | ast.While | ast.IfExp) -> Iterator[Change]:
    """Negate a condition, or never return early.

    A comparison has an opposite of its own, and a ``not`` is dropped elsewhere.
    """
    test = node.test
    if isinstance(node, ast.If) and isinstance(node.body[-1], ast.Return) and not node.orelse:
        never = copy.copy(node)
        never.test = ast.Constant(False)
        yield Change("deleted return", never)
    if isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
        return
    if isinstance(test, ast.Compare) and len(test.ops) == 1:
        return
    changed = copy.copy(node)
    changed.test = ast.UnaryOp(op=ast.Not(), operand=copy.deepcopy(test))
    yield Change("negated condition", changed)


def _indices(node: ast.Subscript) -> Iterator[Change]:
    if not isinstance(node.ctx, ast.Load):
        return
    count = len(node.slice.elts) if isinstance(node.slice, ast.Tuple) else 1
    for i in range(count):
        changed = copy.deepcopy(node)
        part = changed.slice.elts[i] if isinstance(changed.slice, ast.Tuple) else changed.slice
        if isinstance(part, ast.Slice):
            yield from _bounds(node, i)
            continue
        whole = whole_number(part)
        if whole is None:
            continue
        new = ast.Constant(whole + 1 if whole >= 0 else whole - 1)
        if isinstance(changed.slice, ast.Tuple):
            changed.slice.elts[i] = new
        else:
            changed.slice = new
        yield Change("off by one", changed)


def _bounds(node: ast.Subscript, i: int) -> Iterator[Change]:
    """Move a bound of the slice that is part ``i`` of an index."""
    for side in ("lower", "upper"):
        changed = copy.deepcopy(node)
        part = changed.slice.elts[i] if isinstance(changed.slice, ast.Tuple) else changed.slice
        bound = getattr(part, side)
        if bound is not None:
            setattr(part, side, _plus(bound, 1))
            yield Change("off by one", changed)


def whole_number(node: ast.AST) -> int | None:
    """Read a whole number, with its sign; None for anything else."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        value = whole_number(node.operand)
        return None if value is None else -value
    if isinstance(node, ast.Constant) and type(node.value) is int:
        return node.value
    return None


def _plus(node: ast.expr, step: int) -> ast.expr:
    whole = whole_number(node)
    if whole is not None:
        return ast.Constant(whole + step)
    op = ast.Add() if step > 0 else ast.Sub()
    return ast.BinOp(left=copy.deepcopy(node), op=op, right=ast.Constant(abs(step)))


def _deletions(node: ast.stmt) -> Iterator[Change]:
    """Leave a statement out, where what follows still has all its names."""
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        yield Change("deleted call", ast.Pass())
    elif isinstance(node, ast.AugAssign) or (
        isinstance(node, ast.Assign)
        and all(isinstance(target, ast.Attribute | ast.Subscript) for target in node.targets)
    ):
        yield Change("deleted assignment", ast.Pass())
    elif isinstance(node, ast.Break):
        yield Change("deleted break", ast.Continue())
    elif isinstance(node, ast.Continue):
        yield Change("deleted continue", ast.Pass())
