"""Media in the form that kernels and estimators need: coefficients, transmittance, looks.

Mitsuba's own integrators track the medium from the sensor onward, across the surfaces that a path passes, and rely on
the medium that the sensor names. Light paths begin at emitters, which seldom name one: see `surroundings`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ...numerics.arrays import to_float, to_uint, to_vectors
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ...scene.media import check_depth
from ..checks import check_phase
from ..shadow_rays import leaving, size_of
from .interfaces import medium_ahead, number, numbers, pointers
from .parts import boxes, parts
from .rendered import FAR, coefficients_of, extinction_of, rendered, scattering_of
from .tracking import SEGMENTS, MediumSegment, glow, scattering_point, walk

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import MiMedium, MiScene, MiShape, MiVolume

mi = mitsuba()


class Media:
    """The media of a scene, and their coefficients for kernels.

    Parameters
    ----------
    plugins
        Mitsuba's media; repeated ones count once.
    around
        The Mitsuba scene, if several of its shapes have media inside, which may touch; else None.
    filling, clear
        The medium that fills the whole space, and whether it leaves light from infinity undimmed.
    unfelt
        Media that only beams feel: they do not dim surfaces.
    emission
        Mitsuba's volumes of the radiance that heterogeneous media emit per scene unit, by the media's numbers.

    Raises
    ------
    SceneError
        A medium cannot be rendered.
    """

    def __init__(
        self, plugins: Iterable[Any], around: MiScene | None = None, filling: MiMedium | None = None,
        clear: bool = False, unfelt: Sequence[MiMedium] = (), emission: Mapping[int, MiVolume] | None = None,
    ) -> None:  # fmt: skip
        found = {number(plugin): plugin for plugin in plugins if plugin is not None}
        for each in found.values():  # first, because a call of one phase function calls those of all media
            check_phase(each)
        # In the scene's order. Numbers differ between processes: in their order, sums of light would round differently.
        self.all = tuple(rendered(each, found[each]) for each in found)
        size = max(found, default=0) + 2  # 2 or more, as `numerics.arrays.padded` explains
        table = np.zeros((3, size, 3))
        for each in self.all:
            table[0, each.number] = each.medium.extinction
            table[1, each.number] = each.medium.scattering
            table[2, each.number] = each.tracked is not None, each.colored, not each.plugin.is_homogeneous()
        self._extinction, self._scattering, self._kinds = (to_vectors(each) for each in table)
        mean = np.zeros(size)
        mean[[each.number for each in self.all]] = [
            each.fullness * np.mean(each.medium.extinction) for each in self.all
        ]
        self._mean = to_float(mean)
        self.any_varying = any(each.tracked is not None for each in self.all)
        self._around, self._size = around, size_of(*([] if around is None else [around]))
        self.filling, self._clear = number(filling), clear
        felt = np.ones(size, dtype=np.uint32)
        felt[[number(each) for each in unfelt]] = 0
        self._felt = to_uint(felt) if unfelt else None
        self._emission = [(each, emission[each.number]) for each in self.all if emission and each.number in emission]

    @classmethod
    def of(cls, plugin: MiScene) -> Media:
        """Return the media of a Mitsuba scene: those inside and around shapes, and those of sensors and emitters."""
        named = [each.get_medium() for each in (*plugin.sensors(), *plugin.emitters())]
        shapes = parts(plugin, mi.Shape)
        several = sum(each.interior_medium() is not None for each in shapes) > 1 or any(map(_repeats, shapes))
        result = cls([*parts(plugin, mi.Medium), *named], plugin if several else None)
        held = boxes(shapes)
        for each in result.all:
            if each.tracked is not None and each.number in held:
                extents = np.diag([*np.asarray(held[each.number].extents(), dtype=float), 1.0])
                name = f"medium {each.plugin.id() or each.plugin.class_name()}"
                check_depth(max(each.medium.extinction), extents, name)
        return result

    def extinction(self, medium: UInt32) -> Array3f:
        """Return σt of media by their numbers; 0 in empty space."""
        return dr.gather(Array3f, self._extinction, medium)

    def scattering(self, medium: UInt32) -> Array3f:
        """Return σs of media by their numbers; 0 in empty space."""
        return dr.gather(Array3f, self._scattering, medium)

    def mean_extinction(self, medium: UInt32) -> Float:
        """Return the mean of σt of media over channels, and over the grid of those that vary."""
        return dr.gather(Float, self._mean, medium)

    def coefficients(self, medium: UInt32, place: Array3f) -> tuple[Array3f, Array3f]:
        """Return σs and σt of media at places; those that vary go on beyond their box as they are at its sides."""
        scattering, extinction = self.scattering(medium), self.extinction(medium)
        if not self.any_varying:
            return scattering, extinction
        varying, _ = self.varying(medium)
        here = coefficients_of(pointers(dr.select(varying, medium, 0)), place, varying)
        return dr.select(varying, here[0], scattering), dr.select(varying, here[2], extinction)

    def extent(self, medium: UInt32, origin: Array3f, direction: Array3f, length: Float) -> tuple[Float, Float]:
        """Return where rays enter and leave the boxes of media that vary, up to a length; others have no box."""
        if not self.any_varying:
            return Float(0), length
        varying, _ = self.varying(medium)
        media = pointers(dr.select(varying, medium, 0))
        inside, enter, leave = media.intersect_aabb(mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction)))
        begin = dr.select(varying & inside, dr.maximum(enter, 0), 0)
        end = dr.select(inside, dr.maximum(dr.minimum(leave, length), begin), begin)
        return begin, dr.select(varying, end, length)

    def varying(self, medium: UInt32) -> tuple[Bool, Bool]:
        """Return which media have coefficients that vary, and which of these have a coloured extinction."""
        kind = dr.gather(Array3f, self._kinds, medium)
        return kind.x > 0, kind.y > 0

    def varies(self, medium: int) -> bool:
        """Return whether the medium with a number has coefficients that vary."""
        return any(each.number == medium and each.tracked is not None for each in self.all)

    def absorbed(self, medium: UInt32, distance: Float) -> Array3f:
        """Return exp(−σt x) of homogeneous media; in empty space it is 1, even at an infinite distance."""
        extinction = self.extinction(medium)
        thick = extinction > 0
        if self._clear:
            thick &= distance < FAR
        return dr.select(thick, dr.exp(-extinction * distance), 1)

    def felt(self, medium: UInt32, transmittance: Array3f) -> Array3f:
        """Return a transmittance as surfaces feel it: 1 in beams-only media."""
        if self._felt is None:
            return transmittance
        return dr.select(dr.gather(UInt32, self._felt, medium) > 0, transmittance, 1)

    def transmittance(
        self, medium: UInt32, origin: Array3f, direction: Array3f, distance: Float, seed: UInt32, active: Bool,
        coarse: bool = False,
    ) -> Array3f:  # fmt: skip
        """Return the transmittance over a distance along rays, an unbiased estimate in heterogeneous media.

        Pieces are a quarter of a free path long, at the greatest extinction. In a `coarse` estimate, for rays whose
        noise hardly counts, they are a whole free path long.
        """
        plain = self.absorbed(medium, distance)
        if not self.any_varying:
            return plain
        varying = active & (dr.gather(Array3f, self._kinds, medium).z > 0)
        media = pointers(dr.select(varying, medium, 0))
        segment = self._segment(medium, origin, direction, distance, seed, 1 if coarse else 4)
        return dr.select(varying, walk(segment, extinction_of(media, varying), varying), plain)

    def scattering_point(
        self, medium: UInt32, origin: Array3f, direction: Array3f, distance: Float, *, seed: UInt32, sample: Float,
        active: Bool, fine: int = 0,
    ) -> tuple[Float, Array3f]:  # fmt: skip
        """Return a point on each ray at which a medium scatters light toward its origin, and its weight.

        See `tracking.scattering_point`, and for `fine` `_segment`.
        """
        media = pointers(dr.select(active, medium, 0))
        place, weight = scattering_point(
            self._segment(medium, origin, direction, distance, seed, fine), extinction_of(media, active),
            scattering_of(media, active), sample, active,
        )  # fmt: skip
        return dr.select(active, place, 0), dr.select(active, weight, 0)

    def gathered(
        self, medium: UInt32, origin: Array3f, direction: Array3f, distance: Float, seed: UInt32, active: Bool,
        source: Callable[[Array3f], Array3f],
    ) -> Array3f:  # fmt: skip
        """Return the radiance along rays of light that media scatter toward their origins, an unbiased estimate.

        That is ∫ T(t) σs(t) S dt, with the `source` S, the phase function's mean of the radiance, at points.
        """
        media = pointers(dr.select(active, medium, 0))
        segment, scattering = self._segment(medium, origin, direction, distance, seed), scattering_of(media, active)
        return glow(segment, extinction_of(media, active), lambda point: scattering(point) * source(point), active)

    def _segment(
        self, medium: UInt32, origin: Array3f, direction: Array3f, distance: Float, seed: UInt32, fine: int = 0
    ) -> MediumSegment:
        """Return rays' segments in media; with `fine`, a free path at the greatest extinction has so many pieces."""
        majorant = dr.max(self.extinction(medium))
        result = MediumSegment(origin, direction, *self.extent(medium, origin, direction, distance), majorant, seed)
        if fine:
            result.pieces = UInt32(dr.clip(dr.ceil(fine * majorant * (result.far - result.near)), 1, SEGMENTS))
        return result

    def all_felt(self) -> Media:
        """Return the media as beams feel them, all of which dim light."""
        if self._felt is None:
            return self
        result = copy(self)
        result._felt = None
        return result

    @property
    def emissive(self) -> bool:
        """Whether any medium emits light."""
        return bool(self._emission)

    def emitted(
        self, medium: UInt32, origin: Array3f, direction: Array3f, distance: Float, seed: UInt32, active: Bool
    ) -> Array3f:
        """Return an unbiased estimate of the radiance that media emit along rays over a distance."""
        result = dr.zeros(Array3f, dr.width(direction))
        for each, volume in self._emission:
            inside = active & (medium == dr.opaque(UInt32, each.number))
            if isinstance(volume, tuple):
                result += dr.select(inside, _even_glow(each.extinction(origin), distance) * Array3f(*volume), 0)
                continue

            def emission(point: Array3f, volume: MiVolume = volume) -> Array3f:
                place = dr.zeros(mi.Interaction3f, dr.width(point))
                place.p = mi.Point3f(point)
                return Array3f(volume.eval(place))

            segment = each.segment(origin, direction, Float(0), distance, seed)
            result += glow(segment, each.extinction, emission, inside)
        return result

    def beyond(self, hit: Any, direction: Array3f, medium: UInt32, active: Bool) -> UInt32:
        """Return the number of the medium that rays enter at a hit; if that is no interface, `medium`, where they were.

        Reflected light stays in its medium if the interface names none on that side. Where two interfaces coincide, a
        ray meets only one of them; if that one leads into empty space, the next interface decides.
        """
        direction = mi.Vector3f(direction)
        interface = hit.is_medium_transition()
        entered = dr.select(interface, numbers(hit.target_medium(direction)), medium)
        incoming = hit.to_world(hit.wi)
        back = dr.dot(hit.n, incoming) * dr.dot(hit.n, direction) > 0
        entered = dr.select(interface & back & (entered == 0), medium, entered)
        if self._around is None:
            return entered
        lost = active & interface & ~back & (entered == 0)
        start = leaving(hit, direction, self._size)
        ahead = medium_ahead(self._around, start, Array3f(direction), lost, self._size)
        return dr.select(lost, ahead, entered)


def _repeats(shape: MiShape) -> bool:
    return bool(shape.class_name() == "Instance")


def _even_glow(extinction: Array3f, distance: Float) -> Array3f:
    """Return ∫ exp(−σt s) ds over a distance: the radiance of even fog that emits 1 per scene unit."""
    depth = extinction * distance
    thin = depth < 1e-3  # where 1 − exp(−τ) cancels
    long = (1 - dr.exp(-depth)) * dr.rcp(dr.select(thin, 1, extinction))
    return dr.select(thin, distance * (1 - 0.5 * depth), long)
