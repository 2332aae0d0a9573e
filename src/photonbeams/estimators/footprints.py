"""Screen footprints of beams: the hull of two discs each, widened by the lens and by motion.

The projection of a cone is the hull of two discs. Its half extent R/z is linear along the projected axis: numbers that
are linear along the axis, as R and 1, are linear on the screen once they are divided by z. A beam that contains the
camera, or nearly does, has no such footprint: every tile lists it, as the Talk puts a quad over the whole screen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr

from ..beams import Beams
from ..runtime.device import Array2f, Array3f, Array4f, Bool, Float, UInt32
from .cones import Cone, around
from .projection import Pose, Projection

FAR = 1e30  # pixels

# Beams are clipped this many radii in front of the camera plane, where a disc's picture is still an ellipse.
_CLIP = 1.25
# Of beams around the camera, the part that is farther than this many radii has a width on the screen: anything nearer
# covers more than a quarter of a radian.
_WIDE = 4.0


@dataclass
class Footprints:
    """Screen footprints of N beams: two discs, x, y and half extents in pixels, and 1/z, packed for gathering."""

    data: Any  # three packets of four a beam
    count: int


def footprints(beams: Beams, view: Projection, close: Beams | None = None) -> Footprints:
    """Project beams to the screen, widened by the lens and by all motion over the shutter.

    At any time, each end of a beam is in camera space a convex combination of its places with camera and beam at
    shutter open and at shutter close. So the box around an end's discs at those times holds this end, and the hull of
    both ends' boxes holds the beam, at all times.
    """
    cones = [_posed(each, pose) for pose in view.poses for each in (beams, close) if each is not None]
    near, visible, limit = _nearness(cones, view)
    limit = dr.select(near, limit * (_WIDE / _CLIP), limit)
    starts = _Box.around(_clipped(cones, limit, view), view)
    ends = _Box.around(_clipped([Cone(b, a, rb, ra) for a, b, ra, rb in cones], limit, view), view)
    widest = cones[0].radius_start
    for cone in cones:
        widest = dr.maximum(widest, dr.maximum(cone.radius_start, cone.radius_end))
    packets = (
        Array4f(starts.x, starts.y, ends.x, ends.y),
        Array4f(starts.half_x, starts.half_y, ends.half_x, ends.half_y),
        Array4f(starts.key, ends.key, widest, dr.select(near, 1, dr.select(visible, 0, -1))),
    )
    data = dr.zeros(Float, len(beams) * 12)
    for number, packet in enumerate(packets):
        dr.scatter(data, packet, dr.arange(UInt32, len(beams)) * 3 + number)
    dr.eval(data)
    return Footprints(data, len(beams))


def _posed(beams: Beams, pose: Pose) -> Cone:
    """Return the bounds of beams in camera space."""
    return around(beams, pose.to_camera(beams.start), pose.to_camera(beams.end))


def _nearness(cones: list[Cone], view: Projection) -> tuple[Bool, Bool, Float]:
    """Return which beams are near the camera, which can be seen at all, and the z at which each is clipped.

    A disc of radius R about a point c behind the clip plane z = ε is seen, in a picture whose corner lies at the angle
    e, only if √(|c|² − ε²) cos e − ε sin e < R. Beams that come so near count as seen everywhere. For moving beams, and
    for rays from all over a lens, R is that of a beam at rest that holds all of them.
    """
    first = cones[0]
    largest, moved = dr.maximum(first.radius_start, first.radius_end), Float(0)
    for cone in cones[1:]:
        largest = dr.maximum(largest, dr.maximum(cone.radius_start, cone.radius_end))
        moved = dr.maximum(moved, dr.maximum(dr.norm(cone.start - first.start), dr.norm(cone.end - first.end)))
    reach = largest + moved + (view.lens[0] if view.lens is not None else 0)
    limit = dr.maximum(_CLIP * reach, 1e-6)
    if view.orthographic:
        count = dr.width(largest)
        return dr.full(Bool, False, count), dr.full(Bool, True, count), limit
    axis = first.end - first.start
    where = dr.clip(-dr.dot(first.start, axis) / dr.maximum(dr.squared_norm(axis), 1e-20), 0, 1)
    distance = dr.norm(first.start + axis * where)
    edge_x, edge_y = _edges(view)
    corner = dr.sqrt(1 + edge_x * edge_x + edge_y * edge_y)
    nearest, farthest = first.start.z, first.start.z
    for cone in cones:
        nearest = dr.minimum(nearest, dr.minimum(cone.start.z, cone.end.z))
        farthest = dr.maximum(farthest, dr.maximum(cone.start.z, cone.end.z))
    near = (nearest < limit) & (distance < (_CLIP + (1 + _CLIP) * corner) * reach)
    return near, near | (farthest > limit), limit


def _edges(view: Projection) -> tuple[Float, Float]:
    """Return the greatest |x/z| and |y/z| of rays: from the rim of a lens they lean farther out than from a pinhole."""
    lean = view.lens[0] / view.lens[1] if view.lens is not None else Float(0)
    return view.edge_x + lean, view.edge_y + lean


def _clipped(cones: list[Cone], limit: Float, view: Projection) -> list[tuple[Array3f, Float, Bool]]:
    """Return centre, radius and validity of the discs whose hull holds the cones' starts, in front of the clip plane.

    A start behind the plane is replaced by the points where the lines from it to all other corners of the hull pass the
    plane.
    """
    if view.orthographic:
        return [(cone.start, cone.radius_start, Bool(True)) for cone in cones]
    discs = []
    for cone in cones:
        start, radius = cone.start, cone.radius_start
        others = [(other.end, other.radius_end) for other in cones]
        others += [(other.start, other.radius_start) for other in cones if other is not cone]
        behind = start.z < limit
        for corner, corner_radius in others:
            dz = corner.z - start.z
            cut = dr.select(behind, dr.clip((limit - start.z) / dr.select(dz == 0, 1, dz), 0, 1), 0)
            place = start + (corner - start) * cut
            place.z = dr.maximum(place.z, limit)
            discs.append((place, dr.lerp(radius, corner_radius, cut), ~behind | (corner.z > limit)))
    return discs


class _Box(NamedTuple):
    """Screen box of discs: centre and half extents in pixels, and the key of the nearest depth."""

    x: Any
    y: Any
    half_x: Any
    half_y: Any
    key: Any

    @classmethod
    def around(cls, discs: list[tuple[Array3f, Float, Bool]], view: Projection) -> _Box:
        """Return the box of all valid discs; without any, the beam is not seen and the box has no meaning."""
        low, high, key = Array2f(FAR), Array2f(-FAR), Float(-FAR)
        for place, radius, valid in discs:
            center, half = _disc(place, radius, view)
            low = dr.select(valid, dr.minimum(low, center - half), low)
            high = dr.select(valid, dr.maximum(high, center + half), high)
            key = dr.select(valid, dr.maximum(key, _key(place.z, view)), key)
        middle, extent = 0.5 * (low + high), 0.5 * (high - low)
        return cls(middle.x, middle.y, extent.x, extent.y, key)


def _disc(place: Array3f, radius: Float, view: Projection) -> tuple[Array2f, Array2f]:
    """Return centre and half extents in pixels of a disc, with its blur where it is out of focus."""
    (sx, sy), (cx, cy) = view.scale, view.center
    z = Float(1) if view.orthographic else dr.rcp(place.z)
    center = Array2f(cx + sx * place.x * z, cy - sy * place.y * z)
    if view.orthographic:
        return center, Array2f(dr.abs(sx) * radius, dr.abs(sy) * radius)
    # In a picture with this greatest slope, a sphere's picture is at most this much wider than R/z.
    edge_x, edge_y = _edges(view)
    half = Array2f(dr.sqrt(1 + edge_x * edge_x), dr.sqrt(1 + edge_y * edge_y)) * (radius * z)
    if view.lens is not None:
        half += view.lens[0] * dr.abs(z - dr.rcp(view.lens[1]))
    return center, half * Array2f(dr.abs(sx), dr.abs(sy))


def _key(z: Float, view: Projection) -> Float:
    # Depths are compared by a number that is linear on the screen: 1/z in perspective, −z in parallel projection.
    return -z if view.orthographic else dr.rcp(z)
