"""Each kind of light path of each emitter is found once, whichever techniques are off, and the mean stays."""

from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from benchmarks.compare.random_rooms import room
from photonbeams import Look, Shot, scene
from photonbeams.render import light as light_module
from photonbeams.render.light import ShotLight
from photonbeams.render.paths.emitters import Chosen
from photonbeams.render.pilots.pilot import Findings
from photonbeams.render.scene_frame import Extras, render
from photonbeams.render.settings import METHODS as NAMED
from photonbeams.render.settings import Settings
from photonbeams.render.techniques import (
    BEAMS,
    METHODS,
    PHOTONS,
    SAMPLES,
    SEGMENTS,
    WALKS,
    Kind,
    SeenLight,
    Technique,
    Techniques,
)
from photonbeams.render.worlds import StillWorld
from photonbeams.runtime.device import mitsuba
from photonbeams.scene import SceneError
from photonbeams.transport.segments.records import Counts
from photonbeams.transport.simulation import Simulation
from photonbeams.transport.strata import Allotment
from photonbeams.transport.tuning import Tuning
from photonbeams.world.described import world_of_scene
from photonbeams.world.emitters.sources import Source
from photonbeams.world.plugin import world_of_plugin
from tests.helpers.comparison import box
from tests.helpers.mitsuba_scenes import T, camera, cube_of, fog, frames, load, rgb
from tests.helpers.sweep import sweep

mi = mitsuba()

THEORY = Path(__file__).resolve().parents[2] / "docs" / "theory.md"
FLOOR = box("/floor", (-2, -1.2, -2), (2, -1, 2))
MIRROR = replace(box("/mirror", (-1, -0.9, -1.2), (1, 0.5, -1.1)), material=scene.Material(metallic=1.0, roughness=0.0))
HAZE = scene.Medium(0.1, 0.02, name="/haze", mesh=box("/haze", (-1.5, -0.9, -1.5), (1.5, 1.2, 1.5)))
SMOKE = scene.Medium(
    300.0, name="/smoke", grid=scene.DensityGrid(np.ones((4, 4, 4), np.float32), np.diag([2.0, 2.0, 0.1, 1.0]))
)
SKY = scene.DomeLight("/sky", 0.5, lights_media=True, emits_beams=False)
LIGHTS = (
    scene.SphereLight("/lamp", 20.0, center=np.array([0.5, 1.5, 0]), radius=0.1),
    scene.SphereLight("/look", 20.0, center=np.array([-0.5, 1.5, 0]), radius=0.1, look=Look(angle=1.0)),
    scene.SphereLight("/unlit", 20.0, center=np.array([0, 1.5, 1]), radius=0.1, unlit=frozenset({"/floor"})),
    scene.SphereLight("/ghost", 20.0, center=np.array([0, 1.5, -1]), radius=0.1, unshadowed=frozenset({"/floor"})),
    scene.DistantLight("/sun", 1.0, axis=np.array([0, -0.8, -0.6]), angle=0.5),
    scene.DomeLight("/dome", 0.5),
    SKY,
    replace(SKY, name="/both", emits_beams=True),
)
EMITTERS = {
    "ball": {"type": "sphere", "center": [0, 3, 0], "radius": 0.2, "emitter": {"type": "area", "radiance": 5.0}},
    "point": {"type": "point", "position": [1, 3, 0], "intensity": 5.0},
    "laser": {"type": "rectangle", "emitter": {"type": "directionalarea", "radiance": 5.0}},
    "sun": {"type": "directional", "direction": [1, -0.6, 0.2], "irradiance": 2.0},
    "sky": {"type": "constant", "radiance": 1.0},
}


def test_the_table_of_the_theory_is_that_of_the_module():
    text = THEORY.read_text(encoding="utf-8").split("**Which light is found how.**")[1]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"]
    assert rows[0] == ["kind", "light path", "found by"]
    assert rows[2 : 2 + len(Kind)] == [[kind.title, kind.path, kind.said] for kind in Kind]


def test_methods_are_sets_of_techniques_that_are_off():
    assert tuple(METHODS) == NAMED
    with pytest.raises(SceneError, match="without is 'magic': expected one of direct samples, walks"):
        Settings(without=frozenset({"magic"}))


# -- each kind is found once -----------------------------------------------------------------------------------------


def some(rng, values):
    """Return each of the values with an even chance."""
    return [each for each in values if rng.random() < 0.5]


def stage_world(rng):
    """Return the world of a random stage."""
    meshes = (FLOOR, MIRROR) if rng.random() < 0.4 else (FLOOR,)
    content = scene.Scene(lights=some(rng, LIGHTS) or LIGHTS[:1], meshes=meshes, media=some(rng, (HAZE, SMOKE)))
    return world_of_scene(content, sharp=True)


def scene_world(rng):
    """Return the world of a random Mitsuba scene, with beam settings for some emitters."""
    parts = {"floor": {"type": "rectangle"}, **{name: EMITTERS[name] for name in some(rng, EMITTERS)}}
    if rng.random() < 0.5:
        parts["glass"] = {"type": "sphere", "center": [3, 0, 0], "radius": 0.5, "bsdf": {"type": "dielectric"}}
    if rng.random() < 0.5:
        parts["fog"] = cube_of(fog(0.5))
    plugin = load(**parts)
    choices = scene.BeamSettings(), scene.BeamSettings(beam_count=64)
    beams = [choices[rng.integers(2)] for _ in plugin.emitters()]
    return world_of_plugin(plugin, None, (Source(),), beams, [0] * len(beams))


def finders(light, number):
    """Return what finds the light of an emitter, by kinds of path; of media by their numbers.

    It is read from what is traced and sampled, not from the table. Walks hold what they were made from.
    """
    world = light.world
    emitter, walks, sharp = world.emitters[number], light.walks(world), world.mirrors
    small = emitter.lamp.bare.sharp
    traced = next((own.emitter.counts for own in light.simulation.strata(world) if own.emitter.number == number), 0)
    on_surfaces = walks.surfaces is not None and number in walks.surfaces.emitters.numbers
    virtual = on_surfaces and walks.surfaces.bound is not None and number in walks.surfaces.emitters.connected
    skies = light.single_scattering(world, 1, None) or ()
    turned = on_surfaces and number not in walks.surfaces.emitters.sharp
    sampled = number in light.lighting(world).numbers
    result = {
        "straight": [sampled, traced & Counts.DIRECT_PHOTONS and not virtual],
        "further": [on_surfaces, traced & Counts.PHOTONS],
    }
    if virtual:
        result["virtual"] = [traced & Counts.DIRECT_PHOTONS]
    if sharp:
        caught = Counts.PHOTONS | Counts.CAUSTIC_PHOTONS
        result["caustics"] = [turned if small else on_surfaces, traced & caught]
    for medium in world.media.all:
        own = [each for _, each in walks.media if number in each.emitters.numbers]
        own = [each for each in own if each.media is None or medium.number in each.media]
        names = light.simulation.walked.get(emitter.source, ())
        hidden = medium.number in {world.numbers[name] for name in names}
        straight = traced & Counts.DIRECT_BEAMS and not hidden and world.sources[emitter.source].beams
        result["fog", medium.number] = [*own, straight, number in skies]
        tallied, scattered = traced & Counts.TALLIED, traced & Counts.BEAMS and not hidden
        result["fog further", medium.number] = [*own, scattered and not tallied, tallied]
        if sharp:
            result["mirrored", medium.number] = [*own, scattered]
        if sharp and small:
            away = [each for each in own if number not in each.emitters.sharp]
            result["fog caustics", medium.number] = [*away, traced & (Counts.BEAMS | Counts.CAUSTIC_BEAMS)]
    return {kind: [each for each in found if each] for kind, found in result.items()}


@pytest.fixture
def seen_through(monkeypatch):
    """Walks, lighting and samples along segments are replaced by what they were made for."""
    for name in ("MitsubaEmitters", "StageEmitters"):
        monkeypatch.setattr(light_module, name, lambda world, chosen, *portal: chosen)
    monkeypatch.setattr(
        light_module,
        "StageLighting",
        lambda world, others: Chosen([each for each in range(len(world.emitters)) if each not in others], ()),
    )
    monkeypatch.setattr(light_module, "SingleScattering", lambda world, skies, *rest: skies)
    monkeypatch.setattr(light_module.PathEmitter, "flux", np.ones(3))


@pytest.mark.parametrize("seed", range(40))
def test_each_kind_of_light_path_is_found_once(seed, seen_through):
    rng = np.random.default_rng(seed)
    world = (stage_world if seed % 2 else scene_world)(rng)
    bounces = [None, 3][rng.integers(2)]
    short, visible = bool(rng.random() < 0.1), bool(rng.random() < 0.9)
    tuning = Tuning(max_bounces=bounces, short=short, visible=visible)
    count, little = len(world.emitters), rng.random(16) < 0.3
    off = METHODS[NAMED[rng.integers(3)]] | {*rng.choice([*Technique], rng.integers(3), replace=False)}
    seen = SeenLight(dict(enumerate(np.where(little, 0.1, 0.9))), dict(enumerate(rng.random(count))))
    rows = Techniques(world, tuning, off, seen).rows
    simulation = Simulation(
        tuning, Allotment(64, past=None, counts={row.number: row.counts for row in rows}),
        walked={world.emitters[row.number].source: row.thick for row in rows},
    )  # fmt: skip
    light = ShotLight(StillWorld(world), simulation, Settings(), bounces, 0, False, rows, None, Findings(), ())
    for number, emitter in enumerate(world.emitters):
        for kind, found in finders(light, number).items():
            sky = emitter.beams.lights_media and not emitter.beams.emits_beams
            dark = kind[0] == "fog" and sky and not world.hazy
            assert len(found) == (0 if dark else 1), (seed, emitter.name, kind, found, off)


# -- the mean stays --------------------------------------------------------------------------------------------------


def means(frames):
    """Return the mean of pictures, and its standard error."""
    found = np.array([each.mean() for each in frames])
    return found.mean(), found.std(ddof=1) / np.sqrt(len(found))


# Three rooms with fog: spots and point lamps around glass, a point lamp over coated balls, and a lamp that is a ball.
# No pilot chooses: in fog, light is beams unless these are off.
ROOMS = (18, 30, 48)


@cache
def room_mean(number, off):
    """Return the mean of pictures of a room without some techniques, and its standard error."""
    content = mi.load_dict(room(number, 12, 8))
    given = {"passes": 2, "beams": 1024, "max_depth": 4, "guiding": False, "without": off}
    extras = Extras(findings=Findings(seen=SeenLight()))
    pictures = (render(content, content.sensors()[0], Settings(seed=each, **given), extras=extras) for each in range(4))
    return means([each.layers()["rgba"][..., :3] for each in pictures])


@pytest.mark.parametrize(
    "case", sweep(product(ROOMS, Technique), keep=[(30, each) for each in (SAMPLES, WALKS, BEAMS)])
)
def test_rooms_keep_their_mean_without_a_technique(case):
    number, off = case
    (expected, error), (found, own) = room_mean(number, frozenset()), room_mean(number, frozenset({off}))
    assert abs(found - expected) < 4 * np.hypot(error, own)
    assert error < 0.05 * expected


def test_walks_find_the_caustics_of_a_wide_lamp_without_photons():
    # The lamp is so wide that a twentieth of the directions behind the ball meet it: no walk is a firefly.
    lamp = {"type": "rectangle", "to_world": T().translate([0, 2.5, 0]).rotate([1, 0, 0], 90).scale(1.5)}
    lamp["emitter"] = {"type": "area", "radiance": rgb(1.0)}
    floor = {"type": "rectangle", "to_world": T().translate([0, -1.2, 0]).rotate([1, 0, 0], -90).scale(2)}
    ball = {"type": "sphere", "center": [0, -0.4, 0], "radius": 0.6, "bsdf": {"type": "dielectric"}}
    content = load(lamp=lamp, floor=floor, ball=ball, sensor=camera(size=12, target=(0, -1, 0)))
    given = {"passes": 4, "beams": 4096, "max_depth": 5, "guiding": False}
    (found, own), (expected, error), (dark, _) = (
        means([frame.layers()["surface"] for frame in frames(content, Settings(**given | more), 4)])
        for more in ({"without": frozenset({PHOTONS})}, {}, {"without": frozenset({PHOTONS}), "max_depth": 3})
    )
    # Photon discs blur, and the parts of them beside the floor count as on the floor: half a per cent.
    assert abs(found - expected) < 4 * np.hypot(error, own) + 0.005 * expected
    assert dark < 0.95 * expected


def test_walks_of_one_lamp_do_not_meet_photons_of_another():
    # Of the green lamp, which the block does not stop, photons find all further light: once more behind each bounce
    # would be a tenth too much. The samples of the lamp are the same in both pictures, so only rounding differs.
    green = scene.SphereLight(
        "/green", (0, 20.0, 0), center=np.array([-0.5, 0.5, 0]), radius=0.1, unshadowed=frozenset({"/block"})
    )
    red = scene.SphereLight("/red", (20.0, 0, 0), center=np.array([0.5, 0.5, 0]), radius=0.1)
    shell, block = box("/room", (-1, -1, -1), (1, 1, 1)), box("/block", (-0.2, -1, -0.2), (0.2, -0.6, 0.2))
    eye = scene.Camera.look_at((0, 0, 0.9), (0, -0.3, 0), fov=80, aspect=1)
    given = {"passes": 1, "width": 16, "height": 16, "beams": 1024, "guiding": False, "max_depth": 5}
    alone, both = (
        Shot(scene.Scene(lights=lights, meshes=(shell, block)), eye).render(**given).layers["surface"]
        for lights in ((green,), (green, red))
    )
    np.testing.assert_allclose(both[..., 1], alone[..., 1], rtol=1e-4, atol=1e-6)
    assert both[..., 0].mean() > 0


def test_beams_take_the_share_of_samples_along_segments_of_a_sky():
    smoke = scene.Medium(0.3, mesh=box("/smoke", (-0.5,) * 3, (0.5,) * 3), name="/smoke")
    far = scene.Camera.look_at((0, 0, 4), (0, 0, 0), fov=20, aspect=1)
    shot, found = Shot(scene.Scene(lights=[SKY], media=[smoke]), far), []
    for off in (frozenset(), frozenset({SEGMENTS})):
        given = {"passes": 4, "width": 16, "height": 16, "beams": 8192, "guiding": False, "without": off}
        found.append(means([shot.render(seed=seed, **given).layers["beams"] for seed in range(4)]))
    (sampled, error), (traced, own) = found
    # Beams that stick out of their medium lose up to half a per cent.
    assert abs(traced - sampled) < 4 * np.hypot(error, own) + 0.005 * sampled
