"""Light by light groups."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

import drjit as dr

from ..runtime.device import Array3f, Bool, Float, UInt32


class GroupedLight:
    """Light (Array3f) of each light group, in the order of the groups' numbers; loops may carry it."""

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {"parts": list}

    parts: list[Any]

    def __init__(self, parts: Iterable[Any] = ()) -> None:
        self.parts = list(parts)

    @classmethod
    def dark(cls, groups: int, width: int = 1) -> GroupedLight:
        """Return no light, of this number of groups."""
        return cls(dr.zeros(Array3f, width) for _ in range(groups))

    @classmethod
    def of(cls, light: Any, group: UInt32 | int, groups: int) -> GroupedLight:
        """Return light that belongs to a group, the same for all (an int) or not."""
        if isinstance(group, int):
            return cls(light if each == group else dr.zeros(Array3f, dr.width(light)) for each in range(groups))
        if groups == 1:
            return cls([light])
        return cls(dr.select(group == dr.opaque(UInt32, each), light, 0) for each in range(groups))

    def __add__(self, other: GroupedLight) -> GroupedLight:
        return GroupedLight(one + another for one, another in zip(self.parts, other.parts, strict=True))

    def __mul__(self, factor: Array3f | Float) -> GroupedLight:
        return GroupedLight(each * factor for each in self.parts)

    def where(self, lit: Bool, other: GroupedLight | None = None) -> GroupedLight:
        """Return the light where `lit` holds, and elsewhere the `other` light, or none."""
        others = [0] * len(self.parts) if other is None else other.parts
        return GroupedLight(dr.select(lit, one, another) for one, another in zip(self.parts, others, strict=True))

    def numbers(self) -> GroupedLight:
        """Return the light, without that which is no number."""
        return GroupedLight(dr.select(dr.isnan(dr.sum(each)), 0, each) for each in self.parts)

    def finite(self) -> GroupedLight:
        """Return the light, without that which is infinite or no number."""
        return GroupedLight(dr.select(dr.isfinite(dr.sum(each)), each, 0) for each in self.parts)

    @property
    def total(self) -> Any:
        """The light of all groups."""
        return sum(self.parts[1:], self.parts[0])
