"""Surfaces as Mitsuba's shapes: one for the meshes of a material, and built again only where something has changed."""

from dataclasses import replace

import numpy as np
import pytest

import photonbeams as pb
from photonbeams import scene
from photonbeams.render.worlds import ShutterWorlds
from photonbeams.world.described import world_of_scene
from photonbeams.world.shutter import Shutter
from photonbeams.world.surfaces import build
from tests.helpers.comparison import box
from tests.helpers.sweep import sweep

RED, BLUE = scene.Material(diffuse=(0.8, 0.1, 0.1)), scene.Material(diffuse=(0.1, 0.1, 0.8), roughness=0.3)
GLASS = scene.Material(opacity=0.0, roughness=0.0)
CAMERA = scene.Camera("/Camera", np.eye(4) + np.outer([0, 0, 1, 0], [0, 0, 0, 7.0]), focal_length=2.0)


def boxes(count, materials, seed=3):
    """Return boxes of random places and sizes, with one material after the other."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-2, 1.5, (count, 3))
    sizes = rng.uniform(0.1, 0.8, (count, 3))
    return [
        replace(box(f"/Box{number}", low, low + size), material=materials[number % len(materials)])
        for number, (low, size) in enumerate(zip(corners, sizes, strict=True))
    ]


def lamp(**given):
    return scene.SphereLight("/Lamp", (9.0, 8.0, 7.0), center=(1.0, 2.5, 3.0), radius=0.3, **given)


def picture(meshes, **given):
    content = scene.Scene(meshes=tuple(meshes), lights=(lamp(**given),), media=(pb.Medium(scattering=0.05),))
    return pb.Shot(content, CAMERA).render(passes=2, width=32, height=24, max_depth=3).layers["rgba"]


def test_the_meshes_of_a_material_are_one_shape_as_long_as_it_is_small(monkeypatch):
    meshes = boxes(12, [RED, BLUE])
    assert [len(each) for each in build.grouped(meshes, (), (), True)] == [6, 6]
    corners = len(meshes[0].points)
    monkeypatch.setattr(build, "_MOST", 4 * corners + 1)
    assert [len(each) for each in build.grouped(meshes, (), (), True)] == [4, 4, 2, 2]
    monkeypatch.setattr(build, "_MOST", corners - 1)  # a large mesh is a shape by itself
    assert [len(each) for each in build.grouped(meshes, (), (), True)] == [1] * 12


def test_what_lights_or_media_treat_in_another_way_is_a_shape_of_its_own():
    meshes = boxes(6, [RED])
    meshes[5] = replace(meshes[5], seen=False)
    names = {"/Box1", "/Box4"}
    found = build.grouped(meshes, {id(meshes[2])}, [frozenset(names)], True)
    assert {frozenset(each.name for each in group) for group in found} == {
        frozenset(names), frozenset({"/Box2"}), frozenset({"/Box0", "/Box3"}), frozenset({"/Box5"}),
    }  # fmt: skip


@pytest.mark.parametrize("linked", sweep([False, True], keep=[True]))
def test_a_picture_of_groups_is_that_of_single_shapes(linked):
    meshes = boxes(14, [RED, BLUE, GLASS])
    names = {"unlit": frozenset({"/Box0", "/Box4"}), "unshadowed": frozenset({"/Box1"})} if linked else {}
    together = picture(meshes, **names)
    apart = picture([replace(each, material=replace(each.material)) for each in meshes], **names)
    assert np.allclose(together, apart, rtol=1e-4, atol=1e-6) and together[..., :3].max() > 0.01


def test_only_shapes_of_what_has_changed_are_built_again():
    meshes = boxes(9, [RED, BLUE, GLASS])
    media = (pb.Medium(scattering=0.05),)
    first = world_of_scene(scene.Scene(meshes=tuple(meshes), media=media), sharp=True)
    assert len(first.shapes) == 2 + 3  # bodies of glass are shapes of their own
    green = scene.Material(diffuse=(0.1, 0.8, 0.1))
    edited = [replace(each, material=green) if each.material is RED else each for each in meshes]
    second = world_of_scene(scene.Scene(meshes=tuple(edited), media=media), like=first, sharp=True)
    kept = {name for name, shape in first.shapes if any(shape is other for _, other in second.shapes)}
    assert kept == {"/Box1", "/Box2", "/Box5", "/Box8"} and second.surfaces is not first.surfaces
    same = world_of_scene(scene.Scene(meshes=tuple(edited), media=media), like=second, sharp=True)
    assert same.surfaces is second.surfaces
    denser = scene.Scene(meshes=tuple(edited), media=(pb.Medium(scattering=0.1),))  # the fog around the glass
    third = world_of_scene(denser, like=second, sharp=True)
    kept = {name for name, shape in third.shapes if any(shape is other for _, other in second.shapes)}
    assert kept == {"/Box0", "/Box1"}


def test_worlds_with_and_without_mirrors_and_glass_are_not_mixed():
    content = scene.Scene(meshes=tuple(boxes(2, [RED, GLASS])), lights=(lamp(),))
    shutter = Shutter.still(content, CAMERA)
    plain = ShutterWorlds(shutter, sharp=False)
    sharp = ShutterWorlds(shutter, sharp=True, earlier=[plain.opened])
    assert sharp.opened is not plain.opened and sharp.opened.mirrors and not plain.opened.mirrors
    again = ShutterWorlds(shutter, sharp=True, earlier=[plain.opened, sharp.opened])
    assert again.opened is sharp.opened and again.known == [sharp.opened]
