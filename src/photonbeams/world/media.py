"""The media of a Mitsuba scene, and which of them is where.

Mitsuba's own integrators follow media from the sensor on, over the surfaces that a path passes, and believe what the
sensor names. Light paths begin at emitters, which seldom name anything: see `surroundings`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np

from .. import scene
from ..looks import Attenuation, Look, Scattering
from ..looks.context import ShadingContext
from ..looks.factors import Factor
from ..numerics.arrays import to_uint, to_vectors
from ..numerics.hashing import hash32, unit_float
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from .tracking import MediumSegment, Track, Tracked, walk

mi = mitsuba()

# Stands for a medium that is not known.
UNKNOWN = 0xFFFFFFFF

# Surfaces that a ray may pass on its way to an interface of media, and steps of a walk to one.
_LAYERS, _STEPS = 64, 32

# From here on a distance is infinite.
_FAR = 1e30

# Surfaces behind which a medium goes on, where they do not name any.
_TRANSMITS = int(
    mi.BSDFFlags.Null | mi.BSDFFlags.DeltaTransmission | mi.BSDFFlags.GlossyTransmission
    | mi.BSDFFlags.DiffuseTransmission
)  # fmt: skip


class MediumScattering(Factor):
    """σs · phase(cos θ) of a Mitsuba medium that varies, or whose phase function is none of Henyey and Greenstein's."""

    def __init__(self, plugin: Any) -> None:
        self._plugin, self._phase = plugin, plugin.phase_function()
        self.rough = not plugin.is_homogeneous()

    def evaluate(self, at: ShadingContext) -> Any:
        """Return scattering coefficient times phase function; it turns with the light, so any direction does for it."""
        place = dr.zeros(mi.MediumInteraction3f)
        place.p = mi.Point3f(at.position)
        light = mi.Vector3f(0, 0, 1)
        place.wi, place.sh_frame = -light, mi.Frame3f(light)
        cosine = dr.clip(at.cosine, -1, 1)
        value, _ = self._phase.eval_pdf(
            mi.PhaseFunctionContext(), place, mi.Vector3f(dr.safe_sqrt(1 - cosine * cosine), 0, cosine), True
        )
        if self._plugin.is_homogeneous():
            return at.medium.scattering * Array3f(value)
        scattering = Array3f(self._plugin.get_scattering_coefficients(place, True)[0])
        return dr.select(_in_grid(self._plugin, at.position), scattering * Array3f(value), 0)


class Ended(Factor):
    """Along short beams: what is left of light that surely comes as far, exp(−σt s) over its mean by channels.

    Beams end where a flight does, so that as many are left at s as light is; of what has no colour nothing else is.
    """

    def evaluate(self, at: ShadingContext) -> Any:
        """Return the share of each channel; the channels' weights are the beam's power, by which flights choose."""
        left = dr.exp(-at.medium.extinction * at.depth)
        return ended(left, getattr(at.beam, "power", Array3f(1)))


def _in_grid(plugin: Any, point: Any) -> Any:
    """Return whether points lie where a medium that varies is known: beyond, grids are clamped, and the medium ends."""
    inside, enter, leave = plugin.intersect_aabb(mi.Ray3f(mi.Point3f(point), mi.Vector3f(0.6, 0.64, 0.48)))
    return inside & (enter <= 0) & (leave >= 0)


def ended(left: Any, power: Any) -> Any:
    """Return what is left over its mean, weighted by the power."""
    return left * dr.sum(power) * dr.rcp(dr.maximum(dr.dot(left, power), 1e-30))


@dataclass(frozen=True)
class RenderedMedium:
    """A medium of a scene.

    Attributes
    ----------
    number
        What names it in arrays of media.
    plugin
        Mitsuba's medium.
    medium, look
        What estimators need to know of it; of a medium that varies, the greatest coefficients.
    tracked
        Of a medium that varies: the look's factor toward the camera, for which rays have to be tracked.
    colored
        Of a medium that varies: whether its extinction has a colour.
    """

    number: int
    plugin: Any
    medium: scene.Medium
    look: Look
    tracked: Tracked | None = None
    colored: bool = False

    def ending(self) -> RenderedMedium:
        """Return the same for short beams."""
        return self if self.tracked is not None else replace(self, look=Look(along=Ended(), angle=self.look.angle))

    def shaded(self, look: Look | None) -> Look:
        """Return the look of beams in the medium: physical, or an artist's with the medium's own physical factors."""
        if look is None:
            return self.look
        own = self.look
        if type(own.along) is Attenuation and type(own.eye) is Attenuation and type(own.angle) is Scattering:
            return look
        result = copy(look)
        if type(look.along) is Attenuation:
            result.along = own.along
        if type(look.eye) is Attenuation:
            result.eye = own.eye
        if type(look.angle) is Scattering:
            result.angle = own.angle
        return result

    def extinction(self, point: Any) -> Array3f:
        """Return σt at points."""
        return _extinction(self.plugin, point, Bool(True))

    def track(self, origin: Any, direction: Any, near: Any, far: Any, seed: Any, active: Any) -> None:
        """Track rays from `near` to `far`, for the look's factor toward the camera, where the medium varies."""
        if self.tracked is not None:
            self.tracked.track = Track(self.way(origin, direction, near, far, seed), self.extinction, active)

    def way(self, origin: Any, direction: Any, near: Any, far: Any, seed: Any) -> MediumSegment:
        """Return the part of rays, from `near` to `far`, on which the medium is not nothing."""
        _, enter, leave = self.plugin.intersect_aabb(mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction)))
        majorant = dr.opaque(Float, max(self.medium.extinction))
        return MediumSegment(origin, direction, dr.maximum(near, enter), dr.minimum(far, leave), majorant, seed)


def _extinction(media: Any, point: Any, active: Any) -> Array3f:
    """Return σt of a medium, or of media, at points."""
    place = dr.zeros(mi.MediumInteraction3f, dr.width(point))
    place.p = mi.Point3f(point)
    return Array3f(media.get_scattering_coefficients(place, active)[2])


class Media:
    """The media of a scene, and their coefficients for kernels.

    Parameters
    ----------
    plugins
        Mitsuba's media, each as often as it may be.
    around
        The Mitsuba scene, where several of its shapes hold media, which may touch.
    filling, clear
        The medium that fills the whole space, and whether it leaves what is infinitely far away as it is.
    unfelt
        Media that beams alone feel.

    Raises
    ------
    SceneError
        A medium that cannot be rendered.
    """

    def __init__(
        self, plugins: Iterable[Any], around: Any = None, filling: Any = None, clear: bool = False,
        unfelt: Sequence[Any] = (),
    ) -> None:  # fmt: skip
        found = {number(plugin): plugin for plugin in plugins if plugin is not None}
        for each in found.values():  # all of them first: Mitsuba calls all phase functions where it calls one
            _check_phase(each)
        # In the order of the scene: numbers differ from one process to the next, and so would the sums of light.
        self.all = tuple(_rendered(each, found[each]) for each in found)
        size = max(found, default=0) + 2  # a gather from an array of one is a broadcast, hence another kernel
        table = np.zeros((3, size, 3))
        for volume in self.all:
            table[0, volume.number] = volume.medium.extinction
            table[1, volume.number] = volume.medium.scattering
            table[2, volume.number, :2] = volume.tracked is not None, volume.colored
        self._extinction, self._scattering, self._kinds = (to_vectors(each) for each in table)
        self.any_varying = any(volume.tracked is not None for volume in self.all)
        self._around = around
        self.filling, self._clear = number(filling), clear
        felt = np.ones(size, dtype=np.uint32)
        felt[[number(each) for each in unfelt]] = 0
        self._felt = to_uint(felt) if unfelt else None

    @classmethod
    def of(cls, plugin: Any) -> Media:
        """Return the media of a Mitsuba scene: in and around its shapes, and those that sensors and emitters name."""
        named = [each.get_medium() for each in (*plugin.sensors(), *plugin.emitters())]
        shapes = parts(plugin, mi.Shape)
        several = sum(each.interior_medium() is not None for each in shapes) > 1 or any(map(_repeats, shapes))
        return cls([*parts(plugin, mi.Medium), *named], plugin if several else None)

    def extinction(self, medium: UInt32) -> Array3f:
        """Return σt of media by their numbers; 0 in empty space."""
        return dr.gather(Array3f, self._extinction, medium)

    def scattering(self, medium: UInt32) -> Array3f:
        """Return σs of media by their numbers; 0 in empty space."""
        return dr.gather(Array3f, self._scattering, medium)

    def varying(self, medium: UInt32) -> tuple[Bool, Bool]:
        """Return which media vary, and whose extinction then has a colour."""
        kind = dr.gather(Array3f, self._kinds, medium)
        return kind.x > 0, kind.y > 0

    def absorbed(self, medium: UInt32, distance: Float) -> Array3f:
        """Return exp(−σt x) of homogeneous media; in empty space it is 1, however long the distance."""
        extinction = self.extinction(medium)
        thick = extinction > 0
        if self._clear:
            thick &= distance < _FAR
        return dr.select(thick, dr.exp(-extinction * distance), 1)

    def felt(self, medium: UInt32, transmittance: Array3f) -> Array3f:
        """Return a transmittance as surfaces feel it: 1 of a fog that beams alone feel."""
        if self._felt is None:
            return transmittance
        return dr.select(dr.gather(UInt32, self._felt, medium) > 0, transmittance, 1)

    def transmittance(
        self, medium: UInt32, origin: Array3f, direction: Array3f, distance: Float, seed: UInt32, active: Bool
    ) -> Array3f:
        """Return the transmittance over a distance along rays; of media that vary an unbiased estimate."""
        plain = self.absorbed(medium, distance)
        if not self.any_varying:
            return plain
        varying, _ = self.varying(medium)
        varying &= active
        media = pointers(dr.select(varying, medium, 0))
        ray = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction))
        inside, enter, leave = media.intersect_aabb(ray)
        majorant = dr.max(self.extinction(medium))

        way = MediumSegment(origin, direction, dr.maximum(enter, 0), dr.minimum(leave, distance), majorant, seed)
        return dr.select(varying, walk(way, lambda point: _extinction(media, point, varying), varying & inside), plain)

    def beyond(self, hit: Any, direction: Any, medium: UInt32, active: Bool) -> UInt32:
        """Return the number of the medium that rays enter at a hit, where it is an interface; else that they are in.

        Light that is reflected stays in its medium where the interface names none on that side. Where two interfaces
        lie on each other a ray meets one of them: if it then is in empty space, we ask the next one.
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
        start = Array3f(hit.spawn_ray(direction).o)
        return dr.select(lost, _ahead(self._around, start, Array3f(direction), lost), entered)


def _repeats(shape: Any) -> bool:
    return bool(shape.class_name() == "Instance")


class _Parts(mi.TraversalCallback):  # type: ignore[misc, name-defined]
    """Collects the objects that another one consists of, each once."""

    def __init__(self, found: dict[Any, None]) -> None:
        super().__init__()
        self.found = found

    def put(self, name: str, value: Any, flags: Any, cpptype: Any = None) -> None:
        if isinstance(value, mi.Object) and value not in self.found:
            self.found[value] = None
            value.traverse(_Parts(self.found))  # another one, for Mitsuba calls no Python method within itself


def parts(plugin: Any, kind: type) -> list[Any]:
    """Return all parts of a Mitsuba scene that are of a kind, those of groups of shapes too."""
    found: dict[Any, None] = {}
    plugin.traverse(_Parts(found))
    return [each for each in found if isinstance(each, kind)]


def boxes(shapes: Iterable[Any]) -> dict[int, Any]:
    """Return the box around all shapes that hold a medium, by the numbers of media."""
    result: dict[int, Any] = {}
    for shape in shapes:
        if shape.interior_medium() is not None:
            result.setdefault(number(shape.interior_medium()), mi.ScalarBoundingBox3f()).expand(shape.bbox())
    return result


def number(plugin: Any) -> int:
    """Return the number of a medium, 0 for None."""
    return 0 if plugin is None else int(numbers(mi.MediumPtr(plugin))[0])


def numbers(media: Any) -> UInt32:
    """Return the numbers of an array of media."""
    return UInt32(dr.reinterpret_array(mi.UInt32, media))


def pointers(media: UInt32) -> Any:
    """Return the media with these numbers."""
    return dr.reinterpret_array(mi.MediumPtr, mi.UInt32(media))


def shape_number(plugin: Any) -> int:
    """Return the number of a shape in arrays of shapes."""
    return int(UInt32(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(plugin)))[0])


@dataclass(frozen=True)
class Met:
    """What rays meet.

    Attributes
    ----------
    hit
        Mitsuba's surface interaction.
    interface
        Whether the surface names media.
    near, far
        The numbers of those before and behind it, UNKNOWN where it names none.
    transmits
        Whether a ray may pass the surface.
    """

    hit: Any
    interface: Any
    near: Any
    far: Any
    transmits: Any


def meet(plugin: Any, origin: Any, direction: Any, active: Any) -> Met:
    """Return what rays meet in a Mitsuba scene, and what it tells of the media there."""
    along = mi.Vector3f(direction)
    hit = plugin.ray_intersect(mi.Ray3f(mi.Point3f(origin), along), active)
    valid = active & hit.is_valid()
    interface = valid & hit.is_medium_transition()
    near, far = (dr.select(interface, numbers(hit.target_medium(each)), UNKNOWN) for each in (-along, along))
    transmits = valid & ((UInt32(hit.bsdf().flags()) & _TRANSMITS) != 0)
    return Met(hit, interface, near, far, transmits)


def reflected(hit: Any, direction: Any, aside: Any) -> Array3f:
    """Return directions away from surfaces, on the side that rays come from, by a random unit vector."""
    normal = Array3f(hit.n)
    normal = dr.select(dr.dot(normal, direction) > 0, -normal, normal)
    result = normal * 1.001 + aside
    return result * dr.rsqrt(dr.maximum(dr.squared_norm(result), 1e-12))


def medium_at(
    plugin: Any, origin: Array3f, direction: Array3f, otherwise: UInt32, everywhere: UInt32, active: Any = True
) -> UInt32:
    """Return the number of the medium at points, found by a random walk from each.

    A walk is reflected by surfaces, and passes those that transmit light and name no medium: it stays in the medium
    that it began in, which the first interface on its way names. What names no medium on this side is empty space, if
    nothing else on the way tells more.

    Parameters
    ----------
    plugin
        The Mitsuba scene.
    origin, direction
        Rays along which walks begin.
    otherwise
        The medium of points whose walks find no interface.
    everywhere
        The medium of the background.
    active
        Which points are asked for.
    """
    width = max(dr.width(origin), dr.width(direction))
    lane = dr.arange(UInt32, width) + dr.opaque(UInt32, 0)

    def further(here: Array3f, along: Array3f, medium: UInt32, step: UInt32, going: Bool) -> tuple[Any, ...]:
        met = meet(plugin, here, along, going)
        escaped = going & ~met.hit.is_valid()
        medium = dr.select(met.interface, met.near, medium)
        medium = dr.select(escaped, everywhere, medium)
        going = going & ~escaped & ~(met.interface & (met.near > 0))
        along = dr.select(met.transmits & ~met.interface, along, reflected(met.hit, along, _unit(hash32(lane, step))))
        here = dr.select(going, Array3f(met.hit.spawn_ray(mi.Vector3f(along)).o), here)
        return here, along, medium, step + 1, going

    state = (
        origin + dr.zeros(Array3f, width), direction + dr.zeros(Array3f, width), dr.full(UInt32, UNKNOWN, width),
        dr.zeros(UInt32, width), active & dr.full(Bool, True, width),
    )  # fmt: skip
    end: Any = dr.while_loop(state, lambda *each: each[4] & (each[3] < _STEPS), further, label="medium_at")
    found = UInt32(end[2])
    return dr.select(found == UNKNOWN, otherwise, found)


def _unit(seed: UInt32) -> Array3f:
    """Return random unit vectors."""
    z = 2 * unit_float(seed) - 1
    sine, cosine = dr.sincos(2 * dr.pi * unit_float(hash32(seed)))
    across = dr.safe_sqrt(1 - z * z)
    return Array3f(across * cosine, across * sine, z)


def _ahead(plugin: Any, origin: Array3f, direction: Array3f, active: Bool) -> UInt32:
    """Return the number of the medium that the next interface along rays names on this side, 0 if there is none.

    Rays pass surfaces that transmit light and name no medium; opaque ones tell nothing.
    """

    def further(here: Array3f, medium: UInt32, layer: UInt32, going: Bool) -> tuple[Any, ...]:
        met = meet(plugin, here, direction, going)
        medium = dr.select(met.interface, met.near, medium)
        going = going & met.hit.is_valid() & met.transmits & ~met.interface
        here = dr.select(going, Array3f(met.hit.spawn_ray(mi.Vector3f(direction)).o), here)
        return here, medium, layer + 1, going

    width = max(dr.width(origin), dr.width(direction))
    state = (
        origin + dr.zeros(Array3f, width), dr.zeros(UInt32, width), dr.zeros(UInt32, width),
        active & dr.full(Bool, True, width),
    )  # fmt: skip
    return dr.while_loop(state, lambda *each: each[3] & (each[2] < _LAYERS), further, label="ahead")[1]


def _rendered(own: int, plugin: Any) -> RenderedMedium:
    """Return a medium as estimators see it."""
    name = plugin.id() or plugin.class_name()
    _check_numbers(plugin, name)
    place = dr.zeros(mi.MediumInteraction3f)
    scattering, _, extinction = plugin.get_scattering_coefficients(place)
    if not plugin.is_homogeneous():
        extinction = plugin.get_majorant(place)
        scattering = extinction
    sigma_s, sigma_t = (np.ravel(np.asarray(each, dtype=float))[:3] for each in (scattering, extinction))
    if not (np.all(np.isfinite(sigma_t)) and np.all(sigma_t >= 0) and np.all(sigma_s >= 0)):
        raise scene.SceneError(f"medium {name}: sigma_t is {sigma_t.tolist()}: expected finite numbers from 0 on")
    if np.any(sigma_s > sigma_t * (1 + 1e-5)):
        albedo = (sigma_s / np.maximum(sigma_t, 1e-30)).tolist()
        raise scene.SceneError(f"medium {name}: its albedo is {albedo}: expected 1 at most")
    g, look = _scattering(plugin)
    medium = scene.Medium(tuple(sigma_s), tuple(np.maximum(sigma_t - sigma_s, 0)), g)
    if plugin.is_homogeneous():
        return RenderedMedium(own, plugin, medium, look)
    tracked = Tracked(float(sigma_t.max()))
    look = Look(along=1.0, eye=tracked, angle=MediumScattering(plugin))
    return RenderedMedium(own, plugin, medium, look, tracked, _has_color(plugin))


def _check_phase(plugin: Any) -> None:
    """Raise SceneError where a medium's phase function depends on more than the angle."""
    phase = plugin.phase_function()
    if mi.has_flag(phase.flags(), mi.PhaseFunctionFlags.Microflake):
        name = plugin.id() or plugin.class_name()
        raise scene.SceneError(
            f"medium {name}: its phase function {phase.class_name()} depends on where its flakes look: "
            "expected one that depends on the angle alone"
        )


def _check_numbers(plugin: Any, name: str) -> None:
    """Raise SceneError where a number of a medium is not finite, or none that such a coefficient may have."""
    check_finite(plugin, f"medium {name}")
    for key, value in mi.traverse(plugin):
        numbers = _numbers(value)
        if not numbers.size:
            continue
        if key.startswith(("sigma_t.", "albedo.")) and key.endswith((".data", ".value")) and numbers.min() < 0:
            raise scene.SceneError(f"medium {name}: {key} has numbers below 0, such as {numbers.min():g}")
        if key.startswith("albedo.") and key.endswith((".data", ".value")) and numbers.max() > 1 + 1e-5:
            raise scene.SceneError(f"medium {name}: {key} has numbers above 1, such as {numbers.max():g}")


def check_finite(plugin: Any, name: str) -> None:
    """Raise SceneError where a number of an object of Mitsuba's, or of an image or a grid of it, is not finite."""
    for key, value in mi.traverse(plugin):
        if not np.all(np.isfinite(_numbers(value))):
            raise scene.SceneError(f"{name}: {key} has numbers that are not finite")


def _numbers(value: Any) -> np.ndarray:
    """Return the numbers of a parameter; none of one that is not made of numbers."""
    value = getattr(value, "matrix", value)
    try:
        return np.asarray(getattr(value, "array", value), dtype=float)
    except (TypeError, ValueError):
        return np.zeros(0)


def _has_color(plugin: Any) -> bool:
    """Return whether a medium's extinction differs between channels; one that nobody knows may."""
    data = next((value for key, value in mi.traverse(plugin) if key == "sigma_t.data"), None)
    return data is None or data.shape[-1] != 1


def _scattering(plugin: Any) -> tuple[float, Look]:
    """Return g and the look of a medium: those of Henyey and Greenstein where its phase function is theirs."""
    phase = plugin.phase_function()
    if phase.class_name() == "IsotropicPhaseFunction":
        return 0.0, Look()
    if phase.class_name() == "HGPhaseFunction":
        g = float(np.ravel(mi.traverse(phase)["g"])[0])
        if abs(g) <= 0.99:
            return g, Look()
    return 0.0, Look(angle=MediumScattering(plugin))
