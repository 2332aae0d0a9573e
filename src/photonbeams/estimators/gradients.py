"""Derivatives of beams' radiance along rays, by positions, radii and power of beams, by the fog and by looks.

The estimators' loops are made for speed and have no derivatives. If something is attached to Dr.Jit's AD graph, the
pairs of rays and beams that meet are listed, and the frustum's integral is computed once more for each pair, as a graph
without loops: the chord's ends depend on the beam, and the rule's points on the ends (Leibniz's rule, by the chain
rule). Each of the rule's points has a lane of its own: else kernels would contain the integrand once for each of them,
and each would have a kernel of its own that sums its derivative by a number.
"""

from __future__ import annotations

import drjit as dr

from ..looks import BoundLook
from ..numerics.syntax import syntax
from ..quadrature import gauss_legendre
from ..runtime.device import Array3f, Float, UInt32
from ..scene import SceneError
from .frustum import integrand, unchanging
from .geometry import Rays, chord
from .points import Points
from .records import Packed, Record, load

# Most pairs: kernels of derivatives hold a few hundred bytes for each.
MOST_PAIRS = 1 << 24

_PIECES = 2  # of a chord: derivatives are as smooth as the factors, except at knots of a ramp
_FINE_PIECES = 12  # if the look has corners in the radius, or changes in space
_RULE = gauss_legendre(6)  # for each piece


def radiance(packed: Packed, rays: Rays, look: BoundLook, count: int) -> Array3f:
    """Return the radiance of all beams toward `count` rays, attached to the graph.

    Raises
    ------
    SceneError
        If more pairs of rays and beams meet than fit into memory.
    """
    pieces = _FINE_PIECES if look.rings or look.of_places else _PIECES
    with dr.suspend_grad():
        ray, beam = _pairs(packed, rays, count, MOST_PAIRS * _PIECES // pieces)
        result = dr.zeros(Array3f, count)
        if not dr.width(ray):
            return result
        lanes = pieces * len(_RULE.points)
        ray, beam = dr.repeat(ray, lanes), dr.repeat(beam, lanes)
    found = load(packed, beam, _of(Float, rays.time, ray))
    part = _at_points(found, _taken(rays, ray), look, pieces)
    dr.scatter_add(result, part, ray)
    return result


def _pairs(packed: Packed, rays: Rays, count: int, most: int) -> tuple[UInt32, UInt32]:
    """Return the numbers of the rays and of the beams that meet, for each pair."""
    counter = dr.zeros(UInt32, count)
    _meet(packed, rays, counter, None, None, None)
    dr.eval(counter)
    total = int(dr.sum(counter)[0])
    if total > most:
        raise SceneError(
            f"{total:,} pairs of rays and beams have derivatives: expected at most {most:,}; take fewer rays"
        )
    base = dr.prefix_sum(counter)
    ray, beam = dr.zeros(UInt32, max(total, 1)), dr.zeros(UInt32, max(total, 1))
    _meet(packed, rays, dr.zeros(UInt32, count), base, ray, beam)
    dr.eval(ray, beam)
    return (ray, beam) if total else (UInt32(), UInt32())


@syntax
def _meet(
    packed: Packed, rays: Rays, counter: UInt32, base: UInt32 | None, out_ray: UInt32 | None, out_beam: UInt32 | None
) -> None:
    """Count the beams that each ray meets or, with `base`, list the pairs."""
    ray = dr.arange(UInt32, dr.width(counter))
    first = dr.gather(UInt32, base, ray) if dr.hint(base is not None, mode="scalar") else ray
    number, found, stop = UInt32(0), UInt32(0), dr.opaque(UInt32, packed.count)
    while number < stop:
        part = chord(load(packed, number, rays.time), rays.origin, rays.direction, rays.t_min, rays.t_max)
        if dr.hint(base is not None, mode="scalar"):
            dr.scatter(out_ray, ray, first + found, part.valid)
            dr.scatter(out_beam, number, first + found, part.valid)
        found += dr.select(part.valid, UInt32(1), 0)
        number += 1
    dr.scatter(counter, found, ray)


def _of(kind: type[dr.ArrayT], value: dr.ArrayT | None, index: UInt32) -> dr.ArrayT | None:
    """Return the entries of an array; a single entry serves all."""
    if value is None:
        return None
    return kind(value) if dr.width(value) == 1 else dr.gather(kind, value, index)


def _taken(rays: Rays, index: UInt32) -> Rays:
    return Rays(
        _of(Array3f, rays.origin, index), _of(Array3f, rays.direction, index), _of(Float, rays.t_max, index),
        _of(Float, rays.t_min, index), time=_of(Float, rays.time, index), base=rays.base, index=index,
    )  # fmt: skip


def _at_points(beam: Record, ray: Rays, look: BoundLook, pieces: int) -> Array3f:
    """Return what one point of the rule in one of `pieces` equal pieces of the chord adds to a beam's radiance.

    The next lane has the next point, and the last point of a piece is followed by the first of the next piece.
    """
    part = chord(beam, ray.origin, ray.direction, ray.t_min, ray.t_max)
    half = (part.b - part.a) * (0.5 / pieces)
    count, lane = len(_RULE.points), dr.arange(UInt32, dr.width(ray.index))
    node = Points(_RULE)(lane % count)
    middle = part.a + half * Float(2 * (lane // count % pieces) + 1)
    light = integrand(beam, part, dr.fma(half, node.x, middle), look, ray) * (node.y * half)
    return dr.select(part.valid, unchanging(beam, part, look) * light, 0)
