"""Normal and bump maps: no black rims, the energy of the nested BSDF, and the normals that NumPy computes."""

import dataclasses

import drjit as dr
import numpy as np
import pytest

from photonbeams import scene
from photonbeams.runtime.device import Float, mitsuba
from photonbeams.world.surfaces.normal_maps import NORMAL_MAP
from photonbeams.world.surfaces.shapes import bsdf_of, sharp_bsdf_of

mi = mitsuba()
COUNT = 1 << 16
NORMALS = np.array([[[0.6, 0.0, 0.8], [-0.5, 0.3, 0.8]], [[0.0, -0.8, 0.6], [0.0, 0.0, 1.0]]])
NORMALS /= np.linalg.norm(NORMALS, axis=-1, keepdims=True)
MAP = scene.UVTexture((NORMALS / 2 + 0.5).astype(np.float32))


def hits(u, v, wi=None, dp_du=(1.0, 0, 0), dp_dv=(0, 1.0, 0), n=(0, 0, 1.0)):
    """Return hits at UVs, with the tangents of a parametrisation, seen from `wi` in the shading frame."""
    found = dr.zeros(mi.SurfaceInteraction3f, dr.width(u))
    found.uv = mi.Point2f(u, v)
    n, dp_du, dp_dv = (np.asarray(each, dtype=float).tolist() for each in (n, dp_du, dp_dv))
    found.dp_du, found.dp_dv = mi.Vector3f(*dp_du), mi.Vector3f(*dp_dv)
    found.n, found.sh_frame = mi.Normal3f(*n), mi.Frame3f(mi.Normal3f(*n))
    found.wi = mi.Vector3f(0, 0, 1) if wi is None else wi
    return found


def numbers(seed):
    """Return random numbers of [0, 1)^5 for many samples, stratified in the first dimension."""
    random = np.random.default_rng(seed)
    first = (np.arange(COUNT) + random.random(COUNT)) / COUNT
    return [Float(first), *(Float(random.random(COUNT)) for _ in range(4))]


METAL = scene.Material((1.0,) * 3, roughness=0.3, metallic=1.0, normal=MAP)
COSINES = (0.02, 0.1, 0.3, 0.6, 1.0)


def sampled(material, cosine):
    """Return the weights of samples of a material that is seen at an angle, and the cosines of their directions."""
    bsdf, (u, v, lobe, x, y) = mi.load_dict(sharp_bsdf_of(material) or bsdf_of(material)), numbers(1)
    wi = mi.Vector3f(float(np.sqrt(1 - cosine**2)), 0, cosine)
    sample, weight = bsdf.sample(mi.BSDFContext(), hits(u, v, wi), lobe, mi.Point2f(x, y))
    return weight.x.numpy(), sample.wo.z.numpy()


@pytest.mark.parametrize(
    ("material", "kept"),
    [
        (dataclasses.replace(METAL, roughness=0.0), 1.0),
        (METAL, 1.0),
        # At least half of a lobe around a direction above the horizon is above it; of a diffuse one, (1 + N·n) / 2 is.
        (dataclasses.replace(METAL, metallic=0.0), 0.5),
        (dataclasses.replace(METAL, metallic=0.0, ior=1.0), 0.8),
    ],
    ids=["mirror", "metal", "glossy", "matte"],
)
def test_in_a_furnace_no_direction_is_black_and_the_energy_is_that_of_the_bsdf_inside(material, kept):
    plain = dataclasses.replace(material, normal=None)
    inside = [sampled(plain, cosine)[0].mean() for cosine in COSINES]
    for cosine in COSINES:
        weight, height = sampled(material, cosine)
        assert np.all(np.isfinite(weight)) and np.all(height[weight > 0] > 0)
        noise = 6 * max(weight.std(), 1e-5) / np.sqrt(COUNT)
        assert kept * min(inside) - noise <= weight.mean() <= max(inside) + noise


@pytest.mark.parametrize("metallic", [1.0, 0.0])
def test_values_and_densities_are_those_of_the_samples(metallic):
    material = scene.Material((1.0,) * 3, roughness=0.6, metallic=metallic, normal=MAP)
    bsdf, (u, v, lobe, x, y) = mi.load_dict(bsdf_of(material)), numbers(2)
    seen = hits(u, v, mi.Vector3f(0.95, 0, float(np.sqrt(1 - 0.95**2))))
    sample, weight = bsdf.sample(mi.BSDFContext(), seen, lobe, mi.Point2f(x, y))
    direction = mi.warp.square_to_uniform_hemisphere(mi.Point2f(x, y))
    value, density = bsdf.eval_pdf(mi.BSDFContext(), seen, direction)
    # The fraction of samples that are kept, and their energy, from samples and from values: to six standard errors.
    for by_samples, by_values in ((Float(sample.pdf > 0), density), (weight.x, value.x)):
        one, other = by_samples.numpy(), 2 * np.pi * by_values.numpy()
        error = np.hypot(one.std(), other.std()) / np.sqrt(COUNT)
        assert abs(one.mean() - other.mean()) < 6 * error


@pytest.mark.parametrize("mirrored", [False, True])
def test_normals_are_of_the_tangents_of_the_uvs_also_where_those_are_mirrored(mirrored):
    bsdf = mi.load_dict(bsdf_of(METAL))
    dp_du, dp_dv = np.array([0.0, 2.0, 0.4]), np.array([0.5, 0.0, -0.1]) * (1 if mirrored else -1)
    n = np.array([0.0, 0.6, 0.8])
    for column, row in np.ndindex(2, 2):
        hit = hits((column + 0.5) / 2, (row + 0.5) / 2, dp_du=dp_du, dp_dv=dp_dv, n=n)
        found = hit.to_world(bsdf.normal(hit)).numpy().ravel()
        # Mitsuba's first row is at v = 0, the material's at v = 1.
        tangent = dp_du - n * (n @ dp_du)
        tangent /= np.linalg.norm(tangent)
        bitangent = np.cross(n, tangent) * np.sign(np.cross(dp_du, dp_dv) @ n)
        expected = NORMALS[1 - row, column] @ np.stack([tangent, bitangent, n])
        assert found == pytest.approx(expected, abs=1e-5)
        assert bitangent @ dp_dv > 0


@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
def test_bumps_tilt_the_normal_by_the_slope_of_their_heights(wrap):
    u, v = (np.arange(64) + 0.5) / 64, 1 - (np.arange(64)[:, None] + 0.5) / 64
    to_image = np.array([[2.0, 0.5, 0.1], [0, 0.5, 0.2], [0, 0, 1]])
    heights = scene.UVTexture((0.2 * u**2 - 0.1 * v * u)[..., None].astype(np.float32), wrap, to_image)
    bsdf = mi.load_dict({"type": NORMAL_MAP, "lobes": "mixed", "surface": {"type": "diffuse"},
                         "slopes": bsdf_of(scene.Material(bump=heights))["slopes"]})  # fmt: skip
    at = np.array([0.12, 0.31])
    s, t = to_image[:2, :2] @ at + to_image[:2, 2]
    slope = np.array([0.4 * s - 0.1 * t, -0.1 * s]) @ to_image[:2, :2]
    dp_du, dp_dv = np.array([2.0, 0, 0]), np.array([0.3, -0.5, 0.0])  # mirrored
    hit = hits(*at.tolist(), dp_du=dp_du, dp_dv=dp_dv)
    found = hit.to_world(bsdf.normal(hit)).numpy().ravel()
    moved = [dp + slope[axis] * np.array([0, 0, 1.0]) for axis, dp in enumerate((dp_du, dp_dv))]
    expected = -np.cross(*moved)
    # Differences of quadratics are exact at the pixels, and linear in between.
    assert found == pytest.approx(expected / np.linalg.norm(expected), abs=1e-4)


def test_slopes_change_their_sign_where_an_image_is_mirrored():
    heights = scene.UVTexture(np.linspace(0, 1, 8, dtype=np.float32)[None, :, None], "mirror")
    slopes = heights.slopes().pixels[..., 0]
    assert np.allclose(slopes[:, 1:7], 8 / 7) and np.allclose(slopes[:, 9:15], -8 / 7)
