"""The parser of expressions: it checks a syntax tree and returns functions that compute its value."""

from __future__ import annotations

import ast
import difflib
import operator
from collections.abc import Callable, Iterable
from functools import reduce
from itertools import pairwise
from typing import Any, NamedTuple, NoReturn

import drjit as dr

from . import guarded
from .guarded import Operand, divided, power, times, truth, vector_type
from .syntax import DEEPEST, EXPECTED, ExpressionError, excerpt, too_deep
from .vocabulary import CONSTANTS, FUNCTIONS, NAMES, NOISE_PARTS, ExpressionFunction, Kind, Parameter

MOST_PARTS = 1000  # numbers, names, operators and calls; an octave of noise counts as `NOISE_PARTS` of them


class Operands(NamedTuple):
    """Values from which the parts of an expression are computed, all of one precision."""

    inputs: dict[str, Any]
    numbers: tuple[Any, ...]  # of the text, in order


class Node(NamedTuple):
    """A checked part of an expression."""

    kind: Kind
    compute: Callable[[Operands], Any]
    varies: bool = False  # whether it depends on an input


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


class Parser:
    """One walk over a syntax tree, which checks every node and returns a part for it.

    A node is read by the method with the name of its class, as by Python's `ast.NodeVisitor`.
    """

    def __init__(self, text: str) -> None:
        self._text = text
        self._parts = 0
        self.names: set[str] = set()
        self.numbers: list[float] = []

    def part(self, node: ast.expr, depth: int) -> Node:
        """Return the checked part of a node, which is `depth` levels down."""
        if depth > DEEPEST:
            self._refuse(node, too_deep())
        self._count(node, 1)
        reader: Callable[[Any, int], Node] | None = getattr(self, f"_{type(node).__name__.lower()}", None)
        if reader is None:
            self._refuse(node, f"this has no meaning here: {EXPECTED}")
        return reader(node, depth)

    def _refuse(self, node: ast.expr | ast.keyword, reason: str) -> NoReturn:
        raise ExpressionError(self._text, node.col_offset + 1, reason)

    def _count(self, node: ast.expr, parts: int) -> None:
        self._parts += parts
        if self._parts > MOST_PARTS:
            self._refuse(
                node,
                f"the expression has too many parts: expected at most {MOST_PARTS} numbers, names, operators and "
                f"calls, where an octave of noise counts as {NOISE_PARTS}",
            )

    def _scalar(self, node: ast.expr, depth: int, what: str) -> Node:
        part = self.part(node, depth)
        if part.kind == "vector":
            self._refuse(node, f"{what} is a vector: expected a scalar, such as one of its components .x, .y or .z")
        return part

    def _constant(self, node: ast.Constant, depth: int) -> Node:
        if type(node.value) not in (int, float):
            self._refuse(node, f"{node.value!r} is not a number: {EXPECTED}")
        return self._literal(node, node.value)

    def _literal(self, node: ast.expr, value: Any) -> Node:
        # Compared before it becomes a float: an integer of many digits may be beyond every float.
        if value > guarded.LARGEST:
            self._refuse(node, f"this number is too large: expected at most {guarded.LARGEST:g}")
        index = len(self.numbers)
        self.numbers.append(float(value))
        return Node("scalar", lambda values: values.numbers[index])

    def _name(self, node: ast.Name, depth: int) -> Node:
        name = node.id
        if name in CONSTANTS:
            return self._literal(node, CONSTANTS[name])
        if name in FUNCTIONS:
            self._refuse(node, f"{name} is a function: expected {FUNCTIONS[name].signature}")
        if name not in NAMES:
            self._refuse(node, _unknown(name, "a name", [*NAMES, *CONSTANTS], FUNCTIONS))
        self.names.add(name)
        return Node(NAMES[name].kind, lambda values: values.inputs[name], varies=True)

    def _unaryop(self, node: ast.UnaryOp, depth: int) -> Node:
        if isinstance(node.op, ast.Not):
            operand = self._scalar(node.operand, depth + 1, "the operand of not")
            return _computed(lambda value: truth(value == 0, value), [operand])
        if not isinstance(node.op, (ast.USub, ast.UAdd)):
            self._refuse(node, f"this operator has no meaning here: {EXPECTED}")
        operand = self.part(node.operand, depth + 1)
        if isinstance(node.op, ast.UAdd):
            return operand
        return operand._replace(compute=lambda values: -operand.compute(values))

    def _binop(self, node: ast.BinOp, depth: int) -> Node:
        function = _OPERATORS.get(type(node.op))
        if function is None:
            hint = "expected floor(a / b)" if isinstance(node.op, ast.FloorDiv) else "expected + - * / % or **"
            self._refuse(node, f"this operator has no meaning here: {hint}")
        return _applied(function, [self.part(node.left, depth + 1), self.part(node.right, depth + 1)])

    def _compare(self, node: ast.Compare, depth: int) -> Node:
        if any(type(each) not in _COMPARISONS for each in node.ops):
            self._refuse(node, "this comparison has no meaning here: expected < <= > >= == or !=")
        functions = [_COMPARISONS[type(each)] for each in node.ops]
        nodes = [node.left, *node.comparators]
        parts = [self._scalar(each, depth + 1, "one side of a comparison") for each in nodes]

        def compared(*values: Operand) -> Operand:
            masks = [function(*pair) for function, pair in zip(functions, pairwise(values), strict=True)]
            return truth(reduce(operator.and_, masks), values[0])

        return _computed(compared, parts)

    def _boolop(self, node: ast.BoolOp, depth: int) -> Node:
        word, join = ("and", operator.and_) if isinstance(node.op, ast.And) else ("or", operator.or_)
        parts = [self._scalar(each, depth + 1, f"one side of {word}") for each in node.values]

        def joined(*values: Operand) -> Operand:
            return truth(reduce(join, [each != 0 for each in values]), values[0])

        return _computed(joined, parts)

    def _ifexp(self, node: ast.IfExp, depth: int) -> Node:
        condition = self._scalar(node.test, depth + 1, "the condition")
        first, second = self.part(node.body, depth + 1), self.part(node.orelse, depth + 1)
        return _call(FUNCTIONS["select"], [condition, first, second])

    def _tuple(self, node: ast.Tuple, _: int) -> NoReturn:
        self._refuse(node, "a list in round brackets has no meaning here: expected [x, y, z] for a vector")

    def _list(self, node: ast.List, depth: int) -> Node:
        if len(node.elts) != 3:
            count = f"{len(node.elts)} component{'' if len(node.elts) == 1 else 's'}"
            self._refuse(node, f"a vector has {count}: expected three, as in [1, 0.5, s]")
        parts = [self._scalar(each, depth + 1, "a component of a vector") for each in node.elts]
        return _call(FUNCTIONS["vec"], parts)

    def _attribute(self, node: ast.Attribute, depth: int) -> Node:
        if node.attr not in _COMPONENTS:
            self._refuse(node, f".{node.attr} is not a component: expected .x, .y, .z, .r, .g or .b")
        return self._indexed(node.value, depth, _COMPONENTS[node.attr])

    def _subscript(self, node: ast.Subscript, depth: int) -> Node:
        index = node.slice
        if not (isinstance(index, ast.Constant) and type(index.value) is int and 0 <= index.value <= 2):
            self._refuse(index, "this is not the number of a component: expected [0], [1] or [2]")
        return self._indexed(node.value, depth, index.value)

    def _indexed(self, node: ast.expr, depth: int, index: int) -> Node:
        part = self.part(node, depth + 1)
        if part.kind == "scalar":
            self._refuse(node, "a scalar has no components: expected a vector here")
        return Node("scalar", lambda values: part.compute(values)[index], part.varies)

    def _call(self, node: ast.Call, depth: int) -> Node:
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
            return None if default is None else Node("scalar", lambda values: default)
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


def _call(function: ExpressionFunction, arguments: list[Any]) -> Node:
    """Return the part of a call with checked arguments: parts, whole numbers, and None."""
    mixed = function.result == "any"
    broadcast = [k for k, each in enumerate(function.parameters) if each.kind == "any" and mixed]
    vector = any(arguments[k].kind == "vector" for k in broadcast)

    def compute(values: Operands) -> Operand:
        computed = [each.compute(values) if isinstance(each, Node) else each for each in arguments]
        if vector:
            for k in broadcast:
                computed[k] = _as_vector(computed[k])
        return function.compute(*computed)

    kind: Kind = "vector" if vector or function.result == "vector" else "scalar"
    return Node(kind, compute, any(each.varies for each in arguments if isinstance(each, Node)))


def _computed(function: Callable[..., Operand], parts: list[Node]) -> Node:
    """Return the part of a scalar that is computed from scalar parts."""
    return Node(
        "scalar", lambda values: function(*(part.compute(values) for part in parts)), any(part.varies for part in parts)
    )


def _applied(function: Callable[..., Operand], parts: list[Node]) -> Node:
    """Return the part of an operator between parts, component by component if one of them is a vector."""
    parameters = tuple(Parameter(name) for name in "ab")
    return _call(ExpressionFunction("", parameters, "any", "", function), parts)


def _as_vector(value: Operand) -> Operand:
    return value if dr.depth_v(value) > 1 else vector_type(value)(value, value, value)


def _unknown(name: str, what: str, expected: list[str], others: Iterable[str]) -> str:
    """Return the reason of the error for an unknown name, with the most similar known name."""
    by_case = {each.lower(): each for each in (*others, *expected)}
    near = difflib.get_close_matches(name.lower(), by_case, n=1)
    hint = f"; did you mean {by_case[near[0]]}?" if near else ""
    shown = name if len(name) <= 40 else f"{name[:40]}…"
    return f"{shown} is not {what}: expected one of {', '.join(expected)}{hint}"
