"""A mesh with a network of shaders."""

MESH = """
def SphereLight "Lamp" {
}
def Mesh "M" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")
    color3f[] primvars:paint = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)] (interpolation = "vertex")
    color3f[] primvars:displayColor = [(0.3, 0.2, 0.1)] (interpolation = "constant")
    rel material:binding = </Mat>
}
"""


def shader(name, kind, *inputs):
    lines = "\n".join(inputs)
    return f'''def Shader "{name}" {{
        uniform token info:id = "{kind}"
        {lines}
        token outputs:surface
        color3f outputs:out
    }}'''


def material(kind, *inputs, nodes=(), context="", more=""):
    output = f"token outputs:{context}surface.connect = </Mat/S.outputs:surface>"
    body = "\n".join([output, shader("S", kind, *inputs), *nodes, more])
    return f'{MESH}\ndef Material "Mat" {{\n{body}\n}}'


STANDARD = ["arnold:standard_surface", "ND_standard_surface_surfaceshader"]
PIXELS = [[[0.2, 0.4, 0.6], [0.8, 1, 0]]]
