"""Walks meet the light of lamps in media that are too thick for beams; elsewhere beams carry it."""

from dataclasses import replace

import numpy as np
import pytest

from photonbeams import scene
from photonbeams.render.settings import Settings
from photonbeams.render.stage_frame import begin, render, simulate
from photonbeams.runtime.device import mitsuba
from photonbeams.world.cameras.cameras import Window
from photonbeams.world.shutter import Shutter

mi = mitsuba()

SIZE, PASSES = 33, 8
WINDOW = Window(SIZE, SIZE, (0, 0, SIZE, SIZE))
CAMERA = replace(
    scene.Camera.look_at(origin=(0, 0, 9), target=(0, 0, 0)),
    projection="orthographic", horizontal_aperture=1.8, vertical_aperture=1.8,
)  # fmt: skip


def slab(depth, optical):
    """Return smoke in a grid, 2 units wide and `depth` deep, of this optical depth."""
    place = np.diag([2.0, 2.0, depth, 1.0])
    place[:3, 3] = [-1, -1, -depth / 2]
    grid = scene.DensityGrid(np.ones((4, 4, 4), np.float32), place)
    return scene.Medium((optical / depth,) * 3, name="/smoke", grid=grid)


def lit(cosine, *media):
    """Return media in a sun of irradiance 1 that comes from the camera's side, at an angle to its axis."""
    axis = np.array([0, -np.sqrt(1 - cosine**2), -cosine])
    sun = scene.DistantLight("/sun", (1.0, 1.0, 1.0), axis=axis, angle=0.0)
    return Shutter.still(scene.Scene(lights=(sun,), media=media), CAMERA)


@pytest.mark.parametrize("seed", range(2))
def test_thin_dense_smoke_is_as_bright_as_by_the_closed_form(seed):
    random = np.random.default_rng(seed)
    depth, optical, cosine = 10 ** random.uniform(-2.3, -1.7), 10 ** random.uniform(0, 0.5), random.uniform(0.3, 0.6)
    frame = render(lit(cosine, slab(depth, optical)), WINDOW, Settings(passes=PASSES))
    # The integral of σ / 4π exp(-σ z (1 + 1 / cosine)) over the depth.
    rate = 1 + 1 / cosine
    right = -np.expm1(-optical * rate) / (4 * np.pi * rate)
    # Samples lie between 0 and 1 / 4π, so their variance is at most the mean times that.
    error = np.sqrt(right / (4 * np.pi) / (PASSES * SIZE**2))
    # Rays begin a little within the boundary that they pass, as Mitsuba's do: that much of the smoke is not seen.
    unseen = optical * rate * mi.math.RayEpsilon / depth * right
    assert frame.layers()["beams"][..., :3].mean() == pytest.approx(right, abs=4 * error + unseen)


@pytest.mark.parametrize(("optical", "media"), [(0.1, 2), (30.0, 1)])
def test_walks_are_left_thick_smoke_alone_and_files_of_beams_have_all(optical, media):
    haze = scene.Medium((0.01, 0.01, 0.01), name="/haze")
    shutter, settings = lit(0.5, slab(0.1, optical), haze), Settings(passes=1, beams=256)
    shown = begin(shutter, WINDOW, settings).light.traced(0, lambda: None).sets
    assert len({each.medium for each in shown}) == media
    assert len({each.medium for each in simulate(shutter, WINDOW, settings)}) == 2


def test_thick_media_need_no_names():
    media = [replace(each, name="") for each in (slab(0.1, 30.0), slab(3.0, 0.1))]
    assert render(lit(0.5, *media), WINDOW, Settings(passes=1, beams=64)).layers()["beams"].max() > 0
