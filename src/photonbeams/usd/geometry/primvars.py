"""Read primvars as plain arrays: flattened, and as long as their interpolation needs, or left out with a warning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...scene import Array
from ..common.openusd import Usd, UsdGeom
from ..common.reading import Reading
from .polygons import Values

_PLAIN = ("normals", "widths")  # attributes that need not be primvars


@dataclass(frozen=True)
class Instance:
    """One instance of a point instancer: its prims take the instancer's primvars at this index."""

    instancer: Usd.Prim
    index: int


def find_primvar(prim: Usd.Prim, name: str) -> UsdGeom.Primvar | None:
    """Return a primvar with a value, of a prim or inherited from an ancestor; or None."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    return primvar if primvar and primvar.HasValue() else None


def read_primvar(
    reading: Reading,
    prim: Usd.Prim,
    name: str,
    columns: int | None,
    lengths: Mapping[str, int],
    any_fitting: bool = False,
) -> Values | None:
    """Return as many values of a primvar as its interpolation needs; None, with a warning, if they cannot be used.

    Parameters
    ----------
    name
        The primvar's; without one, `normals` and `widths` are those of the plain attribute.
    columns
        The same as for `flattened`.
    lengths
        How many values each interpolation needs; the prim cannot have an interpolation that is not listed.
    any_fitting
        Whether the number of values decides the interpolation if it does not fit the declared one: exporters of curves
        leave that at its fallback.
    """
    primvar = find_primvar(prim, name)
    if primvar is None and name in _PLAIN:
        primvar = UsdGeom.Primvar(prim.GetAttribute(name))
    numbers = None if primvar is None else flattened(reading, prim, primvar, columns)
    if primvar is None or numbers is None:
        return None
    # It is invalid as a primvar if it is a plain attribute, whose fallback is another.
    kind = str(primvar.GetInterpolation() if primvar or primvar.HasAuthoredInterpolation() else "vertex")
    if any_fitting and lengths.get(kind) != len(numbers):
        kind = next((name for name, count in lengths.items() if count == len(numbers)), kind)
    count, called = lengths.get(kind), str(primvar.GetName())
    if count is None:
        text = f"is of interpolation '{kind}': expected {', '.join(lengths)}; it is left out"
        reading.warn(prim, text, called)
        return None
    if len(numbers) != count:
        instead = "it is left out" if len(numbers) < count else "the first are used"
        text = f"has {len(numbers)} values of interpolation '{kind}': expected {count}; {instead}"
        reading.warn(prim, text, called)
    return Values(numbers[:count], kind) if len(numbers) >= count else None


def flattened(reading: Reading, prim: Usd.Prim, primvar: UsdGeom.Primvar, columns: int | None) -> Array | None:
    """Return a primvar's values with its indices applied, (N, columns); None, with a warning, if there are none.

    `elementSize` only counts if single numbers make up vectors, as in other renderers; exporters write it arbitrarily.

    Parameters
    ----------
    columns
        Numbers per value; longer values are cut. None: as many as there are.
    """
    name = str(primvar.GetName())
    numbers = _numbers(reading, prim, primvar, columns)
    numbers = None if numbers is None else reading.in_working_space(primvar.GetAttr(), numbers)
    if numbers is not None and primvar.IsIndexed():
        indices = np.asarray(primvar.GetIndices(reading.time) or (), dtype=np.int64)
        wrong = indices[(indices < 0) | (indices >= len(numbers))]
        if len(wrong):
            text = f"names value {wrong[0]}: expected values from 0 to {len(numbers) - 1}; {name} is left out"
            reading.warn(prim, text, f"{name}:indices")
            return None
        numbers = numbers[indices]
    return numbers


def read_instanced(
    reading: Reading, prim: Usd.Prim, name: str, columns: int, instances: Sequence[Instance]
) -> Array | None:
    """Return a primvar's value for an instance of a prim, (columns,), from the innermost instancer that has it.

    Return None if no instancer has it, or if the prim below them has one of its own.
    """
    if find_primvar(prim, name) is not None:
        return None
    for instance in instances:
        key = ("instanced", instance.instancer.GetPath(), name)
        if key not in reading.cache:
            reading.cache[key] = _of_instances(reading, instance.instancer, name, columns)
        values = reading.cache[key]
        if values is not None:
            return values.values[0 if values.interpolation == "constant" else instance.index]
    return None


def _of_instances(reading: Reading, instancer: Usd.Prim, name: str, columns: int) -> Values | None:
    """Return a primvar of an instancer, with one value for each instance or one for all."""
    count = len(reading.integers(instancer, "protoIndices"))
    lengths = dict.fromkeys(("uniform", "varying", "vertex", "faceVarying"), count) | {"constant": 1}
    return read_primvar(reading, instancer, name, columns, lengths=lengths)


def _numbers(reading: Reading, prim: Usd.Prim, primvar: UsdGeom.Primvar, columns: int | None) -> Array | None:
    """Return values without indices as (N, columns) finite numbers, or None if there are none of this kind."""
    raw, name, element = primvar.Get(reading.time), str(primvar.GetName()), primvar.GetElementSize()
    if raw is None:
        return None
    try:
        numbers = np.asarray(raw, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.zeros((1, 0))
    if not type(raw).__module__.endswith(".Vt"):  # a single value, not an array
        numbers = numbers.reshape(1, -1)
    elif not len(numbers):
        return None
    if numbers.ndim == 1:
        numbers = numbers.reshape(-1, element if columns == element and len(numbers) % element == 0 else 1)
    if numbers.ndim != 2 or numbers.shape[1] < (columns or 1):
        expected = "one number" if columns in (None, 1) else f"{columns} numbers"
        reading.warn(prim, f"has values of type {type(raw).__name__}: expected {expected} each; it is left out", name)
        return None
    numbers = numbers[:, :columns]
    finite = np.isfinite(numbers).all(axis=1)
    if not finite.all():
        index = int(np.argmin(finite))
        text = f"is {tuple(numbers[index].tolist())}: expected finite numbers; {name} is left out"
        reading.warn(prim, text, f"{name}[{index}]")
        return None
    return numbers
