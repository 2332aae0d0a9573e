"""The stage that most tests of the studio show: a lamp with a look, a ball and fog."""

STAGE = """#usda 1.0
(
    defaultPrim = "World"
)
def Xform "World"
{
    def Camera "Camera"
    {
        double3 xformOp:translate = (0, 0, 4)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def SphereLight "Lamp" (prepend apiSchemas = ["PhotonBeamsLightAPI"])
    {
        float inputs:radius = 0.05
        float inputs:intensity = 20
        int photonbeams:count = 300
        rel photonbeams:look = </World/Look>
    }
    def PhotonBeamsLook "Look"
    {
        color3f photonbeams:along:tint = (1, 0.5, 0.2)
    }
    def Sphere "Ball"
    {
        double radius = 0.3
        double3 xformOp:translate = (0.8, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Cube "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"])
    {
        color3f photonbeams:scattering = (0.2, 0.2, 0.2)
    }
}
"""
