"""The stage that the command renders in most tests: a lamp above a floor, in fog, seen by a camera."""

FOG = """def Scope "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) {
    color3f photonbeams:scattering = (0.1, 0.1, 0.1)
}
"""
CAMERA = """def Camera "Camera" {
    float focalLength = 20
    float horizontalAperture = 32
    float verticalAperture = 18
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
LAMP = """def SphereLight "Lamp" {
    float inputs:radius = 0.1
    float inputs:intensity = 10
}
"""
FLOOR = """def Mesh "Floor" {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-2, -1, 2), (2, -1, 2), (2, -1, -2), (-2, -1, -2)]
    uniform token subdivisionScheme = "none"
}
"""


def write_stage(path, *prims, metadata="startTimeCode = 7\n    endTimeCode = 9"):
    path.write_text(f"#usda 1.0\n(\n    {metadata}\n)\n{''.join(prims)}")
    return path


KEY = LAMP.replace("}\n", '    token photonbeams:lightGroup = "key"\n}\n')
FILL = KEY.replace('"Lamp"', '"Fill"').replace('"key"', '"fill"').replace(
    "float inputs:radius", "double3 xformOp:translate.timeSamples = { 1: (1, 0, 0), 4: (0, 1, 0) }\n"
    '    uniform token[] xformOpOrder = ["xformOp:translate"]\n    float inputs:radius',
)  # fmt: skip
