"""PhotonBeamsLook prims, and the schemas."""

import numpy as np
import pytest
from pxr import Usd

from photonbeams.looks import ColorRamp
from photonbeams.scene import Medium, SceneError
from photonbeams.usd.common.definitions import LOOK, PREFIX, definitions
from photonbeams.usd.common.reading import Reading
from photonbeams.usd.looks.shading import build_look

MEDIUM = Medium((0.1, 0.1, 0.1))
LIGHT = 'def SphereLight "L" {\nrel photonbeams:look = </Look>\n}\n'


def look(body):
    return f'{LIGHT}def PhotonBeamsLook "Look" {{\n{body}\n}}\n'


@pytest.fixture
def read(scene):
    return lambda body: scene(look(body)).lights[0].look


@pytest.fixture
def values(read):
    return lambda body: read(body).values


def test_a_look_without_attributes_is_physical(read):
    """What is read are the fallbacks of the schema, which are physical."""
    found = read("")
    assert found.name == "/Look"
    for name, own in definitions(LOOK).items():
        value = found.values[name.removeprefix(PREFIX)]
        if isinstance(value, float):
            assert value == pytest.approx(own.default, rel=1e-7)
        else:
            assert (list(value) if isinstance(value, tuple) else value) == own.default
    physical = [found.values[name] for name in ("along:falloff", "eye:falloff", "angle:shading")]
    assert physical == ["physical"] * 3 and found.values["across:profile"] == "epanechnikov"


def test_what_is_read_is_all_that_the_schema_has(scene, monkeypatch):
    asked = set()
    value = Reading.value

    def remember(self, prim, name, default=None):
        if prim.GetTypeName() == "PhotonBeamsLook":
            asked.add(name)
        return value(self, prim, name, default)

    monkeypatch.setattr(Reading, "value", remember)
    scene(look(""))
    definition = Usd.SchemaRegistry().FindConcretePrimDefinition("PhotonBeamsLook")
    assert asked == {name for name in definition.GetPropertyNames() if name.startswith("photonbeams:")}


def test_a_ramp_is_read(values):
    spec = values("""
        float[] photonbeams:along:ramp:knots = [0, 0.5, 2]
        color3f[] photonbeams:along:ramp:colors = [(1, 1, 1), (1, 0.5, 0), (0.25, 0, 0)]
        uniform token photonbeams:along:ramp:interpolation = "catmullRom"
        uniform token photonbeams:along:space = "distance"
        float photonbeams:along:begin = 1
        float photonbeams:along:end = 3
        bool photonbeams:along:physical = 0
        color3f photonbeams:along:tint = (0.5, 1, 1)""")
    assert spec["along:ramp:knots"] == (0, 0.5, 2)
    assert spec["along:ramp:colors"] == ((1, 1, 1), (1, 0.5, 0), (0.25, 0, 0))
    assert spec["along:ramp:interpolation"] == "catmullRom"
    assert [spec[f"along:{name}"] for name in ("space", "begin", "end")] == ["distance", 1, 3]
    assert not spec["along:physical"]
    assert spec["along:tint"] == (0.5, 1, 1)


def test_falloffs_are_read(values):
    spec = values("""
        uniform token photonbeams:along:falloff = "polynomial"
        float[] photonbeams:along:coefficients = [1, -2, 1]
        float photonbeams:along:length = 3
        float photonbeams:along:exponent = 1.5
        uniform token photonbeams:eye:falloff = "exponential"
        float photonbeams:eye:length = 7""")
    assert (spec["along:falloff"], spec["along:coefficients"]) == ("polynomial", (1, -2, 1))
    assert (spec["along:length"], spec["along:exponent"]) == (3, 1.5)
    assert (spec["eye:falloff"], spec["eye:length"]) == ("exponential", 7)


def test_profiles_and_angles_are_read(values):
    spec = values("""
        uniform token photonbeams:across:profile = "tabulated"
        float[] photonbeams:across:values = [1, 0.5, 0]
        float photonbeams:across:hardness = 0.25
        float photonbeams:across:width = 0.5
        uniform token photonbeams:angle:shading = "glow"
        float photonbeams:angle:anisotropy = 0.5
        float photonbeams:angle:mix = 0.25
        float photonbeams:angle:gain = 2""")
    across = [spec[f"across:{name}"] for name in ("profile", "width", "hardness", "values")]
    assert across == ["tabulated", 0.5, 0.25, (1, 0.5, 0)]
    assert [spec[f"angle:{name}"] for name in ("shading", "anisotropy", "mix", "gain")] == ["glow", 0.5, 0.25, 2]


def test_every_factor_takes_a_ramp_a_texture_and_an_expression(read, image):
    path = image("ramp.exr", [[[1, 0, 0], [0, 1, 0]]], "float")
    for slot, place in (
        ("along", ("fraction", 0, 1)),
        ("across", ("radius", 0, 1)),
        ("eye", ("distance", 2, 5)),
        ("angle", ("angle", 0, 180)),
    ):
        found = read(f"""
            float[] photonbeams:{slot}:ramp:knots = [0, 1]
            color3f[] photonbeams:{slot}:ramp:colors = [(1, 1, 1), (1, 0.5, 0)]
            uniform token photonbeams:{slot}:ramp:interpolation = "smooth"
            asset photonbeams:{slot}:texture = @{path}@
            string photonbeams:{slot}:expression = "1 - r"
            float photonbeams:eye:begin = 2
            float photonbeams:eye:end = 5""")
        own = {name.removeprefix(f"{slot}:"): value for name, value in found.values.items()}
        assert (own["ramp:knots"], own["ramp:colors"]) == ((0, 1), ((1, 1, 1), (1, 0.5, 0)))
        assert (own["ramp:interpolation"], own["expression"]) == ("smooth", "1 - r")
        assert np.allclose(own["texture"], [[1, 0, 0], [0, 1, 0]])
        space, begin, end = place
        ramp = ColorRamp((0, 1), ((1, 1, 1), (1, 0.5, 0)), "smooth", begin=begin, end=end, space=space)
        assert repr(ramp) in repr(build_look(found))
        built = build_look(found).bind(MEDIUM, 5.0)
        assert "radius" in built.uses and built.by_radius


def test_noise_fade_and_variation_are_read_and_built(read):
    found = read("""
        float photonbeams:along:inner = 1
        float photonbeams:along:outer = 3
        uniform token photonbeams:along:fade = "linear"
        float photonbeams:noise:amount = 0.5
        float photonbeams:noise:scale = 2
        int photonbeams:noise:octaves = 3
        float photonbeams:noise:contrast = 1.5
        float3 photonbeams:noise:drift = (0, 0.5, 0)
        float photonbeams:noise:evolution = 0.25
        uniform token photonbeams:noise:space = "light"
        float photonbeams:variation = 0.125
        uniform token photonbeams:surfaces = "tint"
        uniform token photonbeams:across:profile = "hollow"
        float photonbeams:across:inner = 0.25
        float photonbeams:across:softness = 0.5""")
    own = found.values
    assert (own["along:inner"], own["along:outer"], own["along:fade"]) == (1, 3, "linear")
    noise = [own[f"noise:{name}"] for name in ("amount", "scale", "octaves", "contrast", "drift", "evolution", "space")]
    assert noise == [0.5, 2, 3, 1.5, (0, 0.5, 0), 0.25, "light"]
    assert own["variation"] == 0.125
    assert (own["across:profile"], own["across:inner"], own["across:softness"]) == ("hollow", 0.25, 0.5)
    assert build_look(found).surfaces == "tint"
    built = build_look(found).bind(MEDIUM, 5.0)
    assert {"local", "random", "time"} <= built.uses
    assert ("distance", pytest.approx(1)) in built.corners and ("distance", pytest.approx(3)) in built.corners


def test_a_texture_along_the_beam_is_decoded_and_its_rows_averaged(values, image):
    path = image("ramp.exr", [[[1, 0, 0], [0, 1, 0]], [[3, 0, 0], [0, 1, 2]]], "float")
    found = values(f"asset photonbeams:along:texture = @{path}@")["along:texture"]
    assert np.allclose(found, [[2, 0, 0], [0, 1, 1]])


def test_the_ends_of_a_range_are_in_it(values):
    """The ends of a range are accepted, although USD's single precision stores 0.99 as a little less or more."""
    found = values("""
        float photonbeams:across:width = 0.02
        float photonbeams:across:inner = 0.99
        float photonbeams:across:softness = 0.01
        float photonbeams:angle:anisotropy = -0.99""")
    assert [found[f"across:{name}"] for name in ("width", "inner", "softness")] == [0.02, 0.99, 0.01]
    assert found["angle:anisotropy"] == -0.99


def test_a_look_that_is_no_relationship_is_an_error(scene):
    with pytest.raises(SceneError, match=r"/L\.photonbeams:look is an attribute"):
        scene('def SphereLight "L" {\nstring photonbeams:look = "Look"\n}\n')


def test_lights_and_curves_share_a_look(scene):
    text = (
        look("")
        + """
    def BasisCurves "B" (prepend apiSchemas = ["PhotonBeamsCurvesAPI"]) {
        uniform token type = "linear"
        int[] curveVertexCounts = [2]
        point3f[] points = [(0, 0, 0), (1, 0, 0)]
        float[] widths = [0.1]
        rel photonbeams:look = </Look>
    }"""
    )
    result = scene(text)
    assert result.drawn[0].look is result.lights[0].look


def test_a_misspelt_attribute_is_named(read, caplog):
    read("float photonbeams:along:lenght = 3")
    assert "/Look.photonbeams:along:lenght is not an attribute of a PhotonBeamsLook" in caplog.text


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            "float[] photonbeams:along:ramp:knots = [0, 1]",
            "along:ramp:knots has 2 values but ramp:colors has 0",
        ),
        (
            "float[] photonbeams:along:ramp:knots = [1, 0]\n"
            "color3f[] photonbeams:along:ramp:colors = [(1, 1, 1), (1, 1, 1)]",
            r"along:ramp:knots is \[1\.0, 0\.0\]",
        ),
        (
            "float[] photonbeams:along:ramp:knots = [0.5, 0.5]\n"
            "color3f[] photonbeams:along:ramp:colors = [(1, 1, 1), (1, 1, 1)]",
            r"along:ramp:knots is \[0\.5, 0\.5\]",
        ),
        (
            "float[] photonbeams:along:ramp:knots = [nan]\ncolor3f[] photonbeams:along:ramp:colors = [(1, 1, 1)]",
            r"along:ramp:knots\[0\] is nan",
        ),
        (
            "float[] photonbeams:along:ramp:knots = [0]\ncolor3f[] photonbeams:along:ramp:colors = [(1, -1, 1)]",
            r"along:ramp:colors\[0\] is .*",
        ),
        (
            'uniform token photonbeams:along:falloff = "steep"',
            "along:falloff is 'steep'",
        ),
        ('uniform token photonbeams:along:falloff = "polynomial"', r"along:coefficients is empty"),
        ("float photonbeams:along:length = 0", "along:length is 0"),
        ("float photonbeams:along:end = -1", "along:end is -1"),
        (
            'uniform token photonbeams:across:profile = "tabulated"',
            r"across:values is \[\]: a tabulated profile expects",
        ),
        (
            "float photonbeams:across:hardness = 2",
            "across:hardness is 2.*",
        ),
        (
            'uniform token photonbeams:eye:falloff = "power"',
            "eye:falloff is 'power'",
        ),
        (
            "float photonbeams:along:inner = 2\nfloat photonbeams:along:outer = 1",
            "along:outer is 1",
        ),
        ("float photonbeams:eye:begin = 2", "eye:end is 1"),
        (
            'string photonbeams:across:expression = "1 - rr"',
            r'across:expression is wrong: expression "1 - rr", column 5: ',
        ),
        ("""string photonbeams:eye:expression = "__import__('os')" """, r"eye:expression is wrong: expression .*"),
        ("float photonbeams:along:ramp:knots = 1", r"along:ramp:knots is 1\.0"),
        ("color3f[] photonbeams:along:tint = [(1, 1, 1)]", "along:tint is .*"),
        ("float[] photonbeams:noise:drift = [1, 2]", "noise:drift has 2 values"),
        ('string photonbeams:along:texture = "a.png"', r"along:texture names a\.png"),
        ("int photonbeams:noise:octaves = 9", "noise:octaves is 9"),
        ("float photonbeams:noise:scale = 0", "noise:scale is 0"),
        ("float photonbeams:variation = 2", "variation is 2.*"),
        ("float photonbeams:angle:anisotropy = 1", "angle:anisotropy is 1.*"),
        ("color3f photonbeams:along:tint = (nan, 1, 1)", "along:tint is .*"),
        ("asset photonbeams:along:texture = @gone.png@", r"along:texture names gone\.png"),
    ],
)
def test_what_cannot_be_a_look_is_an_error_that_names_prim_and_attribute(read, body, message):
    with pytest.raises(SceneError, match=rf"stage\.usda: /Look\.photonbeams:{message}"):
        read(body)


def test_a_schema_can_be_applied_and_a_look_defined():
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/Look", "PhotonBeamsLook")
    assert prim.GetAttribute("photonbeams:across:profile").Get() == "epanechnikov"
    lamp = stage.DefinePrim("/Lamp", "SphereLight")
    assert lamp.ApplyAPI("PhotonBeamsLightAPI")
    assert lamp.GetAttribute("photonbeams:intensity").Get() == 1
    assert lamp.GetAttribute("photonbeams:count").Get() is None
