"""Light paths at their lights: their power, and the sums of strata, against float64 integrals and `illuminate`."""

import dataclasses

import drjit as dr
import numpy as np
import pytest

from photonbeams import scene
from photonbeams.numerics.sampling import sobol_block
from photonbeams.runtime.device import Array3f, Float
from photonbeams.scene.vectors import ellipsoid_area
from photonbeams.world.described import world_of_scene
from photonbeams.world.emitters.build import lamp_of
from photonbeams.world.emitters.portals import emit_through

RADIANCE = (3.0, 2.0, 1.0)
COUNT = 1 << 14
AXIS = np.array([0.0, 0.0, -1.0])


def portal(points, faces=((0, 1, 2), (0, 2, 3))):
    return scene.Mesh("/portal", np.array(points, dtype=np.float64), np.array(faces))


#: A tilted quadrilateral one and a half units in front of the lights.
QUAD = portal([[-0.5, -0.4, -1.5], [0.3, -0.4, -1.3], [0.3, 0.6, -1.3], [-0.5, 0.6, -1.5]])
#: A round hole over a flaring slot, as a fan of triangles: a keyhole.
ANGLES = np.linspace(-0.35 * np.pi, 1.35 * np.pi, 24)
OUTLINE = np.array(
    [[0.2 * np.cos(a), 0.2 + 0.2 * np.sin(a), -1.0] for a in ANGLES] + [[-0.25, -0.5, -1], [0.25, -0.5, -1]]
)
KEYHOLE = portal(
    np.concatenate([[[0.0, 0.1, -1.0]], OUTLINE]),
    [[0, 1 + i, 1 + (i + 1) % len(OUTLINE)] for i in range(len(OUTLINE))],
)
#: A bent sheet: not planar.
BENT = portal(
    [[-0.5, -0.4, -1.2], [0, -0.4, -1.0], [0.5, -0.4, -1.2], [-0.5, 0.4, -1.2], [0, 0.4, -1.0], [0.5, 0.4, -1.2]],
    [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]],
)


def flat(**given):
    return scene.FlatLight(
        "/light", RADIANCE, half_x=np.array([0.2, 0, 0]), half_y=np.array([0, 0.1, 0]), axis=AXIS, **given
    )


def sphere(radius=0.2, **given):
    return scene.SphereLight("/light", RADIANCE, radius=radius, axis=AXIS, **given)


def distant(angle=5.0, **given):
    return scene.DistantLight("/light", RADIANCE, axis=AXIS, angle=angle, **given)


def cylinder(**given):
    given = {"half": np.array([0.3, 0, 0.4])} | given
    return scene.CylinderLight("/light", RADIANCE, radius=0.1, axis=AXIS, **given)


def tetrahedron(**given):
    points = 0.2 * np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    mesh = scene.Mesh("/light", points, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))
    return scene.MeshLight("/light", RADIANCE, mesh=mesh, **given)


#: A stretched, turned, sheared and mirrored space.
STRETCHED = np.array([[0.3, 0.1, 0.0], [-0.05, 0.1, 0.02], [0.1, 0.05, -0.15]])


def ellipsoid(**given):
    return sphere(radius=0.2, shape=STRETCHED, **given)


def elliptic_cylinder(**given):
    return cylinder(shape=STRETCHED, **given)


def mantle(linear, count=2000):
    """Return the area of a cylinder of radius 1 along X, from -1 to 1, under a linear map: midpoint rule, float64."""
    turn = 2 * np.pi * (np.arange(count) + 0.5) / count
    along = np.stack([0 * turn, -np.sin(turn), np.cos(turn)], axis=-1) @ linear.T
    return 2 * np.linalg.norm(np.cross(linear[:, 0], along), axis=1).mean() * 2 * np.pi


def sheet(**given):
    """Return a rectangle that glows on both sides, 0.4 by 0.2 and facing up."""
    points = [[-0.2, -0.1, 0], [0.2, -0.1, 0], [0.2, 0.1, 0], [-0.2, 0.1, 0]]
    mesh = scene.Mesh("/light", np.array(points), np.array([[0, 1, 2], [0, 2, 3]]))
    return scene.MeshLight("/light", RADIANCE, mesh=mesh, both_sides=True, **given)


def world(light):
    """Return a world of one light, within a sphere of radius 4."""
    return world_of_scene(scene.Scene(lights=(light,)), viewpoints=[(-4, 0, 0), (4, 0, 0)])


def emission(light, count=COUNT, block=0):
    built = world(light)
    return built.emitters[0].lamp.emit(*sobol_block(count, block, (1,)), built.bounds), built


def through(light, count=COUNT):
    built = world(light)
    hole = built.emitters[0].portal
    return emit_through(built.emitters[0].lamp, hole, built.bounds, *sobol_block(count, 0, (2,))), built


def flux(paths, where=None):
    """Return the total flux of paths, (3,), and its standard error if they were independent."""
    value = paths.flux.numpy().astype(np.float64) * paths.valid.numpy() / dr.width(paths.origin)
    if where is not None:
        value = value * where
    count = value.shape[1]
    return value.sum(axis=1), np.sqrt(count) * value.std(axis=1)


SHAPED = scene.Shaping(cone_angle=35.0)
#: A profile that is brighter on one side: intensities at 0, 30 and 60 degrees from its axis, in four directions around.
LOPSIDED = scene.Shaping(
    180.0,
    profile=scene.Profile([0, 30, 60], [0, 90, 180, 270, 360], [[2, 5, 1], [2, 3, 0], [2, 1, 0], [2, 3, 0], [2, 5, 1]]),
)


@pytest.mark.parametrize(
    ("light", "power"),
    [
        (sphere(), 4 * np.pi**2 * 0.2**2),
        (sphere(shaping=SHAPED), 2 * np.pi**2 * 0.2**2 * (1 - np.cos(np.radians(35)))),
        (sphere(radius=0.0), 4 * np.pi),
        (sphere(radius=0.0, shaping=scene.Shaping(cone_angle=90.0, focus=3.0)), 2 * np.pi / 4),
        (cylinder(), np.pi * 2 * np.pi * 0.1 * 1.0),
        (tetrahedron(), np.pi * np.sqrt(3) * 0.2 * 0.2 * 8),
        (sheet(), 2 * np.pi * 0.08),
        (ellipsoid(), np.pi * ellipsoid_area(np.linalg.svd(STRETCHED, compute_uv=False))),
        (elliptic_cylinder(), np.pi * mantle(STRETCHED)),
        (flat(), np.pi * 0.08),
        (flat(disk=True), np.pi * 0.08 * np.pi / 4),
        (flat(shaping=SHAPED), np.pi * 0.08 * np.sin(np.radians(35)) ** 2),
        (flat(shaping=scene.Shaping(cone_angle=90.0, focus=3.0)), 2 * np.pi * 0.08 / 5),
        (distant(angle=0.0), np.pi * 4.004**2),
        (distant(), 2 * np.pi * (1 - np.cos(np.radians(2.5))) * np.pi * 4.004**2),
        (scene.DomeLight("/light", RADIANCE), 4 * np.pi * np.pi * 4.004**2),
    ],
)
def test_paths_carry_the_power_of_their_light(light, power):
    total, error = flux(emission(light)[0])
    # Every path has the same power here: what remains is float32 rounding, and the hard edge of the whole sphere's map.
    assert np.allclose(total, np.multiply(power, RADIANCE), rtol=2e-5, atol=4 * error.max())


def test_soft_cone_carries_the_integral_of_its_falloff():
    shaping = scene.Shaping(cone_angle=50.0, cone_softness=0.7)
    angle = np.radians(50) * (np.arange(20_000) + 0.5) / 20_000
    x = np.clip((angle - np.radians(15)) / np.radians(35), 0, 1)
    expected = (2 * np.pi * np.sin(angle) * (1 - x * x * (3 - 2 * x))).sum() * np.radians(50) / 20_000
    total, error = flux(emission(sphere(radius=0.0, shaping=shaping))[0])
    assert np.all(np.abs(total - np.multiply(expected, RADIANCE)) < 4 * error + 1e-5 * total)


def mean_of_profile(profile, flat=False, count=720):
    """Return ∫ profile dω, times the cosine for a flat light, by the midpoint rule in float64."""
    theta = np.pi * (np.arange(count) + 0.5) / count
    phi = 360 * (np.arange(count) + 0.5) / count
    value = profile.at(np.degrees(theta)[:, None], phi) * np.sin(theta)[:, None]
    return (value * (np.maximum(np.cos(theta), 0)[:, None] if flat else 1)).sum() * 2 * np.pi * np.pi / count**2


@pytest.mark.parametrize("scale", [0.0, 0.4, -0.6])
def test_paths_follow_a_profile_and_carry_its_integral(scale):
    profile = dataclasses.replace(LOPSIDED.profile, angle_scale=scale)
    shaping = dataclasses.replace(LOPSIDED, profile=profile)
    for light, flat_light in ((sphere(radius=0.0, shaping=shaping), False), (flat(shaping=shaping), True)):
        if flat_light and scale < 0:  # all its light goes up, behind the rectangle
            continue
        value = emission(light)[0].flux.numpy().astype(np.float64) / COUNT
        expected = mean_of_profile(profile, flat_light) * (0.08 if flat_light else 1)
        total, error = value.sum(axis=1), np.sqrt(COUNT) * value.std(axis=1)
        assert np.all(np.abs(total - np.multiply(expected, RADIANCE)) < error + 2e-3 * total)
        # Paths are distributed as the light is, so their power hardly differs.
        assert value[0].std() < 0.3 * value[0].mean()


def test_paths_begin_on_the_light():
    paths, _ = emission(sphere())
    assert np.allclose(np.linalg.norm(paths.origin.numpy(), axis=0), 0.2, atol=1e-6)
    assert dr.all(dr.dot(paths.origin, paths.direction) > -1e-6)  # outward
    paths, _ = emission(flat(shaping=SHAPED))
    x, y, z = paths.origin.numpy()
    assert np.abs(x).max() <= 0.2 and np.abs(y).max() <= 0.1 and np.abs(z).max() == 0
    assert paths.direction.numpy()[2].max() <= -np.cos(np.radians(35)) + 1e-6
    paths, built = emission(distant())
    assert np.linalg.norm(paths.origin.numpy(), axis=0).min() >= built.radius * (1 - 1e-5)  # outside of the bounds


def grid(low, high, count):
    return low + (np.arange(count) + 0.5) / count * (high - low)


def rectangle_to_quad(mesh, count=40):
    """Return ∫∫ cos cos / d² over the flat light and the portal's parallelogram, by the midpoint rule in float64."""
    corner, x, y = mesh.points[0], mesh.points[1] - mesh.points[0], mesh.points[3] - mesh.points[0]
    s, t = (axis.ravel() for axis in np.meshgrid(grid(0, 1, count), grid(0, 1, count)))
    points = corner + s[:, None] * x + t[:, None] * y
    normal = np.cross(x, y)
    total = 0.0
    for u in grid(-0.2, 0.2, count):
        for v in grid(-0.1, 0.1, count):
            to = points - [u, v, 0]
            total += np.sum(-to[:, 2] * np.abs(to @ normal) / np.sum(to * to, axis=1) ** 2)
    return total / count**4 * 0.08


def test_flux_through_a_portal_is_the_form_factor_integral():
    total, error = flux(through(flat(portal=QUAD))[0])
    expected = np.multiply(rectangle_to_quad(QUAD), RADIANCE)
    assert np.all(np.abs(total - expected) < error + 1e-4 * expected)  # stratified: better than one standard error


def solid_angle(mesh):
    """Return the solid angle of a mesh seen from the origin (Van Oosterom and Strackee 1983)."""
    a, b, c = (mesh.points[mesh.faces[:, corner]] for corner in range(3))
    la, lb, lc = (np.linalg.norm(p, axis=1) for p in (a, b, c))
    numerator = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a)))
    return np.abs(2 * np.arctan2(numerator, la * lb * lc + ab * lc + bc * la + ca * lb)).sum()


@pytest.mark.parametrize("mesh", [QUAD, KEYHOLE, BENT], ids=["quad", "keyhole", "bent"])
def test_flux_of_a_point_through_a_portal_is_its_solid_angle(mesh):
    paths, built = through(sphere(radius=0.0, portal=mesh))
    total, error = flux(paths)
    expected = np.multiply(solid_angle(mesh), RADIANCE)
    assert np.all(np.abs(total - expected) < 2 * error + 1e-4 * expected)
    assert (built.emitters[0].portal.sides is None) == (mesh is BENT)
    assert np.isclose(paths.valid.numpy().mean(), built.emitters[0].portal.fill, atol=0.01)


def test_keyhole_points_lie_in_its_tight_rectangle():
    hole = world(sphere(portal=KEYHOLE)).emitters[0].portal
    assert np.isclose(hole.area, np.prod(np.ptp(OUTLINE[:, :2], axis=0)), rtol=1e-6)
    assert 0.5 < hole.fill < 0.8


@pytest.mark.parametrize("light", [sphere, flat, distant], ids=["sphere", "flat", "distant"])
def test_paths_through_a_portal_and_the_others_make_the_light_without_one(light):
    inside, _ = through(light(portal=QUAD))
    others, built = emission(light(portal=QUAD), block=1)
    others.valid &= ~built.emitters[0].portal.crosses(others.origin, others.direction)
    whole, _ = emission(light(), block=2)

    def landing(paths):
        """Return which paths cross a square behind the portal, which light through the portal partly covers."""
        o, d = paths.origin.numpy(), paths.direction.numpy()
        t = (-2.5 - o[2]) / np.where(d[2] < 0, d[2], -1e-9)
        x, y = o[0] + t * d[0], o[1] + t * d[1]
        return (d[2] < 0) & (t > 0) & (np.abs(x - 0.6) < 0.7) & (np.abs(y - 0.3) < 0.5)

    parts = [flux(paths, landing(paths)) for paths in (inside, others, whole)]
    error = np.sqrt(sum(part[1] ** 2 for part in parts))
    assert np.all(parts[0][0] > 0) and np.all(parts[1][0] > 0)
    assert np.all(np.abs(parts[0][0] + parts[1][0] - parts[2][0]) < 4 * error)


@pytest.mark.parametrize(
    "light",
    [sphere(), sphere(radius=0.0, shaping=scene.Shaping(60, 0.5, 1.5)), flat(), flat(disk=True), cylinder(),
     tetrahedron(), sheet(), ellipsoid(), elliptic_cylinder(shaping=scene.Shaping(70, 0.5, 1.5)),
     sphere(radius=0.0, shaping=LOPSIDED), flat(shaping=LOPSIDED), distant(),
     scene.DomeLight("/light", RADIANCE, image=np.random.default_rng(1).random((8, 16, 3)))],
    ids=["sphere", "spot", "rect", "disk", "cylinder", "mesh", "sheet", "ellipsoid", "elliptic", "profile",
         "rect with profile", "distant", "dome"],
)  # fmt: skip
def test_beams_that_land_on_a_patch_carry_what_illuminate_says(light):
    paths, built = emission(light, count=1 << 16)
    half = 0.5
    o, d = paths.origin.numpy().astype(np.float64), paths.direction.numpy().astype(np.float64)
    t = (-1.5 - o[2]) / np.where(np.abs(d[2]) > 1e-9, d[2], 1e-9)
    landing = (t > 0) & (d[2] < 0) & (np.abs(o[0] + t * d[0]) < half) & (np.abs(o[1] + t * d[1]) < half)
    beams, beams_error = flux(paths, landing)
    u, v = sobol_block(COUNT, 0, (9,))
    point = Array3f(half * (2 * v.x - 1), half * (2 * v.y - 1), Float(-1.5))
    sample = built.emitters[0].lamp.illuminate(point, u)
    value = (sample.weight * dr.maximum(sample.direction.z, 0)).numpy().astype(np.float64) * (2 * half) ** 2
    error = np.hypot(beams_error, value.std(axis=1) / np.sqrt(COUNT))
    assert np.all(np.abs(beams - value.mean(axis=1)) < 4 * error)


def test_a_portal_of_no_area_is_refused():
    with pytest.raises(scene.SceneError, match="/portal: the portal has no area"):
        world(sphere(portal=portal([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]])))


def test_a_light_of_an_unknown_kind_is_refused():
    with pytest.raises(scene.SceneError, match="/light: a Light cannot be sampled"):
        lamp_of(scene.Light("/light", RADIANCE))
