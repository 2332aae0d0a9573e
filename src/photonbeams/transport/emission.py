"""Where light paths begin: rays from the emitters of a Mitsuba scene, in strata, and how far apart they are.

Each emitter has a share of a pass's paths by its power, and a 4D Sobol sequence of its own: two numbers place a path on
the emitter, two direct it, as `Emitter.sample_ray` takes them. With each path go the derivatives of its origin and its
direction by these four numbers, by forward-mode differentiation; `paths` carries them on through the scene.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import drjit as dr
import numpy as np

from ..numerics.arrays import to_float
from ..numerics.sampling import pairs, sobol_block, sobol_points
from ..runtime.device import Array2f, Array3f, Float, UInt32, mitsuba
from ..world.media import check_finite
from .guiding import PILOT, Guide, Numbers, learn

mi = mitsuba()

# Paths that tell how much power an emitter has, and the least share of a pass that an emitter with any power gets.
_PILOT, _LEAST = 4096, 1 / 64

# Points of SciPy's Sobol sequences, after which another one begins.
_SEQUENCE = 1 << 30


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

    `flux` is the power of each, `count` of how many one sequence consists that it belongs to, `emitter` the place of
    the emitter among the scene's.
    """

    origin: Any
    direction: Any
    flux: Any
    tangents: Tangents
    count: Any
    emitter: int = 0


def differentiate(inputs: list[Any], outputs: list[Any], directions: list[Any]) -> list[Any]:
    """Return the derivatives of outputs along a direction in the space of the inputs (forward mode).

    `inputs` are attached to the AD graph, and `outputs` are computed from them. There is no second traversal of a graph
    with calls of Mitsuba's plug-ins: Dr.Jit forgets what they need. For several directions let lanes stand for each.
    """
    for value, direction in zip(inputs, directions, strict=True):
        dr.set_grad(value, direction)
    dr.enqueue(dr.ADMode.Forward, *inputs)
    dr.traverse(dr.ADMode.Forward, flags=dr.ADFlag.ClearEdges)
    return [dr.grad(output) for output in outputs]


def copies(count: int) -> tuple[UInt32, UInt32]:
    """Return numbers of lanes that stand for each of `count` four times, and which of the four they are."""
    lane = dr.arange(UInt32, 4 * count) + dr.opaque(UInt32, 0)
    return lane // 4, lane % 4


def of_copies(shift: Any, turn: Any, count: int) -> Tangents:
    """Return the derivatives of such lanes as those of each by all four numbers."""
    lane = dr.arange(UInt32, count) * 4
    return Tangents.of([(dr.gather(Array3f, shift, lane + k), dr.gather(Array3f, turn, lane + k)) for k in range(4)])


class Emitters:
    """The emitters of a Mitsuba scene and their shares of a pass's light paths.

    `power` is the flux of all, per channel.
    """

    def __init__(self, plugin: Any, seed: int = 0) -> None:
        self._scene, self._plugins = plugin, plugin.emitters()  # an emitter alone does not keep its shape alive
        self._seed = seed
        for each in self._plugins:
            check_finite(each, f"emitter {each.id() or each.class_name()}")
        fluxes = [self._flux(number) for number in range(len(self._plugins))]
        power = np.array([max(flux) for flux in fluxes])
        self.power = np.sum(fluxes, axis=0) if fluxes else np.zeros(3)
        shares = np.where(power > 0, np.maximum(power / max(power.sum(), 1e-30), _LEAST), 0)
        self._shares = shares / max(shares.sum(), 1e-30)
        self._guides: dict[int, Guide | None] = {}

    def _flux(self, number: int) -> np.ndarray:
        u, v = sobol_block(_PILOT, 0, (_PILOT, number))
        _, weight = self._sample(number, mi.Point2f(u), mi.Point2f(v))
        values = (Array3f(weight) + dr.zeros(Array3f, _PILOT)).numpy()
        flux: np.ndarray = np.nan_to_num(values, posinf=0, neginf=0).mean(axis=1)
        return flux

    def _sample(self, number: int, u: Any, v: Any) -> Any:
        """Return Mitsuba's ray from an emitter and its weight."""
        return self._plugins[number].sample_ray(Float(0), Float(0.5), u, v, True)

    def learn(self, importance: Callable[[list[Emitted]], Numbers]) -> None:
        """Guide emission toward what is seen.

        Parameters
        ----------
        importance
            Returns for light paths of a pilot pass how much of their light is seen, (N,), in their order.
        """
        pilot = [
            self._emit(number, max(round(share * PILOT), 1), 0, pilot=True) if share > 0 else None
            for number, share in enumerate(self._shares)
        ]
        emitted = [each for each in pilot if each is not None]
        if not emitted:
            return
        seen = importance(emitted)
        sums = np.zeros(len(self._shares))
        first = 0
        for number, each in enumerate(pilot):
            if each is not None:
                count = dr.width(each.origin)
                own = seen[first : first + count]
                sums[number], first = own.sum(), first + count
                self._guides[number] = learn(self._points(number, count, 0, pilot=True), own)
        if sums.sum() > 0:  # as much of what is seen as of what there is
            self._shares = 0.5 * self._shares + 0.5 * sums / sums.sum()

    def _points(self, number: int, count: int, block: int, pilot: bool = False) -> Numbers:
        blocks = max(1, _SEQUENCE // count)
        more = (1,) if pilot else (2, block // blocks) if block >= blocks else ()
        return sobol_points(count, block % blocks, (self._seed & 0xFFFFFFFF, number, *more))

    def emit(self, count: int, block: int) -> list[Emitted]:
        """Return about `count` light paths of pass `block`, by emitters."""
        result = []
        for number, share in enumerate(self._shares):
            own = round(share * count) if share < 1 else count
            if share > 0:
                result.append(self._emit(number, max(own, 1), block))
        return result

    def _emit(self, number: int, count: int, block: int, pilot: bool = False) -> Emitted:
        points = self._points(number, count, block, pilot)
        guide = None if pilot else self._guides.get(number)
        stretch = np.ones((count, 4), dtype=np.float32)
        if guide is not None:
            points, stretch = guide(points)
        u, v = pairs(points)
        tangents = self._tangents(number, u, v, pairs(stretch))
        ray, weight = self._sample(number, mi.Point2f(u), mi.Point2f(v))
        nothing = dr.zeros(Array3f, count)
        flux = Array3f(weight) * to_float(np.prod(stretch, axis=1) / count) + nothing
        valid = dr.isfinite(dr.sum(flux)) & (dr.min(flux) >= 0)
        result = Emitted(
            Array3f(ray.o) + nothing, Array3f(ray.d) + nothing, dr.select(valid, flux, 0), tangents,
            dr.full(Float, count, count), number,
        )  # fmt: skip
        dr.eval(result.origin, result.direction, result.flux, result.tangents, result.count)
        return result

    def _tangents(self, number: int, u: Array2f, v: Array2f, stretch: tuple[Array2f, Array2f]) -> Tangents:
        """Return the derivatives of rays by the four numbers, before a guide stretched them."""
        count = dr.width(u)
        lane, which = copies(count)
        inputs = [mi.Point2f(dr.gather(Array2f, each, lane)) for each in (u, v)]
        scales = [dr.gather(Array2f, each, lane) for each in stretch]
        units = [
            mi.Point2f(dr.select(which == 2 * k, scale.x, 0), dr.select(which == 2 * k + 1, scale.y, 0))
            for k, scale in enumerate(scales)
        ]
        with dr.resume_grad():  # whatever the caller has suspended, as `mi.render` does
            dr.enable_grad(inputs)
            ray, _ = self._sample(number, *inputs)
            shift, turn = differentiate(inputs, [ray.o, ray.d], units)
        shift, turn = (Array3f(each) + dr.zeros(Array3f, 4 * count) for each in (shift, turn))
        dr.eval(shift, turn)
        return of_copies(shift, turn, count)
