"""The shot as Mitsuba sees it: bounds, fog and materials."""

import dataclasses

import drjit as dr
import numpy as np
import pytest

from comparison import box, comparison_scene, quad
from photonbeams import scene
from photonbeams.runtime.device import Array3f, Bool, Float, UInt32
from photonbeams.world.stage_world import StageWorld

CUBE = box("/fog", [-1, -1, -1], [1, 1, 1])


def fog_of(mesh):
    return StageWorld.build(scene.Scene(media=(scene.Medium((0.5, 1.0, 2.0), mesh=mesh),))).fog


def interval(fog, origin, direction):
    enter, leave, normal = fog.interval(Array3f(*origin), Array3f(*direction))
    return enter.numpy()[0], leave.numpy()[0], normal.numpy().ravel()


def test_bounds_hold_everything_there_is():
    world = StageWorld.build(comparison_scene(), viewpoints=[(10.0, 1.5, 0.0)])
    center = world.bounds.center.numpy().ravel()
    for point in [(10.0, 1.5, 0.0), (-2, 0, -2), (-2, 3, 2), (-1.9, 1.5, 0)]:
        assert np.linalg.norm(center - point) <= world.radius
    assert world.radius < 7
    assert StageWorld.build(scene.Scene()).radius == 1


@pytest.mark.parametrize("inward", [False, True])
def test_a_ray_knows_where_fog_begins_and_ends(inward):
    mesh = dataclasses.replace(CUBE, faces=CUBE.faces[:, ::-1]) if inward else CUBE
    fog = fog_of(mesh)
    enter, leave, normal = interval(fog, (-3, 0.2, 0.1), (1, 0, 0))
    assert np.allclose([enter, leave, *normal], [2, 4, 1, 0, 0], atol=1e-5)
    enter, leave, normal = interval(fog, (0.5, 0.2, 0.1), (0, 0, -1))
    assert np.allclose([enter, leave, *normal], [0, 1.1, 0, 0, -1], atol=1e-5)
    enter, leave, _ = interval(fog, (-3, 2, 0), (1, 0, 0))
    assert enter > leave


def test_length_in_fog_ends_at_the_given_distance():
    fog = fog_of(CUBE)
    start, ahead = Array3f(-3, 0.2, 0.1), Array3f(1, 0, 0)
    for distance, expected in ((1, 0), (2.5, 0.5), (9, 2), (np.inf, 2)):
        assert np.isclose(fog.length(start, ahead, Float(distance))[0], expected, atol=1e-5)
    through = fog.transmittance(start, ahead, Float(9)).numpy().ravel()
    assert np.allclose(through, np.exp([-1, -2, -4]), rtol=1e-5)


def test_unbounded_fog_does_not_dim_what_is_infinitely_far():
    fog = fog_of(None)
    assert fog.length(Array3f(0), Array3f(1, 0, 0), Float(3))[0] == 3
    assert fog.length(Array3f(0), Array3f(1, 0, 0), Float(np.inf))[0] == 0


def test_materials_of_every_kind_become_surfaces():
    image = np.full((2, 2, 1), 0.5, dtype=np.float32)
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    normals = np.broadcast_to([0.0, 0, 1], (4, 3))
    materials = [
        scene.Material(diffuse=scene.Texture(np.repeat(image, 3, axis=2)), roughness=scene.Texture(image, "clamp")),
        scene.Material(metallic=scene.Texture(image, "mirror"), opacity=scene.Texture(image), ior=0.7),
        scene.Material(diffuse=(2.0, 0.5, -0.0), clearcoat=1.0, clearcoat_roughness=0.5, ior=1.0),
        scene.Material(diffuse=scene.Texture(image), emissive=scene.Texture(image), opacity=0.5),
    ]
    cards = [
        dataclasses.replace(
            quad(f"/{i}", [[i, 0, 0], [i + 1, 0, 0], [i + 1, 1, 0], [i, 1, 0]], material), uvs=uvs, normals=normals
        )
        for i, material in enumerate(materials)
    ]
    empty = scene.Mesh("/empty", np.zeros((0, 3)), np.zeros((0, 3), dtype=int))
    world = StageWorld.build(scene.Scene(meshes=(*cards, empty)))
    assert world.cutouts and world.glowing
    origin = Array3f(Float(np.arange(4) + 0.5), 0.5, 1.0)
    hit = world.surfaces.ray_intersect(_ray(origin))
    clear = hit.bsdf().eval_null_transmission(hit).numpy()
    assert np.allclose(clear, [[0, 0.5, 0, 0.5]] * 3, atol=1e-6)


def _ray(origin):
    from photonbeams.runtime.device import mitsuba

    mi = mitsuba()
    return mi.Ray3f(mi.Point3f(origin), mi.Vector3f(0, 0, -1))


def test_rays_pass_many_clear_layers_to_the_solid_one():
    clear = scene.Material(opacity=0.0)
    sheets = [quad(f"/{i}", [[-9, -9, -i], [9, -9, -i], [9, 9, -i], [-9, 9, -i]], clear) for i in range(1, 20)]
    solid = quad("/solid", [[-9, -9, -21], [9, -9, -21], [9, 9, -21], [-9, 9, -21]])
    world = StageWorld.build(scene.Scene(meshes=(*sheets, solid)))
    always = dr.full(Bool, True, 1)
    hit = world.intersect(Array3f(0.3, 0.2, 0), Array3f(0, 0, -1), always, UInt32(1))
    assert np.isclose(hit.t[0], 21, rtol=1e-5)
    blocked = [world.blocked(Array3f(0.3, 0.2, 0), Array3f(0, 0, -1), Float(t), always, UInt32(1))[0] for t in (20, 22)]
    assert blocked == [False, True]
