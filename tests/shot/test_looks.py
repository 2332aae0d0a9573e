"""PhotonBeamsLook prims, and the schemas."""

import numpy as np
import pytest
from pxr import Sdf, Usd

from photonbeams.scene import SceneError
from photonbeams.shot.looks import AcrossSpec, AlongSpec, AngleSpec, EyeSpec, LookSpec, Span
from photonbeams.shot.schemas import FOLDER

LIGHT = 'def SphereLight "L" {\nrel photonbeams:look = </Look>\n}\n'


def look(body):
    return f'{LIGHT}def PhotonBeamsLook "Look" {{\n{body}\n}}\n'


@pytest.fixture
def read(scene):
    return lambda body: scene(look(body)).lights[0].look


def test_a_look_without_attributes_is_physical(read):
    single = {key: float(np.float32(value)) for key, value in {"width": 0.35, "anisotropy": 0.8}.items()}
    across, angle = AcrossSpec(width=single["width"]), AngleSpec(anisotropy=single["anisotropy"])
    assert read("") == LookSpec("/Look", across=across, angle=angle)
    assert (AlongSpec().falloff, AcrossSpec().profile, EyeSpec().falloff, AngleSpec().shading) == (
        "physical",
        "epanechnikov",
        "physical",
        "physical",
    )


def test_the_schemas_fallbacks_are_those_of_the_spec():
    """The fallbacks are written twice, in schema.usda and in the dataclasses: they agree."""
    definition = Usd.SchemaRegistry().FindConcretePrimDefinition("PhotonBeamsLook")
    fallbacks = {
        "along:falloff": AlongSpec().falloff,
        "along:length": AlongSpec().length,
        "along:exponent": AlongSpec().exponent,
        "along:physical": AlongSpec().physical,
        "along:ramp:interpolation": AlongSpec().interpolation,
        "along:space": Span().space,
        "along:begin": Span().begin,
        "along:end": Span().end,
        "across:profile": AcrossSpec().profile,
        "across:width": AcrossSpec().width,
        "across:hardness": AcrossSpec().hardness,
        "eye:falloff": EyeSpec().falloff,
        "eye:length": EyeSpec().length,
        "angle:shading": AngleSpec().shading,
        "angle:anisotropy": AngleSpec().anisotropy,
        "angle:mix": AngleSpec().mix,
        "angle:gain": AngleSpec().gain,
    }
    for name, value in fallbacks.items():
        found = definition.GetAttributeFallbackValue(f"photonbeams:{name}")
        assert found == (pytest.approx(value) if isinstance(value, float) else value)


def test_a_ramp_is_read(read):
    spec = read("""
        float[] photonbeams:along:ramp:knots = [0, 0.5, 2]
        color3f[] photonbeams:along:ramp:colors = [(1, 1, 1), (1, 0.5, 0), (0.25, 0, 0)]
        uniform token photonbeams:along:ramp:interpolation = "catmullRom"
        uniform token photonbeams:along:space = "distance"
        float photonbeams:along:begin = 1
        float photonbeams:along:end = 3
        bool photonbeams:along:physical = 0
        color3f photonbeams:along:tint = (0.5, 1, 1)""").along
    assert spec.knots == (0, 0.5, 2)
    assert spec.colors == ((1, 1, 1), (1, 0.5, 0), (0.25, 0, 0))
    assert spec.interpolation == "catmull-rom"
    assert spec.span == Span("distance", 1, 3)
    assert not spec.physical
    assert spec.tint == (0.5, 1, 1)


def test_falloffs_are_read(read):
    spec = read("""
        uniform token photonbeams:along:falloff = "polynomial"
        float[] photonbeams:along:coefficients = [1, -2, 1]
        float photonbeams:along:length = 3
        float photonbeams:along:exponent = 1.5
        uniform token photonbeams:eye:falloff = "exponential"
        float photonbeams:eye:length = 7""")
    assert (spec.along.falloff, spec.along.coefficients) == ("polynomial", (1, -2, 1))
    assert (spec.along.length, spec.along.exponent) == (3, 1.5)
    assert spec.eye == EyeSpec("exponential", 7)


def test_profiles_and_angles_are_read(read):
    spec = read("""
        uniform token photonbeams:across:profile = "tabulated"
        float[] photonbeams:across:values = [1, 0.5, 0]
        float photonbeams:across:hardness = 0.25
        float photonbeams:across:width = 0.5
        uniform token photonbeams:angle:shading = "glow"
        float photonbeams:angle:anisotropy = 0.5
        float photonbeams:angle:mix = 0.25
        float photonbeams:angle:gain = 2""")
    assert spec.across == AcrossSpec("tabulated", 0.5, 0.25, (1, 0.5, 0))
    assert spec.angle == AngleSpec("glow", 0.5, 0.25, 2)


def test_a_texture_along_the_beam_is_decoded_and_its_rows_averaged(read, image):
    path = image("ramp.exr", [[[1, 0, 0], [0, 1, 0]], [[3, 0, 0], [0, 1, 2]]], "float")
    found = read(f"asset photonbeams:along:texture = @{path}@").along.texture
    assert np.allclose(found, [[2, 0, 0], [0, 1, 1]])


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
    assert "/Look.photonbeams:along:lenght is no attribute of a PhotonBeamsLook" in caplog.text


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            "float[] photonbeams:along:ramp:knots = [0, 1]",
            r"along:ramp:knots has 2 values and along:ramp:colors 0: expected as many of each",
        ),
        (
            "float[] photonbeams:along:ramp:knots = [1, 0]\n"
            "color3f[] photonbeams:along:ramp:colors = [(1, 1, 1), (1, 1, 1)]",
            r"along:ramp:knots is \[1\.0, 0\.0\]: expected positions that ascend",
        ),
        (
            "float[] photonbeams:along:ramp:knots = [0.5, 0.5]\n"
            "color3f[] photonbeams:along:ramp:colors = [(1, 1, 1), (1, 1, 1)]",
            r"along:ramp:knots is \[0\.5, 0\.5\]: expected positions that ascend",
        ),
        (
            "float[] photonbeams:along:ramp:knots = [nan]\ncolor3f[] photonbeams:along:ramp:colors = [(1, 1, 1)]",
            r"along:ramp:knots\[0\] is nan: expected finite numbers",
        ),
        (
            "float[] photonbeams:along:ramp:knots = [0]\ncolor3f[] photonbeams:along:ramp:colors = [(1, -1, 1)]",
            r"along:ramp:colors\[0\] is .*: expected one or three finite numbers of at least 0",
        ),
        (
            'uniform token photonbeams:along:falloff = "steep"',
            r"along:falloff is 'steep': expected one of physical, none",
        ),
        ('uniform token photonbeams:along:falloff = "polynomial"', r"along:coefficients is empty"),
        ("float photonbeams:along:length = 0", r"along:length is 0: expected a positive number"),
        ("float photonbeams:along:end = -1", r"along:end is -1: expected more than along:begin, 0"),
        (
            'uniform token photonbeams:across:profile = "tabulated"',
            r"across:values is \[\]: a tabulated profile expects",
        ),
        (
            "float photonbeams:across:hardness = 2",
            r"across:hardness is 2.*: expected a finite number at least 0 at most 1",
        ),
        (
            'uniform token photonbeams:eye:falloff = "power"',
            r"eye:falloff is 'power': expected one of physical, none, exp",
        ),
        ("float photonbeams:angle:anisotropy = 1", r"angle:anisotropy is 1.*: expected"),
        ("color3f photonbeams:along:tint = (nan, 1, 1)", r"along:tint is .*: expected one or three finite numbers"),
        ("asset photonbeams:along:texture = @gone.png@", r"along:texture names gone\.png: expected an image file"),
    ],
)
def test_what_cannot_be_a_look_is_an_error_that_names_prim_and_attribute(read, body, message):
    with pytest.raises(SceneError, match=rf"stage\.usda: /Look\.photonbeams:{message}"):
        read(body)


def test_every_attribute_of_the_schemas_is_documented():
    registry = Usd.SchemaRegistry()
    definitions = [registry.FindConcretePrimDefinition("PhotonBeamsLook")]
    for name in ("PhotonBeamsLightAPI", "PhotonBeamsCurvesAPI", "PhotonBeamsMediumAPI"):
        definitions.append(registry.FindAppliedAPIPrimDefinition(name))
    for definition in definitions:
        names = definition.GetPropertyNames()
        assert names
        for name in names:
            assert definition.GetPropertyDocumentation(name), name


def test_the_generated_schema_is_the_schema():
    """There is no usdGenSchema in the pip build of OpenUSD, so the two files are kept alike by hand."""
    source, generated = (Sdf.Layer.FindOrOpen(str(FOLDER / name)) for name in ("schema.usda", "generatedSchema.usda"))
    names = {spec.name for spec in source.rootPrims} - {"GLOBAL"}
    assert names == {spec.name for spec in generated.rootPrims}
    for name in names:
        ours, theirs = source.GetPrimAtPath(f"/{name}"), generated.GetPrimAtPath(f"/{name}")
        assert ours.documentation == theirs.documentation
        assert [str(spec) for spec in ours.properties] == [
            str(spec).replace("generatedS", "s") for spec in theirs.properties
        ]
        for one, other in zip(ours.properties, theirs.properties, strict=True):
            assert {key: one.GetInfo(key) for key in one.ListInfoKeys()} == {
                key: other.GetInfo(key) for key in other.ListInfoKeys()
            }


def test_a_schema_can_be_applied_and_a_look_defined():
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/Look", "PhotonBeamsLook")
    assert prim.GetAttribute("photonbeams:across:profile").Get() == "epanechnikov"
    lamp = stage.DefinePrim("/Lamp", "SphereLight")
    assert lamp.ApplyAPI("PhotonBeamsLightAPI")
    assert lamp.GetAttribute("photonbeams:intensity").Get() == 1
    assert lamp.GetAttribute("photonbeams:count").Get() is None
