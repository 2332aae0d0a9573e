"""Descriptions of USD prims, as the renderer takes them (`usd/authoring/prims.py`), and names that USD allows."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from typing import Any, NamedTuple

import numpy as np

#: Called with a sentence about what is not rendered as in Blender.
Told = Callable[[str], None]
#: Values of attributes by their names: numbers, texts, lists, arrays.
Values = dict[str, Any]
#: Paths of prims by the names of relationships.
Targets = dict[str, list[str]]

# The types of attributes by the last part of their names, where the value does not say it.
_TYPES = {
    "file": "asset", "filePath": "asset", "gobo": "asset", "texture": "asset", "points": "point3f[]",
    "extent": "point3f[]", "normals": "normal3f[]", "open": "double", "close": "double", "drift": "float3",
    "expression": "string", "varname": "string",
}  # fmt: skip
_LISTS = {2: "float2", 3: "color3f", 4: "float4"}
_ARRAYS = {(): "float[]", (2,): "texCoord2f[]", (3,): "color3f[]"}


class Primvar(NamedTuple):
    """An array with its interpolation."""

    value: Any
    interpolation: str


@dataclass
class Prim:
    """A prim.

    Attributes
    ----------
    path, type, apis
        Where it is, its type, and the schemas that are applied.
    values, targets
        What its attributes and relationships have.
    sources
        By input or output: the path of the property that it is connected to.
    matrix
        Its transform to the parent, (4, 4), of row vectors; None: none.
    """

    path: str
    type: str
    values: Values = field(default_factory=dict)
    targets: Targets = field(default_factory=dict)
    sources: dict[str, str] = field(default_factory=dict)
    apis: list[str] = field(default_factory=list)
    matrix: Any = None

    def described(self, name: str = "") -> dict[str, Any]:
        """Return the description of the prim, which Blender calls by a name."""
        parts = {**vars(self), "values": typed(self.values), "name": name}
        parts["sources"] = {each: ["token", path] for each, path in self.sources.items()}
        return {each: part for each, part in parts.items() if part is not None}


def typed(values: Values) -> dict[str, list[Any]]:
    """Return values with their types, and the interpolation of those that have one."""
    return {
        name: [_type_of(name, *value[:1]), *value] if isinstance(value, Primvar) else [_type_of(name, value), value]
        for name, value in values.items()
    }


def _type_of(name: str, value: Any) -> str:
    last = name.rpartition(":")[2]
    if last in _TYPES:
        return _TYPES[last]
    if isinstance(value, np.ndarray):
        return "int[]" if value.dtype.kind == "i" else _ARRAYS[value.shape[1:]]
    if isinstance(value, list | tuple):
        return _LISTS[len(value)]
    kinds = {"bool": bool, "int": int, "float": float | np.floating}
    return next((kind for kind, plain in kinds.items() if isinstance(value, plain)), "token")


def free_path(parent: str, name: str, taken: Callable[[str], object]) -> str:
    """Return the path of a prim, which has a number if it is taken otherwise."""
    valid = re.sub(r"\W", "_", name, flags=re.ASCII)
    valid = valid if valid[:1].isalpha() or valid[:1] == "_" else f"_{valid}"
    return next(path for k in count() if not taken(path := f"{parent}/{valid}_{k}" if k else f"{parent}/{valid}"))


def group_name(name: str) -> str:
    """Return the name of a light group."""
    return re.sub(r"[^A-Za-z0-9_-]", "_", name)
