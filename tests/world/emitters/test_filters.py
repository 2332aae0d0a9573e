"""Filters of lights against the distance to their shapes, in NumPy, and as they cut beams."""

import dataclasses

import drjit as dr
import numpy as np
import pytest

from photonbeams import scene
from photonbeams.numerics.arrays import to_float, to_vectors
from photonbeams.runtime.device import UInt32
from photonbeams.world.described import world_of_scene
from photonbeams.world.emitters.filters import FilterChain, filter_of
from tests.helpers.comparison import box
from tests.helpers.tracing import trace

TURN = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
FRAME = np.block([[TURN * [1.2, 0.8, 1.0], np.array([[0.3], [-0.2], [0.1]])], [np.zeros((1, 3)), np.ones((1, 1))]])
SHAPES = {
    "sphere": ((0, 0, 0), 0.6, False),
    "capsule": ((0, 0.8, 0), 0.3, False),
    "box": ((0.5, 0.7, 0.2), 0.0, False),
    "round": ((0.5, 0.3, 0.2), 0.3, False),
    "plane": ((0.6, 0.8, 0), 0.0, True),
    "window": ((0.6, 0.3, 0), 0.3, True),
}
COLOR = (0.5, 0.25, 0.0)


def shape(kind, **settings):
    half, radius, flat = SHAPES[kind]
    return scene.Blocker("/f", np.array(half, float), radius, frame=FRAME, flat=flat, color=COLOR, **settings)


def left(described, lamp, point, infinite=False, seed=1, soft=True):
    """Return what a filter leaves, (N, 3), of light from lamps at points."""
    toward = lamp - point
    distance = np.linalg.norm(toward, axis=1)
    found = FilterChain((filter_of(described),), infinite).factor(
        to_vectors(point), to_vectors(toward / distance[:, None]), to_float(distance),
        dr.arange(UInt32, len(point)) + UInt32(seed), soft,
    )  # fmt: skip
    return (found + dr.zeros(type(found), len(point))).numpy().T


def outside(described, point):
    """Return the distance of points from the box of a shape, beyond its radius, in the filter's space."""
    inverse = np.linalg.inv(described.frame)
    local = point @ inverse[:3, :3].T + inverse[:3, 3]
    if described.flat:
        local = local * [1, 1, 0]
    return np.linalg.norm(np.maximum(np.abs(local) - described.half, 0), axis=-1) - described.radius


def lines(rng, count=4000):
    lamp, way = rng.uniform(-2, 2, (count, 3)), rng.normal(size=(count, 3))
    return lamp, lamp + way / np.linalg.norm(way, axis=1, keepdims=True) * rng.uniform(1, 3, (count, 1))


def near(away, tolerance):
    """Return which distances may be of either side of a shape's surface; within a sharp box they are 0."""
    return (away != 0) & (np.abs(away) < tolerance)


def agrees(found, acts, unsure):
    """Require the filter's colour where it acts, and 1 elsewhere, but for lines that graze the shape."""
    expected = np.where(acts[:, None], COLOR, 1.0)
    assert 5 < acts.sum() < len(acts) - 5
    assert unsure.mean() < 0.2
    assert np.array_equal(found[~unsure], expected[~unsure].astype(np.float32))


@pytest.mark.parametrize("kind", SHAPES)
def test_light_is_filtered_behind_a_shape_in_it_or_all_along(rng, kind):
    lamp, point = lines(rng)
    parts = np.linspace(0, 1, 601)
    described = shape(kind)
    flat = described.flat
    inverse = np.linalg.inv(FRAME)
    heights = [(each @ inverse[:3, :3].T + inverse[:3, 3])[:, 2] for each in (lamp, point)]
    if flat:
        place = heights[0] / (heights[0] - heights[1])  # where the whole line crosses the plane, from lamp to point
        away = outside(described, lamp + place[:, None] * (point - lamp))
        crosses, ahead = (place > 0) & (place < 1), place > 0
        unsure = np.abs(away) < 2e-3
        met, any_met = crosses & (away <= 0), ahead & (away <= 0)
    else:
        away = np.min([outside(described, lamp + each * (point - lamp)) for each in parts], axis=0)
        beyond = np.min([outside(described, lamp + each * (point - lamp)) for each in 8 * parts], axis=0)
        unsure = (np.abs(away) < 8e-3) | (np.abs(beyond) < 0.03)
        met, any_met = away <= 0, beyond <= 0
        agrees(left(shape(kind, where="inside"), lamp, point), outside(described, point) <= 0, unsure)
        agrees(left(shape(kind, where="inside", invert=True), lamp, point), outside(described, point) > 0, unsure)
    agrees(left(described, lamp, point), met, unsure)
    agrees(left(shape(kind, where="along"), lamp, point), any_met, unsure)
    agrees(left(shape(kind, where="along", invert=True), lamp, point), ~any_met, unsure)
    if flat:
        agrees(left(shape(kind, invert=True), lamp, point), crosses & (away > 0), unsure)
        # A lamp at infinity is behind everything: what counts is the line from the point on.
        agrees(left(described, lamp, point, infinite=True), (place < 1) & (away <= 0), unsure)


@pytest.mark.parametrize("settings", [{"flat": True}, {"where": "inside"}, {}], ids=["flat", "inside", "behind"])
def test_the_mean_of_the_random_edges_is_the_smooth_one(rng, settings):
    """A point behind the middle of a shape's side, x beside it; a line that passes it there."""
    described = scene.Blocker("/f", np.array([0.5, 0.5, 0]), edge=0.4, **settings)
    x = 0.5 + 0.4 * np.repeat([0.1, 0.35, 0.5, 0.8], 4096)
    point = np.stack([x, 0 * x, 0 * x + (0.0 if settings.get("where") else -1)], axis=1)
    lamp = point + np.array([0, 0, 2])
    hard = 1 - left(described, lamp, point, soft=False)[:, 0].reshape(4, -1).mean(axis=1)
    t = (x.reshape(4, -1)[:, 0] - 0.5) / 0.4
    expected = 1 - t * t * (3 - 2 * t)
    assert np.all(np.abs(hard - expected) < 4 * np.sqrt(expected * (1 - expected) / 4096))
    if settings:
        soft = 1 - left(described, lamp, point)[::4096, 0]
        assert np.allclose(soft, expected, atol=1e-5)


def test_a_ramp_is_linear_between_its_knots_and_has_steps(rng):
    lamp, point = lines(rng)
    ramp = scene.DistanceRamp("/r", [0.5, 1.5, 1.5, 2.5], [[1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 2, 2]])
    distance = np.linalg.norm(lamp - point, axis=1)
    knots = ramp.knots + np.array([0, 0, 1e-9, 0])
    expected = np.stack([np.interp(distance, knots, each) for each in ramp.colors.T], axis=1)
    assert np.allclose(left(ramp, lamp, point), expected, atol=2e-5)


@pytest.mark.parametrize("settings", [
    {"half": [0.5, -0.1, 0]}, {"half": [0.5, 0.5]}, {"edge": -1}, {"radius": np.nan}, {"color": -1}, {"where": "above"},
    {"flat": True, "where": "inside"}, {"frame": np.zeros((4, 4))},
])  # fmt: skip
def test_blockers_without_sense_are_errors(settings):
    with pytest.raises(scene.SceneError, match=r"/f: .* expected"):
        scene.Blocker("/f", **settings)


@pytest.mark.parametrize("knots, colors", [
    ([], []), ([1, 0], [1, 0]), ([0, 1], [1]), ([0, 1], [1, -1]), ([0, np.inf], [1, 0]), ([[0]], [[1]]),
])  # fmt: skip
def test_ramps_without_sense_are_errors(knots, colors):
    with pytest.raises(scene.SceneError, match=r"/r: .* expected"):
        scene.DistanceRamp("/r", knots, colors)


LAMP = scene.SphereLight("/lamp", (1.0, 1.0, 1.0), radius=0.1)
ROOM, FLAG = box("/room", [-3, -3, -3], [3, 3, 3]), box("/flag", [-0.5, -0.5, 0.9], [0.5, 0.5, 1.1])


def beams_of(*filters, meshes=(ROOM,), **more):
    lamp = dataclasses.replace(LAMP, filters=filters)
    sets = trace(world_of_scene(scene.Scene(lights=(lamp,), meshes=meshes)), beams_per_light=2048, **more)
    return sets[0].beams.arrays()


def test_beams_end_at_a_blocker_as_at_a_mesh_in_its_place():
    place = np.eye(4)
    place[2, 3] = 1
    flag = scene.Blocker("/flag", np.array([0.5, 0.5, 0.1]), frame=place)
    blocked, stopped = beams_of(flag), beams_of(meshes=(ROOM, FLAG))
    ends = []
    for beams in (blocked, stopped):
        at_flag = np.abs(beams["end"][:, 2] - 0.9) < 1e-4
        ends.append(beams["end"][at_flag][np.argsort(beams["id"][at_flag])])
    assert len(ends[0]) > 50
    assert np.allclose(*ends, atol=1e-4)
    assert np.abs(ends[0][:, :2]).max() < 0.5


def test_beams_are_cut_where_a_rod_and_a_ramp_change_them():
    rod = scene.Blocker("/rod", np.zeros(3), 1.0, color=0.25, where="inside", frame=np.eye(4))
    beams = beams_of(rod)
    begins = np.linalg.norm(beams["start"], axis=1)
    within = begins < 0.9
    beyond = np.abs(begins - 1) < 1e-4  # where the parts within the sphere end
    assert within.sum() == beyond.sum() == 2048
    assert np.allclose(beams["power"][within].sum(), 0.25 * beams["power"][beyond].sum(), rtol=1e-5)
    ramp = beams_of(scene.DistanceRamp("/ramp", [1, 2], [1, 0]))
    middle = (ramp["offset"] > 0.9) & (ramp["offset"] < 1.1)
    assert np.all(ramp["offset"] < 1.1)  # what is beyond 2 is dark
    assert np.allclose(ramp["power_end"][middle], 0, atol=1e-3 * ramp["power"].max())
    assert np.allclose(ramp["power_end"][~middle], ramp["power"][~middle])
