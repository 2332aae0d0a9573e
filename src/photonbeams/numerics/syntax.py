"""Loops and branches on arrays, written in Python's own syntax."""

from __future__ import annotations

import ast
from typing import Any, TypeVar

import drjit as dr
import drjit.ast

T = TypeVar("T")

_Base: Any = vars(drjit.ast)["_SyntaxVisitor"]


class _Visitor(_Base):  # type: ignore[misc]
    """Dr.Jit's transformation; what a loop or branch only reads is no part of its state."""

    def rewrite_and_track(self, node: Any) -> Any:
        test, hints = self.extract_hints(node.test)
        if not hints.keys() & {"include", "exclude"}:
            read = {each.id for each in ast.walk(node) if isinstance(each, ast.Name)} - _written(node)
            names: list[ast.expr] = [ast.Name(each, ast.Load()) for each in sorted(read)]
            keywords = [ast.keyword(name, value) for name, value in hints.items()]
            hint = ast.Attribute(ast.Name("dr", ast.Load()), "hint", ast.Load())
            node.test = ast.Call(hint, [test], [*keywords, ast.keyword("exclude", ast.List(names, ast.Load()))])
        return super().rewrite_and_track(node)


def _written(node: ast.AST) -> set[str]:
    """Return the variables that a statement assigns, or parts of which it assigns."""
    result = set()
    for each in ast.walk(node):
        if isinstance(each, ast.Name | ast.Attribute | ast.Subscript) and not isinstance(each.ctx, ast.Load):
            target: ast.AST = each
            while isinstance(target, ast.Attribute | ast.Subscript):
                target = target.value
            if isinstance(target, ast.Name):
                result.add(target.id)
    return result


def syntax(function: T) -> T:
    """Return a function as `drjit.syntax` does, whose loops and branches are recorded faster.

    Dr.Jit takes all variables of a loop for its state. If it finds that some do not change, and have another size, it
    records the loop once more without them: one loop within another is recorded four times. And in every branch it goes
    through the fields of all structs. Here the state has only what is assigned; the rest is simply there.
    """
    module: Any = drjit.ast
    module._SyntaxVisitor = _Visitor
    try:
        result: T = dr.syntax(function)
    finally:
        module._SyntaxVisitor = _Base
    return result
