"""Hashes of values by their content, the same in every process and on every machine; and whether two are equal.

Values may be numbers, text, arrays, containers of these, objects (hashed by their fields), and functions (hashed by
their source text and the values that it names). Dr.Jit's arrays are hashed like NumPy's.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from enum import Enum
from functools import cached_property, partial
from hashlib import sha256
from os import PathLike, fspath
from types import BuiltinFunctionType, CellType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

_PLAIN = (type(None), bool, int, float, complex, str, bytes)
_NAMED = (type, ModuleType, BuiltinFunctionType, FunctionType, MethodType)


def digest(*values: object) -> str:
    """Return a hash of values, as text."""
    hashed = sha256()
    _Feed(hashed).add(values)
    return hashed.hexdigest()


class ByContent:
    """Base of objects that are equal if they are of one class, and their fields are equal; fields may be arrays."""

    def __eq__(self, other: object) -> bool:
        return self is other or (type(self) is type(other) and equal(fields_of(self), fields_of(other)))

    def __hash__(self) -> int:
        return hash(repr(self))


def equal(a: Any, b: Any) -> bool:
    """Return whether two values have the same content: arrays and containers are compared entry by entry."""
    if a is b:
        return True
    if type(a) is not type(b):
        return False
    if isinstance(a, Mapping):
        return a.keys() == b.keys() and all(equal(value, b[name]) for name, value in a.items())
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(equal, a, b))
    if isinstance(a, np.ndarray) or hasattr(type(a), "numpy"):
        first, second = (each if isinstance(each, np.ndarray) else each.numpy() for each in (a, b))
        return np.array_equal(first, second)
    if (is_dataclass(a) or type(a).__eq__ is object.__eq__) and hasattr(a, "__dict__") and not isinstance(a, _NAMED):
        return equal(fields_of(a), fields_of(b))
    return bool(a == b)


class _Feed:
    """Feeds values to a hash; objects that refer to each other are fed once."""

    def __init__(self, hashed: Any) -> None:
        self._hashed, self._known = hashed, dict[int, tuple[int, Any]]()

    def _put(self, *words: object) -> None:
        for word in words:
            text = word if isinstance(word, bytes) else str(word).encode("utf-8", "surrogatepass")
            self._hashed.update(b"%d:" % len(text))
            self._hashed.update(text)

    def add(self, value: object) -> None:
        """Feed a value to the hash."""
        if isinstance(value, _PLAIN) and not isinstance(value, Enum):
            self._put(type(value).__name__, value)
            return
        if id(value) in self._known:
            self._put("again", self._known[id(value)][0])
            return
        self._known[id(value)] = len(self._known), value  # kept alive, so that no other value gets its id
        self._add_large(value)

    def _add_large(self, value: Any) -> None:
        if isinstance(value, Mapping):
            self._put("mapping", len(value))
            for name in sorted(value, key=repr):
                self.add(name)
                self.add(value[name])
        elif isinstance(value, set | frozenset):
            self._put("set", *sorted(digest(each) for each in value))
        elif isinstance(value, np.ndarray | np.generic) or hasattr(type(value), "numpy"):
            numbers = np.ascontiguousarray(value if isinstance(value, np.ndarray | np.generic) else value.numpy())
            self._put("array", numbers.dtype.str, numbers.shape, numbers.tobytes())
        elif isinstance(value, Sequence):
            self._put(type(value).__name__, len(value))
            for each in value:
                self.add(each)
        elif isinstance(value, PathLike):
            self._put("path", fspath(value))
        else:
            self._add_object(value)

    def _add_object(self, value: object) -> None:
        if isinstance(value, FunctionType):
            self._add_function(value)
        elif isinstance(value, MethodType):
            self._put("method")
            self.add((value.__func__, value.__self__))
        elif isinstance(value, partial):
            self._put("partial")
            self.add((value.func, value.args, value.keywords))
        elif isinstance(value, type | ModuleType | BuiltinFunctionType):
            self._put("named", getattr(value, "__module__", ""), getattr(value, "__qualname__", value.__name__))
        elif isinstance(value, Enum):
            self._put("enum", type(value).__qualname__, value.name)
        else:
            self._put("object", type(value).__module__, type(value).__qualname__)
            if not type(value).__module__.startswith("photonbeams."):
                self._put(_source(type(value)))
            self.add(fields_of(value))

    def _add_function(self, function: FunctionType) -> None:
        self._put("function", function.__qualname__, _source(function))
        if function.__name__ == "<lambda>":  # the same source lines may have several
            self._put(_text(function.__code__))
        self.add((function.__defaults__, function.__kwdefaults__))
        self.add([_content(cell) for cell in function.__closure__ or ()])
        for name in sorted(_names(function.__code__) & function.__globals__.keys()):
            value = function.__globals__[name]
            self._put(name)
            if isinstance(value, FunctionType | type) and value.__module__ != function.__module__:
                self._put(value.__module__, value.__qualname__)  # of a library: its source is not hashed
            else:
                self.add(_source(value) if isinstance(value, type) else value)


def fields_of(value: object) -> dict[str, Any]:
    """Return an object's attributes without cached properties, which may not have been computed yet."""
    kinds = [vars(each) for each in type(value).__mro__]
    slots = {name for each in kinds for name in _names_of_slots(each.get("__slots__", ()))}
    fields = {**getattr(value, "__dict__", {}), **{name: getattr(value, name, None) for name in slots}}
    computed = {name for each in kinds for name, own in each.items() if isinstance(own, cached_property)}
    return {name: each for name, each in fields.items() if name not in computed}


def _names_of_slots(given: str | Iterable[str]) -> list[str]:
    names = [given] if isinstance(given, str) else [*given]
    return [name for name in names if not name.startswith("__")]


def _content(cell: CellType) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # the cell is still empty
        return None


def _names(code: CodeType) -> set[str]:
    """Return the names that a function and its inner functions look up."""
    inner = (each for each in code.co_consts if isinstance(each, CodeType))
    return {*code.co_names}.union(*map(_names, inner))


def _source(value: type | FunctionType) -> str:
    """Return the source text of a function or a class or, if there is none, its compiled code."""
    try:
        return inspect.getsource(value)
    except (OSError, TypeError):
        code = getattr(value, "__code__", None)
        return "" if code is None else _text(code)


def _text(code: CodeType) -> str:
    constants = [_text(each) if isinstance(each, CodeType) else repr(each) for each in code.co_consts]
    return repr((code.co_code, code.co_names, constants))
