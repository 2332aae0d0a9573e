"""A shot at survey coordinates has the picture that it has near zero, and what users see has their coordinates."""

from dataclasses import fields, replace
from itertools import chain

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import photonbeams as pb
from photonbeams import scene
from photonbeams.images.steady import FilmFrame
from photonbeams.scene import places
from photonbeams.scene.places import Origin, moved
from photonbeams.world.bounds import origin_of
from tests.helpers.windows import camera, room

# A room that single precision made 27 % too bright, and one whose surfaces were off by as much light as they had.
FAR, FARTHER = (408201.0, 0.0, 4080928.0), (691000.0, 5334000.0, 520.0)
# What single precision may leave. The renderer measures from within a size of the shot, where single precision has 1e-7
# of the size, and light paths are the same: pictures do not differ by noise.
CLOSE = 0.01
LAYERS = {"positions": True, "normals": True}
SIZE = {"width": 32, "height": 32, "passes": 1, "beams": 1024}

ROOM = """def Camera "Cam" {
    float focalLength = 18
    float horizontalAperture = 36
    float verticalAperture = 36
    double3 xformOp:translate = (0, 1.5, 6)
    double3 xformOp:translate:then.timeSamples = { 1: (0, 0, 0), 9: (1, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:translate:then"]
}
def Mesh "Floor" {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-4, 0, 4), (4, 0, 4), (4, 0, -4), (-4, 0, -4)]
}
def Sphere "Ball" {
    double radius = 0.3
    double3 xformOp:translate = (-0.6, 1.2, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Cube "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) {
    double size = 10
    color3f photonbeams:scattering = (0.1, 0.1, 0.1)
}
def SphereLight "Lamp" (prepend apiSchemas = ["ShapingAPI"]) {
    float inputs:radius = 0.05
    float inputs:intensity = 2000
    float inputs:shaping:cone:angle = 25
    double3 xformOp:translate = (-0.5, 4, 0)
    float xformOp:rotateX = -90
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
}
"""


@pytest.fixture
def room_at(tmp_path):
    """Return a function that writes the room under a transform, and returns the file."""

    def write(place, more=""):
        path = tmp_path / f"room{place[0]:.0f}.usda"
        move = 'uniform token[] xformOpOrder = ["xformOp:translate"]'
        world = f'def Xform "W" {{\n    double3 xformOp:translate = {tuple(map(float, place))}\n    {move}\n{ROOM}}}\n'
        path.write_text(f"#usda 1.0\n(\n    startTimeCode = 1\n    endTimeCode = 9\n)\n{world}{more}")
        return path

    return write


def off(near, far):
    """Return the mean difference of two pictures, relative to the mean of the first; of black ones 0."""
    there = np.isfinite(near)
    assert np.array_equal(there, np.isfinite(far))
    return float(np.abs(near[there] - far[there]).mean() / max(np.abs(near[there]).mean(), 1e-9))


def check_alike(near, far, place=FAR):
    """Check that frames show the same room, with the coordinates that it has in each."""
    for name, layer in near.layers.items():
        if name != "position":
            assert off(layer, far.layers[name]) < CLOSE, name
    if "position" in near.layers:
        seen = np.isfinite(near.layers["depth"])[..., 0]
        own = far.layers["position"][seen].astype(np.float64) - place
        # A layer has single precision, in which coordinates are so far apart.
        assert np.all(np.abs(own - near.layers["position"][seen]) <= np.spacing(np.float32(np.max(place))))


@pytest.mark.parametrize("place", [FAR, FARTHER])
def test_a_far_room_looks_as_it_does_near_zero(room_at, place):
    near, far = (pb.Shot.open(room_at(each)).render(**SIZE, **LAYERS) for each in (np.zeros(3), place))
    check_alike(near, far, place)
    assert np.allclose(np.linalg.inv(far.metadata["worldToCamera"].T)[:3, 3] - place, (0, 1.5, 6), atol=1e-6)


def test_a_far_scene_that_is_built_in_python_looks_as_it_does_near_zero():
    grid = scene.DensityGrid(np.ones((2, 2, 2)), _at((0.5, 0.5, 0.5)) @ np.diag([4.0, 2.0, 4.0, 1.0]))
    flag = scene.Blocker("/Flag", half=(0.2, 0.2, 0.0), flat=True, frame=_at((2.5, 2.0, 3.0)))
    place = (2.5, 2.5, 3.0)
    lamp = scene.SphereLight("/Lamp", 20.0, center=place, radius=0.05, filters=(flag,), frame=_at(place))
    content = scene.Scene(room().meshes, lamp, media=scene.Medium(0.1, grid=grid))
    check_alike(*(pb.Shot(*put(content, place)).render(**SIZE, **LAYERS) for place in (np.zeros(3), FAR)))


def put(content, place):
    """Return a scene that somebody built at a place, and its camera."""
    return replace(moved(content, np.array(place)), zero=places.ZERO), moved(camera(), np.array(place))


def _at(place):
    frame = np.eye(4)
    frame[:3, 3] = place
    return frame


def test_near_zero_nothing_is_moved():
    content = room()
    assert not origin_of([content], [camera().to_world[:3, 3]]).any()
    assert Origin().local(content) is content


def test_all_frames_and_workers_measure_from_the_same_point(room_at):
    path = room_at(FAR)
    zeros = {
        pb.Shot.open(path)._prepared(frame, 1, None, width=8, height=8).content.shutter.at(0.0).scene.zero
        for frame in (1, 5, 9)
    }
    assert len(zeros) == 1
    assert np.max(np.abs(np.array(next(iter(zeros))) + FAR)) < 20


def test_huge_grounds_and_what_was_left_at_zero_do_not_move_the_origin():
    (content, _), place = put(room(), FAR), np.array(FAR)
    ground = scene.Mesh("/Ground", [[-1e7, 0, -1e7], [1e7, 0, -1e7], [0, 0, 1e7]], [[0, 1, 2]])
    left = scene.Mesh("/Left", [[0, 0, 0], [1, 0, 0], [0, 0, 1]], [[0, 1, 2]])
    more = scene.Scene((*content.meshes, ground, left), (scene.SphereLight("/Forgotten", 1.0), *content.lights))
    assert np.abs(origin_of([more], [place]) - place).max() < 10  # the room is 8 units across


def test_every_place_of_a_scene_moves():
    """A field with numbers that is no place is listed here; a new one has to be listed, or to be moved."""
    others = {
        *("faces", "normals", "uvs", "power", "power_end", "end_normal", "start_normal", "side_normal"),
        *("start_tangent", "end_tangent", "radius_start", "radius_end", "offset", "total", "entry", "random", "id"),
        *("generation", "axis", "half", "half_x", "half_y", "shape", "image", "values", "knots", "colors", "bounds"),
        "up",
    }  # fmt: skip
    kinds = [scene.Scene, scene.Mesh, scene.Camera, scene.DrawnBeams, scene.Medium, scene.DensityGrid, scene.FogDensity,
             scene.Blocker, scene.DistanceRamp, scene.SphereLight, scene.FlatLight, scene.CylinderLight,
             scene.MeshLight, scene.DistantLight, scene.DomeLight]  # fmt: skip
    numbers = ("Array", "Vector", "Transform")
    every = chain.from_iterable(map(fields, kinds))
    names = {each.name for each in every if any(kind in str(each.type) for kind in numbers)}
    assert names - others == (places._POINTS | places._TRANSFORMS) - {"zero"}


@pytest.mark.parametrize(
    ("near", "far"),
    [
        ("noise(3 * P)", f"noise(3 * (P - [{FAR[0]:.0f}, 0, {FAR[2]:.0f}]))"),
        ("fit(P[2], -4, 4, 0, 1)", f"fit(P[2], {FAR[2] - 4:.0f}, {FAR[2] + 4:.0f}, 0, 1)"),
        ("noise(3 * Pl)", "noise(3 * Pl)"),
    ],
)
def test_looks_read_the_users_coordinates(room_at, near, far):
    def seen(place, text):
        look = pb.Look(along=pb.looks.Expression(text), surfaces="tint")
        return pb.Shot.open(room_at(place), looks=look).render(**SIZE)

    check_alike(seen(np.zeros(3), near), seen(FAR, far))


def test_programs_see_and_make_beams_in_the_users_coordinates(room_at):
    def seen(place):
        def narrow(beams, context):
            assert np.allclose(np.subtract(context.bounds[0], place), (0, 0, 0), atol=10)
            assert np.abs(context.medium.mesh.points - place).max() < 6
            assert np.abs(beams.arrays()["start"] - place).max() < 6
            beams.power = 0.5 * beams.power
            return beams

        def drawn(context):
            start, end = (np.array([[x, 1.0, 1.0]]) + place for x in (-2, 2))
            return scene.DrawnBeams("/Line", start, end, np.full(1, 0.1), np.full(1, 0.1), np.full((1, 3), 50.0))

        return pb.Shot.open(room_at(place), simulate=narrow, emit=drawn).render(**SIZE)

    check_alike(seen(np.zeros(3)), seen(FAR))


def test_beams_leave_in_the_users_coordinates_and_come_back(room_at, tmp_path):
    pictures = []
    for place in (np.zeros(3), np.array(FAR)):
        shot, path = pb.Shot.open(room_at(place)), tmp_path / f"beams{place[0]:.0f}.usda"
        starts = shot.beams(beams=64)[0].beams.arrays()["start"] - place
        assert np.abs(starts).max() < 6
        shot.write_beams(path, beams=64)
        written = Usd.Stage.Open(str(path))
        (curves,) = (UsdGeom.Xformable(each) for each in written.Traverse() if each.IsA(UsdGeom.Curves))
        assert bool(curves.GetOrderedXformOps()) == bool(place.any())
        lit = Usd.Stage.Open(str(room_at(place)))
        lit.GetRootLayer().subLayerPaths.append(str(path))
        lit.GetPrimAtPath("/W/Lamp").SetActive(False)
        pictures.append(pb.Shot(lit).render(**SIZE))
    check_alike(*pictures)


def test_films_at_far_places_are_steadied_as_near_zero(room_at, tmp_path):
    """The matrices of EXR's header have single precision, in which the camera is off by a quarter of a unit."""
    views = []
    for place in (np.zeros(3), np.array(FAR)):
        path = tmp_path / f"frame{place[0]:.0f}.exr"
        pb.Shot.open(room_at(place)).render(5, passes=1, width=16, height=16).write(path)
        views.append(FilmFrame.read(path).views[""])
    near, far = views
    depth = np.full_like(near.depth, 6.0)
    assert np.abs(far.points(depth)[:3].T - FAR - near.points(depth)[:3].T).max() < 1e-4
