"""Surfaces seen through fog, against closed forms and against Mitsuba's own direct light in an equivalent scene."""

import dataclasses

import drjit as dr
import numpy as np
import pytest

from photonbeams import scene
from photonbeams.numerics.arrays import to_vectors
from photonbeams.runtime.device import Array3f, Bool, UInt32, mitsuba
from photonbeams.world.described import world_of_scene
from tests.helpers.comparison import box, quad
from tests.helpers.kernels import compiled
from tests.helpers.shading import Shaded, shade
from tests.helpers.tracing import trace

DIFFUSE = scene.Material(diffuse=(0.6, 0.5, 0.4), roughness=1.0, ior=1.001)
GLOSSY = scene.Material(diffuse=(0.2, 0.3, 0.4), roughness=0.25, metallic=0.3, clearcoat=0.5)
FLOOR = quad("/floor", [[-3, 0, -3], [-3, 0, 3], [3, 0, 3], [3, 0, -3]], DIFFUSE)
LIGHT = scene.FlatLight(
    "/light", (5.0, 4.0, 3.0), center=np.array([0.3, 2.5, 0.0]), half_x=np.array([0.6, 0, 0]),
    half_y=np.array([0, 0, 0.4]), axis=np.array([0, -1.0, 0]),
)  # fmt: skip
DOWN = np.array([0.0, -1.0, 0.0])
SKY_ABOVE = scene.DomeLight("/sky", (1.0, 2.0, 3.0))
LAMP_ABOVE = scene.FlatLight(
    "/lamp", (5.0, 4.0, 3.0), center=np.array([0, 3.0, 0]), half_x=np.array([0.4, 0, 0]),
    half_y=np.array([0, 0, 0.4]), axis=DOWN,
)  # fmt: skip


def rays(origin, target):
    """Return rays from origins to targets; either is (N, 3), or one point for all rays."""
    origin, target = np.broadcast_arrays(np.atleast_2d(origin).astype(float), np.atleast_2d(target).astype(float))
    direction = (target - origin) / np.linalg.norm(target - origin, axis=1, keepdims=True)
    return [to_vectors(part) for part in (origin, direction)]


def render(world, origin, direction, passes=64):
    """Render all passes at once; return the radiance's mean and variance over them, (3, N), and the last pass."""
    count = dr.width(direction)
    index = dr.arange(UInt32, count * passes)
    ray = index // dr.opaque(UInt32, passes)
    found = shade(world, dr.gather(Array3f, origin, ray), dr.gather(Array3f, direction, ray), index)
    values = found.radiance.numpy().astype(np.float64).reshape(3, count, passes)
    last = dr.arange(UInt32, count) * passes + (passes - 1)
    return values.mean(axis=2), values.var(axis=2), Shaded(*(dr.gather(type(each), each, last) for each in found))


def built(meshes, *lights, medium=None):
    return world_of_scene(
        scene.Scene(tuple(meshes), lights, media=() if medium is None else (medium,)), viewpoints=[(0, 2, 4)]
    )


def lambert(light, medium=None, at=(0, 0, 0)):
    """Return the radiance of a lit floor, seen from (0, 3, 4), as a mean over many samples, and the last pass."""
    world = built([FLOOR], light, medium=medium)
    origin, direction = rays(np.broadcast_to([0.0, 3, 4], (512, 3)), at)
    mean, _, last = render(world, origin, direction, passes=32)
    return mean.mean(axis=1), last


# Mitsuba's principled BSDF adds retro-reflection to Lambert's law; its value is measured with a distant light.
@pytest.fixture(scope="module")
def reflectance():
    """Return the floor's radiance per irradiance, seen from (0, 3, 4) and lit from above."""
    return lambert(scene.DistantLight("/sun", (1.0,) * 3, axis=DOWN, angle=0.0))[0]


def test_a_diffuse_floor_reflects_as_disneys_diffuse_bsdf(reflectance):
    """Burley 2015: (1 − Fv / 2) (1 − Fl / 2) + Rr (Fl + Fv + Fl Fv (Rr − 1)), Rr = 2 roughness cos² θd."""
    # Light from straight above has Fl = 0; the view's cosine is 0.6, and θd is half of the angle between the two.
    fresnel, retro = (1 - 0.6) ** 5, 2 * (1 + 0.6) / 2
    factor = 1 - fresnel / 2 + retro * fresnel
    # float32; the specular lobe reflects ((ior − 1) / (ior + 1))² = 2.5e-7 of the light.
    assert np.allclose(reflectance, factor * np.array([0.6, 0.5, 0.4]) / np.pi, rtol=1e-5)


def test_a_matte_floor_is_lamberts_in_the_colours_of_its_vertices_and_by_its_normals():
    """The floor reflects albedo / π of the irradiance, linear between vertices; a constant normal map tilts it."""
    sun = scene.DistantLight("/sun", (1.0,) * 3, axis=DOWN, angle=0.0)
    colors = np.array([[0, 0, 0.5], [0, 1, 0.5], [1, 1, 0.5], [1, 0, 0.5]])
    matte = scene.Material(diffuse=scene.VertexValues(colors), ior=1.0)
    at = np.array([[x, 0, z] for x in (-2.0, -1.0, 0.5) for z in (-1.0, 1.5)])
    origin, direction = rays([0.0, 3, 4], at)
    mean, _, _ = render(built([dataclasses.replace(FLOOR, material=matte)], sun), origin, direction, passes=1)
    # As x goes from −3 to 3, red goes from 0 to 1, and so does green with z.
    expected = np.stack([(at[:, 0] + 3) / 6, (at[:, 2] + 3) / 6, np.full(len(at), 0.5)]) / np.pi
    assert np.allclose(mean, expected, atol=1e-6)
    tilted = np.array([0.6, 0.0, 0.8]) / 2 + 0.5
    normal = scene.UVTexture(np.full((1, 1, 3), tilted, np.float32))
    uvs = np.array([[0.0, 0], [0, 1], [1, 1], [1, 0]])
    bent = dataclasses.replace(FLOOR, uvs=uvs, material=scene.Material(diffuse=(0.5,) * 3, ior=1.0, normal=normal))
    mean, _, _ = render(built([bent], sun), origin, direction, passes=1)
    assert np.allclose(mean, 0.5 * 0.8 / np.pi, rtol=1e-5)


@pytest.mark.parametrize(
    ("light", "irradiance"),
    [
        (scene.SphereLight("/p", (1.0,) * 3, center=np.array([0, 2.0, 0])), 1 / 4),
        (scene.SphereLight("/s", (1.0,) * 3, center=np.array([0, 20.0, 0]), radius=0.5), np.pi * 0.25 / 400),
        (scene.DistantLight("/d", (1.0,) * 3, axis=DOWN, angle=2.0), np.pi * np.sin(np.radians(1)) ** 2),
    ],
    ids=["point", "sphere", "distant"],
)
def test_lights_from_above_reflect_by_their_irradiance(reflectance, light, irradiance):
    # The lamps subtend less than 3 degrees, over which the reflectance is constant to 1e-3.
    assert np.allclose(lambert(light)[0], reflectance * irradiance, rtol=2e-3)


def test_fog_dims_light_on_both_legs(reflectance):
    medium = scene.Medium((0.1, 0.2, 0.3), (0.0, 0.1, 0.0))
    point = scene.SphereLight("/p", (1.0,) * 3, center=np.array([0, 2.0, 0]))
    value, last = lambert(point, medium)
    extinction = np.array([0.1, 0.3, 0.3])
    assert np.allclose(value, reflectance / 4 * np.exp(-extinction * (2 + 5)), rtol=1e-4)
    assert np.allclose(last.transmittance.numpy()[:, 0], np.exp(-extinction * 5), rtol=1e-5)
    assert np.allclose(last.depth.numpy(), 5, rtol=1e-5)
    # Unbounded fog does not dim a distant light on its way to surfaces, or none of it would arrive.
    sun = scene.DistantLight("/sun", (1.0,) * 3, axis=DOWN, angle=0.0)
    assert np.allclose(lambert(sun, medium)[0], reflectance * np.exp(-extinction * 5), rtol=1e-4)


def test_a_fog_that_beams_alone_feel_leaves_surfaces_as_they_are(reflectance):
    medium = scene.Medium((0.5, 0.2, 0.3), surfaces=False)
    point = scene.SphereLight("/p", (1.0,) * 3, center=np.array([0, 2.0, 0]))
    value, last = lambert(point, medium)
    assert np.array_equal(value, lambert(point)[0])
    assert np.array_equal(last.transmittance.numpy(), np.ones_like(last.transmittance.numpy()))
    sphere = dataclasses.replace(point, center=np.array([0.0, 2, 0]), radius=0.5)
    origin, direction = rays([0, 2, 4], [0, 2, 0])
    assert np.allclose(render(built([], sphere, medium=medium), origin, direction, passes=1)[0], 1)


def test_bounded_fog_dims_only_where_it_is(reflectance):
    medium = scene.Medium((0.5,) * 3, mesh=box("/fog", [-9, 1, -9], [9, 2, 9]))
    sun = scene.DistantLight("/sun", (1.0,) * 3, axis=DOWN, angle=0.0)
    value, last = lambert(sun, medium)
    slant = 5 / 3  # length of the ray from (0, 3, 4) per unit of height
    # Mitsuba's rays begin 1500 roundings of 1 + |x|, here at most 6, behind an interface; this counts for both legs.
    tolerance = 2 * 0.5 * slant * 1500 * 6 * 2.0**-24
    assert np.allclose(value, reflectance * np.exp(-0.5 * (1 + slant)), rtol=tolerance)
    assert np.allclose(last.transmittance.numpy(), np.exp(-0.5 * slant), rtol=tolerance)


def test_shadows_fall_behind_surfaces():
    sun = scene.DistantLight("/sun", (1.0,) * 3, axis=DOWN, angle=0.0)
    roof = quad("/roof", [[-1, 2, -1], [1, 2, -1], [1, 2, 1], [-1, 2, 1]], DIFFUSE)
    origin, direction = rays([[0, 1, 4], [0, 1, 4]], [[0.0, 0, 0], [2, 0, 0]])
    mean, _, _ = render(built([FLOOR, roof], sun), origin, direction, passes=1)
    assert np.all(mean[:, 0] == 0) and np.all(mean[:, 1] > 0)


ROOF = quad("/roof", [[-1, 2, -1], [1, 2, -1], [1, 2, 1], [-1, 2, 1]], DIFFUSE)
SUN = scene.DistantLight("/sun", (1.0,) * 3, axis=DOWN, angle=0.0)


def test_a_light_shines_on_what_it_is_linked_to():
    stage = quad("/stage", [[0, 0.1, -3], [0, 0.1, 3], [3, 0.1, 3], [3, 0.1, -3]], DIFFUSE)
    origin, direction = rays([[-1, 1, 4], [1, 1, 4]], [[-1.0, 0, 0], [1, 0.1, 0]])  # at the floor, at the stage
    whole = render(built([FLOOR, stage], SUN), origin, direction, passes=1)[0]
    assert np.all(whole > 0)
    for name, kept in (("/floor", 1), ("/stage", 0), ("/elsewhere", None)):
        light = dataclasses.replace(SUN, unlit=frozenset({name}))
        mean = render(built([FLOOR, stage], light), origin, direction, passes=1)[0]
        expected = whole if kept is None else whole * np.eye(2)[kept]
        assert np.allclose(mean, expected, rtol=1e-6)
        # A light without links is not affected by the other light's links.
        both = render(built([FLOOR, stage], SUN, dataclasses.replace(light, name="/b")), origin, direction, passes=1)[0]
        assert np.allclose(both, whole + expected, rtol=1e-6)


@pytest.mark.parametrize("light", [SUN, SKY_ABOVE, LAMP_ABOVE], ids=["sun", "sky", "lamp"])
def test_only_what_a_light_is_linked_to_stops_it(light):
    origin, direction = rays(np.broadcast_to([0, 1, 4], (64, 3)), [0.0, 0, 0])
    open_floor = render(built([FLOOR], light), origin, direction, passes=32)
    through = render(
        built([FLOOR, ROOF], dataclasses.replace(light, unshadowed=frozenset({"/roof"}))), origin, direction, passes=32
    )
    shadow = render(built([FLOOR, ROOF], light), origin, direction, passes=32)[0]
    error = np.sqrt((open_floor[1] + through[1]).mean(axis=1) / 32 / 64)
    assert np.all(np.abs((through[0] - open_floor[0]).mean(axis=1)) <= 4 * error + 1e-6)
    assert np.all(shadow.mean(axis=1) < 0.85 * open_floor[0].mean(axis=1))  # the roof hides a quarter of the sky


def test_surfaces_are_scaled_and_shadows_end_where_a_light_says():
    origin, direction = rays([[0, 1, 4], [2.5, 1, 4]], [[0.0, 0, 0], [2.5, 0, 0]])  # under the roof, and beside it
    lit = render(built([FLOOR], SUN), origin, direction, passes=1)[0]
    for distance, color, shadow in ((1.9, 0.0, 1), (2.1, 0.0, 0), (np.inf, 0.3, 0.3)):  # the roof is 2 above the floor
        light = dataclasses.replace(SUN, surface_scale=0.5, shadow_distance=distance, shadow_color=(color,) * 3)
        mean = render(built([FLOOR, ROOF], light), origin, direction, passes=1)[0]
        assert np.allclose(mean, 0.5 * lit * [shadow, 1], rtol=1e-6)


def test_hidden_lamps_light_surfaces_and_are_not_seen():
    origin, direction = rays([[0, 1, 4], [0.3, 0.1, 0]], [[0.0, 0, 0], [0.3, 2.5, 0]])  # at the floor, at the lamp
    seen, hidden = (
        render(built([FLOOR], dataclasses.replace(LIGHT, seen=shown)), origin, direction, passes=1)[0]
        for shown in (True, False)
    )
    assert np.allclose(seen[:, 0], hidden[:, 0], rtol=1e-6)
    assert np.allclose(seen[:, 1], [5, 4, 3])
    assert np.all(hidden[:, 1] == 0)


@pytest.mark.parametrize("depth", [0.0, 0.5], ids=["air", "fog"])
def test_an_image_on_a_portal_tints_the_lamp_behind_it_also_through_a_boundary_of_fog(depth):
    green = scene.Gobo(np.full((2, 2, 3), [0.0, 1.0, 0.0], dtype=np.float32))
    pane = quad("/pane", [[-1, -1, 2], [1, -1, 2], [1, 1, 2], [-1, 1, 2]], DIFFUSE)
    lamp = scene.SphereLight("/s", (1.0, 2.0, 3.0), radius=0.5, portal=pane, portal_gobo=green)
    fog = scene.Medium((0.0,) * 3, (depth,) * 3, mesh=box("/fog", (-3, -3, 3), (3, 3, 4)))
    world = world_of_scene(scene.Scene((), (lamp,), media=(fog,)), viewpoints=[(0, 0, 6)])
    mean, _, _ = render(world, *rays([0, 0, 6], [0.0, 0, 0]), passes=1)
    # The ray meets both sides of the slab of fog, one unit thick, before it passes the pane.
    assert np.allclose(mean[:, 0], [0, 2 * np.exp(-depth), 0], rtol=1e-3)
    behind = dataclasses.replace(fog, mesh=box("/fog", (-3, -3, 1), (3, 3, 1.5)))
    world = world_of_scene(scene.Scene((), (lamp,), media=(behind,)), viewpoints=[(0, 0, 6)])
    mean, _, _ = render(world, *rays([0, 0, 6], [0.0, 0, 0]), passes=1)
    assert np.allclose(mean[:, 0], [0, 2 * np.exp(-0.5 * depth), 0], rtol=1e-3)


def test_a_mesh_light_without_a_surface_is_seen_as_a_lamp_and_one_with_a_surface_is_not():
    glow = quad("/glow", [[-1, 2, -1], [1, 2, -1], [1, 2, 1], [-1, 2, 1]], DIFFUSE)
    floor = [[0, 1, 4], [0, 1, 0.0]]
    origin, direction = rays(floor, [[0.0, 0, 0], [0, 2, 0]])
    lamp = scene.MeshLight("/m", (5.0, 4.0, 3.0), mesh=glow)
    seen = render(built([FLOOR], lamp), origin, direction, passes=1)[0]
    assert np.allclose(seen[:, 1], [5, 4, 3])
    surface = render(built([FLOOR, glow], dataclasses.replace(lamp, surface=True)), origin, direction, passes=1)[0]
    assert np.all(surface[:, 1] == 0)
    assert np.allclose(surface[:, 0], seen[:, 0], rtol=1e-4)  # the same light on the floor


def test_a_glowing_surface_glows_also_where_some_lights_pass_it():
    lamp = quad("/glow", ROOF.points, scene.Material(diffuse=scene.BLACK, emissive=(2.0, 1.0, 3.0)))
    origin, direction = rays([0, 1, 4], [0.0, 2, 0])
    light = dataclasses.replace(SUN, unshadowed=frozenset({"/glow"}))
    assert np.allclose(render(built([FLOOR, lamp], light), origin, direction, passes=1)[0][:, 0], [2, 1, 3])


def test_lamps_are_seen_directly_and_hide_what_is_behind():
    sphere = scene.SphereLight("/s", (1.0, 2.0, 3.0), center=np.array([0, 2.0, 0]), radius=0.5)
    facing = dataclasses.replace(LIGHT, half_y=np.array([0, 0.4, 0]), axis=np.array([0, 0, 1.0]))
    lamps = (
        sphere,
        dataclasses.replace(facing, center=np.array([2.0, 2, 0])),
        dataclasses.replace(facing, name="/back", center=np.array([-2.0, 2, 0]), axis=np.array([0, 0, -1.0])),
    )
    wall = quad("/wall", [[-9, -9, -2], [9, -9, -2], [9, 9, -2], [-9, 9, -2]], scene.Material(diffuse=(0.0,) * 3))
    targets = np.array([[0, 2.0, 0], [2, 2, 0], [-2, 2, 0]])
    origin, direction = rays(targets + np.array([0, 0, 4]), targets)
    _, _, result = render(built([wall], *lamps, medium=scene.Medium((0.1,) * 3)), origin, direction, passes=1)
    assert np.allclose(result.depth.numpy(), [3.5, 4, 6], rtol=1e-6)
    assert np.array_equal(result.alpha.numpy(), [1, 1, 1])
    radiance = result.radiance.numpy()
    assert np.allclose(radiance[:, 0], np.array([1, 2, 3]) * np.exp(-0.35), rtol=1e-5)
    assert np.allclose(radiance[:, 1], np.array([5, 4, 3]) * np.exp(-0.4), rtol=1e-5)
    assert np.all(radiance[:, 2] < 0.2)  # a flat light cannot be seen from behind: the wall's gloss


def test_lights_that_light_no_surfaces_are_neither_seen_nor_felt():
    hidden = dataclasses.replace(LIGHT, surface_scale=0)
    origin, direction = rays([[0, 1, 4], [0.3, 0.1, 0]], [[0.0, 0, 0], [0.3, 2.5, 0]])
    mean, _, result = render(built([FLOOR], hidden), origin, direction, passes=1)
    assert np.all(mean == 0)
    assert np.array_equal(result.alpha.numpy(), [1, 0])


def test_the_open_shows_the_environment_without_alpha():
    lights = (scene.DomeLight("/dome", (0.1, 0.2, 0.3)), scene.DistantLight("/sun", (7.0,) * 3, axis=DOWN, angle=1.0))
    origin, direction = rays([0, 0, 0], [[0, 0.1, 1.0], [0, 1, 0]])
    mean, _, result = render(built([], *lights), origin, direction, passes=1)
    assert np.allclose(mean[:, 0], [0.1, 0.2, 0.3])
    assert np.allclose(mean[:, 1], [7.1, 7.2, 7.3])
    assert np.array_equal(result.alpha.numpy(), [0, 0])
    assert np.all(np.isinf(result.depth.numpy()))


def test_rays_that_are_not_active_see_nothing():
    origin, direction = rays([[0, 1, 4], [0, 1, 4]], [[0.0, 0, 0], [0, 5, 0]])
    world = built([FLOOR], LIGHT, scene.DomeLight("/dome", (1.0,) * 3))
    result = shade(world, origin, direction, UInt32([0, 1]), active=Bool([False, False]))
    assert np.all(result.radiance.numpy() == 0) and np.all(result.alpha.numpy() == 0)


def test_surfaces_glow_to_both_sides():
    material = dataclasses.replace(DIFFUSE, emissive=(1.0, 2.0, 3.0))
    origin, direction = rays([[0, 1, 0], [0, -1, 0]], [[0.1, 0, 0], [0.1, 0, 0]])
    mean, _, _ = render(built([dataclasses.replace(FLOOR, material=material)]), origin, direction, passes=1)
    assert np.allclose(mean.T, [[1, 2, 3], [1, 2, 3]])


def test_images_lie_on_surfaces_with_their_first_row_at_v_one():
    pixels = np.zeros((2, 2, 3), dtype=np.float32)
    pixels[0, 1] = (1, 0.5, 0.25)  # top right: u, v near 1
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    shift = np.array([[1, 0, 0.5], [0, 1, 0], [0, 0, 1.0]])
    for transform, spot in ((np.eye(3), [0.5, 0.5]), (shift, [-0.5, 0.5])):
        glow = scene.Material(emissive=scene.UVTexture(pixels, "repeat", transform))
        card = dataclasses.replace(quad("/card", [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], glow), uvs=uvs)
        corners = np.array([[x, y, 0] for x in (-0.5, 0.5) for y in (-0.5, 0.5)])
        origin, direction = rays(corners + np.array([0, 0, 1]), corners)
        mean, _, _ = render(built([card]), origin, direction, passes=1)
        expected = [pixels[0, 1] if list(corner[:2]) == spot else (0, 0, 0) for corner in corners]
        assert np.allclose(mean.T, expected, atol=1e-6)


def test_opacity_lets_its_part_of_light_and_sight_through(reflectance):
    sun = scene.DistantLight("/sun", (1.0,) * 3, axis=DOWN, angle=0.0)
    sheer = scene.Material(diffuse=(0.0,) * 3, opacity=0.25, ior=1.001)
    veil = quad("/veil", [[-2, 1, -2], [2, 1, -2], [2, 1, 1], [-2, 1, 1]], sheer)
    origin, direction = rays(np.broadcast_to([0.0, 3, 4], (4096, 3)), [0, 0, 0])
    mean, variance, _ = render(built([FLOOR, veil], sun), origin, direction, passes=8)
    error = np.sqrt(variance.mean(axis=1) / mean.shape[1] / 8)  # light passes the veil once, the view passes beside it
    assert np.all(np.abs(mean.mean(axis=1) - 0.75 * reflectance) < 4 * error + 1e-3 * reflectance)


SPHERE = scene.SphereLight("/light", (9.0, 4.0, 3.0), center=np.array([0.3, 2.5, 0.0]), radius=0.4)
SKY = scene.DomeLight("/light", (1.0, 2.0, 3.0), image=np.random.default_rng(2).random((8, 16, 3)) ** 4)


def emitter_of(light):
    """Return a light as a plug-in of Mitsuba."""
    mi = mitsuba()
    if isinstance(light, scene.DomeLight):
        pixels = np.float32(light.image * light.radiance)
        return {"type": "envmap", "bitmap": mi.Bitmap(pixels)}
    area = {"type": "area", "radiance": {"type": "rgb", "value": list(light.radiance)}}
    if isinstance(light, scene.SphereLight):
        return {"type": "sphere", "center": list(light.center), "radius": light.radius, "emitter": area}
    frame = np.eye(4)
    frame[:3, :3] = np.array([light.half_x, light.half_y, light.axis]).T
    frame[:3, 3] = light.center
    return {"type": "rectangle", "to_world": mi.ScalarTransform4f(frame), "emitter": area}


@pytest.mark.parametrize("material", [DIFFUSE, GLOSSY], ids=["diffuse", "glossy"])
@pytest.mark.parametrize("light", [LIGHT, SPHERE, SKY], ids=["rect", "sphere", "dome"])
def test_direct_light_equals_mitsubas_own_integrator(material, light):
    mi = mitsuba()
    block = box("/block", [-1, 0, -1], [-0.2, 0.8, 0], material)
    world = built([dataclasses.replace(FLOOR, material=material), block], light)
    shapes = {f"shape_{i}": shape for i, shape in enumerate(world.surfaces.shapes())}
    reference = mi.load_dict({"type": "scene", **shapes, "light": emitter_of(light)})
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-1.5, 1.5, 16), np.linspace(-0.9, 0.77, 9)))
    origin, direction = rays([0, 2, 4], np.stack([x, y, 0 * x], axis=1))
    count, samples = dr.width(direction), 256
    mean, variance, _ = render(world, origin, direction, passes=samples)

    integrator = mi.load_dict({"type": "direct"})
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(3, count * samples)
    index = dr.arange(UInt32, count * samples) // samples
    ray = mi.RayDifferential3f(
        mi.Point3f(dr.gather(Array3f, origin + dr.zeros(mi.Float, count), index)),
        mi.Vector3f(dr.gather(Array3f, direction, index)),
    )
    theirs = np.array(integrator.sample(reference, sampler, ray)[0]).reshape(3, count, samples)
    error = np.sqrt(theirs.var(axis=2) / samples + variance / samples)
    z = (mean - theirs.mean(axis=2)) / (error + 1e-5)
    lit = theirs.mean(axis=2)[0] > 1e-4
    assert lit.mean() > 0.5
    # In 0.3 % of sets of 432 normal variates, one exceeds 4.5 standard deviations; float32 needs a little room.
    assert np.abs(z).max() < 4.5
    assert abs(z[:, lit].mean()) < 4 / np.sqrt(lit.sum())  # the three channels share their samples


def test_samples_of_a_pixel_converge_faster_than_random_ones():
    origin, direction = rays(np.broadcast_to([0.0, 2, 4], (256, 3)), [0.5, 0, 0])
    mean, variance, _ = render(built([FLOOR], LIGHT), origin, direction, passes=64)
    # This compares the means of pixels that see the same point with means of 64 independent samples.
    assert mean[0].std() < 0.5 * np.sqrt(variance[0].mean() / 64)


def test_passes_and_lights_values_compile_nothing():
    def frame(number):
        light = dataclasses.replace(LIGHT, radiance=(1.0 + number, 2, 3), center=np.array([0.1 * number, 2.5, 0]))
        extra = [dataclasses.replace(light, name=f"/extra{i}") for i in range(number)]
        medium = scene.Medium((0.1 + 0.1 * number,) * 3)
        world = built([FLOOR], light, *extra, medium=medium)
        origin, direction = rays(np.broadcast_to([0.0, 2, 4], (64, 3)), [0.1 * number, 0, 0])
        render(world, origin, direction, passes=2)

    frame(0)
    assert not compiled(frame, 1)


def leaded(seed, size=(6, 8)):
    """Return two lights behind images, and one that shines through a window with an image."""
    rng = np.random.default_rng(seed)
    images = [rng.random((*size, 3)).astype(np.float32) for _ in range(3)]
    slide = scene.SphereLight(
        "/slide", (9.0,) * 3, center=np.array([0, 3.0, 0.1 * seed]), axis=DOWN, gobo=scene.Gobo(images[0], 40.0 + seed)
    )
    other = dataclasses.replace(slide, name="/other", gobo=scene.Gobo(images[1], 60.0))
    window = quad("/window", [[-1, 1.5, -1], [1, 1.5, -1], [1, 1.5, 1], [-1, 1.5, 1]])
    portal_gobo = dataclasses.replace(
        LIGHT, name="/pane", portal=window, portal_gobo=scene.Gobo(images[2], up=np.array([0, 0, -1.0]))
    )
    return slide, other, portal_gobo


def test_lights_behind_images_add_up_on_surfaces():
    lights = leaded(1)
    origin, direction = rays([0, 2, 4], np.random.default_rng(0).uniform([-1, 0, -1], [1, 0, 1], (64, 3)))
    parts = [render(built([FLOOR], light), origin, direction, passes=128) for light in lights]
    mean, variance, _ = render(built([FLOOR], *lights), origin, direction, passes=128)
    expected = sum(part[0] for part in parts)
    error = np.sqrt((variance + sum(part[1] for part in parts)) / 128)
    assert all(part[0].mean() > 0.05 * expected.mean() for part in parts)
    # There are 192 values; lights behind slides have no noise except for float32 rounding.
    assert np.all(np.abs(mean - expected) < 4.5 * error + 1e-5 * expected)


def test_a_sky_behind_a_window_with_an_image_is_coloured_through_it_alone():
    window = quad("/window", [[-1, 2, -1], [1, 2, -1], [1, 2, 1], [-1, 2, 1]])
    red = scene.Gobo(np.array([[[1.0, 0, 0]]], dtype=np.float32), up=np.array([0, 0, -1.0]))
    walls = box("/walls", [-1, -0.1, -1], [1, 2.1, 1], DIFFUSE)
    walls = dataclasses.replace(walls, faces=walls.faces[[0, 1, 2, 3, 8, 9, 10, 11]])  # neither floor nor ceiling
    light = dataclasses.replace(SKY_ABOVE, portal=window, portal_gobo=red)
    origin, direction = rays(np.broadcast_to([0, 1.9, 0.1], (64, 3)), [0.0, 0, 0])
    mean, _, _ = render(built([FLOOR, walls], light), origin, direction, passes=16)
    assert mean[0].mean() > 0.05 and np.all(mean[1:] == 0)
    sky, _, _ = render(built([FLOOR], light), *rays([0, 3, 4], [0, 4.0, 0]), passes=1)
    assert np.allclose(sky[:, 0], SKY_ABOVE.radiance)


@pytest.mark.parametrize("links", [False, True], ids=["free", "linked"])
def test_another_image_and_another_link_compile_nothing(links):
    def frame(seed, size):
        lights = leaded(seed, size)
        if links:
            names = frozenset({("/a", "/b")[seed]})
            lights = tuple(dataclasses.replace(light, unlit=names, unshadowed=names) for light in lights)
        blocks = [box(f"/{name}", [x, 0, seed], [x + 0.5, 0.5, 2], DIFFUSE) for x, name in enumerate("ab")]
        world = built([FLOOR, *blocks], *lights, medium=scene.Medium((0.1,) * 3))
        origin, direction = rays(np.broadcast_to([0.0, 2, 4], (64, 3)), [0.1 * seed, 0, 0])
        render(world, origin, direction, passes=2)
        for number in range(2):
            dr.eval([each.beams for each in trace(world, beams_per_light=64, pass_index=number)])

    frame(0, (6, 8))
    assert not compiled(frame, 1, (9, 5))


def test_a_black_image_of_a_sky_takes_no_light_from_lamps():
    dark = scene.DomeLight("/sky", (0.0, 0.0, 0.0), image=np.ones((2, 4, 3), dtype=np.float32))
    with_sky, alone = (render(built([FLOOR], *lights), *rays([0, 3, 4], [0, 0, 0]), passes=256)[0]
                       for lights in ((LAMP_ABOVE, dark), (LAMP_ABOVE,)))  # fmt: skip
    assert alone.min() > 0
    # The sky only takes samples of its own: the lamp has the same ones.
    np.testing.assert_allclose(with_sky, alone, rtol=1e-5)
