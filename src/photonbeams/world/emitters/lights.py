"""Lights in Dr.Jit: what reaches a point from a light, and what a ray that meets it sees.

Surfaces and beams share this code: a beam through a portal *is* the light that `illuminate` finds at a point of the
portal, so the two cannot disagree. The formulas of shaping are those of UsdLuxShapingAPI and hdEmbree's reference code.

The parameters of a light are opaque Dr.Jit values, with one struct for each kind of light. Structs of one kind can be
packed into arrays and gathered in a loop, so that a kernel depends neither on the number of lights nor on their values.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, TypeVar

import drjit as dr
import numpy as np

from ... import scene
from ...numerics.arrays import opaque, to_float, to_uint, to_vectors
from ...runtime.device import Array2f, Array3f, Float, UInt32, mitsuba
from ..warp import cone, disk, perpendicular
from .cylinders import CylinderLamp
from .illumination import Illumination, Lamp, LightHit, ShapingFactor, unit
from .mesh_lamps import MeshLamp
from .stretched import StretchedLamp

mi = mitsuba()

T = TypeVar("T")


class SphereLamp(Lamp):
    """A sphere that radiates evenly; with radius 0, a point, whose `radiance` is a radiant intensity."""

    central = True
    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {
        "radiance": Array3f, "center": Array3f, "radius": Float, "axis": Array3f, "shaping": ShapingFactor,
    }  # fmt: skip

    radiance: Any
    center: Any
    radius: Any
    axis: Any
    shaping: Any

    @classmethod
    def of(cls, light: scene.SphereLight) -> SphereLamp:
        """Return the light's parameters, opaque."""
        result = cls()
        result.radiance, result.center = opaque(light.radiance), opaque(light.center)
        result.radius, result.axis = opaque(light.radius), opaque(unit(light.axis))
        result.shaping = ShapingFactor.of(light.shaping)
        return result

    def emitted(self, direction: Array3f) -> Array3f:
        """Return the radiance (of a point: the intensity) that leaves along `direction`."""
        return self.radiance * self.shaping.factor(dr.dot(direction, self.axis))

    def silhouette(self, direction: Array3f) -> Float:
        """Return the area of the sphere's projection along `direction`."""
        return dr.pi * self.radius * self.radius + 0 * direction.x

    def position(self, u: Array2f, direction: Array3f) -> Array3f:
        """Return a point from which light leaves along `direction`, uniform over the silhouette."""
        s, t = perpendicular(direction)
        offset = disk(u)
        lift = dr.safe_sqrt(1 - dr.squared_norm(offset))
        return self.center + self.radius * (s * offset.x + t * offset.y + direction * lift)

    def illuminate(self, point: Array3f, u: Array2f) -> Illumination:
        """Return a direction in the cone that the sphere subtends, uniform in solid angle."""
        to = self.center - point
        squared = dr.squared_norm(to)
        axis = to * dr.rsqrt(squared)
        one_minus_cos, outside = self._subtended(squared)
        towards = dr.select(self.radius > 0, cone(u, axis, one_minus_cos), axis)
        along = dr.dot(to, towards)
        across = dr.squared_norm(to - along * towards)
        distance = along - dr.safe_sqrt(self.radius * self.radius - across)
        pdf = dr.select(self.radius > 0, dr.rcp(dr.two_pi * one_minus_cos), 0)
        scale = dr.select(self.radius > 0, dr.two_pi * one_minus_cos, dr.rcp(squared))
        weight = dr.select(outside, self.emitted(-towards) * scale, 0)
        return Illumination(towards, distance, weight, pdf)

    def see(self, origin: Array3f, direction: Array3f) -> LightHit:
        """Return what a ray sees of the sphere; a point is not seen."""
        to = self.center - origin
        along = dr.dot(to, direction)
        room = self.radius * self.radius - dr.squared_norm(to - along * direction)
        distance = along - dr.safe_sqrt(room)
        one_minus_cos, outside = self._subtended(dr.squared_norm(to))
        hit = (self.radius > 0) & outside & (room >= 0) & (distance > 0)
        radiance = dr.select(hit, self.emitted(-direction), 0)
        return LightHit(hit, dr.select(hit, distance, dr.inf), radiance, dr.rcp(dr.two_pi * one_minus_cos))

    def _subtended(self, squared_distance: Float) -> tuple[Float, Any]:
        """Return 1 − cos of the half angle that the sphere subtends, and whether the point is outside of the sphere."""
        sine2 = self.radius * self.radius / squared_distance
        outside = sine2 < 1
        sine2 = dr.select(outside, sine2, 1)
        return dr.maximum(sine2 / (1 + dr.safe_sqrt(1 - sine2)), 1e-30), outside


class EllipsoidLamp(StretchedLamp):
    """A stretched sphere."""

    central = True
    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {**StretchedLamp.FIELDS, "shape": SphereLamp}

    @classmethod
    def round(cls) -> SphereLamp:
        """Return a sphere of radius 1."""
        return SphereLamp.of(scene.SphereLight("", scene.WHITE, radius=1.0))


class EllipticCylinderLamp(StretchedLamp):
    """A stretched cylinder, which may be oblique."""

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {**StretchedLamp.FIELDS, "shape": CylinderLamp}

    @classmethod
    def round(cls) -> CylinderLamp:
        """Return a cylinder of radius 1 along X, from -1 to 1."""
        return CylinderLamp.of(scene.CylinderLight("", scene.WHITE, half=np.array([1.0, 0.0, 0.0]), radius=1.0))


class FlatLamp(Lamp):
    """A rectangle or ellipse that radiates to one side, along `axis`."""

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {
        "radiance": Array3f, "center": Array3f, "half_x": Array3f, "half_y": Array3f, "dual_x": Array3f,
        "dual_y": Array3f, "axis": Array3f, "area": Float, "disk": Float, "shaping": ShapingFactor,
    }  # fmt: skip

    radiance: Any
    center: Any
    half_x: Any
    half_y: Any
    dual_x: Any
    dual_y: Any
    axis: Any
    area: Any
    disk: Any
    shaping: Any

    @classmethod
    def of(cls, light: scene.FlatLight) -> FlatLamp:
        """Return the light's parameters, opaque."""
        result = cls()
        halves = np.array([light.half_x, light.half_y], dtype=np.float64)
        dual = np.linalg.pinv(halves)  # each column has the dot product 1 with one half axis, and 0 with the other
        result.radiance, result.center = opaque(light.radiance), opaque(light.center)
        result.half_x, result.half_y = opaque(halves[0]), opaque(halves[1])
        result.dual_x, result.dual_y = opaque(dual[:, 0]), opaque(dual[:, 1])
        result.axis, result.area = opaque(unit(light.axis)), opaque(light.area)
        result.disk = opaque(1.0 if light.disk else 0.0)
        result.shaping = ShapingFactor.of(light.shaping)
        return result

    def emitted(self, direction: Array3f) -> Array3f:
        """Return the radiance that leaves along `direction`; none leaves to the back."""
        cosine = dr.dot(direction, self.axis)
        return dr.select(cosine > 0, self.radiance * self.shaping.factor(cosine), 0)

    def position(self, u: Array2f) -> Array3f:
        """Return a point of the light, uniform in area."""
        local = dr.select(self.disk > 0, disk(u), 2 * u - 1)
        return self.center + self.half_x * local.x + self.half_y * local.y

    def illuminate(self, point: Array3f, u: Array2f) -> Illumination:
        """Return the direction to a point of the light, uniform in area: weight L cos θ A / d²."""
        to = self.position(u) - point
        squared = dr.maximum(dr.squared_norm(to), 1e-30)
        distance = dr.sqrt(squared)
        towards = to / distance
        cosine = dr.maximum(-dr.dot(towards, self.axis), 0)
        weight = self.emitted(-towards) * (cosine * self.area / squared)
        return Illumination(towards, distance, weight, squared / dr.maximum(cosine * self.area, 1e-30))

    def see(self, origin: Array3f, direction: Array3f) -> LightHit:
        """Return what a ray sees of the light's front."""
        cosine = -dr.dot(direction, self.axis)
        distance = dr.dot(origin - self.center, self.axis) / dr.select(cosine > 0, cosine, 1)
        offset = origin + distance * direction - self.center
        x, y = dr.dot(offset, self.dual_x), dr.dot(offset, self.dual_y)
        inside = dr.select(self.disk > 0, x * x + y * y, dr.square(dr.maximum(dr.abs(x), dr.abs(y)))) <= 1
        hit = (cosine > 0) & (distance > 0) & inside & (self.area > 0)
        radiance = dr.select(hit, self.emitted(-direction), 0)
        pdf = distance * distance / dr.maximum(cosine * self.area, 1e-30)
        return LightHit(hit, dr.select(hit, distance, dr.inf), radiance, pdf)


class DistantLamp(Lamp):
    """Light from a cone of directions around −`axis`; if the cone has no angle, `radiance` is an irradiance."""

    infinite = True
    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {"radiance": Array3f, "axis": Array3f, "one_minus_cos": Float}

    radiance: Any
    axis: Any
    one_minus_cos: Any

    @classmethod
    def of(cls, light: scene.DistantLight) -> DistantLamp:
        """Return the light's parameters, opaque."""
        result = cls()
        result.radiance, result.axis = opaque(light.radiance), opaque(unit(light.axis))
        result.one_minus_cos = opaque(2 * np.sin(np.radians(light.angle) / 4) ** 2)  # 1 − cos of half the angle
        return result

    def illuminate(self, point: Array3f, u: Array2f) -> Illumination:
        """Return a direction in the light's cone, uniform in solid angle."""
        wide = self.one_minus_cos > 0
        towards = dr.select(wide, cone(u, -self.axis, self.one_minus_cos), -self.axis)
        solid_angle = dr.two_pi * self.one_minus_cos
        weight = self.radiance * dr.select(wide, solid_angle, 1)
        nowhere = 0 * point.x  # as wide as the points
        return Illumination(
            towards + nowhere, dr.inf + nowhere, weight + nowhere, dr.select(wide, dr.rcp(solid_angle), 0) + nowhere
        )

    def see(self, origin: Array3f, direction: Array3f) -> LightHit:
        """Return what a ray sees of the light, at infinity."""
        hit = dr.squared_norm(direction + self.axis) < 2 * self.one_minus_cos  # chord² = 2 (1 − cos)
        pdf = dr.rcp(dr.maximum(dr.two_pi * self.one_minus_cos, 1e-30))
        return LightHit(hit, dr.inf + 0 * origin.x, dr.select(hit, self.radiance, 0), pdf + 0 * origin.x)


class EmitterSource:
    """A Mitsuba emitter; `central` says whether its light goes out from one point, which is then `center`."""

    central = False
    center: Any

    def __init__(self, emitter: Any) -> None:
        self.emitter = emitter
        self.infinite = mi.has_flag(emitter.flags(), mi.EmitterFlags.Infinite)

    def illuminate(self, point: Array3f, u: Array2f) -> Illumination:
        """Return a direction, sampled by the emitter; by brightness if it is an environment."""
        interaction = dr.zeros(mi.SurfaceInteraction3f)
        interaction.p = mi.Point3f(point)
        sample, weight = self.emitter.sample_direction(interaction, mi.Point2f(u))
        nowhere = 0 * point.x
        weight = dr.select(sample.pdf > 0, Array3f(weight), 0)
        distance = dr.inf if self.infinite else sample.dist
        pdf = dr.select(sample.delta, 0, sample.pdf)
        return Illumination(Array3f(sample.d), distance + nowhere, weight + nowhere, pdf + nowhere)

    def see(self, origin: Array3f, direction: Array3f) -> LightHit:
        """Return the light of an environment along a ray that meets nothing else."""
        interaction = dr.zeros(mi.SurfaceInteraction3f)
        interaction.wi = mi.Vector3f(-direction)
        sample = dr.zeros(mi.DirectionSample3f)
        sample.d = mi.Vector3f(direction)
        radiance = Array3f(self.emitter.eval(interaction))
        nowhere = 0 * origin.x
        pdf = self.emitter.pdf_direction(interaction, sample) + nowhere
        return LightHit(nowhere == 0, dr.inf + nowhere, radiance + nowhere, pdf)


class DomeLamp(EmitterSource):
    """An environment, sampled by its brightness.

    Mitsuba's `envmap` has the convention of UsdLuxDomeLight's latlong format: +Y is up, the middle of the image looks
    along +Z and its first quarter along +X. So only the light's own rotation is applied. Mitsuba puts the first and the
    last row at the poles themselves, not half a row from them. The error is at most half a pixel of latitude, and is
    accepted.
    """

    def __init__(self, light: scene.DomeLight) -> None:
        radiance = np.asarray(light.radiance, dtype=np.float64)
        if light.image is None:
            plugin = {"type": "constant", "radiance": {"type": "rgb", "value": [float(c) for c in radiance]}}
        else:
            to_world = np.eye(4)
            to_world[:3, :3] = light.to_world
            pixels = np.ascontiguousarray(np.asarray(light.image)[..., :3] * radiance, dtype=np.float32)
            plugin = {
                "type": "envmap",
                "bitmap": mi.Bitmap(pixels),
                "to_world": mi.ScalarTransform4f(to_world),
            }
        super().__init__(mi.load_dict(plugin))


Light = SphereLamp | FlatLamp | CylinderLamp | StretchedLamp | MeshLamp | DistantLamp | DomeLamp


def source(light: scene.Light, host: Any = None, around: Sequence[Any] = ()) -> Light:
    """Return a light's lamp in Dr.Jit; for mesh lights, `host` is explained in `scene_of`, `around` in `MeshLamp`."""
    if isinstance(light, scene.SphereLight):
        return SphereLamp.of(light) if light.shape is None else EllipsoidLamp.of(light)
    if isinstance(light, scene.FlatLight):
        return FlatLamp.of(light)
    if isinstance(light, scene.CylinderLight):
        return CylinderLamp.of(light) if light.shape is None else EllipticCylinderLamp.of(light)
    if isinstance(light, scene.MeshLight):
        return MeshLamp(light, host, around)
    if isinstance(light, scene.DistantLight):
        return DistantLamp.of(light)
    if isinstance(light, scene.DomeLight):
        return DomeLamp(light)
    raise scene.SceneError(f"{light.name}: a {type(light).__name__} cannot be sampled")


def pack(sources: Sequence[T]) -> T:
    """Return structs of one kind as one struct of arrays, for `dr.gather` in a loop over lights.

    The last entry is repeated, because a gather from an array of one is a broadcast in Dr.Jit, hence another kernel.
    """
    result = type(sources[0])()
    for name, kind in result.DRJIT_STRUCT.items():  # type: ignore[attr-defined]
        values = [getattr(item, name) for item in [*sources, sources[-1]]]
        if hasattr(kind, "DRJIT_STRUCT"):
            packed: Any = pack(values[:-1])
        elif kind is UInt32:
            packed = to_uint([value.numpy()[0] for value in values])
        else:
            rows = np.array([np.ravel(value.numpy()) for value in values]).T
            packed = to_float(rows[0]) if kind is Float else to_vectors(rows.T)
        setattr(result, name, packed)
    return result
