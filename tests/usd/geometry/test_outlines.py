"""What is read at times other than the rendered one: how far a stage extends, and what is the same at all times."""

import numpy as np

from photonbeams.usd.contents import hull_corners
from photonbeams.usd.stage import read_extent, read_scene
from photonbeams.world.bounds import bounding_sphere

STAGE = """def Sphere "Still" { double3 xformOp:translate = (4, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"] }
def Mesh "Growing" {
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points.timeSamples = {
        1: [(0, 0, 0), (1, 0, 0), (0, 1, 0), (99, 0, 0)],
        2: [(0, 0, 0), (2, 0, 0), (0, 2, 0), (99, 0, 0)],
    }
}
def PointInstancer "Copies" {
    rel prototypes = [</Copies/Ball>]
    int[] protoIndices.timeSamples = { 1: [0, 0], 2: [0, 7] }
    point3f[] positions = [(0, 0, -9), (0, 0, 9)]
    def Sphere "Ball" { double radius = 0.5 }
}
"""


def test_outlines_reach_as_far_as_the_surfaces_without_a_warning(usd, caplog):
    stage, lasting = usd(STAGE), {}
    for time in (1, 2):
        outline = bounding_sphere([read_extent(stage, time, lasting)], [])
        assert not caplog.records  # not even about the instance that has no prototype at time 2
        center, radius = bounding_sphere([read_scene(stage, time)], [])
        assert np.allclose(outline[0], center)
        assert np.isclose(outline[1], radius)
        caplog.clear()


def test_what_does_not_change_is_the_same_object_at_all_times(usd):
    stage, lasting = usd(STAGE), {}
    first, second, again = (
        {mesh.name: mesh for mesh in read_scene(stage, time, lasting=lasting).meshes} for time in (1, 2, 2)
    )
    assert first["/Still"] is second["/Still"]
    assert first["/Copies[0]"] is second["/Copies[0]"]
    assert first["/Growing"] is not second["/Growing"]
    assert np.ptp(second["/Growing"].points[:, 0]) == np.ptp(again["/Growing"].points[:, 0]) == 2


def test_the_corners_of_a_hull_are_those_of_all_points(rng):
    points = rng.normal(size=(2000, 3))
    corners = hull_corners(points)
    assert len(corners) < 500
    ways = rng.normal(size=(3, 100))
    assert np.allclose((points @ ways).max(axis=0), (corners @ ways).max(axis=0))
    flat = points * [1, 1, 0]
    assert len(hull_corners(flat)) == len(flat)
