"""Pictures of Mitsuba scenes against Mitsuba's own integrators, against closed forms, and against themselves."""

import drjit as dr
import numpy as np
import pytest

from photonbeams.render.scene_frame import begin, render
from photonbeams.runtime.device import mitsuba
from photonbeams.scene import SceneError
from photonbeams.transport.tuning import CEILING, FREE_PATHS
from tests.helpers.kernels import compiled
from tests.helpers.mitsuba_pictures import INSIDE, LAMP, SEEDS, SMALL, agree, pictures
from tests.helpers.mitsuba_scenes import (
    T,
    by_beams,
    camera,
    cloud,
    comparison,
    cube_of,
    fog,
    frames,
    load,
    rgb,
)
from tests.helpers.references import reference
from tests.helpers.sweep import sweep

mi = mitsuba()


HG = {"type": "hg", "g": 0.6}
PHASES = {
    "rayleigh": {"type": "rayleigh"},
    "blend": {"type": "blendphase", "weight": 0.4, "a": {"type": "isotropic"}, "b": HG},
    "table": {"type": "tabphase", "values": "0.1,0.2,0.5,2.0"},
}
SCENES = {
    "isotropic, single": ({"fog": cube_of(fog(0.5)), "light": LAMP}, 2),
    "isotropic": ({"fog": cube_of(fog(0.5)), "light": LAMP}, -1),
    "coloured, forward": ({"fog": cube_of(fog([0.3, 0.6, 0.9], [0.9, 0.8, 0.5], phase=HG)), "light": LAMP}, -1),
    "rayleigh, blend, table": (
        {**{name: {**cube_of(fog(0.8, phase=phase)), "to_world": T().translate([0.66 * x, 0, 0]).scale([0.32, 1, 1])}
            for x, (name, phase) in enumerate(PHASES.items(), -1)}, "light": LAMP}, 3),
    "cloud": ({"fog": cube_of(cloud()), "light": LAMP}, -1),
    "cloud, forward, light inside": ({"fog": cube_of(cloud(phase=HG)), "light": INSIDE}, 3),
    "sky": ({"fog": cube_of(fog(0.8, 0.7)), "light": {"type": "constant", "radiance": 0.5}}, -1),
    "walls": (
        {"fog": cube_of(fog(0.3, 0.8), 1.5), "light": LAMP,
         "floor": {"type": "rectangle", "to_world": T().translate([0, -0.8, 0]).rotate([1, 0, 0], -90),
                   "bsdf": {"type": "twosided", "side": {"type": "diffuse", "reflectance": rgb([0.6, 0.4, 0.2])}}}},
        2),
}  # fmt: skip


#: Those that are left out have a medium, a phase function and a light that another one has; depth alone differs.
FOR_SOAK = {"isotropic, single", "cloud, forward, light inside"}


@pytest.mark.parametrize("name", sweep(SCENES, SCENES.keys() - FOR_SOAK))
def test_pictures_are_those_of_volpath(name):
    parts, depth = SCENES[name]
    scene = load(**parts, sensor=camera(size=32))
    ours = pictures(scene, max_depth=None if depth < 0 else depth, hide_emitters=True, **SMALL)
    theirs = reference(f"scene_frame/{name}", scene, 128, SEEDS, max_depth=depth, hide_emitters=True)
    # Beams of radius r lose the part that lies outside the fog: in theory about r / 2 at each boundary, of a side of 2.
    assert agree(ours, theirs, bias=0.006)


def test_short_beams_make_the_same_picture():
    medium = fog([0.3, 0.6, 1.5], [0.9, 0.8, 0.5], phase=HG)
    scene = load(fog=cube_of(medium), light=LAMP, sensor=camera(size=32))
    ours = pictures(scene, hide_emitters=True, short=True, **{**SMALL, "beams": 32768})
    theirs = reference("scene_frame/short beams", scene, 128, SEEDS, hide_emitters=True)
    assert agree(ours, theirs, bias=0.006)


def test_a_coloured_cloud_is_that_of_volpathmis():
    scene = load(fog=cube_of(cloud((1.0, 0.5, 0.2))), light=LAMP, sensor=camera(size=32))
    ours = pictures(scene, hide_emitters=True, **SMALL)
    theirs = reference("scene_frame/a coloured cloud", scene, 128, SEEDS, "volpathmis", hide_emitters=True)
    assert agree(ours, theirs, bias=0.006)


def test_fog_without_a_border_fills_the_space():
    medium = mi.load_dict(fog(0.2, 0.5))
    spot = {"type": "spot", "to_world": T().look_at([-2, 0, 0], [0, 0.2, 0], [0, 1, 0]), "intensity": rgb(5.0)}
    scene = load(light=spot, sensor=camera(size=32, medium=medium))
    ours = pictures(scene, **SMALL)
    theirs = reference("scene_frame/fog without a border", scene, 256, SEEDS)
    assert agree(ours, theirs, bias=0.01)


def test_white_fog_in_a_white_sky_is_not_seen():
    """Energy is conserved: fog that absorbs nothing has the radiance of the uniform sky around it everywhere."""
    fill = {"type": "sphere", "bsdf": {"type": "null"}, "interior": fog([0.5, 1.0, 0.8], 1.0)}
    scene = load(fog=fill, light={"type": "constant", "radiance": 1.0}, sensor=camera(fov=30, size=32))
    found = pictures(scene, **SMALL)
    error = found.mean(axis=(1, 2)).std(axis=0, ddof=1) / np.sqrt(SEEDS)
    np.testing.assert_array_less(np.abs(found.mean(axis=(0, 1, 2)) - 1), 4.5 * error + 0.006)


@pytest.mark.parametrize(("depth", "expected"), [pytest.param(2, 0.1201, marks=pytest.mark.soak), (None, 0.1433)])
def test_the_comparison_scene_has_its_known_mean(depth, expected):
    scene = comparison()
    settings = by_beams(passes=4, beams=1 << 16, max_depth=depth, surfaces=False)
    mean = render(scene, scene.sensors()[0], settings).layers()["beams"].mean()
    assert mean == pytest.approx(expected, rel=0.005)


@pytest.mark.parametrize("sensor", sweep(["declares it", "does not say"], ["does not say"]))
def test_a_sensor_inside_of_fog_need_not_say_so(sensor):
    medium = mi.load_dict(fog(0.5))
    seen = camera((0, 0, 0.9), medium=medium if sensor == "declares it" else None, size=32)
    scene = load(fog=cube_of(medium), light=INSIDE, sensor=seen)
    declared = load(fog=cube_of(medium), light=INSIDE, sensor=camera((0, 0, 0.9), medium=medium, size=32))
    ours = pictures(scene, max_depth=2, **SMALL)
    theirs = reference("scene_frame/a sensor inside of fog", declared, 256, SEEDS, max_depth=2)
    assert agree(ours, theirs, bias=0.01)


def test_a_mirror_shows_what_stands_before_it():
    """A picture in a mirror is the picture of the mirrored camera, times the mirror's reflectance."""
    mirror = {"type": "rectangle", "to_world": T().translate([0, 0, 3]).rotate([1, 0, 0], 180).scale(9),
              "bsdf": {"type": "conductor", "material": "none"}}  # fmt: skip
    parts = {"fog": cube_of(fog(0.4, 0.9)), "light": {**LAMP, "center": [-2.0, 0.5, 0.0]}}
    # The mirror's plane is z = 3: the image of a camera at z = 2 that looks along +z is at z = 4 and looks along −z.
    seen = load(**parts, mirror=mirror, sensor=camera((0, 0, 2), (0, 0, 3)))
    image = load(**parts, sensor=camera((0, 0, 4), (0, 0, 0)))
    settings = {"passes": 1, "beams": 4096, "hide_emitters": True, "radius": 0.05, "guiding": False}
    # The mirror adds one segment to paths; none is left for light that the mirror reflects into the fog.
    by_mirror = pictures(seen, max_depth=3, **settings)[:, :, ::-1]
    direct = pictures(image, max_depth=2, **settings)
    # Rays leave the mirror and the fog's boundary with an offset of 1e-4, where the fog's size is of the order of one.
    assert agree(by_mirror, direct, bias=5e-3)


def test_the_same_seed_gives_the_same_picture_on_any_number_of_threads(set_threads):
    scene = load(fog=cube_of(fog(0.5)), light=LAMP, sensor=camera())
    settings = by_beams(passes=2, beams=2048)
    found = []
    for threads in (1, 2, 2):
        set_threads(threads)
        found.append(render(scene, scene.sensors()[0], settings).layers()["rgba"])
    assert np.array_equal(found[0], found[1]) and np.array_equal(found[1], found[2])


def test_a_checkpoint_of_another_picture_is_refused():
    scene = load(fog=cube_of(fog(0.5)), light=LAMP, sensor=camera())
    state = render(scene, scene.sensors()[0], by_beams(passes=1, beams=64)).sums()
    other = load(fog=cube_of(fog(0.5)), light=LAMP, sensor=camera(size=8))
    with pytest.raises(SceneError, match="checkpoint is of another picture"):
        begin(other, other.sensors()[0], by_beams()).restore(state)


def test_the_error_is_told_by_the_passes():
    """The error that the passes report agrees with the spread between pictures of different seeds."""
    scene = load(fog=cube_of(fog(0.5)), light=LAMP, sensor=camera())
    found = frames(scene, by_beams(passes=4, beams=512, alpha=1.0, max_depth=2), 8)
    values = np.array([each.layers()["beams"].mean(axis=2).ravel() for each in found])
    mean = values.mean(axis=0)
    order = np.argsort(values.std(axis=0, ddof=1) / np.maximum(mean, 1e-12))
    # The reported error is a mean around this one, of which half of the light has a smaller spread.
    middle = order[np.searchsorted(np.cumsum(mean[order]), 0.5 * mean.sum())]
    spread = values.std(axis=0, ddof=1)[middle] / mean[middle]
    told = np.median([each.error() for each in found])
    # Passes continue one sequence, so their mean is better than they report, but not by orders of magnitude.
    assert 0.2 * told < spread < 1.5 * told


def test_a_second_picture_compiles_nothing():
    # Only the camera and the samples change: Mitsuba itself compiles numbers of its plug-ins into kernels (a sphere's
    # centre, a medium's scale). The first pictures also compile the kernels of rare events.
    def picture(number):
        scene = load(fog=cube_of(fog(0.5)), light=LAMP, sensor=camera((0, 0.1 * number, 4)))
        render(scene, scene.sensors()[0], by_beams(passes=3, beams=16384 + number, seed=number))

    for number in range(3):
        picture(number)
    assert not compiled(picture, 3)


def test_light_that_is_scattered_by_nothing_is_a_plain_picture():
    """A scene without media shows surfaces, and has no beams."""
    scene = load(light=LAMP, floor={"type": "rectangle", "to_world": T().scale(2)}, sensor=camera())
    frame = render(scene, scene.sensors()[0], by_beams(passes=2, max_depth=2))
    assert frame.statistics.beams == 0
    assert frame.layers()["surface"].mean() > 0 and not frame.layers()["beams"].any()


def test_kernels_do_not_leave_derivatives_on():
    scene = load(fog=cube_of(fog(0.5)), light=LAMP, sensor=camera())
    frame = begin(scene, scene.sensors()[0], by_beams(beams=64))
    for each in frame.light.traced(0, lambda: None).sets:
        assert not dr.grad_enabled(each.beams.start, each.beams.radius_end)


def test_a_point_light_in_fog_is_its_closed_form():
    """Rays have the radiance ∫ σs / 4π · I exp(−σt (t + d)) / d² dt, here by the midpoint rule in the angle φ."""
    strength, albedo, intensity = 0.3, 0.8, 2.0
    medium = mi.load_dict(fog(strength, albedo))
    light = {"type": "point", "position": [0, 0, 0], "intensity": rgb(intensity)}
    scene = load(light=light, sensor=camera((1.5, 1.0, 4), (1.5, 1.0, 0), fov=20, size=8, medium=medium))
    found = pictures(scene, passes=2, beams=1 << 16, max_depth=2, surfaces=False)[..., 0].mean(axis=0)
    x = np.tan(np.radians(10)) * ((np.arange(8 * 8) + 0.5) / 32 - 1)  # 8 places in each pixel
    grid = np.stack(np.broadcast_arrays(x[None], -x[:, None], -1.0), axis=-1)
    grid /= np.linalg.norm(grid, axis=-1, keepdims=True)
    origin = np.array([1.5, 1.0, 4.0])
    closest = -(grid @ origin)
    height = np.linalg.norm(origin + closest[..., None] * grid, axis=-1)
    # t = closest + height tan φ: dt / d² = dφ / height.
    first = np.arctan2(-closest, height)
    steps = 512
    exact = np.zeros(height.shape)
    for step in range(steps):
        angle = first + (step + 0.5) / steps * (np.pi / 2 - first)
        t, d = closest + height * np.tan(angle), height / np.cos(angle)
        exact += np.exp(-strength * (t + d)) / height * (np.pi / 2 - first) / steps
    exact *= strength * albedo * intensity / (4 * np.pi)
    expected = exact.reshape(8, 8, 8, 8).mean(axis=(1, 3))
    # Pixels have a spread of 3.4 % with one seed and 1.7 % with four, and about four of them are correlated. The
    # largest of 64 deviations is within 4.5 times that, and that of the mean within 2.5 times a quarter of it.
    np.testing.assert_allclose(found, expected, rtol=0.08)
    assert found.mean() == pytest.approx(expected.mean(), rel=0.01)


@pytest.mark.parametrize("extinction", [0.5, 40.0])
def test_radii_are_of_the_medium_whatever_lies_around_it(extinction):
    def radii(ground):
        below = {"type": "rectangle", "to_world": T().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(ground)}
        light = {"type": "point", "position": [0, 3, 0], "intensity": rgb(1.0)}
        both = load(fog=cube_of(fog(extinction)), below=below, light=light, sensor=camera())
        beams = begin(both, both.sensors()[0], by_beams(beams=512, guiding=False)).light.traced(0, lambda: None).sets
        return np.concatenate([each.beams.radius_end.numpy() for each in beams])

    near, far = radii(2.0), radii(10_000.0)
    widest = min(CEILING * np.sqrt(3), FREE_PATHS / extinction)
    assert near.max() <= widest * (1 + 1e-6) and far.max() <= widest * (1 + 1e-6)
    # The beams that come straight from the light are the same.
    assert np.median(far) == pytest.approx(np.median(near), rel=0.2)
