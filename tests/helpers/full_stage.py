"""A stage with a prim of nearly every kind that is read."""

from __future__ import annotations

STAGE = """#usda 1.0
(
    renderSettingsPrimPath = "/Settings"
)
def RenderSettings "Settings"
{
    rel camera = </Camera>
    uniform int2 resolution = (64, 32)
    uniform float4 dataWindowNDC = (0, 0, 1, 1)
    rel products = </Settings/Product>
    def RenderProduct "Product"
    {
        token productName = "a.exr"
        rel orderedVars = </Settings/Product/Var>
        def RenderVar "Var"
        {
            uniform string sourceName = "depth"
        }
    }
}
def Camera "Camera"
{
    token projection = "perspective"
    float2 clippingRange = (0.1, 100)
    float focalLength = 20
    float horizontalAperture = 32
    float verticalAperture = 18
    float horizontalApertureOffset = 0
    float fStop = 4
    float focusDistance = 5
    float exposure = 0
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Scope "Fog" (
    prepend apiSchemas = ["PhotonBeamsMediumAPI"]
)
{
    color3f photonbeams:scattering = (0.1, 0.1, 0.1)
    color3f photonbeams:absorption = (0.1, 0.1, 0.1)
    float photonbeams:anisotropy = 0.5
    int photonbeams:bounces = 1
}
def SphereLight "Lamp" (
    prepend apiSchemas = ["PhotonBeamsLightAPI", "ShapingAPI"]
)
{
    float inputs:radius = 0.1
    float inputs:intensity = 10
    float inputs:exposure = 1
    color3f inputs:color = (1, 1, 1)
    bool inputs:enableColorTemperature = 1
    float inputs:colorTemperature = 5000
    bool inputs:normalize = 1
    float inputs:shaping:cone:angle = 40
    float inputs:shaping:focus = 1
    bool photonbeams:enabled = 1
    int photonbeams:count = 100
    float photonbeams:intensity = 1
    int photonbeams:seed = 3
    token photonbeams:lightGroup = "key"
    token photonbeams:scattered = "physical"
    rel photonbeams:look = </Look>
    rel photonbeams:portal = </Portal>
    rel photonbeams:guides = </Guide>
    rel collection:lightLink:includes = </Mesh>
    rel collection:shadowLink:excludes = </Ball>
    double3 xformOp:translate = (0, 3, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def RectLight "Panel"
{
    float inputs:width = 1
    float inputs:height = 2
}
def DistantLight "Sun"
{
    float inputs:angle = 1
}
def DomeLight "Sky"
{
    token inputs:texture:format = "latlong"
}
def PhotonBeamsLook "Look"
{
    token photonbeams:along:falloff = "exponential"
    float photonbeams:along:length = 2
    float[] photonbeams:along:ramp:knots = [0, 1]
    color3f[] photonbeams:along:ramp:colors = [(1, 0, 0), (0, 0, 1)]
    token photonbeams:across:profile = "gaussian"
    float photonbeams:across:width = 0.3
    float photonbeams:noise:amount = 0.5
}
def Plane "Portal"
{
    double width = 2
    double length = 2
}
def BasisCurves "Guide"
{
    uniform token type = "linear"
    int[] curveVertexCounts = [3]
    point3f[] points = [(0, 3, 0), (0, 2, 0), (1, 1, 0)]
}
def BasisCurves "Drawn" (
    prepend apiSchemas = ["PhotonBeamsCurvesAPI"]
)
{
    uniform token type = "cubic"
    uniform token basis = "bspline"
    int[] curveVertexCounts = [4, 5]
    point3f[] points = [
        (0, 0, 0), (1, 0, 0), (2, 1, 0), (3, 0, 0), (0, 1, 0), (1, 1, 0), (2, 2, 0), (3, 1, 0), (4, 1, 0)
    ]
    float[] widths = [0.1, 0.2] (
        interpolation = "uniform"
    )
    color3f[] photonbeams:power = [(1, 1, 1)]
}
def Mesh "Mesh" (
    prepend apiSchemas = ["MaterialBindingAPI"]
)
{
    int[] faceVertexCounts = [4, 3]
    int[] faceVertexIndices = [0, 1, 2, 3, 0, 1, 4]
    point3f[] points = [(-2, -1, 2), (2, -1, 2), (2, -1, -2), (-2, -1, -2), (0, 1, 0)]
    normal3f[] normals = [(0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 1, 0)]
    vector3f[] velocities = [(0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 1, 0)]
    uniform token orientation = "rightHanded"
    uniform token subdivisionScheme = "none"
    int[] holeIndices = []
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1)] (
        interpolation = "vertex"
    )
    int[] primvars:st:indices = [0, 1, 2, 0, 1]
    color3f[] primvars:displayColor = [(1, 0, 0)]
    rel material:binding = </Material>
    def GeomSubset "Part" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [1]
        rel material:binding = </Material>
    }
}
def Sphere "Ball"
{
    double radius = 1
    token visibility = "inherited"
    uniform token purpose = "default"
    float3 xformOp:scale = (1, 1, 1)
    uniform token[] xformOpOrder = ["xformOp:scale"]
}
def PointInstancer "Copies"
{
    rel prototypes = [</Copies/Cube>]
    int[] protoIndices = [0, 0, 0]
    point3f[] positions = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]
    quath[] orientations = [(1, 0, 0, 0), (1, 0, 0, 0), (1, 0, 0, 0)]
    float3[] scales = [(1, 1, 1), (1, 1, 1), (1, 1, 1)]
    int64[] ids = [1, 2, 3]
    int64[] invisibleIds = [2]
    def Cube "Cube"
    {
        double size = 1
    }
}
def Material "Material"
{
    token outputs:surface.connect = </Material/Surface.outputs:surface>
    def Shader "Surface"
    {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor.connect = </Material/Image.outputs:rgb>
        float inputs:roughness = 0.5
        float inputs:opacity = 1
        float inputs:ior = 1.5
        token outputs:surface
    }
    def Shader "Image"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @gone.png@
        float4 inputs:fallback = (1, 0, 0, 1)
        token inputs:wrapS = "repeat"
        float2 inputs:st.connect = </Material/Reader.outputs:result>
        float3 outputs:rgb
    }
    def Shader "Reader"
    {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "st"
        float2 outputs:result
    }
}
"""
