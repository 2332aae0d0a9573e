"""Denoising removes noise and keeps what the passes agree on; layers still add up, and passes do not change."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, maximum_filter

from photonbeams import Shot, scene
from photonbeams.render.films import denoising
from photonbeams.render.films.denoising import check_denoiser, denoised
from photonbeams.render.films.frame_sums import FrameSums
from photonbeams.render.films.layers import develop
from photonbeams.render.films.sums import PassSums
from photonbeams.render.passes import PlannedPasses
from photonbeams.render.settings import Settings
from photonbeams.scene import SceneError
from photonbeams.shot import Stereo
from photonbeams.shot.development import developed
from tests.helpers.small_stage import CAMERA, FILL, FLOOR, FOG, KEY, write_stage

SHAPE = (64, 64)
GROUPS = {"key": "beams_key", "fill": "beams_fill"}
SMALL = {"width": 48, "height": 27, "beams": 64}


def summed(passes):
    """Return the sums of passes, each of which has the grey light of the surface and of two groups, (H, W)."""
    sums = PassSums()
    for number, (surface, key, fill) in enumerate(passes):
        layers = {"surface_default": surface, "beams_key": key, "beams_fill": fill}
        pictures = {"surface/": surface, "beams/key": key, "beams/fill": fill}
        pictures = {name: np.tile(each.reshape(1, -1), (3, 1)) for name, each in pictures.items()}
        for name, each in layers.items():
            pictures |= {f"light/{name}": each.reshape(-1), f"squares/{name}": each.reshape(-1) ** 2}
        guides = np.full((3, surface.size), 0.5)
        pictures |= {"alpha": np.full(surface.size, 0.25), "albedo": guides, "mean normal": guides}
        sums.add(number, {name: each.astype(np.float32) for name, each in pictures.items()})
    return sums


def layers_of(passes, **given):
    sums = summed(passes)
    noisy = develop(sums, SHAPE, GROUPS)
    return noisy, denoised(noisy, sums, GROUPS, **given)


def error(layer, truth):
    return np.sqrt(np.mean((layer[..., 0] - truth) ** 2))


def noisy_passes(rng, truth, count=8, spread=0.5):
    """Return passes whose pixels have independent errors."""
    return [tuple(truth * rng.gamma(spread**-2, spread**2, (3, *SHAPE))) for _ in range(count)]


@pytest.mark.parametrize("passes", [1, 2])
def test_lamps_that_are_seen_keep_their_light(passes):
    """The network made lamps green, and up to ten times as bright as anything around them."""
    color = (17593.0, 16714.0, 14954.0)
    lamps = [scene.SphereLight(f"/l{x}", color, center=np.array([x, 0.3, 0.0]), radius=0.05) for x in (-1, 0, 1)]
    floor = scene.Mesh(
        "/f", np.array([(-9, -3, -9), (9, -3, -9), (9, -3, 9), (-9, -3, 9)]), np.array([(0, 1, 2), (0, 2, 3)])
    )
    camera = scene.Camera.look_at((0, 1, 4), (0, 0.3, 0), fov=45)
    layers = Shot(scene.Scene(lights=lamps, meshes=[floor]), camera).render(
        passes=passes, width=96, denoise=True, keep_noisy=True
    ).layers  # fmt: skip
    found, noisy = layers["surface"], layers["noisy_surface"]
    seen = noisy.max(axis=2) > 500  # the floor has 5 at most: 1 % of that
    assert seen.sum() >= 12
    np.testing.assert_allclose(found[seen], noisy[seen], rtol=0.02)
    assert np.all(found <= maximum_filter(noisy, (15, 15, 1)) * (1 + 1e-5))
    assert not np.array_equal(found, noisy)


def test_an_interrupt_ends_the_network_before_it_is_done(rng):
    asked = []

    def interrupt():
        asked.append(1)
        if len(asked) == 3:
            raise KeyboardInterrupt

    passes = noisy_passes(rng, np.ones(SHAPE))
    with pytest.raises(KeyboardInterrupt):
        layers_of(passes, interrupt=interrupt)
    assert len(asked) == 3
    whole, again = layers_of(passes)[1], layers_of(passes, interrupt=lambda: asked.append(1))[1]
    assert len(asked) > 6 and all(np.array_equal(whole[name], again[name]) for name in whole)


def test_noise_of_single_pixels_goes(rng):
    truth = np.add.outer(np.linspace(0.2, 1, 64), np.linspace(0, 1, 64))
    noisy, result = layers_of(noisy_passes(rng, truth))
    for name in ("surface", *GROUPS.values()):
        # A mean over 5 × 5 pixels would leave a fifth of the noise.
        assert error(result[name], truth) < error(noisy[name], truth) / 4


@pytest.mark.parametrize("scale", [1e-30, 1e-15, 1e-8, 1.0, 1e12, 1e18])
def test_light_of_any_brightness_is_denoised_alike(rng, scale):
    truth = np.add.outer(np.linspace(0.2, 1, 64), np.linspace(0, 1, 64))
    passes = noisy_passes(rng, truth)
    usual = layers_of(passes)[1]
    noisy, result = layers_of([tuple(each * scale for each in lights) for lights in passes])
    for name in ("surface", *GROUPS.values()):
        expected = usual[name] if scale > 1e-19 else noisy[name] / scale  # squares of less light are 0
        assert np.allclose(result[name] / scale, expected, atol=1e-4)


def test_light_whose_squares_overflow_is_denoised_as_after_one_pass(rng):
    truth = 1e20 * np.add.outer(np.linspace(0.2, 1, 64), np.linspace(0, 1, 64))
    passes = noisy_passes(rng, truth)
    with np.errstate(over="ignore"):  # of the squares, in `summed`
        noisy, result = layers_of(passes)
    assert error(result["surface"], truth) < error(noisy["surface"], truth) / 4
    assert all(np.array_equal(result[name], noisy[name]) for name in GROUPS.values())
    assert np.array_equal(result["rgba"][..., :3], result["surface"] + result["beams"])


def test_what_the_passes_agree_on_stays(rng):
    texture = rng.random((3, *SHAPE))
    noisy, result = layers_of([tuple(texture)] * 4)
    # The variance of equal passes is rounding alone, about 1e-7, so hardly any of the network's change is applied.
    assert all(np.allclose(result[name], noisy[name], atol=1e-5) for name in noisy)


def test_a_pattern_that_looks_like_noise_is_kept_where_it_is_larger_than_the_passes_error(rng):
    texture = rng.uniform(0.2, 1, SHAPE)
    noisy, result = layers_of(noisy_passes(rng, texture, 16, 0.1))
    # The weight σ² / (σ² + b²) lowers the error; a mean over 225 pixels and 15 passes gives σ² to a few percent.
    for name in ("surface", *GROUPS.values()):
        assert error(result[name], texture) < 1.02 * error(noisy[name], texture)
    # The network by itself would take the texture for noise.
    guides = {"albedo": np.full((*SHAPE, 3), 0.5, np.float32)}
    assert error(denoising._filtered(noisy["surface"], guides), texture) > 3 * error(noisy["surface"], texture)


def test_noise_goes_where_the_network_is_a_little_too_dark_over_many_pixels(rng):
    noise, shade = 0.08 * rng.normal(size=(96, 96, 3)), 0.05 * np.sin(np.arange(96) / 10)[:, None, None]
    # Noise of one variance in each channel: that of their mean is a third of it.
    mixed = denoising._mixture(1 + noise, shade - noise, np.full((96, 96), 0.08**2 / 3), 0.0) - 1
    slow = gaussian_filter(mixed, (3, 3, 0))
    # The fine noise is all noise. Of slow light, 1/(4π 3²) of the variance is noise, less than a tenth of the shade's.
    assert np.std(mixed - slow) < 0.05 * 0.08
    assert np.std(slow) < 0.5 * np.std(shade)


def test_layers_add_up_and_alpha_is_as_it_was(rng):
    noisy, result = layers_of(noisy_passes(rng, np.ones(SHAPE)), keep_noisy=True)
    assert np.allclose(result["beams"], result["beams_key"] + result["beams_fill"], atol=1e-6)
    assert np.array_equal(result["rgba"][..., :3], result["surface"] + result["beams"])
    assert np.array_equal(result["rgba"][..., 3], noisy["rgba"][..., 3])
    for name in ("surface", "beams", *GROUPS.values()):
        assert np.array_equal(result[f"noisy_{name}"], noisy[name])
        assert not np.array_equal(result[name], noisy[name])


def test_of_one_pass_beams_stay_and_surfaces_are_the_networks(rng):
    noisy, result = layers_of(noisy_passes(rng, np.ones(SHAPE), 1))
    assert np.array_equal(result["beams"], noisy["beams"])
    assert error(result["surface"], 1) < error(noisy["surface"], 1) / 4


def test_black_stays_black(rng):
    noisy, result = layers_of([(np.zeros(SHAPE),) * 3] * 4)
    assert all(np.array_equal(result[name], noisy[name]) for name in noisy)


@pytest.fixture
def broken(monkeypatch):
    """Make the denoising library unavailable."""
    denoising._device.cache_clear()
    monkeypatch.setitem(sys.modules, "mitsuba_oidn", None)
    yield
    denoising._device.cache_clear()


def test_without_the_library_there_is_one_sentence_before_the_first_pass(broken, shot):
    expected = "cannot denoise because Open Image Denoise fails"
    with pytest.raises(SceneError, match=expected):
        check_denoiser()
    told = []
    with pytest.raises(SceneError, match=expected):
        shot.render(passes=1, denoise=True, progress=lambda *_: told.append(1), **SMALL)
    assert not told


def test_sums_of_other_passes_are_refused(rng):
    sums = summed(noisy_passes(rng, np.ones(SHAPE), 2))
    kept = PassSums.restored({name: each for name, each in sums.state().items() if "normal" not in name})
    with pytest.raises(SceneError, match="have no normals to denoise with"):
        denoised(develop(kept, SHAPE, GROUPS), kept, GROUPS)


def test_noisy_layers_are_of_denoised_pictures():
    with pytest.raises(SceneError, match="keep_noisy is True, but denoise is not"):
        Settings(keep_noisy=True)


# -- rendered --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    path = tmp_path_factory.mktemp("stage") / "stage.usda"
    return Shot.open(write_stage(path, FOG, CAMERA, KEY, FILL, FLOOR, metadata="startTimeCode = 1"))


def test_denoising_changes_no_pass_and_keeps_their_mean(shot):
    part = PlannedPasses(range(3), 3)
    plain, kept = (shot.render_part(part, denoise=wanted, **SMALL) for wanted in (False, True))
    own, more = plain.views[0].state(), kept.views[0].state()
    assert own.keys() < more.keys() and all(np.array_equal(own[name], more[name]) for name in own)
    names = {name.rpartition("/")[2] for name in own}
    assert not names & {"albedo", "mean normal"}  # they were not requested
    frame = shot.render(passes=3, denoise=True, keep_noisy=True, **SMALL)
    noisy = shot.render(passes=3, **SMALL)
    for name in ("surface", "beams", *GROUPS.values()):
        assert np.array_equal(frame.layers[f"noisy_{name}"], noisy.layers[name])
    assert np.array_equal(frame.layers["rgba"][..., 3], noisy.layers["rgba"][..., 3])


def test_passes_of_several_machines_are_denoised_as_of_one(shot, tmp_path):
    given = {"denoise": True, "albedo": True, **SMALL}
    sums = [shot.render_part(PlannedPasses(numbers, 4), **given) for numbers in (range(2, 4), range(2))]
    sums[0].save(tmp_path / "a.checkpoint")
    joined = FrameSums.load(tmp_path / "a.checkpoint")
    joined.join(sums[1])
    found, expected = developed(joined).layers, shot.render(passes=4, **given).layers
    assert found.keys() == expected.keys() and "albedo" in found
    assert all(np.array_equal(found[name], expected[name]) for name in expected)


def test_a_checkpoint_holds_noisy_sums_from_which_a_denoised_frame_goes_on(shot, tmp_path):
    path = tmp_path / "frame.checkpoint"
    plain = shot.render_part(PlannedPasses(range(2), 4), denoise=True, **SMALL)
    plain.save(path)
    resumed = shot.render(passes=4, denoise=True, checkpoint=path, **SMALL)
    whole = shot.render(passes=4, denoise=True, **SMALL)
    assert all(np.array_equal(resumed.layers[name], whole.layers[name]) for name in whole.layers)


def test_each_eye_is_denoised_by_itself(shot):
    two = Shot(shot.stage, stereo=Stereo(0.2, 5.0))
    both = two.render(passes=2, denoise=True, **SMALL)
    for eye in ("left", "right"):
        alone = two.render(passes=2, denoise=True, view=eye, **SMALL).layers
        assert all(np.array_equal(both.views[eye][0][name], alone[name]) for name in alone)


def test_threads_change_no_bit(set_threads, shot):
    found = []
    for threads in (1, 2):
        set_threads(threads)
        found.append(shot.render(passes=2, denoise=True, **SMALL).layers)
    assert all(np.array_equal(found[0][name], found[1][name]) for name in found[0])


def test_through_a_wide_pixel_filter_there_is_a_warning_and_the_noisy_picture_is_the_same(shot, caplog):
    given = {"passes": 2, "crop": (0.25, 0.2, 0.75, 0.8), "pixel_filter": "gaussian", **SMALL}
    frame = shot.render(denoise=True, keep_noisy=True, **given)
    assert [each.message for each in caplog.records] == [
        "denoise: the pixel filter gaussian makes noise alike in neighbouring pixels, and much stays: expected box"
    ]
    noisy = shot.render(**given)
    assert all(np.array_equal(frame.layers[f"noisy_{name}"], noisy.layers[name]) for name in ("surface", "beams"))


def test_without_a_named_filter_the_box_is_taken():
    assert Settings(denoise=True).filter_name == "box" and Settings().filter_name is None
    assert Settings(denoise=True, pixel_filter="tent").filter_name == "tent"


def test_settings_of_a_pass_know_nothing_of_what_is_kept():
    from photonbeams.render.settings import as_passes

    own = Settings(passes=3, denoise=True)
    assert as_passes(own) == as_passes(replace(own, keep_noisy=True, passes=9, error=0.1, time_limit=1.0))
    assert as_passes(own) != as_passes(replace(own, denoise=False))
