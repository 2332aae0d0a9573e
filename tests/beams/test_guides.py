"""Beams along guide curves: a guide bends the space around it, and a straight guide changes nothing."""

from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams import scene
from photonbeams.beams.guides import Guide, led, pieces_along
from photonbeams.beams.modify import bend
from photonbeams.beams.programs import PassContext
from photonbeams.scene import SceneError
from photonbeams.world.described import world_of_scene
from tests.helpers.kernels import compiled
from tests.helpers.tracing import trace

QUARTER = np.linspace(0, np.pi / 2, 200)
#: A quarter of a circle of radius 2 about (0, 2, 0): from the origin along +x to (2, 2, 0) along +y.
BOW = 2 * np.stack([np.sin(QUARTER), 1 - np.cos(QUARTER), 0 * QUARTER], axis=1)


def bundle(rng, count=200, length=5.0):
    """Return parallel beams along +x that begin one unit before the guide."""
    beside = rng.uniform(-0.3, 0.3, (count, 2))
    start = np.column_stack([np.full(count, -1.0), beside])
    return pb.Beams(start, start + np.array([length, 0, 0]), 0.02, 0.04, [[1, 0.5, 0.25]])


def test_a_parallel_bundle_becomes_a_bent_tube(rng):
    beams = bundle(rng)
    found = led(beams, [Guide.through(BOW)]).arrays()
    steps = pieces_along([Guide.through(BOW)]) + 2
    assert len(found["start"]) == steps * 200
    side, up = beams.arrays()["start"].T[1:]
    nodes = found["end"].reshape(200, steps, 3)
    bent = nodes[:, 1:-1]  # at the ends of the pieces beside the guide
    # Each path is as far from the guide's circle as the straight path was from the x axis.
    assert np.allclose(np.hypot(bent[..., 0], bent[..., 1] - 2), (2 - side)[:, None], atol=1e-3)
    assert np.allclose(bent[..., 2], up[:, None], atol=1e-5)
    assert np.allclose(nodes[:, 0, 0], 0, atol=1e-5)  # straight until the guide begins
    # Beyond the guide's end each path runs along +y for the length that is left: 5 − 1 − π.
    assert np.allclose(nodes[:, -1] - nodes[:, -2], [0, 4 - np.pi, 0], atol=1e-3)
    assert np.allclose(nodes[:, -1, 0], 2 - side, atol=1e-3)


def test_a_guide_turns_a_bundle_about_itself_no_more_than_it_must(rng):
    """Along a space curve the guide's frame is parallel-transported: it does not rotate about the tangent."""
    turn = np.linspace(0, 3, 400)
    helix = np.stack([np.cos(turn), np.sin(turn), 0.5 * turn], axis=1)
    guide = Guide.through(helix)
    rate = np.diff(guide.sides, axis=0) / (guide.length / 511)
    beside = np.cross(guide.tangents, guide.sides)[:-1]
    # The derivative of one side has no component along the other side; in the Frenet frame that component is the
    # torsion, 0.4. What is left is of the order of a row's length, 1/150.
    assert np.abs(np.sum(rate * beside, axis=1)).max() < 1 / 150
    assert np.allclose(np.sum(guide.sides * guide.tangents, axis=1), 0, atol=1e-12)
    assert np.allclose(guide.turn, np.degrees(3 / np.hypot(1, 0.5)), rtol=0.01)


def test_a_straight_guide_changes_nothing(rng):
    beams = bundle(rng, 40)
    line = np.linspace(0, 1, 5)[:, None] * [3.0, 0, 0]
    bent = led(beams, [Guide.through(line)])
    for points in (bent.start, bent.end):
        beside = beams.arrays()["start"][:, 1:].repeat(3, axis=0)
        assert np.allclose(points.numpy().T[:, 1:], beside, atol=1e-6)
    origin, direction = rng.uniform(-1, 3, (400, 3)), rng.normal(size=(400, 3))
    given = {"medium": pb.Medium((0.1, 0.2, 0.3)), "estimator": "frustum"}
    expected, found = (np.array(pb.estimate(each, origin, direction, **given)) for each in (beams, bent))
    assert np.linalg.norm(found - expected) <= 1e-4 * np.linalg.norm(expected)


def test_falloffs_run_along_the_bent_path(rng):
    beams = bundle(rng)
    found = led(beams, [Guide.through(BOW)]).arrays()
    steps = len(found["start"]) // 200
    shape = (200, steps)
    offset, total = (found[name].reshape(shape) for name in ("offset", "total"))
    length = np.linalg.norm(found["end"] - found["start"], axis=1).reshape(shape)
    assert np.allclose(offset[:, 0], 0) and np.allclose(offset[:, 1:], (offset + length)[:, :-1], atol=1e-5)
    # On the inside of the bend the path is shorter, by the turning angle times the distance from the guide.
    side = beams.arrays()["start"][:, 1]
    assert np.allclose(total[:, 0], 5 - side * np.pi / 2, atol=5e-3)
    assert np.allclose(total, (offset + length)[:, -1:], atol=1e-5)
    assert np.allclose(found["power"], [1, 0.5, 0.25])
    assert np.all(np.diff(found["radius_start"].reshape(shape), axis=1) > 0)
    assert np.array_equal(found["start"].reshape(200, steps, 3)[:, 1:], found["end"].reshape(200, steps, 3)[:, :-1])


def test_both_parts_of_a_path_that_was_cut_are_led_as_one(rng):
    whole = bundle(rng, 20).arrays()
    cut = np.concatenate([np.full((20, 1), 2.5), whole["start"][:, 1:]], axis=1)
    first = pb.Beams(whole["start"], cut, 0.02, 0.03, [[1, 1, 1]], offset=np.zeros(20), total=np.full(20, 5.0))
    second = pb.Beams(cut, whole["end"], 0.03, 0.04, [[1, 1, 1]], offset=np.full(20, 3.5), total=np.full(20, 5.0))
    one, other = (led(each, [Guide.through(BOW)]).arrays() for each in (first, second))
    steps = len(one["start"]) // 20
    last = {name: one[name].reshape(20, steps, -1)[:, -1] for name in one}
    begin = {name: other[name].reshape(20, steps, -1)[:, 0] for name in other}
    # The cut at x = 2.5 lies before the guide's end at x = π: the second part begins where the first part ends.
    assert np.allclose(last["end"], begin["start"], atol=1e-5)
    assert np.allclose(last["end_tangent"], begin["start_tangent"], atol=1e-5)
    length = np.linalg.norm(last["end"] - last["start"], axis=1, keepdims=True)
    assert np.allclose(last["offset"] + length, begin["offset"], atol=1e-5)


def test_beams_beside_the_guide_alone_have_pieces_of_no_light_elsewhere(rng):
    short = pb.Beams([[0.5, 0, 0]], [[1.5, 0, 0]], 0.02, 0.02, [[1, 1, 1]])
    found = led(short, [Guide.through(BOW)]).arrays()
    assert not found["power"][0].any() and not found["power"][-1].any() and np.all(found["power"][1:-1] == 1)
    look = pb.Look(along=1.0, eye=1.0, angle=1.0)
    for estimator in ("billboard", "frustum", "auto"):
        seen = np.array(pb.estimate(led(short, [Guide.through(BOW)]), [[1, 0, 5.0]], [[0, 0.05, -1]], look=look,
                                    estimator=estimator))  # fmt: skip
        assert np.all(np.isfinite(seen))


def test_each_path_follows_the_guide_that_begins_nearest_to_it():
    far = BOW * [1, -1, 1] + [0, 10.0, 0]
    beams = pb.Beams([[0, 0, 0], [0, 10, 0]], [[4, 0, 0], [4, 10, 0]], 0.02, 0.02, [[1, 1, 1]])
    found = led(beams, [Guide.through(BOW), Guide.through(far)]).arrays()["end"].reshape(2, -1, 3)[:, -1]
    rest = 4 - np.pi
    assert np.allclose(found, [[2, 2 + rest, 0], [2, 8 - rest, 0]], atol=1e-3)


def test_guides_are_given_in_python_too(rng):
    beams = bundle(rng, 5)
    found, expected = bend([BOW])(beams, PassContext()).arrays(), led(beams, [Guide.through(BOW)]).arrays()
    assert all(np.array_equal(found[name], expected[name]) for name in expected)


LAMP = scene.DistantLight("/sun", (1.0, 1.0, 1.0), axis=np.array([1.0, 0, 0]), angle=0.0)


def world_of(light):
    return world_of_scene(scene.Scene(lights=(light,), bounds=(np.zeros(3), 3.0)))


def test_light_tracing_follows_a_lights_guides_and_moves_with_them():
    plain = trace(world_of(LAMP), beams_per_light=64)[0].beams
    led_light = replace(LAMP, guides=(BOW,))
    (found,) = trace(world_of(led_light), beams_per_light=64)
    steps = pieces_along([Guide.through(BOW)]) + 2
    assert len(found.beams) == steps * len(plain) and found.close is None
    # The guides at shutter close turn less, but they have as many pieces.
    later = replace(LAMP, guides=(BOW * [1, 0.5, 1],))
    (moving,) = trace(world_of(led_light), beams_per_light=64, close=world_of(later))
    assert len(moving.close) == len(moving.beams) == steps * len(plain)
    assert moving.beams.arrays().keys() == moving.close.arrays().keys()
    assert not np.allclose(moving.beams.arrays()["end"], moving.close.arrays()["end"])


def test_another_pass_with_other_guides_compiles_nothing():
    def run(number):
        light = replace(LAMP, guides=(BOW * [1, 1 - 0.1 * number, 1], BOW + 5))
        dr.eval(trace(world_of(light), beams_per_light=64 + number, pass_index=number)[0].beams)

    run(0)
    assert not compiled(run, 1)


def test_a_guide_without_length_is_told_in_a_sentence():
    with pytest.raises(SceneError, match="a guide has fewer than two different points"):
        Guide.through([[1, 1, 1], [1, 1, 1]])
