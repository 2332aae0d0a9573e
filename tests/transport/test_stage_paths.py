"""Beams in a world of surfaces, fog and portals."""

import dataclasses

import drjit as dr
import numpy as np
import pytest

from photonbeams import scene
from photonbeams.runtime.device import Array3f, Bool, UInt32
from photonbeams.transport.guiding.lines import LightLines
from photonbeams.world.cameras.cameras import View, Window
from photonbeams.world.described import world_of_scene
from tests.helpers.comparison import HOLE_X, across_x, box, comparison_scene, quad
from tests.helpers.kernels import compiled
from tests.helpers.tracing import trace

EYE = (0.0, 1.5, 1.95)


@pytest.fixture(scope="module")
def room():
    return world_of_scene(comparison_scene(), viewpoints=[EYE])


def only(sets):
    """Return the arrays of the only set of beams, with the parts joined of those that a blocked rim makes narrower."""
    assert len(sets) == 1
    beams = sets[0].beams.arrays()
    order = np.lexsort([beams["offset"], beams["id"]])
    beams = {name: values[order] for name, values in beams.items()}
    # At a portal the radius is the same on both sides; where a beam becomes narrower, it is not.
    goes_on = (beams["id"][1:] == beams["id"][:-1]) & (beams["radius_start"][1:] < 0.99 * beams["radius_end"][:-1])
    first, last = np.flatnonzero([True, *~goes_on]), np.flatnonzero([*~goes_on, True])
    ends = {"end", "radius_end", "end_normal"}
    return {name: values[last if name in ends else first] for name, values in beams.items()}


def world_of(*lights, **parts):
    return world_of_scene(scene.Scene(lights=lights, **parts))


LAMP = scene.SphereLight("/lamp", (1.0, 1.0, 1.0), center=np.array([0.0, 0.0, 0.0]), radius=0.1)
FOG = scene.Medium((0.1, 0.1, 0.1))


def test_beams_stop_at_the_first_surface_and_know_its_normal():
    cube = box("/cube", [-1, -2, -3], [2, 1, 1])
    beams = only(trace(world_of(LAMP, meshes=(cube,)), beams_per_light=256))
    low, high = np.array([-1, -2, -3]), np.array([2, 1, 1])
    gap = np.minimum(np.abs(beams["end"] - low), np.abs(beams["end"] - high))
    assert np.allclose(gap.min(axis=1), 0, atol=1e-5)
    assert np.all((beams["end"] > low - 1e-5) & (beams["end"] < high + 1e-5))
    direction = beams["end"] - beams["start"]
    assert np.all(np.einsum("ij,ij->i", direction, beams["end_normal"]) < 0)
    assert np.array_equal(np.argmax(np.abs(beams["end_normal"]), axis=1), np.argmin(gap, axis=1))
    assert np.allclose(beams["total"], np.linalg.norm(direction, axis=1), rtol=1e-5)


def test_beams_pass_what_their_light_is_not_stopped_by():
    inner, outer = box("/inner", [-1, -1, -1], [1, 1, 1]), box("/outer", [-3, -3, -3], [3, 3, 3])
    through = dataclasses.replace(LAMP, unshadowed=frozenset({"/inner", "/nothing"}))
    for lamp, reach in ((LAMP, 1), (through, 3), (dataclasses.replace(LAMP, unlit=frozenset({"/inner"})), 1)):
        beams = only(trace(world_of(lamp, meshes=(inner, outer)), beams_per_light=256))
        assert np.allclose(np.abs(beams["end"]).max(axis=1), reach, rtol=1e-5)
    # Beams end as if the inner box were not there.
    passing = only(trace(world_of(through, meshes=(inner, outer)), beams_per_light=256))
    alone = only(trace(world_of(LAMP, meshes=(outer,)), beams_per_light=256))
    for name in ("end", "radius_start", "radius_end"):
        assert np.allclose(passing[name], alone[name], rtol=1e-4), name
    first, second = trace(
        world_of(LAMP, dataclasses.replace(through, name="/twin"), meshes=(inner, outer)), beams_per_light=64
    )
    assert np.abs(first.beams.arrays()["end"]).max() < 1.01 < np.abs(second.beams.arrays()["end"]).max()


def test_a_world_at_another_time_keeps_what_stops_its_lights():
    inner = box("/inner", [-1, -1, -1], [1, 1, 1])
    lamp = dataclasses.replace(LAMP, unshadowed=frozenset({"/inner"}))
    first = world_of(lamp, meshes=(inner,))
    moved = scene.Scene(lights=(dataclasses.replace(lamp, center=np.array([0.1, 0, 0])),), meshes=(inner,))
    later = world_of_scene(moved, like=first)
    links = first.emitters[0].links
    assert later.stopping(links).surfaces is first.stopping(links).surfaces is not first.surfaces
    assert first.stopping(world_of(LAMP).emitters[0].links) is first


def test_beams_that_meet_nothing_end_far_beyond_the_bounds():
    world = world_of(LAMP)
    beams = only(trace(world, beams_per_light=64))
    assert np.allclose(np.linalg.norm(beams["end"], axis=1), scene.ESCAPE * world.radius, rtol=1e-5)
    direction = (beams["end"] - beams["start"]) / beams["total"][:, None]
    assert np.allclose(beams["end_normal"], -direction, atol=1e-5)


def test_the_same_seed_gives_the_same_beams_bit_for_bit_with_one_and_two_threads(room, set_threads):
    results = []
    for threads in (1, 2, 2):
        set_threads(threads)
        results.append(only(trace(room, beams_per_light=512, pass_index=3, seed=5, light_side={"/light"})))
    for other in results[1:]:
        assert all(np.array_equal(results[0][name], other[name]) for name in other)


def test_seeds_passes_and_lights_have_different_beams(room):
    ends = [only(trace(room, beams_per_light=64, **given))["end"] for given in ({}, {"seed": 1}, {"pass_index": 1})]
    assert not np.array_equal(ends[0][:8], ends[1][:8])
    assert not np.array_equal(ends[0][:8], ends[2][:8])
    twins = trace(world_of(LAMP, dataclasses.replace(LAMP, name="/twin")), beams_per_light=64)
    assert not np.array_equal(twins[0].beams.arrays()["end"], twins[1].beams.arrays()["end"])


def test_a_path_through_a_portal_is_two_beams_that_fit(room):
    beams = only(trace(room, beams_per_light=1024))
    first, second = (beams["offset"] == 0), (beams["offset"] > 0)
    assert first.sum() == second.sum() == 1024  # the hole is open, and the portal fills its rectangle
    assert np.allclose(beams["end"][first][:, 0], HOLE_X, atol=1e-4)
    assert np.array_equal(beams["end"][first], beams["start"][second])
    assert np.array_equal(beams["radius_end"][first], beams["radius_start"][second])
    for name in ("power", "total"):
        assert np.array_equal(beams[name][first], beams[name][second])
    assert np.allclose(
        beams["offset"][second], np.linalg.norm((beams["end"] - beams["start"])[first], axis=1), rtol=1e-4
    )
    whole = np.linalg.norm(beams["end"][second] - beams["start"][first], axis=1)
    assert np.allclose(beams["total"][second], whole, rtol=1e-5)
    assert np.all(np.abs(beams["start"][second][:, 1] - 1.5) < 0.1501)
    assert np.all(np.abs(beams["start"][second][:, 2]) < 0.1001)


def test_what_blocks_the_way_to_a_portal_stops_its_beams(room):
    blocked = dataclasses.replace(
        room.parts.content, meshes=(*room.parts.content.meshes, across_x("/lid", -1.5, (1.0, 2.0), (-1, 1)))
    )
    beams = only(trace(world_of_scene(blocked, viewpoints=[EYE]), beams_per_light=128))
    assert np.all(beams["offset"] == 0)
    assert np.allclose(beams["end"][:, 0], -1.5, atol=1e-5)
    assert np.allclose(beams["end_normal"], [-1, 0, 0], atol=1e-6)


def test_the_light_side_is_a_quarter_of_the_beams_and_misses_the_portal(room):
    beams = only(trace(room, beams_per_light=4096, light_side={"/light"}))
    aside = beams["power"][:, 0] > 0.5  # each carries 1000 / 1024; those through the portal carry far less
    assert 0.9 * 1024 < aside.sum() < 1024
    through = (~aside) & (beams["offset"] == 0)
    assert through.sum() == 3072
    total = beams["power"][aside].sum(axis=0) + beams["power"][through].sum(axis=0)
    assert np.allclose(total, 1000, rtol=0.2 / 32)  # binomial: the light side's fraction errs by 0.2 / sqrt(1024)
    assert np.all(beams["end"][aside][:, 0] < HOLE_X + 1e-4)


def test_fog_in_a_mesh_clips_beams_to_its_first_interval():
    fog = scene.Medium((0.1,) * 3, mesh=box("/fog", [1, -1, -1], [2, 1, 1]))
    light = scene.SphereLight("/lamp", (1.0,) * 3, axis=np.array([1.0, 0, 0]), shaping=scene.Shaping(cone_angle=15.0))
    wall = across_x("/wall", 5.0, (-9, 9), (-9, 9))
    beams = only(trace(world_of(light, meshes=(wall,), media=(fog,)), beams_per_light=128))
    first, last = (np.linalg.norm(beams[end], axis=1) for end in ("start", "end"))
    # Beams reach beyond the box until their rim has left it: by the tangent of their slant times their radius.
    cosine = beams["end"][:, 0] / last
    beyond = np.sqrt(1 - cosine**2) / cosine
    # Mitsuba's rays begin 1500 roundings of 1 + |x| behind an interface.
    assert np.allclose(beams["entry"] * cosine, 1, atol=3100 * 2.0**-24)
    assert np.allclose(first, beams["entry"] - beyond * beams["radius_start"] * beams["entry"] / first, rtol=1e-3)
    assert np.allclose(last, 2 / cosine + beyond * beams["radius_end"] * 2 / cosine / last, rtol=1e-3)
    assert np.allclose(beams["end_normal"] * last[:, None], -beams["end"], rtol=1e-4, atol=1e-4)
    assert np.allclose(beams["offset"], first, rtol=1e-5)
    assert np.allclose(
        beams["radius_end"] / beams["radius_start"], last / first, rtol=1e-3
    )  # a point's beams are cones
    assert np.all(beams["total"] > 5 * (1 - 1e-6))


def test_beams_that_start_in_fog_begin_at_the_light_and_those_that_miss_it_are_gone():
    fog = scene.Medium((0.1,) * 3, mesh=box("/fog", [-1, -1, -1], [1, 1, 1]))
    inside = only(trace(world_of(LAMP, media=(fog,)), beams_per_light=64))
    assert np.array_equal(inside["offset"], np.zeros(64))
    assert np.all(np.abs(inside["end"]).max(axis=1) >= 1 - 1e-5)
    away = scene.SphereLight("/lamp", (1.0,) * 3, center=np.array([0, 0, 9.0]), axis=np.array([0, 0, 1.0]))
    spot = dataclasses.replace(away, shaping=scene.Shaping(cone_angle=30.0))
    assert trace(world_of(spot, media=(fog,)), beams_per_light=64) == []


def test_a_cut_out_surface_lets_its_part_of_the_beams_through():
    def passed(opacity):
        sheet = across_x("/sheet", 1.0, (-50, 50), (-50, 50))
        sheet = dataclasses.replace(sheet, material=scene.Material(opacity=opacity))
        spot = scene.Shaping(cone_angle=40.0)
        light = scene.SphereLight("/spot", (1.0,) * 3, axis=np.array([1.0, 0, 0]), shaping=spot)
        return (only(trace(world_of(light, meshes=(sheet,)), beams_per_light=4096))["end"][:, 0] > 1.1).mean()

    assert passed(1.0) == 0
    assert passed(0.0) == 1
    assert abs(passed(0.25) - 0.75) < 4 * np.sqrt(0.25 * 0.75 / 4096)


def test_lights_say_how_many_beams_and_how_bright():
    lights = (
        dataclasses.replace(LAMP, name="/a", beam_count=10, group="key"),
        dataclasses.replace(LAMP, name="/b", beam_scale=0.25),
        dataclasses.replace(LAMP, name="/c", emits_beams=False),
        dataclasses.replace(LAMP, name="/d", beam_count=0),
    )
    sets = trace(world_of(*lights), beams_per_light=20)
    assert [(item.group, len(item.beams)) for item in sets] == [("key", 10), ("", 20)]
    power = [item.beams.power.numpy().sum() for item in sets]
    assert np.isclose(power[1], 0.25 * power[0], rtol=1e-5)


def test_drawn_beams_come_along():
    drawn = scene.DrawnBeams("/ray", [[0, 0, 0.0]], [[1, 0, 0.0]], [0.1], [0.2], [[1, 2, 3.0]], group="drawn")
    sets = trace(world_of(drawn=(drawn,)), beams_per_light=20)
    assert [(item.group, len(item.beams)) for item in sets] == [("drawn", 1)]
    assert np.allclose(sets[0].beams.power.numpy()[:, 0], [1, 2, 3])


def test_cross_sections_of_a_point_light_tile_the_sphere():
    light = dataclasses.replace(LAMP, radius=0.0)
    for count in (16, 1000):
        beams = only(trace(world_of(light), beams_per_light=count, overlap=1.3))
        areas = np.pi * (beams["radius_end"] / beams["total"]) ** 2
        assert np.isclose(areas.sum(), np.pi / 4 * 1.3**2 * 4 * np.pi, rtol=1e-4)


def test_radii_balance_the_light_and_the_portal(room):
    beams = only(trace(room, beams_per_light=1024))
    second = beams["offset"] > 0
    light, hole = beams["radius_start"][~second], beams["radius_start"][second]
    # The product is light area × portal area over N cells, however the two are balanced; cosines are near 1 here.
    area = 0.1**2 * 0.2 * 0.3 / 1024
    assert np.allclose((2 * light) ** 2 * (2 * hole) ** 2, area, rtol=0.3)
    d, s = beams["offset"][second], beams["total"][second]
    expected = np.hypot(light * (s / d - 1), hole * s / d)
    # Behind the portal radii are on a line, which is the expected curve at one distance; some beams become narrower.
    assert np.quantile(beams["radius_end"][second] / expected, [0.75, 1]) == pytest.approx([1, 1], abs=0.1)


def test_a_thousand_beams_keep_the_outline_of_the_shaft(room):
    beams = only(trace(room, beams_per_light=1024))
    reached = beams["end"][:, 0] > 1.99
    radius = beams["radius_end"][reached]
    # The shaft's cross-section at the far wall is 1.6 × 2.3: footprints must stay far below it.
    assert 0.01 < np.median(radius) < 0.3


def past_portals(world, eye, forward):
    """Return the lights that a camera with a field of view of 90 degrees sees past their portals."""
    camera = scene.Camera.look_at(eye, np.add(eye, forward), fov=90)
    return LightLines(world, View(camera, Window.full(32, 18)).projections).seen_past_portals()


def test_the_camera_sees_the_light_side_through_the_hole_and_not_from_behind_a_wall(room):
    assert past_portals(room, EYE, [0, 0, -1]) == {"/light"}
    beside = (-1.0, 1.5, 1.0)
    assert past_portals(room, beside, [1, 0, 0]) == {"/light"}  # looks away, but rays are aimed at the hole
    baffle = across_x("/baffle", -1.2, (0.9, 2.1), (-0.6, 0.6))
    closed = dataclasses.replace(room.parts.content, meshes=(*room.parts.content.meshes, baffle))
    assert past_portals(world_of_scene(closed, viewpoints=[EYE]), (1.0, 1.5, 0.0), [-1, 0, 0]) == frozenset()
    on_light_side = (-1.9, 1.5, 1.9)
    assert past_portals(room, on_light_side, [0, 0, -1]) == {"/light"}


def test_transparent_to_portals_and_fog_meshes():
    """Neither a portal nor the boundary of fog stops rays."""
    sheet = across_x("/portal", 1.0, (-1, 1), (-1, 1))
    fog = box("/fog", [-3, -3, -3], [3, 3, 3])
    light = dataclasses.replace(LAMP, portal=sheet)
    world = world_of(light, meshes=(sheet, fog, quad("/wall", [[2, -1, -1], [2, 1, -1], [2, 1, 1], [2, -1, 1]])),
                     media=(dataclasses.replace(FOG, mesh=fog),))  # fmt: skip
    hit = world.intersect(Array3f(0), Array3f(1, 0, 0), dr.full(Bool, True, 1), UInt32(0))
    assert np.isclose(hit.t[0], 2)


def test_a_second_frame_compiles_nothing():
    def frame(number):
        light = dataclasses.replace(
            comparison_scene().lights[0], radiance=(1.0 + number, 2.0, 3.0), center=np.array([-1.9, 1.5, 0.01 * number])
        )
        world = world_of_scene(dataclasses.replace(comparison_scene(), lights=(light,)), viewpoints=[EYE])
        trace(world, beams_per_light=256, pass_index=number, seed=number, overlap=1 + number, light_side={"/light"})
        past_portals(world, EYE, [0.1 * number, 0, -1])

    frame(0)
    assert not compiled(frame, 1)


@pytest.mark.parametrize(
    "light",
    [
        dataclasses.replace(LAMP, radiance=(0.0,) * 3),
        scene.FlatLight("/lamp", (1.0,) * 3, half_x=np.zeros(3)),
        scene.DomeLight("/lamp", (1.0,) * 3, image=np.zeros((4, 8, 3), dtype=np.float32)),
    ],
    ids=["black", "no area", "black dome"],
)
def test_lights_without_power_make_no_beams(light):
    assert trace(world_of(light), beams_per_light=16) == []


def test_a_single_beam_is_a_beam(room):
    assert len(only(trace(world_of(LAMP), beams_per_light=1))["start"]) == 1
    assert len(only(trace(room, beams_per_light=1))["start"]) == 2


def test_beams_keep_their_width_over_any_number_of_null_collisions():
    # Smoke in a grid that is thin except in one corner: in a coloured medium, each null collision ends a step.
    density = np.full((4, 4, 4), 0.01, np.float32)
    density[0, 0, 0] = 1
    place = np.diag([8.0, 8, 8, 1])
    place[:3, 3] = -4
    smoke = scene.Medium((4.0, 3.0, 2.0), name="/smoke", grid=scene.DensityGrid(density, place))
    lamp = scene.SphereLight("/lamp", (1.0, 1.0, 1.0), center=np.zeros(3), radius=0.0)
    world = world_of_scene(scene.Scene(lights=(lamp,), media=(smoke,)), [(0, 0, 9)])
    (found,) = trace(world, beams_per_light=256)
    beams = found.beams
    assert len(beams) > 8 * 256
    # Without surfaces, all beams of a point are cones of the same angle.
    distance = dr.norm(beams.end).numpy()
    ratio = (beams.radius_end.numpy() / distance)[distance > 0.5]
    np.testing.assert_allclose(ratio, np.median(ratio), rtol=0.05)
