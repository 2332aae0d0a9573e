"""Panes of glass without thickness: light and sight go straight through them, in their colour, and are mirrored."""

import numpy as np
import pytest

import photonbeams as pb
from photonbeams import scene
from tests.helpers.mitsuba_scenes import T, camera, cube_of, fog, load, rgb

RED = (1.0, 0.25, 0.0)
RHO, IOR, DOWN = 0.6, 1.5, np.array([0.5, -1.0, 0.0])
COSINE = 1 / np.sqrt(1.25)
FLOOR = scene.Material(diffuse=(RHO,) * 3, ior=1.0)


def card(name, corners, material):
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    return scene.Mesh(name, np.array(corners, dtype=np.float64), faces, material=material)


def flat(name, height, half, material):
    corners = (-half, half), (half, half), (half, -half), (-half, -half)
    return card(name, [[x, height, z] for x, z in corners], material)


def passed(cosine):
    """Return how much light passes a thin pane: (1 − R) / (1 + R), for Fresnel's reflectance R of one of its sides."""
    inside = np.sqrt(1 - (1 - cosine**2) / IOR**2)
    across = ((cosine - IOR * inside) / (cosine + IOR * inside)) ** 2
    along = ((IOR * cosine - inside) / (IOR * cosine + inside)) ** 2
    reflected = (across + along) / 2
    return (1 - reflected) / (1 + reflected)


@pytest.mark.parametrize(
    ("glass", "factor"),
    [(scene.Material(opacity=0.0, roughness=0.0, ior=IOR), passed(COSINE)),
     (scene.Material(opacity=0.3, roughness=0.5, ior=IOR), 0.7),
     (scene.Material(opacity=0.0, roughness=0.0, ior=IOR, tint=RED), passed(COSINE) * np.array(RED)),
     (scene.Material(opacity=0.0, roughness=0.5, ior=IOR, tint=RED, thin=True), RED),
     (scene.Material(opacity=0.3, roughness=0.0, ior=IOR, tint=(0.5,) * 3), 0.35 * passed(COSINE)),
     (scene.Material(opacity=0.0, ior=1.0, tint=RED), RED)],
    ids=["clear", "faint", "red", "thin", "grey", "gel"],
)  # fmt: skip
@pytest.mark.parametrize("scale", [0.01, 1.0, 300.0])
def test_a_pane_dims_the_sun_and_does_not_bend_it(glass, factor, scale):
    """The floor under a pane, seen from below it, has the light of the sun, and a bounce adds less than 1 %.

    Of the light of the floor, the pane sends back a tenth; it lands where the picture does not show it.
    """
    sun = scene.DistantLight("/Sun", (2.0,) * 3, axis=DOWN / np.linalg.norm(DOWN), angle=0.0)
    meshes = (flat("/Floor", 0.0, 0.3 * scale, FLOOR), flat("/Pane", 2 * scale, 4 * scale, glass))
    camera = scene.Camera.look_at((0, 1 * scale, 2 * scale), (0, 0, 0), fov=3)
    described = scene.Scene(lights=(sun,), meshes=meshes)
    picture = pb.Shot(described, camera).render(passes=1, width=64, height=64, max_depth=5).layers["surface"]
    picture = picture[..., :3].reshape(16, 4, 16, 4, 3).mean(axis=(1, 3))
    expected = RHO / np.pi * 2.0 * COSINE * np.broadcast_to(factor, 3)
    np.testing.assert_allclose(picture.mean(axis=(0, 1)), expected, rtol=0.01)
    assert (picture.std(axis=(0, 1)) <= 0.05 * expected).all()


def test_a_pane_shows_what_is_straight_behind_it():
    """A slanted pane in front of a glowing card with edges in the middle of pixels' columns."""
    glow = scene.Material(diffuse=(0.0,) * 3, emissive=(1.0, 1.0, 1.0), ior=1.0)
    lit = card("/Card", [[0, -9, -4], [9, -9, -4], [9, 9, -4], [0, 9, -4]], glow)
    slant = card("/Pane", [[-3, -3, -3], [3, -3, -1], [3, 3, -1], [-3, 3, -3]],
                 scene.Material(opacity=0.0, roughness=0.0, ior=IOR))  # fmt: skip
    camera = scene.Camera.look_at((0, 0, 0), (0, 0, -1), fov=10)
    shot = pb.Shot(scene.Scene(meshes=(lit, slant)), camera)
    # All rows show the same: 16 of them have as many samples as one has in 16 times the passes.
    picture = shot.render(passes=32, width=64, height=64, max_depth=5).layers["rgba"][..., 0]
    picture = picture.reshape(4, 16, 64).mean(axis=1)
    cosine = 3 / np.sqrt(10)
    assert picture[:, :32].max() < 0.01
    np.testing.assert_allclose(picture[:, 32:].mean(), passed(cosine), rtol=0.01)


def box(material):
    """Return a box without a lid, and a lid, which is all of a material."""
    whole = scene.Mesh.box("/Box", (-1,) * 3, (1,) * 3)
    open_ = whole.faces[(whole.corners[..., 1] < 1).any(axis=1)]
    return scene.Mesh("/Box", whole.points, open_, material=FLOOR), flat("/Lid", 1.0, 1, material)


SUN = scene.DistantLight("/Sun", (2.0,) * 3, axis=DOWN / np.linalg.norm(DOWN), angle=0.0)
HAZE = scene.Medium(scattering=0.3, mesh=scene.Mesh.box("/Haze", (-0.98,) * 3, (0.98,) * 3))


LAMP = scene.SphereLight("/Lamp", (40.0,) * 3, center=np.array([-0.3, 1.6, 0.2]), radius=0.1)
SKY = scene.DomeLight("/Sky", (1.0,) * 3)
EYE, AT = (0.5, 0, 0.9), (-0.5, -0.3, -0.9)
GEL = scene.Material(opacity=0.0, ior=1.0, tint=RED)


def stage(*lights):
    """Return a box of haze with a red lid, under lights."""
    return pb.Shot(scene.Scene(lights=lights, meshes=box(GEL), media=(HAZE,)), scene.Camera.look_at(EYE, AT, fov=70))


def in_mitsuba():
    """Return such a box in Mitsuba, in the sun."""
    turns = {"floor": ([1, 0, 0], -90), "lid": ([1, 0, 0], 90), "left": ([0, 1, 0], 90), "right": ([0, 1, 0], -90),
             "back": ([0, 1, 0], 0), "front": ([0, 1, 0], 180)}  # fmt: skip
    wall = {"type": "twosided", "side": {"type": "diffuse", "reflectance": RHO}}
    gel = {"type": "thindielectric", "int_ior": 1.0, "ext_ior": 1.0, "specular_transmittance": rgb(RED)}
    parts = {
        name: {"type": "rectangle", "to_world": T().rotate(axis, angle).translate([0, 0, -1]),
               "bsdf": gel if name == "lid" else wall}
        for name, (axis, angle) in turns.items()
    }  # fmt: skip
    sun = {"type": "directional", "direction": DOWN.tolist(), "irradiance": 2.0}
    return pb.Shot(load(sensor=camera(EYE, AT, fov=70), sun=sun, haze=cube_of(fog(0.3, 1.0), 0.98), **parts))


SHOTS = {"sun": lambda: stage(SUN), "lamp": lambda: stage(LAMP), "sky": lambda: stage(SKY), "mitsuba": in_mitsuba}


@pytest.mark.parametrize(
    ("name", "method", "depth"),
    [("sun", "auto", 2), ("lamp", "auto", 2), ("sun", "beams", 5), ("mitsuba", "beams", 5), ("lamp", "paths", 5),
     ("sky", "paths", 5), ("mitsuba", "paths", 5)],
)  # fmt: skip
def test_all_that_a_coloured_pane_lets_in_has_its_colour(name, method, depth):
    """All light in the box has passed the lid once: that of beams, photons, walks and virtual lights.

    Fog and walls are grey, so each path carries the colours in the same proportion, up to rounding.
    """
    layers = SHOTS[name]().render(passes=2, width=24, height=16, max_depth=depth, method=method).layers
    light = np.array([layers[layer][..., :3] for layer in ("surface", "beams")], dtype=float)
    red, green, blue = np.moveaxis(light, -1, 0)
    assert red.mean(axis=(1, 2)).min() > 1e-3
    np.testing.assert_allclose(green, RED[1] * red, rtol=1e-3, atol=1e-3 * red.mean())
    assert blue.max() < 1e-6


@pytest.mark.parametrize("depth", [2, 5])
def test_an_image_on_a_pane_tints_each_point_of_the_light(depth):
    """The floor under four panes in one image, each of which colours its quarter of the light."""
    colors = np.array([[[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [0.5, 0.5, 0.5]]], dtype=np.float32)
    image = scene.UVTexture(colors.repeat(8, axis=0).repeat(8, axis=1))
    lid = flat("/Lid", 1.0, 1, scene.Material(opacity=0.0, ior=1.0, tint=image))
    lid = scene.Mesh(
        "/Lid", lid.points, lid.faces, uvs=lid.points[:, [0, 2]] * [0.5, -0.5] + 0.5, material=lid.material
    )
    sun = scene.DistantLight("/Sun", (2.0,) * 3, axis=(0.0, -1.0, 0.0), angle=0.0)
    camera = scene.Camera.look_at((0, 0.9, 0), (0, 0, 0), up=(0, 0, -1), fov=90)
    shot = pb.Shot(scene.Scene(lights=(sun,), meshes=(lid, flat("/Floor", 0.0, 1, FLOOR))), camera)
    picture = shot.render(passes=1, width=16, height=16, max_depth=depth).layers["surface"][..., :3]
    quarters = picture.reshape(2, 8, 2, 8, 3)[:, 2:6, :, 2:6].mean(axis=(1, 3))
    np.testing.assert_allclose(quarters, RHO / np.pi * 2.0 * colors, atol=1e-3)


WINDOW = """
def Camera "Above" {
    float focalLength = 300
    double3 xformOp:translate = (0.5, 0, 9)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Camera "Below" {
    float focalLength = 100
    double3 xformOp:translate = (0.5, 0, 2)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Mesh "Floor" {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)]
}
def Mesh "Window" {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-1, -1, 3), (1, -1, 3), (1, 1, 3), (-1, 1, 3)]
}
def DistantLight "Sun" (prepend apiSchemas = ["PhotonBeamsLightAPI"]) {
    float inputs:angle = 0
    float inputs:intensity = 3
    rel photonbeams:portal = </Window>
    asset photonbeams:portal:gobo = @IMAGE@
    bool photonbeams:portal:gobo:visible = VISIBLE
}
"""


@pytest.mark.parametrize("bounces", [0, 1])
def test_an_image_on_a_portal_is_a_pane_where_it_is_shown(usd, image, bounces):
    """The sun gives the floor under it the same colours, and pictures show the floor through them once more."""
    halves = [[0.5, 0.2, 0.0]] * 4 + [[0.1, 0.8, 0.4]] * 4
    path = image("halves.exr", [halves], "float")  # the cameras look at one of them

    def seen(visible, name):
        text = WINDOW.replace("IMAGE", str(path)).replace("VISIBLE", f"{visible:d}")
        shot = pb.Shot(usd(text, 'upAxis = "Z"'), f"/{name}")
        return shot.render(passes=1, width=8, height=8, max_depth=2 + bounces).layers["surface"][..., :3].mean((0, 1))

    hidden, under = seen(False, "Above"), seen(True, "Below")
    color = next(np.array(each) for each in halves[::4] if np.argmax(each) == np.argmax(hidden))
    np.testing.assert_allclose(hidden / hidden.max(), color / color.max(), rtol=2e-3, atol=1e-6)
    # What the pane reflects of the floor's light is nothing: its index of refraction is 1.
    np.testing.assert_allclose(under, seen(False, "Below"), rtol=2e-3, atol=1e-6)
    np.testing.assert_allclose(seen(True, "Above"), hidden * color, rtol=5e-3, atol=1e-6)
