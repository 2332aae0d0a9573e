"""Rooms: the light that surfaces send one another, whichever light makes beams, wherever the room is and how large."""

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.runtime.device import mitsuba

mi = mitsuba()

# A hollow ball of radius r, of which each point sends the fraction ρ on, around a lamp of radius a and radiance 1. All
# of its points have the irradiance E = π a² / r² straight from the lamp, and then ρ times that of the bounce before:
#
#     L = ρ / π · E · Σ ρ^k  over the bounces k = 0, 1, …
LAMP, REFLECTED = 0.05, 0.6


def radiance(bounces):
    """Return the radiance of the wall after so many bounces, for a ball of radius 1."""
    return REFLECTED * LAMP**2 * sum(REFLECTED**k for k in range(bounces + 1))


def sphere(rows=48):
    """Return the faces and points of a ball of radius 1, which is nowhere nearer to its middle than 0.997."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, 2 * rows, endpoint=False))
    points = np.stack([np.sin(polar) * np.cos(around), np.cos(polar), np.sin(polar) * np.sin(around)], axis=-1)
    column, row = np.meshgrid(np.arange(2 * rows), np.arange(rows), indexing="ij")
    after = (column + 1) % (2 * rows)
    corners = [column * (rows + 1) + row, column * (rows + 1) + row + 1]
    corners += [after * (rows + 1) + row + 1, after * (rows + 1) + row]
    faces = np.stack(corners, axis=-1).reshape(-1, 4)
    return [4] * len(faces), faces.ravel().tolist(), [tuple(each) for each in points.reshape(-1, 3).round(7).tolist()]


def ball(size, place, light="", more=""):
    """Return a stage of a ball of radius `size` around `place`, seen from between its middle and its wall."""
    x, y, z = place
    counts, indices, points = sphere()
    return f"""
def Mesh "Ball" (prepend apiSchemas = ["MaterialBindingAPI"])
{{
    int[] faceVertexCounts = {counts}
    int[] faceVertexIndices = {indices}
    point3f[] points = {points}
    uniform token subdivisionScheme = "none"
    bool doubleSided = 1
    rel material:binding = </Wall>
    double3 xformOp:translate = ({x}, {y}, {z})
    float3 xformOp:scale = ({size}, {size}, {size})
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
}}
def Material "Wall"
{{
    token outputs:surface.connect = </Wall/Matt.outputs:surface>
    def Shader "Matt"
    {{
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = ({REFLECTED}, {REFLECTED}, {REFLECTED})
        int inputs:useSpecularWorkflow = 1
        color3f inputs:specularColor = (0, 0, 0)
        token outputs:surface
    }}
}}
def SphereLight "Lamp" (prepend apiSchemas = ["PhotonBeamsLightAPI"])
{{
    float inputs:radius = {LAMP * size}
    float inputs:intensity = 1
    {light}
    double3 xformOp:translate = ({x}, {y}, {z})
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def Camera "Camera"
{{
    float focalLength = 20
    float2 clippingRange = ({0.001 * size}, {100 * size})
    double3 xformOp:translate = ({x}, {y}, {z - 0.4 * size})
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
{more}
"""


def mitsuba_ball(lamp, fog=None):
    """Return a Mitsuba scene of a ball of radius 1 around (3, −2, 1) with a lamp in it, seen from inside.

    A cube of thin fog, which is `fog` wide from its middle, has the lamp and the camera in it.
    """
    medium = {"type": "homogeneous", "albedo": 1.0, "sigma_t": 1e-4}
    within = {} if fog is None else {"medium": {"type": "ref", "id": "fog"}}
    place = mi.ScalarTransform4f().translate([3, -2, 1]).scale(fog or 1)
    bound = {"type": "cube", "to_world": place, "bsdf": {"type": "null"}}
    look = mi.ScalarTransform4f().look_at([3, -2, 0.6], [3, -2, -1], [0, 1, 0])
    return mi.load_dict({
        "type": "scene",
        **({} if fog is None else {"fog": medium, "bound": {**bound, "interior": within["medium"]}}),
        "ball": {
            "type": "sphere", "center": [3, -2, 1], "flip_normals": True,
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": REFLECTED}},
        },
        "lamp": {**lamp, **within},
        "sensor": {
            "type": "perspective", "fov": 60, "near_clip": 1e-3, "to_world": look, "film": {"type": "hdrfilm"},
            **within,
        },
    })  # fmt: skip


def seen(shot, seeds=4, **settings):
    """Return the mean radiance of surfaces over several seeds, and its standard error.

    A pass over many pixels launches as many kernels as one over few: these two have the samples of 32 over 16 × 12.
    """
    size = {"width": 64, "height": 48, "passes": 2}
    found = [shot.render(**{**size, **settings}, seed=seed).layers["surface"] for seed in range(seeds)]
    found = np.array([each[..., :3].mean() for each in found])
    return found.mean(), found.std(ddof=1) / np.sqrt(seeds)


@pytest.mark.parametrize(
    ("size", "place", "bounces"),
    [(1.0, (0, 0, 0), 3), (0.02, (0.5, -0.2, 0.1), 1), (300.0, (2e4, -1e4, 5e3), 6)],
    ids=["at the origin", "small", "large and far away"],
)
def test_walls_of_a_ball_have_the_light_of_all_bounces(usd, size, place, bounces):
    found, error = seen(pb.Shot(usd(ball(size, place))), max_depth=2 + bounces)
    # The ball's facets are nearer to the lamp than a ball, by at most half a per cent of the light.
    assert abs(found - radiance(bounces)) < 4 * error + 0.005 * radiance(bounces)


def test_a_light_has_as_many_bounces_as_it_asks_for(usd):
    shot = pb.Shot(usd(ball(1.0, (0, 0, 0), light="int photonbeams:bounces = 1")))
    found, error = seen(shot)
    assert abs(found - radiance(1)) < 4 * error + 0.01 * radiance(1)


def test_the_walls_of_a_mitsuba_scene_have_that_light_too():
    scene = mitsuba_ball({
        "type": "sphere", "center": [3, -2, 1], "radius": LAMP, "bsdf": {"type": "null"},
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 1.0}},
    })  # fmt: skip
    found, error = seen(pb.Shot(scene), max_depth=5)
    assert abs(found - radiance(3)) < 4 * error + 0.002 * radiance(3)


# A lamp that shines into a narrow cone lights a small part of a ball's wall. All of the wall has the same irradiance by
# what that part reflects, and then by all later bounces: of the flux Φ, ρ Φ / (4 π r²) times Σ ρ^k. This is the cone's
# angle in degrees.
CONE = 12.0


def beyond_the_spot(flux, bounces):
    """Return the radiance of a ball's wall, of radius 1, where a spot does not shine."""
    return REFLECTED**2 * flux / (4 * np.pi**2) * sum(REFLECTED**k for k in range(bounces))


@pytest.mark.parametrize(
    ("size", "place", "fog"),
    [
        pytest.param(1.0, (0, 0, 0), None, id="clear"),
        pytest.param(30.0, (400, -200, 100), None, id="large", marks=pytest.mark.soak),
        pytest.param(1.0, (2, 1, 0), 1e-3, id="in fog"),
    ],
)
def test_a_spot_lights_the_rest_of_a_ball_by_bounces(usd, size, place, fog):
    shaping = f"float inputs:shaping:cone:angle = {CONE}\n    double3 xformOp:rotateXYZ = (0, 140, 0)"
    stage = ball(size, place, shaping).replace('["PhotonBeamsLightAPI"]', '["PhotonBeamsLightAPI", "ShapingAPI"]')
    head, lamp = stage.split("def SphereLight", 1)
    lamp = lamp.replace('["xformOp:translate"]', '["xformOp:translate", "xformOp:rotateXYZ"]', 1)
    shot = pb.Shot(usd(head + "def SphereLight" + lamp), medium=fog and pb.Medium(fog / size))
    found, error = seen(shot, max_depth=5)
    flux = np.pi * LAMP**2 * 2 * np.pi * (1 - np.cos(np.radians(CONE)))
    # The fog takes a few thousandths of the light.
    assert abs(found - beyond_the_spot(flux, 3)) < 4 * error + 0.01 * found
    assert error < 0.01 * found


@pytest.mark.parametrize("fog", [None, 0.5])
def test_a_spot_of_a_mitsuba_scene_does_so_too(fog):
    scene = mitsuba_ball({
        "type": "spot", "to_world": mi.ScalarTransform4f().look_at([3, -2, 1], [3.2, -2.1, 2], [0, 1, 0]),
        "cutoff_angle": CONE, "beam_width": CONE - 1e-3, "intensity": {"type": "rgb", "value": 1.0},
    }, fog)  # fmt: skip
    found, error = seen(pb.Shot(scene), max_depth=5)
    expected = beyond_the_spot(2 * np.pi * (1 - np.cos(np.radians(CONE))), 3)
    assert abs(found - expected) < 4 * error + 0.002 * expected
    assert error < 0.01 * expected


def test_beams_of_a_light_do_not_change_what_it_does_to_surfaces(usd):
    thin = """
def Sphere "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"])
{
    double radius = 0.3
    color3f photonbeams:scattering = (0.001, 0.001, 0.001)
}
"""
    shot = pb.Shot(usd(ball(1.0, (0, 0, 0), "int photonbeams:count = 256", thin)))
    found, error = seen(shot, max_depth=5)
    # The fog takes less than 0.06 % of the light.
    assert abs(found - radiance(3)) < 4 * error + 0.01 * radiance(3)


def test_a_sun_lights_endless_fog_as_far_as_its_beams_reach(usd):
    stage = """
def Mesh "Ground"
{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-3, 0, 3), (3, 0, 3), (3, 0, -3), (-3, 0, -3)]
    bool doubleSided = 1
}
def DistantLight "Sun"
{
    float inputs:intensity = 1000
    float inputs:angle = 0.5
    float3 xformOp:rotateXYZ = (-50, 30, 0)
    uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
}
def Scope "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"])
{
    color3f photonbeams:scattering = (0.05, 0.05, 0.05)
}
def Camera "Camera"
{
    float focalLength = 20
    double3 xformOp:translate = (0, 1, 2.5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
    shot, found = pb.Shot(usd(stage)), {}
    for method, passes in (("paths", 16), ("beams", 2)):
        frame = shot.render(width=64, height=48, passes=passes, method=method, max_depth=3)
        found[method] = frame.layers["beams"][..., :3].mean()
    # Beams reach a little farther than the sphere around everything, in whose cylinder they begin.
    assert found["paths"] == pytest.approx(found["beams"], rel=0.15)


def test_a_lamp_in_sight_counts_once_in_coloured_smoke():
    # At each collision that is none, in smoke with colours, a walk stops and goes on, with its lamp still ahead.
    density = np.random.default_rng(3).random((6, 6, 6)).astype(np.float32)
    place = np.diag([4.0, 4.0, 4.0, 1.0])
    place[:3, 3] = -2
    smoke = pb.scene.Medium((1.2, 0.8, 0.5), (0.1, 0.1, 0.1), grid=pb.scene.DensityGrid(density, place), name="/smoke")
    lamp = pb.scene.SphereLight("/lamp", (5.0, 5.0, 5.0), center=(0.3, 0.5, 0.2), radius=0.4)
    camera = pb.scene.Camera.look_at((0, 0, 8), (0, 0, 0))
    shot, found = pb.Shot(pb.scene.Scene(lights=[lamp], media=[smoke]), camera), {}
    for method, passes in (("paths", 4), ("beams", 2)):
        frames = [
            shot.render(width=32, height=24, passes=passes, seed=seed, method=method, max_depth=4, beams=2048)
            for seed in range(3)
        ]
        found[method] = np.array([each.layers["beams"][..., :3].mean(axis=(0, 1)) for each in frames])
    (paths, beams), errors = (
        [each.mean(axis=0) for each in found.values()],
        [each.std(axis=0, ddof=1) / np.sqrt(3) for each in found.values()],
    )
    # Few renders underestimate the errors; beams in a grid are up to a quarter of a free path wide.
    assert np.all(np.abs(paths - beams) < 5 * np.hypot(*errors) + 0.02 * beams)
    assert np.all(np.hypot(*errors) < 0.03 * beams)


SCREEN = """#usda 1.0
( upAxis = "Y" )
def SphereLight "Candle" {{
    float inputs:intensity = 0
    double3 xformOp:translate = (0, 5, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def Mesh "Floor" {{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-3, 0, 3), (3, 0, 3), (3, 0, -3), (-3, 0, -3)]
    color3f[] primvars:displayColor = [(0.6, 0.6, 0.6)]
}}
def Mesh "Screen" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-1, 0.5, -1), (1, 0.5, -1), (1, 1.5, -1), (-1, 1.5, -1)]
    rel material:binding = </Glow>
    {told}
}}
def Material "Glow" {{
    token outputs:surface.connect = </Glow/Shader.outputs:surface>
    def Shader "Shader" {{
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:emissiveColor = (2, 3, 4)
        token outputs:surface
    }}
}}
def Camera "Camera" {{
    float focalLength = 20
    double3 xformOp:translate = (0, 1, 4)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
"""


def test_a_screen_lights_the_room(tmp_path):
    """As a lamp that is asked for does, with and without bounces; 0 keeps it from that."""
    mean = {}
    kinds = {"glows": "", "lamp": "bool photonbeams:enabled = 1", "none": "bool photonbeams:enabled = 0"}
    for name, told in kinds.items():
        path = tmp_path / f"{name}.usda"
        path.write_text(SCREEN.format(told=told))
        for depth in (2, 4):
            layers = pb.Shot.open(path).render(passes=8, width=96, height=54, max_depth=depth).layers
            mean[name, depth] = float(layers["surface"][36:].mean())  # the floor
    assert mean["none", 2] == mean["none", 4] == 0
    assert mean["glows", 2] == mean["lamp", 2] > 0.05
    assert mean["glows", 4] == mean["lamp", 4] > mean["lamp", 2]
