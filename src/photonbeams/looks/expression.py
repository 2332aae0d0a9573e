"""One-line expressions of artists, such as `smoothstep(0, 0.2, s) * fbm(3 * P, time=time)`, as Dr.Jit values.

Python's `ast` parses the text, and a walk over the syntax tree accepts only known nodes; the text is never run. The
language has:

- Numbers, and the inputs, constants and functions of `vocabulary`.
- `+ - * / % **`, comparisons (also chained), `and`, `or`, `not`, `a if condition else b`. True is 1, false is 0, and
  every number except 0 is true. `%` has the sign of its right side.
- Vectors and colours `[x, y, z]`; components `.x .y .z`, `.r .g .b`, `[0] [1] [2]`. A scalar beside a vector counts as
  a vector of three equal components.

Whether a value is a scalar or a vector is checked when the text is parsed. Every number of the text is an opaque Dr.Jit
value, so that changing it does not recompile a kernel; the number of octaves of a noise is part of the kernel.

The value of an expression is always finite, by the rules of `guarded`. Infinite inputs count as the largest number,
±10¹⁸, and inputs that are not a number count as 0.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr

from ..runtime.device import Float
from . import guarded
from .guarded import Operand, vector_type
from .parser import Node, Operands, Parser
from .syntax import tree
from .vocabulary import NAMES, describe

__all__ = ["ParsedExpression", "describe", "parse"]


class ParsedExpression:
    """A parsed expression; `parse` makes it. Expressions of equal text are equal.

    Attributes
    ----------
    text
        The text, without white space around it.
    kind
        Kind of the value, "scalar" or "vector".
    names
        Names of the inputs that it uses.
    """

    __slots__ = ("_compute", "_double", "_single", "kind", "names", "text")

    def __init__(self, text: str, part: Node, names: frozenset[str], numbers: list[float]) -> None:
        self.text, self.kind, self.names = text, part.kind, names
        self._compute = part.compute
        double: Any = dr.float64_array_t(Float)
        self._single = tuple(dr.opaque(Float, number) for number in numbers)
        self._double = tuple(dr.opaque(double, number) for number in numbers)

    def evaluate(self, lookup: Callable[[str], Operand | float]) -> Operand:
        """Return the expression's value: a Float or an Array3f, in double precision if an input is.

        Parameters
        ----------
        lookup
            Returns an input's value by its name: a Dr.Jit float, a vector of three, or an integer. It is called once
            for each of `names`. A Python number becomes opaque.
        """
        found = {name: _opaque(lookup(name)) for name in sorted(self.names)}
        double = any(dr.type_v(value) == dr.VarType.Float64 for value in found.values())
        scalar: Any = dr.float64_array_t(Float) if double else Float
        types = {"scalar": scalar, "vector": vector_type(scalar)}
        inputs = {name: guarded.finite(types[NAMES[name].kind](value)) for name, value in found.items()}
        return self._compute(Operands(inputs, self._double if double else self._single))

    def __repr__(self) -> str:
        return f"Expression({self.text!r})"

    def __eq__(self, other: object) -> bool:
        return self.text == other.text if isinstance(other, ParsedExpression) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.text)

    def __reduce__(self) -> tuple[Callable[[str], ParsedExpression], tuple[str]]:
        return parse, (self.text,)


def _opaque(value: Any) -> Any:
    if dr.is_array_v(value):
        return value
    return dr.opaque(Float, float(value))


def parse(text: str) -> ParsedExpression:
    """Return the expression that a text holds.

    Raises
    ------
    ExpressionError
        If the text is not an expression; the error names the column, and what was expected there.
    """
    stripped = text.strip()
    parser = Parser(stripped)
    part = parser.part(tree(stripped), 1)
    return ParsedExpression(stripped, part, frozenset(parser.names), parser.numbers)
