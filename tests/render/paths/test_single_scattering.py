"""Smoke under a dome, sampled along camera paths: against closed forms and numerical integrals."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expn

from photonbeams import Look, Shot, scene
from photonbeams.runtime.device import mitsuba
from tests.helpers.comparison import box

mi = mitsuba()

SKY = (1.0, 2.0, 0.5)
SCATTERING, ABSORPTION = np.array([0.9, 0.3, 0.05]), np.array([0.1, 0.3, 0.05])
LAYERS = np.array([0.2, 3.0, 0.5, 0.0, 1.3], np.float32)  # densities of a slab's cells, from the bottom up
CORNER = np.outer([1, 1, 1, 0], [0, 0, 0, 1])  # a shift along the diagonal, as a matrix
WIDE = 500.0  # half the slab's side: so many free paths that its sides are black
CAMERA = scene.Camera.look_at((0, 3, 0), (0, 0, 0), up=(0, 0, 1), fov=1, aspect=1)


def slab(varying, **given):
    """Return a slab of height 1, homogeneous or in layers, that is lit by dome lights."""
    numbers = {"scattering": tuple(SCATTERING), "absorption": tuple(ABSORPTION), "name": "/smoke", **given}
    if not varying:
        return scene.Medium(mesh=box("/smoke", (-WIDE, 0, -WIDE), (WIDE, 1, WIDE)), **numbers)
    place = np.diag([2 * WIDE, 1, 2 * WIDE, 1])
    place[:3, 3] = -WIDE, 0, -WIDE
    return scene.Medium(grid=scene.DensityGrid(LAYERS[None, :, None], place), **numbers)


def scattered_once(varying):
    """Return the radiance above the slab, ∫ T σs S(y) dy, where S is the mean radiance of the sky that reaches y.

    The mean transmittance through an optical depth τ, over the directions of a hemisphere, is E2(τ).
    """
    y = (np.arange(20000) + 0.5) / 20000
    density = np.interp(y, (np.arange(5) + 0.5) / 5, LAYERS) if varying else np.ones_like(y)
    result = []
    for scattering, extinction, sky in zip(SCATTERING, SCATTERING + ABSORPTION, SKY, strict=True):
        below = extinction * (np.cumsum(density) - 0.5 * density) / len(y)
        above = extinction * density.mean() - below
        reaching = 0.5 * sky * (expn(2, below) + expn(2, above))
        result.append(np.mean(np.exp(-above) * scattering * density * reaching))
    return np.array(result)


SKY_ALONE = scene.DomeLight("/sky", SKY, lights_media=True, emits_beams=False)


@pytest.mark.parametrize("varying", [False, True])
def test_a_slab_under_an_even_sky_is_lit_as_exponential_integrals_say(varying):
    shot = Shot(scene.Scene(lights=[SKY_ALONE], media=[slab(varying)]), CAMERA)
    found = shot.render(passes=4, width=24, height=24, pixel_filter="box").layers["beams"].reshape(-1, 3)
    error = found.std(axis=0) / np.sqrt(len(found))
    assert np.all(np.abs(found.mean(axis=0) - scattered_once(varying)) < 4.5 * error)
    assert np.all(error < 0.02 * found.mean(axis=0))


@pytest.mark.parametrize("sky", [SKY_ALONE, scene.DomeLight("/sky", SKY)], ids=["sampled", "beams"])
def test_endless_fog_is_lit_by_the_sky_from_the_bounds_on(sky):
    """At the distance s from the middle of bounds of radius R, E = L exp(−σt R) sinh(σt s) / (σt s) arrives.

    Light begins in planes that touch the bounds, so it comes from a direction at the angle θ through R − s cos θ.
    """
    radius, fog = 5.0, scene.Medium(0.06, 0.04)
    camera = scene.Camera.look_at((0, 0, 0), (0, 0, -1), up=(0, 1, 0), fov=2, aspect=1)
    shot = Shot(scene.Scene(lights=[sky], media=[fog], bounds=(np.zeros(3), radius)), camera)
    found = shot.render(passes=4, width=16, height=16, guiding=False).layers["beams"].reshape(-1, 3)
    s = radius * (np.arange(10_000) + 0.5) / 10_000
    arriving = np.exp(-0.1 * radius) * np.sinh(0.1 * s) / (0.1 * s)
    right = np.array(SKY) * 0.06 * radius * (np.exp(-0.1 * s) * arriving).mean()
    # Beams as wide as most of the bounds blur: see below.
    assert found.mean(axis=0) == pytest.approx(right, rel=0.01 if sky is SKY_ALONE else 0.1)


@pytest.mark.parametrize("varying", [False, True])
def test_beams_of_an_even_sky_fade_as_its_light_does_in_a_cube(varying):
    """Beams of the sky's usual width, 0.9 of half the cube, would let 14 % too much light into the middle.

    The light is σs ∫ exp(−σt (t + d)) dt dω / 4π, with the distances d from points of the ray to the cube's faces.
    """
    half, size = 5.0, 0.1
    boundary = {"mesh": box("/m", (-half,) * 3, (half,) * 3)}
    grid = {"grid": scene.DensityGrid(np.ones((4, 4, 4)), np.diag([2 * half] * 3 + [1]) - half * CORNER)}
    cube = scene.Medium(size, name="/m", **(grid if varying else boundary))
    rng = np.random.default_rng(0)
    t, way = 9.9 * (np.arange(100_000) + 0.5) / 100_000, rng.normal(size=(100_000, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    point = np.stack([0 * t, 0 * t, 4.9 - t], axis=1)
    leaving = np.min((np.sign(way) * half - point) / way, axis=1)
    right = size * 9.9 * np.exp(-size * (t + leaving)).mean()
    sky = scene.DomeLight("/sky", 1.0)
    camera = scene.Camera.look_at((0, 0, 4.9), (0, 0, 0), up=(0, 1, 0), fov=5, aspect=1)
    shot = Shot(scene.Scene(lights=[sky], media=[cube]), camera)
    beams = shot.render(passes=4, width=8, height=8, guiding=False).layers["beams"]
    assert beams.mean() == pytest.approx(right, rel=0.1)  # the spread over seeds is 2.5 %


def test_the_light_that_domes_scatter_in_smoke_is_in_the_beams_of_their_group():
    # A cube of albedo 1 in a furnace is as bright as the sky. Scattered beams carry a tenth of its light (9 % are
    # missing without them). They are at most a twentieth of the cube's radius wide and reach out of it by no more on
    # either side, so at most a tenth of that tenth is lost. Light beyond ten bounces is below 0.1 %.
    cube = scene.Medium((0.5, 0.5, 0.5), mesh=box("/m", (-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)), name="/m")
    sky = replace(SKY_ALONE, radiance=(1.0, 1.0, 1.0), group="sky")
    camera = scene.Camera.look_at((0, 0.3, 3), (0, 0, 0), fov=8, aspect=1)
    layers = Shot(scene.Scene(lights=[sky], media=[cube]), camera).render(
        passes=4, width=24, height=24, max_depth=12, pixel_filter="box"
    ).layers  # fmt: skip
    assert np.array_equal(layers["beams"], layers["beams_sky"])
    assert layers["rgba"][..., :3].mean() == pytest.approx(1, abs=0.01)


def test_beams_that_nothing_shows_are_not_traced():
    lamp = scene.SphereLight("/lamp", (1.0, 1.0, 1.0), center=np.array([0, 2.0, 0]), radius=0.1, group="a")
    shown = replace(lamp, name="/shown", look=Look(angle=1.0), beam_count=64)
    for lights, beams in (([lamp], 0), ([lamp, shown], 64)):
        frame = Shot(scene.Scene(lights=lights), CAMERA).render(passes=1, width=8, height=8)
        assert (frame.statistics.beams, "beams_a" in frame.layers) == (beams, True)


@pytest.mark.parametrize("method", ["auto", "paths"])
def test_endless_fog_of_a_mitsuba_scene_is_lit_from_the_bounds_on(method):
    """As above: the sky of a scene whose bounds are those of two small balls."""
    fog = {"type": "homogeneous", "id": "fog", "sigma_t": 0.1, "albedo": 0.6}
    ball = {"type": "sphere", "radius": 0.01}
    camera = {
        "type": "perspective", "fov": 2, "medium": {"type": "ref", "id": "fog"},
        "film": {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}},
    }  # fmt: skip
    balls = {name: {**ball, "center": [x, 0, 0]} for name, x in (("left", -5), ("right", 5))}
    parts = {"fog": fog, "camera": camera, "sky": {"type": "constant", "radiance": 1.0}, **balls}
    plugin = {"type": "photon_beams", "method": method, "max_depth": 2}
    found = np.array(mi.render(mi.load_dict({"type": "scene", **parts}), integrator=mi.load_dict(plugin), spp=64))
    s = 5.01 * (np.arange(10_000) + 0.5) / 10_000
    arriving = np.exp(-0.1 * 5.01) * np.sinh(0.1 * s) / (0.1 * s)
    assert found.mean() == pytest.approx(0.06 * 5.01 * (np.exp(-0.1 * s) * arriving).mean(), rel=0.01)
