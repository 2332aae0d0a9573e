"""What has changed between two states of a scene; equal parts are the identical objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np

from .scene import Scene

T = TypeVar("T")

_PRIMS = ("meshes", "lights", "drawn", "media")  # fields of scenes
_ROUNDING = 1e-9  # relative error of float64 positions between two keys of the same value


def followed(first: Scene, later: Scene) -> Scene:
    """Return a later state of a scene with the prims of the first one, in their order, so that beams can be followed.

    Equal parts are the same object in both, by which the renderer knows what is at rest. A prim that is missing later
    stays as it was; a new prim has to wait for the next frame.
    """
    parts: dict[str, Any] = {name: _matched(getattr(first, name), getattr(later, name)) for name in _PRIMS}
    return (
        first
        if all(parts[name] is getattr(first, name) for name in parts)
        else replace(later, **parts, bounds=first.bounds)
    )


def sharing(first: Scene, later: Scene) -> Scene:
    """Return a later scene with its own prims, of which parts that are equal in the first one are the same objects."""
    parts: dict[str, Any] = {}
    for name in _PRIMS:
        by_name, own = {each.name: each for each in getattr(first, name)}, getattr(later, name)
        parts[name] = tuple(same(by_name.get(each.name, each), each) for each in own)
    result = replace(later, **parts)
    return first if equal(first, result) else result


def _matched(first: Sequence[T], later: Sequence[T]) -> Sequence[T]:
    by_name = {item.name: item for item in later}  # type: ignore[attr-defined]
    result = tuple(same(item, by_name.get(item.name, item)) for item in first)  # type: ignore[attr-defined]
    return first if all(a is b for a, b in zip(first, result, strict=True)) else result


def same(first: T, later: T) -> T:
    """Return the first of two equal values, else the later one, with its equal parts taken from the first."""
    if equal(first, later):
        return first
    if is_dataclass(first) and type(first) is type(later):
        parts = {each.name: same(getattr(first, each.name), getattr(later, each.name)) for each in fields(first)}
        return replace(later, **parts)  # type: ignore[type-var]
    return later


def equal(a: object, b: object, rounding: float = _ROUNDING) -> bool:
    """Return whether two values, which may contain arrays, are equal up to the rounding of interpolated keys."""
    if a is b:
        return True
    if is_dataclass(a) and type(a) is type(b):
        return all(equal(getattr(a, field.name), getattr(b, field.name), rounding) for field in fields(a))
    if isinstance(a, float | np.ndarray) and isinstance(b, float | np.ndarray):
        return np.shape(a) == np.shape(b) and np.allclose(a, b, rtol=rounding, atol=0)
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(equal(one, other, rounding) for one, other in zip(a, b, strict=True))
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(equal(value, b[name], rounding) for name, value in a.items())
    return bool(type(a) is type(b) and a == b)
