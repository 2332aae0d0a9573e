"""Images in front of lights and on portals: their places, their power, and the agreement of surfaces and beams."""

import dataclasses

import drjit as dr
import numpy as np
import pytest

from photonbeams import scene
from photonbeams.numerics.arrays import to_vectors
from photonbeams.numerics.sampling import sobol_block
from photonbeams.runtime.device import Array2f, Array3f, Float, UInt32
from photonbeams.world.described import world_of_scene
from photonbeams.world.emitters.portals import emit_through
from tests.helpers.tracing import trace

RADIANCE = (3.0, 2.0, 1.0)
COUNT = 1 << 16
DOWN = np.array([0.0, 0.0, -1.0])
NOISE = np.random.default_rng(4).random((5, 7, 3)).astype(np.float32)
#: Red top left, green top right, blue bottom left, white bottom right, in blocks that are flat in their middle.
CORNERS = np.kron(np.array([[[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 1, 1]]]), np.ones((16, 24, 1))).astype(np.float32)
RED, GREEN, BLUE, WHITE = np.eye(3)[0], np.eye(3)[1], np.eye(3)[2], np.ones(3)
#: A frame with the light along −Z and +Y up, and the same frame turned about X: the light is along −Y, and −Z is up.
FRAME = np.eye(4)
TURNED = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def spot(image=NOISE, angle=60.0, repeat=False, **given):
    given = {"axis": DOWN, "radius": 0.0} | given
    return scene.SphereLight("/light", RADIANCE, gobo=scene.Gobo(image, angle=angle, repeat=repeat), **given)


def flat(image=NOISE, **given):
    return scene.FlatLight(
        "/light", RADIANCE, half_x=np.array([0.7, 0, 0]), half_y=np.array([0, 0.4, 0]), axis=DOWN,
        gobo=scene.Gobo(image), **given,
    )  # fmt: skip


def distant(image=NOISE, width=1.5, repeat=False, angle=0.0, **given):
    gobo = scene.Gobo(image, width=width, repeat=repeat)
    return scene.DistantLight("/light", RADIANCE, axis=DOWN, angle=angle, gobo=gobo, **given)


WINDOW = scene.Mesh(
    "/window",
    np.array([[-0.5, -0.3, -1.0], [0.5, -0.3, -1], [0.5, 0.3, -1], [-0.5, 0.3, -1]]),
    np.array([[0, 1, 2], [0, 2, 3]]),
)


def point(image=NOISE, portal=WINDOW, **given):
    return scene.SphereLight("/light", RADIANCE, portal=portal, portal_gobo=scene.Gobo(image, **given))


def world(*lights, **parts):
    return world_of_scene(scene.Scene(lights=lights, **parts), viewpoints=[(-4, 0, 0), (4, 0, 0)])


def paths_of(light, count=COUNT):
    built = world(light)
    source, samples = built.emitters[0].lamp, sobol_block(count, 0, (1,))
    if light.portal is not None:
        return emit_through(source, built.emitters[0].portal, built.bounds, *samples)
    return source.emit(*samples, built.bounds)


def flux(paths):
    """Return the total flux of paths, (3,), and its standard error if they were independent."""
    value = paths.flux.numpy().astype(np.float64) * paths.valid.numpy() / dr.width(paths.origin)
    return value.sum(axis=1), np.sqrt(value.shape[1]) * value.std(axis=1)


def interpolated(image, u, v):
    """Return an image at coordinates from its lower left corner, linear between pixel centres, in float64."""
    rows, columns = image.shape[:2]
    x, y = np.clip(u * columns - 0.5, 0, columns - 1), np.clip((1 - v) * rows - 0.5, 0, rows - 1)
    left, top = np.minimum(x.astype(int), columns - 2), np.minimum(y.astype(int), rows - 2)
    a, b = (x - left)[..., None], (y - top)[..., None]
    upper = (1 - a) * image[top, left] + a * image[top, left + 1]
    lower = (1 - a) * image[top + 1, left] + a * image[top + 1, left + 1]
    return (1 - b) * upper + b * lower


def over_solid_angle(image, width, distance):
    """Return ∫ image dω over a rectangle of this width, perpendicular to the axis at this distance: midpoint rule."""
    grid = (np.arange(400) + 0.5) / 400
    u, v = np.meshgrid(grid, grid)
    height = width * image.shape[0] / image.shape[1]
    x, y = (u - 0.5) * width, (v - 0.5) * height
    weight = distance / (x * x + y * y + distance * distance) ** 1.5 * width * height / u.size
    return np.einsum("ijk,ij->k", interpolated(image, u, v), weight)


MEAN = NOISE.astype(np.float64).mean(axis=(0, 1))  # linear between pixel centres, constant beyond them


@pytest.mark.parametrize(
    ("light", "power"),
    [
        (spot(), over_solid_angle(NOISE, 2 * np.tan(np.radians(30)), 1.0)),
        (spot(radius=0.2), np.pi * 0.04 * over_solid_angle(NOISE, 2 * np.tan(np.radians(30)), 1.0)),
        (flat(), np.pi * 4 * 0.7 * 0.4 * MEAN),
        (distant(), 1.5 * 1.5 * 5 / 7 * MEAN),
        (distant(angle=2.0), np.pi * np.sin(np.radians(1)) ** 2 * 1.5 * 1.5 * 5 / 7 * MEAN),
        (point(np.ascontiguousarray(NOISE[:, :5])), None),
    ],
    ids=["spot", "sphere", "rect", "distant", "sun", "portal"],
)
def test_the_power_of_all_beams_is_the_integral_of_the_image(light, power):
    if power is None:  # the window is 1 x 0.6, and the image covers it
        grid_u, grid_v = (np.arange(500) + 0.5) / 500, (np.arange(300) + 0.5) / 300
        u, v = np.meshgrid(grid_u, grid_v)
        x, y = u - 0.5, 0.6 * (v - 0.5)
        seen = interpolated(light.portal_gobo.image, 1 - u, v)  # by a viewer who faces the light
        power = np.einsum("ijk,ij->k", seen, 0.6 / u.size / (x * x + y * y + 1) ** 1.5)
    total, error = flux(paths_of(light))
    # Samples of a Sobol sequence do far better than as many independent ones; 1e-3 for the kinks between pixels.
    assert np.all(np.abs(total / RADIANCE / power - 1) < 0.3 * error / total + 1e-3)


def test_an_image_lies_on_each_of_several_openings_and_not_between_them():
    """It was stretched over the rectangle around all of them. Also in two planes."""
    first, second, third = (
        scene.Mesh(f"/w{x}", WINDOW.points * [0.5, 1, 1] + np.array([x, 0, z]), WINDOW.faces)
        for x, z in ((-1.0, 0.0), (1.0, 0.0), (4.0, -0.5))
    )
    corners = np.cumsum([0, len(first.points), len(second.points)])
    whole = scene.Mesh(
        "/w", np.concatenate([each.points for each in (first, second, third)]),
        np.concatenate([each.faces + start for each, start in zip((first, second, third), corners, strict=True)]),
    )  # fmt: skip
    gobos = tuple(scene.Gobo(NOISE, over=each) for each in (first, second, third))
    light = dataclasses.replace(distant(), gobo=None, portal=whole, portal_gobo=gobos)
    alone = [dataclasses.replace(light, portal=each.over, portal_gobo=each) for each in gobos]
    lamp = world(light).emitters[0].lamp
    for single, gobo in zip(alone, gobos, strict=True):
        places = gobo.over.points.mean(axis=0) + np.array([[-0.1, 0.1, 0], [0.12, -0.03, 0], [0, 0.2, 0]])
        at = to_vectors(places)
        one = world(single).emitters[0].lamp
        assert lamp.portal_color(at).numpy() == pytest.approx(one.portal_color(at).numpy(), abs=1e-5)
        behind = places + 0.2 * light.axis / np.linalg.norm(light.axis)
        assert seen_from(lamp, behind)[0] == pytest.approx(seen_from(one, behind)[0], abs=1e-5)
    between = seen_from(lamp, np.array([[0.0, 0, -0.2]]))[0]
    assert between == pytest.approx(seen_from(world(dataclasses.replace(distant(), gobo=None)).emitters[0].lamp,
                                              np.array([[0.0, 0, -0.2]]))[0])  # fmt: skip


@pytest.mark.parametrize("light", [spot, flat, distant], ids=["spot", "rect", "distant"])
def test_a_half_black_image_darkens_half_of_the_light(light):
    half = np.ones((64, 64, 1), dtype=np.float32)
    half[:, :32] = 0
    paths, whole = paths_of(light(half)), paths_of(light(np.ones_like(half)))
    lit, bright = paths.flux.numpy()[0], whole.flux.numpy()[0]
    rough = 1 / np.sqrt((bright > 0).sum())  # the error of as many independent paths
    assert lit.sum() == pytest.approx(0.5 * bright.sum(), rel=rough)
    assert (lit > 0).sum() == pytest.approx(0.5 * (bright > 0).sum(), rel=0.03)  # half a pixel of 64 is grey
    dark = paths.direction.numpy()[0] < -0.02 if light is spot else paths.origin.numpy()[0] < -0.03
    if light is flat:  # for a viewer who faces the light, the left is at +X
        dark = paths.origin.numpy()[0] > 0.03
    assert np.all(lit[dark] == 0)


def seen_from(source, places, u=(0.5, 0.5)):
    """Return the light's weight at places, divided by its radiance, (N, 3), and the light sample."""
    at = to_vectors(np.asarray(places, dtype=np.float64))
    sample = source.illuminate(at, Array2f(*u) + dr.zeros(Float, len(places)))
    return sample.weight.numpy().T / RADIANCE, sample


@pytest.mark.parametrize(
    ("frame", "local"),
    [(FRAME, lambda p: p), (TURNED, lambda p: [p[0], p[2], -p[1]])],
    ids=["upright", "turned"],
)
def test_a_slide_is_upright_on_the_wall_as_seen_from_the_light(frame, local):
    light = spot(CORNERS, 90.0, frame=frame, axis=-frame[:3, 2])
    # On a wall two units ahead, the image is four units wide and, by its aspect, 8/3 high; local X is to the right.
    places = np.array([local(p) for p in [(-1.0, 0.7, -2), (1, 0.7, -2), (-1, -0.7, -2), (1, -0.7, -2)]])
    weight, sample = seen_from(world(light).emitters[0].lamp, places)
    squared = np.sum(places**2, axis=1)[:, None]
    assert np.allclose(weight * squared, [RED, GREEN, BLUE, WHITE], atol=1e-6)
    assert np.allclose(sample.distance.numpy() ** 2, squared[:, 0])
    outside = [local(p) for p in [(2.1, 0, -2), (0, 1.4, -2), (0, 0, 2), (-1.0, 0.7, 2)]]
    assert np.array_equal(seen_from(world(light).emitters[0].lamp, outside)[0], np.zeros((4, 3)))


@pytest.mark.parametrize("portal", [False, True], ids=["rect", "portal"])
def test_an_image_on_a_pane_is_upright_for_one_who_faces_the_light(portal):
    # For a viewer at z = -4 who looks along +Z, -X is on the right.
    places = [[0.3, 0.2, -4], [-0.3, 0.2, -4], [0.3, -0.2, -4], [-0.3, -0.2, -4]]
    if portal:
        places = [[4 * x, 4 * y, z] for x, y, z in places]  # seen from the light through the window
        weight, sample = seen_from(world(point(CORNERS)).emitters[0].lamp, places)
        weight *= sample.distance.numpy()[:, None] ** 2
        assert np.allclose(weight, [RED, GREEN, BLUE, WHITE], atol=1e-5)
        beside = [[2.2, 0, -4], [0, 1.4, -4], [0.3, 0.2, -0.5]]  # past the window, and before it
        weight, sample = seen_from(world(point(CORNERS)).emitters[0].lamp, beside)
        assert np.allclose(weight * sample.distance.numpy()[:, None] ** 2, 1, rtol=1e-5)
    else:
        # According to UsdLuxRectLight's documentation, the first pixel is at (+X, +Y).
        source = world(flat(CORNERS)).emitters[0].lamp
        for (u, v), color in {(0.8, 0.8): RED, (0.2, 0.8): GREEN, (0.8, 0.2): BLUE, (0.2, 0.2): WHITE}.items():
            weight, _ = seen_from(source, [[0, 0, -4]], (u, v))
            assert np.allclose(weight / weight.max(), color, atol=1e-5)


def test_an_image_on_a_skylight_has_its_top_where_up_is_said_to_be():
    skylight = dataclasses.replace(WINDOW, points=WINDOW.points[:, [0, 2, 1]])  # at y = -1, under the light
    light = point(CORNERS, portal=skylight, up=np.array([0.0, 0, -1]))
    places = [[-1.2, -4, -0.8], [1.2, -4, -0.8], [-1.2, -4, 0.8], [1.2, -4, 0.8]]
    weight, _ = seen_from(world(light).emitters[0].lamp, places)
    # For a viewer who looks up from below with the top at -Z, -X is on the right.
    assert np.array_equal(np.argsort(weight.max(axis=1) > 0), [0, 1, 2, 3])
    assert np.allclose(weight / weight.max(axis=1)[:, None], [GREEN, RED, WHITE, BLUE], atol=1e-5)


def test_a_distant_lights_image_is_as_wide_as_asked_and_may_repeat():
    frame = FRAME.copy()
    frame[:3, 3] = (5, 1, 9)
    for repeat in (False, True):
        source = world(distant(CORNERS, 3.0, repeat, frame=frame)).emitters[0].lamp
        at = np.array([(-0.7, 0.5), (0.7, 0.5), (-0.7, -0.5), (0.7, -0.5)])
        weight, _ = seen_from(source, [(5 + x, 1 + y, -20) for x, y in at])
        assert np.allclose(weight, [RED, GREEN, BLUE, WHITE], atol=1e-5)
        weight, _ = seen_from(source, [(5 + x + 3, 1 + y - 4, -20) for x, y in at])
        assert np.allclose(weight, [RED, GREEN, BLUE, WHITE] if repeat else 0, atol=1e-5)


def test_surface_light_under_a_checkerboard_is_its_projection():
    board = (np.indices((8, 8)).sum(axis=0) % 2).astype(np.float32)
    image = np.kron(board, np.ones((32, 32), dtype=np.float32))[..., None]
    source = world(spot(image, 40.0, center=np.array([0.0, 0, 3]))).emitters[0].lamp
    x, y = np.meshgrid(np.linspace(-1.2, 1.2, 97), np.linspace(-1.2, 1.2, 97))
    places = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    weight, sample = seen_from(source, places)
    width = 2 * 3 * np.tan(np.radians(20))
    u, v = places[:, 0] / width + 0.5, places[:, 1] / width + 0.5
    inside = (np.abs(u - 0.5) < 0.5) & (np.abs(v - 0.5) < 0.5)
    square = board[np.clip((8 * (1 - v)).astype(int), 0, 7), np.clip((8 * u).astype(int), 0, 7)] * inside
    irradiance = weight[:, 0] * sample.direction.numpy()[2]
    expected = square * 3 / np.linalg.norm(places - [0, 0, 3], axis=1) ** 3  # I cos θ / d²
    edges = [np.abs(8 * w - np.round(8 * w)) < 1 / 32 for w in (u, v)]  # the image fades over half a pixel on each side
    clear = ~(edges[0] | edges[1])
    assert clear.mean() > 0.8
    assert np.allclose(irradiance[clear], expected[clear], rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize(
    "light",
    [spot(radius=0.3), spot(radius=0.3, repeat=True, angle=20.0), flat(), flat(disk=True), distant(angle=10.0),
     dataclasses.replace(flat(), portal=WINDOW, portal_gobo=scene.Gobo(CORNERS))],
    ids=["sphere", "repeated", "rect", "disk", "distant", "both"],
)  # fmt: skip
def test_a_ray_sees_what_the_masked_light_sample_carries(light):
    source = world(light).emitters[0].lamp
    count = 1 << 12
    u, v = sobol_block(count, 0, (5,))
    at = Array3f(0.8 * v.x - 0.4, 0.6 * v.y - 0.3, Float(-2.0) + dr.zeros(Float, count))
    sample = source.illuminate(at, u)
    sight = source.see(at, sample.direction)
    carried, seen = sample.weight.numpy(), (sight.radiance / sight.pdf).numpy()
    hit = sight.hit.numpy()
    assert hit.mean() > 0.99 and (carried > 0).mean() > 0.2
    assert np.quantile(np.abs(seen - carried)[:, hit] / carried.max(), 0.99) < 1e-3


@pytest.mark.parametrize(
    "light",
    [spot(), spot(radius=0.3), flat(), distant(), distant(angle=8.0)],
    ids=["spot", "sphere", "rect", "distant", "sun"],
)
def test_beams_behind_an_image_land_as_surfaces_are_lit(light):
    built = world(light)
    paths = paths_of(light)
    half = 0.4
    o, d = paths.origin.numpy().astype(np.float64), paths.direction.numpy().astype(np.float64)
    t = (-1.5 - o[2]) / np.where(np.abs(d[2]) > 1e-9, d[2], 1e-9)
    x, y = o[0] + t * d[0] - 0.1, o[1] + t * d[1] - 0.2
    landing = (t > 0) & (d[2] < 0) & (np.abs(x) < half) & (np.abs(y) < half)
    beams = paths.flux.numpy().astype(np.float64) * landing / COUNT
    u, v = sobol_block(1 << 14, 0, (9,))
    at = Array3f(0.1 + half * (2 * v.x - 1), 0.2 + half * (2 * v.y - 1), Float(-1.5))
    sample = built.emitters[0].lamp.illuminate(at, u)
    value = (sample.weight * dr.maximum(sample.direction.z, 0)).numpy().astype(np.float64) * (2 * half) ** 2
    error = np.hypot(np.sqrt(COUNT) * beams.std(axis=1), value.std(axis=1) / 128)
    assert np.all(np.abs(beams.sum(axis=1) - value.mean(axis=1)) < 3 * error)
    assert np.all(value.mean(axis=1) > 10 * error)


def test_packed_masked_lights_have_their_own_images():
    plain = np.full((3, 2, 3), 0.5, dtype=np.float32)
    lights = [
        dataclasses.replace(spot(image, angle), name=f"/{i}", center=np.array([0.0, 0, i]))
        for i, (image, angle) in enumerate([(CORNERS, 90.0), (plain, 30.0), (NOISE, 50.0)])
    ]
    built = world(*lights)
    lamp = built.lamps.among(range(3))
    at = np.random.default_rng(1).uniform([-1, -1, -3], [1, 1, -2], (64, 3))
    for number, source in enumerate(each.lamp for each in built.emitters):
        taken = lamp(UInt32(number))
        assert np.allclose(seen_from(taken, at)[0], seen_from(source, at)[0], atol=1e-6)
    assert (seen_from(built.emitters[0].lamp, at)[0] > 0).any()


def test_a_mostly_black_image_still_gets_its_beams():
    image = np.zeros((64, 64, 1), dtype=np.float32)
    image[20:28, 30:38] = 1  # 1/64 of the slide
    bare = dataclasses.replace(spot(), gobo=None, shaping=scene.Shaping(30.0))
    fog = scene.Medium((0.1,) * 3)
    sets = [trace(world(light, media=(fog,)), beams_per_light=1024) for light in (bare, spot(image))]
    counts = [len(each[0].beams) for each in sets]
    assert counts[0] == 1024
    assert 0.7 * 1024 < counts[1] < 1.6 * 1024  # the cone around the slide, and half a pixel around the window
    # The same number of beams in a 64th of the cone are an eighth as wide.
    widths = [np.median(each[0].beams.arrays()["radius_end"]) for each in sets]
    assert 0.08 < widths[1] / widths[0] < 0.2


def test_a_black_image_leaves_no_beams():
    assert trace(world(spot(np.zeros((2, 2, 1), dtype=np.float32)), media=(scene.Medium((0.1,) * 3),))) == []


def test_the_paths_beside_a_portal_are_not_those_of_its_image():
    black = point(np.zeros((2, 2, 1), dtype=np.float32))
    sets = trace(world(black, media=(scene.Medium((0.1,) * 3),)), beams_per_light=512, light_side={"/light"})
    (beams,) = (each.beams.arrays() for each in sets)
    direction = beams["end"] - beams["start"]
    crossing = direction / direction[:, 2:] * -1.0
    through = (direction[:, 2] < 0) & (np.abs(crossing[:, 0]) < 0.499) & (np.abs(crossing[:, 1]) < 0.299)
    assert len(direction) > 100 and not through.any()


def test_a_bent_portal_holds_no_image():
    bent = dataclasses.replace(WINDOW, points=WINDOW.points + np.array([[0, 0, 0.1], [0, 0, 0], [0, 0, 0], [0, 0, 0]]))
    with pytest.raises(scene.SceneError, match="/light: the portal is not flat"):
        world(point(portal=bent))


def test_an_image_is_on_the_device_once_while_it_is_in_use():
    first = world(spot(), distant())
    later = world_of_scene(scene.Scene(lights=(spot(angle=50.0),)), like=first)
    one, *others = (each.lamp.pixels["slide"] for each in [*first.emitters, *later.emitters])
    assert len(others) == 2 and all(each is one for each in others)


@pytest.mark.parametrize(
    ("light", "degrees"),
    [
        (scene.SphereLight("/l", RADIANCE), 90),
        (scene.SphereLight("/l", RADIANCE, shaping=scene.Shaping(25.0)), 50),
        (scene.SphereLight("/l", RADIANCE, shaping=scene.Shaping(90.0)), 90),
        (spot(angle=33.0, shaping=scene.Shaping(25.0)), 33),
    ],
)
def test_a_slide_covers_its_own_angle_or_the_lights_cone(light, degrees):
    assert light.slide_angle == degrees
