"""Ray differentials of light (Igehy 1999): derivatives of rays by the four numbers of their emission sample."""

from __future__ import annotations

from typing import Any, ClassVar

import drjit as dr

from ..runtime.device import Array3f, UInt32


class RayDifferentials:
    """Derivatives of rays by their emission sample, four each: (3,) of origin `p` and (3,) of direction `d`."""

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {f"{name}{k}": Array3f for name in "pd" for k in range(4)}

    def columns(self) -> list[tuple[Any, Any]]:
        """Return (derivative of the origin, derivative of the direction) by each number."""
        return [(getattr(self, f"p{k}"), getattr(self, f"d{k}")) for k in range(4)]

    @classmethod
    def of(cls, columns: list[tuple[Any, Any]]) -> RayDifferentials:
        """Return derivatives by each number as a struct."""
        result = cls()
        for k, (p, d) in enumerate(columns):
            setattr(result, f"p{k}", Array3f(p))
            setattr(result, f"d{k}", Array3f(d))
        return result


def differentiate(inputs: list[Any], outputs: list[Any], directions: list[Any]) -> list[Any]:
    """Return the derivatives of outputs along a direction in the space of the inputs (forward mode).

    `inputs` are attached to the AD graph, and `outputs` are computed from them. There is no second traversal of a graph
    with calls of Mitsuba's plug-ins: Dr.Jit forgets what they need. For several directions, give each lanes of its own.
    """
    for value, direction in zip(inputs, directions, strict=True):
        dr.set_grad(value, direction)
    dr.enqueue(dr.ADMode.Forward, *inputs)
    dr.traverse(dr.ADMode.Forward, flags=dr.ADFlag.ClearEdges)
    return [dr.grad(output) for output in outputs]


def copies(count: int) -> tuple[UInt32, UInt32]:
    """Return for 4 · `count` lanes, four for each path, the path and which of its four derivatives the lane has."""
    lane = dr.arange(UInt32, 4 * count) + dr.opaque(UInt32, 0)
    return lane // 4, lane % 4


def of_copies(shift: Any, turn: Any, count: int) -> RayDifferentials:
    """Return the ray differentials of `count` paths from the derivatives of their `copies`."""
    lane = dr.arange(UInt32, count) * 4
    return RayDifferentials.of(
        [(dr.gather(Array3f, shift, lane + k), dr.gather(Array3f, turn, lane + k)) for k in range(4)]
    )
