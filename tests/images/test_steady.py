"""Frames averaged with their neighbours, in films whose light is known, with noise as denoising leaves it."""

import numpy as np
import OpenEXR
import pytest
from scipy.ndimage import gaussian_filter

from photonbeams.images.steady import FilmFrame, FilmView, steadied
from photonbeams.scene import Camera, SceneError
from photonbeams.world.cameras.cameras import View, Window

WIDTH, HEIGHT, NOISE, OWN = 160, 90, 0.04, 2
INSIDE = np.s_[12:-12, 12:-12]  # the camera's motion brings new pixels at the edges


def rays(origin, target):
    """Return the matrices of a camera, its position, and the directions through its pixels at a planar depth of 1."""
    camera = Camera.look_at(origin, target, fov=50)
    header = View(camera, Window.full(WIDTH, HEIGHT)).header()
    to_camera, to_ndc = header["worldToCamera"].T, header["worldToNDC"].T
    half = np.tan(np.radians(25))
    x = half * (2 * (np.arange(WIDTH) + 0.5) / WIDTH - 1)
    y = half * (1 - 2 * (np.arange(HEIGHT) + 0.5) / HEIGHT) * HEIGHT / WIDTH
    local = np.stack([*np.meshgrid(x, y), -np.ones((HEIGHT, WIDTH))], axis=2)
    return to_camera, to_ndc, np.asarray(origin), local @ camera.to_world[:3, :3].T


def wall(seen, distance, angle):
    """Return the planar depth of a wall across −z, turned by an angle, and the points that pixels show of it."""
    _, _, origin, direction = seen
    normal = np.array([np.sin(angle), 0, np.cos(angle)])
    depth = (-distance * normal[2] - origin @ normal) / (direction @ normal)
    return depth, origin + depth[..., None] * direction


def pattern(points, scale):
    """Return a smooth light, (H, W, 3), of the points of a wall."""
    x, y = points[..., 0] / scale, points[..., 1] / scale
    return np.stack([1 + 0.5 * np.sin(x), 1 + 0.5 * np.cos(1.3 * y), 1 + 0.4 * np.sin(x + y)], axis=2)


def noise(rng):
    """Return what denoising leaves of noise: smooth, of a standard deviation of NOISE."""
    value = gaussian_filter(rng.normal(size=(HEIGHT, WIDTH, 3)), (3, 3, 0))
    return 1 + NOISE * value / value.std()


def view(seen, depth, surface, beams):
    layers = {"rgba": np.concatenate([surface + beams, np.ones((HEIGHT, WIDTH, 1))], axis=2), "surface": surface}
    layers |= {"beams": beams, "depth": depth[..., None]}
    return FilmView({name: each.astype(np.float32) for name, each in layers.items()}, *seen[:2])


def error(picture, truth):
    return float(np.sqrt(np.mean(((picture - truth)[INSIDE] / truth[INSIDE]) ** 2)))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("moves", [False, True])
def test_noise_falls_by_the_root_of_the_frames_and_the_light_stays(seed, moves):
    """The mean of five frames has 1/√5 = 0.45 of their noise; weights below 1 and interpolation leave it below 0.6.

    The wall and, at half its distance, the beams shift by different numbers of pixels.
    """
    rng = np.random.default_rng(seed)
    scale, angle = 10.0 ** rng.uniform(-2, 2), rng.uniform(-0.5, 0.5)
    step = scale * rng.uniform(-0.06, 0.06, 3) * moves
    frames, truths = [], []
    for number in range(5):
        seen = rays(number * step, number * step + [0, 0, -scale])
        depth, points = wall(seen, 4 * scale, angle)
        _, inside = wall(seen, 2 * scale, angle)
        truth = pattern(points, 0.3 * scale), pattern(inside, 0.5 * scale)
        truths.append(truth)
        frames.append(view(seen, depth, *(each * noise(rng) for each in truth)))
    layers = steadied(frames, OWN)
    for name, truth in zip(("surface", "beams"), truths[OWN], strict=True):
        before, after = error(frames[OWN].layers[name], truth), error(layers[name], truth)
        assert after < 0.6 * before, (name, before, after)
        assert abs(np.mean((layers[name] / truth)[INSIDE]) - 1) < 0.01
    np.testing.assert_allclose(layers["rgba"][..., :3], layers["surface"] + layers["beams"], rtol=1e-6)


def test_things_and_lights_that_move_leave_no_ghosts():
    """A bright ball crosses a still picture, and in one frame a lamp flashes: what was there before or after stays."""
    seen = rays(np.zeros(3), np.array([0.0, 0, -1]))
    depth, points = wall(seen, 4.0, 0.0)
    rows, columns = np.indices((HEIGHT, WIDTH))
    frames, truths = [], []
    for number in range(5):
        ball = np.hypot(rows - 45, columns - 40 - 15 * number) < 8
        light = pattern(points, 0.5) * (2.0 if number == 3 else 1.0)
        light[ball] = 5.0
        truths.append(light)
        frames.append(view(seen, np.where(ball, 2.0, depth), light, 0 * light))
    for own, truth in enumerate(truths):
        worst = np.abs(steadied(frames, own)["surface"] / truth - 1).max()
        assert worst < 0.01, (own, worst)


def test_light_that_rises_evenly_is_not_delayed():
    seen = rays(np.zeros(3), np.array([0.0, 0, -1]))
    depth, points = wall(seen, 4.0, 0.2)
    frames = [view(seen, depth, pattern(points, 0.5) * (1 + 0.03 * number), 0 * points) for number in range(5)]
    np.testing.assert_allclose(steadied(frames, OWN)["surface"], frames[OWN].layers["surface"], rtol=1e-5)


NAMES = {
    "photonbeams": ("R", "G", "B", "A", "Z"),
    "layers": ("surface.R", "surface.G", "surface.B", "surface.A", "depth.Z"),
    "Nuke": ("surface.red", "surface.green", "surface.blue", "surface.alpha", "depth.Z"),
    "small": ("r", "g", "b", "a", "z"),
}


def film_file(path, rng, names, channels=4):
    """Write a frame of a film whose `surface` has an alpha, too, and return its values by parts and letters."""
    header = View(Camera.look_at((0, 0, 3), (0, 0, 0), fov=50), Window.full(20, 12)).header()
    window = (np.array((0, 0), np.int32), np.array((19, 11), np.int32))
    shared = {"worldToCamera": header["worldToCamera"].astype(np.float32), "dataWindow": window,
              "worldToNDC": header["worldToNDC"].astype(np.float32), "displayWindow": window}  # fmt: skip
    parts, values = [], {}
    for layer, count in (("rgba", 4), ("surface", channels), ("beams", 3), ("depth", 1)):
        own = rng.uniform(1, 2, (count, 12, 20)).astype(np.float32)
        chosen = names[4:] if layer == "depth" else names[:count]
        values[layer] = own
        found = {name.replace("surface", layer): OpenEXR.Channel(name.replace("surface", layer), each, 1, 1)
                 for name, each in zip(chosen, own, strict=True)}  # fmt: skip
        parts.append(OpenEXR.Part({**shared, "type": OpenEXR.scanlineimage}, found, layer))
    OpenEXR.File(parts).write(str(path))
    return values


@pytest.mark.parametrize("names", NAMES)
def test_channels_keep_their_colours_whatever_they_are_called(tmp_path, rng, names):
    first, second = tmp_path / "a.exr", tmp_path / "b.exr"
    values = film_file(first, rng, NAMES[names])
    FilmFrame.read(first).averaged([], []).write(second)
    for own in OpenEXR.File(str(second), separate_channels=True).parts:
        layer = own.name()
        chosen = NAMES[names][4:] if layer == "depth" else NAMES[names][: len(values[layer])]
        for name, expected in zip(chosen, values[layer], strict=True):
            # Alone, a frame is its own mean; what it shows is the sum of its surfaces and beams.
            index = chosen.index(name)
            right = values["surface"][index] + values["beams"][index] if layer == "rgba" and index < 3 else expected
            found = own.channels[name.replace("surface", layer)].pixels
            np.testing.assert_allclose(found, right, rtol=1e-6, err_msg=f"{layer} {name}")


def test_a_layer_without_colours_is_told(tmp_path, rng):
    path = tmp_path / "grey.exr"
    film_file(path, rng, NAMES["photonbeams"], channels=1)
    with pytest.raises(SceneError, match="its layer surface has 1 channels: expected red, green and blue"):
        FilmFrame.read(path)
