"""Light that media scatter again, or after a surface, toward the pixels of a view: the pass's tally in froxels."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ..estimators.estimate import ENDLESS
from ..numerics.arrays import to_float, to_numpy, to_uint
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..scene import Array
from ..transport.tally import Deposit, Tally
from ..transport.tuning import FREE_PATHS, radius_scale
from ..world.cameras.panoramas import OVERLAP
from ..world.media.phases import Phases
from .paths import camera_paths
from .paths.camera_paths import CameraTracing
from .paths.froxels import Froxels, FroxelSums, most_columns
from .paths.surface_light import NO_LIGHT

if TYPE_CHECKING:
    from ..estimators.projection import Projection
    from ..numerics.samples import Samples
    from ..world.bounds import Box
    from ..world.cameras.cameras import View
    from ..world.cameras.sensors import PrimaryRays
    from ..world.media.media import Media
    from ..world.media.rendered import RenderedMedium
    from ..world.world import World
    from .paths.branches import CameraPaths
    from .paths.camera_paths import CameraVertex

# The blur of the fluence in the first pass, a standard deviation, as a part of a medium's radius.
_BLUR = 0.0125
# A deposit of the usual power over the region's radius is so many units: 2^17 walks cannot exceed 63 bits.
_UNITS = 2.0**33
# Light in homogeneous media ends at this optical depth.
_DEEPEST = 12.0
# The least blur along rays through media that vary, in cells: so light is known beyond where a cell's rays end.
_ALONG = 0.6
# A medium has so many pixels across, or its own have 1 / _FINEST of their width; and so many pixels beside it.
_FEWEST, _FINEST, _BESIDE = 80, 64, 2


@dataclass(frozen=True)
class TalliedView:
    """The light of a tally toward a view.

    Attributes
    ----------
    view, media, groups
        The view, the media, and the names of the light groups.
    froxels
        The cells of each medium that the rays of the view meet, by their steps and the media's numbers, with the
        radiance of each group, or in media that vary, or `apart`, the fluence: see `Froxels`.
    apart
        Whether rays begin apart from the view's, all over a lens, and so see what it does not.
    """

    view: Projection
    media: Media
    groups: Sequence[str]
    froxels: Mapping[tuple[int, int], tuple[Froxels, Sequence[Float]]]
    apart: bool

    def weight(self, paths: CameraPaths) -> Float:
        """Return the weights of the view for camera rays, among views that overlap: 0 at its rim and beyond.

        They fall smoothly where another face of a cube has the ray, too: the noise of neighbours is not alike.
        """
        pose = self.view.poses[0]
        toward = pose.to_camera(pose.origin + paths.direction)
        aside = dr.maximum(dr.abs(toward.x), dr.abs(toward.y)) * dr.rcp(dr.maximum(toward.z, 1e-30))
        left = dr.clip((OVERLAP - aside) / (OVERLAP - 1 / OVERLAP), 0, 1)
        return dr.select(toward.z > 0, left * left * (3 - 2 * left), 0)

    def add(
        self, radiance: dict[str, Any], step: int, paths: CameraPaths, vertex: CameraVertex, *, share: Float,
        active: Bool,
    ) -> None:  # fmt: skip
        """Add the light along the camera rays that are `active`, up to their ends in one step."""
        for number, medium in self.froxels:
            # At a silhouette rays meet a medium after more surfaces than those that have found it, or after fewer.
            nearest = min((each for each, own in self.froxels if own == medium), key=lambda each: abs(each - step))
            own = active & (paths.medium == dr.opaque(UInt32, medium))
            if number != nearest or not bool(dr.any(own)):
                continue
            length = dr.select(own, dr.minimum(vertex.end, ENDLESS) - paths.near, 0)
            for group in range(len(self.groups)):
                light = self._along(medium, number, group, paths, length, vertex.seed, own)
                light *= paths.throughput * share
                name = self.groups[group]
                radiance[name] = radiance.get(name, 0) + dr.select(own, light, 0)
                dr.eval(radiance[name])

    def _along(
        self, medium: int, number: int, group: int, paths: CameraPaths, length: Float, seed: UInt32, active: Bool
    ) -> Array3f:
        """Return the light of a group along rays over lengths in a medium."""
        froxels, tables = self.froxels[number, medium]
        table, start = tables[group], paths.origin + paths.near * paths.direction
        at = froxels.view.seen(paths.origin + paths.direction).at
        cells = [(each, own[group]) for (_, where), (each, own) in self.froxels.items() if where == medium]

        def source(place: Array3f) -> Array3f:
            along = dr.dot(place - start, paths.direction)
            if not self.apart:
                return froxels.source(table, at, along)
            result = froxels.source(table, froxels.view.seen(place).at, along)
            for each, own in cells if len(cells) > 1 else ():  # the view has met the medium before and behind another
                there, inside = each.seen(place)
                result = dr.select(there, each.source(own, each.view.seen(place).at, inside), result)
            return result

        if self.media.varies(medium):
            return self.media.gathered(paths.medium, start, paths.direction, length, seed, active, source)
        if not self.apart:
            return froxels.radiance(table, at, length)
        scattering, extinction = self.media.scattering(paths.medium), self.media.extinction(paths.medium)
        return froxels.gathered(source, start, paths.direction, length, scattering=scattering, extinction=extinction)


@dataclass(frozen=True)
class PinholeRays:
    """The rays through the middles of all pixels of a part of a picture, how they are followed, and their samples.

    They find where the media with these numbers are.
    """

    view: Projection
    primary: PrimaryRays
    tracing: CameraTracing
    samples: Samples
    media: Collection[int]

    def meeting(
        self, media: Sequence[RenderedMedium]
    ) -> Iterator[tuple[tuple[int, RenderedMedium], tuple[Float, Float]]]:  # fmt: skip
        """Yield the steps in which the rays meet their media, with where these begin and end on each ray."""
        pixels = dr.width(self.primary.direction)
        begun = camera_paths.begin(self.tracing, self.primary, dr.arange(UInt32, pixels))
        for step, (paths, vertex) in enumerate(camera_paths.follow(self.tracing, begun, self.samples, NO_LIGHT)):
            for each in media:
                own = paths.alive & paths.primary & (paths.medium == dr.opaque(UInt32, each.number))
                if each.number in self.media and bool(dr.any(own)):
                    near, far = dr.zeros(Float, pixels), dr.zeros(Float, pixels)
                    dr.scatter(near, paths.near, paths.pixel, own)
                    dr.scatter(far, dr.minimum(vertex.end, ENDLESS), paths.pixel, own)
                    dr.eval(near, far)
                    yield (step, each), (near, far)


def parts_with_media(world: World, view: View) -> list[tuple[View, list[int]]]:
    """Return parts of a picture, and the numbers of the media that scatter light for which rays there are enough.

    Rays through the middles of few pixels do not tell where a small medium is. So its part has smaller pixels, as many
    as a large one has.
    """
    result: dict[tuple[tuple[int, int, int, int], int], list[int]] = {}
    shape = np.array([view.window.width, view.window.height])
    for each in _scattering(world):
        around = _around(view, world.boxes.get(each.number))
        if around is None:
            continue
        low, high = around
        finer = min(-(-_FEWEST // max(math.ceil(float((high - low).max())), 1)), _FINEST)
        if finer == 1:
            low, high = np.zeros(2), shape
        left, top = np.maximum(np.floor(low * finer) - _BESIDE, 0).astype(int).tolist()
        right, bottom = np.minimum(np.ceil(high * finer) + _BESIDE, shape * finer).astype(int).tolist()
        result.setdefault(((left, top, right, bottom), finer), []).append(each.number)
    return [(view.part(corners, finer), media) for (corners, finer), media in result.items()]


def _around(view: View, box: Box | None) -> tuple[Array, Array] | None:
    """Return the corners (x, y) of the part of a picture that shows a box, in pixels; None: it is beside the picture.

    Without a box, or with one that is partly behind the camera, that is the whole picture.
    """
    everything = np.zeros(2), np.array([view.window.width, view.window.height], dtype=np.float64)
    if box is None:
        return everything
    seen = view.projection.seen(Array3f(np.array([*product(*zip(*box, strict=True))]).T))
    if float(dr.min(seen.depth)[0]) <= 0:
        return everything
    places = to_numpy(seen.at).astype(np.float64)
    low, high = places.min(axis=1), places.max(axis=1)
    if (high <= 0).any() or (low >= everything[1]).any():
        return None
    return np.maximum(low, 0), np.minimum(high, everything[1])


def _scattering(world: World) -> list[RenderedMedium]:
    """Return the media that scatter light."""
    return [each for each in world.media.all if max(each.medium.scattering) > 0]


def tallied_view(
    world: World, tally: Tally, view: Projection, parts: Sequence[PinholeRays], number: int, *, apart: bool
) -> TalliedView:  # fmt: skip
    """Return the light of the tally of pass `number` toward a pinhole that sees a world, in parts of its picture.

    Rays that begin `apart` from the pinhole, all over a lens, also see what it does not.
    """
    sources, media = world.sources, _scattering(world)
    groups = sorted({each.group for each in sources})
    shrunk = radius_scale(tally.alpha, number)
    blur = {
        each.number: shrunk * min(_BLUR * world.radius_of(each), FREE_PATHS / max(*each.medium.extinction, 1e-30))
        for each in media
    }
    # Of each group by itself: the light of a still lamp does not change when another one begins to shine.
    numbers, power = np.array([groups.index(each.group) for each in sources]), np.zeros(len(groups))
    np.maximum.at(power, numbers[tally.starts.source.numpy()], tally.starts.initial.numpy())
    units = np.where(power > 0, power, 1.0) * (tally.tracing.region / _UNITS)
    froxels: dict[tuple[int, int], Froxels] = {}
    for rays in parts:
        for (step, each), (near, far) in rays.meeting(media):
            froxels[step, each.number] = Froxels.of(
                rays.view,
                facing=rays.primary.facing,
                near=near,
                far=far,
                deepest=np.inf if each.tracked else _DEEPEST / max(min(each.medium.extinction), 1e-30),
                blur=blur[each.number],
                most=most_columns(3 * len(groups) * len(media)),
            )
    group_of = to_uint([*numbers, 0])
    scale_of = to_float([*(each.beam_scale for each in sources), 0])

    def deposit(own: Deposit, active: Bool) -> None:
        group, light = dr.gather(UInt32, group_of, own.source), own.light * dr.gather(Float, scale_of, own.source)
        sums.add(own.place, light, own.medium, group, partial(_phase, own), active)

    result: dict[tuple[int, int], tuple[Froxels, Sequence[Float]]] = {}
    if not froxels:
        return TalliedView(view, world.media, groups, result, apart=apart)
    traced = {seen: number for number, seen in tally.media.items()}
    sums = FroxelSums(view, [*froxels.values()], [traced.get(number, number) for _, number in froxels], units.tolist())
    tally.fill(deposit, None if view.orthographic else view.origin)
    for index, ((step, number), cells) in enumerate(froxels.items()):
        if apart or world.media.varies(number):
            fluence = cells.fluence(blur[number], sums.of(index), apart, _ALONG)
            tables = [to_float(each.ravel()) for each in fluence]
        else:
            medium = next(each.medium for each in media if each.number == number)
            tables = cells.tables(medium, blur[number], sums.of(index))
        result[step, number] = cells, tables
    return TalliedView(view, world.media, groups, result, apart=apart)


def _phase(deposit: Deposit, toward: Array3f, active: Bool) -> Array3f:
    """Return 4π times the phase function for light that goes on in other directions."""
    value, _ = Phases(deposit.place, deposit.direction, deposit.medium, active).value(toward, active)
    return 4 * dr.pi * value
