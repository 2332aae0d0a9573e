"""The estimators for arbitrary rays, against float64 twins, closed forms, and each other."""

import inspect

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams.estimators import estimate
from photonbeams.runtime.device import Array3f
from tests.estimators.random_beams import (
    CONVERGED,
    EPSILON32,
    LOOKS,
    MEDIUM,
    RAMP,
    as_float32,
    beams_of,
    beside_the_twin,
    pixel_directions,
    radiance,
    random_beam,
    random_rays,
    smooth_part,
)
from tests.helpers import beam_twin as twin
from tests.helpers.beam_twin import Beam


@pytest.mark.parametrize("name", LOOKS)
def test_billboard_equals_its_twin_on_random_beams_and_rays(name, rng):
    look, double = LOOKS[name]
    for _ in range(12):
        beam = random_beam(rng)
        origin, direction = random_rays(rng, beam, 200)
        # For rays closer to the axis' direction the billboard is singular, and `auto` does not use it.
        keep = np.linalg.norm(np.cross(direction, beam.axis), axis=1) > 0.1
        origin, direction = origin[keep], direction[keep]
        t_min = as_float32(rng.uniform(0.01, 0.3, len(origin)))
        t_max = as_float32(t_min + rng.uniform(0.5, 4, len(origin)))
        expected = twin.billboard(beam, double, origin, direction, t_min, t_max)
        found = radiance(beam, origin, direction, look, "billboard", t_min=t_min, t_max=t_max)
        # Positions of up to 4 units are rounded to EPSILON32, and the closest approach divides that by sin² ≥ 0.01.
        places = smooth_part(beam, double, origin, direction, t_min, t_max, expected, 4 * EPSILON32 / 0.01)
        # Some 30 roundings, and a profile in a table of 1024 entries, whose error is 1024⁻² of its curvature.
        assert np.all(np.abs(found - expected) <= 2 * places + (30 * EPSILON32 + 2e-5) * expected.max() + 1e-12)
        assert np.count_nonzero(expected[:, 0]) > 10


@pytest.mark.parametrize("name", LOOKS)
def test_frustum_equals_its_twin_on_random_beams_and_rays(name, rng):
    look, double = LOOKS[name]
    for _ in range(12):
        beam = random_beam(rng)
        origin, direction = random_rays(rng, beam, 200)
        t_min = as_float32(rng.uniform(0.0, 0.3, len(origin)))
        t_max = as_float32(t_min + rng.uniform(0.5, 4, len(origin)))
        expected = twin.frustum(beam, double, origin, direction, t_min, t_max)
        found = radiance(beam, origin, direction, look, "frustum", t_min=t_min, t_max=t_max)
        # A chord's ends are accurate to a few EPSILON32 of 4 units; chords and radii are 0.02 and more. At a pointed
        # end the kernel grows as 1/R², so the tolerance is relative to the largest value.
        assert np.abs(found - expected).max() <= 40 * EPSILON32 * 4 / 0.02 * expected.max()
        assert np.count_nonzero(expected[:, 0]) > 50


# -- Closed forms ----------------------------------------------------------------------------------------------------


def cylinder_integral(origin, direction, radius, length, extinction):
    """Return ∫ exp(−σt (t + s(t))) dt over the ray's part in a cylinder along z, in closed form."""
    c = direction[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        a = np.sum(direction[:, :2] ** 2, axis=1)
        b = np.sum(origin[:, :2] * direction[:, :2], axis=1)
        root = np.sqrt(b * b - a * (np.sum(origin[:, :2] ** 2, axis=1) - radius**2))
        walls = np.where(a > 0, [(-b - root) / a, (-b + root) / a], [[-np.inf], [np.inf]])
        ends = np.sort([-origin[:, 2] / c, (length - origin[:, 2]) / c], axis=0)
    low, high = np.maximum(0, np.maximum(walls[0], ends[0])), np.minimum(walls[1], ends[1])
    rate = extinction * (1 + c)
    chord = np.where(rate < 1e-9, high - low, -np.expm1(-rate * (high - low)) / np.where(rate < 1e-9, 1, rate))
    return np.exp(-extinction * (low + origin[:, 2] + c * low)) * chord


def test_frustum_equals_the_closed_form_in_a_cylinder_of_constant_profile():
    # Rays from inside, at all angles from along the axis to against it; at c = −1 the formula is a limit.
    angles = np.concatenate([np.linspace(0, np.pi, 181), [np.pi - 1e-3, np.pi - 1e-5]])
    direction = np.stack([np.sin(angles), np.zeros_like(angles), np.cos(angles)], axis=1)
    direction[angles == np.pi] = (0, 0, -1)
    radius, length = 0.25, 2.0
    medium = pb.Medium((0.5, 1.0, 2.0))
    look = pb.Look(across=pb.looks.Uniform(), angle=1.0)
    beam = Beam((0, 0, 0), (0, 0, length), radius, radius)
    for at in ((0.0, 0.0, 0.5), (0.125, 0.0625, 1.5), (-0.2, 0.0, 1.0)):
        origin = np.broadcast_to(at, direction.shape)
        parts = [cylinder_integral(origin, direction, radius, length, e) for e in medium.extinction]
        expected = np.stack(parts, axis=1) / (np.pi * radius**2)
        found = radiance(beam, at, direction, look, "frustum", medium=medium)
        # At the wall the chord's end errs by the direction's rounding over sin θ, against a length of 2.
        np.testing.assert_allclose(found, expected, rtol=3e-5)


def test_six_points_are_enough_in_that_cylinder():
    angles = np.linspace(0, np.pi, 91)
    direction = np.stack([np.sin(angles), np.zeros_like(angles), np.cos(angles)], axis=1)
    origin = np.broadcast_to((0.0, 0.0, 0.5), direction.shape)
    medium, look = pb.Medium((1.0, 1.0, 1.0)), pb.Look(across=pb.looks.Uniform(), angle=1.0)
    expected = cylinder_integral(origin, direction, 0.25, 2.0, 1.0) / (np.pi * 0.25**2)
    found = radiance(
        Beam((0, 0, 0), (0, 0, 2), 0.25, 0.25),
        origin,
        direction,
        look,
        "frustum",
        medium=medium,
        rule=pb.gauss_legendre(6),
    )
    # σt (1 + cos θ)(b − a) is at most 3: six points err by 1.5^12 · 2^13 (6!)^4 / (13 (12!)^3) < 1e-9 of it.
    np.testing.assert_allclose(found[:, 0], expected, rtol=3e-5)


# -- Where the camera is ----------------------------------------------------------------------------------------------

#: A cone from (−1, 0.25, 0.5), along (2, 1, −0.5), with radii 0.1 and 0.3.
CONE = Beam(np.array([-1.0, 0.25, 0.5]), np.array([1.0, 1.25, 0.0]), 0.1, 0.3, power=(1.0, 0.5, 2.0))
SIDE = np.cross(CONE.axis, (0.0, 1.0, 0.0))
SIDE /= np.linalg.norm(SIDE)


def at(along, across):
    """Return a point at a fraction of CONE's length; its distance from the axis is in units of the radius there."""
    s = along * CONE.length
    return as_float32(CONE.start + s * CONE.axis + across * CONE.radius(s) * SIDE)


CAMERAS = {
    "beside": at(0.5, 6.0),
    "near": at(0.5, 1.5),
    "at the edge": at(0.5, 1.0),
    "just inside": at(0.5, 0.99),
    "inside": at(0.4, 0.5),
    "on the axis": at(0.6, 0.0),
    "at the start": at(0.0, 0.3),
    "at the end": at(1.0, 0.3),
    "on the axis at the end": at(1.0, 0.0),
    "behind": at(-0.3, 0.1),
    "before": at(1.4, 0.1),
}


def directions_all_around(count=1000):
    """Return directions spread over the sphere, and directions along CONE's axis and near it, both ways."""
    z = 1 - 2 * (np.arange(count) + 0.5) / count
    turn = np.pi * (1 + 5**0.5) * np.arange(count)
    sphere = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1)
    tilt = np.concatenate([[0], np.logspace(-7, -0.5, 60)])[:, None]
    along = CONE.axis + tilt * SIDE
    directions = np.concatenate([sphere, along, -along])
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.mark.parametrize("camera", CAMERAS)
def test_the_camera_may_be_anywhere(camera):
    look, double = LOOKS["physical"]
    directions = directions_all_around()
    expected = twin.frustum(CONE, double, CAMERAS[camera], directions)
    converged = radiance(CONE, CAMERAS[camera], directions, look, "frustum")
    # As for random rays. The chord's length has an infinite slope at a tangent, but the profile is zero there.
    assert np.abs(converged - expected).max() <= 40 * EPSILON32 * 4 / 0.1 * expected.max()
    # The blend may err by 0.5 % over the picture (issue 2), and by at most ten times that in any direction.
    blend = radiance(CONE, CAMERAS[camera], directions, look, "auto", rule=pb.gauss_legendre(6))
    assert np.linalg.norm(blend - expected) <= 0.005 * np.linalg.norm(expected)
    assert np.abs(blend - expected).max() <= 0.05 * expected.max()
    assert expected.max() > 0


@pytest.mark.parametrize("estimator", ["billboard", "frustum", "auto"])
@pytest.mark.parametrize("taper", [0.0, 0.1])
def test_looking_along_the_axis_is_finite(estimator, taper, rng):
    # Rounded cosines exceed 1 here; with constant factors, nothing but the angle hands the ray to the frustum.
    axes = rng.normal(size=(16, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    look = pb.Look(along=1.0, eye=1.0, angle=1.0)
    for axis in axes:
        origin = axis * rng.uniform(-2, 2, (60, 1)) + rng.normal(size=(60, 3)) * 0.02
        direction = np.where(np.arange(60)[:, None] % 2, axis, -axis)
        found = radiance(Beam(0 * axis, axis, 0.1, 0.1 + taper), origin, direction, look, estimator)
        assert np.all(np.isfinite(found)) and np.all(found >= 0)
        if estimator == "auto":
            np.testing.assert_array_equal(
                found, radiance(Beam(0 * axis, axis, 0.1, 0.1 + taper), origin, direction, look, "frustum")
            )


# -- Looks of all kinds -----------------------------------------------------------------------------------------------

COLOURS = [[1.0, 0.1, 0.0], [0.0, 1.0, 0.2], [0.1, 0.0, 1.0], [1.0, 1.0, 1.0]]
BLENDED = {
    "physical": pb.Look(),
    "constant with a hard rim": pb.Look(across=pb.looks.Uniform(), along=1.0, eye=1.0, angle=1.0),
    "ramp": pb.Look(along=pb.looks.ColorRamp(*RAMP) * pb.looks.Attenuation(), across=pb.looks.Smoothstep()),
    "many colours": pb.Look(along=pb.looks.ColorRamp([0, 0.3, 0.6, 1], COLOURS), across=pb.looks.Gaussian()),
    "hollow, hundredfold falloff": pb.Look(across=[0, 1, 0.2, 0], along=pb.looks.Power(2, 0.3)),
    "waves in space": pb.Look(along=lambda s, P: 1 + 0.8 * dr.sin(8 * P.x + 5 * P.y) * s, across=pb.looks.Biweight()),
    "colours by radius": pb.Look(across=pb.looks.ColorRamp([0, 0.5, 1], COLOURS[:3], space="radius")),
    "eye and angle": pb.Look(
        along=1.0,
        eye=pb.looks.ColorRamp([0, 0.3, 1], COLOURS[:3], "smooth", 0, 6, "distance"),
        angle=pb.looks.ColorRamp([0, 0.4, 1], COLOURS[:3], "linear", 0, 180, "angle"),
    ),
    "noise and a hollow wall": pb.Look(across=pb.looks.Hollow(0.4, 0.6) * pb.looks.Noise(scale=0.8, octaves=3)),
    "torn noise, fading": pb.Look(
        along=pb.looks.Noise(scale=0.3, contrast=6) * pb.looks.Fade(0.5, 2.5), across=pb.looks.Biweight()
    ),
    "expression": pb.Look(along="smoothstep(0, 1, s) * (0.6 + 0.4 * noise(4 * P + time))", across="1 - r ** 4"),
    "expression of the radius and the place": pb.Look(across="smoothstep(1, 0.3 + 0.3 * snoise(2 * P), r)"),
    "exponential and glow": pb.Look(
        along=pb.looks.Exponential(0.3), eye=pb.looks.Exponential([0.5, 1, 2]), angle=pb.looks.Glow()
    ),
}


# -- The thin limit ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["physical", "uniform", "place, radius and view"])
def test_billboard_equals_frustum_in_the_thin_limit(name, rng):
    """The chord is symmetric about the closest approach, so the billboard's error is of second order in the radius."""
    look = LOOKS[name][0]
    medium = pb.Medium((2.0, 1.0, 0.5), 0.0, 0.3)
    radii, errors = np.array([0.1, 0.05, 0.025, 0.0125]), []
    place, turn = rng.uniform(0.3, 0.7, (800, 1)), rng.uniform(0.6, 2.5, 800)
    for radius in radii:
        beam = Beam((0, 0, 0), (0, 0, 2), radius, 1.5 * radius)
        direction = np.stack([np.sin(turn), np.zeros_like(turn), np.cos(turn)], axis=1)
        passing = np.stack([np.zeros(800), rng.uniform(-0.9, 0.9, 800) * radius, 2 * place[:, 0]], axis=1)
        given = {"medium": medium, "look": look}
        thin = radiance(beam, passing - 2 * direction, direction, estimator="billboard", **given)
        thick = radiance(beam, passing - 2 * direction, direction, estimator="frustum", **given)
        errors.append(np.linalg.norm(thin - thick) / np.linalg.norm(thick))
    order = np.polyfit(np.log(radii), np.log(errors), 1)[0]
    assert order == pytest.approx(2, abs=0.25)
    assert errors[-1] < 1e-3


@pytest.mark.parametrize("name", BLENDED)
def test_every_looks_billboard_nears_the_frustum_as_beams_become_thin(name, rng):
    """The difference falls at least with first order: corners of looks and noise may prevent second order."""
    medium, errors = pb.Medium((2.0, 1.0, 0.5), 0.0, 0.3), []
    place, turn, aside = rng.uniform(0.3, 0.7, 800), rng.uniform(0.6, 2.5, 800), rng.uniform(-0.9, 0.9, 800)
    direction = np.stack([np.sin(turn), np.zeros(800), np.cos(turn)], axis=1)
    for radius in (0.04, 0.01, 0.0025):
        beam = Beam((0, 0, 0), (0, 0, 2), radius, 1.5 * radius)
        origin = np.stack([np.zeros(800), aside * radius, 2 * place], axis=1) - 2 * direction
        given = {"medium": medium, "look": BLENDED[name]}
        thin, thick = (radiance(beam, origin, direction, estimator=each, **given) for each in ("billboard", "frustum"))
        errors.append(np.linalg.norm(thin - thick) / np.linalg.norm(thick))
    # A tabulated profile with corners and its tabulated projection differ by half a thousandth for any radius.
    assert errors[1] < max(0.5 * errors[0], 5e-4) and errors[2] < max(0.5 * errors[1], 5e-4)
    assert errors[2] < 0.01


# -- Ends, caps and pieces of a path ----------------------------------------------------------------------------------


@pytest.mark.parametrize("estimator", ["billboard", "frustum"])
def test_a_beam_that_ends_on_a_slanted_surface_is_cut_by_its_plane(estimator, rng):
    for _ in range(4):
        beam = random_beam(rng)
        slant = -beam.axis + 0.6 * rng.normal(size=3)
        beam.end_normal = as_float32(slant / np.linalg.norm(slant) * np.sign(-slant @ beam.axis))
        found, expected, places = beside_the_twin(beam, "physical", estimator, rng)
        # The tolerance is that of beams without a cap, above.
        assert np.all(np.abs(found - expected) <= places + 40 * EPSILON32 * 4 / 0.02 * expected.max() + 1e-12)


@pytest.mark.parametrize("estimator", ["billboard", "frustum"])
def test_a_beam_is_cut_by_the_planes_at_its_start_and_beside_it(estimator, rng):
    for _ in range(4):
        beam = random_beam(rng)
        slant = beam.axis + 0.6 * rng.normal(size=3)
        beam.start_normal = as_float32(slant / np.linalg.norm(slant) * np.sign(slant @ beam.axis))
        across = np.cross(beam.axis, rng.normal(size=3))
        normal = across / np.linalg.norm(across) + 0.1 * rng.normal(size=3)
        normal = as_float32(normal / np.linalg.norm(normal))
        middle = 0.5 * np.add(beam.start, beam.end)
        beam.side = as_float32(middle - rng.uniform(-0.2, 0.8) * beam.radius_start * normal), normal
        found, expected, places = beside_the_twin(beam, "physical", estimator, rng)
        # The tolerance is that of beams without a cap, above.
        assert np.all(np.abs(found - expected) <= places + 40 * EPSILON32 * 4 / 0.02 * expected.max() + 1e-12)


@pytest.mark.parametrize("moving", [False, True])
def test_the_two_sides_of_a_plane_add_up_to_the_whole_beam(moving, rng):
    """What planes cut off is what the planes that face the other way leave; planes without a normal cut nothing."""
    beams = pb.Beams.join([beams_of(random_beam(rng)) for _ in range(30)])
    numbers = beams.arrays()
    normal, origin, direction = rng.normal(size=(30, 3)), rng.normal(size=(2000, 3)), rng.normal(size=(2000, 3))
    side = 0.5 * (numbers["start"] + numbers["end"])
    more = {"time": rng.random(2000)} if moving else {}

    def seen(*normals):
        total = 0
        for each in normals:
            own = pb.Beams(**numbers, side=side, side_normal=each, start_normal=0 * each)
            more["close"] = own if moving else None
            total += np.asarray(pb.estimate(own, origin, direction, medium=MEDIUM, estimator="frustum", **more))
        return total

    whole = np.asarray(pb.estimate(beams, origin, direction, medium=MEDIUM, estimator="frustum"))
    assert whole.any()
    # Each chord is cut in two, and each part is integrated with six points, as the whole is.
    assert np.allclose(seen(normal, -normal), whole, rtol=2e-3, atol=1e-4 * whole.max())
    # Beams that move are interpolated: near a rim, a chord grows with the root of the distance, and so does rounding.
    rounding = np.sqrt(EPSILON32) if moving else 1e-6
    assert np.allclose(seen(0 * normal), whole, rtol=1e-5, atol=rounding * whole.max())


def test_nothing_is_seen_behind_a_cap(rng):
    normal = np.array([-0.6, 0.8, 0.0])
    beam = Beam((-2, 0, 0), (0, 0, 0), 0.1, 0.2, end_normal=normal)
    behind = rng.normal(size=(500, 3)) * 0.1
    behind -= (behind @ normal + np.abs(rng.normal(size=500)) * 0.1 + 0.001)[:, None] * normal
    direction = np.cross(normal, rng.normal(size=(500, 3)))  # along the wall, on its far side
    for estimator in ("billboard", "frustum", "auto"):
        assert not radiance(beam, behind, direction, LOOKS["physical"][0], estimator).any()


@pytest.mark.parametrize("name", ["physical", "ramp"])
@pytest.mark.parametrize("estimator", ["billboard", "frustum"])
def test_offset_total_and_entry_equal_the_twin(name, estimator, rng):
    for _ in range(3):
        beam = random_beam(rng, offset=0.75, total=4.5, entry=float(rng.choice([0.5, 1.25])))
        found, expected, places = beside_the_twin(beam, name, estimator, rng)
        assert np.all(np.abs(found - expected) <= places + 40 * EPSILON32 * 4 / 0.02 * expected.max() + 1e-12)


@pytest.mark.parametrize("name", ["physical", "ramp"])
def test_a_beam_cut_in_two_equals_the_whole_one(name, rng):
    look = LOOKS[name][0]
    whole = random_beam(rng, offset=0.5, total=4.0, entry=0.75)
    cut = 0.375 * whole.length
    middle, radius = whole.start + cut * whole.axis, whole.radius(cut)
    parts = beams_of(
        Beam(whole.start, middle, whole.radius_start, radius, whole.power, 0.5, 4.0, 0.75),
        Beam(middle, whole.end, radius, whole.radius_end, whole.power, 0.5 + cut, 4.0, 0.75),
    )
    origin, direction = random_rays(rng, whole, 2000)
    expected = radiance(whole, origin, direction, look, "frustum")
    # Each half has its own chord: the rounding is as against the twin.
    found = radiance(parts, origin, direction, look, "frustum")
    assert np.abs(found - expected).max() <= 40 * EPSILON32 * 4 / 0.02 * expected.max()
    blend = radiance(parts, origin, direction, look, "auto", rule=pb.gauss_legendre(6))
    assert np.linalg.norm(blend - expected) <= 0.005 * np.linalg.norm(expected)


# -- The blend against the converged frustum --------------------------------------------------------------------------

#: Camera position and target; the beams begin near the origin and run along +x for 3 units.
VIEWS = {
    "beside": ((1.5, 0.1, 3.0), (1.5, 0, 0)),
    "close": ((1.5, 0.1, 0.8), (2.5, 0, 0)),
    "along": ((-3, 0.2, 0.1), (0, 0, 0)),
    "along the axis": ((-1, 0, 0), (1, 0, 0)),
    "inside": ((1.0, 0.02, 0.01), (3, 0, 0.3)),
    "inside, looking back": ((2.5, 0.1, 0.01), (0, 0, 0)),
    "border": ((1.5, 0.05, 0.35), (1.2, 0.2, -1)),
    "on the wall": ((1.5, 0.2, 0), (3, 0.3, 0)),
    "before the end": ((3.4, 0.1, 0), (0, 0, 0)),
}


def shaft(rng, count=60):
    start = rng.uniform(-0.1, 0.1, (count, 3))
    end = start + np.array([3, 0, 0]) + rng.uniform(-1, 1, (count, 3))
    return pb.Beams(start, end, 0.02, 0.1, [[1.0, 0.8, 0.5]])


@pytest.mark.parametrize("name", BLENDED)
def test_auto_equals_the_converged_frustum_to_half_a_percent(name, rng):
    """The relative RMSE of the picture is at most 0.5 % (issue 2)."""
    look = BLENDED[name]
    for beams in (shaft(rng), pb.Beams([[0, 0, 0]], [[3, 0, 0]], 0.1, 0.3, [[1.0, 0.8, 0.5]])):
        for view, (origin, target) in VIEWS.items():
            direction = pixel_directions(np.subtract(target, origin), 64, 36)
            converged = radiance(beams, origin, direction, look, "frustum")
            blend = radiance(beams, origin, direction, look, "auto", rule=pb.gauss_legendre(6))
            assert np.linalg.norm(blend - converged) <= 0.005 * np.linalg.norm(converged), view


@pytest.mark.parametrize("name", BLENDED)
@pytest.mark.parametrize("forward", [(0.3, -0.1, -1.0), (1.0, 0.05, -0.1), (-1.0, 0.05, -0.1)])
def test_auto_does_not_pop_on_a_path_through_a_wall_and_out_of_the_end(name, forward):
    """From frame to frame the picture changes by at most 1 % more than the converged picture (issue 2)."""
    beams = pb.Beams(
        [[0, 0, 0], [0, 0.3, 0.1], [-0.5, -0.4, 0.6]], [[2, 0, 0], [2, 0.5, 0.2], [1.5, 0.6, -0.5]],
        [0.2, 0.1, 0.05], [0.3, 0.1, 0.15], [[1.0, 0.8, 0.5]],
    )  # fmt: skip
    time = np.linspace(0, 1, 101)
    # The path crosses the wall of the first beam in the first half of the time, then runs inside and out of its end.
    path = np.stack([-0.5 + 2.4 * time + 1.2 * time**2, 0.05 * np.sin(6 * time), 0.9 * (1 - time) ** 2 - 0.02], axis=1)
    direction = pixel_directions(forward, 16, 9)
    origin = np.repeat(path, len(direction), axis=0)
    direction = np.tile(direction, (len(path), 1))
    pictures = [
        radiance(beams, origin, direction, BLENDED[name], estimator, rule=rule).reshape(len(path), -1)
        for estimator, rule in (("auto", pb.gauss_legendre(6)), ("frustum", CONVERGED))
    ]
    blend, converged = (np.linalg.norm(np.diff(picture, axis=0), axis=1) for picture in pictures)
    # On noise with hard edges, six points err by a thousandth or two of a picture.
    assert np.all(blend <= 1.01 * converged + 0.002 * np.linalg.norm(pictures[1][1:], axis=1))
    assert np.count_nonzero(converged) > 50


# -- Input of `estimate` ----------------------------------------------------------------------------------------------

ONE = Beam((0, 0, 0), (1, 0, 0), 0.1, 0.1)


def test_no_beams_give_no_light():
    beams = pb.Beams(np.zeros((0, 3)), np.zeros((0, 3)), 0.1, 0.1, np.zeros((0, 3)))
    found = radiance(beams, [[0, 0, 0]] * 5, (0, 0, 1), pb.Look(), "auto")
    assert found.shape == (5, 3) and not found.any()


def test_directions_need_not_be_of_unit_length_and_arrays_may_be_dr_jit():
    origin, direction = (0.5, 0.02, -1.0), np.array([0.1, 0.0, 1.0])
    expected = radiance(ONE, origin, direction, pb.Look(), "auto")
    np.testing.assert_allclose(radiance(ONE, origin, 7 * direction, pb.Look(), "auto"), expected, rtol=1e-5)
    found = radiance(ONE, Array3f(*origin), Array3f(*direction.tolist()), pb.Look(), "auto")
    np.testing.assert_allclose(found, [expected], rtol=1e-5)
    assert expected.shape == (3,) and expected.all()


@pytest.mark.parametrize("length", [2.0**-110, 2.0**-64, 2.0**64, 2.0**110])  # powers of 2 scale without rounding
def test_directions_have_any_length_above_0(length):
    origin, direction = (0.5, 0.02, -1.0), np.array([0.1, 0.0, 1.0])
    expected = radiance(ONE, origin, direction, pb.Look(), "auto")
    assert np.array_equal(radiance(ONE, origin, length * direction, pb.Look(), "auto"), expected)


def test_rays_have_any_leading_shape_and_are_broadcast(rng):
    origin = as_float32(rng.normal(size=(3, 4, 3)) * 0.05 + [0, 0, -1])
    direction, t_max = as_float32(rng.normal(size=(4, 3)) * 0.02 + [0, 0, 1]), np.array([[0.5], [1.5], [9.0]])
    given = {"look": pb.Look(), "medium": MEDIUM}
    found = pb.estimate(beams_of(ONE), origin, direction, t_max, **given)
    wide = (np.broadcast_to(direction, (3, 4, 3)).reshape(-1, 3), np.broadcast_to(t_max, (3, 4)).ravel())
    expected = pb.estimate(beams_of(ONE), origin.reshape(-1, 3), *wide, **given)
    assert found.shape == (3, 4, 3) and expected.shape == (12, 3)
    assert np.array_equal(np.asarray(found).reshape(-1, 3), expected.numpy()) and expected.numpy().any()
    tensor = type(found)
    again = pb.estimate(beams_of(ONE), tensor(origin.astype(np.float32)), tensor(direction), t_max, **given)
    assert np.array_equal(again.numpy(), found.numpy())
    assert pb.estimate(beams_of(ONE), origin[0, 0], direction[0], **given).shape == (3,)
    assert pb.estimate(beams_of(ONE), origin[:0], direction, **given).shape == (0, 4, 3)


@pytest.mark.parametrize(
    "value", [3, "beams", None, [], [[1, 2], [3]], [None], 1j, float("nan"), pb.Look(), object(), np.ones((2, 2, 2))]
)
@pytest.mark.parametrize("name", inspect.signature(estimate).parameters)
def test_what_estimate_cannot_take_is_told_in_a_sentence(name, value):
    given = {"beams": beams_of(ONE), "origin": np.zeros((3, 3)), "direction": (0, 0, 1), "medium": MEDIUM}
    if name == "time":
        given["close"] = given["beams"]
    optional = value is None and name in ("t_max", "t_min", "look", "context", "close")
    if optional or (isinstance(value, int) and name in ("t_max", "t_min")) or (name == "look" and "Look" in str(value)):
        assert np.all(np.isfinite(pb.estimate(**(given | {name: value})).numpy()))
        return
    with pytest.raises(pb.SceneError) as error:
        pb.estimate(**(given | {name: value}))
    assert len(str(error.value)) <= 300 and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("message", "given"),
    [
        ("estimator is 'planes': expected one of auto, billboard, frustum", {"estimator": "planes"}),
        ("origin has shape", {"origin": [[0, 0]]}),
        ("direction has shape \\(\\): expected finite numbers", {"direction": 1}),
        ("have shapes .* expected shapes that broadcast", {"t_max": [1.0, 2.0, 3.0]}),
        ("t_min is nan: expected numbers", {"t_min": float("nan")}),
        ("a ray has no direction", {"direction": [[0, 0, 0]]}),
        ("direction is .*nan.*: expected finite numbers", {"direction": [[0, 0, float("nan")]]}),
        ("physical factor", {"medium": None}),
    ],
)
def test_bad_input_is_told_in_a_sentence(message, given):
    given = {"origin": np.zeros((2, 3)), "direction": (0, 0, 1), "medium": MEDIUM} | given
    with pytest.raises(ValueError, match=message):
        estimate(beams_of(ONE), given.pop("origin"), given.pop("direction"), **given)
