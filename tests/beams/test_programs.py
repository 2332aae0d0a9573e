"""Functions that change or make beams: the built-in ones, what a function is given, and what it must not return."""

from dataclasses import replace
from functools import cache

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams import scene
from photonbeams.beams.modify import aim, bend, clamp, recolor, thin
from photonbeams.beams.programs import PassContext, Program, chain, emitted
from photonbeams.beams.sets import BeamSet
from photonbeams.render.settings import Settings
from photonbeams.render.stage_frame import render, simulate
from photonbeams.runtime.device import Array3f, Float, UInt32
from photonbeams.scene import SceneError
from photonbeams.world.cameras.cameras import Window
from photonbeams.world.described import world_of_scene
from photonbeams.world.shutter import Moment, Shutter
from tests.helpers.comparison import comparison_scene
from tests.helpers.kernels import compiled
from tests.helpers.tracing import trace

EYE = (0.0, 1.5, 1.95)
CONTEXT = PassContext("/light")


@pytest.fixture(scope="module")
def traced():
    """Return beams through a portal, two or more for each path: where surfaces block the rim, they become narrower."""
    return trace(world_of_scene(comparison_scene(), viewpoints=[EYE]), beams_per_light=256)[0].beams


@pytest.fixture
def beams(rng):
    start, power = rng.normal(size=(50, 3)), rng.uniform(0.1, 1, (50, 3))
    return pb.Beams(start, start + rng.normal(size=(50, 3)), 0.1, rng.uniform(0.1, 0.3, 50), power)


def joints(numbers):
    """Return the indices of parts of paths, and of the parts that follow them."""
    order = np.lexsort([numbers["offset"], numbers["id"]])
    same = numbers["id"][order[1:]] == numbers["id"][order[:-1]]
    assert same.sum() >= 256
    return order[:-1][same], order[1:][same]


def lengths(numbers):
    return np.linalg.norm(numbers["end"] - numbers["start"], axis=1)


# -- Built-in functions ------------------------------------------------------------------------------------------------


def test_aimed_fully_all_paths_pass_the_target_and_keep_length_and_light(traced):
    target = np.array([1.0, 0.5, 0.25])
    before, after = traced.arrays(), aim(target)(traced, CONTEXT).arrays()
    direction = (after["end"] - after["start"]) / lengths(after)[:, None]
    apart = target - after["start"]
    away = np.linalg.norm(apart - np.sum(apart * direction, axis=1)[:, None] * direction, axis=1)
    assert away.max() < 1e-4  # float32 positions, of paths some units long whose first parts are a thousandth of that
    assert np.allclose(lengths(after), lengths(before), atol=1e-5)
    for name in ("power", "radius_start", "radius_end", "offset", "total"):
        assert np.array_equal(after[name], before[name])


@pytest.mark.parametrize("distance", [1e25, 1e30])
def test_a_target_may_be_as_far_away_as_single_precision_reaches(traced, distance):
    # Seen from there, the beams are at one place: all of them become parallel.
    far, near = (aim((each, 0, 0))(traced, CONTEXT).arrays() for each in (distance, 1e10))
    np.testing.assert_allclose(far["end"], near["end"], rtol=1e-5, atol=1e-5)


def test_not_aimed_at_all_paths_stay(traced):
    before, after = traced.arrays(), aim((1, 0.5, 0.25), 0.0)(traced, CONTEXT).arrays()
    for name in ("start", "end"):
        assert np.allclose(after[name], before[name], atol=1e-5)


def test_both_parts_of_a_path_through_a_portal_are_aimed_alike(traced):
    after = aim((1, 0.5, 0.25), 0.5)(traced, CONTEXT).arrays()
    before, behind = joints(after)
    assert np.allclose(after["end"][before], after["start"][behind], atol=1e-3)  # a turn of a few units, in float32


def toward_axis(p):
    """Return the field that bends beams into circles about the z axis: toward it, with the curvature 1 / distance."""
    inv = dr.rcp(dr.maximum(p.x * p.x + p.y * p.y, 1e-12))
    return Array3f(-p.x * inv, -p.y * inv, 0)


def test_a_field_bends_beams_to_its_curvature_with_the_square_of_the_steps():
    beam = pb.Beams([[2, 0, 0]], [[2, np.pi, 0]], 0.1, 0.2, [[1, 1, 1]])  # a quarter of a circle of radius 2
    errors = []
    for steps in (8, 16, 32):
        found = bend(toward_axis, steps)(beam, CONTEXT).arrays()
        assert len(found["start"]) == steps
        errors.append(np.linalg.norm(found["end"][-1] - (0, 2, 0)))
    assert np.polyfit(np.log([8, 16, 32]), np.log(errors), 1)[0] == pytest.approx(-2, abs=0.3)
    assert np.array_equal(found["start"][1:], found["end"][:-1])
    assert np.array_equal(found["start_tangent"][1:], found["end_tangent"][:-1])
    assert np.allclose(found["start_tangent"][0], (0, 1, 0), atol=1e-6)
    assert np.allclose(found["end_tangent"][-1], (-1, 0, 0), atol=0.01)
    assert np.allclose(found["offset"], np.arange(32) / 32 * np.pi, atol=1e-5) and np.allclose(found["total"], np.pi)
    assert np.allclose(found["radius_start"], 0.1 + 0.1 * np.arange(32) / 32)


def test_no_field_leaves_the_picture_as_it_was(traced, rng):
    bent = bend(lambda p: 0 * p, 8)(traced, CONTEXT)
    assert len(bent) == 8 * len(traced)
    origin, direction = rng.normal(size=(300, 3)) * 0.3 + [0, 1.5, 0], rng.normal(size=(300, 3))
    medium = pb.Medium((0.1, 0.1, 0.1))
    given = {"medium": medium, "estimator": "frustum"}
    expected, found = (np.array(pb.estimate(each, origin, direction, **given)) for each in (traced, bent))
    assert np.linalg.norm(found - expected) <= 1e-4 * np.linalg.norm(expected)


def test_an_aimed_path_leaves_the_walls_beside_it():
    """A path that is turned toward a wall and beyond is not cut by it, as other surfaces do not stop it."""
    wall = {"start_normal": [[0, 0, 1]], "side": [[0, -0.05, 0]], "side_normal": [[0, 1, 0]]}
    plain = {"start": [[0, 0, 0]], "end": [[0, 0, 2]], "radius_start": 0.1, "radius_end": 0.1, "power": [[1, 1, 1]]}
    found, expected = (aim((0, -1, -1))(pb.Beams(**plain, **more), CONTEXT).arrays() for more in (wall, {}))
    assert found.keys() == expected.keys()
    assert all(np.array_equal(found[name], expected[name]) for name in found)


def test_the_surface_that_stops_a_path_turns_with_it():
    beams = pb.Beams([[0, 0, 0]], [[2, 0, 0]], 0.1, 0.1, [[1, 1, 1]], end_normal=[[-0.8, 0, 0.6]])
    found = bend(lambda p: Array3f(0, 1, 0) + 0 * p, 16)(beams, CONTEXT).arrays()
    last = found["end_tangent"][-1]
    assert last[1] > 0.9 and found["end_normal"][-1] @ last == pytest.approx(-0.8, abs=0.01)
    assert found["end_normal"][-1][2] == pytest.approx(0.6, abs=1e-5)
    assert np.array_equal(found["end_normal"][:-1], -found["end_tangent"][:-1])


def test_both_parts_of_a_path_through_a_portal_are_bent_as_one(traced):
    bent = bend(lambda p: Array3f(0, -0.5, 0.2) + 0 * p, 8)(traced, CONTEXT).arrays()
    before, behind = joints(traced.arrays())
    ends = bent["end"].reshape(-1, 8, 3)[:, -1][before]
    starts = bent["start"].reshape(-1, 8, 3)[:, 0][behind]
    # Light is followed from its lamp to each part in so many steps. So behind the portal, steps have other lengths.
    at_portal = traced.arrays()["offset"][before] == 0
    assert np.allclose(ends[at_portal], starts[at_portal], atol=1e-5) and np.allclose(ends, starts, atol=0.02)
    tangents = [bent[name].reshape(-1, 8, 3)[:, place] for name, place in (("end_tangent", -1), ("start_tangent", 0))]
    assert np.allclose(tangents[0][before][at_portal], tangents[1][behind][at_portal], atol=1e-5)


def test_beams_that_are_bent_are_not_bent_again(beams):
    bent = bend(lambda p: 0 * p, 2)(beams, CONTEXT)
    for modifier in (bend(lambda p: 0 * p, 2), aim((0, 0, 0))):
        with pytest.raises(SceneError, match="is given beams that are bent already: expected straight ones"):
            modifier(bent, CONTEXT)


def test_thinned_beams_are_the_same_ones_each_time_and_keep_their_light():
    count = 20_000
    beams = pb.Beams(np.zeros((count, 3)), np.ones((count, 3)), 0.1, 0.1, [[1, 2, 3]], offset=np.arange(count))
    found = [thin(0.25)(beams, CONTEXT).arrays() for _ in range(2)]
    assert np.array_equal(found[0]["offset"], found[1]["offset"])
    # The count is binomial: four standard deviations of the fraction are 4 · sqrt(0.25 · 0.75 / 20000).
    assert len(found[0]["offset"]) / count == pytest.approx(0.25, abs=0.0123)
    assert np.allclose(found[0]["power"], [4, 8, 12])
    assert np.allclose(thin(0.25, keep_light=False)(beams, CONTEXT).arrays()["power"], [1, 2, 3])
    other = thin(0.25)(beams, replace(CONTEXT, pass_index=1)).arrays()
    assert not np.array_equal(found[0]["offset"][:50], other["offset"][:50])
    fewer = thin(0.125)(beams, CONTEXT).arrays()
    assert np.all(np.isin(fewer["offset"], found[0]["offset"]))


def test_curves_are_thinned_whole(beams):
    bent = bend(lambda p: Array3f(0, 1, 0) + 0 * p, 8)(beams, CONTEXT)
    found = thin(0.5)(bent, CONTEXT).arrays()
    assert 0 < len(found["start"]) < len(bent) and len(found["start"]) % 8 == 0
    groups = {name: found[name].reshape(-1, 8, 3) for name in ("start", "end")}
    assert np.array_equal(groups["start"][:, 1:], groups["end"][:, :-1])


def test_recolored_beams_keep_their_mean_power(beams):
    before = beams.arrays()["power"].mean(axis=1)
    found = recolor((2, 1, 0))(beams, CONTEXT).arrays()["power"]
    assert np.allclose(found, before[:, None] * [2, 1, 0])
    found = recolor(lambda b: Array3f(b.radius_end, 0, 0))(beams, CONTEXT).arrays()
    assert np.allclose(found["power"][:, 0], before * found["radius_end"]) and not found["power"][:, 1:].any()


def test_clamped_beams_keep_their_colour_and_the_dim_ones_stay(beams):
    before, after = beams.arrays()["power"], clamp(power=0.5)(beams, CONTEXT).arrays()["power"]
    bright = before.max(axis=1) > 0.5
    assert bright.any() and not bright.all()
    assert np.array_equal(after[~bright], before[~bright])
    assert np.allclose(after[bright].max(axis=1), 0.5)
    assert np.allclose(after * before.max(axis=1)[:, None], before * after.max(axis=1)[:, None], rtol=1e-5)


def test_clamped_radiance_is_what_a_ray_through_the_axis_sees(beams):
    limit = 1.5
    found = clamp(radiance=limit)(beams, CONTEXT)
    numbers = found.arrays()
    middle, axis = (numbers["start"] + numbers["end"]) / 2, numbers["end"] - numbers["start"]
    across = np.cross(axis, [0.3, 0.5, 0.7])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    seen = []
    for number in range(len(found)):
        look = pb.Look(along=1.0, eye=1.0, angle=1.0)
        origin, direction = middle[number] - across[number], across[number]
        seen.append(np.array(pb.estimate(found[number], origin, direction, look=look, estimator="billboard")))
    seen = np.max(seen, axis=1)
    before = beams.arrays()
    peak = 8 / (3 * np.pi) * before["power"].max(axis=1) / (0.5 * (before["radius_start"] + before["radius_end"]))
    assert np.allclose(seen, np.minimum(peak, limit), rtol=1e-4)
    assert np.any(peak > limit) and np.any(peak < limit)


def test_modifiers_chain_in_their_order(beams):
    found = chain(recolor((1, 1, 1)), clamp(power=0.25), recolor((2, 2, 2)))(beams, CONTEXT).arrays()["power"]
    assert np.allclose(found, np.minimum(beams.arrays()["power"].mean(axis=1), 0.25)[:, None] * 2)


def test_another_pass_of_all_modifiers_compiles_nothing(traced):
    program = chain(aim((1, 0.5, 0), 0.5), thin(0.5), recolor((1, 0.5, 0.2)), clamp(power=1.0),
                    bend(lambda p: Array3f(0, -0.1, 0) + 0 * p, 8))  # fmt: skip
    world = world_of_scene(comparison_scene(), viewpoints=[EYE])

    def run(number):
        beams = trace(world, beams_per_light=256, pass_index=number)[0].beams
        dr.eval(program(beams, replace(CONTEXT, pass_index=number, seed=number)))

    run(0)
    assert not compiled(run, 1)


@pytest.mark.parametrize(
    ("message", "make"),
    [
        (r"aim: amount is 2: expected a finite number at least 0 and at most 1", lambda: aim((0, 0, 0), 2)),
        (r"aim: target is \(0, 0\): expected 3 finite numbers", lambda: aim((0, 0))),
        (r"thin: fraction is 0: expected more than 0", lambda: thin(0)),
        (r"thin: fraction is 1.5: expected", lambda: thin(1.5)),
        (r"recolor: color is \(1, nan, 0\): expected 3 finite numbers", lambda: recolor((1, float("nan"), 0))),
        (r"clamp has no limit: expected power, radiance, or both", lambda: clamp()),
        (r"clamp: power is -1: expected a finite number at least 0", lambda: clamp(-1)),
        (r"bend: steps is 0: expected a finite number at least 1", lambda: bend(lambda p: p, 0)),
        (r"a guide has fewer than two different points", lambda: bend([[[0, 0, 0], [0, 0, 0]]])),
    ],
)
def test_what_the_modifiers_cannot_do_is_told_in_a_sentence(message, make):
    with pytest.raises(SceneError, match=message):
        make()


# -- What a function is given, and what it returns ---------------------------------------------------------------------


def sets_of(beams, close=None):
    return [BeamSet("key", None, beams, close, "/light")]


def applied(modifier, sets, times=(0.0,)):
    return Program(modifier, 7.0, lambda fraction: 7 + fraction)(sets, 3, 5, times, None, ((0.0, 0.0, 0.0), 2.0))


def test_a_function_is_called_for_each_set_with_what_there_is_to_know(beams):
    told = []

    def look_at(found, context):
        told.append(context)
        return found

    (result,) = applied(look_at, sets_of(beams, beams), (0.25, 0.5))
    assert [each.time for each in told] == [7.25, 7.5]
    first = told[0]
    assert (first.name, first.group, first.pass_index, first.seed, first.frame) == ("/light", "key", 3, 5, 7.0)
    assert first.medium is None and first.bounds[1] == 2.0
    assert result.group == "key" and result.name == "/light" and len(result.close) == 50


def broken(beams, **given):
    result = pb.Beams()
    for name in pb.Beams.DRJIT_STRUCT:
        setattr(result, name, given.get(name, getattr(beams, name)))
    return result


@pytest.mark.parametrize(
    ("message", "modifier"),
    [
        (r"<lambda> returned, of /light, nothing: expected Beams", lambda b, c: None),
        (r"<lambda> returned, of /light, a list: expected Beams", lambda b, c: [b]),
        (r"beams whose power is not finite", lambda b, c: broken(b, power=b.power / 0)),
        (r"beams whose end is not finite", lambda b, c: broken(b, end=b.end * float("nan"))),
        (r"beams of negative power", lambda b, c: broken(b, power=-b.power)),
        (r"a radius is negative, or both of a beam are 0", lambda b, c: broken(b, radius_end=-b.radius_end)),
        (r"radius_end has 3 entries: expected 50", lambda b, c: broken(b, radius_end=Float([1, 2, 3]))),
        (r"radius_end is not given", lambda b, c: broken(b, radius_end=None)),
    ],
)
def test_what_a_function_may_not_return_is_told_in_a_sentence(message, modifier, beams):
    with pytest.raises(SceneError, match=message):
        applied(modifier, sets_of(beams))


def test_other_beams_at_shutter_close_are_told_in_a_sentence(beams):
    def later_fewer(found, context):
        return found if context.time == 7 else found.take(dr.arange(UInt32, 3))

    with pytest.raises(SceneError, match=r"Beams\(50\) of /light at shutter open and Beams\(3\) at shutter close"):
        applied(later_fewer, sets_of(beams, beams), (0.0, 1.0))


def test_numbers_for_all_are_broadcast_in_what_a_function_returns(beams):
    (result,) = applied(lambda b, c: broken(b, power=Array3f(1, 2, 3)), sets_of(beams))
    assert dr.width(result.beams.power) == 50


@pytest.mark.parametrize("kind", ["beams", "drawn", "several"])
def test_beams_from_nothing_are_drawn_beams(kind, beams):
    drawn = scene.DrawnBeams("/mine", **beams.arrays(), group="made")

    def sparks(context):
        assert context == PassContext(frame=3, time=3.0)
        return {"beams": beams, "drawn": drawn, "several": [beams, drawn]}[kind]

    found = emitted(sparks, PassContext(frame=3, time=3.0))
    names = {"beams": ["/sparks"], "drawn": ["/mine"], "several": ["/sparks_0", "/mine"]}
    assert [each.name for each in found] == names[kind]
    assert all(np.array_equal(each.start, beams.arrays()["start"]) for each in found)


def test_a_function_may_remember_what_it_made_by_its_context(beams):
    """A fog on a grid has arrays, which have no hash, and whose equality is no bool."""
    remembered = cache(lambda context: [beams])
    grids = (scene.DensityGrid(np.full((2, 2, 2), value)) for value in (0.5, 0.5, 0.7))
    first, again, other = (PassContext(medium=scene.Medium(1.0, grid=each)) for each in grids)
    assert remembered(first) is remembered(again) and remembered(other) is not remembered(first)
    assert first == again != other


def test_a_function_that_makes_nothing_is_named():
    def forgetful(_):
        return None

    with pytest.raises(SceneError, match="forgetful returned nothing: expected Beams"):
        emitted(forgetful, PassContext())


# -- In a render -------------------------------------------------------------------------------------------------------


WINDOW = Window.full(24, 16)


def room(shift=0.0):
    content = comparison_scene()
    light = replace(content.lights[0], center=content.lights[0].center + np.array([0, shift, 0]), portal=None)
    return replace(content, lights=(light,), bounds=(np.array([0, 1.5, 0]), 4.0))


def camera():
    to_world = np.eye(4)
    to_world[:3, 3] = EYE
    return scene.Camera("/camera", to_world, focal_length=1.05, horizontal_aperture=2.1, vertical_aperture=1.4)


def test_half_the_power_is_half_the_picture():
    shutter = Shutter.still(room(), camera())
    settings = Settings(passes=2, beams=256)
    half = replace(settings, program=Program(lambda b, c: recolor((0.5, 0.5, 0.5))(b, c)))
    pictures = [render(shutter, WINDOW, each).layers()["beams"] for each in (settings, half)]
    assert pictures[0].any() and np.allclose(pictures[1], 0.5 * pictures[0], rtol=1e-4)


def test_what_moves_is_changed_at_both_ends_of_the_shutter():
    """A program changes the beams at shutter open and at shutter close: a bent beam moves between two bent states."""
    states = [room(), room(0.2)]
    shutter = Shutter(lambda at: Moment(room(0.2 * at) if at not in (0, 1) else states[int(at)], (camera(),)), True)
    program = Program(bend(lambda p: Array3f(0, 0.2, 0) + 0 * p, 6))
    settings = Settings(passes=1, beams=64, guiding=False, program=program)  # a portal would cut each beam in two
    (found,) = simulate(shutter, WINDOW, settings)
    first, last = found.beams.arrays(), found.close.arrays()
    assert len(first["start"]) >= 6 * 64 and first.keys() == last.keys()
    moved = (last["start"] - first["start"]).reshape(-1, 6, 3)[:, 0]
    leaving = first["offset"].reshape(-1, 6)[:, 0] == 0  # others are parts that a rim's blocker cuts off
    assert leaving.sum() == 64 and np.allclose(moved[leaving], (0, 0.2, 0), atol=0.02)
    assert render(shutter, WINDOW, settings).layers()["beams"].any()
