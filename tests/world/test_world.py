"""The shot as Mitsuba sees it: bounds, fog and materials."""

import dataclasses

import drjit as dr
import numpy as np
import pytest

from photonbeams import scene
from photonbeams.numerics.arrays import to_vectors
from photonbeams.runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from photonbeams.world.described import world_of_scene
from photonbeams.world.plugin import world_of_plugin
from photonbeams.world.surfaces import shapes
from tests.helpers.comparison import box, comparison_scene, quad

mi = mitsuba()
CUBE = box("/fog", [-1, -1, -1], [1, 1, 1])


def dimming(mesh, origin, direction, distance):
    """Return the transmittance of a fog along a ray."""
    world = world_of_scene(scene.Scene(media=(scene.Medium((0.5, 1.0, 2.0), mesh=mesh),)))
    start, ahead, always = Array3f(*origin), Array3f(*direction), dr.full(Bool, True, 1)
    medium = world.medium_of_view(start, ahead)
    return world.dimming(start, ahead, Float(distance), medium, UInt32(0), always).numpy().ravel()


def test_bounds_hold_everything_there_is():
    world = world_of_scene(comparison_scene(), viewpoints=[(10.0, 1.5, 0.0)])
    center = world.bounds.center.numpy().ravel()
    for point in [(10.0, 1.5, 0.0), (-2, 0, -2), (-2, 3, 2), (-1.9, 1.5, 0)]:
        assert np.linalg.norm(center - point) <= world.radius
    assert world.radius < 7
    assert world_of_scene(scene.Scene()).radius == 1


@pytest.mark.parametrize("inward", [False, True])
@pytest.mark.parametrize(
    ("origin", "direction", "distance", "inside"),
    [
        ((-3, 0.2, 0.1), (1, 0, 0), 9, 2), ((-3, 0.2, 0.1), (1, 0, 0), np.inf, 2), ((-3, 2, 0), (1, 0, 0), 9, 0),
        ((-3, 0.2, 0.1), (1, 0, 0), 1, 0), ((-3, 0.2, 0.1), (1, 0, 0), 2.5, 0.5),
        ((0.5, 0.2, 0.1), (0, 0, -1), np.inf, 1.1),
    ],
)  # fmt: skip
def test_a_bounded_fog_dims_only_where_it_is(inward, origin, direction, distance, inside):
    mesh = dataclasses.replace(CUBE, faces=CUBE.faces[:, ::-1]) if inward else CUBE
    # Mitsuba's rays begin 1500 roundings of 1 + |x| behind each interface.
    tolerance = 2.0 * 2 * 1500 * 4 * 2.0**-24
    found = dimming(mesh, origin, direction, distance)
    assert np.allclose(found, np.exp(-inside * np.array([0.5, 1, 2])), rtol=tolerance)


def test_unbounded_fog_does_not_dim_what_is_infinitely_far():
    assert np.allclose(dimming(None, (0, 0, 0), (1, 0, 0), 3), np.exp([-1.5, -3, -6]), rtol=1e-6)
    assert np.array_equal(dimming(None, (0, 0, 0), (1, 0, 0), np.inf), [1, 1, 1])


def test_materials_of_every_kind_become_surfaces():
    image = np.full((2, 2, 1), 0.5, dtype=np.float32)
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    normals = np.broadcast_to([0.0, 0, 1], (4, 3))
    materials = [
        scene.Material(diffuse=scene.UVTexture(np.repeat(image, 3, axis=2)), roughness=scene.UVTexture(image, "clamp")),
        scene.Material(metallic=scene.UVTexture(image, "mirror"), opacity=scene.UVTexture(image), ior=0.7),
        scene.Material(diffuse=(2.0, 0.5, -0.0), clearcoat=1.0, clearcoat_roughness=0.5, ior=1.0),
        scene.Material(diffuse=scene.UVTexture(image), emissive=scene.UVTexture(image), opacity=0.5),
    ]
    cards = [
        dataclasses.replace(
            quad(f"/{i}", [[i, 0, 0], [i + 1, 0, 0], [i + 1, 1, 0], [i, 1, 0]], material), uvs=uvs, normals=normals
        )
        for i, material in enumerate(materials)
    ]
    empty = scene.Mesh("/empty", np.zeros((0, 3)), np.zeros((0, 3), dtype=int))
    world = world_of_scene(scene.Scene(meshes=(*cards, empty)))
    assert world.cutouts and world.glowing
    origin = Array3f(Float(np.arange(4) + 0.5), 0.5, 1.0)
    hit = world.surfaces.ray_intersect(_ray(origin))
    clear = hit.bsdf().eval_null_transmission(hit).numpy()
    assert np.allclose(clear, [[0, 0.5, 0, 0.5]] * 3, atol=1e-6)


def _ray(origin):
    return mi.Ray3f(mi.Point3f(origin), mi.Vector3f(0, 0, -1))


def test_rays_pass_many_clear_layers_to_the_solid_one():
    clear = scene.Material(opacity=0.0)
    sheets = [quad(f"/{i}", [[-9, -9, -i], [9, -9, -i], [9, 9, -i], [-9, 9, -i]], clear) for i in range(1, 20)]
    solid = quad("/solid", [[-9, -9, -21], [9, -9, -21], [9, 9, -21], [-9, 9, -21]])
    world = world_of_scene(scene.Scene(meshes=(*sheets, solid)))
    always = dr.full(Bool, True, 1)
    hit = world.intersect(Array3f(0.3, 0.2, 0), Array3f(0, 0, -1), always, UInt32(1))
    assert np.isclose(hit.t[0], 21, rtol=1e-5)
    blocked = [
        world.solids.blocked(Array3f(0.3, 0.2, 0), Array3f(0, 0, -1), Float(t), always, UInt32(1))[0] for t in (20, 22)
    ]
    assert blocked == [False, True]


@pytest.mark.parametrize("angle", [0.0, 0.5])
def test_rays_in_fog_meet_the_floor_that_its_box_stands_on(angle):
    """Rays in a fog's box meet the floor, not the face that the box has in common with it, however both are turned.

    Without a floor in that place they meet the box.
    """
    sine, cosine = np.sin(angle), np.cos(angle)
    turn = np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
    corners = np.array([[-2, -1, -2], [-2, -1, 2], [2, -1, 2], [2, -1, -2]])
    fog = scene.Medium((0.5, 0.5, 0.5), mesh=dataclasses.replace(CUBE, points=CUBE.points @ turn.T))
    x, z = np.random.default_rng(0).uniform(-0.99, 0.99, (2, 500))
    origin = to_vectors(np.stack([x, 0 * x, z], axis=1) @ turn.T)
    down, always = Array3f(*(turn @ [0, -1, 0]).tolist()), dr.full(Bool, True, 500)
    for depth, transmits in ((0, False), (0.01, True)):
        floor = quad("/floor", (corners - [0, depth, 0]) @ turn.T)
        world = world_of_scene(scene.Scene(meshes=(floor,), media=(fog,)))
        hit = world.intersect(origin, down, always, UInt32(1))
        assert np.allclose(hit.t.numpy(), 1, atol=1e-5)
        assert np.all(hit.is_medium_transition().numpy() == transmits)


class Spy:
    """Mitsuba, with a record of the scenes that were loaded with a host, and of their hosts."""

    def __init__(self):
        self.hosts = []

    def __getattr__(self, name):
        return getattr(mi, name)

    def load_dict(self, content):
        result = mi.load_dict(content)
        if "host" in content:
            self.hosts.append((result, content["host"]))
        return result


def test_on_cuda_all_scenes_in_which_a_kernel_traces_rays_share_the_table_of_one(monkeypatch):
    # Dr.Jit skips, with a warning, the rays in scenes that do not share one shader binding table.
    spy = Spy()
    monkeypatch.setattr(shapes, "backend", lambda: "cuda")
    monkeypatch.setattr(shapes, "mi", spy)
    wall, lamp, hole = (quad(f"/{x}", [[x, -1, -1], [x, 1, -1], [x, 1, 1], [x, -1, 1]]) for x in (3, 4, 2))
    white = {"radiance": (1.0, 1.0, 1.0)}
    world = world_of_scene(
        scene.Scene(
            meshes=(wall,),
            lights=(
                scene.MeshLight("/lamp", mesh=lamp, unshadowed=frozenset({"/3"}), **white),
                scene.SphereLight("/bulb", radius=0.1, center=(0.0, 0, 0), portal=hole, **white),
            ),
            media=tuple(scene.Medium((1.0,) * 3, mesh=box(f"/{x}", [x, 0, 0], [x + 1, 1, 1])) for x in (5, 7)),
        )
    )
    portal, light = (
        next(each.portal for each in world.emitters if each.name == "/bulb").scene,
        world.emitters[0].lamp._scene,
    )
    scenes = [world.surfaces, world.plugin, world.around, *world.everything.others, portal, light]
    assert all((each, world.host) in spy.hosts for each in [*scenes, *world.blockers.values()])
    ray = mi.Ray3f(mi.Point3f(dr.linspace(Float, 0, 1, 2), 0.5, 0.25), mi.Vector3f(1, 0, 0))
    found = sum(each.ray_intersect(ray).t for each in scenes)
    assert np.allclose(found, np.array([3 + 3 + 5 + 5 + 2 + 4]) - [0, 6], rtol=1e-5)

    fog = {"type": "cube", "bsdf": {"type": "null"}, "interior": {"type": "homogeneous"}}
    plugin = mi.load_dict({"type": "scene", "fog": fog, "lamp": {"type": "point"}})
    assert (world_of_plugin(plugin).without_surfaces().plugin, plugin) in spy.hosts


def test_rays_meet_what_is_not_hidden_from_them():
    front = dataclasses.replace(box("/front", [-1, -1, -1], [1, 1, 0]), seen=False, blocks=False)
    back = dataclasses.replace(box("/back", [-1, -1, -5], [1, 1, -4]), holdout=True)
    lamp = scene.SphereLight("/lamp", 1.0, center=(0, 9, 0), radius=0.1)
    world = world_of_scene(scene.Scene((front, back), (lamp,)))
    start, ahead, active = Array3f(0.1, 0.2, [3, 3]), Array3f(0, 0, -1), dr.full(Bool, True, 2)
    hit = world.seen(start, ahead, Float(np.inf), active, UInt32(0), Bool([True, False]))
    assert np.allclose(hit.t.numpy(), [7, 3])  # straight from the camera; after a mirror
    assert world.held_out(hit, start, ahead, active).numpy().tolist() == [True, False]
    (emitter,) = world.emitters
    each = (world, world.stopping(emitter.links))
    blocked = [own.solids.blocked(start, ahead, Float(5), active, UInt32(0)).numpy().all() for own in each]
    assert blocked == [True, False]
