"""Shading normals without black rims: a mesh's smooth ones, and Mitsuba's `normalmap` and `bumpmap` as a BSDF.

Smooth normals on a coarse mesh may face away from the direction ωi from which it is seen, or mirror it below the mesh.
`consistent` bends them where rays meet surfaces, so that all BSDFs have sensible ones.

A mapped normal N may face away from the direction ωi from which a surface is seen, and directions sampled around N may
lie below the surface. Mitsuba's plug-ins return black there. What this one does depends on the BSDF inside:

- Specular ones (mirrors, metal, glass): an N that faces away is mirrored at the plane across ωi, and directions that
  would leave through the surface are mirrored at the tangent plane, like light that bounces once more between facets
  (Schüssler et al., Microfacet-based Normal Mapping, 2017). Both are continuous, and no light is lost: seen from ωi,
  the albedo is that of the BSDF around N.
- Diffuse ones are always seen from the front, wherever N points, as in other renderers.
- Mixed ones would be too bright with either at grazing light. N is bent toward the surface's normal until the mirror
  direction of ωi is above the surface (as in Cycles). Of a glossy lobe, at most half is then lost.

Like every such remedy, they make the BSDF non-reciprocal where they have an effect.

References
----------
A. Reshetov, A. Soupikov and W. Mark, "Consistent Normal Interpolation", SIGGRAPH Asia 2010.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import drjit as dr

from ...numerics.syntax import syntax
from ...runtime.device import Array2f, Array3f, Bool, Float, kept_variant, mitsuba, mitsuba_variant
from ..warp import outward

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import BsdfContext, SurfaceInteraction

#: The plug-in's type in Mitsuba's dictionaries.
NORMAL_MAP = "photonbeams_normalmap"

mi = mitsuba()
with kept_variant():  # the plug-in is for stages, which have colors, whichever variant imports this module
    _colored = mitsuba(mitsuba_variant())
    _BSDF: Any = _colored.BSDF
    _colored.register_bsdf(NORMAL_MAP, lambda properties: NormalMap(properties))

#: Kinds of the BSDF inside: its lobes are specular, diffuse, or both.
SPECULAR, DIFFUSE, MIXED = "specular", "diffuse", "mixed"

_LEAST = 1e-3  # least cosine between N and ωi, or the surface's normal: below, float32 cancels
_ABOVE = 0.01  # cosine of a bent N's mirror direction


class NormalMap(_BSDF):  # type: ignore[misc]
    """The plug-in. It takes a BSDF, the kind of that as `lobes`, and one of two textures.

    `normalmap` holds n / 2 + 1 / 2 in tangent space, where the tangent points along u and the bitangent along v, even
    if the UVs are mirrored. `slopes` holds the derivatives of a bump map's heights by u and v, from
    `scene.UVTexture.slopes`.
    """

    def __init__(self, properties: Any) -> None:
        super().__init__(properties)
        inner = [properties[each] for each in properties if isinstance(properties[each], mi.BSDF)]
        self._inner, self._bumps = inner[0], "slopes" in properties
        self._lobes = properties["lobes"]
        self._map = properties["slopes" if self._bumps else "normalmap"]
        self.m_components = [self._inner.flags(i) for i in range(self._inner.component_count())]
        self.m_flags = self._inner.flags()

    def traverse(self, callback: Any) -> None:
        """List the texture and the BSDF inside for Mitsuba."""
        callback.put(
            "slopes" if self._bumps else "normalmap",
            self._map,
            mi.ParamFlags.Differentiable | mi.ParamFlags.Discontinuous,
        )
        callback.put("nested_bsdf", self._inner, mi.ParamFlags.Differentiable)

    def sample(
        self, context: BsdfContext, hit: SurfaceInteraction, sample1: Float, sample2: Array2f,
        active: Bool | bool = True,
    ) -> Any:  # fmt: skip
        """Sample the BSDF inside; directions through the surface are mirrored, or get no weight."""
        frame, inside = self._turned(hit, active)
        sample, weight = self._inner.sample(context, inside, sample1, sample2, active)
        outgoing = frame.to_world(sample.wo)
        same_side = (sample.wo.z * inside.wi.z > 0) == (hit.wi.z > 0)
        if self._lobes != SPECULAR:
            kept = (outgoing.z > 0) == same_side
            sample.wo, sample.pdf = outgoing, dr.select(kept, sample.pdf, 0)
            return sample, dr.select(kept, weight, 0)
        height = dr.maximum(dr.abs(outgoing.z), 1e-6)
        sample.wo = mi.Vector3f(outgoing.x, outgoing.y, dr.select(same_side, height, -height))
        ideal = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
        sample.pdf = dr.select(ideal, sample.pdf, self.pdf(context, hit, sample.wo, active & ~ideal))
        return sample, weight

    def eval_pdf(
        self, context: BsdfContext, hit: SurfaceInteraction, outgoing: Array3f, active: Bool | bool = True
    ) -> Any:
        """Return value and density, which for specular BSDFs include those of the mirrored direction."""
        frame, inside = self._turned(hit, active)
        reflects = outgoing.z * hit.wi.z > 0
        value, density = mi.Color3f(0), Float(0)
        for height in (outgoing.z, -outgoing.z) if self._lobes == SPECULAR else (outgoing.z,):
            leaving = frame.to_local(mi.Vector3f(outgoing.x, outgoing.y, height))
            chosen = active & ((leaving.z * inside.wi.z > 0) == reflects)
            found, pdf = self._inner.eval_pdf(context, inside, leaving, chosen)
            value, density = value + dr.select(chosen, found, 0), density + dr.select(chosen, pdf, 0)
        return value, density

    def eval(self, context: BsdfContext, hit: SurfaceInteraction, outgoing: Array3f, active: Bool | bool = True) -> Any:
        """Return the value, as `eval_pdf` does."""
        return self.eval_pdf(context, hit, outgoing, active)[0]

    def pdf(self, context: BsdfContext, hit: SurfaceInteraction, outgoing: Array3f, active: Bool | bool = True) -> Any:
        """Return the density, as `eval_pdf` does."""
        return self.eval_pdf(context, hit, outgoing, active)[1]

    def eval_diffuse_reflectance(self, hit: SurfaceInteraction, active: Bool | bool = True) -> Any:
        """Return the diffuse reflectance of the BSDF inside."""
        return self._inner.eval_diffuse_reflectance(hit, active)

    def normal(self, hit: Any, active: Bool | bool = True) -> Any:
        """Return the mapped normal in the shading frame, before it is turned toward the viewer."""
        found, n = self._map.eval_3(hit, active), hit.sh_frame.n
        area = dr.dot(dr.cross(hit.dp_du, hit.dp_dv), n)
        if self._bumps:
            slope = found.x * dr.cross(hit.dp_dv, n) + found.y * dr.cross(n, hit.dp_du)
            world = n - dr.select(area == 0, 0, slope / area)
        else:
            tangent = dr.normalize(dr.fma(-n, dr.dot(n, hit.dp_du), hit.dp_du))
            bitangent = dr.cross(n, tangent) * dr.select(area < 0, -1, 1)
            x, y, z = 2 * found - 1
            world = tangent * x + bitangent * y + n * dr.maximum(z, _LEAST)
        return mi.Normal3f(dr.normalize(hit.to_local(world)))

    def _turned(self, hit: SurfaceInteraction, active: Bool | bool) -> tuple[Any, Any]:
        """Return the frame around the turned normal, in the shading frame, and the hit as the BSDF inside sees it."""
        incident, normal = hit.wi, self.normal(hit, active)
        facing = dr.select(incident.z < 0, -1, 1) * incident
        if self._lobes == SPECULAR:
            cosine = dr.dot(normal, facing)
            normal = dr.select(cosine < 0, normal - 2 * cosine * facing, normal)
            normal = dr.normalize(normal + dr.maximum(_LEAST - dr.abs(cosine), 0) * facing)
        elif self._lobes == MIXED:
            normal = _bent(normal, facing)
        frame = mi.Frame3f(normal)
        inside = mi.SurfaceInteraction3f(hit)
        seen = frame.to_local(incident)
        if self._lobes == DIFFUSE:
            seen.z = dr.mulsign(dr.maximum(dr.abs(seen.z), _LEAST), incident.z)
        inside.wi = seen
        return frame, inside

    def to_string(self) -> str:
        """Return the plug-in's name with the inner BSDF's."""
        return f"NormalMap[{self._inner}]"


def _bent(normal: Any, facing: Any) -> Any:
    """Return N, bent until the mirror image of a direction lies above the surface.

    Let θ be the angle between N and the surface's normal. In the plane of these, let the direction's projection have
    the length ρ and the angle φ to the surface's normal. The mirrored direction then has the cosine ρ cos(2 θ − φ).
    """
    sine = dr.maximum(dr.norm(mi.Vector2f(normal.x, normal.y)), 1e-9)
    x, y = normal.x / sine, normal.y / sine
    along = x * facing.x + y * facing.y
    length = dr.maximum(dr.norm(mi.Vector2f(along, facing.z)), 1e-9)
    most = 0.5 * (dr.atan2(along, facing.z) + dr.acos(_least_height(facing.z) / length))
    angle = dr.minimum(dr.atan2(sine, normal.z), most)
    turned, height = dr.sincos(angle)
    return mi.Normal3f(turned * x, turned * y, height)


def _least_height(cosine: Float) -> Float:
    """Return the least cosine between the surface's normal and the mirror image of a direction with this cosine."""
    return dr.minimum(_ABOVE, 0.9 * cosine)


@syntax
def consistent(hit: SurfaceInteraction) -> SurfaceInteraction:
    """Return hits with shading normals that face the side from which rays arrive, and mirror the rays to that side."""
    incident, shading, ground = (
        mi.Vector3f(dr.detach(each)) for each in (hit.to_world(hit.wi), hit.sh_frame.n, outward(hit))
    )
    cosine = dr.dot(ground, incident)
    side = dr.mulsign(Float(1), cosine)
    mirrored = 2 * side * dr.dot(shading, incident) * dr.dot(shading, ground) - dr.abs(cosine)
    result = mi.SurfaceInteraction3f(hit)
    seen, wi = mi.Frame3f(hit.sh_frame), mi.Vector3f(hit.wi)
    if hit.is_valid() & (mirrored < _least_height(dr.abs(cosine))):
        seen, wi = _seen(hit, side * _bent_toward(mi.Frame3f(side * ground), side * shading, incident))
    result.sh_frame, result.wi = seen, wi
    return result


def _bent_toward(ground: Any, normal: Any, incident: Any) -> Any:
    """Return a normal, bent in the frame of the surface's own."""
    return ground.to_world(_bent(ground.to_local(normal), ground.to_local(incident)))


def _seen(hit: SurfaceInteraction, normal: Any) -> tuple[Any, Any]:
    """Return the frame of a shading normal, and the direction of the ray in it."""
    turned = mi.SurfaceInteraction3f(hit)
    turned.sh_frame.n = normal
    turned.initialize_sh_frame()
    return turned.sh_frame, turned.to_local(hit.to_world(hit.wi))
