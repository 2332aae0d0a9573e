"""A lamp in fog above a floor, as the prims that Blender's extension sends."""

import numpy as np

CAMERA = "/Camera"


def prims(intensity=10.0):
    """Return the prims of the scene: a floor, a lamp, the fog and the camera, which looks along +Y."""
    corners = np.array([[-4, -4, 0], [4, -4, 0], [4, 4, 0], [-4, 4, 0]], np.float32)
    down = np.eye(4)
    down[3, :3] = 0, 0, 2
    eye = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, -6, 1, 1]])
    return [
        {"path": "/Floor", "type": "Mesh", "values": {
            "points": ["point3f[]", corners], "faceVertexIndices": ["int[]", np.arange(4, dtype=np.int32)],
            "faceVertexCounts": ["int[]", np.array([4], np.int32)], "subdivisionScheme": ["token", "none"],
        }},
        {"path": "/Lamp", "type": "SphereLight", "matrix": down, "apis": ["ShapingAPI"], "values": {
            "inputs:intensity": ["float", intensity], "inputs:normalize": ["bool", True],
            "inputs:radius": ["float", 0.05], "inputs:shaping:cone:angle": ["float", 30.0],
            "photonbeams:lightGroup": ["token", "key"],
        }},
        {"path": "/Fog", "type": "Scope", "apis": ["PhotonBeamsMediumAPI"], "values": {
            "photonbeams:scattering": ["color3f", [0.1, 0.1, 0.1]],
        }},
        {"path": CAMERA, "type": "Camera", "matrix": eye, "values": {
            "focalLength": ["float", 50.0], "horizontalAperture": ["float", 36.0], "verticalAperture": ["float", 20.25],
        }},
    ]  # fmt: skip
