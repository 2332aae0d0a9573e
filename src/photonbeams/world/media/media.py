"""Media in the form that kernels and estimators need: coefficients, transmittance, looks.

Mitsuba's own integrators track the medium from the sensor onward, across the surfaces that a path passes, and rely on
the medium that the sensor names. Light paths begin at emitters, which seldom name one: see `surroundings`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np

from ... import scene
from ...looks import Attenuation, Look, Scattering
from ...looks.context import ShadingContext
from ...looks.factors import Factor, Product
from ...numerics.arrays import to_uint, to_vectors
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ...scene.media import check_depth
from ..bounds import box_of
from ..checks import check_numbers, check_phase
from ..shadow_rays import leaving, size_of
from ..spectra import rgb
from .interfaces import medium_ahead, number, numbers, pointers
from .tracking import SEGMENTS, MediumSegment, Track, Tracked, glow, scattering_point, walk

mi = mitsuba()

# Distances from this one on count as infinite.
_FAR = 1e30


class MediumScattering(Factor):
    """σs · phase(cos θ) of a heterogeneous medium, or of one whose phase function is not Henyey–Greenstein's."""

    def __init__(self, plugin: Any) -> None:
        self._plugin, self._phase = plugin, plugin.phase_function()
        self._even = not varies(plugin)
        self.rough = not self._even or not all(map(_is_constant, parts(plugin, mi.Volume)))

    def evaluate(self, at: ShadingContext) -> Any:
        """Return scattering coefficient times phase function, which depends on the scattering angle alone."""
        place = dr.zeros(mi.MediumInteraction3f)
        place.p = mi.Point3f(at.position)
        light = mi.Vector3f(0, 0, 1)
        place.wi, place.sh_frame = -light, mi.Frame3f(light)
        cosine = dr.clip(at.cosine, -1, 1)
        value, _ = self._phase.eval_pdf(
            mi.PhaseFunctionContext(), place, mi.Vector3f(dr.safe_sqrt(1 - cosine * cosine), 0, cosine), True
        )
        if self._even:
            return at.medium.scattering * rgb(value)
        scattering = rgb(self._plugin.get_scattering_coefficients(place, True)[0])
        return dr.select(_in_grid(self._plugin, at.position), scattering * rgb(value), 0)


def _with(own: Factor, kind: type[Factor], given: Factor) -> Factor:
    """Return a factor with those of class `kind` replaced by the medium's own, also in products, as stage looks are."""
    if type(given) is Product:
        return Product([_with(own, kind, each) for each in given.factors])
    return own if type(given) is kind else given


class ShortBeamAttenuation(Factor):
    """Attenuation along short beams: exp(−σt s) over its mean over the channels.

    Short beams end with their free flight, so the number of beams that reach s already falls with the transmittance.
    For grey media the factor is 1.
    """

    def evaluate(self, at: ShadingContext) -> Any:
        """Return the factor of each channel; the mean is weighted by the beam's power, as free flights are sampled."""
        left = dr.exp(-at.medium.extinction * at.depth)
        return over_mean(left, getattr(at.beam, "power", Array3f(1)))


def _in_grid(plugin: Any, point: Any) -> Any:
    """Return whether points lie in a heterogeneous medium's box: it ends there, though its grid is clamped."""
    inside, enter, leave = plugin.intersect_aabb(mi.Ray3f(mi.Point3f(point), mi.Vector3f(0.6, 0.64, 0.48)))
    return inside & (enter <= 0) & (leave >= 0)


def over_mean(left: Any, power: Any) -> Any:
    """Return a transmittance over its mean, weighted by the power."""
    return left * dr.sum(power) * dr.rcp(dr.maximum(dr.dot(left, power), 1e-30))


@dataclass(frozen=True)
class RenderedMedium:
    """A medium of a scene.

    Attributes
    ----------
    number
        Its number in arrays of media.
    plugin
        Mitsuba's medium.
    medium, look
        Its coefficients (the greatest ones of a heterogeneous medium) and its physical look, for estimators.
    tracked
        For a medium whose coefficients vary, the look's factor toward the camera, for which rays have to be tracked.
    colored
        For a heterogeneous medium, whether its extinction has a colour.
    """

    number: int
    plugin: Any
    medium: scene.Medium
    look: Look
    tracked: Tracked | None = None
    colored: bool = False

    def for_short_beams(self) -> RenderedMedium:
        """Return the same medium for short beams."""
        if self.tracked is not None:
            return self
        return replace(self, look=Look(along=ShortBeamAttenuation(), angle=self.look.angle))

    def shaded(self, look: Look | None) -> Look:
        """Return the look of beams in the medium: physical, or an artist's with the medium's own physical factors."""
        if look is None:
            return self.look
        own = self.look
        if type(own.along) is Attenuation and type(own.eye) is Attenuation and type(own.angle) is Scattering:
            return look
        result = copy(look)
        result.along = _with(own.along, Attenuation, look.along)
        result.eye = _with(own.eye, Attenuation, look.eye)
        result.angle = _with(own.angle, Scattering, look.angle)
        return result

    def extinction(self, point: Any) -> Array3f:
        """Return σt at points."""
        return _extinction(self.plugin, point, Bool(True))

    def track(self, origin: Any, direction: Any, near: Any, far: Any, seed: Any, active: Any) -> None:
        """Track rays from `near` to `far` for the factor toward the camera; without effect if σt does not vary."""
        if self.tracked is not None and not self.plugin.is_homogeneous():
            self.tracked.track = Track(self.segment(origin, direction, near, far, seed), self.extinction, active)

    def segment(self, origin: Any, direction: Any, near: Any, far: Any, seed: Any) -> MediumSegment:
        """Return the segments of rays, from `near` to `far`, that lie in the medium's bounding box."""
        _, enter, leave = self.plugin.intersect_aabb(mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction)))
        majorant = dr.opaque(Float, max(self.medium.extinction))
        return MediumSegment(origin, direction, dr.maximum(near, enter), dr.minimum(far, leave), majorant, seed)

    def scattering_point(
        self, origin: Any, direction: Any, far: Any, seed: Any, sample: Any, active: Any
    ) -> tuple[Any, Any]:
        """Return a point on each ray, up to `far`, at which the medium scatters light toward it, and its weight."""

        def scattering(point: Any) -> Array3f:
            place = dr.zeros(mi.MediumInteraction3f, dr.width(point))
            place.p = mi.Point3f(point)
            return Array3f(self.plugin.get_scattering_coefficients(place, Bool(True))[0])

        segment = self.segment(origin, direction, Float(0), far, seed)
        return scattering_point(segment, self.extinction, scattering, sample, active)


def _extinction(media: Any, point: Any, active: Any) -> Array3f:
    """Return σt of a medium, or of media, at points."""
    place = dr.zeros(mi.MediumInteraction3f, dr.width(point))
    place.p = mi.Point3f(point)
    return rgb(media.get_scattering_coefficients(place, active)[2])


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
        self, plugins: Iterable[Any], around: Any = None, filling: Any = None, clear: bool = False,
        unfelt: Sequence[Any] = (), emission: Mapping[int, Any] | None = None,
    ) -> None:  # fmt: skip
        found = {number(plugin): plugin for plugin in plugins if plugin is not None}
        for each in found.values():  # first, because a call of one phase function calls those of all media
            check_phase(each)
        # In the scene's order. Numbers differ between processes: in their order, sums of light would round differently.
        self.all = tuple(_rendered(each, found[each]) for each in found)
        size = max(found, default=0) + 2  # 2 or more, as `numerics.arrays.padded` explains
        table = np.zeros((3, size, 3))
        for each in self.all:
            table[0, each.number] = each.medium.extinction
            table[1, each.number] = each.medium.scattering
            table[2, each.number] = each.tracked is not None, each.colored, not each.plugin.is_homogeneous()
        self._extinction, self._scattering, self._kinds = (to_vectors(each) for each in table)
        self.any_varying = any(each.tracked is not None for each in self.all)
        self._around, self._size = around, size_of(*([] if around is None else [around]))
        self.filling, self._clear = number(filling), clear
        felt = np.ones(size, dtype=np.uint32)
        felt[[number(each) for each in unfelt]] = 0
        self._felt = to_uint(felt) if unfelt else None
        self._emission = [(each, emission[each.number]) for each in self.all if emission and each.number in emission]

    @classmethod
    def of(cls, plugin: Any) -> Media:
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

    def varying(self, medium: UInt32) -> tuple[Bool, Bool]:
        """Return which media have coefficients that vary, and which of these have a coloured extinction."""
        kind = dr.gather(Array3f, self._kinds, medium)
        return kind.x > 0, kind.y > 0

    def absorbed(self, medium: UInt32, distance: Float) -> Array3f:
        """Return exp(−σt x) of homogeneous media; in empty space it is 1, even at an infinite distance."""
        extinction = self.extinction(medium)
        thick = extinction > 0
        if self._clear:
            thick &= distance < _FAR
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
        ray = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction))
        inside, enter, leave = media.intersect_aabb(ray)
        majorant = dr.max(self.extinction(medium))

        segment = MediumSegment(origin, direction, dr.maximum(enter, 0), dr.minimum(leave, distance), majorant, seed)
        pieces = dr.ceil((1 if coarse else 4) * majorant * (segment.far - segment.near))
        segment.pieces = UInt32(dr.clip(pieces, 1, SEGMENTS))
        return dr.select(
            varying, walk(segment, lambda point: _extinction(media, point, varying), varying & inside), plain
        )

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

            def emission(point: Any, volume: Any = volume) -> Array3f:
                place = dr.zeros(mi.Interaction3f, dr.width(point))
                place.p = mi.Point3f(point)
                return Array3f(volume.eval(place))

            segment = each.segment(origin, direction, Float(0), distance, seed)
            result += glow(segment, each.extinction, emission, inside)
        return result

    def beyond(self, hit: Any, direction: Any, medium: UInt32, active: Bool) -> UInt32:
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


def _repeats(shape: Any) -> bool:
    return bool(shape.class_name() == "Instance")


class _Parts(mi.TraversalCallback):  # type: ignore[misc, name-defined]
    """Collects the parts of one of Mitsuba's objects, each once."""

    def __init__(self, found: dict[Any, None]) -> None:
        super().__init__()
        self.found = found

    def put(self, name: str, value: Any, flags: Any, cpptype: Any = None) -> None:
        if isinstance(value, mi.Object) and value not in self.found:
            self.found[value] = None
            value.traverse(_Parts(self.found))  # a new callback: Mitsuba does not call Python methods recursively


def parts(plugin: Any, kind: type) -> list[Any]:
    """Return all parts of a Mitsuba scene that are of a class, including those in shape groups."""
    found: dict[Any, None] = {}
    plugin.traverse(_Parts(found))
    return [each for each in found if isinstance(each, kind)]


def boxes(shapes: Iterable[Any]) -> dict[int, Any]:
    """Return the box around all shapes with a medium inside, by the numbers of media."""
    result: dict[int, Any] = {}
    for shape in shapes:
        if shape.interior_medium() is not None:
            result.setdefault(number(shape.interior_medium()), mi.ScalarBoundingBox3f()).expand(box_of(shape))
    return result


class _Volumes(mi.TraversalCallback):  # type: ignore[misc, name-defined]
    """Collects the volumes of a medium by name."""

    def __init__(self) -> None:
        super().__init__()
        self.found: dict[str, Any] = {}

    def put(self, name: str, value: Any, flags: Any, cpptype: Any = None) -> None:
        if isinstance(value, mi.Volume):
            self.found[name] = value


def varies(plugin: Any) -> bool:
    """Return whether a medium's coefficients vary; the albedo of Mitsuba's `homogeneous` media may.

    Raises
    ------
    SceneError
        The extinction of a `homogeneous` medium varies: Mitsuba itself takes it from arbitrary points.
    """
    if not plugin.is_homogeneous():
        return True
    volumes = _Volumes()
    plugin.traverse(volumes)
    if "sigma_t" in volumes.found and not _is_constant(volumes.found["sigma_t"]):
        name = plugin.id() or plugin.class_name()
        raise scene.SceneError(
            f"medium {name}: it is homogeneous, but its sigma_t is a grid: expected a constant, or type heterogeneous"
        )
    return any(not _is_constant(each) for each in volumes.found.values())


def _is_constant(volume: Any) -> bool:
    """Return whether a volume has the same value everywhere."""
    if volume.class_name() == "ConstVolume":
        return True
    data = next((np.asarray(value) for key, value in mi.traverse(volume) if key == "data"), None)
    return data is not None and bool(np.all(np.ptp(data.reshape(-1, data.shape[-1]), axis=0) == 0))


def _rendered(own: int, plugin: Any) -> RenderedMedium:
    """Return a Mitsuba medium in the form that estimators need."""
    name = plugin.id() or plugin.class_name()
    check_numbers(plugin, name)
    place = dr.zeros(mi.MediumInteraction3f)
    scattering, _, extinction = plugin.get_scattering_coefficients(place)
    uneven = varies(plugin)
    if uneven:
        extinction = plugin.get_majorant(place)
        scattering = extinction
    sigma_s, sigma_t = (np.resize(np.asarray(each, dtype=float), 3) for each in (scattering, extinction))
    if not (np.all(np.isfinite(sigma_t)) and np.all(sigma_t >= 0) and np.all(sigma_s >= 0)):
        raise scene.SceneError(f"medium {name}: sigma_t is {sigma_t.tolist()}: expected finite numbers, 0 or more")
    if np.any(sigma_s > sigma_t * (1 + 1e-5)):
        albedo = (sigma_s / np.maximum(sigma_t, 1e-30)).tolist()
        raise scene.SceneError(f"medium {name}: its albedo is {albedo}: expected at most 1")
    g, look = _scattering(plugin)
    medium = scene.Medium(tuple(sigma_s), tuple(np.maximum(sigma_t - sigma_s, 0)), g)
    if not uneven:
        return RenderedMedium(own, plugin, medium, look)
    tracked, even = Tracked(float(sigma_t.max())), plugin.is_homogeneous()
    look = Look(along=1.0, eye=Attenuation() if even else tracked, angle=MediumScattering(plugin))
    colored = bool(np.ptp(sigma_t) > 0) if even else _has_color(plugin)
    return RenderedMedium(own, plugin, medium, look, tracked, colored)


def _has_color(plugin: Any) -> bool:
    """Return whether a medium's extinction may differ between channels."""
    data = next((value for key, value in mi.traverse(plugin) if key == "sigma_t.data"), None)
    return data is None or data.shape[-1] != 1


def _scattering(plugin: Any) -> tuple[float, Look]:
    """Return g and the look of a medium; g is 0 where its phase function is not Henyey and Greenstein's."""
    phase = plugin.phase_function()
    if phase.class_name() == "IsotropicPhaseFunction":
        return 0.0, Look()
    if phase.class_name() == "HGPhaseFunction":
        g = float(np.ravel(mi.traverse(phase)["g"])[0])
        if abs(g) <= 0.99:
            return g, Look()
    return 0.0, Look(angle=MediumScattering(plugin))
