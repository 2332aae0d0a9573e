"""Walks through smoke that varies find small lamps, in the mean and with noise that does not depend on their size."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.stats.qmc import Sobol

from photonbeams import scene
from photonbeams.render.settings import Settings
from photonbeams.render.stage_frame import render
from photonbeams.world.cameras.cameras import Window
from photonbeams.world.shutter import Shutter
from tests.helpers.sweep import sweep

SIZE, WIDTH, CELLS, STEPS = 24, 2.5, 6, 32
WINDOW = Window(SIZE, SIZE, (0, 0, SIZE, SIZE))
# A camera that sees [-1, 1]³ along -z, with some pixels around it, since filters reach beyond the picture.
CAMERA = replace(
    scene.Camera.look_at(origin=(0, 0, 9), target=(0, 0, 0)),
    projection="orthographic", horizontal_aperture=WIDTH, vertical_aperture=WIDTH,
)  # fmt: skip
PLACE = np.array([[2.0, 0, 0, -1], [0, 2, 0, -1], [0, 0, 2, -1], [0, 0, 0, 1]])


def smoke(values, scattering, absorption=0.0):
    grid = scene.DensityGrid(np.float32(values), PLACE)
    return scene.Medium(tuple(scattering), absorption=(absorption,) * 3, name="/smoke", grid=grid)


def ball(center, radius, flux=1.0):
    return scene.SphereLight("/lamp", (flux / radius**2,) * 3, center=center, radius=radius)


def fog_of(lights, medium, seed, **settings):
    """Return the layer of fog by walks, (SIZE, SIZE, 3)."""
    shutter = Shutter.still(scene.Scene(lights=lights, media=(medium,)), CAMERA)
    return render(shutter, WINDOW, Settings(method="paths", seed=seed, **settings)).layers()["beams"][..., :3]


def density(values, points):
    """Return the density at points (..., 3): linear between the centres of cells, 0 outside of [-1, 1]³."""
    at = np.moveaxis((points[..., ::-1] + 1) / 2 * CELLS - 0.5, -1, 0)
    found = map_coordinates(values, at, order=1, mode="nearest")
    return np.where(np.all(np.abs(points) <= 1, axis=-1), found, 0)


def depth_between(values, begin, end):
    """Return the mean density along lines times their length, by the midpoint rule."""
    t = ((np.arange(STEPS) + 0.5) / STEPS)[:, None, None]
    return density(values, begin + t * (end - begin)).mean(axis=0) * np.linalg.norm(end - begin, axis=-1)


def scattered_once(values, lamp, scattering, extinction):
    """Return the mean of ∫ T σs E / 4π over the picture by a lattice around the lamp; (3,)."""
    u = Sobol(5, scramble=False).random_base2(14)[1:]
    c, r, far = np.asarray(lamp.center), lamp.radius, 4.0
    z, around = 2 * u[:, 1] - 1, 2 * np.pi * u[:, 2]
    axis = np.stack([np.sqrt(1 - z**2) * np.cos(around), np.sqrt(1 - z**2) * np.sin(around), z], axis=-1)
    d = r + (far - r) * u[:, 0]
    x = c + d[:, None] * axis
    # A point of the lamp, uniform in the cone that it subtends from x.
    least = np.sqrt(1 - (r / d) ** 2)
    cosine, around = 1 - (1 - least) * u[:, 3], 2 * np.pi * u[:, 4]
    s = np.cross(axis, np.where(np.abs(z)[:, None] < 0.7, [0.0, 0, 1], [1.0, 0, 0]))
    s /= np.linalg.norm(s, axis=-1, keepdims=True)
    side = np.cos(around)[:, None] * s + np.sin(around)[:, None] * np.cross(axis, s)
    toward = -cosine[:, None] * axis + np.sqrt(1 - cosine**2)[:, None] * side
    length = d * cosine - np.sqrt(np.maximum(r**2 - d**2 * (1 - cosine**2), 0))
    front = np.where(x[:, 2:] < 1, [0, 0, 1] + x * [1, 1, 0], x)
    depth = depth_between(values, x, x + length[:, None] * toward) + depth_between(values, x, front)
    fluence = lamp.radiance[0] * 2 * np.pi * (1 - least)
    # The camera does not see what is behind the lamp.
    seen = (x[:, 2] > c[2]) | (np.hypot(*(x - c)[:, :2].T) > r)
    weight = (far - r) * d**2 * density(values, x) * fluence * seen
    passed = np.exp(-np.outer(extinction, depth))
    return np.asarray(scattering) * np.mean(weight * passed, axis=-1) / WIDTH**2


@pytest.mark.parametrize("seed", sweep(range(12), [1, 2]))
def test_smoke_around_a_lamp_is_as_bright_as_by_quadrature(seed):
    rng = np.random.default_rng(seed)
    values = rng.random((CELLS,) * 3) ** rng.choice([0.5, 4])
    scattering = rng.uniform(0.5, 8) * (np.ones(3) if seed % 2 else rng.uniform(0.2, 1, 3))
    absorption = rng.uniform(0, 2)
    lamp = ball(tuple(rng.uniform(-1.2, 1.2, 3)), 10 ** rng.uniform(-2, -1))
    right = scattered_once(values, lamp, scattering, scattering + absorption)
    medium = smoke(values, scattering, absorption)
    found = [fog_of((lamp,), medium, each, passes=2, max_depth=2).mean(axis=(0, 1)) for each in range(6)]
    error = np.std(found, axis=0, ddof=1) / np.sqrt(6)
    # The lattice errs by 0.2 %: so much its sums change with 16 times as many points.
    assert np.mean(found, axis=0) == pytest.approx(right, abs=5 * error.max() + 3e-3 * right.max())
    assert np.all(error < 0.02 * right)


def test_noise_of_smoke_does_not_grow_where_a_lamp_is_smaller():
    values = np.random.default_rng(3).random((CELLS,) * 3)
    medium, center = smoke(values, (4.0,) * 3), (0.1, 0.05, 0.2)
    x, y = np.meshgrid(*2 * [((np.arange(SIZE) + 0.5) / SIZE - 0.5) * WIDTH])
    # Beside the lamp, where it is not resolved, pixels see about the same light of both.
    beside = np.hypot(x - center[0], -y - center[1]) > 0.25
    noise = []
    for radius in (0.1, 0.01):
        found = [fog_of((ball(center, radius),), medium, each, passes=2, max_depth=4) for each in range(6)]
        noise.append(np.var(found, axis=0, ddof=1).mean(axis=-1)[beside].mean() / np.mean(found) ** 2)
    # With free flights alone the variance is as 1 / radius: 10 times as much.
    assert noise[1] < 2 * noise[0]
