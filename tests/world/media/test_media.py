"""Media of Mitsuba scenes: where they are, and which are refused."""

from dataclasses import replace

import numpy as np
import pytest

from photonbeams.render.scene_frame import render
from photonbeams.render.settings import Settings
from photonbeams.runtime.device import Array3f, UInt32, mitsuba
from photonbeams.scene import SceneError
from photonbeams.world.media.interfaces import medium_at, number
from photonbeams.world.media.media import Media
from tests.helpers.mitsuba_scenes import T, by_beams, camera, cloud, cube_of, fog, load, rgb
from tests.helpers.references import reference

mi = mitsuba()


def nested():
    """Return a scene and its media: nested cubes, a wall in the outer one, and a glass ball without a medium inside."""
    outer, inner = mi.load_dict(fog(0.1)), mi.load_dict(fog(2.0))
    scene = load(
        outer=cube_of(outer, 4),
        inner={**cube_of(inner), "exterior": outer},
        wall={"type": "rectangle", "to_world": T().translate([0, 0, 2])},
        ball={"type": "sphere", "center": [0, 3, 0], "radius": 0.5, "bsdf": {"type": "dielectric"}, "exterior": outer},
    )
    return scene, outer, inner


def test_points_are_in_the_medium_whose_interfaces_walks_meet():
    scene, outer, inner = nested()
    points = {(0, 0, 0): inner, (0.9, 0.9, 0.9): inner, (0, 0, 1.5): outer, (0, 0, 3): outer, (3.9, 0, 0): outer,
              (0, 3, 0): None, (0, 0, 9): None, (9, 9, 9): None}  # fmt: skip
    rng = np.random.default_rng(0)
    for direction in rng.normal(size=(16, 3)):
        unit = Array3f((direction / np.linalg.norm(direction)).tolist())
        origin = Array3f(np.array(list(points), dtype=np.float32).T)
        found = medium_at(scene, origin, unit, UInt32(7), UInt32(0)).numpy()
        assert found.tolist() == [number(medium) for medium in points.values()]


def test_where_no_interface_is_met_the_medium_is_the_usual_one_or_the_background():
    room = load(room={"type": "sphere", "bsdf": {"type": "twosided", "side": {"type": "diffuse"}}})
    for origin, expected in (((0, 0, 0.5), 7), ((0, 0, 2), 5)):
        found = medium_at(room, Array3f(*origin), Array3f(0, 0, -1), UInt32(7), UInt32(5))
        assert found.numpy().tolist() == [expected]


def test_homogeneous_media_are_read():
    medium = mi.load_dict(fog([0.4, 0.8, 1.2], [0.5, 0.25, 1.0], phase={"type": "hg", "g": 0.3}))
    (volume,) = Media([medium, medium, None]).all
    np.testing.assert_allclose(volume.medium.extinction, [0.4, 0.8, 1.2], rtol=1e-6)
    np.testing.assert_allclose(volume.medium.scattering, [0.2, 0.2, 1.2], rtol=1e-6)
    assert volume.medium.anisotropy == pytest.approx(0.3)
    assert volume.tracked is None


def test_media_that_vary_are_tracked_and_know_whether_they_have_a_colour():
    grey, red = mi.load_dict(cloud()), mi.load_dict(cloud((1.0, 0.5, 0.25)))
    assert [(each.tracked is not None, each.colored) for each in Media([grey]).all] == [(True, False)]
    assert [each.colored for each in Media([red]).all] == [True]


def test_a_grid_with_numbers_that_are_none_is_refused():
    medium = cloud()
    grid = np.ones((4, 4, 4, 1), dtype=np.float32)
    grid[1, 2, 3] = np.nan
    medium["sigma_t"]["grid"] = mi.VolumeGrid(grid)
    with pytest.raises(SceneError, match=r"medium dust: sigma_t.data has numbers that are not finite"):
        Media([mi.load_dict({**medium, "id": "dust"})])


@pytest.mark.parametrize("channels", [1, 3, 6])
def test_flakes_are_refused(channels):
    """Flakes are refused whatever their volume is, although Mitsuba evaluates only volumes with six channels."""
    grid = mi.VolumeGrid(np.ones((2, 2, 2, channels), dtype=np.float32))
    volume = {"type": "gridvolume", "grid": grid, "raw": True}
    if channels == 3:
        volume = {"type": "constvolume", "value": rgb(1.0)}
    plain, flakes = mi.load_dict(fog()), mi.load_dict(fog(phase={"type": "sggx", "S": volume}))
    with pytest.raises(SceneError, match="depends on the orientation of flakes"):
        Media([plain, flakes])


def test_a_grid_that_is_smaller_than_its_shape_ends_at_its_own_border():
    ones = {"type": "gridvolume", "grid": mi.VolumeGrid(np.ones((4, 4, 4, 1), np.float32)), "raw": True,
            "to_world": T().translate(-0.6).scale(1.2)}  # fmt: skip
    smoke = {"type": "heterogeneous", "sigma_t": ones, "albedo": 1.0, "scale": 3.0}
    # Without absorption, under uniform light of radiance 1, everything has the radiance 1.
    furnace = load(smoke=cube_of(smoke), light={"type": "constant", "radiance": 1.0}, sensor=camera(size=16))
    settings = by_beams(passes=2, beams=8192, max_radius=0.02, guiding=False)
    pictures = [render(furnace, furnace.sensors()[0], replace(settings, seed=seed)).layers()["rgba"] for seed in (1, 2)]
    means = np.array([picture[..., :3].mean() for picture in pictures])
    assert means == pytest.approx(1, abs=0.02)  # with light from outside of the grid it was 1.9


def test_media_that_touch_are_as_bright_as_with_a_gap():
    left, right = mi.load_dict(fog(1, 0.9)), mi.load_dict(fog([0.8, 0.3, 0.1], 0.7))

    def mean(gap):
        both = load(
            left={**cube_of(left), "to_world": T().translate([-0.7 - gap, 0, 0]).scale(0.7)},
            right={**cube_of(right), "to_world": T().translate([0.7, 0, 0]).scale(0.7)},
            floor={"type": "rectangle", "to_world": T().translate([0, -0.72, 0]).rotate([1, 0, 0], -90).scale(4)},
            light={"type": "point", "position": [-3, 2, 1], "intensity": 15.0}, sensor=camera((0, 1, 5), size=16),
        )  # fmt: skip
        # Without a pilot, whose paths decide where others go, both pictures have the same paths.
        settings = by_beams(passes=2, beams=65536, max_depth=4, guiding=False)
        return render(both, both.sensors()[0], settings).layers()["rgba"][..., :3].mean(axis=(0, 1))

    # Where rays meet only one of two coincident boundaries, 3 % is lost. With 8 passes the ratio spreads by 0.07 %
    # between seeds, so with 2 by twice that, if passes are independent.
    np.testing.assert_allclose(mean(0.0), mean(2e-3), rtol=5e-3)


@pytest.mark.parametrize("values", [[1e38] * 64, [0.0] * 63 + [1e38], [0.0] * 63 + [6e3]])
def test_grids_that_no_path_would_get_through_are_refused(values):
    grid = mi.VolumeGrid(np.reshape(values, (4, 4, 4, 1)).astype(np.float32))
    dense = {**cloud(), "sigma_t": {"type": "gridvolume", "grid": grid, "raw": True}}
    scene = load(fog=cube_of(mi.load_dict(dense)))
    with pytest.raises(SceneError, match=r"mean free paths across its grid: expected up to 10000"):
        Media.of(scene)


def halves(low, high):
    """Return a grid over [−1, 1]³ that changes along x."""
    values = np.array([low, high], dtype=np.float32).reshape(1, 1, 2, -1)
    grid = mi.VolumeGrid(np.repeat(np.repeat(values, 2, axis=0), 2, axis=1))
    return {"type": "gridvolume", "grid": grid, "raw": True, "to_world": T().translate(-1).scale(2)}


@pytest.mark.parametrize("method", ["beams", "paths"])
def test_the_albedo_of_a_homogeneous_medium_may_be_a_grid(method):
    medium = fog([1.0, 0.5, 0.25]) | {"albedo": halves([0.2, 0.9, 0.5], [0.9, 0.1, 0.5])}
    lamp = {"type": "sphere", "center": [0, 0, 3], "radius": 0.3, "light": {"type": "area", "radiance": 20.0}}
    scene = load(fog=cube_of(medium), lamp=lamp, sensor=camera((0, 3, 3), size=32, fov=20))
    (expected,) = reference("media/an albedo on a grid", scene, 1 << 10, max_depth=2)
    settings = Settings(method=method, passes=4, beams=1 << 13, max_depth=2, guiding=False)
    found = render(scene, scene.sensors()[0], settings).layers()["rgba"][..., :3]
    for own, theirs in zip(np.split(found, 2, axis=1), np.split(expected, 2, axis=1), strict=True):
        # With one albedo for all of it, channels are up to four times as bright. There is 2 % of noise.
        assert np.allclose(own.mean((0, 1)), theirs.mean((0, 1)), rtol=0.08)


def test_a_homogeneous_medium_with_a_grid_of_extinction_is_refused_unless_it_is_constant():
    same, other = ({"type": "homogeneous", "id": "dust", "sigma_t": halves([1.0], [end])} for end in (1.0, 2.0))
    assert [each.tracked for each in Media([mi.load_dict(same)]).all] == [None]
    with pytest.raises(SceneError, match=r"^medium dust: it is homogeneous, but its sigma_t is a grid: expected"):
        Media([mi.load_dict(other)])


def test_a_phase_function_whose_weight_is_a_grid_is_rough():
    phase = {"type": "blendphase", "weight": halves([0.0], [1.0]), "a": {"type": "isotropic"}, "b": {"type": "hg"}}
    (found,) = Media([mi.load_dict({"type": "homogeneous", "phase": phase})]).all
    assert found.tracked is None
    assert found.look.angle.rough
