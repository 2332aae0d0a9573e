"""Pictures by panoramic cameras: each pixel is what its ray meets, beams and surfaces alike."""

import numpy as np
import pytest

import photonbeams as pb

# A room of six walls that glow in six colours and light nothing, with an endless fog and a beam that passes the camera.
SIDES = {"Front": (0, 0, -1), "Back": (0, 0, 1), "Right": (1, 0, 0), "Left": (-1, 0, 0), "Up": (0, 1, 0),
         "Down": (0, -1, 0)}  # fmt: skip
COLORS = {"Front": (1, 0, 0), "Back": (0, 1, 0), "Right": (0, 0, 1), "Left": (1, 1, 0), "Up": (0, 1, 1),
          "Down": (1, 0, 1)}  # fmt: skip
SIZE = 4.0
FOG = pb.Medium(scattering=0.05)
BEAM = {"start": (-2.0, 1.0, -3.0), "end": (3.0, 0.5, 1.5), "radius": 0.8}
CAMERA = """def Camera "C" {{
    token photonbeams:projection = "{projection}"
    float2 photonbeams:fieldOfView = {field}
    {more}
}}
"""


def wall(name):
    normal, color = np.array(SIDES[name]) * SIZE, COLORS[name]
    one = np.roll(np.array(SIDES[name]), 1) * SIZE
    other = np.cross(normal, one) / SIZE
    points = [tuple(normal + a * one + b * other) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    return f"""def Mesh "{name}" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = {[tuple(map(float, each)) for each in points]}
    uniform token subdivisionScheme = "none"
    bool photonbeams:enabled = 0
    rel material:binding = </M{name}>
}}
def Material "M{name}" {{
    token outputs:surface.connect = </M{name}/S.outputs:surface>
    def Shader "S" {{
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (0, 0, 0)
        color3f inputs:emissiveColor = {color}
        token outputs:surface
    }}
}}
"""


STAGE = f"""#usda 1.0
(
    endTimeCode = 2
)
def Scope "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) {{
    color3f photonbeams:scattering = (0.05, 0.05, 0.05)
    bool photonbeams:surfaces = 0
}}
def BasisCurves "Beam" (prepend apiSchemas = ["PhotonBeamsCurvesAPI"]) {{
    uniform token type = "linear"
    int[] curveVertexCounts = [2]
    point3f[] points = [{BEAM["start"]}, {BEAM["end"]}]
    float[] widths = [{2 * BEAM["radius"]}]
    color3f[] photonbeams:power = [(20, 10, 5)]
}}
"""


@pytest.fixture
def rendered(tmp_path):
    def render(projection, field=(0, 0), more="", walls=(), stereo=None, **given):
        path = tmp_path / "stage.usda"
        camera = CAMERA.format(projection=projection, field=field, more=more)
        path.write_text(STAGE + camera + "".join(wall(each) for each in walls))
        given = {"passes": 1, "pixel_filter": "box", **given}
        return pb.Shot.open(path, stereo=stereo).render(**given)

    return render


def along(directions, origin=(0.0, 0.0, 0.0)):
    """Return the radiance of the beam along rays, (N, 3)."""
    beams = pb.Beams([BEAM["start"]], [BEAM["end"]], BEAM["radius"], BEAM["radius"], power=[[20, 10, 5]])
    return pb.estimate(beams, np.tile(origin, (len(directions), 1)), directions, medium=FOG).numpy()


def latlong(width, height):
    x, y = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    lon, lat = 2 * np.pi * (x - 0.5), np.pi * (0.5 - y)
    return np.stack([np.sin(lon) * np.cos(lat), np.sin(lat), -np.cos(lon) * np.cos(lat)], axis=-1)


def agrees(found, expected):
    """Compare pictures whose pixels are jittered with their centres: by the slopes to the neighbours.

    A ray lies within half a pixel of the centre in x and in y, so the difference is at most half of both slopes, which
    are taken generously from the largest in the neighbourhood, plus the estimate's own error.
    """
    slope = np.zeros(expected.shape)
    for axis in (0, 1):
        step = np.abs(np.diff(expected, axis=axis))
        pad = [(0, 0)] * 3
        pad[axis] = (1, 1)
        step = np.pad(step, pad, mode="edge")
        low, high = (np.take(step, range(k, step.shape[axis] - 1 + k), axis=axis) for k in (0, 1))
        slope += np.maximum(low, high)
    rough = np.maximum.reduce([np.roll(slope, (a, b), (0, 1)) for a in (-1, 0, 1) for b in (-1, 0, 1)])
    assert np.all(np.abs(found - expected) <= rough + 2e-3 * expected.max())


def test_beams_of_a_panorama_are_those_along_its_rays(rendered):
    frame = rendered("equirectangular", width=64)
    assert frame.layers["beams"].shape == (32, 64, 3)  # its height is half of its width
    expected = along(latlong(64, 32).reshape(-1, 3)).reshape(32, 64, 3)
    assert (expected > 0.01 * expected.max()).mean() > 0.1
    agrees(frame.layers["beams"], expected)
    assert frame.layers["beams"].sum() == pytest.approx(expected.sum(), rel=0.02)


def test_surfaces_of_a_panorama_are_where_its_rays_meet_them(rendered):
    layers = rendered("equirectangular", width=64, walls=SIDES).layers
    direction = latlong(64, 32)
    sides = np.array([*SIDES.values()])
    nearest = (direction @ sides.T).argmax(axis=-1)
    expected = np.array([*COLORS.values()])[nearest]
    inside = np.sort(direction @ sides.T, axis=-1)
    inside = inside[..., -1] - inside[..., -2] > 0.15  # not beside an edge of the room: a pixel is 0.1 radians wide
    assert inside.mean() > 0.6
    np.testing.assert_allclose(layers["surface"][inside], expected[inside], atol=1e-5)
    # Depths are distances, which the middle of a wall has least of.
    distance = SIZE / (direction @ sides.T).max(axis=-1)
    np.testing.assert_allclose(layers["depth"][inside][:, 0], distance[inside], rtol=1e-4)


def test_a_dome_sees_a_circle_and_is_black_around_it(rendered):
    layers = rendered("fisheyeEquidistant", width=32, walls=SIDES).layers
    assert layers["rgba"].shape == (32, 32, 4)
    x, y = np.meshgrid((np.arange(32) + 0.5) / 16 - 1, 1 - (np.arange(32) + 0.5) / 16)
    r = np.hypot(x, y)
    outside, around = r > 1.1, (r > 0.85) & (r < 0.95)
    np.testing.assert_array_equal(layers["rgba"][outside], 0)
    np.testing.assert_array_equal(layers["beams"][outside], 0)
    assert (layers["rgba"][r < 0.95][:, 3] == 1).all()
    # 80 degrees from the axis, only the walls beside the camera are seen.
    np.testing.assert_allclose(layers["surface"][r < 0.3], [[1, 0, 0]] * (r < 0.3).sum(), atol=1e-5)
    assert layers["surface"][around][:, 0].mean() == pytest.approx(0.5, abs=0.05)  # yellow and magenta, not the front
    theta = r * np.pi / 2
    side = np.sin(theta) / r
    inner = r < 0.9
    directions = np.stack([side * x, side * y, -np.cos(theta)], axis=-1).reshape(-1, 3)
    expected = np.where(inner[..., None], along(directions).reshape(32, 32, 3), 0)
    found = np.where(inner[..., None], layers["beams"], 0)
    assert found.sum() == pytest.approx(expected.sum(), rel=0.03)


def test_a_moving_panorama_is_blurred_along_its_path(rendered):
    more = """double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 1: (0, -1, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    double shutter:close = 1"""
    frame = rendered("equirectangular", more=more, width=32, passes=16, frame=0)
    directions = latlong(32, 16).reshape(-1, 3)
    times = (np.arange(16) + 0.5) / 16
    expected = np.mean([along(directions, (0, -t, 0)) for t in times], axis=0).reshape(16, 32, 3)
    still = along(directions).reshape(16, 32, 3)
    found = frame.layers["beams"]
    # Of 16 passes with a time in each sixteenth of the shutter, the mean of all pixels is known to about a percent.
    assert found.sum() == pytest.approx(expected.sum(), rel=0.02)
    assert np.abs(found - expected).sum() < 0.2 * np.abs(found - still).sum()


def test_a_tile_of_a_panorama_has_the_pixels_of_the_whole(rendered):
    whole = rendered("equirectangular", width=32, walls=("Front",)).layers["rgba"]
    part = rendered("equirectangular", width=32, walls=("Front",), crop=(0.5, 0.0, 1.0, 0.5)).layers["rgba"]
    np.testing.assert_array_equal(part, whole[:8, 16:])


def test_what_panoramas_cannot_do_is_told(rendered):
    for given, text in (({"stereo": pb.Stereo()}, "is equirectangular: expected a perspective camera"),
                        ({"deep": True}, "perspective or orthographic")):  # fmt: skip
        with pytest.raises(pb.SceneError, match=text):
            rendered("equirectangular", width=32, **given)
