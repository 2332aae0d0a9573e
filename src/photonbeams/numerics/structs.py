"""Structs of Dr.Jit arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, TypeVar, get_type_hints

import drjit as dr
import numpy as np

from ..runtime.device import Float, UInt32
from .arrays import padded, to_float, to_uint, to_vectors

T = TypeVar("T")


class Struct:
    """Base of structs: annotated attributes of a subclass whose type is a Dr.Jit type or a struct are its fields.

    The constructor takes values in the order of the fields, or by their names; Dr.Jit calls it without values.
    """

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {}

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.DRJIT_STRUCT = {name: kind for name, kind in get_type_hints(cls).items() if _is_field(kind)}

    def __init__(self, *values: object, **named: object) -> None:
        for name, value in (*zip(self.DRJIT_STRUCT, values, strict=False), *named.items()):
            setattr(self, name, value)


def _is_field(kind: object) -> bool:
    return dr.is_struct_v(kind) or dr.is_array_v(kind)


def pack(sources: Sequence[T]) -> T:
    """Return structs of one kind as one struct of arrays, `padded`, for `dr.gather` in a loop over them."""
    result = type(sources[0])()
    for name, kind in result.DRJIT_STRUCT.items():  # type: ignore[attr-defined]
        values = [getattr(item, name) for item in padded(sources)]
        if hasattr(kind, "DRJIT_STRUCT"):
            packed: Any = pack(values[:-1])
        elif kind is UInt32:
            packed = to_uint([value.numpy()[0] for value in values])
        else:
            rows = np.array([np.ravel(value.numpy()) for value in values]).T
            packed = to_float(rows[0]) if kind is Float else to_vectors(rows.T)
        setattr(result, name, packed)
    return result
