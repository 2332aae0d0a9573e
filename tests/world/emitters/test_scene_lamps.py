"""Gobos and portals in front of the emitters of Mitsuba scenes: the light that passes them."""

from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

from photonbeams.render.scene_frame import Extras, render
from photonbeams.runtime.device import mitsuba
from photonbeams.scene import BeamSettings, Gobo, Mesh, SceneError
from photonbeams.world.plugin import world_of_plugin
from tests.helpers.mitsuba_scenes import T, by_beams, camera, cube_of, fog, load, rgb
from tests.helpers.tracing import emission_of

mi = mitsuba()

COUNT = 1 << 14
LIGHT = [3.0, 2.0, 1.0]
#: Looks along −X, with +Y up: +Z is on the left of a viewer who looks along it, on the right of one who faces it.
AIMED = T().look_at([2, 0.3, 0], [0, 0.3, 0], [0, 1, 0])
AREA = {"emitter": {"type": "area", "radiance": rgb(LIGHT)}}
EMITTERS = {
    "spot": {"type": "spot", "to_world": AIMED, "cutoff_angle": 35.0, "intensity": rgb(LIGHT)},
    "rectangle": {"type": "rectangle", "to_world": AIMED @ T().scale([0.7, 0.4, 1]), **AREA},
    "disk": {"type": "disk", "to_world": AIMED @ T().scale(0.5), **AREA},
    "directional": {"type": "directional", "to_world": AIMED, "irradiance": rgb(LIGHT)},
    "point": {"type": "point", "position": [2, 0.3, 0.2], "intensity": rgb(LIGHT)},
    "sphere": {"type": "sphere", "center": [2, 0.3, 0.2], "radius": 0.4, **AREA},
    "mesh": {"type": "cube", "to_world": T().translate([2, 0, 0]).scale(0.3), **AREA},
    "projector": {"type": "projector", "to_world": AIMED, "irradiance": rgb(1.0)},
    "constant": {"type": "constant", "radiance": rgb(LIGHT)},
}
#: A projected image is upright as seen from the lamp, an image on a lamp's face as seen by a viewer.
THROWN, FACES = ("spot", "directional"), ("rectangle", "disk")
WINDOW = {"type": "rectangle", "to_world": T().look_at([1, 0.3, 0.1], [2, 0.4, 0.2], [0, 1, 0]).scale([0.4, 0.3, 1]),
          "bsdf": {"type": "null"}}  # fmt: skip
#: Left white, right black.
HALF = np.array([[[1.0], [0.0]]] * 2)


def emitted(name, **given):
    scene = load(lamp=EMITTERS[name], window=WINDOW, wall={"type": "cube", "to_world": T().scale(3)})
    world = world_of_plugin(scene, None, beams=[BeamSettings(**given)])
    # With as many paths for each image, whatever passes it.
    return [replace(each, count=COUNT).emit(0) for each in emission_of(world, COUNT).strata], world


def flux(paths):
    return paths.flux.numpy().astype(np.float64).sum(axis=1)


@pytest.mark.parametrize("name", THROWN + FACES)
def test_a_white_gobo_leaves_all_light_and_one_that_is_half_black_the_left_half(name):
    ((bare,), _) = emitted(name)
    ((white,), _) = emitted(name, gobo=Gobo(np.ones((2, 2, 3)), repeat=True))
    np.testing.assert_array_equal(white.flux.numpy(), bare.flux.numpy())
    # The image fades between the centres of its two pixels; it is symmetric, so half of the light remains.
    ((half,), _) = emitted(name, gobo=Gobo(HALF, width=12.0))
    np.testing.assert_allclose(flux(half), flux(bare) / 2, rtol=0.01)
    lit = half.flux.numpy()[0] > 0.99 * bare.flux.numpy()[0]
    left = (half.origin if name != "spot" else half.direction).numpy()[2] * (1 if name in THROWN else -1)
    assert lit.any() and (left[lit] > -1e-5).all()


@pytest.mark.parametrize("name", EMITTERS)
def test_a_portal_parts_the_light_and_loses_none(name):
    ((whole,), world) = emitted(name)
    ((through, beside), world) = emitted(name, portal="window")
    portal = world.emitters[0].portal
    crossing = portal.crosses(whole.origin, whole.direction).numpy()
    value = whole.flux.numpy().astype(np.float64)
    part = (value * crossing).sum(axis=1)
    # The error of independent samples; that of stratified ones is smaller.
    error = np.sqrt(len(crossing)) * (value * crossing).std(axis=1)
    assert (np.abs(flux(through) - part) < 4.5 * error).all()
    assert (np.abs(flux(beside) - (flux(whole) - part)) < 4.5 * 2 * error).all()
    lit = through.flux.numpy()[0] > 0
    assert portal.crosses(through.origin, through.direction).numpy()[lit].mean() > 0.999
    assert not portal.crosses(beside.origin, beside.direction).numpy()[beside.flux.numpy()[0] > 0].any()
    if name == "constant":  # π L over the area, from both sides
        np.testing.assert_allclose(flux(through), 2 * np.pi * 4 * 0.4 * 0.3 * np.array(LIGHT), rtol=0.01)


def test_an_emitter_keeps_as_many_paths_as_it_says():
    scene = load(lamp=EMITTERS["point"], other=EMITTERS["constant"], wall={"type": "rectangle"})
    said = {each.id(): BeamSettings(beam_count=321) if each.id() == "lamp" else BeamSettings() for each in
            scene.emitters()}  # fmt: skip
    strata = emission_of(world_of_plugin(scene, None, beams=list(said.values())), 1000).strata
    assert {each.emitter.name: each.count for each in strata}["lamp"] == 321


#: A room of black walls with an opening, fog inside, and a floor.
BLACK = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(0.0)}}
GREY = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(0.5)}}
LAMP = {"type": "spot", "to_world": T().look_at([2, 0.4, 0], [1, 0, 0], [0, 1, 0]), "cutoff_angle": 40.0,
        "intensity": rgb(5.0)}  # fmt: skip
OPENING = T().translate([1, 0, 0]).rotate([0, 1, 0], -90).scale([0.3, 0.3, 1])


def room(lamp, **more):
    sides = {
        f"side{k}": {"type": "rectangle", "bsdf": BLACK, "to_world": T().translate([1, *place]).rotate([0, 1, 0], -90)
                     .scale([*size, 1])}
        for k, (place, size) in enumerate(
            [((0.95, 0), (1.0, 0.65)), ((-0.65, 0), (1.0, 0.35)), ((0, 0.65), (0.35, 0.3)), ((0, -0.65), (0.35, 0.3))]
        )
    }  # fmt: skip
    floor = {"type": "rectangle", "bsdf": GREY, "to_world": T().translate([0, -0.5, 0]).rotate([1, 0, 0], -90)}
    window = {"type": "rectangle", "bsdf": {"type": "null"}, "to_world": OPENING}
    return load(
        False, fog=cube_of(fog(0.5), 0.99), floor=floor, lamp=lamp, opening=window, sensor=camera(**more), **sides
    )


def pictures(scene, beams=None, seeds=4, **given):
    settings = {"passes": 2, "beams": 2048, "max_depth": 4, "radius": 0.02, "alpha": 1.0, "guiding": False, **given}
    extras = Extras(beams or {})
    found = [
        render(scene, scene.sensors()[0], by_beams(seed=seed, **settings), extras=extras).layers()
        for seed in range(seeds)
    ]
    return {name: np.array([each[name][..., :3] for each in found]) for name in ("beams", "surface", "rgba")}


def test_a_portal_leaves_the_mean_as_it_is():
    scene = room(LAMP)
    bare = pictures(scene)
    own = pictures(scene, {"lamp": BeamSettings(portal="opening")})
    for name in ("beams", "surface"):
        means = [each[name].mean(axis=(1, 2)) for each in (bare, own)]
        error = np.sqrt(sum(each.var(axis=0, ddof=1) / len(each) for each in means))
        difference = np.abs(means[0].mean(axis=0) - means[1].mean(axis=0))
        assert (difference < 4.5 * error + 0.003 * means[0].mean(axis=0)).all(), (name, means, error)


@pytest.mark.parametrize("where", ["gobo", "portal_gobo"])
def test_surfaces_and_beams_see_the_same_image(where):
    """An image of one colour that all light passes colours beams and surfaces alike."""
    scene = room(LAMP)
    color = np.array([0.2, 0.5, 1.0])
    image = Gobo(np.ones((1, 1, 3)) * color, repeat=True)
    plain, own = (
        pictures(scene, {"lamp": BeamSettings(portal="opening", **given)}, seeds=1) for given in ({}, {where: image})
    )
    for name in ("beams", "surface"):
        assert plain[name].any()
        np.testing.assert_allclose(own[name], plain[name] * color, rtol=1e-3, atol=1e-6)


def test_the_sky_behind_a_portal_has_the_colours_of_its_image():
    """The image colours the sky, also if there are boundaries of media on either side of the image."""
    null = {"type": "null"}
    pane = {"type": "rectangle", "to_world": T().scale(4), "bsdf": null}
    planes = [{"type": "rectangle", "to_world": T().translate([0, 0, z]).scale(5), "bsdf": null} for z in (-1, 1)]
    scene = load(
        False, sky={"type": "constant", "radiance": 1.0}, pane=pane, far=planes[0], near=planes[1], sensor=camera()
    )
    color = np.array([0.2, 0.5, 1.0])
    said = BeamSettings(portal="pane", portal_gobo=Gobo(np.ones((1, 1, 3)) * color))
    found = pictures(scene, {"sky": said}, seeds=1)["rgba"]
    np.testing.assert_allclose(found, np.broadcast_to(color, found.shape), rtol=1e-5)


def fan(points):
    return Mesh("hole", np.array(points, dtype=float), np.array([[0, 1, 2], [0, 2, 3]]))


@pytest.mark.parametrize(
    ("name", "given", "words"),
    [
        ("mesh", {"gobo": Gobo(HALF)}, "emitter lamp is of type AreaLight, which cannot have a gobo: expected a point"),
        ("constant", {"gobo": Gobo(HALF)}, "which cannot have a gobo"),
        ("projector", {"gobo": Gobo(HALF)}, "emitter lamp is of type Projector, which cannot have a gobo"),
        ("spot", {"portal": "door"}, r"'door' is no shape of the scene: expected one with a null BSDF \(window\)"),
        ("spot", {"portal": "wall"}, "its portal wall stops light: expected a null BSDF"),
        ("spot", {"portal_gobo": Gobo(HALF)}, "has a gobo on its portal, but no portal"),
        ("spot", {"portal": fan([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5]])}, "hole is not flat"),
        ("constant", {"portal": fan([[0, 0, 9], [1, 0, 9], [1, 1, 9], [0, 1, 9]])}, "hole lies outside of the scene"),
    ],
)
def test_what_an_emitter_cannot_have_is_told_in_a_sentence(name, given, words):
    with pytest.raises(SceneError, match=words):
        emitted(name, **given)


@pytest.mark.parametrize("name", ["spot", "directional", "projector"])
@pytest.mark.parametrize("scale", [0.01, 7.0])
def test_paths_have_unit_directions_and_the_light_of_direct_samples_whatever_the_scale(monkeypatch, name, scale):
    before, _ = emitted(name)
    scaled = AIMED @ T().scale(scale)
    monkeypatch.setitem(EMITTERS, name, {**EMITTERS[name], "to_world": scaled})
    after, _ = emitted(name)
    np.testing.assert_allclose(np.linalg.norm(after[0].direction.numpy(), axis=0), 1, rtol=1e-5)

    def direct(to_world):
        lamp = mi.load_dict({**EMITTERS[name], "to_world": to_world})
        lamp.set_scene(load(wall={"type": "cube", "to_world": T().scale(3)}))
        place = dr.zeros(mi.Interaction3f)
        place.p = mi.Point3f(0.0, 0.3, 0.0)
        return np.ravel(lamp.sample_direction(place, mi.Point2f(0.5), True)[1])

    # Mitsuba's direct light of a projector grows with the scale.
    expected = flux(before[0]) * direct(scaled) / direct(AIMED) if name == "projector" else flux(before[0])
    np.testing.assert_allclose(flux(after[0]), expected, rtol=1e-4)
