"""Numbers of samples of surfaces and of pixels at edges of beams; what integrators keep between renders."""

from itertools import product

import drjit as dr
import numpy as np
import pytest

from photonbeams.render import frame as frame_module
from photonbeams.render.costs import surface_samples
from photonbeams.render.pilots import sample_plan
from photonbeams.render.pilots.beam_noise import BeamCost, _coarse_rays, beam_cost, gathered
from photonbeams.render.pilots.pilot import Findings
from photonbeams.render.pilots.sample_plan import SamplePlan
from photonbeams.render.scene_frame import Extras, begin, render
from photonbeams.render.settings import Settings
from photonbeams.render.techniques import SeenLight
from photonbeams.runtime.device import mitsuba
from photonbeams.scene import SceneError
from photonbeams.transport.guiding.lines import LightLines
from photonbeams.world.cameras.cameras import Window
from photonbeams.world.parameters import Parameters
from tests.helpers.mitsuba_scenes import by_beams, camera, comparison, cube_of, fog, load, rgb

mi = mitsuba()
LAMP = {"type": "sphere", "center": [0, 3, 0], "radius": 0.5, "emitter": {"type": "area", "radiance": rgb(20.0)}}


def room(albedo, **film):
    """Return a room of fog with a large lamp in it, whose walls have this albedo."""
    turned = mi.ScalarTransform4f().translate([0, 0.9, 0]).rotate([1, 0, 0], 90).scale(0.5)
    walls = {
        **cube_of(fog(0.05)),
        "bsdf": {"type": "twosided", "side": {"type": "diffuse", "reflectance": rgb(albedo)}},
    }
    return load(
        lamp={"type": "rectangle", "to_world": turned, "emitter": {"type": "area", "radiance": rgb(5.0)}}, walls=walls,
        sensor=camera((0, 0, 0.9), fov=80, **{"width": 640, "height": 360, **film}),
    )  # fmt: skip


def test_passes_without_light_paths_look_once_and_others_as_often_as_their_beams_pay_for():
    assert surface_samples(0, 1000) == 1
    counts = [surface_samples(16384, pixels) for pixels in (16, 10_000, 100_000, 1_000_000, 100_000_000)]
    assert counts == sorted(counts, reverse=True) and counts[0] == 16 and counts[-1] >= 1
    assert all(each & (each - 1) == 0 for each in counts)
    assert surface_samples(1, 100_000_000) == 1


@pytest.mark.parametrize("value", [0, 3, 2048, 1.5])
def test_a_number_of_samples_is_a_power_of_two(value):
    with pytest.raises(SceneError, match="surface_samples"):
        Settings(surface_samples=value)


def test_more_samples_at_edges_leave_the_mean_and_take_the_noise_of_edges_away():
    """More samples remove the noise of edges, where fog behind the hole is forty times as bright as before the wall."""
    scene = comparison(48, 27)
    found = {}
    for each in (1, 8):
        once = {"passes": 1, "beams": 8192, "max_depth": 2, "surface_samples": each, "guiding": False}
        pictures = [render(scene, scene.sensors()[0], by_beams(seed=seed, **once)) for seed in range(12)]
        found[each] = np.array([picture.layers()["beams"].mean(axis=2) for picture in pictures])
    totals = {each: own.mean(axis=(1, 2)) for each, own in found.items()}
    error = np.hypot(*(each.std(ddof=1) / np.sqrt(len(each)) for each in totals.values()))
    assert abs(totals[1].mean() - totals[8].mean()) < 4 * error
    variance = {each: own.var(axis=0, ddof=1) for each, own in found.items()}
    edge = variance[1] > np.quantile(variance[1], 0.99)
    # Edges have five samples instead of one; beams themselves have noise, too.
    assert variance[8][edge].mean() < variance[1][edge].mean() / 3


def test_samples_of_surfaces_are_means_over_the_pixel():
    """Four passes of one sample and one pass of four give the same picture of a lamp before black."""
    scene = load(lamp=LAMP, sensor=camera(target=(0, 2, 0), size=12), dust=cube_of(fog(0.01)))
    one, four = (
        render(scene, scene.sensors()[0], by_beams(passes=passes, beams=64, max_depth=2, surface_samples=each)).layers()
        for passes, each in ((4, 1), (1, 4))
    )
    # Both use the same points of one sequence of samples.
    np.testing.assert_array_equal(one["rgba"][..., 3], four["rgba"][..., 3])
    np.testing.assert_allclose(one["surface"], four["surface"], rtol=1e-6)
    assert len(np.unique(four["rgba"][..., 3])) > 2


def plan(scene, **given):
    """Return the frame, if beams carry the light in fog, and its plan."""
    extras = Extras(findings=Findings(seen=SeenLight()))
    frame = begin(scene, scene.sensors()[0], Settings(max_depth=4, **given), extras=extras)
    return frame, frame._plan


def counts(scene, **given):
    """Return how many samples the blocks of the picture have."""
    frame, _ = plan(scene, **given)
    frame.add_pass(0)
    return frame._counts[0][0].blocks


def test_black_walls_have_few_samples_and_grainy_ones_many():
    """The light that walls send one another is grain of their samples; the light of fog is that of beams."""
    few, many = (counts(room(albedo)) for albedo in (0.0, 0.8))
    # The lamp itself has edges.
    assert few.mean() < 1.5 and np.median(few) == 1
    assert many.mean() > 3 and len(np.unique(many)) > 2


def test_a_plan_depends_on_neither_crop_nor_overscan_and_a_pass_on_no_other_pass():
    whole, _ = plan(room(0.8))
    part, _ = plan(room(0.8, crop_width=40, crop_height=24, crop_offset_x=99, crop_offset_y=177))
    for frame in (whole, part):
        frame.add_pass(1)
    np.testing.assert_array_equal(whole._counts[0][0].blocks, part._counts[0][0].blocks)
    layers, own = whole.layers(), part.layers()
    assert (own["surface"] > 0).any()
    inner = np.s_[4:-4, 4:-4]  # beyond the reach of the filter
    for name in ("surface", "beams"):
        np.testing.assert_allclose(own[name][inner], layers[name][177:201, 99:139][inner], rtol=1e-6)


def test_a_small_picture_asks_no_pilot():
    assert plan(room(0.8, width=64, height=36))[1].sample == 0
    assert plan(room(0.8), surface_samples=4)[1] == SamplePlan(4)


def test_plans_take_the_mean_of_no_block_away(monkeypatch):
    """Each block has the mean that equal numbers give it, and less noise where there is much."""
    scene = room(0.8, width=64, height=40)
    forced = SamplePlan(4, 2e5)
    monkeypatch.setattr(frame_module, "beam_cost", lambda *_: BeamCost(1e-6, 1e6))
    found = {}
    for own in (forced, SamplePlan(4)):
        monkeypatch.setattr(frame_module, "sample_plan", lambda *_, own=own: own)
        pictures = []
        for seed in range(12):
            frame, _ = plan(scene, seed=seed, beams=2048)
            frame.add_pass(0)
            pictures.append(frame.layers()["surface"].mean(axis=2).reshape(5, 8, 8, 8).mean(axis=(1, 3)))
            blocks = frame._counts[0][0].blocks
        found[own.sample == 0] = np.array(pictures)
        assert (len(np.unique(blocks)) > 1) == (own.sample > 0)
    means = [each.mean(axis=0) for each in found.values()]
    error = np.hypot(*(each.std(axis=0, ddof=1) / np.sqrt(len(each)) for each in found.values()))
    # The greatest of 40 differences, of 12 seeds each: 5 errors are exceeded twice in a thousand times.
    assert (abs(means[0] - means[1]) < 5 * error + 1e-7).all()


def test_halves_of_a_pass_tell_the_noise_of_its_beams():
    frame, _ = plan(room(0.8), beams=1024)
    rays = _coarse_rays(frame.light.cameras)
    passes = np.array([gathered(frame, frame.lit(number)[0], rays) for number in range(16)])
    between = np.sqrt(passes.var(axis=0, ddof=1)).mean() ** 2
    # Blocks of a Sobol sequence are stratified nearly as it is; a pass alone tells up to half or twice.
    told = np.mean([beam_cost(frame, frame.lit(number)[0], 1).noise for number in range(4)])
    assert 0.5 < told / between < 1.5


@pytest.mark.parametrize("seed", range(8))
def test_a_plan_is_as_good_as_the_best_of_all(seed):
    """Of all numbers of samples of six blocks, with the given mean, none has much less error at equal cost."""
    rng = np.random.default_rng(seed)
    noise, cost = 10.0 ** rng.uniform(-6, 0, 2)
    surfaces = 10.0 ** rng.uniform(-4, 1, 6)
    given = SamplePlan(8, 10.0 ** rng.uniform(2, 5))
    # Two samples that differ by √(2 S) have the variance S; a block has two cells across and two down.
    half = np.tile(np.repeat(np.sqrt(surfaces / 2), 2), (2, 1)).ravel()
    radiance = np.stack([10 - half, 10 + half])
    chosen = given.counts(BeamCost(noise, 1e4 * cost), radiance, np.ones_like(radiance), Window.full(48, 8)).blocks[0]
    smooth = np.maximum(surfaces, np.convolve(np.pad(surfaces, 1, mode="edge"), np.ones(3) / 3, mode="valid"))

    def spent(each):
        return np.sqrt(noise + smooth / each).mean(axis=-1) ** 2 * (1e4 * cost + np.mean(each, axis=-1) * given.sample)

    every = np.array(list(product([1, 2, 4, 8, 16, 32], repeat=6)))
    every = every[every.mean(axis=1) <= 8]
    # Plans are those of one weight for all blocks, in steps of a quarter, and 2 % are given for fewer samples.
    assert chosen.mean() <= 8 and spent(chosen) <= 1.15 * spent(every).min()


def test_blocks_around_an_edge_have_two_samples():
    """Behind an edge, fog may be a hundred times as bright: pixels are found whose samples differ in distance."""
    reach = np.ones((2, 10, 10))
    reach[:, :, :4] = 1.05  # a slanted surface is no edge
    reach[1, 3, 7] = 2.0
    radiance = np.full((2, 100), 0.5)
    found = SamplePlan(4, 1e5).counts(BeamCost(1.0, 1e6), radiance, reach.reshape(2, 100), Window.full(40, 40))
    expected = np.ones((5, 5))
    expected[0:3, 2:5] = 2
    assert found.blocks.tolist() == expected.tolist() and found.typical == 2
    assert sum(dr.width(each.pixels) * each.each for each in found.pieces(Window.full(40, 40))) == 1600 + 24 * 24


def test_a_black_picture_and_one_that_overflows_have_a_plan():
    reach = np.full((2, 4), np.inf, np.float32)
    for light in (0.0, np.inf, np.nan):
        radiance = np.full((2, 4), light, np.float32)
        found = SamplePlan(4, 1e5).counts(BeamCost(0.0, 1e6), radiance, reach, Window.full(7, 5))
        assert found.blocks.tolist() == [[1]]


def test_parameters_are_equal_until_one_is_set():
    scene = load(lamp=LAMP, sensor=camera(size=4))
    state = Parameters(scene, scene.sensors()[0])
    assert state == Parameters(scene, scene.sensors()[0])
    parameters = mi.traverse(scene)
    name = next(each for each in parameters.properties if "radiance" in each)
    parameters[name] = 2 * parameters[name]
    parameters.update()
    assert state != Parameters(scene, scene.sensors()[0])


def test_an_integrator_asks_its_pilot_once_while_nothing_changes(monkeypatch):
    asked, lit = [], LightLines.free
    monkeypatch.setattr(LightLines, "free", lambda *given: asked.append(1) or lit(*given))
    forward = {"type": "hg", "g": 0.5}  # rendering makes this number a variable
    sky = {"type": "constant", "radiance": rgb(0.1)}  # what is in its way is asked
    scene = load(lamp=LAMP, sky=sky, fog=cube_of(fog(0.5, phase=forward)), sensor=camera(size=4))
    integrator = mi.load_dict({"type": "photon_beams", "paths": 256, "max_depth": 3})
    pictures = [np.array(mi.render(scene, integrator=integrator, spp=1, seed=seed)) for seed in (0, 1, 0)]
    assert len(asked) == 1
    # What the integrator keeps does not change its pictures.
    np.testing.assert_array_equal(pictures[0], pictures[2])
    fresh = mi.load_dict({"type": "photon_beams", "paths": 256, "max_depth": 3})
    np.testing.assert_array_equal(np.array(mi.render(scene, integrator=fresh, spp=1, seed=1)), pictures[1])
    parameters = mi.traverse(scene)
    name = next(each for each in parameters.properties if "radiance" in each)
    parameters[name] = 2 * parameters[name]
    parameters.update()
    mi.render(scene, integrator=integrator, spp=1)
    assert len(asked) == 3


@pytest.mark.parametrize("seed", range(3))
def test_blocks_that_missed_light_that_is_rarely_found_have_samples_like_those_around_them(monkeypatch, seed):
    """One ray in fifty finds a bright stripe: of the blocks, each with 8 rays, most have found nothing."""
    rng = np.random.default_rng(seed)
    radiance = np.where(rng.uniform(size=(2, 60, 80)) < 0.02, 50.0, 0.0) + rng.uniform(0.9, 1.1, (2, 60, 80))
    window = Window.full(320, 240)
    given = SamplePlan(8, 1e5)
    found = given.counts(BeamCost(0.0, 1e6), radiance.reshape(2, -1), np.ones((2, 4800)), window).blocks
    assert (found >= 4).mean() > 0.98 and found.min() >= 2 and found.max() <= 16
    monkeypatch.setattr(sample_plan, "_PART", 0.0)
    patchy = given.counts(BeamCost(0.0, 1e6), radiance.reshape(2, -1), np.ones((2, 4800)), window).blocks
    assert (patchy == 1).mean() > 0.1
