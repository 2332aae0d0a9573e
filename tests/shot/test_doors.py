"""The ways into a shot: what `Shot` and `Shot.open` take, old Mitsuba scenes, and shots that are pickled."""

import ast
import inspect
import pickle
from dataclasses import fields
from fractions import Fraction
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.runtime.device import mitsuba
from photonbeams.scene import SceneError
from photonbeams.shot.old_scenes import converted
from tests.helpers.mitsuba_scenes import camera, cube_of, fog, rgb

pytestmark = pytest.mark.usefixtures("helping_thread")

mi = mitsuba()
DICTIONARY = {
    "type": "scene", "fog": cube_of(fog(0.5)), "sensor": camera((0.2, 0.3, 4), width=16, height=12),
    "lamp": {"type": "point", "position": [0.3, 0.4, 0.2], "intensity": rgb([3.0, 2.0, 1.0])},
}  # fmt: skip
BUILT = pb.scene.Scene(lights=pb.scene.SphereLight("/Lamp", 50.0), media=pb.Medium(0.1))


EYE = pb.scene.Camera.look_at((0, 0, 5), (0, 0, 0))
BUILT_SHOT = pb.Shot(BUILT, EYE)


def render(shot, **given):
    return shot.render(passes=2, beams=200, method="beams", guiding=False, **given)


# -- What is taken -------------------------------------------------------------------------------------------------


def test_help_shows_the_parameters_of_a_shot():
    assert [*inspect.signature(pb.Shot).parameters][:3] == ["stage", "camera", "medium"]


def test_a_medium_is_typed_by_all_of_its_fields():
    """Types are checked with the constructor that the source shows them; the dataclass has its own."""
    source = ast.parse(Path(inspect.getsourcefile(pb.Medium)).read_text())
    (medium,) = [each for each in ast.walk(source) if isinstance(each, ast.ClassDef) and each.name == "Medium"]
    (shown,) = [each for each in ast.walk(medium) if isinstance(each, ast.FunctionDef) and each.name == "__init__"]
    assert [each.arg for each in shown.args.args[1:]] == [each.name for each in fields(pb.Medium)]
    assert ast.unparse(shown.args.args[1].annotation) == "ColorLike"


@pytest.mark.parametrize(
    "value", [DICTIONARY, BUILT, None, 5, [1], b"a.usda", ""], ids=lambda each: type(each).__name__
)
def test_open_takes_the_name_of_a_file_and_says_what_takes_others(value):
    with pytest.raises(SceneError, match=r"expected the name of a file; pb\.Shot\(\.\.\.\) takes") as refused:
        pb.Shot.open(value)
    assert len(str(refused.value)) <= 300


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("a.usda", "Shot.open takes a file"),
        ({}, "stage is {}: expected a Usd.Stage"),
        ({"type": "sphere"}, "stage is a Shape of Mitsuba's: expected a Scene"),
        ({"type": "scene", "lamp": {"type": "lampp"}}, 'Plugin "lampp" not found'),
        ({"type": "scene", "integrator": {"type": "photon_beams", "order": 0}}, "photon_beams: order is 0: expected 1"),
        (mi.load_dict({"type": "diffuse"}), "stage is a BSDF of Mitsuba's: expected a Scene"),
    ],
    ids=str,
)
def test_a_shot_says_what_it_cannot_be_made_of(value, message):
    with pytest.raises(SceneError) as refused:
        pb.Shot(value)
    assert message in str(refused.value) and "Traceback" not in str(refused.value)
    assert len(str(refused.value)) <= 300


LAMP, PAIR = BUILT.lights[0], np.zeros(2)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: pb.Plate(LAMP), "expected a file's name, or pixels"),
        (lambda: pb.Holdout(PAIR, kind=PAIR), "holdout-depth is [0., 0.]: expected one of"),
        (lambda: pb.Holdout(PAIR, scale="1"), "holdout-scale is 1: expected more than 0"),
        (lambda: pb.scene.SphereLight("/L", LAMP), "/L: radiance is SphereLight("),
        (lambda: pb.scene.SphereLight("/L", 1, shadow_distance=PAIR), "/L: shadow_distance is [0., 0.]"),
        (lambda: pb.scene.Camera("c", np.eye(4), projection=PAIR), "camera c: projection is [0., 0.]"),
        (lambda: pb.scene.Camera.panorama("c", np.eye(4), []), "camera c: projection is []: expected one of"),
        (lambda: pb.Shot.open("a.usda", overrides=[5]), "one of several arguments is 5: expected a str or a PathLike"),
        (lambda: pb.Shot.open("a.usda", session_layers=5), "one of several arguments is 5"),
        (lambda: pb.Shot.open("a.usda", mask=5), "mask is 5: expected text or several of them, each text"),
        (lambda: pb.Shot.open("a.usda", complexity=[]), "complexity is []: expected text"),
        (lambda: pb.Shot.open("a.usda", texture_limit=10**400), "texture_limit is 1000"),
        (lambda: render(BUILT_SHOT, progress=5), "progress is 5: expected a function of 2 arguments"),
        (lambda: render(BUILT_SHOT, progress=int), "progress is <class 'int'>: expected a function of 2 arguments"),
        (lambda: render(BUILT_SHOT, progress=lambda: 0), ">: expected a function of 2 arguments"),
        (lambda: render(BUILT_SHOT, progress=max), "progress is <built-in function max>: expected a function of 2"),
        (lambda: pb.Shot(BUILT, EYE, emit=lambda: None), ">: expected a function of 1 argument"),
        (lambda: pb.Shot(BUILT, EYE, emit=int), "emit is <class 'int'>: expected a function of 1 argument"),
        (lambda: pb.Shot(BUILT, EYE, simulate=int), "simulate is <class 'int'>: expected a function of 2 arguments"),
        (lambda: pb.Shot(BUILT, EYE, medium=5), "medium is 5: expected a Medium or a function of 1 argument"),
        (lambda: pb.Shot(BUILT, looks=pb.Look), "looks is <class 'photonbeams.looks.look.Look'>: expected a Look"),
        (lambda: pb.Shot(BUILT, looks={"/L": pb.Look}), "looks is <class 'photonbeams.looks.look.Look'> for /L: exp"),
        (lambda: pb.looks.BoundLook(pb.Look, None, 1.0, None, ((0, 0, 0), (1, 1, 1))), "look.Look'>: expected a Look"),
        (lambda: pb.looks.BoundLook(look=1.0), "BoundLook lacks fog, reach, context, box: expected look"),
        (lambda: pb.looks.BoundLook(1.0, None, 1.0, None, ((0, 0, 0), (1, 1, 1))), "look is 1.0: expected a Look"),
        (lambda: render(BUILT_SHOT, frame=10**400), "frame is 1000"),
        (lambda: render(BUILT_SHOT, blur=PAIR), "blur is [0., 0.]: expected True or False"),
        (lambda: render(BUILT_SHOT, checkpoint=5), "path is 5: expected text or a path"),
        (lambda: BUILT_SHOT.resolution(pixel_aspect=0), "pixel_aspect is 0: expected a finite number at least 0.001"),
        (lambda: BUILT_SHOT.resolution(plates=5), "plates is 5: expected several of them, each a Holdout or a Plate"),
        (lambda: pb.scene.SphereLight(5, 1.0), "name is 5: expected text"),
        (lambda: pb.scene.SphereLight("/L", 1.0, seen="x"), "seen is 'x': expected True or False"),
        (lambda: pb.scene.SphereLight("/L"), "SphereLight lacks radiance"),
        (lambda: pb.scene.Mesh("/M", 5, [[0, 1, 2]]), "mesh /M: points have the shape (): expected (0, 3) numbers"),
        (lambda: pb.scene.Mesh.box("/M", "x"), "mesh /M: [low, high] is ['x', (1, 1, 1)]: expected two corners"),
        (lambda: pb.scene.Mesh.box("/M", to_world=PAIR), "low and high have the shape (3,), to_world (2,): expected"),
        (lambda: pb.scene.Camera("c", np.diag([0, 0, 0, 1])), "expected 4 x 4 finite numbers, a transform that can be"),
        (lambda: pb.scene.Camera.look_at((0, 0, 1), (0, 0, 0), fov="x"), "fov is 'x': expected a number"),
        (lambda: pb.scene.SphereLight("/L", 1.0, frame=None), "/L: frame"),
        (lambda: BUILT_SHOT.render(crop=[[1], [1, 2]]), "the crop is [[1], [1, 2]]: expected four numbers"),
        (lambda: BUILT_SHOT.resolution(width=-(10**400)), "expected 1 to"),
        (lambda: pb.bend([1, 2]), "a guide is 1: expected (M, 3) points"),
        (lambda: pb.scene.Scene(lights=np.array(None)), "lights hold a NoneType: expected each to be a Light"),
        (lambda: pb.scene.SphereLight("/L", 1.0, frame=np.full((4, 4), np.nan)), "expected 4 x 4 finite numbers"),
        (lambda: pb.scene.SphereLight("/L", 1.0, radius=Fraction(1, 3)), "radius is 1/3: expected a number"),
        (lambda: pb.scene.Camera("c", np.eye(4), clipping=(1, 0)), "clipping is (1, 0): expected two finite numbers"),
        (lambda: pb.scene.Camera("c", np.eye(4), clipping=(1,)), "clipping is (1,): expected two finite numbers"),
        (lambda: pb.scene.Camera("c", np.eye(4), lens_radius=-1.0), "lens_radius is -1.0: expected a finite number"),
        (lambda: pb.scene.Camera("c", np.eye(4), exposure_scale=np.nan), "exposure_scale is nan: expected a finite"),
        (lambda: pb.scene.Camera("c", np.eye(4), focal_length=0.0), "focal_length is 0.0: expected a finite number"),
        (lambda: pb.scene.Camera.panorama("c", np.eye(4), field=5), "field is 5: expected several of them, each a num"),
        (lambda: pb.colors_of_medium(5, 1.0), "medium is 5: expected a Medium"),
        (lambda: pb.Beams.load(1.5), "path is 1.5: expected text or a path"),
        (lambda: pb.Shot(BUILT, pb.scene.Camera("c", np.eye(4)), lambda _: 5).read(), "of the medium returns is 5"),
    ],
)  # fmt: skip
def test_arguments_of_other_types_are_refused(call, message):
    with pytest.raises(SceneError) as refused:
        call()
    assert message in str(refused.value)


def test_a_frame_is_not_written_over_what_its_shot_reads(tmp_path):
    plate, gobo, stage = (tmp_path / name for name in ("plate.exr", "gobo.png", "a.usda"))
    other = pb.shot.Frame({"rgba": np.ones((9, 16, 4), np.float32)}, {}, None)
    other.write(plate)
    other.write(gobo)
    stage.write_text("""#usda 1.0
def Camera "C" {}
def Cube "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"])
{
    color3f photonbeams:scattering = (0.2, 0.2, 0.2)
}
def SphereLight "Lamp" (prepend apiSchemas = ["PhotonBeamsLightAPI"])
{
    asset photonbeams:gobo = @./gobo.png@
}
""")
    before = gobo.read_bytes()
    frame = render(pb.Shot.open(stage), width=16, height=9, over=plate)
    for path in (gobo, plate):
        with pytest.raises(SceneError, match=f"{path.name} would replace .*{path.name}, which is read"):
            frame.write(path)
    assert gobo.read_bytes() == before
    pickle.loads(pickle.dumps(frame)).write(tmp_path / "other.exr")


def test_a_dictionary_and_its_scene_are_one_shot_and_it_can_be_pickled():
    scene = mi.load_dict(DICTIONARY)
    with pytest.raises(SceneError, match="that Mitsuba has loaded cannot be pickled"):
        pickle.dumps(pb.Shot(scene))
    with pytest.raises(SceneError, match="cannot be pickled: expected"):
        from pxr import Usd

        pickle.dumps(pb.Shot(Usd.Stage.CreateInMemory()))
    assert repr(pickle.loads(pickle.dumps(pb.Shot(BUILT, pb.scene.Camera.look_at((0, 0, 5), (0, 0, 0))))))
    first, second = (render(each).layers for each in (pb.Shot(scene), pb.Shot(DICTIONARY)))
    assert first["beams"].any() and all(np.array_equal(first[name], second[name]) for name in first)


# -- Scenes with what Mitsuba does not have ------------------------------------------------------------------------

NEW = """<scene version="3.0.0">
  <default name="spp" value="2"/>
  <integrator type="volpath"><integer name="max_depth" value="3"/></integrator>
  <medium type="homogeneous" id="fog">
    <rgb name="sigma_t" value="0.25, 0.5, 0.75"/><rgb name="albedo" value="0.5, 0.75, 0"/>
    <float name="scale" value="2"/>
    <phase type="hg"><float name="g" value="0.3"/></phase>
  </medium>
  <sensor type="perspective">
    <float name="fov" value="40"/><string name="fov_axis" value="x"/>
    <transform name="to_world"><lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
    <sampler type="independent"><integer name="sample_count" value="$spp"/></sampler>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="12"/>
      <rfilter type="box"/></film>
    <ref id="fog"/>
  </sensor>
  <bsdf type="diffuse" id="orange"><rgb name="reflectance" value="1, 0.21586050011389926, 0.05126945837404324"/></bsdf>
  <shape type="sphere"><float name="radius" value="0.5"/>
    <bsdf type="roughplastic"><rgb name="diffuse_reflectance" value="0.5"/><float name="int_ior" value="1.5"/></bsdf>
  </shape>
  <shape type="rectangle">
    <transform name="to_world"><scale x="3" y="3" z="1"/><translate x="0" y="0" z="-1"/></transform><ref id="orange"/>
  </shape>
  <emitter type="spot"><transform name="to_world"><lookat origin="0, 2, 2" target="0, 0, 0" up="0, 1, 0"/></transform>
    <rgb name="intensity" value="9, 8, 7"/><float name="cutoff_angle" value="30"/><float name="beam_width" value="10"/>
  </emitter>
</scene>
"""
#: What Mitsuba 0.6 writes instead; the names of properties follow.
OLD = {
    'version="3.0.0"': 'version="0.6.0"', "lookat": "lookAt", "volpath": "volpath_simple", "hdrfilm": "ldrfilm",
    "independent": "ldsampler",
    '<rfilter type="box"/>':
        '<float name="gamma" value="2.2">\n</float><boolean name="banner" value="false"/><rfilter type="box"/>',
    '<rgb name="sigma_t" value="0.25, 0.5, 0.75"/><rgb name="albedo" value="0.5, 0.75, 0"/>':
        '<spectrum name="sigmaA" value="0.125, 0.125, 0.75"/><rgb name="sigmaS" value="0.125, 0.375, 0"/>',
    '"scale"': '"densityMultiplier"', '<rgb name="reflectance" value="1, 0.21586050011389926, 0.05126945837404324"/>':
        '<srgb name="reflectance" value="#ff8040"/>',
    '<rgb name="diffuse_reflectance" value="0.5"/>':
        '<rgb name="diffuseReflectance" value="0.5" intent="reflectance"/>',
    '<rgb name="intensity" value="9, 8, 7"/>': '<spectrum name="intensity" value="9, 8, 7"/>',
    '<integer name="max_depth" value="3"/>':
        '<integer name="maxDepth" value="3"/><boolean name="strictNormals" value="true"/>',
    "fov_axis": "fovAxis", "to_world": "toWorld", "sample_count": "sampleCount", "int_ior": "intIOR",
    "cutoff_angle": "cutoffAngle", "beam_width": "beamWidth",
}  # fmt: skip


def old(text):
    for new, other in OLD.items():
        assert new in text
        text = text.replace(new, other)
    return text


@pytest.fixture
def written(tmp_path):
    def write(text, name="scene.xml"):
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return write


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    path = tmp_path_factory.mktemp("new") / "new.xml"
    path.write_text(NEW)
    return render(pb.Shot.open(path)).layers


DEPTH = '<integer name="max_depth" value="3"/>'
UNKNOWN = NEW.replace("volpath", "bdpt").replace("independent", "halton")
UNKNOWN = UNKNOWN.replace(DEPTH, f'{DEPTH}<boolean name="light_image" value="true"/>')


@pytest.mark.parametrize("text", [UNKNOWN, old(NEW)], ids=["unknown", "old"])
def test_a_scene_renders_without_what_mitsuba_lacks_and_a_render_replaces(written, expected, text):
    shot = pb.Shot.open(written(text), overrides="spp=5")
    settings = shot.settings()
    assert (settings.passes, settings.max_depth, shot.resolution()) == (5, 3, (16, 12))
    assert expected["beams"].any()
    found = render(pickle.loads(pickle.dumps(shot))).layers
    assert all(np.array_equal(found[name], expected[name]) for name in expected)


FOG = """<scene version="{version}"><integrator type="volpath"/>
  <sensor type="perspective">
    <transform name="{to_world}"><lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="6"/>{film}</film>
  </sensor>
  <shape type="cube">{bsdf}<medium name="interior" type="homogeneous">{medium}</medium></shape>
  <emitter type="point"><point name="position" x="0" y="3" z="0"/><rgb name="intensity" value="30"/></emitter>
</scene>
"""


@pytest.mark.parametrize(
    "medium",
    [
        '<rgb name="sigmaS" value="2, 4, 0"/><rgb name="sigmaA" value="2, 0, 0"/><float name="scale" value="0.5"/>',
        '<volume name="density" type="constvolume"><rgb name="value" value="2, 2, 0"/></volume>'
        '<volume name="albedo" type="constvolume"><rgb name="value" value="0.5, 1, 0"/></volume>'
        '<string name="method" value="woodcock"/>',
    ],
)
def test_an_old_fog_is_thick_and_light_passes_its_boundary(written, medium):
    """Mitsuba 3 takes colours up to 1, and makes a boundary without a BSDF diffuse; Mitsuba 0.6 does neither."""
    film = '<string name="pixelFormat" value="rgb, luminance"/>'
    text = FOG.format(version="0.6.0", to_world="toWorld", film=film, bsdf="", medium=medium)
    text = text.replace('<rgb name="intensity"', '<spectrum name="intensity"')
    if "constvolume" in medium:
        text = text.replace("homogeneous", "heterogeneous")
    thick = '<rgb name="sigma_t" value="1, 1, 0"/><rgb name="albedo" value="0.5, 1, 0"/><float name="scale" value="2"/>'
    new = FOG.format(version="3.0.0", to_world="to_world", film="", bsdf='<bsdf type="null"/>', medium=thick)
    first, second = (
        pb.Shot.open(written(each)).render(passes=1, beams=100, method="beams", guiding=False) for each in (text, new)
    )
    assert second.layers["beams"].any()
    np.testing.assert_allclose(first.layers["beams"], second.layers["beams"], rtol=1e-4, atol=1e-6)


def test_an_old_fog_may_have_spectra(written):
    """A spectrum that is v at all wavelengths of sight has the luminance v."""
    medium = '<spectrum name="sigmaS" value="0.2"/><spectrum name="sigmaA" value="360:0.1, 600:0.1 830:0.1"/>'
    text = FOG.format(version="0.6.0", to_world="toWorld", film="", bsdf="", medium=medium)
    found = {
        each.get("name"): [float(number) for number in each.get("value").split(",")]
        for each in ElementTree.fromstring(converted(written(text))).iter("rgb")
    }
    luminance = [0.2126, 0.7152, 0.0722]
    assert np.dot(luminance, found["sigmaT"]) == pytest.approx(0.3, rel=0.01)
    assert np.dot(luminance, np.multiply(found["sigmaT"], found["albedo"])) == pytest.approx(0.2, rel=0.01)


def test_old_scenes_include_old_scenes(written, expected):
    body = old(NEW)
    start, end = body.index("<bsdf"), body.index("<emitter")
    written(f'<scene version="0.5.0">{body[start:end]}</scene>', "part.xml")
    text = converted(written(f'{body[:start]}<include filename="part.xml"/>{body[end:]}'))
    assert converted(written(body, "whole.xml")).split() == text.split()
    assert converted(written(NEW)) is None


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('type="diffuse"', 'type="phong"', 'line 18, col 4: failed to instantiate bsdf plugin of type "phong"'),
        (
            '<rgb name="sigmaS" value="0.125, 0.375, 0"/>',
            '<string name="material" value="Skin1"/>',
            '"material": "Skin1"',
        ),
        (
            '<spectrum name="intensity" value="9, 8, 7"/>',
            '<blackbody name="intensity" temperature="3000K"/>',
            "<blackbody>",
        ),
        ("</scene>", "", "mismatch"),
    ],
)
def test_an_old_scene_that_is_not_plain_is_refused_in_a_sentence(written, before, after, message):
    with pytest.raises(SceneError) as refused:
        pb.Shot.open(written(old(NEW).replace(before, after)))
    assert message in str(refused.value) and len(str(refused.value)) <= 300
    assert str(refused.value).endswith("; the scene is of Mitsuba 0.6.0: expected one of Mitsuba 3")
