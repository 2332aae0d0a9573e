"""Structs of Dr.Jit arrays."""

from __future__ import annotations

from typing import Any, ClassVar, get_type_hints


class Struct:
    """Base of structs: the annotated attributes of a subclass are its fields, each a Dr.Jit type or a struct.

    The constructor takes values in the order of the fields; Dr.Jit calls it without values.
    """

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {}

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.DRJIT_STRUCT = {name: kind for name, kind in get_type_hints(cls).items() if name != "DRJIT_STRUCT"}

    def __init__(self, *values: Any) -> None:
        for name, value in zip(self.DRJIT_STRUCT, values, strict=False):
            setattr(self, name, value)
