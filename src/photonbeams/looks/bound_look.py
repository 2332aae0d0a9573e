"""A look that is bound to a medium, in the form that estimators evaluate, with how fast its factors change."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..numerics.arrays import opaque, to_float, to_numpy, to_vectors
from ..runtime.device import Array3f, Float
from ..scene import SceneError, arguments, instance, number, shown
from .context import OF_BEAMS, OF_PLACES, OF_RADII, Fog, LightContext, ShadingContext, inputs_of
from .factors import Constant, Corner, Factor, Product, Value
from .functions import check_value
from .table import Places

if TYPE_CHECKING:
    from ..numerics.given import Number
    from .look import Look

#: Two opposite corners of a box.
Box = tuple[Any, Any]

_LINES = 8  # over which the factors' rates of change are measured
_SAMPLES = 512  # on each line
_BENT = 0.97  # quantile of a line's curvatures that counts
# Curvature below which it is rounding: float32 holds values to 6e-8, and second differences over 1/511 multiply that by
# a million.
_ROUNDING = 1.0

# How much the factors may change over a piece of a chord, in units of their largest value. On an exponential, six
# points err by 1e-5 over a change of 8.
_CHANGE = 8.0
_CUTS = 4  # greatest number of pieces of a chord
# The same for factors of space, which go up and down: a wave of amplitude a changes by 4 within 4/√a radians, over
# which six points err by less than 1e-3.
_CHANGE_OF_PLACES = 2.0
_CUTS_OF_PLACES = 64

_OF_NOISE = 0.2  # with which the examples' pictures err by 0.04 % in the median

# Larger products leave float32's range once they are multiplied by a beam's power and its kernel.
_MOST = 1e18

# Inputs that are constant along a ray's chord in a beam.
_OF_RAYS = OF_BEAMS | {"cosine", "angle", "medium", "fog", "context", "time", "frame", "light", "beam"}


class BoundLook:
    """A look in a medium, in the form that estimators evaluate. `Look.bind` makes it.

    Parameters
    ----------
    look, fog, reach, context, box
        The look, its medium as a `Fog`, and the arguments of `Look.bind`.

    Attributes
    ----------
    profile
        The profile across the beam.
    uses
        Names of the `ShadingContext` attributes that the factors read.
    by_radius
        Whether factors change with ρ; if so, the billboard has to project them together with the profile.
    of_beams
        Whether factors read a beam's `random`, `id` or `generation`.
    of_places
        Whether factors read positions.
    rate_along, rate_fraction, rate_eye, rate_place, rate_radius
        How fast the factors change: the largest slope over the largest value, per scene unit along the beam, per
        fraction of the beam, per scene unit along the ray, per scene unit of space, and per radius. The billboard
        replaces a factor by its value at one point (except over the radius); the rates say for which chords it may.
    change, cuts
        How much the factors may change over a piece of a chord, and the greatest number of pieces of a chord.
    decay_along, decay_eye
        How fast the exponents of the factors change, per scene unit along the beam and along the ray.
    corners
        Names of inputs, and their values at which the integrand has corners.
    places
        The values by the names of the inputs, in device memory.
    smooth
        Whether all factors are smooth: none of them is noise or an expression, or changes in space or with ρ.
    attached
        Whether factors or the profile are attached to the AD graph.
    lenient, of_noise
        Whether an estimate may err a little, which its caller sets; and the part of `rate_place` that then counts, less
        than 1 if noise alone changes in space. What a billboard errs of noise is small in a pixel, in which many beams
        meet it at many places.

    Raises
    ------
    SceneError
        If a factor needs a medium and there is none, if it is neither a number nor a colour, or if it is not finite
        somewhere.

    Examples
    --------
    >>> bound = pb.Look(eye="1 - 0.1 * t").bind(pb.Medium(0.1), reach=4.0)
    >>> round(bound.eye(distance=2.0, depth=2.0)[0], 3)
    0.8
    >>> bound.smooth  # an expression may have steps
    False
    """

    @arguments
    def __init__(self, look: Look, fog: Fog | None, reach: float, context: LightContext | None, box: Box) -> None:
        from .look import Look

        instance(look, "look", Look)
        self._look, self._fog, self._context = look, fog, context or LightContext()
        self.lenient = False
        self.profile = look.across
        self._modulation = look.modulation or Constant(1.0)
        eye = tuple(("eye" if name == "distance" else name, place) for name, place in look.eye.corners)
        self.corners: tuple[Corner, ...] = look.along.corners + eye + self._modulation.corners + look.angle.corners
        inputs = sorted({name for name, _ in self.corners if name != "radius"})
        self.places = {name: Places(at for each, at in self.corners if each == name) for name in inputs}
        if self.rings:
            self.places["radius"] = Places(self.rings)
        self._factors: dict[str, Factor] = {
            "along": look.along, "across": self._modulation, "eye": look.eye, "angle": look.angle,
        }  # fmt: skip
        whole = Product([*self._factors.values()])
        self._wild = whole.wild
        probe = self._probe(1, box)
        with dr.resume_grad():
            values = [each.evaluate(probe) for each in whole.factors]
            self.attached = self.profile.attached or any(map(dr.grad_enabled, values))
        for each, value in zip(whole.factors, values, strict=True):
            check_value(value, f"the look's factor {shown(each)}")
        asked = {slot: inputs_of(each.evaluate, probe) for slot, each in self._factors.items()}
        self._turning = not asked["angle"] <= _OF_RAYS  # whether the angle's factor changes along a ray
        self.uses = frozenset().union(*asked.values())
        self.by_radius, self.of_beams = bool(self.uses & OF_RADII), bool(self.uses & OF_BEAMS)
        self.of_places = bool(self.uses & OF_PLACES)
        self.of_noise = opaque(1.0 if whole.wild or whole.rough else _OF_NOISE)
        winding = self.of_places or self.by_radius or whole.rough
        self.smooth = not (winding or whole.wild or whole.of_rays)
        self.cuts = opaque(_CUTS_OF_PLACES if winding else _CUTS)
        self.change = opaque(_CHANGE_OF_PLACES if winding else _CHANGE)
        self._measure(number(reach, "the length of a look's beams"), box)

    @property
    def rings(self) -> tuple[float, ...]:
        """Values of ρ below 1 at which a chord is cut because of the profile, or because a factor has a corner."""
        own = [place for name, place in self.corners if name == "radius" and 0 < place < self.profile.support]
        return (*self.profile.rings, *own)

    def at(self, **where: Any) -> ShadingContext:
        """Return a shading context in this medium and light context; `where` are the other attributes."""
        return ShadingContext(fog=self._fog, context=self._context, **where)

    def light(self, at: ShadingContext, reach_depth: Float) -> Value:
        """Return the product of all factors that may change along a ray, except for the profile.

        Parameters
        ----------
        at
            The shading context, whose own distance and depth are those from the light.
        reach_depth
            Distance in the medium toward the camera.

        Returns
        -------
        The product, a Float or an Array3f, which is finite and not negative.
        """
        light = self._light(at, reach_depth)
        return _tamed(light) if self._wild else light

    def _light(self, at: ShadingContext, reach_depth: Number) -> Value:
        light, exponent = self._split(at, reach_depth)
        light = light * dr.exp(exponent)
        if self._context.zero is None:
            return light
        kind: Any = dr.float32_array_t(type(light))  # what is made of positions far from zero is double
        return kind(light)

    def _split(self, at: ShadingContext, reach_depth: Number) -> tuple[Any, Any]:
        """Return (light, exponent), so that the product of the factors is light · exp(exponent)."""
        look = self._look
        light, fading = look.along.split(at)
        eye, dimming = look.eye.split(at.own(at.to_camera, reach_depth))
        light = light * eye
        if look.modulation is not None:
            modulation, more = look.modulation.split(at)
            light, fading = light * modulation, fading + more
        if self._turning:
            light = light * look.angle.evaluate(at)
        return light, fading + dimming

    def turned(self, cosine: Number, beam: Any = None) -> Value:
        """Return the view-angle shading where it is constant along a ray, else 1: then `light` includes it.

        `cosine` is that of the angle between the light's direction and the direction to the camera; `beam` is the beam,
        for factors that read its `identity`.
        """
        if self._turning:
            return Float(1)
        value = self._look.angle.evaluate(self.at(cosine=cosine, beam=beam))
        return _tamed(value) if self._look.angle.wild else value

    def factor(self, slot: str, at: ShadingContext, **where: Any) -> Value:
        """Return one factor at a shading context.

        Parameters
        ----------
        slot
            "along", "across", "eye" or "angle"; for "across", the factor that modulates the profile.
        at
            The shading context.
        **where
            Attributes of the context to replace.
        """
        return self._factors[slot].evaluate(replace(at, **where))

    def along(self, distance: Number, depth: Number, fraction: Number) -> Value:
        """Return the factor along the beam.

        Parameters
        ----------
        distance, depth
            Distance from the light, and the part of it in the medium, in scene units.
        fraction
            Distance from the light as a fraction of the whole light path.
        """
        return self._look.along.evaluate(
            self.at(distance=distance, depth=depth, from_light=distance, fraction=fraction)
        )

    def eye(self, distance: Number, depth: Number) -> Value:
        """Return the factor over a `distance` to the camera, of which `depth` is in the medium (scene units)."""
        return self._look.eye.evaluate(self.at(distance=distance, depth=depth, to_camera=distance))

    def angle(self, cosine: Number) -> Value:
        """Return the view-angle shading for the `cosine` between the light's direction and that to the camera."""
        return self._look.angle.evaluate(self.at(cosine=cosine))

    # -- How fast it changes ------------------------------------------------------------------------------------------

    def _probe(self, width: int, box: Box) -> ShadingContext:
        """Return a shading context for each of _LINES lines, `width` times, with all distances 0.

        Fractions, and the inputs that are constant along a ray, are spread over their ranges.
        """
        spread = (np.arange(_LINES) + 0.5) / _LINES
        rng = np.random.default_rng(0)
        low, high = np.asarray(box, dtype=np.float64)
        points = low + rng.random((_LINES, 3)) * (high - low)
        place = to_vectors(np.repeat(points, width, axis=0))

        def each(values: npt.ArrayLike) -> Float:
            return to_float(np.repeat(values, width))

        numbers = each(rng.permutation(spread)), each(np.arange(_LINES)), each(np.zeros(_LINES))
        return self.at(
            fraction=each(spread), cosine=each(2 * rng.permutation(spread) - 1), rho2=each(rng.permutation(spread)),
            place=lambda: place, beam=SimpleNamespace(identity=Array3f(*numbers)),
            **{name: each(np.zeros(_LINES)) for name in ("distance", "depth", "from_light", "to_camera")},
        )  # fmt: skip

    def _measure(self, reach: float, box: Box) -> None:
        """Measure the rates, and check that all factors are finite everywhere."""
        probe = self._probe(_SAMPLES, box)
        steps = np.tile(np.linspace(0, 1, _SAMPLES), _LINES)
        distances, unit = to_float(steps * reach), to_float(steps)
        along = replace(probe, distance=distances, depth=distances, from_light=distances)
        eye = replace(probe, to_camera=distances)
        self.rate_along = opaque(self._rate(along) / reach)
        self.rate_fraction = opaque(self._rate(replace(probe, fraction=unit)))
        self.rate_eye = opaque(self._rate(eye, distances) / reach)
        self.decay_along = opaque(self._decay(along) / reach)
        self.decay_eye = opaque(self._decay(eye, distances) / reach)
        self.rate_radius = opaque(self._rate(replace(probe, rho2=dr.square(unit))) if self.by_radius else 0.0)
        self.rate_place = opaque(0.0)
        turned = replace(probe, cosine=2 * unit - 1)
        if not _is_finite(self._look.angle, turned):
            self._complain(turned)
        if self.of_places:
            low, high = np.asarray(box, dtype=np.float64)
            size = max(float(np.linalg.norm(high - low)), 1e-6)
            axes = np.repeat(np.random.default_rng(1).normal(size=(_LINES, 3)), _SAMPLES, axis=0)
            axes /= np.linalg.norm(axes, axis=1, keepdims=True)
            # Lines cross the box in any direction. Noise that is finer than their steps counts as changing at the rate
            # of one step.
            offset = to_vectors(axes * (steps[:, None] - 0.5) * size)
            start = probe.point
            moved = replace(probe, place=lambda: start + offset)
            self.rate_place = opaque(self._rate(moved) / size)

    def _rate(self, at: ShadingContext, reach_depth: Number = 0.0) -> float:
        """Return the look's rate of change over the unit interval: its slope or the square root of its curvature.

        Both are relative to the largest value, and equal for an exponential. A faint wave has little slope, but the
        billboard's error depends on its curvature. The curvature of corners, of which there are few, is ignored in
        favour of the slope.
        """
        width = _LINES * _SAMPLES
        values = np.asarray(dr.zeros(Float, width) + self._light(at, reach_depth) * Array3f(1), dtype=np.float64)
        if values.shape != (3, width):
            raise SceneError(f"a look has values of shape {values.shape[::-1]}: expected numbers or colours")
        if not np.all(np.isfinite(values)) or np.abs(values).max() > _MOST:
            self._complain(at, reach_depth)
        lines = values.reshape(3, _LINES, _SAMPLES)
        peak = np.abs(lines).max()
        if not peak > 0:
            return 0.0
        slope = np.abs(np.diff(lines, axis=-1)).max() * (_SAMPLES - 1) / peak
        bends = np.quantile(np.abs(np.diff(lines, 2, axis=-1)), _BENT, axis=-1).max() * (_SAMPLES - 1) ** 2 / peak
        return float(max(slope, np.sqrt(bends) if bends > _ROUNDING else 0.0))

    def _decay(self, at: ShadingContext, reach_depth: Number = 0.0) -> float:
        """Return how fast the look's exponent changes over the unit interval."""
        width = _LINES * _SAMPLES
        exponent = dr.zeros(Float, width) + self._split(at, reach_depth)[1] * Array3f(1)
        lines = to_numpy(exponent).reshape(3, _LINES, _SAMPLES)
        return float(np.abs(np.diff(lines, axis=-1)).max() * (_SAMPLES - 1))

    def _complain(self, at: ShadingContext, reach_depth: Number = 0.0) -> None:
        """Raise SceneError with the name of the factor that is not finite, or say that their product is too large."""
        for slot, each in self._factors.items():
            here = at.own(at.to_camera, reach_depth) if slot == "eye" else at
            if not _is_finite(each, here):
                raise SceneError(f"the look's factor {slot} is not finite everywhere: expected a number or a colour")
        raise SceneError(f"the look's factors reach more than {_MOST:g} together: expected smaller numbers")


def _is_finite(factor: Factor, at: ShadingContext) -> bool:
    return bool(dr.all(dr.isfinite(dr.sum(factor.evaluate(at) * Array3f(1)))))


def _tamed(value: Value) -> Value:
    """Return a value, 0 where it is negative or not finite."""
    return dr.select(dr.isfinite(value), dr.maximum(value, 0), 0)
