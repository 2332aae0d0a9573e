"""Scattered light that is aimed at portals, and light that hits the edges of holes."""

import drjit as dr
import numpy as np
import pytest

from photonbeams.numerics.arrays import to_numpy
from photonbeams.numerics.sampling import pixel_sample
from photonbeams.runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from photonbeams.transport import light_tracer
from photonbeams.transport.aiming import Openings
from photonbeams.transport.emission import PathEmitter, Stratum
from photonbeams.transport.interactions import reflect
from photonbeams.transport.simulation import Simulation
from photonbeams.transport.strata import SURROUND, Allotment, with_surrounds
from photonbeams.transport.tuning import Tuning
from photonbeams.world.described import world_of_scene
from photonbeams.world.plugin import world_of_plugin
from photonbeams.world.warp import sphere
from tests.helpers.comparison import EYE, HOLE_X, HOLE_Y, HOLE_Z, comparison_scene
from tests.helpers.mitsuba_scenes import T, bumpy, load, rgb, tilted

mi = mitsuba()

COUNT = 1 << 16
CORNER, ACROSS, UP = np.array([1.0, -0.2, -0.1]), np.array([0.0, 0.4, 0.0]), np.array([0.0, 0.0, 0.3])
OPENINGS = Openings.from_sides([(CORNER, ACROSS, UP)])


def solid_angle(a, b, c):
    """Return the solid angle of a triangle from the origin (van Oosterom and Strackee 1983)."""
    a, b, c = (each / np.linalg.norm(each) for each in (a, b, c))
    return 2 * np.arctan2(abs(a @ np.cross(b, c)), 1 + a @ b + b @ c + c @ a)


def mean(values):
    """Return the mean of values, (K, N), and its standard error, (K,)."""
    return values.mean(axis=1), values.std(axis=1) / np.sqrt(values.shape[1])


@pytest.mark.parametrize("x", [0.0, 0.9, 2.0], ids=["before", "close by", "behind"])
def test_aimed_directions_are_even_over_the_sphere_with_their_ratio(x):
    lane = dr.arange(UInt32, COUNT)
    point = Array3f(x, 0.05, 0) + dr.zeros(Array3f, COUNT)
    aimed = OPENINGS.aimed(point, lane, UInt32(5))
    direction = dr.select(aimed.taken, aimed.direction, sphere(pixel_sample(lane, UInt32(3))))
    ratio = aimed.ratio(direction, Float(1 / (4 * dr.pi)), Bool(True))
    local = np.array([x, 0.05, 0])
    sides = [CORNER - local, CORNER + ACROSS - local, CORNER + ACROSS + UP - local, CORNER + UP - local]
    part = (solid_angle(*sides[:3]) + solid_angle(sides[0], *sides[2:])) / (4 * np.pi)
    d, weight = to_numpy(direction + dr.zeros(Array3f, COUNT)), to_numpy([ratio + dr.zeros(Float, COUNT)])[0]
    place = local[:, None] + ((1 - x) / d[0]) * d
    inside = ((1 - x) / d[0] > 0) & (abs(place[1]) < 0.2) & (place[2] > -0.1) & (place[2] < 0.2)
    found, error = mean(weight * np.stack([np.ones(COUNT), inside, d[1], d[2], d[0] ** 2]))
    assert np.all(abs(found - [1, part, 0, 0, 1 / 3]) < 4.5 * error + 1e-6)
    if x < 1:  # half of the directions meet the opening, of even ones a fraction `part`
        assert error[1] ** 2 * COUNT < 2 * part * part
        assert np.all(weight <= 2 + 1e-5)
    else:
        assert np.all(weight == 1)


BSDFS = {
    "diffuse": {"type": "diffuse", "reflectance": rgb(0.6)},
    "rough metal": {"type": "roughconductor", "alpha": 0.3},
    "plastic": {"type": "plastic", "diffuse_reflectance": rgb(0.4)},
    "principled": {"type": "principled", "roughness": 0.4, "metallic": 0.5, "specular": 0.5},
    "rough glass": {"type": "roughdielectric", "alpha": 0.3},
    "half a mask": {"type": "mask", "opacity": 0.5, "nested": {"type": "diffuse", "reflectance": rgb(0.8)}},
    "mirror": {"type": "conductor"},
    "tilted": tilted({"type": "diffuse", "reflectance": rgb(0.7)}),
    "bumpy": bumpy({"type": "roughconductor", "alpha": 0.4}),
}


@pytest.mark.parametrize("name", BSDFS)
def test_surfaces_reflect_as_much_light_to_all_sides_as_without_openings(name):
    bsdf = BSDFS[name] if "glass" in name else {"type": "twosided", "bsdf": BSDFS[name]}
    floor = {"type": "rectangle", "to_world": T().scale(2), "bsdf": BSDFS[name] if "mask" in name else bsdf}
    world = world_of_plugin(load(floor=floor, lamp={"type": "constant"}), None)
    lane = dr.arange(UInt32, COUNT)
    u = pixel_sample(lane, UInt32(9))
    origin = Array3f(u.x - 0.5, u.y - 0.5, 0) - 2 * Array3f(0.4, 0.1, -0.9)
    hit = world.intersect(origin, dr.normalize(Array3f(0.4, 0.1, -0.9)), Bool(True), lane)
    openings = Openings.from_sides([np.array([[0.8, -0.3, 0.2], [0, 0.5, 0], [0, 0, 0.5]])])
    results = []
    for seed, own in ((1, None), (2, openings)):
        stream = UInt32(seed)
        aimed = None if own is None else own.aimed(Array3f(hit.p), lane, stream)
        scatter = reflect(world, hit, Bool(True), UInt32(0), lane, stream, aimed)
        d, weight = to_numpy(scatter.direction), to_numpy(scatter.weight)[1]
        assert np.isfinite(weight).all()
        results.append(mean(weight * np.stack([np.ones(COUNT), d[0], d[1], abs(d[2]), d[2] > 0, d[0] > 0.5])))
    (one, error), (other, own_error) = results
    assert one[0] > 0.2
    assert np.all(abs(one - other) < 4.5 * np.hypot(error, own_error) + 1e-5)


def test_the_surround_of_a_portal_and_the_rest_are_the_light_beside_it():
    world = world_of_scene(comparison_scene(), viewpoints=[EYE])
    emitter = PathEmitter(world, 0).at(world.emitters[0].portal, False)
    beside = Stratum(emitter, 1 << 14, (1, 2))
    near, far = with_surrounds([beside])
    assert near.count == SURROUND * beside.count
    assert near.count + far.count == beside.count
    flux, place = [], []
    for each in (beside, near, far):
        emitted = each.emit(0)
        own, origin, direction = (to_numpy(part) for part in (emitted.flux, emitted.origin, emitted.direction))
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = origin + (HOLE_X - origin[0]) / direction[0] * direction
        flux.append(own[0] * (direction[0] > 0))
        place.append(crossing[1:])
    low, high = np.array([HOLE_Y, HOLE_Z], dtype=float).T
    size = high - low

    def within(points, wider):
        middle = points.T - 0.5 * (low + high)
        return np.all(abs(middle) < (0.5 + wider) * size, axis=1)

    # Near light passes the rectangle that is wider by 0.3 on each side, but not the hole; far light passes neither.
    assert within(place[1][:, flux[1] > 0], 0.3 + 1e-4).all()
    assert not within(place[1][:, flux[1] > 0], -1e-4).any()
    assert not within(place[2][:, flux[2] > 0], 0.3 - 1e-4).any()
    own = within(place[0], 0.3)
    expected, error = mean(flux[0][None] * own * beside.count)
    found, own_error = mean(flux[1][None] * near.count)
    assert abs(expected - found)[0] < 4 * np.hypot(error, own_error)[0]


def test_as_much_scattered_light_gets_into_the_room_and_more_evenly(monkeypatch):
    world = world_of_scene(comparison_scene(), viewpoints=[EYE])
    tuning = Tuning(3, 2, alpha=1.0)
    passes = 48

    def light():
        """Return the mean light of scattered beams on the camera's side of the wall, over passes, and its error."""
        result = []
        for number in range(passes):
            sets, *_ = Simulation(tuning, Allotment(512, past={"/light"})).simulated([world], number)
            total = 0.0
            for each in sets:
                start, end = (to_numpy(getattr(each.beams, name)) for name in ("start", "end"))
                power, depth = to_numpy(each.beams.power)[0], np.asarray(each.beams.generation.numpy())
                inside = np.clip(np.stack([start[0], end[0]]) - HOLE_X, 0, None)
                part = abs(inside[1] - inside[0]) / np.maximum(abs(end[0] - start[0]), 1e-9)
                length = part * np.linalg.norm(end - start, axis=0)
                total += float((power * length)[depth > 0].sum())
            result.append(total)
        return mean(np.array([result]))

    with_openings, error = light()
    monkeypatch.setattr(light_tracer.Openings, "of", lambda *_: None)
    monkeypatch.setattr(light_tracer, "with_surrounds", lambda strata: strata)
    without, own_error = light()
    assert abs(with_openings - without)[0] < 4 * np.hypot(error, own_error)[0]
    assert error[0] < own_error[0]


@pytest.mark.parametrize("swapped", [False, True])
def test_openings_face_the_way_that_light_takes(swapped):
    world = world_of_scene(comparison_scene(), viewpoints=[EYE])
    portal = world.emitters[0].portal
    if swapped:
        corner, across, up = portal.sides
        portal.sides = corner, up, across
    stratum = Stratum(PathEmitter(world, 0).at(portal, True), 256, (1,))
    openings = Openings.of([stratum], [stratum.emit(0)])
    across, up = (each.numpy()[:, 0] for each in (openings.packed.across, openings.packed.up))
    assert np.cross(across, up)[0] > 0  # from the lamp, along x
    assert int(openings.count[0]) == 1
    aside = Stratum(PathEmitter(world, 0).at(portal, False), 256, (1,))
    assert Openings.of([aside], [aside.emit(0)]) is None
