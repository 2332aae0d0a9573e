"""Count the prims of a stage before it is composed: a small file may name itself by references without end.

A prim is composed of the places that its references, payloads, inherits and variants lead to. Prims with the same
places have the same prims below them, so that each place is looked at once, however often it is referred to.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, takewhile
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ...scene import SceneError
from ..common.openusd import Pcp, Sdf

#: The most prims of a stage, counting those in every instance: reading one takes about a millisecond.
MOST_PRIMS = 10_000_000
#: How deep prims may be in prims: OpenUSD needs a part of the stack for each, and for each brace of a text.
DEEPEST = 1000
_ARCS = {"references", "payload", "inheritPaths", "specializes", "variantSetNames"}  # fields that lead elsewhere

# What may hold braces that nest nothing: texts, names of files, comments.
_QUOTED = re.compile(
    rb"""\"{3}.*?\"{3}|'{3}.*?'{3}|"(?:[^"\\\n]|\\.)*"|'(?:[^'\\\n]|\\.)*'|@[^@\n]*@|\#[^\n]*|//[^\n]*|/\*.*?\*/""",
    re.DOTALL,
)
_EXPRESSION = re.compile(rb"`[^`\n]*`")

_Places: TypeAlias = frozenset[tuple[Any, Any]]  # stacks of layers with paths in them


def is_deep(text: bytes) -> bool:
    """Return whether braces are too deep in braces in the text of a layer, or brackets in an expression."""
    if text.count(b"(") > DEEPEST and any(_depth(each[0], b"(", b")") > DEEPEST for each in _EXPRESSION.finditer(text)):
        return True
    return text.count(b"{") > DEEPEST and _depth(_QUOTED.sub(b"", text), b"{", b"}") > DEEPEST


def _depth(text: bytes, begin: bytes, end: bytes) -> int:
    codes = np.frombuffer(text, np.uint8)
    return int(np.cumsum((codes == ord(begin)).astype(np.int32) - (codes == ord(end))).max(initial=0))


class _Size(NamedTuple):
    """How many prims are at and below one, and how many are below each other."""

    prims: int
    height: int


_ONE = _Size(1, 0)


class _Outline:
    """Where the prims of a layer are, and which of them lead elsewhere."""

    def __init__(self, layer: Sdf.Layer, prims: Iterable[Sdf.Path]) -> None:
        self._prims = sorted(prims)
        self._leading = [each for each in self._prims if not _ARCS.isdisjoint(_keys(layer.GetObjectAtPath(each)))]

    def leads(self, path: Sdf.Path) -> bool:
        """Return whether a prim at or below a path leads elsewhere."""
        return next(_below(self._leading, path), None) is not None

    def size(self, path: Sdf.Path) -> _Size:
        """Return the size of the prim at a path, which leads nowhere else."""
        depths = [each.pathElementCount for each in _below(self._prims, path)]
        return _Size(len(depths), max(depths, default=0) - path.pathElementCount)


def _keys(spec: Any) -> list[str]:
    return spec.ListInfoKeys() if isinstance(spec, Sdf.PrimSpec) else []


def _below(paths: list[Sdf.Path], root: Sdf.Path) -> Iterator[Sdf.Path]:
    """Yield those of sorted paths that are at or below a root."""
    return takewhile(lambda path: path.HasPrefix(root), islice(paths, bisect_left(paths, root), None))


@dataclass
class _Visit:
    """A prim that is being counted, with the names of those below it that are left."""

    path: Sdf.Path
    places: _Places
    left: list[str]
    size: _Size = _ONE


class _Counter:
    """Counts prims by composing one for each set of places."""

    def __init__(self, root: Sdf.Layer, session: Sdf.Layer, outlines: Mapping[str, _Outline]) -> None:
        self._cache = Pcp.Cache(Pcp.LayerStackIdentifier(root, session), "", True)
        self._outlines = outlines
        self._known: dict[_Places, _Size] = {}

    def size(self, path: Sdf.Path) -> _Size:
        """Return the size of the prim at a path, or what is known of it as soon as that is too large."""
        visits = [self._visit(path)]
        while True:
            visit = visits[-1]
            if visit.left:
                visits.append(self._visit(visit.path.AppendChild(visit.left.pop())))
                if len(visits) > DEEPEST:
                    return _Size(visit.size.prims, DEEPEST + 1)
                continue
            self._known[visit.places] = visits.pop().size
            if not visits:
                return visit.size
            outer = visits[-1]
            outer.size = _Size(outer.size.prims + visit.size.prims, max(outer.size.height, visit.size.height + 1))

    def _visit(self, path: Sdf.Path) -> _Visit:
        index, _ = self._cache.ComputePrimIndex(path)
        if index.hasAnyPayloads:
            self._cache.RequestPayloads([path], [])
            index, _ = self._cache.ComputePrimIndex(path)
        places = frozenset(_places(index.rootNode))
        if places not in self._known and not any(each.leads(path) for each, path in self._outlined(places)):
            sizes = [each.size(path) for each, path in self._outlined(places)]
            self._known[places] = max(sizes, default=_ONE)  # layers over each other have the same prims
        if places in self._known:
            return _Visit(path, places, [], self._known[places])
        active = next((spec.active for spec in index.primStack if spec.HasActive()), True)
        return _Visit(path, places, index.ComputePrimChildNames()[0] if active else [])

    def _outlined(self, places: _Places) -> Iterator[tuple[_Outline, Sdf.Path]]:
        for stack, path in places:
            for layer in stack.layers:
                if layer.identifier in self._outlines:
                    yield self._outlines[layer.identifier], path


def _places(root: Any) -> Iterator[tuple[Any, Sdf.Path]]:
    """Yield the places with opinions of which a prim is composed."""
    nodes = [root]
    for node in nodes:  # which grows meanwhile
        nodes += node.children
        if node.hasSpecs and node.CanContributeSpecs():
            yield node.layerStack, node.path


def check_count(
    root: Sdf.Layer, session: Sdf.Layer, prims: Mapping[Sdf.Layer, Sequence[Sdf.Path]], mask: Iterable[str] | None
) -> None:
    """Raise SceneError for a stage of more prims than can be read, counting those of instances, or of too deep ones.

    `prims` are the prims of each layer. Only what is at and below the paths of a mask counts.
    """
    outlines = {layer.identifier: _Outline(layer, paths) for layer, paths in prims.items()}
    counter = _Counter(root, session, outlines)
    found = [counter.size(Sdf.Path(path)) for path in (("/",) if mask is None else mask)]
    total, height = sum(each.prims for each in found), max((each.height for each in found), default=0)
    name = root.realPath or root.identifier
    if height > DEEPEST:
        raise SceneError(f"{name} has prims in prims, more than {DEEPEST:,} deep: expected fewer")
    if total > MOST_PRIMS:
        text = f"has {total:,} prims, with those that it refers to: expected no more than {MOST_PRIMS:,}"
        raise SceneError(f"{name} {text}; a mask can select some of them")
