"""Base class of factors, profiles and contexts: arguments are checked, and the repr is the constructor's call."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, ParamSpec

import drjit as dr
import numpy as np

from ..runtime.digest import ByContent
from ..scene import arguments

P = ParamSpec("P")

_MOST_NUMBERS = 12  # of an array that a repr writes out


class Described(ByContent):
    """An object whose repr is the call of its constructor, with its arguments; equal ones have equal fields."""

    _arguments: Mapping[str, Any] = {}

    @arguments
    def __init__(self) -> None: ...

    def __repr__(self) -> str:
        listed = ", ".join(f"{name}={described(value)}" for name, value in self._arguments.items())
        return f"{type(self).__name__}({listed})"


def constructor(initialize: Callable[P, None]) -> Callable[P, None]:
    """Decorate the `__init__` of a `Described`, so that it checks its arguments and keeps them for the repr."""
    checked, signature = arguments(initialize), inspect.signature(initialize)

    @wraps(initialize)
    def kept(*args: P.args, **kwargs: P.kwargs) -> None:
        checked(*args, **kwargs)
        bound = signature.bind(*args, **kwargs)
        bound.apply_defaults()
        own, *_ = bound.arguments.values()
        own._arguments = dict(list(bound.arguments.items())[1:])

    return kept


def described(value: Any) -> str:
    """Return an argument as text: numbers with six digits, long arrays as their shape."""
    if callable(value) and hasattr(value, "__name__"):
        return f"<function {value.__name__}>"
    if isinstance(value, str | Described) or value is None:
        return repr(value)
    if dr.is_jit_v(value) and not dr.is_tensor_v(value):
        value = value.numpy().T
        value = value[0] if len(value) == 1 else value
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        return repr(value)
    if numbers.size > _MOST_NUMBERS:
        return f"<numbers {numbers.shape}>"
    return _written(numbers.tolist())


def _written(numbers: Any) -> str:
    return f"[{', '.join(map(_written, numbers))}]" if isinstance(numbers, list) else f"{numbers:.6g}"
