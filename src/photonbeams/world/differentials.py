"""Ray differentials of light paths (Igehy 1999): derivatives of rays by the four numbers of an emission sample."""

from __future__ import annotations

from typing import Any, ClassVar

import drjit as dr

from ..runtime.device import Array3f, UInt32


class RayDifferentials:
    """Derivatives of rays by the four numbers of their emission sample, (3,) of the origin, `p`, and direction, `d`."""

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {f"{name}{k}": Array3f for name in "pd" for k in range(4)}

    def columns(self) -> list[tuple[Array3f, Array3f]]:
        """Return the derivatives of origin and direction by each of the four numbers."""
        return [(getattr(self, f"p{k}"), getattr(self, f"d{k}")) for k in range(4)]

    @classmethod
    def of(cls, columns: list[tuple[Array3f, Array3f]]) -> RayDifferentials:
        """Return a struct of the derivatives by each of the four numbers."""
        result = cls()
        for k, (p, d) in enumerate(columns):
            setattr(result, f"p{k}", Array3f(p))
            setattr(result, f"d{k}", Array3f(d))
        return result


def differentiate(inputs: list[dr.ArrayBase], outputs: list[dr.ArrayBase], directions: list[dr.ArrayBase]) -> list[Any]:
    """Return the derivatives of outputs along a direction in the space of the inputs (forward mode).

    `inputs` are attached to the AD graph, and `outputs` are computed from them. A graph with calls of Mitsuba's
    plug-ins cannot be traversed twice, because Dr.Jit discards what they need. For several directions, use separate
    lanes for each.
    """
    for value, direction in zip(inputs, directions, strict=True):
        dr.set_grad(value, direction)
    dr.enqueue(dr.ADMode.Forward, *inputs)
    dr.traverse(dr.ADMode.Forward, flags=dr.ADFlag.ClearEdges)
    return [dr.grad(output) for output in outputs]


def copies(count: int) -> tuple[UInt32, UInt32]:
    """Return, for four lanes for each of `count` paths, the path and the number of the derivative, 0 to 3."""
    lane = dr.arange(UInt32, 4 * count) + dr.opaque(UInt32, 0)
    return lane // 4, lane % 4


def of_copies(shift: Array3f, turn: Array3f, count: int) -> RayDifferentials:
    """Return the ray differentials of `count` paths from the derivatives of their `copies`."""
    lane = dr.arange(UInt32, count) * 4
    return RayDifferentials.of(
        [(dr.gather(Array3f, shift, lane + k), dr.gather(Array3f, turn, lane + k)) for k in range(4)]
    )
