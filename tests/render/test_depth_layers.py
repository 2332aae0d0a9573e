"""Deep holdouts and those with an alpha weigh the light of beams as the layers cover it."""

import dataclasses

import numpy as np
import OpenImageIO
import pytest

from photonbeams import scene
from photonbeams.images.exr import deep_sizes
from photonbeams.images.plates import Holdout
from photonbeams.render.seen import depth_layers
from photonbeams.render.seen.depth_layers import DepthLayers
from photonbeams.render.settings import Settings
from photonbeams.render.stage_frame import render
from photonbeams.world.cameras.cameras import View, Window
from photonbeams.world.shutter import Shutter
from tests.helpers.comparison import quad
from tests.helpers.deep_files import damaged, write_deep

WIDTH, HEIGHT = 40, 24
WINDOW = Window.full(WIDTH, HEIGHT)
# Nine times the pixels in an eighth of the passes: as many samples, by an eighth of the launches.
LARGE = Window.full(3 * WIDTH, 3 * HEIGHT)
# Centimetres, far from the origin.
FAR, UNIT = np.array([3000.0, -700.0, 5000.0]), 100.0
FOG = scene.Medium(scattering=(2e-3, 2e-3, 2e-3))
TO_WORLD = np.eye(4)
TO_WORLD[:3, 3] = FAR
CAMERA = scene.Camera("/camera", to_world=TO_WORLD, focal_length=1.0, horizontal_aperture=1.0, vertical_aperture=0.6)
PASSES = 64


def beam(depth, scale=1.0):
    """Return a beam across the whole picture at a depth in units."""
    start, end = (FAR + UNIT * np.array([[x, 0.0, -depth]]) for x in (-6, 6))
    radius = np.full(1, 0.5 * UNIT)
    return scene.DrawnBeams(f"/beam{depth:g}", start, end, radius, radius, np.full((1, 3), scale))


def light(*beams, held=None, meshes=(), window=WINDOW, passes=PASSES):
    """Return the red light of beams over a picture's middle rows, and the depth layer."""
    still = Shutter.still(scene.Scene(tuple(meshes), (), beams, (FOG,)), CAMERA)
    view = View(CAMERA, window)
    holdouts = [each.seen_by(view) for each in held or ()]
    layers = render(still, window, Settings(passes=passes, pixel_filter="box"), holdouts=holdouts).layers()
    middle = slice(window.height // 3, 2 * window.height // 3)
    return layers["beams"][middle, :, 0].astype(np.float64), layers["depth"][middle]


def read(holdout, window=WINDOW):
    warnings = []
    return holdout.read(1, [""], (window.width, window.height), warnings.append), warnings


def test_layers_are_those_of_the_product_of_samples_in_any_order():
    """Two volumes that overlap, behind a surface, in the wrong order: optical depths at every depth are sums."""
    front, back, alpha = np.array([[4.0, 3.0, 2.0], [8.0, 6.0, 2.0], [0.5, 0.75, 0.25]])
    layers = DepthLayers.of_samples(np.array([[0, 3]]), front, back, alpha)
    assert layers.counts.tolist() == [[0, 4]]
    assert layers.nearest().tolist() == [[np.inf, 2.0]]
    at = np.linspace(1.9, 9, 200)
    density = [np.clip((at - z) / max(end - z, 1e-9), 0, 1) for z, end in zip(front, back, strict=True)]
    expected = -sum(part * np.log1p(-a) for part, a in zip(density, alpha, strict=True))
    found = np.zeros_like(at)
    for begin, end, before, after in zip(
        layers.front, layers.back, [0, *layers.optical[:-1]], layers.optical, strict=True
    ):
        found += (after - before) * np.clip((at - begin) / max(end - begin, 1e-9), 0, 1)
    assert np.allclose(found, expected, atol=1e-9)


def test_layers_are_the_same_however_many_pixels_are_taken_together(rng, monkeypatch):
    counts = rng.integers(0, 4, (5, 7))
    front = rng.uniform(1, 9, counts.sum())
    back, alpha = front + rng.choice([0.0, 2.0], len(front)), rng.uniform(0, 1, len(front))
    whole = DepthLayers.of_samples(counts, front, back, alpha)
    assert (whole.counts.sum(axis=1) > 0).all() and (whole.front < whole.back).any()
    for most in (1, 2, 5, len(front)):
        monkeypatch.setattr(depth_layers, "_TOGETHER", most)
        parts = DepthLayers.of_samples(counts, front, back, alpha)
        assert all(np.array_equal(getattr(parts, each), getattr(whole, each)) for each in ("counts", "front", "back"))
        assert np.allclose(parts.optical, whole.optical, rtol=1e-12, atol=1e-12)
    assert not len(DepthLayers.of_samples(0 * counts, front[:0], back[:0], alpha[:0]).front)


@pytest.mark.parametrize(("parts", "tiled"), [pytest.param(1, False, marks=pytest.mark.soak), (2, True)])
def test_light_between_deep_samples_is_that_which_the_samples_before_let_through(tmp_path, parts, tiled):
    """Light before all samples, between a surface and a volume, in the volume, and behind it, by itself."""
    samples = [[(5, 9, 0.75), (3, 3, 0.5)], [(1, 1, 1)]]
    size = LARGE.width, LARGE.height
    path = write_deep(tmp_path / "deep.exr", lambda part, _: samples[part], size, parts, tiled)
    (held,), warnings = read(Holdout(path, scale=UNIT), LARGE)
    large = {"window": LARGE, "passes": PASSES // 8}
    assert len(warnings) == (parts > 1)  # one of several depths is used
    # Half-way in the volume, a beam that is thin in depth has 0.25^0.5 of its light; it is 1 unit thick, and symmetric.
    passed = {2.0: 1.0, 4.0: 0.5, 12.0: 0.125}
    for depth, expected in passed.items():
        whole, _ = light(beam(depth), **large)
        seen, front = light(beam(depth), held=[held], **large)
        assert np.allclose(front, 3 * UNIT, rtol=1e-5)
        assert seen.sum() / whole.sum() == pytest.approx(expected, abs=2e-3)
    whole, seen = light(beam(7.0), **large)[0], light(beam(7.0), held=[held], **large)[0]
    along = np.linspace(-0.5, 0.5, 201)
    chord = np.sqrt(np.maximum(0.25 - along**2, 0))
    inside = 0.5 * float((chord * 0.25 ** ((2 + along) / 4)).sum() / chord.sum())
    assert seen.sum() / whole.sum() == pytest.approx(inside, abs=4e-3)


def test_a_slanted_deep_surface_hides_beams_right_behind_it(tmp_path):
    """A deep floor with alpha 1 is the flat one: its layers have slopes."""
    down = (np.arange(HEIGHT) + 0.5) / HEIGHT * 0.6 - 0.3
    depth = np.repeat(np.where(down > 0, 0.5 / np.maximum(down, 1e-9), np.inf)[:, None], WIDTH, axis=1)
    near = depth.ravel() < 40
    floor = [[(each, each, 1)] if seen else [] for each, seen in zip(depth.flat, near, strict=True)]
    path = write_deep(tmp_path / "floor.exr", lambda _, pixel: floor[pixel], (WIDTH, HEIGHT))
    (deep,), _ = read(Holdout(path))
    (flat,), _ = read(Holdout(np.where(depth < 40, depth, np.inf)))
    own, other = (each.seen_by(View(CAMERA, WINDOW)) for each in (deep, flat))
    assert deep.layers is not None and flat.layers is None
    slopes = [np.zeros((HEIGHT, WIDTH)), np.zeros((HEIGHT, WIDTH))]
    for mine, theirs in zip(slopes, (own, other), strict=True):
        found = theirs._slopes[1].numpy()
        mine.ravel()[near if len(found) != mine.size else slice(None)] = found
    assert np.allclose(*slopes, atol=1e-6) and slopes[0].max() > 0.04


def test_a_holdout_with_an_alpha_is_the_geometry_that_it_was_made_from():
    """Thin slanted slats before a beam: their alpha and depth, one of each pixel, hide what the slats hide."""
    slats = []
    for number in range(14):
        x = -1.7 + 0.27 * number
        corners = FAR + UNIT * np.array([[x, -1, -2], [x + 0.04, -1, -2], [x + 0.34, 1, -2], [x + 0.3, 1, -2]])
        slats.append(quad(f"/slat{number}", corners))
    lit = beam(5.0)
    real, _ = light(lit, meshes=slats)
    # Their exact coverage: slats are parallelograms in the picture.
    fine = 64
    column, row = np.meshgrid((np.arange(WIDTH * fine) + 0.5) / fine, (np.arange(HEIGHT * fine) + 0.5) / fine)
    x = 2 * (column / WIDTH - 0.5) - 0.15 * (2 * (0.3 - row / HEIGHT * 0.6) + 1) + 1.7
    hit = (x % 0.27 < 0.04) & (x > 0) & (x < 14 * 0.27)
    alpha = hit.reshape(HEIGHT, fine, WIDTH, fine).mean(axis=(1, 3))
    centre = hit[fine // 2 :: fine, fine // 2 :: fine]
    assert 0.1 < alpha.mean() < 0.2 and (centre != (alpha > 0)).any()
    # A renderer that takes the depth at the centre has none in most pixels: they take that of the pixels around them.
    depth = np.where(centre, 2.0, np.inf)
    (held,), _ = read(Holdout(depth, scale=UNIT, coverage=alpha))
    seen, _ = light(lit, held=[held])
    (without,), _ = read(Holdout(depth, scale=UNIT))
    dashed, _ = light(lit, held=[without])
    whole, _ = light(lit)
    blocks = [each.reshape(2, 4, 10, 4).mean(axis=(1, 3)) / whole.mean() for each in (real, seen, dashed)]
    assert not np.allclose(blocks[0], whole.reshape(2, 4, 10, 4).mean(axis=(1, 3)) / whole.mean(), atol=0.05)
    # 64 stratified samples of each of 16 pixels, in each of which one errs by less than 1/64.
    assert np.abs(blocks[1] - blocks[0]).max() < 0.005 + 3 / 64 / np.sqrt(16)
    assert abs(seen.sum() / real.sum() - 1) < 0.005
    assert np.abs(blocks[2] - blocks[0]).max() > 0.02
    # Along a slat there are no dashes: in each pixel, light is that of its coverage.
    error = seen / np.maximum(whole, 1e-9) - (1 - alpha[8:16])
    assert np.sqrt((error**2).mean()) < 2 / 64


def test_an_alpha_beside_the_depth_is_used_unless_it_is_turned_off(tmp_path):
    path = tmp_path / "a.exr"
    spec = OpenImageIO.ImageSpec(WIDTH, HEIGHT, 2, "float")
    spec.channelnames = ("A", "Z")
    out = OpenImageIO.ImageOutput.create(str(path))
    assert out.open(str(path), spec)
    assert out.write_image(
        np.dstack([np.full((HEIGHT, WIDTH), 0.25), np.full((HEIGHT, WIDTH), 3.0)]).astype(np.float32)
    )
    out.close()
    (held,), warnings = read(Holdout(path))
    assert held.layers is not None and not warnings
    assert np.allclose(held.layers.optical, -np.log(0.75))
    assert read(Holdout(path, coverage="none"))[0][0].layers is None
    assert read(Holdout(path, coverage="A"))[0][0].layers is not None
    with pytest.raises(scene.SceneError, match="has no channel 'mask': expected one of A, Z, auto or none"):
        read(Holdout(path, coverage="mask"))
    # The box of a crop has the layers of its pixels, and none beyond the picture.
    (part,) = Holdout(path).read(1, [""], (WIDTH, HEIGHT), print, (-2, 3, 5, 7))
    assert part.layers.counts.tolist() == [[0, 0, 1, 1, 1, 1, 1]] * 4
    assert dataclasses.replace(held, distance=True).seen_by(View(CAMERA, WINDOW)).depth.numpy().min() < 2.8


def test_a_deep_file_is_refused_before_it_is_decoded_if_it_claims_what_it_cannot_hold(tmp_path, monkeypatch):
    """A line of a billion samples, one that ends beyond the file, and more samples than the memory holds."""
    path = write_deep(tmp_path / "a.exr", lambda *_: [(3, 3, 0.5)], (WIDTH, HEIGHT), tiled=True)
    write_deep(tmp_path / "b.exr", lambda *_: [(3, 3, 0.5)], (WIDTH, HEIGHT), parts=2)
    monkeypatch.setattr("photonbeams.images.deep.read_deep", None)
    monkeypatch.setattr("photonbeams.images.channels.read_deep", None)
    lie = "cannot be read: expected an image .its header or its chunks are damaged, or the end is missing.$"
    for file in (path, tmp_path / "b.exr"):
        whole = file.read_bytes()
        for bad in (damaged(whole, decoded=12 * 10**9), damaged(whole, packed=10**12), whole[:-40]):
            file.write_bytes(bad)
            with pytest.raises(scene.SceneError, match=lie):
                read(Holdout(file))
        file.write_bytes(whole)
        assert sum(deep_sizes(file)) == WIDTH * HEIGHT * 12 * (1 if file == path else 2)
    monkeypatch.setattr("photonbeams.runtime.inputs.memory", lambda: 500_000)
    with pytest.raises(
        scene.SceneError, match=r"reading its deep samples takes .*: expected up to .*, the memory here"
    ):
        read(Holdout(path))
