"""Light paths: photon differentials against finite differences of whole paths, and conservation of energy."""

from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

from photonbeams.numerics.sampling import pairs
from photonbeams.runtime.device import Array3f, Float, UInt32, mitsuba
from photonbeams.transport import paths
from photonbeams.world.media.interfaces import number
from photonbeams.world.media.media import Media
from photonbeams.world.plugin import world_of_plugin
from tests.helpers.mitsuba_scenes import T, cube_of, fog, load, rgb
from tests.helpers.tracing import emission_of

mi = mitsuba()
COUNT, OVERLAP = 4096, 2.0
SPOT = {"type": "spot", "to_world": T().look_at([-2.5, 1.5, 0.3], [0, 0, 0], [0, 1, 0]), "intensity": rgb(20.0),
        "cutoff_angle": 14.0, "beam_width": 14.0}  # fmt: skip


def ball_in_fog(light=SPOT, **ball):
    medium = mi.load_dict(fog(1e-3, 0.0))
    glass = {"type": "sphere", "radius": 0.8, "bsdf": {"type": "dielectric", "int_ior": 1.5}, **ball}
    scene = load(ball={**glass, "exterior": medium}, light=light)
    return scene, medium


def tracing(scene, medium, **given):
    """Return the tracing of light paths in a scene whose space a medium fills."""
    world = replace(world_of_plugin(scene), media=Media([medium]))
    plain = {"max_bounces": None, "rr_depth": 5, "overlap": OVERLAP, "region": 1.0, "paths": [COUNT], "power": [1.0]}
    return paths.Tracing(world, **{**plain, **given})


def emitted(scene, medium, count):
    """Return light paths that begin in a medium."""
    found = emission_of(world_of_plugin(scene), count).emit(0)
    wide = dr.zeros(UInt32, count)
    return [replace(each, medium=dr.opaque(UInt32, number(medium)) + wide) for each in found]


def steps(tracing, begun, limit=12):
    """Return the results of the steps of light paths, a list of (segments, photons on surfaces)."""
    found = []
    for each in paths.trace(tracing, paths.begin(tracing, begun)):
        found.append(each)
        if len(found) == limit:
            break
    return found


def shifted(scene, medium, k, step):
    """Return the light paths with number `k` of their emission samples increased by `step`."""
    (own,) = emitted(scene, medium, COUNT)
    (stratum,) = emission_of(world_of_plugin(scene), COUNT).strata
    numbers = stratum.points(0).T.copy()
    numbers[k] += step
    rays = stratum.emitter.lamp.emit(*pairs(numbers.T), stratum.emitter.bounds)
    nothing = dr.zeros(Array3f, COUNT)
    return [replace(own, origin=rays.origin + nothing, direction=rays.direction + nothing)]


SPHERE_LIGHT = {"type": "sphere", "center": [-2.5, 1.5, 0.3], "radius": 0.3,
                "emitter": {"type": "area", "radiance": rgb(1.0)}}  # fmt: skip


@pytest.mark.parametrize("light", [SPOT, SPHERE_LIGHT], ids=["spot", "sphere"])
@pytest.mark.parametrize("seen_in", [0, 2], ids=["straight", "through glass"])
def test_widths_follow_neighbours(light, seen_in):
    """The squared width is (overlap / 2)² times the mean squared distance to neighbours, one cell away on each side."""
    scene, medium = ball_in_fog(light)
    trace, step = tracing(scene, medium), 2e-4
    base = steps(trace, emitted(scene, medium, COUNT))[seen_in][0]
    own, direction = base.number.numpy(), base.direction.numpy()
    at = 1.5  # a distance along the segments
    spreads = np.zeros((4, len(own)))
    known = np.full(len(own), True)
    for k in range(4):
        ends = []
        for sign in (1, -1):
            other = steps(trace, shifted(scene, medium, k, sign * step))[seen_in][0]
            place = np.full((3, COUNT), np.nan)
            place[:, other.number.numpy()] = (other.origin + at * other.direction).numpy()
            ends.append(place[:, own])
        change = (ends[0] - ends[1]) / (2 * step)
        known &= np.isfinite(change).all(axis=0) & (np.abs(change).max(axis=0) < 100)  # not over an edge
        spreads[k] = (change**2).sum(axis=0) - (change * direction).sum(axis=0) ** 2
    place, aim = spreads[:2].sum(axis=0) / 2, spreads[2:].sum(axis=0) / 2
    # Each pair of numbers gets cells according to how far it moves the segment's ends; `cells` has all possible splits.
    found = np.square(base.width(at).numpy()) / np.square(OVERLAP / 2)
    cells = np.logspace(0, np.log10(COUNT), 400)[:, None]
    best = np.abs(np.log((place / cells + aim * cells / COUNT) / found)).min(axis=0)
    assert known.sum() > 30
    # Errors of differences over 2 · 2e-4 are rounding, 1e-6 / 4e-4, and curvature; that of the grid of splits is 1.4 %.
    # Light straight from its lamp has a width that is linear in the distance, which bends away from the lines by more.
    assert np.median(best[known]) < (0.01 if seen_in else 0.1)
    assert np.quantile(best[known], 0.9) < 0.1


def test_a_lens_has_its_focus_where_rays_meet():
    """Rays along the axis of a glass ball meet at n R / (2 (n − 1)) from its centre, which is 1.5 radii for n = 1.5."""
    light = {"type": "directionalarea", "radiance": rgb(1.0)}
    lamp = {"type": "disk", "to_world": T().translate([0, 0, -3]).scale(0.04), "emitter": light}
    scene, medium = ball_in_fog(lamp)
    segments = steps(tracing(scene, medium), emitted(scene, medium, 1024))[2][0]
    behind = segments.direction.numpy()[2] > 0.9
    focus = (segments.origin + segments.width.knot * segments.direction).numpy()[2][behind]
    assert behind.sum() > 500
    # Rays are up to 5 % of the radius from the axis: third-order aberration is of the order of the square of that.
    np.testing.assert_allclose(focus, 1.5 * 0.8, rtol=0.01)


def test_white_fog_neither_makes_nor_loses_light():
    """All emitted light leaves a fog that absorbs nothing."""
    medium = mi.load_dict(fog([0.5, 1.0, 2.0], 1.0))
    scene = load(cube=cube_of(medium), light={"type": "point", "intensity": rgb([1.0, 2.0, 3.0])})
    trace = tracing(scene, medium, rr_depth=3)
    begun = paths.begin(trace, emitted(scene, medium, 1 << 14))
    entered, left = np.zeros(3), np.zeros(3)
    for segments, _ in paths.trace(trace, begun):
        if segments is not None:
            flux, length = segments.flux.numpy(), segments.length.numpy()
            left += (flux * np.exp(-np.array([[0.5], [1.0], [2.0]]) * length)).sum(axis=1)
            entered = np.maximum(entered, flux.sum(axis=1))
    # Long beams of all orders estimate the light that leaves; with 16,384 paths, channels spread by less than 2 %.
    np.testing.assert_allclose(left, 4 * np.pi * np.array([1.0, 2.0, 3.0]), rtol=0.04)
    np.testing.assert_allclose(entered, 4 * np.pi * np.array([1.0, 2.0, 3.0]), rtol=1e-4)


def test_no_path_through_thick_white_fog_outshines_the_others():
    """In white fog ten free paths deep, each path keeps its emitted flux over about a hundred collisions."""
    medium = mi.load_dict(fog(10.0, 1.0))
    scene = load(cube=cube_of(medium), light={"type": "point"})
    found = steps(tracing(scene, medium), emitted(scene, medium, 512), 200)
    depths, fluxes = (
        np.concatenate([each.numpy() for each in kind])
        for kind in zip(*((left.depth, left.flux.x) for left, _ in found if left is not None), strict=True)
    )
    assert depths.max() > 40
    # After 256 bounces, paths end at random, and the survivors carry the flux of the others.
    assert fluxes[depths < 256].max() == pytest.approx(4 * np.pi / 512, rel=1e-4)


def test_the_last_paths_leave_the_same_light_in_one_kernel_as_step_by_step(monkeypatch):
    """Beams and photons around a ball in thick fog have the same fluxes, positions and depths, in the same order."""
    medium = mi.load_dict(fog(3.0, 0.99))
    ball = {
        "type": "sphere",
        "radius": 0.5,
        "center": [0.8, 0, 0],
        "bsdf": {"type": "diffuse", "reflectance": rgb(0.9)},
    }
    scene = load(cube=cube_of(medium), ball={**ball, "exterior": medium}, light={"type": "point"})
    trace = tracing(scene, medium)

    def lit():
        result = [[], []]
        for left in steps(trace, emitted(scene, medium, 512), 300):
            for kind, each in zip(result, left, strict=True):
                if each is not None:
                    place = each.origin if hasattr(each, "origin") else each.position
                    rows = np.concatenate([each.flux.numpy(), place.numpy(), each.depth.numpy()[None]])
                    kind.append(rows[:, rows[0] > 0])  # a single entry has a second one without flux
        return [np.concatenate(kind, axis=1) for kind in result]

    together = lit()
    assert together[0][-1].max() > 30  # beyond the steps that are always taken one by one
    monkeypatch.setattr(paths, "_LAST", 0)
    for a, b in zip(together, lit(), strict=True):
        assert a.shape == b.shape
        # Another kernel rounds differently, and each bounce amplifies the error of a direction, so a few paths drift.
        same = np.isclose(a, b, rtol=1e-3, atol=1e-4).all(axis=0)
        assert same.mean() > 0.99


def test_short_beams_end_where_light_is_scattered():
    medium = mi.load_dict(fog(2.0, 0.5))
    scene = load(light={"type": "point"}, far={"type": "sphere", "radius": 100})
    trace = tracing(scene, medium, short=True)
    segments = steps(trace, emitted(scene, medium, 1 << 13), 1)[0][0]
    # Lengths are exponentially distributed: their mean and standard deviation are 1/2.
    lengths = segments.length.numpy()
    assert lengths.mean() == pytest.approx(0.5, abs=4 * 0.5 / 2**6.5)
    assert lengths.std() == pytest.approx(0.5, rel=0.1)


def test_paths_end_after_so_many_events():
    medium = mi.load_dict(fog(2.0, 1.0))
    scene = load(cube=cube_of(medium), light={"type": "point"})
    for most in (0, 2):
        found = steps(tracing(scene, medium, max_bounces=most), emitted(scene, medium, 1024))
        depth = np.concatenate([each.depth.numpy() for each, _ in found if each is not None])
        assert depth.max() == most


def test_photons_on_surfaces_have_been_somewhere_else_first():
    medium = mi.load_dict(fog(1e-3, 1.0))
    floor = {"type": "rectangle", "to_world": T().translate([0, -1.2, 0]).rotate([1, 0, 0], -90).scale(4)}
    ball = {"type": "sphere", "radius": 0.8, "bsdf": {"type": "dielectric"}, "exterior": medium}
    scene = load(ball=ball, floor=floor, light={**SPOT, "cutoff_angle": 40.0, "beam_width": 40.0})
    found = steps(tracing(scene, medium), emitted(scene, medium, 4096))
    assert found[0][1] is None  # straight from the lamp: that is direct light
    landed = [each for _, each in found if each is not None]
    height = np.concatenate([each.position.y.numpy() for each in landed])
    np.testing.assert_allclose(height, -1.2, atol=1e-4)
    assert all((each.depth.numpy() > 0).all() for each in landed)


def test_light_that_glass_reflects_by_chance_is_as_wide_as_it_is_rare():
    """Glass reflects a Fresnel fraction F of the paths, so their squared width is 1 / F times that off a mirror."""
    widths = []
    for bsdf in ({"type": "dielectric", "int_ior": 1.5}, {"type": "conductor", "material": "none"}):
        scene, medium = ball_in_fog(bsdf=bsdf)
        first, second = (each[0] for each in steps(tracing(scene, medium), emitted(scene, medium, COUNT), 2))
        cosine = np.full(COUNT, np.nan)
        facing = -(dr.dot(first.normal, first.direction)).numpy()
        cosine[first.number.numpy()] = np.abs(facing)
        width = np.full(COUNT, np.nan)
        width[second.number.numpy()] = np.square(second.width(1.0).numpy())
        widths.append(width)
    on_ball = np.abs(np.linalg.norm(second.origin.numpy(), axis=0) - 0.8) < 1e-3  # not scattered by the fog before it
    both = np.isfinite(widths[0]) & np.isfinite(widths[1]) & np.isin(np.arange(COUNT), second.number.numpy()[on_ball])
    fresnel = mi.fresnel(Float(cosine[both].astype(np.float32)), 1.5)[0].numpy()
    assert both.sum() > 100
    np.testing.assert_allclose((widths[0] / widths[1])[both] * fresnel, 1, rtol=0.01)
