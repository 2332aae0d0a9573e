"""Heterogeneous media: transmittance against integrals in float64, and free flights against transmittance."""

import drjit as dr
import numpy as np
import pytest

from photonbeams.numerics.hashing import hash32
from photonbeams.runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from photonbeams.world.media.interfaces import pointers
from photonbeams.world.media.media import Media
from photonbeams.world.media.tracking import Track, free_flight, walk
from tests.helpers.mitsuba_scenes import cloud

mi = mitsuba()
ORIGIN, DIRECTION, LENGTH = np.array([-2.0, 0.1, 0.2]), np.array([1.0, 0.05, -0.1]), 4.0
DIRECTION /= np.linalg.norm(DIRECTION)


def depth_to(volume, distances):
    """Return the optical depth along the ray up to distances, (N, 3), by the midpoint rule over small steps."""
    steps = 4096
    t = (np.arange(steps) + 0.5) * LENGTH / steps
    points = ORIGIN + t[:, None] * DIRECTION
    inside = np.all(np.abs(points) < 1, axis=1)
    values = volume.extinction(Array3f(points.T.astype(np.float32))).numpy() * inside
    sums = np.cumsum(values, axis=1) * LENGTH / steps
    return np.array([sums[:, min(int(each / LENGTH * steps), steps - 1)] for each in distances])


@pytest.fixture(params=[(1.0,), (1.0, 0.5, 0.2)], ids=["grey", "coloured"])
def volume(request):
    (result,) = Media([mi.load_dict(cloud(request.param))]).all
    return result


def ways(volume, count):
    zeros = dr.zeros(Array3f, count)
    seed = hash32(dr.arange(UInt32, count))
    return volume.segment(zeros + Array3f(ORIGIN), zeros + Array3f(DIRECTION), Float(0), Float(LENGTH), seed)


def test_transmittance_is_unbiased_and_has_little_noise(volume):
    found = walk(ways(volume, 1 << 14), volume.extinction, Bool(True)).numpy()
    expected = np.exp(-depth_to(volume, [LENGTH])[0])
    error = found.std(axis=1) / np.sqrt(found.shape[1])
    # Four standard errors, plus the error of the reference's steps, which is of the order of their square.
    np.testing.assert_array_less(np.abs(found.mean(axis=1) - expected), 4 * error + 1e-5)
    # With ratio tracking and the same majorant, the spread would be about as large as the light that is lost.
    assert (found.std(axis=1) < 0.1 * (1 - expected)).all()


def test_a_track_knows_the_transmittance_at_all_distances(volume):
    count = 1 << 14
    track = Track(ways(volume, count), volume.extinction, Bool(True))
    distances = [0.5, 1.2, 1.9, 2.4, 3.5]
    expected = np.exp(-depth_to(volume, distances))
    rays = dr.arange(UInt32, count)
    for distance, value in zip(distances, expected, strict=True):
        found = track(rays, dr.opaque(Float, distance, count)).numpy()
        error = found.std(axis=1) / np.sqrt(count)
        # Half a step of the reference at its densest: 1.5 · 1.5 · 4 / 4096 / 2.
        np.testing.assert_array_less(np.abs(found.mean(axis=1) - value), 4 * error + 1.2e-3)


def test_free_flights_follow_the_transmittance(volume):
    count = 1 << 15
    zeros = dr.zeros(Array3f, count)
    media = pointers(dr.opaque(UInt32, volume.number, count))
    share = dr.full(Array3f, 1 / 3, count)
    distance, collided, scattered, weight = free_flight(
        media, zeros + Array3f(ORIGIN), zeros + Array3f(DIRECTION), dr.full(Float, LENGTH, count), share,
        hash32(dr.arange(UInt32, count)), dr.full(Bool, True, count), dr.opaque(Bool, volume.colored, count),
    )  # fmt: skip
    ends = distance.numpy()
    majorant = max(volume.medium.extinction)
    for limit in (0.9, 1.5, 2.1, 2.7):
        gone = (ends < limit).mean()
        if volume.colored:  # flights end at tentative collisions, whose rate is the same everywhere
            enter, leave = (-1 - ORIGIN[0]) / DIRECTION[0], (1 - ORIGIN[0]) / DIRECTION[0]
            expected = 1 - np.exp(-majorant * (np.clip(limit, enter, leave) - enter))
        else:
            expected = 1 - np.exp(-depth_to(volume, [limit])[0][0])
        assert gone == pytest.approx(expected, abs=4 * np.sqrt(0.25 / count) + 1.2e-3)
    assert (scattered.numpy() <= collided.numpy()).all()
    if not volume.colored:
        np.testing.assert_allclose(weight.numpy()[:, scattered.numpy()], 0.9, rtol=1e-5)  # the albedo


def test_what_lies_between_the_probes_is_not_overlooked():
    """A thin dense sheet between the probes, in a fine grid, has the right mean transmittance."""
    grid = np.zeros((3, 3, 256, 1), dtype=np.float32)
    grid[:, :, 120:122] = 1.0
    to_world = mi.ScalarTransform4f().translate(-1).scale(2)
    sheet = {"type": "gridvolume", "grid": mi.VolumeGrid(grid), "to_world": to_world, "filter_type": "nearest"}
    (volume,) = Media([mi.load_dict({"type": "heterogeneous", "sigma_t": sheet, "scale": 40.0})]).all
    found = walk(ways(volume, 1 << 16), volume.extinction, Bool(True)).numpy()[0]
    expected = np.exp(-depth_to(volume, [LENGTH])[0][0])
    assert abs(found.mean() - expected) < 4 * found.std() / 256 + 1e-2 * expected
