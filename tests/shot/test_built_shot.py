"""Shots of scenes that are built in Python have the pictures of stages with the same content."""

import numpy as np
import pytest

import photonbeams as pb
from photonbeams import scene

STAGE = """#usda 1.0
def Camera "Eye" {
    float focalLength = 50
    float horizontalAperture = 40
    float verticalAperture = 20
    float2 clippingRange = (0.001, 1000000)
    double3 xformOp:translate = (0.2, 0.5, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "Lamp" {
    float inputs:radius = 0.25
    color3f inputs:color = (3, 2, 1)
    string photonbeams:lightGroup = "key"
    double3 xformOp:translate = (0.5, 1, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Mesh "Floor" {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-2, -1, 2), (2, -1, 2), (2, -1, -2), (-2, -1, -2)]
    uniform token subdivisionScheme = "none"
}
def Scope "Fog" {
    color3f photonbeams:scattering = (0.1, 0.1, 0.125)
}
"""
FLOOR = scene.Mesh(
    "/Floor",
    np.array([[-2.0, -1, 2], [2, -1, 2], [2, -1, -2], [-2, -1, -2]]),
    np.array([[0, 1, 2], [0, 2, 3]]),
)
LAMP = scene.SphereLight("/Lamp", (3, 2, 1), center=np.array([0.5, 1, 0]), radius=0.25, group="key")
FOG = pb.Medium((0.1, 0.1, 0.125), name="/Fog")
#: An aperture of 40 at a focal length of 50 has a field of view of 2 atan 0.4.
CAMERA = scene.Camera.look_at([0.2, 0.5, 5], [0.2, 0.5, 0], fov=float(np.degrees(2 * np.arctan(0.4))), aspect=2)
SMALL = {"width": 32, "passes": 1, "beams": 300}


def shot(**given):
    return pb.Shot(scene.Scene(meshes=[FLOOR], lights=[LAMP], media=[FOG]), CAMERA, **given)


def test_it_is_the_picture_of_the_stage_that_says_the_same(tmp_path):
    (tmp_path / "shot.usda").write_text(STAGE)
    expected = pb.Shot.open(tmp_path / "shot.usda").render(**SMALL).layers
    found = shot().render(**SMALL).layers
    assert found["rgba"].shape == (16, 32, 4) and found.keys() == expected.keys()
    assert found["beams_key"].any() and found["surface"].any()
    for name, values in expected.items():
        # The stage's numbers have single precision, so the sizes of the two scenes differ by rounding.
        np.testing.assert_allclose(found[name], values, rtol=2e-4, atol=1e-5, err_msg=name)


def test_it_has_eyes_looks_and_checkpoints_as_stages_have(tmp_path):
    red = pb.Look(along=pb.looks.Attenuation() * pb.looks.Constant((1, 0, 0)))
    two = shot(stereo=pb.Stereo(interaxial=0.2, convergence=5), looks={"Lamp": red})
    frame = two.render(7, checkpoint=tmp_path / "kept.npz", **SMALL)
    left, right = (frame.views[eye][0]["beams"] for eye in ("left", "right"))
    assert left[..., 0].any() and not left[..., 1:].any() and not np.array_equal(left, right)
    again = two.render(7, checkpoint=tmp_path / "kept.npz", **SMALL)
    np.testing.assert_array_equal(again.layers["rgba"], frame.layers["rgba"])
    assert frame.metadata["frame"] == 7


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: pb.Shot(scene.Scene(media=[FOG]), CAMERA).render(**SMALL), "there is no light"),
        (lambda: pb.Shot(scene.Scene(), "camera"), "camera is 'camera': expected a scene.Camera"),
        (lambda: scene.Scene(lights=[FLOOR]), "lights hold a Mesh: expected each to be a Light"),
        (lambda: scene.Mesh("/M", [[0, 0, 0]], [[0, 0, 1]]), "mesh /M: faces name the point 1: expected 0 to 0"),
        (lambda: scene.Mesh("/M", [[0, 0]], [[0, 0, 0]]), "mesh /M: points have the shape"),
        (lambda: scene.SphereLight("/Lamp", -1), "/Lamp: radiance is -1: expected"),
        (lambda: scene.SphereLight("/Lamp", 1, center=[0, 1]), r"/Lamp: center is \[0, 1\]: expected 3 finite numbers"),
        (
            lambda: shot(looks={"Sun": pb.Look()}).render(**SMALL),
            "the scene: no beams are named Sun: expected one of /La",
        ),
        (lambda: scene.Camera.look_at([0, 0, 0], [0, 1, 0]), "up not along the line"),
    ],
)
def test_what_is_wrong_is_told_in_a_sentence(build, words):
    with pytest.raises(pb.SceneError, match=words):
        build()
