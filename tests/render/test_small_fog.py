"""Fog that is smaller than a pixel, a few pixels wide, or seen by a part of the lens, is as bright as any other."""

import numpy as np
import pytest

from photonbeams.runtime.device import mitsuba
from photonbeams.world.media.discovery.survey import held

mi = mitsuba()

WIDTH = 16
LAMP, INTENSITY = (0.8, 1.2, 2.0), 10.0
AWAY, FOV = 4.0, 30.0
DEEP = {"max_depth": 12, "rr_depth": 1000}


def ball_of_fog(radius, depth, *, place=0.0, width=WIDTH, **more):
    """Return a ball of fog of an optical `depth` around (place, place, 0), with a lamp beside it, before a camera.

    `more` are other objects, and settings of the camera.
    """
    medium = {"type": "homogeneous", "albedo": 0.99, "sigma_t": depth / (2 * radius)}
    film = {"type": "hdrfilm", "width": width, "height": width, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    to_world = mi.ScalarTransform4f().look_at(origin=[0, 0, AWAY], target=[0, 0, 0], up=[0, 1, 0])
    return mi.load_dict({
        "type": "scene",
        "fog": {
            "type": "sphere", "center": [place, place, 0], "radius": radius, "bsdf": {"type": "null"},
            "interior": medium,
        },
        "lamp": {"type": "point", "position": LAMP, "intensity": {"type": "rgb", "value": INTENSITY}},
        "sensor": {"type": "perspective", "fov": FOV, "to_world": to_world, "film": film} | more.pop("sensor", {}),
        **more,
    })  # fmt: skip


def mean(scene, passes, **settings):
    """Return the mean of a picture."""
    integrator = mi.load_dict({"type": "photon_beams", **settings})
    return float(np.array(mi.render(scene, integrator=integrator, spp=passes, seed=1)).mean())


@pytest.mark.parametrize("place", [0.0, 0.06])
def test_fog_that_no_middle_of_a_pixel_sees_is_lit(place):
    """Of thin fog with the volume V at the distance D, pixels of the width p at 1 see Σ L p² = σs E V / (4π D²)."""
    radius, depth = 0.05, 0.02  # of a pixel's width, 0.134
    scene = ball_of_fog(radius, depth, place=place)
    to_fog = np.linalg.norm(np.array(LAMP) - [place, place, 0])
    volume, scattering = 4 / 3 * np.pi * radius**3, 0.99 * depth / (2 * radius)
    away = np.linalg.norm([place, place, AWAY])
    right = scattering * INTENSITY / to_fog**2 * volume / (4 * np.pi * away**2)
    picture = (2 * np.tan(np.radians(FOV / 2))) ** 2  # of all pixels, at 1
    # A pass has a sample in each pixel, and the fog covers 0.44 of one: 96 passes err by 0.11. Of unguided light
    # paths, two of 16,384 meet the fog, and their beams are as wide as a 20th of it.
    assert mean(scene, 96, max_depth=2, rr_depth=1000) == pytest.approx(right / picture, rel=0.35)


def test_fog_of_a_few_pixels_is_as_bright_as_in_a_larger_picture():
    large = mean(ball_of_fog(0.25, 4.0, width=128), 4, **DEEP)
    # 64 passes err by 0.006. With the volumes that rays through 16 × 16 pixels see it was a tenth too dark.
    assert mean(ball_of_fog(0.25, 4.0), 64, **DEEP) == pytest.approx(large, rel=0.035)


def post():
    """Return a dark post before the fog."""
    to_world = mi.ScalarTransform4f().translate([0, 0, 2.5]).scale([0.08, 3, 0.02])
    return {"type": "cube", "to_world": to_world, "bsdf": {"type": "diffuse", "reflectance": 0.0}}


def behind():
    """Return fog behind a ball of fog."""
    to_world = mi.ScalarTransform4f().translate([0, 0, -1]).scale([1.5, 1.5, 0.4])
    interior = {"type": "homogeneous", "albedo": 0.99, "sigma_t": 5.0}
    return {"type": "cube", "to_world": to_world, "bsdf": {"type": "null"}, "interior": interior}


@pytest.mark.parametrize(
    ("aperture", "radius", "center", "lamp", "other"),
    [(0.3, 1.5, (0, 0, 0), LAMP, post), (0.4, 0.3, (0.2, 0, 2), (0.3, 0.9, 2.2), behind)],
)
def test_fog_that_a_part_of_the_lens_sees_is_as_bright_as_by_paths(aperture, radius, center, lamp, other):
    """A post far out of focus hides a part of the fog from each place on the lens, or a ball of fog is before it."""
    lens = {"type": "thinlens", "aperture_radius": aperture, "focus_distance": 2.0}
    fog = {"type": "sphere", "center": center, "radius": radius, "bsdf": {"type": "null"},
           "interior": {"type": "homogeneous", "albedo": 0.99, "sigma_t": 1.5 / radius}}  # fmt: skip
    light = {"type": "point", "position": lamp, "intensity": {"type": "rgb", "value": INTENSITY}}
    scene = ball_of_fog(radius, 3.0, sensor=lens, other=other(), fog=fog, lamp=light)
    right = np.array(mi.render(scene, integrator=mi.load_dict({"type": "volpath", **DEEP}), spp=2048, seed=1))
    own = np.array(mi.render(scene, integrator=mi.load_dict({"type": "photon_beams", **DEEP}), spp=6, seed=1))
    # 6 passes err by 0.022, and the paths by 0.001. What the pass's place on the lens and a ray both see is 0.1 less;
    # by cells behind the ball alone, fog beside it was 0.1 brighter.
    assert own[:, 5:11].mean() == pytest.approx(right[:, 5:11].mean(), rel=0.055)


@pytest.mark.parametrize("beside", [(2.2, 0, 0), (0, -2.2, 0), (-2.2, 0, 0), (0, 2.2, 0), (2.2, -2.2, 0)])
def test_fog_beside_the_picture_changes_nothing(beside):
    other = {
        "type": "sphere", "center": beside, "radius": 0.25, "bsdf": {"type": "null"},
        "interior": {"type": "homogeneous", "albedo": 0.99, "sigma_t": 8.0},
    }  # fmt: skip
    alone, both = (mean(ball_of_fog(0.25, 4.0, **more), 4, **DEEP) for more in ({}, {"other": other}))
    assert both == pytest.approx(alone, rel=0.2)  # 4 passes err by 0.03, and the other ball lights this one a little


@pytest.mark.parametrize("least", [(-0.08, -0.08, -0.08), (0.52, 0.42, -0.08)])
def test_instances_of_fog_are_in_its_box(least):
    medium = {"type": "homogeneous", "albedo": 0.99, "sigma_t": 40.0, "id": "fog"}
    ball = {"type": "sphere", "radius": 0.08, "bsdf": {"type": "null"}, "interior": {"type": "ref", "id": "fog"}}
    scene = mi.load_dict({
        "type": "scene", "fog": medium, "group": {"type": "shapegroup", "ball": ball},
        "instance": {
            "type": "instance", "to_world": mi.ScalarTransform4f().translate([0.6, 0.5, 0]),
            "group": {"type": "ref", "id": "group"},
        },
    } | ({"itself": ball} if least[0] < 0 else {}))  # fmt: skip
    ((low, high),) = held(scene).values()
    np.testing.assert_allclose([low, high], [least, [0.68, 0.58, 0.08]], atol=1e-6)
