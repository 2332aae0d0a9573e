"""Photons that were scattered at random have a radius that reaches their neighbours."""

import drjit as dr
import numpy as np

from photonbeams.numerics.arrays import to_float, to_vectors
from photonbeams.render.paths import photons
from photonbeams.render.paths.photons import _NEIGHBOURS
from photonbeams.runtime.device import Array3f, Bool, Float, mitsuba
from photonbeams.transport.segments.radii import Limits
from photonbeams.transport.segments.records import PhotonHits
from photonbeams.world.plugin import world_of_plugin
from tests.helpers.mitsuba_scenes import camera, load

mi = mitsuba()


def hits(places, coherent, flux=1.0):
    """Return photon hits at places (N, 3)."""
    result = dr.zeros(PhotonHits, len(places))
    result.position, result.coherent = to_vectors(places), Bool(coherent)
    result.flux, result.radius = Array3f(to_float(np.full(len(places), flux))), dr.zeros(Float, len(places))
    return result


def reached(*given):
    return photons._neighbourhood(hits(*given)).numpy()


def test_distances_are_those_of_all_pairs():
    places = np.random.default_rng(1).random((200, 3)).astype(np.float32)
    every = np.linalg.norm(places[:, None] - places[None], axis=2)
    nearest = np.sort(every, axis=1)[:, _NEIGHBOURS]  # the first is the photon itself
    np.testing.assert_allclose(reached(places, np.zeros(200, bool)), nearest, rtol=1e-5)


def test_photons_of_coherent_paths_neither_reach_nor_are_reached():
    places = np.random.default_rng(2).random((400, 3)).astype(np.float32)
    coherent = np.arange(400) % 2 == 0
    found = reached(places, coherent)
    assert np.all(found[coherent] == 0)
    np.testing.assert_array_equal(found[~coherent], reached(places[~coherent], np.zeros(200, bool)))


def test_the_disc_of_a_photon_holds_as_many_as_are_asked_for():
    """On a plane with n photons per unit area, the mean of π r² n is the number of neighbours."""
    places = np.random.default_rng(3).random((20000, 3)).astype(np.float32)
    places[:, 2] = 0
    middle = np.all(np.abs(places[:, :2] - 0.5) < 0.4, axis=1)
    count = np.pi * reached(places, np.zeros(20000, bool))[middle].astype(np.float64) ** 2 * 20000
    # π r² n has the mean k and the variance k, and neighbours share their discs: N / k of N values are independent.
    assert abs(count.mean() / _NEIGHBOURS - 1) < 3 / np.sqrt(middle.sum())


def test_few_photons_and_dark_ones_keep_their_radius():
    places = np.random.default_rng(4).random((_NEIGHBOURS, 3)).astype(np.float32)
    assert np.all(reached(places, np.zeros(_NEIGHBOURS, bool)) == 0)
    places = np.random.default_rng(4).random((100, 3)).astype(np.float32)
    assert np.all(reached(places, np.zeros(100, bool), 0.0) == 0)


def test_a_photon_that_is_nowhere_stops_nothing():
    places = np.random.default_rng(5).random((100, 3)).astype(np.float32)
    places[7] = np.nan
    found = reached(places, np.zeros(100, bool))
    assert found[7] == 0
    assert np.all(np.delete(found, 7) > 0)


def fitted(flux, radius, floor=0.01):
    """Return radius and flux of photons on a floor, fitted to it with the bounds `floor` and 0.1."""
    floor_of_ten = {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(10)}
    found = hits(np.zeros((len(flux), 3)), np.ones(len(flux), bool), flux)
    found.radius, found.normal = to_float(radius), to_vectors(np.tile([0.0, 0, 1], (len(flux), 1)))
    found.direction = -found.normal
    world = world_of_plugin(load(floor=floor_of_ten, sensor=camera()), None)
    photons._fit(found, world, Limits(*(dr.opaque(Float, each) for each in (floor, 0.1, 1.0))))
    return found.radius.numpy(), found.flux.numpy()[0]


def test_a_photon_with_more_flux_than_others_reaches_further_and_is_no_brighter():
    """A hundred times the flux may have ten times the greatest radius, if the photon's differentials are as wide."""
    flux = np.array([1.0] * 9 + [100.0, 100.0, 0.01, 1e6, np.inf])
    found, kept = fitted(flux, np.array([5.0] * 9 + [5.0, 0.3, 5.0, 5.0, 5.0]))
    np.testing.assert_allclose(found, [0.1] * 9 + [1.0, 0.3, 0.1, 1.6, 0.1], rtol=1e-5)
    np.testing.assert_allclose(kept, flux, rtol=1e-5)


def test_a_radius_that_is_set_holds_for_all_photons():
    found, _ = fitted(np.array([1.0, 1, 1, 100]), np.array([5.0, 0.01, 5, 5]), floor=0.1)
    np.testing.assert_allclose(found, 0.1, rtol=1e-6)
