"""The media of a scene as media of Mitsuba."""

import drjit as dr
import numpy as np
import pytest

from photonbeams import scene
from photonbeams.beams import Beams
from photonbeams.estimators.estimate import estimate_rays
from photonbeams.estimators.geometry import Rays
from photonbeams.estimators.points import Points
from photonbeams.looks import Attenuation
from photonbeams.quadrature import gauss_legendre
from photonbeams.render.scene_frame import begin, render
from photonbeams.runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from photonbeams.usd.authoring.presets import preset_look
from photonbeams.usd.looks.look import LookSpec
from photonbeams.usd.looks.shading import build_look
from photonbeams.world.media.interfaces import number
from photonbeams.world.media.media import Media
from photonbeams.world.media.rendered import MediumScattering
from photonbeams.world.media.stage_media import media_of
from photonbeams.world.media.tracking import Tracked
from tests.helpers.comparison import box
from tests.helpers.kernels import compiled
from tests.helpers.mitsuba_scenes import by_beams, camera, cube_of, fog, load, rgb

mi = mitsuba()
AIR = scene.Medium((0.1, 0.2, 0.3), name="/Air")
LIGHT = {"type": "point", "position": [-2.0, 1.5, 0.5], "intensity": rgb(30.0)}


def solid(name, low, high, strength=1.0, **more):
    return scene.Medium((strength,) * 3, mesh=box(name, low, high), name=name, **more)


def smoke(values=None, size=1.0, color=(1.0, 1.0, 1.0), name="/Smoke"):
    values = np.ones((2, 3, 4)) if values is None else values
    return scene.Medium(color, grid=scene.DensityGrid(values, np.diag([size, size, size, 1])), name=name)


def names(built):
    return {each.medium.name: None if each.shape is None or each.shape.exterior_medium() is None
            else each.shape.exterior_medium().id() for each in built}  # fmt: skip


def test_each_bounded_medium_is_inside_of_the_smallest_one_around_it():
    room, tank = solid("/Room", [-4] * 3, [4] * 3), solid("/Tank", [-2] * 3, [0] * 3)
    beside, apart = solid("/Beside", [1] * 3, [2] * 3), solid("/Apart", [9] * 3, [10] * 3)
    drop = solid("/Drop", [-1.5] * 3, [-0.5] * 3)
    found = names(media_of([drop, AIR, room, beside, tank, apart, smoke(name="/Smoke")]))
    assert found == {"/Drop": "/Tank", "/Air": None, "/Room": "/Air", "/Beside": "/Room", "/Tank": "/Room",
                     "/Apart": "/Air", "/Smoke": "/Room"}  # fmt: skip
    assert names(media_of([drop, tank])) == {"/Drop": "/Tank", "/Tank": None}


def test_smoke_that_replaces_what_is_around_it_is_named(caplog):
    media_of([AIR, smoke(name="/Smoke"), smoke(name="/Same"), smoke(size=0.5, name="/Less")])
    told = [each.getMessage() for each in caplog.records]
    rest = "replaces it in its whole box: they do not add up"
    assert told == [f"smoke /Less lies in /Same, and {rest}", f"smoke /Same lies in /Smoke, and {rest}",
                    f"smoke /Smoke lies in /Air, and {rest}"]  # fmt: skip
    caplog.clear()
    media_of([solid("/Room", [-4] * 3, [4] * 3), AIR])
    assert not caplog.text


def test_what_lies_on_the_floor_of_a_room_is_in_it():
    room, tank = solid("/Room", [-4] * 3, [4] * 3), solid("/Tank", [-1, -4, -1], [1, -3, 1])
    assert names(media_of([room, tank]))["/Tank"] == "/Room"


def test_faces_turn_outward_and_hold_the_medium():
    inside_out = box("/fog", [-1] * 3, [1] * 3)
    inside_out = scene.Mesh("/fog", inside_out.points, np.asarray(inside_out.faces)[:, ::-1])
    (built,) = media_of([scene.Medium((1.0,) * 3, mesh=inside_out, name="/fog")])
    assert built.shape.interior_medium().id() == "/fog" and built.shape.exterior_medium() is None
    hit = load(fog=built.shape).ray_intersect(mi.Ray3f(mi.Point3f(0.1, 0.2, 5), mi.Vector3f(0, 0, -1)))
    assert np.allclose(np.ravel(hit.n), [0, 0, 1]) and np.isclose(hit.t[0], 4)


def test_two_media_of_the_whole_space_are_refused():
    with pytest.raises(scene.SceneError, match="medium /B has no boundary, and is in medium /Air, which fills the"):
        media_of([AIR, scene.Medium((1.0,) * 3, name="/B")])


def test_media_that_overlap_are_named_once(caplog):
    media = [solid("/A", [-1] * 3, [1] * 3), solid("/B", [-0.5] * 3, [1.5] * 3)]
    warned: set[str] = set()
    for _ in range(2):
        media_of(media, warned)
    (record,) = caplog.records
    assert record.getMessage() == "media /A and /B overlap: expected one inside the other, or side by side"


def test_coefficients_are_those_of_the_scene_however_large():
    medium = scene.Medium((3.0, 1.0, 0.0), (0.5, 0.0, 2.0), 0.3, name="/Fog")
    (found,) = Media([media_of([medium])[0].plugin]).all
    np.testing.assert_allclose(found.medium.scattering, medium.scattering, atol=1e-6)
    np.testing.assert_allclose(found.medium.absorption, medium.absorption, atol=1e-6)
    assert found.medium.anisotropy == pytest.approx(0.3)


@pytest.mark.parametrize("channels", [1, 3])
def test_a_density_lies_as_the_grid_has_it(channels):
    """A density is linear between cell centres, has the axes (Z, Y, X), and multiplies the medium's coefficients."""
    values = np.random.default_rng(0).random((2, 3, 4, channels)).astype(np.float32)
    to_world = np.array([[0, -2, 0, 1], [3, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], dtype=float)
    grid = scene.DensityGrid(values if channels == 3 else values[..., 0], to_world)
    medium = scene.Medium((2.0, 1.0, 0.5), (1.0, 1.0, 1.0), grid=grid)
    place = dr_place(to_world @ [2.5 / 4, 1 / 2, 0.25, 1])  # in the third column, the second row, the first layer
    plugin = media_of([medium])[0].plugin
    scattering, _, extinction = plugin.get_scattering_coefficients(place)
    np.testing.assert_allclose(np.ravel(extinction), values[0, 1, 2] * np.array(medium.extinction), rtol=1e-5)
    np.testing.assert_allclose(np.ravel(scattering), values[0, 1, 2] * np.array(medium.scattering), rtol=1e-5)


def dr_place(point):
    place = mi.MediumInteraction3f()
    place.p = mi.Point3f(*point[:3].tolist())
    return place


def test_a_medium_of_a_scene_looks_as_mitsubas_own():
    (built,) = media_of([solid("/Fog", [-1] * 3, [1] * 3, 0.5)])
    scenes = (load(fog=each, light=LIGHT, sensor=camera(size=8)) for each in (built.shape, cube_of(fog(0.5, 1.0))))
    ours, theirs = (render(each, each.sensors()[0], by_beams(passes=2, beams=1024, guiding=False)) for each in scenes)
    # Samples and boxes are the same, and rays leave a mesh and a cube by the same offsets.
    np.testing.assert_allclose(ours.layers()["beams"], theirs.layers()["beams"], rtol=0.01, atol=1e-4)


def test_a_second_frame_of_other_media_compiles_nothing():
    def frame(index):
        rng = np.random.default_rng(index)
        built = media_of([
            scene.Medium((0.1, 0.2, 0.3 + 0.1 * index), name="/Air"),
            solid("/Fog", [-1] * 3, [1, 1, 1 + 0.1 * index], 1.0 + index, anisotropy=0.3 + 0.1 * index),
            smoke(rng.random((4, 4, 4)), 0.5, (1.0 + index,) * 3),
        ])  # fmt: skip
        air, thick, thin = built
        both = load(fog=thick.shape, smoke=thin.shape, light={**LIGHT, "medium": air.plugin},
                    sensor=camera((0, 0, 4), medium=air.plugin, size=4))  # fmt: skip
        return render(both, both.sensors()[0], by_beams(passes=1, beams=512, max_depth=4, guiding=False))

    assert frame(0).layers()["beams"].any()
    frame(1)
    assert not compiled(frame, 2)


def test_a_frame_knows_how_large_media_of_a_scene_are():
    air, drop = media_of([AIR, solid("/Drop", [-1] * 3, [1] * 3)])
    built = load(drop=drop.shape, light={**LIGHT, "medium": air.plugin}, sensor=camera(medium=air.plugin))
    frame = begin(built, built.sensors()[0], by_beams(beams=64, guiding=False))
    world = frame.light.world
    sizes = {each.number: world.radius_of(each) for each in world.media.all}
    assert sizes[number(drop.plugin)] == pytest.approx(np.sqrt(3), rel=1e-5)
    assert sizes[number(air.plugin)] >= np.sqrt(3)  # as large as the scene


def test_emission_of_a_grid_is_the_integral_along_camera_rays():
    """Emission agrees with 20,000 points of the same linear interpolation in float64, to five standard errors."""
    random = np.random.default_rng(2)
    density, glow = random.random((4, 5, 6)), random.random((4, 5, 6, 3))
    grids = [scene.DensityGrid(each, np.diag([2.0, 2.0, 2.0, 1.0])) for each in (density, glow)]
    color = (1.0, 2.0, 0.5)
    medium = scene.Medium((0.0,) * 3, color, grid=grids[0], emission=grids[1], name="/Fire")
    (built,) = media_of([medium])
    media = Media([built.plugin], emission={number(built.plugin): built.emission})
    assert media.emissive
    count, origin = 4096, np.array([0.2, 0.9, -1.0])
    direction = np.array([0.25, 0.1, 1.0]) / np.linalg.norm([0.25, 0.1, 1.0])
    rays = [mi.Vector3f(*each.tolist()) + dr.zeros(mi.Vector3f, count) for each in (origin, direction)]
    found = media.emitted(dr.full(mi.UInt32, number(built.plugin), count), *map(Array3f, rays), mi.Float(9.0),
                          dr.arange(mi.UInt32, count), dr.full(mi.Bool, True, count)).numpy().T  # fmt: skip
    enter, leave = 1 / direction[2], 3 / direction[2]
    t = enter + (np.arange(20000) + 0.5) * (leave - enter) / 20000
    points = origin + t[:, None] * direction
    extinction = interpolated(density[..., None], points / 2) * color
    transmittance = np.exp(-np.cumsum(extinction, axis=0) * (t[1] - t[0]))
    expected = (transmittance * interpolated(glow, points / 2)).sum(axis=0) * (t[1] - t[0])
    assert np.all(np.abs(found.mean(axis=0) - expected) < 5 * found.std(axis=0) / np.sqrt(count) + 1e-3 * expected)
    passed = media.transmittance(dr.full(mi.UInt32, number(built.plugin), count), *map(Array3f, rays), mi.Float(9.0),
                                 dr.arange(mi.UInt32, count), dr.full(mi.Bool, True, count)).numpy().T  # fmt: skip
    error = np.abs(passed.mean(axis=0) - transmittance[-1])
    assert np.all(error < 5 * passed.std(axis=0) / np.sqrt(count) + 1e-3 * transmittance[-1])


def interpolated(values, unit):
    """Interpolate values at cell centres, (Z, Y, X, C), at points of the unit cube, clamped at its sides."""
    shape = np.array(values.shape[2::-1])
    place = np.clip(unit * shape - 0.5, 0, shape - 1)
    first = np.minimum(place.astype(int), shape - 2)
    part, result = place - first, 0
    for corner in np.ndindex(2, 2, 2):
        x, y, z = (first + corner).T
        result = result + np.prod(np.where(corner, part, 1 - part), axis=1)[:, None] * values[z, y, x]
    return result


def test_looks_of_stages_have_the_grids_own_physical_factors():
    """Looks are products, with the density in the factors of scattering and of transmittance."""
    (found,) = Media([media_of([smoke(np.random.default_rng(0).random((2, 2, 2)))])[0].plugin]).all
    look = build_look(LookSpec("look", {**preset_look("look-physical").values, "along:tint": (1.0, 0.5, 0.25)}))
    shaded = found.shaded(look)
    for given, factor in ((shaded.eye, Tracked), (shaded.angle, MediumScattering)):
        assert [type(each) for each in given.factors] == [factor]
    assert not any(isinstance(each, Attenuation) for each in shaded.along.factors)
    assert shaded.across is look.across
    short = found.for_short_beams().shaded(look)
    assert [type(each) for each in short.angle.factors] == [MediumScattering]


def placed(x, size):
    """Return the transform of a grid's unit cube: at x, and so large."""
    result = np.diag([size, size, size, 1.0])
    result[0, 3] = x
    return result


def test_all_volumes_run_the_kernels_of_the_first():
    """Volumes of other sizes, places and values; the code of a plug-in contains these."""
    grids = [
        scene.DensityGrid(np.full((2, 2, 2 + each), 0.5 + each, np.float32), placed(3.0 * each, 1.0 + each))
        for each in range(4)
    ]
    built = media_of([scene.Medium(0.5, name=f"/V{number}", grid=grid) for number, grid in enumerate(grids)])
    media = Media(each.plugin for each in built)
    origin, direction = dr.opaque(Array3f, 0, 64), dr.opaque(Array3f, 3**-0.5, 64)
    rays = Rays(origin, direction, dr.opaque(Float, 9, 64), dr.opaque(Float, 0, 64))
    beams = Beams([[0, 0, 0]], [[9, 0, 1]], 0.5, 0.5, power=[[1, 1, 1]])
    points = Points(gauss_legendre(6))
    seed, active = dr.arange(UInt32, 64), dr.full(Bool, True, 64)

    def gathered(medium):
        medium.track(rays.origin, rays.direction, rays.t_min, rays.t_max, seed, active)
        dr.eval(estimate_rays(beams, rays, look=medium.shaded(None), medium=medium.medium, points=points))

    first, *others = media.all
    assert compiled(gathered, first)
    for each in others:
        assert not compiled(gathered, each)


def test_volumes_with_the_same_values_share_them():
    """A hundred instances of a grid take the memory of one, and each is where it is."""
    values = np.random.default_rng(5).random((3, 4, 5), np.float32)
    grids = [scene.DensityGrid(values, placed(2.0 * each, 1.0)) for each in range(3)]
    media = [scene.Medium(0.5, grid=grid) for grid in grids] + [scene.Medium(2.0, grid=grids[0])]
    built = [each.plugin for each in media_of(media)]
    data = [mi.traverse(each)["sigma_t.data"] for each in built]
    assert data[0].array.index == data[1].array.index == data[2].array.index != data[3].array.index
    place = dr.zeros(mi.MediumInteraction3f)
    for index, each in enumerate(built[:3]):
        place.p = mi.Point3f(2.0 * index + 0.1, 0.125, 1 / 6)  # the middle of the first cell
        found = each.get_scattering_coefficients(place)[2].numpy().ravel()
        np.testing.assert_allclose(found, 0.5 * values[0, 0, 0], rtol=1e-5)
        np.testing.assert_allclose(np.ravel(each.get_majorant(place).numpy()), 0.5 * values.max(), rtol=1e-6)
