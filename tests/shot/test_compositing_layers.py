"""Layers for compositing: positions, motion vectors and cryptomattes, by their formulas and as files hold them.

The stage is in centimetres, a kilometre from the origin: a turned card behind a ball that moves, seen by a camera that
moves and turns. The cryptomatte's reader is written from Psyop's specification alone.
"""

import json
import struct

import numpy as np
import OpenImageIO
import pytest

import photonbeams as pb
from photonbeams.images.files import read_layers

SIZE = 61
STAGE = """#usda 1.0
(
    metersPerUnit = 0.01
    startTimeCode = 1
    endTimeCode = 5
)
def Xform "Far" {
    double3 xformOp:translate = (0, 0, 100000)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Camera "Cam" {
        float focalLength = 50
        float horizontalAperture = 24
        float verticalAperture = 24
        double3 xformOp:translate.timeSamples = { 1: (1.3, 0.7, 600), 5: (21.3, 0.7, 600) }
        float xformOp:rotateY.timeSamples = { 1: 0, 5: 6 }
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]
    }
    def Sphere "Ball" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        double radius = 60
        rel material:binding = </Paint>
        double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 5: (0, 80, 0) }
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Mesh "Kärtchen" {
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-150, -100, -300), (20, -100, -250), (20, 100, -250), (-150, 100, -300)]
    }
    def SphereLight "Lamp" {
        float inputs:radius = 5
        double3 xformOp:translate = (0, 500, 500)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
def Material "Paint" {
    token outputs:surface.connect = </Paint/S.outputs:surface>
    def Shader "S" {
        uniform token info:id = "UsdPreviewSurface"
        token outputs:surface
    }
}
"""
LAYERS = {"positions": True, "motion": True, "crypto_object": True, "crypto_material": True}


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    path = tmp_path_factory.mktemp("stage") / "stage.usda"
    path.write_text(STAGE, encoding="utf-8")
    return pb.Shot.open(path)


@pytest.fixture(scope="module")
def frame(shot):
    return shot.render(
        1, passes=2, width=SIZE, height=SIZE, beams=16, surface_samples=32, pixel_filter="gaussian", **LAYERS
    )


def ndc(frame, places):
    """Return where places are in the picture: 0 to 1 from the left and from below."""
    to_ndc = np.float64(frame.metadata["worldToNDC"])
    found = np.concatenate([places, np.ones((*places.shape[:-1], 1))], axis=-1) @ to_ndc
    return found[..., :2] / found[..., 3:]


def test_positions_are_those_that_pixels_centres_see_at_their_depth(frame):
    place, depth = np.float64(frame.layers["position"]), frame.layers["depth"][..., 0]
    seen = np.isfinite(depth)
    assert seen.sum() > 500 and not place[~seen].any()
    row, column = np.mgrid[:SIZE, :SIZE] + 0.5
    wanted = np.stack([column, SIZE - row], axis=-1)[seen] / SIZE
    # Single precision at 100,000 units is 0.008, and a pixel is 4.7 units wide there.
    assert np.abs(ndc(frame, place[seen]) - wanted).max() < 2 * 0.008 / 4.7 / SIZE
    away = np.concatenate([place, np.ones((SIZE, SIZE, 1))], axis=-1) @ np.float64(frame.metadata["worldToCamera"])
    assert np.allclose(-away[seen][:, 2], depth[seen], atol=0.03)


def test_motion_is_how_far_surfaces_and_the_background_move_until_the_next_frame(frame, shot):
    motion, depth, place = (np.float64(frame.layers[name]) for name in ("motion", "depth", "position"))
    later = shot.render(2, passes=1, width=SIZE, height=SIZE, beams=16)
    ball = depth[..., 0] < 700
    card = np.isfinite(depth[..., 0]) & ~ball
    assert ball.sum() > 300 and card.sum() > 300
    for pixels, moved in ((ball, [0, 20, 0]), (card, [0, 0, 0])):
        before, after = ndc(frame, place[pixels]), ndc(later, place[pixels] + moved)
        # As above: both projections round the place.
        assert np.abs((after - before) * SIZE - motion[pixels]).max() < 4 * 0.008 / 4.7
    # Directions far away only turn: by 1.5 degrees, in the middle of the picture.
    corner = motion[0, SIZE // 2]
    assert not np.isfinite(depth[0, SIZE // 2, 0])
    assert corner[0] == pytest.approx(np.tan(np.radians(1.5)) * 50 / 24 * SIZE, rel=2e-3)


def mattes(spec, layers, name):
    """Return the manifest's names with their coverages, (H, W), from a file's header and layers."""
    (key,) = (each.name[:-5] for each in spec.extra_attribs if each.name.endswith("/name") and each.value == name)
    assert spec.getattribute(f"{key}/hash") == "MurmurHash3_32"
    assert spec.getattribute(f"{key}/conversion") == "uint32_to_float32"
    result = {}
    for label, digits in json.loads(spec.getattribute(f"{key}/manifest")).items():
        wanted = struct.unpack("<f", bytes.fromhex(digits)[::-1])[0]
        pairs = [layers[f"{name}{number:02d}"][..., k : k + 2] for number in range(3) for k in (0, 2)]
        result[label] = sum(np.where(pair[..., 0] == np.float32(wanted), pair[..., 1], 0) for pair in pairs)
    return key, result


def test_cryptomattes_have_the_coverages_of_objects_and_materials(frame, tmp_path):
    frame.write(tmp_path / "frame.exr")
    layers = read_layers(tmp_path / "frame.exr")
    spec = OpenImageIO.ImageInput.open(str(tmp_path / "frame.exr")).spec()
    key, objects = mattes(spec, layers, "crypto_object")
    assert key == "cryptomatte/f834d0a"  # the hash of "crypto_object", as in files of other renderers
    assert [*objects] == ["/Far/Ball", "/Far/Kärtchen"]
    alpha = layers["rgba"][..., 3]
    # 64 stratified samples here and there in an edge's pixel: each of both errs by less than 1/32, in six deviations.
    # Where the first 16 agree, they miss less than a 16th of the pixel.
    total = sum(objects.values())
    edge = (total > 0) & (total < 1)
    assert edge.sum() > 100 and np.abs(total - alpha)[edge].max() < 2 / 32
    assert np.abs(total - alpha).max() < 3 / 32 and abs(float((total - alpha).mean())) < 1e-3
    _, materials = mattes(spec, layers, "crypto_material")
    assert [*materials] == ["/Paint"] and np.allclose(materials["/Paint"], objects["/Far/Ball"])
    # The silhouette of a sphere is the cone of its tangents; the mesh is inside of it by less than a percent.
    wanted = np.pi * 60**2 / (600**2 - 60**2) * (50 / 24 * SIZE) ** 2
    assert objects["/Far/Ball"].sum() == pytest.approx(wanted, rel=0.01)


def test_a_moving_object_covers_what_it_moves_over(shot):
    """Over the shutter interval an object's matte is blurred as the picture is."""
    moving = pb.Shot.open(shot.subject.name, overrides=["/Far/Cam.shutter:close=2"])
    frame = moving.render(1, passes=4, width=SIZE, height=SIZE, beams=16, surface_samples=32, crypto_object=True)
    layers = frame.layers
    total = sum(layers[f"crypto_object{number:02d}"][..., k] for number in range(3) for k in (1, 3))
    alpha = layers["rgba"][..., 3]
    blurred = (alpha > 0.1) & (alpha < 0.9)
    assert blurred.sum() > 150
    assert np.abs(total - alpha).max() < 0.13 and abs(float((total - alpha).mean())) < 3e-3


def test_mitsuba_scenes_have_mattes_by_ids_and_no_motion(tmp_path):
    path = tmp_path / "ball.xml"
    path.write_text("""<scene version="3.0.0">
        <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="24"/>
        <integer name="height" value="24"/><rfilter type="box"/></film>
        <transform name="to_world"><lookat origin="0,0,6" target="0,0,0" up="0,1,0"/></transform></sensor>
        <shape type="sphere" id="Ball"><bsdf type="diffuse" id="Paint"/></shape>
        <emitter type="point"><point name="position" x="0" y="5" z="5"/></emitter></scene>""")
    shot = pb.Shot.open(path)
    frame = shot.render(passes=1, beams=16, crypto_object=True, crypto_material=True, positions=True)
    frame.write(tmp_path / "ball.exr")
    spec, layers = OpenImageIO.ImageInput.open(str(tmp_path / "ball.exr")).spec(), read_layers(tmp_path / "ball.exr")
    ball, paint = mattes(spec, layers, "crypto_object")[1]["Ball"], mattes(spec, layers, "crypto_material")[1]["Paint"]
    assert ball[12, 12] == 1 and ball[0, 0] == 0 and np.array_equal(ball, paint)
    place = layers["position"][layers["depth"] < 9]
    assert np.allclose(np.linalg.norm(place, axis=1), 1, atol=1e-5)
    with pytest.raises(pb.SceneError, match="motion is a layer of stages"):
        shot.render(passes=1, motion=True)
