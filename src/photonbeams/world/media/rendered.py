"""A medium as estimators need it: coefficients, and its physical look as factors."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ... import scene
from ...looks import Attenuation, Look, Scattering
from ...looks.context import ShadingContext
from ...looks.factors import Factor, Product
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..checks import check_numbers
from ..spectra import rgb
from .interfaces import number, pointers
from .parts import is_constant, parts, varies
from .tracking import Extinction, MediumSegment, Track, Tracked

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import MediumPtr, MiMedium

mi = mitsuba()

# Distances from this one on count as infinite.
FAR = 1e30


class MediumScattering(Factor):
    """σs · phase(cos θ) of a heterogeneous medium, or of one whose phase function is not Henyey–Greenstein's."""

    def __init__(self, plugin: Any) -> None:
        self._media = called(number(plugin))
        self._even = not varies(plugin)
        self.rough = not self._even or not all(map(is_constant, parts(plugin, mi.Volume)))

    def evaluate(self, at: ShadingContext) -> Array3f:
        """Return scattering coefficient times phase function, which depends on the scattering angle alone."""
        place = dr.zeros(mi.MediumInteraction3f)
        place.p = mi.Point3f(at.point)
        light = mi.Vector3f(0, 0, 1)
        place.wi, place.sh_frame = -light, mi.Frame3f(light)
        cosine = dr.clip(at.cosine, -1, 1)
        value, _ = self._media.phase_function().eval_pdf(
            mi.PhaseFunctionContext(), place, mi.Vector3f(dr.safe_sqrt(1 - cosine * cosine), 0, cosine), True
        )
        if self._even:
            return at.medium.scattering * rgb(value)
        scattering = rgb(self._media.get_scattering_coefficients(place, Bool(True))[0])
        return dr.select(_in_grid(self._media, at.point), scattering * rgb(value), 0)


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


def called(own: int) -> Any:
    """Return a pointer to the medium of a number, by which all media run the same kernels.

    The code of a plug-in contains its place and its size.
    """
    return pointers(dr.opaque(UInt32, own))


def _in_grid(media: MediumPtr, point: Array3f) -> Bool:
    """Return whether points lie in a heterogeneous medium's box: it ends there, though its grid is clamped."""
    inside, enter, leave = media.intersect_aabb(mi.Ray3f(mi.Point3f(point), mi.Vector3f(0.6, 0.64, 0.48)))
    return inside & (enter <= 0) & (leave >= 0)


def over_mean(left: Any, power: Array3f) -> Array3f:
    """Return a transmittance over its mean, weighted by the power."""
    return left * dr.sum(power) * dr.rcp(dr.maximum(dr.dot(left, power), 1e-30))


@dataclass(frozen=True)
class RenderedMedium:
    """A medium of a scene.

    Attributes
    ----------
    number
        Its number in arrays of media.
    plugin, calls
        Mitsuba's medium, and a pointer to it, by which kernels call it.
    medium, look
        Its coefficients (the greatest ones of a heterogeneous medium) and its physical look, for estimators.
    tracked
        For a medium whose coefficients vary, the look's factor toward the camera, for which rays have to be tracked.
    colored
        For a heterogeneous medium, whether its extinction has a colour.
    fullness
        For a medium in a grid, the mean extinction over the greatest.
    """

    number: int
    plugin: Any
    calls: Any
    medium: scene.Medium
    look: Look
    tracked: Tracked | None = None
    colored: bool = False
    fullness: float = 1.0

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

    def extinction(self, point: Array3f) -> Array3f:
        """Return σt at points."""
        return extinction_of(self.calls, Bool(True))(point)

    def track(self, origin: Array3f, direction: Array3f, near: Float, far: Float, seed: UInt32, active: Bool) -> None:
        """Track rays from `near` to `far` for the factor toward the camera; without effect if σt does not vary."""
        if self.tracked is not None and not self.plugin.is_homogeneous():
            self.tracked.track = Track(self.segment(origin, direction, near, far, seed), self.extinction, active)

    def segment(self, origin: Array3f, direction: Array3f, near: Float, far: Float, seed: UInt32) -> MediumSegment:
        """Return the segments of rays, from `near` to `far`, that lie in the medium's bounding box."""
        _, enter, leave = self.calls.intersect_aabb(mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction)))
        majorant = dr.opaque(Float, max(self.medium.extinction))
        return MediumSegment(origin, direction, dr.maximum(near, enter), dr.minimum(far, leave), majorant, seed)


def coefficients_of(media: MediumPtr, point: Array3f, active: Bool) -> Sequence[Array3f]:
    """Return σs, the null coefficient and σt of media at points."""
    place = dr.zeros(mi.MediumInteraction3f, dr.width(point))
    place.p = mi.Point3f(point)
    return [rgb(each) for each in media.get_scattering_coefficients(place, active)]


def extinction_of(media: MediumPtr, active: Bool) -> Extinction:
    """Return a function that returns σt of media at points."""
    return lambda point: coefficients_of(media, point, active)[2]


def scattering_of(media: MediumPtr, active: Bool) -> Extinction:
    """Return a function that returns σs of media at points."""
    return lambda point: coefficients_of(media, point, active)[0]


def rendered(own: int, plugin: MiMedium) -> RenderedMedium:
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
        return RenderedMedium(own, plugin, called(own), medium, look=look)
    tracked, even = Tracked(float(sigma_t.max())), plugin.is_homogeneous()
    look = Look(along=1.0, eye=Attenuation() if even else tracked, angle=MediumScattering(plugin))
    data = None if even else next((value for key, value in mi.traverse(plugin) if key == "sigma_t.data"), None)
    colored = bool(np.ptp(sigma_t) > 0) if even else data is None or data.shape[-1] != 1
    fullness = 1.0 if data is None else float(np.mean(data, dtype=np.float64) / max(np.max(data), 1e-30))
    return RenderedMedium(
        own, plugin, called(own), medium, look=look, tracked=tracked, colored=colored, fullness=fullness
    )  # fmt: skip


def _scattering(plugin: MiMedium) -> tuple[float, Look]:
    """Return g and the look of a medium; g is 0 where its phase function is not Henyey and Greenstein's."""
    phase = plugin.phase_function()
    if phase.class_name() == "IsotropicPhaseFunction":
        return 0.0, Look()
    if phase.class_name() == "HGPhaseFunction":
        g = float(np.ravel(mi.traverse(phase)["g"])[0])
        if abs(g) <= 0.99:
            return g, Look()
    return 0.0, Look(angle=MediumScattering(plugin))
