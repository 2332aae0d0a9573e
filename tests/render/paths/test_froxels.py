"""Fluence in cells of a camera's frustum: an even fluence in fog has a closed form, whatever rays see of it."""

from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams.numerics.arrays import to_float
from photonbeams.render.paths.froxels import Froxels, FroxelSums
from photonbeams.runtime.device import Array3f, Bool, UInt32
from photonbeams.scene import Camera
from photonbeams.world.cameras.cameras import View, Window

WIDTH, HEIGHT, COUNT = 200, 120, 1 << 21
PERSPECTIVE = Camera(
    "/camera", to_world=np.eye(4), focal_length=1.0, horizontal_aperture=1.0, vertical_aperture=0.6, focus_distance=4.0
)
# It sees a box of 2 × 1.2 units.
ORTHOGRAPHIC = replace(PERSPECTIVE, projection="orthographic", horizontal_aperture=2.0, vertical_aperture=1.2)


def even(camera, medium, near, far, rng):
    """Return the radiance that pixels see of fog with a fluence of 1 between two distances, and the cells.

    A quarter of the pixels, at the lower right, see half as far.
    """
    view = View(camera, Window.full(WIDTH, HEIGHT))
    rays = view.rays((0.5, 0.5))
    y, x = np.divmod(np.arange(WIDTH * HEIGHT), WIDTH)
    shorter = (x >= WIDTH // 2) & (y >= HEIGHT // 2)
    length = np.where(shorter, 0.5, 1.0) * (far - near)
    begin = to_float(np.full(WIDTH * HEIGHT, near))
    deepest = 12 / max(min(medium.extinction), 1e-30)
    cells = Froxels.of(view.projection, rays.facing, begin, begin + to_float(length), deepest=deepest, blur=0.01 * far)
    sums = FroxelSums(view.projection, [cells], [1], [1e-15])
    # The volume element is z² dz for even slopes x / z and y / z; beyond the sides of the picture there is light, too.
    parallel = camera.projection == "orthographic"
    last = min(far, near + 8 / max(min(medium.extinction), 1e-30))  # deeper light is not seen
    size = np.array([2.2, 1.4, last]) * ([1, 1, 1] if parallel else [0.5, 0.5, 1])
    across, down, depth = size[:, None] * (rng.random((3, COUNT)) - np.array([[0.5], [0.5], [0.0]]))
    scale, volume = (1.0, 1.0) if parallel else (depth, depth**2)
    value = np.prod(size) * volume / COUNT + 0 * depth
    places = np.stack([across * scale, down * scale, -depth]).astype(np.float32)
    ones = dr.full(Bool, True, COUNT)
    group = dr.zeros(UInt32, COUNT)
    sums.add(Array3f(places), Array3f(to_float(value)), group + 1, group, lambda toward, _: Array3f(1), ones)
    (table,) = cells.tables(medium, 0.01 * far, sums.of(0))
    at = view.projection.seen(Array3f(rays.origin) + 2.0 * Array3f(rays.direction)).at
    return cells.radiance(table, at, to_float(length)).numpy(), length


@pytest.mark.parametrize("camera", [PERSPECTIVE, ORTHOGRAPHIC], ids=["perspective", "orthographic"])
@pytest.mark.parametrize("near", [0.0, 3.0])
@pytest.mark.parametrize("extinction", [0.0, 0.2, 5.0])
def test_an_even_fluence_has_its_radiance_up_to_every_depth(rng, camera, near, extinction):
    scattering = np.array([0.05, 0.1, 0.2])
    medium = pb.Medium(scattering=tuple(scattering), absorption=tuple(np.maximum(extinction - scattering, 0)))
    found, length = even(camera, medium, near, 6.0, rng)
    total = np.array(medium.extinction)[:, None]
    right = np.array(medium.scattering)[:, None] / (4 * np.pi) * -np.expm1(-total * length) / total
    # A column has thousands of deposits, and a block a hundred columns. Within a cell the integral is that of an even
    # fluence, so that only the noise is left, and at the shorter quarter's edge a cell that sees both lengths.
    error = (found / right - 1).reshape(3, 4, HEIGHT // 4, 5, WIDTH // 5).mean(axis=(2, 4))
    assert np.abs(error).max() < 0.03
    assert np.abs(found / right - 1).mean() < 0.06


def test_sums_do_not_depend_on_the_order_of_deposits(rng):
    view = View(PERSPECTIVE, Window.full(WIDTH, HEIGHT))
    rays = view.rays((0.5, 0.5))
    end = dr.full(type(rays.facing), 4.0, WIDTH * HEIGHT)
    places = rng.uniform((-2, -1, -4), (2, 1, 0), (1 << 16, 3)).astype(np.float32)
    value = rng.uniform(0, 1, (1 << 16, 3)).astype(np.float32)

    def sums(order):
        cells = Froxels.of(view.projection, rays.facing, 0 * end, end, deepest=np.inf, blur=0.04)
        found = FroxelSums(view.projection, [cells, cells], [1, 1], [1e-9])
        light = Array3f(value[order].T.copy())
        everywhere = dr.full(Bool, True, len(order))
        group = dr.zeros(UInt32, len(order))
        found.add(Array3f(places[order].T.copy()), light, group + 1, group, lambda *_: Array3f(1), everywhere)
        assert (found.of(0) == found.of(1)).all()
        return found.of(0)

    first = sums(np.arange(1 << 16))
    assert first.max() > 0
    assert (first == sums(rng.permutation(1 << 16))).all()
