"""The film of a view: pixel filters against NumPy and Mitsuba's filters, light groups, errors, saved state."""

import drjit as dr
import numpy as np
import pytest

from photonbeams.constants import FILTERS
from photonbeams.numerics.arrays import joined, opaque, taken, to_float, to_uint, to_vectors
from photonbeams.numerics.samples import Samples
from photonbeams.render.films.film import BeamSamples, Film, PassPicture, SeenSums
from photonbeams.render.films.pixel_filters import averaged, reconstruction_filter
from photonbeams.render.films.sample_layout import PixelSamples, SampleLayout, SamplePiece, parts
from photonbeams.render.films.sums import PassSums
from photonbeams.runtime.device import Array3f, Float, mitsuba
from photonbeams.scene import SceneError

mi = mitsuba()

HEIGHT, WIDTH = 11, 13
GROUPS = {"": "beams_default", "key": "beams_key", "off": "beams_off"}


def pixels(rng, passes, shape=(HEIGHT, WIDTH)):
    """Return the surface, two groups of beams, alpha, transmittance and depth of each pass, as NumPy arrays."""
    return [
        {name: rng.random((*shape, channels), dtype=np.float32)
         for name, channels in (("surface", 3), ("", 3), ("key", 3), ("alpha", 1), ("transmittance", 3), ("depth", 1))}
        for _ in range(passes)
    ]  # fmt: skip


def picture(one, crop=None):
    x0, y0, x1, y1 = crop or (0, 0, WIDTH, HEIGHT)
    part = {name: each[y0:y1, x0:x1].reshape(-1, each.shape[-1]) for name, each in one.items()}
    scattered = {"key": to_vectors(0.5 * part["key"])}
    surface = {"": to_vectors(0.75 * part["surface"]), "key": to_vectors(0.25 * part["surface"])}
    seen = PassPicture(surface, to_float(part["alpha"]), scattered, to_vectors(part["transmittance"]))
    return seen, {"key": to_vectors(0.5 * part["key"]), "": to_vectors(part[""])}, {"depth": to_float(part["depth"])}


def sums_of(film, parts, exposure=1.0):
    """Return the sums of pictures, which are given with the places of their samples."""
    count = film.shape[0] * film.shape[1]
    each = sum(dr.width(places) for _, places in parts) // count
    result = SeenSums(film, each, exposure)
    for seen, places in parts:
        piece = SamplePiece(None, each, range(dr.width(places) // count))
        result.add(
            seen, places, opaque(1 / each), SampleLayout.of(count, [piece]), PixelSamples.of(count, [piece]).pixel
        )
    return result


def add(result, number, whole, places, exposure=1.0):
    """Add a pass with one sample in each pixel."""
    seen, beams, first = whole
    seen = sums_of(result, [(seen, places)], exposure)
    result.add(number, seen, BeamSamples(beams, places), exposure, first if number == 0 else None)


def film(passes, name=None, crop=None, exposure=1.0, groups=GROUPS):
    x0, y0, x1, y1 = crop or (0, 0, WIDTH, HEIGHT)
    result = Film((y1 - y0, x1 - x0), (x0, y0), reconstruction_filter(name), groups)
    for number, one in enumerate(passes):
        add(result, number, picture(one, crop), result.places(Samples(0, number)), opaque(exposure))
    return result


def by_passes(values, name):
    """Return the filtered light of beams: each pass is filtered by itself, unless the filter has negative lobes."""
    if name in ("mitchell", "catmullrom", "lanczos"):
        return of_mitsuba(values, name)
    return np.mean([of_mitsuba([value], name, first=number) for number, value in enumerate(values)], axis=0)


def of_mitsuba(values, name, shares=None, first=0):
    """Return the mean of the samples around each pixel, weighted one by one by Mitsuba's own filter, in float64.

    `first` is the number of the first pass.
    """
    plugin = mi.load_dict({"type": name})
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    total, weights = np.zeros(values[0].shape), np.zeros((HEIGHT, WIDTH, 1))
    for number, value in enumerate(values):
        across, down = Film((HEIGHT, WIDTH)).places(Samples(0, first + number)).numpy().reshape(2, HEIGHT, WIDTH)
        for row in range(HEIGHT):
            for column in range(WIDTH):
                far = [column + across[row, column] - x - 0.5, row + down[row, column] - y - 0.5]
                w = np.prod([plugin.eval(to_float(each)).numpy().reshape(HEIGHT, WIDTH) for each in far], axis=0)
                w = np.where(np.max(np.abs(far), axis=0) < plugin.radius(), w, 0)[..., None].astype(np.float64)
                w = w if shares is None else w * shares[number, row, column]
                total, weights = total + w * value[row, column], weights + w
    return total / weights


@pytest.mark.parametrize("name", FILTERS[1:])
def test_a_pixel_is_the_weighted_mean_of_the_samples_around_it(rng, name):
    passes = pixels(rng, 3)
    layers = film(passes, name).layers()
    for layer, own in (("surface", "surface"), ("transmittance", "transmittance")):
        expected = of_mitsuba([each[own] for each in passes], name)
        # float32 sums of some dozens of numbers below 1; with negative lobes, corners divide by weights of 1/3.
        np.testing.assert_allclose(layers[layer], expected, atol=1e-5)
    lights = [each["key"] for each in passes]  # half of it by beams, half by camera paths
    expected = 0.5 * (by_passes(lights, name) + of_mitsuba(lights, name))
    np.testing.assert_allclose(layers["beams_key"], expected, atol=1e-5)
    np.testing.assert_allclose(layers["rgba"][..., 3:], of_mitsuba([each["alpha"] for each in passes], name), atol=1e-5)


@pytest.mark.parametrize("name", [None, "box"])
def test_the_box_is_the_plain_mean_and_layers_add_up(rng, name):
    passes = pixels(rng, 3)
    layers = film(passes, name, exposure=2.0).layers()
    mean = {own: np.mean([each[own] for each in passes], axis=0) for own in passes[0]}
    assert list(layers) == [
        "rgba", "surface", "beams", "beams_default", "beams_key", "beams_off", "surface_default", "surface_key",
        "surface_off", "transmittance", "depth",
    ]  # fmt: skip
    np.testing.assert_allclose(layers["surface"], 2 * mean["surface"], rtol=1e-6)
    np.testing.assert_allclose(layers["beams_key"], 2 * mean["key"], rtol=1e-6)
    np.testing.assert_allclose(layers["transmittance"], mean["transmittance"], rtol=1e-6)
    np.testing.assert_allclose(layers["rgba"][..., 3:], mean["alpha"], rtol=1e-6)
    assert np.array_equal(layers["beams"], layers["beams_default"] + layers["beams_key"])
    assert np.array_equal(layers["surface"], layers["surface_default"] + layers["surface_key"])
    np.testing.assert_allclose(layers["surface_key"], 0.5 * mean["surface"], rtol=1e-6)
    assert np.array_equal(layers["rgba"][..., :3], layers["surface"] + layers["beams"])
    assert np.array_equal(layers["depth"], passes[0]["depth"])  # of the first pass
    assert not layers["beams_off"].any() and not layers["surface_off"].any()


@pytest.mark.parametrize("name", ["box", "mitchell"])
def test_samples_of_surfaces_and_of_edges_count_as_their_shares_say(rng, name):
    """Pixels are means of four samples of surfaces, added in parts, and at edges of five samples of beams."""
    passes, count = pixels(rng, 5), HEIGHT * WIDTH
    whole = Film((HEIGHT, WIDTH), (0, 0), reconstruction_filter(name))
    seen, beams = zip(*(picture(each)[:2] for each in passes), strict=True)
    places = [whole.places(Samples(0, number)) for number in range(5)]
    both = {group: joined([each.surface[group] for each in seen[:2]]) for group in seen[0].surface}
    two = PassPicture(both, joined([each.alpha for each in seen[:2]]))
    parts = [(two, joined(places[:2])), *((PassPicture(each.surface, each.alpha), place)
             for each, place in zip(seen[2:4], places[2:4], strict=True))]  # fmt: skip
    edge = rng.random(count) < 0.5
    share = np.concatenate([np.where(edge, 0.2, 1.0), *[np.where(edge, 0.2, 0.0)] * 4])
    light = joined([each[""] for each in beams]) * to_float(share)
    layout = SampleLayout.of(count, [SamplePiece(None, 5, range(5))])
    whole.add(0, sums_of(whole, parts), BeamSamples({"": light}, joined(places), to_float(share), layout))
    layers = whole.layers()
    expected = of_mitsuba([each["surface"] for each in passes[:4]], name)
    np.testing.assert_allclose(layers["surface"], expected, atol=1e-5)
    shares = share.reshape(5, HEIGHT, WIDTH, 1)
    expected = of_mitsuba([each[""] for each in passes], name, shares)
    np.testing.assert_allclose(layers["beams"], expected, atol=1e-5)


@pytest.mark.parametrize("name", ["box", "mitchell"])
@pytest.mark.parametrize("most", [40, 200, 2000])
def test_pixels_may_have_different_numbers_of_samples(rng, name, most):
    """Each sample has the weight 1 / n in its pixel, however many samples are followed at once."""
    count, each = HEIGHT * WIDTH, rng.choice([1, 2, 8], HEIGHT * WIDTH, p=[0.2, 0.7, 0.1])
    values = rng.random((8, HEIGHT, WIDTH, 3), dtype=np.float32)
    whole = Film((HEIGHT, WIDTH), (0, 0), reconstruction_filter(name))
    places = joined([whole.places(Samples(0, number)) for number in range(8)])
    seen = SeenSums(whole, 1)
    pieces = [SamplePiece(to_uint(np.flatnonzero(each == own)), own, range(own)) for own in (1, 2, 8)]
    for part in parts(pieces, count, most):
        lanes = PixelSamples.of(count, part)
        number = lanes.sample * count + lanes.pixel
        surface, reach = taken(to_vectors(values.reshape(-1, 3)), number), Float(lanes.sample) + 1
        picture = PassPicture({"": surface}, dr.ones(Float, dr.width(number)), reach=reach)
        share = dr.rcp(Float(lanes.each))
        seen.add(picture, taken(places, number), share, SampleLayout.of(count, part), lanes.pixel)
    assert seen.farthest.numpy().tolist() == each.tolist() and not (seen.nearest.numpy() != 1).any()
    whole.add(0, seen, BeamSamples({}, whole.centers()))
    shares = np.where(np.arange(8)[:, None] < each, 1 / each, 0).reshape(8, HEIGHT, WIDTH, 1)
    np.testing.assert_allclose(whole.layers()["surface"], of_mitsuba(values, name, shares), atol=1e-5)


def test_a_film_without_groups_has_no_layers_of_them(rng):
    layers = film(pixels(rng, 1), groups={}).layers()
    assert list(layers) == ["rgba", "surface", "beams", "transmittance", "depth"]


def places(seed, passes, crop=(0, 0, 32, 32)):
    """Return the places of samples in their pixels, (passes, H, W, 2)."""
    x0, y0, x1, y1 = crop
    own = Film((y1 - y0, x1 - x0), (x0, y0))
    found = [own.places(Samples(seed, number, 4)).numpy() for number in range(passes)]
    return np.array(found).reshape(passes, 2, y1 - y0, x1 - x0).transpose(0, 2, 3, 1)


def test_samples_fill_each_pixel_over_the_passes_and_over_the_seeds():
    found = places(3, 16)
    for across, down in ((4, 4), (16, 1), (1, 16)):  # sixteen passes have one sample in each cell of every grid
        cell = np.floor(found * [across, down]) @ [1, across]
        assert (np.sort(cell, axis=0) == np.arange(16)[:, None, None]).all()
    other = places(4, 16)
    # Within a pass, places differ between pixels, and so do their shifts between seeds; both are uniform: σ = 0.289.
    for values in (found[0].reshape(-1, 2), (found[0] - other[0]).reshape(-1, 2) % 1.0):
        assert len(np.unique(values, axis=0)) > 1000
        assert values.std(axis=0) == pytest.approx([12**-0.5] * 2, rel=5 / np.sqrt(1024))
    assert np.array_equal(places(3, 2, (5, 3, 20, 30)), found[:2, 3:30, 5:20])


@pytest.mark.parametrize(("name", "reach"), [("box", 0), ("gaussian", 2), ("lanczos", 3)])
def test_a_crop_is_the_part_of_the_whole_where_the_filter_is_inside(rng, name, reach):
    passes, crop = pixels(rng, 3), (2, 1, 12, 10)
    whole, part = film(passes, name), film(passes, name, crop)
    order = whole.order.numpy().reshape(HEIGHT, WIDTH)
    assert np.array_equal(part.order.numpy().reshape(9, 10), order[1:10, 2:12])
    for layer, found in part.layers().items():
        inner = found[reach : 9 - reach, reach : 10 - reach]
        expected = whole.layers()[layer][1 + reach : 10 - reach, 2 + reach : 12 - reach]
        assert inner.size and np.array_equal(inner, expected)


@pytest.mark.parametrize("name", ["box", "mitchell"])
def test_a_film_goes_on_from_the_state_of_another(rng, name):
    passes = pixels(rng, 4)
    whole, first = film(passes, name), film(passes[:2], name)
    resumed = Film((HEIGHT, WIDTH), (0, 0), reconstruction_filter(name), GROUPS)
    resumed.restore(PassSums.restored(first.sums.state()))
    for number in (2, 3):
        add(resumed, number, picture(passes[number]), resumed.places(Samples(0, number)), opaque(1.0))
    assert all(np.array_equal(each, resumed.layers()[layer]) for layer, each in whole.layers().items())
    assert resumed.error() == whole.error()


@pytest.mark.parametrize(
    ("name", "shape"), [("box", (HEIGHT, WIDTH + 1)), ("mitchell", (HEIGHT, WIDTH)), ("box", (1, 3 * HEIGHT * WIDTH))]
)
def test_a_state_of_another_picture_is_refused(rng, name, shape):
    sums = film(pixels(rng, 1)).sums
    with pytest.raises(SceneError, match="the checkpoint is of another picture"):
        Film(shape, (0, 0), reconstruction_filter(name)).restore(sums)


def test_the_error_is_that_of_the_mean_of_independent_passes(rng):
    count, passes = 64, 32
    samples = [rng.exponential(1.0, (count, count, 1)).astype(np.float32) for _ in range(passes)]
    result = Film((count, count))
    for number, each in enumerate(samples):
        grey = to_vectors(np.repeat(each.reshape(-1, 1), 3, axis=1))
        assert np.isnan(result.error()) == (number < 2)
        seen = PassPicture({"": grey}, to_float(np.ones(count * count)))
        result.add(number, sums_of(result, [(seen, result.centers())]), BeamSamples({}, result.centers()))
    values = np.array(samples)
    mean = values.mean(axis=0)
    relative = (values.std(axis=0, ddof=1) / np.sqrt(passes) / mean).ravel()
    # The mean over the middle half of the light is the integral of its quantiles.
    levels = np.linspace(0.25, 0.75, 20001)
    expected = np.quantile(relative, levels, method="inverted_cdf", weights=mean.ravel()).mean()
    assert result.error() == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("name", ["box", "gaussian", "lanczos"])
def test_all_passes_have_the_kernels_of_the_first(rng, name):
    passes = pixels(rng, 6, (8, 8))
    result = Film((8, 8), (0, 0), reconstruction_filter(name))
    new = []
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for number, one in enumerate(passes):
            seen, beams, first = whole = picture(one, (0, 0, 8, 8))
            dr.eval(seen.surface, seen.alpha, seen.transmittance, seen.scattered, beams, first)
            dr.kernel_history_clear()
            add(result, number, whole, result.places(Samples(0, number)), opaque(1.0))
            kernels = {each["hash"] for each in dr.kernel_history() if each["type"].name == "JIT"}
            new.append(kernels)
    assert all(each <= new[0] for each in new[1:])


@pytest.mark.parametrize(
    ("name", "expected"),
    # For a tent, ∫f² is 2/3; for a Gaussian of σ = 0.5, (∫f)² / ∫f² is 2 σ √π, less a little for its cut at 4 σ.
    [("box", 1.0), ("tent", 1.5**2), ("gaussian", np.pi)],
)
def test_a_filter_averages_as_many_pixels_as_it_lowers_independent_noise(name, expected):
    assert averaged(reconstruction_filter(name)) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("name", ["tent", "gaussian"])
def test_even_light_of_one_pass_is_even(name):
    result, count = Film((HEIGHT, WIDTH), (0, 0), reconstruction_filter(name)), HEIGHT * WIDTH
    black = PassPicture({"": dr.zeros(Array3f, count)}, dr.zeros(Float, count))
    for number, light in enumerate((0.0, 1.0)):
        places = result.places(Samples(0, number))
        result.add(
            number, sums_of(result, [(black, places)]), BeamSamples({"": dr.full(Array3f, light, count)}, places)
        )
    np.testing.assert_allclose(result.layers()["beams"], 0.5, rtol=1e-6)
