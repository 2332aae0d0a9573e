"""Which lamps can light a place: no list lacks a lamp that does, and lists of narrow cones are short."""

import drjit as dr
import numpy as np
import pytest

from photonbeams import scene
from photonbeams.runtime.device import Array2f, Array3f, Bool, UInt32
from photonbeams.world.bounds import Bounds
from photonbeams.world.emitters.build import lamp_of
from photonbeams.world.emitters.lamp_boxes import LampBoxes

PLACES = 20_000


def lights(count, seed, widest):
    """Return lamps of the kinds that have cones, with random places, sizes and axes, in a ball of radius 10."""
    rng = np.random.default_rng(seed)
    result = []
    for number in range(count):
        center, axis = rng.normal(0, 3, 3), rng.normal(0, 1, 3)
        axis /= np.linalg.norm(axis)
        shaping = scene.Shaping(cone_angle=float(rng.uniform(1, widest)), cone_softness=float(rng.uniform(0, 1)))
        more = {"center": center, "axis": axis, "shaping": None if rng.random() < 0.1 else shaping}
        x = np.linalg.svd(axis[None])[2][1] * rng.uniform(0.01, 1)
        name = f"/L{number}", (1, 1, 1)
        if number % 3 == 0:
            result.append(scene.SphereLight(*name, radius=float(rng.choice([0, 0.5])), **more))
        elif number % 3 == 1:
            result.append(scene.FlatLight(*name, half_x=x, half_y=np.cross(axis, x), disk=True, **more))
        else:
            result.append(scene.CylinderLight(*name, half=x, radius=0.1, **more))
    return result


def listed(boxes, place, active=True):
    """Return which lamps, (places, lamps), the lists of places have."""
    first, stop = boxes.lists(place, Bool(active) & dr.full(Bool, True, dr.width(place)))
    lamps = boxes.lamp(dr.arange(UInt32, int(dr.max(stop)[0]))).numpy()
    return [lamps[begin:end] for begin, end in zip(first.numpy(), stop.numpy(), strict=True)]


@pytest.mark.parametrize(("count", "seed", "widest"), [(1, 0, 20), (9, 1, 180), (60, 2, 20), (200, 3, 60)])
def test_lists_have_all_lamps_that_light_a_place(count, seed, widest):
    rng = np.random.default_rng(seed)
    # Some places are outside of the bounds, which all lamps light.
    place, aim = Array3f(rng.normal(0, 5, (3, PLACES))), Array2f(rng.random((2, PLACES)))
    given = lights(count, seed, widest)
    found = listed(LampBoxes(given, Bounds(np.zeros(3), 10.0)), place)
    assert all((np.diff(own) > 0).all() for own in found)  # in order, once each
    has = np.zeros((PLACES, count), dtype=bool)
    for row, own in zip(has, found, strict=True):
        row[own] = True
    for number, light in enumerate(given):
        lit = (dr.max(lamp_of(light).illuminate(place, aim).weight)).numpy() > 0
        assert has[lit, number].all(), light


def test_lists_of_a_rig_are_short():
    given = lights(200, 5, 10)
    place = Array3f(np.random.default_rng(0).normal(0, 3, (3, PLACES)))
    found = listed(LampBoxes(given, Bounds(np.zeros(3), 10.0)), place)
    everywhere = sum(each.shaping is None for each in given)
    # A cone of 10 degrees is 1 / 130 of all directions; boxes are as large as cones are wide.
    assert np.mean([len(own) for own in found]) < everywhere + 0.1 * len(given)


def test_places_that_are_not_asked_for_have_empty_lists():
    boxes = LampBoxes(lights(20, 4, 20), Bounds(np.zeros(3), 10.0))
    place = Array3f(np.random.default_rng(1).normal(0, 5, (3, 100)))
    first, stop = boxes.lists(place, dr.full(Bool, False, 100))
    assert (first.numpy() == stop.numpy()).all()
