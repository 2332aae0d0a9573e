"""Count what the source contains, and check that no number grows unnoticed; `make lint` calls it.

Usage: python tools/budget.py, which compares the numbers with those of tools/budget.toml, and fails if one is higher;
python tools/budget.py --write, which lowers numbers of the file that have fallen, and writes the file if there is none;
or python tools/budget.py --list KIND, which prints the places that one number counts.

Numbers of tokens and modules are by room, which is a package or module right under src/photonbeams; Blender's extension
is a room of its own. All other numbers are of the whole without that extension, which is a program by itself.
"""

from __future__ import annotations

import argparse
import ast
import gc
import io
import sys
import token
import tokenize
import tomllib
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

ROOT = Path(__file__).parents[1]
#: The package that is counted, and the file with its numbers, in a repository.
SOURCE = Path("src/photonbeams")
FILE = Path("tools/budget.toml")

#: The folder of SOURCE that is a room of its own, and the name of that room.
EXTENSION = Path("blender/extension")
EXTENSION_ROOM = "blender-extension"
#: What the numbers of the whole are under.
WHOLE = "whole"

#: The types of tokens that are code, as tinygrad's sz.py counts.
CODE = {token.NAME, token.NUMBER, token.STRING, token.OP}
#: Those between which Python 3.12 and later divide an f-string.
OPENING = {number for number, name in token.tok_name.items() if name.endswith("STRING_START")}
CLOSING = {number for number, name in token.tok_name.items() if name.endswith("STRING_END")}
#: The most positional arguments of a call that is not counted.
MOST_POSITIONAL = 4
#: The most elements of a result that is a tuple and not counted.
MOST_ELEMENTS = 2

#: What the file says above its numbers.
HEAD = f"""\
# The size of {SOURCE}, which `make lint` checks with tools/budget.py: no number may be higher than here.
# A change that raises one raises it here, by hand, and its commit says why. `python tools/budget.py --write` lowers
# those that have fallen. `python tools/budget.py --list KIND` prints what is counted.
#
# ROOM.modules            modules, `__init__` among them
# ROOM.tokens             names, numbers, strings and operators; no docstrings, comments or line breaks
# {WHOLE}.calls             calls with more than {MOST_POSITIONAL} positional arguments; one with a star counts as one
# {WHOLE}.circles           circles of imports, those of types and those in functions among them
# {WHOLE}.circular-modules  modules in these circles
# {WHOLE}.classes           names that several classes have, leading underscores aside
# {WHOLE}.names             functions and classes at the top level of a module, without a leading underscore
# {WHOLE}.tuples            functions whose result is a tuple of more than {MOST_ELEMENTS} elements (or None)

"""


class Place(NamedTuple):
    """A line of a file of the repository, and what is counted there."""

    path: Path
    line: int
    text: str


class Import(NamedTuple):
    """A line of a module, and the dotted name of another module that it imports."""

    line: int
    target: str


@dataclass(frozen=True)
class Module:
    """A module: its path in the repository, its path in the source, and its text."""

    path: Path
    inner: Path
    text: str

    @property
    def in_extension(self) -> bool:
        """Return whether it is a module of Blender's extension."""
        return self.inner.is_relative_to(EXTENSION)

    @property
    def room(self) -> str:
        """Return the name of its room."""
        return EXTENSION_ROOM if self.in_extension else self.inner.with_suffix("").parts[0]

    @property
    def package(self) -> tuple[str, ...]:
        """Return the parts of the dotted name of its package."""
        return (SOURCE.name, *self.inner.parent.parts)

    @property
    def name(self) -> str:
        """Return its dotted name; a package's is without `__init__`."""
        return ".".join(self.package if self.inner.stem == "__init__" else (*self.package, self.inner.stem))

    @cached_property
    def tree(self) -> ast.Module:
        """Return its syntax."""
        return ast.parse(self.text, filename=str(self.path))

    @cached_property
    def nodes(self) -> list[ast.AST]:
        """Return all nodes of its syntax."""
        return list(ast.walk(self.tree))

    def tokens(self) -> int:
        """Return the number of its tokens of code.

        A string that is a statement is a docstring. An f-string is one token, as it is for Python 3.11.
        """
        statements = (node.value for node in self.nodes if isinstance(node, ast.Expr))
        docstrings = {(value.lineno, value.col_offset) for value in statements if _is_text(value)}
        count = depth = 0
        for kind, _, start, _, _ in tokenize.generate_tokens(io.StringIO(self.text).readline):
            if kind in CLOSING:
                depth -= 1
            elif kind in CODE or kind in OPENING:
                count += not depth and start not in docstrings
                depth += kind in OPENING
        return count

    def place(self, node: ast.expr | ast.stmt, text: str) -> Place:
        """Return the place of a node."""
        return Place(self.path, node.lineno, text)


def _is_text(value: ast.expr) -> bool:
    return isinstance(value, ast.Constant) and isinstance(value.value, str)


def read(root: Path) -> list[Module]:
    """Return the modules of a repository's source, sorted by their paths."""
    source = root / SOURCE
    return [
        Module(path.relative_to(root), path.relative_to(source), path.read_text(encoding="utf-8"))
        for path in sorted(source.rglob("*.py"))
    ]


def without_extension(modules: Iterable[Module]) -> list[Module]:
    """Return the modules that are not of Blender's extension."""
    return [module for module in modules if not module.in_extension]


def sizes(modules: Iterable[Module]) -> list[Place]:
    """Return the modules with their numbers of tokens, the largest first."""
    counts = sorted(((module.tokens(), module.path) for module in modules), reverse=True)
    return [Place(path, 1, f"{count} tokens") for count, path in counts]


def public_names(modules: Iterable[Module]) -> list[Place]:
    """Return the functions and classes at the top level of modules whose names have no leading underscore."""
    return [
        module.place(node, node.name)
        for module in modules
        for node in module.tree.body
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) and not node.name.startswith("_")
    ]


def repeated_classes(modules: Iterable[Module]) -> dict[str, list[Place]]:
    """Return the places of classes by the names that several have, leading underscores aside."""
    places = defaultdict(list)
    for module in modules:
        for node in module.nodes:
            if isinstance(node, ast.ClassDef):
                places[node.name.lstrip("_")].append(module.place(node, f"class {node.name}"))
    return {name: places[name] for name in sorted(places) if len(places[name]) > 1}


def long_calls(modules: Iterable[Module]) -> list[Place]:
    """Return the calls with many positional arguments."""
    return [
        module.place(node, f"{ast.unparse(node.func)}() has {len(node.args)} positional arguments")
        for module in modules
        for node in module.nodes
        if isinstance(node, ast.Call) and len(node.args) > MOST_POSITIONAL
    ]


def long_tuples(modules: Iterable[Module]) -> list[Place]:
    """Return the functions whose result is a tuple of many elements."""
    return [
        module.place(node, f"{node.name}() returns {ast.unparse(node.returns)}")
        for module in modules
        for node in module.nodes
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.returns and _is_long_tuple(node.returns)
    ]


def _is_long_tuple(annotation: ast.expr) -> bool:
    if isinstance(annotation, ast.BinOp):  # tuple[A, B, C] | None
        return _is_long_tuple(annotation.left) or _is_long_tuple(annotation.right)
    if not (isinstance(annotation, ast.Subscript) and isinstance(annotation.slice, ast.Tuple)):
        return False
    return ast.unparse(annotation.value) == "tuple" and len(annotation.slice.elts) > MOST_ELEMENTS


def imports(module: Module, names: Collection[str]) -> Iterator[Import]:
    """Yield the imports of other modules with the names, wherever they stand: for types and in functions, too.

    What a package's `__init__` offers is imported from that package; a module of the package is not.
    """
    for node in module.nodes:
        if isinstance(node, ast.Import):
            targets = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            start = module.package[: len(module.package) - node.level + 1] if node.level else ()
            base = ".".join((*start, *([node.module] if node.module else [])))
            dotted = [f"{base}.{alias.name}" for alias in node.names]
            targets = [name if name in names else base for name in dotted]
        else:
            continue
        yield from (Import(node.lineno, name) for name in targets if name in names and name != module.name)


def circles(modules: Sequence[Module]) -> list[list[Place]]:
    """Return the imports within each circle, which is a strongly connected component of modules; the largest first."""
    index = {module.name: i for i, module in enumerate(modules)}
    links = [(i, entry) for i, module in enumerate(modules) for entry in imports(module, index)]
    rows, columns = [i for i, _ in links], [index[entry.target] for _, entry in links]
    graph = coo_array((np.ones(len(links)), (rows, columns)), shape=(len(modules), len(modules)))
    _, labels = connected_components(graph, connection="strong")
    places = defaultdict(list)
    for i, entry in dict.fromkeys(links):
        if labels[i] == labels[index[entry.target]]:
            places[labels[i]].append(Place(modules[i].path, entry.line, f"imports {entry.target}"))
    return sorted(places.values(), key=_size, reverse=True)


def _size(circle: Iterable[Place]) -> int:
    """Return the number of modules of a circle: each imports another."""
    return len({place.path for place in circle})


def _places_of_classes(modules: Iterable[Module]) -> list[Place]:
    return [place for places in repeated_classes(modules).values() for place in places]


def _places_of_circles(modules: Sequence[Module]) -> list[Place]:
    return [
        place._replace(text=f"circle {i} of {_size(circle)} modules: {place.text}")
        for i, circle in enumerate(circles(modules), start=1)
        for place in circle
    ]


#: What --list prints, by the kind of the number.
LISTS: dict[str, Callable[[Sequence[Module]], list[Place]]] = {
    "calls": long_calls,
    "circles": _places_of_circles,
    "classes": _places_of_classes,
    "names": public_names,
    "tokens": sizes,
    "tuples": long_tuples,
}


def counted(modules: Sequence[Module]) -> dict[str, int]:
    """Return the numbers by their names in the file, such as "beams.tokens" or "whole.calls"."""
    numbers: Counter[str] = Counter()
    for module in modules:
        numbers[f"{module.room}.modules"] += 1
        numbers[f"{module.room}.tokens"] += module.tokens()
    inside = without_extension(modules)
    loops = circles(inside)
    numbers[f"{WHOLE}.calls"] = len(long_calls(inside))
    numbers[f"{WHOLE}.circles"] = len(loops)
    numbers[f"{WHOLE}.circular-modules"] = sum(map(_size, loops))
    numbers[f"{WHOLE}.classes"] = len(repeated_classes(inside))
    numbers[f"{WHOLE}.names"] = len(public_names(inside))
    numbers[f"{WHOLE}.tuples"] = len(long_tuples(inside))
    return dict(numbers)


def loaded(file: Path) -> dict[str, int]:
    """Return the numbers of a file, by their names."""
    tables = tomllib.loads(file.read_text(encoding="utf-8"))
    return {f"{room}.{kind}": number for room, numbers in tables.items() for kind, number in numbers.items()}


def write(file: Path, numbers: Mapping[str, int]) -> None:
    """Write numbers to a file, one a line, by room."""
    lines = "".join(f"{name} = {numbers[name]}\n" for name in sorted(numbers))
    file.write_text(HEAD + lines, encoding="utf-8")


def lowered(budget: Mapping[str, int], numbers: Mapping[str, int]) -> dict[str, int]:
    """Return a budget without what has fallen: no number is raised, and none is new."""
    return {name: min(budget[name], numbers[name]) for name in budget if name in numbers}


def raised(budget: Mapping[str, int], numbers: Mapping[str, int]) -> list[str]:
    """Return a sentence for each number that is higher than in a budget, or not in it."""
    return [
        f"{name} was {budget[name]}, and is {number}: lower it, or raise it in {FILE} and say why in the commit"
        if name in budget
        else f"{name} is {number}, and {FILE} has no such number: add `{name} = {number}` and say why in the commit"
        for name, number in sorted(numbers.items())
        if name not in budget or number > budget[name]
    ]


def fallen(budget: Mapping[str, int], numbers: Mapping[str, int]) -> list[str]:
    """Return a sentence for each number of a budget that is lower now, or not there any more."""
    return [
        f"{name} was {budget[name]}, and is {numbers.get(name, 0)}: write it down with python tools/budget.py --write"
        for name in sorted(budget)
        if numbers.get(name, 0) < budget[name]
    ]


def listed(kind: str, modules: Sequence[Module]) -> list[str]:
    """Return a line for each place that the numbers of a kind count."""
    modules = modules if kind == "tokens" else without_extension(modules)
    return [f"{place.path}:{place.line}: {place.text}" for place in LISTS[kind](modules)]


def compare(budget: Mapping[str, int], numbers: Mapping[str, int]) -> int:
    """Print how numbers differ from a budget; return 1 if one is higher."""
    wrong = raised(budget, numbers)
    print(*fallen(budget, numbers), *wrong, f"numbers above {FILE}: {len(wrong)}", sep="\n")
    return int(bool(wrong))


def main(arguments: Sequence[str], root: Path = ROOT) -> int:
    """Count a repository's source, and do what the arguments say; return 1 if a number is higher than the file's."""
    parser = argparse.ArgumentParser(description=f"compare the numbers of {SOURCE} with {FILE}")
    action = parser.add_mutually_exclusive_group()
    action.add_argument("--write", action="store_true", help="lower the file's numbers, or write it if there is none")
    action.add_argument("--list", choices=LISTS, help="print the places that one number counts")
    options = parser.parse_args(arguments)
    modules, file = read(root), root / FILE
    if options.list:
        print(*listed(options.list, modules), sep="\n")
        return 0
    numbers = counted(modules)
    if options.write:
        write(file, lowered(loaded(file), numbers) if file.exists() else numbers)
    if not file.exists():
        print(f"there is no {FILE}: python tools/budget.py --write writes it")
        return 1
    return compare(loaded(file), numbers)


if __name__ == "__main__":
    gc.disable()  # all trees live to the end: looking for garbage among them took 1.5 of 4 seconds
    sys.exit(main(sys.argv[1:]))
