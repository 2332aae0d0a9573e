"""Deep pictures of beams: flattened they are the layer, and at any depth they show what a holdout there shows.

OpenImageIO reads, merges and flattens the files.
"""

import numpy as np
import OpenImageIO
import pytest

import photonbeams as pb
from photonbeams import scene
from tests.helpers.comparison import quad

WIDTH, HEIGHT = 40, 24
PLACE = np.array([310.0, -45.0, 820.0])  # where the camera is: far from the origin


def shot(**fog):
    """Return a shot of three crossing shafts in fog, and a slanted wall, seen from inside the fog."""
    starts = np.array([[-3, 1, -3.0], [2, -3, -7], [-1, 3, -14]]) + PLACE
    ends = np.array([[3, 0, -6.0], [-2, 3, -5], [4, -2, -11]]) + PLACE
    radii = np.array([0.2, 0.4, 0.8])
    power = np.array([[4, 2, 1], [1, 4, 2], [3, 3, 9.0]])
    drawn = scene.DrawnBeams("/beams", starts, ends, radii, radii, power)
    wall = quad("/wall", [PLACE + each for each in ([-9, -6, -6], [9, -6, -20], [9, 6, -20], [-9, 6, -6])])
    content = scene.Scene((wall,), (), (drawn,), (scene.Medium(**fog),))
    matrix = np.eye(4)
    matrix[:3, 3] = PLACE
    camera = scene.Camera("/c", to_world=matrix, focal_length=1.0, horizontal_aperture=1.0, vertical_aperture=0.6)
    return pb.Shot(content, camera)


def flattened(image):
    return OpenImageIO.ImageBufAlgo.flatten(image).get_pixels(OpenImageIO.FLOAT)


def card(like, depth):
    """Return a deep picture of an opaque, black card at a depth."""
    spec = OpenImageIO.ImageSpec(like.spec())
    result = OpenImageIO.ImageBuf(spec)
    for y, x in np.ndindex(HEIGHT, WIDTH):
        result.set_deep_samples(x, y, 0, 1)
        for name, value in (("A", 1.0), ("Z", depth), ("ZBack", depth)):
            result.set_deep_value(x, y, 0, spec.channelindex(name), 0, value)
    return result


@pytest.mark.parametrize("fog", [{"scattering": 0.05}, {"scattering": (0.02, 0.05, 0.1), "surfaces": False}])
def test_flattened_it_is_the_layer_and_merged_with_a_card_it_is_a_holdout(tmp_path, fog):
    own = shot(**fog)
    frame = own.render(passes=16, width=WIDTH, height=HEIGHT, deep=True)
    frame.write_deep(tmp_path / "deep.exr")
    deep, beams = OpenImageIO.ImageBuf(str(tmp_path / "deep.exr")), frame.layers["beams"]
    assert deep.spec().deep and [*deep.spec().channelnames] == ["R", "G", "B", "A", "Z", "ZBack"]
    flat = flattened(deep)
    assert np.allclose(flat[..., :3], beams, rtol=5e-3, atol=5e-4 * beams.max())  # halves have 11 bits
    if "surfaces" in fog:
        assert not flat[..., 3].any()
    else:  # one pass has one of the places in a pixel, whose distances differ, while the layer is their mean
        wall = np.isfinite(frame.layers["depth"][:, :-3, 0]).all(axis=0)
        clear = frame.layers["transmittance"].mean(axis=2)[:, :-3][:, wall]
        assert clear.size > 500 and np.allclose(1 - flat[:, :-3, 3][:, wall], clear, atol=0.02)
    for depth in (4.2, 5.7, 12.0):
        wanted = own.render(
            passes=16, width=WIDTH, height=HEIGHT, holdout=np.minimum(frame.layers["depth"][..., 0], depth)
        ).layers["beams"]
        found = flattened(OpenImageIO.ImageBufAlgo.deep_merge(deep, card(deep, depth)))[..., :3]
        assert 0.02 < wanted.sum() / beams.sum() < 0.98
        # The card cuts one sample of a pixel, whose light is not known better; a pixel's edges are known from two rays.
        error, bound = np.abs(found - wanted).sum(axis=2), brightest(frame.deep[""])
        lit = beams.sum(axis=2) > 0.01 * beams.sum(axis=2).max()
        assert np.mean(error[lit] <= (bound + 0.1 * beams.sum(axis=2))[lit]) > 0.98
        assert error.sum() / beams.sum() < 0.03


def brightest(deep):
    """Return the light of the brightest sample of each pixel, as it is seen."""
    result, ends = np.zeros(deep.counts.size), np.cumsum(deep.counts.ravel())
    for pixel, (end, count) in enumerate(zip(ends, deep.counts.ravel(), strict=True)):
        sample = deep.color[end - count : end].astype(np.float64)
        clear = np.cumprod(np.concatenate([[1], 1 - sample[:-1, 3]])) if count else np.zeros(0)
        result[pixel] = max((clear * sample[:, :3].sum(axis=1)).tolist(), default=0)
    return result.reshape(deep.counts.shape)


def test_light_in_a_mirror_is_at_the_mirror(tmp_path):
    """Light behind the camera is seen in a mirror, and in the deep picture it is where the mirror is."""
    drawn = scene.DrawnBeams(
        "/b", np.array([[-3.0, 0.2, 2.0]]), np.array([[3.0, -0.2, 2.0]]), np.full(1, 0.3), np.full(1, 0.3),
        np.full((1, 3), 5.0),
    )  # fmt: skip
    mirror = scene.Material(diffuse=(1.0, 1.0, 1.0), metallic=1.0, roughness=0.0)
    plane = quad("/mirror", [[-9, -9, -3], [9, -9, -3], [9, 9, -3], [-9, 9, -3]], material=mirror)
    camera = scene.Camera("/c", to_world=np.eye(4), focal_length=1.0, horizontal_aperture=1.0, vertical_aperture=0.6)
    content = scene.Scene((plane,), (), (drawn,), (scene.Medium(scattering=0.05),))
    frame = pb.Shot(content, camera).render(passes=1, width=WIDTH, height=HEIGHT, deep=True, max_depth=4)
    deep, beams = frame.deep[""], frame.layers["beams"]
    assert beams.max() > 0.01
    assert np.allclose(deep.flat()[..., :3], beams, rtol=1e-4, atol=1e-6)
    there = np.isclose(deep.front, 3, rtol=1e-4) & np.isclose(deep.back, 3, rtol=1e-4)
    # Where only other rays of a pixel see the beam, at its rim, it is not known where its light comes from.
    assert deep.color[~there, 0].sum() < 0.03 * deep.color[:, 0].sum()
