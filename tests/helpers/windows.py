"""A room with windows and a sun, in plain numbers and as a stage: where the openings are is known."""

from itertools import pairwise

import numpy as np

from photonbeams import scene

#: Windows of the room, by their corners: two in the wall x = 0, and one in the wall z = 0.
WINDOWS = np.array([[[0, 1, 1], [0, 2, 2]], [[0, 1, 3], [0, 2, 4]], [[1, 1, 0], [2, 2, 0]]], dtype=float)
#: The direction of the sun's light, which passes all of them.
SUN = np.array([0.7, -0.35, 0.62])


def wall(name, origin, right, size, holes=()):
    """Return a wall, `size` wide and 3 high, along the axis `right`, with square holes from 1 to 2 in height."""
    right, up = np.eye(3)[right], np.array([0.0, 1.0, 0.0])
    columns = sorted({0.0, size, *(each + end for each in holes for end in (0.0, 1.0))})
    quads = []
    for low, high in pairwise(columns):
        rows = [(0, 1), (2, 3)] if low in holes else [(0, 3)]
        quads += [[(low, down), (high, down), (high, top), (low, top)] for down, top in rows]
    points = [np.asarray(origin) + x * right + y * up for corners in quads for x, y in corners]
    faces = [[4 * each + a for a in (0, b, b + 1)] for each in range(len(quads)) for b in (1, 2)]
    return scene.Mesh(name, np.array(points), np.array(faces))


def flat(name, y):
    """Return a floor or a roof."""
    corners = np.array([[0, y, 0], [5, y, 0], [5, y, 6], [0, y, 6]], dtype=float)
    return scene.Mesh(name, corners, np.array([[0, 1, 2], [0, 2, 3]]))


def room(*lights):
    """Return the room, 5 x 3 x 6 units, with lights; without any, with the sun."""
    meshes = (
        wall("/Left", (0, 0, 0), 2, 6.0, (1.0, 3.0)), wall("/Back", (0, 0, 0), 0, 5.0, (1.0,)),
        wall("/Right", (5, 0, 0), 2, 6.0), wall("/Front", (0, 0, 6), 0, 5.0), flat("/Floor", 0), flat("/Roof", 3),
    )  # fmt: skip
    sun = scene.DistantLight("/Sun", 3e4, axis=SUN / np.linalg.norm(SUN), angle=0.5)
    return scene.Scene(meshes=meshes, lights=lights or (sun,))


def camera():
    """Return a camera in the middle of the front wall."""
    return scene.Camera.look_at(origin=(2.6, 1.5, 5.8), target=(2.6, 1.5, 0), name="/Camera", fov=95)


def stage_text(metadata=""):
    """Return the room as the text of a stage in centimetres, as another program may export it."""
    lines = ["#usda 1.0", "(", "    metersPerUnit = 0.01", '    upAxis = "Y"', metadata, ")"]
    for mesh in room().meshes:
        points = ", ".join(f"({x:g}, {y:g}, {z:g})" for x, y, z in 100 * mesh.points)
        indices = ", ".join(map(str, mesh.faces.ravel()))
        lines += [
            f'def Mesh "{mesh.name[1:]}" {{', f"    int[] faceVertexCounts = [{', '.join(['3'] * len(mesh.faces))}]",
            f"    int[] faceVertexIndices = [{indices}]", f"    point3f[] points = [{points}]",
            '    uniform token subdivisionScheme = "none"', "}",
        ]  # fmt: skip
    turned = np.degrees([np.arctan2(-SUN[0], -SUN[2]), np.arcsin(SUN[1] / np.linalg.norm(SUN))])
    lines += [
        'def Xform "Lights" {', '    def DistantLight "Sun" {', "        float inputs:angle = 0.5",
        "        float inputs:intensity = 30000",
        f"        float3 xformOp:rotateXYZ = ({turned[1]}, {turned[0]}, 0)",
        '        uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]', "    }", "}",
        'def Camera "Camera" {', "    float focalLength = 16", "    float horizontalAperture = 36",
        "    float verticalAperture = 20", "    double3 xformOp:translate = (260, 150, 580)",
        '    uniform token[] xformOpOrder = ["xformOp:translate"]', "}",
    ]  # fmt: skip
    return "\n".join(lines)
