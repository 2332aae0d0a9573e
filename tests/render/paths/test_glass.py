"""Glass in pictures: where a camera path first meets glass, both reflection and refraction are followed."""

from functools import partial

import numpy as np

from photonbeams.render.scene_frame import render
from photonbeams.runtime.device import mitsuba
from tests.helpers.kernels import compiled
from tests.helpers.mitsuba_scenes import T, by_beams, camera, cube_of, fog, load, rgb

mi = mitsuba()
IOR = 1.5
SKY = {"type": "constant", "radiance": rgb(1.0)}
BALL = {"type": "sphere", "radius": 0.7, "bsdf": {"type": "dielectric", "int_ior": IOR}}
BLACK = {"type": "twosided", "side": {"type": "diffuse", "reflectance": rgb(0.0)}}


def picture(scene, **given):
    """Return the picture and its alpha, (H, W, 4)."""
    settings = {"passes": 1, "beams": 64, "surface_samples": 1, "guiding": False, **given}
    return render(scene, scene.sensors()[0], by_beams(**settings)).layers()["rgba"]


def reflectance(cosine):
    """Return the reflectance of glass by Fresnel's equations."""
    inside = np.sqrt(1 - (1 - cosine**2) / IOR**2)
    across = (cosine - IOR * inside) / (cosine + IOR * inside)
    along = (IOR * cosine - inside) / (IOR * cosine + inside)
    return 0.5 * (across**2 + along**2)


def test_a_pane_has_its_reflectance_in_each_pixel_of_a_single_pass():
    """A pane before a black wall reflects R' = 2R / (1 + R) of the sky, by all reflections between its two sides."""
    size, fov = 16, 20.0
    angle = np.radians(72.0)  # at this angle, no lobe is so faint that roulette ends it
    pane = {"type": "rectangle", "to_world": T().scale(20), "bsdf": {"type": "thindielectric", "int_ior": IOR}}
    wall = {"type": "rectangle", "to_world": T().translate([0, 0, -1]).scale(40), "bsdf": BLACK}
    eye = (0, -4 * np.sin(angle), 4 * np.cos(angle))
    found = picture(load(sky=SKY, pane=pane, wall=wall, sensor=camera(eye, (0, 0, 0), size=size, fov=fov)))
    # Each row of the picture sees the pane at its own angle; samples lie anywhere in a pixel.
    offset = np.radians(fov) / size
    near, far = (reflectance(np.cos(angle + each)) for each in (-0.5 * np.radians(fov), 0.5 * np.radians(fov)))
    expected = [2 * each / (1 + each) for each in (near, far)]
    rows = found[..., 0].mean(axis=1)
    assert found[..., 0].min() > 0.9 * expected[0] and found[..., 0].max() < 1.1 * expected[1]
    middle = [2 * each / (1 + each) for each in (reflectance(np.cos(angle + k * offset)) for k in (-1, 1))]
    assert middle[0] < rows[size // 2 - 1 : size // 2 + 1].mean() < middle[1]
    # A random choice between 0 and 1 would have a standard deviation of √(R' (1 − R')), 0.4.
    assert (found[..., 0].std(axis=1) < 0.05).all()
    assert np.allclose(found[..., 3], 1)


def test_a_ball_of_glass_in_an_even_sky_cannot_be_seen():
    found = picture(load(sky=SKY, ball=BALL, sensor=camera()), passes=4)[..., 0]
    error = found.std() / np.sqrt(found.size)
    assert abs(found.mean() - 1) < 4 * error + 1e-5
    assert error > 0 and found.std() < 0.3  # the noise of roulette at faint lobes


def scene_in_fog(shift=0.0):
    medium = mi.load_dict(fog(0.4, 0.9))
    lamp = {"type": "sphere", "center": [-1.5, 1.2, 0.5], "radius": 0.2,
            "emitter": {"type": "area", "radiance": rgb(40.0)}}  # fmt: skip
    floor = {"type": "rectangle", "to_world": T().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(3)}
    return load(
        fog=cube_of(medium, 2.5), ball={**BALL, "exterior": medium}, lamp=lamp, floor=floor,
        sensor=camera((0, 0.5 + shift, 4), (0, 0, 0)),
    )  # fmt: skip


def test_branches_add_up_in_one_order_on_any_number_of_threads(set_threads):
    scene, found = scene_in_fog(), []
    for threads in (1, 2, 2):
        set_threads(threads)
        found.append(picture(scene, beams=2048, surface_samples=2, max_depth=6))
    assert np.array_equal(found[0], found[1]) and np.array_equal(found[1], found[2])


def usual(kernels):
    """Return kernels without those of the last path, or the last ray: whether there is a single one is chance."""
    return [each for each in kernels if each["size"] > 2]


def test_another_view_of_glass_compiles_nothing():
    show = partial(picture, beams=2048, surface_samples=2, max_depth=6)
    for number in range(5):
        show(scene_in_fog(0.1 * number), seed=number)
    assert not usual(compiled(lambda: show(scene_in_fog(0.5), seed=5)))


def test_longer_paths_run_the_kernels_of_short_ones():
    show = partial(picture, scene_in_fog(), beams=2048, surface_samples=2)
    for seed in range(2):
        show(max_depth=6, seed=seed)
    assert not usual(compiled(lambda: show(max_depth=10)))
