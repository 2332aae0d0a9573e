"""The light that reaches a point from a lamp, against the closed forms of radiometry."""

import dataclasses

import drjit as dr
import numpy as np
import pytest

from photonbeams import scene
from photonbeams.numerics.sampling import sobol_block
from photonbeams.numerics.structs import pack
from photonbeams.runtime.device import Array3f, Float, UInt32
from photonbeams.world.emitters.build import lamp_of
from photonbeams.world.emitters.kinds.sphere import SphereLamp
from photonbeams.world.emitters.shaping import ShapingFactor

POINTS = 1 << 14
AXIS = np.array([0.6, 0.0, -0.8])
SIDE = np.array([0.8, 0.0, 0.6])
UP = np.array([0.0, 1.0, 0.0])
RADIANCE = (3.0, 2.0, 1.0)
#: A stretched, turned, sheared and mirrored space.
STRETCHED = np.array([[0.9, 0.3, 0.0], [-0.2, 0.5, 0.1], [0.3, 0.2, -0.4]])


@pytest.fixture(scope="module")
def square():
    return sobol_block(POINTS, 0, (5,))[0]


def vector(values):
    return Array3f(*(Float(float(value)) for value in values))


def irradiance(source, point, normal, square):
    """Return the mean of weight · cos θ over samples, and its standard error if they were random, (3,) each."""
    light = source.illuminate(vector(point) + dr.zeros(Float, POINTS), square)
    cosine = dr.maximum(dr.dot(light.direction, vector(normal)), 0)
    value = (light.weight * cosine).numpy().astype(np.float64)
    return value.mean(axis=1), value.std(axis=1) / np.sqrt(POINTS)


def agrees(measured, expected):
    """Return whether a Monte Carlo value is within four standard errors, or float32 rounding, of the expected one."""
    value, error = measured
    return np.all(np.abs(value - np.multiply(expected, RADIANCE)) < 4 * error + 1e-5 * np.abs(value))


def flat(disk=False, **given):
    return scene.FlatLight(
        "/flat",
        RADIANCE,
        center=np.array([1.0, 2, 3]),
        half_x=0.7 * SIDE,
        half_y=0.4 * UP,
        axis=AXIS,
        disk=disk,
        **given,
    )


def sphere(radius=0.5, **given):
    return scene.SphereLight("/sphere", RADIANCE, center=np.array([1.0, 2, 3]), radius=radius, axis=AXIS, **given)


def cylinder(radius=0.3, length=2.0, **given):
    center = np.array([1.0, 2, 3])
    return scene.CylinderLight(
        "/tube", RADIANCE, center=center, half=0.5 * length * UP, radius=radius, axis=AXIS, **given
    )


def box(**given):
    """Return a mesh light: a box of edges 1, 2 and 3 around (1, 2, 3), faces wound outward."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([corner for a, b, c, d in quads for corner in ([a, b, c], [a, c, d])])
    mesh = scene.Mesh("/box", np.array([1.0, 2, 3]) + 0.5 * signs * [1, 2, 3], faces)
    return scene.MeshLight("/box", RADIANCE, mesh=mesh, **given)


def sheet(turn=1):
    """Return a mesh light that is the rectangle `flat()`, and shines from both sides; `turn` -1 winds it about."""
    corners = np.array([1.0, 2, 3]) + 0.7 * SIDE * [[-1], [1], [1], [-1]] + 0.4 * UP * [[-1], [-1], [1], [1]]
    mesh = scene.Mesh("/sheet", corners, np.array([[0, 1, 2], [0, 2, 3]])[:, ::turn])
    return scene.MeshLight("/sheet", RADIANCE, mesh=mesh, both_sides=True)


def test_irradiance_of_a_point_is_intensity_over_squared_distance(square):
    source = lamp_of(sphere(radius=0.0))
    assert agrees(irradiance(source, [1, 2, 0], [0, 0, 1], square), 1 / 9)
    assert agrees(irradiance(source, [1, 2, 0], [0, 0.6, 0.8], square), 0.8 / 9)


def test_irradiance_of_a_sphere_is_that_of_its_disc(square):
    source = lamp_of(sphere(radius=0.5))
    for distance in (0.6, 3.0, 1000.0):
        expected = np.pi * 0.5**2 / distance**2  # exact while the whole sphere is above the horizon
        assert agrees(irradiance(source, [1, 2, 3 - distance], [0, 0, 1], square), expected)


def corner_factor(x, y):
    """Return the form factor of a rectangle from a point under its corner, with sides in units of the distance."""
    a, b = np.hypot(1, x), np.hypot(1, y)
    return (x / a * np.arctan(y / a) + y / b * np.arctan(x / b)) / (2 * np.pi)


@pytest.mark.parametrize("distance", [0.3, 2.0])
def test_irradiance_of_a_rectangle_is_its_form_factor(square, distance):
    source = lamp_of(flat())
    center = np.array([1.0, 2, 3])
    middle = 4 * corner_factor(0.7 / distance, 0.4 / distance)
    corner = corner_factor(1.4 / distance, 0.8 / distance)
    assert agrees(irradiance(source, center + distance * AXIS, -AXIS, square), np.pi * middle)
    at_corner = center + distance * AXIS + 0.7 * SIDE + 0.4 * UP
    assert agrees(irradiance(source, at_corner, -AXIS, square), np.pi * corner)
    for side in (1, -1):
        both = lamp_of(sheet(side))
        assert agrees(irradiance(both, center + distance * side * AXIS, -side * AXIS, square), np.pi * middle)


def test_irradiance_of_a_disk_follows_its_closed_form(square):
    light = scene.FlatLight("/d", RADIANCE, half_x=0.7 * SIDE, half_y=0.7 * UP, axis=AXIS, disk=True)
    source = lamp_of(light)
    expected = np.pi * 0.7**2 / (0.7**2 + 1.1**2)
    assert agrees(irradiance(source, 1.1 * AXIS, -AXIS, square), expected)


def test_a_flat_light_is_dark_from_behind(square):
    value, _ = irradiance(lamp_of(flat()), np.array([1.0, 2, 3]) - AXIS, AXIS, square)
    assert np.array_equal(value, [0, 0, 0])


@pytest.mark.parametrize("angle", [0.0, 0.53, 40.0])
def test_irradiance_of_a_distant_light_is_its_projected_solid_angle(square, angle):
    source = lamp_of(scene.DistantLight("/sun", RADIANCE, axis=AXIS, angle=angle))
    expected = np.pi * np.sin(np.radians(angle / 2)) ** 2 if angle else 1.0
    assert agrees(irradiance(source, [5, 6, 7], -AXIS, square), expected)


def test_irradiance_of_an_even_dome_is_pi_times_its_radiance(square):
    assert agrees(irradiance(lamp_of(scene.DomeLight("/dome", RADIANCE)), [0, 0, 0], UP, square), np.pi)


@pytest.mark.parametrize(
    "light",
    [
        sphere(),
        sphere(shaping=scene.Shaping(70, 0.5, 2.0)),
        flat(),
        flat(disk=True),
        cylinder(),
        box(),
        sheet(),
        sphere(shape=STRETCHED),
        cylinder(shape=STRETCHED),
        scene.DistantLight("/sun", RADIANCE, axis=AXIS, angle=10.0),
        scene.DomeLight("/dome", RADIANCE, image=np.random.default_rng(3).random((8, 16, 3)).astype(np.float32)),
    ],
    ids=["sphere", "spot", "rect", "disk", "cylinder", "mesh", "sheet", "ellipsoid", "elliptic", "distant", "dome"],
)
def test_a_ray_sees_what_the_light_sample_carries(square, light):
    source = lamp_of(light)
    point = vector(np.array([1.0, 2, 3]) + 2.5 * AXIS + 0.3 * UP) + dr.zeros(Float, POINTS)
    sample = source.illuminate(point, square)
    sight = source.see(point, sample.direction)
    lit = sample.weight.numpy().max(axis=0) > 0  # not from the back of a mesh
    hit = sight.hit.numpy() & lit & (sight.pdf.numpy() > 0)
    assert hit.sum() > 0.99 * lit.sum() > 0  # rounding loses a few at the rim
    pdf, carried = sight.pdf.numpy()[hit], sample.weight.numpy()[:, hit]
    # Near a sphere's rim, and over the steps between an image's pixels, rounding of the direction is amplified.
    assert np.median(np.abs(pdf / sample.pdf.numpy()[hit] - 1)) < 1e-5
    error = np.abs(sight.radiance.numpy()[:, hit] / pdf - carried) / carried.max()
    assert np.quantile(error, 0.99) < 1e-4
    distance = sample.distance.numpy()[hit]
    if np.all(np.isfinite(distance)):
        assert np.quantile(np.abs(sight.distance.numpy()[hit] - distance), 0.99) < 1e-4


def test_rays_past_a_light_see_nothing(square):
    for light in (sphere(), flat(), flat(disk=True), cylinder(radius=0.5, length=1.0), box(surface=True)):
        source = lamp_of(light)
        start = np.array([1.0, 2, 3]) + 2 * AXIS
        for direction in (AXIS, np.array([0.0, 0.8, 0.0]) - 0.6 * AXIS):  # away from it; more than 0.7 to its side
            assert not dr.any(source.see(vector(start), vector(direction)).hit)
    corner = np.array([1.0, 2, 3]) + 2 * AXIS + 0.65 * SIDE + 0.35 * UP  # in the rectangle, not in the ellipse
    assert dr.all(lamp_of(flat()).see(vector(corner), vector(-AXIS)).hit)
    assert not dr.any(lamp_of(flat(disk=True)).see(vector(corner), vector(-AXIS)).hit)


def irradiance_of_tube(point, normal, radius, half, count=1000):
    """Return ∫ max(cos, 0) max(cos at the tube, 0) / d² over the side of a tube along Y: midpoint rule, float64."""
    phi = 2 * np.pi * (np.arange(count) + 0.5) / count
    y = half * (2 * (np.arange(count) + 0.5) / count - 1)[:, None]
    out = np.stack([np.cos(phi), 0 * phi, np.sin(phi)], axis=-1)
    to = radius * out[None] + y[..., None] * UP - point
    squared = np.sum(to * to, axis=-1)
    leaving, arriving = -np.einsum("ijk,jk->ij", to, out), to @ normal
    value = np.maximum(leaving, 0) * np.maximum(arriving, 0) / squared**2
    return value.sum() * 4 * np.pi * radius * half / count**2


@pytest.mark.parametrize(
    ("place", "normal"),
    [((1.2, 0.4, 0), (-1, 0, 0)), ((0.35, 0, 0), (-1, 0, 0)), ((0.5, 1.7, 0.2), (-0.6, -0.8, 0)),
     ((-3, -2, 1), (0.6, 0.8, 0))],
    ids=["beside", "close", "beyond its end", "far"],
)  # fmt: skip
def test_irradiance_of_a_cylinder_is_the_integral_over_its_mantle(square, place, normal):
    value = irradiance(lamp_of(cylinder()), np.array([1.0, 2, 3]) + place, normal, square)
    expected = irradiance_of_tube(np.array(place), np.array(normal), 0.3, 1.0)
    assert np.all(np.abs(value[0] - np.multiply(expected, RADIANCE)) < 4 * value[1] + 1e-3 * value[0])


def test_a_short_cylinder_far_away_has_the_intensity_of_its_silhouette(square):
    sine = 0.8
    away = np.array([sine, 0.6, 0.0])
    expected = 2 * 0.3 * 2.0 * sine / 400**2
    assert agrees(irradiance(lamp_of(cylinder()), np.array([1.0, 2, 3]) + 400 * away, -away, square), expected)


def test_a_cylinder_is_dark_from_within_and_beyond_its_open_ends(square):
    value, _ = irradiance(lamp_of(cylinder()), [1.1, 2 + 1.5, 3], -UP, square)
    assert np.array_equal(value, [0, 0, 0])


def irradiance_of_stretched(linear, round_part, point, normal, count=300):
    """Return ∫ cos cos / d² over a unit sphere or cylinder under a linear map: Gauss and midpoint rules, float64."""
    x, weights = np.polynomial.legendre.leggauss(count)
    phi = 2 * np.pi * (np.arange(count) + 0.5) / count
    bulge = np.sqrt(1 - x * x) if round_part == "sphere" else np.ones(count)
    places = np.stack(
        np.broadcast_arrays(x[:, None], bulge[:, None] * np.cos(phi), bulge[:, None] * np.sin(phi)), axis=-1
    )
    normals = places * ([1, 1, 1] if round_part == "sphere" else [0, 1, 1])
    to = places @ linear.T - point
    distance = np.linalg.norm(to, axis=-1)
    element = normals @ np.linalg.inv(linear) * abs(np.linalg.det(linear))  # the area's vector
    leaving, arriving = -np.sum(to * element, axis=-1) / distance, to @ normal / distance
    value = np.maximum(leaving, 0) * np.maximum(arriving, 0) / distance**2
    return (value * weights[:, None]).sum() * 2 * np.pi / count


@pytest.mark.parametrize("draw", range(6))
def test_irradiance_of_a_stretched_light_is_the_integral_over_its_surface(square, draw):
    rng = np.random.default_rng(draw)
    kind = ("sphere", "cylinder")[draw % 2]
    left, _, right = np.linalg.svd(rng.normal(size=(3, 3)))
    sizes = 10 ** rng.uniform(-1, 0.3, 3) * 10 ** rng.uniform(-2, 2)
    linear = (left * sizes) @ right
    away = rng.normal(size=3)
    away *= rng.uniform(2, 6) * sizes.max() / np.linalg.norm(away)
    normal = -away / np.linalg.norm(away)
    center = 10 * sizes.max() * rng.normal(size=3)
    light = sphere(1.0, shape=linear) if kind == "sphere" else cylinder(1.0, shape=linear)
    source = lamp_of(dataclasses.replace(light, center=center))
    expected = irradiance_of_stretched(linear, kind, away, normal)
    assert irradiance(source, center + away, normal, square)[0] == pytest.approx(
        np.multiply(expected, RADIANCE), rel=1e-4
    )


def test_irradiance_of_a_mesh_is_that_of_the_faces_that_are_seen(square):
    expected = 4 * np.pi * corner_factor(0.5 / 0.7, 1.0 / 0.7)  # the face toward +Z, of 1 by 2, at a distance of 0.7
    assert agrees(irradiance(lamp_of(box()), [1, 2, 3 + 1.5 + 0.7], [0, 0, -1], square), expected)


def factor(shaping, degrees):
    return ShapingFactor.of(shaping).factor(Float(np.cos(np.radians(np.atleast_1d(degrees))))).numpy()


def test_spot_cone_falls_from_its_soft_start_to_its_edge():
    soft = scene.Shaping(cone_angle=40.0, cone_softness=0.5)
    assert np.allclose(factor(soft, [0, 19.9, 30, 40.1, 90, 180])[0], [1, 1, 0.5, 0, 0, 0], atol=1e-3)
    # Above 1, the edge begins beyond the axis: hdEmbree's formula, 1 − smoothstep(θ, −30°, 30°).
    wide = scene.Shaping(cone_angle=30.0, cone_softness=2.0)
    assert np.allclose(
        factor(wide, [0, 7.5, 15, 22.5, 29, 31])[0], [0.5, 0.31641, 0.15625, 0.04297, 0.00082, 0], atol=2e-5
    )
    hard = scene.Shaping(cone_angle=40.0)
    assert np.array_equal(factor(hard, [0, 39.99, 40.01, 120])[0], [1, 1, 0, 0])
    assert np.array_equal(factor(None, [0, 90, 180])[0], [1, 1, 1])


def test_shaping_is_hdembrees_formula(rng):
    for _ in range(20):
        cone, softness, focus = (
            rng.uniform(1, 200),
            rng.choice([0.0, rng.uniform(0, 3)]),
            rng.choice([0.0, rng.uniform(0, 9)]),
        )
        tint, theta = rng.uniform(0, 1, 3), rng.uniform(0, 180, 50)
        theta = theta[np.abs(theta - cone) > 1e-2]  # a hard edge lies between two float32 angles
        start = cone * (1 - softness)
        x = np.clip((theta - start) / max(cone - start, 1e-9), 0, 1)
        power = np.abs(np.cos(np.radians(theta))) ** focus
        expected = (tint[:, None] * (1 - power) + power) * (1 - x * x * (3 - 2 * x))
        shaping = scene.Shaping(cone, softness, focus, tuple(tint))
        assert np.allclose(factor(shaping, theta), expected, atol=2e-4)


def test_focus_is_a_power_of_the_cosine_and_its_tint_what_remains():
    focused = scene.Shaping(cone_angle=180.0, focus=3.0)
    # UsdLuxShapingAPI takes the absolute cosine: without a cone, light leaves the back of a sphere as well.
    assert np.allclose(factor(focused, [0, 60, 120])[0], [1, 0.125, 0.125], atol=1e-6)
    tinted = scene.Shaping(cone_angle=180.0, focus=3.0, focus_tint=(0.2, 0.4, 1.0))
    assert np.allclose(factor(tinted, 60)[:, 0], [0.2 * 0.875 + 0.125, 0.4 * 0.875 + 0.125, 1], atol=1e-6)


def test_packed_lights_are_the_lights():
    given = [sphere(radius, shaping=scene.Shaping(30.0 + radius)) for radius in (0.0, 0.5, 1.0)]
    packed = pack([lamp_of(light) for light in given])
    taken = dr.gather(SphereLamp, packed, UInt32([2, 1]))
    assert np.allclose(taken.radius.numpy(), [1.0, 0.5])
    assert np.allclose(taken.center.numpy()[:, 0], [1, 2, 3])
    assert np.allclose(taken.shaping.cutoff.numpy(), np.radians([31.0, 30.5]))


TURN = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize("turn", [np.eye(3), TURN], ids=["upright", "turned"])
@pytest.mark.parametrize(("row", "column"), [(2, 3), (13, 3), (5, 20), (8, 16), (8, 0), (8, 31)])
def test_a_bright_pixel_shines_from_its_place_in_the_latlong_image(square, turn, row, column):
    height, width = 16, 32
    image = np.zeros((height, width, 3), dtype=np.float32)
    image[row, column] = 1
    # hdEmbree, OpenUSD's reference, has s = 1 − fract(atan2(x, z) / 2π + ½) and t = acos(y) / π (UsdLuxDomeLight):
    # longitude runs from +π at the left edge to −π at the right one, and +Y is up.
    longitude, latitude = np.pi * (1 - 2 * (column + 0.5) / width), np.pi * (0.5 - (row + 0.5) / height)
    local = [np.sin(longitude) * np.cos(latitude), np.sin(latitude), np.cos(longitude) * np.cos(latitude)]
    direction = turn @ local
    source = lamp_of(scene.DomeLight("/dome", RADIANCE, image=image, to_world=turn))
    seen = source.see(vector([0, 0, 0]), vector(direction)).radiance.numpy()[:, 0]
    assert np.all(seen > 0.5 * np.array(RADIANCE))  # interpolated between rows that are half a pixel off at most
    assert np.allclose(source.see(vector([0, 0, 0]), vector(-direction)).radiance.numpy(), 0)
    sample = source.illuminate(dr.zeros(Array3f, POINTS), square)
    assert (dr.dot(sample.direction, vector(direction)).numpy() > np.cos(2 * np.pi / height)).all()
