"""Where light paths begin: rays from the emitters of a Mitsuba scene, in strata, and how far apart they are.

Each emitter has a share of a pass's paths by its power, and a 4D Sobol sequence of its own: two numbers place a path on
the emitter, two direct it, as `Emitter.sample_ray` takes them. With each path go the derivatives of its origin and its
direction by these four numbers, by forward-mode differentiation; `paths` carries them on through the scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import drjit as dr
import numpy as np

from ..device import Array3f, Float, mitsuba
from ..simulation.sampling import sobol_block

mi = mitsuba()

# Paths that tell how much power an emitter has, and the least share of a pass that an emitter with any power gets.
_PILOT, _LEAST = 4096, 1 / 64


class Tangents:
    """Derivatives of rays by the four numbers of their emission: (3,) each, of origin `p` and of direction `d`."""

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {f"{name}{k}": Array3f for name in "pd" for k in range(4)}

    def columns(self) -> list[tuple[Any, Any]]:
        """Return (derivative of the origin, derivative of the direction) by each number."""
        return [(getattr(self, f"p{k}"), getattr(self, f"d{k}")) for k in range(4)]

    @classmethod
    def of(cls, columns: list[tuple[Any, Any]]) -> Tangents:
        """Return derivatives by each number as a struct."""
        result = cls()
        for k, (p, d) in enumerate(columns):
            setattr(result, f"p{k}", Array3f(p))
            setattr(result, f"d{k}", Array3f(d))
        return result


@dataclass(frozen=True)
class Emitted:
    """Light paths at their emitters.

    `flux` is the power of each, `count` of how many one sequence consists that it belongs to.
    """

    origin: Any
    direction: Any
    flux: Any
    tangents: Tangents
    count: Any


def differentiate(inputs: list[Any], outputs: list[Any], columns: list[list[Any]]) -> list[list[Any]]:
    """Return the derivatives of outputs along each column of derivatives of the inputs (forward mode).

    `inputs` are attached to the AD graph; `outputs` are computed from them. Of a graph with calls of Mitsuba's plug-ins
    there can be but one column: Dr.Jit forgets what these need for another traversal.
    """
    result = []
    for column in columns:
        for value, tangent in zip(inputs, column, strict=True):
            dr.set_grad(value, tangent)
        dr.enqueue(dr.ADMode.Forward, *inputs)
        dr.traverse(dr.ADMode.Forward, flags=dr.ADFlag.ClearInterior)
        result.append([dr.grad(output) for output in outputs])
        dr.clear_grad(outputs)
    return result


class Emitters:
    """The emitters of a Mitsuba scene and their shares of a pass's light paths.

    `power` is the flux of all, per channel.
    """

    def __init__(self, plugin: Any, seed: int = 0) -> None:
        self._plugins = plugin.emitters()
        self._seed = seed
        fluxes = [self._flux(number) for number in range(len(self._plugins))]
        power = np.array([max(flux) for flux in fluxes])
        self.power = np.sum(fluxes, axis=0) if fluxes else np.zeros(3)
        shares = np.where(power > 0, np.maximum(power / max(power.sum(), 1e-30), _LEAST), 0)
        self._shares = shares / max(shares.sum(), 1e-30)

    def _flux(self, number: int) -> np.ndarray:
        u, v = sobol_block(_PILOT, 0, (_PILOT, number))
        _, weight = self._plugins[number].sample_ray(Float(0), Float(0.5), mi.Point2f(u), mi.Point2f(v), True)
        values = (Array3f(weight) + dr.zeros(Array3f, _PILOT)).numpy()
        flux: np.ndarray = np.nan_to_num(values, posinf=0, neginf=0).mean(axis=1)
        return flux

    def emit(self, count: int, block: int) -> list[Emitted]:
        """Return about `count` light paths of pass `block`, by emitters."""
        result = []
        for number, share in enumerate(self._shares):
            own = round(share * count) if share < 1 else count
            if share > 0:
                result.append(self._emit(number, max(own, 1), block))
        return result

    def _emit(self, number: int, count: int, block: int) -> Emitted:
        u, v = (mi.Point2f(each) for each in sobol_block(count, block, (self._seed & 0xFFFFFFFF, number)))
        dr.enable_grad(u, v)
        with dr.resume_grad():
            ray, weight = self._plugins[number].sample_ray(Float(0), Float(0.5), u, v, True)
            origin, direction = ray.o, ray.d
        none = mi.Point2f(0)
        columns = [
            [mi.Point2f(*unit), none] if k < 2 else [none, mi.Point2f(*unit)]
            for k, unit in enumerate(((1, 0), (0, 1)) * 2)
        ]
        tangents = Tangents.of([tuple(each) for each in differentiate([u, v], [origin, direction], columns)])
        nothing = dr.zeros(Array3f, count)
        flux = Array3f(dr.detach(weight)) * dr.rcp(dr.opaque(Float, count)) + nothing
        valid = dr.isfinite(dr.sum(flux)) & (dr.min(flux) >= 0)
        result = Emitted(
            Array3f(dr.detach(origin)) + nothing, Array3f(dr.detach(direction)) + nothing,
            dr.select(valid, flux, 0), tangents, dr.full(Float, count, count),
        )  # fmt: skip
        dr.eval(result.origin, result.direction, result.flux, result.tangents, result.count)
        return result
