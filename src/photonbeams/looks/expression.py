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

import ast
import difflib
import operator
from collections.abc import Callable
from functools import reduce
from typing import Any, NamedTuple, NoReturn

import drjit as dr

from ..runtime.device import Float
from . import guarded
from .guarded import divided, power, times, truth, vector_type
from .syntax import DEEPEST, EXPECTED, LONGEST, ExpressionError, excerpt, too_deep, tree
from .vocabulary import CONSTANTS, FUNCTIONS, NAMES, NOISE_PARTS, ExpressionFunction, Kind, Parameter, describe

__all__ = [
    "CONSTANTS",
    "DEEPEST",
    "FUNCTIONS",
    "LONGEST",
    "MOST_PARTS",
    "NAMES",
    "ExpressionError",
    "ParsedExpression",
    "describe",
    "parse",
]  # fmt: skip

MOST_PARTS = 1000  # numbers, names, operators and calls; an octave of noise counts as `NOISE_PARTS` of them


class _Operands(NamedTuple):
    """Values from which the parts of an expression are computed, all of one precision."""

    inputs: dict[str, Any]
    numbers: tuple[Any, ...]  # of the text, in order


class _Node(NamedTuple):
    """A checked part of an expression."""

    kind: Kind
    compute: Callable[[_Operands], Any]
    varies: bool = False  # whether it depends on an input


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

    def __init__(self, text: str, part: _Node, names: frozenset[str], numbers: list[float]) -> None:
        self.text, self.kind, self.names = text, part.kind, names
        self._compute = part.compute
        double: Any = dr.float64_array_t(Float)
        self._single = tuple(dr.opaque(Float, number) for number in numbers)
        self._double = tuple(dr.opaque(double, number) for number in numbers)

    def evaluate(self, lookup: Callable[[str], Any]) -> Any:
        """Return the expression's value: a Float or an Array3f, in double precision if an input is.

        Parameters
        ----------
        lookup
            Returns an input's value by its name: a Dr.Jit float, a vector of three, or an integer. It is called once
            for each of `names`. A Python number becomes opaque.
        """
        found = {name: _opaque(lookup(name)) for name in sorted(self.names)}
        double = any(dr.type_v(value) == dr.VarType.Float64 for value in found.values())
        scalar = dr.float64_array_t(Float) if double else Float
        types = {"scalar": scalar, "vector": vector_type(scalar)}
        inputs = {name: guarded.finite(types[NAMES[name].kind](value)) for name, value in found.items()}
        return self._compute(_Operands(inputs, self._double if double else self._single))

    def __repr__(self) -> str:
        return f"Expression({self.text!r})"

    def __eq__(self, other: object) -> bool:
        return self.text == other.text if isinstance(other, ParsedExpression) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.text)

    def __reduce__(self) -> Any:
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
    parser = _Parser(stripped)
    part = parser.part(tree(stripped), 1)
    return ParsedExpression(stripped, part, frozenset(parser.names), parser.numbers)


_OPERATORS: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: times,
    ast.Div: divided,
    ast.Mod: guarded.remainder,
    ast.Pow: power,
}
_COMPARISONS: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_COMPONENTS = {name: index for names in ("xyz", "rgb") for index, name in enumerate(names)}
_STEPS = ("linearstep", "smoothstep", "gaussstep")


class _Parser:
    """One walk over a syntax tree, which checks every node and returns a part for it."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._parts = 0
        self.names: set[str] = set()
        self.numbers: list[float] = []

    def part(self, node: ast.expr, depth: int) -> _Node:
        """Return the checked part of a node, which is `depth` levels down."""
        if depth > DEEPEST:
            self._refuse(node, too_deep())
        self._count(node, 1)
        readers: dict[type[ast.expr], Callable[[Any, int], _Node]] = {
            ast.Constant: self._number,
            ast.Name: self._name,
            ast.UnaryOp: self._sign,
            ast.BinOp: self._operation,
            ast.Compare: self._comparison,
            ast.BoolOp: self._logic,
            ast.IfExp: self._choice,
            ast.List: self._list,
            ast.Attribute: self._component,
            ast.Subscript: self._subscript,
            ast.Call: self._call,
        }
        reader = readers.get(type(node))
        if isinstance(node, ast.Tuple):
            self._refuse(node, "a list in round brackets has no meaning here: expected [x, y, z] for a vector")
        if reader is None:
            self._refuse(node, f"this has no meaning here: {EXPECTED}")
        return reader(node, depth)

    def _refuse(self, node: Any, reason: str) -> NoReturn:
        raise ExpressionError(self._text, node.col_offset + 1, reason)

    def _count(self, node: Any, parts: int) -> None:
        self._parts += parts
        if self._parts > MOST_PARTS:
            self._refuse(
                node,
                f"the expression has too many parts: expected at most {MOST_PARTS} numbers, names, operators and "
                f"calls, where an octave of noise counts as {NOISE_PARTS}",
            )

    def _scalar(self, node: ast.expr, depth: int, what: str) -> _Node:
        part = self.part(node, depth)
        if part.kind == "vector":
            self._refuse(node, f"{what} is a vector: expected a scalar, such as one of its components .x, .y or .z")
        return part

    def _number(self, node: ast.Constant, depth: int) -> _Node:
        if type(node.value) not in (int, float):
            self._refuse(node, f"{node.value!r} is not a number: {EXPECTED}")
        return self._literal(node, node.value)

    def _literal(self, node: Any, value: Any) -> _Node:
        # Compared before it becomes a float: an integer of many digits may be beyond every float.
        if value > guarded.LARGEST:
            self._refuse(node, f"this number is too large: expected at most {guarded.LARGEST:g}")
        index = len(self.numbers)
        self.numbers.append(float(value))
        return _Node("scalar", lambda values: values.numbers[index])

    def _name(self, node: ast.Name, depth: int) -> _Node:
        name = node.id
        if name in CONSTANTS:
            return self._literal(node, CONSTANTS[name])
        if name in FUNCTIONS:
            self._refuse(node, f"{name} is a function: expected {FUNCTIONS[name].signature}")
        if name not in NAMES:
            self._refuse(node, _unknown(name, "a name", [*NAMES, *CONSTANTS], FUNCTIONS))
        self.names.add(name)
        return _Node(NAMES[name].kind, lambda values: values.inputs[name], varies=True)

    def _sign(self, node: ast.UnaryOp, depth: int) -> _Node:
        if isinstance(node.op, ast.Not):
            operand = self._scalar(node.operand, depth + 1, "the operand of not")
            return _Node("scalar", lambda values: _not(operand.compute(values)), operand.varies)
        if not isinstance(node.op, (ast.USub, ast.UAdd)):
            self._refuse(node, f"this operator has no meaning here: {EXPECTED}")
        operand = self.part(node.operand, depth + 1)
        if isinstance(node.op, ast.UAdd):
            return operand
        return operand._replace(compute=lambda values: -operand.compute(values))

    def _operation(self, node: ast.BinOp, depth: int) -> _Node:
        function = _OPERATORS.get(type(node.op))
        if function is None:
            hint = "expected floor(a / b)" if isinstance(node.op, ast.FloorDiv) else "expected + - * / % or **"
            self._refuse(node, f"this operator has no meaning here: {hint}")
        return _applied(function, [self.part(node.left, depth + 1), self.part(node.right, depth + 1)])

    def _comparison(self, node: ast.Compare, depth: int) -> _Node:
        if any(type(each) not in _COMPARISONS for each in node.ops):
            self._refuse(node, "this comparison has no meaning here: expected < <= > >= == or !=")
        functions = [_COMPARISONS[type(each)] for each in node.ops]
        nodes = [node.left, *node.comparators]
        parts = [self._scalar(each, depth + 1, "one side of a comparison") for each in nodes]

        def compute(values: _Operands) -> Any:
            computed = [part.compute(values) for part in parts]
            masks = [function(*computed[k : k + 2]) for k, function in enumerate(functions)]
            return truth(reduce(operator.and_, masks), computed[0])

        return _Node("scalar", compute, any(part.varies for part in parts))

    def _logic(self, node: ast.BoolOp, depth: int) -> _Node:
        word, join = ("and", operator.and_) if isinstance(node.op, ast.And) else ("or", operator.or_)
        parts = [self._scalar(each, depth + 1, f"one side of {word}") for each in node.values]

        def compute(values: _Operands) -> Any:
            computed = [part.compute(values) for part in parts]
            return truth(reduce(join, [each != 0 for each in computed]), computed[0])

        return _Node("scalar", compute, any(part.varies for part in parts))

    def _choice(self, node: ast.IfExp, depth: int) -> _Node:
        condition = self._scalar(node.test, depth + 1, "the condition")
        first, second = self.part(node.body, depth + 1), self.part(node.orelse, depth + 1)
        return _call(FUNCTIONS["select"], [condition, first, second])

    def _list(self, node: ast.List, depth: int) -> _Node:
        if len(node.elts) != 3:
            count = f"{len(node.elts)} component{'' if len(node.elts) == 1 else 's'}"
            self._refuse(node, f"a vector has {count}: expected three, as in [1, 0.5, s]")
        parts = [self._scalar(each, depth + 1, "a component of a vector") for each in node.elts]
        return _call(FUNCTIONS["vec"], parts)

    def _component(self, node: ast.Attribute, depth: int) -> _Node:
        if node.attr not in _COMPONENTS:
            self._refuse(node, f".{node.attr} is not a component: expected .x, .y, .z, .r, .g or .b")
        return self._indexed(node.value, depth, _COMPONENTS[node.attr])

    def _subscript(self, node: ast.Subscript, depth: int) -> _Node:
        index = node.slice
        if not (isinstance(index, ast.Constant) and type(index.value) is int and 0 <= index.value <= 2):
            self._refuse(index, "this is not the number of a component: expected [0], [1] or [2]")
        return self._indexed(node.value, depth, index.value)

    def _indexed(self, node: ast.expr, depth: int, index: int) -> _Node:
        part = self.part(node, depth + 1)
        if part.kind == "scalar":
            self._refuse(node, "a scalar has no components: expected a vector here")
        return _Node("scalar", lambda values: part.compute(values)[index], part.varies)

    def _call(self, node: ast.Call, depth: int) -> _Node:
        if not isinstance(node.func, ast.Name):
            self._refuse(node, "this is not the name of a function: expected a call such as clamp(s, 0, 1)")
        name = node.func.id
        if name in NAMES or name in CONSTANTS:
            self._refuse(node, f"{name} is not a function: expected {name} without brackets after it")
        if name not in FUNCTIONS:
            self._refuse(node, _unknown(name, "a function", list(FUNCTIONS), NAMES))
        function = FUNCTIONS[name]
        given = self._arguments(node, function)
        arguments = [
            self._argument(function, parameter, argument, depth + 1)
            for parameter, argument in zip(function.parameters, given, strict=True)
        ]
        octaves = [value for value, each in zip(arguments, function.parameters, strict=True) if each.name == "octaves"]
        self._count(node, function.parts * (octaves[0] if octaves else 1) - 1)
        if name in _STEPS and [each.varies for each in arguments] == [True, False, False]:
            self._refuse(node, f"{name} has its varying argument first: expected its edges first, {function.signature}")
        return _call(function, arguments)

    def _arguments(self, node: ast.Call, function: ExpressionFunction) -> list[ast.expr | None]:
        """Return the arguments' nodes in the order of the parameters; None for those that are left out."""
        least, most = function.arity
        names = [each.name for each in function.parameters]
        given: dict[str, ast.expr] = dict(zip(names, node.args, strict=False))
        for keyword in node.keywords:
            optional = [each.name for each in function.parameters if each.optional]
            if keyword.arg is None:
                self._refuse(keyword, f"** has no meaning here: expected {function.signature}")
            if keyword.arg not in optional:
                expected = f"one of {', '.join(optional)}" if optional else function.signature
                self._refuse(keyword, f"{function.name} has no optional argument {keyword.arg}: expected {expected}")
            if keyword.arg in given:
                self._refuse(keyword, f"{keyword.arg} is given twice: expected it once")
            given[keyword.arg] = keyword.value
        if len(node.args) > most or any(name not in given for name in names[:least]):
            count = f"{len(node.args)} argument{'' if len(node.args) == 1 else 's'}"
            self._refuse(node, f"{function.name} has {count}: expected {function.signature}")
        return [given.get(name) for name in names]

    def _argument(self, function: ExpressionFunction, parameter: Parameter, node: ast.expr | None, depth: int) -> Any:
        """Return an argument: a part, an int for a whole number, or None if it is left out and has no default."""
        default = parameter.default
        if parameter.kind == "whole":
            return self._whole(parameter, node) if node is not None else int(default or 0)
        if node is None:
            return None if default is None else _Node("scalar", lambda values: default)
        what = f"{function.name}'s {parameter.name}"
        if parameter.kind == "scalar":
            return self._scalar(node, depth, what)
        part = self.part(node, depth)
        if parameter.kind == "vector" and part.kind == "scalar":
            self._refuse(node, f"{what} is a scalar: expected a vector, such as P or [x, y, z]")
        return part

    def _whole(self, parameter: Parameter, node: ast.expr) -> int:
        value = node.value if isinstance(node, ast.Constant) else None
        if type(value) is not int or not parameter.least <= value <= parameter.most:
            given = excerpt(self._text[node.col_offset : node.end_col_offset], 1)
            expected = f"expected a whole number from {parameter.least} to {parameter.most}, written out"
            self._refuse(node, f"{parameter.name} is {given}: {expected}")
        return value


def _call(function: ExpressionFunction, arguments: list[Any]) -> _Node:
    """Return the part of a call with checked arguments: parts, whole numbers, and None."""
    mixed = function.result == "any"
    broadcast = [k for k, each in enumerate(function.parameters) if each.kind == "any" and mixed]
    vector = any(arguments[k].kind == "vector" for k in broadcast)

    def compute(values: _Operands) -> Any:
        computed = [each.compute(values) if isinstance(each, _Node) else each for each in arguments]
        if vector:
            for k in broadcast:
                computed[k] = _as_vector(computed[k])
        return function.compute(*computed)

    kind: Kind = "vector" if vector or function.result == "vector" else "scalar"
    return _Node(kind, compute, any(each.varies for each in arguments if isinstance(each, _Node)))


def _applied(function: Callable[..., Any], parts: list[_Node]) -> _Node:
    """Return the part of an operator between parts, component by component if one of them is a vector."""
    parameters = tuple(Parameter(name) for name in "ab")
    return _call(ExpressionFunction("", parameters, "any", "", function), parts)


def _as_vector(value: Any) -> Any:
    return value if dr.depth_v(value) > 1 else vector_type(value)(value, value, value)


def _not(value: Any) -> Any:
    return truth(value == 0, value)


def _unknown(name: str, what: str, expected: list[str], others: Any) -> str:
    """Return the reason of the error for an unknown name, with the most similar known name."""
    by_case = {each.lower(): each for each in (*others, *expected)}
    near = difflib.get_close_matches(name.lower(), by_case, n=1)
    hint = f"; did you mean {by_case[near[0]]}?" if near else ""
    shown = name if len(name) <= 40 else f"{name[:40]}…"
    return f"{shown} is not {what}: expected one of {', '.join(expected)}{hint}"
