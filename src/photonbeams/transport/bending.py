"""Ray differentials of light paths over mirrors and through lenses."""

from __future__ import annotations

import drjit as dr

from ..numerics.arrays import indices
from ..numerics.hashing import hash32
from ..runtime.device import Array3f, Bool, UInt32, mitsuba
from ..world.differentials import RayDifferentials, copies, differentiate, of_copies
from .interactions import sampled
from .segments.records import LightPaths
from .tracing import Tracing

mi = mitsuba()


def carry(tracing: Tracing, paths: LightPaths, following: LightPaths, bent: Bool, stream: UInt32) -> None:
    """Propagate ray differentials over mirrors and through lenses, by forward-mode differentiation.

    Each path has four lanes, one for each derivative, because Dr.Jit can traverse a graph with BSDF calls only once.
    """
    lanes = indices(bent)
    if not len(lanes):
        return
    count = len(lanes)
    copy, which = copies(count)
    lane = dr.gather(UInt32, lanes, copy)
    shift, turn = Array3f(0), Array3f(0)
    for k, (p, d) in enumerate(paths.differentials.columns()):
        shift = dr.select(which == k, dr.gather(Array3f, p, lane), shift)
        turn = dr.select(which == k, dr.gather(Array3f, d, lane), turn)
    origin = mi.Point3f(dr.gather(Array3f, paths.origin, lane))
    direction = mi.Vector3f(dr.gather(Array3f, paths.direction, lane))
    index, own, link = (dr.gather(UInt32, each, lane) for each in (paths.index, stream, paths.link))
    with dr.resume_grad():
        dr.enable_grad(origin, direction)
        hit = tracing.world.intersect(origin, direction, Bool(True), hash32(own, index), link)
        sample, _ = sampled(tracing.world, hit, True, index, own)
        p, d = differentiate([origin, direction], [hit.p, hit.to_world(sample.wo)], [shift, turn])
    shift, turn = Array3f(p), Array3f(d)
    dr.eval(shift, turn)
    columns = []
    bent_columns = of_copies(shift, turn, count).columns()
    for unbent, changed in zip(following.differentials.columns(), bent_columns, strict=True):
        column = [Array3f(each) for each in unbent]
        for each, value in zip(column, changed, strict=True):
            dr.scatter(each, value, lanes)
        columns.append((column[0], column[1]))
    following.differentials = RayDifferentials.of(columns)
    dr.eval(following.differentials)
