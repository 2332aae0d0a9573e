"""Check what users give functions and classes by the types that these declare."""

from __future__ import annotations

import builtins
import difflib
import inspect
import os
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial, wraps
from numbers import Integral
from types import NoneType, UnionType
from typing import Annotated, Any, NamedTuple, ParamSpec, TypeVar, Union, get_args, get_origin

import numpy as np

from .checks import LONGEST, SceneError, as_float, plain, shortened, shown

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")


class Declared(NamedTuple):
    """What a declared type takes: a test, and the words of a message for it.

    A type that is annotated with a check has that instead: it takes a value and its name, and returns the value as the
    field holds it.
    """

    fits: Callable[[Any], bool]
    expected: str = ""
    check: Callable[[Any, str], Any] | None = None


def arguments(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function that users call, so that a wrong argument raises a SceneError that says what is right.

    The function's own checks say more, so values are held against the declared types where it raises another error
    and, as fields of an object, where it raises none. Fields whose type is annotated with a check hold what that
    returns; messages name them as the `called` of their class says.

    Examples
    --------
    >>> @arguments
    ... def render(passes=1, width=640): ...
    >>> render(widht=320)
    Traceback (most recent call last):
    photonbeams.scene.checks.SceneError: render has no argument 'widht', did you mean width? Expected passes, width
    """
    signature = inspect.signature(function)
    makes = function.__name__ == "__init__"
    declared: dict[str, Declared] = {}
    unknown = {**signature.parameters}

    def learn(owners: Sequence[Any]) -> None:
        """Evaluate the types, once what they name exists."""
        kinds = {key: _declared(each, owners) for key, each in unknown.items()}
        declared.update({key: kind for key, kind in kinds.items() if kind is not None})
        unknown.clear()

    def convert(bound: dict[str, Any], called: str) -> None:
        """Replace the fields that have a check by what it returns."""
        for key, kind in declared.items():
            if kind.check is not None:
                value = bound.get(key, signature.parameters[key].default)
                bound[key] = kind.check(value, called.format(field=key, **bound))

    def check(bound: Mapping[str, object]) -> None:
        for key, value in bound.items():
            kind = declared.get(key)
            if kind is not None and not kind.fits(value):
                raise SceneError(f"{key} is {shown(value)}: expected {kind.expected}") from None

    @wraps(function)
    def checked(*given: P.args, **named: P.kwargs) -> R:
        try:
            taken = signature.bind(*map(plain, given), **{key: plain(value) for key, value in named.items()})
        except TypeError as error:
            name = type(given[0]).__name__ if makes else function.__name__
            raise SceneError(_misuse(name, signature, len(given), named, error)) from None
        learn(type(given[0]).__mro__ if makes else (function,))
        try:
            if makes:
                convert(taken.arguments, getattr(given[0], "called", "{field}"))
            result = function(*taken.args, **taken.kwargs)
        except (SceneError, OSError):
            raise
        except Exception:
            check(taken.arguments)
            raise
        if makes:
            check(taken.arguments)
        return result

    return checked


def typed(kind: type[T]) -> type[T]:
    """Decorate a dataclass whose fields are checked as `arguments` checks those of a function."""
    setattr(kind, "__init__", arguments(getattr(kind, "__init__")))  # noqa: B009, B010 - for mypy
    return kind


def unknown(name: str, key: str, expected: Iterable[str]) -> str:
    """Return the message for an argument that a function does not have; it names the most similar one that exists."""
    listed = list(expected)
    near = difflib.get_close_matches(key.lower(), listed, n=1)
    hint = f", did you mean {near[0]}?" if near else "."
    return shortened(f"{name} has no argument {shown(key)}{hint} Expected {', '.join(listed) or 'none'}")


def _misuse(name: str, signature: inspect.Signature, given: int, named: Mapping[str, object], error: TypeError) -> str:
    """Return the message for the arguments of a call that do not match `signature`."""
    parameters = {key: each for key, each in signature.parameters.items() if key != "self"}
    wrong = [key for key in named if key not in parameters]
    if wrong:
        return unknown(name, wrong[0], parameters)
    positional = [key for key, each in parameters.items() if each.kind is not each.KEYWORD_ONLY]
    given -= "self" in signature.parameters
    if given > len(positional):
        return f"{name} got {given} positional arguments: expected up to {len(positional)}, {', '.join(positional)}"
    taken = (*named, *positional[:given])
    missing = [key for key, each in parameters.items() if each.default is each.empty and key not in taken]
    if missing:
        return f"{name} lacks {', '.join(missing)}: expected {', '.join(parameters)}"[:LONGEST]
    return f"{name}: {error}"


def _declared(parameter: inspect.Parameter, owners: Iterable[Any]) -> Declared | None:
    """Return what a parameter takes; None: its type is not known, or the function checks it itself.

    `owners` are the function, or the classes in whose modules the fields of a class are declared.
    """
    if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
        return None
    names: dict[str, Any] = {}
    for each in owners:
        names = {**vars(sys.modules[each.__module__]), **names}
    try:
        return _of(eval(parameter.annotation, names))
    except (NameError, TypeError):  # imported for type checkers only, or no annotation
        return None


def _of(kind: Any) -> Declared | None:
    """Return what a type takes; None: any value."""
    origin = get_origin(kind) or kind
    if origin is Annotated:
        return Declared(_anything, check=kind.__metadata__[0])
    if origin in (Union, UnionType):
        parts = [_of(each) for each in get_args(kind)]
        known = [each for each in parts if each is not None]
        words = " or ".join(dict.fromkeys(each.expected for each in known if each is not _NONE))
        checks = [each.check for each in known if each.check is not None]
        if checks:
            return Declared(_anything, check=partial(_unless_none, checks[0]))
        return Declared(lambda value: any(each.fits(value) for each in known), words) if known == parts else None
    if origin is Callable and get_args(kind) and get_args(kind)[0] is not ...:
        return _function_of(len(get_args(kind)[0]))
    if origin in _KNOWN:
        return _KNOWN[origin]
    if origin in (Iterable, Sequence):
        inner = _of(*get_args(kind))
        return inner and Declared(lambda value: _all(inner.fits, value), f"several of them, each {inner.expected}")
    if not isinstance(origin, type) or origin in _LOOSE or getattr(origin, "_is_protocol", False):
        return None
    return Declared(lambda value: isinstance(value, origin), f"a {origin.__name__}")


def _anything(value: object) -> bool:
    return True


def _unless_none(check: Callable[[Any, str], Any], value: object, name: str) -> Any:
    return None if value is None else check(value, name)


def _function_of(count: int) -> Declared:
    """Return what a type of functions takes, which are called with so many arguments."""

    def fits(value: Any) -> bool:
        try:
            inspect.signature(value).bind(*range(count))
        except TypeError:
            return False
        except ValueError:  # some do not say; classes, as int, and Python's own, as max, are no functions of a user's
            return not isinstance(value, type) and getattr(value, "__self__", None) is not builtins
        return True

    return Declared(fits, f"a function of {count} argument{'s' * (count != 1)}")


def _all(fits: Callable[[Any], bool], value: object) -> bool:
    """Return whether a value holds such values; what is gone once it is read, such as a generator, is not read."""
    if isinstance(value, str | bytes) or not isinstance(value, Iterable) or getattr(value, "shape", None) == ():
        return False
    return not isinstance(value, Collection) or all(map(fits, value))


def _is_number(value: Any) -> bool:
    """Return whether a value is a real number as kernels take it, also a NumPy one, or an array of one."""
    if isinstance(value, float | np.floating | Integral):
        return not isinstance(value, Integral) or np.isfinite(as_float(value))
    shapes = ((),) if isinstance(value, np.ndarray) else ((), (1,))  # a number of Dr.Jit's is a row of one entry
    return getattr(value, "shape", None) in shapes and getattr(getattr(value, "dtype", None), "kind", "f") in "buif"


_NONE = Declared(lambda value: value is None, "None")
_KNOWN = {
    NoneType: _NONE,
    str: Declared(lambda value: isinstance(value, str), "text"),
    bool: Declared(lambda value: isinstance(value, Integral) and value in (0, 1), "True or False"),
    int: Declared(lambda value: isinstance(value, Integral), "a whole number"),
    float: Declared(_is_number, "a number"),
    os.PathLike: Declared(lambda value: isinstance(value, os.PathLike), "a path"),
    Mapping: Declared(lambda value: isinstance(value, Mapping), "a dict"),
    Callable: Declared(callable, "a function"),
}
# Arrays are also made from lists, and collections from others: what takes them checks them.
_LOOSE = (Any, object, np.ndarray, tuple, list, dict, set, frozenset)
