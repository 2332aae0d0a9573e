"""Sweeps that are too long for every change: some of their cases run in `make test`, and all of them in `make soak`."""

from collections.abc import Container, Iterable, Sequence

import pytest


def sweep(values: Iterable[object], keep: Container[object], ids: Sequence[str] | None = None) -> list[object]:
    """Return the values of a sweep as parameters; those that are not in `keep` are for `make soak` alone.

    `ids` name the values, and `keep` has names where there are ids. A value that is `pytest.param` already keeps its
    marks and its id.
    """
    values = list(values)
    names = values if ids is None else list(ids)
    marked = [value if name in keep else _for_soak(value) for value, name in zip(values, names, strict=True)]
    if len(marked) == sum(map(_is_for_soak, marked)):
        raise ValueError(f"a sweep of {len(marked)} values has none in `make test`: expected one that represents it")
    return marked


def _for_soak(value: object) -> object:
    if isinstance(value, type(pytest.param())):
        return pytest.param(*value.values, marks=(*value.marks, pytest.mark.soak), id=value.id)
    return pytest.param(value, marks=pytest.mark.soak)


def _is_for_soak(value: object) -> bool:
    return any(mark.name == "soak" for mark in getattr(value, "marks", ()))
