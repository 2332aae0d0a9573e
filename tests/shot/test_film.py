"""Frames of a film: what they have in common is made once, and they have the bits of frames by themselves."""

import gc
import weakref

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.render import reuse, worlds
from photonbeams.render.light import ShotLight
from photonbeams.render.passes import PlannedPasses
from photonbeams.render.reuse import FilmMemory
from photonbeams.transport.guiding.lines import LightLines

FRAMES = (1, 2, 4)
SETTINGS = {"width": 24, "height": 18, "passes": 3, "beams": 96}

STAGE = """
def Camera "C" {{
    double3 xformOp:translate.timeSamples = {{ 1: (0, 0, 6), 2: (.3, 0, 6), 4: (.2, .5, 5) }}
    uniform token[] xformOpOrder = ["xformOp:translate"]
    double shutter:close = .5
}}
def Scope "Air" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) {{
    color3f photonbeams:scattering = (.1, .1, .1)
}}
def SphereLight "Lamp" {{
    token visibility{shown}
    float inputs:intensity{intensity}
    float inputs:radius = .2
    double3 xformOp:translate = (-2, 1, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def Sphere "Ball" {{
    double radius = .6
    double3 xformOp:translate{place}
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
"""
STILL = {"shown": "", "intensity": " = 10", "place": " = (0, 0, 0)"}
OTHER = {
    "a ball that moves": STILL | {"place": ".timeSamples = { 1: (0, 0, 0), 2: (0, 0, 0), 4: (0, 1, 0) }"},
    "a lamp that goes out": STILL | {"shown": '.timeSamples = { 1: "inherited", 2: "inherited", 4: "invisible" }'},
    "a lamp that goes on": STILL | {"shown": '.timeSamples = { 1: "invisible", 2: "invisible", 4: "inherited" }'},
    "a ball that moves by a rounding": STILL
    | {"place": ".timeSamples = { 1: (0, 0, 0), 2: (0, 0, 0), 4: (0, 0, 1e-17) }"},
    "a lamp that grows brighter": STILL | {"intensity": ".timeSamples = { 1: 10, 2: 10, 4: 30 }"},
}


@pytest.fixture
def made(monkeypatch):
    """Return the numbers of passes whose light was traced, and the worlds that were built, as two lists."""
    traced, built = [], []
    trace, build = ShotLight.traced, worlds.world_of_scene

    def traced_light(self, number, *arguments):
        traced.append(number)
        return trace(self, number, *arguments)

    def built_world(*arguments, **given):
        built.append(build(*arguments, **given))
        return built[-1]

    monkeypatch.setattr(ShotLight, "traced", traced_light)
    monkeypatch.setattr(worlds, "world_of_scene", built_world)
    return traced, built


def rendered(shot, frames=FRAMES, **changes):
    return [shot.render(frame, **SETTINGS | changes).layers for frame in frames]


def assert_same(film, alone):
    for one, other in zip(film, alone, strict=True):
        assert one.keys() == other.keys()
        for name, pixels in one.items():
            np.testing.assert_array_equal(pixels, other[name], err_msg=name)


def test_only_the_camera_moves(usd, made):
    traced, built = made
    shot = pb.Shot(usd(STAGE.format(**STILL)))
    alone = rendered(shot)
    assert not np.array_equal(alone[0]["beams"], alone[1]["beams"])
    traced.clear()
    built.clear()
    with shot.film():
        film = rendered(shot)
    assert_same(film, alone)
    assert (sorted(traced), len(built)) == ([0, 1, 2], 1)
    traced.clear()
    rendered(shot, FRAMES[:1])
    assert sorted(traced) == [0, 1, 2]  # the film is over


def test_parts_of_frames_have_a_film_in_common(usd, made):
    """As on a worker of a farm, which renders some passes of each frame."""
    traced, built = made
    given = {name: value for name, value in SETTINGS.items() if name != "passes"}
    found = []
    for film in (None, FilmMemory()):
        shot = pb.Shot(usd(STAGE.format(**STILL)))
        traced.clear()
        built.clear()
        part = PlannedPasses(range(1, 3), 3)
        found.append([shot.render_part(part, frame, film=film, **given).state() for frame in FRAMES])
    assert (sorted(traced), len(built)) == ([1, 2], 1)
    assert_same(*found)


@pytest.mark.parametrize("stage", OTHER.values(), ids=OTHER)
def test_something_else_changes(usd, made, stage):
    traced, _ = made
    shot = pb.Shot(usd(STAGE.format(**stage)))
    alone = rendered(shot)
    traced.clear()
    with shot.film():
        film = rendered(shot)
    assert_same(film, alone)
    assert len(traced) > len(FRAMES)


@pytest.mark.parametrize("changes", [{"seed": 5}, {"beams": 50}, {"max_depth": 3}, {"width": 32}, {"passes": 2}])
def test_other_settings(usd, changes):
    shot = pb.Shot(usd(STAGE.format(**STILL)))
    alone = rendered(shot, (1,), **changes)
    with shot.film():
        rendered(shot, (2,))
        assert_same(rendered(shot, (1,), **changes), alone)


def test_a_lamp_seen_past_its_portal_in_one_frame(usd, monkeypatch):
    portal = """
def SphereLight "Far" {
    float inputs:intensity = 50
    double3 xformOp:translate = (3, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    rel photonbeams:portal = </Portal>
}
def Plane "Portal" {
    double width = .5
    double length = .5
    uniform token axis = "X"
    double3 xformOp:translate = (2, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
    moving = STAGE.format(**STILL).replace("2: (.3, 0, 6)", "2: (5, 0, 6)")
    shot = pb.Shot(usd(moving + portal))
    monkeypatch.setattr(
        LightLines, "seen_past_portals", lambda own: frozenset({"/Far"} if float(own.views[0].origin.x[0]) > 2 else ())
    )
    alone = rendered(shot)
    with shot.film():
        assert_same(rendered(shot), alone)


def test_a_modifier_of_each_frame(usd):
    shot = pb.Shot(usd(STAGE.format(**STILL)), simulate=lambda beams, context: beams[: 10 * int(context.frame)])
    alone = rendered(shot)
    assert alone[0]["beams"].sum() < 0.7 * alone[1]["beams"].sum()
    with shot.film():
        assert_same(rendered(shot), alone)


def test_light_beyond_the_memory_is_traced_again(usd, made, monkeypatch):
    traced, _ = made
    monkeypatch.setattr(reuse, "_MOST_RECORDS", 0)
    shot = pb.Shot(usd(STAGE.format(**STILL)))
    with shot.film():
        film = rendered(shot)
    assert len(traced) == 3 * len(FRAMES)
    assert_same(film, rendered(shot))


def test_the_world_is_forgotten_with_the_film(usd, made):
    _, built = made
    shot = pb.Shot(usd(STAGE.format(**STILL)))
    with shot.film():
        rendered(shot, FRAMES[:2])
        known = weakref.ref(built.pop())
    gc.collect()
    assert known() is None
