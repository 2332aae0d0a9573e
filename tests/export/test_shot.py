"""Stages exported as Mitsuba scenes: the files, the warnings, and the same pictures."""

import logging

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.export.shot import export
from photonbeams.runtime.device import mitsuba
from photonbeams.scene import SceneError
from tests.helpers.agreement import deviations, means, ratio
from tests.helpers.sweep import sweep
from tests.helpers.usda import material, quad

pytestmark = pytest.mark.usefixtures("helping_thread")

mi = mitsuba()
SEEDS, PASSES, WIDTH = 4, 4, 48
# Texture coordinates of a quad that repeat the image along one edge.
COORDINATES = 'texCoord2f[] primvars:st = [(0, 0), (1.5, 0), (1.5, 1), (0, 1)] (interpolation = "vertex")'


def textured(name, *inputs):
    """Return a material with a texture, `checks.png`, that is read by the coordinates `st`."""
    nodes = f"""    def Shader "Image"
    {{
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @./checks.png@
        token inputs:sourceColorSpace = "raw"
        token inputs:wrapS = "repeat"
        token inputs:wrapT = "repeat"
        float2 inputs:st.connect = </{name}/Reader.outputs:result>
        float3 outputs:rgb
    }}
    def Shader "Reader"
    {{
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "st"
        float2 outputs:result
    }}
"""
    return material(name, *inputs, nodes=nodes)


def placed(kind, name, at, *inputs, turned=(0, 0, 0), scale=(1, 1, 1), api=""):
    lines = "\n".join(f"    {each}" for each in inputs)
    return f"""
def {kind} "{name}" {api}
{{
{lines}
    double3 xformOp:translate = {at}
    float3 xformOp:rotateXYZ = {turned}
    double3 xformOp:scale = {scale}
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
}}
"""


def camera(*inputs, size=1):
    apertures = f"float horizontalAperture = {24 * size}", f"float verticalAperture = {16 * size}"
    return placed(
        "Camera", "Camera", (0, 0.1, 3), "float focalLength = 24", *apertures, *inputs, turned=(-4, 8, 3)
    )  # fmt: skip


def fog(at=(0, 0, -9), *inputs, size=0.1):
    """Return a fog, by default outside the picture: a stage cannot be rendered without one."""
    values = inputs or ("color3f photonbeams:scattering = (0.001, 0.001, 0.001)",)
    return placed(
        "Cube", "Fog", at, f"double size = {size}", *values, api='(prepend apiSchemas = ["PhotonBeamsMediumAPI"])'
    )


GREY = material("Grey", "color3f inputs:diffuseColor = (0.5, 0.6, 0.4)", "float inputs:roughness = 1")
PAINT = textured(
    "Paint", "color3f inputs:diffuseColor.connect = </Paint/Image.outputs:rgb>", "float inputs:roughness = 0.8"
)
GLOSS = material(
    "Gloss", "color3f inputs:diffuseColor = (0.7, 0.3, 0.2)", "float inputs:roughness = 0.4",
    "float inputs:metallic = 0.5", "float inputs:clearcoat = 0.5", "float inputs:clearcoatRoughness = 0.3",
    "float inputs:opacity = 0.6",
)  # fmt: skip
# A floor, a painted wall behind, and in front of it a glossy, partly transparent board with bent normals.
ROOM = (
    GREY + PAINT + GLOSS
    + quad("Floor", "[(-2, -1, 1), (2, -1, 1), (2, -1, -2), (-2, -1, -2)]", "Grey")
    + quad("Wall", "[(-2, -1, -2), (2, -1, -2), (2, 1, -2), (-2, 1, -2)]", "Paint", COORDINATES)
    + quad(
        "Board", "[(-0.5, -1, -0.6), (0.4, -1, -0.2), (0.5, -0.3, -0.5), (-0.6, -0.2, -0.9)]", "Gloss",
        "normal3f[] normals = [(-0.3, 0, 1), (0.3, 0, 1), (0.2, 0.3, 1), (-0.2, 0.4, 1)]\n"
        '    uniform token subdivisionScheme = "none"',
    )
)  # fmt: skip

DOWN = {"turned": (-60, 20, 0)}
POINT = "bool treatAsPoint = 1"


def colored(color, intensity):
    return f"color3f inputs:color = {color}", f"float inputs:intensity = {intensity}"


# One light for each channel.
R, G, B = (1, 0, 0), (0, 1, 0), (0, 0, 1)
LIGHTS = {
    "sphere, rectangle, disk": (
        placed("SphereLight", "A", (-0.5, 1.2, 0.8), *colored(R, 20), "float inputs:radius = 0.2")
        + placed("RectLight", "B", (0.6, 1.3, 0.8), *colored(G, 5), "float inputs:width = 0.3",
                 "float inputs:height = 0.8", 'asset inputs:texture:file = @./checks.png@', **DOWN)
        + placed("DiskLight", "C", (0, 1.4, 0.6), *colored(B, 9), scale=(1, 0.5, 1), **DOWN)
    ),
    "point, spot, soft spot": (
        placed("SphereLight", "A", (-0.5, 1.2, 0.8), *colored(R, 40), POINT)
        + placed("SphereLight", "B", (0.6, 1.3, 0.8), *colored(G, 90), POINT,
                 "float inputs:shaping:cone:angle = 35", **DOWN)
        + placed("SphereLight", "C", (0, 1.4, 0.6), *colored(B, 90), POINT, "float inputs:shaping:cone:angle = 45",
                 "float inputs:shaping:cone:softness = 0.6", "float inputs:shaping:focus = 3", **DOWN)
    ),
    "distant, dome": (
        placed("DistantLight", "A", (0, 0, 0), *colored(R, 2), "float inputs:angle = 0", **DOWN)
        + placed("DomeLight", "B", (0, 0, 0), *colored((0, 1, 0.6), 1), "asset inputs:texture:file = @./sky.exr@",
                 turned=(20, 70, 10))
    ),
    "gobo": placed(
        "SphereLight", "A", (0, 1.2, 1.5), *colored((1, 1, 1), 90), POINT, "asset photonbeams:gobo = @./checks.png@",
        "float photonbeams:gobo:angle = 70", turned=(-35, 0, 10),
        api='(prepend apiSchemas = ["PhotonBeamsLightAPI"])',
    ),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    """Return a folder with an image of painted squares, and a sky of noise."""
    checks = np.full((8, 8, 3), 30, np.uint8)
    checks[:4, :4], checks[:2, 4:], checks[5:, 6:] = (230, 60, 30), (40, 200, 90), (50, 70, 240)
    mi.Bitmap(checks).write(str(tmp_path / "checks.png"))
    sky = 3 * np.random.default_rng(1).random((16, 32, 3)).astype(np.float32) ** 4
    mi.Bitmap(sky).write(str(tmp_path / "sky.exr"))
    return tmp_path


def shot_of(folder, *parts):
    path = folder / "stage.usda"
    path.write_text('#usda 1.0\n(\n    upAxis = "Y"\n)\n' + "".join(parts))
    return pb.Shot.open(path)


def pictures(shot, **settings):
    found = [shot.render(passes=PASSES, width=WIDTH, beams=16, seed=seed, **settings) for seed in range(SEEDS)]
    return np.array([each.layers["rgba"][..., :3] for each in found])


def twins(path, samples=64):
    scene = mi.load_file(str(path))
    volpath = mi.load_dict({"type": "volpath", "max_depth": 2})
    return np.array(
        [np.array(mi.render(scene, integrator=volpath, spp=samples, seed=seed))[..., :3] for seed in range(SEEDS)]
    )


def agree(ours, theirs):
    """Assert that two sets of pictures have the same mean.

    None of about a hundred means of blocks should be six standard errors off, with variances from few seeds.
    """
    found, expected = means(ours, 8), means(theirs, 8)
    value, error = ratio(found, expected)
    assert abs(value - 1) < 5e-3 + 4 * error
    assert deviations(found, expected, bias=0.005).max() < 6


# Lamps that are points and spots light the pictures of a lens and of a crop too, below.
@pytest.mark.parametrize("name", sweep(LIGHTS, [name for name in LIGHTS if not name.startswith("point")]))
def test_lights_light_surfaces_of_the_twin_as_those_of_the_stage(name, folder):
    shot = shot_of(folder, ROOM, fog(), camera(), LIGHTS[name])
    export(shot, folder / "twin.xml", width=WIDTH)
    agree(pictures(shot), twins(folder / "twin.xml"))


def test_a_lens_blurs_in_the_twin_what_it_blurs_on_the_stage(folder):
    lens = camera("float fStop = 12", "float focusDistance = 2")
    shot = shot_of(folder, ROOM, fog(), lens, LIGHTS["point, spot, soft spot"])
    export(shot, folder / "twin.xml", width=WIDTH)
    agree(pictures(shot), twins(folder / "twin.xml"))


def test_a_crop_and_an_exposure_are_those_of_the_stage(folder):
    shot = shot_of(folder, ROOM, fog(), camera("float exposure = 1"), LIGHTS["point, spot, soft spot"])
    export(shot, folder / "twin.xml", width=2 * WIDTH, crop=(0.25, 0.5, 0.75, 1))
    settings = {"width": 2 * WIDTH, "crop": (0.25, 0.5, 0.75, 1)}
    found = [shot.render(passes=PASSES, beams=16, seed=seed, **settings) for seed in range(SEEDS)]
    agree(np.array([each.layers["rgba"][..., :3] for each in found]), twins(folder / "twin.xml"))


GLOW = material("Glow", "color3f inputs:emissiveColor = (2, 1, 0.5)")


def test_a_mesh_glows_in_the_twin(folder):
    shot = shot_of(
        folder, GLOW, quad("Lamp", "[(-1, -1, -2), (1, -1, -2), (1, 1, -2), (-1, 1, -2)]", "Glow"), fog(), camera(),
        LIGHTS["point, spot, soft spot"],
    )  # fmt: skip
    export(shot, folder / "twin.xml", width=WIDTH)
    scene = mi.load_file(str(folder / "twin.xml"))
    seen = np.array(mi.render(scene, integrator=mi.load_dict({"type": "path", "max_depth": 1}), spp=4))
    assert np.allclose(seen[..., :3].max(axis=(0, 1)), (2, 1, 0.5), rtol=1e-5)


def test_the_camera_names_the_medium_that_it_is_in(folder):
    around = "color3f photonbeams:scattering = (0.1, 0.2, 0.4)", "color3f photonbeams:absorption = (0.1, 0, 0)"
    lights = LIGHTS["point, spot, soft spot"]
    for at, size, inside in (((0, 0, 2.5), 4, True), ((0, 0, -1), 3, False)):
        export(shot_of(folder, fog(at, *around, size=size), camera(), lights), folder / "twin.xml", width=WIDTH)
        scene = mi.load_file(str(folder / "twin.xml"))
        medium = scene.sensors()[0].get_medium()
        assert (medium is not None) == inside
        (shape,) = scene.shapes()
        values = shape.interior_medium().get_scattering_coefficients(mi.MediumInteraction3f())
        assert np.allclose(np.ravel(values[2]), (0.2, 0.2, 0.4)) and np.allclose(np.ravel(values[0]), (0.1, 0.2, 0.4))


def test_a_fog_without_a_border_is_the_medium_of_the_camera_alone(folder):
    endless = 'def Scope "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"])\n{\n'
    endless += "color3f photonbeams:scattering = (0.2, 0.2, 0.2)\nfloat photonbeams:anisotropy = 0.5\n}\n"
    export(shot_of(folder, endless, camera(), LIGHTS["point, spot, soft spot"]), folder / "twin.xml", width=WIDTH)
    scene = mi.load_file(str(folder / "twin.xml"))
    assert scene.sensors()[0].get_medium().phase_function().class_name() == "HGPhaseFunction"
    assert not scene.shapes()


# -- what is left out --------------------------------------------------------------------------------------------------

LOST = {
    "/A.photonbeams:portal": ("SphereLight", "rel photonbeams:portal = </Floor>"),
    "/A.photonbeams:look": ("SphereLight", "rel photonbeams:look = </Look>"),
    "/A.photonbeams:lightGroup": ("SphereLight", 'token photonbeams:lightGroup = "warm"'),
    "/A.photonbeams:intensity": ("SphereLight", "float photonbeams:intensity = 2"),
    "/A.photonbeams:enabled": ("SphereLight", "bool photonbeams:enabled = 0"),
    "/A.inputs:diffuse": ("SphereLight", "float inputs:diffuse = 0\nfloat inputs:specular = 0"),
    "/A.inputs:shaping": ("SphereLight", "float inputs:shaping:focus = 2"),
    "/A shines from a point": ("RectLight", "float inputs:shaping:cone:angle = 20"),
    "/A.inputs:angle": ("DistantLight", "float inputs:angle = 1"),
    "/A.light:filters": ("SphereLight", "rel light:filters = </Dim>"),
    "/A.collection:shadowLink": ("SphereLight", "rel collection:shadowLink:excludes = </Floor>"),
    "/A.collection:lightLink": ("SphereLight", "rel collection:lightLink:excludes = </Floor>"),
    "/A.photonbeams:gobo": (
        "DistantLight",
        "asset photonbeams:gobo = @./checks.png@\nfloat photonbeams:gobo:width = 1\nfloat inputs:angle = 0",
    ),
    "/A: what is behind": ("SphereLight", "float inputs:radius = 3"),
}  # fmt: skip
PLAIN = """
def PhotonBeamsLook "Look" {
}
def PhotonBeamsBlockerFilter "Dim" {
}
""" + placed("SphereLight", "Other", (0, 1, 0), POINT)


@pytest.mark.parametrize("prim", LOST)
def test_what_mitsuba_cannot_say_is_warned_of_once(prim, folder, caplog):
    kind, line = LOST[prim]
    api = '(prepend apiSchemas = ["PhotonBeamsLightAPI", "CollectionAPI:lightLink", "CollectionAPI:shadowLink"])'
    shot = shot_of(folder, ROOM, fog(), camera(), PLAIN, placed(kind, "A", (0, 1.2, 0.8), line, api=api))
    with caplog.at_level(logging.WARNING, "photonbeams"):
        export(shot, folder / "twin.xml", width=WIDTH)
    (said,) = [each.getMessage() for each in caplog.records]
    assert prim in said and said.startswith(str(folder / "stage.usda")) and len(said) - len(str(folder)) < 300


def test_beams_that_someone_drew_are_warned_of(folder, caplog):
    curves = """
def BasisCurves "Drawn" (prepend apiSchemas = ["PhotonBeamsCurvesAPI"])
{
    uniform token type = "linear"
    int[] curveVertexCounts = [2]
    point3f[] points = [(0, 0, 0), (1, 0, 0)]
    float[] widths = [0.1, 0.1]
}
"""
    export(shot_of(folder, fog(), camera(), PLAIN, curves), folder / "twin.xml", width=WIDTH)
    assert "/Drawn is left out" in caplog.text


# -- files -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shot", "path", "message"),
    [
        ("stage.usda", "a.xml", "shot is 'stage.usda': expected a Shot"),
        (None, b"a", "path is b'a': expected text or a"),
    ],
)
def test_what_is_no_shot_and_no_path_is_refused(folder, shot, path, message):
    with pytest.raises(SceneError, match=message):
        export(shot or shot_of(folder, camera()), path)


def test_all_files_are_whole_or_none_is_there(folder, monkeypatch):
    shot = shot_of(folder, ROOM, fog(), camera(), LIGHTS["distant, dome"])
    before = sorted(each.name for each in folder.iterdir())

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("photonbeams.export.scene._write_image", full)
    with pytest.raises(OSError, match="No space left"):
        export(shot, folder / "twin.xml", width=WIDTH)
    assert sorted(each.name for each in folder.iterdir()) == before
    monkeypatch.undo()
    files = export(shot, folder / "twin.xml", width=WIDTH)
    assert files[0] == folder / "twin.xml" and all(each.is_file() for each in files)
    assert sorted(files[1:]) == sorted((folder / "twin").iterdir())


def test_ids_are_those_of_prims(folder):
    export(shot_of(folder, ROOM, fog(), camera(), LIGHTS["sphere, rectangle, disk"]), folder / "twin.xml")
    scene = mi.load_file(str(folder / "twin.xml"))
    assert {"A", "B", "C"} == {each.id() for each in scene.emitters()}
    assert scene.sensors()[0].id() == "Camera"
    assert scene.integrator().settings.max_depth == 2 and scene.sensors()[0].sampler().sample_count() == 16


@pytest.mark.parametrize("name", ["twin.json", "stage.usda"])
def test_another_kind_of_file_is_refused(name, folder):
    shot = shot_of(folder, fog(), camera(), PLAIN)
    with pytest.raises(SceneError, match=r"expected a name that ends in \.xml"):
        export(shot, folder / name)
