"""Irradiance below lamps that lie in the plane of a surface, of any size and anywhere, against closed forms.

The draws are bounded by float32 alone: a lamp, and its height, are many times the rounding error of their place.
"""

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams import scene
from photonbeams.numerics.arrays import to_vectors
from photonbeams.numerics.sampling import sobol_block
from photonbeams.runtime.device import Array3f, Bool, UInt32, mitsuba
from photonbeams.transport.emission import PathEmitter
from photonbeams.world.described import world_of_scene
from photonbeams.world.plugin import world_of_plugin
from tests.helpers.shading import shade

mi = mitsuba()
MATTE = scene.Material(diffuse=(0.5, 0.5, 0.5), roughness=1.0, ior=1.0)
KINDS = "rectangle", "mesh", "disk", "sphere"
COUNT = 1 << 12


def rectangle(name, center, x, y):
    """Return a matte rectangle with the half axes x and y."""
    points = np.array([center - x - y, center + x - y, center + x + y, center - x + y])
    return scene.Mesh(name, points, np.array([[0, 1, 2], [0, 2, 3]]), material=MATTE)


class Draw:
    """A point on a floor and a lamp above it, at a random place, scale and turn."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        far, size = 10 ** rng.uniform(-3, 5), 10 ** rng.uniform(-3, 3)
        self.size = max(size, far * 2.0**-24 * 2000)
        self.place = far * unit(rng.normal(size=3))
        self.up = unit(rng.normal(size=3))
        self.x = unit(np.cross(self.up, rng.normal(size=3)))
        self.y = np.cross(self.up, self.x)
        self.height, self.half = self.size * 10 ** rng.uniform(-0.7, 0.5), self.size / 2
        self.floor = 10 ** rng.uniform(-1, 1.5) * self.size
        self.center = self.place + self.height * self.up

    def lamp(self, kind):
        """Return a lamp, the surface in whose plane it lies, and the irradiance at the place: radiance 1."""
        radiance, ceiling = (
            (1.0,) * 3,
            rectangle("/ceiling", self.center, 4 * self.size * self.x, 4 * self.size * self.y),
        )
        half_x, half_y = self.half * self.x, self.half * self.y
        if kind == "mesh":  # it is its own surface
            corners = rectangle("/lamp", self.center, half_x, -half_y)
            return scene.MeshLight("/lamp", radiance, mesh=corners), corners, self._below_rectangle()
        if kind == "sphere":
            radius = min(self.half, 0.8 * self.height)
            light = scene.SphereLight("/lamp", radiance, center=self.center, radius=radius)
            return light, rectangle("/ceiling", self.center + radius * self.up, *(4 * self.size * each for each in (
                self.x, self.y))), np.pi * (radius / self.height) ** 2  # fmt: skip
        light = scene.FlatLight(
            "/lamp", radiance, center=self.center, half_x=half_x, half_y=half_y, axis=-self.up, disk=kind == "disk"
        )
        disk = np.pi * self.half**2 / (self.half**2 + self.height**2)
        return light, ceiling, disk if kind == "disk" else self._below_rectangle()

    def _below_rectangle(self):
        """Return the irradiance below the centre of a square (four times that below its corner)."""
        a = self.half / self.height
        return 4 * a / np.hypot(1, a) * np.arctan(a / np.hypot(1, a))


def unit(vector):
    return vector / np.linalg.norm(vector)


def irradiance(draw, light, walls, eye):
    """Return the irradiance at the place over the mean of many samples, and its standard error."""
    world = world_of_scene(scene.Scene(tuple(walls), (light,)), viewpoints=[eye])
    rays = (to_vectors(np.broadcast_to(each, (COUNT, 3))) for each in (eye, unit(draw.place - eye)))
    radiance = shade(world, *rays, dr.arange(UInt32, COUNT)).radiance.numpy()[0].astype(np.float64)
    value = radiance / 0.5 * np.pi
    return value.mean(), value.std() / np.sqrt(COUNT)


@pytest.mark.parametrize("kind", KINDS)
def test_a_lamp_in_the_plane_of_a_surface_lights_what_is_below_it(kind):
    for seed in range(8):
        draw = Draw((seed, KINDS.index(kind)))
        light, ceiling, expected = draw.lamp(kind)
        floor = rectangle("/floor", draw.place, draw.floor * draw.x, draw.floor * draw.y)
        eye = draw.place + 0.1 * draw.height * draw.up + 0.05 * draw.height * draw.x
        mean, error = irradiance(draw, light, [floor, ceiling], eye)
        assert abs(mean - expected) < 0.005 * expected + 4 * error, (seed, vars(draw))


@pytest.mark.parametrize("kind", KINDS[:3])
def test_a_wall_just_above_the_floor_hides_half_of_a_lamp(kind):
    for seed in range(6):
        draw = Draw((seed, 10 + KINDS.index(kind)))
        light, ceiling, expected = draw.lamp(kind)
        floor = rectangle("/floor", draw.place, draw.floor * draw.x, draw.floor * draw.y)
        wide = 40 * (draw.half + draw.height)
        wall = rectangle(
            "/wall", draw.place + 0.05 * draw.height * draw.up - wide * draw.x, wide * draw.x, wide * draw.y
        )
        eye = draw.place + 0.03 * draw.height * draw.up + 0.01 * draw.height * draw.x
        mean, error = irradiance(draw, light, [floor, ceiling, wall], eye)
        assert abs(mean - expected / 2) < 0.005 * expected + 4 * error, (seed, vars(draw))


@pytest.mark.parametrize("kind", KINDS[:3])
def test_all_light_paths_leave_a_lamp_in_the_plane_of_a_surface(kind):
    for seed in range(6):
        draw = Draw((seed, 20 + KINDS.index(kind)))
        light, ceiling, _ = draw.lamp(kind)
        world = world_of_scene(scene.Scene((ceiling,), (light,)), viewpoints=[draw.place])
        paths = PathEmitter(world, 0).sample(*sobol_block(COUNT, 0, (seed,)))
        hit = world.intersect(paths.origin, paths.direction, Bool(True), dr.arange(UInt32, COUNT))
        assert not np.any(hit.is_valid().numpy()), (seed, vars(draw))


@pytest.mark.parametrize("kind", ["rectangle", "disk"])
def test_cameras_see_all_of_a_lamp_in_the_plane_of_a_surface(kind):
    for seed in range(6):
        draw = Draw((seed, 40 + KINDS.index(kind)))
        light, ceiling, _ = draw.lamp(kind)
        world = world_of_scene(scene.Scene((ceiling,), (light,)), viewpoints=[draw.place])
        side = 0.6 * draw.half * np.random.default_rng(seed).uniform(-1, 1, (2, COUNT, 1))
        ray = draw.center + side[0] * draw.x + side[1] * draw.y - draw.place
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        origin = to_vectors(np.broadcast_to(draw.place, (COUNT, 3)))
        radiance = shade(world, origin, to_vectors(ray), dr.arange(UInt32, COUNT)).radiance.numpy()
        assert np.all(np.abs(radiance - 1) < 1e-5), (seed, vars(draw))


def test_the_back_of_a_mesh_that_shines_is_dark():
    for seed in range(6):
        draw = Draw((seed, 60))
        light, panel, _ = draw.lamp("mesh")
        world = world_of_scene(scene.Scene((panel,), (light,)), viewpoints=[draw.center + draw.height * draw.up])
        side = 0.9 * draw.half * np.random.default_rng(seed).uniform(-1, 1, (2, COUNT, 1))
        ray = side[0] * draw.x + side[1] * draw.y - draw.height * draw.up
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        origin = to_vectors(np.broadcast_to(draw.center + draw.height * draw.up, (COUNT, 3)))
        radiance = shade(world, origin, to_vectors(ray), dr.arange(UInt32, COUNT)).radiance.numpy()
        assert np.all(radiance == 0), (seed, vars(draw))


def test_emitters_of_mitsuba_scenes_light_what_is_near_them():
    for seed in range(4):
        draw = Draw((seed, 30))
        _, _, expected = draw.lamp("rectangle")
        eye = draw.place + 0.1 * draw.height * draw.up + 0.05 * draw.height * draw.x
        parts = {
            "lamp": {"type": "rectangle", "to_world": turned(draw.center, -draw.up, draw.x, draw.half),
                     "emitter": {"type": "area", "radiance": 1.0}},
            "floor": {"type": "rectangle", "to_world": turned(draw.place, draw.up, draw.x, draw.floor),
                      "bsdf": {"type": "diffuse", "reflectance": 0.5}},
            "sensor": {
                "type": "perspective", "fov": 0.5, "near_clip": 1e-3 * draw.height, "far_clip": 1e3 * draw.height,
                "to_world": mi.ScalarTransform4f().look_at(list(eye), list(draw.place), list(draw.y)),
                "film": {"type": "hdrfilm", "width": 16, "height": 16},
            },
        }  # fmt: skip
        shot = pb.Shot(mi.load_dict({"type": "scene", **parts}))
        values = shot.render(passes=4, max_depth=2).layers["surface"][..., 0].astype(np.float64) / 0.5 * np.pi
        assert abs(values.mean() - expected) < 0.02 * expected, (seed, vars(draw))


@pytest.mark.parametrize("kind", ["rectangle", "disk", "cube", "sphere"])
def test_light_paths_of_shapes_in_mitsuba_scenes_begin_at_the_shape(kind):
    """They begin within a 200th of its size; Mitsuba's own gap may be larger than the lamp."""
    for seed in range(6):
        draw = Draw((seed, 50))
        to_world = turned(draw.center, -draw.up, draw.x, draw.half).scale([1, 1, draw.half])
        lamp = {"type": kind, "to_world": to_world}
        plugin = mi.load_dict({"type": "scene", "lamp": lamp | {"emitter": {"type": "area", "radiance": 1.0}}})
        paths = PathEmitter(world_of_plugin(plugin), 0).sample(*sobol_block(COUNT, 0, (seed,)))
        back = plugin.ray_intersect(mi.Ray3f(mi.Point3f(paths.origin), -mi.Vector3f(paths.direction)))
        met = back.is_valid()
        height = dr.select(met, back.t * dr.abs(dr.dot(Array3f(back.n), paths.direction)), 0).numpy()
        assert met.numpy().mean() > 0.95, (seed, vars(draw))  # the others pass beside its edge
        size = np.linalg.norm(np.ravel(plugin.bbox().extents()))
        assert height.max() < 0.005 * size, (seed, vars(draw))
        blocked = plugin.ray_test(mi.Ray3f(mi.Point3f(paths.origin), mi.Vector3f(paths.direction))).numpy()
        assert blocked.mean() < 0.003, (seed, vars(draw))  # rounding loses paths that graze a sphere


def turned(center, normal, x, half):
    """Return the transform of Mitsuba's rectangle to a centre, a normal, and a half size."""
    matrix = np.eye(4)
    matrix[:3] = np.array([half * x, half * np.cross(normal, x), normal, center]).T
    return mi.ScalarTransform4f(matrix)
