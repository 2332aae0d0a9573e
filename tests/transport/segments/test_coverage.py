"""Kernels of photons and beams keep their light: light beside a surface or outside of a medium goes to the rest."""

import drjit as dr
import numpy as np
import pytest

from photonbeams.numerics.arrays import to_vectors
from photonbeams.render.scene_frame import begin
from photonbeams.runtime.device import Bool, Float, UInt32, mitsuba
from photonbeams.transport.segments.coverage import medium_coverage, surface_coverage
from photonbeams.transport.segments.records import Segments
from photonbeams.transport.tuning import FREE_PATHS
from photonbeams.world.plugin import world_of_plugin
from tests.helpers.mitsuba_scenes import T, by_beams, camera, cube_of, fog, load, rgb

mi = mitsuba()

COUNT = 2000  # kernels, each turned by a different angle: their mean coverage is known to 0.002


def below(x):
    """Return the fraction of Epanechnikov's kernel that lies before a line, x radii beyond the centre."""
    t = np.linspace(-1, x, 4001)
    return np.trapezoid(8 / (3 * np.pi) * (1 - t * t) ** 1.5, t)


def world(**parts):
    return world_of_plugin(load(**parts, sensor=camera()), None)


@pytest.mark.parametrize("edge", [2.0, 0.8, 0.3])
def test_the_part_of_a_disc_on_a_square_is_known(edge):
    """The fraction of a photon's disc on a square is known to half of a twelfth, the area of one of its points.

    The disc has the radius 0.2, and is `edge` radii from the square's edge.
    """
    place = to_vectors(np.tile([1 - 0.2 * edge, 0.1, 0], (COUNT, 1)))
    square = world(square={"type": "rectangle"})
    up = to_vectors(np.tile([0.0, 0, 1], (COUNT, 1)))
    radius, covered = surface_coverage(square, place, up, dr.full(Float, 0.2, COUNT))
    kept = radius.numpy() == np.float32(0.2)
    assert kept.mean() > 0.9  # few discs have too little coverage
    assert covered.numpy()[kept].mean() == pytest.approx(below(min(edge, 1)), abs=1 / 24)


def test_discs_are_narrowed_to_small_surfaces():
    """A disc ten times as wide as its square, which has few of its points, becomes about as wide as the square."""
    small = world(square={"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(0.02)})
    up = to_vectors(np.tile([0.0, 0, 1], (COUNT, 1)))
    radius, covered = surface_coverage(small, 0 * up, up, dr.full(Float, 0.2, COUNT))
    assert np.all(radius.numpy() <= 0.05)
    assert np.all(covered.numpy() >= 0.3)


def test_a_wall_ends_a_disc():
    """A wall that stands on the floor ends a photon's disc, although the floor goes on behind the wall."""
    wall = mi.ScalarTransform4f().rotate([0, 1, 0], 90)
    room = world(floor={"type": "rectangle"}, wall={"type": "rectangle", "to_world": wall})
    place, up = (to_vectors(np.tile(each, (COUNT, 1))) for each in ([0.06, 0.0, 0], [0.0, 0, 1]))
    radius, covered = surface_coverage(room, place, up, dr.full(Float, 0.2, COUNT))
    kept = radius.numpy() == np.float32(0.2)
    assert covered.numpy()[kept].mean() == pytest.approx(below(0.3), abs=1 / 24)


@pytest.mark.parametrize("gap, beside", [(0.02, 0.1), (0.0, 0.5)])
def test_a_boundary_of_fog_before_a_surface_does_not_count_as_surface(gap, beside):
    """A fog's box leaves the covered fractions of discs as they are without fog.

    The box is on the floor, or 0.02 before the floor and a wall. A disc of radius 0.2 is looked for from 0.05 above the
    floor. Were points of the boundary taken for the floor's, they would be 0.02 farther from the photon, and the
    fraction less by 2 (0.02 / 0.2)² = 0.02. Half a radius from the wall, which they would not see, it would be more.
    """
    turned = mi.ScalarTransform4f().rotate([0, 1, 0], 90)
    walls = {"floor": {"type": "rectangle"}, "wall": {"type": "rectangle", "to_world": turned}}
    box = cube_of(fog(0.5))
    box["to_world"] = mi.ScalarTransform4f().translate([0.5 + gap, 0, 0.5 + gap]).scale(0.5)
    place, up = (to_vectors(np.tile(each, (COUNT, 1))) for each in ([beside, 0.0, 0], [0.0, 0, 1]))
    bare, filled = (surface_coverage(each, place, up, dr.full(Float, 0.2, COUNT))
                    for each in (world(**walls), world(**walls, fog=box)))  # fmt: skip
    for without, within in zip(bare, filled, strict=True):
        same = np.isclose(within.numpy(), without.numpy(), rtol=1e-4)
        assert same.mean() > 0.998  # a point may lie on the wall, up to rounding


@pytest.mark.parametrize("direction, height, expected", [
    ((1, 0, 0), 0.5, 1),  # along the boundary, 2.5 radii from it
    ((1, 0, 0), 0.94, below(0.3)),
    ((0.6, 0, 0.8), 0.0, 1),  # across it, at a slant of 37 degrees: its two sides compensate each other
])  # fmt: skip
def test_the_part_of_a_beam_in_a_cube_is_known(direction, height, expected):
    """The covered fraction is known for beams of radius 0.2 that begin in a cube, along its face z = 1 or toward it."""
    box = world(fog=cube_of(fog(0.5)), light={"type": "point", "position": [0, 0, 5]})
    segments = Segments()
    segments.origin, segments.direction = (
        to_vectors(np.tile(np.float64(each), (COUNT, 1))) for each in ((-0.5, 0, height), direction)
    )
    segments.length = dr.full(Float, (1 - height) / direction[2] if direction[2] else 1.0, COUNT)
    segments.medium = dr.opaque(UInt32, box.media.all[0].number, COUNT)
    segments.index = dr.arange(UInt32, COUNT)
    segments.key, segments.depth = dr.zeros(UInt32, COUNT), dr.zeros(UInt32, COUNT)
    reach = 0.2 * 0.75 if direction[2] else 0.0

    def shape(factor):
        return 0.2 * factor, 0.2 * factor, 0 * factor, reach * factor, -segments.direction

    factor, covered, shift = medium_coverage(box, segments, shape, dr.opaque(Float, 0.5), Bool(True))
    kept = (factor.numpy() == 1) & (dr.squared_norm(shift).numpy() == 0)
    assert kept.mean() > 0.6  # others are reflected
    # Neither what stays nor what is reflected has more than three times its flux, or it would be a bright streak.
    assert covered.numpy().min() > 0.3 - 1e-6
    # A line stands for an eighth. Beams that fade lack more light before their end than is behind it, by σ times 0.15.
    assert covered.numpy()[kept].mean() == pytest.approx(expected, abs=1 / 16)


def test_wide_beams_lose_no_light_at_the_boundary_of_a_ball():
    """The light that a ball scatters once from beams a fifth as wide as the ball is the integral over its chords.

    The chords are 2c long, and c has the density 2c. The ball scatters the fraction 1 − 2 (1 − (1 + a) exp(−a)) / a² of
    a flux of 4π², where a = 2 σt.
    """
    ball = {"type": "sphere", "bsdf": {"type": "null"}, "interior": fog(1.0, 1.0)}
    scene = load(ball=ball, sky={"type": "constant", "radiance": rgb(1.0)}, sensor=camera())
    settings = by_beams(max_depth=2, max_radius=0.2, guiding=False)
    light = begin(scene, scene.sensors()[0], settings).light
    sets, *_ = light.simulation.simulated([light.world], 0)
    found = sum(scattered(each.beams, 1.0, np.random.default_rng(0)) for each in sets)
    a = 2.0
    # 5,500 of 16,384 stratified paths meet the ball, which gives the sum to 0.1 %. Eight lines give the fraction of a
    # beam at the boundary to about 0.06, and the mean of its inverse is too high by the square of that: 0.3 %.
    assert found == pytest.approx(4 * np.pi**2 * (1 - 2 * (1 - (1 + a) * np.exp(-a)) / a**2), rel=0.005)


def test_beams_in_a_grid_keep_their_light_and_are_as_fine_as_the_grid_is_dense():
    """In a uniform grid of σt = 2, beams scatter the light of the integral, and have radii of at most FREE_PATHS / σt.

    Beams in a grid end where light is scattered, and do not fade. The standard deviation of the light of such a path is
    its mean, so 44,000 paths give the sum to 0.5 %.
    """
    even = mi.VolumeGrid(np.ones((2, 2, 2, 1), dtype=np.float32))
    smoke = {"type": "heterogeneous", "albedo": 1.0, "scale": 2.0, "sigma_t": {
        "type": "gridvolume", "grid": even, "raw": True, "to_world": T().translate(-1).scale(2)}}  # fmt: skip
    ball = {"type": "sphere", "bsdf": {"type": "null"}, "interior": smoke}
    scene = load(ball=ball, sky={"type": "constant", "radiance": rgb(1.0)}, sensor=camera())

    def beams(**given):
        settings = by_beams(max_depth=2, guiding=False, beams=1 << 17, **given)
        light = begin(scene, scene.sensors()[0], settings).light
        return light.simulation.simulated([light.world], 0)[0]

    found = sum(scattered(each.beams, 2.0, np.random.default_rng(0), fades=0) for each in beams(max_radius=0.2))
    a = 4.0
    assert found == pytest.approx(4 * np.pi**2 * (1 - 2 * (1 - (1 + a) * np.exp(-a)) / a**2), rel=0.015)
    widest = max(float(dr.max(each.beams.radius_start)[0]) for each in beams(min_radius=1.0))
    assert widest == pytest.approx(FREE_PATHS / 2.0, rel=1e-5)


def scattered(beams, extinction, rng, points=64, fades=1):
    """Return the light that beams scatter inside of the unit ball, estimated at random points in each beam."""
    start, end, power = (np.array(each, dtype=np.float64).T for each in (beams.start, beams.end, beams.power))
    radii = np.array(beams.radius_start), np.array(beams.radius_end)
    length = np.linalg.norm(end - start, axis=1)
    axis = (end - start) / length[:, None]
    across = np.cross(axis, np.where(np.abs(axis[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]]))
    across /= np.linalg.norm(across, axis=1)[:, None]
    total = np.zeros(len(length))
    for part in (np.arange(points) + 0.5) / points:
        at = radii[0] + (radii[1] - radii[0]) * part
        rho = np.sqrt(1 - np.sqrt(1 - rng.random(len(at))))
        angle = 2 * np.pi * rng.random(len(at))
        aside = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * np.cross(axis, across)
        point = start + part * (end - start) + (at * rho)[:, None] * aside
        inside = np.sum(point**2, axis=1) < 1
        total += inside * extinction * length / points * np.exp(-fades * extinction * part * length)
    return float(np.sum(total * power[:, 0]))
