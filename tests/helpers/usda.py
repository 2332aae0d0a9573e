"""Prims as text, for the stages of tests."""


def prim(kind: str, name: str, at: object, *lines: str, turned: object = (0, 0, 0), api: str = "") -> str:
    """Return a prim at a position, with further lines and, if given, an applied schema."""
    body = "\n".join(f"    {each}" for each in lines)
    applied = f'(prepend apiSchemas = ["{api}"])' if api else ""
    return f"""
def {kind} "{name}" {applied}
{{
{body}
    double3 xformOp:translate = {at}
    float3 xformOp:rotateXYZ = {turned}
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
}}
"""


def quad(name: str, points: object, material: str, more: str = "") -> str:
    """Return a mesh of four points with a material."""
    return f"""
def Mesh "{name}" (prepend apiSchemas = ["MaterialBindingAPI"])
{{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = {points}
    rel material:binding = </{material}>
    {more}
}}
"""


def material(name: str, *inputs: str, nodes: str = "") -> str:
    """Return a UsdPreviewSurface; `nodes` are further shaders of the material."""
    lines = "\n".join(f"        {each}" for each in inputs)
    return f"""
def Material "{name}"
{{
    token outputs:surface.connect = </{name}/Surface.outputs:surface>
    def Shader "Surface"
    {{
        uniform token info:id = "UsdPreviewSurface"
{lines}
        token outputs:surface
    }}
{nodes}}}
"""


def textured(name: str, file: str) -> str:
    """Return a material whose colour is an image, the shader Image; `file` is the declaration of its `inputs:file`."""
    image = f"""    def Shader "Image"
    {{
        uniform token info:id = "UsdUVTexture"
        {file}
        float3 outputs:rgb
    }}
"""
    return material(name, f"color3f inputs:diffuseColor.connect = </{name}/Image.outputs:rgb>", nodes=image)
